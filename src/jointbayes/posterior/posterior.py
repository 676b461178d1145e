"""The posterior: draws in physical units, with the few questions that are asked of every posterior."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from jointbayes.errors import ModelError
from jointbayes.frf import AnyStructure, Ports
from jointbayes.inference import Problem
from jointbayes.joint import AnyJoint
from jointbayes.posterior.checks import PredictiveCheck, check_of, checks_of
from jointbayes.posterior.diagnosis import diagnoses_of
from jointbayes.posterior.forecast import NextStep
from jointbayes.posterior.identifiability import Verdict
from jointbayes.posterior.knowledge import (
    Knowledge,
    UnderPremises,
    assumed_of,
    assumptions_of,
    directions_of,
    judged_names,
    known_in_workshop,
    profiles_of,
    rows_of,
    verdict_of,
    weighed_joints,
    what_decides_of,
    workshop_of,
)
from jointbayes.posterior.model_errors import mesh_of
from jointbayes.posterior.next_step import advice, next_steps
from jointbayes.posterior.other_structure import OtherStructure, predict_other
from jointbayes.posterior.prediction import FrfPrediction, predict_frf
from jointbayes.posterior.sampled import Sampled, by_ensemble, kept_findings
from jointbayes.posterior.storage import (
    PROBLEM_GROUP,
    FileRecord,
    arviz_tree,
    log_prior_of_joint,
    problem_arrays,
    to_arviz,
    write_tree,
)
from jointbayes.posterior.summary import (
    STIFFNESS_HEAD,
    Summary,
    measured_frequencies,
    stiffness_row,
    summarise,
    value_rows,
)
from jointbayes.posterior.verdicts import line_of
from jointbayes.reproducibility import one_blas_thread
from jointbayes.rounding import in_lines
from jointbayes.structure import StructureRecipe
from vibrecords.arrays import Array
from vibrecords.notebook_view import frf_svg, paragraph_html, table_html

_KERNEL_DRAWS = 4000
_MOST_SHOWN = 9  # quantities, where a posterior is printed


@dataclass(frozen=True, eq=False)
class Posterior(Sampled):
    """Draws from the posterior of a joint's stiffnesses, with a verdict on each; see `Sampled` for its parts.

    Examples
    --------
    >>> import jointbayes as jb
    >>> posterior = jb.sample(jb.load_case("configs/clamped_beam.toml"), seed=1)  # doctest: +SKIP
    >>> posterior.interval("k12"), posterior.verdict("k12")  # doctest: +SKIP
    """

    @property
    def check(self) -> PredictiveCheck:
        """Posterior predictive check of the data that were analysed, over draws evenly spaced among all.

        Of several tests that of the one which the model explains worst. The seed of the run also replicates the data.
        """
        return check_of(self)

    def verdict(self, name: str) -> Verdict:
        """Class of a stiffness with its interval, limit, reasons and conditions, made in one pass and frozen.

        It equals the string of its class: ``posterior.verdict("k22") == "identified"``; `str` adds the conditions.

        Inputs that a workshop does not know exactly are looked at where `under` was asked, and of a run that was kept.
        Else the verdict names them all.

        Raises
        ------
        ModelError
            If the joint's coordinates hold the stiffness rigid: there is nothing to judge.
        """
        return verdict_of(self, name)

    @property
    def under(self) -> Mapping[str, UnderPremises]:
        """Small posteriors under other premises, by name: ``posterior.under["workshop"].interval("k22")``.

        Each has ``.draws``, ``.interval(name, 0.95)``, ``.verdict(name)`` and ``.to_arviz()``.

        ``"exact"`` with nothing but the joint uncertain, ``"workshop"`` with material, length and damping as in a
        workshop where the case does not declare them exact; each where it can differ from the run, and settled. That
        of measured FRFs within their noise is a run of its own, ``jb.sample(case, premises="exact")``.
        """
        return {"workshop" if row.uncertain else "exact": UnderPremises(row) for row in rows_of(self)[1:] if row.known}

    @one_blas_thread()
    def summary(self, knowledge: Knowledge | None = None) -> Summary:
        """The numbers of the run: `print` shows a table, ``to_dict`` gives what ``summary.json`` holds.

        Parameters
        ----------
        knowledge
            What `gather_knowledge` found of it, for the section on what is identifiable; by default without.
        """
        warnings = () if self.case is None else tuple(map(str, self.case.warnings))
        return summarise(
            self,
            self.problem.first_guess.tolist(),
            measured_frequencies(self),
            knowledge,
            warnings,
            assumptions_of(self),
            None if self.case is None else self.case.about,
        )

    def predict_frf(
        self, ports: Ports | None = None, *, probability: float = 0.95, max_draws: int = 400, test: str | None = None
    ) -> FrfPrediction:
        """Median and interval of FRFs over posterior draws, as the measurement would show them without its noise.

        An uncertain gain is in them, as in the measured FRFs, and what the errors of measured bodies make of them.

        Parameters
        ----------
        ports
            Lines and DOFs; by default those of the measured FRFs. In the quantity that was measured.
        probability
            Probability inside the band at each line.
        max_draws
            At most so many draws, evenly spaced, are evaluated.
        test
            Name of the test, where there are several; by default the first.

        Raises
        ------
        ModelError
            If the data are natural frequencies and no lines are given, or a DOF does not exist.
        """
        part = self.problem.part(test)
        frf = None if part.test.data.shown_frfs is None else part.test.data.shown_frfs.frf
        if ports is None:
            if frf is None:
                words = part.test.data.words
                raise ModelError(f"FRF prediction: the data are {words}; expected lines and DOFs; give ports")
            ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
        quantity = "receptance" if frf is None else frf.quantity
        return predict_frf(part, self.thinned(max_draws), ports, quantity, probability)

    def predict(
        self,
        structure: "StructureRecipe | AnyStructure | Problem | Posterior",
        ports: Ports,
        joint: AnyJoint | None = None,
        **settings: Any,  # noqa: ANN401 (of `predict_other`)
    ) -> OtherStructure:
        """FRFs, natural frequencies and damping of a structure that was never tested, held by this joint.

        Parameters
        ----------
        structure
            The other structure without its joint: a recipe, a body such as `jb.Structure`, or a case, problem or
            posterior of it.
        ports
            Lines, outputs and inputs that are wanted.
        joint
            Where the joint acts there; by default at the DOFs of the test.
        **settings
            `uncertain`, `own`, `quantity`, `test`, `probability`, `max_draws`, see
            `jointbayes.posterior.other_structure.predict_other`.

        Raises
        ------
        ModelError
            If a DOF does not exist, the joint is of another size, or a quantity is none of the structure.
        """
        return predict_other(self, structure, ports, joint, **settings)

    def to_dataframe(self) -> Any:  # noqa: ANN401 (a pandas.DataFrame, loaded late)
        """The draws as a pandas.DataFrame: a row for each chain and draw, a column for each quantity, in its unit."""
        return self.draws.to_dataframe()

    def to_arviz(self, megabytes: float = 200.0, max_draws: int = 1000) -> Any:  # noqa: ANN401 (type depends on the ArviZ version)
        """Return the draws as ArviZ takes them: InferenceData before ArviZ 1.0, a DataTree from 1.0 on.

        A chain is an ensemble, for its walkers are proposed from each other: the first half of every walker's draws,
        walker after walker, then the second half. R̂ and effective sizes are then as here, within 5 % where a walker
        is as long as the stop rule asks, 50 autocorrelation times.

        Groups are ``posterior``, ``sample_stats``, ``prior``, ``observed_data``, ``posterior_predictive``,
        ``log_likelihood`` value by value, and ``log_prior``: of it ``coordinates`` is the density over θ, as priors are
        stated, and with ``to_quantities`` it is that over the quantities in ``posterior``. Where values depend on each
        other there is no ``log_likelihood``, and an attribute of ``posterior`` says why. Data are ``data``, of several
        tests ``data_NAME``, by ``quantity``, or of FRFs by ``frequency`` (Hz), ``output`` and ``input``: the
        magnitude, in addition to ``data_real`` and ``data_imag``.

        Parameters
        ----------
        megabytes
            Size of ``log_likelihood`` and ``posterior_predictive`` together. Draws are left out evenly, of all groups
            alike, until they fit; 20 of each chain stay. 0 leaves out these two groups and no draw.
        max_draws
            Draws of a chain at most, so that a figure of all takes less than a minute; without effect at 0 megabytes.
        """
        theta = self.theta.reshape(*self.log_density.shape, -1)
        return to_arviz(arviz_tree(self.problem, self.tree, theta, self.record.seed, megabytes, max_draws))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the posterior to a netCDF file, whole or not at all; `jointbayes.load_posterior` reads it.

        Its problem is kept with it, matrices, data and priors to the last bit, with the text of its case, and so are
        the prior's density at each draw, and findings that took time, so that a later report need not find them again.

        Raises
        ------
        WriteError
            If the file cannot be written; an older one is then still there.
        """
        problem, description = problem_arrays(self.problem)
        groups = {PROBLEM_GROUP: problem}
        of_text = self.case is not None and self.case.stated is self.problem
        record = FileRecord(self.record, self.best, self.estimate, description, kept_findings(self), of_text)
        if self.problem.prior.marginals:
            theta = self.theta.reshape(*self.log_density.shape, -1)
            groups["log_prior"] = log_prior_of_joint(self.problem.prior, theta)
        write_tree(self.tree, groups, record.as_text(), path)

    def __repr__(self) -> str:
        lines = [line_of(name, self.verdict(name)) for name in judged_names(self)[:_MOST_SHOWN]]
        lines += [f"{name}: {value}" for name, value in value_rows(self._nuisances)]
        shown, left = lines[:_MOST_SHOWN], len(judged_names(self)) + len(self._nuisances) - _MOST_SHOWN
        more = f"and {left} more" if left > 0 else ""
        body = [line for text in (*shown, more, *self._remarks) if text for line in in_lines(text, 2)]
        return "\n".join([*in_lines(self._title, 0), *body])

    def _repr_html_(self) -> str:
        part = next((part for part in self.problem.parts if part.test.data.shown_frfs), None)
        drawing = ""
        if part is not None and part.test.data.shown_frfs is not None:
            frf, prior, theta = part.test.data.shown_frfs.frf, part.prior, self.estimate.theta[None]
            ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
            best = part.frfs_as_measured(ports, frf.quantity, prior.values(theta), prior.factors(theta))[0]
            drawing = frf_svg(frf.frequency_hz, {"measured": frf.values[:, 0, 0], "MAP": best[:, 0, 0]})
        drawing += "".join(map(paragraph_html, self._remarks))
        rows = [stiffness_row(name, self.verdict(name)) for name in judged_names(self)]
        rows += [(name, value, "") for name, value in value_rows(self._nuisances)]
        return table_html(self._title, STIFFNESS_HEAD, rows, drawing)

    @property
    def _title(self) -> str:
        return f"Posterior of {self.record.case_name!r}. {self.record.state}"

    @property
    def _nuisances(self) -> dict[str, tuple[Array, str]]:
        names = [nuisance.name for nuisance in self.problem.prior.nuisances]
        return {name: (by_ensemble(self, name), self.unit(name)) for name in names}

    @property
    def _remarks(self) -> tuple[str, ...]:
        """What stands below the numbers where a posterior is printed."""
        return (*assumptions_of(self), self.estimate.sentence)


