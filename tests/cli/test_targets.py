"""What commands write over: what jointbayes wrote, and nothing else that is there."""

import os
import shutil
import unittest.mock
from pathlib import Path

import h5py
import numpy as np
import pytest

from jointbayes.errors import WriteError
from jointbayes.posterior import Posterior
from jointbayes.posterior.verdicts import line_of
from tests.conftest import cheap_text, cli, edited, without_stages
from vibrecords import FrfSet
from vibrecords.formats import write_frf

#: Each with what stands before the name of its target; one chooses the name itself.
COMMANDS = {
    "init": ("init",),
    "inspect": ("inspect", "tip.csv", "--figure"),
    "run": ("run", "clamp.toml", "--out"),
    "sample": ("sample", "clamp.toml", "--out"),
    "sample by default": ("sample", "clamp.toml"),
    "report": ("report", "draws.nc", "--out"),
    "one page": ("report", "draws.nc", "--one-page", "--out"),
    "export": ("export", "draws.nc", "--format", "nastran", "--to"),
    "compare": ("compare", "clamp.toml", "--out"),
    "campaign": ("campaign", "clamp.toml", "--out"),
}
TARGETS = {
    "case": "clamp.toml",
    "measurement": "tip.csv",
    "foreign HDF5": "theirs.h5",
    "text": "thesis.txt",
    "link": "link.txt",
    "directory": "folder",
    "pipe": "pipe",
}
#: Work that must not begin.
WORK = (
    "jointbayes.workflow.sample",
    "vibrecords.inspection.inspect_file",
    "jointbayes.report.run_directory.write_run",
    "jointbayes.report.run_directory.write_one_page",
    "jointbayes.report.export.export",
    "jointbayes.studies.compare.compare",
    "jointbayes.studies.campaign.run_cases",
)


def state(folder):
    """Everything in a directory by its name: content of a file, end of a link."""
    paths = sorted(folder.rglob("*"))
    return {
        str(p.relative_to(folder)): os.readlink(p) if p.is_symlink() else p.is_file() and p.read_bytes() for p in paths
    }


@pytest.fixture(scope="module")
def prepared(tmp_path_factory, cheap_posterior: Posterior):
    """Files of a user: two cases that share a base, a measurement, and what jointbayes has not written."""
    folder = tmp_path_factory.mktemp("user")
    lines = np.arange(20.0, 60.0)
    frf = FrfSet(lines, (1e-5 - 1e-8j * lines)[:, None, None], ("tip",), ("hammer",), "receptance")
    write_frf(frf, folder / "tip.csv", "csv")
    text = (folder / "tip.csv").read_text(encoding="utf-8").split("\n", 1)[1]  # as an analyser has written it
    (folder / "tip.csv").write_text(text, encoding="utf-8")
    whole = edited(cheap_text(), ("max_steps = 20000", "max_steps = 200"))
    start, end = whole.index("[data]"), whole.index("[identification]")
    data = '[data]\nkind = "measured_frf"\nfile = "tip.csv"\n[data.channels]\ntip = "5:y"\nhammer = "5:y"\n'
    noise = '[data.variance]\nsource = "relative"\nrelative = 0.02\nfloor = 0.01\n\n'
    (folder / "base.toml").write_text(f"{whole[:start]}{data}{noise}{whole[end:]}", encoding="utf-8")
    (folder / "clamp.toml").write_text('extends = "base.toml"\ntitle = "Clamp"\n', encoding="utf-8")
    with h5py.File(folder / "theirs.h5", "w") as theirs:
        theirs["years"] = np.arange(5.0)
    (folder / "thesis.txt").write_text("written by: jointbayes, said the reader\n", encoding="utf-8")
    (folder / "link.txt").symlink_to("thesis.txt")
    (folder / "folder").mkdir()
    (folder / "folder" / "chapter.tex").write_text("mine", encoding="utf-8")
    cheap_posterior.save(folder / "draws.nc")
    return folder


@pytest.fixture
def user(prepared, tmp_path, monkeypatch) -> Path:
    place = tmp_path / "user"
    shutil.copytree(prepared, place, symlinks=True)
    os.mkfifo(place / "pipe")
    monkeypatch.setattr("jointbayes.case.case.find_numbering", lambda *_: None)  # looked for at each reading of a case
    monkeypatch.chdir(place)
    return place


@pytest.mark.parametrize("kind", TARGETS)
@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_that_jointbayes_did_not_write_is_replaced(user, monkeypatch, command, kind):
    def never(*_arguments, **_options):
        raise AssertionError("work began before the refusal")

    for work in WORK:
        monkeypatch.setattr(work, never)
    target = TARGETS[kind]
    if command == "sample by default":
        if kind in ("case", "measurement"):
            Path("clamp.nc").hardlink_to(target)
        else:
            Path(target).rename("clamp.nc")
    arguments = COMMANDS[command] if command == "sample by default" else (*COMMANDS[command], target)
    before = state(user)
    result = cli(*arguments)
    after = state(user)
    if (command, kind) == ("init", "directory"):
        assert result.exit_code == 0
        assert after.pop("folder/my_case.toml")
    else:
        (line,) = without_stages(result.stderr)
        assert (result.exit_code, line.startswith("jointbayes: ")) == (2, True)
        assert "found " in line
        assert "expected " in line
    assert after == before


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
@pytest.mark.parametrize("form", ["csv", "nastran", "abaqus", "ansys"])
def test_an_exported_file_and_a_figure_are_replaced(user, form):
    arguments = ("export", "draws.nc", "--format", form, "--to", "frf.out")
    assert [cli(*arguments).exit_code for _ in range(2)] == [0, 0]
    figure = ("inspect", "tip.csv", "--figure", "tip.svg")
    if form == "csv":
        assert [cli(*figure).exit_code for _ in range(2)] == [0, 0]
        assert cli(*arguments[:-1], "tip.svg").exit_code == 0  # both can be had again
        assert [cli("report", "draws.nc", "--one-page").exit_code for _ in range(2)] == [0, 0]
        assert Path("one-page.pdf").read_bytes().startswith(b"%PDF")


