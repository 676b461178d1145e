"""The directory of a calibration: data sets that are done, and what they say."""

import datetime
import os
from pathlib import Path

from jointbayes.case.case import Case
from jointbayes.own_directory import real_directory
from jointbayes.report import Figure, render_html, render_pdf
from jointbayes.report.run_directory import json_text
from jointbayes.studies.calibration.kept import calibration_directory
from jointbayes.studies.calibration.report import build_calibration_report, ranks_csv
from jointbayes.studies.calibration.result import Calibration
from jointbayes.whole_file import write_whole_file

__all__ = ["write_calibration"]


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
    files = {"report.html": render_html(report).encode(), "report.pdf": render_pdf(report)}
    files["ranks.csv"] = ranks_csv(calibration).encode()
    if case is not None:
        files["case.toml"] = case.text.encode()
    for block in report.blocks():
        if isinstance(block, Figure):
            files[f"figures/{block.identifier}.svg"] = block.svg.encode()
    files["summary.json"] = json_text(calibration.summary()).encode()  # last: where it is, all the rest is
    with calibration_directory(target):
        real_directory(target / "figures")
        for name, content in files.items():
            write_whole_file(target / name, content)
    return target
