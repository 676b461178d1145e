"""The paper's beam and joint, and the cases of the repository."""

from pathlib import Path

import numpy as np
import pytest

from jointbayes.joint import Joint
from jointbayes.structure import BeamMaterial, DampingLaw, ModalDamping, Section, Structure, beam

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
STEEL = BeamMaterial(2.1e11, 0.3, 7800.0)  # Table 1
TABLE_3 = np.array([5.05e9, 3.44e7, 1.52e6])
CLAMP = Joint(("1:y", "1:rz"))


def rod(
    length: float = 0.383,
    damping: DampingLaw | None = None,
    elements: int = 10,
    shear_coefficient: float | None = None,
    dofs_per_node: int = 2,
) -> Structure:
    """Table 1's rod, free."""
    return beam(
        length,
        Section.circle(0.025),
        STEEL,
        damping or ModalDamping((0.01,)),
        elements=elements,
        shear_coefficient=shear_coefficient,
        dofs_per_node=dofs_per_node,
    )


@pytest.fixture(scope="session")
def configs() -> Path:
    return CONFIGS
