"""From the table of a case whose data are modes to the measurement that it states."""

import numpy as np

from jointbayes.case.schema.modes import ModesSpec
from jointbayes.measurement import ModeMeasurement, ModeShapes, Observed

Rows = tuple[tuple[float, ...], ...]


def modes_of(spec: ModesSpec) -> ModeMeasurement:
    """The modes that a case states."""
    damping = shapes = None
    if spec.damping_ratios is not None:
        damping = _observed(spec.damping_ratios, spec.damping_sd_relative, spec.damping_sd)
    if (stated := spec.shapes) is not None:
        reference = stated.reference[0] if len(stated.reference) == 1 else stated.reference
        shapes = ModeShapes(stated.dofs, reference, Observed(np.array(stated.components), np.array(stated.sd)[:, None]))
    rows = spec.frequencies_hz or spec.eigenvalues
    assert rows is not None
    of_eigenvalues = spec.eigenvalues is not None
    frequency = _observed(rows, spec.sd_relative, spec.eigenvalue_sd if of_eigenvalues else spec.sd_hz)
    return ModeMeasurement(frequency, damping, shapes, spec.numbers or (), spec.match, of_eigenvalues)


def _observed(rows: Rows, relative: tuple[float, ...], absolute: tuple[float, ...]) -> Observed:
    values = np.array(rows)
    # a fraction of the mean over repetitions: the spread does not depend on what one of them happened to give
    seen = ~np.isnan(values)
    mean = np.where(seen, values, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    return Observed(values, np.hypot(np.array(relative) * mean, absolute))
