"""Are posteriors calibrated? Truths from the prior, data from the likelihood, ranks of the truths: `make science`.

Each data set is analysed as a user's would be, from the search for the mode to the draws. Each has a seed of its own,
whatever the number of processes. Finished analyses are kept as they come, so that a run that was cut off goes on where
it was. Writes its part of docs/calibration.md and a figure for each variant.
"""

import argparse
import json
import multiprocessing
import os
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from benchmarks.calibration_data import VARIANTS, case_of, draw_data
from benchmarks.calibration_page import SUMMARY, write_figure, write_page
from benchmarks.record import kept_lines, merged
from jointbayes.errors import JointBayesError
from jointbayes.studies.calibration import CalibrationResult, calibrate, rank_statistic

__all__ = ["DENSITY", "KEPT", "SETTINGS", "Outcome", "analyse", "outcomes", "results", "summary"]

ROOT = Path(__file__).resolve().parents[1]
PARTIAL = ROOT / "build" / "calibration"
ENTROPY = 20220322

#: The default stop rule with more walkers and shorter runs: 1500 effective draws and more.
SETTINGS = jb.SamplerSettings(
    walkers=64, check_every=25, max_steps=2000, tau_factor=6.0, tau_tolerance=0.1, end_tolerance=0.1
)

#: Draws among which a truth is ranked.
KEPT = 63

#: Ranked like a parameter: the density tells of errors that each parameter by itself does not show.
DENSITY = "log density"


@dataclass(frozen=True)
class Outcome:
    """What became of one data set; values by name are in the order of the names."""

    index: int
    seconds: float
    names: tuple[str, ...] = ()
    truth: tuple[float, ...] = ()
    rank: tuple[int, ...] = ()
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    converged: bool = False
    mode_agrees: bool = False
    ess: float = 0.0
    error: str = ""


def analyse(task: tuple[str, int]) -> Outcome:
    """Draw data set number so many of a variant and analyse it."""
    variant, index = task
    began = time.process_time()
    key = (list(VARIANTS).index(variant), index)
    rng = np.random.default_rng(np.random.SeedSequence(ENTROPY, spawn_key=key))
    data = draw_data(variant, rng)
    try:
        posterior = jb.sample(data.case, seed=int(rng.integers(2**32)), settings=SETTINGS)
    except (JointBayesError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        return Outcome(index, time.process_time() - began, error=f"{type(error).__name__}: {error}")
    prior, log_posterior = data.case.problem.prior, data.case.problem.log_posterior
    names = (*("k11", "k12", "k22"), *(n.name for n in prior.nuisances), DENSITY)
    known = prior.stiffness(data.theta), prior.nuisance_values(data.theta), log_posterior(data.theta)
    truth = np.concatenate(known)
    columns = [posterior.values(name).ravel() for name in names[:-1]] + [posterior.log_density.ravel()]
    draws = np.stack(columns, axis=-1)
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    return Outcome(
        index,
        time.process_time() - began,
        names,
        tuple(truth.tolist()),
        tuple(rank_statistic(truth, draws, KEPT, rng).tolist()),
        tuple(low.tolist()),
        tuple(high.tolist()),
        posterior.converged,
        posterior.mode_agrees,
        float(min(posterior.record.sampler["ess"].values())),
    )


def outcomes(variant: str, count: int, processes: int = 1, kept: Path | None = None) -> list[Outcome]:
    """Analyse the first `count` data sets of a variant, but for those whose outcome is kept in a file already."""
    done = {one.index: one for one in _read(kept, variant)} if kept is not None else {}
    todo = [(variant, i) for i in range(count) if i not in done]
    began = time.monotonic()
    for i, one in enumerate(_analysed(todo, processes), 1):
        done[one.index] = one
        if kept is not None:
            with kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(one)) + "\n")
            if i % 10 == 0 or i == len(todo):
                left = (time.monotonic() - began) / i * (len(todo) - i) / 60
                print(f"{variant}: {len(done)} of {count}, {left:.1f} min left", flush=True)
    return [done[i] for i in range(count)]


