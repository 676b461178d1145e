"""Rigid-body motions of structures that float: they have no natural frequency, and no test reports them as modes."""

import numpy as np

from jointbayes.arrays import Array
from jointbayes.joint import AnyJoint
from jointbayes.structure import Structure

#: Motions of a joint that are smaller beside the largest of their kind are rounding.
_AT_REST = 1e-8


def rigid_body_modes(structure: Structure, joint: AnyJoint) -> int:
    """Number of rigid-body motions that a structure has with its joint, whatever the joint's stiffness.

    Examples
    --------
    >>> from jointbayes.joint import Joint
    >>> from jointbayes.structure import ModalDamping, chain
    >>> two = chain([1.0, 2.0], (), ModalDamping((0.01,))).structure()
    >>> rigid_body_modes(two, Joint(("2:x",), ("1:x",))), rigid_body_modes(two, Joint(("1:x",)))
    (1, 1)
    """
    modes = structure.modes()
    return rigid_motions(modes.eigenvalues, joint.selection(structure).T @ modes.shapes)


def rigid_motions(eigenvalues: Array, joined: Array) -> int:
    """The same of free modes, (m,), rigid-body ones exactly 0, and the joint's motions in them, (r, m)."""
    rigid = joined[:, eigenvalues == 0.0]
    if not rigid.size:
        return rigid.shape[1]
    # translations and rotations have different units
    size = np.abs(joined).max(axis=1, keepdims=True)
    held = np.linalg.svd(rigid / np.where(size > 0, size, 1.0), compute_uv=False)
    return rigid.shape[1] - int((held > _AT_REST * held.max(initial=0.0)).sum())


def of_every_mode(values: Array, rigid: int, fill: float) -> Array:
    """What is stated of elastic modes, (n, c), with `fill` for the rigid-body motions before them, (n, rigid + c)."""
    return np.hstack([np.full((len(values), rigid), fill), values]) if rigid else values
