"""Do intervals from measured modes hold where the model is wrong as stated? `python -m benchmarks.model_error`.

The data are natural frequencies and antiresonances of `benchmarks.exact_beam`, which has no mesh and shares no code
with the package: the beam of the main case with an error of 2 % in its modulus, 1 % in its density and 0.3 % in its
length, with 20 g at mid-span of which the model knows nothing, on a joint with k11 of 1e7 to 1e11 N/m, k22 of 1e4 to
1e7 N m/rad and any coupling up to 0.95. A test scatters by 0.05 %. It is analysed with modulus, density and length
uncertain by as much and with `[uncertain.model_error]` as it is by default: from three frequencies, from four, and from
four and the first three antiresonances of the tip. Counted is how often the 95 % interval holds the true stiffness, and
how wide it is. Intervals are those of the package's density by importance sampling, which needs a second where a run
of the sampler takes half a minute.

Part of `make science`. Outcomes are kept in build/model_error as they come, one line of JSON each, so that a run that
was cut off goes on where it was. Figures go to benchmarks/model_error.json, the table to docs/modes.md.
"""

import argparse
import json
import math
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

import jointbayes as jb
from benchmarks.exact_beam import ExactBeam, circle
from benchmarks.page import table
from benchmarks.record import environment, kept_outcomes, record_kind, write_between

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[1]
BASE = ROOT / "configs" / "clamped_beam.toml"
KEPT = ROOT / "build" / "model_error"
SUMMARY = ROOT / "benchmarks" / "model_error.json"
PAGE = ROOT / "docs" / "modes.md"
ENTROPY = 20261124

#: Natural frequencies and antiresonances of the tip that are measured, by what the table calls them.
KINDS = {"three frequencies": (3, 0), "four frequencies": (4, 0), "four frequencies, three antiresonances": (4, 3)}
CASES = 200
#: What is asked of each stiffness: the share of its 95 % intervals that hold the truth.
WANTED = (0.92, 0.98)
SCATTER = 0.0005
MASS = 0.020  # kg, at mid-span
ERRORS = {"youngs_modulus": 0.02, "density": 0.01, "length": 0.003}
#: Importance sampling: draws a round, rounds at most, and effective draws that end it. Ends of intervals are then known
#: to some 5 % of their width, far better than what the scatter of 200 cases can tell.
DRAWS, ROUNDS, ENOUGH = 8000, 20, 2000
_FEWEST, _CENTRES, _WIDTH, _DOF, _FROM_PRIOR = 150, 400, 0.4, 5, 0.1
#: The tip is held by so many kg: its antiresonances are then off by less than 1e-6 of them.
_HOLDING = 1e6
_HIGHEST_HZ = 20_000.0
_PRIOR = """
[prior.k11]
distribution = "log_uniform"
low = 1e7
high = 1e11

[prior.k22]
distribution = "log_uniform"
low = 1e4
high = 1e7

[prior.rho]
distribution = "uniform"
low = -0.95
high = 0.95
"""


def true_beam(rng: np.random.Generator) -> ExactBeam:
    """A beam and a joint, neither of them quite as they are modelled."""
    off = {name: math.exp(sd * rng.standard_normal()) for name, sd in ERRORS.items()}
    k11, k22 = 10 ** rng.uniform(7, 11), 10 ** rng.uniform(4, 7)
    length = 0.383 * off["length"]
    return ExactBeam(
        length,
        circle(0.025, 0.3),
        2.1e11 * off["youngs_modulus"],
        0.3,
        7800.0 * off["density"],
        {1: 0.0, 6: length / 2, 11: length},
        (k11, rng.uniform(-0.95, 0.95) * math.sqrt(k11 * k22), k22),
        masses={6: MASS},
    )


def exact_modes(beam: ExactBeam, count: int, zeros: int) -> tuple[Array, Array]:
    """Its lowest natural frequencies and antiresonances of the tip, Hz."""
    held = ExactBeam(**{**beam.__dict__, "masses": {**beam.masses, 11: _HOLDING}})
    frequency, antiresonance = (each.modes(_HIGHEST_HZ).omega / (2 * np.pi) for each in (beam, held))
    return frequency[:count], antiresonance[1 : 1 + zeros]  # first of all the beam swings about its heavy tip


