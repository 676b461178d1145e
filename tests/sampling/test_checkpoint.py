"""Runs that go on from a checkpoint: the same bits as if never interrupted, whatever was damaged on the way."""

import dataclasses
import errno
import os
import signal

import numpy as np
import pytest

from jointbayes.errors import CheckpointError
from jointbayes.sampling import Identity, Proposal, SamplerSettings, StudentT, UnfinishedRun, run_adapted
from jointbayes.sampling import checkpoint as checkpoints
from tests.sampling.test_adapted import exact, filament, of_one_half

SETTINGS = SamplerSettings(walkers=8, max_steps=600, end_tolerance=1e-6)
OF_STAGES = SamplerSettings(walkers=24, max_steps=1500)
PARTS = {"seed": "4", "sampling.walkers": "8"}


class Killed(Exception):
    """In place of SIGKILL: nothing of the room catches it."""


@pytest.fixture(autouse=True)
def _every_block(monkeypatch):
    monkeypatch.setattr(checkpoints, "SECONDS_BETWEEN", 0.0)
    monkeypatch.setattr(checkpoints, "_TIMES_THE_COST", 0)


def gaussian(theta):
    return -0.5 * (theta**2).sum(axis=1)


@pytest.fixture(scope="module")
def begin():
    """A proposal and a start."""
    rng = np.random.default_rng(3)
    return Proposal(StudentT(np.zeros(2), np.eye(2), 5.0), 0.3, 0), rng.normal(size=(4, 8, 2))


def run(begin, keeper=None, density=gaussian, progress=None, settings=SETTINGS):
    proposal, start = begin
    rng = np.random.default_rng(4)
    return run_adapted(density, start, rng, settings, progress, systems=[Identity()], proposal=proposal, keeper=keeper)


@pytest.fixture(scope="module")
def undisturbed(begin):
    return run(begin)


def killed_after(steps):
    def progress(told):
        if told.steps >= steps:
            raise Killed

    return progress


def killed(begin, place, steps, **options):
    """Leave a run as a process that dies after so many steps does."""
    with pytest.raises(Killed):
        begun(begin, place, progress=killed_after(steps), **options)


def begun(begin, place, told=None, **options):
    with UnfinishedRun(place, tell=(told if told is not None else []).append) as keeper:
        keeper.begin(PARTS)
        return run(begin, keeper, **options)


def resumed(begin, place, told=None, **options):
    with UnfinishedRun(place, resume=True, tell=(told if told is not None else []).append) as keeper:
        keeper.begin(PARTS)
        return run(begin, keeper, **options)


def same(one, other):
    """Whether two results agree in all but the time they took."""
    (chains, proposal), (others, other_proposal) = one, other
    for part in dataclasses.fields(chains):
        if part.name in ("seconds", "history"):
            continue
        np.testing.assert_array_equal(getattr(chains, part.name), getattr(others, part.name))
    for check, other_check in zip(chains.history, others.history, strict=True):
        for part in dataclasses.fields(check):
            np.testing.assert_array_equal(getattr(check, part.name), getattr(other_check, part.name))
    assert proposal.efficiency == other_proposal.efficiency


@pytest.mark.parametrize("steps", [50, 300, 600])
def test_a_killed_run_goes_on_to_the_same_bits(begin, undisturbed, tmp_path, steps):
    killed(begin, tmp_path / "run", steps)
    same(resumed(begin, tmp_path / "run"), undisturbed)


@pytest.mark.science
def test_a_run_that_fits_its_proposal_anew_goes_on_to_the_same_bits(tmp_path):
    rng = np.random.default_rng(3)
    slow = of_one_half(rng), exact(4 * 24, rng).reshape(4, 24, 3)
    options = {"density": filament, "settings": OF_STAGES}
    chains, proposal = run(slow, **options)
    assert chains.discarded == 500
    assert chains.steps > 100
    killed(slow, tmp_path / "run", 500, **options)  # at the end of a stage
    with pytest.raises(Killed):  # after the first block of the next
        resumed(slow, tmp_path / "run", progress=killed_after(550), **options)
    same(resumed(slow, tmp_path / "run", **options), (chains, proposal))


