"""The run directory: report, draws, summary, case and figures, whole or absent."""

import datetime
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from jointbayes.errors import CaseError
from jointbayes.posterior import Posterior
from jointbayes.report import Figure, Report, ReportInputs, build_report, render_html, render_pdf
from jointbayes.report.kept_draws import draws_kept

__all__ = [
    "json_text",
    "require_writable",
    "write_report",
    "write_run",
    "write_whole",
]

_MARK = "summary.json"  # by which a run directory is known


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


def write_run(posterior: Posterior, target: Path, tell: Callable[[str], None] = lambda _: None) -> Path:
    """Write a run directory, without a copy of the draws elsewhere until it is there.

    Parameters
    ----------
    posterior
        The posterior.
    target
        The directory.
    tell
        Called with the name of each phase as it begins.

    Raises
    ------
    CaseError
        If the directory exists and is no run directory.
    """
    require_writable(target)
    inputs = ReportInputs(posterior)
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
    scratch = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}."))
    try:
        (scratch / "report.html").write_text(render_html(report), encoding="utf-8", newline="\n")
        (scratch / "report.pdf").write_bytes(render_pdf(report))
        for block in report.blocks():
            if isinstance(block, Figure):
                files = {**files, f"figures/{block.identifier}.svg": block.svg}
        for name, text in files.items():
            (scratch / name).parent.mkdir(exist_ok=True)
            (scratch / name).write_text(text, encoding="utf-8")
        if save_draws is not None:
            save_draws(scratch / "posterior.nc")
        scratch.chmod(0o755)  # mkdtemp makes it private
        _swap(scratch, target)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def require_writable(target: Path, mark: str = _MARK) -> None:
    """Refuse a place where a run directory cannot or must not be written; before the work, not after it.

    Parameters
    ----------
    target
        The directory to be.
    mark
        File by which an earlier one is known.

    Raises
    ------
    CaseError
        If it is a file, or a directory that holds something else.
    """
    remedy = "expected a new directory or an earlier run directory; choose another --out"
    if target.is_dir():
        if any(target.iterdir()) and not (target / mark).is_file():
            raise CaseError(f"{target}: found a directory that holds other files; {remedy}")
    elif target.exists():
        raise CaseError(f"{target}: found a file; {remedy}")
    parent = next(p for p in target.absolute().parents if p.exists())
    if not parent.is_dir():
        raise CaseError(f"{target}: found that {parent} is a file; {remedy}")
    if not os.access(parent, os.W_OK):
        raise CaseError(f"{target}: found that {parent} cannot be written to; {remedy}")


def _swap(scratch: Path, target: Path) -> None:
    """Put `scratch` in the place of `target`; an older run directory goes only when the new one is there."""
    if not target.exists():
        scratch.replace(target)
        return
    old = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}.old."))
    try:
        target.replace(old / "run")
        try:
            scratch.replace(target)
        except BaseException:
            (old / "run").replace(target)
            raise
    finally:
        shutil.rmtree(old, ignore_errors=True)
