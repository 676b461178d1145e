import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.case.case_objects import recipe_of
from jointbayes.frf import DirectSolve
from jointbayes.inference import ProportionalNoise
from jointbayes.posterior import first_look
from jointbayes.posterior.coordinates import coordinate_systems
from jointbayes.posterior.first_look import FrfCandidate, estimated_law, repeated
from jointbayes.posterior.identifiability import listed
from jointbayes.posterior.knowledge import taken_as_exact
from jointbayes.posterior.next_step import spread_in_words
from jointbayes.sampling import WeightedDraws, fit_proposal
from jointbayes.studies.planning import plan_report
from jointbayes.studies.planning.case_candidates import candidates_of
from jointbayes.studies.planning.make_plan import (
    Simulator,
    assumed_truth,
    could_come_first,
    plan,
    stated_joint,
)
from tests.conftest import CONFIGS, TABLE_3, cheap_text, cli, edited, pair_matrix, shipped_text
from tests.one_line import refused
from vibrecords import RelativeNoise

TRUTH = np.log(TABLE_3)
LAW = RelativeNoise(0.03, 0.01)


def accelerometer(case, *outputs, law=LAW):
    problem, data = case.problem, case.spec.data
    ports = jb.Ports(np.array(data.lines_hz()), outputs, data.inputs)
    words = f"an accelerometer at {' and '.join(outputs)}"
    name = "+".join(outputs)
    return FrfCandidate(
        name=name, words=words, structure=problem.test.structure, ports=ports, quantity="receptance", law=law
    )


def planned_text(*changes):
    """The small case with a [plan] of two accelerometers."""
    return edited(cheap_text() + '\n[plan]\nparameter = "k12"\noutputs = ["3:y", "5:rz"]\n', *changes)


def test_information_adds_over_independent_measurements(cheap_case):
    both = first_look.measurement_information(accelerometer(cheap_case, "3:y", "4:y"), cheap_case.problem, TRUTH)
    one, other = (
        first_look.measurement_information(accelerometer(cheap_case, dof), cheap_case.problem, TRUTH)
        for dof in ("3:y", "4:y")
    )
    np.testing.assert_allclose(both, one + other, rtol=1e-9, atol=1e-9 * np.abs(both).max())
    assert np.linalg.eigvalsh(one).min() > -1e-9 * np.abs(one).max()


def test_the_information_of_a_candidate_is_that_of_the_case_which_measures_it(cheap_case):
    """The extended case, its noise law at the truth, says the same as present case and candidate together."""
    extended = jb.case_from_text("both", edited(cheap_text(), ('outputs = ["5:y"]', 'outputs = ["5:y", "3:y"]')))
    candidate = accelerometer(cheap_case, "3:y", law=RelativeNoise(0.008, 0.0016))
    added = first_look.measurement_information(candidate, cheap_case.problem, TRUTH)
    whole = first_look.fisher_information(cheap_case.problem, TRUTH).data + added
    np.testing.assert_allclose(whole, first_look.fisher_information(extended.problem, TRUTH).data, rtol=1e-6)


def test_a_repeated_measurement_halves_the_linearised_variance(cheap_case):
    problem = cheap_case.problem
    look = first_look.FirstLook(problem, {"again": repeated(problem, 2.0)}, "k22", TRUTH[None])
    now = first_look.sd_of(first_look.fisher_information(problem, TRUTH), "k22")
    assert look.linearised(("again",)).median / now == pytest.approx(math.sqrt(0.5), rel=1e-6)


def simulator_about_the_truth(case, quantity, truths=6):
    """Simulator of a case, with importance draws of its posterior about the truth."""
    problem, rng = case.problem, np.random.default_rng(1)
    proposal = fit_proposal(problem.log_posterior, coordinate_systems(problem), ((TRUTH, 1e-6 * np.eye(3)),), rng)
    draws = WeightedDraws(*proposal.weighted_draws(problem.log_posterior, rng, 20_000)).resample(rng, 8000)
    return Simulator(problem, quantity, draws, coordinate_systems(problem), rng, truths=truths)


