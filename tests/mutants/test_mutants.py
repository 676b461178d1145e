"""The list of mutants fits the tree as it is, and the command that tries them says what it found."""

import os
import re

import pytest

from tests.mutants import harness
from tests.mutants.__main__ import main
from tests.mutants.harness import ROOT, Mutant, judge, read_list, run_tests

MUTANTS = read_list()
TRUE = "def double(x):\n    return 2 * x\n\n\ndef half(x):\n    return x / 2\n"
TESTED = "from thing import double\n\n\ndef test_double():\n    assert double(3) == 6\n"
KILLED = ("twice", "src/thing.py", "return 2 * x", "return 3 * x", ("tests/test_thing.py::test_double",))
SURVIVES = ("half", "src/thing.py", "return x / 2", "return x / 3", ("tests/test_thing.py::test_double",))


@pytest.mark.parametrize("mutant", MUTANTS, ids=[mutant.id for mutant in MUTANTS])
def test_each_mutant_of_the_list_can_be_put_into_the_tree(mutant):
    assert mutant.faults(ROOT) == []


def test_the_list_has_sixty_mutants_and_no_name_twice():
    assert len(MUTANTS) >= 60
    assert len({mutant.id for mutant in MUTANTS}) == len(MUTANTS)


@pytest.fixture
def tree(tmp_path):
    """A little package with one of its two functions tested."""
    for name, text in {"src/thing.py": TRUE, "tests/test_thing.py": TESTED}.items():
        path = tmp_path / "tree" / name
        path.parent.mkdir(parents=True)
        path.write_text(text)
    return tmp_path / "tree"


@pytest.fixture
def command(tree, tmp_path):
    """The command on that tree and on a list of mutants."""

    def run(*mutants, arguments=()):
        names = ("id", "file", "old", "new", "tests")
        tables = [dict(zip(names, mutant, strict=True)) for mutant in mutants]
        lines = (
            f"{key} = {list(value) if key == 'tests' else repr(value)}"
            for table in tables
            for key, value in table.items()
        )
        text = re.sub(r"^(?=id = )", "[[mutant]]\n", "\n".join(lines), flags=re.MULTILINE)
        (tmp_path / "list.toml").write_text(text)
        return main(["--outcomes", str(tmp_path / "outcomes.jsonl"), *arguments], tree, tmp_path / "list.toml")

    return run


@pytest.fixture
def runs(monkeypatch, tree):
    """What pytest is asked to run: texts of the file, and whether it is as it was; the tests are made by hand."""
    seen = []

    def by_hand(copy, tests, *, unmutated):
        path = copy / "src" / "thing.py"
        assert copy != tree
        assert (
            unmutated == (path.read_text() == TRUE) == (path.stat().st_mtime == (tree / "src/thing.py").stat().st_mtime)
        )
        seen.append(path.read_text())
        wrong = "2 * x" not in seen[-1]
        return int(wrong), "FAILED tests/test_thing.py::test_double - assert 9 == 6" if wrong else ""

    monkeypatch.setattr(harness, "run_tests", by_hand)
    return seen


def test_each_mutant_is_put_in_alone_and_taken_out_and_a_survivor_makes_exit_code_1(command, runs, tree, capsys):
    assert command(KILLED, SURVIVES) == 1
    assert sorted(runs) == sorted([TRUE, TRUE.replace("2 * x", "3 * x"), TRUE.replace("x / 2", "x / 3")])
    told = capsys.readouterr().out
    assert re.search(r"^twice +killed +\d+\.\d s  tests/test_thing\.py::test_double$", told, re.MULTILINE)
    assert re.search(r"^half +survived +\d+\.\d s$", told, re.MULTILINE)
    assert re.search(r"^1 mutants killed, 1 not: half; \d+ s$", told, re.MULTILINE)
    assert ((tree / "src/thing.py").read_text(), command(KILLED, SURVIVES, arguments=["twice"])) == (TRUE, 0)


