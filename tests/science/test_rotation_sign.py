"""A rotation from two stations has the sign of the FE model's, whatever axis the body lies along."""

import numpy as np
import pytest

from jointbayes.frf import DirectSolve, Ports
from jointbayes.joint import Joint
from jointbayes.structure import BeamMaterial, FrameBody, FrameRecipe, LossFactor, Member, Section
from tests.conftest import first_in_ci
from vibrecords import FrfSet
from vibrecords.rotations import Rotation


@pytest.mark.science
@pytest.mark.parametrize("axis", first_in_ci(range(3), 1), ids="xyz")
def test_the_sign_of_a_rotation_is_that_of_a_rod_along_any_axis(axis):
    lines = np.array([60.0, 350.0])
    far, near = (tuple(length * (i == axis) for i in range(3)) for length in (0.3, 0.299))
    rod = Member(("root", "near", "tip"), Section.rectangle(0.02, 0.03), BeamMaterial(2.1e11, 0.3, 7800.0))
    body = FrameBody({"root": (0.0, 0.0, 0.0), "near": near, "tip": far}, (rod,))
    free = FrameRecipe(body, LossFactor(0.02)).structure()
    root = Joint(tuple(f"root:{way}" for way in ("x", "y", "z", "rx", "ry", "rz")))
    for across in (i for i in range(3) if i != axis):
        direction, turn = "xyz"[across], f"r{'xyz'[3 - axis - across]}"
        dofs = (f"near:{direction}", f"tip:{direction}", f"tip:{turn}")
        model = DirectSolve(free, root, Ports(lines, dofs, dofs[1:2]))
        frf = FrfSet(lines, model.receptance(np.diag([1e8] * 3 + [1e5] * 3))[0], dofs, dofs[1:2])
        found = Rotation(dofs[2], dofs[:2], 1e-3, "first order", axis="xyz"[axis]).compute_frf(frf).values[:, 0, 0]
        true = frf.frf(dofs[2], dofs[1])
        assert np.linalg.norm(found - true) < 5e-3 * np.linalg.norm(true)  # the shear angle at the driven tip remains