def _analysed(tasks: list[tuple[str, int]], processes: int) -> Iterator[Outcome]:
    if processes == 1 or len(tasks) < 2:
        yield from map(analyse, tasks)
        return
    with multiprocessing.get_context("spawn").Pool(min(processes, len(tasks))) as pool:
        yield from pool.imap_unordered(analyse, tasks)


def _fingerprint(variant: str) -> dict[str, Any]:
    """What outcomes depend on: those of another case or other settings are not mixed with these."""
    return {"case": case_of(variant).text, "settings": asdict(SETTINGS), "kept": KEPT, "entropy": ENTROPY}


def _read(file: Path, variant: str) -> list[Outcome]:
    """Outcomes kept in a file; it is begun anew if it is of another case or other settings."""
    head = json.dumps(_fingerprint(variant))
    found = kept_lines(file, head)
    return [Outcome(**{k: tuple(v) if isinstance(v, list) else v for k, v in one.items()}) for one in found]


def results(found: Iterable[Outcome]) -> tuple[CalibrationResult, ...]:
    """Ranks and coverage of each parameter over all analyses that came to an end, converged or not."""
    ended = [one for one in found if not one.error]

    def column(field: str, i: int) -> NDArray[np.float64]:
        return np.array([getattr(one, field)[i] for one in ended])

    names = ended[0].names
    return calibrate(
        {name: column("rank", i) for i, name in enumerate(names)},
        {name: np.stack([column("low", i), column("high", i)], axis=-1) for i, name in enumerate(names)},
        {name: column("truth", i) for i, name in enumerate(names)},
        KEPT,
    )


def summary(found: list[Outcome], judged: tuple[CalibrationResult, ...]) -> dict[str, Any]:
    """JSON-ready figures of one variant."""
    ended = [one for one in found if not one.error]
    return {
        "count": len(found),
        "failed": [one.error for one in found if one.error],
        "converged": sum(one.converged for one in ended),
        "mode_agrees": sum(one.mode_agrees for one in ended),
        "median_ess": float(np.median([one.ess for one in ended])),
        "median_seconds": float(np.median([one.seconds for one in found])),
        "total_seconds": float(np.sum([one.seconds for one in found])),
        "draws": KEPT,
        "band_probability": judged[0].band.probability,
        "parameters": {
            r.name: {
                "inside_band": r.inside_band,
                "p_value": r.p_value,
                "largest_deviation": r.largest_deviation,
                "covered": r.coverage.inside,
                "coverage_interval95": r.coverage.interval95,
            }
            for r in judged
        },
    }


def main() -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--variant", action="append", choices=list(VARIANTS), help="may be repeated; default: all")
    parser.add_argument("--count", type=int, default=500, help="data sets of each variant; default 500")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--pilot", action="store_true", help="print only: leave page, figures and summary as they are")
    options = parser.parse_args()
    for variant in options.variant or VARIANTS:
        kept = PARTIAL / f"{variant.replace(' ', '-')}.jsonl"
        found = outcomes(variant, options.count, options.processes, kept)
        judged = results(found)
        data = merged(None, variant, summary(found, judged), options.pilot)[variant]
        for name, row in data["parameters"].items():
            print(f"  {name:20s}", {k: v if isinstance(v, bool | int) else np.round(v, 4) for k, v in row.items()})
        print({k: v for k, v in data.items() if k not in ("parameters", "environment")})
        if not options.pilot:
            kept_figures = json.loads(SUMMARY.read_text(encoding="utf-8")) if SUMMARY.exists() else {}
            SUMMARY.write_text(json.dumps({**kept_figures, variant: data}, indent=1) + "\n", encoding="utf-8")
            write_figure(variant, judged)
            write_page()


if __name__ == "__main__":
    main()
