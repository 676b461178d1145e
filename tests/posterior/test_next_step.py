"""The forecast of what to measure next, against differences of the model's own FRFs and against a run with the data."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.bricks import brick_model, face
from scipy.linalg import eigh

import jointbayes as jb
from jointbayes.frf import DirectSolve, Ports
from jointbayes.inference import JointPrior, Normal, Nuisance
from jointbayes.joint import Joint, Joints
from jointbayes.posterior.candidates import candidates_of, free_modes, frfs_there, modes_there, scatter, sensor_noise
from jointbayes.posterior.fisher import fisher_information, spread_in_words
from jointbayes.posterior.forecast import LARGEST, NextStep
from jointbayes.posterior.identifiability import ratio_of
from jointbayes.posterior.next_step import next_steps
from jointbayes.posterior.posterior import gather_knowledge
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.sections.lead import lead
from jointbayes.structure import family_of_recipe, reduce_to_ports
from tests.case.refusal_rows import parts_named
from tests.case.test_free_structure_as_test import MATERIAL as FREE_MATERIAL
from tests.case.test_several_tests import BASE
from tests.conftest import CLAMP, CONFIGS, PAIR, TABLE_3, of_case, unsettled
from tests.inference.test_free_test import CLAMPED, FREE, MATERIAL, PRIOR, beam_family
from vibrecords import Antiresonances, ModeData, Observed, quantity_factor

ERRORS = "[uncertain.model_error]\nfrequency_error = 0.002\nshape_error = 0.005\n"
OFFSET = Nuisance("length_offset", "m", 1.0, Normal(0.0, 0.001))


@pytest.fixture(scope="module")
def judged(cheap_posterior):
    return {name: cheap_posterior.verdict(name) for name in cheap_posterior.stiffness_names}


def next_step(*given):
    return next_steps(*given)[0]


def words_of(problem):
    return [candidate.words for candidate in candidates_of(problem)]


def free_of(problem):
    first = itertools.takewhile(lambda candidate: "before it is joined" in candidate.words, candidates_of(problem))
    return [candidate for candidate in first if candidate.words.startswith("a test of the structure")]


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
    for row in next_steps(cheap_posterior, None, judged):
        (of_place,) = [sd for place, sd in median.items() if place in row.words]
        assert row.sd_after == pytest.approx(of_place, rel=0.02)
        assert row.sd_before == step.sd_before


def _information(problem, theta, ports):
    steps = 1e-5 * np.eye(theta.size)
    frfs = problem.frfs_as_measured(
        ports,
        problem.test.data.frfs.frf.quantity,
        problem.prior.values(np.vstack([theta, theta + steps])),
        problem.prior.factors(np.vstack([theta, theta + steps])),
    )[..., 0, 0]
    exact, tip = np.abs(frfs[0]), np.abs(problem.test.data.frfs.frf.values[:, 0, 0])
    # the case's noise, each part: relative to each FRF, and what the sensor at the tip has by itself wherever it is
    sd = np.sqrt(2) * (0.008 * exact + 0.0016 * np.median(tip))
    slopes = (frfs[1:] - frfs[0]) / 1e-5 / sd
    return 2 * np.real(slopes.conj() @ slopes.T)


def test_the_forecast_is_for_the_stiffness_that_is_known_least(cheap_posterior, judged):
    widest = max(judged, key=lambda name: ratio_of(judged[name].interval))
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
    assert words_of(part) == [
        "modes 4 and 5",
        "an accelerometer at 270 mm (4:y), calibrated with the one at 360 mm (5:y)",
        "antiresonances 1 and 2 at 360 mm (5:y), by force and sensor there",
    ]
    # where a place is held still the structure has one DOF fewer
    theta, test, relative = frequency_posterior.estimate.theta, part.test, scatter(part.test.data)
    made = modes_there(part, theta, (1, 2), relative, held="5:y").test.data.zeros
    structure = test.structures.recipe.structure()
    rows = [structure.index((label,))[0] for label in test.joints.labels]
    stiffness = structure.stiffness.copy()
    stiffness[np.ix_(rows, rows)] += part.prior.matrix(theta[None]).stiffness[0]
    kept = np.delete(np.arange(len(stiffness)), structure.index(("5:y",))[0])
    square = eigh(stiffness[np.ix_(kept, kept)], structure.mass[np.ix_(kept, kept)], eigvals_only=True)
    assert made.frequency.values[0] == pytest.approx(np.sqrt(square[:2]) / (2 * np.pi), rel=1e-6)
    assert made.frequency.sd == pytest.approx(relative * made.frequency.values, rel=1e-6)


def test_a_ratio_is_known_to_one_per_cent_and_to_the_noise_of_the_sensor(frequency_posterior):
    (part,), theta = frequency_posterior.problem.parts, frequency_posterior.estimate.theta
    for dof in ("4:y", "1:y"):
        seen = modes_there(part, theta, (1, 2, 3), 0.01, dof=dof, reference="5:y").test.data.shapes.components
        np.testing.assert_allclose(seen.sd, np.maximum(0.01 * np.abs(seen.values), 0.001), rtol=1e-9)
        assert (seen.sd.ravel()[0] == 0.001) == (dof == "1:y")  # the clamp moves little in the first mode


def test_antiresonances_that_are_measured_are_not_proposed_again(frequency_posterior):
    (part,) = frequency_posterior.problem.parts
    seen = Antiresonances("5:y", Observed(np.array([540.0]), np.array([1.0])))
    data = ModeData(Observed(part.test.data.frequency_hz, part.test.data.sd_hz), zeros=seen)
    words = words_of(replace(part, tests=(replace(part.test, data=data),)))
    assert words[-1] == "antiresonances 2 and 3 at 5:y, in a wider band"


@pytest.mark.parametrize(("fewer", "proposed"), [(2, True), (1, False)])
def test_no_more_antiresonances_are_proposed_than_the_model_has(frequency_posterior, fewer, proposed):
    (part,) = frequency_posterior.problem.parts
    last = part.test.most_modes - 1 - fewer  # seen, of all that there are with that place held
    seen = Antiresonances("5:y", Observed(np.array([5400.0]), np.array([1.0])), numbers=(last,))
    data = ModeData(Observed(part.test.data.frequency_hz, part.test.data.sd_hz), zeros=seen)
    words = words_of(replace(part, tests=(replace(part.test, data=data),)))
    assert any(word.startswith("antiresonances") for word in words) == proposed
    assert any(word.startswith("modes") for word in words)


@pytest.mark.parametrize(("before", "after", "worth"), [
    (9.0, math.log(9.99) / 1.96, True), (9.0, math.log(10.01) / 1.96, False),
    (0.1, 0.1 / 1.16, True), (0.1, 0.1 / 1.14, False),
])  # fmt: skip
def test_a_forecast_of_next_to_nothing_is_not_worth_its_price(before, after, worth):
    step = NextStep("k11", "an accelerometer", "a sensor", before, after)
    assert step.is_worth_it == worth
    assert step.gain == pytest.approx(min(before, 3.0) / after)


def test_the_sentence_has_its_figure_and_price_and_says_that_it_is_an_estimate(cheap_posterior, judged):
    step = next_step(cheap_posterior, None, judged)
    assert spread_in_words(step.sd_after) in step.sentence
    assert "an estimate" in step.sentence
    assert "It costs 4 times the measuring time" in step.sentence
    changed = replace(step, sd_after=0.01).sentence
    assert "±2 %" in changed
    assert changed != step.sentence


@pytest.mark.parametrize(("relative", "floor", "share"), [(0.01, 0.002, 0.01), (0.02, 0.0, 0.2)])
def test_a_sensor_on_the_clamp_sees_little_but_its_own_noise(cheap_case, relative, floor, share):
    """|H| at the clamp is 1000 times smaller than at the tip, where the present sensor is."""
    problem, theta = cheap_case.problem, np.log(TABLE_3)
    frf = problem.test.data.frfs.frf
    tip = problem.frfs_as_measured(Ports(frf.frequency_hz, ("5:y",), frf.inputs), frf.quantity, np.array([TABLE_3]),
                           np.ones((1, 0)))[0]  # fmt: skip
    sd = relative * np.abs(tip) + floor * np.median(np.abs(tip))
    data = jb.FrfData(replace(frf, values=tip), 2 * sd**2)
    told, least = {}, relative * np.abs(tip).min() + floor * np.median(np.abs(tip))
    for dof in ("5:y", "4:y", "1:y"):
        ports = Ports(frf.frequency_hz, (dof,), frf.inputs)
        there = frfs_there(problem, ports, sensor_noise(data, (dof,)), data, theta)
        values, variance = there.test.data.frfs.frf.values, there.test.data.frfs.variance
        expected = np.maximum(relative * np.abs(values) + floor * np.median(np.abs(tip)), least)
        np.testing.assert_allclose(variance, 2 * expected**2, rtol=1e-6)
        as_if_its_own = frfs_there(
            problem,
            ports,
            lambda h: 2 * ((relative + 1e-9) * np.abs(h) + floor * np.median(np.abs(h))) ** 2,
            data,
            theta,
        )
        told[dof] = [fisher_information(each, theta).data[0, 0] for each in (there, as_if_its_own)]
    assert told["4:y"][0] > 0.1 * told["4:y"][1]
    assert told["1:y"][0] < share * told["1:y"][1]  # noise in proportion to the sensor's own FRF promises far too much


def test_each_kind_of_sensor_has_a_noise_of_its_own(cheap_case):
    frf = cheap_case.problem.test.data.frfs.frf
    ports = Ports(frf.frequency_hz, ("5:y", "5:rz"), ("5:y", "4:y"))
    both = cheap_case.problem.frfs_as_measured(ports, frf.quantity, np.array([TABLE_3]), np.ones((1, 0)))[0]
    noise = np.array([[1e-9, 3e-9], [2e-8, 5e-8]])
    sd = 0.01 * np.abs(both) + noise
    data = jb.FrfData(replace(frf, values=both, outputs=ports.outputs, inputs=ports.inputs), 2 * sd**2)
    large = np.full((1, 3, 2), 1.0 + 0j)
    found = sensor_noise(data, ("2:rz", "3:y", "4:y"))(large)
    np.testing.assert_allclose(np.sqrt(found / 2)[0] - 0.01, noise[[1, 0, 0]], rtol=1e-5)


def test_a_test_of_the_structure_free_is_looked_at_where_its_body_is_uncertain(cheap_posterior, cheap_case):
    """What it would tell is what its FRFs, computed densely without the joint, say of E by differences."""
    assert not free_of(cheap_posterior.problem)
    problem, theta = cheap_case.workshop_problem, np.append(cheap_posterior.estimate.theta, [0.0, 0.0, 0.0, 0.0])
    (free,) = free_of(problem)
    assert free.words == "a test of the structure hit free, before it is joined"
    frf, recipe = cheap_posterior.problem.test.data.frfs.frf, problem.test.structures.recipe
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    steps = [
        DirectSolve(recipe.structure({"youngs_modulus": factor}), Joints(()), ports).receptance(np.zeros((1, 0, 0)))[0]
        for factor in (1.0, math.exp(1e-5))
    ]
    exact, moved = (quantity_factor(ports.frequency_hz, frf.quantity)[:, None, None] * each for each in steps)
    # the case's noise, each part
    sd = np.sqrt(2) * (0.008 * np.abs(exact) + 0.0016 * np.median(np.abs(frf.values)))
    told = 2 * (np.abs((moved - exact) / 1e-5 / sd) ** 2).sum()
    at = problem.names.index("youngs_modulus")
    information = free.information(theta)
    assert information[at, at] == pytest.approx(told, rel=0.02)
    assert not information[:3].any()  # of the joint it says nothing by itself


def test_weighing_tells_the_sum_of_density_and_length_and_adds_to_a_free_test(cheap_posterior, cheap_case):
    problem, theta = cheap_case.workshop_problem, np.append(cheap_posterior.estimate.theta, [0.0, 0.0, 0.0, 0.0])
    free, weighed, both = (c for c in candidates_of(problem) if "before it is joined" in c.words)
    assert (weighed.words, weighed.price) == ("the structure weighed to 0.1 %, before it is joined", "a scale")
    mass = weighed.information(theta)
    recipe, step = problem.test.structures.recipe, 1e-4
    for name in problem.names[3:]:
        factors = {name: math.exp(step)} if name != "damping_ratio" else {}
        heavier = recipe.structure(factors).mass, recipe.structure({}).mass
        slope = math.log(heavier[0][0::2, 0::2].sum() / heavier[1][0::2, 0::2].sum()) / step
        at = problem.names.index(name)
        assert mass[at, at] == pytest.approx((slope / 1e-3) ** 2, rel=1e-3, abs=1e-6)
    np.testing.assert_allclose(both.information(theta), free.information(theta) + mass)
    assert np.linalg.matrix_rank(mass) == 1


def joined(nuisances, test=CLAMPED, *more):
    return jb.Problem([test, *more], JointPrior(PAIR, PRIOR.marginals, tuple(nuisances)))


def test_frequencies_of_the_free_structure_are_forecast_as_well_known_as_the_present_ones():
    problem, theta = joined(MATERIAL), np.append(np.log(TABLE_3), np.zeros(3))
    (free,) = free_of(problem)
    at = problem.names.index("youngs_modulus")
    # natural frequencies go with the root of E, each known to 0.1 %
    assert free.information(theta)[at, at] == pytest.approx(3 * (0.5 / 0.001) ** 2, rel=1e-4)
    assert free_modes(problem.test, problem.test.data) == (1, 2, 3)


def test_a_free_test_counts_errors_of_the_model_at_their_usual_size():
    """Data that fit exactly would say that the model has none."""
    text = BASE.partition("[data]")[0] + parts_named("free_structure")["heard clamped"] + FREE_MATERIAL
    problem = jb.case_from_text("case", text + ERRORS).problem
    theta = np.array([np.log(2e9), np.log(1e7), np.log(3e5), 0.01, -0.004, 0.001])
    at = problem.names.index("youngs_modulus")
    found = free_of(problem)[0].information(theta)[at, at]
    assert found == pytest.approx(3 * 0.5**2 / (0.002**2 + 0.002**2), rel=0.01)


@pytest.mark.parametrize(
    ("test", "nuisances", "more", "proposed"),
    [
        (CLAMPED, MATERIAL, (), True),
        (replace(CLAMPED, structure=beam_family(("density",))), MATERIAL[1:2], (), True),
        (replace(CLAMPED, structure=beam_family(())), (), (), False),
        (replace(CLAMPED, structure=beam_family(("length_offset",))), (OFFSET,), (), False),
        (replace(CLAMPED, structure=beam_family(("density", "length_offset"))), (MATERIAL[1], OFFSET), (), False),
        (replace(CLAMPED, structure=beam_family(("density",), supports=("11:y",))), MATERIAL[1:2], (), False),
        (
            replace(CLAMPED, joints=Joint(CLAMP.dofs, ("11:y", "11:rz"), offset_m=(0.383, 0.0, 0.0))),
            MATERIAL,
            (),
            False,
        ),
        (CLAMPED, MATERIAL, (FREE,), False),
    ],
)
def test_free_is_proposed_of_an_uncertain_body_that_joints_alone_hold_to_ground(test, nuisances, more, proposed):
    assert bool(free_of(joined(nuisances, test, *more))) == proposed


def test_of_an_imported_structure_no_more_free_modes_are_proposed_than_it_is_known_up_to():
    model = brick_model((8, 2, 2))
    recipe = reduce_to_ports(model, {"foot": face(model, 0.0)}, 5000.0, jb.LossFactor(0.01))
    body, joint = family_of_recipe(recipe, {"density": (-0.1, 0.1)}), Joint(("foot:y", "foot:z"))
    frequency = np.array([300.0, 500.0, 1500.0, 2100.0])
    test = jb.Test("", body, joint, ModeData(Observed(frequency, 1e-3 * frequency)))
    natural = np.sqrt(np.abs(eigh(model.stiffness.toarray(), model.mass.toarray(), eigvals_only=True))) / (2 * np.pi)
    assert len(free_modes(test, test.data)) == (natural[6:] < 5000.0).sum() < 4
    low = replace(test, structure=family_of_recipe(replace(recipe, top_hz=100.0)))
    assert not free_modes(low, low.data)


def test_a_candidate_that_cannot_be_computed_costs_no_other_its_row(cheap_posterior, judged, monkeypatch):
    every = next_steps(cheap_posterior, None, judged)

    def broken(_):
        raise jb.ModelError("found no mode")

    def one_less(problem):
        first, *others = candidates_of(problem)
        return (replace(first, information=broken), *others)

    monkeypatch.setattr("jointbayes.posterior.next_step.candidates_of", one_less)
    left = next_steps(cheap_posterior, None, judged)
    assert len(left) == len(every) - 1
    assert set(left) < set(every)


@pytest.mark.parametrize("name", ["cheap_posterior", "frequency_posterior"])
def test_plan_prints_the_ranking_whose_first_row_is_next_of_page_one(name, request):
    posterior = request.getfixturevalue(name)
    plan, knowledge = jb.plan(posterior), gather_knowledge(posterior)
    sds = [step.sd_after for step in plan.steps]
    assert sds == sorted(sds)
    assert len(sds) > 2
    assert plan.advice == knowledge.advice == plan.steps[0].sentence
    assert plan.table.rows[0][0] in plan.advice.lower()
    assert plan.table.rows[-1][0] == "(now)"
    assert plan.lines[0] == plan.advice
    before, after = np.minimum([plan.steps[0].sd_before, sds[0]], LARGEST)
    assert plan.as_json()["steps"][0]["gain"] == pytest.approx(before / after)
    assert not jb.plan(unsettled(posterior)).steps


@pytest.mark.whole
@pytest.mark.parametrize(("name", "worth"), [
    ("measured_rotation", True), pytest.param("spindle_tool", True, marks=pytest.mark.long),
    ("clamped_beam_frequencies", False),
])  # fmt: skip
def test_next_on_page_one_of_a_shipped_case_is_the_first_row_of_plan(name, worth):
    posterior = jb.sample(CONFIGS / f"{name}.toml", seed=1)
    plan = jb.plan(posterior)
    (page,) = (b.text for b in lead(ReportInputs(posterior)) if getattr(b, "text", "").startswith("**Next.**"))
    measurement, price, known_to, _ = plan.table.rows[0]
    assert plan.steps[0].is_worth_it == worth
    assert all(words in page.lower() for words in (measurement, price, known_to)) == worth
