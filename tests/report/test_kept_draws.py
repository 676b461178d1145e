"""Draws that outlive whatever fails after them: on disk before any figure, one line that says how to go on."""

import errno
import os
import shlex
import subprocess
import sys
import tempfile

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.errors import CaseError, ReportError, ReportInterruptedError, WriteError
from jointbayes.posterior.verdicts import mode_agrees
from jointbayes.report.run_directory import write_report
from tests.conftest import cheap_frequencies_text, cli

FAILURES = {
    "nobody expected it": (IndexError("list index\nout of range"), "found IndexError (list index out of range)"),
    "disk full": (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), "No space left on device"),
    "out of memory": (MemoryError(), "found MemoryError (no message)"),
    "one of ours": (CaseError("fonts: found none; expected one"), "fonts: found none; expected one"),
}


def content(directory):
    return {p.relative_to(directory): p.is_file() and p.read_bytes() for p in directory.rglob("*")}


def failing(error):
    def fail(*_arguments, **_options):
        raise error

    return fail


@pytest.fixture
def config(tmp_path, monkeypatch, frequency_posterior, plain_reports):
    """A case file whose draws are those of the session."""
    monkeypatch.setattr("jointbayes.workflow.sample", lambda *_arguments, **_options: frequency_posterior)
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "clamp.toml"
    path.write_text(cheap_frequencies_text(), encoding="utf-8")
    return path


@pytest.mark.whole
@pytest.mark.parametrize(
    ("where", "error", "code", "words"),
    [("run_directory.build_report", error, 2, f"out: no report: {words}") for error, words in FAILURES.values()]
    + [("inputs.gather_knowledge", RuntimeError("broken"), 2, "out: no report: found RuntimeError (broken)")]
    + [("run_directory.render_pdf", RuntimeError("no fonts"), 2, "out: no report: found RuntimeError (no fonts)")]
    + [("run_directory.render_html", KeyboardInterrupt(), 130, "interrupted while the report was written")],
    ids=[*FAILURES, "in the summary", "in the PDF", "interrupted"],
)
def test_a_report_that_fails_leaves_the_draws_and_one_line(
    config, monkeypatch, frequency_posterior, where, error, code, words
):
    monkeypatch.setattr(f"jointbayes.report.{where}", failing(error))
    result = cli("run", config, "--out", "out")
    assert result.exit_code == code
    assert result.stdout.startswith(frequency_posterior.record.state)  # the answer is there before the report
    *_, line = result.stderr.splitlines()
    assert line.startswith(f"jointbayes: {words}; ")
    assert line.endswith(
        "the draws are whole in out.posterior.nc; go on with: jointbayes report out.posterior.nc --out out"
    )
    assert {p.name for p in config.parent.iterdir()} == {"clamp.toml", "out.posterior.nc"}
    loaded = jb.load_posterior("out.posterior.nc")
    assert loaded.theta.tobytes() == frequency_posterior.theta.tobytes()


@pytest.mark.whole
def test_the_line_goes_on_to_the_report_even_from_names_with_blanks(config, monkeypatch):
    with monkeypatch.context() as broken:
        broken.setattr("jointbayes.report.run_directory.render_pdf", failing(RuntimeError("no fonts")))
        result = cli("run", config, "--out", "my report")
    command = shlex.split(result.stderr.split("go on with: ")[1])
    assert command == ["jointbayes", "report", "my report.posterior.nc", "--out", "my report"]
    result = cli(*command[1:])
    assert result.exit_code == 0, result.output
    assert (config.parent / "my report" / "report.pdf").is_file()


@pytest.mark.whole
@pytest.mark.parametrize(("command", "written"), [("run", "out"), ("sample", "out")])
def test_an_interrupt_after_the_writing_says_what_was_written(config, monkeypatch, command, written):
    monkeypatch.setattr("jointbayes.cli.common.print_caveats", failing(KeyboardInterrupt()))
    result = cli(command, config, "--out", "out")
    assert result.exit_code == 130
    assert result.stderr.endswith(f"jointbayes: interrupted; {written} is whole\n")


def test_too_little_memory_is_one_line(config, monkeypatch):
    monkeypatch.setattr("jointbayes.workflow.sample", failing(MemoryError()))
    result = cli("run", config, "--out", "out")
    assert (result.exit_code, result.stdout) == (2, "")
    *_, line = result.stderr.splitlines()
    assert line.startswith("jointbayes: found too little memory; ")


@pytest.mark.whole
def test_an_earlier_run_and_its_kept_draws_survive_runs_that_fail(config, monkeypatch):
    assert cli("run", config, "--out", "out").exit_code == 0
    before = content(config.parent)
    monkeypatch.setattr("jointbayes.report.run_directory.build_report", failing(RuntimeError("broken")))
    for number, kept in enumerate(("out.posterior.nc", "out.posterior-2.nc", "out.posterior-3.nc"), 1):
        result = cli("run", config, "--out", "out")
        assert f"the draws are whole in {kept}; " in result.stderr
        after = content(config.parent)
        assert len(after) == len(before) + number
        assert before.items() <= after.items()


