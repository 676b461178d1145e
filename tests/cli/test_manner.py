"""How commands speak: one JSON object, quietly, in lines that are not endless; what their help shows can be typed."""

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib

import click
import pytest

import jointbayes as jb
from jointbayes.case.json_schema import case_schema
from jointbayes.cli import common, progress_display
from jointbayes.cli.commands import main
from jointbayes.cli.output import LONGEST, fail, shortened, source_lines
from tests.case.refusal_rows import parts_named
from tests.conftest import CONFIGS, cheap_text, cli, edited, plain_reports, without_stages

MINIMAL = CONFIGS.parent / "src" / "jointbayes" / "cli" / "clamp.toml"
SHIPPED = [*sorted(CONFIGS.glob("*.toml")), MINIMAL]
COMMANDS = sorted(main.commands)


@pytest.fixture
def case(tmp_path, monkeypatch, cheap_posterior):
    """The cheap case as a file, in a directory of its own, with draws that are there already."""
    monkeypatch.setattr("jointbayes.workflow.sample", lambda *_, **__: cheap_posterior)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "clamp.toml").write_text(cheap_text(), encoding="utf-8")
    return "clamp.toml"


# ---- JSON, quiet, open


@pytest.mark.whole
def test_every_command_prints_one_json_object_if_asked_and_only_open_opens(
    case, tmp_path, monkeypatch, cheap_posterior
):
    opened = []
    monkeypatch.setattr(click, "launch", opened.append)
    cheap_posterior.save(tmp_path / "draws.nc")
    (tmp_path / "tip.csv").write_text(
        "frequency [Hz],real tip / hammer [m/N],imaginary\n" + "".join(f"{20 + i},1e-6,-1e-8\n" for i in range(60)),
        encoding="utf-8",
    )
    asked = '[predict]\noutputs = ["5:y"]\ninputs = ["5:y"]\nf_min_hz = 20\nf_max_hz = 900\nf_step_hz = 20\n'
    (tmp_path / "other.toml").write_text(cheap_text() + asked, encoding="utf-8")
    keys = {
        "init my_case.toml": {"case", "questions"},
        f"validate {case}": {"cases"},
        f"identify {case} --paper": {"map", "paper"},
        f"sample {case} --out new.nc": {"parameters", "converged", "draws"},
        f"check {case}": {"matches", "lines"},
        f"run {case} --out out": {"parameters", "converged", "report"},
        "report draws.nc --out again --open": {"parameters", "converged", "report"},
        "export draws.nc --to joint.bdf": {"written", "format"},
        "predict draws.nc other.toml --out there": {"modes", "never_asked", "report"},
        "same draws.nc draws.nc": {"changed", "two_log_b", "stiffness", "together", "premises"},
        "inspect tip.csv": {"channels", "resonances", "doubts"},
    }
    with plain_reports():
        for line, expected in keys.items():
            result = cli(*shlex.split(line), "--json")
            told = json.loads(result.stdout)
            assert told["command"] == line.split()[0]
            assert (told["exit_code"], result.exit_code) == (0, 0), line
            assert expected | {"messages", "warnings", "errors"} <= told.keys(), line
            assert all(len(message) <= LONGEST for message in told["messages"]), line
    assert opened == ["again/report.html"]
    assert set(COMMANDS) - {line.split()[0] for line in keys} == {"campaign", "compare", "plan", "schema"}
    assert json.loads(cli("schema", "--json").stdout) == json.loads(cli("schema").stdout) == case_schema()


def test_quiet_says_no_progress_and_all_the_rest(case):
    loud, quiet = cli("identify", case), cli("identify", case, "--quiet")
    assert loud.stdout == quiet.stdout
    assert len(loud.stderr.splitlines()) >= 2
    assert quiet.stderr == ""
    (slip,) = cli("identify", "none.toml", "--quiet").stderr.splitlines()
    assert "no such file" in slip


