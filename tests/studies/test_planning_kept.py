"""What a plan keeps while it is made: interrupted it goes on, and says how long it will take."""

import json
import os
import re
from dataclasses import asdict, replace
from types import SimpleNamespace

import pytest

import jointbayes as jb
from jointbayes.errors import WriteError
from jointbayes.studies.planning import make_plan
from jointbayes.studies.planning.make_plan import KEPT, KeptSimulations, Simulator
from jointbayes.studies.planning.plan_report import SimulatedPosterior
from tests.conftest import cli
from tests.studies.test_planning import planned_text

WANTED = SimulatedPosterior(0.3, "weakly identified", 812.5, "reweighting")


@pytest.fixture
def made(monkeypatch):
    """Names and truth of each simulation that is made."""
    after, made = Simulator.posterior_after, []

    def counted(self, candidates, truth):
        posterior = after(self, candidates, truth)
        made.append((tuple(one.name for one in candidates), truth))
        return posterior

    monkeypatch.setattr(Simulator, "posterior_after", counted)
    return made


def interrupting(made, count):
    """A callback that interrupts once so many simulations are made."""

    def tell(now):
        if len(made) == count and now.stage == "simulating":
            raise KeyboardInterrupt

    return tell


def few(posterior, directory=None, *, text=None, **options):
    """A plan of three candidates: of two truths, and of three where they could come first."""
    case = jb.case_from_text("cheap", text or planned_text())
    return jb.plan(case, posterior, **{"seed": 3, "simulations": 3, **options}, directory=directory)


@pytest.mark.whole
def test_a_plan_that_was_interrupted_goes_on_and_is_the_same(cheap_posterior, made, tmp_path, monkeypatch):
    monkeypatch.setattr("jointbayes.studies.planning.make_plan.FIRST", 2)
    whole, all_made = few(cheap_posterior).summary(), made.copy()
    assert len(all_made) > 7  # so that some of the second round are among them
    made.clear()
    for count in (4, 7):
        with pytest.raises(KeyboardInterrupt):
            few(cheap_posterior, tmp_path, progress=interrupting(made, count))
    assert made == all_made[:7]
    assert not (tmp_path / "lock").exists()
    file = tmp_path / KEPT
    file.write_bytes(file.read_bytes()[:-9])  # as of a process killed while it wrote: that one is made again
    told = []
    assert few(cheap_posterior, tmp_path, progress=told.append).summary() == whole
    assert (made, str(told[0])) == (all_made[:7] + all_made[6:], "going on: 6 simulations are kept")
    assert (few(cheap_posterior, tmp_path).summary(), len(made)) == (whole, len(all_made) + 1)


@pytest.mark.whole
@pytest.mark.parametrize(("options", "part"), [
    ({"seed": 4}, "seed"), ({"text": planned_text(("length_mm = 383.0", "length_mm = 384.0"))}, "structure.length_mm"),
    ({"text": planned_text(('"5:rz"]\n', '"5:rz"]\nadded_mass_g = 3.0\n'))}, "plan.added_mass_g"),
    ({"assume": {"k11": 1e9, "k12": 1e7, "k22": 1e6}}, "assumed joint"), ({"simulations": 10}, "number of truths"),
    ({}, "version of"),
])  # fmt: skip
def test_simulations_of_another_plan_are_refused_before_any_work(options, part, tmp_path, monkeypatch, cheap_posterior):
    few(cheap_posterior, tmp_path, simulations=0)
    before = (tmp_path / KEPT).read_bytes()
    monkeypatch.setattr("jointbayes.studies.planning.make_plan.sample", lambda *_, **__: pytest.fail("sampled"))
    if not options:
        monkeypatch.setattr("jointbayes.posterior.run_record.version", lambda _: "0.0")
    with pytest.raises(jb.CaseError, match=f"simulations of another .*{part}.*; expected those of this plan; choose"):
        few(None, tmp_path, **{"simulations": 0, **options})
    assert (tmp_path / KEPT).read_bytes() == before


@pytest.mark.parametrize("kind", ["device", "pipe"])
def test_simulations_are_not_read_from_what_never_ends(kind, tmp_path):
    file = tmp_path / KEPT
    if kind == "pipe":
        os.mkfifo(file)
    else:
        file.symlink_to("/dev/zero")
    with pytest.raises(WriteError, match=f"{KEPT}: found a link, a file of several names, or no file at all"):
        KeptSimulations(file, {"seed": "1"})


