"""What the joint does in a structure that was never tested: against dense modes, and what is said of its limits."""

import json
from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.posterior import other_structure
from jointbayes.posterior.model_errors import model_error_of
from jointbayes.rounding import number
from jointbayes.studies.lobes import Cut, limiting_depth
from jointbayes.studies.predict import read_other
from tests.case.refusal_rows import parts_named
from tests.conftest import TO_CONVERGE, cli, shipped_text

TIP = jb.Ports(np.arange(20.0, 1200.0, 10.0), ("11:y",), ("11:y",))
ASKED = parts_named("rooms")["posterior/other_structure asked"]
LOBES = parts_named("rooms")["posterior/other_structure lobes"]


def recipe_of(posterior):
    """The beam of the run, with the nodes that `TIP` names."""
    return replace(posterior.problem.test.structures.recipe, elements=10)


@pytest.fixture(scope="module", name="wrong_model")
def _wrong_model():
    """A posterior that allows for an error of the model in each natural frequency."""
    text = shipped_text("clamped_beam_frequencies").replace('exact = ["model"]', "")
    text = text.replace("[120.0, 762.0, 2101.0]", "[120.5, 741.0, 2044.0, 3890.0]")
    return jb.sample(jb.case_from_text("wrong", text), seed=1, settings=TO_CONVERGE)


def test_the_structure_of_the_run_is_predicted_as_the_run_predicts_it(cheap_posterior):
    found = cheap_posterior.predict(recipe_of(cheap_posterior), TIP)
    band = cheap_posterior.predict_frf(jb.Ports(TIP.frequency_hz, ("5:y",), ("5:y",)))  # the same place
    np.testing.assert_allclose(found.frf.magnitude_high, band.magnitude_high, rtol=1e-6)
    np.testing.assert_allclose(found.frf.phase_deg, band.phase_deg, rtol=1e-6, atol=1e-6)


def test_a_body_a_problem_and_a_posterior_of_it_are_predicted_as_its_recipe_is(cheap_posterior):
    recipe = recipe_of(cheap_posterior)
    expected = cheap_posterior.predict(recipe, TIP, max_draws=5)
    body = recipe.structure()
    problem = cheap_posterior.problem.with_test(structure=jb.BeamFamily(recipe, {}))
    for other in (body, problem, replace(cheap_posterior, problem=problem)):
        found = cheap_posterior.predict(other, TIP, max_draws=5)
        np.testing.assert_allclose(found.frequency_hz, expected.frequency_hz, rtol=1e-6)
        np.testing.assert_allclose(found.values, expected.values, rtol=1e-5)


def test_natural_frequencies_of_another_length_are_those_of_dense_modes_of_each_draw(cheap_posterior):
    longer = replace(recipe_of(cheap_posterior), length=0.5)
    found = cheap_posterior.predict(longer, TIP, max_draws=5)
    whole, joint = longer.structure(), jb.Joint(("1:y", "1:rz"))
    at = whole.unit_forms(joint.labels)
    rows = cheap_posterior.thinned(5)
    for matrix, frequency in zip(cheap_posterior.problem.prior.matrix(rows).stiffness, found.frequency_hz, strict=True):
        exact = whole.modes(at @ matrix @ at.T).frequency_hz[: frequency.size]
        assert frequency == pytest.approx(exact, rel=1e-6)
    low, high = found.interval(1)
    assert low <= np.median(found.frequency_hz[:, 0]) <= high
    assert found.damping_ratio == pytest.approx(0.01)


def test_a_length_is_measured_anew_and_a_modulus_is_that_of_the_tested_bar(cheap_posterior):
    recipe = recipe_of(cheap_posterior)
    certain = cheap_posterior.predict(recipe, TIP).frequency_hz[:, 0]
    one_percent = jb.Nuisance("length", "mm", 383.0, jb.Normal(0.0, 0.01))
    found = cheap_posterior.predict(recipe, TIP, uncertain=[one_percent]).frequency_hz[:, 0]
    spread = np.sqrt(np.log(found).std() ** 2 - np.log(certain).std() ** 2)
    assert spread == pytest.approx(0.02, rel=0.2)  # f falls with the square of the length
    stiffer = jb.Nuisance("youngs_modulus", "GPa", 210.0, jb.Normal(0.0, 0.02))
    with_e = cheap_posterior.predict(recipe, TIP, uncertain=[stiffer]).frequency_hz[:, 0]
    assert np.log(with_e).std() > 3 * np.log(certain).std()


