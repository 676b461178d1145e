"""Coverage beside a measured body: a spindle known by its FRFs with 1 % noise, a modelled tool, the joint unknown.

Each data set has its own errors of the spindle's FRFs and of the tool's. The 95 % intervals of the joint's stiffnesses
should hold the truth in 95 of 100. Three studies: the noise of the spindle counts in the likelihood; it is ignored; it
counts, and the joint has a loss factor of its own. The data are those of both bodies assembled, dense matrices solved
line by line. The table goes to docs/imported.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from benchmarks.page import table
from benchmarks.study import Row, Study, coverage, outcome, share
from jointbayes.frf import MeasuredBody, Substructures
from jointbayes.inference import JointPrior, Problem, Uniform
from jointbayes.joint import Damped, Joint, LogStiffness
from jointbayes.sampling import SamplerSettings
from jointbayes.structure import BeamMaterial, LossFactor, Section, Structure, beam
from vibrecords import FrfData, FrfSet

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

STEEL = BeamMaterial(2.1e11, 0.3, 7800.0)
LINES = np.arange(100.0, 3000.0, 20.0)
TRUTH = (1.5e8, 1.2e6, 6e4)
NOISE = 0.01
NOSE, TIP = ("spindle:y", "spindle:rz"), ("7:y", "4:y")
TAPER = Joint(("1:y", "1:rz"), NOSE)
SETTINGS = SamplerSettings(walkers=24, max_steps=2000).for_one_of_many()


@dataclass(frozen=True)
class Variant:
    """Whether the noise of the spindle counts, and the loss factor of the joint, none where it is 0."""

    propagate: bool
    loss_factor: float = 0.0

    @property
    def truth(self) -> tuple[float, ...]:
        """Quantities of the joint."""
        return (*TRUTH, self.loss_factor) if self.loss_factor else TRUTH


STUDIES: Mapping[str, Variant] = {
    "counted": Variant(True),
    "ignored": Variant(False),
    "counted, damped joint": Variant(True, 0.05),
}


def tool() -> Structure:
    """A tool of 90 mm, 20 mm thick, free."""
    return beam(0.09, Section.circle(0.02), STEEL, LossFactor(0.02), elements=6)


def spindle() -> Structure:
    """A stub of 300 mm on two bearings, much damped; what the analysis knows of it is its FRFs at the nose."""
    free = beam(0.3, Section.circle(0.05), STEEL, LossFactor(0.06), elements=6)
    stiffness = np.array(free.stiffness)
    for label, bearing in (("1:y", 8e7), ("5:y", 1.2e8)):
        stiffness[free.dofs.index(label), free.dofs.index(label)] += bearing
    nose = {"7:y": NOSE[0], "7:rz": NOSE[1]}
    return Structure(stiffness, free.mass, free.damping, tuple(nose.get(label, f"b{label}") for label in free.dofs))


def exact_frf(bodies: Sequence[Structure], added: ComplexArray, outputs: Sequence[str], inputs: Sequence[str]) -> Any:
    """Receptances (lines, outputs, inputs) of bodies side by side with a joint of the taper, dense at every line."""
    labels = [label for body in bodies for label in body.dofs]
    z = np.zeros((LINES.size, len(labels), len(labels)), dtype=complex)
    start, omega = 0, 2 * np.pi * LINES[:, None, None]
    for body in bodies:
        part = slice(start, start + body.n_dofs)
        z[:, part, part] = body.stiffness * (1 + 1j * body.damping.hysteretic) - omega**2 * body.mass
        start += body.n_dofs
    if added.any():
        stretch = np.zeros((len(labels), 2))
        for i, (here, there) in enumerate(zip(TAPER.dofs, TAPER.against, strict=True)):
            stretch[labels.index(here), i], stretch[labels.index(there), i] = 1.0, -1.0
        z += stretch @ added @ stretch.T
    load = np.eye(len(labels))[:, [labels.index(label) for label in inputs]]
    found = np.linalg.solve(z, np.broadcast_to(load, (LINES.size, *load.shape)))
    return found[:, [labels.index(label) for label in outputs]]


def noisy(values: ComplexArray, rng: np.random.Generator) -> tuple[ComplexArray, Array]:
    """Values with complex circular errors of 1 % of each, and their variance."""
    white = rng.standard_normal((*values.shape, 2)) @ [1, 1j] / np.sqrt(2)
    return values * (1 + NOISE * white), (NOISE * np.abs(values)) ** 2


def data_set(study: str, index: int) -> Problem:
    """Noisy FRFs of the spindle by itself, and of the tool's end in it."""
    spec = STUDIES[study]
    rng, (k11, k12, k22) = np.random.default_rng([index, 2026]), TRUTH
    measured, variance = noisy(exact_frf((spindle(),), np.zeros(1), NOSE, NOSE), rng)
    body = MeasuredBody.of(FrfSet(LINES, measured, NOSE, NOSE), variance, "spindle")
    added = np.array([[k11, k12], [k12, k22]]) * (1 + 1j * spec.loss_factor)
    frf, spread = noisy(exact_frf((tool(), spindle()), added, TIP, TIP[:1]), rng)
    data = FrfData(FrfSet(LINES, frf, TIP, TIP[:1]), spread, synthetic=True)
    kind = Damped(LogStiffness(), (), ("all",)) if spec.loss_factor else LogStiffness()
    prior = JointPrior(kind, tuple(Uniform(np.log(k / 30), np.log(30 * k)) for k in spec.truth))
    return Problem(
        structure=Substructures(tool(), (body,), spec.propagate),
        joint=TAPER,
        data=data,
        prior=prior,
        name=f"spindle {index}",
    )


def analysed(study: str, index: int) -> Row:
    """What a run says of each quantity of a data set."""
    posterior = jb.sample(data_set(study, index), seed=index, settings=SETTINGS)
    return outcome(posterior, dict(zip(posterior.stiffness_names, STUDIES[study].truth, strict=True)))


def tables(results: Mapping[str, Row]) -> list[str]:
    """How many intervals hold the truth."""
    head = ("noise of the spindle", "k11", "k12", "k22", "loss factor", "model explains the data", "converged")
    rows = []
    for study, data in results.items():
        held = {name: share(count, data["sets"]) for name, count in data["held"].items()}
        shares = (held.get(name, "–") for name in ("k11", "k12", "k22", "eta"))
        rows.append((study, *shares, str(data["explains"]), str(data["converged"])))
    return table(head, rows)


STUDY = Study("measured_body", "imported.md", dict.fromkeys(STUDIES, 100), analysed, coverage, tables)

if __name__ == "__main__":
    STUDY.main()
