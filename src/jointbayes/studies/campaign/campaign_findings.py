"""What a campaign found, in numbers: population, every joint with and without it, outliers, what needs a look.

Of outliers each joint has an estimate and its own standard deviation; what is asked is whether it differs from the
others by more than both allow. Centre and scatter are medians, which a few odd joints do not move.
"""

import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from jointbayes.errors import ModelError
from jointbayes.joint import COORDINATES, Coordinate, Parametrisation, parametrisation_named
from jointbayes.studies.campaign.hierarchical import (
    JointDraws,
    Population,
    PopulationPrior,
    PopulationStiffness,
    hierarchical_posterior,
    population_stiffness,
    weighted_quantiles,
)
from jointbayes.studies.campaign.index import DONE, CaseRow, read_index
from vibrecords.arrays import Array

#: Why a joint of another kind is in no population.
OTHER_KIND = "its joint is not one coupled pair (k11, k12, k22), the same in all its tests"
_NUMBERS = 1_200_000  # draws of all joints together that are looked at
_MOST, _FEWEST = 2000, 50  # of each joint
_EDGE, _PILED = 0.05, 2.0  # a strip of a prior's range, and how much more than the prior has there is a pile


@dataclass(frozen=True, slots=True, eq=False)
class CampaignDraws:
    """Draws of the cases that are done and converged, all in the same coordinates.

    Parameters
    ----------
    rows
        Their cases, shape (joints,).
    parametrisation
        The coordinates: those of most cases.
    draws
        Of all joints.
    prior_mean, prior_sd
        Of the joints' own priors in each coordinate, shape (m, d), of those that were sampled in these coordinates.
    at_edge
        By key, ends of priors at which draws accumulate, such as ``"upper end of the prior of k11"``.
    """

    rows: tuple[CaseRow, ...]
    parametrisation: Parametrisation
    draws: JointDraws
    prior_mean: Array
    prior_sd: Array
    at_edge: Mapping[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class _Case:
    """Draws of one case (n, d) in its own coordinates, with what its file says of its prior."""

    row: CaseRow
    coordinates: str
    stiffness: Array
    log_prior: Array
    prior: Mapping[str, Array]


def read_draws(
    directory: str | os.PathLike[str], rows: Sequence[CaseRow]
) -> tuple[CampaignDraws | None, dict[str, str]]:
    """Read draws of every case that is done and converged, as many of each as memory and time allow.

    Cases in other coordinates than most are carried over into these where they can be.

    Returns
    -------
    draws
        None where no case has any.
    left_out
        By key, why a case that is done and converged has no part in them.
    """
    chosen = [row for row in rows if row.status == DONE and row.converged]
    most = min(_MOST, max(_FEWEST, _NUMBERS // max(len(chosen), 1)))
    cases, left_out = [], {}
    for row in chosen:
        try:
            cases.append(_read_case(Path(directory), row, most))
        except ModelError as error:
            left_out[row.key] = str(error)
        except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
            left_out[row.key] = f"its posterior cannot be read ({type(error).__name__})"
    if not cases:
        return None, left_out
    common = Counter(case.coordinates for case in cases).most_common(1)[0][0]
    parametrisation = parametrisation_named(common)
    theta, log_prior, kept = [], [], []
    for case in cases:
        k = case.stiffness
        if not parametrisation.describes(k).all():
            left_out[case.row.key] = f"some of its draws have no {common} coordinates, in which most cases were sampled"
            continue
        at, density = parametrisation.coordinates(k), case.log_prior
        if case.coordinates != common:
            own = parametrisation_named(case.coordinates)
            density = density - own.log_slope(own.coordinates(k)) + parametrisation.log_slope(at)
        theta.append(at)
        log_prior.append(density)
        kept.append(case)
    # of cases in other coordinates the prior is that of those which have the common ones
    priors = [case.prior for case in kept if case.coordinates == common]
    mean, sd = (np.stack([prior[name] for prior in priors]) for name in ("mean", "sd"))
    edges = {case.row.key: text for case in kept if (text := _piled_up(case))}
    kept_rows = tuple(case.row for case in kept)
    return CampaignDraws(kept_rows, parametrisation, JointDraws.stacked(theta, log_prior), mean, sd, edges), left_out


def _read_case(directory: Path, row: CaseRow, most: int) -> _Case:
    import h5py  # type: ignore[import-untyped]

    with h5py.File(_inside(directory, row.file or f"cases/{row.key}.nc"), "r") as file:
        group = file["log_prior"]
        key = group.attrs["coordinates"]
        coordinates = key.decode() if isinstance(key, bytes) else str(key)
        if coordinates not in COORDINATES:
            raise ModelError(OTHER_KIND)
        names = [quantity.name for quantity in parametrisation_named(coordinates).quantities]
        density = file["log_prior/joint"][()].ravel()
        columns = [file[f"posterior/{name}"][()].ravel() for name in names]
        prior = {name: np.asarray(group.attrs[name], dtype=float) for name in ("mean", "sd", "low", "high")}
    stiffness = np.stack(columns, axis=-1)
    if stiffness.shape[0] != density.size or not density.size:
        raise ValueError("draws and prior of other lengths")
    if not (np.isfinite(stiffness).all() and np.isfinite(density).all()):
        raise ValueError("draws that are not finite")
    rows = np.linspace(0, density.size - 1, min(most, density.size)).round().astype(int)
    return _Case(row, coordinates, stiffness[rows], density[rows], prior)


def _inside(directory: Path, file: str) -> Path:
    """The place of a case's file, which the index may not lead out of the campaign's directory."""
    place = (directory / file).resolve()
    if not place.is_relative_to(directory.resolve()):
        raise ValueError("a file outside the campaign")
    return place


def _piled_up(case: _Case) -> str:
    """At which ends of its prior the draws of a case accumulate; empty if at none."""
    parametrisation = parametrisation_named(case.coordinates)
    theta, ends = parametrisation.coordinates(case.stiffness), []
    for i, axis in enumerate(parametrisation.axes):
        low, high = float(case.prior["low"][i]), float(case.prior["high"][i])
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            continue
        place = (theta[:, i] - low) / (high - low)
        for side, share in (("lower", (place < _EDGE).mean()), ("upper", (place > 1 - _EDGE).mean())):
            if share > _PILED * _EDGE:
                ends.append(f"{side} end of the prior of {axis.name}")
    return ", ".join(ends)


#: Joints below which scatter by medians says too little to call one of them an outlier.
FEWEST = 8
#: Probability of one or more outliers, over all stiffnesses, in a campaign of joints of one normal population.
FALSE_ALARM = 0.05

_MEDIAN_OF_NORMAL = 0.6744897501960817  # of |z|
_ROUNDS = 5
_CAMPAIGNS = 2000  # simulated
_AT_ONCE = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Centre and scatter of one quantity over joints.

    Parameters
    ----------
    value, sd
        Estimate of each joint and its standard deviation, shape (joints,).
    centre
        Weighted median of all.
    scatter
        Of all joints about the centre, without what the estimates' own errors add.
    """

    value: Array
    sd: Array
    centre: float
    scatter: float

    @property
    def score(self) -> Array:
        """Distance of each joint from the centre in standard deviations of scatter and error together, (joints,)."""
        return np.asarray((self.value - self.centre) / np.hypot(self.scatter, self.sd))


@dataclass(frozen=True, slots=True, eq=False)
class ComparedQuantity:
    """One stiffness of every joint, or the coordinate that stands for one of either sign; joints in their order.

    Intervals have rows of 2.5, 50 and 97.5 %, shape (joints, 3), in `unit`.

    Parameters
    ----------
    name, label, unit
        Of the stiffness or coordinate; the label is that of an axis.
    logarithmic
        Whether spread and scores are those of the logarithm.
    unpooled
        Median and interval of each joint by itself.
    shrunken
        Median and interval of each joint given all the others.
    rank
        Rank of each joint among all, 1 the lowest: median and 95 % interval, shape (joints, 3).
    spread
        Over the joints, of the logarithm where `logarithmic`.
    outlier_limit
        Score beyond which a joint is an outlier; infinite where there are too few joints.
    """

    name: str
    label: str
    unit: str
    logarithmic: bool
    unpooled: Array
    shrunken: Array
    rank: Array
    spread: Spread
    outlier_limit: float

    @property
    def in_unit(self) -> str:
        """The unit behind a name, in brackets; empty where there is none."""
        return "" if self.unit == "1" else f" ({self.unit})"

    @property
    def outlier(self) -> NDArray[np.bool_]:
        """Whether a joint is an outlier, shape (joints,)."""
        return np.asarray(np.abs(self.spread.score) > self.outlier_limit)

    def value_in_unit(self, value: Array) -> Array:
        """What the spread calls a value, in `unit`."""
        return np.asarray(np.exp(value)) if self.logarithmic else value


def spread_of(value: Array, sd: Array) -> Spread:
    """Centre and scatter of estimates.

    Parameters
    ----------
    value, sd
        Estimate of each joint and its standard deviation, shape (joints,), the latter above zero.
    """
    scatter = 0.0
    for _ in range(_ROUNDS):
        weight = 1 / np.hypot(scatter, sd)
        centre = float(weighted_quantiles(value[None], weight[None] / weight.sum(), (0.5,))[0, 0])
        scatter = _scatter(np.abs(value - centre), sd)
    return Spread(value, sd, centre, scatter)


def _scatter(distance: Array, sd: Array) -> float:
    """τ, 0 or more, for which distance/√(τ² + sd²) has the median of a normal distribution."""

    def median(tau: float) -> float:
        return float(np.median(distance / np.hypot(tau, sd)))

    if median(0.0) <= _MEDIAN_OF_NORMAL:
        return 0.0
    most = float(distance.max()) / _MEDIAN_OF_NORMAL
    return float(optimize.bisect(lambda tau: median(tau) - _MEDIAN_OF_NORMAL, 0.0, most, xtol=1e-15 * most))


@lru_cache(maxsize=16)
def outlier_limit(joints: int, quantities: int) -> float:
    """Score beyond which a joint is an outlier, so that `FALSE_ALARM` of campaigns have any by chance.

    From simulated campaigns of joints of one normal population, each with centre and scatter by medians as here: with
    few joints these are uncertain, and the limit is wider than that of known ones.

    Parameters
    ----------
    joints
        In the campaign, at least 2.
    quantities
        That are looked at, taken as independent.
    """
    rng = np.random.default_rng([joints, 11])
    largest = []
    step = max(1, _AT_ONCE // joints)
    for first in range(0, _CAMPAIGNS, step):
        z = rng.normal(size=(min(step, _CAMPAIGNS - first), joints))
        z = np.abs(z - np.median(z, axis=1, keepdims=True))
        largest.append(z.max(axis=1) * _MEDIAN_OF_NORMAL / np.median(z, axis=1))
    each: float = (1 - FALSE_ALARM) ** (1 / quantities)
    return float(np.quantile(np.concatenate(largest), each))


#: Joints below which nothing is said of a population.
FEWEST_JOINTS = 3
_RANKINGS = 200  # drawn from the joints' shrunken posteriors
_USUAL = 0.75  # share of cases with one verdict, from which on another one is unusual
_CENTRAL = (0.15865525393145707, 0.8413447460685429)  # one standard deviation of a normal to either side


@dataclass(frozen=True, slots=True, eq=False)
class PopulationFindings:
    """The population, and every joint of it.

    Parameters
    ----------
    draws
        Of all joints, in the order of the table.
    prior, population, stiffness
        What was assumed, and what was found, in coordinates and in stiffness.
    quantities
        Every joint, by quantity.
    """

    draws: CampaignDraws
    prior: PopulationPrior
    population: Population
    stiffness: tuple[PopulationStiffness, ...]
    quantities: tuple[ComparedQuantity, ...]

    @property
    def unresolved(self) -> list[Coordinate]:
        """Coordinates whose scatter the joints do not tell from none."""
        hidden = np.flatnonzero(self.population.unresolved(self.draws.draws))
        return [self.draws.parametrisation.axes[i] for i in hidden]


@dataclass(frozen=True, slots=True)
class Look:
    """A case that somebody should look at, the gravest reason first."""

    row: CaseRow
    gravity: int
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class CampaignFindings:
    """Everything that the report of a campaign says.

    Parameters
    ----------
    rows
        All cases, in the order of the table.
    counts
        Cases by what became of them.
    joints
        The population; None where there are too few joints.
    left_out
        By key, why a case that is done has no part in the population.
    look
        Cases that need a look, the gravest first.
    """

    rows: tuple[CaseRow, ...]
    counts: Mapping[str, int]
    joints: PopulationFindings | None
    left_out: Mapping[str, str]
    look: tuple[Look, ...]


def examine_campaign(directory: str | os.PathLike[str], seed: int = 1) -> CampaignFindings:
    """Examine the cases of a campaign together.

    Parameters
    ----------
    directory
        Of the campaign: its index and the posteriors of its cases.
    seed
        Of all random numbers.

    Raises
    ------
    MeasurementError
        If there is no index of a campaign.
    """
    rows = read_index(directory)
    draws, left_out = read_draws(directory, rows)
    joints = None if draws is None or len(draws.rows) < FEWEST_JOINTS else _examined(draws, seed)
    done = [row for row in rows if row.status == DONE]
    counts = {
        "cases": len(rows),
        **Counter(row.status for row in rows),
        DONE: len(done),
        "not converged": sum(not row.converged for row in done),
        "do not explain their data": sum(row.explains is False for row in done),
        "in the population": 0 if joints is None else len(joints.draws.rows),
    }
    return CampaignFindings(rows, counts, joints, left_out, _needing_a_look(rows, draws, joints, left_out))


def _examined(draws: CampaignDraws, seed: int) -> PopulationFindings:
    prior = PopulationPrior.from_joints(draws.prior_mean, draws.prior_sd)
    population = hierarchical_posterior(draws.draws, prior, draws.parametrisation, seed)
    stiffness = population_stiffness(population, draws.parametrisation, seed)
    quantities = _quantities(draws, population, np.random.default_rng([seed, 9]))
    return PopulationFindings(draws, prior, population, stiffness, quantities)


def _quantities(draws: CampaignDraws, population: Population, rng: np.random.Generator) -> tuple[ComparedQuantity, ...]:
    """Every stiffness that is positive, by its logarithm; for one of either sign the coordinate that stands for it."""
    parametrisation, theta = draws.parametrisation, draws.draws.theta
    names, compared = parametrisation.names, []
    free = [q for q in parametrisation.quantities if any(axis.quantity == q.name for axis in parametrisation.axes)]
    limit = outlier_limit(len(theta), len(free)) if len(theta) >= FEWEST else np.inf
    there = draws.draws.log_prior < np.inf
    weight = there / there.sum(axis=1, keepdims=True)
    for quantity in free:
        if quantity.name in names or quantity.may_be_negative:
            axis = parametrisation.axes[names.index(parametrisation.standing_for(quantity.name))]
            values, logarithmic = theta[..., names.index(axis.name)], axis.logarithmic
            name, unit = axis.name, axis.unit
        else:
            place = parametrisation.quantities.index(quantity)
            values, logarithmic = np.log(parametrisation.values(theta)[..., place]), True
            name, unit = quantity.name, quantity.unit
        label = name if name == quantity.name else f"{name}, for {quantity.name}"
        quantiles = weighted_quantiles(values, weight, (0.025, 0.5, 0.975, *_CENTRAL))
        median, least = quantiles[:, 1], np.finfo(float).eps * np.maximum(np.abs(quantiles[:, 1]), 1.0)
        spread = spread_of(median, np.maximum((quantiles[:, 4] - quantiles[:, 3]) / 2, least))
        scale = np.exp if logarithmic else np.asarray
        ends = scale(quantiles[:, :3]), scale(population.shrunken(values))
        rank = _ranks(values, population.weight, rng)
        compared.append(ComparedQuantity(name, label, unit, logarithmic, *ends, rank, spread, limit))
    return tuple(compared)


def _ranks(values: Array, weight: Array, rng: np.random.Generator) -> Array:
    """Rank of each joint over joint draws from all: lower end, median and upper end, shape (joints, 3)."""
    steps = np.cumsum(weight, axis=1)
    rows = np.arange(len(values))
    ranks = np.empty((_RANKINGS, len(values)))
    for i in range(_RANKINGS):
        picked = (steps < (rng.random(len(values)) * steps[:, -1])[:, None]).sum(axis=1)
        order = np.argsort(values[rows, picked])
        ranks[i, order] = np.arange(1, len(values) + 1)
    return np.quantile(ranks, [0.025, 0.5, 0.975], axis=0).T


def _needing_a_look(
    rows: Sequence[CaseRow], draws: CampaignDraws | None, joints: PopulationFindings | None, left_out: Mapping[str, str]
) -> tuple[Look, ...]:
    """Cases with whatever is unusual about them; what holds for most cases is no reason to look at one."""
    reasons: dict[str, list[tuple[int, str]]] = {row.key: [] for row in rows}
    done = [row for row in rows if row.status == DONE]
    for row in rows:
        if row.status != DONE:
            told = f": {row.error}" if row.error else ""
            reasons[row.key].append((0 if "kill" in row.status else 1, f"{row.status}{told}"))
        elif not row.converged:
            reasons[row.key].append((3, f"not converged: {row.reason}" if row.reason else "not converged"))
    usual = 2 * list(left_out.values()).count(OTHER_KIND) >= len(done)
    for key, reason in left_out.items():
        if not (usual and reason == OTHER_KIND):
            reasons[key].append((2, reason))
    if joints is not None:
        for key, gravity, why in _unlike_the_others(joints):
            reasons[key].append((gravity, why))
    if 2 * sum(row.explains is False for row in done) < len(done):
        for row in done:
            if row.explains is False:
                reasons[row.key].append((5, "the model does not explain its data"))
    edges = {} if draws is None else draws.at_edge
    if 2 * len(edges) < len(done):
        for key, ends in edges.items():
            reasons[key].append((6, f"its draws accumulate at the {ends}"))
    for key, why in _unusual_verdicts(done):
        reasons[key].append((7, why))
    flagged = [(row, sorted(reasons[row.key])) for row in rows if reasons[row.key]]
    looks = [Look(row, found_in[0][0], tuple(why for _, why in found_in)) for row, found_in in flagged]
    return tuple(sorted(looks, key=lambda look: (look.gravity, -len(look.reasons), look.row.order)))


def _unlike_the_others(joints: PopulationFindings) -> list[tuple[str, int, str]]:
    """Key, gravity and words for joints that are outliers."""
    told = []
    rows = joints.draws.rows
    for quantity in joints.quantities:
        score = quantity.spread.score
        for i in np.flatnonzero(quantity.outlier):
            side = "high" if score[i] > 0 else "low"
            told.append((rows[i].key, 4, f"{quantity.name} is an outlier, {side} by {abs(score[i]):.1f} sd"))
    return told


def _unusual_verdicts(done: Sequence[CaseRow]) -> list[tuple[str, str]]:
    told = []
    for name in dict.fromkeys(name for row in done for name in row.verdicts):
        count = Counter(row.verdicts[name] for row in done if name in row.verdicts)
        usual, often = count.most_common(1)[0]
        if often < _USUAL * count.total():
            continue
        told += [
            (row.key, f"{name} is {row.verdicts[name]}, of most joints {usual}")
            for row in done
            if row.verdicts.get(name, usual) != usual
        ]
    return told
