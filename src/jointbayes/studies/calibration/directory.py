"""The directory of a calibration: data sets that are done, and what they say."""

import datetime
import os
from pathlib import Path

from jointbayes.case.case import Case
from jointbayes.report.run_directory import json_text, write_into
from jointbayes.studies.calibration.kept import calibration_directory
from jointbayes.studies.calibration.report import build_calibration_report, ranks_csv
from jointbayes.studies.calibration.result import Calibration


def write_calibration(calibration: Calibration, directory: str | os.PathLike[str], case: Case | None = None) -> Path:
    """Write what a calibration found into its directory, beside the data sets that are kept there.

    Parameters
    ----------
    calibration
        The calibration.
    directory
        The one that `calibrate` was given, or any other. Each file is whole or absent.
    case
        The case that was calibrated, for its title and text.

    Returns
    -------
    Path
        The directory: ``report.html``, ``report.pdf``, ``summary.json``, ``ranks.csv``, ``case.toml`` of a case, and
        ``figures/ranks.svg``.

    Raises
    ------
    WriteError
        If a file cannot be written, the directory holds something else, or another process is at work in it.
    """
    target = Path(directory)
    title = case.title if case is not None else calibration.name
    report = build_calibration_report(calibration, title, datetime.datetime.now(datetime.UTC).date())
    files = {"ranks.csv": ranks_csv(calibration)}
    if case is not None:
        files["case.toml"] = case.text
    files["summary.json"] = json_text(calibration.summary())  # last: where it is, all the rest is
    with calibration_directory(target):
        write_into(target, report, files)
    return target
