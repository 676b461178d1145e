"""Ratios of the motions of sensors that measured FRFs show, as data beside the natural frequencies.

They know what frequencies alone do not: a body that is longer than it is said to be has other shapes. Used alone they
would do harm where a clamp's edge is not where it is modelled, so that they are where that has a place.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointbayes.errors import JointBayesError
from jointbayes.frf import AssembledShapes
from jointbayes.inference import ErrorSizes, Problem, UsedMode
from jointbayes.inference.common_errors import has_edge
from jointbayes.inference.noise.model_error import LEAST_COMPONENT
from jointbayes.posterior.rounding import number
from vibrecords import ModeShapes, Observed
from vibrecords.arrays import Array
from vibrecords.modal_ratios import MotionRatio, identify_ratios
from vibrecords.provenance import MeasuredMode

#: Ratios that no joint brings the model closer to than this, as a fraction of them or of 0.3, are not used.
FARTHEST_RATIO = 0.3


def with_ratios(
    part: Problem, tried: tuple[Array, Array], ratios: Sequence[Sequence[MotionRatio]], used: Sequence[UsedMode]
) -> tuple[list[UsedMode], str]:
    """Modes of a test with ratios of motions in them; and why there are none where they are not believed.

    Parameters
    ----------
    part
        Of that test.
    tried
        Stiffnesses (n, d) and factors (n, q), of which the nearest counts.
    ratios, used
        What was measured in each mode, and the mode of the model that it is.

    Returns
    -------
    modes, left_out : list, str
        The same modes; a sentence, empty where ratios are used or there are none.
    """
    each = [(mode.number, ratio) for mode, of_mode in zip(used, ratios, strict=True) for ratio in of_mode]
    if not each:
        return list(used), ""
    dofs = tuple(dict.fromkeys(dof for _, ratio in each for dof in (ratio.dof, ratio.reference)))
    if (nearest := _nearest(part, tried, each, dofs)) > FARTHEST_RATIO:
        where = f" of set-up {part.test.name}" if part.test.name else ""
        return list(used), (
            f"How much {', '.join(dofs)}{where} move beside each other is not used: the nearest model misses it by "
            f"{number(100 * nearest, 2)} %, and {100 * FARTHEST_RATIO:g} % is allowed; look at signs, gains and places "
            "of the sensors."
        )
    return [replace(mode, ratios=tuple(of_mode)) for mode, of_mode in zip(used, ratios, strict=True)], ""


def measured_ratios(
    part: Problem, resonances: Sequence[MeasuredMode], kept: Sequence[int], sizes: ErrorSizes
) -> Sequence[Sequence[MotionRatio]]:
    """Ratios of motions in each of those resonances of a test of FRFs that are kept.

    Parameters
    ----------
    part
        As it is to be analysed: an edge moves modes as an uncertain length does, and without one there are no ratios.
    resonances, kept
        All that the FRFs show, and the places of those that are modes of the model.
    sizes
        Of the model's errors.
    """
    frfs, none = part.test.data.frfs, [()] * len(kept)
    if frfs is None or not sizes.edge or not has_edge(part):
        return none
    accelerance = frfs.converted("accelerance")
    try:
        ratios = identify_ratios(accelerance.frf, accelerance.variance, resonances)
    except (JointBayesError, np.linalg.LinAlgError):  # too few lines for so many modes
        return none
    return [ratios[place] for place in kept]


def _nearest(
    part: Problem, tried: tuple[Array, Array], each: Sequence[tuple[int, MotionRatio]], dofs: tuple[str, ...]
) -> float:
    """Largest error of any ratio, as a fraction of it or of 0.3, at the joint where that is least."""
    stiffness, factors = tried
    modes = np.array([number_of for number_of, _ in each]) - 1
    model = AssembledShapes(part.test.structures, part.test.joints, int(modes.max()) + 1, dofs)
    shapes = model.modes(part.parametrisation.matrix(stiffness), part.structural(factors)).shapes
    at, below = np.array([(dofs.index(ratio.dof), dofs.index(ratio.reference)) for _, ratio in each]).T
    values = np.array([ratio.value for _, ratio in each])
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.abs(shapes[:, modes, at] / shapes[:, modes, below] - values) / np.maximum(
            np.abs(values), LEAST_COMPONENT
        )
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
