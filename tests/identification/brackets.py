"""An L-bracket of bricks whose foot stands on six springs, with FRFs of dense solves."""

from functools import cache

import numpy as np
from benchmarks.bricks import brick_model, face
from scipy import linalg

import jointbayes as jb
from jointbayes.structure import LossFactor, Port, family_of_recipe, reduce_to_ports
from jointbayes.structure.imported.ports import port_forms
from vibrecords import FrfData, FrfSet

WAYS = ("x", "y", "z", "rx", "ry", "rz")
_LOSS, _NOISE = 0.005, 0.02
_LINES = np.arange(50.0, 3000.0, 10.0)
_SPRINGS = np.array([3e7, 3e7, 3e7, 5e3, 5e3, 5e3])


@cache
def bracket():
    """The model of 420 DOFs, and its ports: the foot's end face, the top corner, and one across the upright."""
    model = brick_model((6, 4, 9), (0.06, 0.04, 0.09), bracket=True)

    def at(*place):
        return Port((int(model.nodes[np.linalg.norm(model.places - place, axis=1).argmin()]),))

    return model, {"foot": Port(face(model, 0.06)), "top": at(0.0, 0.0, 0.09), "side": at(0.01, 0.04, 0.05)}


def springs_of(seed):
    """Six springs, N/m and N·m/rad, each within a factor of 5."""
    return _SPRINGS * 10 ** np.random.default_rng(seed).uniform(-0.7, 0.7, 6)


def bracket_problem(seed):
    """The problem with 18 accelerances of the whole model, each line solved, with 2 % noise."""
    model, ports = bracket()
    forms = {
        f"{name}:{way}": form for name, port in ports.items() for way, form in port_forms(model, port, name).items()
    }
    outputs = tuple(f"{name}:{way}" for name in ("top", "side") for way in "xyz")
    held = np.stack([forms[f"foot:{way}"] for way in WAYS], axis=1)
    seen = np.stack([forms[dof] for dof in outputs], axis=1)
    free, mass = model.stiffness.toarray(), model.mass.toarray()
    values, shapes = linalg.eigh(free + held @ np.diag(springs_of(seed)) @ held.T, mass)
    damping, seen, omega = shapes.T @ free @ shapes, shapes.T @ seen, 2 * np.pi * _LINES
    dynamic = (np.diag(values - w**2) + 1j * _LOSS * damping for w in omega)
    exact = np.array([-(w**2) * seen.T @ np.linalg.solve(d, seen[:, :3]) for w, d in zip(omega, dynamic, strict=True)])
    rng = np.random.default_rng([seed, 1])
    noise = _NOISE / np.sqrt(2) * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape))
    frf = FrfSet(_LINES, exact * (1 + noise), outputs, outputs[:3], "accelerance")
    body = family_of_recipe(reduce_to_ports(model, ports, float(_LINES[-1]), LossFactor(_LOSS)))
    joint, data = jb.Joint(tuple(f"foot:{way}" for way in WAYS)), FrfData(frf, (_NOISE * np.abs(exact)) ** 2)
    return jb.Problem(structure=body, joint=joint, data=data, name=f"bracket {seed}")