def test_simulations_of_other_draws_are_passed_over(tmp_path):
    kept = KeptSimulations(tmp_path / KEPT, {"seed": "1"})
    kept.take("these")
    kept.add(("3:y", "5:rz"), 4, WANTED)
    kept.add(("3:y",), 0, None)
    again, other = (KeptSimulations(tmp_path / KEPT, {"seed": "1"}) for _ in range(2))
    again.take("these")
    other.take("others")
    assert (again.done, other.done) == ({(("3:y", "5:rz"), 4): WANTED, (("3:y",), 0): None}, {})


@pytest.mark.parametrize(
    "values",
    [
        {"posterior": {"sd": 0.1}}, {"posterior": 3}, {"posterior": {**asdict(WANTED), "verdict": "\x1b[2J"}},
        {"posterior": {**asdict(WANTED), "sd": "x"}}, {"truth": None}, {"names": 7},
    ],
)  # fmt: skip
def test_a_line_that_holds_no_simulation_is_passed_over(values, tmp_path):
    file = tmp_path / KEPT
    line = {"draws": "these", "names": ["3:y"], "truth": 0, "posterior": None, **values}
    file.write_text(f'{{"seed": "1"}}\n{json.dumps(line)}\n[1]\n', encoding="utf-8")
    kept = KeptSimulations(file, {"seed": "1"})
    kept.take("these")
    assert kept.done == {}


def test_the_time_left_is_that_of_all_that_may_follow(monkeypatch):
    clock, told = [0.0], []

    def after(_candidates, truth):
        clock[0] += 10.0
        return replace(WANTED, sd=0.3 + 0.01 * truth)

    monkeypatch.setattr(make_plan, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    names = [("a",), ("b",), ("c",), ("d",)]
    kept = KeptSimulations(None, {})
    kept.add(("a",), 0, WANTED)  # of an earlier start: it took no time of this one
    simulator = SimpleNamespace(posterior_after=after)
    outcome = make_plan.simulate_first(simulator, dict.fromkeys("abcd"), names, kept, 2, 5, told.append)
    # 7 of the first two truths and 9 that may follow, 10 s each
    assert str(told[0]) == "simulating: 1 of 16 measurements, last of a, about 2 min left"
    assert ([told[i].left_seconds for i in (0, 6, -1)], told[-1].done) == ([150.0, 90.0, 0.0], 16)
    assert sorted(len(one.posteriors) for one in outcome.values()) == [2, 5, 5, 5]


@pytest.mark.long
@pytest.mark.science
def test_the_command_that_was_interrupted_says_what_is_kept_and_goes_on(made, tmp_path, monkeypatch):
    monkeypatch.setattr("jointbayes.studies.planning.make_plan.FIRST", 3)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cheap.toml").write_text(planned_text(('"3:y", "5:rz"', '"1:y"')), encoding="utf-8")
    command = ["plan", "cheap.toml", "--seed", "2"]
    with monkeypatch.context() as patch:
        patch.setattr("jointbayes.cli.progress_display._print_lines", lambda: interrupting(made, 4))
        stopped = cli(*command)
    directory = tmp_path / "reports" / "cheap-plan"
    assert stopped.exit_code == 130
    kept = "jointbayes: interrupted; what is done is kept in reports/cheap-plan; the same command goes on\n"
    assert stopped.stderr.endswith(kept)
    assert {path.name for path in directory.iterdir()} == {".jointbayes", KEPT, "present"}

    monkeypatch.setattr("jointbayes.workflow.find_map", lambda *_, **__: pytest.fail("the mode was sought again"))
    ended = cli(*command)
    monkeypatch.undo()
    assert ended.exit_code == 0, ended.output
    assert len(made) == len(set(made))
    assert "going on: 4 simulations are kept" in ended.stderr
    assert re.search(r"^simulating: (\d+) of \1 measurements, .*, about 0 s left$", ended.stderr, re.MULTILINE)
    assert "Report: reports/cheap-plan/report.html and " in ended.stdout
    case, written = jb.load_case(tmp_path / "cheap.toml"), (directory / "plan.json").read_text(encoding="utf-8")
    with monkeypatch.context() as patch:
        patch.setattr("jointbayes.studies.planning.make_plan.FIRST", 3)
        assert json.loads(written) == jb.plan(case, seed=2).summary()
