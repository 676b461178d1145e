"""What to measure next: page one's "Next" in full, every further measurement that was looked at in its rank."""

from dataclasses import asdict, dataclass
from typing import Any

from jointbayes.case.case import AnyCase
from jointbayes.inference import Problem
from jointbayes.posterior import Posterior
from jointbayes.posterior.fisher import spread_in_words
from jointbayes.posterior.forecast import NextStep
from jointbayes.posterior.posterior import gather_knowledge
from jointbayes.progress import Progress, ProgressCallback, callback_of
from jointbayes.report.model import Table
from jointbayes.reproducibility import one_blas_thread
from jointbayes.rounding import json_ready, number
from jointbayes.workflow import sample


@dataclass(frozen=True, slots=True)
class Plan:
    """Further measurements, ranked by how well a stiffness would be known after each.

    Parameters
    ----------
    steps
        Forecasts of one stiffness, the best measurement first; empty where nothing can be forecast.
    advice
        What page one of the report says under "Next": the first step, or what comes before any further measurement.
    converged
        Whether the sampler of the present posterior has converged.
    """

    steps: tuple[NextStep, ...]
    advice: str
    converged: bool

    def __repr__(self) -> str:
        return "\n".join(self.lines)

    @property
    def table(self) -> Table:
        """A row for each measurement: price, how well the stiffness would be known, and the gain."""
        quantity, now = self.steps[0].quantity, spread_in_words(self.steps[0].sd_before)
        rows = [(step.words, step.price, spread_in_words(step.sd_after), number(step.gain, 2)) for step in self.steps]
        return Table(
            f"Further measurements, and how well {quantity} would then be known",
            ("Measurement", "Price", f"{quantity} known to", "Gain"),
            (*rows, ("(now)", "", now, "1")),
            align="llll",
            note="95 %, linearised. Gain: how many times narrower.",
        )

    @property
    def lines(self) -> tuple[str, ...]:
        """What is printed: the advice, then the table."""
        return (self.advice, *((*self.table.lines(), self.table.note) if self.steps else ()))

    def as_json(self) -> dict[str, Any]:
        """The numbers, JSON-ready."""
        steps = [asdict(step) | {"gain": step.gain, "is_worth_it": step.is_worth_it} for step in self.steps]
        return json_ready({"advice": self.advice, "converged": self.converged, "steps": steps})


@one_blas_thread()
def plan(
    given: AnyCase | Problem | Posterior, *, seed: int | None = None, progress: ProgressCallback | bool | None = None
) -> Plan:
    """Rank further measurements by how well the stiffness that is known least would then be known.

    The first row is what page one of the report says under "Next", under the same premises.

    Parameters
    ----------
    given
        A case or a problem, which is sampled first, or a posterior. The data in hand may be FRFs or modes.
    seed
        Seed of the run; by default the case's, 1 of a problem.
    progress
        As for `jointbayes.sample`.

    Raises
    ------
    JointBayesError
        As from `jointbayes.sample`.
    """
    tell = callback_of(progress)
    posterior = given if isinstance(given, Posterior) else sample(given, seed=seed, progress=tell)
    tell(Progress("looking at further measurements"))
    knowledge = gather_knowledge(posterior)
    return Plan(knowledge.next_steps, knowledge.advice, posterior.converged)
