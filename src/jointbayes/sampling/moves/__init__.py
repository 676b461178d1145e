"""How walkers move, a file for each kind; importing this imports emcee.

`tests/science/test_invariance.py` proves any of them: add a file, a line here and a line there.
"""

from jointbayes.sampling.moves.autoregressive import AutoregressiveMove as AutoregressiveMove
from jointbayes.sampling.moves.base import advance as advance
from jointbayes.sampling.moves.differential_evolution import DEMove as DEMove
from jointbayes.sampling.moves.independence import IndependenceMove as IndependenceMove
from jointbayes.sampling.moves.stretch import HalvesStretchMove as HalvesStretchMove
