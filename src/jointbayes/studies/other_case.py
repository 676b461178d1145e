"""A case file as the description of a structure that was never tested: what `jointbayes predict` is asked."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from jointbayes.case.case_objects import CaseHome, quantities_of, reduce_imported
from jointbayes.case.case_text import CaseText, read_case_text
from jointbayes.case.parse import parse_case
from jointbayes.case.spec.frame_and_imported import ImportedSpec
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.errors import CaseError, JointBayesError
from jointbayes.frf import Ports
from jointbayes.inference import Nuisance
from jointbayes.joint import AnyJoint, joints_of
from jointbayes.structure import StructureRecipe
from vibrecords import Quantity

#: Tables of a case on data that there are none of.
_OF_DATA = frozenset(
    {"data", "noise", "left_out", "plan", "compare", "reference", "virtual_test", "identification", "sampling"}
    | {"tests", "level", "assembly", "bodies"}
)


@dataclass(frozen=True, eq=False)
class OtherCase:
    """A structure that was never tested, and what is wanted of it.

    Parameters
    ----------
    name, title
        Of the case file.
    recipe, joint
        The structure, and where the joint holds it.
    uncertain, own
        What is uncertain of it, and which of that is its own whatever the tested structure's is.
    ports, quantity
        Lines, DOFs and quantity.
    text
        The case as one text.
    """

    name: str
    title: str
    recipe: StructureRecipe
    joint: AnyJoint
    uncertain: tuple[Nuisance, ...]
    own: frozenset[str]
    ports: Ports
    quantity: Quantity
    text: str


def read_other(path: str | os.PathLike[str], allow_outside: bool = False) -> OtherCase:
    """Read a case file that describes another structure: its structure, joint, ``[uncertain]`` and ``[predict]``.

    It may build on the case of the run by ``extends``; data and what is to be done with them do not matter.

    Raises
    ------
    CaseError
        If the file cannot be read, or something in it is wrong: file, line and key.
    """
    source = read_case_text(path, allow_outside)
    table = source.data.get("predict")
    if not isinstance(table, Mapping):
        words = "missing", "a table with outputs, inputs, f_min_hz, f_max_hz and f_step_hz", "add [predict]"
        raise CaseError(source.fault(("predict",), *words))
    spec = parse_case(_without_data(source, table))
    asked = spec.predict
    assert asked is not None
    try:
        if spec.structure.damping.measured:
            words = "found no data to take damping ratios from", "a ratio", "state structure.damping.ratio"
            raise CaseError(source.fault(("structure", "damping", "ratio"), *words))
        joint = joints_of(spec.joint_objects)
        if isinstance(spec.structure, ImportedSpec):
            dofs = (*joint.labels, *asked.outputs, *asked.inputs)
            spec = reduce_imported(spec, CaseHome(Path(path).parent, source, allow_outside), dofs, asked.f_max_hz)
        sensors = asked.outputs if spec.structure.accelerometer_mass_g > 0 else ()
        recipe = spec.structure.recipe(sensors)
        joint.require_one_place(lambda label: recipe.positions.get(label.rpartition(":")[0]))
        lines = np.array(asked.lines_hz())
        ports = Ports(lines, asked.outputs, asked.inputs)
    except CaseError:
        raise
    except JointBayesError as error:
        raise CaseError(source.fault(("structure", *getattr(error, "key", ())), str(error))) from error
    return OtherCase(Path(path).stem, spec.title or Path(path).stem, recipe, joint, *_uncertain(spec), ports,
                     asked.quantity, source.text)  # fmt: skip


def _uncertain(spec: CaseSpec) -> tuple[tuple[Nuisance, ...], frozenset[str]]:
    of_structure = [(n, own) for n, own in quantities_of(spec) if n.name != "gain"]
    return tuple(n for n, _ in of_structure), frozenset(n.name for n, own in of_structure if own)


def _without_data(source: CaseText, asked: Mapping[str, Any]) -> CaseText:
    """The case with the DOFs that are asked as channels of a measurement that is never read."""
    rest = {key: value for key, value in source.data.items() if key not in _OF_DATA}
    if isinstance(uncertain := rest.get("uncertain"), Mapping):
        rest["uncertain"] = {key: value for key, value in uncertain.items() if key not in ("gain", "model_error")}
    each = [asked.get(key) for key in ("outputs", "inputs")]
    labels = [label for some in each if isinstance(some, list) for label in some if isinstance(label, str)]
    data = {"kind": "measured_frf", "file": "never read", "channels": {label: label for label in labels or ["1:x"]}}
    # what is wrong with a DOF is told at the key that asks for it
    data |= {key: some for key, some in zip(("outputs", "inputs"), each, strict=True) if isinstance(some, list)}
    places = {path: place for path, place in source.places.items() if path[0] not in _OF_DATA}
    places |= {("data", *path[1:]): place for path, place in source.places.items() if path[0] == "predict"}
    return replace(source, data=rest | {"data": data}, places=places)