def case_of(kind: str, index: int) -> tuple[jb.Case, dict[str, float]]:
    """One measurement of one beam, and its true stiffnesses; the same beam and scatter for every kind."""
    rng = np.random.default_rng([ENTROPY, index])
    beam = true_beam(rng)
    count, zeros = KINDS[kind]
    frequency, antiresonance = exact_modes(beam, 4, 3)
    frequency, antiresonance = (
        each * np.exp(SCATTER * rng.standard_normal(each.size)) for each in (frequency, antiresonance)
    )
    whole = BASE.read_text(encoding="utf-8")
    head = whole[: whole.index("# What is known before")].replace(
        'parametrisation = "log"', 'parametrisation = "signed"'
    )
    text = f"{head}{_PRIOR}\n[uncertain.model_error]\n"
    text += "".join(f"\n[uncertain.{name}]\nsd_percent = {100 * sd}\n" for name, sd in ERRORS.items())
    stated = f"sd_relative = {SCATTER}\nfrequencies_hz = "
    text += f'\n[data]\nkind = "modes"\n{stated}{frequency[:count].tolist()}\n'
    if zeros:
        text += f'\n[data.zeros]\ndof = "11:y"\n{stated}{antiresonance[:zeros].tolist()}\n'
    k11, _, k22 = beam.stiffness
    return jb.case_from_text(f"{kind} {index}", text), {"k11": k11, "k22": k22}


def analysed(kind: str, index: int) -> dict[str, Any]:
    """What a run says of each stiffness of one beam, beside the truth; JSON-ready."""
    began = time.process_time()
    case, truth = case_of(kind, index)
    problem = case.problem
    theta, weight = importance_draws(problem, np.random.default_rng([ENTROPY, index, 1]))
    values = problem.prior.values(theta)
    names = [quantity.name for quantity in problem.quantities]
    stiffness = {
        name: {"truth": true, "interval95": weighted_quantiles(values[:, names.index(name)], weight, (0.025, 0.975))}
        for name, true in truth.items()
    }
    effective = float(1 / (weight**2).sum())
    return {"index": index, "effective": effective, "seconds": time.process_time() - began, "stiffness": stiffness}


