"""The report of a plan: what to measure next, from the numbers of `plan.json`."""

import datetime
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas

from jointbayes.report.figures import svg
from jointbayes.report.format import number
from jointbayes.report.model import SERIES_COLOURS, Callout, Figure, Paragraph, Report, Section, Table

__all__ = ["build_plan_report", "candidate_table"]

Entry = Mapping[str, Any]


def candidate_table(summary: Mapping[str, Any]) -> Table:
    """Each candidate alone, best first, and the best set where it has more than one measurement."""
    parameter = summary["parameter"]
    entries = list(summary["candidates"])
    for key in ("best_set", "best_by_gain"):
        if summary[key]["names"] not in [e["names"] for e in entries]:
            entries.append(summary[key])
    return Table(
        f"Further measurements and what they do to ln {parameter}",
        (
            "Candidate",
            "Gain (bits)",
            f"sd of ln {parameter}",
            "Verdict after",
            "Confirmed",
            "Simulated sd (80 %)",
            "Simulated gain",
        ),
        tuple(_row(e) for e in entries),
        align="lllllll",
        note="Gain and sd: before the measurement, by Fisher information. Simulated: expected over simulated "
        "measurements, with the Monte Carlo error and the central 80 % of the sd. Confirmed: the two sds agree within a"
        " factor of 1.25. The verdict is of the simulated sd where there is one.",
    )


def _row(entry: Entry) -> tuple[str, ...]:
    change = f"{number(entry['sd_before'])} → {number(entry['sd_after'])}"
    found = entry["simulated"]
    start = (" + ".join(entry["names"]), number(entry["gain_bits"]), change, entry["verdict_after"])
    if found is None:
        return (*start, "not asked", "–", "–")
    if not found["valid"]:
        return (*start, f"{found['lost']} of {found['simulated']} lost", "–", "–")
    low, high = found["sd_range80"]
    simulated = (
        f"{number(found['sd_before'])} → {number(found['sd_after'])} ± {number(found['sd_after_error'], 1)} "
        f"({number(low)} to {number(high)})"
    )
    gain = f"{number(found['gain_bits'])} ± {number(found['gain_bits_error'], 1)}"
    said = "yes" if entry["confirmed"] else f"no, {found['sd_after'] / entry['sd_after']:.2g} ×"
    return (*start, said, simulated, gain)


def build_plan_report(summary: Mapping[str, Any], date: datetime.date) -> Report:
    """Build the report of a plan from its summary, the sentence first."""
    parameter = summary["parameter"]
    entries: Sequence[Entry] = summary["candidates"]
    how = (
        "Measurements that are independent given the parameters add their Fisher information. It is taken "
        f"at {'the assumed joint' if summary['assumed'] else 'the mode of the present posterior'}, with the noise law "
        "of the case on the FRFs of the model; the nuisances are marginalised. The gain is ½ ln det of the covariance "
        "of the joint's coordinates before over after."
    )
    check = (
        "Fisher information is of one point and takes the posterior for Gaussian. For the candidates that were asked "
        "about, measurements were therefore simulated, with noise, for "
        f"{'the assumed joint' if summary['assumed'] else 'joints drawn from the present posterior'}, and the "
        "posterior of the data in hand together with each was found by importance sampling."
    )
    sections = (
        Section("candidates", "Candidates", (candidate_table(summary), _figure(entries, parameter))),
        Section("method", "How this was found", (Paragraph(how), Paragraph(check))),
    )
    best = summary["candidates"] + [summary["best_set"]]
    verdict = next(e["verdict_after"] for e in best if e["names"] == summary["best"])
    kind = {"identified": "good", "weakly identified": "caution"}.get(verdict, "bad")
    lead = Callout("good" if kind == "good" else "caution" if kind == "caution" else "bad", summary["sentence"])
    return Report(
        title=summary["title"],
        subtitle=f"What to measure next to know {parameter}",
        lead=(lead, Callout("caution", summary["note"])) if summary["note"] else (lead,),
        sections=sections,
        date=date,
        version=version("jointbayes"),
    )


def _figure(entries: Sequence[Entry], parameter: str) -> Figure:
    names = [" + ".join(e["names"]) for e in entries]
    alt = f"Bars of the standard deviation of ln {parameter} after each further measurement: " + ", ".join(
        f"{name} {number(e['sd_after'])}" for name, e in zip(names, entries, strict=True)
    )
    caption = (
        f"Standard deviation of ln {parameter} after each further measurement: by Fisher information (bars), and of "
        "simulated measurements (points: expected; lines: central 80 %). Dashed: now."
    )
    return Figure("plan", caption, alt, plan_bars(entries, parameter))


def plan_bars(entries: Sequence[Entry], parameter: str) -> str:
    """One bar for each candidate, best on top, on a logarithmic axis; simulated ones as points with their range."""

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        place = np.arange(len(entries))[::-1]
        after = [e["sd_after"] if e["sd_after"] is not None else np.nan for e in entries]
        axes.barh(place, after, height=0.6, color=SERIES_COLOURS[0], label="Fisher information")
        asked = [(y, e["simulated"]) for y, e in zip(place, entries, strict=True) if e["simulated"]]
        known = [(y, s) for y, s in asked if s["sd_after"] is not None]
        if known:
            rows = [y for y, _ in known]
            low, high = np.array([s["sd_range80"] for _, s in known]).T
            axes.hlines(rows, low, high, color=SERIES_COLOURS[1], lw=2)
            middle = [s["sd_after"] for _, s in known]
            axes.plot(middle, rows, "o", ms=5, color=SERIES_COLOURS[1], label="simulated")
        if entries[0]["sd_before"] is not None:
            axes.axvline(entries[0]["sd_before"], color="0.4", ls="--", lw=1, label="now")
        axes.set_xscale("log")
        axes.set_yticks(place, [" + ".join(e["names"]) for e in entries])
        axes.set_xlabel(f"Standard deviation of ln {parameter}")
        axes.legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)

    return svg(draw, 6.2, 1.2 + 0.3 * len(entries))
