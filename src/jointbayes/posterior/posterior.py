"""The posterior: draws that are judged, summed up, set in a row of a table or along the levels of tests, and kept."""

import os
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Self

import numpy as np
import xarray as xr

from jointbayes.errors import ModelError, require_count
from jointbayes.frf import Ports
from jointbayes.posterior.curves import Curve, curve_of
from jointbayes.posterior.decision import premises_sentences
from jointbayes.posterior.draws import OF_ALL_MODES, PosteriorDraws
from jointbayes.posterior.file_record import BestDraw, FileRecord
from jointbayes.posterior.identifiability import ExactInputs, Identifiability, listed
from jointbayes.posterior.knowledge import Knowledge
from jointbayes.posterior.limits import LikelihoodRegion
from jointbayes.posterior.prediction import frfs_as_measured
from jointbayes.posterior.rounding import join_unit, number
from jointbayes.posterior.solutions import Solutions
from jointbayes.posterior.storage import log_prior_of_joint, write_tree
from jointbayes.posterior.stored_problem import add_problem
from jointbayes.posterior.summary import (
    NuisanceSummary,
    StiffnessSummary,
    Summary,
    nuisance_summary,
    stiffness_summary,
    summarise,
)
from jointbayes.posterior.summary_tables import STIFFNESS_HEAD, stiffness_row, value_rows
from jointbayes.posterior.uncertain_inputs import (
    UncertainInputsRow,
    effect_of_uncertain_inputs,
    inputs_taken_as_exact,
    taken_as_exact,
)
from jointbayes.posterior.verdicts import judge_stiffness, line_of
from jointbayes.posterior.widened import WidenedPosterior, widen_posterior
from jointbayes.reproducibility import one_blas_thread
from vibrecords.arrays import Array
from vibrecords.notebook_view import frf_svg, paragraph_html, table_html

_TINY = float(np.finfo(float).tiny)
_REGION_DRAWS = 4000
_MOST_SHOWN = 9  # quantities, where a posterior is printed
_FAR_LEVEL = 3.0  # that no damping of a best fit explains
#: One cell of a table of cases; None where a number does not exist.
Cell = str | float | int | bool | None


def _columns(name: str, summary: StiffnessSummary | NuisanceSummary) -> dict[str, Cell]:
    """Columns of one quantity; a number that is not finite is none."""
    known = summary.known if isinstance(summary, StiffnessSummary) else summary
    cells: dict[str, Cell] = {"unit": summary.unit, "map": summary.map, "median": known.median}
    cells |= dict(zip(("low95", "high95"), known.interval95, strict=True))
    if isinstance(known, Identifiability):
        cells |= dict(zip(("printed_low95", "printed_high95"), known.printed95, strict=True))
    cells |= {"sd_log": known.sd_log, "contraction": known.contraction, "verdict": getattr(known, "verdict", None)}
    return {
        f"{name}.{column}": None if isinstance(value, float) and not np.isfinite(value) else value
        for column, value in cells.items()
    }


