"""Whether a structure that was never tested does what `predict` says: 100 pairs of beams in one clamp.

The clamp is identified on an overhang of 383 mm; a bar of 300 mm in the same clamp is then "measured" by the exact
beam, which knows nothing of jointbayes. Two studies. "frfs": noisy FRFs of a bar that is exactly as modelled.
"modes": five natural frequencies of bars whose modulus, density and lengths are off as stated, and whose modes are off
by 0.3 % each, in the test and in the structure that is predicted. The 95 % bands should hold 95 of 100 lines and
natural frequencies. The table goes to docs/predict.md.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from benchmarks.exact_beam import ExactBeam, circle
from benchmarks.page import table
from benchmarks.study import Row, Study, share
from jointbayes.sampling import SamplerSettings

ENTROPY = 20261128
SETTINGS = SamplerSettings(walkers=24, max_steps=2000).for_one_of_many()

KINDS = {"frfs": "FRFs, model exact", "modes": "five frequencies, models wrong by 0.3 %"}
TESTED, OTHER, RATIO = 0.383, 0.300, 0.01
LINES = np.arange(20.0, 2500.0, 10.0)
COUNT, MODES, MODEL_ERROR = 5, 3, 0.003
#: Standard deviations of modulus, density and each length, as fractions.
OFF = {"youngs_modulus": 0.02, "density": 0.01, "length": 0.003}
NOISE, FLOOR = 0.03, 0.01

HEAD = """
[structure]
kind = "beam"
length_mm = 383.0
elements = 10
youngs_modulus_gpa = 210.0
poissons_ratio = 0.3
density_kg_m3 = 7800.0
section = { shape = "circle", diameter_mm = 25.0 }
damping = { law = "modal", ratio = 0.01 }
[joint]
dofs = ["1:y", "1:rz"]
parametrisation = "signed"
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


def beam(length: float, off: dict[str, float], stiffness: tuple[float, float, float]) -> ExactBeam:
    """A bar in the clamp."""
    points = {1: 0.0, 6: length / 2, 11: length}
    return ExactBeam(
        length, circle(0.025, 0.3), 2.1e11 * off["youngs_modulus"], 0.3, 7800.0 * off["density"], points, stiffness
    )


def frf(of: ExactBeam, errors: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Receptance of the tip; the first modes are off by these fractions."""
    exact = of.modal_receptance(LINES, ["11:y"], ["11:y"], [RATIO])[:, 0, 0]
    modes, omega = of.modes(20_000.0), 2 * np.pi * LINES[:, None]
    count = min(errors.size, len(modes.omega))
    shape = modes.shapes[:count, of.index(["11:y"])[0]]
    for natural, sign in ((modes.omega[:count], -1.0), (modes.omega[:count] * (1 + errors[:count]), 1.0)):
        exact = exact + sign * (shape**2 / (natural**2 - omega**2 + 2j * RATIO * natural * omega)).sum(axis=1)
    return np.asarray(exact)


def pair(kind: str, index: int) -> Row:
    """One pair: which lines and natural frequencies of the other bar its bands hold."""
    rng = np.random.default_rng([ENTROPY, index])
    k11, k22 = 10 ** rng.uniform(7.5, 10), 10 ** rng.uniform(4.5, 6.5)
    stiffness = (k11, rng.uniform(-0.6, 0.9) * math.sqrt(k11 * k22), k22)
    wrong = kind == "modes"
    off = {name: math.exp(sd * rng.standard_normal()) if wrong else 1.0 for name, sd in OFF.items()}
    other_length = OTHER * (math.exp(OFF["length"] * rng.standard_normal()) if wrong else 1.0)
    tested, other = beam(TESTED * off["length"], off, stiffness), beam(other_length, off, stiffness)
    errors = (MODEL_ERROR if wrong else 0.0) * rng.standard_normal((2, 12))
    case = jb.case_from_text(f"{kind} {index}", HEAD + _data(tested, errors[0], wrong, rng))
    posterior = jb.sample(case, seed=index, settings=SETTINGS)
    truth, exact = frf(other, errors[1]), other.modes(20_000.0).omega[:MODES] * (1 + errors[1][:MODES]) / (2 * np.pi)
    recipe = case.tests[0].spec.structure.model_copy(update={"length_mm": 1e3 * OTHER}).recipe(())
    found = posterior.predict(recipe, jb.Ports(LINES, ("11:y",), ("11:y",)))
    size, low, high = np.abs(truth), found.frf.magnitude_low[:, 0, 0], found.frf.magnitude_high[:, 0, 0]
    ends = [found.interval(mode) for mode in range(1, MODES + 1)]
    return {
        "lines": float(((low <= size) & (size <= high)).mean()),
        "frequencies": [bool(a <= f <= b) for (a, b), f in zip(ends, exact, strict=True)],
        "band": float(np.median(high / low)),
    }


def _data(tested: ExactBeam, errors: NDArray[np.float64], wrong: bool, rng: np.random.Generator) -> str:
    """The table of the data, and of what is uncertain."""
    if wrong:
        frequency = tested.modes(20_000.0).omega[:COUNT] * (1 + errors[:COUNT]) / (2 * np.pi)
        uncertain = "".join(f"[uncertain.{name}]\nsd_percent = {100 * sd}\n" for name, sd in OFF.items())
        stated = "[uncertain.model_error]\n"
        return (
            f'[data]\nkind = "modes"\nsd_relative = 0.0002\nfrequencies_hz = {frequency.tolist()}\n{uncertain}{stated}'
        )
    k11, k12, k22 = tested.stiffness
    truth = f"[data.truth]\nk11 = {k11}\nk12 = {k12}\nk22 = {k22}\n"
    noise = f"[data.noise]\nrelative = {NOISE}\nfloor = {FLOOR}\nseed = {int(rng.integers(2**31))}\n"
    lines = f"f_min_hz = 20\nf_max_hz = 2500\nf_step_hz = 10\n{noise}"
    table_ = f'[data]\nkind = "synthetic_frf"\noutputs = ["11:y"]\ninputs = ["11:y"]\n{lines}{truth}'
    return f'{table_}[uncertain]\nexact = ["model", "youngs_modulus", "density", "length", "damping_ratio"]\n'


def summary(rows: Sequence[Row]) -> Row:
    """Shares of lines and of natural frequencies that bands hold."""
    held = [hit for row in rows for hit in row["frequencies"]]
    lines = [row["lines"] for row in rows]
    return {
        "lines": float(np.mean(lines)),
        "lines_se": float(np.std(lines) / math.sqrt(len(rows))),
        "held": sum(held),
        "frequencies": len(held),
        "band": float(np.median([row["band"] for row in rows])),
    }


def tables(results: Mapping[str, Row]) -> list[str]:
    """The table."""
    head = ("Test", "Pairs", "Lines held", "Natural frequencies held", "Width of the band, median")
    rows = []
    for kind, data in results.items():
        lines = f"{100 * data['lines']:.1f} ± {100 * data['lines_se']:.1f} %"
        held, band = share(data["held"], data["frequencies"]), f"{100 * (data['band'] - 1):.2g} %"
        rows.append((KINDS[kind], str(data["sets"]), lines, held, band))
    return table(head, rows)


STUDY = Study("predictions", "predict.md", dict.fromkeys(KINDS, 100), pair, summary, tables)

if __name__ == "__main__":
    STUDY.main()
