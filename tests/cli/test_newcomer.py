"""What a newcomer runs into in the first hour: each slip is told where it is, with what to do, in a whole line."""

import json
import shlex
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.cli.files import _structure_in_words
from tests.conftest import CONFIGS, cheap_text, cli, shipped_text

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


@pytest.mark.parametrize(
    ("kind", "what", "names", "words"),
    [
        ("beam", "300 mm", (), "beam 300 mm, 40 × 8 mm, modal damping"),
        (
            "beam",
            "300 mm",
            ("youngs_modulus", "damping_ratio_1", "damping_ratio_2", "damping_ratio_4"),
            "beam 300 mm, 40 × 8 mm, modal damping; uncertain: Young's modulus and damping of modes 1 to 4",
        ),
        ("imported", "solid_bar.npz, 9 DOFs", (), "solid_bar.npz, 9 DOFs, modal damping"),
    ],
)
def test_validate_says_the_structure_in_words(kind, what, names, words):
    recipe = SimpleNamespace(kind=kind, what=what, damping=jb.ModalDamping((0.01,)))
    test = SimpleNamespace(structures=SimpleNamespace(recipe=recipe, names=names), measured_bodies=())
    assert _structure_in_words(test, {"40 × 8 mm": []}) == words


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
