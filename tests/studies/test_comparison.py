"""Comparing joints: hypotheses, words, the same-data rule, prior edges, files and the command."""

import dataclasses
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.joint import RIGID
from jointbayes.posterior.decision import only_modes
from jointbayes.posterior.evidence import Evidence
from jointbayes.posterior.evidence_table import EvidenceTable, bayes_factor_words
from jointbayes.studies import compare as weigh
from tests.conftest import CONFIGS, cheap_frequencies_text, cheap_text, cli, edited, pair_matrix
from tests.one_line import refused

#: Coordinates under each hypothesis; None for those of the case.
YIELDING = {
    "rigid": (),
    "translation": ("k11",),
    "rotation": ("k22",),
    "springs": ("k11", "k22"),
    "full": None,
    "coupled": None,
    "undamped springs": ("k11", "k22"),
}


def frequencies_text(*changes, hypotheses=("rigid", "springs")):
    text = re.sub(r"hypotheses = \[[^\]]*\]", f"hypotheses = {json.dumps(hypotheses)}", cheap_frequencies_text())
    return edited(text, *changes)


@pytest.fixture(scope="module")
def cases():
    """Two free lengths, the same measured frequencies."""
    return (
        jb.case_from_text("long", frequencies_text(("length_mm = 360.0", "length_mm = 383.0"))),
        jb.case_from_text("short", frequencies_text()),
    )


@pytest.fixture(scope="module")
def comparison(cases):
    return jb.compare(cases, seed=3)


def made_up(log_z, hypothesis="rotation", *, method="bridge sampling", error=0.01, converged=True, at_edge=()):
    """A candidate whose numbers nobody computed."""
    evidence = Evidence(log_z, error, method, 100)
    stiffness = np.array([RIGID, 0.0, 2e5])
    model = weigh.WeighedModel("case", "A case", hypothesis, ("k22",), stiffness, evidence, at_edge)
    return replace(model, converged=converged)


# ---- words and probabilities


@pytest.mark.parametrize(("two_log_b", "words"), [
    (0.0, "not worth more than a bare mention"), (1.99, "not worth more than a bare mention"), (2.01, "positive"),
    (5.99, "positive"), (6.01, "strong"), (9.99, "strong"), (10.01, "very strong"), (1e9, "very strong"),
])  # fmt: skip
def test_bayes_factors_are_graded_as_by_kass_and_raftery(two_log_b, words):
    assert bayes_factor_words(two_log_b) == words


def test_probabilities_are_in_the_ratio_of_the_evidences_however_small_these_are():
    table = EvidenceTable({"a": -5000.0, "b": -5000.0 + np.log(3), "c": -9000.0})
    np.testing.assert_allclose([*table.probabilities.values()], [0.25, 0.75, 0.0], atol=1e-12)
    assert table.two_log_b("a") == pytest.approx(2 * np.log(3))
    assert table.two_log_b("b", "a") == pytest.approx(-2 * np.log(3))
    assert [*table.ranking] == ["b", "a", "c"]
    assert table.pooled("bac".find).log_z == {1: -5000.0, 0: table.log_z["b"], 2: -9000.0}
    assert table.pooled(len).log_z[1] == pytest.approx(np.log(4 / 3) - 5000.0)


# ---- hypotheses


def test_a_hypothesis_keeps_the_priors_of_what_may_yield_and_holds_the_rest(cases):
    problem = cases[0].problem
    assert problem.names == ("k11", "k22", "rho")
    for hypothesis, names in YIELDING.items():
        found = weigh.hypothesis_problem(problem, hypothesis)
        assert found.names == (problem.names if names is None else names)
        assert found.test.data is problem.test.data
        for name, marginal in zip(found.names, found.prior.marginals, strict=True):
            assert marginal == problem.prior.marginals[problem.names.index(name)]
    k11, k12, k22 = weigh.hypothesis_problem(problem, "rotation").prior.values(np.log([2e5]))
    assert (k11, k12, k22) == (RIGID, 0.0, pytest.approx(2e5))
    refused(lambda: weigh.hypothesis_problem(problem, "loose"), jb.ModelError, "expected one of rigid, translation")


def test_what_else_is_uncertain_stays_so_under_every_hypothesis():
    problem = jb.case_from_text("uncertain", cheap_text() + "\n[uncertain.youngs_modulus]\nsd_percent = 2.0\n").problem
    for hypothesis in weigh.HYPOTHESES:
        assert weigh.hypothesis_problem(problem, hypothesis).names[-1] == "youngs_modulus"
    assert weigh.hypothesis_problem(problem, "rigid").names == ("youngs_modulus",)


