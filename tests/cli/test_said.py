"""What a newcomer runs into in the first hour, as golden pages: each slip is told where it is, with what to do.

A row is what lies in the directory, and the commands typed there. `GOLDEN=update pytest -n 0 tests/cli/test_said.py`
keeps what they print now; read the diff.
"""

import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.walk_through import accelerance, exact_accelerance, hits, write_frfs, write_lvm
from benchmarks.written_files import write_records

from jointbayes.cli.output import LONGEST
from tests.conftest import cheap_text, cli, edited, shipped_text, without_stages
from tests.golden import require_kept
from vibrecords.formats.read import iter_records
from vibrecords.records import ModeRecord, TimeRecord

KEPT = Path(__file__).parent / "said"
#: A bar on a spring of 2 kg: one resonance at 225 Hz.
LINES = np.arange(20.0, 600.0)
SQUARED = (2 * np.pi * LINES) ** 2
BAR = -SQUARED / (4e6 * (1 + 0.02j) - 2 * SQUARED)
CHANNELS = 'channels = { "a tip" = "11:y", "input 1" = "11:y" }'
COARSE = np.arange(20.0, 1000.0, 8.0)
ANSWERS = {'length_mm = "?"': "length_mm = 383.0", 'diameter_mm = "?"': "diameter_mm = 25.0",
           'joint.dofs = ["?"]': 'joint.dofs = ["1:y", "1:rz"]', '= "?"': '= "11:y"'}  # fmt: skip


def tip(values=BAR, outputs=("a tip",), unit="[m/s^2/N]", name="tip.csv", force="input 1"):
    """Writes a table of FRFs of some outputs over one force, which its header names."""
    heads = (f"real {out} / {force} {unit},imaginary {out} / {force} {unit}" for out in outputs)
    pairs = zip(LINES, values, strict=True)
    rows = (f"{f:g}," + ",".join([f"{h.real:.17g},{h.imag:.17g}"] * len(outputs)) for f, h in pairs)
    text = f"frequency [Hz],{','.join(heads)}\n" + "\n".join(rows)
    return lambda: Path(name).write_text(text, encoding="utf-8")


def case(*changes, more=""):
    """Writes a case whose structure is known, of a table with two outputs, with some changes."""
    whole = shipped_text("clamped_beam")
    text = whole[: whole.index("[data]")] + f'[data]\nkind = "measured_frf"\nfile = "tip.csv"\n{CHANNELS}\n'
    text += '\n[data.variance]\nsource = "relative"\nrelative = 0.03\nfloor = 0.01\n' + more
    return lambda: Path("case.toml").write_text(edited(text, *changes), encoding="utf-8")


def text(name, content):
    return lambda: Path(name).write_text(content, encoding="utf-8")


def table(name, head, *columns):
    rows = [",".join(map(repr, row)) for row in zip(*(column.tolist() for column in columns), strict=True)]
    return text(name, "\n".join([head, *rows]))


def uff(name, lines=COARSE, sign=1, kind="uff58b"):
    """Writes an FRF with its coherence as an analyser does, or the same with its motion turned."""

    def write():
        write_frfs(Path(name), lines, kind, (("Point:3:Z+", "11:y"),))
        records = [replace(record, values=sign * record.values) for record in iter_records(Path(name))]
        write_records(records, Path(name), kind)

    return write


def recordings():
    rng = np.random.default_rng(1)
    for name, quantity, unit in (("shaker", "force", "N"), ("acc", "acceleration", "m/s^2")):
        record = TimeRecord(name, 1000.0, rng.standard_normal(16_000), quantity, unit)
        write_records([record], Path(f"{name}.uff"), "uff58b")


def hit(head):
    (force, response), *_ = hits(1)
    return table("hit.csv", head, np.arange(force.size) / 5120, force, response)


def modal_test(patch):
    modes = [ModeRecord(i + 1, f, 0.1 * (i + 1), 0.01, shape={"1:Z+": 1.0}) for i, f in enumerate((121.5, 752.4))]
    patch.setattr("jointbayes.case.first_case.iter_records", lambda *_: iter(modes))
    patch.setattr("jointbayes.case.first_case.about_file", lambda _: {"operator": "A. Miller"})


