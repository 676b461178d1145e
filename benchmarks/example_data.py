"""What the examples state or read as data: `python -m benchmarks.example_data` prints it and writes the files.

`tests/test_examples.py` compares what is in `configs/` with what is made here.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

import jointbayes as jb
from benchmarks.exact_beam import ExactBeam, circle
from benchmarks.written_files import write_frf, write_records
from jointbayes.case.case_objects import true_stiffness
from jointbayes.frf import MeasuredBody, Ports, Substructures, receptance_model
from jointbayes.joint import Joint, Joints
from jointbayes.structure import FrameRecipe, Structure
from vibrecords import FrfSet
from vibrecords.records import FrfRecord

Array = NDArray[np.float64]
CONFIGS = Path(__file__).resolve().parents[1] / "configs"

#: The spindle by itself and the whole with its tool, in the order of `spindle_files`.
SPINDLE_FILES = ("data/spindle_nose.uff", "data/spindle_tip.uff")
#: What the model of spindle_tool.toml leaves out: bearings that give way, N/m, and damp more.
BEARINGS = {"rear:y": 2.5e8, "front:y": 4e8}
LOSS_FACTOR = 0.05
#: Of each FRF of the spindle by itself, and of the whole.
NOISE = (0.01, 0.02)

#: Files of measured_bar.toml by the length that moves, m: outputs, and (k11, k12, k22); strings carry the free bar.
BAR_FILES = {
    0.5: ("data/bar_free.uff", (11,), (800.0, 0.0, 20.0)),
    0.3835: ("data/bar_held.uff", (11, 6), (3e8, 4e6, 1.6e5)),
}
AVERAGES, COHERENCE = 10, 0.99

#: The two-storey building of Beck and Au (2002), DOI 10.1061/(ASCE)0733-9399(2002)128:4(380): masses in kg, nominal
#: stiffness of a storey in N/m, measured natural frequencies in Hz, and mode of the prior of k over the nominal one,
#: whose standard deviation is 1.
TWO_STOREYS = {"masses": (16.5e3, 16.1e3), "nominal": 29.7e6, "frequencies": (3.13, 9.83), "modes": (1.3, 0.8)}
#: Mean and standard deviation of k1 over the nominal one that Straub and Papaioannou (2015, DOI
#: 10.1061/(ASCE)EM.1943-7889.0000839) give.
PUBLISHED = {"mean": 1.12, "sd": 0.66}


def eigenvalues() -> Array:
    """Measured eigenvalues ω², rad²/s²."""
    return (2 * np.pi * np.array(TWO_STOREYS["frequencies"])) ** 2


def log_normal(mode: float) -> tuple[float, float]:
    """Median, and standard deviation of the logarithm, of the log-normal of this mode with standard deviation 1."""
    s2 = brentq(lambda s2: (math.exp(s2) - 1) * (mode * math.exp(s2)) ** 2 * math.exp(s2) - 1, 1e-9, 5.0)
    return mode * math.exp(s2), math.sqrt(s2)


def solutions() -> Array:
    """Both pairs (k1, k2) with exactly these eigenvalues, N/m, in the order of k1.

    λ1 + λ2 = (k1 + k2)/m1 + k2/m2 and λ1 λ2 = k1 k2/(m1 m2): a quadratic equation for k2.
    """
    (m1, m2), (low, high) = TWO_STOREYS["masses"], eigenvalues()
    k2 = np.roots([1 + m1 / m2, -m1 * (low + high), m1 * m2 * low * high])
    pairs = np.stack([m1 * m2 * low * high / k2, k2], axis=1)
    return pairs[np.argsort(pairs[:, 0])]


def moments(posterior: jb.Posterior) -> dict[str, float]:
    """Mean and standard deviation of k1 over the nominal one, and the share of draws nearer to the first solution."""
    relative = posterior.stiffness[:, 0] / TWO_STOREYS["nominal"]
    edge = solutions()[:, 0].mean() / TWO_STOREYS["nominal"]
    figures = {"relative_mean": relative.mean(), "relative_sd": relative.std(), "lower_share": (relative < edge).mean()}
    return {name: float(f"{value:.4g}") for name, value in figures.items()}


def first_shape() -> float:
    """Displacement of the lower storey over the upper one's in the first mode, of the softer first storey."""
    (_, m2), (low, _) = TWO_STOREYS["masses"], eigenvalues()
    return float(1 - low * m2 / solutions()[0, 1])


