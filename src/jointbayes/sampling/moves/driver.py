"""emcee's loop over the steps, without what each of its steps copies in vain."""

from typing import Any

import emcee

__all__ = ["Driver"]


class Driver(emcee.EnsembleSampler):  # type: ignore[misc]  # emcee is not typed
    """emcee's sampler, whose state of random numbers is read at the end only.

    emcee copies the 624 words of the generator's state at every step. With vectorised moves that would be a fourth of
    the time of a step.
    """

    @property
    def random_state(self) -> None:
        """Nothing between the steps; see `final_random_state`."""
        return

    @random_state.setter
    def random_state(self, state: tuple[Any, ...]) -> None:
        self._random.set_state(state)

    @property
    def final_random_state(self) -> tuple[Any, ...]:
        """State of the Mersenne twister, as `RandomState.get_state` gives it."""
        return tuple(self._random.get_state())
