"""Stretch move along the line through another walker."""

from emcee.moves import StretchMove

from jointbayes.sampling.moves.base import HalvesMove


class HalvesStretchMove(HalvesMove, StretchMove):  # type: ignore[misc]  # emcee is not typed
    """emcee's stretch move, accepted or refused for half of the walkers at once.

    References
    ----------
    J. Goodman, J. Weare, Ensemble samplers with affine invariance (2010), DOI 10.2140/camcos.2010.5.65.
    """
