"""Virtual tests: records that hold the truth of a case, with the noise that is stated."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import jointbayes as jb
from jointbayes.frf import DirectSolve, Ports
from tests.conftest import TABLE_3, cheap_text, edited, pair_matrix
from tests.one_line import refused
from tests.simulated import noisy_frf
from tests.virtual_test import Truth, VirtualTest, simulate
from vibrecords import CoherenceNoise, FrfSet, RelativeNoise
from vibrecords.records import FrfRecord, Record, TimeRecord
from vibrecords.signals.hits import HitSettings, find_hits

NOISE = "relative = 0.008 \nfloor = 0.0016"


def virtual_case(*changes: tuple[str, str]) -> jb.Case:
    return jb.case_from_text("virtual", edited(cheap_text(), *changes))


def as_set(records: list[Record]) -> FrfSet:
    """The set of records that make one row of outputs."""
    assert all(isinstance(record, FrfRecord) for record in records)
    values = np.stack([record.values for record in records], axis=1)[:, :, None]
    coherence = np.stack([record.coherence for record in records], axis=1)[:, :, None]
    first = records[0]
    labels = tuple(record.response for record in records)
    return FrfSet(first.frequency_hz, values, labels, (first.reference,), first.quantity, coherence, first.averages)


@pytest.mark.parametrize(("quantity", "unit"), [("receptance", "m/N"), ("accelerance", "(m/s^2)/N")])
def test_the_frfs_of_a_virtual_test_are_those_of_the_truth(quantity, unit):
    case = virtual_case(
        ('quantity = "receptance"', f'quantity = "{quantity}"'),
        ("relative = 0.008", "relative = 1e-9"),
        ("floor = 0.0016", "floor = 1e-12"),
        ("k11 = 5.05e9", "gain = 1.5\nk11 = 5.05e9"),
    )
    records = simulate(case, VirtualTest(extra_outputs=("3:y", "1:rz")), seed=1)
    assert [(r.response, r.reference) for r in records] == [
        (response, "Point:5:Y+") for response in ("Point:5:Y+", "Point:3:Y+", "Point:1:RZ+")
    ]
    lines = np.array(case.spec.data.lines_hz())
    ports = Ports(lines, ("5:y", "3:y", "1:rz"), ("5:y",))
    body = case.problem.test.structures_of_data.at(ports.outputs, lines[-1])
    exact = DirectSolve(body.nominal, case.problem.test.joints, ports).receptance(pair_matrix(TABLE_3))[0]
    factor = (2j * np.pi * lines) ** (2 * (quantity == "accelerance"))
    for i, record in enumerate(records):
        assert_array_equal(record.frequency_hz, lines)
        assert (record.quantity, record.unit, record.averages) == (quantity, unit, 10)
        expected = 1.5 * exact[:, i, 0] * factor  # from another mesh
        assert_allclose(record.values, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())


def test_accelerometers_load_the_virtual_structure():
    damping = ('law = "modal"', 'law = "loss_factor"'), ("ratio = 0.01", "loss_factor = 0.01")
    heavy = virtual_case(*damping, ("k11 = 5.05e9", "accelerometer_mass_g = 50.0\nk11 = 5.05e9"))
    lines = np.array(heavy.spec.data.lines_hz())
    loaded, bare = (Truth(case).frf(lines, ("5:y",)).values[:, 0, 0] for case in (heavy, virtual_case(*damping)))
    # exact mass loading at a drive point: 1/H' = 1/H − ω² m
    assert_allclose(1 / loaded, 1 / bare - (2 * np.pi * lines) ** 2 * 0.05, rtol=1e-6)


@pytest.mark.parametrize("averages", [2, 5, 50])
def test_noise_and_coherence_are_those_of_h1_from_the_averages_themselves(averages):
    rng = np.random.default_rng(averages)
    lines, law = 20_000, RelativeNoise(0.2, 0.0)
    true = FrfSet(1.0 + np.arange(lines), np.full((lines, 1, 1), 2 - 1j), ("1:y",), ("1:y",))
    short = noisy_frf(true, law, averages, rng)
    sd = np.sqrt(averages * law.variance(true.values)[0, 0, 0] / 2)
    y = 2 - 1j + sd * (rng.standard_normal((averages, lines)) + 1j * rng.standard_normal((averages, lines)))
    coherence = np.abs(y.sum(0)) ** 2 / (averages * (np.abs(y) ** 2).sum(0))
    for quantile in (0.05, 0.5, 0.95):
        assert np.quantile(short.coherence, quantile) == pytest.approx(np.quantile(coherence, quantile), rel=0.02)
    assert np.mean(np.abs(short.values - (2 - 1j)) ** 2) == pytest.approx(law.variance(true.values)[0, 0, 0], rel=0.03)
    assert jb.coherence_variance(short).mean() == pytest.approx(law.variance(true.values)[0, 0, 0], rel=0.03)


def test_one_average_has_no_coherence():
    true = FrfSet([1.0, 2.0], np.ones((2, 1, 1)), ("1:y",), ("1:y",))
    single = noisy_frf(true, RelativeNoise(0.1, 0.0), 1, np.random.default_rng(1))
    assert (single.coherence, single.averages) == (None, 1)


def test_averages_are_those_of_the_test_then_of_the_noise():
    case = virtual_case(("relative = 0.008", "coherence = 0.9\naverages = 7"))
    assert simulate(case)[0].averages == 7
    assert simulate(case, VirtualTest(averages=3))[0].averages == 3
    case = virtual_case(("relative = 0.008", "coherence = 0.9\naverages = 7"), ("floor = 0.0016", "floor = 0"))
    assert as_set(simulate(case)).coherence.mean() == pytest.approx(0.9, abs=0.02)


def test_the_same_seed_gives_the_same_test():
    case = virtual_case()
    first, again, other = (simulate(case, seed=seed)[0].values for seed in (1, 1, 2))
    assert first.tobytes() == again.tobytes()
    assert (first != other).all()


def test_a_case_without_a_truth_cannot_be_simulated(frequency_case):
    with pytest.raises(jb.CaseError, match=r'frequencies:\d+: data.kind: found "natural_frequencies"; expected'):
        simulate(frequency_case, seed=1)


def test_coherence_noise_of_the_case_is_used_as_stated():
    true = FrfSet([1.0, 2.0], np.ones((2, 1, 1)), ("1:y",), ("1:y",))
    rng = np.random.default_rng(5)
    values = np.array([noisy_frf(true, CoherenceNoise(0.8, 10), 10, rng).values[:, 0, 0] for _ in range(4000)])
    assert np.mean(np.abs(values - 1) ** 2) == pytest.approx(0.2 / 8, rel=0.06)


# time histories


@pytest.mark.parametrize(("method", "quantity"), [
    ("impact", "receptance"),
    ("shaker", "accelerance"),
    *(pytest.param(*one, marks=pytest.mark.science) for one in (("impact", "mobility"), ("impact", "accelerance"),
     ("shaker", "receptance"), ("shaker", "mobility"))),
])  # fmt: skip
def test_the_frfs_of_simulated_records_are_those_of_the_truth_within_their_noise(method, quantity):
    case = virtual_case(('quantity = "receptance"', f'quantity = "{quantity}"'))
    found = as_set(simulate(case, VirtualTest(method, averages=12, extra_outputs=("3:y",)), seed=4))
    assert found.outputs == ("Point:5:Y+", "Point:3:Y+")
    lines = np.array(case.spec.data.lines_hz())
    assert_allclose(found.frequency_hz, lines, rtol=1e-9)
    z = np.abs(found.values - Truth(case).frf(lines, ("5:y", "3:y")).values) ** 2 / jb.coherence_variance(found)
    # Student-t with 2(n − 1) = 22 degrees of freedom: mean 22/20
    assert z.mean() == pytest.approx(1.1, abs=0.25)


@pytest.mark.parametrize(
    ("law", "key"), [("loss_factor", "loss_factor = 0.02"), ("rayleigh", "alpha_per_s = 20.0\nbeta_s = 1e-6")]
)
def test_other_laws_of_damping_are_tested_as_well(law, key):
    damping = ('law = "modal"', f'law = "{law}"'), ("ratio = 0.01", key)
    case = virtual_case(*damping, ('"receptance"', '"accelerance"'))
    found = as_set(simulate(case, VirtualTest("impact"), seed=4))
    z = np.abs(found.values - Truth(case).frf(found.frequency_hz, ("5:y",)).values) ** 2 / jb.coherence_variance(found)
    assert z.mean() == pytest.approx(1.125, abs=0.3)


def test_the_decay_rate_is_that_of_the_slowest_mode():
    assert Truth(virtual_case()).decay_rate == pytest.approx(0.01 * 2 * np.pi * 121.5, rel=0.01)
    damping = ('law = "modal"', 'law = "rayleigh"'), ("ratio = 0.01", "alpha_per_s = 20.0\nbeta_s = 0.0")
    assert Truth(virtual_case(*damping)).decay_rate == pytest.approx(10.0)


def test_time_histories_are_written_hit_by_hit_with_double_hits_and_overloads():
    test = VirtualTest("impact", "time", averages=2, double_hits=1, overloads=1, extra_outputs=("3:y",))
    records = simulate(virtual_case(), test, seed=1)
    assert all(isinstance(record, TimeRecord) for record in records)
    assert [(r.hit, r.channel, r.quantity, r.unit) for r in records[:3]] == [
        (1, "Point:5:Y+", "force", "N"),
        (1, "Point:5:Y+", "displacement", "m"),
        (1, "Point:3:Y+", "displacement", "m"),
    ]
    assert [record.hit for record in records] == [1] * 3 + [2] * 3 + [3] * 3 + [4] * 3
    hits = find_hits([r for r in records if r.quantity == "force"], HitSettings())
    assert sorted(hit.reason.split(",")[0] for hit in hits) == ["", "", "double hit", "force overloaded"]
    assert {(record.values.size, record.sample_rate_hz) for record in records} == {(28_000, 20_000.0)}


def test_a_structure_without_damping_rings_for_ever_and_is_refused():
    undamped = virtual_case(("ratio = 0.01", "ratio = 0.0"), ("f_min_hz = 20.0", "f_min_hz = 21.3"))
    refused(lambda: simulate(undamped, VirtualTest("impact")), jb.MeasurementError, "without damping")
