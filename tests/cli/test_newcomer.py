"""What a newcomer runs into in the first hour: each slip is told where it is, with what to do, in a whole line."""

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from benchmarks.walk_through import exact_accelerance

from jointbayes.cli.files import _in_words
from jointbayes.cli.output import LONGEST, source_lines
from tests.conftest import CONFIGS, cheap_text, cli, edited, shipped_text, without_stages

#: A bar on a spring of 2 kg: one resonance at 225 Hz.
LINES = np.arange(20.0, 600.0)
CHANNELS = 'channels = { "a tip" = "11:y", "input 1" = "11:y" }'


SQUARED = (2 * np.pi * LINES) ** 2
BAR = -SQUARED / (4e6 * (1 + 0.02j) - 2 * SQUARED)


def write_tip(path, outputs=("a tip",), unit="[m/s^2/N]", force="input 1", values=BAR):
    """A table of FRFs of some outputs over one force, which its header names."""
    heads = (f"real {name} / {force} {unit},imaginary {name} / {force} {unit}" for name in outputs)
    cells = (",".join(f"{h.real:.17g},{h.imag:.17g}" for _ in outputs) for h in values)
    rows = (f"{f:g},{row}" for f, row in zip(LINES, cells, strict=True))
    path.write_text(f"frequency [Hz],{','.join(heads)}\n" + "\n".join(rows), encoding="utf-8")


@pytest.fixture
def measured(tmp_path, monkeypatch):
    """A case whose structure is known, of a table with two outputs."""
    monkeypatch.chdir(tmp_path)
    write_tip(tmp_path / "tip.csv", ("a tip", "a mid"))
    whole = shipped_text("clamped_beam")
    text = whole[: whole.index("[data]")] + f'[data]\nkind = "measured_frf"\nfile = "tip.csv"\n{CHANNELS}\n'
    text += '\n[data.variance]\nsource = "relative"\nrelative = 0.03\nfloor = 0.01\n'
    (tmp_path / "case.toml").write_text(text, encoding="utf-8")
    return text


def only(result):
    """The one message of a command that is refused, and what stands under it."""
    assert result.exit_code == 2
    message, *below = without_stages(result.stderr)
    assert len(message) <= LONGEST
    assert "…" not in message
    return message, below


# ---- validate


def validated(text, *options):
    """What `validate` says of a case of this text, in the working directory."""
    Path("case.toml").write_text(text, encoding="utf-8")
    return cli("validate", "case.toml", *options)


def test_validate_and_report_state_the_same_prior(tmp_path, cheap_posterior):
    path = tmp_path / "clamp.toml"
    path.write_text(cheap_text(), encoding="utf-8")
    (entry,) = json.loads(cli("validate", path, "--json").stdout)["cases"]
    told = [line.partition(" from ")[2].split(" to ") for line in entry["understood"] if line.startswith("unknown ")]
    low, high = np.array([[float(a), float(b.split()[0])] for a, b in told]).T
    for at, (name, stated) in enumerate(cheap_posterior.summary().parameters.items()):
        assert np.log(low[at] / stated.prior_interval95[0]) == pytest.approx(0, abs=0.3), name
        assert np.log(high[at] / stated.prior_interval95[1]) == pytest.approx(0, abs=0.3), name
    assert high[1] ** 2 < high[0] * high[2]  # k12² <= k11 k22 in every joint


def test_validate_says_what_was_tested_with_its_day_in_quotes_or_not(tmp_path, measured):
    for day in ("2026-11-25", '"2026-11-25"', "2026-11-25T08:00:00"):
        about = f'[about]\nspecimen = "Clamp 12"\ndate = {day}\noperator = "A. Miller"\n'
        (entry,) = json.loads(validated(measured + about, "--json").stdout)["cases"]
        assert entry["understood"][0] == "Specimen: Clamp 12; Date of test: 2026-11-25; Operator: A. Miller"


