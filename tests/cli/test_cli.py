"""The command line: what it leaves behind, its exit status, one line for each bad input, a quick start."""

import dataclasses
import gc
import json
import math
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from functools import partial

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.rounding import with_interval
from tests.conftest import (
    CONFIGS,
    PAIR,
    TO_CONVERGE,
    cheap_frequencies_text,
    cheap_text,
    cli,
    edited,
    plain_reports,
    unsettled,
    without_stages,
)

HEAVY = ("numpy", "scipy", "pydantic", "matplotlib", "xarray", "arviz", "emcee", "jinja2")
SHORT = ("max_steps = 20000", "max_steps = 200")  # the least: ends unconverged, in half a second


def listing(directory):
    return {
        str(p.relative_to(directory)): p.read_bytes() if p.is_file() else None for p in sorted(directory.rglob("*"))
    }


def python(code, cwd=None):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=cwd)


# ---- start


def test_nothing_heavy_is_loaded_before_it_is_needed():
    code = f"""
import sys, jointbayes
from jointbayes.cli.commands import main
for asked in (["--help"], ["run", "--help"], ["--version"]):
    main(asked, standalone_mode=False)
print("loaded:", *sorted(set(sys.modules) & {set(HEAVY)}))
"""
    done = python(code)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1] == "loaded:"


def test_what_is_wrong_with_a_case_file_is_said_before_anything_heavy_is_loaded(tmp_path):
    (tmp_path / "bad.toml").write_text(edited(GOOD, ("length_mm = 383.0", "length_mm = -1")), encoding="utf-8")
    code = """
import sys
from click.testing import CliRunner
from jointbayes.cli.commands import main
for command in ("run", "identify", "sample", "check", "plan"):
    for name in ("missing.toml", "bad.toml"):
        result = CliRunner().invoke(main, [command, name])
        assert (result.exit_code, len(result.stderr.splitlines())) == (2, 1), (command, name, result.output)
print(*sorted(set(sys.modules) & {"numpy", "numba", "scipy"}))
"""
    done = python(code, tmp_path)
    assert (done.stdout, done.stderr) == ("\n", "")


