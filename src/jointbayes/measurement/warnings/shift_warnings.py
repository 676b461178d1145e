"""Resonances that are at other frequencies in one FRF than in another, as those of one linear structure never are."""

from dataclasses import dataclass

import numpy as np

from jointbayes.arrays import Array
from jointbayes.measurement.provenance import MeasurementWarning
from jointbayes.measurement.warnings.clear_frf import ClearFrf

#: A shift counts from this fraction of the half-power width on: of the same FRF, and of FRFs of other responses, whose
#: peaks other modes move.
_SAME, _OTHER = 0.3, 0.5
#: Resonances that must shift one way in FRFs of other responses.
_FEWEST = 3


@dataclass(frozen=True, slots=True, eq=False)
class Peaks:
    """Resolved resonances of one FRF: centre and half-power width, Hz; distance of the lines; and where it is from."""

    where: str
    centre_hz: Array
    width_hz: Array
    step_hz: float

    @classmethod
    def of(cls, where: str, clear: ClearFrf) -> "Peaks":
        """Resonances of at least three lines."""
        f = clear.frequency_hz
        step = float((f[-1] - f[0]) / (f.size - 1))
        peaks = [p for p in clear.resonances if p.lines >= 3]
        return cls(where, np.array([p.centre_hz for p in peaks]), np.array([p.lines * step for p in peaks]), step)


def shift_warning(first: Peaks, other: Peaks, *, same_frf: bool) -> MeasurementWarning | None:
    """Warning where resonances of the second FRF have moved from those of the first; None where they have not.

    Its key is ``"level_dependence"`` of the same FRF twice, and ``"mass_loading"`` of other responses to one force,
    where all that have moved must have moved one way.
    """
    if not first.centre_hz.size or not other.centre_hz.size:
        return None
    distance = np.abs(first.centre_hz[:, None] - other.centre_hz)
    mine, theirs = np.arange(len(distance)), distance.argmin(axis=1)
    width = np.sqrt(first.width_hz * other.width_hz[theirs])
    alike = np.abs(np.log(first.width_hz / other.width_hz[theirs])) < np.log(2)
    near = (distance.argmin(axis=0)[theirs] == mine) & (distance[mine, theirs] < 4 * width) & alike
    shift = (other.centre_hz[theirs] - first.centre_hz)[near]
    reach = (_SAME if same_frf else _OTHER) * width[near] + max(first.step_hz, other.step_hz)
    moved = np.abs(shift) > reach
    one_way = min((moved & (shift > 0)).sum(), (moved & (shift < 0)).sum()) == 0
    if not moved.any() or (not same_frf and (moved.sum() < max(_FEWEST, near.sum() / 2) or not one_way)):
        return None
    relative = 100 * shift[moved] / first.centre_hz[near][moved]
    largest = int(np.argmax(np.abs(relative)))
    at, change = first.centre_hz[near][moved][largest], abs(relative[largest])
    which = "lower" if relative[largest] < 0 else "higher"
    where = (
        f"{int(moved.sum())} of {int(near.sum())} resonances are elsewhere, that at {at:.5g} Hz {change:.2g} % {which}"
    )
    if same_frf:
        return MeasurementWarning(
            "level_dependence",
            f"the same FRF is there twice, and {where}: the structure depends on the level of the force, or changed",
            "measure at one level, the lower the better, or give each level a set-up of its own",
        )
    return MeasurementWarning(
        "mass_loading",
        f"over the same force {where}, all of these the same way: the structure changed between the runs, as by the "
        "mass of a roving accelerometer, the temperature or the level",
        "state accelerometer_mass_g in [data.channels], which takes it out, or measure all responses at once",
    )
