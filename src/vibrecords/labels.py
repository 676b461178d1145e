"""What labels of DOFs say: ``"11:y"`` is the translation of point 11 along y."""

from collections.abc import Sequence

_MOST = 6  # labels that are listed


def list_labels(labels: Sequence[str]) -> str:
    """The first labels, and how many more there are."""
    return ", ".join(labels[:_MOST]) + (f" and {len(labels) - _MOST} more" if len(labels) > _MOST else "")


def direction_of(label: str) -> str:
    """Direction of a DOF label: ``"y"`` of ``"11:y"``."""
    return label.rpartition(":")[2]


def rotation_sign(rotation: str, translation: str, axis: str) -> int:
    """Sign s of θ = s ∂u/∂(axis), where a line along `axis` turns by θ and its points move by u: e_axis × e_u = s e_θ.

    0 where this rotation does not move the line in this direction.

    Examples
    --------
    >>> rotation_sign("rz", "y", "x"), rotation_sign("ry", "z", "x"), rotation_sign("rx", "y", "x")
    (1, -1, 0)
    """
    turn = (axis, translation, rotation.removeprefix("r"))
    if sorted(turn) != ["x", "y", "z"] or not rotation.startswith("r"):
        return 0
    return 1 if "".join(turn) in "xyzxy" else -1