@pytest.mark.whole
def test_measured_frfs_are_weighed_by_the_modes_that_all_cases_have_a_place_for(cheap_case):
    data = replace(cheap_case.problem.test.data, synthetic=False)
    cases = []
    for name, length in (("true", "383.0"), ("short", "300.0")):
        case = jb.case_from_text(name, edited(cheap_text(), ("length_mm = 383.0", f"length_mm = {length}")))
        problem = case.problem.with_test(data=data)
        cases.append(replace(case, problem=problem, stated=problem, tests=()))
    assert weigh._data_of(cases[0].problem) == weigh._data_of(cases[1].problem)
    true, short = weigh._answered([weigh.Compared.of(case) for case in cases], 1, lambda _: None).values()
    used = [{mode.resonance for mode in problem.premises.modes} for problem in (true, short)]
    assert used[0] == used[1] != set()
    np.testing.assert_array_equal(np.sort(true.test.data.values), np.sort(short.test.data.values))
    few = set(sorted(used[0])[:2])
    of_few = only_modes(true, few)
    assert ({mode.resonance for mode in of_few.premises.modes}, of_few.test.data.values.size) == (few, 2)
    assert of_few.test.data.shown_frfs is data
    refused(lambda: only_modes(true, {("", "", 1.0)}), jb.ModelError, "found no resonance near a mode of every model")


@pytest.mark.whole
def test_a_rigid_joint_has_the_likelihood_itself_as_evidence(cases, comparison):
    rigid = comparison.candidates[0]
    expected = cases[0].problem.log_posterior.likelihood.log_likelihood(pair_matrix([[1e30, 0.0, 1e30]]))[0]
    assert (rigid.hypothesis, rigid.names, rigid.evidence.log_z) == ("rigid", (), pytest.approx(expected, abs=1e-9))
    assert (rigid.evidence.method, rigid.evidence.error) == ("exact", 0.0)


# ---- the whole


def test_candidates_come_case_by_case_and_the_best_is_that_of_the_largest_evidence(comparison):
    labels = [c.label for c in comparison.candidates]
    assert labels == ["rigid in long", "springs in long", "rigid in short", "springs in short"]
    log_z = [c.evidence.log_z for c in comparison.candidates]
    assert comparison.best.label == labels[int(np.argmax(log_z))] == "springs in short"
    assert [c.evidence.log_z for c in comparison.ranking] == sorted(log_z, reverse=True)
    assert comparison.probabilities.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(
        np.log(comparison.probabilities[1] / comparison.probabilities[0]), log_z[1] - log_z[0], rtol=1e-9
    )
    assert comparison.two_log_b(comparison.candidates[1]) == pytest.approx(2 * (max(log_z) - log_z[1]))
    assert comparison.words(comparison.best) == "best"


def test_each_search_starts_from_the_modes_of_the_joint_with_more_coordinates(cases, monkeypatch):
    known = []

    def noted(problem, **options):
        known.append((problem.names, options["floor"], problem.known_theta))
        return found(problem, **options)

    found = weigh.find_map
    monkeypatch.setattr(weigh, "find_map", noted)
    text = frequencies_text(hypotheses=("rotation", "springs"))
    both = jb.compare([jb.case_from_text("short", text)], seed=3).candidates
    (springs, none, first), (rotation, floor, second) = known
    assert (springs, rotation, none) == (("k11", "k22"), ("k22",), -np.inf)
    assert floor == pytest.approx(both[1].evidence.log_z - 100, abs=2)
    assert len(second) == len(first) + 1
    np.testing.assert_allclose(np.exp(second[-1][0]), both[1].stiffness[2], rtol=1e-6)  # the spring that both have


def test_a_joint_that_is_out_of_the_question_is_not_drawn_from(monkeypatch):
    drawn, found = [], weigh.draws_of
    monkeypatch.setattr(weigh, "draws_of", lambda problem, *more: drawn.append(problem.names) or found(problem, *more))
    case = jb.case_from_text("short", frequencies_text(hypotheses=("translation", "springs")))
    translation, springs = jb.compare([case], seed=3).candidates
    assert drawn == [("k11", "k22")]
    assert (translation.evidence.method, springs.evidence.method) == ("Laplace", "bridge sampling")
    assert springs.evidence.log_z - translation.evidence.log_z > 100
    assert translation.trusted


@pytest.mark.science
def test_nested_sampling_where_asked_agrees_with_the_draws():
    case = jb.case_from_text("short", frequencies_text(hypotheses=("rotation", "springs")))
    drawn, nested = (jb.compare([case], seed=3, nested=asked).candidates for asked in (False, True))
    for one, other in zip(drawn, nested, strict=True):
        assert other.evidence.method == "nested sampling"
        assert abs(one.evidence.log_z - other.evidence.log_z) < 4 * other.evidence.error < 1.5


