import random

import pytest

from jointbayes.errors import ModelError
from tests.fuzz.damage import EXTREMES, damaged_bytes, with_extreme_number
from tests.fuzz.harness import Attacker, fuzz, made_input
from tests.fuzz.targets import TARGETS as ALL
from tests.fuzz.targets import Target


class _RawError(ModelError):
    """An error whose text is as it was given, unlike those of the package."""

    def __str__(self) -> str:
        return str(self.args[0])


HERE = __name__
IMPORTS = """import os, time, warnings
from pathlib import Path
from jointbayes.errors import CaseError, ModelError"""
REFUSE = "raise ModelError(f'{path}: found nothing; expected something; write it')"


class Misbehaving(Target):
    """Does what its input says, which is Python."""

    name = "misbehaving"
    suffix = ".txt"
    memory = 2 * 2**30
    seconds = 1.0

    def seeds(self):
        return [b"pass"]

    def damage(self, rng, content, other):
        return rng.choice([content, b"xxxxxx zero xxxxxx", REFUSE.encode()])

    def attempt(self, path):
        if "zero" in path.read_text():
            raise ZeroDivisionError
        exec(f"{IMPORTS}\n{path.read_text()}", {"path": path, "_RawError": _RawError})


BAD = Misbehaving()
TARGETS = {BAD.name: BAD}


@pytest.fixture(scope="module")
def attacker():
    with Attacker(f"{HERE}:{BAD.name}") as attacker:
        yield attacker


@pytest.mark.parametrize(("text", "kind"), [
    ("pass", "accepted"), (REFUSE, "refused"), ("zero", "traceback"), ("raise SystemExit", "traceback"),
    ("raise ModelError('found nothing')", "message"), ("raise CaseError(f'{path}:1: found\\nnothing')", "message"),
    ("raise _RawError(f'{path}:1: found \\x1b[31mred')", "message"), ("Path('left.txt').write_text('x')", "file left"),
    ("(Path(os.environ['TMPDIR']) / 'left' / 'deep').mkdir(parents=True)", "file left"),
    ("warnings.warn('look', UserWarning, stacklevel=1)", "warning"), ("print('hello')", "printed"),
    ("bytearray(4 * 2**30)", "memory"), ("os.abort()", "crash"),
    pytest.param("while True: pass", "hang", marks=pytest.mark.science),
    pytest.param("while time.process_time() - begun < 1.2: pass", "slow", marks=pytest.mark.science),
])  # fmt: skip
def test_each_misdeed_is_seen_and_the_next_input_is_judged_afresh(attacker, text, kind):
    text = text.replace("while time", "begun = time.process_time()\nwhile time")
    assert (attacker.attempt(text.encode()).kind, attacker.attempt(b"pass").kind) == (kind, "accepted")


def test_inputs_depend_on_seed_and_number_alone():
    inputs = [made_input(BAD, BAD.seeds(), 1, number) for number in range(50)]
    assert inputs == [made_input(BAD, BAD.seeds(), 1, number) for number in range(50)]
    assert inputs != [made_input(BAD, BAD.seeds(), 2, number) for number in range(50)]
    assert len(set(inputs)) == 3


def test_an_offender_is_kept_small_with_what_it_did_and_counted(tmp_path):
    tally = fuzz(f"{HERE}:{BAD.name}", seed=1, count=40, seconds=None, offenders=tmp_path)
    assert tally.kinds.total() == 40
    ((kind, where), numbers) = next(iter(tally.faults.items()))
    assert (kind, where) == ("traceback", "ZeroDivisionError in test_harness.py:attempt")
    assert len(numbers) == tally.kinds["traceback"] > 3
    smallest = min(tally.saved, key=lambda path: path.stat().st_size)
    assert smallest.read_bytes() == b"zero"
    assert "raise ZeroDivisionError" in smallest.with_name(f"{smallest.name}.txt").read_text()
    assert "ZeroDivisionError" in str(tally)


def test_the_generator_alone_decides_on_damage():
    text = b"length_mm = 383.0\n[joint]\ndofs = 4\n"
    assert damaged_bytes(random.Random(3), text) == damaged_bytes(random.Random(3), text)
    assert len({damaged_bytes(random.Random(seed), text) for seed in range(100)}) > 80
    assert damaged_bytes(random.Random(1), b"") == b""
    found = with_extreme_number(random.Random(1), b"length_mm = 383.0 # mm")
    assert found.removeprefix(b"length_mm = ").removesuffix(b" # mm").decode() in EXTREMES


@pytest.mark.parametrize("name", ALL)
def test_damage_is_the_generators_and_no_input_is_made_often(name):
    target = ALL[name]
    seeds = target.seeds()[:8]
    inputs = [made_input(target, seeds, 1, number) for number in range(60)]
    assert len(set(inputs)) > 40
    if name not in ("mat", "mat73", "hdf5", "posterior"):  # whose writers put the time into a file
        assert inputs == [made_input(target, seeds, 1, number) for number in range(60)]
