"""What was found by fuzzing once stays right: every kept file of every target."""

import pytest

from tests.fuzz.harness import Attacker
from tests.fuzz.targets import FILES, TARGETS

#: Whose kept files take ten seconds.
_LARGE = ("case", "posterior")
_KNOWN = [pytest.param(name, marks=[pytest.mark.long, pytest.mark.science] if name in _LARGE else pytest.mark.whole)
          for name in TARGETS]  # fmt: skip


@pytest.fixture(scope="module")
def reader():
    """One process for files of all formats: what they hold and their ending says which is which."""
    with Attacker("tests.fuzz.targets:csv") as attacker:
        yield attacker


@pytest.mark.parametrize("name", _KNOWN)
def test_every_kept_file_is_taken_or_refused_in_one_line(reader, name):
    target = TARGETS[name]
    kept = target.corpus()
    assert kept
    with Attacker(f"tests.fuzz.targets:{name}") as own:
        for path in kept:
            verdict = (reader if target in FILES else own).attempt(path.read_bytes(), target.suffix)
            assert verdict.right, f"{path.name}: {verdict.kind}: {verdict.where}\n{verdict.text}"
