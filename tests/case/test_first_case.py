"""What a newcomer types: `init --from FILE`, an answer to each question, `run`; the beam of the files has no mesh."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.walk_through import AVERAGES, COHERENCE, TRUTH, accelerance, hits, write_frfs, write_lvm
from benchmarks.written_files import write_records
from click.testing import CliRunner

import jointbayes as jb
from jointbayes.cli.commands import main
from tests.one_line import says
from vibrecords.formats.read import iter_records
from vibrecords.records import ModeRecord, TimeRecord

LINES = np.arange(20.0, 1000.0, 8.0)
ANSWERS = (
    ('length_mm = "?"', "length_mm = 383.0"),
    ('diameter_mm = "?"', "diameter_mm = 25.0"),
    ('joint.dofs = ["?"]', 'joint.dofs = ["1:y", "1:rz"]'),
)


def csv(path: Path) -> None:
    """As somebody exports it from a spreadsheet: three columns, a unit, no coherence."""
    rows = (f"{f},{h.real!r},{h.imag!r}\n" for f, h in zip(LINES.tolist(), accelerance(LINES).tolist(), strict=True))
    path.write_text("Frequency (Hz),Real (m/s²/N),Imag (m/s²/N)\n" + "".join(rows), encoding="utf-8")


def frf_file(path: Path, kind: str) -> None:
    write_frfs(path, LINES, kind, (("Point:3:Z+", "11:y"),))


FILES = {
    "tip.csv": (csv, {"output 1": "11:y", "input 1": "11:y"}, "relative"),
    "tip.uff": (lambda path: frf_file(path, "uff58b"), {"Point:3:Z+": "11:y"}, "coherence"),
    "tip.mat": (lambda path: frf_file(path, "mat"), {"Point:3:Z+": "11:y"}, "coherence"),
    "hits.lvm": (write_lvm, {"hammer": "11:y", "acc tip": "11:y"}, "coherence"),
}


def typed(*arguments: object) -> str:
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result.output


def case_of(measured: Path) -> str:
    """Text of the case that `init` writes for a file, into its directory."""
    path = measured.parent / "my_case.toml"
    typed("init", path, "--from", measured)
    return path.read_text(encoding="utf-8")


def toml_key(label: str) -> str:
    return label if label.isidentifier() else f'"{label}"'


def answered(folder: Path, name: str) -> Path:
    """The case that `init` writes for a file, with each question answered in its line."""
    write, channels, _ = FILES[name]
    write(folder / name)
    path = folder / "my_case.toml"
    said = typed("init", path, "--from", folder / name)
    text = path.read_text(encoding="utf-8")
    asked = [str(i) for i, line in enumerate(text.splitlines(), 1) if '"?"' in line and not line.startswith("#")]
    assert len(asked) == 3
    assert f"(lines {', '.join(asked)})" in said
    of_channels = [(f'{toml_key(label)} = "?"', f'{toml_key(label)} = "{dof}"') for label, dof in channels.items()]
    for question, answer in (*ANSWERS, *of_channels):
        assert text.count(question) == 1
        text = text.replace(question, answer)
    assert '= "?"' not in text
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", FILES)
def test_three_lines_are_asked_and_the_rest_is_in_the_file(tmp_path, name):
    data = jb.load_case(answered(tmp_path, name)).problem.test.data
    assert (data.frf.outputs, data.frf.inputs) == (("11:y",), ("11:y",))
    assert data.provenance.variance.startswith("as stated" if FILES[name][2] == "relative" else "from the coherence")
    lines = data.frf.frequency_hz
    exact = -((2 * np.pi * lines) ** 2) * TRUTH.receptance(lines, ("11:y",), ("11:y",), loss_factor=0.02)[:, 0, 0]
    band = (lines > 40) & (lines < 900)
    # the damping of the records is viscous, and the decay is cut off where a block ends
    assert np.median(np.abs(data.frf.converted("accelerance").values[:, 0, 0] / exact - 1)[band]) < 0.06
    assert "# youngs_modulus = { sd_percent = 3.0 }" in (tmp_path / "my_case.toml").read_text(encoding="utf-8")


def test_the_noise_of_a_file_without_coherence_is_what_a_modal_fit_leaves(tmp_path):
    stated = float(answered(tmp_path, "tip.csv").read_text(encoding="utf-8").split("relative = ")[1].split()[0])
    assert stated == pytest.approx(np.sqrt((1 - COHERENCE) / COHERENCE / (AVERAGES - 1) / 2), rel=0.3)


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


@pytest.mark.parametrize("command", ["run", "identify"])
def test_an_open_question_is_named_with_its_line(tmp_path, command):
    csv(tmp_path / "tip.csv")
    typed("init", tmp_path / "my_case.toml", "--from", tmp_path / "tip.csv")
    result = CliRunner().invoke(main, [command, str(tmp_path / "my_case.toml")])
    assert (result.exit_code, result.output.count('found "?", a question still open; expected')) == (2, 5)


def test_what_the_file_does_not_say_is_asked(tmp_path):
    rows = [f"{f},{h.real},{h.imag},0.99" for f, h in zip(LINES, accelerance(LINES), strict=True)]
    head = "Frequency (Hz),Real acc / force (EU/V),Imag acc / force (EU/V),Coherence acc / force"
    (tmp_path / "tip.csv").write_text("\n".join([head, *rows]), encoding="utf-8")
    text = case_of(tmp_path / "tip.csv")
    assert '"acc" = { dof = "?", unit = "?" }'.replace('"acc"', "acc") in text
    says(text, 'force = { dof = "?", sensitivity = "?", unit = "?" }', 'averages = "?"')


def test_a_layout_goes_into_the_case(tmp_path):
    np.savez(tmp_path / "odd.npz", lines=LINES, answer=accelerance(LINES))
    path = tmp_path / "my_case.toml"
    typed("init", path, "--from", tmp_path / "odd.npz", "--layout", "frequency_hz=lines", "--layout", "frf=answer")
    assert 'layout = { frequency_hz = "lines", frf = "answer" }' in path.read_text(encoding="utf-8")


def test_modes_of_a_modal_test_are_typed_into_the_case(tmp_path, monkeypatch):
    modes = [ModeRecord(i + 1, f, 0.1 * (i + 1), 0.01, shape={"1:Z+": 1.0}) for i, f in enumerate((121.5, 752.4))]
    monkeypatch.setattr("jointbayes.case.first_case.iter_records", lambda *_: iter(modes))
    monkeypatch.setattr("jointbayes.case.first_case.about_file", lambda _: {"operator": "A. Miller"})
    text = jb.case.first_case.propose_case([tmp_path / "modes.uff"], tmp_path)
    assert 'about = { operator = "A. Miller" }   # as the file says' in text
    says(text, "frequencies_hz = [121.5, 752.4]", "sd_hz = [0.1, 0.2]", "shapes at 1:Z+")
    assert "\nyoungs_modulus = { sd_percent = 3.0 }" in text


@pytest.mark.parametrize(("arguments", "message"), [
    (["--from", "missing.csv"], "found no such file"),
    (["my_case.toml", "other.toml", "--from", "tip.csv"], "found a second case to write"),
    (["--from", "../tip.csv"], "found outside of the directory of the case"),
    (["--from", "empty.csv"], "blank bytes"),
])  # fmt: skip
def test_what_cannot_be_begun_leaves_no_case(tmp_path, monkeypatch, arguments, message):
    folder = tmp_path / "here"
    folder.mkdir()
    csv(folder / "tip.csv")
    csv(tmp_path / "tip.csv")
    (folder / "empty.csv").write_text(" ")
    monkeypatch.chdir(folder)
    result = CliRunner().invoke(main, ["init", *arguments])
    assert (result.exit_code, message in result.output) == (2, True), result.output
    assert not list(folder.glob("*.toml"))


def test_several_files_are_named_behind_from_as_a_shell_lists_them(tmp_path, monkeypatch):
    frf_file(tmp_path / "a.uff", "uff58b")
    frf_file(tmp_path / "b.uff", "uff58b")
    monkeypatch.chdir(tmp_path)
    typed("init", "--from", "a.uff", "b.uff")
    text = Path("my_case.toml").read_text(encoding="utf-8")
    assert 'file = ["a.uff", "b.uff"]' in text
    assert 'source = "repeats"   # 2 measurements of each FRF' in text


def test_a_recording_says_nothing_of_its_blocks_where_it_is_no_hammers(tmp_path):
    rng = np.random.default_rng(1)
    for name, quantity in (("shaker", "force"), ("acc", "acceleration")):
        record = TimeRecord(
            name, 1000.0, rng.standard_normal(16_000), quantity, "N" if quantity == "force" else "m/s^2"
        )
        write_records([record], tmp_path / f"{name}.uff", "uff58b")
    typed("init", tmp_path / "a.toml", "--from", tmp_path / "shaker.uff", tmp_path / "acc.uff")
    assert 'records = { method = "shaker", block_s = 1' in (tmp_path / "a.toml").read_text(encoding="utf-8")


def write_hit(path: Path, head: str) -> None:
    (force, response), *_ = hits(1)
    samples = enumerate(zip(force.tolist(), response.tolist(), strict=True))
    path.write_text("\n".join([head, *[f"{i / 5120:.7f},{x!r},{y!r}" for i, (x, y) in samples]]), encoding="utf-8")


def test_one_hit_has_the_noise_that_a_modal_fit_leaves_and_its_case_is_valid(tmp_path):
    write_hit(tmp_path / "hit.csv", "Time (s),hammer (N),acc (m/s^2)")
    text = case_of(tmp_path / "hit.csv")
    assert 'records = { method = "impact" }   # H1 from 1 of 1 hits' in text
    assert 'source = "relative"   # what a modal fit leaves: the one hit has no coherence' in text
    (tmp_path / "my_case.toml").write_text(with_answers(text), encoding="utf-8")
    assert "valid, no warnings" in typed("validate", tmp_path / "my_case.toml")


def with_answers(text: str) -> str:
    for question, answer in ANSWERS:
        text = text.replace(question, answer)
    return text.replace('= "?"', '= "11:y"')


def test_a_band_that_begins_above_mode_1_has_its_damping_in_numbers(tmp_path):
    write_frfs(tmp_path / "high.uff", np.arange(300.0, 2400.0, 4.0), "uff58b", (("Point:3:Z+", "11:y"),))
    text = case_of(tmp_path / "high.uff")
    ratio = float(re.search(r'law = "modal", ratio = ([\d.]+)', text)[1])
    assert ratio == pytest.approx(0.01, rel=0.1)  # a loss factor of 0.02
    assert "The file begins at 300 Hz, and its first resonance at 752" in text
    (tmp_path / "my_case.toml").write_text(with_answers(text), encoding="utf-8")
    assert "valid, no warnings" in typed("validate", tmp_path / "my_case.toml")
    wrong = with_answers(text).replace(f"ratio = {ratio}", 'ratio = "measured"')
    (tmp_path / "my_case.toml").write_text(wrong, encoding="utf-8")
    refused = CliRunner().invoke(main, ["validate", str(tmp_path / "my_case.toml")])
    assert refused.exit_code == 2
    assert f"; write ratio = {ratio:.2g}, lower f_min_hz, or correct" in refused.output


def test_a_turned_drive_point_and_averages_are_told_as_the_file_has_them(tmp_path):
    write_frfs(tmp_path / "tip.uff", np.arange(20.0, 1000.0, 2.0), "uff58b", (("Point:3:Z+", "11:y"),))
    turned = [replace(record, values=-record.values) for record in iter_records(tmp_path / "tip.uff")]
    write_records(turned, tmp_path / "turned.uff", "uff58b")
    text = case_of(tmp_path / "turned.uff")
    assert 'turn the channel in the case file ("-11:y")' in text
    assert f'source = "coherence"   # {AVERAGES} averages, as the file says' in text


def test_a_hammer_without_units_is_told_by_its_name(tmp_path):
    write_hit(tmp_path / "hit.csv", "Time (s),hammer,acc")
    text = case_of(tmp_path / "hit.csv")
    says(text, 'records = { method = "impact" }', 'hammer = { dof = "?", unit = "?" }')