@pytest.mark.whole
@pytest.mark.parametrize("quantity", ["k11", "k12", "k22"])
def test_simulated_repetitions_halve_the_variance_where_the_posterior_is_gaussian(quantity):
    """With the joint itself measured all three stiffnesses are known to a part in a hundred or better."""
    text = edited(cheap_text(), ('outputs = ["5:y"]', 'outputs = ["5:y", "1:y", "1:rz"]'))
    case = jb.case_from_text("joint measured", text)
    candidate = repeated(case.problem, 2.0)
    simulator = simulator_about_the_truth(case, quantity)
    found = plan_report.Simulation(tuple(simulator.posterior_after([candidate], i) for i in range(6)))
    assert simulator.now.sd == pytest.approx(
        first_look.sd_of(first_look.fisher_information(case.problem, TRUTH), quantity), rel=0.1
    )
    assert found.lost == 0
    assert found.reweighted > 0  # no more than some two bits are gained: many present draws stay effective
    assert found.median / simulator.now.sd == pytest.approx(math.sqrt(0.5), rel=0.06)


@pytest.mark.whole
def test_reweighting_and_importance_sampling_find_the_same_posterior(cheap_case, cheap_posterior, monkeypatch):
    problem = cheap_case.problem
    candidate = repeated(problem, 2.0)

    def simulated():
        rng = np.random.default_rng(1)
        simulator = Simulator(problem, "k12", cheap_posterior.theta, coordinate_systems(problem), rng, truths=5)
        return [simulator.posterior_after([candidate], i) for i in range(5)]

    usual = simulated()
    monkeypatch.setattr("jointbayes.studies.planning.make_plan._SPARE", 1e9)
    by_importance = simulated()
    assert {one.method for one in by_importance} == {"importance sampling"}
    both = [(a.sd, b.sd) for a, b in zip(usual, by_importance, strict=True) if a.method == "reweighting"]
    assert len(both) >= 3
    np.testing.assert_allclose(*np.transpose(both), rtol=0.15)


def test_importance_sampling_takes_over_where_the_weights_of_present_draws_collapse(cheap_case, cheap_posterior):
    """An accelerometer at the joint leaves a small part of the present posterior."""
    problem = cheap_case.problem
    simulator = Simulator(
        problem, "k12", cheap_posterior.theta, coordinate_systems(problem), np.random.default_rng(1), truths=1
    )
    found = simulator.posterior_after([accelerometer(cheap_case, "1:y", "1:rz")], 0)
    assert found.method == "importance sampling"
    assert found.effective >= 200
    assert found.sd < 0.5 * simulator.now.sd


def test_few_draws_are_refused(cheap_case):
    few, systems = np.zeros((5, 3)), coordinate_systems(cheap_case.problem)
    with pytest.raises(jb.ModelError, match="3 simulations and 5 draws"):
        Simulator(cheap_case.problem, "k12", few, systems, np.random.default_rng(1), truths=3)


def test_averages_reduce_the_variance_of_all_frfs_in_hand_and_new_together(cheap_case):
    new = repeated(cheap_case.problem, 4.0).problem(cheap_case.problem, TRUTH).test.data.variance
    old = cheap_case.problem.test.data.variance
    np.testing.assert_allclose(1 / (1 / new + 1 / old), old / 4)


def test_sets_are_all_there_are_or_grown_one_by_one():
    names = ("a", "b", "c")
    assert (first_look.sets_of(names, 2, len), first_look.sets_of(names, 9, len)) == (
        (("a", "b"), ("a", "c"), ("b", "c")),
        (names,),
    )
    many = tuple(str(i) for i in range(60))
    assert first_look.sets_of(many, 4, lambda one: -sum(map(int, one))) == (("59", "58", "57", "56"),)


def test_all_that_could_come_first_are_worth_simulating():
    looks = [first_look.Linearised((name,), np.array(sds)) for name, sds in
             {"first": [0.1, 0.2, 0.3], "near": [0.9, 1.1, 1.2], "far": [1.3, 2.0, 3.0]}.items()]  # fmt: skip
    assert first_look.worth_simulating(looks[::-1], 3) == tuple(looks)
    assert first_look.worth_simulating(looks, 2) == tuple(looks[:2])  # 0.9 / 2 ≤ 0.3 · 2 < 1.3 / 2


