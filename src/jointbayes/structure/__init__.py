"""Structures as matrices: beams, their damping and their DOF labels."""

from jointbayes.structure.beam import BeamMaterial, beam, bending_element
from jointbayes.structure.beam_family import BeamFamily
from jointbayes.structure.damping import DampingLaw, LossFactor, ModalDamping, Rayleigh, ViscousMatrix
from jointbayes.structure.families import StructureRecipe, family_of_recipe
from jointbayes.structure.family import Discretisation, FixedFamily, FreeModes, StructureFamily, as_family
from jointbayes.structure.frame import Body, Member, PointMass
from jointbayes.structure.frame_family import FrameFamily
from jointbayes.structure.frame_recipe import FrameRecipe
from jointbayes.structure.given_matrices import MatrixFamily, MatrixRecipe, chain
from jointbayes.structure.matrices import Modes, Structure, mode_shift
from jointbayes.structure.mesh import BeamMesh
from jointbayes.structure.section import Section
from jointbayes.structure.uncertain_quantities import (
    STRUCTURE_QUANTITIES,
    BeamRecipe,
    ElementKind,
    is_additive,
    is_mode_frequency,
)

__all__ = [
    # structures
    "Modes",
    "Structure",
    "mode_shift",
    # beams
    "BeamMaterial",
    "BeamMesh",
    "ElementKind",
    "Section",
    "beam",
    "bending_element",
    # frames
    "Body",
    "FrameRecipe",
    "Member",
    "PointMass",
    # given matrices
    "MatrixFamily",
    "MatrixRecipe",
    "chain",
    # uncertain structures
    "STRUCTURE_QUANTITIES",
    "BeamFamily",
    "BeamRecipe",
    "Discretisation",
    "FixedFamily",
    "FrameFamily",
    "FreeModes",
    "StructureFamily",
    "StructureRecipe",
    "as_family",
    "family_of_recipe",
    "is_additive",
    "is_mode_frequency",
    # damping
    "DampingLaw",
    "LossFactor",
    "ModalDamping",
    "Rayleigh",
    "ViscousMatrix",
]
