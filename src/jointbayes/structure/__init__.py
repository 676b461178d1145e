"""Structures as matrices: beams, their damping and their DOF labels."""

from jointbayes.structure.beam import BeamMaterial, beam, bending_element
from jointbayes.structure.beam_recipe import STRUCTURE_QUANTITIES, BeamMesh, BeamRecipe
from jointbayes.structure.body import Body, Discretisation, FreeModes
from jointbayes.structure.damping import DampingLaw, LossFactor, ModalDamping, Rayleigh, ViscousMatrix
from jointbayes.structure.frame import FrameBody, Member, PointMass
from jointbayes.structure.frame_recipe import FrameRecipe
from jointbayes.structure.given_matrices import MatrixFamily, MatrixRecipe, chain
from jointbayes.structure.matrices import Structure
from jointbayes.structure.modes import Modes, Reduction
from jointbayes.structure.recipe import ElementKind, is_additive
from jointbayes.structure.section import Section
from jointbayes.structure.uncertain_bodies import BeamFamily, FrameFamily, StructureRecipe, family_of_recipe

__all__ = [
    # structures
    "Body",
    "Modes",
    "Reduction",
    "Structure",
    # beams
    "BeamMaterial",
    "BeamMesh",
    "ElementKind",
    "Section",
    "beam",
    "bending_element",
    # frames
    "FrameBody",
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
    "FrameFamily",
    "FreeModes",
    "StructureRecipe",
    "family_of_recipe",
    "is_additive",
    # damping
    "DampingLaw",
    "LossFactor",
    "ModalDamping",
    "Rayleigh",
    "ViscousMatrix",
]
