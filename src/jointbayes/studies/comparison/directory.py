"""The directory of a comparison: report, numbers and cases, whole or absent."""

import datetime
import os
from collections.abc import Sequence
from pathlib import Path

from jointbayes.case.case import Case
from jointbayes.report.run_directory import json_text, require_writable, write_whole
from jointbayes.studies.comparison.report import build_comparison_report
from jointbayes.studies.comparison.result import Comparison

#: File by which the directory of a comparison is known.
COMPARISON_MARK = "compare.json"


def write_comparison(comparison: Comparison, cases: Sequence[Case], directory: str | os.PathLike[str]) -> Path:
    """Write the run directory of a comparison, whole or absent.

    Parameters
    ----------
    comparison
        What was compared.
    cases
        Its cases, whose text is kept.
    directory
        Where to write, as for `write_report`; an older comparison of the same name is replaced.

    Returns
    -------
    Path
        The directory: ``report.html``, ``report.pdf``, ``compare.json``, ``cases/*.toml``, ``figures/*.svg``.

    Raises
    ------
    CaseError
        If the directory exists and holds no comparison.
    """
    target = Path(directory)
    require_writable(target, COMPARISON_MARK)
    summary = comparison.summary()
    report = build_comparison_report(summary, datetime.datetime.now(datetime.UTC).date())
    files = {COMPARISON_MARK: json_text(summary), **{f"cases/{case.name}.toml": case.text for case in cases}}
    write_whole(target, report, files)
    return target
