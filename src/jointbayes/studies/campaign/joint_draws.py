"""The draws of a campaign's cases as they are read from its directory, all in the same coordinates."""

import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.joint import COORDINATES, Parametrisation, parametrisation_named
from jointbayes.studies.campaign.index import DONE, CaseRow
from jointbayes.studies.campaign.reweighting import JointDraws
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
