"""Whether a structure that was never tested does what `predict` says: 100 pairs of each kind with one joint.

The clamp is identified on an overhang of 383 mm; a bar of 300 mm in the same clamp is then "measured" by the exact
beam, which knows nothing of jointbayes. Two studies. "frfs": noisy FRFs of a bar that is exactly as modelled.
"modes": five natural frequencies of bars whose modulus, density and lengths are off as stated, and whose modes are off
by 0.3 % each, in the test and in the structure that is predicted. The 95 % bands should hold 95 of 100 lines and
natural frequencies. The table goes to docs/predict.md.

Three more kinds take what is usual: nothing is stated; modulus, density, lengths and modes are off as in a workshop.
Joints are drawn from the prior. "longer": a bar of 300 mm predicts one of 460 mm, both exact. "frames": an L of two
members predicts another one; their matrices come from exact dynamic stiffness. "solids": a bar of bricks, which the
analysis reduces, predicts a longer one on the same face; the truth is the whole model.
"""

import math
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

import jointbayes as jb
from benchmarks.bricks import brick_model, face
from benchmarks.exact_beam import ExactBeam, circle, rectangle
from benchmarks.page import table
from benchmarks.random_frames import member
from benchmarks.study import Row, Study, share
from jointbayes.inference import JointPrior, Problem, Test, Uniform
from jointbayes.joint import Joint, parametrisation_named
from jointbayes.sampling import SamplerSettings
from jointbayes.structure import ModalDamping, Port, StructureRecipe, family_of_recipe, reduce_to_ports
from jointbayes.structure.imported.ports import port_forms
from vibrecords import ModeData, Observed

Array = NDArray[np.float64]
Modes = tuple[Array, Array]  # ω and the tip's share of each mode of unit mass
ENTROPY = 20261128
SETTINGS = SamplerSettings(walkers=24, max_steps=2000).for_one_of_many()

KINDS = {"frfs": "FRFs, model exact", "modes": "five frequencies, models wrong by 0.3 %"}
USUAL = {
    "longer": "bar to longer bar, as usual",
    "frames": "frame to frame, as usual",
    "solids": "solid to solid, as usual",
}
TESTED, OTHER, RATIO = 0.383, 0.300, 0.01
LINES = np.arange(20.0, 2500.0, 10.0)
COUNT, MODES, MODEL_ERROR = 5, 3, 0.003
OF_SOLID = 8  # frequencies for six springs, a modulus and a density
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

FRAME = """
[structure]
kind = "frame"
directions = ["x", "y", "rz"]
youngs_modulus_gpa = 210.0
density_kg_m3 = 7800.0
section = {{ shape = "rectangle", width_mm = 40.0, height_mm = 20.0 }}
points = {{ foot = [0, 0, 0], head = [0, {height}, 0], tip = [{arm}, {height}, 0] }}
members = [{{ points = ["foot", "head"] }}, {{ points = ["head", "tip"] }}]
damping = {{ law = "modal", ratio = 0.01 }}
[joint]
kind = "springs"
dofs = ["foot:x", "foot:y", "foot:rz"]
[prior]
kx = {{ distribution = "log_uniform", low = 1e7, high = 1e10 }}
ky = {{ distribution = "log_uniform", low = 1e7, high = 1e10 }}
krz = {{ distribution = "log_uniform", low = 1e4, high = 1e6 }}
"""
FREQUENCIES = '[data]\nkind = "natural_frequencies"\nsd_relative = 0.0002\nfrequencies_hz = '
USUAL_OFF = {"youngs_modulus": 0.03, "density": 0.01, "length": 0.005}
FRAMES, PIECES = ((0.35, 0.5), (0.5, 0.3)), 16  # height and arm, m; parts of a member
BARS, WAYS = ((8, 0.2), (10, 0.26)), ("x", "y", "z", "rx", "ry", "rz")  # bricks along x, and length in m
SOFTEST, STIFFEST = np.array([1e7] * 3 + [1e3] * 3), np.array([1e9] * 3 + [1e5] * 3)


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
    """One pair: which lines and natural frequencies of the other structure its bands hold."""
    if kind in USUAL:
        return usual_pair(kind, index)
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
    return _held(posterior, recipe, "11:y", truth, exact)


def _held(posterior: jb.Posterior, recipe: StructureRecipe, tip: str, truth: Any, exact: Array) -> Row:
    """Compare the prediction of a structure with its FRF and natural frequencies."""
    found = posterior.predict(recipe, jb.Ports(LINES, (tip,), (tip,)))
    size, low, high = np.abs(truth), found.frf.magnitude_low[:, 0, 0], found.frf.magnitude_high[:, 0, 0]
    ends = [found.interval(mode) for mode in range(1, MODES + 1)]
    return {
        "lines": float(((low <= size) & (size <= high)).mean()),
        "frequencies": [bool(a <= f <= b) for (a, b), f in zip(ends, exact, strict=True)],
        "band": float(np.median(high / low)),
    }


def usual_pair(kind: str, index: int) -> Row:
    """One pair whose premises are the usual ones, and whose truths are drawn from them."""
    rng = np.random.default_rng([ENTROPY, list(USUAL).index(kind), index])
    off = {name: math.exp(sd * rng.standard_normal()) for name, sd in USUAL_OFF.items()}
    modes, problem_of, recipe, tip = {"longer": _bars, "frames": _frames, "solids": _solids}[kind](rng, off)
    errors = MODEL_ERROR * rng.standard_normal((2, 12))
    (tested, _), (omega, shape) = (
        (omega * _padded(1 + e, omega), s) for (omega, s), e in zip(modes, errors, strict=True)
    )
    count = OF_SOLID if kind == "solids" else COUNT
    hz = tested[:count] / (2 * np.pi) * (1 + 0.0002 * rng.standard_normal(count))
    posterior = jb.sample(problem_of(hz), seed=index, settings=SETTINGS)
    w = 2 * np.pi * LINES[:, None]
    truth = (shape**2 / (omega**2 - w**2 + 2j * RATIO * omega * w)).sum(axis=1)
    return _held(posterior, recipe, tip, truth, omega[:MODES] / (2 * np.pi))


