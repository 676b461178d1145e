"""How the linearised spread of each stiffness changes when what was taken as exactly known is freed.

For planning and for tables of hypothetical measurements, of which there are no draws. What a run knows is said by its
draws: `jointbayes.posterior.information.uncertain_inputs`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from jointbayes.posterior.identifiability import LEAST_CONTRACTION, Verdict
from jointbayes.posterior.information.directions import interval_ratio, verdict_of
from jointbayes.posterior.information.fisher import FisherInformation

__all__ = ["FreedRow", "freeing_table"]


@dataclass(frozen=True, slots=True)
class FreedRow:
    """Linearised: what is known of the stiffnesses when some nuisances are free and the others exactly known.

    Parameters
    ----------
    freed
        Names of the free nuisances; empty where all else is known.
    sd_log
        Standard deviation of ln |k| by stiffness, from the Fisher information with priors.
    ratio
        Upper over lower end of the 95 % interval that it implies.
    verdict
        By the rule of `jointbayes.posterior.identifiability`.
    """

    freed: tuple[str, ...]
    sd_log: Mapping[str, float]
    ratio: Mapping[str, float]
    verdict: Mapping[str, Verdict]


def freeing_table(fisher: FisherInformation, nuisances: Sequence[str]) -> tuple[FreedRow, ...]:
    """Free no nuisance, each alone, and all together.

    Parameters
    ----------
    fisher
        Information whose parameters include the nuisances with their priors.
    nuisances
        Names to free; those of `fisher` that are not named stay exactly known throughout.

    Returns
    -------
    tuple of FreedRow
        First all else known, then one row for each nuisance, then all of them if there is more than one.

    Raises
    ------
    ModelError
        If `fisher` has no parameter of such a name.
    """
    sets: list[tuple[str, ...]] = [(), *((name,) for name in nuisances)]
    if len(nuisances) > 1:
        sets.append(tuple(nuisances))
    return tuple(_row(fisher, freed) for freed in sets)


def _row(fisher: FisherInformation, freed: tuple[str, ...]) -> FreedRow:
    sd = fisher.stiffness_sd((*fisher.joint_names, *freed))
    ratio = {name: interval_ratio(value) for name, value in sd.items()}
    return FreedRow(freed, sd, ratio, {name: _verdict(fisher, name, value) for name, value in sd.items()})


def _verdict(fisher: FisherInformation, name: str, sd: float) -> Verdict:
    """Verdict with the contraction where the prior of ln k is stated, which it is not for k12 = ρ √(k11 k22)."""
    if name in fisher.joint_names:
        prior_sd = float(fisher.prior_sd[fisher.names.index(name)])
        if 1 - (sd / prior_sd) ** 2 < LEAST_CONTRACTION:
            return "not identified"
    return verdict_of(sd)