def test_a_run_killed_again_and_again_comes_to_the_same_bits(begin, undisturbed, tmp_path):
    for steps in (100, 300, 500, 550):
        with pytest.raises(Killed):
            resumed(begin, tmp_path / "run", progress=killed_after(steps))
    same(resumed(begin, tmp_path / "run"), undisturbed)


def test_a_finished_run_is_read_without_a_step(begin, undisturbed, tmp_path):
    resumed(begin, tmp_path / "run")
    calls = []

    def counted(theta):
        calls.append(len(theta))
        return gaussian(theta)

    same(resumed(begin, tmp_path / "run", density=counted), undisturbed)
    assert sum(calls) == 2 * 4 * 8  # at the start and at the end


def flipped(path, place):
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(bytes(content))


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda run: flipped(run / "checkpoint", 40), "damaged"),
        (lambda run: (run / "checkpoint").write_bytes(b""), "damaged"),
        (lambda run: (run / "checkpoint").write_bytes((run / "checkpoint").read_bytes()[:-30]), "damaged"),
        (lambda run: flipped(run / "draws-0", -5), "damaged"),
        (lambda run: os.truncate(run / "draws-0", (run / "draws-0").stat().st_size - 8), "damaged"),
        (lambda run: (run / "checkpoint").unlink(), None),  # killed between two renames
        (lambda run: (run / "checkpoint.new").write_bytes(b"half a che"), None),  # killed while it was written
        (lambda run: os.truncate(run / "draws-0", (run / "draws-0").stat().st_size + 12), None),  # half appended
    ],
    ids=["a bit", "empty", "cut", "a bit of the draws", "draws cut", "renamed", "half written", "half appended"],
)
def test_what_a_crash_damages_costs_a_block_at_most(begin, undisturbed, tmp_path, damage, said):
    killed(begin, tmp_path / "run", 250)
    damage(tmp_path / "run")
    told = []
    same(resumed(begin, tmp_path / "run", told), undisturbed)
    assert [line for line in told if "damaged" in line] == told
    assert len(told) == (said is not None)


def test_two_damaged_checkpoints_are_refused(begin, tmp_path):
    killed(begin, tmp_path / "run", 150)
    flipped(tmp_path / "run" / "draws-0", 5)
    with pytest.raises(CheckpointError, match="found both checkpoints damaged; expected one that is whole; remove"):
        resumed(begin, tmp_path / "run")


def test_a_run_is_not_begun_where_another_one_is_unfinished(begin, tmp_path):
    killed(begin, tmp_path / "run", 50)
    before = {p.name: p.read_bytes() for p in (tmp_path / "run").iterdir() if p.name != "lock"}
    with pytest.raises(CheckpointError, match="found an unfinished run; expected none; to go on with it pass"):
        UnfinishedRun(tmp_path / "run").__enter__()
    assert {p.name: p.read_bytes() for p in (tmp_path / "run").iterdir() if p.name != "lock"} == before


def test_a_run_of_something_else_is_refused_by_the_part_that_differs(begin, tmp_path):
    killed(begin, tmp_path / "run", 50)
    with UnfinishedRun(tmp_path / "run", resume=True) as keeper, pytest.raises(CheckpointError) as refused:
        keeper.begin({"seed": "5", "sampling.walkers": "8", "prior.k11.low": "1.0"})
    words = "something else: seed: found 5, expected 4 as in the checkpoint; prior.k11.low: found 1.0, expected nothing"
    assert words in str(refused.value)
    assert "walkers" not in str(refused.value)


def test_draws_of_another_density_are_refused(begin, tmp_path):
    killed(begin, tmp_path / "run", 100)
    with pytest.raises(CheckpointError, match="found ln p = "):
        resumed(begin, tmp_path / "run", density=lambda theta: gaussian(theta) - 0.01 * theta[:, 0] ** 2)


