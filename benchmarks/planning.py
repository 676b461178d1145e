"""Does `jointbayes plan` foretell the posterior spread that a further measurement then leaves?

The measurements are those of docs/identifiability.md: 10 to 2500 Hz in steps of 2 Hz, 3 % noise and a floor of 1 %.
Random cases: joint, structure, which quantities are uncertain, where the further accelerometer goes and which stiffness
is looked at are drawn from the laws below, the seed being the number of the case; none is left out. Each case is
planned from its present data alone. Then the measurement is made with its own noise, and the posterior of both
together is sampled. Three forecasts of the standard deviation of ln k are set beside the one found:

- "Fisher": at the mode of the present posterior;
- "expected": nested Monte Carlo over the present posterior, which is what the plan prints as simulated;
- "joint told": the same for the true joint, as `plan(assume=...)` has it: the question of someone who plans for a
  stated joint. It parts what the present data leave open from what the method gets wrong.

    python -m benchmarks.planning --cases 20
"""

import argparse
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from jointbayes.case_candidates import candidates_of
from jointbayes.planning import present_draws
from jointbayes.posterior.fisher import fisher_information
from jointbayes.posterior.planning import forecast, measurement_information
from jointbayes.posterior.planning_check import assumed_truth, confirm
from jointbayes.workflow import charts

__all__ = ["RandomCase", "Row", "analyse", "random_case", "table"]

WITHIN = 0.15
#: About 2000 effective draws: a standard deviation to 2 %.
SETTINGS = jb.SamplerSettings(walkers=24, max_steps=4000, tau_factor=25.0, tau_tolerance=0.05, end_tolerance=0.1)
#: Uncertain quantity: standard deviation in per cent; the damping ratio is between a third and three times its value.
QUANTITIES = {"youngs_modulus": 2.0, "length": 0.5, "density": 1.0, "damping_ratio": None}
NOMINAL = {"youngs_modulus": 210.0, "length": 383.0, "density": 7800.0, "damping_ratio": 0.01}
TRUTH_KEYS = {
    "youngs_modulus": "youngs_modulus_gpa", "length": "length_mm", "density": "density_kg_m3",
    "damping_ratio": "damping_ratio",
}  # fmt: skip
TEMPLATE = """
title = "Random case {seed}"
[structure]
kind = "beam"
length_mm = 383.0
elements = 10
youngs_modulus_gpa = 210.0
poissons_ratio = 0.3
density_kg_m3 = 7800.0
section = {{ shape = "circle", diameter_mm = 25.0 }}
damping = {{ law = "modal", ratio = 0.01 }}
[joint]
dofs = ["1:y", "1:rz"]
initial = {{ k11 = 1.0e8, k12 = 0.0, k22 = 0.0 }}
[prior]
k11 = {{ distribution = "log_uniform", low = 1.0e6, high = 1.0e11 }}
k12 = {{ distribution = "log_uniform", low = 1.0e4, high = 1.0e10 }}
k22 = {{ distribution = "log_uniform", low = 1.0e3, high = 1.0e8 }}
[uncertain]
{uncertain}
[data]
kind = "synthetic_frf"
outputs = {outputs}
inputs = ["11:y"]
quantity = "receptance"
f_min_hz = 10.0
f_max_hz = 2500.0
f_step_hz = 2.0
[data.truth]
{truth}
[data.noise]
relative = 0.03
floor = 0.01
seed = {noise_seed}
[identification]
line_weight = 0.5
[sampling]
walkers = 24
[plan]
parameter = "{parameter}"
outputs = ["{dof}"]
"""


@dataclass(frozen=True)
class RandomCase:
    """One draw: the case in hand, the same with the further measurement, and the truth."""

    seed: int
    present: jb.Case
    both: jb.Case
    parameter: str
    dof: str
    uncertain: tuple[str, ...]
    truth: NDArray[np.float64]


def random_case(seed: int, node: int | None = None) -> RandomCase:
    """Draw a case.

    ln k11 uniform from 1e8 to 1e10 N/m, ln k22 from 1e5 to 1e7 N·m/rad, k12/√(k11 k22) from 0.1 to 0.8; each quantity
    uncertain with probability a half, its true value then from its prior; the further
    accelerometer at any node, or at that which is named.
    """
    rng = np.random.default_rng([seed, 2024])
    k11, k22 = np.exp(rng.uniform(np.log([1e8, 1e5]), np.log([1e10, 1e7])))
    k12 = rng.uniform(0.1, 0.8) * math.sqrt(k11 * k22)
    uncertain = tuple(name for name in QUANTITIES if rng.random() < 0.5)
    parameter, drawn_node = ("k11", "k12", "k22")[rng.integers(3)], int(rng.integers(1, 11))
    node = drawn_node if node is None else node
    logs = {name: _draw(name, rng) for name in uncertain}
    lines = [f"k11 = {k11:.6e}", f"k12 = {k12:.6e}", f"k22 = {k22:.6e}"]
    lines += [f"{TRUTH_KEYS[name]} = {NOMINAL[name] * math.exp(log)!r}" for name, log in logs.items()]
    priors = [
        f"{name} = {{ low_factor = 0.3333, high_factor = 3.0 }}" if sd is None else f"{name} = {{ sd_percent = {sd} }}"
        for name, sd in QUANTITIES.items()
        if name in uncertain
    ]
    dof = f"{node}:y"

    def case(outputs: str) -> jb.Case:
        text = TEMPLATE.format(
            seed=seed, uncertain="\n".join(priors), truth="\n".join(lines), outputs=outputs, parameter=parameter,
            dof=dof, noise_seed=1000 + seed,
        )  # fmt: skip
        return jb.case_from_text(f"random case {seed}", text)

    both = case(f'["11:y", "{dof}"]')
    in_order = [logs[n.name] for n in both.problem.prior.nuisances]
    truth = np.concatenate([np.log([k11, k12, k22]), in_order])
    return RandomCase(seed, case('["11:y"]'), both, parameter, dof, uncertain, truth)


