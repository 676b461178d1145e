"""The posterior: draws in physical units, what is computed from them, judged, summed up, and kept."""

import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError, require_count, require_probability
from jointbayes.frf import AnyStructure, Ports
from jointbayes.identification import MapEstimate
from jointbayes.inference import ErrorSizes, Problem
from jointbayes.joint import AnyJoint
from jointbayes.phrases import listed
from jointbayes.posterior.any_posterior import Solutions
from jointbayes.posterior.checks import PredictiveCheck, check_part
from jointbayes.posterior.compared_frfs import ComparedFrf, compare_frfs, sentences_of_faults
from jointbayes.posterior.coordinates import by_names
from jointbayes.posterior.decision import premises_sentences
from jointbayes.posterior.diagnosis import Diagnosis, diagnose
from jointbayes.posterior.directions import name_directions
from jointbayes.posterior.forecast import NextStep
from jointbayes.posterior.identifiability import ExactInputs, Verdict
from jointbayes.posterior.knowledge import (
    KeptKnowledge,
    Knowledge,
    UncertainInputsRow,
    assumed_beyond,
    effect_of_uncertain_inputs,
    inputs_taken_as_exact,
    known_in_workshop,
    simpler_joints,
    taken_as_exact,
    uncertain_quantities,
)
from jointbayes.posterior.limits import LikelihoodRegion, ProfileLikelihood
from jointbayes.posterior.model_errors import InferredError, MeshCheck, NoiseOfBodies, check_mesh, noise_of_bodies
from jointbayes.posterior.next_step import advice, next_steps
from jointbayes.posterior.other_structure import OtherStructure, predict_other
from jointbayes.posterior.prediction import FrfPrediction, LeftOut, predict_frf, predict_left_out
from jointbayes.posterior.run_record import RunRecord, SampledCase
from jointbayes.posterior.storage import (
    PROBLEM_GROUP,
    BestDraw,
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
    stiffness_row,
    summarise,
    value_rows,
)
from jointbayes.posterior.verdicts import MOST_UNKNOWNS, judge_stiffness, line_of
from jointbayes.posterior.what_decides import WhatDecides, what_decides
from jointbayes.reproducibility import one_blas_thread
from jointbayes.rounding import in_lines
from jointbayes.structure import StructureRecipe
from jointbayes.verdict_rule import RULE, VerdictRule
from vibrecords import FrfSet
from vibrecords.arrays import Array
from vibrecords.notebook_view import frf_svg, paragraph_html, table_html

_REGION_DRAWS, _KERNEL_DRAWS = 4000, 4000
_MOST_SHOWN = 9  # quantities, where a posterior is printed
_COMPARED_DRAWS = 20  # whose FRFs are compared with the measured ones
#: One cell of a table of cases; None where a number does not exist.
Cell = str | float | int | bool | None
#: Quantities that move all modes alike.
OF_ALL_MODES = ("youngs_modulus", "density", "length", "length_offset")
_SIZES, _STREAM = 8000, 7  # draws that the size of the model's error is told from, and their random numbers
#: Draws whose residuals are checked; fewer where these are millions, among which draws make no difference.
_CHECK_DRAWS, _FEWEST_CHECKED, _CHECKED_VALUES = 200, 12, 25_000_000