@pytest.mark.whole
def test_the_same_seed_gives_the_same_evidence_whatever_else_is_compared(cases, comparison):
    alone = jb.compare(cases[1:], seed=3)
    assert [c.evidence.log_z for c in alone.candidates] == [c.evidence.log_z for c in comparison.candidates[2:]]
    assert abs(jb.compare(cases[1:], seed=4).candidates[1].evidence.log_z - alone.candidates[1].evidence.log_z) > 1e-6


def of(case, log_z, hypothesis="rotation", **changes):
    return dataclasses.replace(made_up(log_z, hypothesis, **changes), case=case)


def test_the_verdict_decides_where_the_evidence_is_strong():
    found, close = (jb.Comparison((of("long", low), of("short", -10.0)), 1, "") for low in (-20.0, -10.5))
    assert list(found.by_case) == ["short", "long"]
    assert (found.decided, close.decided) == (True, False)
    with pytest.raises(AttributeError, match=r"Comparison has no attribute 'verdict': use \.finding"):
        _ = close.verdict
    assert repr(close) == f"Comparison of 2 joints: {close.finding}"


def test_a_joint_is_excluded_over_all_cases_and_not_by_the_best_case_alone():
    # what docs/comparison.md weighs: rigid is impossible at 360 mm, and has probability 0.04 at 383 mm
    log_z = {"springs": (-13.95, -18.15), "full": (-14.44, -16.49), "rigid": (-941.80, -16.45), "rotation": (-40, -41)}
    every = [
        of(case, z, joint) for joint, both in log_z.items() for case, z in zip(("short", "long"), both, strict=True)
    ]
    found = jb.Comparison(tuple(every), 1, "")
    assert found.probabilities[5] == pytest.approx(
        np.exp(-16.45) / np.exp([-13.95, -14.44, -16.45, -16.49, -18.15]).sum()
    )
    mean = {joint: np.log(np.mean(np.exp(both))) for joint, both in log_z.items()}
    assert found.by_joint == pytest.approx(mean)
    assert found.sentences[1:] == (
        "Cannot decide between springs without coupling and with coupling: odds 1.5 to 1.",
        "Excluded in every case: springs in rotation only (odds 10¹¹ to 1).",
    )
    assert 10.5 < np.log10(np.exp(mean["springs"] - mean["rotation"])) < 11.5


def test_cases_are_named_by_the_one_number_in_which_they_differ(cases):
    assert weigh.what_differs(cases) == {"long": "length 383 mm", "short": "length 360 mm"}
    changes = ("length_mm = 360.0", "length_mm = 350.0"), ("walkers = 8", "walkers = 10")
    other = jb.case_from_text("other", frequencies_text(*changes))
    assert weigh.what_differs([cases[0], other]) == {"long": "long", "other": "other"}
    assert weigh.what_differs(cases[:1]) == {"long": "long"}
    shipped = [jb.load_case(CONFIGS / f"clamped_beam_frequencies{end}.toml") for end in ("", "_360mm")]
    assert list(weigh.what_differs(shipped).values()) == [
        "length 383 mm",
        "length 360 mm",
    ]  # also the paper's iteration


@pytest.mark.parametrize(("method", "error", "converged", "trusted"), [
    ("bridge sampling", 0.49, True, True), ("bridge sampling", 0.51, True, False),
    ("bridge sampling", 0.1, False, False), ("bridge sampling", np.inf, True, False), ("Laplace", np.nan, True, True),
])  # fmt: skip
def test_an_evidence_is_trusted_up_to_an_error_of_one_half_if_its_draws_converged(method, error, converged, trusted):
    candidate = made_up(-10.0, method=method, error=error, converged=converged)
    assert (candidate.trusted, jb.Comparison((candidate, made_up(-11.0, "springs")), 1, "").trusted) == (
        trusted,
        trusted,
    )


# ---- the same data


def test_cases_of_other_data_are_refused_by_name(cases):
    other = jb.case_from_text("other", frequencies_text(("120.0, 762.0", "121.0, 762.0")))
    with pytest.raises(jb.CaseError, match="found other data in other than in long; expected the same"):
        jb.compare([*cases, other])
    noisier = jb.case_from_text("noisier", frequencies_text(("sd_hz = 0.5", "sd_hz = 0.6")))
    refused(lambda: weigh.require_same_data([cases[0], noisier]), jb.CaseError, "noisier")
    refused(lambda: weigh.require_same_data([cases[0], cases[0]]), jb.CaseError, "two cases named long")
    refused(lambda: jb.compare([]), jb.CaseError, "found no case")
    weigh.require_same_data(cases)


# ---- prior edges


