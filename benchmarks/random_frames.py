"""How often `find_map` ends at the mode of random plane frames with four to eight springs.

A column on a base joint and an arm, in one piece or joined by springs, on a support of one or two springs or on none:
data come from exact dynamic stiffness, which has no mesh, springs and sizes are drawn, and the model is right. The mode
counts as found where the search ends no more than one in log posterior below a climb from the truth. Nothing that makes
the data imports jointbayes.

References
----------
Howson, W. P., Williams, F. W. (1973). Natural frequencies of frames with axially loaded Timoshenko members. Journal of
Sound and Vibration 26(4), 503-515. DOI 10.1016/S0022-460X(73)80216-0
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

import jointbayes as jb
from benchmarks.exact_beam import CrossSection, rectangle
from benchmarks.study import Row, Study
from jointbayes.identification import refine
from vibrecords import FrfData, FrfSet

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

COUNT = 40
#: Log posterior that the search may end below a climb from the truth.
TOLERANCE = 1.0
#: Steel, and the loss factor of the members.
YOUNGS_MODULUS, POISSONS_RATIO, DENSITY, LOSS_FACTOR = 2.1e11, 0.3, 7800.0, 0.01
NOISE = 0.02
#: Ends of the log-uniform priors of translational and rotational springs, N/m and N·m/rad.
ENDS = {"x": (1e6, 1e10), "y": (1e6, 1e10), "rz": (1e3, 1e7)}
_PER_POINT = ("x", "y", "rz")


@dataclass(frozen=True)
class Spring:
    """A spring between a DOF and ground, or between two DOFs."""

    joint: str
    direction: str
    dof: str
    against: str = ""


def member(squared: Array, vector: Array, section: CrossSection, e: complex, density: float) -> Complex:
    """Dynamic stiffness of a member in global axes, shape (lines, 6, 6), from its transfer matrix at each ω²."""
    shear = section.shear_coefficient * e / (2 * (1 + POISSONS_RATIO)) * section.area
    length = float(np.hypot(*vector))
    # motions u, v, θ and forces N, Q, M along the member: y' = A y
    a = np.zeros((squared.size, 6, 6), dtype=complex)
    a[:, 0, 3], a[:, 1, 2], a[:, 1, 4], a[:, 2, 5] = 1 / (e * section.area), 1, 1 / shear, 1 / (e * section.inertia)
    a[:, 3, 0] = a[:, 4, 1] = -squared * density * section.area
    a[:, 5, 2], a[:, 5, 4] = -squared * density * section.inertia, -1
    scale = np.array([1, 1, 1 / length, 1e8, 1e8, 1e8 * length])  # so that rounding is alike in all six
    transfer = expm(a * length * (scale / scale[:, None]))
    motions, forces = slice(0, 3), slice(3, 6)
    flexible = np.linalg.inv(transfer[:, motions, forces])
    first = np.concatenate([-flexible @ transfer[:, motions, motions], flexible], axis=2)
    last = transfer[:, forces, forces] @ first
    last[:, :, :3] += transfer[:, forces, motions]
    local = np.concatenate([-first, last], axis=1)
    local = local * np.tile(scale[3:], 2)[:, None] / np.tile(scale[:3], 2)
    c, s = vector / length
    turn = np.kron(np.eye(2), np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
    return turn.T @ local @ turn


class Frame:
    """A frame drawn from a seed.

    Parameters
    ----------
    seed
        Of its sizes, its springs and its noise; seed modulo 5 gives the number of springs, four to eight.
    driven
        Point of the arm where it is hit, across: its head or its tip. By default the tip where that is free.
    """

    def __init__(self, seed: int, driven: str | None = None) -> None:
        rng = np.random.default_rng([seed, 31])
        self.seed, self.count = seed, 4 + seed % 5
        self.height, self.arm = rng.uniform(0.3, 0.6), rng.uniform(0.3, 0.8)
        self.width, self.depth = rng.uniform(0.03, 0.05), rng.uniform(0.015, 0.03)
        self.elbow = self.count >= 6
        head, tip = ("arm.head", "arm.tip") if self.elbow else ("head", "tip")
        foot, top = ("column.foot", "column.head") if self.elbow else ("foot", "head")
        self.springs = [Spring("base", d, f"{foot}:{d}") for d in _PER_POINT]
        if self.elbow:
            self.springs += [Spring("elbow", d, f"{top}:{d}", f"{head}:{d}") for d in _PER_POINT]
        directions = ("y", "x")[: self.count - len(self.springs)]
        self.springs += [Spring("support", d, f"{tip}:{d}") for d in directions]
        self.stiffness = np.array([np.exp(rng.uniform(*np.log(ENDS[s.direction]))) for s in self.springs])
        middle = head.replace("head", "middle")
        at = {"head": head, "tip": tip}[driven or ("tip" if self.count == 6 else "head")]
        self.input, self.outputs = f"{at}:y", (f"{at}:y", f"{middle}:{'y' if at == tip else 'x'}")
        self.points = {foot: (0.0, 0.0), top: (0.0, self.height), head: (0.0, self.height)}
        self.points |= {middle: (0.4 * self.arm, self.height), tip: (self.arm, self.height)}
        self.members = ((foot, top), (head, middle), (middle, tip))
        self._rng = rng

    def receptance(self, frequency_hz: Array) -> Complex:
        """Exact receptances, shape (lines, 2, 1)."""
        names = list(self.points)
        omega, size = 2 * np.pi * frequency_hz, 3 * len(names)
        dynamic = np.zeros((omega.size, size, size), dtype=complex)
        for start, end in self.members:
            rows = [3 * names.index(p) + i for p in (start, end) for i in range(3)]
            dynamic[:, np.array(rows)[:, None], rows] += self._member(omega, start, end)
        for spring, k in zip(self.springs, self.stiffness, strict=True):
            rows = [self._row(names, dof) for dof in (spring.dof, spring.against) if dof]
            sign = np.array([1.0, -1.0])[: len(rows)]
            dynamic[:, np.array(rows)[:, None], rows] += k * np.outer(sign, sign)
        force = np.zeros((size, 1))
        force[self._row(names, self.input)] = 1.0
        motion = np.linalg.solve(dynamic, np.broadcast_to(force, (omega.size, size, 1)))
        return motion[:, [self._row(names, dof) for dof in self.outputs]]

    @staticmethod
    def _row(names: list[str], dof: str) -> int:
        point, direction = dof.split(":")
        return 3 * names.index(point) + _PER_POINT.index(direction)

    def _member(self, omega: Array, start: str, end: str) -> Complex:
        section = rectangle(self.width, self.depth, POISSONS_RATIO)
        vector = np.subtract(self.points[end], self.points[start])
        return member(omega**2, vector, section, YOUNGS_MODULUS * (1 + 1j * LOSS_FACTOR), DENSITY)

    def case(self) -> jb.Case:
        """The case that a user would write, with computed data in the place of the exact ones."""
        points = {name: f"[{1e3 * x!r}, {1e3 * y!r}, 0]" for name, (x, y) in self.points.items()}
        tables = []
        for body in ("column", "arm") if self.elbow else ("",):
            of_body = {n.removeprefix(f"{body}."): p for n, p in points.items() if n.startswith(body)}
            pairs = ((a.removeprefix(f"{body}."), b.removeprefix(f"{body}.")) for a, b in self.members)
            members = ", ".join(f'{{ points = ["{a}", "{b}"] }}' for a, b in pairs if {a, b} <= of_body.keys())
            listed = ", ".join(f"{name} = {place}" for name, place in of_body.items())
            head = f"[structure.bodies.{body}]\n" if body else ""
            tables.append(f"{head}points = {{ {listed} }}\nmembers = [{members}]\n")
        for joint in dict.fromkeys(spring.joint for spring in self.springs):
            springs = [spring for spring in self.springs if spring.joint == joint]
            tables.append(f'[joints.{joint}]\nkind = "springs"\ndofs = {_list(s.dof for s in springs)}')
            if springs[0].against:
                tables.append(f"against = {_list(s.against for s in springs)}")
            for s in springs:
                low, high = ENDS[s.direction]
                tables.append(f'prior.k{s.direction} = {{ distribution = "log_uniform", low = {low}, high = {high} }}')
        truth = [f"{s.joint}.k{s.direction} = {float(k)!r}" for s, k in zip(self.springs, self.stiffness, strict=True)]
        text = f"""