@dataclass(frozen=True, eq=False)
class Posterior:
    """Draws from the posterior of a joint's stiffnesses, with a verdict on each.

    Parameters
    ----------
    problem
        Structure, joint, data and prior.
    tree
        Groups ``posterior``, ``sample_stats`` (log density), ``prior`` and ``observed_data``, of several tests one of
        the last for each, ``observed_data_long``; draws have dimensions chain × draw, one chain per walker, with the
        walker's ensemble as a coordinate.
    estimate
        MAP with Laplace covariance.
    mode_theta, mode_log_density
        Joint mode: the best draw refined, shape (d,), and its log density.
    record
        How the draws came about.
    case
        The case that was sampled, for its report; None where there was none.
    """

    problem: Problem
    tree: xr.DataTree
    estimate: MapEstimate
    mode_theta: Array
    mode_log_density: float
    record: RunRecord
    case: SampledCase | None = None
    #: What `gather_knowledge` once found, as it was read with the draws.
    _kept_knowledge: KeptKnowledge | None = field(default=None, repr=False)

    def __getitem__(self, name: str) -> xr.DataArray:
        """Draws of one stiffness or other uncertain quantity, chain × draw, in its unit.

        Raises
        ------
        ModelError
            If there is no such quantity.
        """
        return _named(self.draws, name)

    def __contains__(self, name: object) -> bool:
        return name in self.draws.data_vars

    def __iter__(self) -> Iterator[str]:
        return iter(map(str, self.draws))

    def to_dataframe(self) -> Any:  # noqa: ANN401 (a pandas.DataFrame, loaded late)
        """The draws as a pandas.DataFrame: a row for each chain and draw, a column for each quantity, in its unit."""
        return self.draws.to_dataframe()

    @property
    def draws(self) -> xr.Dataset:
        """Draws in physical units, chain × draw: the quantities of the joint and what else is uncertain."""
        return self.tree["posterior"].to_dataset()

    @property
    def converged(self) -> bool:
        """Whether the sampler met its stop rule."""
        return self.record.converged

    @property
    def reason(self) -> str:
        """Why the sampler stopped, with figures."""
        return self.record.reason

    @property
    def mode(self) -> dict[str, float]:
        """Joint posterior mode (of the density over θ) in physical units, by name."""
        prior = self.problem.prior
        stiffness = dict(zip(self.stiffness_names, prior.values(self.mode_theta).tolist(), strict=True))
        names = (n.name for n in prior.nuisances)
        return stiffness | dict(zip(names, prior.nuisance_values(self.mode_theta).tolist(), strict=True))

    @property
    def mode_distance(self) -> float:
        """Largest distance of joint mode and MAP in Laplace standard deviations: 0 where they agree."""
        sd = np.sqrt(np.diag(self.estimate.covariance))
        return float(np.abs((self.mode_theta - self.estimate.theta) / sd).max())

    @property
    def mode_agrees(self) -> bool:
        """Whether joint mode and MAP are one point: within 0.01 standard deviations, or equal in density to 0.001.

        Along a direction that the data leave flat many points are equally the mode.
        """
        return self.mode_distance <= 0.01 or abs(self.mode_log_density - self.estimate.log_posterior) <= 1e-3

    @property
    def at_prior_edge(self) -> tuple[str, ...]:
        """Coordinates whose mode lies on an edge of the prior's support: there the prior decides, not the data."""
        return self.problem.prior.coordinates_at_edge(self.mode_theta)

    @property
    def stiffness_names(self) -> tuple[str, ...]:
        """Names of the joint's stiffnesses, in the order of `stiffness`."""
        return tuple(quantity.name for quantity in self.problem.quantities)

    def unit(self, name: str) -> str:
        """Unit of one stiffness or other quantity."""
        return str(_named(self.draws, name).attrs.get("units", ""))

    def values(self, name: str) -> Array:
        """All draws of one stiffness or other quantity, shape (chains, draws).

        Raises
        ------
        ModelError
            If there is no such quantity.
        """
        return _variable(self.draws, name)

    def prior_values(self, name: str) -> Array:
        """Draws of one stiffness from the prior, shape (1, draws)."""
        return _variable(self.tree["prior"].to_dataset(), name)

    @cached_property
    def stiffness(self) -> Array:
        """All draws of the joint's quantities, shape (n, q), chain after chain."""
        return np.stack([self.values(name).ravel() for name in self.stiffness_names], axis=-1)

    @property
    def prior_stiffness(self) -> Array:
        """Draws of the joint's quantities from the prior, shape (m, q)."""
        return np.stack([self.prior_values(name).ravel() for name in self.stiffness_names], axis=-1)

    @cached_property
    def theta(self) -> Array:
        """All draws of θ, shape (n, d), chain after chain."""
        prior = self.problem.prior
        rest = [n.coordinate(self.values(n.name).ravel()) for n in prior.nuisances]
        joint = prior.parametrisation.coordinates(self.stiffness)
        return np.concatenate([joint, *(column[:, None] for column in rest)], axis=1)

    @property
    def log_density(self) -> Array:
        """Log density over θ of each draw, up to the evidence, shape (chains, draws)."""
        return _variable(self.tree["sample_stats"].to_dataset(), "lp")

    def interval(self, name: str, probability: float = 0.95) -> tuple[float, float]:
        """Equal-tailed credible interval of one stiffness, in its unit.

        Raises
        ------
        ModelError
            If there is no such stiffness or the probability is not inside (0, 1).
        """
        require_probability(probability, "interval")
        tail = (1 - probability) / 2
        low, high = np.quantile(self.values(name), [tail, 1 - tail])
        return float(low), float(high)

    def by_ensemble(self, name: str) -> Array:
        """All draws of one quantity with walkers of an ensemble together, shape (ensembles, draws, walkers).

        Raises
        ------
        ModelError
            If there is no such quantity.
        """
        values = self.values(name)
        ensembles = len(np.unique(self.draws["ensemble"].values))
        return values.reshape(ensembles, -1, values.shape[1]).swapaxes(1, 2)

    @cached_property
    def check(self) -> PredictiveCheck:
        """Posterior predictive check of the data that were analysed, over draws evenly spaced among all.

        Of several tests that of the one which the model explains worst. The seed of the run also replicates the data.
        """
        return min(self.checks, key=lambda check: (check.explains, check.smallest_p_value))

    @cached_property
    def checks(self) -> tuple[PredictiveCheck, ...]:
        """The check of each test, at a level that allows for the checks of all."""
        each = [self._check(number, part) for number, part in enumerate(self.problem.parts)]
        n_tests = sum(check.n_own_tests for check in each)
        return tuple(replace(check, n_tests=n_tests) for check in each)

    def _check(self, number: int, part: Problem) -> PredictiveCheck:
        likelihood = part.log_posterior.likelihood
        theta = self.thinned(min(_CHECK_DRAWS, max(_FEWEST_CHECKED, _CHECKED_VALUES // likelihood.n_data)))
        return check_part(part, theta, np.random.default_rng([self.record.seed, 2, *([number] if number else [])]))

    @cached_property
    def model_error(self) -> InferredError | None:
        """The model's error in natural frequencies as it was inferred; None where there is no place for one."""
        prior, likelihood = self.problem.prior, self.problem.log_posterior.likelihood
        laws = (test.noise.shares for test in self.problem.tests if test.noise is not None)
        law = next((law for law in laws if isinstance(law, ErrorSizes)), None)
        if law is None:
            return None
        rng, theta = np.random.default_rng([self.record.seed, _STREAM]), self.thinned(_SIZES)
        matrices, factors = prior.matrix(theta), prior.factors(theta)
        sizes = likelihood.draw_error_size(law, matrices, factors, rng)
        assert sizes is not None
        low, middle, high = np.quantile(sizes[:, 0], [0.025, 0.5, 0.975]).tolist()
        away = (self.theta.reshape(-1, len(prior.names)).mean(axis=0) - prior.mean) / prior.sd
        shifts = {
            nuisance.name: float(shift)
            for nuisance, shift in zip(prior.nuisances, away[len(prior.marginals) :], strict=True)
            if nuisance.name.rpartition(".")[2] in OF_ALL_MODES
        }
        edges = likelihood.shift_of_edges(law, matrices, factors).mean(axis=0)
        if edges.size:
            shifts["edge"] = float(max(edges, key=abs))
        spring, misnumbered = float(np.median(sizes[:, 1])), self.problem.premises.misnumbered
        return InferredError(middle, low, high, law.frequency, spring, shifts, misnumbered)

    @cached_property
    def mesh(self) -> MeshCheck | None:
        """What the elements of the model do to the result; None where the structure is given by its matrices."""
        kept, estimate = self._kept_knowledge, self.estimate
        if kept is not None and kept.mesh is not None:
            return kept.mesh
        return check_mesh(self.problem, estimate.theta, estimate.covariance, self.stiffness, self.record.seed)

    @cached_property
    def noise_of_bodies(self) -> NoiseOfBodies | None:
        """What the errors of measured bodies do to the result; None where the structure is modelled throughout."""
        return noise_of_bodies(self.problem, self.estimate.theta)

    @property
    def diagnosis(self) -> Diagnosis:
        """How far the MAP is from the data in an engineer's measure, and what its residuals point to.

        Of several tests that of the one which the model explains worst.
        """
        return self.diagnoses[[test.name for test in self.problem.tests].index(self.check.test)]

    @cached_property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """The diagnosis of each test."""
        if self._kept_knowledge is not None and self._kept_knowledge.diagnoses is not None:
            return self._kept_knowledge.diagnoses
        theta = self.mode_theta if self.mode_log_density > self.estimate.log_posterior else self.estimate.theta
        each = ((part, np.random.default_rng([self.record.seed, 4])) for part in self.problem.parts)
        return tuple(
            replace(diagnose(part.test.data, part, theta, rng), remedy=check.remedy)
            for (part, rng), check in zip(each, self.checks, strict=True)
        )

    def region_level(self, stiffness: ArrayLike) -> float:
        """Probability of the smallest highest-density region that holds a joint, shape (q,).

        0.95 or less means that the point lies inside the joint 95 % region; 1 where it is impossible. Whatever else
        is uncertain is integrated out: the density is then that of a kernel estimate.
        """
        parametrisation = self.problem.parametrisation
        if not parametrisation.describes(stiffness):
            return 1.0
        point = parametrisation.coordinates(stiffness)
        if self.problem.prior.nuisances:
            from scipy.stats import gaussian_kde  # late: a quarter of a second

            draws = self.problem.prior.joint(self.thinned(_KERNEL_DRAWS)).T
            estimate = gaussian_kde(draws)
            return float((estimate(draws) > estimate(point)).mean())
        return float((self.log_density > self.problem.log_posterior(point)[0]).mean())

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

    def predict_natural_frequencies(self, count: int = 3, max_draws: int = 4000, *, test: str | None = None) -> Array:
        """Natural frequencies of posterior draws, shape (draws, count), Hz.

        Those of the model: its own error, see ``[uncertain.model_error]``, is not in them. Of the test of that name,
        by default the first.
        """
        theta, prior = self.thinned(max_draws), self.problem.prior
        return self.problem.part(test).natural_frequencies_hz(prior.values(theta), count, prior.factors(theta))

    def predict_left_out(self, probability: float = 0.95, max_draws: int = 2000) -> tuple[LeftOut, ...]:
        """What was left out of the data, and what the draws predict a measurement of it to show; empty without any.

        The intervals hold what is uncertain in joint and structure, the error of the model as far as the noise model
        states one, drawn anew for what was left out, and the noise of the measurement. Of FRFs the magnitude is
        compared, of at most 400 draws.

        Parameters
        ----------
        probability
            Probability inside each interval.
        max_draws
            At most so many draws, evenly spaced, are evaluated.

        Raises
        ------
        ModelError
            If the probability is not inside (0, 1).
        """
        require_probability(probability, "left out")
        return predict_left_out(self.problem, self.thinned(max_draws), probability, self.record.seed)

    def thinned(self, most: int) -> Array:
        """At most so many draws of θ, evenly spaced over all chains, shape (n, d)."""
        require_count(most, "max_draws: found")
        rows = np.linspace(0, len(self.theta) - 1, min(most, len(self.theta))).round().astype(int)
        return self.theta[rows]

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
        magnitude, beside ``data_real`` and ``data_imag``.

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

    @property
    def measured_frequencies_hz(self) -> tuple[float, ...] | None:
        """Measured natural frequencies of the one test, if they are the lowest and data, or the case states any, Hz."""
        if self.case is not None:
            return self.case.measured_frequencies_hz
        return None if len(self.problem.tests) > 1 else self.problem.test.data.lowest_hz

    def has_default_prior(self, name: str) -> bool:
        """Whether the range of a quantity is the default one, which the case does not state."""
        return self.case is not None and name in self.case.default_priors

    @cached_property
    def solutions(self) -> Solutions:
        """What each of several modes says; of one mode itself."""
        return Solutions(self)

    @cached_property
    def likelihood_region(self) -> LikelihoodRegion:
        """Joints that fit nearly as well as the best, for likelihood-ratio limits, which it keeps once found."""
        modes = [self.estimate.theta, self.mode_theta, *(mode.theta for mode in self.estimate.modes)]
        theta = np.vstack([*modes, self.thinned(_REGION_DRAWS)])
        return LikelihoodRegion(self.problem.log_posterior, theta, self.solutions.nearest(theta))

    def rule(self, name: str) -> VerdictRule:
        """Thresholds by which a stiffness is judged: those that the case states in ``[verdict]``, or the usual ones."""
        return RULE if self.case is None else self.case.verdict_rules.get(name, RULE)

    def verdict(self, name: str) -> Verdict:
        """Class of a stiffness with its interval, limit, reasons and conditions, made in one pass and frozen.

        It equals the string of its class: ``posterior.verdict("k22") == "identified"``; `str` adds the conditions.

        Inputs that a workshop does not know exactly are looked at where `rows` are known: of a run that was kept, and
        once `under` was asked. Else the verdict names them all.

        Raises
        ------
        ModelError
            If the joint's coordinates hold the stiffness rigid: there is nothing to judge.
        """
        if np.ptp(self.prior_values(name)) == 0:
            raise ModelError(
                f"posterior: found {name} held rigid; expected a joint whose stiffnesses are all uncertain, for "
                "verdicts, summary and report; use draws, mode and intervals of the others"
            )
        if name not in self._judged:
            self._judged[name] = judge_stiffness(self, name)
        found = self._judged[name]
        unsaid = found.cls in ("no verdict", "not identified")
        return found if unsaid else replace(found, exact=self._exact_inputs.get(name))

    @cached_property
    def _judged(self) -> dict[str, Verdict]:
        """What draws, priors and likelihood say of stiffnesses that were asked for: a report asks several times."""
        return {}

    @cached_property
    @one_blas_thread()
    def rows(self) -> tuple[UncertainInputsRow, ...]:
        """What is known with other quantities uncertain or exactly known; the first row is the run itself.

        Empty where there is nothing to free, and where the run allows no verdict.
        """
        if self._kept_knowledge is not None:
            return self._kept_knowledge.freed
        return effect_of_uncertain_inputs(self, self._workshop_problem)

    @property
    def _workshop_problem(self) -> Problem | None:
        """The same problem with more quantities uncertain, as its case has it; None without a case, or any more."""
        return None if self.case is None else self.case.workshop_problem

    @property
    def _exact_inputs(self) -> Mapping[str, ExactInputs]:
        """What verdicts take as exact, by stiffness; of all the same where nobody looked at what is known without."""
        if self._kept_knowledge is not None or "rows" in self.__dict__:
            return inputs_taken_as_exact(self.rows)
        taken = taken_as_exact(self.problem, self._workshop_problem)
        unseen = ExactInputs(taken, None, looked_at=False)
        return dict.fromkeys(self.stiffness_names, unseen) if taken else {}

    def __repr__(self) -> str:
        lines = [line_of(name, self.verdict(name)) for name in self.judged_names[:_MOST_SHOWN]]
        lines += [f"{name}: {value}" for name, value in value_rows(self._nuisances)]
        shown, left = lines[:_MOST_SHOWN], len(self.judged_names) + len(self._nuisances) - _MOST_SHOWN
        more = f"and {left} more" if left > 0 else ""
        body = [line for text in (*shown, more, *self._remarks) if text for line in in_lines(text, 2)]
        return "\n".join([*in_lines(self._title, 0), *body])

    def _repr_html_(self) -> str:
        part = next((part for part in self.problem.parts if part.test.data.shown_frfs), None)
        drawing = ""
        if part is not None and part.test.data.shown_frfs is not None:
            frf, best = part.test.data.shown_frfs.frf, self._best_frfs(part, part.test.data.shown_frfs.frf)
            drawing = frf_svg(frf.frequency_hz, {"measured": frf.values[:, 0, 0], "MAP": best[:, 0, 0]})
        drawing += "".join(map(paragraph_html, self._remarks))
        rows = [stiffness_row(name, self.verdict(name)) for name in self.judged_names]
        rows += [(name, value, "") for name, value in value_rows(self._nuisances)]
        return table_html(self._title, STIFFNESS_HEAD, rows, drawing)

    @property
    def _title(self) -> str:
        return f"Posterior of {self.record.case_name!r}. {self.record.state}"

    @property
    def judged_names(self) -> list[str]:
        """Names of the stiffnesses that are uncertain."""
        return [name for name in self.stiffness_names if np.ptp(self.prior_values(name)) > 0]

    @property
    def _nuisances(self) -> dict[str, tuple[Array, str]]:
        names = [nuisance.name for nuisance in self.problem.prior.nuisances]
        return {name: (self.by_ensemble(name), self.unit(name)) for name in names}

    @property
    def _remarks(self) -> tuple[str, ...]:
        """What stands below the numbers where a posterior is printed."""
        return (*self.assumptions, self.estimate.sentence)

    @property
    def premises_sentences(self) -> tuple[str, ...]:
        """What the answer rests on where data are not taken as stated, and what is off of FRFs that it does not fit."""
        modes = [test.name for test in self.problem.tests if test.data.modes is not None]
        faults = [text for test in modes for text in sentences_of_faults(self.compared_frfs[test], test)]
        return (*premises_sentences(self.problem.premises, self.model_error), *self.unseen_inputs, *faults)

    @property
    def unseen_inputs(self) -> tuple[str, ...]:
        """What modes cannot show of inputs that move all of them alike, where no shape was measured."""
        own = [nuisance.name.rpartition(".")[2] for nuisance in self.problem.prior.nuisances]
        inputs = [name for name in OF_ALL_MODES if name in own]
        more = any(test.data.modes is None or test.data.shows_shapes for test in self.problem.tests)
        if not self.problem.premises.reason or not inputs or more:
            return ()
        what = listed(inputs, "or")
        return (f"Natural frequencies alone hardly show that {what} is further off than assumed: measure it.",)

    @cached_property
    def compared_frfs(self) -> dict[str, tuple[ComparedFrf, ...]]:
        """Each measured FRF and the predicted one by test, fitted or not: level, sign and shape, and what is off."""
        theta = np.vstack([self.estimate.theta, self.thinned(_COMPARED_DRAWS)])
        return {part.test.name: compare_frfs(part, theta) for part in self.problem.parts}

    def _best_frfs(self, part: Problem, frf: FrfSet) -> NDArray[np.complex128]:
        """FRFs of the MAP where others were measured, in their quantity and shape."""
        theta, ports = self.estimate.theta[None], Ports(frf.frequency_hz, frf.outputs, frf.inputs)
        return part.frfs_as_measured(ports, frf.quantity, part.prior.values(theta), part.prior.factors(theta))[0]

    @property
    def assumptions(self) -> tuple[str, ...]:
        """The same, and where it was not looked at what is known without that which the verdicts take as exact."""
        unseen = next((exact for exact in self._exact_inputs.values() if not exact.looked_at), None)
        if unseen is None or not self.converged:
            return self.premises_sentences
        name = listed(unseen.quantities)
        return (*self.premises_sentences, f"What is known with {name} uncertain: posterior.under, and the report.")

    @property
    def under(self) -> Mapping[str, UncertainInputsRow]:
        """What is known under other premises, by name: ``posterior.under["workshop"].interval("k22")``.

        ``"exact"`` with nothing but the joint uncertain, ``"workshop"`` with material, length and damping as in a
        workshop where the case does not declare them exact; each where it can differ from the run, and settled. That
        of measured FRFs within their noise is a run of its own, ``jb.sample(case, premises="exact")``.
        """
        return {"workshop" if row.uncertain else "exact": row for row in self.rows[1:] if row.known}

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
            self.measured_frequencies_hz,
            knowledge,
            warnings,
            self.assumptions,
            None if self.case is None else self.case.about,
        )

    def save(self, path: str | os.PathLike[str], knowledge: Knowledge | None = None) -> None:
        """Write the posterior to a netCDF file, whole or not at all; `jointbayes.load_posterior` reads it.

        Its problem is kept with it, matrices, data and priors to the last bit, with the text of its case, and so is
        the prior's density at each draw.

        Parameters
        ----------
        path
            The file.
        knowledge
            What `gather_knowledge` found, kept with the draws so that a later report need not find it again; by
            default what was kept with them already.

        Raises
        ------
        WriteError
            If the file cannot be written; an older one is then still there.
        """
        problem, description = problem_arrays(self.problem)
        groups = {PROBLEM_GROUP: problem}
        record = FileRecord(
            self.record,
            BestDraw(self.mode_theta, self.mode_log_density),
            self.estimate,
            description,
            self._kept_knowledge if knowledge is None else knowledge.kept,
            self.case is not None and self.case.stated is self.problem,
        )
        if self.problem.prior.marginals:
            theta = self.theta.reshape(*self.log_density.shape, -1)
            groups["log_prior"] = log_prior_of_joint(self.problem.prior, theta)
        write_tree(self.tree, groups, record.as_text(), path)


def _named(dataset: xr.Dataset, name: str) -> xr.DataArray:
    if name not in dataset.data_vars:
        raise ModelError(f"posterior: found parameter {name!r}; expected one of {', '.join(map(str, dataset))}")
    return dataset[name]


def _variable(dataset: xr.Dataset, name: str) -> Array:
    return np.asarray(_named(dataset, name).transpose("chain", "draw").values, dtype=float)


def gather_knowledge(posterior: Posterior) -> Knowledge:
    """Check and examine a posterior; the seed of its run also replicates the data of the check.

    What a workshop does not know exactly, for the table of what freeing it does, is that of its case, if it has one.
    """
    kept, rows, freed = posterior._kept_knowledge, posterior.rows, posterior._workshop_problem
    simpler, directions = (kept.simpler, kept.directions) if kept else (None, None)
    judged = {name: posterior.verdict(name) for name in posterior.stiffness_names}
    steps: tuple[NextStep, ...] = ()
    if all(check.explains for check in posterior.checks):
        workshop = known_in_workshop(rows)
        steps = next_steps(posterior, freed if workshop else None, workshop or judged)
    if directions is None:
        draws, parametrisation = (posterior.stiffness, posterior.prior_stiffness), posterior.problem.parametrisation
        directions = name_directions(*draws, judged, parametrisation, posterior.rule)
    return Knowledge(
        check=posterior.check,
        directions=directions,
        profiles=kept.profiles if kept else _profiles(posterior),
        freed=rows,
        assumed=kept.assumed if kept else assumed_beyond(posterior.problem, freed),
        simpler=simpler_joints(posterior) if simpler is None else simpler,
        next_steps=steps,
        advice=advice(posterior, steps),
        decides=_what_decides(posterior),
        mesh=posterior.mesh,
        diagnoses=posterior.diagnoses,
    )


def _what_decides(posterior: Posterior) -> WhatDecides | None:
    """Each input alone; None of fewer than two, and where the model does not explain the data."""
    inputs = max((row.uncertain for row in posterior.rows), key=len, default=())
    if len(inputs) < 2 or not all(check.explains for check in posterior.checks):
        return None
    run, freed = posterior.problem, posterior._workshop_problem
    problem = run if freed is None or set(inputs) <= set(uncertain_quantities(run)) else freed
    if not set(inputs) <= set(problem.names):  # rows of a file without the case that freed them
        return None
    return what_decides(problem, inputs, by_names(posterior.mode_theta[None], run.names, problem.names)[0])


def _profiles(posterior: Posterior) -> tuple[ProfileLikelihood, ...]:
    profiles: list[ProfileLikelihood] = []
    if len(posterior.problem.names) > MOST_UNKNOWNS:
        return ()
    for name in posterior.problem.parametrisation.names:
        with suppress(ModelError):  # no residual depends on it: its prior is all there is, and the verdict says so
            profiles.append(posterior.likelihood_region.profile(name))
    return tuple(profiles)
