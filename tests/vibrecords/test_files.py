"""Files and directories that are whole or absent: scraps of the dead are swept, those of the living stay."""

import errno
import os
import signal
import subprocess
import sys
from contextlib import suppress
from functools import partial

import pytest

from vibrecords import files
from vibrecords.errors import WriteError
from vibrecords.files import LOCK, MARK, OwnDirectory, lock_file, sweep, whole_directory, whole_file, write_whole_file

WRITER = """
import sys, time
from pathlib import Path
from vibrecords.files import whole_directory, whole_file
kind, target = sys.argv[1], Path(sys.argv[2])
with (whole_file if kind == "file" else whole_directory)(target) as scratch:
    (scratch if kind == "file" else scratch / "half").write_bytes(b"half")
    print("writing", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def writing():
    """Start processes that write; they are killed at the end."""
    started = []

    def start(kind, target):
        process = subprocess.Popen([sys.executable, "-c", WRITER, kind, str(target)], stdout=subprocess.PIPE, text=True)
        started.append(process)
        assert process.stdout.readline() == "writing\n"
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()
        process.stdout.close()


def names(folder):
    return sorted(p.name for p in folder.iterdir())


@pytest.mark.parametrize("kind", ["file", "directory"])
def test_what_a_killed_process_left_is_swept_and_what_a_living_one_writes_stays(tmp_path, writing, kind):
    living, dead = writing(kind, tmp_path / "one"), writing(kind, tmp_path / "two")
    of_each = {"file": 1, "directory": 2}[kind]
    assert len(names(tmp_path)) == 2 * of_each
    dead.send_signal(signal.SIGKILL)
    dead.wait()
    sweep(tmp_path)
    assert [name.startswith(".one.") for name in names(tmp_path)] == [True] * of_each
    living.send_signal(signal.SIGKILL)
    living.wait()
    sweep(tmp_path)
    assert names(tmp_path) == []


def test_the_first_file_that_a_process_writes_sweeps(tmp_path, writing):
    dead = writing("file", tmp_path / "one")
    dead.kill()
    dead.wait()
    assert len(names(tmp_path)) == 1
    files._swept.clear()
    write_whole_file(tmp_path / "two", b"whole")
    assert names(tmp_path) == ["two"]


def test_nothing_is_swept_that_only_looks_like_a_scrap(tmp_path):
    others = [".one.12345678", ".one.1234567.jointbayes", "one.12345678.jointbayes", ".one.1234567g.jointbayes"]
    for name in others:
        (tmp_path / name).write_bytes(b"mine")
    os.mkfifo(tmp_path / ".pipe.12345678.jointbayes")  # would wait for a writer if it were opened as a file is
    sweep(tmp_path)
    assert set(others) <= set(names(tmp_path))


def scrap(folder, name=".one.12345678.jointbayes"):
    """A directory as a process leaves it that was killed as it wrote in it."""
    (folder / name).touch()
    (folder / f"{name}.d").mkdir()
    return folder / f"{name}.d"


@pytest.mark.parametrize("name", [".one.12345678.jointbayes", ".one.12345678.jointbayes.d"])
def test_a_directory_that_was_not_begun_by_us_is_not_swept(tmp_path, name):
    (tmp_path / name / "new").mkdir(parents=True)
    (tmp_path / name / "new" / "thesis").write_text("mine", encoding="utf-8")
    sweep(tmp_path)
    assert (tmp_path / name / "new" / "thesis").read_text(encoding="utf-8") == "mine"
    assert names(tmp_path) == [name]


def test_nothing_is_moved_out_of_a_directory_that_a_scrap_links_to(tmp_path):
    (tmp_path / "victim").mkdir()
    (tmp_path / "victim" / "thesis").write_text("mine", encoding="utf-8")
    (tmp_path / "here").mkdir()
    (scrap(tmp_path / "here") / "old").symlink_to(tmp_path / "victim")
    sweep(tmp_path / "here")
    assert names(tmp_path / "victim") == ["thesis"]
    assert names(tmp_path / "here") == []
    (tmp_path / "here" / ".one.12345678.jointbayes").touch()
    (tmp_path / "here" / ".one.12345678.jointbayes.d").symlink_to(tmp_path)
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "thesis").write_text("mine", encoding="utf-8")
    sweep(tmp_path / "here")
    assert names(tmp_path / "old") == names(tmp_path / "victim") == ["thesis"]


def directory(place, content):
    place.mkdir()
    (place / "content").write_text(content, encoding="utf-8")
    return place


@pytest.mark.parametrize("at_once", [True, False])
def test_a_directory_takes_the_place_of_another(tmp_path, monkeypatch, at_once):
    if not at_once:
        monkeypatch.setattr(files, "_swapped_at_once", lambda *_names: False)
    target = directory(tmp_path / "run", "old")
    with whole_directory(target) as new:
        (new / "content").write_text("new", encoding="utf-8")
        assert (target / "content").read_text(encoding="utf-8") == "old"
    assert (target / "content").read_text(encoding="utf-8") == "new"
    assert names(tmp_path) == ["run"]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux exchanges two names at once")
def test_linux_exchanges_at_once(tmp_path):
    one, other = directory(tmp_path / "one", "1"), directory(tmp_path / "other", "2")
    assert files._swapped_at_once(one, other)
    assert (one / "content").read_text(encoding="utf-8") == "2"


def test_an_older_directory_comes_back_where_the_new_one_cannot_take_its_place(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "_swapped_at_once", lambda *_names: False)
    rename = type(tmp_path).replace

    def failing(self, to):
        if "new" in self.parts:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return rename(self, to)

    monkeypatch.setattr(type(tmp_path), "replace", failing)
    target = directory(tmp_path / "run", "old")
    with pytest.raises(OSError, match="Input/output"), whole_directory(target):
        pass
    assert (target / "content").read_text(encoding="utf-8") == "old"
    assert names(tmp_path) == ["run"]


def test_an_older_directory_comes_back_where_a_process_was_killed_between_two_renames(tmp_path):
    name = "r" * 130 + ".1"  # of which a scrap's name has the beginning only
    older = scrap(tmp_path) / "old"
    older.mkdir()
    directory(older / name, "old")
    sweep(tmp_path)
    assert names(tmp_path) == [name]
    assert (tmp_path / name / "content").read_text(encoding="utf-8") == "old"


def test_a_lock_is_one_process_s_and_free_when_it_has_gone(tmp_path):
    with lock_file(tmp_path / "lock"):
        assert lock_file(tmp_path / "lock") is None
    lock_file(tmp_path / "lock").close()


def test_a_disk_without_locks_is_written_to_and_never_swept(tmp_path, monkeypatch):
    def no_locks(*_arguments):
        raise OSError(errno.ENOTSUP, os.strerror(errno.ENOTSUP))

    monkeypatch.setattr("fcntl.flock", no_locks)
    (tmp_path / ".other.12345678.jointbayes").write_bytes(b"another machine may be writing this")
    sweep(tmp_path)
    write_whole_file(tmp_path / "one", b"whole")
    assert names(tmp_path) == [".other.12345678.jointbayes", "one"]


@pytest.mark.parametrize("kind", ["fifo", "directory", "link to a device", "link to nothing"])
def test_what_is_no_regular_file_is_never_replaced(tmp_path, kind):
    target = tmp_path / "one"
    if kind == "fifo":
        os.mkfifo(target)
    elif kind == "directory":
        target.mkdir()
    else:
        target.symlink_to("/dev/null" if kind == "link to a device" else tmp_path / "gone")
    before = os.lstat(target)
    with pytest.raises(WriteError, match="found no regular file; expected a file or nothing there"):
        write_whole_file(target, b"new")
    assert os.lstat(target) == before
    assert names(tmp_path) == ["one"]


def test_a_written_file_has_the_permissions_of_any_other(tmp_path):
    (tmp_path / "usual").write_bytes(b"")
    for content in (b"new", b"newer"):
        write_whole_file(tmp_path / "new", content)
        assert (tmp_path / "new").read_bytes() == content
        assert (tmp_path / "new").stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_a_writer_that_fails_leaves_nothing(tmp_path):
    with pytest.raises(ValueError, match="no"), whole_file(tmp_path / "one"):
        raise ValueError("no")
    assert names(tmp_path) == []


def test_files_are_opened_as_bytes_where_the_system_would_translate_lines():
    # the flag of Windows stands for one that can be asked for here
    program = """
