"""The directory of a study, and what the pages of all studies share."""

import os
from collections.abc import Mapping
from pathlib import Path

from jointbayes.inference import Problem
from jointbayes.posterior import package_versions
from jointbayes.report import Report
from jointbayes.report.markup import foreign
from jointbayes.report.model import Figure, ReportSection, Table
from jointbayes.report.run_directory import write_into
from jointbayes.report.structure_sketch import sketch
from vibrecords.files import OwnDirectory


def sketch_figure(tested: Problem | None) -> tuple[Figure, ...]:
    """Return the sketch of a test as a figure of a study's page, or None for a structure without a known shape."""
    drawing, text = sketch(tested) if tested else "", "The structure with its joint, sensors and force."
    return (Figure("structure", text, text, drawing),) if drawing else ()


def settings_section(*settings: tuple[str, str]) -> ReportSection:
    """The last section of a study's page: settings by name, and the version of all that its numbers depend on."""
    versions = foreign(", ".join(" ".join(each) for each in package_versions().items()))
    table = Table("Settings and versions", ("Item", "Value"), (*settings, ("Versions", versions)), align="ll")
    return ReportSection("settings", "Settings", (table,))


def write_study(directory: str | os.PathLike[str], kind: str, report: Report, files: Mapping[str, str]) -> Path:
    """Write the report of a study into its directory, and the files in their order, each whole or absent.

    Parameters
    ----------
    directory
        New, or of an earlier start.
    kind
        What the directory holds: ``"a plan"``.
    report
        ``report.html``, ``report.pdf`` and ``figures/*.svg``.
    files
        Text of further files by name; the last one tells that all are there.

    Raises
    ------
    WriteError
        If a file cannot be written, the directory holds something else, or another process is at work in it.
    """
    with OwnDirectory(directory, kind) as locked:
        write_into(locked.path, report, files)
    return locked.path