WITH_NAME = [
    tip(outputs=("a tip", "a mid")),
    case(more='[about]\nspecimen = "Clamp 12"\ndate = 2026-11-25\noperator = "A. Miller"\n'),
]
HEADS = "Frequency (Hz),Real acc / force (EU/V),Imag acc / force (EU/V),Coherence acc / force"
NOISE = np.array([1, 1j]) @ np.random.default_rng(1).standard_normal((2, LINES.size))
SLIPS = edited(cheap_text(), ("length_mm = 383.0", "lenght_mm = 383.0"), ("diameter_mm = 25.0", 'diameter_mm = "25"'))
FINE = np.arange(20.0, 1000.0, 2.0)
H, EXACT = accelerance(COARSE), exact_accelerance(LINES)
#: What lies in the directory, and what is typed; the case that `init` writes is part of what is said.
ROWS = {
    "what is understood": (WITH_NAME, "validate case.toml"),
    "a point with a name": (
        [tip(), case(("elements = 10", "elements = 10\nat_mm = { mid = 250.0 }"),
                     ('"11:y", "input', '"mid:y", "input'))],
        "validate case.toml",
    ),
    **{f"the FRF {name}": ([tip(values), case(("ratio = 0.01", 'ratio = "measured"')) if free else case()],
                           "validate case.toml") for name, values, free in [
        ("times 1000", 1000 * BAR, False), ("over 1000", BAR / 1000, False), ("without phase", BAR.real + 0j, False),
        ("1 at all lines", 0 * BAR + 1, False), ("of noise alone", NOISE, False),
        ("1, its damping asked", 0 * BAR + 1, True), ("of noise, its damping asked", NOISE, True),
        ("in g", 9.80665 * EXACT, False), ("in g the other way", EXACT / 9.80665, False), ("as it is", EXACT, False),
        ("1.3 times", 1.3 * EXACT, False), ("over 1.3", EXACT / 1.3, False)]},
    **{f"a free gain, the FRF times {factor:g}": (
        [tip(factor * BAR), case(more="\n[uncertain]\ngain = { sd_percent = 5.0 }\n")], "validate case.toml")
        for factor in (1.0, 1000.0, 1e-3)},
    "a wrong modulus": (
        [tip(), case(("youngs_modulus_gpa = 210.0", "youngs_modulus_gpa = 70.0"),
                     ("ratio = 0.01", 'ratio = "measured"'))],
        "validate case.toml",
    ),
    **{f"channels {name}": ([tip(outputs=("a tip", "a mid")), case((old, new))], "validate case.toml")
       for name, old, new in [
        ("misspelt", '"a tip"', '"output 1"'), ("misspelt nearly", '"a tip"', '"tip"'),
        ("too many", '"a tip" = "11:y"', '"a tip" = "11:y", "a mid" = "6:y", "b" = "1:y"')]},
    "a table without a unit": ([tip(outputs=("output 1",), unit="")], "inspect tip.csv"),
    "a fresh case": ([tip(outputs=("a tip", "a mid"))], "init my_case.toml --from tip.csv; validate my_case.toml; "
                     "identify my_case.toml"),
    **{line: ([tip(), case()], line) for line in [
        "run tip.csv", "validate tip.csv", "report case.toml", "export case.toml --to a.bdf", "init x/y/case.toml",
        "init x/case.toml --from tip.csv", "init sub/"]},
    "a table of a campaign with names": (
        [tip(), case(), text("table.csv", "name,structure.length_mm\na,383\n")], "campaign table.csv --base case.toml"),
    **{f"a band from {low} Hz": ([tip(), case((CHANNELS, f"f_min_hz = {low}\nf_max_hz = 900.0\n{CHANNELS}"))],
                                 "validate case.toml") for low in ("700.0", "100.0")},
    "init, no units": (
        [table("tip.csv", HEADS, COARSE, H.real, H.imag, 0 * COARSE + 0.99)], "init --from tip.csv"),
    "init, names that say nothing": ([lambda: np.savez("odd.npz", lines=COARSE, answer=H)],
                                     "init --from odd.npz --layout frequency_hz=lines --layout frf=answer"),
    "init, two measurements": ([uff("a.uff"), uff("b.uff")], "init --from a.uff b.uff"),
    "init, a shaker": ([recordings], "init --from shaker.uff acc.uff"),
    "init, one hit": ([hit("Time (s),hammer (N),acc (m/s^2)")], "init --from hit.csv; answer; validate my_case.toml"),
    "init, a hit without units": ([hit("Time (s),hammer,acc")], "init --from hit.csv"),
    "init, above mode 1": (
        [uff("high.uff", np.arange(300.0, 2400.0, 4.0))], "init --from high.uff; answer; validate my_case.toml"),
    "init, a turned sensor": ([uff("turned.uff", FINE, -1)], "init --from turned.uff"),
    "init, modes": ([modal_test, text("modes.uff", "")], "init --from modes.uff"),
    "init, outside": ([], "init --from ../tip.csv"),
    "init, missing": ([], "init --from missing.csv"),
    "init, a second case": ([tip()], "init my_case.toml other.toml --from tip.csv"),
    "init, blank": ([text("empty.csv", " ")], "init --from empty.csv"),
    **{f"init, answered, {name.rpartition('.')[2]}": ([write], f"init --from {name}; answer; validate my_case.toml")
       for name, write in (
        ("tip.csv", table("tip.csv", "Frequency (Hz),Real (m/s²/N),Imag (m/s²/N)", COARSE, H.real, H.imag)),
        ("tip.uff", uff("tip.uff")), ("tip.mat", uff("tip.mat", kind="mat")),
        ("hits.lvm", lambda: write_lvm(Path("hits.lvm"))))},
    "inspect": ([uff("a.uff", FINE)], "inspect a.uff --figure look.svg; inspect a.uff --band 300 1000"),
    "inspect, bands": ([uff("a.uff")], "; ".join(
        f"inspect a.uff --band {band}" for band in ("1000 300", "300 300", "nan 300", "-1 5"))),
    "inspect, a turned sensor": ([uff("turned.uff", FINE, -1)], "inspect turned.uff"),
    "inspect, conjugates": ([uff("a.uff", FINE)], "inspect a.uff --conjugate"),
    "inspect, no measurement": (
        [text("empty.uff", ""), text("text.uff", 3 * "not a measurement\n")],
        "inspect empty.uff; inspect text.uff; inspect missing.uff"),
    "inspect, a layout": (
        [lambda: np.savez("tip.npz", a=H, b=COARSE)],
        "inspect tip.npz --layout frf=a --layout 'frequency_hz = b'; inspect tip.npz --layout frf"),
    "validate": (
        [text("bad.toml", SLIPS), text("good.toml", cheap_text())],
        "validate bad.toml good.toml missing.toml; validate bad.toml good.toml --json; run bad.toml --json"),
    "validate, a slip": ([text("slip.toml", edited(cheap_text(), ("length_mm = 383.0", "length_mm = 0.383")))],
                         "validate slip.toml; validate slip.toml --json"),
    "wrong calls": ([], "run --json; run case.toml --sed 1 --json; check a.toml --json --seed x; rum --json; "
                    "--sed --json"),
    "what went": ([], "calibrate case.toml; simulate case.toml --out x.uff; run case.toml --resume; "
                  "campaign joints.csv --draws 400; campaign joints.csv --again; plan case.toml --assume k11=1e9; "
                  "plan case.toml --out planned"),
    **{f"what is understood of the day {day}": ([tip(outputs=("a tip", "a mid")), case(
        more=f'[about]\nspecimen = "Clamp 12"\ndate = {day}\n')], "validate case.toml")
       for day in ('"2026-11-25"', "2026-11-25T08:00:00")},
}  # fmt: skip


def typed(line):
    """What a command prints, a line each, with the case that it wrote or that its answers made."""
    path = Path("my_case.toml")
    if line == "answer":
        whole = path.read_text(encoding="utf-8")
        for question, answer in ANSWERS.items():
            whole = whole.replace(question, answer)
        path.write_text(whole, encoding="utf-8")
        return []
    before = path.exists()
    result = cli(*shlex.split(line))
    told = without_stages(result.stderr)
    assert not any("…" in each for each in told)
    assert all(len(each) <= LONGEST for each in told)
    written = path.read_text(encoding="utf-8").splitlines() if path.exists() and not before else []
    return [f"$ jointbayes {line}", *result.stdout.splitlines(), *told, f"exit {result.exit_code}", *written]


@pytest.mark.parametrize("name", ROWS)
def test_what_is_said(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    makers, lines = ROWS[name]
    for make in makers:
        make(monkeypatch) if make is modal_test else make()
    found = [each for line in lines.split("; ") for each in typed(line)]
    require_kept(KEPT / f"{re.sub(r'[^a-z0-9.]+', '_', name.lower())}.txt", found)


def test_every_page_is_compared():
    assert len(list(KEPT.glob("*.txt"))) == len(ROWS)