import fcntl, os, sys
os.O_BINARY = os.O_APPEND
from vibrecords.files import open_regular
print(bool(fcntl.fcntl(open_regular(sys.argv[1], "rb"), fcntl.F_GETFL) & os.O_APPEND))
"""
    done = subprocess.run([sys.executable, "-c", program, __file__], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"


@pytest.mark.parametrize("calls", range(6))
def test_a_directory_that_a_process_was_killed_in_as_it_removed_it_is_swept(tmp_path, monkeypatch, calls):
    """Whatever it had got to: the file, by which the next process knows it, goes last."""
    place = scrap(tmp_path)
    (place / "trial").write_bytes(b"some")
    (place / "new").mkdir()
    (place / "new" / "half").write_bytes(b"half")
    left = iter(range(calls))

    def kill_after_some(call, *arguments, **options):
        if next(left, None) is None:
            raise KeyboardInterrupt
        return call(*arguments, **options)

    with monkeypatch.context() as killing:
        for name in ("unlink", "rmdir"):
            killing.setattr(os, name, partial(kill_after_some, getattr(os, name)))
        with suppress(KeyboardInterrupt):
            sweep(tmp_path)
    sweep(tmp_path)
    assert names(tmp_path) == []


# ---- directories of ours


@pytest.mark.parametrize(
    "left", [{}, {LOCK: b""}, {LOCK: b"process 7 on"}, {MARK: b""}, {MARK: b"", LOCK: b"process 7 on a\n"}]
)
def test_a_directory_that_a_process_was_killed_in_as_it_made_it_is_taken(tmp_path, left):
    (tmp_path / "own").mkdir()
    for name, content in left.items():
        (tmp_path / "own" / name).write_bytes(content)
    with OwnDirectory(tmp_path / "own", "a test"):
        assert (tmp_path / "own" / LOCK).read_text(encoding="utf-8").startswith(f"process {os.getpid()} on ")
    assert (tmp_path / "own" / MARK).read_bytes() == b"jointbayes: a test\n"
    assert names(tmp_path / "own") == [MARK]


@pytest.mark.parametrize("name", [LOCK, MARK, "thesis"])
def test_a_directory_with_a_file_of_somebody_else_is_not_taken(tmp_path, name):
    (tmp_path / name).write_text("mine", encoding="utf-8")
    with pytest.raises(WriteError, match="holds other files, and no mark"), OwnDirectory(tmp_path, "a test"):
        pass
    assert (tmp_path / name).read_text(encoding="utf-8") == "mine"
    assert names(tmp_path) == [name]


@pytest.mark.parametrize("call", range(5))
def test_a_directory_that_cannot_be_made_whole_leaves_nothing(tmp_path, monkeypatch, call):
    """The disk is full at the directory, its lock, what is in that, its mark, and as that is forced to the disk."""
    calls = iter(range(call))

    def refuse(function, *arguments):
        if "rb" not in arguments and next(calls, None) is None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return function(*arguments)

    with monkeypatch.context() as full:
        for module, name in ((os, "mkdir"), (files, "open_regular"), (os, "write"), (os, "fsync")):
            full.setattr(module, name, partial(refuse, getattr(module, name)))
        with pytest.raises(WriteError, match="cannot be written"):
            OwnDirectory(tmp_path / "own", "a test").__enter__()
    assert names(tmp_path) == []


def test_one_that_has_let_go_removes_nothing_of_the_next(tmp_path):
    first, second = (OwnDirectory(tmp_path / "own", "a test") for _ in range(2))
    with first:
        assert not second.take()
    with second:
        first.dissolve()
        assert names(tmp_path / "own") == [MARK, LOCK]
        second.dissolve()
    assert names(tmp_path) == []
