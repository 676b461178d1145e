"""From the tables of one test of a case to the objects they describe: structure, data, noise model."""

import zlib
from dataclasses import replace
from importlib import import_module

import numpy as np

from jointbayes.arrays import Array
from jointbayes.case.spec.data_table import NoiseSpec, SyntheticFrfSpec
from jointbayes.case.spec.fields import DataTable
from jointbayes.case.spec.settings_tables import NoiseModelSpec
from jointbayes.case.spec.structure_table import ModalDampingSpec, StructureBase
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.frf import Ports
from jointbayes.inference import NoiseModel, Nuisance
from jointbayes.inference.noise.base import NoiseChoice
from jointbayes.joint import AnyJoint
from jointbayes.measurement import (
    CoherenceNoise,
    Data,
    NoiseLaw,
    RelativeNoise,
    synthesise_frf,
)
from jointbayes.structure import Body, StructureRecipe, family_of_recipe


def recipe_of(spec: StructureBase, data: DataTable, measurement: Data | None = None) -> StructureRecipe:
    """The structure of a case; accelerometers sit where translations are measured, as files or the case say."""
    loaded = () if data.files else data.loaded
    if measurement is not None and measurement.provenance is not None:
        loaded = tuple(label for label in measurement.provenance.loaded if spec.absent(label) is None)
    return spec.recipe(loaded)


def _synthetic(spec: CaseSpec) -> SyntheticFrfSpec:
    """The table of data that a truth makes, of a case that has one."""
    assert spec.data.synthetic is not None
    return spec.data.synthetic


def true_stiffness(spec: CaseSpec) -> Array:
    """Quantities of the joints that make the data, shape (q,)."""
    return np.array([_synthetic(spec).truth.stiffness_by_name[name] for name in spec.all_quantities])


def noise_of(spec: NoiseModelSpec, data: Data) -> tuple[NoiseModel, tuple[Nuisance, ...]]:
    """Distribution of the residuals, and the priors of its parameters; its module has the name of the distribution."""
    complex_frf = data.frfs is not None and spec.residuals == "complex"
    d = spec.discrepancy
    choice = NoiseChoice(
        spec.scale,
        (spec.scale_low_factor, spec.scale_high_factor),
        spec.scale_dof,
        spec.scale_guess,
        spec.dof,
        None if d is None else ((d.scale_low, d.scale_high), (d.length_low_hz, d.length_high_hz)),
    )
    module = import_module(f"jointbayes.inference.noise.{spec.distribution}")
    return module.noise_of(choice, 2 if complex_frf else 1, data)


def measurement_of(case: CaseSpec, joint: AnyJoint, setup: str = "") -> Data:
    """The data that a case states or makes; FRFs with those at the joint, which the paper's iteration needs.

    Of several set-ups each has noise of its own, by its name.
    """
    stated = case.data.stated()
    if stated is not None:
        return stated
    spec = _synthetic(case)
    parametrisation, truth = case.parametrisation, true_stiffness(case)
    parametrisation.check(truth)
    # one virtual test: the joint's own DOFs come last, so that they leave the noise of the others as it is
    at_joint = tuple(dof for dof in joint.labels if dof not in spec.outputs)
    ports = Ports(np.array(spec.lines_hz()), spec.outputs + at_joint, spec.inputs)
    rng = generator_of(spec.noise.seed, setup) if spec.noise.added else None
    measured = synthesise_frf(
        true_family(case),
        joint,
        parametrisation.matrix(truth),
        ports,
        noise_law(spec.noise),
        spec.quantity,
        rng,
        gain=spec.truth.gain,
    )
    return replace(measured.select(spec.outputs, spec.inputs), joint_frf=measured.frf)


def generator_of(seed: int, setup: str) -> np.random.Generator:
    """Random numbers of a set-up: independent of those of others, and the same whatever others there are."""
    if not setup:
        return np.random.default_rng(seed)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(zlib.crc32(setup.encode()),)))


def true_family(spec: CaseSpec) -> Body:
    """The structure that makes the data: as analysed, but for what the truth states otherwise."""
    truth, structure = _synthetic(spec).truth, spec.structure
    keys = {"youngs_modulus_gpa", "density_kg_m3", "length_mm", "accelerometer_mass_g"}
    stated: dict[str, object] = {key: getattr(truth, key) for key in keys & type(structure).model_fields.keys()}
    if truth.damping_ratio is not None:
        stated["damping"] = ModalDampingSpec(law="modal", ratio=truth.damping_ratio)
    changed = {key: value for key, value in stated.items() if value is not None}
    return family_of_recipe(recipe_of(structure.model_copy(update=changed), spec.data))


def noise_law(spec: NoiseSpec) -> NoiseLaw:
    """Law of the noise of synthetic data."""
    if spec.coherence is not None and spec.averages is not None:
        return CoherenceNoise(spec.coherence, spec.averages, spec.floor)
    return RelativeNoise(spec.relative, spec.floor)
