"""A slender beam as a finite-element model, by the formulas of its element."""

import numpy as np

from jointbayes.structure import FeModel
from tests.euler_beam import euler_beam

E, RHO = 2.1e11, 7800.0


def plane_beam(elements=50, length=0.383, height=0.025, width=0.04):
    """A slender Bernoulli beam, two DOFs a node, as a model."""
    stiffness, mass = euler_beam(length, E * width * height**3 / 12, RHO * width * height, elements)
    nodes = np.arange(1, elements + 2)
    dofs = np.stack([np.repeat(nodes, 2), np.tile([2, 6], elements + 1)], axis=1)
    places = np.stack([(nodes - 1) * length / elements, 0 * nodes, 0 * nodes], axis=1)
    return FeModel(stiffness, mass, dofs, nodes, places, source="plane beam")
