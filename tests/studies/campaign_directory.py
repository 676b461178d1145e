"""Campaign directories as a campaign leaves them, with posteriors whose truth is known: nothing is sampled."""

import datetime
import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from jointbayes.joint import parametrisation_named
from jointbayes.studies.campaign.index import INDEX

#: ln k11, ln k12, ln k22 of the paper's joint.
MEAN = np.log([5.05e9, 3.44e7, 1.52e6])
SCATTER = np.array([0.20, 0.25, 0.10])
ERROR = np.array([0.25, 0.30, 0.05])
LOW, HIGH = np.log([1e6, 1e4, 1e3]), np.log([1e11, 1e10, 1e8])
_VERDICTS = ("weakly identified", "weakly identified", "identified")


def possible(theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Those of the points (n, 3) that are positive definite joints."""
    return theta[parametrisation_named("log").feasible(theta)]


def _cut(middle: NDArray[np.float64], sd: NDArray[np.float64], draws: int, rng: np.random.Generator) -> Any:
    """Normal draws (draws, 3), cut off as by a prior that knows which joints are possible."""
    found = np.zeros((0, 3))
    while len(found) < draws:
        found = np.concatenate([found, possible(middle + sd * rng.normal(size=(2 * draws, 3)))])
    return found[:draws]


def campaign_rows(
    joints: int, seed: int = 1, draws: int = 300, *, dates: bool = True
) -> tuple[list[dict[str, Any]], Any]:
    """Rows of an index and draws of θ (joints, draws, 3) of joints from a known population, log coordinates."""
    rng = np.random.default_rng(seed)
    true = possible(MEAN + SCATTER * rng.normal(size=(2 * joints, 3)))[:joints]
    error = ERROR * np.exp(0.2 * rng.normal(size=(joints, 3)))
    middle = true + error * rng.normal(size=(joints, 3))
    theta = np.stack([_cut(at, sd, draws, rng) for at, sd in zip(middle, error, strict=True)])
    rows = []
    for j in range(joints):
        row: dict[str, Any] = {
            "key": f"case-{j + 1:05d}", "file": f"cases/case-{j + 1:05d}.nc", "status": "done", "attempts": 1,
            "error": None, "serial": f"SN-{20000 + 7 * j}", "order": j, "seed": 1, "converged": True, "reason": "",
            "date": datetime.datetime(2026, 1, 5) + datetime.timedelta(hours=3 * j) if dates else None,
            "seconds": 1.5, "explains": True, "misfit_p_value": float(rng.uniform(0.05, 1)),
        }  # fmt: skip
        for i, (name, unit) in enumerate((("k11", "N/m"), ("k12", "N"), ("k22", "N·m/rad"))):
            low, median, high = np.exp(np.quantile(theta[j, :, i], [0.025, 0.5, 0.975]))
            row |= {
                f"{name}.unit": unit, f"{name}.map": float(median), f"{name}.median": float(median),
                f"{name}.low95": float(low), f"{name}.high95": float(high), f"{name}.sd_log": float(error[j, i]),
                f"{name}.contraction": 0.99, f"{name}.verdict": _VERDICTS[i],
            }  # fmt: skip
        rows.append(row)
    return rows, theta


def write_case(file: Path, theta: NDArray[np.float64], coordinates: str = "log", kind: str = "", **attrs: Any) -> None:
    """What a campaign's report reads of a posterior file: θ of shape (draws, d) under a prior uniform in each."""
    file.parent.mkdir(parents=True, exist_ok=True)
    stiffness = parametrisation_named(coordinates).values(theta)
    given = {"mean": (LOW + HIGH) / 2, "sd": (HIGH - LOW) / np.sqrt(12), "low": LOW, "high": HIGH} | attrs
    with h5py.File(file, "w") as out:
        for i, name in enumerate(("k11", "k12", "k22")):
            out[f"posterior/{name}"] = stiffness[None, :, i]
        out["log_prior/joint"] = attrs.pop("density", np.zeros((1, len(theta))))
        for name, value in ({"coordinates": kind or coordinates} | given).items():
            if name != "density":
                out["log_prior"].attrs[name] = value


def write_index(directory: Path, rows: list[dict[str, Any]]) -> None:
    """The index of a campaign."""
    directory.mkdir(parents=True, exist_ok=True)
    lines = [json.dumps(row, default=datetime.datetime.isoformat) + "\n" for row in rows]
    (directory / INDEX).write_text("".join(lines), encoding="utf-8")


def write_campaign(directory: Path, rows: list[dict[str, Any]], theta: Any, **stated: Any) -> None:
    """The index of a campaign, and the posterior of each case."""
    for row, draws in zip(rows, theta, strict=True):
        write_case(directory / row["file"], draws, **stated)
    write_index(directory, rows)


def campaign_directory(directory: Path, joints: int, seed: int = 1, draws: int = 300) -> list[dict[str, Any]]:
    """A campaign in which two cases failed, two killed their worker, one did not converge and two joints are odd."""
    rows, theta = campaign_rows(joints, seed, draws)
    theta[joints // 2, :, 2] -= 1.5  # too soft by a factor of 4
    theta[joints // 3, :, 2] += 1.0
    for j, (row, draws_of) in enumerate(zip(rows, theta, strict=True)):
        if j == joints // 4:
            row |= {"status": "failed", "attempts": 2, "converged": False, "file": None,
                    "error": f"{row['key']}.uff: found no record of 11:y; expected one; measure it"}  # fmt: skip
        elif j == joints // 4 + 1:
            row |= {"status": "killed its worker", "attempts": 2, "converged": False, "file": None, "error": None}
        else:
            write_case(directory / row["file"], draws_of)
    rows[joints // 5] |= {"converged": False, "reason": "2000 steps were not enough: R̂ 1.08"}
    rows[joints - 2] |= {"explains": False, "misfit_p_value": 0.0}
    rows[joints - 1] |= {"k11.verdict": "not identified"}
    for row in rows:
        if row["status"] != "done":
            for name in [name for name in row if "." in name]:
                row[name] = None
    write_index(directory, rows)
    return rows
