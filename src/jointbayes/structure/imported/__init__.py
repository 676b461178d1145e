"""Finite-element models of other programs: read, reduced to what a joint and sensors see, and used as bodies."""

from jointbayes.structure.imported.beams import with_beams as with_beams
from jointbayes.structure.imported.fe_model import FeModel as FeModel
from jointbayes.structure.imported.fe_model import FePart as FePart
from jointbayes.structure.imported.imported_body import ImportedFamily as ImportedFamily
from jointbayes.structure.imported.imported_body import ImportedRecipe as ImportedRecipe
from jointbayes.structure.imported.imported_body import Outline as Outline
from jointbayes.structure.imported.imported_body import reduce_to_ports as reduce_to_ports
from jointbayes.structure.imported.ports import Port as Port
from jointbayes.structure.imported.ports import nodes_in_box as nodes_in_box
from jointbayes.structure.imported.ports import port_forms as port_forms
from jointbayes.structure.imported.read import read_structure as read_structure
from jointbayes.structure.imported.reduction import ReducedModel as ReducedModel
from jointbayes.structure.imported.reduction import ReducedPart as ReducedPart