def _padded(factors: Array, omega: Array) -> Array:
    return np.concatenate([factors, np.ones(max(len(omega) - len(factors), 0))])[: len(omega)]


def _modes(stiffness: Array, mass: Array, tip: Array) -> Modes:
    squared, shapes = eigh(stiffness, mass)
    return np.sqrt(squared), tip @ shapes


def _bars(rng: np.random.Generator, off: dict[str, float]) -> tuple[Any, ...]:
    k11, k22 = 10 ** rng.uniform(7, 11), 10 ** rng.uniform(4, 7)
    stiffness = (k11, rng.uniform(-0.95, 0.95) * math.sqrt(k11 * k22), k22)
    modes = []
    for length in (0.300 * off["length"], 0.460 * math.exp(USUAL_OFF["length"] * rng.standard_normal())):
        found = (bar := beam(length, off, stiffness)).modes(100_000.0)
        modes.append((found.omega, found.shapes[:, bar.index(["11:y"])[0]]))
    text = HEAD.replace("length_mm = 383.0", "length_mm = 300.0") + FREQUENCIES

    def case(hz: Array) -> jb.Case:
        return jb.case_from_text("bar", f"{text}{hz.tolist()}\n")

    spec = case(np.array([100.0, 500.0, 1500.0])).tests[0].spec.structure
    return modes, case, spec.model_copy(update={"length_mm": 460.0}).recipe(()), "11:y"


def _frames(rng: np.random.Generator, off: dict[str, float]) -> tuple[Any, ...]:
    springs = 10 ** rng.uniform((7, 7, 4), (10, 10, 6))
    section, modes, step = rectangle(0.04, 0.02, 0.3), [], (2 * np.pi * 100) ** 2
    for height, arm in FRAMES:
        size = 3 * (2 * PIECES + 1)
        dynamic = np.zeros((2, size, size))
        for i in range(2 * PIECES):  # D(ω²) = K - ω² M for parts far shorter than a wave
            vector = np.array([0.0, height] if i < PIECES else [arm, 0.0]) / PIECES
            own = member(np.array([0.0, step]), vector, section, 2.1e11 * off["youngs_modulus"], 7800 * off["density"])
            dynamic[:, 3 * i : 3 * i + 6, 3 * i : 3 * i + 6] += own.real
        mass = (dynamic[0] - dynamic[1]) / step
        dynamic[0, :3, :3] += np.diag(springs)
        modes.append(_modes(dynamic[0], mass, np.eye(size)[-2]))
    texts = [FRAME.format(height=1e3 * height, arm=1e3 * arm) + FREQUENCIES for height, arm in FRAMES]

    def case(hz: Array, text: str = texts[0]) -> jb.Case:
        return jb.case_from_text("frame", f"{text}{hz.tolist()}\n")

    other = case(np.array([100.0, 500.0]), texts[1])
    return modes, case, other.problem.test.structures.recipe, "tip:y"


@cache
def _bar(which: int) -> tuple[StructureRecipe, Array, Array, Array, Array]:
    """The reduced bar of bricks, and of the whole one stiffness, mass, directions of the face, the tip's."""
    count, length = BARS[which]
    model = brick_model((count, 2, 2), (length, 0.02, 0.03))
    ports = {"root": Port(face(model, 0.0)), "corner": Port((face(model, length)[-1],))}
    forms = {name: port_forms(model, port, name) for name, port in ports.items()}
    held = np.stack([forms["root"][way] for way in WAYS], axis=1)
    recipe = reduce_to_ports(model, ports, 6000.0, ModalDamping((RATIO,)))
    return recipe, model.stiffness.toarray(), model.mass.toarray(), held, forms["corner"]["y"]


def _solids(rng: np.random.Generator, off: dict[str, float]) -> tuple[Any, ...]:
    springs = np.exp(rng.uniform(np.log(SOFTEST), np.log(STIFFEST)))
    wholes = [_bar(which)[1:] for which in range(2)]
    modes = [
        _modes(off["youngs_modulus"] * k + held @ np.diag(springs) @ held.T, off["density"] * m, tip)
        for k, m, held, tip in wholes
    ]
    ends = zip(np.log(SOFTEST), np.log(STIFFEST), strict=True)
    prior = JointPrior(parametrisation_named("springs", WAYS), tuple(Uniform(low, high) for low, high in ends))
    joint = Joint(tuple(f"root:{way}" for way in WAYS))

    def problem(hz: Array) -> Problem:
        data = ModeData(Observed(hz, 0.0002 * hz))
        return Problem([Test("", family_of_recipe(_bar(0)[0]), joint, data)], prior, name="solid")

    return modes, problem, _bar(1)[0], "corner:y"


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
        rows.append(((KINDS | USUAL)[kind], str(data["sets"]), lines, held, band))
    return table(head, rows)


STUDY = Study("predictions", "predict.md", dict.fromkeys(KINDS | USUAL, 100), pair, summary, tables)

if __name__ == "__main__":
    STUDY.main()
