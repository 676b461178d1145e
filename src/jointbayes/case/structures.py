"""From the `[structure]` table of a case file to the recipe of its structure."""

from collections.abc import Iterable

import numpy as np

from jointbayes.case.schema.damping import LossFactorDampingSpec, ModalDampingSpec, RayleighDampingSpec
from jointbayes.case.schema.frame import BodySpec, FrameSpec, MemberSpec
from jointbayes.case.schema.matrices import ChainSpec, DampersSpec, MatricesSpec, MatrixDampingSpec
from jointbayes.case.schema.section import BoxSpec, CircleSpec, RectangleSpec, SectionSpec, TubeSpec
from jointbayes.case.schema.structure import BeamSpec, StructureSpec
from jointbayes.errors import ModelError
from jointbayes.structure import (
    BeamMaterial,
    BeamRecipe,
    Body,
    DampingLaw,
    FrameRecipe,
    LossFactor,
    MatrixRecipe,
    Member,
    ModalDamping,
    PointMass,
    Rayleigh,
    Section,
    StructureRecipe,
    ViscousMatrix,
    chain,
)
from jointbayes.structure.given_matrices import matrix_of

_MM, _G = 1e-3, 1e-3


def structure_recipe(spec: StructureSpec, loaded: tuple[str, ...]) -> StructureRecipe:
    """The structure of a case; `loaded` are the DOFs at which accelerometers sit.

    Raises
    ------
    ModelError
        If the structure is not possible.
    """
    match spec:
        case BeamSpec():
            return _beam(spec, loaded)
        case FrameSpec():
            return _frame(spec, loaded)
        case ChainSpec():
            return _chain(spec, loaded)
        case MatricesSpec():
            return _matrices(spec, loaded)


def _beam(spec: BeamSpec, loaded: tuple[str, ...]) -> BeamRecipe:
    kappa = None if spec.shear_coefficient == "cowper" else float(spec.shear_coefficient)
    return BeamRecipe(
        spec.length_mm * _MM,
        _section(spec.section),
        BeamMaterial(spec.youngs_modulus_gpa * 1e9, spec.poissons_ratio, spec.density_kg_m3),
        _damping(spec.damping),
        elements=spec.elements,
        dofs_per_node=spec.dofs_per_node,
        shear_coefficient=kappa,
        supports=spec.supports,
        accelerometer_mass=spec.accelerometer_mass_g * _G,
        accelerometer_dofs=loaded,
        element=spec.element,
    )


def _section(spec: SectionSpec) -> Section:
    match spec:
        case CircleSpec():
            return Section.circle(spec.diameter_mm * _MM)
        case TubeSpec():
            return Section.tube(spec.outer_diameter_mm * _MM, spec.inner_diameter_mm * _MM)
        case RectangleSpec():
            return Section.rectangle(spec.width_mm * _MM, spec.height_mm * _MM)
        case BoxSpec():
            return Section.box(spec.width_mm * _MM, spec.height_mm * _MM, spec.wall_mm * _MM)


def _damping(spec: ModalDampingSpec | LossFactorDampingSpec | RayleighDampingSpec) -> DampingLaw:
    match spec:
        case ModalDampingSpec():
            return ModalDamping(spec.ratio)
        case LossFactorDampingSpec():
            return LossFactor(spec.loss_factor)
        case RayleighDampingSpec():
            return Rayleigh(spec.alpha_per_s, spec.beta_s)


def _frame(spec: FrameSpec, loaded: tuple[str, ...]) -> FrameRecipe:
    bodies = tuple((name, _body(spec, body)) for name, body in spec.all_bodies.items())
    return FrameRecipe(
        bodies,
        _damping(spec.damping),
        spec.directions,
        spec.supports,
        spec.accelerometer_mass_g * _G,
        accelerometer_dofs=loaded,
        element=spec.element,
    )


def _body(frame: FrameSpec, body: BodySpec) -> Body:
    members = body.members or (MemberSpec(points=tuple(body.points)),)
    masses = (PointMass(mass.point, mass.mass_kg, mass.inertia_kg_m2, metres(mass.offset_mm)) for mass in body.masses)
    places = tuple((name, metres(place)) for name, place in body.points.items())
    return Body(places, tuple(_member(member, body, frame) for member in members), tuple(masses))


def _member(spec: MemberSpec, body: BodySpec, frame: FrameSpec) -> Member:
    """A member; what it does not state is its body's, and what that does not state the frame's."""
    owners = (spec, body, frame)
    modulus, poisson, density = (
        next(value for owner in owners if (value := getattr(owner, key)) is not None)
        for key in ("youngs_modulus_gpa", "poissons_ratio", "density_kg_m3")
    )
    section = next(owner.section for owner in owners if owner.section is not None)
    kappa = next(owner.shear_coefficient for owner in owners if owner.shear_coefficient is not None)
    none = (0.0, 0.0, 0.0)
    first, last = spec.offsets_mm or (none, none)
    return Member(
        spec.points,
        _section(section),
        BeamMaterial(modulus * 1e9, poisson, density),
        _section(spec.end_section) if spec.end_section else None,
        None if kappa == "cowper" else kappa,
        spec.up,
        (metres(first), metres(last)),
    )


def metres(millimetres: Iterable[float]) -> tuple[float, float, float]:
    """A vector in m from one in mm."""
    x, y, z = (number * _MM for number in millimetres)
    return x, y, z


def _chain(spec: ChainSpec, loaded: tuple[str, ...]) -> MatrixRecipe:
    springs = [(*spring.between, spring.stiffness_n_per_m) for spring in spec.springs]
    if isinstance(spec.damping, DampersSpec):
        dampers = [(*damper.between, damper.damping_n_s_per_m) for damper in spec.damping.dampers]
        whole = chain(spec.masses_kg, springs, dampers=dampers, direction=spec.direction)
    else:
        whole = chain(spec.masses_kg, springs, _damping(spec.damping), direction=spec.direction)
    mass = spec.accelerometer_mass_g * _G
    return MatrixRecipe(
        whole.stiffness,
        whole.mass,
        whole.dofs,
        whole.damping,
        spec.supports,
        accelerometer_mass=mass,
        accelerometer_dofs=loaded,
    )


def _viscous(spec: MatrixDampingSpec) -> ViscousMatrix:
    key = "structure.damping.damping_matrix"
    given = matrix_of(np.array(spec.damping_matrix), key)
    try:
        return ViscousMatrix(given)
    except ModelError as error:
        raise ModelError(f"{key}: {str(error).partition(': ')[2]}") from error


def _matrices(spec: MatricesSpec, loaded: tuple[str, ...]) -> MatrixRecipe:
    law = _viscous(spec.damping) if isinstance(spec.damping, MatrixDampingSpec) else _damping(spec.damping)
    return MatrixRecipe(
        matrix_of(np.array(spec.stiffness), "structure.stiffness"),
        matrix_of(np.array(spec.mass), "structure.mass"),
        spec.dofs,
        law,
        spec.supports,
        {name: metres(place) for name, place in spec.points.items()},
        spec.accelerometer_mass_g * _G,
        accelerometer_dofs=loaded,
    )
