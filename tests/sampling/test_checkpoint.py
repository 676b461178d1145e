"""Runs that go on from a checkpoint: the same bits as if never interrupted, whatever was damaged on the way."""

import dataclasses
import errno
import json
import os
import signal
import stat
from functools import partial

import numpy as np
import pytest

from jointbayes.errors import CheckpointError, WriteError
from jointbayes.sampling import Proposal, SamplerSettings, StudentT, UnfinishedRun, run_adapted, sampler
from jointbayes.sampling import checkpoint as checkpoints
from jointbayes.sampling.coordinate_maps import Identity
from tests.sampling.test_adapted import exact, filament, of_one_half
from vibrecords.files import OwnDirectory

SETTINGS = SamplerSettings(walkers=8, max_steps=120, check_every=10, end_tolerance=1e-6)
SHORT = SamplerSettings(walkers=8, max_steps=60, check_every=10, end_tolerance=1e-6)
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


@pytest.fixture(scope="module")
def short(begin):
    return run(begin, settings=SHORT)


def killed_after(steps):
    def progress(told):
        if told.done >= steps:
            raise Killed

    return progress


def killed(begin, place, steps, **options):
    """Leave a run as a process that dies after so many steps does."""
    with pytest.raises(Killed):
        begun(begin, place, progress=killed_after(steps), **options)


def killed_again(begin, place, *moments, **options):
    """Resume a run, and kill it, at each of these moments."""
    for steps in moments:
        killed(begin, place, steps, resume=True, **options)


def begun(begin, place, told=None, *, resume=False, **options):
    with UnfinishedRun(place, resume=resume, progress=(told if told is not None else []).append) as keeper:
        keeper.begin(PARTS)
        return run(begin, keeper, **options)


resumed = partial(begun, resume=True)


def same(one, other):
    """Whether two results agree in all but the time they took."""
    (chains, proposal), (others, other_proposal) = one, other
    for here, there in zip((chains, *chains.history), (others, *others.history), strict=True):
        for name in {part.name for part in dataclasses.fields(here)} - {"seconds", "history"}:
            np.testing.assert_array_equal(getattr(here, name), getattr(there, name))
    assert proposal.efficiency == other_proposal.efficiency


def test_a_run_of_several_stages_goes_on_to_the_same_bits(tmp_path, monkeypatch):
    def about_the_draws(_density, _systems, _proposal, draws, rng):
        return Proposal(StudentT(draws.mean(axis=0) + 1e-3 * rng.normal(size=3), np.cov(draws.T), 5.0), 0.4, 0)

    monkeypatch.setattr(sampler, "refit_proposal", about_the_draws)  # a mixture is dear to fit
    monkeypatch.setattr(sampler, "_EXPLORING", (20, 20, 20, 20))
    monkeypatch.setattr(sampler, "_STAGES", (30,))
    rng = np.random.default_rng(3)
    slow = Proposal(StudentT(np.zeros(3), 0.01 * np.eye(3), 5.0), 0.4, 0), exact(4 * 8, rng).reshape(4, 8, 3)
    options = {"density": filament, "settings": SETTINGS}
    chains, proposal = run(slow, **options)
    assert chains.discarded >= 80
    killed(slow, tmp_path / "run", 80, **options)  # at the end of a stage
    killed_again(slow, tmp_path / "run", 90, **options)  # after the first block of the next
    same(resumed(slow, tmp_path / "run", **options), (chains, proposal))


@pytest.mark.science
@pytest.mark.long
def test_a_run_that_fits_its_proposal_anew_goes_on_to_the_same_bits(tmp_path):
    rng = np.random.default_rng(3)
    slow = of_one_half(rng), exact(4 * 24, rng).reshape(4, 24, 3)
    options = {"density": filament, "settings": OF_STAGES}
    chains, proposal = run(slow, **options)
    assert chains.discarded == 800  # four stages in search of what the first proposal misses
    assert chains.steps > 100
    killed(slow, tmp_path / "run", 800, **options)  # at the end of a stage
    killed_again(slow, tmp_path / "run", 550, **options)  # after the first block of the next
    same(resumed(slow, tmp_path / "run", **options), (chains, proposal))