def region_level(posterior: Sampled, stiffness: ArrayLike) -> float:
    """Probability of the smallest highest-density region that holds a joint, shape (q,).

    0.95 or less means that the point lies inside the joint 95 % region; 1 where it is impossible. Whatever else
    is uncertain is integrated out: the density is then that of a kernel estimate.
    """
    parametrisation = posterior.problem.parametrisation
    if not parametrisation.describes(stiffness):
        return 1.0
    point = parametrisation.coordinates(stiffness)
    if posterior.problem.prior.nuisances:
        from scipy.stats import gaussian_kde  # late: a quarter of a second

        draws = posterior.problem.prior.joint(posterior.thinned(_KERNEL_DRAWS)).T
        estimate = gaussian_kde(draws)
        return float((estimate(draws) > estimate(point)).mean())
    return float((posterior.log_density > posterior.problem.log_posterior(point)[0]).mean())


def gather_knowledge(posterior: Posterior) -> Knowledge:
    """Check and examine a posterior; the seed of its run also replicates the data of the check.

    What a workshop does not know exactly, for the table of what freeing it does, is that of its case, if it has one.
    """
    rows = rows_of(posterior)
    judged = {name: verdict_of(posterior, name) for name in posterior.stiffness_names}
    steps: tuple[NextStep, ...] = ()
    if all(check.explains for check in checks_of(posterior)):
        workshop = known_in_workshop(rows)
        steps = next_steps(posterior, workshop_of(posterior) if workshop else None, workshop or judged)
    return Knowledge(
        check=check_of(posterior),
        directions=directions_of(posterior),
        profiles=profiles_of(posterior),
        freed=rows,
        assumed=assumed_of(posterior),
        weighed=weighed_joints(posterior),
        next_steps=steps,
        advice=advice(posterior, steps),
        decides=what_decides_of(posterior),
        mesh=mesh_of(posterior),
        diagnoses=diagnoses_of(posterior),
    )
