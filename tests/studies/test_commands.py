"""What every study does as a command: bad input is one line and exit 2 before any work, the exit code is the answer."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import jointbayes as jb
from jointbayes.cli.commands import main
from jointbayes.studies.plan import Plan
from jointbayes.studies.same import JointChange
from tests.conftest import cli
from tests.studies.calibration_cases import FREQUENCIES, TEXT
from tests.studies.test_comparison import made_up
from tests.studies.test_same import UNCHANGED


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    """A directory with cases, with one of somebody else's, and with a posterior that no command gets to read."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("jointbayes.case.case.find_numbering", lambda *_: None)
    mobility = TEXT.replace('kind = "synthetic_frf"', 'kind = "synthetic_frf"\nquantity = "mobility"')
    heard = FREQUENCIES.replace("100.0, 650.0", "101.0, 650.0")
    for name, text in (("case", TEXT), ("mobility", mobility), ("peaks", FREQUENCIES), ("heard", heard)):
        Path(f"{name}.toml").write_text(text, encoding="utf-8")
    Path("full").mkdir()
    Path("full/summary.json").write_text("{}", encoding="utf-8")


@pytest.mark.parametrize(("line", "said"), [
    ("compare peaks.toml heard.toml", "found other data in heard than in peaks"),
    ("compare peaks.toml none.toml", "none.toml"), ("compare peaks.toml peaks.toml", "two cases named peaks"),
    ("same none.toml case.toml", "no such file"), ("same none case.toml", "no such file"),
    ("campaign none.csv", "No such file"), ("plan none.toml", "no such file"),
    *((f"{command} {'peaks' if command == 'compare' else 'case'}.toml --out full", "holds other files")
      for command in ("compare", "campaign")),
])  # fmt: skip
def test_bad_input_is_refused_in_one_line_before_anything_is_computed(line, said, tmp_path, monkeypatch):
    for work in ("workflow.find_map", "workflow.sample", "studies.campaign.run_tasks"):
        monkeypatch.setattr(f"jointbayes.{work}", lambda *_, **__: pytest.fail("computed"))
    result = cli(*line.split())
    assert (result.exit_code, result.stdout, said in result.stderr) == (2, "", True), result.output
    assert len([told for told in result.stderr.splitlines() if told.startswith(("jointbayes: ", "Error: "))]) == 1
    assert [path.name for path in tmp_path.rglob("*") if path.suffix in (".html", ".pdf", ".jsonl")] == []


CHANGE = JointChange((UNCHANGED,), None, -9.0, (), True, "")


@pytest.mark.parametrize(("line", "work", "answer", "code", "said"), [
    ("compare peaks.toml", "studies.compare.compare",
     jb.Comparison((made_up(-10.0, error=0.9), made_up(-12.0, "springs")), 1, ""), 3, "NOT TRUSTED"),
    ("plan case.toml", "studies.plan.plan", Plan((), "Raise max_steps", False), 3, "Raise max_steps"),
    *(("same case.toml case.toml --json --quiet", "studies.same.compare_joints", replace(CHANGE, **wish), code, said)
      for wish, code, said in (({}, 0, '"k22"'), ({"two_log_b": 9.0}, 1, '"k22"'),
                               ({"converged": False, "two_log_b": 9.0, "reason": "no"}, 3, "NOT CONVERGED"))),
])  # fmt: skip
def test_the_exit_code_says_what_was_found(line, work, answer, code, said, tmp_path, monkeypatch):
    monkeypatch.setattr(f"jointbayes.{work}", lambda *_, **__: answer)
    result = cli(*line.split())
    assert (result.exit_code, said in result.stdout) == (code, True), result.output
    if line.startswith("same"):
        told = json.loads(result.stdout)
        assert told["stiffness"][0]["name"] == "k22"
        assert ("NOT CONVERGED, DO NOT USE THESE NUMBERS: no" in told["messages"]) == (code == 3)


def test_a_fault_of_the_program_has_an_exit_code_that_means_nothing_else(monkeypatch):
    monkeypatch.delenv("JOINTBAYES_DEBUG", raising=False)
    monkeypatch.setattr("jointbayes.studies.same.compare_joints", lambda *_: np.zeros(0).reshape(0, -1))
    result = CliRunner().invoke(main, ["same", "case.toml", "case.toml", "--quiet"])
    assert (result.exit_code, result.stdout) == (70, "")
    assert result.stderr.startswith(
        "jointbayes: a bug in jointbayes: found ValueError in studies.py:"
    )  # of the package, and not in what it calls
    assert result.stderr.endswith("please report it, with the case and what JOINTBAYES_DEBUG=1 prints\n")
    assert result.stderr.count("\n") == 1
    told = json.loads(CliRunner().invoke(main, ["same", "case.toml", "case.toml", "--json"]).stdout)
    assert (told["exit_code"], len(told["errors"])) == (70, 1)
