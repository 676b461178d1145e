"""Which verdicts rest on inputs that the run takes as exactly known, and what uncertain inputs do, in words."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jointbayes.posterior.identifiability import Identifiability, Verdict
from jointbayes.posterior.information.directions import factor_in_words
from jointbayes.posterior.information.uncertain_inputs import UncertainInputsRow
from jointbayes.posterior.rounding import in_unit, rounded_interval

_RANK: dict[Verdict, int] = {
    "identified": 0,
    "weakly identified": 1,
    "bounded below": 2,
    "bounded above": 2,
    "not identified": 3,
}
#: An interval that is wider, or whose ends lie further out, by more than this share of its width is another one.
LARGEST_CHANGE = 0.5


@dataclass(frozen=True, slots=True)
class ExactInputs:
    """What a verdict holds only with: quantities that the run takes as exactly known.

    Parameters
    ----------
    quantities
        Their names.
    freed
        What is known with them uncertain; None where that could not be shown.
    """

    quantities: tuple[str, ...]
    freed: Identifiability | None

    @property
    def condition(self) -> str:
        """What follows the verdict: ``" only if density and length are exact"``."""
        return f" only if {listed(self.quantities)} {'are' if len(self.quantities) > 1 else 'is'} exact"

    @property
    def beside(self) -> str:
        """The interval with them uncertain, in words."""
        them = "them" if len(self.quantities) > 1 else "it"
        if self.freed is None:
            return f"what is known with {them} uncertain could not be shown"
        limit, ends = self.freed.limit, rounded_interval(self.freed.interval95, self.freed.interval95_error, " to ")
        return f"with {them} uncertain {limit or in_unit(ends, self.freed.unit)}, {self.freed.verdict}"

    def as_json(self) -> dict[str, Any]:
        """What ``parameters.<name>.only_if_exact`` of ``summary.json`` holds."""
        freed = self.freed
        return {
            "quantities": list(self.quantities),
            "interval95": None if freed is None else list(freed.interval95),
            "limit95": None if freed is None else freed.limit95,
            "verdict": None if freed is None else freed.verdict,
        }


def quantities_taken_as_exact(rows: Sequence[UncertainInputsRow]) -> tuple[str, ...]:
    """Names of what the run, the first row, takes as exact and another row does not."""
    most = max((row.uncertain for row in rows), key=len, default=())
    return tuple(name for name in most if name not in rows[0].uncertain)


def inputs_taken_as_exact(rows: Sequence[UncertainInputsRow]) -> dict[str, ExactInputs]:
    """The stiffnesses whose verdict holds only if what the run takes as exact is so, by name.

    A verdict does where the run's interval is another one with these quantities uncertain, see `LARGEST_CHANGE`, where
    its class is worse, its one-sided limit is weaker by a factor of 1.5, or where this could not be shown.
    """
    exact = quantities_taken_as_exact(rows)
    if not exact:
        return {}
    run, most = rows[0], max(rows, key=lambda row: len(row.uncertain))
    return {
        name: ExactInputs(exact, most.known.get(name))
        for name, known in run.known.items()
        if known.verdict != "not identified" and (not most.known or _is_weaker(most.known[name], known))
    }


def _is_weaker(freed: Identifiability, run: Identifiability) -> bool:
    """Whether less is known than the run says, beyond the Monte Carlo error of either."""
    if _RANK[freed.verdict] > _RANK[run.verdict] or (freed.limit and run.limit and freed.verdict != run.verdict):
        return True
    if freed.limit and run.limit:
        weaker = math.log(run.limit95 / freed.limit95) * (1 if run.verdict == "bounded below" else -1)
        return weaker > math.log(1 + LARGEST_CHANGE)
    low, high = run.interval95
    ends = np.array([run.interval95, freed.interval95])
    errors = np.nan_to_num(np.array([run.interval95_error, freed.interval95_error]))
    median = freed.median
    if (ends > 0).all() or (ends < 0).all():
        errors, ends = errors / np.abs(ends), np.sort(np.log(np.abs(ends)), axis=1)
    (low_run, high_run), (low_freed, high_freed) = ends
    width, error = high_run - low_run, float(np.sqrt((errors**2).sum()))
    change = max(high_freed - low_freed - width, low_run - low_freed, high_freed - high_run)
    return bool(not low <= median <= high or change > max(LARGEST_CHANGE * width, 2 * error))


def effect_sentence(rows: Sequence[UncertainInputsRow]) -> str:
    """The table in words: whose verdict is worse with all quantities uncertain, and what a single one does."""
    settled = [row for row in rows if row.known]
    least, most = (pick(settled, key=lambda row: len(row.uncertain)) for pick in (min, max))
    if not most.uncertain or least.uncertain or len(settled) < 2:
        return "Whether other uncertain quantities matter is open: the draws that would show it did not converge."
    parts, wider = [], dict.fromkeys(inputs_taken_as_exact((least, most)))
    for name, verdict in least.verdict.items():
        if _RANK[most.verdict[name]] <= _RANK[verdict]:
            continue
        alone = [r.uncertain[0] for r in settled if len(r.uncertain) == 1 and r.verdict[name] == most.verdict[name]]
        enough = f", {' or '.join(alone)} alone suffices" if alone and len(most.uncertain) > 1 else ""
        parts.append(
            f"{name} goes from {verdict} ({_spread(least.known[name])}) to {most.verdict[name]} "
            f"({_spread(most.known[name])}{enough.replace('_', ' ')})"
        )
        wider.pop(name, None)
    for name in wider:
        parts.append(
            f"{name} stays {most.verdict[name]}, but its interval goes from {_interval(least.known[name])} to "
            f"{_interval(most.known[name])}"
        )
    names = listed(most.uncertain)
    if not parts:
        return (
            f"With {names} uncertain no verdict is worse than with all exactly known, and no interval of a "
            f'stiffness whose verdict is not "not identified" moves or widens by more than '
            f"{100 * LARGEST_CHANGE:g} % of its width."
        )
    return f"With {names} uncertain: {'; '.join(parts)}."


def _interval(known: Identifiability) -> str:
    return known.limit or rounded_interval(known.interval95, known.interval95_error, " … ")


def _spread(found: Identifiability) -> str:
    low, high = found.interval95
    if found.limit:
        return found.limit_in_words
    return "its sign is unknown" if low <= 0 <= high else factor_in_words(max(high / low, low / high))


def listed(names: Sequence[str]) -> str:
    """Names in a sentence: ``"density, length and gain"``."""
    readable = [name.replace("youngs", "Young's").replace("_", " ") for name in names]
    return readable[0] if len(readable) == 1 else f"{', '.join(readable[:-1])} and {readable[-1]}"