def test_a_run_killed_again_and_again_comes_to_the_same_bits(begin, undisturbed, tmp_path):
    killed_again(begin, tmp_path / "run", 20, 60, 100, 110)
    same(resumed(begin, tmp_path / "run"), undisturbed)


def counted(calls, at=(), number=signal.SIGINT):
    """A density that keeps the sizes of its calls, and sends this process a signal at some of them."""

    def density(theta):
        calls.append(len(theta))
        if len(calls) in at:
            signal.raise_signal(number)
        return gaussian(theta)

    return density


def test_a_finished_run_is_read_without_a_step(begin, undisturbed, tmp_path):
    resumed(begin, tmp_path / "run")
    calls = []
    same(resumed(begin, tmp_path / "run", density=counted(calls)), undisturbed)
    assert sum(calls) == 4 * 8  # whether it is the same density


def flipped(content, place, bit=0):
    return content[:place] + bytes([content[place] ^ 1 << bit]) + content[place + 1 :]


RUN_FILE = "a damaged run.npz; its steps are made again"


@pytest.mark.parametrize(
    ("damage", "found"),
    [
        (lambda file: file.write_bytes(flipped(file.read_bytes(), 4000)), RUN_FILE),
        (lambda file: os.truncate(file, 4000), RUN_FILE),
        (lambda file: file.write_bytes(b""), RUN_FILE),
        (lambda file: rewritten(file, lambda record: record["stages"]["0"].pop("checks")), RUN_FILE),
        (lambda file: file.unlink(), "no unfinished run; beginning one"),
    ],
    ids=["a bit", "cut", "empty", "another record", "gone"],
)
def test_a_run_whose_file_is_damaged_is_made_again(begin, undisturbed, tmp_path, damage, found):
    killed(begin, tmp_path / "run", 50)
    damage(tmp_path / "run" / "run.npz")
    for expected in ([f"{tmp_path / 'run'}: found {found}"], []):  # what was made again is on disk
        told = []
        same(resumed(begin, tmp_path / "run", told), undisturbed)
        assert [now.text[: len(expected[0])] for now in told] == expected


@pytest.mark.whole
def test_any_flipped_bit_of_the_file_is_survived(begin, short, tmp_path):
    killed(begin, tmp_path / "run", 50, settings=SHORT)
    whole, rng = (tmp_path / "run" / "run.npz").read_bytes(), np.random.default_rng(5)
    for place in [*rng.integers(len(whole), size=4), *range(len(whole) - 300, len(whole), 47)]:  # at the end the names
        (tmp_path / "run" / "run.npz").write_bytes(flipped(whole, place, int(rng.integers(8))))
        same(resumed(begin, tmp_path / "run", settings=SHORT), short)


def rewritten(path, change):
    """Write the file of a run anew with another record and the right check sums."""
    with np.load(path) as archive:
        arrays = dict(archive)
    record = json.loads(str(arrays.pop("record")))
    change(record)
    np.savez(path, record=np.array(json.dumps(record)), **arrays)


@pytest.mark.parametrize("version", [3, 99])
def test_a_checkpoint_of_another_version_is_refused(begin, tmp_path, version):
    killed(begin, tmp_path / "run", 30)
    rewritten(tmp_path / "run" / "run.npz", lambda record: record.update(version=version))
    with pytest.raises(CheckpointError, match=f"found checkpoint version {version}; expected version 4; remove that"):
        resumed(begin, tmp_path / "run")