def test_two_processes_never_work_on_one_run(tmp_path):
    with UnfinishedRun(tmp_path / "run"):
        with pytest.raises(CheckpointError, match=f"found another run at work on it .process {os.getpid()} on "):
            UnfinishedRun(tmp_path / "run", resume=True).__enter__()
        assert (tmp_path / "run").is_dir()
    assert not (tmp_path / "run").exists()


def test_what_was_never_saved_leaves_nothing(tmp_path):
    with UnfinishedRun(tmp_path / "some" / "run") as keeper:
        keeper.begin(PARTS)
    assert [p.name for p in tmp_path.iterdir()] == ["some"]
    assert not list((tmp_path / "some").iterdir())


def test_a_disk_that_is_full_costs_no_draws_and_says_so_once(begin, undisturbed, tmp_path, monkeypatch):
    def full(*_arguments):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    told = []
    same(begun(begin, tmp_path / "run", told), undisturbed)
    assert told == [f"{tmp_path / 'run'}: no checkpoint could be written (No space left on device); going on without"]


def test_a_disk_that_was_full_for_a_while_is_written_to_again(begin, undisturbed, tmp_path, monkeypatch):
    fsync, calls = os.fsync, []

    def full_for_a_while(descriptor):
        calls.append(descriptor)
        if 10 < len(calls) < 30:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", full_for_a_while)
    killed(begin, tmp_path / "run", 550)
    same(resumed(begin, tmp_path / "run"), undisturbed)


def written(place):
    return sum(path.stat().st_size for path in place.iterdir() if path.name.startswith("draws"))


def test_what_is_written_grows_as_the_draws_do(begin, tmp_path):
    sizes = []

    def look(told):
        sizes.append((written(tmp_path / "run"), (tmp_path / "run" / "checkpoint").stat().st_size))

    begun(begin, tmp_path / "run", progress=look)
    draws, checkpoint = np.transpose(sizes)
    block = 8 * 50 * 4 * 8 * (2 + 1)
    np.testing.assert_array_equal(np.diff(draws, prepend=0), block)  # each draw is written once
    assert np.diff(checkpoint).max() < 400  # one check more


def test_checkpoints_wait_until_they_cost_little(begin, tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoints, "SECONDS_BETWEEN", 3600.0)
    with UnfinishedRun(tmp_path / "run") as keeper:
        keeper.begin(PARTS)
        keeper.keep_estimate({"found": 1})
        with pytest.raises(Killed):
            run(begin, keeper, progress=killed_after(300))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_waits_for_the_block_and_the_checkpoint(begin, undisturbed, tmp_path, monkeypatch, number):
    class Stopped(KeyboardInterrupt):
        pass

    def stop(*_arguments):
        raise Stopped

    before, calls = signal.signal(number, stop), []

    def signalled(theta):
        calls.append(len(theta))
        if len(calls) == 900:
            signal.raise_signal(number)
        return gaussian(theta)

    monkeypatch.setattr(checkpoints, "SECONDS_BETWEEN", 3600.0)
    try:
        with pytest.raises(Stopped):
            begun(begin, tmp_path / "run", density=signalled)
        assert signal.getsignal(number) is stop
    finally:
        signal.signal(number, before)
    with UnfinishedRun(tmp_path / "run", resume=True) as keeper:
        keeper.begin(PARTS)
        assert keeper.steps % 50 == 0
        assert keeper.steps > 0
    same(resumed(begin, tmp_path / "run"), undisturbed)


def test_a_second_signal_does_not_wait(begin, tmp_path):
    calls = []

    def signalled(theta):
        calls.append(len(theta))
        if len(calls) in (900, 901):
            signal.raise_signal(signal.SIGINT)
        return gaussian(theta)

    with pytest.raises(KeyboardInterrupt):
        begun(begin, tmp_path / "run", density=signalled)
    assert len(calls) == 901
    assert UnfinishedRun(tmp_path / "run").holds_a_run
