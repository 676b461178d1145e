"""The report of a campaign and its numbers, each file whole, beside the cases that they are about."""

import csv
import io
import os
from pathlib import Path
from typing import Any

import numpy as np

from jointbayes.posterior import package_versions
from jointbayes.posterior.rounding import json_ready
from jointbayes.report import Figure, Report
from jointbayes.report.markup import foreign
from jointbayes.report.run_directory import json_text, write_into
from jointbayes.studies.campaign.campaign_findings import (
    CampaignFindings,
    PopulationFindings,
    examine_campaign,
)
from jointbayes.studies.campaign.campaign_sections import campaign_lead, campaign_sections
from jointbayes.studies.campaign.hierarchical import LEAST_EFFECTIVE, PopulationStiffness
from jointbayes.studies.campaign.index import DONE
from jointbayes.studies.campaign.outliers import FALSE_ALARM, ComparedQuantity

#: Raised when a reader of the older form would misread the newer one.
SCHEMA_VERSION = 1
_INTERVAL = ("median", "low95", "high95")


def campaign_summary(name: str, findings: CampaignFindings) -> dict[str, Any]:
    """What ``summary.json`` of a campaign holds: no NaN or infinity, None where a number does not exist."""
    joints = findings.joints
    return json_ready(
        {
            "schema_version": SCHEMA_VERSION,
            "campaign": name,
            "counts": dict(findings.counts),
            "population": None if joints is None else _population(joints),
            "outliers": {} if joints is None else {q.name: _outliers(joints, q) for q in joints.quantities},
            "left_out": dict(findings.left_out),
            "need_a_look": [
                {"key": look.row.key, "serial": look.row.serial, "status": look.row.status, "reasons": look.reasons}
                for look in findings.look
            ],
            "versions": package_versions(),
        }
    )


def _population(joints: PopulationFindings) -> dict[str, Any]:
    population, prior, names = joints.population, joints.prior, joints.draws.parametrisation.names
    mean, scatter = (
        np.quantile(values, [0.5, 0.025, 0.975], axis=0).T for values in (population.mean, population.scatter)
    )
    return {
        "joints": len(joints.draws.rows),
        "parametrisation": joints.draws.parametrisation.key,
        "how": population.how,
        "converged": population.converged,
        "effective_draws": population.effective_populations,
        "stiffness": {k.name: _stiffness(k) for k in joints.stiffness},
        "coordinates": {
            name: {
                "mean": dict(zip(_INTERVAL, mean[i], strict=True)),
                "scatter": dict(zip(_INTERVAL, scatter[i], strict=True)),
                "monte_carlo_error_of_mean_sd": population.monte_carlo[0, i],
                "monte_carlo_error_of_log_scatter_sd": population.monte_carlo[1, i],
                "prior_of_mean": {"mean": prior.mean[i], "sd": prior.sd[i]},
                "prior_of_scatter_half_normal": prior.scale[i],
            }
            for i, name in enumerate(names)
        },
        "scatter_not_resolved": [
            name for name, hidden in zip(names, population.unresolved(joints.draws.draws), strict=True) if hidden
        ],
        "least_effective_draws": LEAST_EFFECTIVE,
        "not_trusted": [row.key for row, good in zip(joints.draws.rows, population.trusted, strict=True) if not good],
    }


def _stiffness(k: PopulationStiffness) -> dict[str, Any]:
    return {
        "unit": k.unit,
        "median": dict(zip(_INTERVAL, k.median, strict=True)),
        "low_end_of_95_percent_of_joints": dict(zip(_INTERVAL, k.low95, strict=True)),
        "high_end_of_95_percent_of_joints": dict(zip(_INTERVAL, k.high95, strict=True)),
        "scatter_of": "ln k" if k.logarithmic else k.unit,
        "scatter": dict(zip(_INTERVAL, k.scatter, strict=True)),
    }


def _outliers(joints: PopulationFindings, quantity: ComparedQuantity) -> dict[str, Any]:
    spread, keys = quantity.spread, [row.key for row in joints.draws.rows]
    return {
        "scale": f"ln {quantity.name}" if quantity.logarithmic else quantity.name,
        "unit": quantity.unit,
        "centre": float(quantity.value_in_unit(np.array(spread.centre))),
        "scatter": spread.scatter,
        "limit_in_sd": quantity.outlier_limit,
        "probability_of_a_false_outlier_in_the_campaign": FALSE_ALARM,
        "outliers": [
            {"key": keys[i], "score": float(spread.score[i])}
            for i in np.flatnonzero(quantity.outlier)[np.argsort(-np.abs(spread.score[quantity.outlier]))]
        ],
    }


