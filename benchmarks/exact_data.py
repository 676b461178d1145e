"""Data sets of an exact beam with a random joint, and the case that a user would analyse them with.

The data come from `benchmarks.exact_beam`, which has no mesh and shares no code with the package. The case is
configs/clamped_beam.toml, copied, with another beam, other lines and other bounds where the structure asks for them,
measured at the tip and at mid-span. Nothing is measured at the joint, as in a real test, so that the paper's iteration
is none of the starts.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from benchmarks.exact_beam import CrossSection, ExactBeam, circle, rectangle, tube
from jointbayes.inference import Uniform
from vibrecords import FrfData, FrfSet

ROOT = Path(__file__).resolve().parents[1]
BASE = ROOT / "configs" / "clamped_beam.toml"
ENTROPY = 19660602
NAMES = ("k11", "k12", "k22")
Array = NDArray[np.float64]
Edits = tuple[tuple[str, str], ...]
ALUMINIUM: Edits = (("youngs_modulus_gpa", "70.0"), ("poissons_ratio", "0.33"), ("density_kg_m3", "2700.0"))


@dataclass(frozen=True)
class Subject:
    """A structure of the study.

    Parameters
    ----------
    title
        What it is.
    section
        Cross-section of the exact beam.
    section_text
        The same in the case file.
    edits
        Values of keys of the case file that differ from those of the main case.
    exponents
        Powers of ten between which k11, k12 and k22 lie.
    """

    title: str
    section: CrossSection
    section_text: str
    edits: Edits
    exponents: tuple[tuple[int, int], ...]


def _length(length_mm: float) -> Edits:
    return (("length_mm", str(length_mm)),)


def _lines(low: float, high: float, step: float) -> Edits:
    return ("f_min_hz", str(low)), ("f_max_hz", str(high)), ("f_step_hz", str(step))


#: The main case's bounds on k11, k12 and k22 are 14 to 1.4e6 times EI/L³, 0.4 to 4e5 times EI/L² and 0.1 to 1e4 times
#: EI/L. The others have the same multiples of their own EI/Lⁿ, to the nearest power of ten: from a beam that hardly
#: feels its joint, a decade or two below its own stiffness, to one whose joint can as well be rigid in the whole band,
#: because the stiffness of a mode with a wavelength of L/2 is some hundred times EI/L³.
SUBJECTS = {
    "main": Subject(
        "steel rod, 383 mm × 25 mm, the main case",
        circle(0.025, 0.3),
        'shape = "circle"\ndiameter_mm = 25.0',
        (),
        ((6, 11), (4, 10), (3, 8)),
    ),
    "small rod": Subject(
        "steel rod, 50 mm × 5 mm, 100 to 20 000 Hz in lines of 20 Hz",
        circle(0.005, 0.3),
        'shape = "circle"\ndiameter_mm = 5.0',
        _length(50.0) + _lines(100.0, 20000.0, 20.0),
        ((6, 11), (3, 9), (1, 6)),
    ),
    "tube": Subject(
        "aluminium tube, 1 m, 50 mm outside, 40 mm inside, 10 to 1500 Hz in lines of 0.5 Hz",
        tube(0.05, 0.04, 0.33),
        'shape = "tube"\nouter_diameter_mm = 50.0\ninner_diameter_mm = 40.0',
        _length(1000.0) + ALUMINIUM + _lines(10.0, 1500.0, 0.5),
        ((5, 10), (4, 10), (3, 8)),
    ),
    "bar": Subject(
        "steel bar, 400 mm × 20 mm × 40 mm, moving along its 40 mm, 50 to 4000 Hz in lines of 2 Hz",
        rectangle(0.02, 0.04, 0.3),
        'shape = "rectangle"\nwidth_mm = 20.0\nheight_mm = 40.0',
        _length(400.0) + _lines(50.0, 4000.0, 2.0),
        ((7, 12), (5, 11), (4, 9)),
    ),
}

#: Bounds beyond which a truth may lie, and by how much.
BOUNDS = tuple((name, end, factor) for factor in (10.0, 100.0) for name in NAMES for end in ("low", "high"))


@dataclass(frozen=True)
class DataSet:
    """The true (k11, k12, k22), shape (3,), and the case with data from it."""

    truth: Array
    case: jb.Case


@cache
def base_case(name: str, edits: Edits = ()) -> jb.Case:
    """The copied case of a structure, with data of its own still; `edits` replace further values of keys.

    Raises
    ------
    ValueError
        If a key or table is not in the main case's text exactly once.
    """
    subject = SUBJECTS[name]
    text = BASE.read_text(encoding="utf-8").split("[reference]")[0]
    low, high = np.array(subject.exponents, dtype=float).T
    middle = 10 ** ((low + high) / 2)
    truth = middle[0], min(middle[1], 0.3 * np.sqrt(middle[0] * middle[2])), middle[2]
    tables = {"structure.section": subject.section_text}
    for one, (least, most) in zip(NAMES, subject.exponents, strict=True):
        tables[f"prior.{one}"] = f'distribution = "log_uniform"\nlow = 1.0e{least}\nhigh = 1.0e{most}'
    tables["data.truth"] = "\n".join(f"{one} = {k:.3e}" for one, k in zip(NAMES, truth, strict=True))
    for table, body in tables.items():
        pattern = rf"(?m)^\[{re.escape(table)}\].*\n(?:(?!\[).*\n)*"
        text = _replaced(pattern, f"[{table}]\n{body}\n\n", text, f"[{table}]")
    for key, value in (("outputs", '["11:y", "6:y"]'), *subject.edits, *edits):
        text = _replaced(rf"(?m)^{key} = (\[[^\]]*\]|\S+)", f"{key} = {value}", text, key)
    return jb.case_from_text(f"exact {name}", text)


def _replaced(pattern: str, by: str, text: str, what: str) -> str:
    replaced, count = re.subn(pattern, lambda _: by, text)
    if count != 1:
        raise ValueError(f"{BASE.name}: found {what} {count} times; expected it once")
    return replaced


def exact_beam(case: jb.Case, section: CrossSection, stiffness: Sequence[float]) -> ExactBeam:
    """The exact beam of a case's structure and points, with a joint (k11, k12, k22) at its first point."""
    spec = case.spec.structure
    length = 1e-3 * spec.length_mm
    count = spec.elements + 1
    points = {n: (n - 1) / (count - 1) * length for n in range(1, count + 1)}
    used = {1, *(int(dof.split(":")[0]) for dof in (*case.spec.data.outputs, *case.spec.data.inputs))}
    k11, k12, k22 = (float(k) for k in stiffness)
    return ExactBeam(
        length,
        section,
        1e9 * spec.youngs_modulus_gpa,
        spec.poissons_ratio,
        spec.density_kg_m3,
        {n: points[n] for n in used},
        (k11, k12, k22),
    )


