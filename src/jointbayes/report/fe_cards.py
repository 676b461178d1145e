"""The identified joint as cards of finite-element programs: Nastran, Abaqus, CalculiX and Ansys.

A joint of independent springs in the directions of its DOFs becomes spring elements, any other the full matrix.

References
----------
MSC Nastran Quick Reference Guide: CBUSH, PBUSH, DMIG. Abaqus Keywords Reference Guide: *SPRING, *MATRIX INPUT, *MATRIX
ASSEMBLE. CalculiX CrunchiX User's Manual: *SPRING, *EQUATION. Mechanical APDL Element Reference: MATRIX27.
"""

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.joint.joint import Joint
from jointbayes.joint.quantities import DIRECTIONS, is_rotation
from vibrecords.arrays import Array
from vibrecords.errors import printable
from vibrecords.files import WRITTEN_BY

Units = Literal["SI", "mm-N-t"]
#: Millimetres for a metre, and what the system calls its units.
_LENGTHS: dict[str, tuple[float, str]] = {"SI": (1.0, "m, N, kg, s"), "mm-N-t": (1e3, "mm, N, t, s")}
_ASCII = str.maketrans({"·": "*", "…": "...", "−": "-", "²": "^2", "³": "^3", "ρ": "rho", "–": "-", "→": "->"})

Dof = tuple[int, int]
"""Number of a node, and of its direction from 1: x, y, z, rx, ry, rz."""


@dataclass(frozen=True, slots=True, eq=False)
class JointElement:
    """One joint between one or two nodes of a model.

    Parameters
    ----------
    dofs
        Of the nodes, n of them.
    motions
        What each adds to the joint's r deformations, shape (n, r): `Joint.deformations` in the units.
    matrix
        K^J of the deformations, shape (r, r), in the units.
    """

    dofs: tuple[Dof, ...]
    motions: Array
    matrix: Array

    @property
    def stiffness(self) -> Array:
        """K between the DOFs, shape (n, n)."""
        return self.motions @ self.matrix @ self.motions.T

    @property
    def nodes(self) -> tuple[int, ...]:
        """Its one or two nodes."""
        return tuple(dict.fromkeys(node for node, _ in self.dofs))

    @property
    def springs(self) -> tuple[tuple[float, tuple[Dof, ...]], ...]:
        """Stiffness of each spring with its DOF on either side, or on one; empty where they would not be the joint."""
        sides = [np.flatnonzero(column) for column in self.motions.T]
        plain = all((np.abs(column[column != 0]) == 1).all() for column in self.motions.T)
        own = len({dof for side in sides for dof in side.tolist()}) == sum(map(len, sides))
        if not (plain and own) or np.count_nonzero(self.matrix - np.diag(self.matrix.diagonal())):
            return ()
        pairs = (tuple(self.dofs[dof] for dof in side) for side in sides)
        return tuple(zip(self.matrix.diagonal().tolist(), pairs, strict=True))


def joint_element(
    joint: Joint, stiffness: Array, held: Sequence[int], units: Units, nodes: Mapping[str, int]
) -> JointElement:
    """The element of one joint.

    Parameters
    ----------
    joint
        Where it acts.
    stiffness
        K^J, shape (r, r), SI units.
    held
        Those of its directions that are rigid: no stiffness, so none of the element's.
    units
        Of the element.
    nodes
        Number of each node whose name in the labels is none, and under ``"NAME:r"`` that of the node whose translations
        are its rotations.

    Raises
    ------
    ModelError
        If a node has no number, a DOF no direction, or every direction is rigid.
    """
    yielding = [i for i in range(joint.size) if i not in held]
    if not yielding:
        remedy = "connect the nodes by a rigid element"
        raise ModelError.of(f"joint {joint}", (), "found every direction rigid", "a stiffness", remedy)
    length, _ = _LENGTHS[units]
    turns = np.array([is_rotation(direction) for direction in joint.directions], dtype=float)[yielding]
    turned = np.array([is_rotation(label) for label in joint.labels], dtype=float)
    # u/mm = 1000 u/m, and K in N/mm, N and N·mm
    motions = joint.deformations(joint.labels)[:, yielding] * length ** (turned[:, None] - turns)
    matrix = stiffness[np.ix_(yielding, yielding)] * length ** (turns[:, None] + turns - 1)
    dofs = tuple(_dof(label, nodes) for label in joint.labels)
    if len(set(dofs)) < len(dofs):
        raise ModelError(f"joint {joint}: found one number for two nodes; expected one for each; correct --node")
    return JointElement(dofs, motions, matrix)


