"""The forecast of what to measure next, against differences of the model's own FRFs and against a run with the data."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.bricks import brick_model, face
from scipy.linalg import eigh

import jointbayes as jb
from jointbayes.frf import DirectSolve, NaturalFrequencies, Ports
from jointbayes.inference import JointPrior, Normal, Nuisance
from jointbayes.joint import Joint, Joints
from jointbayes.posterior.first_look import FirstLook, measurement_information, modes_hit_free
from jointbayes.posterior.identifiability import ratio_of
from jointbayes.posterior.next_step import _candidates, _hit_free, next_step, spread_in_words
from jointbayes.posterior.prediction import frfs_as_measured
from jointbayes.structure import family_of_recipe, reduce_to_ports
from tests.conftest import CLAMP, PAIR, TABLE_3, of_case
from tests.inference.test_free_test import BODY, CLAMPED, FREE, MATERIAL, PRIOR, beam_family
from vibrecords import Antiresonances, ModeData, Observed, quantity_factor

OFFSET = Nuisance("length_offset", "m", 1.0, Normal(0.0, 0.001))


@pytest.fixture(scope="module")
def judged(cheap_posterior):
    return {name: cheap_posterior.verdict(name) for name in cheap_posterior.stiffness_names}


def test_the_best_gain_is_that_of_finite_differences_of_the_frfs(cheap_posterior, judged):
    """σ² = E|δH|² puts 2|∂H/∂θ|²/σ² into the information, for noise with the law that the data state."""
    problem, frf = cheap_posterior.problem, cheap_posterior.problem.test.data.frfs.frf
    theta = np.vstack([cheap_posterior.estimate.theta, cheap_posterior.thinned(4)])
    sds = {output: [] for output in ("2:y", "3:y", "4:y", "4 times the averages")}
    for point in theta:
        informations = {
            output: _information(problem, point, Ports(frf.frequency_hz, (output,), frf.inputs))
            for output in ("2:y", "3:y", "4:y", "5:y")
        }
        informations["4 times the averages"] = 3 * informations["5:y"]
        for output, sd in sds.items():
            total = informations["5:y"] + informations[output] + np.diag(problem.prior.precision)
            sd.append(np.sqrt(np.linalg.inv(total)[0, 0]))
    median = {output: np.median(sd) for output, sd in sds.items()}
    step = next_step(cheap_posterior, None, judged)
    assert step.quantity == "k11"
    assert min(median, key=median.get) in step.words
    assert step.sd_after == pytest.approx(min(median.values()), rel=0.02)


def _information(problem, theta, ports):
    steps = 1e-5 * np.eye(theta.size)
    frfs = frfs_as_measured(
        problem, ports, problem.test.data.frfs.frf.quantity, problem.prior.values(np.vstack([theta, theta + steps])),
        problem.prior.factors(np.vstack([theta, theta + steps])),
    )[..., 0, 0]  # fmt: skip
    exact = np.abs(frfs[0])
    sd = np.sqrt(2) * (0.008 * exact + 0.0016 * np.median(exact))  # the case's noise, each part
    slopes = (frfs[1:] - frfs[0]) / 1e-5 / sd
    return 2 * np.real(slopes.conj() @ slopes.T)


def test_the_forecast_is_for_the_stiffness_that_is_known_least(cheap_posterior, judged):
    widest = max(judged, key=lambda name: ratio_of(judged[name].interval95))
    assert next_step(cheap_posterior, None, judged).quantity == widest
    for name in ("k11", "k22"):  # of two with one verdict
        wide = {other: replace(judged["k12"], ratio=50.0 if other == name else 2.0) for other in judged}
        assert next_step(cheap_posterior, None, wide).quantity == name
    known = judged | {"k11": judged["k22"]}
    assert next_step(cheap_posterior, None, known).quantity == "k12"


def test_with_more_uncertain_the_forecast_names_it_and_promises_less(cheap_posterior, cheap_case, judged):
    exact = next_step(cheap_posterior, None, judged)
    freed = next_step(of_case(cheap_posterior), cheap_case.workshop_problem, judged)
    assert freed.names == ("youngs_modulus", "density", "length", "damping_ratio")
    assert freed.sd_before > exact.sd_before
    assert freed.sd_after > exact.sd_after


def test_of_natural_frequencies_further_modes_are_proposed(frequency_posterior):
    judged = {name: frequency_posterior.verdict(name) for name in frequency_posterior.stiffness_names}
    step = next_step(frequency_posterior, None, judged)
    assert step.words == "modes 4 and 5"
    assert step.sd_after < step.sd_before


def test_of_natural_frequencies_a_sensor_and_antiresonances_are_looked_at_too(frequency_posterior):
    (part,) = frequency_posterior.problem.parts
    modes, *sensors, zeros = _candidates(part)
    words = ["an accelerometer at 270 mm (4:y), calibrated with the one at 360 mm (5:y)"]
    assert [sensor.words for sensor in sensors] == words
    assert zeros.words == "antiresonances 1 and 2 at 360 mm (5:y), by force and sensor there"
    # where a place is held still the structure has one DOF fewer
    theta, test = frequency_posterior.estimate.theta, part.test
    made = zeros.problem(part, theta).test.data.zeros
    structure = test.structures.recipe.structure()
    rows = [structure.index((label,))[0] for label in test.joints.labels]
    stiffness = structure.stiffness.copy()
    stiffness[np.ix_(rows, rows)] += part.prior.matrix(theta[None]).stiffness[0]
    kept = np.delete(np.arange(len(stiffness)), structure.index(("5:y",))[0])
    square = eigh(stiffness[np.ix_(kept, kept)], structure.mass[np.ix_(kept, kept)], eigvals_only=True)
    assert made.frequency.values[0] == pytest.approx(np.sqrt(square[:2]) / (2 * np.pi), rel=1e-6)
    assert made.frequency.sd == pytest.approx(modes.relative * made.frequency.values, rel=1e-6)


def test_antiresonances_that_are_measured_are_not_proposed_again(frequency_posterior):
    (part,) = frequency_posterior.problem.parts
    seen = Antiresonances("5:y", Observed(np.array([540.0]), np.array([1.0])))
    data = ModeData(Observed(part.test.data.frequency_hz, part.test.data.sd_hz), zeros=seen)
    *_, zeros = _candidates(replace(part, tests=(replace(part.test, data=data),)))
    assert zeros.numbers == (2, 3)
    assert zeros.words == "antiresonances 2 and 3 at 5:y, in a wider band"


@pytest.mark.parametrize(("fewer", "proposed"), [(2, True), (1, False)])
def test_no_more_antiresonances_are_proposed_than_the_model_has(frequency_posterior, fewer, proposed):
    (part,) = frequency_posterior.problem.parts
    last = part.test.most_modes - 1 - fewer  # seen, of all that there are with that place held
    seen = Antiresonances("5:y", Observed(np.array([5400.0]), np.array([1.0])), numbers=(last,))
    data = ModeData(Observed(part.test.data.frequency_hz, part.test.data.sd_hz), zeros=seen)
    words = [each.words for each in _candidates(replace(part, tests=(replace(part.test, data=data),)))]
    assert any(word.startswith("antiresonances") for word in words) == proposed
    assert any(word.startswith("modes") for word in words)


@pytest.mark.parametrize(("after", "said"), [(math.log(9.99) / 1.96, True), (math.log(10.01) / 1.96, False)])
def test_a_forecast_of_hardly_anything_is_none(cheap_posterior, judged, monkeypatch, after, said):
    def linearised(_look, names):
        return SimpleNamespace(names=names, median=after if names else 9.0)

    monkeypatch.setattr(FirstLook, "linearised", linearised)
    step = next_step(cheap_posterior, None, judged)
    assert (step is not None) == said


def test_the_sentence_has_its_figure_and_price_and_says_that_it_is_an_estimate(cheap_posterior, judged):
    step = next_step(cheap_posterior, None, judged)
    assert spread_in_words(step.sd_after) in step.sentence
    assert "an estimate" in step.sentence
    assert "It costs 4 times the measuring time" in step.sentence
    assert "It costs a sensor and its FRF" in replace(step, words="an accelerometer at 2:y").sentence
    changed = replace(step, sd_after=0.01).sentence
    assert "±2 %" in changed
    assert changed != step.sentence


def test_a_test_of_the_structure_free_is_looked_at_where_its_body_is_uncertain(cheap_posterior, cheap_case):
    """What it would tell is what its FRFs, computed densely without the joint, say of E by differences."""
    assert not list(_hit_free(cheap_posterior.problem))
    problem, theta = cheap_case.workshop_problem, np.append(cheap_posterior.estimate.theta, [0.0, 0.0, 0.0, 0.0])
    (free,) = _hit_free(problem)
    assert free.words == "a test of the structure hit free, before it is joined"
    ports, recipe = free.ports, problem.test.structures.recipe
    steps = [
        DirectSolve(recipe.structure({"youngs_modulus": factor}), Joints(()), ports).receptance(np.zeros((1, 0, 0)))[0]
        for factor in (1.0, math.exp(1e-5))
    ]
    frf = cheap_posterior.problem.test.data.frfs.frf
    exact, moved = (quantity_factor(ports.frequency_hz, frf.quantity)[:, None, None] * each for each in steps)
    sd = np.sqrt(2) * (0.008 * np.abs(exact) + 0.0016 * np.median(np.abs(exact)))  # the case's noise, each part
    told = 2 * (np.abs((moved - exact) / 1e-5 / sd) ** 2).sum()
    at = problem.names.index("youngs_modulus")
    information = measurement_information(free, problem, theta)
    assert information[at, at] == pytest.approx(told, rel=0.02)
    assert not information[:3].any()  # of the joint it says nothing by itself


def test_frequencies_of_the_free_structure_are_forecast_as_well_known_as_the_present_ones():
    problem = joined(MATERIAL)
    (free,) = _hit_free(problem)
    exact = NaturalFrequencies(BODY, Joints(()), 3).frequency_hz(np.zeros((1, 0, 0)))[0]
    theta = np.append(np.log(TABLE_3), np.zeros(3))
    data = free.problem(problem, theta).test.data
    np.testing.assert_allclose(data.frequency_hz, exact, rtol=1e-9)
    np.testing.assert_allclose(data.sd_hz, 0.001 * exact, rtol=1e-9)


def joined(nuisances, test=CLAMPED, *more):
    return jb.Problem([test, *more], JointPrior(PAIR, PRIOR.marginals, tuple(nuisances)))


@pytest.mark.parametrize(
    ("test", "nuisances", "more", "proposed"),
    [
        (CLAMPED, MATERIAL, (), True),
        (replace(CLAMPED, structure=beam_family(("density",))), MATERIAL[1:2], (), True),
        (replace(CLAMPED, structure=beam_family(())), (), (), False),
        (replace(CLAMPED, structure=beam_family(("length_offset",))), (OFFSET,), (), False),
        (replace(CLAMPED, structure=beam_family(("density", "length_offset"))), (MATERIAL[1], OFFSET), (), False),
        (replace(CLAMPED, structure=beam_family(("density",), supports=("11:y",))), MATERIAL[1:2], (), False),
        (replace(CLAMPED, joints=Joint(CLAMP.dofs, ("11:y", "11:rz"))), MATERIAL, (), False),
        (CLAMPED, MATERIAL, (FREE,), False),
    ],
)
def test_free_is_proposed_of_an_uncertain_body_that_joints_alone_hold_to_ground(test, nuisances, more, proposed):
    assert bool(list(_hit_free(joined(nuisances, test, *more)))) == proposed


def test_of_an_imported_structure_no_more_free_modes_are_proposed_than_it_is_known_up_to():
    model = brick_model((8, 2, 2))
    recipe = reduce_to_ports(model, {"foot": face(model, 0.0)}, 5000.0, jb.LossFactor(0.01))
    body, joint = family_of_recipe(recipe, {"density": (-0.1, 0.1)}), Joint(("foot:y", "foot:z"))
    frequency = np.array([300.0, 500.0, 1500.0, 2100.0])
    test = jb.Test("", body, joint, ModeData(Observed(frequency, 1e-3 * frequency)))
    (free,) = modes_hit_free(test, test.data, "free")
    natural = np.sqrt(np.abs(eigh(model.stiffness.toarray(), model.mass.toarray(), eigvals_only=True))) / (2 * np.pi)
    assert len(free.numbers) == (natural[6:] < 5000.0).sum() < 4
    low = replace(test, structure=family_of_recipe(replace(recipe, top_hz=100.0)))
    assert not list(modes_hit_free(low, test.data, "free"))