def test_problems_and_posteriors_are_compared_as_their_case_is(cases, comparison):
    posterior = jb.sample(cases[1], seed=3, settings=jb.SamplerSettings(max_steps=200))
    for given in (posterior, replace(cases[1].problem, name="short")):
        (springs,) = [c for c in jb.compare([given], seed=3).candidates if c.hypothesis == "springs"]
        (expected,) = [c for c in comparison.candidates if (c.case, c.hypothesis) == ("short", "springs")]
        assert (springs.case, springs.names) == ("short", expected.names)
        assert springs.evidence.log_z == pytest.approx(expected.evidence.log_z, abs=0.1)
    refused(lambda: jb.compare([3]), jb.ModelError, "found 3; expected a case, a problem, a posterior or the path")


def test_a_posterior_that_piles_up_on_an_edge_of_its_prior_is_marked_and_no_other(comparison):
    assert comparison.best.at_edge == ()
    # at 383 mm the springs want to be rigid: k11 has no upper end but the prior's
    changes = ("length_mm = 360.0", "length_mm = 383.0"), ("high = 1.0e11", "high = 3.0e9")
    case = jb.case_from_text("narrow", frequencies_text(*changes, hypotheses=("springs",)))
    (found,) = jb.compare([case], seed=2).candidates
    # and k22, which takes over what k11 may not have
    assert [(edge.name, edge.side) for edge in found.at_edge] == [("k11", "high"), ("k22", "high")]
    assert found.at_edge[0].probability > 0.1


# ---- files


def test_the_summary_is_json_without_infinities_and_says_what_is_rigid(comparison):
    summary = comparison.summary()
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    rigid = summary["candidates"][0]
    assert (rigid["rigid"], rigid["map"]) == (["k11", "k22"], {"k11": None, "k12": 0.0, "k22": None})
    assert (summary["best"], summary["candidates"][3]["words"]) == ({"case": "short", "hypothesis": "springs"}, "best")
    assert sum(row["probability"] for row in summary["candidates"]) == pytest.approx(1.0)


def test_the_table_has_the_best_first_and_aligned_columns(comparison):
    table = weigh.evidence_table(comparison.summary())
    assert table.rows[0][:2] == ("springs", "short")
    assert "best" in table.rows[0][-1]
    assert table.row_kinds[0] == "good"
    lines = table.lines()
    assert len(lines) == 5
    column = lines[0].index("Method")
    assert {line[column:].split()[0] for line in lines} == {"Method", "bridge", "exact"}


def test_a_report_states_the_verdict_first_and_what_is_not_to_be_trusted(comparison):
    report = weigh.build_comparison_report(comparison.summary())
    assert comparison.finding in report.lead[0].text
    assert report.lead[0].kind == "good"
    log_z = comparison.best.evidence.log_z
    near = dataclasses.replace(comparison.candidates[0], evidence=Evidence(log_z - 0.5, 0.1, "exact", 1))
    undecided = weigh.build_comparison_report(jb.Comparison((comparison.best, near), 1, "").summary()).lead[0]
    assert (undecided.kind, "Cannot decide" in undecided.text) == ("caution", True)
    doubtful = dataclasses.replace(comparison.best, evidence=Evidence(-14.0, 0.9, "bridge sampling", 1))
    report = weigh.build_comparison_report(jb.Comparison((doubtful, comparison.candidates[0]), 1, "").summary())
    assert report.lead[0].kind == "caution"
    assert "error of the evidence is unreliable for: springs in short" in report.lead[1].text


# ---- command


def write(place, name, text):
    (place / name).write_text(text, encoding="utf-8")
    return place / name


@pytest.mark.whole
def test_compare_prints_the_table_and_the_winner_and_leaves_a_whole_directory(tmp_path, cases, comparison):
    files = [write(tmp_path, f"{case.name}.toml", case.text) for case in cases]
    out = tmp_path / "out"
    result = cli("compare", *files, "--seed", 3, "--out", out)
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    count = len(comparison.sentences)
    assert tuple(lines[:count]) == comparison.sentences
    assert lines[count : count + 5] == weigh.evidence_table(comparison.summary()).lines()
    assert {p.name for p in tmp_path.iterdir()} == {"long.toml", "short.toml", "out"}
    listed = {str(p.relative_to(out)) for p in out.rglob("*") if p.is_file()}
    assert listed == {
        "report.html", "report.pdf", "compare.json", "cases/long.toml", "cases/short.toml",
        "figures/structure.svg", "references.bib", ".jointbayes",
    }  # fmt: skip
    assert json.loads((out / "compare.json").read_text(encoding="utf-8")) == comparison.summary()
    assert (out / "report.pdf").read_bytes().startswith(b"%PDF-")
    assert "Length 360 mm, not 383 mm: odds 10 to 1" in (out / "report.html").read_text(encoding="utf-8")
    comparison.write(out)  # an earlier comparison may be replaced
    assert {str(p.relative_to(out)) for p in out.rglob("*") if p.is_file()} == listed