def test_what_no_data_see_keeps_the_width_of_its_prior():
    names, prior = ("k11", "k12", "k22", "length"), np.diag([0.0, 0.0, 0.0, 4.0])
    data = np.diag([1.0, 1e-30, 1.0, 0.0])
    blind = first_look.FisherInformation(names, np.zeros(4), data, prior, np.full(4, 5.0), jb.LogStiffness())
    assert first_look.sd_of(blind, "k12") == 5.0
    refused(lambda: first_look.sd_of(blind, "k33"), jb.ModelError, "found parameter 'k33'")


def test_a_range_holds_a_further_value_in_four_of_five_cases():
    values = np.random.default_rng(1).lognormal(size=(4000, 10))
    inside = [low <= row[-1] <= high for row in values for low, high in [plan_report.predictive_range(row[:-1])]]
    assert np.mean(inside) == pytest.approx(0.8, abs=0.02)
    assert all(math.isnan(end) for end in plan_report.predictive_range([]))


def test_a_noise_law_is_estimated_from_the_variance(cheap_case):
    exact = jb.case_from_text("exact", edited(cheap_text(), ("added = true", "added = false")))
    law = estimated_law(exact.problem.test.data)
    assert (law.relative, law.floor) == pytest.approx((0.008, 0.0016), rel=1e-6)
    assert estimated_law(cheap_case.problem.test.data).relative == pytest.approx(0.008, rel=0.1)


@pytest.mark.whole
def test_simulated_noise_has_the_stated_variance_and_none_without_a_generator(cheap_case):
    candidate = accelerometer(cheap_case, "3:y")
    exact = candidate.problem(cheap_case.problem, TRUTH)
    noisy = candidate.problem(cheap_case.problem, TRUTH, np.random.default_rng(1))
    z = (noisy.test.data.frf.values - exact.test.data.frf.values) / np.sqrt(exact.test.data.variance)
    assert (np.abs(z) ** 2).mean() == pytest.approx(1.0, abs=4 / math.sqrt(z.size))
    structure, joint = cheap_case.problem.test.structure.nominal, cheap_case.problem.test.joints
    direct = DirectSolve(structure, joint, candidate.ports).receptance(pair_matrix(TABLE_3))[0]
    np.testing.assert_allclose(exact.test.data.frf.values, direct, atol=1e-9 * np.abs(direct).max())


def test_a_noise_that_knows_its_lines_follows_those_of_the_candidate():
    text = cheap_text() + '\n[noise]\ndistribution = "proportional"\n[plan]\nf_max_hz = 3000.0'
    case = jb.case_from_text("proportional", text)
    band = next(c for c in candidates_of(case) if c.name.startswith("band"))
    found = band.problem(case.problem, np.concatenate([TRUTH, np.log([0.01])]), np.random.default_rng(1))
    assert isinstance(found.test.noise, ProportionalNoise)
    assert found.test.noise.stated.shape == (found.test.data.frf.frequency_hz.size, 1)


def test_a_wider_band_adds_only_its_own_lines_with_the_floor_of_all():
    case = jb.case_from_text("wide", cheap_text() + "\n[plan]\nf_max_hz = 3000.0\n")
    measured = next(c for c in candidates_of(case) if c.name.startswith("band")).problem(case.problem, TRUTH).test.data
    present = case.problem.test.data.frf.frequency_hz
    np.testing.assert_allclose(np.diff(np.concatenate([present[-1:], measured.frf.frequency_hz])), 10.0)
    assert measured.frf.frequency_hz[-1] == 3000.0
    ports = jb.Ports(np.concatenate([present, measured.frf.frequency_hz]), ("5:y",), ("5:y",))
    whole = DirectSolve(case.problem.test.structures_of_data.nominal, case.problem.test.joints, ports).receptance(
        pair_matrix(TABLE_3)
    )[0]
    expected = RelativeNoise(0.008, 0.0016).variance(whole)[present.size :]
    np.testing.assert_allclose(measured.variance, expected, rtol=1e-6)


