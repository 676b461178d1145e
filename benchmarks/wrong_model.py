"""What a wrong model does to the answer by modes: `python -m benchmarks.wrong_model`.

Three natural frequencies and two antiresonances of the tip, to 0.01 %, of a beam that is not the one analysed: its
length or modulus off either way; a spring to ground or 20 g at mid-span that the model lacks; a clamp whose edge is 2 %
of the length further in; a joint that is softer the more it moves; a spring so strong that it raises the first natural
frequency by 7 to 15 %. The true joint is drawn from the middle of the prior. Of one beam the ratio of the motions at
mid-span and tip is measured in each mode too, to 1 %; the sensor stays as far from the root as it is said to be where
the length is off, and as far from the tip where the edge is. Each set is analysed as the modes of measured FRFs are:
modulus, density and length as in a workshop, with the usual error of the model. Counted, for each stiffness: how often
the printed 95 % interval holds it, also where no verdict is given; how often one of both is missed next to a green
light, and how often one of these was called identified; how often one lies outside the 99.9 % interval of the draws.

The table of each beam goes to docs/what-can-be-wrong.md.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

import jointbayes as jb
from benchmarks.page import table
from benchmarks.study import Row, Study, holds, outcome
from jointbayes.case.case_objects import recipe_of
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.frf import AssembledShapes, NaturalFrequencies
from jointbayes.inference import ErrorSizes, ModelErrorNoise
from jointbayes.joint import AnyJoint
from jointbayes.posterior.model_errors import model_error_of
from jointbayes.structure import Structure
from vibrecords import Antiresonances, ModeData, ModeShapes, Observed

Array = NDArray[np.float64]
#: Kinds by name, and the part of each by which a length or a modulus is off.
WRONGS = {
    "nothing": 0.0,
    "length 1 % off": 0.01,
    "Young's modulus 5 % off": 0.05,
    "clamp edge 2 % of the length off": 0.02,
    "20 g at mid-span missed": 0.0,
    "a spring to ground missed": 0.0,
    "joint softer by 20 % in the first mode": 0.2,
    "Young's modulus 20 % off": 0.20,
    "length 5 % off": 0.05,
    "a strong spring to ground missed": 0.0,
}
#: Length, mm, and section.
BEAMS = {
    "stocky": (300.0, '{ shape = "rectangle", width_mm = 30.0, height_mm = 16.0 }'),
    "slender": (383.0, '{ shape = "rectangle", width_mm = 25.0, height_mm = 8.0 }'),
    "stocky, two sensors": (300.0, '{ shape = "rectangle", width_mm = 30.0, height_mm = 16.0 }'),
    "stocky, two overhangs": (300.0, '{ shape = "rectangle", width_mm = 30.0, height_mm = 16.0 }'),
}
_SHORT_MM = 200.0  # the other overhang of one clamp, tested as a test of its own
_CASE = """
title = "A beam"
structure = {{ length_mm = {length}, section = {section}, youngs_modulus_gpa = 210.0, density_kg_m3 = 7850.0, \
damping = {{ law = "modal", ratio = 0.01 }} }}
joint = {{ kind = "springs", dofs = ["1:y", "1:rz"] }}
prior.ky = {{ distribution = "log_uniform", low = 1e7, high = 1e9 }}
prior.krz = {{ distribution = "log_uniform", low = 1e4, high = 5e5 }}
uncertain.youngs_modulus.sd_percent = 3.0
uncertain.density.sd_percent = 1.0
uncertain.length.sd_percent = 0.5
uncertain.model_error = {{}}
data = {{ kind = "natural_frequencies", frequencies_hz = [100.0, 500.0, 1500.0], sd_relative = 0.0001 }}
"""
_TESTS = f"tests = {{{{ long = {{{{}}}}, short = {{{{ structure.length_mm = {_SHORT_MM} }}}} }}}}\n"
_MODES, _ZEROS, _SD, _TIP, _MIDDLE = 3, 2, 1e-4, "11:y", "6:y"
_RATIO_SD = 0.01  # of a ratio, or of 0.3 where that is more


def analysed(beam: str, index: int) -> Row:
    """What an analysis says of a beam; indices go through all kinds of wrongness, then again."""
    kinds = list(WRONGS)
    return analyse(kinds[(index - 1) % len(kinds)], beam, 1 + (index - 1) // len(kinds))


def analyse(wrong: str, beam: str, index: int) -> Row:
    """Make data set number so many of a wrong structure, and analyse it."""
    length, section = BEAMS[beam]
    text = (_TESTS if "overhangs" in beam else "") + _CASE
    case = jb.case_from_text("wrong model", text.format(length=length, section=section))
    seed = [list(WRONGS).index(wrong), list(BEAMS).index(beam), index]
    rng, tests = np.random.default_rng(seed), []
    truth = np.exp(rng.uniform(np.log([2e7, 2e4]), np.log([5e8, 2.5e5])))
    for stated, test in zip(case.tests, case.problem.tests, strict=True):
        # what is wrong of the bar or the clamp is so in each test
        own = rng if len(case.tests) == 1 else np.random.default_rng(seed)
        structure = _structure(stated.spec, wrong, own, lambda s, joint=test.joints: _first_hz(s, joint, truth))
        data = _measured(structure, test.joints, wrong, beam, truth, rng)
        tests.append(replace(test, data=data, noise=ModelErrorNoise.of(data, ErrorSizes())))
    problem = replace(case.problem, tests=tuple(tests))
    posterior = jb.sample(problem, seed=index, premises="usual")
    assert model_error_of(posterior) is not None
    said = outcome(posterior, dict(zip(posterior.stiffness_names, truth.tolist(), strict=True)))
    for name, one in said["known"].items():
        low, high = posterior.interval(name, 0.999)
        one["outside"] = not low <= one["truth"] <= high
    return {**said, "wrong": wrong, "grade": model_error_of(posterior).grade}


def _measured(
    structure: Structure, joint: AnyJoint, wrong: str, beam: str, truth: Array, rng: np.random.Generator
) -> ModeData:
    """Frequencies, antiresonances and, of two sensors, ratios of motions of the true structure, with their noise."""
    soft = WRONGS[wrong] if wrong.startswith("joint") else 0.0

    def values(stiffness: Array) -> Array:
        matrix = np.diag(stiffness)
        free = NaturalFrequencies(structure, joint, _MODES).frequency_hz(matrix)[0]
        zeros = [(_TIP, number) for number in range(1, _ZEROS + 1)]
        held = AssembledShapes(structure, joint, 1, (), zeros).modes(matrix).zeros_hz[0]
        return np.concatenate([free, held])

    hz, joints = values(truth), [truth] * (_MODES + _ZEROS)
    if soft:  # a mode of frequency f moves the joint as 1/f² of the first, under the same force
        joints = [truth * (1 - soft * (hz[0] / each) ** 2) for each in hz]
        hz = np.array([values(stiffness)[i] for i, stiffness in enumerate(joints)])
    hz = hz * (1 + _SD * rng.standard_normal(hz.size))
    zeros = Antiresonances((_TIP,) * _ZEROS, Observed(hz[_MODES:], _SD * hz[_MODES:]), tuple(range(1, _ZEROS + 1)))
    shapes = None
    if "sensors" in beam:
        length, from_tip = BEAMS[beam][0] / 1000, wrong.startswith("clamp")
        ratio = np.array([_ratio(structure, joint, k, i, length, from_tip) for i, k in enumerate(joints[:_MODES])])
        sd = _RATIO_SD * np.maximum(np.abs(ratio), 0.3)
        ratio = ratio + sd * rng.standard_normal(_MODES)
        shapes = ModeShapes((_MIDDLE,), _TIP, Observed(ratio[:, None], sd[:, None]))
    return ModeData(Observed(hz[:_MODES], _SD * hz[:_MODES]), zeros=zeros, shapes=shapes)


def _ratio(structure: Structure, joint: AnyJoint, truth: Array, mode: int, length: float, from_tip: bool) -> float:
    """Motion of a sensor half of the stated length from the root, or from the tip, over that of the tip."""
    place_of = {label: structure.position(label) for label in structure.labels if label.endswith(":y")}
    known = {label: place[0] for label, place in place_of.items() if place is not None}  # not inside elements
    motion = AssembledShapes(structure, joint, mode + 1, tuple(known)).modes(np.diag(truth)).shapes[0, mode]
    places = np.array(list(known.values()))
    at = places[-1] - length / 2 if from_tip else length / 2
    return float(CubicSpline(places, motion)(at) / motion[-1])


def _first_hz(structure: Structure, joint: AnyJoint, truth: Array) -> float:
    return float(NaturalFrequencies(structure, joint, 1).frequency_hz(np.diag(truth))[0, 0])


def _structure(
    spec: CaseSpec, wrong: str, rng: np.random.Generator, first_hz: Callable[[Structure], float]
) -> Structure:
    """The structure that makes the data; a clamp's edge is as many mm off at every overhang."""
    recipe, sign = recipe_of(spec.structure, spec.data), float(rng.choice([-1.0, 1.0]))
    size = WRONGS[wrong] * sign
    if wrong.startswith("length"):
        return replace(recipe, length=recipe.length * (1 + size)).structure()
    if wrong.startswith("clamp"):
        longest = 0.3 if recipe.length == _SHORT_MM / 1000 else recipe.length
        return replace(recipe, length=recipe.length + abs(size) * longest).structure()
    if wrong.startswith("Young"):
        return recipe.structure({"youngs_modulus": 1 + size})
    plain = recipe.structure()
    middle = np.zeros_like(plain.mass)
    middle[(plain.index((_MIDDLE,))[0],) * 2] = 1.0
    own = recipe.own_stiffness("1:y", "1:y")

    def sprung(log_share: float) -> Structure:
        return replace(plain, stiffness=plain.stiffness + own * math.exp(log_share) * middle)

    if wrong.startswith("a spring"):
        return sprung(rng.uniform(math.log(0.2), math.log(2.0)))
    if wrong.startswith("a strong spring"):
        raised_hz = (1 + rng.uniform(0.07, 0.15)) * first_hz(plain)
        return sprung(brentq(lambda share: first_hz(sprung(share)) - raised_hz, math.log(0.01), math.log(1e3)))
    return replace(plain, mass=plain.mass + 0.020 * middle) if wrong.startswith("20 g") else plain


