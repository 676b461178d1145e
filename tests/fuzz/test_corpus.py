"""What was found by fuzzing once stays right: every kept file of every target, in each run of the tests."""

import pytest

from tests.fuzz.harness import Attacker
from tests.fuzz.targets import files, places

#: Whose kept files take ten seconds.
_LARGE = ("case", "posterior")


@pytest.fixture(scope="module")
def reader():
    """One process for files of all formats, which are told apart by what they hold and by their ending."""
    with Attacker(places()["csv"]) as attacker:
        yield attacker


def attempted(attacker, target):
    kept = target.corpus()
    assert kept
    for path in kept:
        verdict = attacker.attempt(path.read_bytes(), target.suffix)
        assert verdict.right, f"{path.name}: {verdict.kind}: {verdict.where}\n{verdict.text}"


@pytest.mark.whole
@pytest.mark.parametrize("target", files.TARGETS, ids=lambda target: target.name)
def test_every_kept_file_is_taken_or_refused_in_one_line(reader, target):
    attempted(reader, target)


@pytest.mark.long
@pytest.mark.science
@pytest.mark.parametrize("name", _LARGE)
def test_every_kept_case_and_posterior_is_taken_or_refused_in_one_line(name):
    with Attacker(places()[name]) as attacker:
        attempted(attacker, attacker.target)


@pytest.mark.whole
def test_every_kept_structure_is_taken_or_refused_in_one_line():
    with Attacker(places()["structure"]) as attacker:
        attempted(attacker, attacker.target)


@pytest.mark.whole
def test_every_target_has_its_kept_files_attempted():
    assert set(places()) == {*_LARGE, "structure", *(target.name for target in files.TARGETS)}
