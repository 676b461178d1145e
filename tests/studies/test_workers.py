import itertools
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import forkserver
from pathlib import Path

import pytest

import jointbayes as jb
from jointbayes.errors import WorkerError
from jointbayes.reproducibility import code_version
from jointbayes.studies.workers import attempt, run_tasks
from tests.case.refusal_rows import parts_named
from tests.one_line import refused
from tests.studies import task_functions


def numbered(count, *arguments):
    return ((f"task {i}", (i, *arguments)) for i in range(count))


def by_key(outcomes):
    outcomes = list(outcomes)
    found = {outcome.key: outcome for outcome in outcomes}
    assert len(found) == len(outcomes), "a task has two outcomes"
    return found


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed", reason="install jointbayes[cluster] for the tests on Dask")
    import dask

    # on a busy machine a worker that was killed takes longer to come back than the 15 s after which it is given up
    with (
        dask.config.set({"distributed.deploy.lost-worker-timeout": "10 minutes"}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
        ) as cluster,
    ):
        yield cluster


def test_each_task_has_one_outcome_with_its_value():
    found = by_key(run_tasks(task_functions.square, numbered(20), workers=2))
    assert [found[f"task {i}"].value for i in range(20)] == [i**2 for i in range(20)]
    assert {(o.error, o.attempts, o.killed_worker) for o in found.values()} == {(None, 1, False)}


def test_tasks_are_taken_only_as_workers_come_free():
    taken = 0

    def tasks():
        nonlocal taken
        for i in itertools.count():
            taken += 1
            yield f"task {i}", (i,)

    for number, _ in enumerate(run_tasks(task_functions.square, tasks(), workers=2), 1):
        assert taken <= number + 4
        if number == 30:
            break


def test_task_whose_worker_dies_is_done_again_and_one_that_kills_three_is_set_aside_by_name(tmp_path):
    found = by_key(run_tasks(task_functions.kill_some, numbered(12, str(tmp_path), (3, 7), (5,)), workers=2))
    assert (len(found), {key for key, o in found.items() if o.killed_worker}) == (12, {"task 5"})
    assert found["task 5"].error == "its worker ended by SIGKILL"
    assert found["task 5"].value is None
    assert {key: o.attempts for key, o in found.items() if o.attempts > 1} == {"task 3": 2, "task 5": 3, "task 7": 2}
    assert all(found[f"task {i}"].value == i**2 for i in range(12) if i != 5)
    assert len(list(tmp_path.iterdir())) == 16  # attempts in all: none was done twice without need


def test_task_that_raises_has_its_error_in_words():
    found = by_key(run_tasks(task_functions.fail_some, numbered(4, (3,)), workers=2))
    assert found["task 3"].error == "task 3: found a wrong number; expected another; change it"
    assert found["task 1"].error.startswith("ZeroDivisionError: division by zero (in fail_some, task_functions.py:")
    assert {o.attempts for o in found.values()} == {1}
    assert not any(o.killed_worker for o in found.values())


def test_value_that_cannot_be_sent_and_exit_are_errors_of_the_task():
    (found,) = run_tasks(task_functions.unsendable, numbered(1), workers=1)
    assert "cannot be sent between processes" in found.error
    (found,) = run_tasks(task_functions.leave, numbered(1), workers=1)
    assert found.error.startswith("SystemExit: 3")
    assert not found.killed_worker


def test_first_task_runs_alone_and_then_as_many_as_there_are_workers():
    seen = []
    for _ in run_tasks(task_functions.slow_square, numbered(5, 0.7), workers=2, watch=seen.append):
        pass
    together = [set(keys) for keys in seen if keys]
    assert {"task 0"} in together
    assert not any(len(keys) > 1 for keys in together if "task 0" in keys)
    assert max(len(keys) for keys in together) == 2