def _dof(label: str, nodes: Mapping[str, int]) -> Dof:
    name, _, direction = label.rpartition(":")
    if is_rotation(label) and f"{name}:r" in nodes:
        return nodes[f"{name}:r"], DIRECTIONS.index(direction) - 2
    number = nodes.get(name, int(name) if name.isascii() and name.isdigit() and len(name) < 9 else 0)
    if direction not in DIRECTIONS or not 0 < number < 10**8:
        found = f"found no node with a number from 1 to 99999999 and a direction {', '.join(DIRECTIONS)}"
        remedy = f"give the node's number with --node {name or 'NAME'}=NUMBER"
        raise ModelError.of(f"DOF {label}", (), found, "both for cards", remedy)
    return number, DIRECTIONS.index(direction) + 1


def fe_cards(
    program: str, elements: Sequence[JointElement], comments: Sequence[str], units: Units, first_id: int
) -> str:
    """Text of the cards, comments above them.

    Parameters
    ----------
    program
        One of `PROGRAMS`.
    elements
        The joints.
    comments
        What is said of them.
    units
        Those of the elements.
    first_id
        Number of the first element, property and node that are made.
    """
    sign, write = PROGRAMS[program]
    said = [
        WRITTEN_BY,
        f"Units: {_LENGTHS[units][1]}; rotations in rad, right-handed. Directions are the model's: those of the nodes "
        "must be parallel to them.",
        "Signs: forces that deform the joint = K * (motion of its first node - motion of its second, or of ground, 0): "
        "with k12 > 0 a positive second motion takes a positive first force.",
        *comments,
    ]
    lines = (f"{sign} {line}" for line in ascii_lines(said))
    return "\n".join([*lines, *write(elements, first_id)]) + "\n"


def ascii_lines(texts: Sequence[str]) -> list[str]:
    """Lines of text that every program reads: ASCII, at most 68 characters long."""
    plain = (printable(text).translate(_ASCII).encode("ascii", "backslashreplace").decode() for text in texts)
    return [line for text in plain for line in textwrap.wrap(text, 68)]


def _sum_of(elements: Sequence[JointElement]) -> list[tuple[Dof, Dof, float]]:
    """Upper triangle of one matrix of all, column by column, in the order of the DOFs; zeros left out."""
    dofs = sorted({dof for element in elements for dof in element.dofs})
    whole = np.zeros((len(dofs), len(dofs)))
    for element in elements:
        rows = [dofs.index(dof) for dof in element.dofs]
        whole[np.ix_(rows, rows)] += element.stiffness
    return [(dofs[i], dofs[j], float(whole[i, j])) for j in range(len(dofs)) for i in range(j + 1) if whole[i, j] != 0]


def _nastran(elements: Sequence[JointElement], number: int) -> list[str]:
    lines: list[str] = []
    for element in elements:
        if not element.springs:
            continue
        near = element.springs[0][1][0][0]
        far = [node for node in element.nodes if node != near]
        lines.append(f"CBUSH   {number:8d}{number:8d}{near:8d}{far[0] if far else '':>8}{'':24}{0:8d}")
        stiffness = {pair[0][1]: f"{k:.9E}" for k, pair in element.springs}
        fields = (number, "K", *(stiffness.get(direction, "") for direction in range(1, 7)))  # 16 wide, four on a line
        for name, four in (("PBUSH*", fields[:4]), ("*", fields[4:])):
            lines.append(f"{name:<8}" + "".join(f"{value:>16}" for value in four))
        number += 1
    coupled = [element for element in elements if not element.springs]
    if coupled:
        lines += ["$ Case control: K2GG = KJOINT", f"DMIG    KJOINT  {0:8d}{6:8d}{2:8d}{0:8d}"]
        column = None
        for (row, i), (node, j), k in _sum_of(coupled):
            if (node, j) != column:
                lines.append(f"DMIG*   {'KJOINT':<16}{node:16d}{j:16d}")
                column = node, j
            lines.append(f"*       {row:16d}{i:16d}{k:16.9E}".replace("E", "D"))
    return lines