def summary(rows: Sequence[Row]) -> Row:
    """Counts by kind of wrongness."""
    found = {}
    for wrong in WRONGS:
        some = [row for row in rows if row["wrong"] == wrong]
        if not some:
            continue
        missed = [row for row in some if not all(holds(one, "ends") for one in row["known"].values())]
        green = [row for row in missed if not _warned(row)]
        outside = [row for row in some if any(one["outside"] for one in row["known"].values())]
        widths = [[math.log(high / low) for low, high in _intervals(row)] for row in some]
        found[wrong] = {
            "beams": len(some),
            "held": [sum(holds(row["known"][name], "ends") for row in some) for name in ("ky", "krz")],
            "missed": len(missed),
            "missed_green": len(green),
            "missed_green_identified": sum(map(_misses_identified, green)),
            "outside": [len(outside), sum(map(_warned, outside))],
            "warned": sum(map(_warned, some)),
            "widths": np.exp(np.median(widths, axis=0)).tolist(),
        }
    return {"wrong": found}


def _intervals(row: Row) -> list[tuple[float, float]]:
    return [tuple(row["known"][name]["interval95"]) for name in ("ky", "krz")]


def _misses_identified(row: Row) -> bool:
    return any(one["verdict"] == "identified" and not holds(one, "ends") for one in row["known"].values())