def draw(name: str, index: int, edits: Edits = ()) -> DataSet:
    """Data set number so many of a structure: a joint from the prior, exact FRFs, and noise as the case states it."""
    rng = np.random.default_rng([ENTROPY, list(SUBJECTS).index(name), index])
    case = base_case(name, edits)
    truth = _joint(rng, np.array(SUBJECTS[name].exponents, dtype=float))
    return DataSet(truth, _with_data(case, SUBJECTS[name].section, truth, rng))


def beyond(index: int, edits: Edits = ()) -> tuple[tuple[str, str, float], DataSet]:
    """Data set number so many of the main case in which one stiffness lies beyond a bound, and that bound.

    k11, k22 and a low k12 lie so many times beyond the main case's bound, the others inside theirs. A high k12 is no
    joint unless k11 and k22 are high as well; there the bound is lowered so many times below the truth instead.
    """
    rng = np.random.default_rng([ENTROPY, len(SUBJECTS), index])
    name, end, factor = bound = BOUNDS[index % len(BOUNDS)]
    row = NAMES.index(name)
    case, exponents = base_case("main", edits), np.array(SUBJECTS["main"].exponents, dtype=float)
    inside = exponents.copy()
    if (name, end) == ("k12", "high"):
        inside[row, 0] += np.log10(factor) + 1  # a decade of the prior is left below the bound
        truth = _joint(rng, inside)
        exponents[row, 1] = np.log10(truth[row] / factor)
        prior = case.problem.prior
        marginals = tuple(Uniform(*np.log(10.0) * np.array(ends)) for ends in exponents)
        case = replace(case, problem=replace(case.problem, prior=replace(prior, marginals=marginals)))
    else:
        place = exponents[row, 0] - np.log10(factor) if end == "low" else exponents[row, 1] + np.log10(factor)
        inside[row] = place, place
        truth = _joint(rng, inside)
    return bound, DataSet(truth, _with_data(case, SUBJECTS["main"].section, truth, rng))


def _joint(rng: np.random.Generator, exponents: Array) -> Array:
    """A positive definite joint, its stiffnesses log-uniform between powers of ten."""
    while True:
        k: Array = 10 ** rng.uniform(exponents[:, 0], exponents[:, 1])
        if k[1] ** 2 < k[0] * k[2]:
            return k


def _with_data(case: jb.Case, section: CrossSection, truth: Array, rng: np.random.Generator) -> jb.Case:
    """The case with the exact FRFs of a joint, and noise on them by the law that the case states."""
    data, ratio = case.spec.data, case.spec.structure.damping.ratio
    lines = np.array(data.lines_hz())
    beam = exact_beam(case, section, truth.tolist())
    exact = beam.modal_receptance(lines, data.outputs, data.inputs, ratio)
    size = np.abs(exact)
    sd_of_part = data.noise.relative * size + data.noise.floor * np.median(size, axis=0)
    noise = sd_of_part * (rng.normal(size=exact.shape) + 1j * rng.normal(size=exact.shape))
    frf = FrfSet(lines, exact + noise, data.outputs, data.inputs, "receptance")
    measured = FrfData(frf, 2 * sd_of_part**2, synthetic=True)
    return replace(case, problem=case.problem.with_test(data=measured))
