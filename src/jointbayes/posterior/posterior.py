"""The posterior: draws that are judged, summed up, set in a row of a table or along the levels of tests, and kept."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import xarray as xr

from jointbayes.arrays import Array
from jointbayes.errors import ModelError, require_count, require_probability
from jointbayes.frf import Ports
from jointbayes.inference import Level, Test
from jointbayes.inference.test import own_name
from jointbayes.posterior.assemblies import usual_assemblies
from jointbayes.posterior.decision import premises_sentences
from jointbayes.posterior.draws import PosteriorDraws
from jointbayes.posterior.file_record import BestDraw, FileRecord
from jointbayes.posterior.homogeneity import compare_tests
from jointbayes.posterior.identifiability import Identifiability
from jointbayes.posterior.knowledge import Knowledge, other_premises
from jointbayes.posterior.prediction import frfs_as_measured
from jointbayes.posterior.rounding import number
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
from jointbayes.posterior.uncertain_inputs import UncertainInputsRow, taken_as_exact
from jointbayes.posterior.verdicts import JudgedPosterior, reasons_for_no_verdict
from jointbayes.reproducibility import one_blas_thread

_TINY = float(np.finfo(float).tiny)
_FAR_LEVEL = 3.0  # that no damping of a best fit explains
#: One cell of a table of cases; None where a number does not exist.
Cell = str | float | int | bool | None


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A quantity at each level, in the order of the levels.

    Parameters
    ----------
    name, unit
        The quantity as a set-up calls it, ``"k11"`` or ``"clamp.k11"``, and its unit.
    of
        What the level is, with its unit; its value is that of the first set-up.
    setups, quantities
        Name of each set-up, and of its quantity: ``"loud.k11"``, or ``"k11"`` where it shares that.
    level
        Level of each set-up, shape (n,).
    median, low, high
        Median and ends of the interval, in the unit, each shape (n,).
    probability
        Inside the interval at each level.
    pair
        Places of the two levels that are compared: the lowest and the highest where the medians rise or fall
        throughout, else those between which the quantity differs most clearly.
    pairs
        Number of pairs among which they were chosen: for all of them together the interval of the change holds.
    relative
        Whether the change is a ratio; of a quantity that may be negative it is a difference.
    change
        Median and ends of the interval of the quantity at the second of the levels over that at the first, or minus it.
    unjudged
        Why nothing is said of a change: that the run has no verdict; empty where it has.
    of_usual
        Whether it is the usual assembly at each of the two levels that is compared, about which set-ups scatter.
    equal_data
        Whether the data of the two are equal within their noise, so that they show no change.
    """

    name: str
    unit: str
    of: Level
    setups: tuple[str, ...]
    quantities: tuple[str, ...]
    level: Array
    median: Array
    low: Array
    high: Array
    probability: float
    pair: tuple[int, int]
    pairs: int
    relative: bool
    change: tuple[float, float, float]
    unjudged: str = ""
    equal_data: bool = False
    of_usual: bool = False

    def __repr__(self) -> str:
        return self.sentence

    @property
    def changes(self) -> bool:
        """Whether a change is shown: the interval leaves none out, and the data differ by more than their noise."""
        _, low, high = self.change
        return not (self.unjudged or self.equal_data or low <= (1.0 if self.relative else 0.0) <= high)

    @property
    def sentence(self) -> str:
        """Whether the quantity changes with the level, with its figures."""
        middle, low, high = self.change
        unit = f" {self.of.unit}" if self.of.unit else ""
        first, second = (f"{self.level[place]:g}{unit}" for place in self.pair)
        between = f"between {first} and {second}"
        if self.unjudged:
            return f"{self.name} {between}: nothing is said of a change, for {self.unjudged}."
        least, quantity_unit = (1.0, "") if self.relative else (0.0, f" {self.unit}" if self.unit != "1" else "")
        of = " of the usual assembly" if self.of_usual else ""
        text = f"{self.name}{of} at {second} {'over' if self.relative else 'minus'} that at {first}"
        held = f"{100 * self.probability:g} % credible interval"
        if self.pairs > 1:
            text += f", of {self.pairs} pairs of levels the one that differs most clearly"
            held = f"{100 * self.probability:g} % credible interval for all pairs together"
        text += f": median {middle:.4g}{quantity_unit}, {held} {low:.4g} to {high:.4g}{quantity_unit}"
        if not self.changes:
            why = ", for the data of the two are equal within their noise" if self.equal_data else ""
            return f"{text}; no change {between} is shown{why}."
        return f"{text}; it {'rises' if low > least else 'falls'} {between}."


