"""What was found by fuzzing once stays right: every kept file of every target, in each run of the tests."""

import pytest

from tests.fuzz.harness import Attacker
from tests.fuzz.targets import places

#: Whose kept files take ten seconds.
_LARGE = ("case", "posterior")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.science] * (name in _LARGE)) for name in places()]
)
def test_every_kept_file_is_taken_or_refused_in_one_line(name):
    with Attacker(places()[name]) as attacker:
        for path in attacker.target.corpus():
            verdict = attacker.attempt(path.read_bytes())
            assert verdict.right, f"{path.name}: {verdict.kind}: {verdict.where}\n{verdict.text}"
