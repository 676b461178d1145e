"""Which moves an ensemble makes, and how often each."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from jointbayes.sampling.coordinates.chart import Chart, Identity

if TYPE_CHECKING:
    from emcee import State
    from emcee.model import Model

    from jointbayes.sampling.proposal.fit import Proposal

__all__ = ["Move", "WeightedMove", "independence_share", "mixture"]

CHARTED_SHARE = 0.8  # of the local moves; the plain rest explores where the chart does not help
LARGEST_SHARE = 0.9  # of the independence move; the rest frees a walker that it cannot reach
GOOD_EFFICIENCY = 0.5  # from here on the independence move has its largest share
USELESS = 0.1  # up to here it has none


class Move(Protocol):
    """What emcee asks of a move."""

    def propose(self, model: "Model", state: "State") -> "tuple[State, NDArray[np.bool_]]":
        """Make one step of all walkers; return the state and who accepted, shape (walkers,)."""
        ...


@dataclass(frozen=True, slots=True)
class WeightedMove:
    """A move, its name in the report, and its probability at each step."""

    name: str
    move: Move
    weight: float


def independence_share(efficiency: float) -> float:
    """Probability of the independence move at a step.

    With an importance efficiency e its τ is about 2/e − 1, that of differential evolution in three dimensions about 10.
    On posteriors of measured natural frequencies it gave 2.6 times the effective draws per evaluation at e = 0.34, and
    a tenth fewer at e = 0.15, where walkers wait in places that the proposal does not reach.

    Examples
    --------
    >>> [round(independence_share(e), 3) for e in (0.9, 0.3, 0.0)]
    [0.9, 0.45, 0.0]
    """
    return LARGEST_SHARE * min(1.0, max(0.0, efficiency - USELESS) / (GOOD_EFFICIENCY - USELESS))


def mixture(chart: Chart | None = None, proposal: "Proposal | None" = None) -> tuple[WeightedMove, ...]:
    """Weighted moves of an ensemble.

    With a proposal that is close to the posterior most steps are independence moves. The rest are local.

    Of these, steps along a difference of two walkers had the shortest τ on Gaussian, curved and skewed densities (a
    sixth to a half of that of stretch moves alone). The whole difference (gamma0 = 1) carries walkers from one mode to
    another. A tenth of stretch moves varies the step length, which is fixed in the other two, for densities whose
    width changes from place to place, and costs little. With a chart most of these moves are made in it, and
    the others remain for densities that are no closer to a Gaussian there.

    Parameters
    ----------
    chart : Chart, optional
        Coordinates in which the density is closer to a Gaussian.
    proposal : Proposal, optional
        Fitted approximation of the density, in coordinates of its own.

    Returns
    -------
    tuple of WeightedMove
        Their weights sum to 1.
    """
    # emcee takes a while to import, and nobody who reads the settings needs it
    from jointbayes.sampling.moves.differential_evolution import ChartedDEMove
    from jointbayes.sampling.moves.independence import IndependenceMove
    from jointbayes.sampling.moves.stretch import HalvesStretchMove

    flat = Identity()
    local = [
        WeightedMove("differential evolution", ChartedDEMove(flat), 0.8),
        WeightedMove("whole difference", ChartedDEMove(flat, gamma0=1.0), 0.1),
        WeightedMove("stretch", HalvesStretchMove(), 0.1),
    ]
    if chart is not None:
        charted = [
            WeightedMove("differential evolution in the chart", ChartedDEMove(chart), 0.9),
            WeightedMove("whole difference in the chart", ChartedDEMove(chart, gamma0=1.0), 0.1),
        ]
        local = _share(charted, CHARTED_SHARE) + _share(local, 1 - CHARTED_SHARE)
    share = 0.0 if proposal is None else independence_share(proposal.efficiency)
    if proposal is None or share == 0.0:
        return tuple(local)
    independence = WeightedMove("independence", IndependenceMove(proposal.chart, proposal.density), share)
    return (independence, *_share(local, 1 - share))


def _share(moves: list[WeightedMove], share: float) -> list[WeightedMove]:
    return [WeightedMove(m.name, m.move, share * m.weight) for m in moves]