def curve_of(posterior: PosteriorDraws, name: str, probability: float = 0.95) -> Curve:
    """The curve of one quantity.

    Raises
    ------
    ModelError
        If set-ups have no levels, or none has this quantity for itself.
    """
    require_probability(probability, "curve")
    problem = posterior.problem
    names = [*posterior.stiffness_names, *(nuisance.name for nuisance in problem.prior.nuisances)]
    own_names = [(test, own_name(test.name, name, names)) for test in _sorted_by_level(problem.tests)]
    named = [(test, quantity) for test, quantity in own_names if quantity is not None]
    levels = {_value(test) for test, _ in named}
    if len(levels) < 2 or not any(quantity != name for _, quantity in named):
        what = (
            f"{len(levels)} levels of set-ups with {name!r}" if len(levels) < 2 else f"{name!r} in no set-up of its own"
        )
        raise ModelError(
            f"curve: found {what}; expected a quantity that is each set-up's own, and two levels at least; give the "
            "set-ups levels that differ, and the joint own quantities"
        )
    values = np.stack([posterior.values(quantity).ravel() for _, quantity in named], axis=-1)
    tail = (1 - probability) / 2
    low, median, high = np.quantile(values, [tail, 0.5, 1 - tail], axis=0)
    level = np.array([_value(test) for test, _ in named])
    relative = all(_is_positive(posterior, quantity) for _, quantity in named)
    usual = usual_assemblies(posterior, name, values, level)
    pair, pairs, change = _change(values if usual is None else usual, level, relative=relative, tail=tail)
    first = named[0][0].level
    assert first is not None
    compared = compare_tests(*(named[place][0] for place in pair))
    unit, unjudged = posterior.unit(named[0][1]), "; ".join(reasons_for_no_verdict(posterior))
    of, quantities = tuple(test.name for test, _ in named), tuple(quantity for _, quantity in named)
    curve = (level, median, low, high, probability)
    compared_as = (relative, change, unjudged, compared is not None and compared.equal, usual is not None)
    return Curve(name, unit, first, of, quantities, *curve, pair, pairs, *compared_as)


def _change(
    values: Array, level: Array, *, relative: bool, tail: float
) -> tuple[tuple[int, int], int, tuple[float, float, float]]:
    """The pair of levels that is compared, the number among which it was chosen, and the change between them.

    Parameters
    ----------
    values
        Draws at each level, shape (draws, n).
    level
        Levels, rising, shape (n,).
    relative
        Whether the change is a ratio.
    tail
        Probability on either side of the interval, which is divided among the pairs that were looked at.
    """
    shown = np.log(values) if relative else values
    steps = np.diff(np.median(shown, axis=0))
    last = len(level) - 1
    pairs = [(0, last)]
    if (steps > 0).any() and (steps < 0).any():
        pairs = [(i, j) for i in range(last) for j in range(i + 1, last + 1) if level[i] < level[j]]
    # of many pairs one differs by chance: the interval is that of all pairs together (Bonferroni)
    tail /= len(pairs)
    changes = [np.quantile(shown[:, j] - shown[:, i], [0.5, tail, 1 - tail]) for i, j in pairs]
    clearest = max(range(len(pairs)), key=lambda k: abs(changes[k][0]) / max(changes[k][2] - changes[k][1], _TINY))
    i, j = pairs[clearest]
    changed = values[:, j] / values[:, i] if relative else values[:, j] - values[:, i]
    middle, low, high = np.quantile(changed, [0.5, tail, 1 - tail])
    return (i, j), len(pairs), (float(middle), float(low), float(high))


def _is_positive(posterior: PosteriorDraws, name: str) -> bool:
    """Whether a quantity is above 0 whatever the data say, so that a ratio of two tells their change."""
    problem = posterior.problem
    logarithmic = {axis.quantity for axis in problem.parametrisation.axes if axis.logarithmic}
    signed = {quantity.name for quantity in problem.quantities if quantity.may_be_negative}
    return (name in logarithmic or name not in signed) and bool((posterior.values(name) > 0).all())


def curves_of(posterior: PosteriorDraws) -> tuple[Curve, ...]:
    """The curve of every quantity of the joints that set-ups with levels have for themselves."""
    levels: dict[str, set[float]] = {}
    for name in posterior.stiffness_names:
        for test in _sorted_by_level(posterior.problem.tests):
            if name.startswith(f"{test.name}."):
                levels.setdefault(name.removeprefix(f"{test.name}."), set()).add(_value(test))
    return tuple(curve_of(posterior, name) for name, values in levels.items() if len(values) > 1)


def _sorted_by_level(setups: Sequence[Test]) -> list[Test]:
    return sorted((test for test in setups if test.level is not None), key=_value)


def _value(test: Test) -> float:
    assert test.level is not None
    return test.level.value


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


class Posterior(JudgedPosterior):
    """Draws from the posterior of a joint's stiffnesses; built as `PosteriorDraws` is."""

    @property
    def _remarks(self) -> tuple[str, ...]:
        return (*self.assumptions, *super()._remarks)

    @property
    def premises_sentences(self) -> tuple[str, ...]:
        """What the answer rests on where it is not that of data as stated, and FRFs whose level it does not have."""
        words = [
            f"The FRFs{f' of set-up {setup}' if setup else ''} are {number(ratio, 2)} times as large as the answer "
            "predicts: check unit and sensitivity of the channels, which natural frequencies do not show."
            for setup, ratio in self.levels.items()
            if not 1 / _FAR_LEVEL <= ratio <= _FAR_LEVEL
        ]
        return (*premises_sentences(self.problem.premises, self.model_error), *words)

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
        """The same, and what the verdicts take as exact that a workshop does not know exactly."""
        taken = "" if self.case is None else taken_as_exact(self.problem, self.case.workshop_problem)
        exact = f"The verdicts take {taken} as exact: the report shows what is known with them uncertain."
        return (*self.premises_sentences, *([exact] if taken else []))

    @cached_property
    @one_blas_thread()
    def under(self) -> Mapping[str, UncertainInputsRow]:
        """What is known under other premises, by name: ``posterior.under["workshop"].interval("k22")``.

        ``"exact"`` with nothing but the joint uncertain, ``"workshop"`` with material, length and damping as in a
        workshop where the case does not declare them exact; each where it can differ from the run. That of measured
        FRFs within their noise is a run of its own, ``jb.sample(case, take_as="exact")``.
        """
        return other_premises(self)

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
            self.assumptions if knowledge is None else self.premises_sentences,
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
