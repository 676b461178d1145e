"""Beams that shear and rotary inertia leave alone, by cubic elements written out: matrices of another code."""

import numpy as np


def euler_element(length, bending, mass):
    """K and M, 4 × 4, of (v, rz) at both ends; bending is EI, mass that of a unit of length."""
    h = length
    k = [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2]]
    k += [[-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]
    m = [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2]]
    m += [[54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]
    return bending / h**3 * np.array(k), mass * h / 420 * np.array(m)


def euler_beam(length, bending, mass, elements):
    """K and M of a straight beam of equal elements, free."""
    one, size = euler_element(length / elements, bending, mass), 2 * elements + 2
    whole = np.zeros((2, size, size))
    for first in range(0, 2 * elements, 2):
        whole[:, first : first + 4, first : first + 4] += one
    return whole
