"""Compiles the hot loops before the tests, once: two processes that need them at the same time would both compile them.

`python -m tests.compile_loops`: a second when they are kept.
"""

import numpy as np

import jointbayes as jb
from tests.conftest import CONFIGS

#: Among them one of each kind: modal sum, one joint, many joints.
CASES = ("clamped_beam", "clamped_beam_loss_factor", "portal_frame", "rotor_dampers")


def main() -> None:
    """Evaluate density, prediction and start of the search of each."""
    for name in CASES:
        posterior = jb.load_case(CONFIGS / f"{name}.toml").problem.log_posterior
        draws = posterior.prior.sample(np.random.default_rng(1), 64)
        posterior.predicted(draws[np.argmax(posterior(draws))][None])


if __name__ == "__main__":
    main()
