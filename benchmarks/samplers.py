"""How fast samplers draw from the posterior, on the case with modal damping and on that with a loss factor.

Run by `make bench`, and with `--nuts` by `make science`. A sampler that is not installed is named in the table and
left out.
"""

import argparse
import importlib.util
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import jointbayes as jb
from benchmarks import cases, peers, record
from benchmarks.peer_samplers import Run, StretchRun, dynesty_run, nautilus_run, nuts_run, stretch_run
from benchmarks.timing import Contestant, interleaved

WANTED = 2000.0
SEED = 1
WALKERS = 32
#: Of the processor: 50 autocorrelation times and more.
EMCEE_SECONDS = 30.0
MISSING = "not installed: pip install 'jointbayes[bench]'"


def ours(case: jb.Case, quick: bool) -> Run:
    """`jointbayes.sample` as a user calls it, from finding the mode to the posterior object."""
    settings = jb.SamplerSettings(walkers=8, max_steps=400, tau_factor=10.0) if quick else case.sampler
    began, own = time.perf_counter(), time.process_time()
    posterior = jb.sample(case, seed=SEED, settings=settings)
    total, own = time.perf_counter() - began, time.process_time() - own
    figures = posterior.record.sampler
    theta = case.problem.parametrisation.coordinates(posterior.stiffness)
    return Run(
        theta=theta,
        ess=float(min(figures["ess"].values())),
        evaluations=int(figures["evaluations"]),
        seconds=float(figures["seconds"]),
        start_up_seconds=total - float(figures["seconds"]),
        cpu_share=own / total,
        note=f"`jointbayes.sample`: {posterior.reason}; burn-in counted among the sampling",
    )


def starting_points(case: jb.Case, count: int) -> tuple[np.ndarray, float]:
    """Points about the mode inside the prior's support, shape (count, 3), and the seconds it took to find the mode."""
    began = time.perf_counter()
    estimate = jb.find_map(case, seed=SEED)
    seconds = time.perf_counter() - began
    rng = np.random.default_rng(SEED)
    theta = rng.multivariate_normal(estimate.theta, estimate.covariance, size=20 * count)
    inside = theta[np.isfinite(case.problem.prior.log_density(theta))]
    return inside[:count], seconds


def microseconds(log_likelihood: Callable[[np.ndarray], object], matrices: np.ndarray, rounds: int) -> float:
    """µs per joint of a likelihood by itself."""
    timing = interleaved({"": Contestant(lambda: log_likelihood(matrices), len(matrices))}, rounds)
    return timing[""].median


def extrapolated(stretch: StretchRun, us: float, way: str) -> Run:
    """The stretch move with another likelihood: the same draws at another price for each.

    Posterior and move are those of `stretch`, so its τ holds; measured are the likelihood's µs.
    """
    per_step = stretch.walkers * 1e-6 * us + stretch.overhead_per_step
    kept = stretch.ess * stretch.tau / stretch.walkers
    return Run(
        theta=stretch.theta,
        ess=stretch.ess,
        evaluations=stretch.evaluations,
        seconds=kept * per_step,
        start_up_seconds=stretch.burn_in * per_step,
        cpu_share=stretch.cpu_share,
        note=f"{way}; measured µs per likelihood, τ and draws of emcee on the jointbayes likelihood",
    )


def row(
    method: str, run: Run, reference: Run, us: float, map_seconds: float, extrapolate: bool = False
) -> dict[str, Any]:
    """Figures of one sampler as they are kept."""
    rate = run.ess / run.seconds
    to_wanted = run.seconds_to(WANTED) if run.seconds_to else map_seconds + run.start_up_seconds + WANTED / rate
    ratio = run.sd / reference.sd
    furthest = float(ratio[np.argmax(np.abs(np.log(ratio)))])
    note = run.note
    if abs(np.log(furthest)) > 0.1:
        note += (
            f"; **its spread is {furthest:.2f} of the reference's: ESS and times are not those of the same posterior**"
        )
    return {
        "method": method,
        "extrapolated": extrapolate,
        "us_per_likelihood": us,
        "ess": run.ess,
        "ess_per_second": rate,
        "evaluations": run.evaluations,
        "evaluations_per_effective": run.evaluations / run.ess,
        "seconds": run.seconds,
        "start_up_seconds": run.start_up_seconds,
        "map_seconds": map_seconds,
        "compile_seconds": run.compile_seconds,
        "seconds_to_wanted": to_wanted,
        "cpu_to_wanted": to_wanted * run.cpu_share,
        "mean_difference": float(np.abs((run.mean - reference.mean) / reference.sd).max()),
        "sd_ratio": furthest,
        "mean": run.mean.tolist(),
        "sd": run.sd.tolist(),
        "note": note,
    }