def test_candidates_of_a_case_in_the_order_of_its_plan():
    text = cheap_text() + '\n[plan]\noutputs = ["5:y", "3:y", "1:rz"]\ninputs = ["3:y"]\nadded_mass_g = 50.0\n'
    names = [c.name for c in candidates_of(jb.case_from_text("all", text))]
    # a hammer at 3:y says by reciprocity what the accelerometer there says
    assert names == ["3:y", "1:rz", "3:y / hammer 3:y", "1:rz / hammer 3:y", "4 × averages", "+50 g"]


def test_an_accelerometer_with_mass_loads_the_structure_and_a_hammer_does_not():
    text = edited(cheap_text(), ("elements = 4", "elements = 4\naccelerometer_mass_g = 20.0"))
    text += '\n[plan]\noutputs = ["3:y"]\ninputs = ["3:y"]\n'
    case = jb.case_from_text("loaded", text)
    by_name = {c.name: c for c in candidates_of(case)}
    dofs, top = ("1:y", "1:rz", "3:y", "5:y"), 2500.0
    loaded, bare = (p.at(dofs, top).nominal for p in (by_name["3:y"].structure, case.problem.test.structure))
    added = loaded.mass - bare.mass
    at = bare.index(("3:y",))[0]
    assert (added[at, at], (np.abs(added) > 1e-12).sum()) == (pytest.approx(0.020), 1)
    assert by_name["hammer 3:y"].structure is case.problem.test.structure


@pytest.mark.whole
@pytest.mark.parametrize("own", [0.0, 15.0])
def test_an_added_mass_is_exactly_known_beside_an_uncertain_beam_and_accelerometer(own):
    base = edited(
        shipped_text("clamped_beam_uncertain"), ("elements = 10", f"elements = 10\naccelerometer_mass_g = {own}")
    )
    text = base.replace("[plan]", "[plan]\nadded_mass_g = 50.0")
    if own:
        text = text.replace(
            "[uncertain.density]", "[uncertain.accelerometer_mass]\nsd_percent = 10.0\n[uncertain.density]"
        )
    case = jb.case_from_text("mass", text)
    family = next(c for c in candidates_of(case) if c.name.startswith("+")).structure
    assert family.names == case.problem.test.structure.names
    names = family.names
    factors = np.array([{"density": 1.02, "length": 0.995, "accelerometer_mass": 0.9}.get(n, 1.01) for n in names])
    recipe = recipe_of(case.spec.structure, case.spec.data)
    expected = recipe.structure(dict(zip(names, factors.tolist(), strict=True)))
    mass = np.array(expected.mass)
    at = expected.index(("11:y",))[0]
    mass[at, at] += 0.050
    by_hand = replace(expected, mass=mass)
    np.testing.assert_allclose(family.structure(factors).mass, mass, rtol=1e-12)
    found, _ = family.free_modes(np.array([at]), np.eye(1))(factors[None])
    np.testing.assert_allclose(found[0][2:8], by_hand.modes().eigenvalues[2:8], rtol=1e-6)
    np.testing.assert_allclose(family.damping_ratios(factors[None], 1)[0, 0], 0.0101)
    assert family.loss_factors(factors[None]).tolist() == [0.0]
    assert isinstance(case.problem.test.structure, jb.BeamFamily)


def test_an_assumed_joint_is_kept_and_all_else_follows_the_data():
    case = jb.load_case(CONFIGS / "clamped_beam_uncertain.toml")
    joint = case.problem.parametrisation.coordinates(TABLE_3)
    mode = np.concatenate([joint, np.full(4, 0.01)])
    theta = assumed_truth(case.problem, mode, TABLE_3)
    np.testing.assert_allclose(theta[:3], joint)
    density = case.problem.log_posterior
    assert density(theta)[0] > density(mode)[0]
    for i in range(3, 7):
        for step in (-0.002, 0.002):
            assert density(theta)[0] > density(theta + step * np.eye(7)[i])[0]
    refused(lambda: assumed_truth(case.problem, mode, [1.0, 1.0, 1.0]), jb.ModelError, "outside the prior")