def _warned(row: Row) -> bool:
    return row["grade"] in ("large", "impossible")


def tables(results: Mapping[str, Row]) -> list[str]:
    """Table of a beam, one row for each kind of wrongness."""
    outside = ("Outside 99.9 % (warned)", "Warned", "Upper/lower of ky, krz")
    head = ("Wrong", "ky, krz held", "Any missed (green, of these identified)", *outside)
    rows = []
    for data in results.values():
        for wrong, one in data["wrong"].items():
            of_these = f" ({one['missed_green']}, {one['missed_green_identified']})" if one["missed"] else ""
            far = f"{one['outside'][0]} ({one['outside'][1]})" if one["outside"][0] else "0"
            held, widths = ", ".join(map(str, one["held"])), ", ".join(f"{width:.2f}" for width in one["widths"])
            counts = (f"{held} of {one['beams']}", f"{one['missed']}{of_these}", far, str(one["warned"]))
            rows.append((wrong, *counts, widths))
    return table(head, rows)


STUDY = Study(
    "wrong_model",
    "what-can-be-wrong.md",
    dict.fromkeys(("stocky", "stocky, two sensors"), 20 * len(WRONGS)),
    analysed,
    summary,
    tables,
    page_per_kind=True,
)

if __name__ == "__main__":
    STUDY.main()
