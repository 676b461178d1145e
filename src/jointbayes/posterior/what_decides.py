"""Which uncertain input matters most: the spread of each stiffness with one input uncertain, linearised at the mode."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from jointbayes.errors import JointBayesError
from jointbayes.inference import Problem
from jointbayes.phrases import listed
from jointbayes.posterior.fisher import WORTH_SAYING, fisher_information, spread_in_words
from jointbayes.rounding import sentence_start
from vibrecords.arrays import Array

_UNCHANGED = 1.1  # times the spread with all inputs exact, up to which an input hardly matters
_MOST_NAMED = 4  # inputs in a sentence


@dataclass(frozen=True, slots=True)
class WhatDecides:
    """Linearised standard deviation of ln of each stiffness by what is uncertain besides the joint.

    Parameters
    ----------
    exact
        With all inputs exactly known, by the name of the stiffness, the best known first; only those that are known.
    alone
        With one input uncertain, by its name; the one that matters most first.
    together
        With all inputs uncertain.
    """

    exact: Mapping[str, float]
    alone: Mapping[str, Mapping[str, float]]
    together: Mapping[str, float]

    @property
    def sentence(self) -> str:
        """Which input matters most, and which do not."""
        widening = {name: max(sd[k] / self.exact[k] for k in self.exact) for name, sd in self.alone.items()}
        matter = [name for name, times in widening.items() if times > _UNCHANGED]
        none = listed([name for name in self.alone if name not in matter])
        if not matter:
            return f"No input matters alone: {none}."
        k = max(self.exact, key=lambda name: self.alone[matter[0]][name] / self.exact[name])
        each = ", ".join(f"{listed((name,))} {spread_in_words(self.alone[name][k])}" for name in matter[:_MOST_NAMED])
        rest = f" No matter alone: {none}." if none else ""
        return (
            f"**{sentence_start(listed((matter[0],)))} matters most.** {k} is known to "
            f"{spread_in_words(self.exact[k])} with all inputs exact. With one alone uncertain: {each}.{rest}"
        )

    def as_json(self) -> dict[str, Any]:
        """What ``identifiability.what_decides`` of ``summary.json`` holds."""
        return {"sentence": self.sentence.replace("*", ""), **asdict(self)}


def what_decides(problem: Problem, inputs: Sequence[str], theta: Array) -> WhatDecides | None:
    """Look at each input alone; None where no stiffness is known with all exact, or it cannot be computed.

    Parameters
    ----------
    problem
        With all inputs uncertain.
    inputs
        Their names.
    theta
        The mode, shape (d,).
    """
    try:
        fisher = fisher_information(problem, theta)
        joint = fisher.parametrisation.names
        exact, together = fisher.known_to(joint), fisher.known_to((*joint, *inputs))
        alone = {name: fisher.known_to((*joint, name)) for name in inputs}
    except (JointBayesError, np.linalg.LinAlgError):
        return None
    known = sorted((k for k, sd in exact.items() if 0 < sd <= WORTH_SAYING), key=exact.__getitem__)
    if not known:
        return None
    alone = dict(sorted(alone.items(), key=lambda each: -max(each[1][k] / exact[k] for k in known)))
    of_known = {name: {k: sd[k] for k in known} for name, sd in alone.items()}
    return WhatDecides({k: exact[k] for k in known}, of_known, {k: together[k] for k in known})