def test_an_assumed_joint_is_stated_by_the_names_of_all_its_quantities():
    case = jb.load_case(CONFIGS / "spindle_tool.toml")
    names = [quantity.name for quantity in case.problem.parametrisation.quantities]
    stated = {name: float(i) for i, name in enumerate(names, 1)}
    assert stated_joint(case.name, case.problem, dict(reversed(stated.items()))) == list(stated.values())
    for wrong in ({"k11": 1e9, "k12": 1e7, "k22": 1e6}, {**stated, "more": 1.0}, tuple(stated.values())):
        with pytest.raises(jb.CaseError, match=f"expected a value for each of {', '.join(names)}; state all"):
            plan(case, assume=wrong)


def simulated(*sds, verdict="weakly identified"):
    """Made-up simulations; None is a posterior that was not found."""
    return plan_report.Simulation(
        tuple(None if sd is None else plan_report.SimulatedPosterior(sd, verdict, 500.0, "reweighting") for sd in sds)
    )


def planned(converged=True, **simulations):
    """A made-up plan of the candidates of a small case, by the letters of their order."""
    text = edited(planned_text(), ('"3:y", "5:rz"', '"1:y", "2:y", "3:y"'))
    candidates = candidates_of(jb.case_from_text("made up", text))
    measurements = [
        plan_report.PlannedMeasurement(
            (candidate,),
            first_look.Linearised((candidate.name,), np.array([1.0 if letter in simulations else 0.001])),
            simulations.get(letter),
        )
        for letter, candidate in zip("abc", candidates, strict=False)
    ]
    measurements.sort(key=lambda one: one.rank)
    now = plan_report.SimulatedPosterior(1.0, "not identified", 1e4, "reweighting")
    return jb.Plan("made up", "Made up", 1, "k12", now, tuple(measurements), converged, "why")


def test_the_least_simulated_median_is_recommended_and_the_range_is_its_quantiles():
    sds = [0.5, 0.1, 0.9, 0.3, 0.4, 0.2, 0.7, 0.6, 0.8]
    found = planned(a=simulated(*[0.6] * 9), b=simulated(*sds), c=simulated(*[2.0] * 9))
    assert [one.names for one in found.measurements] == [("2:y",), ("1:y",), ("3:y",)]
    assert found.recommended.names == ("2:y",)
    entry = found.summary()["measurements"][0]["simulated"]
    assert (entry["sd_median"], entry["sd_range80"]) == (0.5, [0.1, 0.9])
    assert found.as_good[0].names == ("1:y",)  # better for 0.7, 0.8 and 0.9: three of nine
    assert "About as good: 1:y." in found.sentence
    half, now, low, high = (spread_in_words(sd) for sd in (0.5, 1.0, 0.1, 0.9))
    assert found.sentence.startswith(
        f"Measure next: an accelerometer on the beam (2:y, 95.75 mm). Forecast: k12 known to {half} "
        f"(weakly identified; in 80 % of simulations between {low} and {high}); now {now} (not identified)."
    )


def test_what_was_not_simulated_is_never_recommended():
    """Its linearised figure is a hundred times better than all that was simulated."""
    found = planned(c=simulated(0.5, 0.5))
    assert found.recommended.names == ("3:y",)
    rows = plan_report.candidate_table(found.summary()).rows
    assert [row[0] for row in rows] == ["3:y (recommended)", "1:y", "2:y", "(now)"]
    assert rows[1][2:] == ("about ±0.2 %", "–", "–", "not simulated")
    assert rows[0][2:4] == ("0.38 to 2.7 times", "0.38 to 2.7 times and 0.38 to 2.7 times")
    none = planned()
    assert none.recommended is None
    assert none.sentence == "No recommendation: every simulation failed."
    assert repr(none) == f"Plan for made up, {len(none.measurements)} measurements: {none.sentence}"


def test_a_candidate_of_which_many_posteriors_were_not_found_is_not_ranked():
    found = planned(a=simulated(0.1, 0.1, None, None), b=simulated(0.5, 0.5, 0.5, 0.5))
    assert found.recommended.names == ("2:y",)
    assert "too many simulations failed: 1:y" in found.notes[0]
    rows = {row[0]: row for row in plan_report.candidate_table(found.summary()).rows}
    assert rows["1:y"][-1] == "2 of 4 simulations failed"


