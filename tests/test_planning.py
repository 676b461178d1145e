import datetime
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import jointbayes as jb
from jointbayes.case_candidates import HeavierFamily, candidates_of
from jointbayes.case_objects import beam_recipe
from jointbayes.cli import main
from jointbayes.frf import DirectSolve, Ports
from jointbayes.inference import CorrelatedNoise
from jointbayes.joint import ComplianceChart, LogStiffness, joint_matrix
from jointbayes.measurement import RelativeNoise
from jointbayes.posterior.candidates import Candidate, StatedVariance, estimated_law, repeated
from jointbayes.posterior.fisher import FisherInformation, fisher_information
from jointbayes.posterior.planning import (
    choose,
    forecast,
    joint_gain,
    measurement_information,
    plan_sentence,
    sd_of,
    verdict_on,
)
from jointbayes.posterior.planning_check import (
    Confirmation,
    WithFurther,
    assumed_truth,
    confirm,
    spread_after,
    weighted_posterior,
)
from jointbayes.report.plan import build_plan_report, candidate_table
from jointbayes.structure import BeamFamily
from jointbayes.workflow import charts
from tests.conftest import CONFIGS, TABLE_3, cheap_frequencies_text, cheap_text, edited

TRUTH = np.log(TABLE_3)
LAW = RelativeNoise(0.03, 0.01)


def made(**arrays):
    """Information about a joint and one nuisance, made up."""
    data = np.asarray(arrays["data"], dtype=float)
    return FisherInformation(
        ("k11", "k12", "k22", "length"), np.zeros(4), data, np.diag([0.0, 0.0, 0.0, 4.0]), np.full(4, 5.0),
        LogStiffness(),
    )  # fmt: skip


def accelerometer(case, *outputs, law=LAW):
    problem, data = case.problem, case.spec.data
    ports = Ports(np.array(data.lines_hz()), outputs, data.inputs)
    words = f"an accelerometer at {' and '.join(outputs)}"
    return Candidate(
        "+".join(outputs), "accelerometer", words, problem.structure, problem.family, ports, "receptance", law
    )


def planned_text(*changes):
    """The small case with a [plan] of two accelerometers."""
    return edited(cheap_text() + '\n[plan]\nparameter = "k12"\noutputs = ["3:y", "5:rz"]\n', *changes)


def test_information_adds_over_independent_measurements(cheap_case):
    both = measurement_information(accelerometer(cheap_case, "3:y", "4:y"), cheap_case.problem, TRUTH)
    one, other = (
        measurement_information(accelerometer(cheap_case, dof), cheap_case.problem, TRUTH) for dof in ("3:y", "4:y")
    )
    np.testing.assert_allclose(both, one + other, rtol=1e-9, atol=1e-9 * np.abs(both).max())
    assert np.linalg.eigvalsh(one).min() > -1e-9 * np.abs(one).max()


def test_the_information_of_a_candidate_is_that_of_the_case_which_measures_it(cheap_case):
    """The extended case, its noise law at the truth, says the same as present case and candidate together."""
    extended = jb.case_from_text("both", edited(cheap_text(), ('outputs = ["5:y"]', 'outputs = ["5:y", "3:y"]')))
    candidate = accelerometer(cheap_case, "3:y", law=RelativeNoise(0.01, 0.002))
    added = measurement_information(candidate, cheap_case.problem, TRUTH)
    whole = fisher_information(cheap_case.problem, TRUTH).data + added
    np.testing.assert_allclose(whole, fisher_information(extended.problem, TRUTH).data, rtol=1e-6)


def test_a_repeated_measurement_doubles_the_information_and_halves_the_variance(cheap_case):
    problem = cheap_case.problem
    candidate = repeated(problem, 2.0)
    fisher = fisher_information(problem, TRUTH)
    found = forecast(fisher, {candidate.name: measurement_information(candidate, problem, TRUTH)}, [candidate], "k22")
    assert found.sd_after / found.sd_before == pytest.approx(math.sqrt(0.5), rel=1e-6)
    assert found.gain_bits == pytest.approx(1.5, abs=0.05)  # half a bit for each of the three coordinates


