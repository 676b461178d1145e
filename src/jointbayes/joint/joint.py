"""Where a joint acts: DOFs of the structure, against others or ground."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import ModelError

__all__ = ["Joint"]

Array = NDArray[np.float64]


class LabelledDofs(Protocol):
    """Whatever has DOFs with labels: a structure."""

    @property
    def n_dofs(self) -> int:
        """Number of DOFs."""
        ...

    def index(self, labels: Sequence[str]) -> NDArray[np.intp]:
        """Row numbers of DOF labels, shape (len(labels),)."""
        ...


@dataclass(frozen=True, slots=True)
class Joint:
    """Where a joint acts.

    Parameters
    ----------
    dofs
        Labels of the r DOFs on the structure's side, e.g. ``("1:y", "1:rz")``.
    against
        Labels of the r DOFs on the other side; empty means ground.

    Raises
    ------
    ModelError
        If a DOF occurs twice or the two sides differ in number.
    """

    dofs: tuple[str, ...]
    against: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "dofs", tuple(self.dofs))
        object.__setattr__(self, "against", tuple(self.against))
        both = self.dofs + self.against
        if not self.dofs or len(set(both)) != len(both):
            raise ModelError(f"joint: found DOFs {both}; expected one or more, each once; correct the labels")
        if self.against and len(self.against) != len(self.dofs):
            raise ModelError(
                f"joint: found {len(self.dofs)} DOFs against {len(self.against)}; "
                "expected as many on both sides, or none (ground) on the other; correct the labels"
            )

    def selection(self, structure: LabelledDofs) -> Array:
        """Matrix B, shape (n, r), so that Bᵀx is the joint's deformation and B K^J Bᵀ its stiffness.

        Raises
        ------
        ModelError
            If a DOF does not exist in the structure.
        """
        selection = np.zeros((structure.n_dofs, len(self.dofs)))
        selection[structure.index(self.dofs), np.arange(len(self.dofs))] = 1.0
        if self.against:
            selection[structure.index(self.against), np.arange(len(self.dofs))] = -1.0
        return selection