@pytest.mark.science
def test_a_server_of_workers_that_runs_gets_the_modules_that_are_wanted():
    list(run_tasks(task_functions.square, numbered(1), workers=1))
    (found,) = run_tasks(task_functions.has_module, [("a", ("colorsys",))], workers=1, preload=["colorsys"])
    assert found.value


@pytest.mark.whole
def test_workers_have_one_thread_and_leave_ctrl_c_to_the_driver():
    forkserver._forkserver._stop()  # one that another test has begun has the environment of then
    found = [o.value for o in run_tasks(task_functions.settings_of_worker, numbered(6), workers=2)]
    assert {(tuple(threads), ignores) for _, threads, ignores in found} == {(("1", "1", "1"), True)}
    assert os.getpid() not in {pid for pid, _, _ in found}
    assert "NUMBA_NUM_THREADS" not in os.environ


def test_leaving_the_loop_ends_the_workers():
    outcomes = run_tasks(task_functions.hang_some, numbered(9, (2, 3)), workers=2)
    next(outcomes)
    assert multiprocessing.active_children()
    outcomes.close()
    for worker in multiprocessing.active_children():  # they were told to end: on a busy machine that takes a moment
        worker.join(10)
    assert not multiprocessing.active_children()


SCRIPT, LOST = parts_named("workers").values()


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_workers_end_with_their_driver_however_it_ends_and_remove_what_is_half_written(tmp_path, number):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(directory=str(tmp_path)))
    with subprocess.Popen(
        [sys.executable, script], stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    ) as driver:  # fmt: skip
        until = time.monotonic() + 60
        while not (marks := list(tmp_path.glob("pid-*"))) and time.monotonic() < until:
            time.sleep(0.05)
        driver.send_signal(number)
        driver.wait(30)
    (worker,) = (int(mark.name.split("-")[2]) for mark in marks)
    while time.monotonic() < until and (alive(worker) or list(tmp_path.glob(".half-*"))):
        time.sleep(0.05)
    assert not alive(worker)
    assert not list(tmp_path.glob(".half-*"))


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_script_without_a_guard_is_told_to_have_one(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(directory=str(tmp_path)).replace('if __name__ == "__main__":', "if True:"))
    ended = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, timeout=60, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert "WorkerError: workers: found that a process ended before it was ready" in ended.stderr


@pytest.mark.parametrize(("settings", "message"), [
    ({"workers": 0}, "workers = 0"),
    ({"executor": ThreadPoolExecutor, "scheduler": "tcp://127.0.0.1:1"}, "executor with scheduler"),
    ({"scheduler": "tcp://127.0.0.1:1"}, "scheduler: found none at tcp://127.0.0.1:1"),
])  # fmt: skip
def test_settings_that_cannot_work_are_refused(settings, message, monkeypatch):
    monkeypatch.setattr("jointbayes.studies.workers._CONNECT", 1.0)
    refused(lambda: list(run_tasks(task_functions.square, numbered(3), **settings)), WorkerError, message)


def test_function_that_cannot_be_sent_is_an_error_of_the_task():
    (found,) = run_tasks(lambda i: i, numbered(1), workers=1)
    assert "cannot be sent between processes" in found.error


def test_any_executor_does_the_tasks():
    with ThreadPoolExecutor(2) as executor:
        found = by_key(run_tasks(task_functions.fail_some, numbered(9, (3,)), executor=executor))
        assert executor.submit(task_functions.square, 3).result() == 9  # it stays open
    assert [i for i in range(9) if found[f"task {i}"].error is None] == [0, 2, 4, 5, 6, 7, 8]


def test_executor_that_breaks_ends_the_loop_in_a_line(tmp_path):
    with ProcessPoolExecutor(2, multiprocessing.get_context("forkserver")) as executor:
        list(executor.map(time.sleep, [0.2, 0.2]))  # one that is started as it breaks would never end
        with pytest.raises(WorkerError, match="executor: found that it has gone, or lost a worker"):
            list(run_tasks(task_functions.kill_some, numbered(8, str(tmp_path), (), (3,)), executor=executor))