def test_simulated_repetitions_halve_the_variance_where_the_posterior_is_gaussian():
    """With the joint itself measured all three stiffnesses are known to a part in a hundred or better."""
    text = edited(cheap_text(), ('outputs = ["5:y"]', 'outputs = ["5:y", "1:y", "1:rz"]'))
    problem = jb.case_from_text("joint measured", text).problem
    fisher, chart, rng = fisher_information(problem, TRUTH), charts(problem), np.random.default_rng(1)
    theta, log_weight = weighted_posterior(problem.log_posterior, TRUTH, fisher.covariance(), chart, rng, 4000)
    weight = np.exp(log_weight - log_weight.max())
    draws = theta[rng.choice(len(theta), 4000, p=weight / weight.sum())]
    for parameter in ("k11", "k12", "k22"):
        found = confirm(problem, [repeated(problem, 2.0)], parameter, draws, chart, rng, simulations=4)
        assert found.valid
        assert found.sd_before == pytest.approx(sd_of(fisher, parameter), rel=0.1)
        assert found.sd_after / found.sd_before == pytest.approx(math.sqrt(0.5), rel=0.1)
        assert found.gain_bits == pytest.approx(1.5, abs=0.3)


def test_averages_reduce_the_variance_of_all_frfs_in_hand_and_new_together(cheap_case):
    new = repeated(cheap_case.problem, 4.0).problem(cheap_case.problem, TRUTH).measurement.variance
    old = cheap_case.problem.measurement.variance
    np.testing.assert_allclose(1 / (1 / new + 1 / old), old / 4)


def test_greedy_and_exhaustive_choice_agree_on_one_measurement(cheap_case):
    problem = cheap_case.problem
    fisher = fisher_information(problem, TRUTH)
    candidates = [accelerometer(cheap_case, dof) for dof in ("2:y", "3:y", "4:y", "5:rz")]
    information = {c.name: measurement_information(c, problem, TRUTH) for c in candidates}
    for by in ("sd", "gain"):
        one = choose(fisher, information, 1, "k12", by=by, exhaustive=False)
        assert one == choose(fisher, information, 1, "k12", by=by, exhaustive=True)
        best = min(candidates, key=lambda c: _loss(fisher, information, c, by))
        assert one == (best.name,)


def _loss(fisher, information, candidate, by):
    found = forecast(fisher, information, [candidate], "k12")
    return found.sd_after if by == "sd" else -found.gain_nats


def test_exhaustive_choice_finds_the_pair_that_one_at_a_time_misses():
    """Alone c is best for k12; together a and b are, each of which sees k12 only along with a nuisance of its own."""
    fisher = made(data=np.diag([1.0, 0.1, 1.0, 0.0]))
    sees = {"a": [0, 3.0, 0, 3.0], "b": [0, 3.0, 0, -3.0], "c": [0, 2.5, 0, 0]}
    information = {name: np.outer(v, v) for name, v in sees.items()}
    assert choose(fisher, information, 2, "k12", exhaustive=True) == ("a", "b")
    assert choose(fisher, information, 2, "k12", exhaustive=False)[0] == "c"
    assert choose(fisher, information, 2, "k12") == ("a", "b")
    assert set(choose(fisher, information, 9, "k12")) == set(sees)


def test_the_gain_marginalises_the_nuisances():
    before = made(data=np.diag([1.0, 1.0, 1.0, 0.0]))
    nuisance_only = replace(before, data=before.data + np.diag([0, 0, 0, 100.0]))
    assert joint_gain(before, nuisance_only) == pytest.approx(0.0, abs=1e-12)
    doubled = replace(before, data=2 * before.data)
    weak = 1 / 25  # a uniform prior of standard deviation 5 counts as a normal one
    assert joint_gain(before, doubled) == pytest.approx(1.5 * math.log((2 + weak) / (1 + weak)))


def test_what_no_data_see_keeps_the_width_of_its_prior():
    blind = made(data=np.diag([1.0, 1e-30, 1.0, 0.0]))
    assert sd_of(blind, "k12") == 5.0
    assert verdict_on(blind, "k12", 0.01) == "identified"
    assert verdict_on(blind, "k12", 5.0) == "not identified"
    with pytest.raises(jb.ModelError, match="found parameter 'k33'"):
        sd_of(blind, "k33")


def test_choosing_nothing_is_refused():
    with pytest.raises(jb.ModelError, match="candidates to choose"):
        choose(made(data=np.eye(4)), {}, 1, "k12")


