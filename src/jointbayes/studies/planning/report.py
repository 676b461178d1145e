"""The report of a plan: what to measure next, from the numbers of `plan.json`."""

import datetime
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas

from jointbayes.posterior.information.directions import spread_in_words
from jointbayes.posterior.rounding import number
from jointbayes.report.canvas import legend_above, margin_labels, panels, svg
from jointbayes.report.markup import foreign
from jointbayes.report.model import SERIES_COLOURS, Callout, Figure, Kind, Paragraph, Report, Section, Table
from jointbayes.studies.planning.plan import Plan

Entry = Mapping[str, Any]


def candidate_table(summary: Mapping[str, Any]) -> Table:
    """Each measurement: simulated ones by their median standard deviation, then those that were not simulated."""
    parameter, now = summary["parameter"], summary["now"]
    present = ("(now)", "", spread_in_words(now["sd"]), number(now["sd"]), now["verdict"], "present posterior")
    rows = [_row(entry, summary["recommended"]) for entry in summary["measurements"]]
    return Table(
        f"Further measurements and how well {parameter} would then be known",
        (
            "Measurement",
            "Position",
            f"{parameter} known to (80 %)",
            f"sd of ln {parameter} (80 %)",
            "Verdict then",
            "Based on",
        ),
        (*rows, present),
        align="llllll",
        note="Median over simulated measurements, and the range that holds 80 % of them. Linearised: ranked by Fisher "
        "information alone, and never recommended.",
    )


def plan_lines(plan: Plan) -> list[str]:
    """A plan as lines for the terminal: the table, the recommendation and notes."""
    table = candidate_table(plan.summary())
    return [*table.lines(), table.note, "", plan.sentence, *plan.notes]


def _row(entry: Entry, recommended: Sequence[str] | None) -> tuple[str, ...]:
    names = foreign(" + ".join(entry["names"])) + (" (recommended)" if entry["names"] == recommended else "")
    where = foreign(" + ".join(place for place in entry["positions"] if place))
    simulated = entry["simulated"]
    if simulated is None:
        sd = entry["linearised"]["median"]
        return names, where, "–", f"about {number(sd)} (linearised)", "–", "not simulated"
    if not simulated["valid"]:
        return names, where, "–", "–", "–", f"{simulated['lost']} of {simulated['truths']} simulations failed"
    low, high = simulated["sd_range80"]
    known = f"{spread_in_words(simulated['sd_median'])} ({spread_in_words(low)} to {spread_in_words(high)})"
    sds = f"{number(simulated['sd_median'])} ({number(low)} to {number(high)})"
    count = simulated["truths"] - simulated["lost"]
    return names, where, known, sds, simulated["verdict"], f"{count} simulations"


def build_plan_report(summary: Mapping[str, Any], date: datetime.date) -> Report:
    """Build the report of a plan from its summary, the recommendation first."""
    parameter = summary["parameter"]
    entries: Sequence[Entry] = summary["measurements"]
    source = "the stated joint" if summary["assumed"] else "joints drawn from the present posterior"
    how = (
        f"Each measurement was simulated, with noise, for {source}, the same ones for all candidates; the posterior "
        "of the data in hand together with each simulated measurement was computed by reweighting draws of the present "
        "posterior, or by importance sampling where too few of them stayed effective. The ranges hold 80 % of the "
        "simulated measurements, so that the value found later should lie within its range in four of five cases. "
        "Candidates that could come first by their range were simulated more often."
    )
    sections = (
        Section("candidates", "Candidates", (candidate_table(summary), _figure(entries, parameter, summary["now"]))),
        Section("method", "How this was computed", (Paragraph(how),)),
    )
    kind: Kind = "bad" if not summary["converged"] else "caution" if summary["recommended"] is None else "good"
    return Report(
        title=foreign(summary["title"]),
        subtitle=f"What to measure next to know {parameter}",
        lead=(
            Callout(kind, foreign(summary["sentence"])),
            *(Callout("caution", foreign(note)) for note in summary["notes"]),
        ),
        sections=sections,
        date=date,
        version=version("jointbayes"),
    )


def _figure(entries: Sequence[Entry], parameter: str, now: Entry) -> Figure:
    simulated = [e for e in entries if e["simulated"] is not None and e["simulated"]["valid"]]
    alt = f"Standard deviation of ln {parameter} after each simulated measurement: " + ", ".join(
        f"{foreign(' + '.join(e['names']))} {number(e['simulated']['sd_median'])}" for e in simulated
    )
    caption = (
        f"Standard deviation of ln {parameter} after each measurement: every simulated one (small points), their "
        "median (large points) and the range of 80 % (lines). Crosses: linearised, of those that were not simulated. "
        "Dashed: now."
    )
    return Figure("plan", caption, alt, _ranges(entries, parameter, now))


def _ranges(entries: Sequence[Entry], parameter: str, now: Entry) -> str:
    """One line for each measurement, best on top, on a logarithmic axis."""

    def draw(canvas: Canvas) -> None:
        labels, margin = margin_labels([" + ".join(e["names"]) for e in entries])
        axes = panels(canvas, left=margin, top=0.3)[0, 0]
        place = np.arange(len(entries))[::-1]
        colour = SERIES_COLOURS[0]
        for y, entry in zip(place, entries, strict=True):
            simulated = entry["simulated"]
            if simulated is not None and simulated["valid"]:
                sds = [sd for sd in simulated["sds"] if sd is not None]
                axes.hlines(y, *simulated["sd_range80"], color=colour, lw=2)
                axes.plot(sds, np.full(len(sds), y), "o", ms=2.5, color=SERIES_COLOURS[1], alpha=0.6)
                axes.plot(simulated["sd_median"], y, "o", ms=6, color=colour)
            elif simulated is None and entry["linearised"]["median"] is not None:
                axes.plot(entry["linearised"]["median"], y, "x", ms=6, color="0.4")
        axes.axvline(now["sd"], color="0.4", ls="--", lw=1, label="now")
        axes.set_xscale("log")
        axes.set_yticks(place, labels)
        axes.set_ylim(-0.6, len(entries) - 0.4)
        axes.set_xlabel(f"Standard deviation of ln {parameter}")
        legend_above(axes)

    return svg(draw, 6.2, 1.2 + 0.3 * len(entries))
