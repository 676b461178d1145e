"""Structures as matrices: beams, their damping and their DOF labels."""

from jointbayes.structure.beam import BeamMaterial, beam, bending_element
from jointbayes.structure.beam_recipe import STRUCTURE_QUANTITIES, BeamMesh, BeamRecipe
from jointbayes.structure.damping import DampingLaw, LossFactor, ModalDamping, Rayleigh, ViscousMatrix
from jointbayes.structure.family import Discretisation, FreeModes, StructureFamily
from jointbayes.structure.frame import Body, Member, PointMass
from jointbayes.structure.frame_recipe import FrameRecipe
from jointbayes.structure.given_matrices import FixedFamily, MatrixFamily, MatrixRecipe, as_family, chain
from jointbayes.structure.matrices import Modes, Structure, mode_shift
from jointbayes.structure.recipe import ElementKind, is_additive, is_mode_frequency
from jointbayes.structure.section import Section
from jointbayes.structure.uncertain_bodies import BeamFamily, FrameFamily, StructureRecipe, family_of_recipe

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