def test_a_plan_says_what_the_case_takes_as_exact():
    found = planned(a=simulated(0.5, 0.5))
    assert found.notes == ()
    words = "This plan takes density and length as exact: where that is not so, less will be known."
    assert replace(found, exact="density and length").notes == (words,)
    assert words in plan_report.plan_lines(replace(found, exact="density and length"))
    stated = jb.case_from_text("case", shipped_text("clamped_beam"))
    exact = "Young's modulus, density, length and damping ratio"
    assert listed(taken_as_exact(stated.problem, stated.workshop_problem)) == exact
    assert taken_as_exact(stated.workshop_problem, stated.workshop_problem) == ()
    assert taken_as_exact(stated.problem, None) == ()


@pytest.mark.parametrize(("found", "sentence", "kind"), [
    ({"a": (0.95, 0.95), "b": (0.99, 0.99)}, "None of the 2 simulated measurements would narrow k12 much", "caution"),
    ({"converged": False, "a": (0.1, 0.1)}, "No recommendation: the calculation for the data in hand has", "bad"),
])  # fmt: skip
def test_nothing_is_recommended_that_does_not_help_or_is_of_draws_that_have_not_converged(found, sentence, kind):
    of = planned(**{name: simulated(*sds) if isinstance(sds, tuple) else sds for name, sds in found.items()})
    assert of.recommended is None
    assert of.sentence.startswith(sentence)
    assert plan_report.build_plan_report(of.summary()).lead[0].kind == kind


def test_those_whose_range_overlaps_that_of_the_first_are_simulated_further():
    found = {
        ("a",): simulated(0.1, 0.2, 0.3), ("b",): simulated(0.25, 0.4, 0.5), ("c",): simulated(0.4, 0.5, 0.6),
        ("d",): simulated(None, None, 0.01),
    }  # fmt: skip
    assert (could_come_first(found), could_come_first({("d",): simulated(None, 0.1)})) == ([("a",), ("b",)], [])


def test_the_best_simulated_comes_first_and_what_was_only_looked_at_last():
    found = planned(a=simulated(0.3, 0.5), b=simulated(0.1, 0.2))  # of the third a first look of 0.001
    assert [one.names for one in found.measurements] == [("2:y",), ("1:y",), ("3:y",)]
    assert [one.ranked for one in found.measurements] == [True, True, False]
    (later,) = (
        replace(one, linearised=first_look.Linearised(("5:y",), np.array([0.002]))) for one in found.measurements[2:]
    )
    assert later.rank > found.measurements[2].rank


@pytest.mark.whole
def test_a_plan_repeats_itself_and_leads_to_a_report(cheap_posterior):
    case = jb.case_from_text("cheap", planned_text(('"5:rz"]\n', '"5:rz"]\nmax_measurements = 2\n')))
    told = []
    plan = jb.plan(case, cheap_posterior, seed=3, simulations=4, progress=told.append)
    summary = plan.summary()
    assert json.loads(json.dumps(summary, allow_nan=False)) == json.loads(
        json.dumps(jb.plan(case, cheap_posterior, seed=3, simulations=4).summary())
    )
    spreads = [one.sd_after for one in plan.measurements]
    assert spreads == sorted(spreads)
    assert plan.recommended is plan.measurements[0]
    assert len(plan.measurements) == 6  # three alone, three pairs
    assert plan.now.sd == pytest.approx(np.log(cheap_posterior.values("k12")).std(), rel=1e-9)
    assert [now.done for now in told if now.stage == "simulating"] == list(range(1, 25))
    assert set(plan.sentences) <= set(plan_report.plan_lines(plan))
    report = plan_report.build_plan_report(summary, plan.tested)
    assert (report.lead[0].text, report.lead[0].kind) == (plan.sentence, "good")
    assert [block.text for block in report.lead[1:-2]] == list(plan.notes)
    assert [block.identifier for block in report.lead[-2:]] == ["structure", "plan"]
    assert plan_report.plan_lines(plan)[: len(plan.sentences)] == list(plan.sentences)
    assert plan.notes[-1].startswith("This plan takes Young's modulus, density, length and damping ratio as exact")
    rows = plan_report.candidate_table(summary).rows
    assert [row[0].removesuffix(" (recommended)") for row in rows[:-1]] == [one.label for one in plan.measurements]
    assert any(row[:2] == ("3:y", "191.5 mm") for row in rows)


