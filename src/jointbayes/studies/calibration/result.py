"""What a calibration found: ranks and coverage of each quantity, judged together."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.studies.calibration.data_set import DRAWS, DataSet
from jointbayes.studies.calibration.ranks import QuantityCalibration, judge

#: Share of right analyses that fail, at most: over all quantities together, each at this over their number.
FALSE_ALARM = 0.01
#: Below this the verdict says that a second seed should be looked at.
SUSPICIOUS = 0.05
_SHOWN = 3  # different errors in a summary


@dataclass(frozen=True, eq=False)
class Calibration:
    """Ranks of truths over many simulated data sets of one case, and whether they are what they should be.

    Parameters
    ----------
    name
        Of the case whose analysis was calibrated.
    source
        Name of the case that gave truths and data, where it is another; empty where it is the same.
    seed
        Of the calibration.
    names
        Quantities that were ranked.
    data_sets
        All of them, in order; those whose analysis failed as well.

    Raises
    ------
    ModelError
        If not one data set has a posterior.
    """

    name: str
    source: str
    seed: int
    names: tuple[str, ...]
    data_sets: tuple[DataSet, ...]

    def __post_init__(self) -> None:
        if not self.analysed:
            why = f": {self.errors[0]}" if self.errors else ""
            raise ModelError(
                f"calibrate: found that not one of {len(self.data_sets)} data sets of {self.name} could be analysed"
                f"{why}; expected posteriors; run the case itself first"
            )

    def __repr__(self) -> str:
        return f"Calibration({self.name!r}, {len(self.data_sets)} data sets): {self.verdict}"

    @cached_property
    def analysed(self) -> tuple[DataSet, ...]:
        """Data sets that have a posterior, converged or not."""
        return tuple(one for one in self.data_sets if not one.error)

    @property
    def failed(self) -> int:
        """Data sets whose analysis ended in an error."""
        return len(self.data_sets) - len(self.analysed)

    @property
    def errors(self) -> tuple[str, ...]:
        """The different errors."""
        return tuple(dict.fromkeys(one.error for one in self.data_sets if one.error))

    @property
    def not_converged(self) -> int:
        """Data sets whose sampler did not meet its stop rule; they are ranked as the others."""
        return sum(not one.converged for one in self.analysed)

    @cached_property
    def quantities(self) -> tuple[QuantityCalibration, ...]:
        """Each quantity with its band, which all of them keep together in 99 % of right analyses at least."""
        each = range(len(self.names))
        return judge(
            {self.names[i]: self._column("rank", i) for i in each},
            {self.names[i]: np.stack([self._column("low", i), self._column("high", i)], axis=-1) for i in each},
            {self.names[i]: self._column("truth", i) for i in each},
            DRAWS,
            1 - FALSE_ALARM / len(self.names),
            self.failed,
        )

    def _column(self, field: str, i: int) -> Array:
        return np.array([getattr(one, field)[i] for one in self.analysed])

    @property
    def p_value(self) -> float:
        """Probability, at most, that a right analysis looks as bad in its worst quantity: Bonferroni's bound."""
        return min(1.0, len(self.quantities) * min(one.p_value for one in self.quantities))

    @property
    def outside(self) -> tuple[QuantityCalibration, ...]:
        """Quantities whose ranks leave their band."""
        return tuple(one for one in self.quantities if not one.inside_band)

    @property
    def passed(self) -> bool:
        """Whether the ranks of all quantities stay inside their bands."""
        return not self.outside

    @property
    def verdict(self) -> str:
        """The outcome in a sentence."""
        count, of = len(self.data_sets), f" of {self.source}" if self.source else ""
        if self.passed:
            near = (
                f" That is below {SUSPICIOUS:g}: look at another seed, or at more data sets."
                if self.p_value < SUSPICIOUS
                else ""
            )
            return (
                f"Calibrated: over {count} data sets{of} the ranks of all {len(self.names)} quantities stay inside "
                f"their bands (p = {self.p_value:.2g}; a right analysis falls below {FALSE_ALARM:g} in at most 1 of "
                f"{1 / FALSE_ALARM:.0f} calibrations).{near}"
            )
        found = "; ".join(f"{one.name}: {one.finding}" for one in self.outside)
        return (
            f"NOT CALIBRATED: over {count} data sets{of} the ranks of {len(self.outside)} of {len(self.names)} "
            f"quantities leave their bands (p = {self.p_value:.2g}). {found}."
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """What else has to be known of it, in sentences."""
        notes = []
        if self.failed:
            shown = "; ".join(self.errors[:_SHOWN])
            notes.append(
                f"{self.failed} of {len(self.data_sets)} analyses failed, and count as intervals that missed, with "
                f"ranks at the end that looks worse: {shown}."
            )
        if self.not_converged:
            notes.append(
                f"{self.not_converged} of {len(self.data_sets)} samplers did not converge. Their ranks count as the "
                "others: leaving them out would leave out certain truths."
            )
        return tuple(notes)

    def summary(self) -> dict[str, Any]:
        """The numbers as JSON: what ``summary.json`` of a calibration holds."""
        analysed: Sequence[DataSet] = self.analysed
        return {
            "schema_version": 1,
            "case": self.name,
            "data_from": self.source or None,
            "seed": self.seed,
            "data_sets": len(self.data_sets),
            "failed": self.failed,
            "errors": list(self.errors[:_SHOWN]),
            "converged": len(analysed) - self.not_converged,
            "mode_agrees": sum(one.mode_agrees for one in analysed),
            "median_ess": float(np.median([one.ess for one in analysed])),
            "median_seconds": float(np.median([one.seconds for one in self.data_sets])),
            "total_seconds": float(np.sum([one.seconds for one in self.data_sets])),
            "ranked_among": DRAWS,
            "passed": self.passed,
            "p_value": self.p_value,
            "false_alarm": FALSE_ALARM,
            "verdict": self.verdict,
            "notes": list(self.notes),
            "quantities": {one.name: _entry(one) for one in self.quantities},
        }


def _entry(one: QuantityCalibration) -> dict[str, Any]:
    return {
        "inside_band": one.inside_band,
        "p_value": one.p_value,
        "largest_deviation": one.largest_deviation,
        "finding": None if one.inside_band else one.finding,
        "coverage95": one.coverage.share,
        "covered": one.coverage.inside,
        "coverage_interval95": list(one.coverage.interval95),
    }
