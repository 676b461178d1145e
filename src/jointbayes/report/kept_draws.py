"""Draws that outlive whatever fails after them: on disk, whole, before any figure is drawn."""

import itertools
import os
import shlex
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jointbayes.errors import JointBayesError, ReportError, ReportInterruptedError, WriteError
from jointbayes.posterior import Posterior


@contextmanager
def draws_kept(posterior: Posterior, directory: Path) -> Iterator[Path]:
    """Keep draws in a file beside the run directory to be until the directory itself holds them.

    Parameters
    ----------
    posterior
        The posterior.
    directory
        The run directory.

    Yields
    ------
    Path
        The file, ``NAME.posterior.nc`` beside the directory NAME, or ``NAME.posterior-2.nc`` and so on where an
        earlier run left one. It goes when the body ends, and stays when the body fails.

    Raises
    ------
    WriteError
        If the draws cannot be written there.
    ReportError, ReportInterruptedError
        If the body fails or is interrupted: with the file, and the command that goes on.
    """
    # "." and ".." have no name of their own
    named = directory if directory.name.strip(".") else Path(os.path.abspath(directory))
    kept = _reserve_file(named)
    try:
        save_draws(posterior, kept, directory)
    except BaseException:
        kept.unlink(missing_ok=True)
        raise
    with draws_explained(kept, directory):
        yield kept
    kept.unlink(missing_ok=True)


@contextmanager
def draws_explained(draws: Path, directory: Path) -> Iterator[None]:
    """Turn whatever fails in the body into one line that names the file of the draws and how to go on.

    Raises
    ------
    ReportError, ReportInterruptedError
        If the body fails or is interrupted.
    """
    try:
        yield
    except KeyboardInterrupt as error:
        text = f"interrupted while the report was written; {_go_on(draws, directory)}"
        raise ReportInterruptedError(text) from error
    except Exception as error:
        raise ReportError(f"{directory}: no report: {_one_line(error)}; {_go_on(draws, directory)}") from error


def save_draws(posterior: Posterior, path: Path, directory: Path | None = None) -> None:
    """Write draws to a file; where that fails, to the temporary directory, so that they are not lost.

    Parameters
    ----------
    posterior
        The posterior.
    path
        The file to be.
    directory
        Run directory that was to be written from it, if any.

    Raises
    ------
    WriteError
        If `path` cannot be written: with the place where the draws are instead, if there is one.
    """
    try:
        posterior.save(path)
    except WriteError as error:
        try:
            rescue = Path(tempfile.mkdtemp(prefix="jointbayes-")) / "posterior.nc"
        except OSError:  # there is no temporary directory
            raise error from None
        try:
            posterior.save(rescue)
        except WriteError:
            rescue.parent.rmdir()
            raise error from None
        raise WriteError(f"{error}; {_go_on(rescue, directory)}") from error


def _reserve_file(named: Path) -> Path:
    """A file for draws beside a run directory; its name is taken now, so that no other run keeps its draws there."""
    for end in itertools.chain([""], (f"-{number}" for number in itertools.count(2))):
        path = named.with_name(f"{named.name}.posterior{end}.nc")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.open("xb").close()
        except OSError:  # where no file can be made, writing the draws will say why and look for another place
            if path.exists():
                continue
        return path
    raise AssertionError


def _go_on(draws: Path, directory: Path | None) -> str:
    command = f"jointbayes report {shlex.quote(os.fspath(draws))}"
    if directory is not None:
        command += f" --out {shlex.quote(os.fspath(directory))}"
    return f"the draws are whole in {draws}; go on with: {command}"


def _one_line(error: Exception) -> str:
    """What went wrong, on one line; what nobody expected comes with its type and a way to its traceback."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    text = " ".join(str(error).split())
    if isinstance(error, JointBayesError):
        return text
    return f"found {type(error).__name__} ({text or 'no message'}); JOINTBAYES_DEBUG=1 shows where"
