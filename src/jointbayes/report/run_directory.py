"""The run directory: report, draws, summary, case and figures, whole or absent.

Its draws outlive anything that fails after them: on disk, whole, before any figure is drawn.
"""

import datetime
import itertools
import json
import os
import shlex
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from jointbayes.errors import CaseError, JointBayesError, ReportError, ReportInterruptedError, WriteError
from jointbayes.inference import Problem
from jointbayes.posterior import Posterior
from jointbayes.posterior.knowledge import judged_names, rows_of
from jointbayes.progress import Progress, ProgressCallback, callback_of, tell_nobody
from jointbayes.report import Figure, Report, ReportInputs, build_report, render_html, render_pdf
from jointbayes.report.contents import one_page
from jointbayes.report.methods import references
from jointbayes.report.model import Paragraph
from jointbayes.reproducibility import one_blas_thread
from jointbayes.sampling import SamplerSettings
from vibrecords.files import real_directory, scratch_file, sweep, whole_directory, write_whole_file


@contextmanager
def draws_kept(posterior: Posterior, directory: Path) -> Iterator[Path]:
    """Keep draws in a file next to the run directory to be until the directory itself holds them.

    Parameters
    ----------
    posterior
        The posterior.
    directory
        The run directory.

    Yields
    ------
    Path
        The file, ``NAME.posterior.nc`` next to the directory NAME, or ``NAME.posterior-2.nc`` and so on where an
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
    """Turn any failure in the body into one line that names the file of the draws and how to go on.

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
    """A file for draws next to a run directory; its name is taken now, so that no other run keeps its draws there."""
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
    """What went wrong, on one line; an unexpected fault comes with its type and a way to its traceback."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    text = " ".join(str(error).split())
    if isinstance(error, JointBayesError):
        return text
    return f"found {type(error).__name__} ({text or 'no message'}); JOINTBAYES_DEBUG=1 shows where"


_MARK = "summary.json"  # by which a run directory is known
#: What may be in a run directory; any other file is the user's.
_FILES = ("report.html", "report.pdf", "posterior.nc", "summary.json", "case.toml", "references.bib",
          "one-page.pdf")  # fmt: skip
_FIGURES, _FIGURE = "figures", ".svg"
_OF_THE_SYSTEM = (".DS_Store", "Thumbs.db", "desktop.ini")  # what looking at a directory leaves in it
_ROOM = 3_000_000  # bytes of a report without its draws: HTML, PDF and figures
_REMEDY = "expected a new directory or an earlier run directory; choose another --out"
_STEPS = 1000  # of each ensemble; the shipped cases take 100 to 950


@one_blas_thread()
def write_report(
    posterior: Posterior, directory: str | os.PathLike[str], *, progress: ProgressCallback | bool | None = None
) -> Path:
    """Write a run directory.

    The draws are on disk, whole, in a file next to the directory, before any figure is drawn; the file goes when the
    directory is there, and stays where the report fails.

    Parameters
    ----------
    posterior
        The posterior, with the problem that was sampled: nothing of it is built again.
    directory
        Where to write. It is written next to it and renamed, so that it is whole or absent; an older run directory of
        the same name is replaced, any other directory is refused.
    progress
        Called as each stage begins.

    Returns
    -------
    Path
        The directory: ``report.html``, ``report.pdf``, ``posterior.nc``, ``summary.json``, ``figures/*.svg``,
        ``references.bib``, and ``case.toml`` where a case file states the problem.

    Raises
    ------
    CaseError
        If the directory exists and is no run directory.
    WriteError
        If not even the draws can be written; where they can be written elsewhere the message says where they are.
    ReportError, ReportInterruptedError
        If the report fails or is interrupted: where the draws are, and how to go on.
    """
    target = Path(directory)
    require_writable(target)
    with draws_kept(posterior, target):
        return write_run(posterior, target, callback_of(progress))


def write_run(
    posterior: Posterior, target: Path, progress: ProgressCallback = tell_nobody, inputs: ReportInputs | None = None
) -> Path:
    """Write a run directory, without a copy of the draws elsewhere until it is there.

    Parameters
    ----------
    posterior
        The posterior.
    target
        The directory.
    progress
        Called as each stage begins.
    inputs
        What is computed of the posterior, to be used again.

    Raises
    ------
    CaseError
        If the directory exists and is no run directory.
    """
    require_writable(target)
    inputs = inputs or ReportInputs(posterior)
    judge_aloud(posterior, progress)
    files = {"summary.json": json_text(inputs.summary.to_dict())}
    if inputs.case_text:
        files["case.toml"] = inputs.case_text
    progress(Progress("drawing figures"))
    report = build_report(inputs, datetime.datetime.now(datetime.UTC).date())
    progress(Progress("writing HTML, PDF and draws"))
    target.parent.mkdir(parents=True, exist_ok=True)
    with whole_directory(target) as new:
        write_into(new, report, files)
        posterior.save(new / "posterior.nc")
        if target.is_dir():
            _require_ours(target)  # once more: hours may have passed
    return target


def write_one_page(posterior: Posterior, target: Path, progress: ProgressCallback = tell_nobody) -> Path:
    """Write page one alone as a PDF of one A4 page, and return its path."""
    judge_aloud(posterior, progress)
    today = datetime.datetime.now(datetime.UTC).date()
    write_whole_file(target, render_pdf(one_page(ReportInputs(posterior), today)))
    return target


def judge_aloud(posterior: Posterior, progress: ProgressCallback) -> None:
    """Judge a posterior, which keeps what it found, with a line before each part that takes seconds."""
    progress(Progress("checking the model"))
    posterior.check  # noqa: B018
    for name in judged_names(posterior):
        progress(Progress("judging", name))
        posterior.verdict(name)
    progress(Progress("looking at what is known under other premises"))
    rows_of(posterior)
    progress(Progress("looking for the best next step, and for joints that the data rule out"))


def json_text(numbers: dict[str, Any]) -> str:
    """JSON as it is written into a directory: indented, readable, without NaN."""
    return json.dumps(numbers, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def write_into(directory: Path, report: Report, files: Mapping[str, str]) -> None:
    """Write report, figures, references and other files, in this order, into a directory; each is whole or absent."""
    figures = {f"figures/{block.identifier}.svg": block.svg for block in report.blocks() if isinstance(block, Figure)}
    if cited := references(*(block.text for block in report.blocks() if isinstance(block, Paragraph))):
        figures["references.bib"] = cited
    rendered = {"report.html": render_html(report).encode(), "report.pdf": render_pdf(report)}
    for name, content in (rendered | {name: text.encode() for name, text in {**figures, **files}.items()}).items():
        if "/" in name:
            real_directory((directory / name).parent)
        write_whole_file(directory / name, content)


def require_writable(target: Path, room: int = _ROOM) -> None:
    """Refuse a place where a run directory cannot or must not be written; before the work, not after it.

    What processes that died there while they wrote have left is removed.

    Parameters
    ----------
    target
        The directory to be.
    room
        Bytes that will be written at least.

    Raises
    ------
    CaseError
        If it is a file, a directory that holds something else, or one that cannot be replaced.
    WriteError
        If nothing can be written there, or the disk has too little room.
    """
    place = Path(os.path.abspath(target))
    here = Path.cwd()
    if os.path.realpath(place) in map(os.path.realpath, (here, *here.parents)):
        raise CaseError(f"{target}: found the directory of this shell, or one above it; {_REMEDY}")
    if place.is_mount():
        raise CaseError(f"{target}: found a disk's own directory, which cannot be replaced; {_REMEDY}")
    if target.is_dir():
        if any(target.iterdir()) and not (target / _MARK).is_file():
            raise CaseError(f"{target}: found a directory that holds other files; {_REMEDY}")
        _require_ours(target)
    elif os.path.lexists(target):
        raise CaseError(f"{target}: found a file; {_REMEDY}")
    parent = next(p for p in place.parents if p.exists())
    if not parent.is_dir():
        raise CaseError(f"{target}: found that {parent} is a file; {_REMEDY}")
    sweep(parent)
    require_room(target, room)


def _require_ours(target: Path) -> None:
    """Refuse to replace a link, or a directory that holds anything that no run has written."""
    if target.is_symlink():
        raise CaseError(f"{target}: found a link; {_REMEDY}")
    for entry in sorted(target.iterdir()):
        expected, below = entry.name in _FILES, [entry]
        if entry.name == _FIGURES and entry.is_dir() and not entry.is_symlink():
            below = sorted(entry.iterdir())
        for file in below:
            ours = expected if file is entry else file.suffix == _FIGURE
            ours = ours or file.name in _OF_THE_SYSTEM
            if not ours or file.is_symlink() or not file.is_file():
                raise CaseError(f"{target}: found {file.relative_to(target)} in it, which no run wrote; {_REMEDY}")


def room_of_run(problem: Problem, settings: SamplerSettings, *, report: bool) -> int:
    """Bytes that a run of a thousand steps has on the disk at one time: draws, and those of a report.

    Parameters
    ----------
    problem, settings
        What is sampled, and how.
    report
        Whether a report is written; the draws are there twice meanwhile.
    """
    dimension = len(problem.names)
    draws = 8 * settings.ensembles * settings.walkers * min(settings.max_steps, _STEPS)
    in_file = dimension + len(problem.quantities) + 3  # θ, stiffnesses, ln p and a share of all the rest
    return draws * (2 if report else 1) * in_file + (_ROOM if report else 0)


def require_room(target: Path, room: int = _ROOM) -> None:
    """Refuse a place where a file or directory cannot be made, or that has too little room.

    Parameters
    ----------
    target
        What is to be made; directories above it need not be there.
    room
        Bytes that will be written at least.

    Raises
    ------
    WriteError
        If that is so.
    """
    remedy = "choose another --out"
    parent = next(p for p in Path(os.path.abspath(target)).parents if p.exists())
    try:
        with scratch_file(parent / target.name) as scratch:
            scratch.write_bytes(bytes(4096))
            free = shutil.disk_usage(parent).free
    except OSError as error:
        found = f"found that {parent} cannot be written to ({error.strerror or error})"
        raise WriteError.of(f"{target}", (), found, "a directory for it that can", remedy) from error
    if free < room:
        found = f"found {free / 1e6:.1f} MB free on the disk"
        expected = f"at least {room / 1e6:.1f} MB for what will be written"
        raise WriteError.of(f"{target}", (), found, expected, f"make room or {remedy}")
