"""From recipes to families: each kind of structure with its own."""

from collections.abc import Mapping

from jointbayes.structure.beam_family import BeamFamily
from jointbayes.structure.frame_family import FrameFamily
from jointbayes.structure.frame_recipe import FrameRecipe
from jointbayes.structure.given_matrices import MatrixFamily, MatrixRecipe
from jointbayes.structure.uncertain_quantities import BeamRecipe

StructureRecipe = BeamRecipe | FrameRecipe | MatrixRecipe


def family_of_recipe(
    recipe: StructureRecipe, ranges: Mapping[str, tuple[float, float]] | None = None
) -> BeamFamily | FrameFamily | MatrixFamily:
    """The structures of a recipe whose quantities lie within ranges of the logarithm of a factor, by name."""
    match recipe:
        case BeamRecipe():
            return BeamFamily(recipe, ranges or {})
        case FrameRecipe():
            return FrameFamily(recipe, ranges or {})
        case MatrixRecipe():
            return MatrixFamily(recipe, ranges or {})
