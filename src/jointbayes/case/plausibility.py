"""What in a case file is possible and yet unlikely, as a slip of the unit or a wrong sign. Warnings, never errors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from jointbayes.case.case_text import CaseText, InputWarning
from jointbayes.case.spec.fields import Finding, entries_of, other_units
from jointbayes.case.spec.structure_tables import BeamSpec, FrameSpec, StructureBase
from jointbayes.case.spec.whole import CaseSpec

if TYPE_CHECKING:
    from jointbayes.identification.numbering import AboveRigid, Renumbered
    from jointbayes.inference import JointPrior
    from vibrecords.provenance import Provenance

#: Velocity of sound √(E/ρ) in metals, wood, concrete, plastics and ceramics, m/s.
WAVE_SPEED = 500.0, 20_000.0
#: Young's modulus of solids, GPa, and their density, kg/m³: from rubber to diamond, from foam to osmium.
YOUNGS_MODULUS, DENSITY = (1e-3, 1300.0), (20.0, 23_000.0)
#: Length of a beam over its largest thickness.
SLENDERNESS = 1.0, 10_000.0
#: First natural frequency over the highest measured one, at most; modes below the lowest measured frequency, at most.
ABOVE_BAND, BELOW_BAND = 10.0, 100

#: Fractions by the key that states them: the largest that is usual, and what it is a fraction of.
LARGEST_FRACTION = {
    "ratio": (0.2, "critical damping"),
    "damping_ratio": (0.2, "critical damping"),
    "damping_ratios": (0.2, "critical damping"),
    "loss_factor": (0.5, "the stiffness"),
    "relative": (0.5, "|H|"),
    "floor": (0.5, "the median |H|"),
    "sd_relative": (0.2, "the value"),
}
#: The smallest usual `sd_percent`, of a length and of anything else: below it a fraction may be meant.
SMALLEST_PERCENT = {"length": 0.005, "": 0.1}

# What a number may have been given in instead, and the factor that makes it right.
_MODULUS_SLIPS = *other_units("gpa"), ("a thousand times too small", 1e3)
_DENSITY_SLIPS = *other_units("kg_m3"), ("a thousand times too large", 1e-3)
_LENGTH_SLIPS = other_units("mm")
_USUAL_MODULUS, _USUAL_DENSITY = (0.5, 1300.0), (200.0, 23_000.0)  # that a slip is corrected to
_USUAL_LENGTH, _USUAL_THICKNESS, _USUAL_SLENDERNESS = (5.0, 1e5), (0.5, 3000.0), (2.0, 200.0)  # mm
_SHORT_MM, _LOW_HZ = 20.0, 100.0  # a length and a band below these may be in m and in kHz
_FAR_LEVEL = 3.0  # factor between FRFs and those of any joint beyond which a unit is wrong
_CANTILEVER = 1.8751040687  # first root of cos λ cosh λ = −1


def input_warnings(spec: CaseSpec, text: CaseText, band_hz: tuple[float, float] | None) -> tuple[InputWarning, ...]:
    """Look for values of a case that no usual machine has.

    Parameters
    ----------
    spec
        The case.
    text
        Its text, for the lines.
    band_hz
        Lowest and highest measured frequency, Hz; None where they are not known yet.
    """
    structure = spec.structure
    warnings = text.warnings("material", _materials(structure))
    if isinstance(structure, BeamSpec):
        warnings += text.warnings("shape", _shape(structure))
        if not warnings and band_hz is not None:  # with warnings the frequencies are off because of these
            warnings = text.warnings("band", _band(spec, structure, band_hz))
    top = getattr(spec.data, "f_max_hz", None)
    if spec.files is not None and top and band_hz is not None and top > 1.05 * band_hz[1]:
        expected, remedy = f"at most {band_hz[1]:g}, where the lines of the file end", "lower it, or measure further"
        warnings += text.warnings("end_of_file", [Finding(("data", "f_max_hz"), f"found {top:g}", expected, remedy)])
    return (*warnings, *text.warnings("per_cent", _fractions(text.data)))


def _fractions(data: Mapping[str, object]) -> Iterator[Finding]:
    """Yield fractions that may be given in per cent, and percentages that may be fractions, at any depth."""
    for path, number in entries_of(float | int, data):
        place = tuple(key for key in path if isinstance(key, str))
        *_, table, key = ("", *place)
        limit, whole = LARGEST_FRACTION.get(key, (math.inf, ""))
        if number > limit:
            expected = f"a fraction of {whole}, seldom above {limit:g}"
            yield Finding(place, f"found {number!r}", expected, f"if it is in per cent, write {number / 100:g}")
        least = SMALLEST_PERCENT.get(table, SMALLEST_PERCENT[""])
        if key == "sd_percent" and number < least:
            expected = f"per cent, seldom below {least:g}"
            yield Finding(place, f"found {number!r}", expected, f"if it is a fraction, write {100 * number:g}")


def _materials(structure: StructureBase) -> Iterator[Finding]:
    """Yield what is wrong with each material: of a frame, its own and those of bodies and members that state one."""
    if isinstance(structure, BeamSpec | FrameSpec):
        yield from _material(("structure",), structure.youngs_modulus_gpa, structure.density_kg_m3)
    if not isinstance(structure, FrameSpec):
        return
    for name, body in structure.all_bodies.items():
        loc = ("structure", "bodies", name) if structure.bodies else ("structure",)
        for i, member in enumerate((body, *body.members)):
            if member.youngs_modulus_gpa is None and member.density_kg_m3 is None:
                continue
            modulus = member.youngs_modulus_gpa or body.youngs_modulus_gpa or structure.youngs_modulus_gpa
            density = member.density_kg_m3 or body.density_kg_m3 or structure.density_kg_m3
            yield from _material((*loc, "members", i - 1) if i else loc, modulus, density)


def _material(loc: tuple[str | int, ...], modulus: float, density: float) -> Iterator[Finding]:
    """Yield modulus or density if no solid has them, or has their velocity of sound."""
    speed = _speed(modulus, density)
    if _within(modulus, YOUNGS_MODULUS) and _within(density, DENSITY) and _within(speed, WAVE_SPEED):
        return
    moduli = [(label, modulus * factor) for label, factor in _MODULUS_SLIPS]
    densities = [(label, density * factor) for label, factor in _DENSITY_SLIPS]
    in_modulus = [(label, e) for label, e in moduli if _usual(e, density)]
    in_density = [(label, rho) for label, rho in densities if _usual(modulus, rho)]
    in_both = [(e, rho) for e in moduli for rho in densities if _usual(e[1], rho[1])]
    if not in_modulus and not in_density and in_both:
        in_modulus, in_density = [in_both[0][0]], [in_both[0][1]]
    expected = (
        f"E from {YOUNGS_MODULUS[0]:g} to {YOUNGS_MODULUS[1]:g} GPa, ρ from {DENSITY[0]:g} to {DENSITY[1]:g} kg/m³ and "
        f"√(E/ρ) from {WAVE_SPEED[0]:g} to {WAVE_SPEED[1]:g} m/s, as in solids"
    )
    if not _within(modulus, YOUNGS_MODULUS) and _usual(density, modulus):
        in_modulus, in_density = [("exchanged with density_kg_m3", density)], []
    asked = [("youngs_modulus_gpa", modulus, in_modulus), ("density_kg_m3", density, in_density)]
    named = [row for row in asked if row[2]]
    alone = asked[1:] if _within(modulus, YOUNGS_MODULUS) and not _within(density, DENSITY) else asked[:1]
    for key, value, slips in named or alone:
        oddity = f"found {value!r}, with which √(E/ρ) = {speed:.3g} m/s (E = {modulus:g} GPa, ρ = {density:g} kg/m³)"
        yield Finding((*loc, key), oddity, expected, _remedy(key, slips) or "check both numbers and their units")


def _shape(structure: BeamSpec) -> Iterator[Finding]:
    """Yield a beam shorter than it is thick, and one thinner than any wire."""
    key, thickness = max(structure.section.sizes_mm.items(), key=lambda size: size[1])
    length, ratio = structure.length_mm, structure.length_mm / thickness
    low, high = SLENDERNESS
    if low <= ratio <= high:
        return
    longer = [(label, length * factor) for label, factor in _LENGTH_SLIPS]
    thicker = [(label, thickness * factor) for label, factor in _LENGTH_SLIPS]
    lengths = [(label, value) for label, value in longer if _likely(value, thickness)]
    if _likely(thickness, length):
        lengths = [(f"exchanged with {key}", thickness)]
    sizes = [(label, value) for label, value in thicker if _likely(length, value)]
    remedy = _remedy("length_mm", lengths) or _remedy(key, sizes) or "check the units of length and section"
    if ratio < low:
        oddity = f"found {length!r}: shorter than its section is thick, {thickness:g} mm"
        yield Finding(("structure", "length_mm"), oddity, "a beam longer than thick", remedy)
        return
    loc, value = (("structure", "length_mm"), length) if lengths else (("structure", "section", key), thickness)
    oddity = f"found {value!r}: the beam, {length:g} mm by {thickness:g} mm, is {ratio:.3g} times as long as thick"
    yield Finding(loc, oddity, f"at most {high:g} times", remedy)


def _band(spec: CaseSpec, structure: BeamSpec, band_hz: tuple[float, float]) -> Iterator[Finding]:
    """Yield a measured band far below or far above the natural frequencies of the beam."""
    lowest, highest = band_hz
    section = structure.section.section
    gyration = math.sqrt(section.inertia_z / section.area)  # of bending in the plane of the height
    flexural = _speed(structure.youngs_modulus_gpa, structure.density_kg_m3) * gyration  # √(EI/ρA), m²/s
    first = _CANTILEVER**2 / (2 * math.pi) * flexural / (structure.length_mm / 1e3) ** 2
    check = "check the units of the beam's length and section (mm) and of the frequencies (Hz)"
    if first > ABOVE_BAND * highest:
        loc, value = _end_of_band(spec, highest, "f_max_hz")
        remedies = []
        if structure.length_mm < _SHORT_MM:
            remedies.append(
                f"if length and section are in m, write them in mm: length_mm = {1e3 * structure.length_mm:.5g}"
            )
        if highest < _LOW_HZ:
            remedies.append(f"if the frequencies are in kHz, write them in Hz: {1e3 * highest:.5g}")
        first_found = f"the first natural frequency of the beam with a stiff joint is about {first:.3g} Hz"
        expected = f"it within {ABOVE_BAND:g} times the highest measured frequency"
        yield Finding(loc, f"found {value:g}, while {first_found}", expected, " or ".join(remedies) or check)
        return
    number = structure.length_mm / 1e3 / math.pi * math.sqrt(2 * math.pi * lowest / flexural) + 0.5
    if number > BELOW_BAND:
        loc, value = _end_of_band(spec, lowest, "f_min_hz")
        oddity = f"found {value:g}, below which the beam has about {number:.0f} bending modes"
        yield Finding(loc, oddity, f"at most {BELOW_BAND} below the lowest measured frequency", check)


def _end_of_band(spec: CaseSpec, value: float, key: str) -> tuple[tuple[str, ...], float]:
    """Key that states an end of the band, or all of it, and its value."""
    keys = (key, "f_step_hz", "frequencies_hz", "eigenvalues", "file")
    stated = next(each for each in keys if getattr(spec.data, each, None) is not None)
    return ("data", stated), getattr(spec.data, key) if stated == key else value


def _speed(modulus_gpa: float, density: float) -> float:
    return math.sqrt(modulus_gpa * 1e9 / density)


def _within(value: float, ends: tuple[float, float]) -> bool:
    return ends[0] <= value <= ends[1]


def _usual(modulus: float, density: float) -> bool:
    """Say whether some beam material has both this modulus and this density."""
    numbers = modulus, density, _speed(modulus, density)
    return all(map(_within, numbers, (_USUAL_MODULUS, _USUAL_DENSITY, WAVE_SPEED)))


def _likely(length: float, thickness: float) -> bool:
    """Say whether a usual beam has this length and thickness in mm."""
    numbers = length, thickness, length / thickness
    return all(map(_within, numbers, (_USUAL_LENGTH, _USUAL_THICKNESS, _USUAL_SLENDERNESS)))


def _remedy(key: str, slips: Sequence[tuple[str, float]]) -> str:
    """What to write where a number was given in another unit; empty where nothing fits."""
    return " or ".join(f"if it is {label}, write {key} = {value:.5g}" for label, value in slips[:2])


def sign_warnings(provenance: Provenance | None, text: CaseText) -> tuple[InputWarning, ...]:
    """Doubts of the sign, or of the sign of i, of FRFs of files, with which every number of a run would be wrong."""
    doubts = provenance.sign_doubts if provenance else ()
    findings = (Finding(("data", "file"), f"found that at {w.where} {w.sentence}", "", w.remedy) for w in doubts)
    return text.warnings("sign", findings)


def level_warnings(log_ratio: float, gain: bool, text: CaseText) -> tuple[InputWarning, ...]:
    """FRFs that are far larger or smaller, by a logarithm, than the structure has them with any joint of the prior."""
    if not abs(log_ratio) > math.log(_FAR_LEVEL):
        return ()
    fault = f"found FRFs {math.exp(log_ratio):.3g} times as large as the model has them with any joint"
    fault += ", which the uncertain gain would take up without a word" * gain
    remedy = "state the unit of the channels: mm for m and N for kN are a factor of 1000, g for m/s² is 9.81; "
    remedy += "or correct the quantity"
    return text.warnings("level", [Finding(("data", "file"), fault, "the level of this structure", remedy)])


def numbering_warnings(
    doubt: Renumbered | None, above: AboveRigid | None, text: CaseText, from_files: bool
) -> tuple[InputWarning, ...]:
    """One doubt of measured modes: of their numbers or unit, or of a frequency that no joint reaches."""
    loc, structure = ("data", "file") if from_files else ("data", "frequencies_hz"), ""
    if above is not None:
        structure = f"check E, density, length and section, with which a rigid joint has mode {above.number} at "
        structure += f"{above.rigid_hz:.4g} Hz"
    if doubt is None:
        if above is None:
            return ()
        oddity = f"found mode {above.number} at {above.measured_hz:.4g} Hz, more than 5 % above any joint's"
        return text.warnings("numbering", [Finding(loc, oddity, f"at most {above.rigid_hz:.4g} Hz", structure)])
    oddity = f"found natural frequencies that {doubt.words}"
    if doubt.rad_per_s:
        remedy = "divide them by 2π if they are not"
        return text.warnings("numbering", [Finding(loc, oddity, "natural frequencies in Hz", remedy)])
    expected = "modes counted from the lowest one, those included in which the structure moves rigidly on a soft joint"
    remedy = f'if they are these, write kind = "modes" with numbers = [{", ".join(map(str, doubt.other))}]'
    if not doubt.better:
        remedy += "; look below and between them for modes that were missed, or add a second sensor"
    remedy += f"; otherwise {structure}" if structure else ""
    return text.warnings("numbering", [Finding(loc, oddity, expected, remedy)])


def excluded_truths(spec: CaseSpec, prior: JointPrior, test: str) -> Iterator[Finding]:
    """Yield stiffnesses of the truth that have no coordinates, or coordinates that the prior excludes.

    No analysis can find such a joint. A test's prior holds its own joints alone.
    """
    if spec.synthetic is None:
        return
    joint, loc, stated = prior.parametrisation, ("data", "truth"), spec.synthetic.truth
    truth = stated.values(_name_in_tables(test, name) for name in joint.stiffness_names)
    if not joint.describes(truth):
        each = ", ".join(f"{name} = {value:g}" for name, value in zip(joint.stiffness_names, truth, strict=True))
        kinds = " and ".join(dict.fromkeys(joint_spec.parametrisation for joint_spec in spec.all_joints.values()))
        oddity = f'found {each}, which joint.parametrisation = "{kinds}" cannot describe'
        yield Finding(loc, oddity, "a truth that the analysis can find", "choose another parametrisation or truth")
        return
    for axis, marginal, value in zip(joint.axes, prior.marginals, joint.coordinates(truth), strict=True):
        low, high = marginal.support
        if not low <= value <= high:
            shown, least, most = (math.exp(x) if axis.logarithmic else x for x in (value, low, high))
            oddity = f"found a truth with {axis.name} = {shown:.4g}, which the prior excludes"
            expected = f"{axis.name} from {least:.4g} to {most:.4g}, so that the analysis can find it"
            of_truth = _name_in_tables(test, axis.quantity)
            place = (of_truth,) if stated.stiffness is None else ("stiffness", *of_truth.split("."))
            owner, _, name = _name_in_tables(test, axis.name).rpartition(".")
            table = f"joints.{owner}.prior.{name}" if owner else f"prior.{name}"
            yield Finding((*loc, *place), oddity, expected, f"widen [{table}] or correct the truth")


def _name_in_tables(test: str, name: str) -> str:
    """Name of a quantity of a test as its own tables have it."""
    return name.removeprefix(f"{test}.") if test else name