def spindle() -> Structure:
    """The spindle of spindle_tool.toml on bearings that give way, with the labels of a measured body at its nose."""
    case = jb.load_case(CONFIGS / "spindle_tool.toml")
    recipe = case.problem.test.structure.recipe
    alone = FrameRecipe(dict(recipe.bodies)["spindle"], jb.LossFactor(LOSS_FACTOR), recipe.directions)
    free = alone.structure(mesh=alone.mesh(top_hz=case.spec.data.f_max_hz))
    stiffness = np.array(free.stiffness)
    for label, bearing in BEARINGS.items():
        (row,) = free.index((label,))
        stiffness[row, row] += bearing
    dofs = tuple(label if label.startswith("nose:") else f"inside-{label}" for label in free.dofs)
    return replace(free, stiffness=stiffness, dofs=dofs, positions={})


def spindle_files() -> tuple[FrfSet, FrfSet]:
    """Receptances of the spindle's nose, 1 % noise, and of the assembled tool's tip and holder's mouth, 2 %.

    Both of the joints of spindle_tool.toml, at its lines. A translation and a rotation are excited and measured at the
    nose; nodes and directions are those of the channels in spindle_measured.toml.
    """
    given = jb.load_case(CONFIGS / "spindle_tool.toml")
    lines, rng = given.spec.data.lines_hz(), np.random.default_rng(2026)
    nose = ("nose:y", "nose:rz")
    nowhere = Joint(("nose:y",), name="none")
    exact = receptance_model(spindle(), nowhere, Ports(lines, nose, nose)).receptance(np.zeros((1, 1)))[0]
    alone = FrfSet(lines, exact, nose, nose)
    body = MeasuredBody.of(alone, np.zeros(exact.shape), "spindle")
    ports = Ports(lines, ("tool.tip:y", "holder.mouth:y"), ("tool.tip:y",))
    taper, shrink = given.problem.test.joints.joints
    recipe = given.problem.test.structure.recipe
    bodies = {name: each for name, each in recipe.bodies if name != "spindle"}
    rest = replace(recipe, bodies=bodies, supports=(), accelerometer_dofs=ports.outputs)
    rest = rest.structure(mesh=rest.mesh(top_hz=given.spec.data.f_max_hz))
    joints = Joints((replace(taper, against=nose), shrink))
    whole = receptance_model(Substructures(rest, (body,)), joints, ports)
    truth = given.problem.parametrisation.matrix(true_stiffness(given.spec))
    both = (alone.values, ("1:y", "1:rz"), ("1:y", "1:rz")), (whole.receptance(truth)[0], ("3:y", "2:y"), ("3:y",))
    found = []
    for (values, outputs, inputs), noise in zip(both, NOISE, strict=True):
        white = rng.standard_normal((*values.shape, 2)) @ [1, 1j]  # as `relative` of a case: in either part
        found.append(FrfSet(lines, values * (1 + noise * white), outputs, inputs))
    return found[0], found[1]


def bar_records(length: float) -> list[FrfRecord]:
    """Accelerances of an exact bar over a force at its tip, with coherence and the noise that ten averages leave."""
    _, points, joint = BAR_FILES[length]
    positions = {1: 0.0, 6: length / 2, 11: length}
    bar = ExactBeam(length, circle(0.025, 0.3), 2.065e11, 0.3, 7830.0, positions, joint)
    lines, rng = np.arange(20.0, 2800.0, 4.0), np.random.default_rng(len(points) + int(1000 * length))
    records = []
    for point in points:
        exact = bar.receptance(lines, (f"{point}:y",), ("11:y",), loss_factor=0.02)[:, 0, 0]
        exact = -((2 * np.pi * lines) ** 2) * exact
        sd = np.abs(exact) * np.sqrt((1 - COHERENCE) / COHERENCE / (AVERAGES - 1) / 2)
        values = exact + sd * (rng.standard_normal(lines.size) + 1j * rng.standard_normal(lines.size))
        coherence, unit = np.full(lines.size, COHERENCE), "(m/s^2)/N"
        pair = f"Point:{point}:Z+", "Point:11:Z+"
        records.append(FrfRecord(*pair, lines, values, "accelerance", unit, coherence, AVERAGES))
    return records


if __name__ == "__main__":
    for bar_length, (bar_file, *_) in BAR_FILES.items():
        write_records(bar_records(bar_length), CONFIGS / bar_file, "uff58b")
    for file, frf in zip(SPINDLE_FILES, spindle_files(), strict=True):
        write_frf(frf, CONFIGS / file, "uff58b")
    print("eigenvalues", eigenvalues().round(2).tolist())
    for mode in TWO_STOREYS["modes"]:
        median, sd_log = log_normal(mode)
        print(f"prior: median {median * TWO_STOREYS['nominal']:.5g} N/m, sd_log {sd_log:.5f}")
    print("solutions", solutions().tolist(), "ratio", first_shape())