@pytest.mark.parametrize(
    ("words", "spread", "sentence"),
    [
        (
            ["an accelerometer at mid-span (6:y)"],
            (1.97, 0.15),
            "An accelerometer at mid-span (6:y) takes k12 from a factor of 7.2 to 16 %.",
        ),
        (["a b", "c d"], (0.2, 0.1), "A b and c d take k12 from 22 % to 11 %."),
        (["4 times the averages"], (0.02, 0.01), "4 times the averages take k12 from 2 % to 1 %."),
    ],
)
def test_the_sentence_says_factor_or_percent(words, spread, sentence):
    assert plan_sentence(words, "k12", *spread) == sentence


def test_the_tip_alone_does_not_identify_k12_and_mid_span_repairs_it():
    case = jb.load_case(CONFIGS / "clamped_beam_uncertain.toml")
    theta = assumed_truth(case.problem, np.concatenate([TRUTH, np.zeros(4)]), TABLE_3)
    fisher = fisher_information(case.problem, theta)
    mid = next(c for c in candidates_of(case) if c.name == "6:y")
    found = forecast(fisher, {"6:y": measurement_information(mid, case.problem, theta)}, [mid], "k12")
    assert 1.8 < found.sd_before < 2.2
    assert 0.13 < found.sd_after < 0.17
    assert (found.verdict_before, found.verdict_after) == ("not identified", "weakly identified")
    assert found.words == ("an accelerometer at mid-span (6:y)",)


def test_a_noise_law_is_estimated_from_the_variance(cheap_case):
    exact = jb.case_from_text("exact", edited(cheap_text(), ("added = true", "added = false")))
    law = estimated_law(exact.problem.measurement)
    assert (law.relative, law.floor) == pytest.approx((0.01, 0.002), rel=1e-6)
    noisy = estimated_law(cheap_case.problem.measurement)
    assert noisy.relative == pytest.approx(0.01, rel=0.1)


def test_a_stated_variance_belongs_to_frfs_of_its_shape():
    with pytest.raises(jb.ModelError, match="repeated measurement"):
        StatedVariance(np.ones((3, 1, 1))).variance(np.ones((2, 1, 1), dtype=complex))


def test_simulated_noise_has_the_stated_variance_and_none_without_a_generator(cheap_case):
    candidate = accelerometer(cheap_case, "3:y")
    exact = candidate.problem(cheap_case.problem, TRUTH)
    noisy = candidate.problem(cheap_case.problem, TRUTH, np.random.default_rng(1))
    z = (noisy.measurement.frf.values - exact.measurement.frf.values) / np.sqrt(exact.measurement.variance)
    assert (np.abs(z) ** 2).mean() == pytest.approx(1.0, abs=4 / math.sqrt(z.size))
    structure, joint = cheap_case.problem.structure, cheap_case.problem.joint
    direct = DirectSolve(structure, joint, candidate.ports).receptance(joint_matrix(TABLE_3))[0]
    np.testing.assert_allclose(exact.measurement.frf.values, direct, atol=1e-9 * np.abs(direct).max())


def test_a_correlated_discrepancy_follows_the_lines_of_the_candidate():
    text = (
        cheap_text() + "\n[noise.discrepancy]\nlength_low_hz = 20.0\nlength_high_hz = 300.0\n[plan]\nf_max_hz = 3000.0"
    )
    case = jb.case_from_text("discrepancy", text)
    names = [c.name for c in candidates_of(case)]
    assert not any("averages" in name for name in names)
    with pytest.raises(jb.ModelError, match="averages do not reduce it"):
        repeated(case.problem, 2.0)
    band = next(c for c in candidates_of(case) if c.kind == "band")
    theta = np.concatenate([TRUTH, np.log([1.0, 50.0])])
    found = band.problem(case.problem, theta, np.random.default_rng(1))
    assert isinstance(found.noise, CorrelatedNoise)
    np.testing.assert_array_equal(found.noise.frequency_hz, found.measurement.frf.frequency_hz)


def test_a_wider_band_adds_only_its_own_lines_with_the_floor_of_all():
    case = jb.case_from_text("wide", cheap_text() + "\n[plan]\nf_max_hz = 3000.0\n")
    band = next(c for c in candidates_of(case) if c.kind == "band")
    measured = band.problem(case.problem, TRUTH).measurement
    present = case.problem.measurement.frf.frequency_hz
    np.testing.assert_allclose(np.diff(np.concatenate([present[-1:], measured.frf.frequency_hz])), 10.0)
    assert measured.frf.frequency_hz[-1] == 3000.0
    ports = Ports(np.concatenate([present, measured.frf.frequency_hz]), ("5:y",), ("5:y",))
    whole = DirectSolve(case.problem.structure, case.problem.joint, ports).receptance(joint_matrix(TABLE_3))[0]
    expected = RelativeNoise(0.01, 0.002).variance(whole)[present.size :]
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
    added = by_name["3:y"].structure.mass - case.problem.structure.mass
    at = case.problem.structure.index(("3:y",))[0]
    assert added[at, at] == pytest.approx(0.020)
    assert np.count_nonzero(added) == 1
    assert by_name["hammer 3:y"].structure is case.problem.structure