def _spring_elements(element: JointElement, number: int) -> list[str]:
    """Cards of springs, the same in Abaqus and CalculiX, one element each."""
    lines = []
    for n, (k, pair) in enumerate(element.springs, number):
        ends = ", ".join(str(node) for node, _ in pair)
        lines += [f"*ELEMENT, TYPE=SPRING{len(pair)}, ELSET=JOINT_{n}", f"{n}, {ends}", f"*SPRING, ELSET=JOINT_{n}"]
        lines += [", ".join(str(direction) for _, direction in pair), f"{k:.12E}"]
    return lines


def _abaqus(elements: Sequence[JointElement], number: int) -> list[str]:
    lines: list[str] = []
    for element in elements:
        lines += _spring_elements(element, number)
        number += len(element.springs)
    coupled = _sum_of([element for element in elements if not element.springs])
    if coupled:
        lines.append("*MATRIX INPUT, NAME=JOINT, TYPE=SYMMETRIC")
        lines += [f"{a}, {i}, {b}, {j}, {k:.12E}" for (a, i), (b, j), k in coupled]
        lines.append("*MATRIX ASSEMBLE, STIFFNESS=JOINT")
    return lines


def _calculix(elements: Sequence[JointElement], number: int) -> list[str]:
    """Springs; of another joint one spring for each factor of K = L D Lᵀ, at a node that an equation moves by Lᵀ.

    Raises
    ------
    ModelError
        If a rotation is that of a node: CalculiX has those of rigid bodies, as translations of another.
    """
    lines: list[str] = []
    for element in elements:
        turned = next((node for node, direction in element.dofs if direction > 3), None)
        if turned is not None:
            expected = "the ROT NODE of a *RIGID BODY, as CalculiX has no rotations of other nodes"
            remedy = "give its number with --node NAME:r=NUMBER"
            raise ModelError.of("calculix", (), f"found a rotation of node {turned}", expected, remedy)
        if element.springs:
            lines += _spring_elements(element, number)
            number += len(element.springs)
            continue
        root = np.linalg.cholesky(element.matrix)  # positive definite, as every joint with coordinates is
        size = root.diagonal()
        for k, row in zip(size**2, (element.motions @ root / size).T, strict=True):
            terms = [(number, 1, -1.0), *((*dof, c) for dof, c in zip(element.dofs, row, strict=True) if c)]
            cells = [f"{node}, {direction}, {factor:.12E}" for node, direction, factor in terms]
            lines += ["*NODE", f"{number}, 0., 0., 0.", "*EQUATION", f"{len(terms)}"]
            lines += [", ".join(cells[i : i + 4]) for i in range(0, len(cells), 4)]
            lines += ["*BOUNDARY", f"{number}, 2, 3"]
            own = JointElement(((number, 1),), np.ones((1, 1)), np.array([[k]]))
            lines += _spring_elements(own, number)
            number += 1
    return lines


def _ansys(elements: Sequence[JointElement], _: int) -> list[str]:
    """MATRIX27 between two nodes; ground is a node that is held, whose rows are zero."""
    lines = ["/PREP7"]
    for element in elements:
        near, *far = element.nodes
        whole = np.zeros((12, 12))
        rows = [direction - 1 + (0 if node == near else 6) for node, direction in element.dofs]
        whole[np.ix_(rows, rows)] = element.stiffness
        constants = [f"{k:.12E}" for k in whole[np.triu_indices(12)]]
        lines += ["*GET,JBET,ETYP,,NUM,MAX", "JBET=JBET+1", "ET,JBET,MATRIX27,,0,4"]
        lines += ["*GET,JBR,RCON,,NUM,MAX", "JBR=JBR+1", f"R,JBR,{','.join(constants[:6])}"]
        lines += [f"RMORE,{','.join(constants[i : i + 6])}" for i in range(6, 78, 6)]
        if not far:
            place = ",".join(f"{axis}({near})" for axis in ("NX", "NY", "NZ"))
            lines += ["*GET,JBN,NODE,,NUM,MAX", "JBN=JBN+1", f"N,JBN,{place}", "D,JBN,ALL,0"]
        lines += ["TYPE,JBET", "REAL,JBR", f"E,{near},{far[0] if far else 'JBN'}"]
    return lines


#: Programs, with what begins a comment and what writes the cards.
PROGRAMS: dict[str, tuple[str, Callable[[Sequence[JointElement], int], list[str]]]] = {
    "nastran": ("$", _nastran),
    "abaqus": ("**", _abaqus),
    "calculix": ("**", _calculix),
    "ansys": ("!", _ansys),
}
