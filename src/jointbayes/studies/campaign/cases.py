"""A campaign's directory as it is read: the row of each case in the index, and the draws of those that are done."""

import datetime
import math
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError, ModelError
from jointbayes.joint import COORDINATES, Parametrisation, parametrisation_named
from jointbayes.studies.campaign.reweighting import JointDraws

#: File by which the directory of a campaign is known.
INDEX = "index.parquet"
DONE = "done"

_NUMBERS = 1_200_000  # draws of all joints together that are looked at
_MOST, _FEWEST = 2000, 50  # of each joint
_EDGE, _PILED = 0.05, 2.0  # a strip of a prior's range, and how much more than the prior has there is a pile


@dataclass(frozen=True, slots=True)
class CaseRow:
    """What the index says of one case.

    Parameters
    ----------
    key, file, status, attempts, error, serial, date, order, converged, reason, explains
        As in the index; None where it says nothing.
    verdicts
        Verdict on each stiffness by name; empty unless the case is done.
    """

    key: str
    file: str
    status: str
    attempts: int
    error: str
    serial: str | None
    date: datetime.datetime | None
    order: int
    converged: bool
    reason: str
    explains: bool | None
    verdicts: Mapping[str, str]

    @property
    def label(self) -> str:
        """Serial number of the joint, or the key of its case."""
        return self.serial or self.key


def read_index(directory: str | os.PathLike[str]) -> tuple[CaseRow, ...]:
    """Read the index of a campaign, in the order of its table.

    Raises
    ------
    MeasurementError
        If there is none, or it is no index of a campaign.
    """
    import pyarrow
    from pyarrow import parquet

    file = Path(directory) / INDEX
    remedy = "expected the index that `jointbayes campaign` writes; give the directory of a campaign"
    if not file.is_file():
        raise MeasurementError(f"{file}: no such file; {remedy}")
    try:
        columns = parquet.read_table(file).to_pydict()
        rows = [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]
        found = [_row(row) for row in rows]
    except (pyarrow.ArrowException, OSError, KeyError, TypeError, ValueError) as error:
        raise MeasurementError(f"{file}: found no index in it ({type(error).__name__}); {remedy}") from error
    return tuple(sorted(found, key=lambda row: row.order))


def _row(row: Mapping[str, Any]) -> CaseRow:
    suffix = ".verdict"
    explains = row.get("explains")
    return CaseRow(
        key=str(row["key"]),
        file=str(row.get("file") or ""),
        status=str(row["status"]),
        attempts=int(row.get("attempts") or 0),
        error=str(row.get("error") or ""),
        serial=None if row.get("serial") in (None, "") else str(row["serial"]),
        date=_date(row.get("date")),
        order=int(row["order"]),
        converged=bool(row.get("converged")),
        reason=str(row.get("reason") or ""),
        explains=None if explains is None else bool(explains),
        verdicts={name.removesuffix(suffix): str(v) for name, v in row.items() if name.endswith(suffix) and v},
    )


def _date(value: object) -> datetime.datetime | None:
    """A date without its time zone: those of one table are compared with each other only."""
    if isinstance(value, datetime.datetime):
        return value.astimezone(datetime.UTC).replace(tzinfo=None) if value.tzinfo else value
    if isinstance(value, datetime.date):
        return datetime.datetime.combine(value, datetime.time())
    return None


def in_order(rows: Sequence[CaseRow]) -> tuple[tuple[CaseRow, ...], str]:
    """Cases in the order of a control chart, and what that is: by date, by serial number or as in the table.

    By date if every case has one that is not the same for all, else by serial number if every case has one, in which
    numbers count as numbers, else as they stand in the table.
    """
    if rows and all(row.date is not None for row in rows) and len({row.date for row in rows}) > 1:
        return tuple(sorted(rows, key=lambda row: (row.date or datetime.datetime.min, row.order))), "date"
    if rows and all(row.serial for row in rows):
        return tuple(sorted(rows, key=lambda row: (_natural(row.serial or ""), row.order))), "serial number"
    return tuple(sorted(rows, key=lambda row: row.order)), "order in the table"


