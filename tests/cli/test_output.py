"""What is printed: no name steers a terminal, and a reader that leaves is no fault."""

import ast
import json
import shlex
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import jointbayes.cli
from jointbayes import errors
from jointbayes.errors import CaseError, JointBayesError, MeasurementError
from tests.conftest import cli
from vibrecords.errors import printable

#: Colours, a title of the window, one byte that begins an escape, a bell, backspaces, text turned round, a new line.
HOSTILE = (
    "\x1b[31m", "\x1b]0;owned\x07", "\x9b31m", "\x08\x08", "\x7f", "\x85", "\r", "\n", "\v", "\f", "\t", "\x0e",
    *map(chr, (*range(0x202A, 0x202F), *range(0x2066, 0x206A), 0x200E, 0x200F, 0x061C, 0x2028, 0xFEFF, 0xE0001)),
    "\x90q", "\udc9b",
)  # fmt: skip
MAIN = "from jointbayes.cli.commands import main; main()"


@pytest.mark.parametrize("part", HOSTILE, ids=ascii)
def test_what_steers_a_terminal_is_escaped(part):
    shown = printable(f"tip{part} of Mößler")
    assert shown.isprintable()
    assert shown == f"tip{repr(part)[1:-1]} of Mößler"


def test_what_prints_stays_as_it_is():
    for text in ("", "plain", "11:y ± 3 %", "Ölfüß 試験 ω² × 10⁻³", "a\xa0b\u2009c\u3000d"):
        assert printable(text) == text
    assert printable("a\nb\x1b", keep="\n") == "a\nb\\x1b"


def is_of_the_package(name):
    kind = getattr(errors, name)
    return isinstance(kind, type) and issubclass(kind, JointBayesError)


@pytest.mark.parametrize("name", [n for n in vars(errors) if is_of_the_package(n)])
def test_every_error_is_printable_and_all_but_that_of_a_case_are_one_line(name):
    error = getattr(errors, name)(f"file{''.join(HOSTILE)}: found nothing")
    assert isinstance(error, JointBayesError)
    lines = str(error).split("\n")
    assert len(lines) == (2 if isinstance(error, CaseError) else 1)
    assert all(line.isprintable() for line in lines)


def test_a_message_that_passes_through_several_errors_is_escaped_once():
    inner = MeasurementError("label '\x1b': found nothing")
    assert str(MeasurementError(f"file: {inner}")) == "file: label '\\x1b': found nothing"


def test_commands_print_by_one_function_alone():
    folder = Path(jointbayes.cli.__path__[0])
    found = [
        f"{path.name}:{node.lineno}"
        for path in sorted(folder.glob("*.py"))
        if path.name != "output.py"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and ast.unparse(node.func) in ("print", "click.echo", "click.secho", "sys.stdout.write", "sys.stderr.write")
    ]
    assert not found, f"jointbayes.cli.output.say makes names safe; use it at {', '.join(found)}"


def hostile_archive(path):
    """An archive with names of members, labels and units of the worst kind, and what is wrong in the last one."""
    word = "".join(HOSTILE[:-1])
    lines = np.arange(1.0, 13.0)
    values = (lines + 1j)[:, None, None] * np.ones((1, 2, 1))
    block = {"frequency_hz": lines, "frf": values, "outputs": [f"a{word}", "b"], "inputs": [f"c{word}"]}
    np.savez(path, **block, unit=f"furlong{word}", averages=3.0)
    return path


def test_json_of_hostile_names_stays_json():
    text = json.dumps({"case": "".join(HOSTILE)})
    assert printable(text) == text


def piped(arguments, cwd, reads, both=False):
    """Exit code and standard error of a command whose reader takes so many bytes and leaves."""
    command = [sys.executable, "-c", MAIN, *arguments]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT if both else subprocess.PIPE, cwd=cwd
    ) as process:
        if reads:
            process.stdout.read(reads)
        process.stdout.close()
        said = "" if both else process.stderr.read().decode()
    return process.returncode, said


@pytest.mark.whole
@pytest.mark.skipif(not hasattr(__import__("select"), "poll"), reason="pipes are looked at by poll")
def test_a_reader_that_leaves_ends_a_command_quietly(tmp_path):
    hostile_archive(tmp_path / "sound.npz")
    for arguments in (["inspect", "sound.npz", "--quiet"], ["--help"]):
        assert piped(arguments, tmp_path, 0) == (141, ""), arguments
    assert piped(["inspect", "none.npz"], tmp_path, 0)[0] == 2  # nothing was to be printed there
    assert piped(["inspect", "none.npz"], tmp_path, 0, both=True)[0] == 2


@pytest.mark.whole
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a shell closes streams, and there is /dev/full")
@pytest.mark.parametrize(
    ("streams", "code", "said"),
    [
        ("2>&-", 0, ""),
        (">&- 2>&-", 0, ""),
        ("2>/dev/full", 0, ""),
        (">/dev/full", 2, "jointbayes: standard output: No space left on device\n"),
    ],
)
def test_a_closed_or_full_stream_ends_no_command_without_a_word(tmp_path, streams, code, said):
    hostile_archive(tmp_path / "sound.npz")
    quiet = "" if "2>" in streams else "--quiet"
    line = f"exec {shlex.quote(sys.executable)} -c {shlex.quote(MAIN)} inspect sound.npz {quiet} {streams}"
    done = subprocess.run(["sh", "-c", line], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (code, said)
    assert bool(done.stdout) == (streams in ("2>&-", "2>/dev/full"))


@pytest.mark.whole
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems keep a directory that is somebody's")
def test_a_working_directory_that_is_gone_is_named(tmp_path):
    (tmp_path / "gone").mkdir()
    line = f"rmdir ../gone; exec {shlex.quote(sys.executable)} -c {shlex.quote(MAIN)} init"
    done = subprocess.run(["sh", "-c", line], cwd=tmp_path / "gone", capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == "jointbayes: the working directory: No such file or directory"


def test_a_warning_of_a_library_is_one_line_without_a_place_in_the_source(capsys):
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert cli("schema").exit_code == 0
        warnings.warn("PDF report: 梁 is a box", RuntimeWarning, stacklevel=1)
    assert capsys.readouterr().err == "jointbayes: warning: PDF report: 梁 is a box\n"