def test_what_is_done_is_handed_out_before_an_executor_that_breaks_is_reported():
    class Breaks(ThreadPoolExecutor):
        def submit(self, *call):
            if self._threads:
                raise BrokenExecutor
            return super().submit(*call)

    with Breaks(1) as executor:
        outcomes = run_tasks(task_functions.square, numbered(3), executor=executor)
        assert next(outcomes).key == "task 0"
        refused(lambda: next(outcomes), WorkerError, r"executor: found that it has gone.*\(BrokenExecutor\)")


@pytest.mark.whole
def test_dask_cluster_loses_no_task_and_names_the_one_that_kills(cluster, tmp_path):
    tasks = numbered(10, str(tmp_path), (3,), (6,))
    found = by_key(run_tasks(task_functions.kill_some, tasks, scheduler=cluster.scheduler_address))
    assert {key for key, o in found.items() if o.killed_worker} == {"task 6"}
    assert "more often than the scheduler allows" in found["task 6"].error
    assert all(found[f"task {i}"].value == i**2 for i in range(10) if i != 6)


@pytest.mark.whole
def test_worker_of_another_version_ends_the_loop_in_a_line(cluster, monkeypatch):
    monkeypatch.setattr("jointbayes.studies.workers.code_version", lambda: "0.1.0+other")
    with pytest.raises(WorkerError, match=r"found jointbayes [\d.]+\+[0-9a-f]{12}; expected 0\.1\.0\+other"):
        list(run_tasks(task_functions.square, numbered(4), scheduler=cluster.scheduler_address))


@pytest.mark.science
def test_a_scheduler_that_is_lost_ends_in_one_line_and_nothing_else_on_the_terminal(tmp_path):
    pytest.importorskip("distributed", reason="install jointbayes[cluster] for the tests on Dask")
    (tmp_path / "script.py").write_text(LOST, encoding="utf-8")
    paths = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    run = [sys.executable, str(tmp_path / "script.py")]
    ended = subprocess.run(run, capture_output=True, text=True, timeout=120, env=os.environ | {"PYTHONPATH": paths})
    assert ended.stdout.startswith("executor: found that it has gone, or lost a worker, and takes no more")
    assert "Traceback" not in ended.stderr


def test_what_another_version_of_a_worker_would_compute_is_refused():
    with pytest.raises(WorkerError, match=r"found jointbayes .*; expected 0\.1\.0\+other, with the sources of"):
        attempt("0.1.0+other", task_functions.square, 3)


@pytest.mark.whole
def test_the_fingerprint_of_the_code_sees_one_changed_digit(tmp_path):
    sources = Path(jb.__file__).parent
    copy, readers = (
        shutil.copytree(sources.parent / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
        for package in ("jointbayes", "vibrecords")
    )
    ask = [sys.executable, "-c", "from jointbayes.reproducibility import code_version; print(code_version())"]

    def told(path):
        environment = os.environ | {"PYTHONPATH": str(path)}
        return subprocess.run(ask, env=environment, capture_output=True, text=True, check=True).stdout

    own = told(sources.parent)
    assert own == told(tmp_path) == f"{code_version()}\n"
    (copy / ".#beam.py").symlink_to("nobody@nowhere.1")  # the lock of an editor
    assert told(tmp_path) == own
    seen = {own}
    for file in (copy / "structure" / "frame.py", readers / "formats" / "units.py"):
        file.write_text(file.read_text(encoding="utf-8") + "\nSHEAR = 0.5\n", encoding="utf-8")
        seen.add(told(tmp_path))
    assert len(seen) == 3


@pytest.mark.whole
def test_task_on_dask_writes_netcdf_as_anywhere_else(cluster):
    found = [
        o.value or o.error for o in run_tasks(task_functions.store, numbered(3), scheduler=cluster.scheduler_address)
    ]
    assert found == [task_functions.store(0)] * 3
