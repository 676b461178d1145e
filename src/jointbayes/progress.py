"""Where a long command stands: what each of them tells the callback that it is given as ``progress=``."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from jointbayes.errors import require

#: Default budget of a stage in evaluations of the density, and the share of each of many unknowns.
EVALUATIONS, _OF_EACH = 4_000_000, 330_000


class Budget:
    """Evaluations of the density that a stage may make, so that every stage ends, on every machine in the same place.

    Parameters
    ----------
    most
        Number of evaluations: rows of θ, however many are evaluated together.

    Examples
    --------
    >>> budget = Budget(1000)
    >>> budget.spend(1000)
    >>> budget.is_spent
    True
    """

    def __init__(self, most: int = EVALUATIONS) -> None:
        self.most, self.spent = most, 0

    @classmethod
    def usual(cls, unknowns: int) -> "Budget":
        """The default budget of a search for some number of unknowns, or of their sampling.

        Examples
        --------
        >>> Budget.usual(3).most, Budget.usual(36).most
        (4000000, 11880000)
        """
        return cls(max(EVALUATIONS, _OF_EACH * unknowns))

    def spend(self, evaluations: int) -> None:
        """Count evaluations that were made."""
        self.spent += evaluations

    @property
    def is_spent(self) -> bool:
        """Whether the stage has to end with what there is."""
        return self.spent >= self.most

    def watch(self, evaluations: Callable[[], int]) -> Callable[[], bool]:
        """Return a function that charges what was evaluated since its last call, and says whether the budget is spent.

        Parameters
        ----------
        evaluations
            Gives the number of evaluations so far; those before this call are not charged.
        """
        counted = evaluations()

        def is_spent() -> bool:
            nonlocal counted
            self.spent, counted = self.spent + evaluations() - counted, evaluations()
            return self.is_spent

        return is_spent

    def __str__(self) -> str:
        return f"stopped after {self.most} evaluations of the density (max_evaluations)"


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a command stands; as text it is the line that the command line prints.

    Parameters
    ----------
    stage
        What is being done: ``"searching for the best fit"``, ``"sampling"``, ``"simulating"``.
    text
        What else is to be said of it.
    done, total
        How many steps, simulations, data sets or cases of this stage are done, and how many there will be; of steps and
        simulations an estimate. `total` is None where nothing is counted.
    unit
        What is counted, in the plural.
    earlier
        How many of those that are done were so before the command began.
    elapsed_seconds
        Since the stage began.
    figures
        Further numbers by name: ``"tau"`` and ``"r_hat"`` of a sampler at its last check, ``"failed"``,
        ``"not_converged"`` and ``"running"`` of a campaign.

    Examples
    --------
    >>> print(Progress("sampling", "R̂ = 1.010", done=750, total=900, unit="steps", elapsed_seconds=40.0))
    sampling: 750 of 900 steps, R̂ = 1.010, about 8 s left
    """

    stage: str
    text: str = ""
    done: int = 0
    total: int | None = None
    unit: str = ""
    earlier: int = 0
    elapsed_seconds: float = 0.0
    figures: Mapping[str, float] = field(default_factory=dict)

    @property
    def left_seconds(self) -> float | None:
        """How long the rest of the stage will take at the pace so far; None where that is not known."""
        if self.total is None or self.done <= self.earlier or not self.elapsed_seconds:
            return None
        return self.elapsed_seconds / (self.done - self.earlier) * (self.total - self.done)

    @property
    def details(self) -> str:
        """All but the stage."""
        counted = "" if self.total is None else f"{self.done} of {self.total} {self.unit}"
        left = "" if self.left_seconds is None else f"about {_duration(self.left_seconds)} left"
        return ", ".join(filter(None, (counted, self.text, left)))

    def __str__(self) -> str:
        return ": ".join(filter(None, (self.stage, self.details)))


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


class ProgressCallback(Protocol):
    """What is called with each `Progress`: what it returns is ignored, and what it raises ends the command."""

    def __call__(self, progress: Progress, /) -> object:
        """Tell of it."""


def callback_of(progress: ProgressCallback | bool | None) -> ProgressCallback:
    """The callback that a command is given as ``progress=``: True stands for a bar, None and False for none."""
    if progress is None or isinstance(progress, bool):
        return _show_bar() if progress else tell_nobody
    require(progress, Callable, "progress: found", "True, None, or what is called with each Progress, such as print")
    return progress


def _show_bar() -> ProgressCallback:
    """A callback that shows each stage as a bar of tqdm, in Jupyter or on a terminal; as lines where it is missing."""
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return _print_new_lines()
    bars: list[Any] = []

    def report(progress: Progress) -> None:
        if not bars or bars[-1].desc.removesuffix(": ") != progress.stage:
            for bar in bars:  # a stage that another follows is done, however many steps it took in the end
                bar.n = bar.total or bar.n
                bar.close()
            bars[:] = [tqdm(desc=progress.stage, bar_format="{desc}: {elapsed}{postfix}")]
        bar = bars[-1]
        if progress.total is not None:
            began = bar.start_t
            if progress.total != bar.total:  # a widget takes another total only so
                bar.reset(progress.total)
            bar.bar_format, bar.start_t, bar.n, bar.unit = "", began, progress.done, f" {progress.unit}"
        bar.set_postfix_str(progress.text)

    return report


def _print_new_lines() -> ProgressCallback:
    """A callback that prints each line that is not the one before."""
    last = ""

    def report(progress: Progress) -> None:
        nonlocal last
        if str(progress) != last:
            last = str(progress)
            print(last)

    return report


def tell_nobody(progress: Progress) -> None:
    """Do nothing: the callback of a command that is given none."""
