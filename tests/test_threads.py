"""The same draws whatever the number of BLAS threads, and the user's number back afterwards."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import scipy.linalg  # noqa: F401  (comes with a BLAS of its own)
from threadpoolctl import ThreadpoolController, threadpool_limits

import jointbayes as jb
from jointbayes.reproducibility import code_version, one_blas_thread
from jointbayes.studies.workers import attempt
from tests.case.refusal_rows import parts_named
from tests.conftest import CONFIGS

_HEAD, _DENSITY, _DRAWS, _TAIL = parts_named("threads").values()


def of_blas():
    return [one["num_threads"] for one in ThreadpoolController().info() if one["user_api"] == "blas"]


@pytest.mark.science
@pytest.mark.long  # `make same` is run with one and with two threads besides
@pytest.mark.parametrize("what", [_DENSITY, _DRAWS], ids=["data, density and short draws", "a long curved posterior"])
def test_what_is_computed_is_that_of_one_thread_with_any_number(what):
    outputs = set()
    for threads in ("1", "4"):
        run = subprocess.run(
            [sys.executable, "-c", _HEAD + what + _TAIL, str(CONFIGS / "clamped_beam_uncertain.toml")],
            env=os.environ | {"OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads},
            capture_output=True,
            text=True,
            check=True,
        )
        outputs.add(run.stdout)
    assert len(outputs) == 1


def test_is_one_inside_and_what_it_was_afterwards_also_after_an_error():
    with threadpool_limits(2, user_api="blas"):
        before = of_blas()
        with one_blas_thread():
            assert set(of_blas()) == {1}
            with one_blas_thread():
                assert set(of_blas()) == {1}
            assert set(of_blas()) == {1}
        with pytest.raises(ZeroDivisionError), one_blas_thread():
            1 / 0  # noqa: B018
        assert of_blas() == before


def test_threads_that_overlap_leave_the_number_as_it_was():
    @one_blas_thread()
    def multiply(size):
        np.ones((size, size)) @ np.ones((size, size))
        return set(of_blas())

    with threadpool_limits(2, user_api="blas"):
        before = of_blas()
        with ThreadPoolExecutor(4) as executor:
            assert all(found == {1} for found in executor.map(multiply, range(50, 90)))
        assert of_blas() == before


@pytest.mark.parametrize(("name", "first"), [
    ("find_map", "jointbayes.workflow._problem_and_case"), ("sample", "jointbayes.workflow._problem_and_case"),
    ("load_posterior", "jointbayes.posterior.stored_file.read_stored"),
])  # fmt: skip
def test_every_step_runs_on_one_thread(name, first, monkeypatch):
    def look(*_arguments, **_named):
        raise InterruptedError(str(set(of_blas())))

    step = getattr(jb, name)
    monkeypatch.setattr(first, look)
    with threadpool_limits(2, user_api="blas"), pytest.raises(InterruptedError, match=r"^\{1\}$"):
        step("any")


def test_tasks_of_studies_run_on_one_thread():
    with threadpool_limits(2, user_api="blas"):
        assert attempt(code_version(), of_blas) == ([1] * len(of_blas()), None)