@pytest.mark.parametrize("own", [0.0, 15.0])
def test_an_added_mass_is_exactly_known_beside_an_uncertain_beam_and_accelerometer(own):
    base = edited(
        (CONFIGS / "clamped_beam_uncertain.toml").read_text(encoding="utf-8"),
        ("elements = 10", f"elements = 10\naccelerometer_mass_g = {own}"),
    )
    text = base.replace("[plan]", "[plan]\nadded_mass_g = 50.0")
    if own:
        text = text.replace(
            "[uncertain.density]", "[uncertain.accelerometer_mass]\nsd_percent = 10.0\n[uncertain.density]"
        )
    case = jb.case_from_text("mass", text)
    family = next(c for c in candidates_of(case) if c.kind == "mass").family
    assert isinstance(family, HeavierFamily)
    assert family.names == case.problem.family.names
    names = family.names
    factors = np.array([{"density": 1.02, "length": 0.995, "accelerometer_mass": 0.9}.get(n, 1.01) for n in names])
    recipe = beam_recipe(case.spec.structure, case.spec.data)
    expected = recipe.structure(dict(zip(names, factors.tolist(), strict=True)))
    mass = np.array(expected.mass)
    at = expected.index(("11:y",))[0]
    mass[at, at] += 0.050
    by_hand = replace(expected, mass=mass)
    np.testing.assert_allclose(family.structure(factors).mass, mass, rtol=1e-12)
    found, _ = family.free_modes(np.eye(len(expected.dofs))[:, [at]])(factors[None])
    modes = by_hand.modes()
    np.testing.assert_allclose(found[0][2:8], modes.eigenvalues[2:8], rtol=1e-6)
    np.testing.assert_allclose(family.damping_ratios(factors[None])[0, 0], 0.0101)
    assert family.loss_factors(factors[None]).tolist() == [0.0]
    assert isinstance(case.problem.family, BeamFamily)


def test_densities_of_independent_measurements_add(cheap_case):
    further = accelerometer(cheap_case, "3:y").problem(cheap_case.problem, TRUTH, np.random.default_rng(1))
    density = WithFurther(cheap_case.problem.log_posterior, [further, further])
    theta = np.array([TRUTH, TRUTH + np.array([0.1, 0.0, 0.01]), [0.0, 50.0, 0.0]])
    found = density(theta)
    expected = cheap_case.problem.log_posterior(theta[:2]) + 2 * further.log_posterior.log_likelihood(theta[:2])
    np.testing.assert_allclose(found[:2], expected)
    assert found[2] == -np.inf


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
    with pytest.raises(jb.ModelError, match="outside the prior"):
        assumed_truth(case.problem, mode, [1.0, 1.0, 1.0])


def test_weighted_draws_are_of_the_density_over_the_parameters_not_over_the_chart():
    def density(theta):
        value = -0.5 * (((theta - TRUTH) / 0.2) ** 2).sum(axis=1)
        return np.where(LogStiffness().feasible(theta), value, -np.inf)

    chart, rng = ComplianceChart(LogStiffness()), np.random.default_rng(1)
    theta, log_weight = weighted_posterior(density, TRUTH, 0.04 * np.eye(3), [chart], rng, 8000)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    np.testing.assert_allclose(weight @ theta, TRUTH, atol=0.02)
    np.testing.assert_allclose(np.sqrt(weight @ (theta - TRUTH) ** 2), 0.2, rtol=0.08)


def test_too_few_importance_draws_are_no_posterior(cheap_case):
    candidate, rng = accelerometer(cheap_case, "3:y"), np.random.default_rng(1)
    arguments = cheap_case.problem, [candidate], "k12", TRUTH, charts(cheap_case.problem), rng
    assert spread_after(*arguments, inner=20) is None
    assert spread_after(*arguments, inner=1000) is not None


