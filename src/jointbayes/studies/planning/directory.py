"""The directory of a plan: report, numbers, case and figure, whole or absent."""

import datetime
import os
from pathlib import Path

from jointbayes.case.case import Case
from jointbayes.report.run_directory import json_text, require_writable, write_whole
from jointbayes.studies.planning.plan import Plan
from jointbayes.studies.planning.report import build_plan_report

__all__ = ["PLAN_MARK", "write_plan"]

#: File by which the directory of a plan is known.
PLAN_MARK = "plan.json"


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
    require_writable(target, PLAN_MARK)
    summary = plan.summary()
    report = build_plan_report(summary, datetime.datetime.now(datetime.UTC).date())
    write_whole(target, report, {PLAN_MARK: json_text(summary), "case.toml": case.text})
    return target
