"""Compiled loops are kept for the next process; a cache that is damaged or cannot be written costs one line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.case.refusal_rows import parts_named

pytestmark = pytest.mark.whole  # what another process finds is the claim

_, SCRIPT = parts_named("scripts").values()


def run(*options, **variables):
    """Standard error of a process that uses one compiled loop."""
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    environment |= {k: str(v) for k, v in variables.items()}
    command = [sys.executable, "-c", SCRIPT, *options]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "42\n"
    return done.stderr


def compiles(said):
    assert said.startswith("jointbayes: compiling the loops")
    assert said.count("\n") == 1


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    directory = tmp_path_factory.mktemp("cache")
    compiles(run(NUMBA_CACHE_DIR=directory))
    return directory


def kept(cache, ending) -> Path:
    (path,) = cache.rglob(f"loop.doubled-*.{ending}")
    return path


@pytest.mark.parametrize(
    ("ending", "damage"),
    [
        ("nbi", lambda whole: b"\x93" + os.urandom(200)),
        ("nbc", lambda whole: whole[: len(whole) // 2] + b"!" + whole[len(whole) // 2 + 1 :]),
    ],
)
def test_a_damaged_cache_is_replaced_with_one_line(cache, ending, damage):
    path = kept(cache, ending)
    path.write_bytes(damage(path.read_bytes()))
    said = run(NUMBA_CACHE_DIR=cache)
    assert "compiling it again" in said
    assert said.count("\n") == 1


def test_what_was_compiled_is_not_compiled_again_and_not_used_on_another_machine(cache):
    run(NUMBA_CACHE_DIR=cache)
    assert run(NUMBA_CACHE_DIR=cache) == ""
    compiles(run(NUMBA_CACHE_DIR=cache, NUMBA_CPU_NAME="generic"))


def test_without_a_directory_to_write_to_a_temporary_one_of_the_user_serves(tmp_path):
    (tmp_path / "file").touch()
    first, second = (run("--nowhere", TMPDIR=tmp_path, NUMBA_CACHE_DIR=tmp_path / "file") for _ in range(2))
    assert first.count("\n") == 2
    assert str(tmp_path / "jointbayes-") in first
    assert "compiling the loops" in first
    assert second.count("\n") == 1
    (directory,) = tmp_path.glob("jointbayes-*")
    assert directory.stat().st_mode & 0o777 == 0o700

    directory.chmod(0o777)  # anybody could have put code there
    third = run("--nowhere", TMPDIR=tmp_path, NUMBA_CACHE_DIR=tmp_path / "file")
    assert "compiling the loops" in third
    assert str(directory) + ":" not in third
    before = sorted(tmp_path.iterdir())
    fourth = run("--nowhere", TMPDIR=tmp_path, NUMBA_CACHE_DIR=tmp_path / "file")
    assert "compiling the loops" not in fourth  # the same one serves again, and none is left behind at each start
    assert sorted(tmp_path.iterdir()) == before
