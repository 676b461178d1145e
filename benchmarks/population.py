"""Does a campaign tell the population that its joints come from? Joints of a known one, inferred: `make science`.

In each repetition 200 joints are drawn from a population of known mean and scatter, measured by simulation with noise
of their own, and inferred one by one under a wide prior that knows nothing of the population; then mean and scatter are
inferred from all of them, as the report of a campaign does. Counted is how often mean and scatter of each stiffness lie
in their 95 % credible intervals. Nothing is shared between repetitions but the structure, the lines and the population:
no joint, no noise and no posterior occurs twice.

Each posterior is one of the package: its likelihood and prior, its proposal fitted from the Laplace approximation,
importance draws. Only the search for the mode is cut short: it begins at the true joint, which in so good a measurement
has the one mode there is. Finished repetitions are kept, so that a run that was cut off goes on where it was.
"""

import argparse
import json
import os
import time
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

import jointbayes as jb
from benchmarks.page import table
from benchmarks.record import environment, kept_lines
from jointbayes.case.case_text import read_case_text
from jointbayes.frf import Ports, ReceptanceModel
from jointbayes.inference import Problem
from jointbayes.joint import LogStiffness
from jointbayes.posterior.coordinates import coordinate_systems
from jointbayes.sampling import fit_proposal
from jointbayes.sampling.density import newton_climb
from jointbayes.sampling.distributions import resampled
from jointbayes.studies.campaign.hierarchical import JointDraws, PopulationPrior, hierarchical_posterior
from jointbayes.studies.workers import run_tasks
from vibrecords import FrfData, FrfSet

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "build" / "population.jsonl"
SUMMARY = ROOT / "benchmarks" / "population.json"
PAGE = ROOT / "docs" / "population.md"
BEGIN, END = "<!-- begin: written by benchmarks/population.py -->", "<!-- end -->"
ENTROPY = 20100710
NAMES = ("k11", "k12", "k22")
Array = NDArray[np.float64]

#: The population: mean and scatter of ln k11, ln k12, ln k22.
MEAN = np.log([5.0e8, 6.0e6, 4.0e5])
SCATTER = np.array([0.15, 0.20, 0.10])
JOINTS, REPETITIONS = 200, 100
#: Kept of each joint, and proposed for it.
DRAWS, PROPOSED = 400, 6000
_GOOD = 0.25  # effective share of the proposed draws at which a fit is good enough
_AT_LEAST, _AT_MOST = 0.92, 0.98  # of the repetitions
_SD = 0.2  # in ln k, about the truth: where the climb to the mode takes its first steps

#: Edits of the case with a loss factor: few elements and lines, tip and mid-span, and no prior knowledge to speak of.
_EDITS = (
    ("elements = 10", "elements = 4"),
    ('outputs = ["11:y"]', 'outputs = ["5:y", "3:y"]'),
    ('inputs = ["11:y"]', 'inputs = ["5:y"]'),
    ("f_step_hz = 1.0", "f_step_hz = 40.0"),
    ("relative = 0.03", "relative = 0.0"),
    ("floor = 0.01", "floor = 0.7"),
)


@cache
def base_problem() -> Problem:
    """The problem that all joints share but for their data; the stated noise is that of the paper's joint."""
    text = read_case_text(ROOT / "configs" / "clamped_beam_loss_factor.toml").text
    for old, new in _EDITS:
        if old not in text:
            raise ValueError(f"clamped_beam_loss_factor.toml: expected {old!r}")
        text = text.replace(old, new, 1)
    problem = jb.case_from_text("population", text).problem
    assert isinstance(problem.test.data, FrfData)
    return problem.with_test(data=replace(problem.test.data, joint_frf=None))


@cache
def _model() -> ReceptanceModel:
    base = base_problem()
    assert isinstance(base.test.data, FrfData)
    frf = base.test.data.frf
    return base.test.receptance_model(Ports(frf.frequency_hz, frf.outputs, frf.inputs))


def measured(theta: Array, rng: np.random.Generator) -> Problem:
    """The problem with a measurement of the joint θ."""
    base = base_problem()
    nominal = base.test.data
    assert isinstance(nominal, FrfData)
    exact = _model().receptance(LogStiffness().matrix(base.prior.values(theta))[None])[0]
    noise = rng.normal(size=exact.shape) + 1j * rng.normal(size=exact.shape)
    values = exact + np.sqrt(nominal.variance / 2) * noise
    frf = FrfSet(nominal.frf.frequency_hz, values, nominal.frf.outputs, nominal.frf.inputs, nominal.frf.quantity)
    return base.with_test(data=replace(nominal, frf=frf))


