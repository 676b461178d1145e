"""A long run holds evenly spaced steps, the same however it came so far, and its diagnostics are those of all."""

import tracemalloc

import numpy as np
import pytest

from jointbayes.sampling import SamplerSettings, run_ensembles
from jointbayes.sampling.chains import spacing
from jointbayes.sampling.moves import advance
from jointbayes.sampling.stopping import diagnose

NEVER = SamplerSettings(walkers=8, max_steps=480, check_every=10, tau_factor=1e9)


def gaussian(x):
    return -0.5 * (x**2).sum(axis=1)


class Counted:
    """A density that says where it had no finite value."""

    singular = 0

    def __call__(self, theta):
        self.singular += int((theta[:, 0] > 2).sum())
        return gaussian(theta)


def run(settings=NEVER, progress=None, density=gaussian):
    rng = np.random.default_rng(1)
    start = rng.normal(size=(settings.ensembles, settings.walkers, 2))
    return run_ensembles(density, start, rng, settings, progress)


@pytest.fixture(scope="module")
def whole():
    return run()


@pytest.fixture(scope="module")
def held_and_blocks():
    blocks = []

    def advanced(*arguments, **options):
        blocks.append(advance(*arguments, **options))
        return blocks[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("jointbayes.sampling.chains.MOST_HELD", 60)
        patch.setattr("jointbayes.sampling.moves.advance", advanced)
        return run(density=Counted()), blocks


@pytest.fixture(scope="module")
def held(held_and_blocks):
    return held_and_blocks[0]


def test_a_long_run_holds_every_so_many_steps_of_the_same_run(whole, held):
    assert (whole.every, held.every) == (1, 8)
    np.testing.assert_array_equal(held.theta, whole.theta[:, 7::8])
    np.testing.assert_array_equal(held.log_density, whole.log_density[:, 7::8])


def test_counts_are_those_of_all_blocks(whole, held_and_blocks):
    chains, blocks = held_and_blocks
    assert (chains.steps, chains.evaluations) == (480, whole.evaluations)
    assert chains.singular == sum(block.singular for block in blocks) > 0
    for ensemble, share in enumerate(chains.acceptance):
        accepted = sum(count.accepted for block in blocks[ensemble::4] for count in block.moves.values())
        assert share == accepted / (480 * 8)
    for name, share in chains.move_acceptance.items():
        counts = [block.moves[name] for block in blocks if name in block.moves]
        assert share == sum(n.accepted for n in counts) / sum(n.proposed for n in counts)
    assert len(chains.move_acceptance) == 3


def test_the_effective_size_of_what_is_held_is_no_larger_and_nearly_that_of_all(whole, held):
    # τ is about the distance of what is held: little is lost
    assert (held.tau >= held.every).all()
    assert (0.4 * whole.ess < held.ess).all()
    assert (held.ess < 1.3 * whole.ess).all()
    assert held.draws().theta.shape[1] == len(range(held.held_burn_in, held.theta.shape[1], max(1, held.thin // 8)))


def test_tau_of_every_so_many_steps_is_in_steps():
    rng = np.random.default_rng(2)
    steps = np.zeros((4, 20_000, 8, 1))
    for k in range(1, steps.shape[1]):  # τ = (1 + 0.98)/(1 - 0.98) = 99
        steps[:, k] = 0.98 * steps[:, k - 1] + rng.normal(size=steps[:, k].shape)
    every, thinned = diagnose(steps, None), diagnose(steps[:, 7::8], None, 8, 20_000)
    assert (thinned.step, thinned.burn_in) == (20_000, 10_000)
    assert thinned.tau == pytest.approx(every.tau, rel=0.05)


@pytest.mark.science
@pytest.mark.long
def test_what_is_held_does_not_grow_with_the_steps(monkeypatch):
    monkeypatch.setattr("jointbayes.sampling.chains.MOST_HELD", 200)
    memory = {}

    def look(progress):
        if progress.done in (1000, 3000):
            memory[progress.done] = tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        run(SamplerSettings(walkers=8, max_steps=3000, tau_factor=1e9), look)
    finally:
        tracemalloc.stop()
    one_step = 4 * 8 * (2 + 1) * 8
    assert memory[3000] - memory[1000] < 200 * one_step  # 2000 steps are ten times that


def test_no_more_than_so_many_steps_are_held_and_those_of_shorter_runs_all():
    for steps in (1, 25_000, 25_001, 50_000, 50_001, 10**6, 10**9):
        every = spacing(steps)
        assert steps // every <= 25_000
        assert every == 1 or steps > every // 2 * 25_000
