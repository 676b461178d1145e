"""Several processes on every shipped case: the same draws bit for bit as one process."""

import dataclasses

import pytest

from jointbayes import load_case
from jointbayes.workflow import sample
from tests.conftest import CONFIGS, FEW_STEPS

pytestmark = pytest.mark.science


@pytest.mark.parametrize("config", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_two_processes_give_the_same_bits_as_one(config):
    case = load_case(config)
    walkers = max(FEW_STEPS.walkers, 2 * len(case.problem.prior.names))
    settings = dataclasses.replace(FEW_STEPS, walkers=walkers)
    one = sample(case, seed=1, settings=settings)
    two = sample(case, seed=1, settings=dataclasses.replace(settings, processes=2))
    assert one.theta.tobytes() == two.theta.tobytes()
    assert one.log_density.tobytes() == two.log_density.tobytes()
