"""Random numbers as a function of where a run stands, so that nothing of a generator need be kept to go on with it."""

from dataclasses import dataclass, replace

import numpy as np

_STEPS, _REFIT = 0, 1


@dataclass(frozen=True, slots=True)
class Streams:
    """Seeds of everything that is drawn in a run: one for each stage, ensemble and block of steps.

    No two are alike, and each can be had without those before it: a block drawn by another process, or after the
    process that drew the block before has died, is the same.

    Parameters
    ----------
    entropy : int or tuple of int
        From the seed of the run.
    key : tuple of int
        What tells this run from others of the same seed.
    stage : int
        Stage of the run, counted from zero.

    Examples
    --------
    >>> one, other = (Streams.of(np.random.default_rng(1)) for _ in range(2))
    >>> one.block(2, 7).generate_state(1) == other.block(2, 7).generate_state(1)
    array([ True])
    """

    entropy: int | tuple[int, ...]
    key: tuple[int, ...]
    stage: int = 0

    @classmethod
    def of(cls, rng: np.random.Generator) -> "Streams":
        """Streams of the next child of a generator, which itself is not drawn from."""
        (child,) = rng.spawn(1)
        seed = child.bit_generator.seed_seq
        assert isinstance(seed, np.random.SeedSequence)
        assert seed.entropy is not None
        entropy = seed.entropy if isinstance(seed.entropy, int) else tuple(int(word) for word in seed.entropy)
        return cls(entropy, seed.spawn_key)

    def of_stage(self, stage: int) -> "Streams":
        """Streams of another stage."""
        return replace(self, stage=stage)

    def block(self, ensemble: int, block: int) -> np.random.SeedSequence:
        """Seed of one block of steps of one ensemble, both counted from zero."""
        return self._seed(_STEPS, self.stage, ensemble, block)

    def refit(self) -> np.random.Generator:
        """Generator for the fit of a proposal to the draws of this stage."""
        return np.random.default_rng(self._seed(_REFIT, self.stage))

    def _seed(self, *place: int) -> np.random.SeedSequence:
        return np.random.SeedSequence(self.entropy, spawn_key=(*self.key, *place))