def test_the_modulus_that_the_run_inferred_is_shared_draw_by_draw_unless_it_is_said_to_be_its_own(wrong_model):
    recipe = recipe_of(wrong_model)
    theta, names = wrong_model.thinned(400), wrong_model.problem.names
    shared = wrong_model.predict(recipe, TIP).frequency_hz[:, 2]
    own = wrong_model.predict(recipe, TIP, own=frozenset({"youngs_modulus"})).frequency_hz[:, 2]
    modulus = theta[:, names.index("youngs_modulus")]
    correlations = [abs(np.corrcoef(modulus, np.log(f))[0, 1]) for f in (shared, own)]
    assert correlations[0] > 0.3
    assert correlations[0] > correlations[1] + 0.1  # two standard errors of 400 draws, which differ by processor


def test_the_error_of_the_model_is_as_large_as_the_data_show_it(wrong_model):
    shown = model_error_of(wrong_model)
    assert shown is not None
    found = wrong_model.predict(recipe_of(wrong_model), TIP)
    assert any("error in natural frequencies" in sentence for sentence in found.premises)
    modal = wrong_model.predict_natural_frequencies(1, 400)[:, 0]
    scatter = np.log(found.frequency_hz[:, 0]).std()
    assert scatter > np.log(modal).std()
    # the band of an FRF at its peak is as wide as the interval of the frequency moves it
    peak = int(found.frf.magnitude[:, 0, 0].argmax())
    assert found.frf.magnitude_high[peak, 0, 0] > 1.5 * found.frf.magnitude_low[peak, 0, 0]


def test_an_error_of_the_model_moves_frequencies_and_lines_alike(wrong_model, monkeypatch):
    """A mode higher by 5 % is that of a structure stiffer by 1.05²: its FRF is the other's at f / 1.05, over 1.05²."""
    recipe, error = recipe_of(wrong_model), 0.05
    monkeypatch.setattr(other_structure, "_model_errors", lambda *_: None)
    certain = wrong_model.predict(recipe, replace(TIP, frequency_hz=TIP.frequency_hz / (1 + error)), max_draws=20)
    monkeypatch.setattr(
        other_structure, "_model_errors", lambda *given: np.full_like(given[5], error) * np.ones((20, 1))
    )
    found = wrong_model.predict(recipe, TIP, max_draws=20)
    np.testing.assert_allclose(found.frequency_hz[:, :2], (1 + error) * certain.frequency_hz[:, :2], rtol=1e-9)
    np.testing.assert_allclose(found.values, certain.values / (1 + error) ** 2, rtol=1e-6)


def test_dashpots_of_the_joint_keep_their_damping_ratio_in_a_mode_that_is_higher():
    """K' = g K and C' = √g C: the FRF is H(f / √g) / g also with dashpots in the joint."""
    problem = jb.case_from_text("damped", shipped_text("rotor_dampers")).problem
    theta, grown = problem.prior.sample(np.random.default_rng(1), 5), 1.21
    label = problem.test.joints.labels[0]
    ports = jb.Ports(np.linspace(5.0, 100.0, 30), (label,), (label,))
    inner = jb.Ports(ports.frequency_hz / np.sqrt(grown), (label,), (label,))
    errors = np.full((5, 3), np.sqrt(grown) - 1)
    found = other_structure._frfs(problem, theta, ports, errors, np.array([20.0, 50.0, 90.0]))
    expected = other_structure._frfs(problem, theta, inner, None, np.array([20.0]))
    np.testing.assert_allclose(found, expected / grown, rtol=1e-6)


def test_what_was_never_asked_of_the_joint_is_said(cheap_posterior):
    recipe, top = recipe_of(cheap_posterior), cheap_posterior.problem.test.data.band_hz[1]
    below, beyond = (jb.Ports(np.linspace(20, share * top, 20), ("11:y",), ("11:y",)) for share in (1.49, 1.51))
    assert cheap_posterior.predict(recipe, below).never_asked == ()
    (said,) = cheap_posterior.predict(recipe, beyond).never_asked
    assert "depends on frequency" in said
    spatial = replace(recipe, dofs_per_node=5)
    (said,) = cheap_posterior.predict(spatial, below).never_asked
    assert "holds 1 along x, z, ry" in said