def importance_draws(problem: jb.Problem, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draws of θ (n, d) and their weights (n,), which sum to 1.

    Each round draws about centres that the draws of the rounds before leave, a Student-t about each, and one draw in
    ten from the prior, so that no weight is large where no centre is. The first rounds find the centres and do not
    count. Coordinates are θ with k22(1 − ρ²) for k22, what is left of it where nothing holds the translation: volumes
    are the same, and a ridge is straight.
    """
    prior, density = problem.prior, problem.log_posterior
    k22, rho = problem.names.index("k22"), problem.names.index("rho")

    def turned(theta: Array, sign: float) -> Array:
        turned_theta = theta.copy()
        turned_theta[:, k22] += sign * np.log(np.maximum(1 - theta[:, rho] ** 2, 1e-3))
        return turned_theta

    theta = prior.sample(rng, 3 * DRAWS)
    log_weight = density.log_likelihood(theta)
    kept: list[tuple[Array, Array]] = []
    for number in range(ROUNDS):
        centres, spread = _centres(turned(theta, 1.0), log_weight, rng)
        about = centres[rng.integers(len(centres), size=DRAWS)]
        away = stats.multivariate_t(np.zeros(len(spread)), spread, df=_DOF).rvs(DRAWS, random_state=rng)
        drawn = turned(about + away, -1.0)
        from_prior = rng.random(DRAWS) < _FROM_PRIOR
        drawn[from_prior] = prior.sample(rng, int(from_prior.sum()))
        mixture = np.logaddexp(
            math.log(1 - _FROM_PRIOR) + _log_kernels(turned(drawn, 1.0), centres, spread),
            math.log(_FROM_PRIOR) + prior.log_density(drawn),
        )
        kept.append((drawn, density(drawn) - mixture))
        # all rounds but the first look alike, and make the next one's centres
        theta, log_weight = (np.concatenate(each) for each in zip(*kept[(number + 1) // 2 :], strict=True))
        weight = np.exp(log_weight - log_weight.max())
        if number > 1 and weight.sum() ** 2 / (weight**2).sum() > ENOUGH:
            break
    return theta, weight / weight.sum()


def _centres(theta: Array, log_weight: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Centres (m, d) among weighted draws, and the spread of a draw about one, shape (d, d)."""
    weight = _tempered(log_weight)
    centres = theta[rng.choice(len(theta), size=_CENTRES, p=weight)]
    return centres, _WIDTH**2 * np.cov(theta.T, aweights=weight)


def _log_kernels(theta: Array, centres: Array, spread: Array) -> Array:
    """ln of the density (n,) of a Student-t about each of the centres, one as probable as the other."""
    d = len(spread)
    lower = np.linalg.cholesky(spread)
    here, there = (np.linalg.solve(lower, each.T).T for each in (theta, centres))
    square = (here**2).sum(axis=1)[:, None] + (there**2).sum(axis=1) - 2 * here @ there.T
    kernels = (1 + np.maximum(square, 0) / _DOF) ** (-(_DOF + d) / 2)
    constant = math.lgamma((_DOF + d) / 2) - math.lgamma(_DOF / 2) - d / 2 * math.log(_DOF * math.pi)
    return np.log(kernels.mean(axis=1)) + constant - np.log(np.diag(lower)).sum()


def _tempered(log_weight: Array) -> Array:
    """Weights to a power of at most 1 that leaves some effective draws to fit."""
    for power in 0.8 ** np.arange(60):
        weight = np.exp(power * (log_weight - log_weight.max()))
        weight /= weight.sum()
        if 1 / (weight**2).sum() > _FEWEST:
            break
    return weight


def weighted_quantiles(values: Array, weight: Array, shares: Sequence[float]) -> list[float]:
    """Quantiles of weighted draws."""
    order = np.argsort(values)
    reached = np.cumsum(weight[order]) - weight[order] / 2
    return np.exp(np.interp(shares, reached, np.log(values[order]))).tolist()


def outcomes(kind: str, count: int, kept: Path) -> list[dict[str, Any]]:
    """Outcomes of the first `count` beams; those kept in a file are not analysed again."""
    case, _ = case_of(kind, 1)
    head = json.dumps({"entropy": ENTROPY, "draws": (DRAWS, ROUNDS, ENOUGH), "case": case.text})
    return kept_outcomes(kept, head, count, partial(analysed, kind), kind)


def summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """JSON-ready counts and widths by stiffness."""
    stiffness = {}
    for name in rows[0]["stiffness"]:
        said = [row["stiffness"][name] for row in rows]
        held = sum(one["interval95"][0] <= one["truth"] <= one["interval95"][1] for one in said)
        widths = [one["interval95"][1] / one["interval95"][0] for one in said]
        stiffness[name] = {"held": held, "width": float(np.median(widths))}
    return {
        "cases": len(rows),
        "least_effective": min(row["effective"] for row in rows),
        "median_seconds": float(np.median([row["seconds"] for row in rows])),
        "stiffness": stiffness,
        "environment": environment(),
    }


def section(results: Mapping[str, Mapping[str, Any]]) -> str:
    """A table of what was measured, and where it was analysed."""
    head = ("measured", "stiffness", "cases", "95 % interval holds", "share (95 % confidence)",
            "upper/lower end, median")  # fmt: skip
    rows = []
    for kind, data in results.items():
        n = data["cases"]
        for name, one in data["stiffness"].items():
            low, high = stats.binomtest(one["held"], n).proportion_ci(0.95, method="exact")
            share = f"{100 * one['held'] / n:.1f} % ({100 * low:.1f} to {100 * high:.1f})"
            counts = (str(n), str(one["held"]))
            rows.append((kind, name, *counts, share, f"{one['width']:.1f}"))
    notes = []
    for kind, data in results.items():
        notes.append(
            f"{kind[0].upper()}{kind[1:]}: at least {data['least_effective']:.0f} effective draws, "
            f"{data['median_seconds']:.1f} s of CPU a case."
        )
    where = next(iter(results.values()))["environment"]
    place = f"{where['date']}, {where['cpu']}, Python {where['python']}, one core."
    return "\n".join([*table(head, rows), "", *notes, place, ""])


def main() -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", action="append", choices=list(KINDS), help="may be repeated; default: all")
    parser.add_argument("--count", type=int, default=CASES, help="beams; default: the whole study")
    parser.add_argument("--pilot", action="store_true", help="print only: leave page and record as they are")
    options = parser.parse_args()
    for kind in options.kind or KINDS:
        data = summary(outcomes(kind, options.count, KEPT / f"{kind.replace(' ', '_').replace(',', '')}.jsonl"))
        print(section({kind: data}), flush=True)
        if not options.pilot:
            write_between(PAGE, "model_error.py", section(record_kind(SUMMARY, KINDS, kind, data)))


if __name__ == "__main__":
    main()