def test_validate_says_where_each_dof_is_and_what_the_beam_is_made_of(tmp_path, measured):
    text = edited(
        measured, ("elements = 10", "elements = 10\nat_mm = { mid = 250.0 }"), ('"a tip" = "11:y"', '"a tip" = "mid:y"')
    )
    (entry,) = json.loads(validated(text, "--json").stdout)["cases"]
    assert {
        "structure: beam 383 mm, circle 25 mm, E 210 GPa, 7800 kg/m³, modal damping",
        "at 0 mm: 1:y, 1:rz",
        "at 250 mm: mid:y",
        "at 383 mm: 11:y",
    } <= set(entry["understood"])


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("300 mm, Modal damping, uncertain: nothing", "beam 300 mm, 40 × 8 mm, modal damping"),
        (
            "300 mm, Modal damping, uncertain: youngs_modulus, damping_ratio_1, damping_ratio_2, damping_ratio_4",
            "beam 300 mm, 40 × 8 mm, modal damping; uncertain: Young's modulus, damping of modes 1 to 4",
        ),
        (
            "solid_bar.npz, 9 DOFs, Loss factor, uncertain: nothing",
            "solid_bar.npz, 9 DOFs, loss factor",
        ),
    ],
)
def test_validate_says_the_structure_in_words(line, words):
    assert _in_words(f"structure: {line}", ["material and section: 40 × 8 mm"]) == f"structure: {words}"


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda h: 1000 * h, "times as large as the model has them with any joint"),
        (lambda h: h / 1000, "times as large as the model has them with any joint"),
        (lambda h: h.real + 0j, "no imaginary part on any of 580 lines: its phase is lost"),
        (lambda h: 0 * h + 1.0, "the FRF is 1+0j on all 580 lines, which no structure is"),
        (lambda h: np.array([1, 1j]) @ np.random.default_rng(1).standard_normal((2, h.size)), "it is noise"),
    ],
)
def test_an_frf_that_no_structure_has_is_told_in_one_warning(tmp_path, measured, made, words):
    write_tip(tmp_path / "tip.csv", values=made(BAR))
    result = cli("validate", "case.toml")
    assert result.exit_code == 0
    assert sum(words in line for line in result.stderr.splitlines()) == 1, result.stderr
    text = measured.replace("ratio = 0.01", 'ratio = "measured"')
    (tmp_path / "case.toml").write_text(text, encoding="utf-8")
    if "on all" in words or "noise" in words:
        message, _ = only(cli("validate", "case.toml"))
        assert "found no mode in an FRF of " in message


@pytest.mark.parametrize("factor", [1000.0, 1e-3])
def test_a_free_gain_that_would_mend_a_wrong_unit_is_named(tmp_path, measured, factor):
    assert "uncertain gain" not in validated(f"{measured}\n[uncertain]\ngain = {{ sd_percent = 5.0 }}\n").stderr
    write_tip(tmp_path / "tip.csv", values=factor * BAR)
    assert "which the uncertain gain would take up without a word" in cli("validate", "case.toml").stderr


@pytest.mark.parametrize(("factor", "warned"), [(9.80665, 1), (1 / 9.80665, 1), (1.0, 0), (1.3, 0), (1 / 1.3, 0)])
def test_g_for_metres_per_second_squared_is_named_and_a_calibration_is_not(tmp_path, measured, factor, warned):
    write_tip(tmp_path / "tip.csv", values=factor * exact_accelerance(LINES))
    assert cli("validate", "case.toml").stderr.count("as large as the model has them with any joint") == warned


def test_a_wrong_modulus_is_the_first_that_a_mode_above_those_of_a_rigid_joint_is_blamed_on(tmp_path, measured):
    text = edited(measured, ("youngs_modulus_gpa = 210.0", "youngs_modulus_gpa = 70.0"))
    text = text.replace("ratio = 0.01", 'ratio = "measured"')
    message, _ = only(validated(text))
    assert message.startswith("jointbayes: case.toml:")
    assert "structure: found mode 1 at 22" in message
    assert message.endswith(
        "; write ratio = 0.01, lower f_min_hz, or correct Young's modulus, density, length or section"
    )


def test_a_misspelt_channel_is_blamed_on_its_label_and_only_free_ones_are_proposed(tmp_path, measured):
    message, (row, carets) = only(validated(edited(measured, ('"a tip"', '"output 1"'))))
    assert 'data.channels."output 1": ' in message
    assert message.endswith('expected one of "a tip", "a mid"; correct the label')
    begin, count = carets.find("^"), carets.count("^")
    assert row[begin : begin + count] == '"output 1" = "11:y"'
    assert 'did you mean "a tip"?' in only(validated(edited(measured, ('"a tip"', '"tip"'))))[0]
    every = '"a tip" = "11:y", "a mid" = "6:y", "b" = "1:y"'
    assert only(validated(edited(measured, ('"a tip" = "11:y"', every))))[0].endswith(
        "all of these are mapped; remove it"
    )


def test_a_stated_noise_is_not_asked_for_and_one_that_is_not_stated_is_with_its_table(tmp_path, measured):
    assert json.loads(cli("validate", "case.toml", "--json").stdout)["warnings"] == []
    assert "or state the noise in [data.variance], or" in cli("inspect", "tip.csv").stdout
    write_tip(tmp_path / "plain.csv", ("output 1",), "")
    assert 'quantity = "accelerance"' in cli("inspect", "plain.csv").stdout


