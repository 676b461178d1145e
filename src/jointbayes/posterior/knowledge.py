"""What the data say beyond the draws: does the model explain them, what is known of the joint, and resting on what."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from jointbayes.posterior.checks import PredictiveCheck
from jointbayes.posterior.directions import NamedDirection, summary_sentence
from jointbayes.posterior.excluded import SimplerJoint, exclusion_sentences
from jointbayes.posterior.identifiability import CERTAINTY, IF_MODEL_RIGHT, ExactInputs, Identifiability, listed
from jointbayes.posterior.limits import ProfileLikelihood
from jointbayes.posterior.next_step import NextStep
from jointbayes.posterior.uncertain_inputs import (
    LARGEST_CHANGE,
    RANK,
    UncertainInputsRow,
    inputs_taken_as_exact,
    known_in_workshop,
    quantities_taken_as_exact,
)

_MOST_TOLD = 4  # stiffnesses in a sentence
#: What ``summary.json`` holds of each combination.
_OF_DIRECTION = ("quantity", "median", "interval95", "ratio", "sd_log", "verdict", "limit", "sentence")


def effect_sentence(rows: Sequence[UncertainInputsRow]) -> str:
    """The table in words: whose verdict is worse, and whose interval another, with all quantities uncertain."""
    settled = [row for row in rows if row.known]
    least, most = (pick(settled, key=lambda row: len(row.uncertain)) for pick in (min, max))
    if not most.uncertain or least.uncertain or len(settled) < 2:
        return "Whether other uncertain quantities matter is open: the calculation that would show it did not settle."
    parts, wider = [], dict.fromkeys(inputs_taken_as_exact((least, most)))
    for name, verdict in least.verdict.items():
        if RANK[most.verdict[name]] <= RANK[verdict]:
            continue
        parts.append(
            f"{name} goes from {verdict} ({least.known[name].spread}) to {most.verdict[name]} "
            f"({most.known[name].spread})"
        )
        wider.pop(name, None)
    for name in wider:
        parts.append(
            f"{name} stays {most.verdict[name]}, but its interval goes from {least.known[name].limit_or_interval} to "
            f"{most.known[name].limit_or_interval}"
        )
    if not parts:
        return (
            f"With {listed(most.uncertain)} uncertain every verdict holds, and no interval of a stiffness that is "
            f"known moves or widens by more than {100 * LARGEST_CHANGE:g} % of its width."
        )
    more = [f"{len(parts) - _MOST_TOLD} more change, see the table"] if len(parts) > _MOST_TOLD else []
    return f"With {listed(most.uncertain)} uncertain: {'; '.join([*parts[:_MOST_TOLD], *more])}."


@dataclass(frozen=True, slots=True, eq=False)
class KeptKnowledge:
    """What took time to find, kept with the draws; the last two are unknown to older files."""

    profiles: tuple[ProfileLikelihood, ...]
    freed: tuple[UncertainInputsRow, ...]
    assumed: tuple[str, ...]
    simpler: tuple[SimplerJoint, ...] | None = None
    next_steps: tuple[NextStep, ...] | None = None  # one or none


@dataclass(frozen=True, eq=False)
class Knowledge:
    """How far the numbers of a posterior carry.

    Parameters
    ----------
    check
        Posterior predictive check.
    directions
        Combinations of the joint's stiffnesses that are determined independently, best known first, by the draws.
    profiles
        Profile likelihood of each coordinate of the joint.
    freed
        What is known with other quantities uncertain or exactly known; the first row is the run. Empty where there is
        nothing to free.
    assumed
        The uncertainties that were assumed for `freed` in words, one for each quantity; empty where they are the case's
        own.
    simpler
        Whether a rigid, absent or uncoupled joint is excluded, of each that is known by bounds at most.
    next_step
        A forecast of what to measure next, with all else as in a workshop where `workshop` is not None; None where
        nothing that was looked at would help, the draws have not converged, or the model does not explain the data.
    """

    check: PredictiveCheck
    directions: tuple[NamedDirection, ...]
    profiles: tuple[ProfileLikelihood, ...]
    freed: tuple[UncertainInputsRow, ...]
    assumed: tuple[str, ...]
    simpler: tuple[SimplerJoint, ...] = ()
    next_step: NextStep | None = None

    @property
    def kept(self) -> KeptKnowledge:
        """What took time to find, as `Posterior.save` keeps it."""
        steps = () if self.next_step is None else (self.next_step,)
        return KeptKnowledge(self.profiles, self.freed, self.assumed, self.simpler, steps)

    @property
    def workshop(self) -> Mapping[str, Identifiability] | None:
        """What is known of each stiffness with all else as in a workshop; None where the run takes nothing as exact."""
        return known_in_workshop(self.freed)

    @property
    def exact(self) -> dict[str, ExactInputs]:
        """The stiffnesses whose verdict holds only if what the run takes as exact is so, by name."""
        return inputs_taken_as_exact(self.freed)

    @property
    def bounds_sentence(self) -> str:
        """What is known of joints of which each stiffness is known by bounds at most; empty where there are none."""
        return " ".join(self.bounds_sentences)

    @property
    def bounds_sentences(self) -> tuple[str, ...]:
        """The same, sentence by sentence."""
        if not self.simpler:
            return ()
        text, *rest = exclusion_sentences(self.simpler)
        if self._condition:
            text = f"With {self._condition}: {text[0].lower()}{text[1:]}"
        if not self.check.explains:
            text = f"{IF_MODEL_RIGHT.capitalize()}: {text[0].lower()}{text[1:]}"
        best = next((f"{d.sentence} ({d.value})" for d in self.directions if d.verdict in CERTAINTY), "")
        known = f"Best known{self._condition and ', on the same condition'}: {best}."
        return (text, *rest, *([known] if best else []))

    @property
    def _condition(self) -> str:
        """What combinations are known with: what the run takes as exact, unless freeing it was seen to change nothing.

        Of stiffnesses that are not identified anyway that cannot be seen, while combinations may be known well.
        """
        exact = quantities_taken_as_exact(self.freed)
        seen = exact and any(verdict != "not identified" for verdict in self.freed[0].verdict.values())
        return f"{listed(exact)} exactly known" if exact and (self.exact or not seen) else ""

    @property
    def directions_sentence(self) -> str:
        """Which combinations are known, in one sentence; conditional as the verdicts are."""
        text = summary_sentence(self.directions)
        if self._condition:
            text = f"With {self._condition}: {text}"
        if self.check.explains or any(d.verdict == "no verdict" for d in self.directions):
            return text
        return f"{IF_MODEL_RIGHT.capitalize()}: {text[0].lower()}{text[1:]}"

    @property
    def freed_sentence(self) -> str:
        """What the verdicts rest on, in one sentence."""
        if not self.freed:
            return ""
        text = effect_sentence(self.freed)
        if self.check.explains or text.startswith("Whether"):
            return text
        return f"{IF_MODEL_RIGHT.capitalize()}, {text[0].lower()}{text[1:]}"

    def as_json(self) -> dict[str, Any]:
        """What ``identifiability`` of ``summary.json`` holds."""
        return {
            "sentence": self.directions_sentence,
            "directions": [{key: getattr(d, key) for key in _OF_DIRECTION} for d in self.directions],
            "bounds_sentence": self.bounds_sentence,
            "simpler_joints": [asdict(joint) | {"excluded": joint.excluded} for joint in self.simpler],
            "profiles": {
                p.name: {"interval95": list(p.interval), "open_below": p.open_below, "open_above": p.open_above}
                for p in self.profiles
            },
            "freed": [
                {
                    "freed": list(row.uncertain),
                    "source": row.source,
                    "interval95": {name: list(assessment.interval95) for name, assessment in row.known.items()},
                    "sd_log": {name: assessment.sd_log for name, assessment in row.known.items()},
                    "verdict": row.verdict,
                    "if_model_right": {name: assessment.if_model_right for name, assessment in row.known.items()},
                }
                for row in self.freed
            ],
            "freed_assumed": bool(self.assumed),
            "freed_assumptions": list(self.assumed),
            "freed_sentence": self.freed_sentence,
        }