def test_every_command_that_writes_a_report_can_open_it():
    writes_reports = {"run", "report", "compare", "predict", "campaign"}
    assert writes_reports == {name for name in COMMANDS if "--open" in cli(name, "--help").output}


# ---- progress

#: Runs commands, one a line of standard input, each in a fork that ends with a code of its own as it begins to load
#: NumPy; prints the codes. What a command said goes to the file of its number.
BEFORE_NUMPY, _ = parts_named("scripts").values()


@pytest.mark.whole
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no forks")
def test_what_is_done_is_named_before_anything_heavy_is_loaded(tmp_path):
    (tmp_path / "clamp.toml").write_text(cheap_text(), encoding="utf-8")
    for name in ("draws.nc", "tip.csv"):
        (tmp_path / name).write_text("here", encoding="utf-8")
    on_a_case = ("run", "identify", "sample", "plan", "compare", "check", "campaign", "validate")
    lines = [*(f"{command} clamp.toml" for command in on_a_case), "report draws.nc", "inspect tip.csv"]
    done = subprocess.run(
        [sys.executable, "-c", BEFORE_NUMPY], input="\n".join(lines), capture_output=True, text=True, cwd=tmp_path
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.split() == ["7"] * len(lines)
    for number, line in enumerate(lines):
        said = (tmp_path / str(number)).read_text(encoding="utf-8")
        assert re.fullmatch(r" *\d+\.\d s  (reading|loading) [^\n]+\n", said), line


def test_a_terminal_shows_progress_in_one_line_that_is_gone_at_the_end(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with progress_display.show_progress() as report:
        report(jb.Progress("searching for the best fit", done=3, total=9, unit="starts"))
        report(jb.Progress("sampling"))
    shown = capsys.readouterr().err
    assert "\n" not in shown
    parts = shown.split("\r")
    seen = list(dict.fromkeys(part.partition(" s  ")[2].rstrip() for part in parts if part.strip()))
    assert seen == ["searching for the best fit: 3 of 9 starts", "sampling"]
    assert parts[-1] == ""
    assert "\x1b" not in shown  # no colours and no other codes, whatever NO_COLOR says


# ---- help


def examples():
    for name in COMMANDS:
        _, _, rest = cli(name, "--help").output.partition("Examples:\n")
        yield from ((name, line.strip()) for line in rest.split("\n\n")[0].splitlines())


def test_every_command_has_examples_in_its_help_that_can_be_typed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shown = list(examples())
    assert {name for name, _ in shown} == set(COMMANDS)
    for name, line in shown:
        program, command, *arguments = shlex.split(line.partition(" > ")[0])
        assert (program, command) == ("jointbayes", name)
        parsed = main.commands[name].make_context(name, arguments)  # options that are unknown or wrong are refused here
        assert parsed.info_name == name


@pytest.mark.parametrize("columns", [50, 80, 100])
def test_help_groups_every_command_and_cuts_no_sentence(columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    page = cli("--help").output
    assert "…" not in page
    assert "..." not in page.partition("\n")[2]  # as click cuts sentences
    told = " ".join(page.split())
    for name in COMMANDS:
        sentence = (main.commands[name].help or "").split("\n\n")[0]
        assert " ".join(sentence.split()) in told, name
    assert re.findall(r"^(\w[\w ]*):$", page, re.MULTILINE)[1:] == ["Analyse", "Look", "Decide", "Files", "Exit codes"]
    codes = {int(code) for line in re.findall(r"^  (\d[\d, ]*?)  ", page, re.MULTILINE) for code in line.split(", ")}
    assert codes == {0, *(value for value in vars(common).values() if type(value) is int)}


def test_without_arguments_the_first_step_is_named():
    result = cli()
    assert result.exit_code == 0
    assert result.output.startswith("First step: jointbayes init --from tip.csv")


# ---- lengths


def test_a_long_message_keeps_what_was_expected(capsys):
    names = ", ".join(f"name_{i}" for i in range(600))
    text = f"a.toml:3: key: found 'x'; expected one of {names}; did you mean \"name_1\"? rename it"
    fail(text)
    assert capsys.readouterr().err.splitlines()[0] == f"jointbayes: {text}"


@pytest.mark.parametrize("name", ["n" * 300, "some/" * 80 + "x", "/" + "n" * 300, "/deep" * 900])
def test_of_an_endless_name_both_ends_stay_and_what_is_wrong_with_it(name):
    short = shortened(f"jointbayes: {name}: File name too long")
    assert re.fullmatch(r"jointbayes: /?(n+|some/[some/]+|deep/[/dep]+)…[^ ]{29}: File name too long", short), short


@pytest.mark.parametrize("command", [("sample", "--out"), ("run", "--out")])
@pytest.mark.parametrize("name", ["n" * 300, "/".join(["n" * 60] * 90)])
def test_a_name_that_no_file_can_have_is_refused_with_its_reason(case, command, name):
    result = cli(command[0], case, *command[1:], name)
    (line,) = without_stages(result.stderr)
    assert (result.exit_code, re.match(r"jointbayes: \S{10,}…[n/]{29}: ", line) is not None) == (2, True)
    assert "File name too long" in line


# ---- validate


@pytest.mark.docs
def test_validate_says_what_was_understood_of_every_shipped_case():
    result = cli("validate", *SHIPPED)
    assert result.exit_code == 0
    assert without_stages(result.stderr) == []
    heads = [line for line in result.stdout.splitlines() if not line.startswith(" ")]
    assert [head.partition(": valid, ")[0] for head in heads] == [str(path) for path in SHIPPED]
    assert max(map(len, result.stdout.replace(f"{CONFIGS}/", "").splitlines())) <= LONGEST
    for part in ("structure: ", "joint: ", "data: ", "noise: ", "unknown k22: 95 % of the prior from "):
        assert result.stdout.count(f"\n  {part}") >= 5, part


@pytest.mark.parametrize(
    ("row", "key", "message", "marked"),
    [
        ("[structure]", "structure.length_mm", "missing", "[structure]"),
        ("noise = { relative = 300, floor = 0.01 }", "data.noise.relative", "found 300", "relative = 300"),
        ('  inputs = ["11:y", "12:y"] # tip', "data.inputs", "found 2", 'inputs = ["11:y", "12:y"]'),
        ('\t"12:y",', "data.inputs", 'found "12:y" as entry 2', '"12:y",'),
        ("title = 'a\x1b[31m'", "title", "found", "title = 'a\\x1b[31m'"),
        ("", "title", "found", ""),
        # the innermost table that stands in the line
        ('channels = { "b" = { dof = "?" }, "a" = { dof = "?" } }', 'data.channels."a".dof', "found", 'dof = "?"'),
        ('channels = { "P:1.5:Y+" = "?", "a" = "?" }', 'data.channels."P:1.5:Y+".dof', "found", '"P:1.5:Y+" = "?"'),
        ("channels = { a = '?', b = '?' }", "data.channels.b.dof", "found", "b = '?'"),
        ("noise = { relative = 3.0 }", "data.noise.floor", "found", "noise = { relative = 3.0 }"),
    ],
)
def test_the_line_of_a_fault_is_shown_with_its_key_and_value_underlined(
    tmp_path, monkeypatch, row, key, message, marked
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.toml").write_text(f"first = 1\n{row}\n", encoding="utf-8")
    shown, carets = source_lines(f"a.toml:2: {key}: {message}; expected more; do it")
    assert shown.startswith("     2 | ")
    assert shown.isprintable()
    begin, count = carets.find("^"), carets.count("^")
    assert (shown[begin : begin + count] if count else "") == marked
    assert source_lines("a.toml:9: key: found") == source_lines("no place") == []


# ---- schema


@pytest.fixture(scope="module")
def schema():
    package = pytest.importorskip("jsonschema", reason="the package jsonschema checks the schema of case files")
    package.Draft202012Validator.check_schema(case_schema())
    return package.Draft202012Validator(case_schema())


@pytest.mark.docs
def test_the_schema_takes_every_shipped_case(schema):
    for path in SHIPPED:
        faults = list(schema.iter_errors(tomllib.loads(path.read_text(encoding="utf-8"))))
        assert not faults, (path.name, [fault.message[:200] for fault in faults])


@pytest.mark.whole
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("length_mm", "lenght_mm"),
        ("length_mm = 383.0", 'length_mm = "383"'),
        ("length_mm = 383.0", "length_mm = -383.0"),
        ("length_mm = 383.0", ""),
        ("elements = 10", "elements = 10.5"),
        ('law = "modal"', 'law = "hysteretic"'),
        ("ratio = 0.01", 'ratio = "mesured"'),
        ('kind = "synthetic_frf"', 'kind = "frf"'),
        ('dofs = ["1:y", "1:rz"]', 'dofs = "1:y"'),
        ('dofs = ["1:y", "1:rz"]', 'dofs = ["1-y", "1:rz"]'),
        ("walkers = 48", "walkers = 48\nwalker = 3"),
    ],
)
def test_the_schema_refuses_what_the_program_refuses(schema, old, new):
    text = edited((CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8"), (old, new))
    with pytest.raises(jb.CaseError):
        jb.case_from_text("case", text)
    assert not schema.is_valid(tomllib.loads(text))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("length_mm", "lenght_mm", {"'lenght_mm' was unexpected", "'length_mm' is a required property"}),
        ("f_max_hz = 2500.0", "f_max_hz = 2500.0\nf_khz = 1", {"'f_khz' was unexpected"}),
        ('kind = "synthetic_frf"', 'kind = "frf"', {"'frf' is not one of ['measured_frequencies', 'measured_frf', "}),
        ('kind = "synthetic_frf"', "", {"'kind' is a required property"}),
        ("ratio = 0.01", "rat = 0.01", {"'rat' was unexpected", "'ratio' is a required property"}),
        ("[joint]\n", "[jiont]\n", {"'jiont' was unexpected", "'dofs' is a required property"}),
    ],
)
def test_the_schema_tells_each_fault_once_and_of_the_kind_that_is_meant(schema, old, new, told):
    text = (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8").replace("[joint]  ", "[joint]\n")
    faults = [fault.message for fault in schema.iter_errors(tomllib.loads(text.replace(old, new, 1)))]
    assert len(faults) == len(told)
    assert all(any(words in fault for fault in faults) for words in told)


def test_the_schema_asks_for_a_joint_or_joints_and_of_a_test_for_nothing(schema):
    whole = tomllib.loads((CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8"))
    del whole["joint"]
    assert [fault.message for fault in schema.iter_errors(whole)] == ["'joint' is a required property"]
    assert schema.is_valid({"extends": "base.toml", "structure": {"length_mm": 300.0}})
    assert not schema.is_valid({"extends": "base.toml", "structure": {"lenght_mm": 300.0}})


def test_every_key_of_the_schema_is_described_and_its_unit_is_in_the_description():
    units = {"mm": "mm", "hz": "Hz", "gpa": "GPa", "g": " g", "kg": "kg", "s": " s", "percent": "percent"}
    whole = case_schema()
    described = 0
    for name, table in {"the file": whole, **whole["$defs"]}.items():
        for key, words in table.get("properties", {}).items():
            assert words.get("description"), (name, key)
            unit = units.get(re.sub(r".*_", "", key)) if "_" in key and "_per_" not in key else None
            if unit and "null" not in json.dumps(words):
                assert unit in words["description"], (name, key, words["description"])
                described += 1
    assert described > 50
