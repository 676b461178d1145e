"""Ratios of the motions of sensors that measured FRFs show, as data beside the natural frequencies.

They know what frequencies alone do not: a body that is longer than it is said to be has other shapes. Used alone they
would do harm where a clamp's edge is not where it is modelled, so that they are where that has a place.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import JointBayesError
from jointbayes.frf import AssembledShapes
from jointbayes.inference import ErrorSizes, Problem, UsedMode, UsedRatio
from jointbayes.inference.common_errors import has_edge
from jointbayes.measurement import ModeShapes, Observed
from jointbayes.measurement.modal_ratios import MotionRatio, identify_ratios
from jointbayes.measurement.provenance import MeasuredMode
from jointbayes.posterior.rounding import number

#: Ratios that no joint brings the model closer to than this, as a fraction of them or of 0.3, are not used.
FARTHEST_RATIO, _LEAST = 0.3, 0.3


def with_ratios(
    part: Problem, tried: tuple[Array, Array], ratios: Sequence[MotionRatio], used: Sequence[UsedMode]
) -> tuple[list[UsedMode], str]:
    """Modes of a test with ratios of motions in them; and why there are none where they are not believed.

    Parameters
    ----------
    part
        Of that test.
    tried
        Stiffnesses (n, d) and factors (n, q), of which the nearest counts.
    ratios, used
        What was measured, and the mode of the model that each mode is.

    Returns
    -------
    modes, left_out : list, str
        The same modes; a sentence, empty where ratios are used or there are none.
    """
    if not ratios:
        return list(used), ""
    if (nearest := _nearest(part, tried, ratios, [mode.number for mode in used])) > FARTHEST_RATIO:
        dofs = ", ".join(dict.fromkeys(dof for ratio in ratios for dof in (ratio.dof, ratio.reference)))
        where = f" of set-up {part.test.name}" if part.test.name else ""
        return list(used), (
            f"How much {dofs}{where} move beside each other is not used: the nearest model misses it by "
            f"{number(100 * nearest, 2)} %, and {100 * FARTHEST_RATIO:g} % is allowed; look at signs, gains and places "
            "of the sensors."
        )
    return [
        replace(mode, ratios=tuple(UsedRatio(r.dof, r.reference, r.value, r.sd) for r in ratios if r.mode == place))
        for place, mode in enumerate(used)
    ], ""


def measured_ratios(
    part: Problem, resonances: Sequence[MeasuredMode], kept: Sequence[int], sizes: ErrorSizes
) -> tuple[MotionRatio, ...]:
    """Ratios of motions in those resonances of a test of FRFs that are kept, numbered among these.

    Parameters
    ----------
    part
        As it is to be analysed: an edge moves modes as an uncertain length does, and without one there are no ratios.
    resonances, kept
        All that the FRFs show, and the places of those that are modes of the model.
    sizes
        Of the model's errors.
    """
    frfs = part.test.data.frfs
    if frfs is None or not sizes.edge or not has_edge(part):
        return ()
    accelerance = frfs.converted("accelerance")
    try:
        ratios = identify_ratios(accelerance.frf, accelerance.variance, resonances)
    except (JointBayesError, np.linalg.LinAlgError):  # too few lines for so many modes
        return ()
    return tuple(replace(ratio, mode=kept.index(ratio.mode)) for ratio in ratios if ratio.mode in kept)


def _nearest(part: Problem, tried: tuple[Array, Array], ratios: Sequence[MotionRatio], numbers: Sequence[int]) -> float:
    """Largest error of any ratio, as a fraction of it or of 0.3, at the joint where that is least."""
    dofs = tuple(dict.fromkeys(dof for ratio in ratios for dof in (ratio.dof, ratio.reference)))
    stiffness, factors = tried
    model = AssembledShapes(part.test.structures, part.test.joints, max(numbers), dofs)
    shapes = model.modes(part.parametrisation.matrix(stiffness), part.structural(factors)).shapes
    modes = np.array([numbers[ratio.mode] - 1 for ratio in ratios])
    at, below = (np.array([dofs.index(getattr(ratio, end)) for ratio in ratios]) for end in ("dof", "reference"))
    values = np.array([ratio.value for ratio in ratios])
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.abs(shapes[:, modes, at] / shapes[:, modes, below] - values) / np.maximum(np.abs(values), _LEAST)
    return float(np.nanmin(error.max(axis=1), initial=np.inf))


def shapes_of(modes: Sequence[UsedMode]) -> ModeShapes | None:
    """The ratios of modes as shapes relative to what moves most in each; None where there are none."""
    dofs = tuple(dict.fromkeys(ratio.dof for mode in modes for ratio in mode.ratios))
    if not dofs:
        return None
    values, sd = np.full((2, len(modes), len(dofs)), np.nan)
    for row, mode in enumerate(modes):
        for ratio in mode.ratios:
            values[row, dofs.index(ratio.dof)], sd[row, dofs.index(ratio.dof)] = ratio.value, ratio.sd
    reference = tuple(mode.ratios[0].reference if mode.ratios else dofs[0] for mode in modes)
    return ModeShapes(dofs, reference, Observed(values, np.where(np.isnan(sd), 1.0, sd)))
