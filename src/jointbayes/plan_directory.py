"""The directory of a plan: report, numbers, case and figure, whole or absent."""

import datetime
import json
import os
import shutil
import tempfile
from pathlib import Path

from jointbayes.case import Case
from jointbayes.errors import CaseError
from jointbayes.planning import Plan
from jointbayes.report import Figure, render_html, render_pdf
from jointbayes.report.plan import build_plan_report
from jointbayes.run_directory import _swap, require_writable

__all__ = ["require_plan_directory", "write_plan"]

_MARK = "plan.json"  # by which the directory of a plan is known


def write_plan(plan: Plan, case: Case, directory: str | os.PathLike[str]) -> Path:
    """Write the directory of a plan.

    Parameters
    ----------
    plan
        The plan.
    case
        Its case, whose text is kept.
    directory
        Where to write. It is written beside and renamed, so that it is whole or absent; the directory of an older plan
        is replaced, any other is refused.

    Returns
    -------
    Path
        The directory: ``report.html``, ``report.pdf``, ``plan.json``, ``case.toml``, ``figures/plan.svg``.

    Raises
    ------
    CaseError
        If the directory exists and is not that of a plan.
    """
    target = Path(directory)
    require_plan_directory(target)
    summary = plan.summary()
    report = build_plan_report(summary, datetime.datetime.now(datetime.UTC).date())
    target.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}."))
    try:
        (scratch / "report.html").write_text(render_html(report), encoding="utf-8", newline="\n")
        (scratch / "report.pdf").write_bytes(render_pdf(report))
        text = json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False)
        (scratch / _MARK).write_text(text + "\n", encoding="utf-8")
        (scratch / "case.toml").write_text(case.text, encoding="utf-8")
        (scratch / "figures").mkdir()
        for block in report.blocks():
            if isinstance(block, Figure):
                (scratch / "figures" / f"{block.identifier}.svg").write_text(block.svg, encoding="utf-8")
        scratch.chmod(0o755)  # mkdtemp makes it private
        _swap(scratch, target)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return target


def require_plan_directory(target: Path) -> None:
    """Refuse a place where the directory of a plan cannot or must not be written; before the work, not after it.

    Raises
    ------
    CaseError
        If it is a file, or a directory that holds something else.
    """
    if target.is_dir() and any(target.iterdir()):
        if not (target / _MARK).is_file():
            raise CaseError(
                f"{target}: found a directory that holds other files; expected a new directory or that of an earlier "
                "plan; choose another --out"
            )
        if not os.access(target.absolute().parent, os.W_OK):
            raise CaseError(
                f"{target}: found that {target.absolute().parent} cannot be written to; choose another --out"
            )
        return
    require_writable(target)