class Posterior(PosteriorDraws):
    """Draws from the posterior of a joint's stiffnesses, with a verdict on each; built as `PosteriorDraws` is."""

    def has_default_prior(self, name: str) -> bool:
        """Whether the range of a quantity is the default one, which the case does not state."""
        return self.case is not None and name in self.case.default_priors

    @cached_property
    def solutions(self) -> Solutions:
        """What each of several modes says; of one mode itself."""
        return Solutions(self)

    @cached_property
    def widened(self) -> WidenedPosterior | None:
        """The posterior with every prior of the joint a decade wider; None where that changes nothing."""
        return widen_posterior(self)

    @cached_property
    def likelihood_region(self) -> LikelihoodRegion:
        """Joints that fit nearly as well as the best, for likelihood-ratio limits, which it keeps once found."""
        modes = [self.estimate.theta, self.mode_theta, *(mode.theta for mode in self.estimate.modes)]
        theta = np.vstack([*modes, self.thinned(_REGION_DRAWS)])
        return LikelihoodRegion(self.problem.log_posterior, theta, self.solutions.nearest(theta))

    def verdict(self, name: str) -> Identifiability:
        """Median, 95 % interval with errors, verdict with its reason and what it takes as exact.

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
        return judge_stiffness(self, name, self._exact_inputs)

    @cached_property
    @one_blas_thread()
    def rows(self) -> tuple[UncertainInputsRow, ...]:
        """What is known with other quantities uncertain or exactly known; the first row is the run itself.

        Empty where there is nothing to free, and where the run allows no verdict.
        """
        if self._kept_knowledge is not None:
            rows: tuple[UncertainInputsRow, ...] = self._kept_knowledge.freed
            return rows
        return effect_of_uncertain_inputs(self, None if self.case is None else self.case.workshop_problem)

    @property
    def _exact_inputs(self) -> Mapping[str, ExactInputs]:
        """What verdicts take as exact, by stiffness; of all the same where nobody looked at what is known without."""
        if self._kept_knowledge is not None or "rows" in self.__dict__:
            return inputs_taken_as_exact(self.rows)
        taken = () if self.case is None else taken_as_exact(self.problem, self.case.workshop_problem)
        unseen = ExactInputs(taken, None, looked_at=False)
        return dict.fromkeys(self.stiffness_names, unseen) if taken else {}

    def __repr__(self) -> str:
        names = [*self.judged_names, *(nuisance.name for nuisance in self.problem.prior.nuisances)]
        shown = [self._line(name) for name in names[:_MOST_SHOWN]]
        more = f"and {len(names) - _MOST_SHOWN} more" if len(names) > _MOST_SHOWN else ""
        return "\n  ".join(filter(None, [self._title, *shown, more, *self._remarks]))

    def _repr_html_(self) -> str:
        part = next((part for part in self.problem.parts if part.test.data.shown_frfs), None)
        drawing = ""
        if part is not None and part.test.data.shown_frfs is not None:
            frf, theta = part.test.data.shown_frfs.frf, self.estimate.theta[None]
            ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
            factors, values = part.prior.factors(theta), part.prior.values(theta)
            best = frfs_as_measured(part, ports, frf.quantity, values, factors)[0]
            drawing = frf_svg(frf.frequency_hz, {"measured": frf.values[:, 0, 0], "MAP": best[:, 0, 0]})
        drawing += "".join(map(paragraph_html, self._remarks))
        rows = [stiffness_row(name, self.verdict(name)) for name in self.judged_names]
        rows += [(*row, "") for row in value_rows(self._nuisances)]
        return table_html(self._title, STIFFNESS_HEAD, rows, drawing)

    @property
    def _title(self) -> str:
        return f"Posterior of {self.record.case_name!r}, {self.theta.shape[0]} draws; {self.reason}"

    @property
    def judged_names(self) -> list[str]:
        """Names of the stiffnesses that are uncertain."""
        return [name for name in self.stiffness_names if np.ptp(self.prior_values(name)) > 0]

    @property
    def _nuisances(self) -> dict[str, tuple[Array, str]]:
        names = [nuisance.name for nuisance in self.problem.prior.nuisances]
        return {name: (self.by_ensemble(name), self.unit(name)) for name in names}

    def _line(self, name: str) -> str:
        if name in self.stiffness_names:
            return line_of(name, self.verdict(name))
        ((_, median, *ends),) = value_rows({name: (self.by_ensemble(name), self.unit(name))})
        return f"{name}: median {median}, 95 % credible interval {join_unit(*ends)}"

    @property
    def _remarks(self) -> tuple[str, ...]:
        """What stands below the numbers where a posterior is printed."""
        return (*self.assumptions, self.estimate.sentence)

    @property
    def premises_sentences(self) -> tuple[str, ...]:
        """What the answer rests on where it is not that of data as stated, and FRFs whose level it does not have."""
        words = [
            f"The FRFs{f' of set-up {setup}' if setup else ''} are {number(ratio, 2)} times as large as the answer "
            "predicts: check unit and sensitivity of the channels, which natural frequencies do not show."
            for setup, ratio in self.levels.items()
            if not 1 / _FAR_LEVEL <= ratio <= _FAR_LEVEL
        ]
        return (*premises_sentences(self.problem.premises, self.model_error), *self.unseen_inputs, *words)

    @property
    def unseen_inputs(self) -> tuple[str, ...]:
        """What modes cannot show of inputs that move all of them alike, where no shape was measured."""
        own = [nuisance.name.rpartition(".")[2] for nuisance in self.problem.prior.nuisances]
        inputs = [name for name in OF_ALL_MODES if name in own]
        more = any(test.data.modes is None or test.data.shows_shapes for test in self.problem.tests)
        if not self.problem.premises.reason or not inputs or more:
            return ()
        what = listed(inputs).replace(" and ", " or ")
        return (f"Natural frequencies alone hardly show that {what} is further off than assumed: measure it.",)

    @cached_property
    def levels(self) -> dict[str, float]:
        """Median of measured over predicted magnitude of the FRFs that modes were read off, by set-up."""
        levels = {}
        for part in self.problem.parts:
            shown, data = part.test.data.shown_frfs, part.test.data
            if shown is None or data.frfs is not None:
                continue
            frf, theta = shown.frf, self.estimate.theta[None]
            ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
            values, factors = part.prior.values(theta), part.prior.factors(theta)
            predicted = np.abs(frfs_as_measured(part, ports, frf.quantity, values, factors)[0])
            levels[part.test.name] = float(np.median(np.abs(frf.values) / np.maximum(predicted, _TINY)))
        return levels

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
        """The numbers of the run: `print` shows a table, ``to_json`` gives what ``summary.json`` holds.

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
        )

    def curve(self, name: str, probability: float = 0.95) -> Curve:
        """A quantity over the levels of the set-ups: its median and interval at each.

        Parameters
        ----------
        name
            The quantity as each set-up calls it: ``"k11"`` of ``"low.k11"`` and ``"high.k11"``.
        probability
            Inside the interval at each level.

        Raises
        ------
        ModelError
            If set-ups have no levels, or none has this quantity for itself.
        """
        return curve_of(self, name, probability)

    def brief(self) -> dict[str, Cell]:
        """One row of a table of many cases: fit, and estimate, interval and verdict of each quantity, by column.

        The numbers are those of `summary`, which also predicts natural frequencies, diagnoses the misfit and sizes up
        the chains, and takes twice as long.

        Returns
        -------
        dict
            ``seed``, ``converged``, ``reason``, ``explains``, ``misfit_p_value``; and for each stiffness and each other
            uncertain quantity q ``q.unit``, ``q.map``, ``q.median``, ``q.low95``, ``q.high95``, ``q.sd_log``,
            ``q.contraction``, and of a stiffness ``q.printed_low95``, ``q.printed_high95`` and ``q.verdict``.
        """
        row: dict[str, Cell] = {
            "seed": self.record.seed,
            "converged": self.converged,
            "reason": self.reason,
            "explains": self.check.explains,
            "misfit_p_value": self.check.misfit_p_value,
        }
        for index, name in enumerate(self.stiffness_names):
            row |= _columns(name, stiffness_summary(self, index, name))
        for index, nuisance in enumerate(self.problem.prior.nuisances):
            row |= _columns(nuisance.name, nuisance_summary(self, index))
        return row

    def with_fewer_draws(self, most: int) -> Self:
        """The same posterior with at most so many draws, for a small file: equally spaced ones of every walker.

        Parameters
        ----------
        most
            Draws at most; no fewer than four of each walker are kept.
        """
        require_count(most, "with_fewer_draws: found")
        chains, draws = self.log_density.shape
        every = max(1, -(-draws // max(4, most // chains)))
        rows = {"posterior": every, "sample_stats": every, "prior": -(-self.prior_stiffness.shape[0] // most)}
        groups = {
            f"/{name}": group.to_dataset().isel(draw=slice(None, None, rows.get(name)), missing_dims="ignore")
            for name, group in self.tree.children.items()
        }
        return replace(self, tree=xr.DataTree.from_dict(groups))

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
        tree, description = add_problem(self.tree, self.problem)
        record = FileRecord(
            self.record,
            BestDraw(self.mode_theta, self.mode_log_density),
            self.estimate,
            description,
            self._kept_knowledge if knowledge is None else knowledge.kept,
            self.case is not None and self.case.stated is self.problem,
        )
        if self.problem.prior.marginals:
            before = log_prior_of_joint(self.problem.prior, self.theta.reshape(*self.log_density.shape, -1))
            groups = {name: node.to_dataset() for name, node in tree.children.items()}
            tree = xr.DataTree.from_dict({**groups, "log_prior": before})
        write_tree(tree, record.as_text(), path)
