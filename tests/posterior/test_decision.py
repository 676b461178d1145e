"""What measured FRFs are analysed as: by their modes, with an error of the model, or as they are."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import linalg

import jointbayes as jb
from jointbayes.inference import ErrorSizes, ModelErrorNoise, Premises
from jointbayes.posterior.compared_frfs import compared_frfs_of
from jointbayes.posterior.decision import (
    TYPED,
    UsedMode,
    _matched,
    _moved,
    _numbered_by_evidence,
    check_best_fit,
    decide,
    modes_problem,
    premises_of,
    premises_sentences,
    unseen_inputs,
    why_by_modes,
)
from jointbayes.posterior.model_errors import InferredError, model_error_of
from jointbayes.workflow import answered_problem
from tests.case.refusal_rows import parts_named
from tests.conftest import CLAMP, CONFIGS, TABLE_3, TO_CONVERGE, cheap_text, edited, pair_matrix, rod, shipped_without
from vibrecords import ModeData, Observed
from vibrecords.mode_data import renumbered

EXACT = ErrorSizes(frequency=1e-9)


def as_measured(posterior, **changes):
    """The same posterior of FRFs that nobody computed."""
    data = replace(posterior.problem.test.data, synthetic=False)
    problem = posterior.problem.with_test(**({"data": data} | changes))
    return replace(posterior, problem=problem, case=None)


@pytest.fixture(scope="module")
def measured(cheap_posterior):
    return as_measured(cheap_posterior)


def of_another_truth(cheap_case, line):
    """Analysed as ever, of measured FRFs that this line of the truth makes."""
    text = edited(cheap_text(), ("k11 = 5.05e9", f"{line}\nk11 = 5.05e9"))
    data = jb.case_from_text("another", text).problem.test.data
    problem = cheap_case.problem.with_test(data=replace(data, synthetic=False))
    return replace(cheap_case, problem=problem, stated=problem, tests=())


def asked_of(posterior, sizes):
    """The problem of the modes that its FRFs show."""
    return modes_problem(posterior.problem, posterior.estimate, posterior.record.seed, sizes)


@pytest.fixture(scope="module")
def asked(measured):
    """The problem of the modes that they show, the errors of the model as usual."""
    return asked_of(measured, ErrorSizes())


def test_the_modes_of_the_model_are_numbered_as_they_are(measured, asked):
    predicted = measured.problem.natural_frequencies_hz(TABLE_3, 4)[0]
    resonances, zeros = asked.premises.modes[:3], asked.premises.modes[3:]
    assert [mode.number for mode in resonances] == [1, 2, 3]
    for mode in resonances:
        assert abs(mode.frequency_hz / predicted[mode.number - 1] - 1) < 0.002
    body = rod(elements=20)
    clamped, clamp, tip = body.stiffness.copy(), body.index(CLAMP.labels), body.index(("21:y",))
    clamped[np.ix_(clamp, clamp)] += pair_matrix(TABLE_3)
    kept = np.delete(np.arange(body.n_dofs), tip)
    squares = linalg.eigh(clamped[np.ix_(kept, kept)], body.mass[np.ix_(kept, kept)], eigvals_only=True)
    of_held = np.sqrt(squares[:4]) / (2 * np.pi)
    assert [(mode.number, mode.held) for mode in zeros] == [(1, "5:y"), (2, "5:y")]
    for zero in zeros:
        assert abs(zero.frequency_hz / of_held[zero.number - 1] - 1) < 0.002
    assert asked.test.data.zeros.dofs == ("5:y", "5:y")
    assert asked.test.data.shown_frfs is measured.problem.test.data
    assert asked.premises.left_out == ()
    assert asked.names == measured.problem.names


def test_zeros_are_counted_where_the_resonances_are(measured):
    """At a soft joint of the prior zeros are as near with one more below them: there the resonances are not."""
    soft = measured.problem.prior.parametrisation.coordinates([4.4e5, 3.5e4, 2.8e3])
    far = replace(measured.estimate, theta=np.asarray(soft), modes=())
    for estimate in (measured.estimate, far):
        asked = modes_problem(measured.problem, estimate, 1, ErrorSizes())
        assert [mode.number for mode in asked.premises.modes] == [1, 2, 3, 1, 2]


def test_a_mode_that_was_not_seen_leaves_the_numbers_of_the_others(measured):
    data = measured.problem.test.data
    asked = asked_of(as_measured(measured, data=replace(data.split([(0.0, 400.0)])[0], synthetic=False)), EXACT)
    assert [mode.number for mode in asked.premises.modes if not mode.held] == [2, 3]


def test_a_resonance_that_the_model_does_not_have_is_named_and_not_used(measured):
    frf = measured.problem.test.data.frf
    ripple = 3e-6 / (1 - (frf.frequency_hz / 1500) ** 2 + 0.02j * frf.frequency_hz / 1500)
    data = replace(measured.problem.test.data, frf=replace(frf, values=frf.values + ripple[:, None, None]))
    asked = asked_of(as_measured(measured, data=replace(data, synthetic=False)), ErrorSizes())
    (left_out,) = asked.premises.left_out
    assert left_out.startswith("The resonance at 150") or left_out.startswith("The resonance at 149")
    assert [mode.number for mode in asked.premises.modes if not mode.held] == [1, 2, 3]


@pytest.mark.parametrize(("away", "used"), [(0.099, True), (-0.099, True), (0.101, False), (-0.101, False)])
def test_a_resonance_farther_than_a_tenth_from_every_mode_is_not_used(away, used):
    seen = SimpleNamespace(frequency_hz=500.0 * math.exp(away))
    numbers, far, _ = _matched([seen, SimpleNamespace(frequency_hz=1000.0)], np.array([200.0, 500.0, 1000.0]))
    assert (numbers.tolist(), far) == (([2, 3], ()) if used else ([3], (0,)))


def test_modes_of_frfs_are_counted_by_what_is_most_probable_and_zeros_with_them(asked):
    wrong = replace(
        asked.with_test(data=renumbered(asked.test.data, 1)).with_premises(asked.premises),
        premises=replace(asked.premises, modes=tuple(_moved(mode, "", 1) for mode in asked.premises.modes)),
    )
    again = _numbered_by_evidence(wrong)
    assert [mode.number for mode in wrong.premises.modes] == [2, 3, 4, 2, 3]
    assert again.premises.modes == asked.premises.modes
    assert again.test.data.numbers == (1, 2, 3)
    assert again.test.data.zeros.numbers == (1, 2)
    assert again.test.noise.quantity == asked.test.noise.quantity
    (sentence,) = again.premises.numbering
    assert sentence.startswith("The natural frequencies fit far better as those of modes 1, 2, 3 than of modes 2, 3, 4")
    assert sentence in premises_sentences(replace(again.premises, reason="why"), None)
    assert asked.premises.numbering == ()


def test_typed_modes_that_are_others_are_named_and_their_model_is_none_of_the_structure():
    text = f"{TYPED_CASE}data.frequencies_hz = [1060.0, 2740.0, 5000.0]\nuncertain.exact = ['density', 'length']\n"
    right = jb.case_from_text("typed", f"{TYPED_CASE}uncertain.exact = ['length']\n", directory=CONFIGS)
    exact = right.problem.natural_frequencies_hz(TABLE_3, 5)[0]
    typed = ", ".join(f"{hz:.2f}" for hz in exact[2:])
    case = jb.case_from_text("typed", text.replace("1060.0, 2740.0, 5000.0", typed), directory=CONFIGS)
    answered = answered_problem(case.problem, case, jb.find_map(case, seed=1), 1)
    words = answered.premises.misnumbered
    assert words.startswith("fit far better as those of modes 3, 4, 5 than of modes 1, 2, 3")
    assert answered.test.data.numbers == (1, 2, 3)  # as they were stated
    error = InferredError(0.003, 0.001, 0.009, 0.003, misnumbered=words)
    assert error.grade == "impossible"
    assert error.findings[0] == f"natural frequencies {words}"
    assert error.causes == "Check the numbers of the modes."
    found = answered_problem(right.problem, right, jb.find_map(right, seed=1), 1)
    assert found.premises.misnumbered == ""


def test_a_joint_whose_only_test_shows_no_mode_leaves_the_answer_to_the_frfs(measured):
    test, prior = measured.problem.test, measured.problem.prior
    dark = replace(test.data.split([(200.0, 600.0)])[1], synthetic=False)  # between two resonances
    tests = [replace(test, name="seen"), replace(test, name="dark", data=dark)]
    both = jb.JointPrior(jb.blocks_of(dict.fromkeys(("seen", "dark"), prior.parametrisation)), prior.marginals * 2)
    twice = np.tile(measured.estimate.theta, 2)
    estimate = SimpleNamespace(theta=twice, places=twice[None])
    assert modes_problem(jb.Problem(tests, both), estimate, 1, ErrorSizes()) is None
    one_joint = modes_problem(jb.Problem(tests, prior), measured.estimate, 1, ErrorSizes())
    assert {mode.test for mode in one_joint.premises.modes} == {"seen"}


def test_a_model_that_nobody_says_is_exact_is_given_an_error(measured, cheap_posterior):
    computed = cheap_posterior.problem
    assert decide(computed, cheap_posterior.estimate, 1) is computed  # not measured: as they are
    decided = decide(measured.problem, measured.estimate, 1)
    assert decided.premises.of_modes
    assert re.fullmatch(
        r"the FRFs are sharper \(0\.0\d+ % of a natural frequency\) than the model \(0\.3 %\)", decided.premises.reason
    )
    assert decided.premises.model_error == ErrorSizes()


def test_a_model_that_is_stated_to_be_exact_is_where_it_explains_the_frfs_and_only_there(measured, cheap_case):
    assert decide(measured.problem, measured.estimate, 1, sizes=EXACT) is measured.problem
    heavier = of_another_truth(cheap_case, "accelerometer_mass_g = 20.0")
    decided = decide(heavier.problem, jb.find_map(heavier), 1, sizes=EXACT)
    assert decided.premises.reason == "the model does not explain the FRFs within their noise"


def test_the_best_fit_is_checked_as_the_draws_are(measured):
    (at_best,) = check_best_fit(measured.problem, measured.estimate, 1)
    assert at_best.explains
    assert at_best.chi2_per_line == pytest.approx(measured.check.chi2_per_line, rel=0.01)


@pytest.mark.science
@pytest.mark.long
def test_a_posterior_of_modes_is_kept_with_the_frfs_that_show_them(cheap_case, tmp_path):
    of_modes = jb.sample(of_another_truth(cheap_case, "length_mm = 383.5"), seed=1)
    of_modes.save(tmp_path / "posterior.nc")
    again = jb.load_posterior(tmp_path / "posterior.nc")
    assert again.problem.premises == of_modes.problem.premises
    frfs = again.problem.test.data.shown_frfs.frf
    np.testing.assert_array_equal(frfs.values, of_modes.problem.test.data.shown_frfs.frf.values)
    for name, truth in zip(of_modes.stiffness_names, TABLE_3, strict=True):
        assert again.interval(name) == of_modes.interval(name)
        low, high = of_modes.verdict(name).interval  # NaN where nothing is printed
        assert (truth < low, truth > high) == (False, False), name
    assert model_error_of(of_modes).grade == "usual"


@pytest.mark.science
@pytest.mark.long
def test_the_frfs_of_a_wrong_model_are_sure_of_a_wrong_joint_and_their_modes_hold_the_true_one(cheap_case):
    longer = of_another_truth(cheap_case, "length_mm = 383.5")
    settings = jb.SamplerSettings(walkers=16, max_steps=1500, tau_factor=20, end_tolerance=0.05)
    exact = jb.sample(longer, settings=settings, seed=1, premises="exact")
    assert exact.check.explains
    assert exact.verdict("k22").cls == "identified"
    assert exact.interval("k22")[1] < 0.9 * TABLE_3[2]
    assert not exact.problem.premises.of_modes
    low, high = jb.sample(longer, seed=1).verdict("k22").interval
    assert low < TABLE_3[2] < high


@pytest.mark.science
@pytest.mark.long
def test_frfs_in_another_unit_are_named_and_their_modes_say_the_same(cheap_case):
    text = cheap_text()
    data = jb.case_from_text("cheap", text).problem.test.data
    answers = []
    for factor in (1.0, 1000.0):
        frf = replace(data.frf, values=factor * data.frf.values)
        measured = replace(data, frf=frf, variance=factor**2 * data.variance, joint_frf=None, synthetic=False)
        problem = cheap_case.problem.with_test(data=measured)
        answers.append(jb.sample(replace(cheap_case, problem=problem, stated=problem, tests=()), seed=1))
    right, wrong = answers
    assert [frf.faults for frf in compared_frfs_of(right)[""]] == [()]
    assert not any("times as large" in sentence for sentence in premises_of(right))
    assert [frf.faults for frf in compared_frfs_of(wrong)[""]] == [("level",)]
    assert re.search(r"The FRFs are (9\d\d|1[01]\d\d) times as large as", " ".join(premises_of(wrong)))
    numbers = [[mode.number for mode in answer.problem.premises.modes] for answer in answers]
    assert numbers[0] == numbers[1]


TYPED_CASE = parts_named("rooms")["posterior/decision typed_case"]
MEASURED = "frequencies_hz = [120.0, 762.0, 2101.0], sd_relative = 0.005, sd_hz = 0.5"
SHAPES = "{ dofs = ['3:y'], reference = '5:y', components = [[0.5], [-0.4], [0.3]], sd = 0.05 }"
WITH_SHAPES = f"data = {{ kind = 'modes', {MEASURED}, shapes = {SHAPES} }}"


BODY = ("youngs_modulus", "density", "length")


@pytest.mark.parametrize(
    ("exact", "more", "error", "uncertain", "said"),
    [
        (["model", *BODY], "", False, (), ""),
        (["model"], "", False, (), ""),
        (BODY, "", True, (), ""),
        (["length"], "", True, ("youngs_modulus", "density"), "Young's modulus or density is further off"),
        pytest.param([], "", True, BODY, "Young's modulus, density or length is further off", marks=pytest.mark.long),
        pytest.param([], WITH_SHAPES, True, BODY, "", marks=pytest.mark.long),
    ],
)
def test_typed_modes_have_an_error_of_the_model_unless_it_is_exact_and_say_what_they_do_not_show(
    frequency_posterior, exact, more, error, uncertain, said
):
    case = jb.case_from_text("typed", f"{TYPED_CASE}{more}\nuncertain.exact = {list(exact)}\n", directory=CONFIGS)
    answered = answered_problem(case.problem, case, jb.find_map(case, seed=1), 1)
    assert isinstance(answered.test.noise, ModelErrorNoise) == error
    assert tuple(nuisance.name for nuisance in answered.prior.nuisances) == uncertain
    assert (answered.premises.reason == TYPED) == error
    assert not answered.premises.of_modes
    sentences = unseen_inputs(answered)
    assert [said in sentence for sentence in sentences] == [True] * bool(said)


def test_premises_may_be_another_table_of_what_is_uncertain(cheap_case):
    """As if the case stated it, with the same messages; a problem states its priors itself."""
    case = jb.case_from_text("typed", f'{TYPED_CASE}uncertain.exact = ["model", "density"]\n', directory=CONFIGS)
    table = {"exact": ["length"], "density": {"sd_percent": 1.0}, "model_error": {"frequency_error": 0.01}}
    answered = answered_problem(case.problem, case, jb.find_map(case, seed=1), 1)
    other = case.with_uncertain(table)
    of_other = answered_problem(other.problem, other, jb.find_map(other, seed=1), 1)
    assert answered is case.problem
    assert {nuisance.name for nuisance in of_other.prior.nuisances} == {"youngs_modulus", "density"}
    assert of_other.test.noise.sizes == ErrorSizes(frequency=0.01)
    for of, premises, kind, words in (
        (case, {"lenght": {"sd_percent": 1.0}}, jb.CaseError, r"typed:\d+: uncertain.lenght: unknown table"),
        (cheap_case.problem, {}, jb.ModelError, "premises: found a table for a problem, which has none"),
        (cheap_case, "extact", jb.ModelError, "premises: found 'extact'; expected \"usual\", \"exact\", a table as"),
        (cheap_case, {"exact": ["density"], "density": {"sd_percent": 1.0}}, jb.CaseError,
         r'uncertain\.exact: found "density", whose prior \[uncertain\.density\] states'),
    ):  # fmt: skip
        with pytest.raises(kind, match=words):
            jb.sample(of, premises=premises)


def test_the_errors_of_a_model_are_put_on_and_taken_off_a_problem(cheap_case):
    problem = jb.case_from_text("typed", TYPED_CASE, directory=CONFIGS).problem
    premises = Premises(model_error=ErrorSizes(frequency=0.02), asked="As I was told.")
    wrong = problem.with_premises(premises)
    assert wrong.premises == premises
    assert wrong.test.noise.sizes == premises.model_error
    theta = problem.prior.mean[None]
    right = wrong.with_premises(Premises())
    assert right.log_posterior(theta) == problem.log_posterior(theta)
    assert wrong.log_posterior(theta) > problem.log_posterior(theta)  # which is far from the data
    assert cheap_case.problem.with_premises(premises).test.noise is cheap_case.problem.test.noise  # of FRFs it has none


def test_what_nobody_stated_is_as_uncertain_as_in_a_workshop_and_what_is_declared_exact_is_exact(cheap_posterior):
    data = replace(cheap_posterior.problem.test.data, synthetic=False)
    declared = jb.case_from_text("cheap", f'{cheap_text()}\n[uncertain]\nexact = ["density", "length"]\n')
    for case, names in ((None, {"youngs_modulus", "density", "length"}), (declared, {"youngs_modulus"})):
        stated = case or jb.case_from_text("cheap", cheap_text())
        freed = stated.workshop_problem.with_test(data=data)
        problem = as_measured(cheap_posterior).problem
        asked = modes_problem(problem, cheap_posterior.estimate, 1, ErrorSizes(), freed)
        assert names <= set(asked.names)
        assert not {"density", "length"} - names & set(asked.names)
        assert [mode.number for mode in asked.premises.modes if not mode.held] == [1, 2, 3]


@pytest.mark.science
def test_draws_of_two_springs_in_a_thin_sheet_have_the_quantiles_of_a_grid():
    data = ModeData(Observed(np.array([116.8, 726.5]), np.array([0.02, 0.1])))
    prior = jb.JointPrior(jb.PlainSprings(), (jb.Uniform(18.0, 26.0), jb.Uniform(11.0, 19.0)))
    test = jb.Test("clamped", rod(), CLAMP, data, ModelErrorNoise.of(data, ErrorSizes()))
    problem = jb.Problem([test], prior)
    quick = jb.sample(problem, seed=1, premises="exact")
    assert quick.problem.names == problem.names
    # the middles of cells, which the prior's edges bound
    axes = 18.0 + 8.0 * (np.arange(80) + 0.5) / 80, 12.2 + 2.0 * (np.arange(1500) + 0.5) / 1500
    points = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    density = np.concatenate([problem.log_posterior(rows) for rows in np.array_split(points, 200)])
    mass = np.exp(density - density.max()).reshape(80, 1500)
    for column, axis in enumerate(axes):
        share = mass.sum(axis=1 - column) / mass.sum()
        below = np.cumsum(share) - share / 2
        for probability in (0.025, 0.5, 0.975):
            drawn = float((quick.theta[:, column] <= np.interp(probability, below, axis)).mean())
            effective = min(quick.record.sampler["ess"].values())
            assert abs(drawn - probability) < 4 * math.sqrt(probability * (1 - probability) / effective)


@pytest.mark.parametrize(
    ("stated", "explains", "reason"),
    [
        # the best of three resonances has an sd of 2⁻¹⁰ of it; that of the antiresonance does not count
        (2**-10, True, ""),
        (np.nextafter(2**-10, 1), True, "sharper (0.098 % of a natural frequency) than the model (0.098 %)"),
        (2**-9, True, "sharper (0.098 % of a natural frequency) than the model (0.2 %)"),
        (1e-9, False, "the model does not explain the FRFs within their noise"),
        (1e-9, True, ""),
    ],
)
def test_frfs_are_analysed_by_modes_where_their_noise_is_below_the_models_error_or_they_are_not_explained(
    stated, explains, reason
):
    seen = [(64.0, 2**-3, ""), (256.0, 2**-2, ""), (512.0, 2.0, ""), (32.0, 2**-20, "5:y")]
    used = tuple(UsedMode("", i, hz, sd, held) for i, (hz, sd, held) in enumerate(seen, 1))
    checks = [SimpleNamespace(explains=True), SimpleNamespace(explains=explains)]
    why = why_by_modes(ErrorSizes(frequency=stated), used, lambda: checks)
    assert bool(why) == bool(reason)
    assert reason in why


@pytest.mark.parametrize(
    ("median", "stated", "grade"),
    [
        (0.01, 0.003, "usual"),
        (np.nextafter(0.01, 1), 0.003, "large"),
        (0.03, 0.003, "large"),
        (np.nextafter(0.03, 1), 0.003, "impossible"),
        (0.02, 0.02, "usual"),  # no worse than it is stated to be
        (0.06, 0.02, "large"),
        (0.0601, 0.02, "impossible"),
    ],
)
def test_an_inferred_error_of_the_model_has_a_grade(median, stated, grade):
    assert InferredError(median, median / 2, 2 * median, stated).grade == grade
    assert InferredError(0.4e-4, 0.0, 0.9e-4, stated).grade == "negligible"


@pytest.mark.parametrize(
    ("spring", "shift", "grade", "found"),
    [
        (0.02, 1.5, "usual", ""),
        (np.nextafter(0.02, 1), 0.0, "large", "spring"),
        (0.1, -2.0, "large", "spring"),
        (np.nextafter(0.1, 1), 0.0, "impossible", "spring"),
        (0.0, np.nextafter(1.5, 2), "large", "edge"),
        (0.0, -np.nextafter(1.5, 2), "large", "edge"),
        (0.0, np.nextafter(2.0, 3), "impossible", "edge"),
    ],
)
def test_springs_and_shifts_of_what_moves_all_modes_have_a_grade_and_are_named(spring, shift, grade, found):
    error = InferredError(0.003, 0.001, 0.009, 0.003, spring, {"length": 0.2, "edge": shift})
    assert error.grade == grade
    assert found in " ".join(error.findings)
    assert bool(found) == bool(error.findings)


@pytest.mark.whole
def test_a_run_of_modes_of_which_the_first_was_not_measured_is_read_again(tmp_path):
    text = shipped_without("measured_stations", "uncertain.model_error", "data.channels", "data.rotations", "reference")
    text = edited(text, ("elements = 10", "elements = 4"), ("f_min_hz = 20.0", "f_min_hz = 400.0"))
    text += '[data.channels]\n"Point:11:Y+" = "5:y"\n'
    case = jb.case_from_text("from the second on", text, directory=CONFIGS)
    posterior = jb.sample(case, seed=1, settings=TO_CONVERGE)
    assert posterior.problem.premises.modes[0].number == 2
    posterior.save(tmp_path / "posterior.nc")
    again = jb.load_posterior(tmp_path / "posterior.nc")
    assert again.interval("k22") == posterior.interval("k22")
    assert again.case.workshop_problem is not None or posterior.case.workshop_problem is None
