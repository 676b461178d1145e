"""What was found by fuzzing once stays right: every kept file of every target, in each run of the tests."""

import pytest

from tests.fuzz.harness import Attacker
from tests.fuzz.targets import places


@pytest.mark.parametrize("name", places())
def test_every_kept_file_is_taken_or_refused_in_one_line(name):
    with Attacker(places()[name]) as attacker:
        for path in attacker.target.corpus():
            verdict = attacker.attempt(path.read_bytes())
            assert verdict.right, f"{path.name}: {verdict.kind}: {verdict.where}\n{verdict.text}"