def missing(method: str) -> dict[str, Any]:
    """The line of a sampler that is not there."""
    return {"method": method, "missing": MISSING, "extrapolated": False}


def emcee_rows(case: jb.Case, law: str, reference: Run, start: tuple[np.ndarray, float], quick: bool) -> list[dict]:
    """emcee's default move on three likelihoods: run on ours, extrapolated for the slow ones."""
    points, map_seconds = start
    stretch = stretch_run(case.problem.log_posterior, points, 1.0 if quick else EMCEE_SECONDS, SEED)
    _, matrices = cases.joints(case, WALKERS // 2)  # emcee asks for half an ensemble at a time
    test = peers.Test(case.problem)
    if law == "loss_factor":
        better = ("2×2 numpy.linalg.solve", peers.batched_solve, "2×2 systems of all lines by numpy.linalg.solve")
    else:
        better = ("modal sum in NumPy", peers.modal_sum, "SciPy eigh of the assembled matrices and modal sum in NumPy")
    ways = [
        ("line-by-line solve", peers.dense_loop, "dense solve at each line", matrices[:1]),
        ("batched dense solve", peers.dense_batched, "dense solves batched over lines", matrices[:2]),
        (*better, matrices),
    ]
    if law != "loss_factor":
        why = "; 2×2 coupling does not apply: the damping belongs to the assembled structure's modes"
        ways[2] = (*better[:2], better[2] + why, matrices)
    rows = []
    for name, make, text, some in ways:
        us = microseconds(make(test), some, 1 if quick else 3)
        rows.append(row(f"emcee, {name}", extrapolated(stretch, us, text), reference, us, map_seconds, True))
    us = 1e6 * stretch.likelihood_seconds / stretch.evaluations
    rows.append(row("emcee, jointbayes likelihood", stretch, reference, us, map_seconds))
    return rows


def nested_rows(case: jb.Case, reference: Run, quick: bool) -> list[dict]:
    """Nested samplers on our likelihood; they need no mode to start from."""
    problem = case.problem
    runs: dict[str, tuple[str, Callable[[], Run]]] = {
        "dynesty": ("dynesty", lambda: dynesty_run(problem, SEED, 25 if quick else 500)),
        "nautilus": ("nautilus", lambda: nautilus_run(problem, SEED, 100 if quick else WANTED, 200 if quick else 2000)),
    }
    rows = []
    for module, (name, run) in runs.items():
        method = f"{name}, jointbayes likelihood"
        if importlib.util.find_spec(module) is None:
            rows.append(missing(method))
            continue
        done = run()
        rows.append(row(method, done, reference, 1e6 * done.likelihood_seconds / done.evaluations, 0.0))
    return rows


def nuts_row(case: jb.Case, reference: Run, start: tuple[np.ndarray, float], quick: bool) -> dict[str, Any]:
    """NUTS over the JAX model."""
    method = "NUTS of blackjax, JAX likelihood with gradient"
    if any(importlib.util.find_spec(module) is None for module in ("jax", "blackjax")):
        return missing(method)
    points, map_seconds = start
    warm_up, draws = (100, 100) if quick else (500, 1000)
    done = nuts_run(case.problem, points[: 2 if quick else 4], SEED, warm_up, draws)
    return row(method, done, reference, 1e6 * done.likelihood_seconds / done.evaluations, map_seconds)


def compare(law: str, quick: bool, nuts: bool) -> dict[str, Any]:
    """All samplers on one case, NUTS among them if that is asked for."""
    case = cases.quick_case(law) if quick else cases.case_with_lines(law)
    theta, _ = cases.joints(case, 64)
    us = microseconds(case.problem.log_posterior, theta, 1 if quick else 5)
    reference = ours(case, quick)
    start = starting_points(case, WALKERS)
    rows = emcee_rows(case, law, reference, start, quick)
    rows += nested_rows(case, reference, quick)
    if nuts:
        rows.append(nuts_row(case, reference, start, quick))
    rows.append(row("jointbayes", reference, reference, us, 0.0))
    return {"law": law, "values": case.problem.test.data.frf.values.size, "rows": rows}


def main(arguments: list[str] | None = None) -> None:
    """Measure, print and keep the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    record.add_options(parser)
    parser.add_argument("--law", choices=list(cases.CASES), help="only the case with this damping law")
    parser.add_argument("--nuts", action="store_true", help="NUTS on a JAX model too: two minutes more")
    options = parser.parse_args(arguments)
    cases.one_core()
    laws = [options.law] if options.law else list(cases.CASES)
    results = {"wanted": WANTED, "cases": [compare(law, options.quick, options.nuts) for law in laws]}
    record.keep("samplers", results, options)


if __name__ == "__main__":
    main()
