"""Channel labels ``Point:12:Z+`` as entity, node and direction of a universal file, and back."""

import re
from dataclasses import dataclass

__all__ = ["Dof", "dof_label", "parse_dof"]

_AXES = ("", "X", "Y", "Z", "RX", "RY", "RZ")
_LABEL = re.compile(r"(?:(?P<entity>[^:\s]{1,10}):)?(?P<node>\d{1,9}):(?P<axis>S|R?[XYZ])(?P<sign>[+-]?)")


@dataclass(frozen=True, slots=True)
class Dof:
    """Entity name (empty where unused), node, and direction: 0 scalar, ±1…3 translations, ±4…6 rotations."""

    entity: str
    node: int
    direction: int


def dof_label(dof: Dof) -> str:
    """Label of a degree of freedom of a file.

    Examples
    --------
    >>> dof_label(Dof("Point", 12, 3)), dof_label(Dof("", 4, -5))
    ('Point:12:Z+', '4:RY-')
    """
    axis = "S" if dof.direction == 0 else _AXES[abs(dof.direction)] + ("+" if dof.direction > 0 else "-")
    return f"{dof.entity}:{dof.node}:{axis}" if dof.entity else f"{dof.node}:{axis}"


def parse_dof(label: str) -> Dof | None:
    """Degree of freedom of a label, upper or lower case, with or without sign; None where it is a mere name.

    Examples
    --------
    >>> parse_dof("11:y")
    Dof(entity='', node=11, direction=2)
    """
    match = _LABEL.fullmatch(label.replace("x", "X").replace("y", "Y").replace("z", "Z").replace(":r", ":R"))
    if match is None:
        return None
    axis = match["axis"]
    direction = 0 if axis == "S" else _AXES.index(axis) * (-1 if match["sign"] == "-" else 1)
    original = label.split(":")[0] if match["entity"] else ""
    return Dof(original, int(match["node"]), direction)