# ---- run


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run of the cheap case: where it was, and what the command said."""
    place = tmp_path_factory.mktemp("run")
    config = place / "clamp.toml"
    config.write_text(cheap_text(), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("jointbayes.workflow.sample", partial(jb.sample, settings=TO_CONVERGE))
        return place, cli("run", config, "--out", place / "out")


@pytest.fixture(scope="module")
def unconverged(tmp_path_factory, frequency_posterior):
    """Run directory of the natural-frequency case, of which a sampler says that its steps were too few."""
    place = tmp_path_factory.mktemp("unconverged")
    config = place / "short.toml"
    config.write_text(edited(cheap_frequencies_text(), SHORT), encoding="utf-8")
    failed = unsettled(frequency_posterior)
    with plain_reports(), pytest.MonkeyPatch.context() as patch:
        patch.setattr("jointbayes.workflow.sample", lambda *_, **__: failed)
        assert cli("run", config, "--out", place / "out").exit_code == 3
    return place / "out"


@pytest.mark.whole
def test_a_run_leaves_its_directory_and_nothing_else(finished):
    place, result = finished
    assert result.exit_code == 0, result.output
    assert {p.name for p in place.iterdir()} == {"clamp.toml", "out"}
    out = place / "out"
    assert {p.name for p in out.iterdir()} == {
        "report.html",
        "report.pdf",
        "summary.json",
        "posterior.nc",
        "references.bib",
        "case.toml",
        "figures",
    }
    assert (out / "case.toml").read_text(encoding="utf-8") == cheap_text()
    assert (out / "report.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert (out / "report.pdf").read_bytes().startswith(b"%PDF-")
    drawings = list((out / "figures").iterdir())
    assert {"corner.svg", "traces.svg", "frf-0-0.svg", "iteration-norm.svg"} <= {p.name for p in drawings}
    for drawing in drawings:
        assert ElementTree.parse(drawing).getroot().tag.endswith("}svg")
    if sys.platform != "win32":
        assert out.stat().st_mode & 0o777 == 0o755


@pytest.mark.whole
def test_a_run_states_the_numbers_of_its_summary(finished):
    place, result = finished
    summary = json.loads((place / "out" / "summary.json").read_text(encoding="utf-8"))
    assert (summary["case"], summary["converged"], summary["seed"]) == ("clamp", True, 1)
    lines = result.stdout.splitlines()
    fewest = float(f"{min(summary['sampler']['ess'].values()):.2g}")
    assert lines[0] == f"Converged: {fewest:,.0f} independent draws.".replace(",", " ")
    assert max(map(len, lines[:-1])) <= 200
    for line, (name, p) in zip(lines[1:], summary["parameters"].items(), strict=False):
        errors = (math.nan, *p["interval95_error"])
        drawn = with_interval((p["median"], *p["interval95"]), p["unit"], errors)
        exact = ", if Young's modulus, density, length and damping ratio are exact" if p["conditions"] else ""
        assert line.startswith(f"{name} = {drawn.partition(' ')[0]}"[: len(name) + 5])
        assert line.endswith(f": {p['verdict']}{exact}")
    assert lines[-2] == summary["check"]["sentence"]
    assert str(place / "out" / "report.html") in lines[-1]
    said = [line for line in result.stderr.splitlines() if "compiling" not in line]
    phases = [line for line in said if not line.startswith("sampling: ")]
    assert [re.sub(r"^ *\d+\.\d s  ", "", line) for line in phases] == [
        "loading the data of the case and building its model",
        "searching for the best fit",
        "preparing the sampling",
        "sampling",
        "checking the model",
        *(f"judging: {name}" for name in ("k11", "k12", "k22")),
        "looking at what is known under other premises",
        "looking for the best next step, and for joints that the data rule out",
        "drawing figures",
        "writing HTML, PDF and draws",
    ]
    seconds = [float(line.split()[0]) for line in phases]
    assert seconds == sorted(seconds)


@pytest.mark.whole
def test_report_reproduces_the_run_directory_from_the_draws(finished, tmp_path):
    out = finished[0] / "out"
    result = cli("report", out / "posterior.nc", "--out", tmp_path / "again")
    assert result.exit_code == 0, result.output
    first, again = listing(out), listing(tmp_path / "again")
    assert first.keys() == again.keys()
    same = {name for name in first if first[name] == again[name]}
    # netCDF files are equal in content, not in bytes; a date that turned between the two is in HTML and PDF only
    assert first.keys() - same <= {"posterior.nc", "report.html", "report.pdf"}
    pair = [jb.load_posterior(place / "posterior.nc") for place in (out, tmp_path / "again")]
    for name in PAIR.stiffness_names:
        assert pair[0].values(name).tobytes() == pair[1].values(name).tobytes()


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
def test_a_rerun_replaces_the_run_directory_and_says_if_it_has_not_converged(finished, tmp_path):
    config, out = tmp_path / "short.toml", tmp_path / "out"
    config.write_text(edited(cheap_frequencies_text(), SHORT), encoding="utf-8")
    shutil.copytree(finished[0] / "out", out)
    result = cli("run", config, "--out", out, "--seed", "5")
    assert result.exit_code == 3
    assert result.stdout.startswith("Not converged after 200 steps: do not use a number without a verdict.\n")
    assert {p.name for p in tmp_path.iterdir()} == {"short.toml", "out"}
    assert not (out / "figures" / "frf-0-0.svg").exists()  # of the run before
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert (summary["case"], summary["seed"], summary["converged"]) == ("short", 5, False)


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
def test_a_report_without_convergence_says_so_before_anything_else(unconverged, tmp_path):
    page = (unconverged / "report.html").read_text(encoding="utf-8")
    body = page[page.index("<body") :]
    assert 0 < body.index("Not converged after 200 steps") < body.index("<table")
    assert "The sampler</strong> converged" not in page
    (tmp_path / "empty").mkdir()  # a fair place
    assert cli("report", unconverged / "posterior.nc", "--out", tmp_path / "empty").exit_code == 3
    assert (tmp_path / "empty" / "summary.json").is_file()


@pytest.mark.science
@pytest.mark.usefixtures("plain_reports")
def test_what_init_writes_runs_as_it_stands(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "next: jointbayes run my_case.toml" in cli("init").output
    assert cli("run", "my_case.toml").exit_code == 0
    summary = json.loads((tmp_path / "reports" / "my_case" / "summary.json").read_text(encoding="utf-8"))
    assert summary["parameters"]["k22"]["verdict"] == "identified"


def test_init_overwrites_nothing_and_needs_a_directory(tmp_path):
    assert cli("init", tmp_path).exit_code == 0
    (tmp_path / "my_case.toml").write_text("mine", encoding="utf-8")
    for target in (tmp_path, tmp_path / "my_case.toml", tmp_path / "none" / "a.toml"):
        result = cli("init", target)
        assert (result.exit_code, len(result.stderr.splitlines())) == (2, 1)
        assert "; expected " in result.stderr
    assert listing(tmp_path) == {"my_case.toml": b"mine"}


# ---- other commands


@pytest.mark.whole
def test_identify_prints_the_best_fit_and_the_iteration_where_it_is_asked_for(tmp_path):
    config = tmp_path / "clamp.toml"
    config.write_text(cheap_text(), encoding="utf-8")
    before = listing(tmp_path)
    plain, result = cli("identify", config), cli("identify", config, "--paper")
    assert plain.exit_code == result.exit_code == 0
    assert result.stdout.startswith(plain.stdout)  # the best fit first
    steps = [line.split() for line in result.stdout.splitlines() if line.strip()[:1].isdigit()]
    assert [int(step[0]) for step in steps] == list(range(len(steps)))
    assert [float(k) for k in steps[0][2:]] == [1e8, 0.0, 0.0]
    assert "The paper's iteration did not converge" in result.stdout
    assert "paper" not in plain.stdout
    estimate, case = jb.find_map(config), jb.load_case(config)
    heading, *rows = plain.stdout.splitlines()
    assert heading == "Best fit (MAP), with 95 % intervals from its curvature (Laplace):"
    ends = estimate.laplace_ends(case.problem.prior).T
    for row, value, between, quantity in zip(rows[:3], estimate.values, ends, PAIR.quantities, strict=True):
        name, *shown, unit = re.fullmatch(r"  (\S+) = (\S+) \((\S+) to (\S+)\) (\S+)", row).groups()
        prefix = unit.removesuffix(quantity.unit)
        assert (name, prefix + quantity.unit) == (quantity.name, unit)
        scale = {"": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}[prefix]
        np.testing.assert_allclose([scale * float(number) for number in shown], [value, *between], rtol=6e-3)
        assert len(set(shown)) == 3  # digits enough for the interval
    sd_log = np.sqrt(np.diag(estimate.covariance))
    assert case.problem.prior.labels[0] == "ln k11"
    np.testing.assert_allclose(ends[0], estimate.values[0] * np.exp([-1.96 * sd_log[0], 1.96 * sd_log[0]]), rtol=1e-3)
    assert listing(tmp_path) == before


def with_reference(text, *changes):
    at = text.index("[reference]")
    return text[:at] + edited(text[at:], *changes)


@pytest.mark.whole
def test_check_prints_what_does_not_match_and_exits_1(tmp_path, monkeypatch, cheap_posterior):
    monkeypatch.setattr("jointbayes.workflow.sample", lambda *_arguments, **_options: cheap_posterior)
    config = tmp_path / "clamp.toml"
    config.write_text(with_reference(cheap_text(), ("k22 = 1.52e6", "k22 = 1.60e6")), encoding="utf-8")
    before = listing(tmp_path)
    result = cli("check", config)
    lines = result.stdout.splitlines()
    assert (result.exit_code, lines[-1]) == (1, "The posterior mode does NOT match.")
    assert lines[0].endswith("; seed 1")
    assert [line[:4] for line in lines[1:5]] == ["ok  ", "ok  ", "info", "info"]
    assert [("published" in line, "expected" in line) for line in lines[3:6]] == [(True, False)] * 2 + [(False, True)]
    assert [line.split(":")[0] for line in lines[5:7]] == ["FAIL mode of k22", "FAIL published values"]
    assert listing(tmp_path) == before


def test_check_exits_0_where_the_published_joint_is_found(tmp_path, monkeypatch, cheap_posterior):
    monkeypatch.setattr("jointbayes.workflow.sample", lambda *_arguments, **_options: cheap_posterior)
    config = tmp_path / "clamp.toml"
    config.write_text(cheap_text(), encoding="utf-8")
    result = cli("check", config)
    assert (result.exit_code, result.stdout.splitlines()[-1]) == (0, "The posterior mode matches.")
    assert "FAIL" not in result.stdout


def failures(posterior, *changes, text=None):
    case = jb.case_from_text("case", with_reference(text or cheap_text(), *changes))
    result = jb.check_posterior(case, posterior)
    found = [line.subject for line in result.lines if line.matches is not None and not line.matches]
    assert result.matches == (not found)
    return found


#: What [reference] states over the mode of each stiffness, whether the data are exact, and what does not match then:
#: noisy data are allowed 2 % of k22 and the 99 % region, exact data half a per cent of each stiffness.
CHECKED = [
    ({"k22": 1 / 1.0201}, False, ["mode of k22", "published values"]),
    ({"k22": 1 / 1.0199}, False, ["published values"]),
    ({"k22": 1 / 0.9799}, False, ["mode of k22", "published values"]),
    ({"k22": 1 / 0.9801}, False, ["published values"]),
    ({"k11": 1 / 1.05}, False, []),
    ({"k12": 6.0e7}, False, ["published values"]),
    ({"k12": 0.0}, False, ["published values"]),
    ({"k12": -3.44e7}, False, ["published values"]),
    ({"k11": 1 / 1.0051, "k12": 1.0048, "k22": 1.0048}, True, ["mode of k11"]),
    ({"k11": 1 / 1.0049, "k12": 1.0048, "k22": 1.0048}, True, []),
]


@pytest.mark.parametrize(("stated", "exact", "found"), CHECKED)
def test_check_allows_a_stiffness_what_its_data_allow(cheap_posterior, stated, exact, found):
    printed = {"k11": "5.05e9", "k12": "3.44e7", "k22": "1.52e6"}
    mode = cheap_posterior.mode
    values = {name: value * mode[name] if 0 < value < 10 else value for name, value in stated.items()}
    changes = [(f"{name} = {printed[name]}", f"{name} = {float(value)}") for name, value in values.items()]
    text = edited(cheap_text(), ("added = true", "added = false")) if exact else cheap_text()
    assert failures(cheap_posterior, *changes, text=text) == found


def test_check_fails_without_convergence_or_with_another_mode_than_the_map(cheap_posterior):
    assert failures(unsettled(cheap_posterior)) == ["sampler"]
    best = cheap_posterior.best
    higher = dataclasses.replace(best, log_density=best.log_density + 1.0)
    assert failures(dataclasses.replace(cheap_posterior, best=higher)) == []  # the same point
    elsewhere = dataclasses.replace(higher, theta=best.theta + np.array([0.1, 0.0, 0.0]))
    assert failures(dataclasses.replace(cheap_posterior, best=elsewhere)) == ["mode against MAP"]


def test_check_without_a_reference_is_refused_before_any_work(tmp_path):
    text = cheap_text()
    config = tmp_path / "clamp.toml"
    config.write_text(text[: text.index("[reference]")], encoding="utf-8")
    result = cli("check", config)
    assert result.exit_code == 2
    (line,) = without_stages(result.stderr)
    assert "found no [reference] table" in line


# ---- bad input

GOOD = (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8")


def only_line(result, name):
    """The one line on standard error, which names the file; nothing on standard output, exit status 2."""
    assert (result.exit_code, result.stdout) == (2, "")
    (line,) = without_stages(result.stderr)
    start = f"jointbayes: {name}:"
    assert line.startswith(start)
    return line[len(start) :]


@pytest.mark.parametrize("command", ["run", "identify", "sample", "check", "report"])
def test_a_file_that_cannot_be_read_is_one_line_for_every_command(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "directory").mkdir()
    (tmp_path / "latin.toml").write_bytes(b"# one\ntitle = 'Tr\xe4ger'\n")
    (tmp_path / "empty.toml").write_bytes(b"")
    (tmp_path / "binary.toml").write_bytes(bytes(range(256)))
    before = listing(tmp_path)
    for name in ("missing.toml", "directory", "latin.toml", "empty.toml", "binary.toml"):
        in_it = "/posterior.nc" if (command, name) == ("report", "directory") else ""
        only_line(cli(command, name), name + in_it)
    assert listing(tmp_path) == before


@pytest.mark.parametrize("stated", [None, "4"])
def test_commands_keep_linear_algebra_to_one_thread_whatever_the_environment_says(monkeypatch, stated):
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        if stated is None:
            monkeypatch.delenv(name, raising=False)
        else:
            monkeypatch.setenv(name, stated)
    cli("identify", "no such case.toml")
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"


def test_commands_look_for_garbage_seldom():
    before = gc.get_threshold()
    gc.set_threshold(700, 10, 10)
    try:
        cli("identify", "no such case.toml")
        assert gc.get_threshold()[0] >= 100_000
    finally:
        gc.set_threshold(*before)