def joints_csv(findings: CampaignFindings) -> str:
    """One line for each case, in the order of the table; numbers that do not exist are empty."""
    joints = findings.joints
    place = {} if joints is None else {row.key: i for i, row in enumerate(joints.draws.rows)}
    quantities = () if joints is None else joints.quantities
    head = ["key", "serial", "date", "status", "converged", "explains", "need_a_look", "effective_draws"]
    found = {(name, k.unit): None for row in findings.rows for name, k in row.stiffness.items()}
    alone = [q for q in quantities if (q.name, q.unit) not in found]  # coordinates that are no stiffness
    for name, unit in found:
        in_unit = "" if unit == "1" else f" ({unit})"
        head += [*(f"{name}.{field}{in_unit}" for field in _INTERVAL), f"{name}.verdict"]
    head += [f"{q.name}.{field}{q.in_unit}" for q in alone for field in _INTERVAL]
    for q in quantities:
        head += [f"{q.name}.given_all.{field}{q.in_unit}" for field in _INTERVAL]
        head += [f"{q.name}.{field}" for field in ("score", "rank", "rank_low95", "rank_high95")]
    looks = {look.row.key: "; ".join(look.reasons) for look in findings.look}
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    for row in findings.rows:
        date = "" if row.date is None else row.date.isoformat(sep=" ")
        explains = "" if row.explains is None else str(row.explains).lower()
        converged = str(row.converged).lower() if row.status == DONE else ""
        line = [_no_formula(row.key), _no_formula(row.serial or ""), date, row.status, converged, explains]
        line.append(_no_formula(looks.get(row.key, "")))
        i = place.get(row.key)
        line.append("" if joints is None or i is None else f"{joints.population.effective[i]:.1f}")
        for name, unit in found:
            k = row.stiffness.get(name) if row.converged else None
            if k is None or k.unit != unit:
                line += [""] * 4
            else:
                line += [*(f"{value:.6g}" for value in (k.median, k.low95, k.high95)), k.verdict]
        if i is None:
            writer.writerow([*line, *[""] * (len(head) - len(line))])
            continue
        line += [f"{q.unpooled[i, k]:.6g}" for q in alone for k in (1, 0, 2)]
        for q in quantities:
            ends = (*q.shrunken[i, [1, 0, 2]], q.spread.score[i], *q.rank[i, [1, 0, 2]])
            line += [f"{value:.6g}" for value in ends]
        writer.writerow(line)
    return stream.getvalue()


def _no_formula(text: str) -> str:
    """Text that a spreadsheet shows and does not compute: behind an apostrophe where it begins as a formula does."""
    return f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\r")) else text


_OURS = ("population", "control-", "ranking-")  # figures of an earlier report have such names


def build_campaign_report(name: str, findings: CampaignFindings) -> Report:
    """Build the report of a campaign of this name, verdict first, from what `examine_campaign` found."""
    return Report(
        title=foreign(name) if name.casefold().startswith("campaign") else f"Campaign {foreign(name)}",
        subtitle="Stiffness of many joints, and of the population they come from",
        lead=campaign_lead(findings),
        sections=campaign_sections(findings),
    )


def write_campaign_report(directory: str | os.PathLike[str], seed: int = 1) -> Path:
    """Write the report of a campaign into its directory.

    Everything is made before the first file is replaced, and each file is whole or as it was: a campaign that is
    restarted replaces its report, one that is cut off keeps the last.

    Parameters
    ----------
    directory
        Of the campaign: ``index.jsonl`` and ``cases/*.nc``, as `jointbayes campaign` leaves them.
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
    report = build_campaign_report(name, findings)
    files = {"joints.csv": joints_csv(findings), "summary.json": json_text(campaign_summary(name, findings))}
    write_into(target, report, files)
    drawn = {f"{block.identifier}.svg" for block in report.blocks() if isinstance(block, Figure)}
    for old in (target / "figures").glob("*.svg"):
        if old.name not in drawn and old.name.startswith(_OURS):
            old.unlink()
    return target