@pytest.mark.parametrize(("converged", "simulations"), [(True, 0), (False, 4)])
def test_without_simulations_or_draws_that_converged_there_is_only_a_first_look(
    cheap_posterior, converged, simulations
):
    posterior = replace(cheap_posterior, record=replace(cheap_posterior.record, converged=converged, reason="why"))
    plan = jb.plan(jb.case_from_text("cheap", planned_text()), posterior, simulations=simulations)
    assert plan.recommended is None
    assert all(one.simulation is None for one in plan.measurements)
    plan_report.build_plan_report(plan.summary())


def test_the_posterior_of_other_parameters_is_refused(cheap_posterior):
    case = jb.load_case(CONFIGS / "clamped_beam_uncertain.toml")
    refused(lambda: jb.plan(case, cheap_posterior), jb.CaseError, "other parameters")


@pytest.mark.whole
def test_the_command_prints_table_and_sentence_and_writes_a_whole_directory(tmp_path, monkeypatch):
    monkeypatch.setattr("jointbayes.studies.planning.make_plan.FIRST", 3)
    file, out = tmp_path / "cheap.toml", tmp_path / "plan"
    file.write_text(edited(planned_text(), ('"3:y", "5:rz"', '"1:y"')), encoding="utf-8")
    result = cli("plan", file, "--out", out, "--seed", "2")
    assert result.exit_code == 0, result.output
    assert re.search(r"^1:y \(recommended\) +0 mm .* identified +\d+ simulations$", result.stdout, re.MULTILINE)
    names = {p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file() and p.parent.name != "present"}
    reported = {"report.html", "report.pdf", "plan.json", "case.toml", "figures/plan.svg", "figures/structure.svg"}
    assert names == {*reported, "simulations.jsonl", ".jointbayes"}
    written = json.loads((out / "plan.json").read_text(encoding="utf-8"))
    assert written["sentence"] in result.stdout
    assert written["sentence"].startswith("Measure next: an accelerometer at the joint (1:y, 0 mm). ")
    assert {p.name for p in tmp_path.iterdir()} == {"cheap.toml", "plan"}


@pytest.mark.whole
def test_sets_that_a_plan_states_are_simulated_beside_single_candidates(cheap_posterior):
    stated = planned_text(
        ('"5:rz"]\n', '"5:rz"]\ntogether = [["5:rz", "3:y"], ["4 × averages", "3:y"], ["3:y", "5:rz"]]\n')
    )
    plan = jb.plan(jb.case_from_text("cheap", stated), cheap_posterior, simulations=2)
    assert sorted(one.names for one in plan.measurements if len(one.names) > 1) == [
        ("3:y", "4 × averages"), ("3:y", "5:rz"),
    ]  # fmt: skip
    assert all(one.simulation is not None for one in plan.measurements)
    assert len(plan.measurements) == 5


@pytest.mark.parametrize(("value", "found"), [
    ('[["3:y", "6:y"]]', 'found "6:y"; expected names of candidates: 3:y, 5:rz, 4 × averages; correct it'),
    ('[["3:y"]]', "found a list of 1"),
    ('["3:y"]', 'found the text "3:y" as entry 1'),
])  # fmt: skip
def test_a_stated_set_of_what_is_no_candidate_is_refused_in_one_line(value, found, cheap_posterior):
    text = planned_text(('"5:rz"]\n', f'"5:rz"]\ntogether = {value}\n'))
    told = refused(
        lambda: jb.plan(jb.case_from_text("cheap", text), cheap_posterior), jb.CaseError, f"plan.together: {found}"
    )
    assert told.startswith("cheap:")


def test_no_line_of_a_plan_in_a_notebook_is_longer_than_100_characters():
    found = planned(a=simulated(0.5, 0.5), b=simulated(0.1, 0.2), c=simulated(0.4, 0.5))
    assert max(map(len, repr(found).splitlines())) <= 100
    assert " ".join(repr(found).split()) == f"Plan for made up, 3 measurements: {found.sentence}"
