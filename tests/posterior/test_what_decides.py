"""Which uncertain input matters most: best fits found anew, widths of first order, each against another way to it."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.posterior.identifiability import assess, ratio_of
from jointbayes.posterior.knowledge import UncertainInputsRow, _row
from jointbayes.posterior.posterior import gather_knowledge
from jointbayes.posterior.what_decides import InputAlone, WhatDecides, _off, what_decides
from jointbayes.report.model import Figure, Table
from jointbayes.report.sections.identifiable import _decides_blocks, range_sentences
from tests.conftest import CONFIGS, edited
from tests.posterior.test_stored_file import copied, refusal, replaced

TEXT = (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def posterior():
    return jb.sample(jb.case_from_text("main", TEXT), seed=1)


@pytest.fixture(scope="module")
def known(posterior):
    return gather_knowledge(posterior)


@pytest.fixture(scope="module")
def found(known):
    assert known.decides is not None
    return known.decides


def test_the_length_decides_and_the_damping_does_not(found):
    assert [each.name for each in found.inputs] == ["length", "youngs_modulus", "density", "damping_ratio"]
    assert list(found.exact) == list(found.together) == ["k22", "k12"]
    assert found.sentence.startswith(
        "**Length matters most.** With all exact k12 is 29.4 to 61.1 MN, with one alone uncertain: length "
    )
    assert found.sentence.endswith(" Damping ratio hardly matters.")


@pytest.mark.parametrize(
    ("name", "key", "stated"), [("youngs_modulus", "youngs_modulus_gpa", 210.0), ("length", "length_mm", 383.0)]
)
def test_the_best_fit_moves_as_that_of_a_case_with_the_other_value(found, posterior, name, key, stated):
    row = next(each for each in found.inputs if each.name == name)
    sd = next(n.prior.sd for n in posterior.case.workshop_problem.prior.nuisances if n.name == name)
    higher = stated * math.exp(sd)
    made = ("\n[data.truth]", f"\n[data.truth]\n{key} = {stated}")
    text = edited(TEXT, (f"{key} = {stated}", f"{key} = {higher!r}"), made)
    refit = jb.find_map(jb.case_from_text("moved", text))
    assert refit.values[2] == pytest.approx(row.best["k22"][1], rel=2e-3)
    assert row.off == ((f"{100 * sd:g} % lower"), (f"{100 * sd:g} % higher"))


@pytest.mark.parametrize("name", ["youngs_modulus", "density"])
def test_widths_of_first_order_are_those_of_draws(found, posterior, name):
    problem = posterior.case.workshop_problem
    sampled = _row(posterior, problem, (name,), np.random.default_rng(5))
    row = next(each for each in found.inputs if each.name == name)
    for k in ("k12", "k22"):
        drawn, of_first_order = (math.log(ratio_of(ends)) for ends in (sampled.interval(k), row.interval95[k]))
        assert of_first_order == pytest.approx(drawn, rel=0.15)


def test_the_report_has_a_bar_for_each_or_a_row_where_an_end_is_at_zero(found):
    names = "all exact", "length ±0.5 %", "Young's modulus ±3 %", "density ±1 %", "damping ratio ±3.8 times"
    figure = _decides_blocks(found)[-1]
    assert isinstance(figure, Figure)
    assert figure.identifier == "tornado"
    of_k22 = {**found.inputs[0].interval95, "k22": (0.0, 2e6)}
    table = _decides_blocks(replace(found, inputs=(replace(found.inputs[0], interval95=of_k22), *found.inputs[1:])))[-1]
    assert isinstance(table, Table)
    assert [row[0] for row in table.rows] == [*names, "all uncertain"]


def alone(name, ends, best=(0.9, 1.1), fits=(True, True), off=("2 % lower", "2 % higher")):
    return InputAlone(name, off, {"k": ends}, {"k": best}, fits)


KNOWN = replace(assess(np.exp(0.01 * np.random.default_rng(1).normal(size=4000)), np.exp(np.arange(3.0))), unit="N/m")


@pytest.mark.parametrize(
    ("rows", "said", "if_off"),
    [
        (
            [alone("density", (0.5, 2.0)), alone("length", KNOWN.interval95, (math.nan, 3.0))],
            "**Density matters most.** With all exact k is 0.981 to 1.020 N/m, with one alone uncertain: density "
            "0.500 to 2.00 N/m. Length hardly matters.",
            "If an input is off, the best fit of k goes from 1.00 N/m to: density 2 % lower: 0.900 N/m (-10 %), "
            "2 % higher: 1.10 N/m (+10 %); length 2 % lower: an end of its prior's range, 2 % higher: 3.00 N/m (× 3).",
        ),
        (
            [alone("density", KNOWN.interval95, fits=(False, False))],
            "None of density alone makes an interval more than 10 % wider.",
            "With density off by 2 % no joint fits the data.",
        ),
    ],
)
def test_what_is_said_of_inputs(rows, said, if_off):
    found = WhatDecides(tuple(rows), {"k": KNOWN}, {}, {"k": 1.0})
    assert (found.sentence, found.if_off) == (said, if_off)


@pytest.mark.parametrize(
    ("nuisance", "off"),
    [
        (jb.Nuisance("length", "mm", 383.0, jb.Normal(0.0, 0.02)), "2 %"),
        (jb.Nuisance("length_offset", "mm", 1000.0, jb.Normal(0.0, 0.0015)), "1.5 mm"),
        (jb.Nuisance("damping_ratio", "1", 0.01, jb.Uniform(-2.0, 2.0)), "3.2 times"),
    ],
)
def test_an_uncertainty_is_told_in_per_cent_in_its_unit_or_as_a_factor(nuisance, off):
    assert _off(nuisance) == (f"{off} lower", f"{off} higher")


def test_nothing_is_said_where_no_stiffness_is_known_anyway(posterior):
    exact = {name: replace(posterior.verdict(name), verdict="not identified") for name in posterior.stiffness_names}
    problem = posterior.case.workshop_problem
    assert what_decides(problem, ("density",), posterior.problem.names, posterior.mode_theta, exact, {}) is None


def test_what_the_range_of_a_prior_decides_is_said_with_its_figure():
    reason = "the prior's lower bound 1e4 N limits it, and the data exclude only 2 % of the prior"
    held = replace(KNOWN, verdict="not identified", verdict_reason=reason)
    rows = UncertainInputsRow((), "this run", {"k": KNOWN}), UncertainInputsRow(("length",), "none", {"k": held})
    assert range_sentences(SimpleNamespace(freed=rows)) == (f"With length uncertain the prior decides on k: {reason}.",)
    assert range_sentences(SimpleNamespace(freed=())) == ()


def test_a_file_keeps_it_with_combinations_mesh_and_diagnoses_and_refuses_what_does_not_belong_together(
    posterior, known, tmp_path, monkeypatch
):
    posterior.save(tmp_path / "draws.nc", known)
    for name in ("what_decides", "name_directions", "check_mesh", "diagnose"):
        monkeypatch.setattr(f"jointbayes.posterior.posterior.{name}", lambda *_: pytest.fail("found anew"))
    again = gather_knowledge(jb.load_posterior(tmp_path / "draws.nc"))
    assert again.mesh == posterior.mesh
    assert repr(again.diagnoses) == repr(posterior.diagnoses)
    assert repr((again.directions, again.decides)) == repr((known.directions, known.decides))  # NaN is unlike itself
    for place, value, said in (
        (("decides", "exact"), {}, r"decides.exact: found \[\]"),
        (("decides", "best", "k22"), 0.0, r"decides.best: found \['k12'\]"),
        (("decides", "inputs"), [], r"decides.inputs: found \[\]"),
        (("decides", "inputs", 1, "interval95", "k22"), None, r"decides.inputs: found \[.*\['k12'\]"),
        (("diagnoses",), [], "diagnoses: found 0; expected 1"),
        (("diagnoses", 0, "modes", 0, "measured_hz"), 0.0, r"diagnoses.modes: found \[ModeError"),
    ):
        change = replaced(("knowledge", *place), value)
        assert re.search(said, refusal(copied(tmp_path, tmp_path / "draws.nc", change)))