def posterior_draws(problem: Problem, theta: Array, rng: np.random.Generator) -> tuple[Array, float]:
    """Equally weighted posterior draws, shape (DRAWS, 3), and the effective number of importance draws behind them."""
    log_posterior = problem.log_posterior
    mode, _, covariance = newton_climb(log_posterior, theta, np.eye(3) * _SD**2)
    proposal = fit_proposal(log_posterior, coordinate_systems(problem), [(mode, covariance)], rng, enough=_GOOD)
    draws, log_weight = proposal.weighted_draws(log_posterior, rng, PROPOSED)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    return draws[rng.permutation(resampled(weight, DRAWS, rng))], float(1 / (weight**2).sum())


@dataclass(frozen=True)
class Repetition:
    """One campaign: 2.5, 50 and 97.5 % of mean and scatter of each ln k, and where the truth lies among their draws."""

    index: int
    seconds: float
    mean: tuple[tuple[float, ...], ...]
    scatter: tuple[tuple[float, ...], ...]
    place: tuple[float, ...]
    score: tuple[float, ...]
    effective: float
    least_effective: float
    monte_carlo: float


def repetition(index: int, joints: int = JOINTS) -> Repetition:
    """Draw a campaign of joints, measure and infer each, then the population."""
    began = time.process_time()
    rng = np.random.default_rng(np.random.SeedSequence(ENTROPY, spawn_key=(index,)))
    prior = base_problem().prior
    theta, log_prior, effective = [], [], []
    while len(theta) < joints:
        true = MEAN + SCATTER * rng.normal(size=3)
        if not prior.feasible(true):  # the population is cut off where no joint is
            continue
        draws, worth = posterior_draws(measured(true, rng), true, rng)
        theta.append(draws)
        log_prior.append(prior.log_density(draws))
        effective.append(worth)
    assumed = PopulationPrior.from_joints(prior.mean, prior.sd)
    drawn = JointDraws.stacked(theta, log_prior)
    found = hierarchical_posterior(drawn, assumed, prior.parametrisation, seed=index)
    both, truth = np.concatenate([found.mean, np.log(found.scatter)], axis=1), np.concatenate([MEAN, np.log(SCATTER)])
    ends = [np.quantile(part, [0.025, 0.5, 0.975], axis=0).T for part in (found.mean, found.scatter)]
    return Repetition(
        index,
        time.process_time() - began,
        *(tuple(map(tuple, part.tolist())) for part in ends),
        tuple((both < truth).mean(axis=0).tolist()),
        tuple(((both.mean(axis=0) - truth) / both.std(axis=0)).tolist()),
        float(np.median(found.effective)),
        float(min(effective)),
        float(found.monte_carlo.max()),
    )


def kept_task(index: int, joints: int) -> dict[str, Any]:
    """A repetition as a task of a worker."""
    return asdict(repetition(index, joints))


def summary(found: list[Repetition], joints: int = JOINTS) -> dict[str, Any]:
    """JSON-ready figures: how often mean and scatter lie in their intervals, and how far off they are."""
    rows = {}
    for i, name in enumerate(NAMES):
        for kind, true, column in (("mean", MEAN[i], i), ("scatter", SCATTER[i], i + len(NAMES))):
            ends = np.array([getattr(one, kind)[i] for one in found])
            inside = int(((ends[:, 0] <= true) & (true <= ends[:, 2])).sum())
            score = np.array([one.score[column] for one in found])
            low, high = stats.binomtest(inside, len(found)).proportion_ci(0.95, method="exact")
            rows[f"{kind} of ln {name}"] = {
                "truth": float(true),
                "median_of_medians": float(np.median(ends[:, 1])),
                "typical_width95": float(np.median(ends[:, 2] - ends[:, 0])),
                "inside": inside,
                "coverage_interval95": [float(low), float(high)],
                "mean_score": float(score.mean()),
                "sd_score": float(score.std()),
            }
    return {
        "repetitions": len(found),
        "joints": joints,
        "draws": DRAWS,
        "rows": rows,
        "median_effective_draws": float(np.median([one.effective for one in found])),
        "least_effective_importance_draws": float(min(one.least_effective for one in found)),
        "largest_monte_carlo_error": float(max(one.monte_carlo for one in found)),
        "total_seconds": float(sum(one.seconds for one in found)),
        "environment": environment(),
    }


