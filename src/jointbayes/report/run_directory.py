"""The run directory: report, draws, summary, case and figures, whole or absent."""

import datetime
import json
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from jointbayes.errors import CaseError, WriteError
from jointbayes.posterior import Posterior
from jointbayes.report import Figure, Report, ReportInputs, build_report, render_html, render_pdf
from jointbayes.report.kept_draws import draws_kept
from jointbayes.whole_file import exchanged, scratch_directory, swept

__all__ = [
    "json_text",
    "require_room",
    "require_writable",
    "write_report",
    "write_run",
    "write_whole",
]

_MARK = "summary.json"  # by which a run directory is known
_ROOM = 3_000_000  # bytes of a report without its draws: HTML, PDF and figures of the smallest case


def write_report(posterior: Posterior, directory: str | os.PathLike[str]) -> Path:
    """Write a run directory.

    The draws are on disk, whole, in a file beside the directory, before any figure is drawn; the file goes when the
    directory is there, and stays where the report fails.

    Parameters
    ----------
    posterior
        The posterior, with the problem that was sampled: nothing of it is built again.
    directory
        Where to write. It is written beside and renamed, so that it is whole or absent; an older run directory of
        the same name is replaced, any other directory is refused.

    Returns
    -------
    Path
        The directory: ``report.html``, ``report.pdf``, ``posterior.nc``, ``summary.json``, ``figures/*.svg``, and
        ``case.toml`` where a case file states the problem.

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
        return write_run(posterior, target)


def write_run(
    posterior: Posterior,
    target: Path,
    tell: Callable[[str], None] = lambda _: None,
    inputs: ReportInputs | None = None,
) -> Path:
    """Write a run directory, without a copy of the draws elsewhere until it is there.

    Parameters
    ----------
    posterior
        The posterior.
    target
        The directory.
    tell
        Called with the name of each phase as it begins.
    inputs
        What is computed of the posterior, to be used again.

    Raises
    ------
    CaseError
        If the directory exists and is no run directory.
    """
    require_writable(target)
    inputs = inputs or ReportInputs(posterior)
    tell("checking the model, and what the verdicts rest on")
    summary = inputs.summary
    tell("drawing figures")
    report = build_report(inputs, datetime.datetime.now(datetime.UTC).date())

    files = {"summary.json": json_text(summary.to_json())}
    if posterior.of_case_text:
        files["case.toml"] = posterior.record.case_text
    tell("writing HTML, PDF and draws")
    write_whole(target, report, files, lambda path: posterior.save(path, inputs.knowledge))
    return target


def json_text(numbers: dict[str, Any]) -> str:
    """JSON as it is written into a directory: indented, readable, without NaN."""
    return json.dumps(numbers, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def write_whole(
    target: Path,
    report: Report,
    files: Mapping[str, str],
    save_draws: Callable[[Path], None] | None = None,
) -> None:
    """Write report, figures, other files and draws beside the target, then put them in its place."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with scratch_directory(target) as scratch:
        new = scratch / "new"
        new.mkdir()
        _write_synced(new / "report.html", render_html(report).encode())
        _write_synced(new / "report.pdf", render_pdf(report))
        for block in report.blocks():
            if isinstance(block, Figure):
                files = {**files, f"figures/{block.identifier}.svg": block.svg}
        for name, text in files.items():
            (new / name).parent.mkdir(exist_ok=True)
            _write_synced(new / name, text.encode())
        if save_draws is not None:
            save_draws(new / "posterior.nc")
        exchanged(new, target, scratch)


def _write_synced(path: Path, content: bytes) -> None:
    """Write a file and force it to the disk: what stands beside the directory goes when this one is in place."""
    with path.open("wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())


def require_writable(target: Path, mark: str = _MARK, room: int = _ROOM) -> None:
    """Refuse a place where a run directory cannot or must not be written; before the work, not after it.

    What processes that died there while they wrote have left is removed.

    Parameters
    ----------
    target
        The directory to be.
    mark
        File by which an earlier one is known.
    room
        Bytes that will be written at least.

    Raises
    ------
    CaseError
        If it is a file, a directory that holds something else, or one that cannot be replaced.
    WriteError
        If nothing can be written there, or the disk has too little room.
    """
    remedy = "expected a new directory or an earlier run directory; choose another --out"
    place = Path(os.path.abspath(target))
    here = Path.cwd()
    if os.path.realpath(place) in map(os.path.realpath, (here, *here.parents)):
        raise CaseError(f"{target}: found the directory of this shell, or one above it; {remedy}")
    if place.is_mount():
        raise CaseError(f"{target}: found a disk's own directory, which cannot be replaced; {remedy}")
    if target.is_dir():
        if any(target.iterdir()) and not (target / mark).is_file():
            raise CaseError(f"{target}: found a directory that holds other files; {remedy}")
    elif os.path.lexists(target):
        raise CaseError(f"{target}: found a file; {remedy}")
    parent = next(p for p in place.parents if p.exists())
    if not parent.is_dir():
        raise CaseError(f"{target}: found that {parent} is a file; {remedy}")
    swept(parent)
    require_room(target, room)


def require_room(target: Path, room: int) -> None:
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
        with scratch_directory(parent / target.name) as scratch:
            (scratch / "trial").write_bytes(bytes(4096))
            free = shutil.disk_usage(scratch).free
    except OSError as error:
        raise WriteError(
            f"{target}: found that {parent} cannot be written to ({error.strerror or error}); expected a directory "
            f"for it that can; {remedy}"
        ) from error
    if free < room:
        raise WriteError(
            f"{target}: found {free / 1e6:.1f} MB free on the disk; expected at least {room / 1e6:.1f} MB for what "
            f"will be written; make room or {remedy}"
        )