@pytest.mark.whole
def test_an_earlier_run_comes_back_where_the_new_one_cannot_take_its_place(config, monkeypatch):
    assert cli("run", config, "--out", "out").exit_code == 0
    before = content(config.parent / "out")
    rename = type(config).replace

    def not_into_place(self, target):
        if str(target) == "out" and "old" not in str(self):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return rename(self, target)

    monkeypatch.setattr("vibrecords.files._swapped_at_once", lambda *_names: False)  # as on a disk that cannot
    monkeypatch.setattr(type(config), "replace", not_into_place)
    result = cli("run", config, "--out", "out")
    assert result.exit_code == 2
    assert "out: no report: Input/output error; the draws are whole in out.posterior.nc" in result.stderr
    assert content(config.parent / "out") == before
    assert {p.name for p in config.parent.iterdir()} == {"clamp.toml", "out", "out.posterior.nc"}


@pytest.mark.whole
def test_a_report_from_a_file_names_that_file_and_makes_no_other(config, monkeypatch, frequency_posterior):
    frequency_posterior.save("draws.nc")
    monkeypatch.setattr("jointbayes.report.run_directory.render_html", failing(RuntimeError("broken")))
    result = cli("report", "draws.nc")
    assert result.exit_code == 2
    assert "the draws are whole in draws.nc; go on with: jointbayes report draws.nc --out reports/" in result.stderr
    assert {p.name for p in config.parent.iterdir()} == {"clamp.toml", "draws.nc", "reports"}
    assert not list((config.parent / "reports").iterdir())


@pytest.mark.whole
def test_python_gets_the_same_with_the_cause_behind_it(config, monkeypatch, frequency_posterior):
    cause = IndexError("here")
    monkeypatch.setattr("jointbayes.report.run_directory.build_report", failing(cause))
    with pytest.raises(ReportError, match=r"the draws are whole in out\.posterior\.nc") as caught:
        write_report(frequency_posterior, "out")
    assert caught.value.__cause__ is cause
    monkeypatch.setattr("jointbayes.report.run_directory.build_report", failing(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt) as stopped:
        write_report(frequency_posterior, "out")
    assert isinstance(stopped.value, ReportInterruptedError)


def test_the_traceback_is_there_for_who_asks(config, monkeypatch):
    monkeypatch.setattr("jointbayes.report.run_directory.build_report", failing(IndexError("here")))
    monkeypatch.setenv("JOINTBAYES_DEBUG", "1")
    result = cli("run", config, "--out", "out")
    assert result.exit_code == 2
    assert "Traceback" in result.stderr
    assert "IndexError: here" in result.stderr
    assert result.stderr.splitlines()[-1].startswith("jointbayes: out: no report: found IndexError (here); ")


# ---- the disk is full


@pytest.mark.parametrize("command", ["run", "sample"])
def test_draws_that_do_not_fit_are_kept_in_the_temporary_directory(
    config, monkeypatch, tmp_path, frequency_posterior, command
):
    elsewhere = tmp_path / "temporary"
    elsewhere.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(elsewhere))
    save = type(frequency_posterior).save

    def full(self, path):
        if not str(path).startswith(str(elsewhere)):
            raise WriteError(f"{path}: found that it cannot be written (No space left on device)")
        save(self, path)

    monkeypatch.setattr(type(frequency_posterior), "save", full)
    result = cli(command, config, "--out", "out")
    assert (result.exit_code, result.stdout) == (2, "")
    *_, line = result.stderr.splitlines()
    assert line.startswith("jointbayes: out")
    assert "No space left on device" in line
    kept = shlex.split(line.split("go on with: jointbayes report ")[1])[0]
    assert jb.load_posterior(kept).theta.tobytes() == frequency_posterior.theta.tobytes()
    assert {p.name for p in config.parent.iterdir()} == {"clamp.toml", "temporary"}


@pytest.mark.whole
def test_a_file_that_does_not_fit_is_one_error_and_leaves_the_old_one(tmp_path):
    resource = pytest.importorskip("resource")
    # the limit on the size of a file fails a write just as a full disk does; the library that makes netCDF files
    # would end the process
    (tmp_path / "draws.nc").write_bytes(b"old")
    code = (
        "import sys\nfrom pathlib import Path\nfrom jointbayes.errors import WriteError\n"
        "import xarray as xr, numpy as np\nfrom jointbayes.posterior.storage import write_tree\n"
        "tree = xr.DataTree.from_dict({'/posterior': xr.Dataset({'k11': ('draw', np.random.rand(50_000))})})\n"
        "try:\n    write_tree(tree, {}, '', 'draws.nc')\nexcept WriteError as error:\n    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)),
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == (
        "draws.nc: found that it cannot be written (File too large); expected a place with room for 0.4 MB; "
        "make room or choose another place\n"
    )
    assert content(tmp_path) == {p.relative_to(tmp_path): b"old" for p in tmp_path.iterdir()}


def test_draws_survive_a_climb_from_the_best_of_them_that_fails(cheap_case, monkeypatch):
    climbs = sys.modules["jointbayes.identification.refine"]  # the package has a function of that name
    monkeypatch.setattr(climbs, "refine", failing(np.linalg.LinAlgError("Singular matrix")))
    posterior = jb.sample(cheap_case, seed=1, settings=jb.SamplerSettings(walkers=8, max_steps=100))
    assert len(posterior.theta) > 1000
    # the best of all draws, of which not every one is kept
    assert posterior.best.log_density >= posterior.log_density.max()
    assert posterior.best.log_density == cheap_case.problem.log_posterior(posterior.best.theta)
    assert not mode_agrees(posterior)  # so there is no verdict
