"""Runs that are stopped from outside: by a signal, by another run, by what stands in their way."""

import os
import signal
import subprocess
import sys

import pytest

import jointbayes as jb
from jointbayes.report.run_directory import room_of_run
from jointbayes.sampling import SamplerSettings, UnfinishedRun, checkpoint
from tests.conftest import CONFIGS, cheap_frequencies_text, cli, edited, first_in_ci

EVERY_BLOCK = "import jointbayes.sampling.checkpoint as c; c.SECONDS_BETWEEN = 0.0; c._TIMES_THE_COST = 0\n"
#: The command line; it sends itself a signal when the sampler has come so far, as a user or a batch system does.
STOPPED = EVERY_BLOCK + (
    "import os, signal, sys\nfrom jointbayes.cli import progress_display as progress\n"
    "from jointbayes.cli.commands import main\n"
    "def report(told):\n    if told.done >= 100: os.kill(os.getpid(), {signal})\n"
    "progress._print_lines = lambda: report\nmain()"
)


def program(folder, code, *arguments):
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)], cwd=folder, capture_output=True, text=True, check=False
    )


def names(folder):
    return sorted(p.name for p in folder.iterdir())


@pytest.fixture
def config(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("jointbayes.case.case.find_numbering", lambda *_: None)  # looked for at each reading of a case
    path = tmp_path / "clamp.toml"
    path.write_text(edited(cheap_frequencies_text(), ("max_steps = 20000", "max_steps = 200")), encoding="utf-8")
    return path


@pytest.mark.whole
@pytest.mark.parametrize(("number", "status"), first_in_ci([(signal.SIGTERM, 143), (signal.SIGINT, 130)], 1))
def test_a_run_stopped_by_a_signal_says_how_to_go_on_and_goes_on_to_the_same_bits(config, tmp_path, number, status):
    done = program(tmp_path, STOPPED.format(signal=int(number)), "sample", config.name, "--out", "x.nc", "--seed", "2")
    assert done.returncode == status, done.stderr
    *_, line = done.stderr.splitlines()
    assert line == (
        "jointbayes: interrupted; the run is kept in x.nc.unfinished as it is after 100 steps; go on with: "
        "jointbayes sample clamp.toml --out x.nc --seed 2 --resume"
    )
    assert "Traceback" not in done.stderr
    assert set(names(tmp_path)) == {"clamp.toml", "x.nc.unfinished"}
    again = cli("sample", config, "--out", "x.nc", "--seed", "2")
    assert again.exit_code == 2
    assert "x.nc.unfinished: found an unfinished run; expected none; to go on with it use: jointbayes" in again.stderr
    assert cli("sample", config, "--out", "x.nc", "--seed", "2", "--resume").exit_code in (0, 3)
    assert names(tmp_path) == ["clamp.toml", "x.nc"]
    undisturbed = jb.sample(jb.load_case(config), seed=2)
    assert jb.load_posterior("x.nc").theta.tobytes() == undisturbed.theta.tobytes()


@pytest.mark.whole
def test_a_signal_before_the_first_step_leaves_nothing(config, tmp_path):
    code = (
        "import os\nfrom jointbayes import workflow\nfrom jointbayes.cli.commands import main\n"
        f"def search(*_a, **_o):\n    os.kill(os.getpid(), {int(signal.SIGHUP)})\n    import time; time.sleep(9)\n"
        "workflow.find_map = search\nmain()"
    )
    done = program(tmp_path, code, "run", config.name, "--out", "out")
    assert (done.returncode, done.stderr.splitlines()[-1]) == (143, "jointbayes: interrupted; nothing was written")
    assert "Traceback" not in done.stderr
    assert names(tmp_path) == ["clamp.toml"]


@pytest.mark.whole
def test_a_signal_while_the_report_is_written_leaves_the_draws_and_nothing_hidden(
    config, tmp_path, frequency_posterior
):
    frequency_posterior.save("draws.nc")
    code = (
        "import os, sys\nimport jointbayes as jb\n"
        "from jointbayes import workflow\nfrom jointbayes.report import run_directory\n"
        "from jointbayes.cli.commands import main\n"
        "workflow.sample = lambda *_a, **_o: jb.load_posterior('draws.nc')\n"
        "run_directory.render_pdf = lambda _report: os.kill(os.getpid(), 15)\n"
        "from jointbayes.posterior import posterior\nfrom jointbayes.report import drawing\n"
        "posterior._profiles = posterior.effect_of_uncertain_inputs = lambda *_: ()\n"
        "drawing.svg = lambda *_: '<svg xmlns=\"http://www.w3.org/2000/svg\"/>'\nmain()"
    )
    done = program(tmp_path, code, "run", config.name, "--out", "out")
    assert done.returncode == 143, done.stderr
    *_, line = done.stderr.splitlines()
    assert line.startswith(
        "jointbayes: interrupted while the report was written; the draws are whole in out.posterior.nc;"
    )
    assert names(tmp_path) == ["clamp.toml", "draws.nc", "out.posterior.nc"]


def test_two_runs_on_one_directory_are_refused(config, tmp_path):
    with UnfinishedRun(tmp_path / "out.unfinished"):
        for command in ("run", "sample"):
            result = cli(command, config, "--out", "out", "--resume")
            assert result.exit_code == 2
            assert f"out.unfinished: found another process at work in it (process {os.getpid()} on " in result.stderr
    assert names(tmp_path) == ["clamp.toml"]


@pytest.mark.whole
def test_a_changed_case_is_refused_by_its_key(config, monkeypatch):
    def stop(told):
        if told.done >= 100:
            raise KeyboardInterrupt

    monkeypatch.setattr(checkpoint, "SECONDS_BETWEEN", 0.0)
    monkeypatch.setattr(checkpoint, "_TIMES_THE_COST", 0)
    with monkeypatch.context() as patch:
        patch.setattr("jointbayes.cli.progress_display._print_lines", lambda: stop)
        assert cli("sample", config, "--out", "x.nc").exit_code == 130
    text = config.read_text(encoding="utf-8")
    config.write_text(text.replace("elements = 4", "elements = 5"), encoding="utf-8")
    result = cli("sample", config, "--out", "x.nc", "--resume")
    assert result.exit_code == 2
    assert "structure.elements: found 5, expected 4 as in the checkpoint" in result.stderr
    config.write_text(f"# only a comment\n{text}", encoding="utf-8")
    assert cli("sample", config, "--out", "x.nc", "--resume").exit_code in (0, 3)


def test_a_run_directory_with_a_file_of_the_user_is_refused_before_any_work(config, tmp_path, monkeypatch):
    monkeypatch.setattr("jointbayes.workflow.find_map", None)
    (tmp_path / "out" / "figures").mkdir(parents=True)
    for name in ("summary.json", "report.html", "figures/k11.svg", ".DS_Store", "figures/Thumbs.db"):
        (tmp_path / "out" / name).touch()  # the last two come from looking at it
    for name, found in (("notes.txt", "notes.txt"), ("figures/photo.jpg", "figures/photo.jpg"), ("raw/x.uff", "raw")):
        (tmp_path / "out" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "out" / name).write_text("mine", encoding="utf-8")
        result = cli("run", config, "--out", "out")
        assert result.exit_code == 2
        assert f"out: found {found} in it, which no run wrote; expected a new directory or" in result.stderr
        (tmp_path / "out" / name).unlink()
    (tmp_path / "out" / "raw").rmdir()
    (tmp_path / "link").symlink_to("out")
    assert "link: found a link; expected" in cli("run", config, "--out", "link").stderr
    assert names(tmp_path) == ["clamp.toml", "link", "out"]


def test_a_run_asks_for_the_room_of_checkpoint_draws_and_report_together(config):
    case = jb.load_case(config)
    settings = SamplerSettings(walkers=8, max_steps=20_000)
    draws = 1000 * 4 * 8 * 8  # bytes of one number of each draw
    assert room_of_run(case.problem, settings, report=False) == draws * (4 + 9)  # θ and ln p; 3 + 3 + 3
    assert room_of_run(case.problem, settings, report=True) == draws * (4 + 2 * 9) + 3_000_000


def places(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "link").symlink_to("/dev/null")
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "mine").write_text("mine", encoding="utf-8")
    return [".", "..", "/", "fifo", "link", "/dev/null", "/proc/x", "notes", "notes/mine", "clamp.toml/out"]


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="this system has no /proc")
@pytest.mark.parametrize("command", ["run", "sample"])
def test_a_place_that_cannot_be_written_is_found_before_any_work(config, tmp_path, monkeypatch, command):
    def worked(*_arguments, **_options):
        raise AssertionError

    monkeypatch.setattr("jointbayes.workflow.find_map", worked)
    for place in [*places(tmp_path), *(["nowhere/x.nc"] if command == "sample" else [])]:
        before = names(tmp_path)
        result = cli(command, config, "--out", place)
        assert (result.exit_code, result.stdout) == (2, ""), (place, result.output)
        assert isinstance(result.exception, SystemExit), place
        line = result.stderr.splitlines()[-1]
        assert line.startswith(f"jointbayes: {place}"), line
        assert names(tmp_path) == before


