"""How the verdict on each stiffness changes when what was taken as exactly known is freed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from jointbayes.posterior.directions import interval_ratio, spread_in_words, verdict_of
from jointbayes.posterior.fisher import FisherInformation
from jointbayes.posterior.identifiability import LEAST_CONTRACTION, Verdict

__all__ = ["FreedRow", "freeing_sentence", "freeing_table"]

_ORDER: tuple[Verdict, ...] = ("identified", "weakly identified", "not identified")


@dataclass(frozen=True, slots=True)
class FreedRow:
    """What is known of the stiffnesses when some nuisances are free and the others exactly known.

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


def freeing_sentence(rows: Sequence[FreedRow]) -> str:
    """The table in words: whose verdict gets worse, through what, and by how much."""
    known, last = rows[0], rows[-1]
    parts = []
    for name, verdict in known.verdict.items():
        if _ORDER.index(last.verdict[name]) <= _ORDER.index(verdict):
            continue
        alone = [row.freed[0] for row in rows[1:] if len(row.freed) == 1 and row.verdict[name] == last.verdict[name]]
        through = f" ({' or '.join(alone)} alone does it)" if alone and len(last.freed) > 1 else ""
        parts.append(
            f"{name} goes from {verdict} ({spread_in_words(known.sd_log[name])}) to {last.verdict[name]} "
            f"({spread_in_words(last.sd_log[name])}){through}"
        )
    if not parts:
        return f"Freeing {_listed(last.freed)} changes no verdict." if last.freed else "Nothing is freed."
    return f"Freeing {_listed(last.freed)}: " + "; ".join(parts) + "."


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


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