def test_a_long_run_of_which_not_all_steps_are_held_goes_on_to_the_same_bits(begin, tmp_path, monkeypatch):
    monkeypatch.setattr("jointbayes.sampling.chains.MOST_HELD", 20)
    monkeypatch.setattr("jointbayes.sampling.chains._AT_ONCE", 3)
    undisturbed = run(begin)
    assert undisturbed[0].every == 8
    killed_again(begin, tmp_path / "run", 20, 30, 50, 90)
    same(resumed(begin, tmp_path / "run"), undisturbed)


# ---- directories and files that are not ours


def test_a_directory_of_somebody_else_is_refused_and_stays(begin, tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis").write_text("mine", encoding="utf-8")
    monkeypatch.chdir(tmp_path / "mine")
    for place in (tmp_path / "mine", "."):
        with pytest.raises(CheckpointError, match="found a directory that holds other files, and no mark of joint"):
            begun(begin, place)
        with pytest.raises(CheckpointError, match="remove it if an older jointbayes left it"):
            resumed(begin, place)
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["thesis"]


def test_a_directory_of_another_kind_is_refused(begin, tmp_path):
    with OwnDirectory(tmp_path / "run", "a campaign"):
        pass
    with pytest.raises(CheckpointError, match="found a directory of a campaign; expected a new directory, or one of"):
        begun(begin, tmp_path / "run")


def test_files_that_somebody_puts_into_the_directory_stay(begin, tmp_path):
    with UnfinishedRun(tmp_path / "run") as keeper:
        keeper.begin(PARTS)
        run(begin, keeper)
        (tmp_path / "run" / "stage-0.npz").write_text("mine", encoding="utf-8")
        (tmp_path / "run" / "folder").mkdir()
        keeper.discard()
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == [".jointbayes", "folder", "stage-0.npz"]


def test_the_directory_is_nobody_elses_to_look_into(tmp_path):
    with UnfinishedRun(tmp_path / "run"):
        assert stat.S_IMODE((tmp_path / "run").stat().st_mode) == 0o700


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *(("run.npz", kind) for kind in ("link", "dangling link", "second name", "directory", "pipe")),
        *((name, "link") for name in ("lock", ".jointbayes")),
    ],
)
def test_nothing_is_written_through_what_has_the_name_of_one_of_its_files(begin, tmp_path, name, kind):
    killed(begin, tmp_path / "run", 20, settings=SHORT)
    victim, place = tmp_path / "victim", tmp_path / "run" / name
    victim.write_text("mine", encoding="utf-8")
    place.unlink(missing_ok=True)
    made = {"second name": partial(os.link, victim), "directory": os.mkdir, "pipe": os.mkfifo}
    made |= {"link": partial(os.symlink, victim), "dangling link": partial(os.symlink, tmp_path / "new")}
    made[kind](place)
    with pytest.raises((CheckpointError, WriteError), match="expected"):
        resumed(begin, tmp_path / "run", settings=SHORT)
    assert victim.read_text(encoding="utf-8") == "mine"
    assert not (tmp_path / "new").exists()


def test_a_run_is_not_begun_where_another_one_is_unfinished(begin, tmp_path):
    def files():
        return {p.name: p.read_bytes() for p in (tmp_path / "run").iterdir() if p.name != "lock"}

    killed(begin, tmp_path / "run", 20)
    before = files()
    with pytest.raises(CheckpointError, match="found an unfinished run; expected none; to go on with it pass"):
        UnfinishedRun(tmp_path / "run").__enter__()
    assert files() == before


def test_a_run_of_something_else_is_refused_by_the_part_that_differs(begin, tmp_path):
    killed(begin, tmp_path / "run", 20)
    with UnfinishedRun(tmp_path / "run", resume=True) as keeper, pytest.raises(CheckpointError) as refused:
        keeper.begin({"seed": "5", "sampling.walkers": "8", "prior.k11.low": "1.0"})
    words = "something else: seed: found 5, expected 4 as in the checkpoint; prior.k11.low: found 1.0, expected nothing"
    assert words in str(refused.value)
    assert "walkers" not in str(refused.value)


