"""The mass of accelerometers is taken out of FRFs exactly where the file has what this needs."""

from dataclasses import replace

import numpy as np
import pytest

from tests.vibrecords.rod import receptance
from vibrecords import FrfData, FrfSet, quantity_factor
from vibrecords.accelerometer import remove_accelerometers
from vibrecords.errors import MeasurementError

LINES = np.linspace(30.0, 2400.0, 60)
TIP, MIDDLE = "5:y", "3:y"
GRAM = 1e-3


def without(frf: FrfSet, masses: dict[str, float], **how: bool) -> FrfSet:
    return remove_accelerometers(FrfData(frf, np.ones(frf.values.shape)), masses, **how).frf


def measured(masses: dict[str, float], outputs=(TIP, MIDDLE), inputs=(TIP, MIDDLE), quantity="accelerance") -> FrfSet:
    values = receptance(LINES, outputs, inputs, elements=4, loss_factor=0.02, masses=masses)
    return FrfSet(LINES, values * quantity_factor(LINES, quantity)[:, None, None], outputs, inputs, quantity)


@pytest.mark.parametrize("quantity", ["receptance", "mobility", "accelerance"])
@pytest.mark.parametrize("masses", [{TIP: 5 * GRAM}, {MIDDLE: 8 * GRAM}, {TIP: 5 * GRAM, MIDDLE: 8 * GRAM}])
def test_frfs_of_the_bare_structure_are_recovered(masses, quantity):
    frf = measured(masses, quantity=quantity)
    found = without(frf, masses)
    bare = measured({}, quantity=quantity)
    assert np.abs(frf.values / bare.values - 1).max() > 0.1  # the mass matters
    np.testing.assert_allclose(found.values, bare.values, rtol=1e-8)


def test_reciprocity_stands_in_for_a_force_at_the_sensor():
    frf = measured({TIP: 5 * GRAM}, inputs=(TIP,))
    found = without(frf, {TIP: 5 * GRAM})
    np.testing.assert_allclose(found.values, measured({}, inputs=(TIP,)).values, rtol=1e-8)


def test_a_roving_sensor_loads_only_its_own_frf():
    each = {dof: measured({dof: 6 * GRAM}, outputs=(dof,)).values for dof in (TIP, MIDDLE)}
    frf = FrfSet(LINES, np.concatenate([each[TIP], each[MIDDLE]], axis=1), (TIP, MIDDLE), (TIP, MIDDLE), "accelerance")
    masses = dict.fromkeys((TIP, MIDDLE), 6 * GRAM)
    found = without(frf, masses, roving=True)
    np.testing.assert_allclose(found.values, measured({}).values, rtol=1e-8)
    fixed = without(frf, masses)
    assert np.abs(fixed.values / measured({}).values - 1).max() > 0.05


def test_a_mass_without_a_force_at_its_dof_cannot_be_taken_out():
    frf = measured({MIDDLE: 8 * GRAM}, inputs=(TIP,))
    with pytest.raises(MeasurementError, match=r"no FRF of 3:y over a force at 3:y.*structure.accelerometer_mass_g"):
        without(frf, {MIDDLE: 8 * GRAM})


def test_no_mass_changes_nothing():
    frf = measured({})
    as_measured = FrfData(frf, np.ones(frf.values.shape))
    assert remove_accelerometers(as_measured, {TIP: 0.0}) is as_measured


def test_the_variance_is_that_of_noise_sent_through_the_correction():
    masses = {TIP: 5 * GRAM, MIDDLE: 8 * GRAM}
    frf = measured(masses)
    variance = (0.002 * np.abs(frf.values)) ** 2
    rng = np.random.default_rng(3)
    corrected = remove_accelerometers(FrfData(frf, variance), masses)
    clean, stated = corrected.frf, corrected.variance
    scatter = np.zeros(variance.shape)
    count = 2000
    for _ in range(count):
        noise = rng.standard_normal((2, *frf.values.shape))
        noisy = replace(frf, values=frf.values + np.sqrt(variance / 2) * (noise[0] + 1j * noise[1]))
        scatter += np.abs(_values_without(noisy, masses) - clean.values) ** 2 / count
    assert np.abs(scatter / stated - 1).mean() < 0.03  # √(1/2000) = 2.2 %
    assert np.median(scatter / stated) == pytest.approx(1.0, abs=0.01)


def _values_without(frf: FrfSet, masses: dict[str, float]) -> np.ndarray:
    """Sherman-Morrison, one mass after the other: a second way to the same FRFs."""
    values = frf.converted("receptance").values
    omega2 = (2 * np.pi * LINES) ** 2
    for dof, mass in masses.items():
        k = frf.outputs.index(dof)
        change = values[:, :, k, None] * values[:, k, None, :] * (omega2 * mass)[:, None, None]
        values = values - change / (1 + omega2 * mass * values[:, k, k])[:, None, None]
    return values * quantity_factor(LINES, frf.quantity)[:, None, None]