def section(data: dict[str, Any]) -> str:
    """What stands in docs/population.md."""
    where, n = data["environment"], data["repetitions"]
    worst = data["largest_monte_carlo_error"]
    rows = []
    for name, row in data["rows"].items():
        low, high = row["coverage_interval95"]
        rows.append(
            (
                name,
                f"{row['truth']:.4g}",
                f"{row['median_of_medians']:.4g}",
                f"{row['typical_width95']:.2g}",
                f"{row['inside']} of {n} ({100 * low:.0f} to {100 * high:.0f} %)",
                f"{row['mean_score']:+.2f} ± {1 / np.sqrt(n):.2f}",
                f"{row['sd_score']:.2f}",
            )
        )
    head = (
        "",
        "truth",
        "median",
        "width of the interval",
        "intervals that hold the truth",
        "mean score",
        "sd of scores",
    )
    return "\n".join(
        [
            f"{n} repetitions of {data['joints']} joints, {data['draws']} draws of each; {where['date']}, "
            f"{where['cpu']}, Python {where['python']}, {data['total_seconds'] / 60:.0f} min of one core in all.",
            "",
            *table(head, rows),
            "",
            "Score: posterior mean less truth, in posterior standard deviations; calibrated scores have mean 0 and "
            f"standard deviation 1. Median effective draws of a joint {data['median_effective_draws']:.0f}; largest "
            f"Monte Carlo error of mean or scatter {worst:.2f} posterior standard deviations.",
            "",
        ]
    )


def write_page(data: dict[str, Any]) -> None:
    """Write the table into docs/population.md, between its marks."""
    page = PAGE.read_text(encoding="utf-8")
    head, rest = page.split(BEGIN)
    _, tail = rest.split(END, 1)
    PAGE.write_text(f"{head}{BEGIN}\n\n{section(data)}\n{END}{tail}", encoding="utf-8")


def _fingerprint(joints: int) -> str:
    parts = {"mean": MEAN.tolist(), "scatter": SCATTER.tolist(), "joints": joints, "draws": DRAWS, "edits": _EDITS}
    return json.dumps(parts | {"proposed": PROPOSED, "entropy": ENTROPY})


def _restored(row: dict[str, Any]) -> Repetition:
    nested = {name: tuple(map(tuple, row[name])) for name in ("mean", "scatter")}
    return Repetition(**{**row, **nested, "place": tuple(row["place"]), "score": tuple(row["score"])})


def main() -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=REPETITIONS)
    parser.add_argument("--joints", type=int, default=JOINTS)
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--pilot", action="store_true", help="print only: leave page and summary as they are")
    options = parser.parse_args()
    kept = KEPT.with_name(f"population-{options.joints}.jsonl")
    done = {one.index: one for one in map(_restored, kept_lines(kept, _fingerprint(options.joints)))}
    tasks = [(str(i), (i, options.joints)) for i in range(options.repetitions) if i not in done]
    began = time.monotonic()
    for i, outcome in enumerate(run_tasks(kept_task, tasks, workers=options.workers), 1):
        if outcome.error is not None:
            raise RuntimeError(f"repetition {outcome.key}: {outcome.error}")
        one = _restored(outcome.value)
        done[one.index] = one
        with kept.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(one)) + "\n")
        left = (time.monotonic() - began) / i * (len(tasks) - i) / 60
        print(f"repetition {one.index}: {one.seconds:.1f} s; {len(done)} done, {left:.1f} min left", flush=True)
    data = summary([done[i] for i in range(options.repetitions)], options.joints)
    print(section(data))
    if options.pilot:
        return
    SUMMARY.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    write_page(data)
    bad = [
        name for name, row in data["rows"].items() if not _AT_LEAST <= row["inside"] / options.repetitions <= _AT_MOST
    ]
    print(f"outside {100 * _AT_LEAST:.0f} to {100 * _AT_MOST:.0f} %: {', '.join(bad) or 'none'}")


if __name__ == "__main__":
    main()
