"""What a newcomer types: `init --from FILE`, an answer to each question, `run`; the beam of the files has no mesh."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from benchmarks.walk_through import accelerance, write_frfs, write_lvm
from click.testing import CliRunner

import jointbayes as jb
from jointbayes.case.first_case import ask
from jointbayes.cli.commands import main
from jointbayes.report.structure_sketch import sketch
from tests.cli.test_said import ANSWERS

LINES = np.arange(20.0, 1000.0, 8.0)


def csv(path: Path) -> None:
    """As somebody exports it from a spreadsheet: three columns, a unit, no coherence."""
    rows = (f"{f},{h.real!r},{h.imag!r}\n" for f, h in zip(LINES.tolist(), accelerance(LINES).tolist(), strict=True))
    path.write_text("Frequency (Hz),Real (m/s²/N),Imag (m/s²/N)\n" + "".join(rows), encoding="utf-8")


FILES = {
    "tip.csv": csv,
    "tip.uff": lambda path: write_frfs(path, LINES, "uff58b", (("Point:3:Z+", "11:y"),)),
    "tip.mat": lambda path: write_frfs(path, LINES, "mat", (("Point:3:Z+", "11:y"),)),
    "hits.lvm": write_lvm,
}


def typed(*arguments: object) -> str:
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result.output


def answered(folder: Path, name: str) -> Path:
    """The case that `init` writes for a file, with each question answered; `test_said.py` keeps what it asks."""
    FILES[name](folder / name)
    path = folder / "my_case.toml"
    typed("init", path, "--from", folder / name)
    text = path.read_text(encoding="utf-8")
    for question, answer in ANSWERS.items():
        text = text.replace(question, answer)
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.science
@pytest.mark.long
def test_a_newcomer_has_a_report_after_three_commands(tmp_path):
    assert "Report: " in typed("run", answered(tmp_path, "tip.csv"), "--out", tmp_path / "out")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    low, high = summary["parameters"]["k22"]["interval95"]
    assert low < 1.52e6 < high
    assert (tmp_path / "out" / "report.html").stat().st_size > 10_000
    assert "Report: " in typed("report", tmp_path / "out" / "posterior.nc", "--out", tmp_path / "again")


@pytest.mark.science
@pytest.mark.long
@pytest.mark.parametrize("name", list(FILES)[1:])
def test_a_newcomer_has_a_report_of_each_kind_of_file(tmp_path, name):
    assert "Report: " in typed("run", answered(tmp_path, name), "--out", tmp_path / "out")


@pytest.mark.parametrize("kind", ["clamp", "bolted", "spindle", "frame", "chain"])
def test_every_kind_of_example_is_valid_and_can_be_drawn(tmp_path, kind):
    path = tmp_path / f"{kind}.toml"
    assert f"next: jointbayes run {path}" in typed("init", path, "--kind", kind)
    assert "valid, no warnings" in typed("validate", path)
    assert "<svg" in sketch(jb.load_case(path).problem)


@pytest.mark.parametrize("kind", ["bolted", "frame"])
def test_an_example_gives_structure_and_joint_to_a_measurement(tmp_path, kind):
    csv(tmp_path / "tip.csv")
    path = tmp_path / "my_case.toml"
    typed("init", path, "--kind", kind, "--from", tmp_path / "tip.csv")
    text = path.read_text(encoding="utf-8")
    dof = {"bolted": "upper.end:y", "frame": "headA:x"}[kind]
    assert 'kind = "synthetic_frf"' not in text
    path.write_text(text.replace('"output 1" = "?", "input 1" = "?"', f'"output 1" = "{dof}", "input 1" = "{dof}"'))
    assert "valid" in typed("validate", path)


ASKED = {
    "a round bar": (
        "tip.csv",
        ["38z", "383", "25", "1", ""],
        {"length_mm": 383.0, "shape": "circle", "diameter_mm": 25.0},
    ),
    "a flat bar": ("tip.csv", ["383", "40 x 8", "1 11"], {"length_mm": 383.0, "width_mm": 40.0, "height_mm": 8.0}),
    "later": ("tip.csv", ["", "", ""], {"length_mm": "?", "diameter_mm": "?"}),
}


@pytest.mark.parametrize("name", ASKED)
def test_a_terminal_is_asked_what_no_file_knows_and_shows_the_beam(tmp_path, monkeypatch, name):
    file, answers, stated = ASKED[name]
    csv(tmp_path / file)
    path = tmp_path / "my_case.toml"
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("click.testing._NamedTextIOWrapper.isatty", lambda _: True, raising=False)
    result = CliRunner().invoke(
        main, ["init", str(path), "--from", str(tmp_path / file)], input="\n".join(answers) + "\n"
    )
    assert result.exit_code == 0, result.output
    structure = tomllib.loads(path.read_text(encoding="utf-8"))["structure"]
    assert stated.items() <= {**structure, **structure["section"]}.items()
    assert ("found '38z'; expected 1 numbers" in result.output) == ("38z" in answers)
    drawn = [line for line in result.output.splitlines() if "=====" in line]
    assert drawn == {"later": [], "a flat bar": ["  #" + "=====+" * 9 + "=====#"],
                     "a round bar": ["  #" + "=====+" * 10]}[name]  # fmt: skip


def test_answers_on_a_model_are_its_unit_and_a_face_or_a_node():
    text = 'length_unit = "?"\n[structure.ports.joint]\nbox_mm = "?"\n'
    given = iter(["mm", "0 0 0 1 20 30"])
    told = tomllib.loads(ask(text, lambda _, form: form(next(given))))
    assert told["length_unit"] == "mm"
    assert told["structure"]["ports"]["joint"] == {"box_mm": [[0.0, 0.0, 0.0], [1.0, 20.0, 30.0]]}
    given = iter(["in", "12"])
    told = ask(text, lambda _, form: form(next(given)))
    assert 'length_unit = "in"\n' in told
    assert "node = 12\n" in told
    with pytest.raises(ValueError, match="expected one of m, mm, in, ft"):
        ask('length_unit = "?"', lambda _, form: form("cm"))
    with pytest.raises(ValueError, match="expected nodes from 1 to 11"):
        ask('joint.dofs = ["?"]', lambda _, form: form("12"))
