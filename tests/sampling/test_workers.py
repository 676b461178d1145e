"""Ensembles in several processes: the same draws, the same errors, and nobody left behind."""

import dataclasses
import multiprocessing
import os
import pickle
import subprocess
import sys
from functools import partial

import numpy as np
import pytest

from jointbayes import case_from_text, load_case
from jointbayes.errors import SamplingError
from jointbayes.joint import ComplianceCoordinates, LogStiffness
from jointbayes.posterior.coordinates import coordinate_systems
from jointbayes.sampling import SamplerSettings, fit_proposal, run_ensembles
from jointbayes.workflow import sample
from tests.conftest import CONFIGS
from tests.sampling.worker_densities import GaussianInCompliance, failing, gaussian, leaving

ONE = SamplerSettings(walkers=8, max_steps=40, check_every=20)
TWO = dataclasses.replace(ONE, processes=2)


@pytest.fixture
def loaded_once(monkeypatch):
    """Processes that a server forks which has imported what they need: a tenth of the price of new ones."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["jointbayes.sampling.workers", "tests.sampling.worker_densities"])
    monkeypatch.setattr("jointbayes.sampling.workers.get_context", lambda _: context)


def run(log_density, settings):
    start = np.random.default_rng(0).normal(size=(4, 8, 2))
    return run_ensembles(log_density, start, np.random.default_rng(1), settings)


def test_two_processes_give_the_same_bits_as_one(loaded_once):
    density = GaussianInCompliance(LogStiffness(), 0.03)
    proposal = fit_proposal(
        density, [density.coordinates], [(density.theta, density.covariance)], np.random.default_rng(2)
    )
    start = np.random.default_rng(3).multivariate_normal(density.theta, density.covariance / 4, size=(4, 8))
    one, two = (
        run_ensembles(
            density, start, np.random.default_rng(1), settings, coordinates=density.coordinates, proposal=proposal
        )
        for settings in (ONE, TWO)
    )
    assert isinstance(density.coordinates, ComplianceCoordinates)
    assert one.theta.tobytes() == two.theta.tobytes()
    assert one.log_density.tobytes() == two.log_density.tobytes()
    assert one.tau.tobytes() == two.tau.tobytes()
    assert one.move_acceptance == two.move_acceptance
    assert one.evaluations == two.evaluations
    assert multiprocessing.active_children() == []


#: One of each kind of structure, data and noise.
KINDS = ("clamped_beam", "clamped_beam_frequencies", "clamped_beam_uncertain", "measured_rotation", "portal_frame",
         "spindle_measured", "two_storeys_shape")  # fmt: skip


@pytest.mark.parametrize("name", KINDS)
def test_the_density_of_a_case_can_be_sent_to_another_process(name):
    problem = load_case(CONFIGS / f"{name}.toml").problem
    theta = problem.prior.sample(np.random.default_rng(4), 40)
    sent, _ = pickle.loads(pickle.dumps((problem.log_posterior, coordinate_systems(problem))))
    assert np.isfinite(sent(theta)).any()
    assert sent(theta).tobytes() == problem.log_posterior(theta).tobytes()


@pytest.mark.whole
def test_two_processes_sample_a_real_case_to_the_same_bits_and_its_posterior_can_be_pickled(cheap_case):
    one, two = (sample(cheap_case, seed=1, settings=settings) for settings in (ONE, TWO))
    assert one.theta.tobytes() == two.theta.tobytes()
    assert one.log_density.tobytes() == two.log_density.tobytes()
    again = pickle.loads(pickle.dumps(two))
    assert again.theta.tobytes() == two.theta.tobytes()
    assert again.problem.log_posterior(again.mode_theta) == two.problem.log_posterior(two.mode_theta)


ERRORS = pytest.mark.parametrize(
    "error", [SamplingError("here: found a; expected b; do c"), KeyboardInterrupt()], ids=["error", "interrupt"]
)


def raised(error):
    with pytest.raises(type(error)) as caught:
        run(partial(failing, error, os.getpid()), TWO)
    assert str(caught.value) == str(error)
    assert multiprocessing.active_children() == []


@ERRORS
def test_an_error_in_a_worker_reaches_the_caller_and_ends_all_processes(error, loaded_once):
    raised(error)


@pytest.mark.whole
@ERRORS
def test_a_new_process_that_fails_prints_nothing(error, capfd):
    raised(error)
    assert capfd.readouterr() == ("", "")


def test_a_process_that_ends_by_itself_is_one_line(loaded_once):
    with pytest.raises(SamplingError, match=r"^sampler setting processes: found .*; expected .*; ") as caught:
        run(partial(leaving, os.getpid()), TWO)
    assert "\n" not in str(caught.value)
    assert multiprocessing.active_children() == []


def test_a_log_density_that_cannot_be_sent_is_refused_in_one_line():
    with pytest.raises(SamplingError, match="expected one that can be pickled") as caught:
        run(lambda theta: gaussian(theta), TWO)
    assert "\n" not in str(caught.value)


def test_the_case_file_sets_the_number_of_processes():
    text = (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8")
    assert "\n[sampling]" in text
    case = case_from_text("two processes", text.replace("\n[sampling]", "\n[sampling]\nprocesses = 2\n#"))
    assert case.sampler.processes == 2


def test_one_process_starts_no_other(monkeypatch):
    monkeypatch.setattr("jointbayes.sampling.workers.ProcessPoolExecutor", None)
    run(gaussian, ONE)


@pytest.mark.whole
def test_ctrl_c_ends_the_run_and_its_processes(tmp_path):
    # a terminal sends the interrupt to the whole group of processes
    script = tmp_path / "long_run.py"
    script.write_text(
        "import sys, numpy as np\n"
        "from jointbayes.sampling import SamplerSettings, run_ensembles\n"
        "def gaussian(theta):\n"
        "    return -0.5 * np.sum(theta**2, axis=1)\n"
        "def started(progress):\n"
        "    print('running', flush=True)\n"
        "if __name__ == '__main__':\n"
        "    start = np.random.default_rng(0).normal(size=(4, 8, 2))\n"
        "    settings = SamplerSettings(walkers=8, max_steps=10**6, tau_factor=1e6, processes=2)\n"
        "    try:\n"
        "        run_ensembles(gaussian, start, np.random.default_rng(1), settings, started)\n"
        "    except KeyboardInterrupt:\n"
        "        import multiprocessing\n"
        "        print('stopped', len(multiprocessing.active_children()))\n",
        encoding="utf-8",
    )
    process = subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "running\n"
    os.killpg(process.pid, 2)
    out, err = process.communicate(timeout=60)
    assert out.splitlines()[-1] == "stopped 0"
    assert err == ""
