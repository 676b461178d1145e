"""The study of modes whose model is wrong as stated: its exact beams, what is kept, and what is counted."""

import numpy as np
import pytest
from benchmarks import model_error
from benchmarks.exact_beam import ExactBeam, circle

import jointbayes as jb
from jointbayes.frf import AssembledShapes, NaturalFrequencies

pytestmark = pytest.mark.docs


@pytest.mark.parametrize("scale", [1e-2, 1.0, 1e4])
def test_frequencies_and_antiresonances_are_those_of_a_beam_without_a_mesh(scale):
    matrix = scale * np.array([[3e7, 2e5], [2e5, 4e4]])
    k11, k12, k22 = matrix[0, 0], matrix[0, 1], matrix[1, 1]
    points = {1: 0.0, 6: 0.1915, 11: 0.383}
    beam = ExactBeam(0.383, circle(0.025, 0.3), 2.1e11, 0.3, 7800.0, points, (k11, k12, k22))
    frequency, antiresonance = model_error.exact_modes(beam, 4, 3)
    test = jb.load_case(model_error.BASE).problem.test
    modelled = NaturalFrequencies(test.structures, test.joints, 4).frequency_hz(matrix)[0]
    np.testing.assert_allclose(modelled, frequency, rtol=1e-8)
    model = AssembledShapes(test.structures, test.joints, 1, (), [("11:y", number) for number in (1, 2, 3)])
    held = model.modes(matrix).zeros_hz[0]
    np.testing.assert_allclose(held, antiresonance, rtol=5e-7)  # the exact one is held by its 1000 tons


def test_every_kind_measures_the_same_beam():
    cases = {kind: model_error.case_of(kind, 3) for kind in model_error.KINDS}
    assert len({tuple(truth.values()) for _, truth in cases.values()}) == 1
    data = [case.problem.test.data for case, _ in cases.values()]
    assert [each.frequency_hz.size for each in data] == [3, 4, 4]
    np.testing.assert_array_equal(data[0].frequency_hz, data[1].frequency_hz[:3])
    assert data[2].zeros.dofs == ("11:y",) * 3
    assert (data[2].zeros.frequency.values > data[2].frequency_hz[:3]).all()  # each between two natural frequencies
    assert all(case.spec.uncertain.model_error is not None for case, _ in cases.values())


def row(index, truth, low, high):
    said = {"truth": truth, "interval95": [low, high]}
    return {"index": index, "effective": 3000.0 - index, "seconds": 1.0, "stiffness": {"k22": said}}


def test_importance_draws_have_the_moments_of_the_density_and_weights_that_sum_to_1():
    case, _ = model_error.case_of("four frequencies", 1)
    theta, weight = model_error.importance_draws(case.problem, np.random.default_rng(0))
    assert weight.sum() == pytest.approx(1.0)
    effective = 1 / (weight**2).sum()
    assert effective > model_error.ENOUGH
    rng = np.random.default_rng(1)
    other = case.problem.prior.sample(rng, 40_000)
    of_prior = np.exp(case.problem.log_posterior.log_likelihood(other))
    of_prior /= of_prior.sum()
    few = 1 / (of_prior**2).sum()
    assert few > 300
    here, there = weight @ theta, of_prior @ other
    sd = np.sqrt(weight @ (theta - here) ** 2)
    assert (np.abs(here - there) < 4 * sd / np.sqrt(few)).all()


def test_a_study_that_was_cut_off_goes_on_and_counts_what_held(tmp_path, monkeypatch):
    rows = {1: row(1, 2.0, 1.0, 4.0), 2: row(2, 9.0, 1.0, 2.0), 3: row(3, 3.0, 1.0, 3.0)}
    monkeypatch.setattr(model_error, "analysed", lambda _, index: rows[index])
    kept = tmp_path / "kept.jsonl"
    model_error.outcomes("four frequencies", 2, kept)
    del rows[1], rows[2]
    data = model_error.summary(model_error.outcomes("four frequencies", 3, kept))
    assert (data["cases"], data["least_effective"]) == (3, 2997.0)
    assert data["stiffness"]["k22"] == {"held": 2, "width": 3.0}
    text = model_error.section({"four frequencies": data})
    assert "| four frequencies | k22 | 3 | 2 | 66.7 % (9.4 to 99.2) | 3.0 |" in text