def _natural(text: str) -> list[tuple[int, float, str]]:
    return [(0, float(p), "") if p.isdigit() else (1, 0.0, p) for p in re.split(r"(\d+)", text[:200]) if p]


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
    left_out
        By key, why a case that is done has no part in this.
    """

    rows: tuple[CaseRow, ...]
    parametrisation: Parametrisation
    draws: JointDraws
    prior_mean: Array
    prior_sd: Array
    at_edge: Mapping[str, str]
    left_out: Mapping[str, str]

    def taken(self, places: Sequence[int]) -> "CampaignDraws":
        """The same joints in another order."""
        chosen = list(places)
        draws = JointDraws(self.draws.theta[chosen], self.draws.log_prior[chosen])
        return replace(self, rows=tuple(self.rows[i] for i in chosen), draws=draws)


@dataclass(frozen=True, slots=True, eq=False)
class _Case:
    """Draws of one case (n, d) in its own coordinates, with what its file says of its prior."""

    row: CaseRow
    coordinates: str
    stiffness: Array
    log_prior: Array
    prior: Mapping[str, Array]


def read_draws(directory: str | os.PathLike[str], rows: Sequence[CaseRow]) -> CampaignDraws | None:
    """Read draws of every case that is done and converged, as many of each as memory and time allow.

    Cases in other coordinates than most are carried over into these where they can be.

    Returns
    -------
    CampaignDraws or None
        None where no case has any.
    """
    chosen = [row for row in rows if row.status == DONE and row.converged]
    most = min(_MOST, max(_FEWEST, _NUMBERS // max(len(chosen), 1)))
    cases, left_out = [], {}
    for row in chosen:
        try:
            cases.append(_read_case(Path(directory), row, most))
        except (OSError, KeyError, ValueError, TypeError, RuntimeError, ModelError) as error:
            left_out[row.key] = f"its posterior cannot be read ({type(error).__name__})"
    if not cases:
        return None
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
    mean, sd = _prior_moments(kept, common)
    edges = {case.row.key: text for case in kept if (text := _piled_up(case))}
    return CampaignDraws(
        tuple(case.row for case in kept),
        parametrisation,
        JointDraws.stacked(theta, log_prior),
        mean,
        sd,
        edges,
        left_out,
    )


def _read_case(directory: Path, row: CaseRow, most: int) -> _Case:
    import h5py  # type: ignore[import-untyped]

    with h5py.File(_inside(directory, row.file or f"cases/{row.key}.nc"), "r") as file:
        group = file["log_prior"]
        key = group.attrs["coordinates"]
        coordinates = key.decode() if isinstance(key, bytes) else str(key)
        if coordinates not in COORDINATES:
            raise ModelError(f"found {coordinates} coordinates")
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


def _prior_moments(cases: Sequence[_Case], common: str) -> tuple[Array, Array]:
    """Mean and sd of each joint's prior in the common coordinates; of cases in others that of those which have them."""
    own = [case for case in cases if case.coordinates == common]
    return np.stack([case.prior["mean"] for case in own]), np.stack([case.prior["sd"] for case in own])


def _piled_up(case: _Case) -> str:
    """At which ends of its prior the draws of a case accumulate; empty if at none."""
    own = parametrisation_named(case.coordinates)
    theta, ends = own.coordinates(case.stiffness), []
    for i, axis in enumerate(own.axes):
        low, high = float(case.prior["low"][i]), float(case.prior["high"][i])
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            continue
        place = (theta[:, i] - low) / (high - low)
        for side, share in (("lower", (place < _EDGE).mean()), ("upper", (place > 1 - _EDGE).mean())):
            if share > _PILED * _EDGE:
                ends.append(f"{side} end of the prior of {axis.name}")
    return ", ".join(ends)
