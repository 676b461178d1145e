"""Faults of a disk and of neighbours: links planted at every name that is written, no room at any write."""

import errno
import os
import shlex
import sys
import tempfile
from pathlib import Path

import pytest

import jointbayes as jb
from jointbayes import workflow
from tests.conftest import cheap_frequencies_text, cheap_text, cli, edited, first_in_ci
from tests.disk_faults import each_change, full_from
from vibrecords.files import MARK

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="descriptors are followed by /proc")

SMALL = (("max_steps = 20000", "max_steps = 200"),)
#: Commands on `clamp.toml`; `compare` writes its directory as `run` does.
COMMANDS = {
    "sample": ("sample", "clamp.toml", "--out", "out"),
    "run": ("run", "clamp.toml", "--out", "out"),
    "campaign": ("campaign", "clamp.toml", "--workers", "1", "--out", "out"),
}
#: What somebody may have planted at a name: a link to what, beside our marks or without.
PLANTED = (("file", False), ("file", True), ("new", True), ("folder", True))


@pytest.fixture(scope="module")
def modes_found():
    return {}


@pytest.fixture(autouse=True)
def _one_search(monkeypatch, plain_reports, modes_found):
    """The mode of one problem is searched for once, as nothing is written in between."""
    search = workflow.find_map

    def found(analysed, **options):
        one = analysed.text, options["seed"]
        if one not in modes_found:
            modes_found[one] = search(analysed, **options)
        return modes_found[one]

    monkeypatch.setattr(workflow, "find_map", found)


def folder(place, monkeypatch):
    place.mkdir(parents=True)
    (place / "clamp.toml").write_text(edited(cheap_frequencies_text(), *SMALL), encoding="utf-8")
    (place / "frf.toml").write_text(edited(cheap_text(), *SMALL), encoding="utf-8")
    monkeypatch.chdir(place)
    return place


def is_one_line(result):
    lines = [line for line in result.stderr.splitlines() if line.startswith("jointbayes: ")]
    return isinstance(result.exception, SystemExit) and "Traceback" not in result.stderr and bool(lines)


# ---- links


def names_written(place, arguments):
    """Every name that was ever there while a command was at work, but those that nobody can guess."""
    seen = set()

    def look(_name, _after):
        seen.update(path.relative_to(place) for path in place.rglob("*"))

    with each_change(place, look):
        result = cli(*arguments)
    assert result.exit_code in (0, 3), result.output
    return sorted(p for p in seen if not any(part.startswith(".") and part != MARK for part in p.parts))


def plant(place, name, target, *, marks):
    """A link in a directory as somebody might have packed it, with our marks or without."""
    path = place / name
    path.parent.mkdir(parents=True, exist_ok=True)
    for parent, text in marks.items():
        if parent in (p.relative_to(place) for p in path.parents if p.is_relative_to(place)) and name.name != MARK:
            (place / parent / MARK).write_bytes(text)
    path.symlink_to(target)


@pytest.mark.science
@pytest.mark.parametrize(
    ("command", "at_each"),
    first_in_ci([("sample", 4), ("campaign", 1), *((name, 4) for name in COMMANDS if name != "sample")], 2),
)
def test_nothing_is_written_through_a_link_at_any_name(tmp_path, monkeypatch, command, at_each):
    """So many kinds of links at each name, in turn."""
    arguments = COMMANDS[command]
    first = folder(tmp_path / "first", monkeypatch)
    marks = {}

    def note(_name, _after):
        marks.update({p.parent.relative_to(first): p.read_bytes() for p in first.rglob(MARK) if p.stat().st_size})

    with each_change(first, note):
        cli(*arguments)
    marks = {parent: text for parent, text in marks.items() if not parent.name.startswith(".")}
    written = [
        p
        for p in names_written(folder(tmp_path / "second", monkeypatch), arguments)
        if p.name not in ("clamp.toml", "frf.toml")
    ]
    assert len(written) >= 4 or (command, written) == ("sample", [Path("out")])  # it writes one file
    through = []
    for number, name in enumerate(written):
        for kind, marked in [PLANTED[(number + turn) % len(PLANTED)] for turn in range(at_each)]:
            place = folder(tmp_path / f"{number}-{kind}-{marked}", monkeypatch)
            victim = tmp_path / f"victim-{number}-{kind}-{marked}"
            if kind == "folder":
                victim.mkdir()
                (victim / "thesis.svg").write_text("mine", encoding="utf-8")
            elif kind == "file":
                victim.write_text("mine", encoding="utf-8")
            before = sorted(victim.rglob("*")) if victim.is_dir() else None
            plant(place, name, victim, marks=marks if marked else {})
            result = cli(*arguments)
            assert result.exit_code in (0, 1, 3) or is_one_line(result), (name, kind, result.output)
            if kind == "file":
                whole = victim.read_text(encoding="utf-8") == "mine"
            else:
                whole = sorted(victim.rglob("*")) == before if before else not victim.exists()
            if not whole:
                through.append((str(name), kind, marked))
    assert through == []


# ---- no room


def calls_that_need_room(place, arguments):
    count = 0

    def note(name, after):
        nonlocal count
        count += not after and name in ("open", "mkdir", "write", "fsync", "rename", "replace")

    with each_change(place, note):
        result = cli(*arguments)
    assert result.exit_code in (0, 3), result.output
    return count


@pytest.mark.whole
@pytest.mark.parametrize(
    ("command", "sampled"), first_in_ci([("sample", 6), ("run", 8), ("sample", None), ("run", None)], 1)
)
def test_a_disk_that_is_full_from_any_write_on_costs_a_line_and_no_draws(tmp_path, monkeypatch, command, sampled):
    elsewhere = tmp_path / "temporary"
    elsewhere.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(elsewhere))
    arguments = COMMANDS[command]
    count = calls_that_need_room(folder(tmp_path / "first", monkeypatch), arguments)
    result_file = "out" if command == "sample" else "out/posterior.nc"
    expected = jb.load_posterior(tmp_path / "first" / result_file).theta.tobytes()
    numbers = range(1, count + 1) if sampled is None else {1 + i * (count - 1) // (sampled - 1) for i in range(sampled)}
    refused = 0
    for number in sorted(numbers):
        place = folder(tmp_path / f"at-{number}", monkeypatch)
        with each_change(place, full_from(number)):
            result = cli(*arguments)
        left = [p.name for p in place.rglob("*") if p.name.startswith(".") and p.name != MARK]
        assert left == [], (number, left)
        if result.exit_code in (0, 3):
            draws = place / result_file
        else:
            assert (result.exit_code, is_one_line(result)) == (2, True), (number, result.output)
            line = result.stderr.splitlines()[-1]
            assert os.strerror(errno.ENOSPC) in line, (number, line)
            if "sampling" not in result.stderr:
                refused += 1  # before any work
                continue
            draws = Path(shlex.split(line.split("go on with: jointbayes report ")[1])[0].rstrip(";"))
        assert jb.load_posterior(place / draws).theta.tobytes() == expected, number
    assert refused < len(numbers)
