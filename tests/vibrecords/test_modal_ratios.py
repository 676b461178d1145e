"""Ratios of motions from FRFs that are sums of modes of known shapes, with noise of known size."""

import numpy as np
import pytest

from vibrecords import FrfSet
from vibrecords.modal_fit import identify_modes
from vibrecords.modal_ratios import _ratios, identify_ratios

HZ = np.arange(20.0, 500.0, 1.0)
MODES_HZ, DAMPING = np.array([80.0, 210.0, 390.0]), np.array([0.01, 0.008, 0.012])
SHAPES = np.array([[0.1, 0.5, 1.0], [-0.6, -0.8, 1.0], [1.0, 0.02, -0.7]])  # (modes, DOFs)
DOFS = ("2:y", "6:y", "11:y")


def measured(outputs, inputs, sd=3e-3, seed=1):
    """Accelerances of these modes, and a mode above the band, with noise."""
    omega, natural = 2 * np.pi * HZ[:, None], 2 * np.pi * np.append(MODES_HZ, 900.0)
    each = -(omega**2) / (natural**2 - omega**2 + 2j * np.append(DAMPING, 0.01) * natural * omega)
    shapes = np.vstack([SHAPES, [0.3, -0.8, 1.0]])
    out, into = ([DOFS.index(dof) for dof in some] for some in (outputs, inputs))
    values = np.einsum("fm,mo,mi->foi", each, shapes[:, out], shapes[:, into])
    rng = np.random.default_rng(seed)
    sd = np.broadcast_to(np.reshape(sd, (-1, 1)), values.shape[1:])
    noise = sd * np.sqrt(0.5) * (rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape))
    variance = np.broadcast_to(sd**2, values.shape)
    return FrfSet(HZ, values + noise, outputs, inputs, quantity="accelerance"), variance


@pytest.mark.parametrize(("outputs", "inputs", "sd"), [
    (DOFS, ("11:y",), 3e-3),
    (("11:y",), DOFS, 3e-3),
    (DOFS, ("11:y", "2:y"), 3e-3),
    (DOFS, ("11:y",), (3e-3, 3e-4, 6e-3)),  # what moves most is the noisiest
])  # fmt: skip
def test_ratios_are_those_of_the_shapes_within_their_standard_deviations(outputs, inputs, sd):
    errors, biggest = [], {0: "11:y", 1: "11:y", 2: "2:y"}
    for seed in range(12):
        frf, variance = measured(outputs, inputs, sd, seed=seed)
        each = identify_ratios(frf, variance, identify_modes(frf, variance))
        found = [(mode, ratio) for mode, ratios in enumerate(each) for ratio in ratios]
        assert {(mode, ratio.reference) for mode, ratio in found} == set(biggest.items())
        assert len(found) == 6
        for mode, ratio in found:
            shape = SHAPES[mode]
            true = shape[DOFS.index(ratio.dof)] / shape[DOFS.index(ratio.reference)]
            assert ratio.value == pytest.approx(true, abs=0.02)
            errors.append((ratio.value - true) / ratio.sd)
    assert 0.75 < np.std(errors) < 1.3  # of 72


def test_what_turns_has_no_ratio_and_one_sensor_has_none():
    frf, variance = measured(DOFS, ("11:y",))
    modes = identify_modes(frf, variance)
    turning = FrfSet(frf.frequency_hz, frf.values, ("2:y", "6:rz", "11:y"), frf.inputs, quantity="accelerance")
    assert {ratio.dof for ratios in identify_ratios(turning, variance, modes) for ratio in ratios} == {"2:y", "11:y"}
    only = turning.select(("6:rz", "11:y"), ("11:y",))
    assert identify_ratios(only, variance[:, 1:], modes) == ((), (), ())
    assert identify_ratios(frf, variance, ()) == ()


def test_a_ratio_is_no_better_known_than_what_it_is_taken_of():
    """Amplitudes that scatter: the ratio has the error of both, that of the reference in proportion to the ratio."""
    amplitude, sd = np.array([[2.0], [1.0]]), np.array([[0.1], [0.02]])
    drawn = amplitude[..., None] + sd[..., None] * np.random.default_rng(1).standard_normal((2, 1, 100_000))
    (ratio,) = _ratios(("tip", "middle"), amplitude, sd)
    assert (ratio.dof, ratio.reference, ratio.value) == ("middle", "tip", 0.5)
    assert ratio.sd == pytest.approx((drawn[1] / drawn[0]).std(), rel=0.02)