def test_confirming_nothing_is_refused(cheap_case):
    chart, rng = charts(cheap_case.problem), np.random.default_rng(1)
    with pytest.raises(jb.ModelError, match="0 candidates"):
        confirm(cheap_case.problem, [], "k12", np.zeros((5, 3)), chart, rng)


def test_a_plan_repeats_itself_and_leads_to_a_report(cheap_posterior):
    case = jb.case_from_text("cheap", planned_text(('"5:rz"]\n', '"5:rz"]\nmax_measurements = 2\n')))
    plan = jb.plan(case, cheap_posterior, seed=3, simulations=2)
    summary = plan.summary()
    assert json.loads(json.dumps(summary, allow_nan=False)) == json.loads(
        json.dumps(jb.plan(case, cheap_posterior, seed=3, simulations=2).summary())
    )
    spreads = [f.sd_after for f in plan.forecasts]
    assert spreads == sorted(spreads)
    assert len(plan.best.names) == 2
    assert plan.best.names in plan.confirmations
    assert plan.best.sd_after <= spreads[0]
    assert plan.sentence.startswith(("An accelerometer at mid-span (3:y) and", "A rotational", "4 times"))
    report = build_plan_report(summary, datetime.date(2026, 1, 1))
    assert report.lead[0].text == plan.sentence
    table = candidate_table(summary)
    assert [row[0] for row in table.rows][: len(spreads)] == [f.names[0] for f in plan.forecasts]
    assert " + ".join(plan.best_set.names) in [row[0] for row in table.rows]


def _with(plan, sds, simulated=4):
    """The plan with made-up simulations of its first candidate."""
    found = Confirmation(2.0, np.array(sds), np.full(len(sds), 1.0), simulated, 0.5)
    return replace(plan, confirmations={plan.forecasts[0].names: found}, best_set=plan.forecasts[0])


def test_fisher_is_confirmed_only_by_simulations_that_say_the_same(cheap_posterior):
    plan = jb.plan(jb.case_from_text("cheap", planned_text()), cheap_posterior, simulations=0)
    first = plan.forecasts[0]
    assert plan.confirmed(first) is None
    assert "No simulated measurements stand behind this." in plan.sentence
    assert plan.note in plan.text()
    same, wider = _with(plan, [first.sd_after] * 4), _with(plan, [2 * first.sd_after] * 4)
    assert same.confirmed(first)
    assert "bear this out" in same.sentence
    assert not wider.confirmed(first)
    assert "say otherwise" in wider.sentence
    assert "no, 2 ×" in candidate_table(wider.summary()).rows[0]
    lost = _with(plan, [first.sd_after], simulated=4)
    assert not lost.confirmed(first)
    assert "3 of 4 lost" in candidate_table(lost.summary()).rows[0]
    assert _with(plan, [1.5] * 4).verdict_after(first.names) == "not identified"


def test_the_posterior_of_other_parameters_is_refused(cheap_posterior):
    case = jb.load_case(CONFIGS / "clamped_beam_uncertain.toml")
    with pytest.raises(jb.CaseError, match="other parameters"):
        jb.plan(case, cheap_posterior)


def test_the_command_prints_table_and_sentence_and_writes_a_whole_directory(tmp_path, monkeypatch):
    file, out = tmp_path / "cheap.toml", tmp_path / "plan"
    file.write_text(planned_text(), encoding="utf-8")
    result = CliRunner().invoke(main, ["plan", str(file), "--out", str(out), "--seed", "2"])
    assert result.exit_code == 0, result.output
    assert re.search(r"^3:y +\d.* identified +(yes|no, [\d.]+ ×) ", result.stdout, re.MULTILINE)
    assert "takes k12 from" in result.stdout
    names = {p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file()}
    assert names == {"report.html", "report.pdf", "plan.json", "case.toml", "figures/plan.svg"}
    written = json.loads((out / "plan.json").read_text(encoding="utf-8"))
    assert written["sentence"] in result.stdout
    assert {p.name for p in tmp_path.iterdir()} == {"cheap.toml", "plan"}
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").write_text("mine")
    refused = CliRunner().invoke(main, ["plan", str(file), "--out", str(tmp_path / "other")])
    assert refused.exit_code == 2
    assert "holds other files" in refused.stderr


def test_natural_frequencies_cannot_be_planned(tmp_path):
    file = tmp_path / "frequencies.toml"
    file.write_text(cheap_frequencies_text(), encoding="utf-8")
    result = CliRunner().invoke(main, ["plan", str(file)])
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert "found natural frequencies as data" in result.stderr
