"""The report of a campaign: HTML, PDF, figures and numbers, each file whole, beside the cases they are about."""

import datetime
import os
from importlib.metadata import version
from pathlib import Path

from jointbayes.own_directory import real_directory
from jointbayes.report import Figure, Report, render_html, render_pdf
from jointbayes.report.markup import foreign
from jointbayes.report.run_directory import json_text
from jointbayes.studies.campaign.findings import CampaignFindings, examine_campaign
from jointbayes.studies.campaign.sections import campaign_lead, campaign_sections
from jointbayes.studies.campaign.summary import campaign_summary, joints_csv
from jointbayes.whole_file import write_whole_file

_OURS = ("population", "control-", "ranking-")  # figures of an earlier report have such names


def build_campaign_report(name: str, findings: CampaignFindings, date: datetime.date) -> Report:
    """Build the report of a campaign, verdict first.

    Parameters
    ----------
    name
        Of the campaign.
    findings
        What `examine_campaign` found.
    date
        Date of the report.
    """
    return Report(
        title=f"Campaign {foreign(name)}",
        subtitle="Stiffness of many joints, and of the population they come from",
        lead=campaign_lead(findings),
        sections=campaign_sections(findings),
        date=date,
        version=version("jointbayes"),
    )


def write_campaign_report(directory: str | os.PathLike[str], seed: int = 1) -> Path:
    """Write the report of a campaign into its directory.

    Everything is made before the first file is replaced, and each file is whole or as it was: a campaign that is
    restarted replaces its report, one that is cut off keeps the last.

    Parameters
    ----------
    directory
        Of the campaign: ``index.parquet`` and ``cases/*.nc``, as `jointbayes campaign` leaves them.
    seed
        Of the random numbers that the population is drawn with.

    Returns
    -------
    Path
        The directory, now with ``report.html``, ``report.pdf``, ``summary.json``, ``joints.csv`` and
        ``figures/*.svg``.

    Raises
    ------
    MeasurementError
        If there is no campaign in the directory.
    WriteError
        If a file cannot be written.
    """
    target = Path(directory)
    findings = examine_campaign(target, seed)
    name = target.resolve().name or "campaign"
    report = build_campaign_report(name, findings, datetime.datetime.now(datetime.UTC).date())
    drawn = {f"{block.identifier}.svg": block.svg for block in report.blocks() if isinstance(block, Figure)}
    contents = {
        **{f"figures/{file}": svg.encode() for file, svg in drawn.items()},
        "joints.csv": joints_csv(findings).encode(),
        "summary.json": json_text(campaign_summary(name, findings)).encode(),
        "report.pdf": render_pdf(report),
        "report.html": render_html(report).encode(),
    }
    figures = real_directory(target / "figures")
    for file, content in contents.items():
        write_whole_file(target / file, content)
    for old in figures.glob("*.svg"):
        if old.name not in drawn and old.name.startswith(_OURS):
            old.unlink()
    return target
