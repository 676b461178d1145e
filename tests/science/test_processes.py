"""Several processes on shipped cases of each sort of density: the same draws bit for bit as one process.

That the density of every shipped case can be sent to a process is tested in tests/sampling/test_workers.py.
"""

import dataclasses

import pytest

from jointbayes import load_case
from jointbayes.workflow import sample
from tests.conftest import CONFIGS, FEW_STEPS, first_in_ci

pytestmark = pytest.mark.science


@pytest.mark.parametrize(
    "name",
    first_in_ci(["two_storeys_shape", "clamped_beam", "clamped_beam_frequencies", "clamped_beam_loss_factor",
                 "spindle_measured", "two_overhangs"], 1),
)  # fmt: skip
def test_two_processes_give_the_same_bits_as_one(name):
    case = load_case(CONFIGS / f"{name}.toml")
    walkers = max(FEW_STEPS.walkers, 2 * len(case.problem.prior.names))
    settings = dataclasses.replace(FEW_STEPS, walkers=walkers)
    one = sample(case, seed=1, settings=settings)
    two = sample(case, seed=1, settings=dataclasses.replace(settings, processes=2))
    assert one.theta.tobytes() == two.theta.tobytes()
    assert one.log_density.tobytes() == two.log_density.tobytes()