def test_what_a_fresh_case_asks_is_told_in_whole_lines(tmp_path, measured):
    assert cli("init", "my_case.toml", "--from", "tip.csv").exit_code == 0
    told = without_stages(cli("validate", "my_case.toml").stderr)
    assert len(told) == 3 * 6
    assert not any("…" in line for line in told)
    row, carets = told[-2:]
    assert row[carets.find("^") : carets.rfind("^") + 1] == '"a mid" = "?"'


@pytest.mark.parametrize(
    ("row", "key", "marked"),
    [
        ('channels = { "b" = { dof = "?" }, "a" = { dof = "?" } }', 'data.channels."a".dof', 'dof = "?"'),
        ('channels = { "P:1.5:Y+" = "?", "a" = "?" }', 'data.channels."P:1.5:Y+".dof', '"P:1.5:Y+" = "?"'),
        ("channels = { a = '?', b = '?' }", "data.channels.b.dof", "b = '?'"),
        ("noise = { relative = 3.0 }", "data.noise.floor", "noise = { relative = 3.0 }"),
    ],
)
def test_the_innermost_table_that_stands_in_the_line_is_underlined(tmp_path, monkeypatch, row, key, marked):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.toml").write_text(row, encoding="utf-8")
    shown, carets = source_lines(f"a.toml:1: {key}: found; expected; do")
    assert shown[carets.find("^") : carets.rfind("^") + 1] == marked


# ---- another file than the one that is meant, another place than one that is there


@pytest.mark.parametrize(
    ("line", "remedy"),
    [
        ("run tip.csv", "this is a measurement file; expected a case file in TOML, UTF-8; write a case for it: "
                        "jointbayes init --from tip.csv"),
        ("validate tip.csv", "jointbayes init --from tip.csv"),
        ("report case.toml", "found a case file; expected a posterior.nc or a run directory; run it first: jointbayes "
                             "run case.toml"),
        ("export case.toml --to a.bdf", "run it first: jointbayes run case.toml"),
        ("init x/y/case.toml", "found no directory x/y; expected one that exists; make it first"),
        ("init x/case.toml --from tip.csv", "found no directory x; expected one that exists; make it first"),
        ("init sub/", "expected NAME.toml; write sub.toml, or make the directory first"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_told_with_the_command_that_takes_it(tmp_path, measured, line, remedy):
    message, _ = only(cli(*shlex.split(line)))
    assert message.endswith(remedy)
    assert {path.name for path in tmp_path.iterdir()} == {"tip.csv", "case.toml"}


# ---- words


def test_a_table_of_a_campaign_with_names_is_told_of_their_column(tmp_path, measured):
    (tmp_path / "table.csv").write_text("name,structure.length_mm\na,383\n", encoding="utf-8")
    message, _ = only(cli("campaign", "table.csv", "--base", "case.toml"))
    assert message.endswith("name: found no such column; expected a key of a case; did you mean 'key'?")


def test_a_band_that_the_file_does_not_have_is_blamed_on_the_end_that_is_wrong(tmp_path, measured):
    lines = edited(measured, (CHANNELS, f"f_min_hz = 700.0\nf_max_hz = 900.0\n{CHANNELS}"))
    message, (row, _) = only(validated(lines))
    assert row.endswith("f_min_hz = 700.0")
    assert "no line from 700 to 900 Hz" in message
    (warning,) = json.loads(validated(lines.replace("700.0", "100.0"), "--json").stdout)["warnings"]
    assert warning["key"] == "data.f_max_hz"
    assert "expected at most 599, where the lines of the file end" in warning["message"]


# ---- wrong calls


@pytest.mark.parametrize(
    ("line", "command", "words"),
    [
        ("run --json", "run", "Missing argument 'CONFIG'"),
        (f"run {CONFIGS / 'clamped_beam.toml'} --sed 1 --json", "run", "No such option '--sed'"),
        ("check a.toml --json --seed x", "check", "'x' is not a valid integer"),
        ("rum --json", None, "No such command 'rum'"),
        ("--sed --json", None, "No such option '--sed'"),
    ],
)
def test_a_wrong_call_is_one_json_object_where_that_is_asked_for(line, command, words):
    result = cli(*shlex.split(line))
    told = json.loads(result.stdout)
    assert (result.exit_code, told["exit_code"], told["command"]) == (2, 2, command)
    (error,) = told["errors"]
    assert words in error["message"]
    assert words in result.stderr
