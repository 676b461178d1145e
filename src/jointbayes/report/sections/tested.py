"""What was tested and how: the structure drawn to scale, and a sentence on the data of each test."""

import numpy as np

from jointbayes.inference import Problem, Test
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import foreign, listed_names
from jointbayes.report.model import Block, Figure, Paragraph
from jointbayes.report.structure_sketch import dof_words, sketch
from jointbayes.rounding import number
from jointbayes.structure.frame_recipe import BeamRecipe, FrameRecipe
from vibrecords import FrfData

_MOST_TESTS = 4  # of which each has its sentence
_MOST_DOFS = 3  # that are named on one side


def blocks_on_tests(inputs: ReportInputs) -> tuple[Block, ...]:
    """The sketch, where anybody knows what the structure looks like, and what was measured."""
    problem = inputs.posterior.problem
    parts = problem.parts
    structures = [_structure(part) for part in parts]
    differ = len(set(structures)) > 1
    told = zip(parts[:_MOST_TESTS], structures, strict=False)
    text = " ".join(_sentence(part, structure if differ else "") for part, structure in told)
    if len(parts) > _MOST_TESTS:
        text += f" In all {len(parts)} tests, see below."
    every = getattr(parts[0].test.joints, "joints", ())
    names = ", ".join(joint.name for joint in every)
    joint = f"{len(every)} joints: {foreign(names)}."
    if len(every) < 2:
        joint = f"Joint: {foreign(str(parts[0].test.joints))}."
    tested = Paragraph(f"**Tested.** {text if differ else f'{structures[0]}: {text}'} {joint}")
    drawings = {sketch(part): part for part in reversed(parts[:_MOST_TESTS])}  # each picture once
    drawn = tuple(drawings.values())[::-1]
    drawing = sketch(*drawn) if len(drawn) > 1 else next(iter(drawings))
    if not drawing:
        return (tested,)
    tests = f"test {listed_names([foreign(part.test.name) for part in drawn])}"
    which = f"{tests if len(parts) > 1 else 'the structure'} with joints, ground, forces and responses."
    return tested, Figure("structure", f"What was tested: {which}", f"Drawing of {which}", drawing)


def _structure(part: Problem) -> str:
    """The structure in words."""
    recipe = getattr(part.test.structures, "recipe", None)
    if isinstance(recipe, BeamRecipe):
        size = " × ".join(f"{1e3 * dimension:g}" for dimension in recipe.section.dimensions if dimension)
        shape = "circle" if recipe.section.shape == "tube" and "×" not in size else recipe.section.shape
        return f"Beam, {1e3 * recipe.length:g} mm long, section {shape} {size} mm"
    if isinstance(recipe, FrameRecipe):
        names = [foreign(name) for name, _ in recipe.bodies if name]
        return f"Frame of {', '.join(names)}" if names else "Frame"
    return "Structure"


def _sentence(part: Problem, structure: str) -> str:
    """One test: its structure, data, lines and band, averages, noise and level."""
    test = part.test
    name = f"{foreign(test.name)} ({structure}): " if structure else f"{foreign(test.name)}: " if test.name else ""
    level = (
        "" if test.level is None else f", {foreign(test.level.name)} {test.level.value:g} {foreign(test.level.unit)}"
    )
    frfs, modes = test.data.shown_frfs, test.data.modes
    if frfs is not None:
        seen = "" if modes is None else f"; analysed by the {modes.frequency_hz.size} modes that they show"
        return f"{name}{_frfs(test, frfs)}{level}{seen}."
    if modes is not None:
        spread = 100 * float(np.median(modes.sd_hz / modes.frequency_hz))
        low, high = modes.band_hz
        band = f"{low:.5g} to {high:.5g} Hz" if high > low else f"{low:.5g} Hz"
        what = foreign(test.data.in_short())
        return f"{name}{what}, {band}, each known to {number(spread, 2)} % (standard deviation){level}."
    return f"{name}{foreign(test.data.in_short())}{level}."


def _frfs(test: Test, data: FrfData) -> str:
    frf, provenance = data.frf, data.provenance
    count = len(frf.outputs) * len(frf.inputs)
    averages = f", {provenance.averages} averages" if provenance is not None and provenance.averages else ""
    size = np.abs(frf.values)
    noise = 100 * float(np.median(np.sqrt(data.variance[size > 0]) / size[size > 0]))
    return (
        f"{count} {'computed ' if data.synthetic else ''}{frf.quantity} FRF{'s' if count > 1 else ''} "
        f"({_where(test, frf.outputs, frf.inputs)}), {frf.n_lines} lines from "
        f"{frf.frequency_hz[0]:g} to {frf.frequency_hz[-1]:g} Hz{averages}, noise {number(noise, 2)} % of |H| (median)"
    )


def _where(test: Test, outputs: tuple[str, ...], inputs: tuple[str, ...]) -> str:
    """Where responses and forces are, by the names that people use."""
    sides = {"force and response": inputs} if outputs == inputs else {"response": outputs, "force": inputs}
    return ", ".join(f"{side} at {_listed(test, dofs)}" for side, dofs in sides.items())


def _listed(test: Test, dofs: tuple[str, ...]) -> str:
    more = f" and {len(dofs) - _MOST_DOFS} more" if len(dofs) > _MOST_DOFS else ""
    names = (words if (words := dof_words(test, dof)) == dof else f"{words} ({dof})" for dof in dofs[:_MOST_DOFS])
    return foreign("; ".join(names)) + more