def test_too_little_room_is_found_before_any_work(config, tmp_path, monkeypatch):
    usage = type("Usage", (), {"free": 5000})
    monkeypatch.setattr("shutil.disk_usage", lambda _place: usage)
    for command in ("run", "sample"):
        result = cli(command, config, "--out", "out")
        assert result.exit_code == 2
        assert "out: found 0.0 MB free on the disk; expected at least " in result.stderr
    assert names(tmp_path) == ["clamp.toml"]


@pytest.mark.science
@pytest.mark.long
def test_killed_runs_come_to_the_same_posterior_and_leave_nothing(tmp_path):
    # a process of its own: the runs are forks of it, and this one has threads
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.killed", "--count", "4", "--seed", "3", "--no-page",
         "--kept", str(tmp_path / "kept")],
        cwd=CONFIGS.parent, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    *_, last = done.stdout.split("| all ")
    runs, _by_time, _at_call, *rest = (int(cell) for cell in last.strip(" |\n").split("|"))
    assert (runs, rest) == (4, [4, 0, 0])


# ---- killed once the result is there


@pytest.mark.whole
@pytest.mark.parametrize("left", first_in_ci([True, False], 1))
def test_what_a_run_killed_after_its_posterior_leaves_goes_with_the_next(config, tmp_path, monkeypatch, left):
    with monkeypatch.context() as killed:
        killed.setattr(UnfinishedRun, "discard", lambda _: None)
        assert cli("sample", config, "--out", "x.nc").exit_code == 3
    place = tmp_path / "x.nc.unfinished"
    assert {path.name for path in place.iterdir()} == {".jointbayes", "run.npz"}
    if not left:  # removed before it was killed
        (place / "run.npz").unlink()
    draws = jb.load_posterior("x.nc").theta.tobytes()
    assert cli("sample", config, "--out", "x.nc", *(["--resume"] if left else [])).exit_code == 3
    assert names(tmp_path) == ["clamp.toml", "x.nc"]
    assert jb.load_posterior("x.nc").theta.tobytes() == draws


@pytest.mark.whole
def test_a_report_removes_the_unfinished_run_of_its_draws_and_no_other(
    tmp_path, monkeypatch, frequency_posterior, cheap_posterior
):
    monkeypatch.chdir(tmp_path)
    inputs = type(
        "Inputs", (), {"summary": type("Summary", (), {"to_json": lambda _: {}})(), "__init__": lambda *_: None}
    )
    monkeypatch.setattr("jointbayes.report.inputs.ReportInputs", inputs)
    monkeypatch.setattr("jointbayes.report.run_directory.write_run", lambda _, target, *__: target.mkdir(exist_ok=True))
    frequency_posterior.save("draws.nc")
    place = tmp_path / "out.unfinished"
    for posterior, after in ((cheap_posterior, ["draws.nc", "out", "out.unfinished"]),
                             (frequency_posterior, ["draws.nc", "out"])):  # fmt: skip
        with UnfinishedRun(place, resume=True) as run:
            run.begin({"seed": "1"})
            run.keep_estimate({})
            run._save(now=True)
            posterior.save(place / "posterior.nc")
        assert cli("report", "draws.nc", "--out", "out").exit_code in (0, 3)
        assert names(tmp_path) == after