def test_a_posterior_replaces_posteriors_alone_and_nothing_else_replaces_one(user, monkeypatch, cheap_posterior):
    monkeypatch.setattr("jointbayes.workflow.sample", lambda *_, **__: cheap_posterior)
    older = Path("draws.nc").stat().st_ino
    assert cli("sample", "clamp.toml", "--out", "draws.nc").exit_code == 0
    assert Path("draws.nc").stat().st_ino != older
    whole = Path("draws.nc").read_bytes()
    assert cli("export", "draws.nc", "--to", "draws.nc", "--format", "csv").exit_code == 2
    assert Path("draws.nc").read_bytes() == whole
    assert cli("export", "draws.nc", "--to", "new.csv").exit_code == 0
    assert "a posterior that jointbayes wrote" in cli("sample", "clamp.toml", "--out", "new.csv").stderr


def test_force_replaces_a_text_and_through_a_link_nothing(user, monkeypatch, cheap_posterior):
    monkeypatch.setattr("jointbayes.workflow.sample", lambda *_, **__: cheap_posterior)
    text = Path("thesis.txt").read_bytes()
    assert cli("sample", "clamp.toml", "--out", "link.txt", "--force").exit_code == 0
    assert (Path("link.txt").is_symlink(), Path("thesis.txt").read_bytes()) == (False, text)
    Path("old").symlink_to("draws.nc")
    draws = Path("draws.nc").read_bytes()
    assert cli("sample", "clamp.toml", "--out", "old").exit_code == 0
    assert (Path("old").is_symlink(), Path("draws.nc").read_bytes()) == (False, draws)
    for arguments in (COMMANDS["sample"], COMMANDS["export"], COMMANDS["inspect"]):
        Path("thesis.txt").write_bytes(text)
        assert cli(*arguments, "thesis.txt").exit_code == 2
        assert Path("thesis.txt").read_bytes() == text
        assert cli(*arguments, "thesis.txt", "--force").exit_code == 0
        assert Path("thesis.txt").read_bytes() != text


@pytest.mark.parametrize("way", ["as it is", "spelt otherwise", "link", "hard link"])
@pytest.mark.parametrize(
    ("command", "read"),
    [("sample", "clamp.toml"), ("sample", "base.toml"), ("sample", "tip.csv"), ("inspect", "tip.csv"),
     ("export", "draws.nc")],
)  # fmt: skip
def test_what_is_read_is_never_replaced(user, command, read, way):
    target = {"as it is": read, "spelt otherwise": f"folder/../{read}"}.get(way, "other")
    if way == "link":
        Path(target).symlink_to(read)
    elif way == "hard link":
        Path(target).hardlink_to(read)
    before = state(user)
    result = cli(*COMMANDS[command], target, "--force")
    assert (result.exit_code, state(user)) == (2, before)
    assert f"{target}: found the file that is read; expected another one; choose another --" in result.stderr


@pytest.mark.parametrize("command", ["run", "compare", "campaign"])
def test_a_directory_that_holds_what_is_read_is_not_written(user, command):
    Path("out").mkdir()
    Path("out/case.toml").write_text(cheap_text(), encoding="utf-8")
    Path("out/summary.json").write_text("{}", encoding="utf-8")
    before = state(user)
    result = cli(command, "out/case.toml", "--out", "out")
    assert (result.exit_code, state(user)) == (2, before)
    assert (
        "out: found case.toml in it, which is read; expected another directory; choose another --out" in result.stderr
    )


def test_a_file_that_appears_while_a_run_is_made_stays(user, monkeypatch, cheap_posterior):
    def sampled(*_arguments, **_options):
        Path("new.nc").write_text("mine", encoding="utf-8")
        return cheap_posterior

    monkeypatch.setattr("jointbayes.workflow.sample", sampled)
    result = cli("sample", "clamp.toml", "--out", "new.nc")
    assert (result.exit_code, Path("new.nc").read_text(encoding="utf-8")) == (2, "mine")


def test_a_run_gives_its_answer_before_it_writes_anything(user, monkeypatch, cheap_posterior):
    monkeypatch.setattr("jointbayes.workflow.sample", lambda *_arguments, **_options: cheap_posterior)
    failing = unittest.mock.Mock(side_effect=WriteError("reports: disk full"))
    monkeypatch.setattr("jointbayes.report.run_directory.write_run", failing)
    result = cli("run", "clamp.toml", "--out", "new")
    assert result.exit_code == 2
    answer = [line_of(name, cheap_posterior.verdict(name)) for name in cheap_posterior.stiffness_names]
    assert result.stdout.splitlines()[: 1 + len(answer)] == [cheap_posterior.record.state, *answer]