def test_another_material_has_a_modulus_of_its_own(wrong_model):
    recipe = recipe_of(wrong_model)
    aluminium = replace(recipe, material=replace(recipe.material, youngs_modulus=7e10))
    modulus = wrong_model.thinned(400)[:, wrong_model.problem.names.index("youngs_modulus")]
    frequency = wrong_model.predict(aluminium, TIP).frequency_hz[:, 1]
    assert abs(np.corrcoef(modulus, np.log(frequency))[0, 1]) < 0.3


class TestCommand:
    @pytest.fixture(name="home")
    def _home(self, tmp_path, cheap_posterior):
        cheap_posterior.save(tmp_path / "posterior.nc")
        (tmp_path / "base.toml").write_text(shipped_text("clamped_beam"))
        (tmp_path / "longer.toml").write_text('extends = "base.toml"\n[structure]\nlength_mm = 500.0\n' + ASKED)
        return tmp_path

    @pytest.fixture(name="ran")
    def _ran(self, home, monkeypatch, plain_reports):
        monkeypatch.chdir(home)
        return cli("predict", "posterior.nc", "longer.toml", "--out", "there")

    def test_it_writes_the_same_numbers_everywhere(self, home, ran, cheap_posterior):
        assert ran.exit_code in (0, 3), ran.output
        kept = json.loads((home / "there" / "prediction.json").read_text())
        expected = cheap_posterior.predict(replace(recipe_of(cheap_posterior), length=0.5), TIP)
        assert kept["modes"][0]["frequency_hz"] == pytest.approx(np.median(expected.frequency_hz[:, 0]), rel=1e-6)
        shown = f"mode 1: {expected.rows()[0][1]}"
        assert shown in ran.output
        page = (home / "there" / "report.html").read_text()
        assert f"first natural frequency will be {expected.rows()[0][1]}" in page
        head, first, *_ = (home / "there" / "frf.csv").read_text().splitlines()
        assert head.startswith("frequency_hz,11:y/11:y median")
        assert float(first.split(",")[1]) == pytest.approx(expected.frf.magnitude[0, 0, 0], rel=1e-6)

    def test_lobes_are_those_of_the_predicted_tip(self, home, monkeypatch, plain_reports, cheap_posterior):
        (home / "longer.toml").write_text('extends = "base.toml"\n' + ASKED + LOBES)
        monkeypatch.chdir(home)
        ran = cli("predict", "posterior.nc", "longer.toml", "--out", "there")
        assert ran.exit_code in (0, 3), ran.output
        head, *rows = (home / "there" / "lobes.csv").read_text().splitlines()
        table = np.array([[float(x) for x in row.split(",")] for row in rows])
        assert head.startswith("speed_rpm,depth_mm 2.5 %,")
        assert (np.diff(table[:, 1:], axis=1) >= 0).all()
        lines = np.arange(20.0, 1200.1, 0.25)
        tip = cheap_posterior.predict(recipe_of(cheap_posterior), jb.Ports(lines, ("11:y",), ("11:y",)), max_draws=200)
        cut = Cut(3, 600e6, 0.2, 0.25, up=False)
        each = [limiting_depth(cut, lines, frf, frf, table[:, 0]) for frf in tip.values[:, :, 0, 0]]
        assert table[:, 3] == pytest.approx(1e3 * np.median(each, axis=0), rel=1e-2)
        assert f"{number(table[:, 1].min(), 3)} mm at every speed" in ran.output
        assert "Stability lobes" in (home / "there" / "report.html").read_text()

    @pytest.mark.parametrize(
        ("text", "place", "words"),
        [
            (ASKED + LOBES.replace('x = "11:y"', 'x = "99:y"'), ": predict.lobes.x", "99:y"),
            (ASKED + LOBES.replace("immersion = 0.25", "immersion = 25"), ": predict.lobes.immersion", "25"),
            ("[structure]\nlength_mm = 500.0\n", "longer.toml:1: predict", "missing"),
            (ASKED.replace('outputs = ["11:y"]', 'outputs = ["99:y"]'), "longer.toml:3", "there is no node 99"),
            (ASKED.replace("f_max_hz = 1200", "f_max_hz = 10"), "longer.toml", "f_m"),
            (ASKED.replace("f_step_hz = 10", ""), "longer.toml:3: predict.f_step_hz", "missing"),
        ],
    )
    def test_a_slip_is_named_by_file_line_and_key(self, home, text, place, words):
        (home / "longer.toml").write_text('extends = "base.toml"\n' + text)
        with pytest.raises(jb.CaseError) as refused:
            read_other(home / "longer.toml")
        assert place in str(refused.value)
        assert words in str(refused.value)
