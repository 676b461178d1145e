"""Inputs that no machine has are errors with their key; inputs that are probably slips are warnings that name them."""

import datetime
import math
import re
from dataclasses import replace
from typing import get_args

import pytest
from pydantic import BaseModel

import jointbayes as jb
from jointbayes.case import plausibility
from jointbayes.case.case_text import case_text
from jointbayes.case.parse import parse_case
from jointbayes.case.spec.fields import LIMITS, limit_text
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.posterior import summarise
from jointbayes.report import ReportInputs, build_report
from jointbayes.report.model import Callout, Lights
from tests.case.refusal_rows import broken, refusal_rows
from tests.conftest import CONFIGS, cheap_frequencies_text, cheap_text, edited, judged_as, of_case, shipped_text
from tests.one_line import says

GOOD = (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8")
UNCERTAIN = shipped_text("clamped_beam_uncertain")
LENGTH, DIAMETER = "length_mm = 383.0", "diameter_mm = 25.0"
MODULUS, DENSITY = "youngs_modulus_gpa = 210.0", "density_kg_m3 = 7800.0"


def warnings_of(*changes, text=None):
    text = edited(text or cheap_text(), *changes)
    spec = parse_case(text, "case")
    return [str(w) for w in plausibility.input_warnings(spec, case_text(text, "case"), spec.data.band_hz)]


# ---- slips


@pytest.mark.docs
@pytest.mark.parametrize("config", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_no_shipped_case_has_a_warning_and_one_has_priors_by_default(config):
    case = jb.load_case(config)
    assert case.warnings == ()
    assert case.default_priors == ({"k11", "k12", "k22"} if config.stem == "measured_bar" else set())


@pytest.mark.parametrize(("changes", "key", "words"), refusal_rows()["small beam, slips"])
def test_a_likely_slip_is_a_warning_with_its_key_and_what_was_meant(changes, key, words):
    (line,) = warnings_of(text=broken(cheap_text(), changes)[0])
    assert line.startswith(f"{key}: found ")
    says(line, "; expected ", words)
    assert line.isprintable()


@pytest.mark.parametrize(
    "change", [("ratio = 0.01", "ratio = 0.2"), ("relative = 0.008", "relative = 0.5"),
               ("[prior.k11]", "[uncertain.length]\nsd_percent = 0.02\n[prior.k11]")],
)  # fmt: skip
def test_unusual_fractions_that_exist_have_no_warning(change):
    assert warnings_of(change) == []


def test_two_slips_that_cancel_in_the_velocity_of_sound_are_both_named():
    modulus, density = warnings_of((MODULUS, "youngs_modulus_gpa = 0.21"), (DENSITY, "density_kg_m3 = 7.8"))
    assert "write youngs_modulus_gpa = 210" in modulus
    assert "write density_kg_m3 = 7800" in density


@pytest.mark.parametrize(("modulus", "density"), [
    (210, 7850), (70, 2700), (3, 1150), (12, 450), (30, 2400), (1220, 3510), (16, 11340), (411, 19300), (303, 1850),
], ids=["steel", "aluminium", "nylon", "spruce", "concrete", "diamond", "lead", "tungsten", "beryllium"])  # fmt: skip
def test_solids_have_no_warning(modulus, density):
    changes = [(MODULUS, f"youngs_modulus_gpa = {modulus}.0"), (DENSITY, f"density_kg_m3 = {density}.0")]
    assert warnings_of(*changes) == []


@pytest.mark.parametrize(("end", "warned"), [(math.nextafter(25.0, 0), True), (25.0, False), (26.0, False)])
def test_a_beam_is_longer_than_thick(end, warned):
    high = (("f_max_hz = 2500.0", "f_max_hz = 1.0e6"), ("f_step_hz = 10.0", "f_step_hz = 1.0e4"))
    assert bool(warnings_of((LENGTH, f"length_mm = {end!r}"), *high)) == warned


def test_measured_natural_frequencies_are_looked_at_as_well():
    frequencies = "frequencies_hz = [120.0, 762.0, 2101.0]"
    (line,) = warnings_of((frequencies, "frequencies_hz = [0.12, 0.762, 2.101]"), text=cheap_frequencies_text())
    assert line.startswith("data.frequencies_hz: found 2.101, while the first natural frequency")


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
def test_report_and_summary_keep_the_warnings(cheap_posterior):
    notes = ("structure.length_mm: found 0.383; expected more; write 383",)
    inputs = ReportInputs(judged_as(of_case(cheap_posterior, warnings=notes), cheap_posterior))
    assert inputs.summary.warnings == notes
    report = build_report(inputs, datetime.date(2026, 1, 5))
    assert Callout("caution", f"**Check the case file.** {notes[0]}.") in report.blocks()
    (lights,) = (block for block in report.lead if isinstance(block, Lights))
    assert (lights.lights[2].kind, lights.lights[2].text) == ("caution", f"Check {notes[0]}.")
    assert summarise(cheap_posterior, (1e8, 0.0, 0.0)).warnings == ()


# ---- what no machine has


def faults_of(text):
    """Each fault of a case on a line of its own; none where the schema accepts it."""
    try:
        parse_case(text, "case")
    except jb.CaseError as error:
        return str(error).splitlines()
    return []


def numbers(text):
    return list(re.finditer(r"^(\w+) = (-?[\d.]+(?:[eE][-+]?\d+)?)\b", text, re.MULTILINE))


@pytest.mark.parametrize("value", ["1e308", "1e-308", "1e110", "1e-110", "4294967296", "1000000000000000000000"])
@pytest.mark.parametrize("text", [GOOD, UNCERTAIN], ids=["main case", "uncertain case"])
def test_absurd_numbers_are_one_line_with_the_key_or_do_no_harm(text, value):
    refused = set()
    for number in numbers(text):
        changed = text[: number.start(2)] + value + text[number.end(2) :]
        line = changed[: number.start()].count("\n") + 1
        for fault in faults_of(changed):
            key, _, rest = fault.removeprefix(f"case:{line}: ").partition(": ")
            if key.endswith(number[1]):  # else a rule between keys names another one
                assert "; expected " in rest
                refused.add(number[1])
    always = {"length_mm", "elements", "diameter_mm", "k11", "k22", "walkers", "ensembles", "max_steps"}
    if value in ("1e308", "1e110"):
        assert refused >= always | {"youngs_modulus_gpa", "density_kg_m3", "high", "threshold", "f_max_hz"}
    assert refused >= {"walkers", "ensembles", "max_steps", "elements"}


def test_the_limits_themselves_are_allowed():
    refused = []
    for number in numbers(UNCERTAIN):
        for value in (LIMITS[number[1]].least, LIMITS[number[1]].most) if number[1] in LIMITS else ():
            changed = UNCERTAIN[: number.start(2)] + repr(value) + UNCERTAIN[number.end(2) :]
            refused += [fault for fault in faults_of(changed) if "of a magnitude" in fault]
    assert refused == []


def _unbounded_numbers(model):
    """Keys of numbers that the schema itself does not bound from above."""
    for key, field in model.model_fields.items():
        yield from _unbounded_in(key, field.annotation, repr(field.metadata))


def _unbounded_in(key, annotation, bounds):
    bounds += repr(annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield from _unbounded_numbers(annotation)
    elif annotation in (int, float) and "Le(" not in bounds and "Lt(" not in bounds:
        yield key
    for part in get_args(annotation):
        yield from _unbounded_in(key, part, bounds)


def test_every_number_of_the_schema_has_limits_on_both_sides():
    open_ended = set(_unbounded_numbers(CaseSpec))
    assert open_ended - set(LIMITS) == set()
    assert len(open_ended) > 30


def test_limits_are_stated_as_numbers_a_person_writes():
    assert [limit_text(v) for v in (1e-3, 1e-12, 10.0, 100.0, 1e3, 1e6, 1e15)] == [
        "0.001", "1e-12", "10", "100", "1000", "1e6", "1e15"
    ]  # fmt: skip


def test_a_prior_put_in_its_place_says_nothing_of_the_truth(cheap_case):
    narrow = replace(cheap_case.problem.prior, marginals=(jb.Uniform(0.0, 1.0),) * 3)
    assert replace(cheap_case, problem=replace(cheap_case.problem, prior=narrow)).warnings == ()


def test_too_little_memory_is_one_line(monkeypatch):
    def too_large(*_args, **_more):
        raise MemoryError

    monkeypatch.setattr("jointbayes.case.case.measurement_of", too_large)
    with pytest.raises(jb.CaseError, match=r"^case.toml:\d+: data: found too little memory; expected room"):
        jb.case_from_text("case.toml", cheap_text())
