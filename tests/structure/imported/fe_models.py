"""A slender beam as a finite-element model, by the formulas of its element."""

import numpy as np

from jointbayes.structure import FeModel

E, RHO = 2.1e11, 7800.0


def plane_beam(elements=50, length=0.383, height=0.025, width=0.04):
    """A slender Bernoulli beam, two DOFs a node, as a model."""
    edge, area, second = length / elements, width * height, width * height**3 / 12
    k = E * second / edge**3 * np.array([
        [12, 6 * edge, -12, 6 * edge], [6 * edge, 4 * edge**2, -6 * edge, 2 * edge**2],
        [-12, -6 * edge, 12, -6 * edge], [6 * edge, 2 * edge**2, -6 * edge, 4 * edge**2]])  # fmt: skip
    m = RHO * area * edge / 420 * np.array([
        [156, 22 * edge, 54, -13 * edge], [22 * edge, 4 * edge**2, 13 * edge, -3 * edge**2],
        [54, 13 * edge, 156, -22 * edge], [-13 * edge, -3 * edge**2, -22 * edge, 4 * edge**2]])  # fmt: skip
    stiffness, mass = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    for e in range(elements):
        stiffness[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += k
        mass[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += m
    nodes = np.arange(1, elements + 2)
    dofs = np.stack([np.repeat(nodes, 2), np.tile([2, 6], elements + 1)], axis=1)
    places = np.stack([(nodes - 1) * edge, 0 * nodes, 0 * nodes], axis=1)
    return FeModel(stiffness, mass, dofs, nodes, places, source="plane beam")
