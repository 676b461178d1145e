"""The directory of a plan: simulations that are done, and what they say."""

import datetime
import os
from pathlib import Path

from jointbayes.case.case import Case
from jointbayes.report.run_directory import json_text, write_into
from jointbayes.studies.planning.plan import Plan
from jointbayes.studies.planning.race import plan_directory
from jointbayes.studies.planning.report import build_plan_report


def write_plan(plan: Plan, case: Case, directory: str | os.PathLike[str]) -> Path:
    """Write a plan into its directory, beside the simulations that are kept there.

    Parameters
    ----------
    plan
        The plan.
    case
        Its case, whose text is kept.
    directory
        The one that `plan` was given, or any other. Each file is whole or absent.

    Returns
    -------
    Path
        The directory: ``report.html``, ``report.pdf``, ``plan.json``, ``case.toml``, ``figures/plan.svg``.

    Raises
    ------
    WriteError
        If a file cannot be written, the directory holds something else, or another process is at work in it.
    """
    target = Path(directory)
    summary = plan.summary()
    report = build_plan_report(summary, datetime.datetime.now(datetime.UTC).date())
    # plan.json last: where it is, all the rest is
    with plan_directory(target):
        write_into(target, report, {"case.toml": case.text, "plan.json": json_text(summary)})
    return target