def _draw(name: str, rng: np.random.Generator) -> float:
    sd = QUANTITIES[name]
    return float(rng.uniform(-math.log(3), math.log(3)) if sd is None else rng.normal(0.0, sd / 100))


@dataclass(frozen=True)
class Row:
    """Forecasts of the standard deviation of ln k for one case, and what sampling found."""

    seed: int
    parameter: str
    dof: str
    uncertain: int
    before: float
    fisher: float
    expected: float
    low: float
    high: float
    told: float
    told_low: float
    told_high: float
    found: float
    converged: bool


def analyse(seed: int, node: int | None = None, simulations: int = 8) -> Row:
    """Plan a case from its present data, then make the measurement and sample."""
    drawn = random_case(seed, node)
    problem, parameter = drawn.present.problem, drawn.parameter
    candidate = next(c for c in candidates_of(drawn.present) if c.name == drawn.dof)
    rng = np.random.default_rng([seed, 3])
    mode = jb.find_map(drawn.present, seed=1).theta
    draws, _ = present_draws(drawn.present, mode, rng)
    fisher = fisher_information(problem, mode)
    information = {candidate.name: measurement_information(candidate, problem, mode)}
    by_fisher = forecast(fisher, information, [candidate], parameter)
    truth = assumed_truth(problem, mode, np.exp(drawn.truth[:3]))
    said, told = (
        confirm(problem, [candidate], parameter, draws, charts(problem), rng, truth=t, simulations=simulations)
        for t in (None, truth)
    )
    posterior = jb.sample(drawn.both, seed=1, settings=SETTINGS)
    found = float(np.log(posterior.values(parameter)).std())
    return Row(
        seed, parameter, drawn.dof, len(drawn.uncertain), said.sd_before, by_fisher.sd_after, said.sd_after,
        *said.sd_range, told.sd_after, *told.sd_range, found, posterior.converged,
    )  # fmt: skip


def holds(row: Row, forecast: str) -> bool:
    """Whether a forecast lies within 15 % of what was found."""
    return abs(getattr(row, forecast) / row.found - 1) <= WITHIN


def sure(low: float, high: float) -> bool:
    """Whether a forecast says of itself that it is sharp: its central 80 % span less than a factor of 1.3."""
    return high <= 1.3 * low


def table(rows: list[Row]) -> str:
    """Markdown table of the cases and of how many forecasts hold."""
    lines = [
        "| case | k | at | uncertain | before | found | Fisher | expected (80 %) | joint told (80 %) |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        mark = "" if r.converged else " (not converged)"
        lines.append(
            f"| {r.seed} | {r.parameter} | {r.dof} | {r.uncertain} | {r.before:.3g} | {r.found:.3g}{mark} | "
            f"{r.fisher:.3g}, **{r.fisher / r.found:.2f}** | {r.expected:.3g} ({r.low:.3g} to {r.high:.3g}), "
            f"**{r.expected / r.found:.2f}** | {r.told:.3g} ({r.told_low:.3g} to {r.told_high:.3g}), "
            f"**{r.told / r.found:.2f}** |"
        )
    lines += ["", "Bold: forecast over found.", "", f"Within 15 % of what sampling found, of {len(rows)} cases:", ""]
    lines.append(f"- Fisher: {sum(holds(r, 'fisher') for r in rows)}.")
    for name, text, ends in (
        ("expected", "expected", lambda r: (r.low, r.high)),
        ("told", "joint told", lambda r: (r.told_low, r.told_high)),
    ):
        sharp = [r for r in rows if sure(*ends(r))]
        inside = sum(ends(r)[0] <= r.found <= ends(r)[1] for r in rows)
        lines.append(
            f"- {text}: {sum(holds(r, name) for r in rows)}; of those {len(sharp)} whose 80 % span less than a factor "
            f"of 1.3: {sum(holds(r, name) for r in sharp)}. Found inside the 80 %: {inside}."
        )
    return "\n".join(lines)


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--first", type=int, default=1, help="number of the first case")
    options = parser.parse_args()
    rows = []
    for seed in range(options.first, options.first + options.cases):
        rows.append(analyse(seed))
        print(rows[-1], flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()
