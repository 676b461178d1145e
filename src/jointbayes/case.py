"""A case: the TOML file turned into structure, joint, data and prior, with the settings of the run."""

import math
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jointbayes import case_schema as schema
from jointbayes.errors import CaseError, JointBayesError
from jointbayes.frf import FrfSet, Ports
from jointbayes.identification import compliance_start
from jointbayes.inference import JointPrior, Marginal, Normal, Problem, Uniform
from jointbayes.joint import Joint, LogStiffness, Parametrisation, SignedCoupling, joint_matrix
from jointbayes.measurement import (
    FrequencyMeasurement,
    FrfMeasurement,
    Measurement,
    RelativeNoise,
    synthesise_frf,
)
from jointbayes.sampling import SamplerSettings
from jointbayes.structure import (
    BeamMaterial,
    DampingLaw,
    LossFactor,
    ModalDamping,
    Rayleigh,
    Section,
    Structure,
    beam,
)
from jointbayes.toml_text import read_text

__all__ = ["Case", "case_from_text", "load_case"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """One identification job.

    Parameters
    ----------
    name
        Short name: the file's, without its ending.
    text
        The TOML text.
    spec
        The same, checked and typed.
    problem
        Structure, joint, data and prior.
    joint_frf
        FRFs at the measured DOFs and at the joint, rotation included, which the paper's iteration needs; None where
        the data are natural frequencies.
    """

    name: str
    text: str
    spec: "schema.CaseSpec"
    problem: Problem
    joint_frf: FrfSet | None

    @property
    def title(self) -> str:
        """Title for people."""
        return self.spec.title

    @property
    def initial(self) -> Array:
        """First guess of (k11, k12, k22), shape (3,)."""
        return _stiffness(self.spec.joint.initial)

    @property
    def reference(self) -> Array | None:
        """Published (k11, k12, k22), shape (3,), if the case names any."""
        return _stiffness(self.spec.reference) if self.spec.reference else None

    @property
    def measured_frequencies_hz(self) -> tuple[float, ...] | None:
        """Measured natural frequencies, if the case holds any, Hz."""
        measured = self.problem.measurement
        if isinstance(measured, FrequencyMeasurement):
            return tuple(measured.frequency_hz.tolist())
        reference = self.spec.reference
        return reference.natural_frequencies_hz if reference else None

    @cached_property
    def compliance_fit(self) -> Array | None:
        """Joint (k11, k12, k22) fitted without any guess, shape (3,); None where the data are natural frequencies."""
        measured = self.problem.measurement
        if isinstance(measured, FrequencyMeasurement):
            return None
        return compliance_start(self.problem.structure, self.problem.joint, measured)

    @cached_property
    def sampler(self) -> SamplerSettings:
        """Sampler settings."""
        spec = self.spec.sampling
        return SamplerSettings(
            ensembles=spec.ensembles, walkers=spec.walkers, max_steps=spec.max_steps, processes=spec.processes
        )


def load_case(path: str | os.PathLike[str]) -> Case:
    """Read a case file.

    Parameters
    ----------
    path
        TOML file; see docs/case-file.md.

    Raises
    ------
    CaseError
        If the file cannot be read or anything in it is wrong: file, line, key, what is expected.

    Examples
    --------
    >>> import jointbayes as jb
    >>> jb.load_case("configs/clamped_beam.toml").name  # doctest: +SKIP
    'clamped_beam'
    """
    file = Path(path)
    text = read_text(file)
    return _build(file.stem, text, schema.parse_case(text, str(file)), str(file))


def case_from_text(name: str, text: str) -> Case:
    """Build a case from TOML text; errors as for `load_case`, with `name` for the file."""
    return _build(name, text, schema.parse_case(text, name), name)


def _build(name: str, text: str, spec: "schema.CaseSpec", where: str) -> Case:
    try:
        structure = _structure(spec.structure)
        joint = Joint(spec.joint.dofs, spec.joint.against)
        measurement, joint_frf = _data(structure, joint, spec.data)
        problem = Problem(structure, joint, measurement, _prior(spec))
        problem.log_posterior  # noqa: B018 (built here so that a DOF that does not exist is found now)
    except CaseError:
        raise
    except JointBayesError as error:
        raise CaseError(f"{where}:1: {error}") from error
    return Case(name, text, spec, problem, joint_frf)


def _structure(spec: "schema.StructureSpec") -> Structure:
    kappa = None if spec.shear_coefficient == "cowper" else float(spec.shear_coefficient)
    free = beam(
        spec.length_mm * 1e-3,
        _section(spec.section),
        BeamMaterial(spec.youngs_modulus_gpa * 1e9, spec.poissons_ratio, spec.density_kg_m3),
        _damping(spec.damping),
        elements=spec.elements,
        dofs_per_node=spec.dofs_per_node,
        shear_coefficient=kappa,
    )
    return free.fixed(spec.supports) if spec.supports else free


def _section(spec: "schema.SectionSpec") -> Section:
    mm = 1e-3
    match spec:
        case schema.CircleSpec():
            return Section.circle(spec.diameter_mm * mm)
        case schema.TubeSpec():
            return Section.tube(spec.outer_diameter_mm * mm, spec.inner_diameter_mm * mm)
        case schema.RectangleSpec():
            return Section.rectangle(spec.width_mm * mm, spec.height_mm * mm)
        case schema.BoxSpec():
            return Section.box(spec.width_mm * mm, spec.height_mm * mm, spec.wall_mm * mm)


def _damping(spec: "schema.DampingSpec") -> DampingLaw:
    match spec:
        case schema.ModalDampingSpec():
            return ModalDamping(spec.ratio)
        case schema.LossFactorDampingSpec():
            return LossFactor(spec.loss_factor)
        case schema.RayleighDampingSpec():
            return Rayleigh(spec.alpha_per_s, spec.beta_s)


def _prior(spec: "schema.CaseSpec") -> JointPrior:
    parametrisation: Parametrisation = LogStiffness() if spec.joint.parametrisation == "log" else SignedCoupling()
    by_name = {name: getattr(spec.prior, name) for name in parametrisation.names}
    return JointPrior(parametrisation, tuple(_marginal(by_name[name]) for name in parametrisation.names))


def _marginal(spec: "schema.PriorSpec") -> Marginal:
    match spec:
        case schema.LogUniformPriorSpec():
            return Uniform(math.log(spec.low), math.log(spec.high))
        case schema.LogNormalPriorSpec():
            return Normal(math.log(spec.median), spec.sd_log)
        case schema.DecadesPriorSpec():
            return Normal.from_decades(spec.guess, spec.decades)
        case schema.UniformPriorSpec():
            return Uniform(spec.low, spec.high)


def _data(structure: Structure, joint: Joint, spec: "schema.DataSpec") -> tuple[Measurement, FrfSet | None]:
    if isinstance(spec, schema.NaturalFrequenciesSpec):
        frequency = np.array(spec.frequencies_hz)
        return FrequencyMeasurement(frequency, np.hypot(spec.sd_relative * frequency, spec.sd_hz)), None
    # one virtual test: the joint's own DOFs come last, so that they leave the noise of the others as it is
    at_joint = tuple(dof for dof in joint.dofs + joint.against if dof not in spec.outputs)
    ports = Ports(np.array(spec.lines_hz()), spec.outputs + at_joint, spec.inputs)
    rng = np.random.default_rng(spec.noise.seed) if spec.noise.added else None
    measured = synthesise_frf(
        structure,
        joint,
        joint_matrix(_stiffness(spec.truth)),
        ports,
        RelativeNoise(spec.noise.relative, spec.noise.floor),
        spec.quantity,
        rng,
    )
    used = FrfMeasurement(
        measured.frf.select(spec.outputs, spec.inputs),
        measured.variance[:, : len(spec.outputs)],
        synthetic=True,
    )
    return used, measured.frf


def _stiffness(spec: "schema.StiffnessSpec | schema.ReferenceSpec") -> Array:
    return np.array([spec.k11, spec.k12, spec.k22])