def test_draws_of_another_density_are_refused(begin, tmp_path):
    killed(begin, tmp_path / "run", 20)
    with pytest.raises(CheckpointError, match="found ln p = "):
        resumed(begin, tmp_path / "run", density=lambda theta: gaussian(theta) - 0.01 * theta[:, 0] ** 2)


def test_what_was_never_saved_leaves_nothing(tmp_path):
    with UnfinishedRun(tmp_path / "some" / "run") as keeper:
        keeper.begin(PARTS)
    assert [p.name for p in tmp_path.iterdir()] == ["some"]
    assert not list((tmp_path / "some").iterdir())


def full(*_arguments):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_disk_that_is_full_costs_no_draws_and_says_so_once(begin, undisturbed, tmp_path, monkeypatch):
    told = []
    with UnfinishedRun(tmp_path / "run", progress=told.append) as keeper:
        monkeypatch.setattr(os, "fsync", full)
        keeper.begin(PARTS)
        same(run(begin, keeper), undisturbed)
    words = "no checkpoint could be written (No space left on device); going on without"
    assert [now.text for now in told] == [f"{tmp_path / 'run'}: {words}"]


def test_a_second_name_that_appears_during_a_run_keeps_what_it_named(begin, undisturbed, tmp_path):
    """A backup by hard links gives a file of the checkpoint a second name."""
    copied = []

    def progress(told):
        if told.done == 60:
            os.link(tmp_path / "run" / "run.npz", tmp_path / "copy")
            copied.append((tmp_path / "copy").read_bytes())

    told = []
    same(begun(begin, tmp_path / "run", told, progress=progress), undisturbed)
    assert told == []
    assert [(tmp_path / "copy").read_bytes()] == copied


def test_a_disk_that_was_full_for_a_while_is_written_to_again(begin, undisturbed, tmp_path, monkeypatch):
    fsync, calls = os.fsync, []

    def full_for_a_while(descriptor):
        calls.append(descriptor)
        (full if 10 < len(calls) < 30 else fsync)(descriptor)

    monkeypatch.setattr(os, "fsync", full_for_a_while)
    killed(begin, tmp_path / "run", 110)
    same(resumed(begin, tmp_path / "run"), undisturbed)


def test_checkpoints_wait_until_they_cost_little(begin, tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoints, "SECONDS_BETWEEN", 3600.0)
    with UnfinishedRun(tmp_path / "run") as keeper:
        keeper.begin(PARTS)
        keeper.keep_estimate({"found": 1})
        with pytest.raises(Killed):
            run(begin, keeper, progress=killed_after(60))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_waits_for_the_block_and_the_checkpoint(begin, undisturbed, tmp_path, monkeypatch, number):
    def stop(*_arguments):
        raise KeyboardInterrupt("stopped")

    before = signal.signal(number, stop)
    monkeypatch.setattr(checkpoints, "SECONDS_BETWEEN", 3600.0)
    try:
        with pytest.raises(KeyboardInterrupt, match="stopped"):
            begun(begin, tmp_path / "run", density=counted([], (180,), number))
        assert signal.getsignal(number) is stop
    finally:
        signal.signal(number, before)
    with UnfinishedRun(tmp_path / "run", resume=True) as keeper:
        keeper.begin(PARTS)
        assert keeper.steps % 10 == 0
        assert keeper.steps > 0
    same(resumed(begin, tmp_path / "run"), undisturbed)


def test_a_second_signal_does_not_wait(begin, tmp_path):
    calls = []
    with pytest.raises(KeyboardInterrupt):
        begun(begin, tmp_path / "run", density=counted(calls, (180, 181)))
    assert len(calls) == 181
    with UnfinishedRun(tmp_path / "run", resume=True) as keeper:
        assert keeper.holds_a_run
