"""A kind of body of one's own: a solid that floats, of scikit-fem's matrices."""

from copy import copy
from functools import partial

import numpy as np
import skfem
from scipy import linalg
from skfem.models.elasticity import lame_parameters, linear_elasticity

from jointbayes.structure import Body, LossFactor, Modes, Reduction


def unchanged(modes, factors):
    return modes.eigenvalues[None], modes.shapes[None]  # one row serves all: no factor changes them


class Solid(Body):
    """A free steel bar of 0.2 × 0.03 × 0.02 m, of elements with 27 nodes."""

    damping = LossFactor(0.01)
    top_hz = np.inf

    def __init__(self, cells=(8, 2, 1)):
        mesh = skfem.MeshHex.init_tensor(*map(np.linspace, (0, 0, 0), (0.2, 0.03, 0.02), np.add(cells, 1)))
        basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex2()), intorder=4)
        inertia = skfem.BilinearForm(lambda u, v, _: 7800.0 * skfem.helpers.dot(u, v))
        self.stiffness = linear_elasticity(*lame_parameters(2.1e11, 0.3)).assemble(basis)
        self.mass, self.places = inertia.assemble(basis), basis.doflocs[:, ::3].T
        self.labels = [f"{node}:{way}" for node in range(1, len(self.places) + 1) for way in "xyz"]
        self.modes = Modes(*linalg.eigh(self.stiffness.toarray(), self.mass.toarray()))
        self.modes.eigenvalues[:6] = 0.0  # not 1e-5: it floats

    def at(self, dofs, top_hz):
        other = copy(self)
        other.top_hz = top_hz
        return other

    def reach_hz(self, count):
        return self.modes.frequency_hz[count + 6]  # the six rigid-body modes stand in front

    def rigid_motions(self, dofs):
        return self.modes.shapes[dofs, :6]

    def free_modes(self, dofs, motions, forced=None):
        modes = Modes(self.modes.eigenvalues, motions.T @ self.modes.shapes[dofs])
        reduction = Reduction.below(self.top_hz, modes, np.eye(len(modes.shapes)), forced)
        return partial(unchanged, reduction.reduce(modes))
