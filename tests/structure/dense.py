"""Bodies whose quantities are uncertain, held against a dense solve of each as it is built with its factors."""

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from jointbayes.frf import DirectSolve, Ports, receptance_model
from jointbayes.joint import Joint
from jointbayes.structure import Structure
from jointbayes.structure.recipe import UncertainBody

Array = NDArray[np.float64]


def worst(
    family: UncertainBody, joint: Joint, stiffness: Array, ports: Ports, factors: Array, top_hz: float = 0
) -> float:
    """Largest deviation of receptances, of the peak of each row of factors; up to a frequency on a finer mesh."""
    found = receptance_model(family, joint, ports).receptance(np.repeat(stiffness[None], len(factors), 0), factors)
    labels = (*joint.dofs, *joint.against, *ports.outputs, *ports.inputs)
    richer = family.at(labels, top_hz) if top_hz else family
    exact = [DirectSolve(richer.structure(row), joint, ports).receptance(stiffness)[0] for row in factors]
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(found, exact, strict=True))


def natural_hz(whole: Structure, joint: Joint, matrix: Array, count: int) -> Array:
    """Lowest natural frequencies of a held structure: eigenvalues of M relative to K, which keep their digits."""
    held = joint.selection(whole)
    stiffness = whole.stiffness + held @ matrix @ held.T
    scale = 1 / np.sqrt(np.diag(stiffness))  # of scaled matrices also beside a stiff spring
    scaled = (scale[:, None] * each * scale for each in (whole.mass, stiffness))
    return 1 / np.sqrt(linalg.eigh(*scaled, eigvals_only=True)[: -count - 1 : -1]) / (2 * np.pi)