[structure]
kind = "frame"
directions = ["x", "y", "rz"]
youngs_modulus_gpa = {YOUNGS_MODULUS / 1e9}
poissons_ratio = {POISSONS_RATIO}
density_kg_m3 = {DENSITY}
section = {{ shape = "rectangle", width_mm = {1e3 * self.width!r}, height_mm = {1e3 * self.depth!r} }}
damping = {{ law = "loss_factor", loss_factor = {LOSS_FACTOR} }}
{chr(10).join(tables)}
[data]
kind = "synthetic_frf"
inputs = ["{self.input}"]
outputs = {_list(self.outputs)}
f_min_hz = 12.0
f_max_hz = 1500.0
f_step_hz = 2.0
noise = {{ relative = {NOISE}, floor = 0.0, seed = 1 }}
[data.truth.stiffness]
{chr(10).join(truth)}
"""
        return jb.case_from_text(f"{self.count} springs", text)

    def problem(self) -> jb.Problem:
        """The problem with the exact data and their noise."""
        problem = self.case().problem
        frequency_hz = problem.test.data.frfs.frf.frequency_hz
        exact = self.receptance(frequency_hz)
        sd = NOISE * np.abs(exact)
        values = exact + sd * (self._rng.normal(size=exact.shape) + 1j * self._rng.normal(size=exact.shape))
        measured = FrfSet(frequency_hz, values, self.outputs, (self.input,), "receptance")
        return problem.with_test(data=FrfData(measured, 2 * sd**2, synthetic=True))


def _list(labels: object) -> str:
    return str(list(labels)).replace("'", '"')  # type: ignore[call-overload]


def search(seed: int, driven: str | None = None) -> Row:
    """How far one search ends above a climb from the truth in log posterior, and its misfit."""
    frame = Frame(seed, driven)
    problem = frame.problem()
    estimate = jb.find_map(problem, seed=seed)
    start, from_truth = refine(problem.log_posterior, problem.parametrisation.coordinates(frame.stiffness))
    total, count = problem.log_posterior.typical_squares(start)
    return {"springs": frame.count, "above": estimate.log_posterior - from_truth, "squares": total / count}


def summary(rows: Sequence[Row]) -> Row:
    """How many modes are found."""
    return {"found": sum(row["above"] > -TOLERANCE for row in rows), "least": min(row["above"] for row in rows)}


def tables(results: Mapping[str, Row]) -> list[str]:
    """One line."""
    return [
        f"{one['found']} of {one['sets']} modes found, the worst {one['least']:.3g} off" for one in results.values()
    ]


STUDY = Study("random_frames", "", {"frames": COUNT}, lambda _, index: search(index - 1), summary, tables)

if __name__ == "__main__":
    STUDY.main()