def test_what_is_done_is_not_done_again_unless_the_tree_is_another(command, runs, tree, tmp_path):
    assert (command(KILLED), command(KILLED, arguments=["--resume"]), len(runs)) == (0, 0, 2)
    kept = tmp_path / "outcomes.jsonl"
    kept.write_text(kept.read_text()[:-20])  # cut off in the line of the mutant
    for _ in range(2):
        assert (command(KILLED, arguments=["--resume"]), len(runs)) == (0, 3)
    (tree / "tests/test_thing.py").write_text(f"{TESTED}\n")
    assert (command(KILLED, arguments=["--resume"]), len(runs), command(KILLED), len(runs)) == (0, 5, 0, 7)


def test_a_mutant_is_not_killed_by_tests_that_fail_without_it(command, monkeypatch, capsys):
    monkeypatch.setattr(harness, "run_tests", lambda *_, **__: (1, "FAILED tests/test_thing.py::test_double"))
    assert command(KILLED) == 1
    assert "(test_thing.py)  tests fail" in capsys.readouterr().out


@pytest.mark.parametrize(("change", "fault"), [
    ({"old": "return"}, "'return' stands 2 times in src/thing.py; expected once; write it as it is now"),
    ({"old": "return 4"}, "'return 4' stands 0 times in src/thing.py; expected once"),
    ({"old": ""}, "'' stands 0 times in src/thing.py; expected once"),
    ({"file": "src/gone.py"}, "'return 2 * x' stands 0 times in src/gone.py; expected once"),
    ({"new": "return 2 * x"}, "'return 2 * x' in the place of 'return 2 * x'; expected another text"),
    ({"new": "return 2\n    x"}, "expected another text, both within one line"),
    ({"tests": ("tests/test_gone.py",)}, "'tests/test_gone.py' is no test; expected a test file, or file::test"),
    ({"tests": ("tests/test_thing.py::test_doubl",)}, "'tests/test_thing.py::test_doubl' is no test"),
    ({"tests": ()}, "'' is no test"),
])  # fmt: skip
def test_a_mutant_that_no_longer_fits_the_tree_is_refused_by_name_before_any_is_tried(
    command, runs, tree, capsys, change, fault
):
    mutant = dict(zip(("id", "file", "old", "new", "tests"), KILLED, strict=True)) | change
    (found,) = Mutant(**mutant).faults(tree)
    assert found.startswith("twice: ")
    assert fault in found
    if "\n" not in mutant["new"]:
        assert (command(tuple(mutant.values()), SURVIVES), capsys.readouterr().out, runs) == (1, f"{found}\n", [])


def test_a_mutant_that_is_not_in_the_list_is_named(command, runs, capsys):
    with pytest.raises(SystemExit, match="2"):
        command(KILLED, arguments=["thrice"])
    assert "found thrice; expected names of mutants in list.toml" in capsys.readouterr().err


@pytest.mark.parametrize(("code", "printed", "outcome"), [
    (0, "1 passed", ("survived", "")),
    (1, "FAILED tests/test_a.py::test_b[x] - assert 1\n1 failed", ("killed", "tests/test_a.py::test_b[x]")),
    (1, "ERROR tests/test_a.py::test_b - NameError\n1 error", ("killed", "tests/test_a.py::test_b")),
    (1, "INTERNALERROR> NameError", ("broke pytest", "")),
    (1, "FAILED tests/a.py::b - Failed: Timeout (>120.0s) from pytest-timeout.", ("takes too long", "tests/a.py::b")),
    (None, "", ("takes too long", "")),
    (2, "ERROR tests/test_a.py - SyntaxError", ("does not import", "tests/test_a.py")),
    (4, "ERROR: not found: tests/test_a.py::test_c", ("names no test", "")),
    (5, "1 deselected", ("runs no test", "")),
    (3, "", ("pytest ended with 3", "")),
])  # fmt: skip
def test_only_a_test_that_fails_kills(code, printed, outcome):
    assert judge(code, printed) == outcome


@pytest.mark.whole
def test_pytest_runs_the_tests_of_a_copy_on_the_code_of_that_copy(tree):
    os.utime(tree / "src/thing.py", (1e9, 1e9))  # as in a tree that was not written this very second
    code, printed = run_tests(tree, ["tests/test_thing.py"], unmutated=True)
    assert (code, "1 passed" in printed) == (0, True)
    (tree / "src/thing.py").write_text(TRUE.replace("2 * x", "3 * x"))
    assert judge(*run_tests(tree, ["tests/test_thing.py"], unmutated=False)) == ("killed", KILLED[-1][0])
