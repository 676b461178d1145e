"""The report of a calibration: verdict, ranks with their bands, coverage, and what became of the data sets."""

import csv
import datetime
import io
from collections.abc import Sequence
from importlib.metadata import version

from matplotlib.figure import Figure as Canvas

from jointbayes.posterior.rounding import number
from jointbayes.report.canvas import panels, svg
from jointbayes.report.model import SERIES_COLOURS, Callout, Figure, Kind, Paragraph, Report, Section, Table
from jointbayes.studies.calibration.data_set import DRAWS
from jointbayes.studies.calibration.ranks import QuantityCalibration
from jointbayes.studies.calibration.result import FALSE_ALARM, SUSPICIOUS, Calibration

_COLUMNS = 4
_FIGURE = "ranks"


def calibration_table(calibration: Calibration) -> Table:
    """Each quantity: whether its ranks stay inside the band, and how often its intervals held the truth."""
    rows = []
    for one in calibration.quantities:
        low, high = one.coverage.interval95
        rows.append(
            (
                one.name,
                "inside" if one.inside_band else f"OUTSIDE: {one.finding}",
                f"{one.p_value:.2g}",
                f"{one.largest_deviation:+.3f}",
                f"{100 * one.coverage.share:.1f} % ({100 * low:.1f} to {100 * high:.1f})",
            )
        )
    return Table(
        "Ranks of the truths, and 95 % intervals that held them",
        ("Quantity", "Ranks and band", "p", "Largest deviation", "Intervals that held the truth"),
        tuple(rows),
        align="llrrr",
        note="In brackets what so many data sets can tell of the share (95 %). A deviation above 0: draws lie above "
        f"the truths. The bands are those of {len(rows)} quantities together, p is that of each by itself.",
        row_kinds=tuple("good" if one.inside_band else "bad" for one in calibration.quantities),
    )


def calibration_lines(calibration: Calibration) -> list[str]:
    """A calibration as lines for the terminal."""
    return [*calibration_table(calibration).lines(), *calibration.notes, calibration.verdict]


def build_calibration_report(calibration: Calibration, title: str, date: datetime.date) -> Report:
    """Build the report, the verdict first."""
    suspicious = calibration.p_value < SUSPICIOUS or bool(calibration.notes)
    kind: Kind = "bad" if not calibration.passed else "caution" if suspicious else "good"
    sections = (
        Section("quantities", "Ranks and coverage", (calibration_table(calibration), _figure(calibration))),
        Section("data-sets", "Data sets", (_data_sets(calibration),)),
        Section("method", "How this was computed", tuple(Paragraph(text) for text in _method(calibration))),
    )
    source = f", by data of {calibration.source}" if calibration.source else ""
    return Report(
        title=title,
        subtitle=f"Calibration of the analysis of {calibration.name}{source}",
        lead=(Callout(kind, calibration.verdict), *(Callout("caution", note) for note in calibration.notes)),
        sections=sections,
        date=date,
        version=version("jointbayes"),
    )


def _method(calibration: Calibration) -> tuple[str, ...]:
    truths = calibration.source or "the case"
    return (
        f"Truths were drawn from the priors of {truths}, of the joint and of all else that is uncertain, and data from "
        "its likelihood at its own lines. Each data set was analysed like the case itself, from the search for the "
        "mode to the draws; the sampler ended with fewer draws than a run's, enough for ranks. If prior, likelihood "
        "and sampler are right, the rank of the truth among draws is uniform, for each quantity and for the log "
        "density, and a 95 % interval holds the truth in 95 % of the cases (Talts et al. 2018, arXiv:1804.06788).",
        f"The rank is that among {DRAWS} draws picked at random. Bands for the empirical distribution of uniform ranks "
        "are exact and simultaneous over all positions (Säilynoja et al. 2022, DOI 10.1007/s11222-022-10090-6). Each "
        f"has the level 1 − {FALSE_ALARM:g}/{len(calibration.names)}, so that in at least "
        f"{100 * (1 - FALSE_ALARM):.0f} % of right analyses the ranks of all quantities stay inside, however they "
        "depend on each other (Bonferroni). "
        "Coverage has no part in the verdict: it follows from the ranks.",
        "Data sets whose sampler did not converge are ranked like the others; those whose analysis failed count as "
        "intervals that missed, with ranks at the end that looks worse.",
        f"Seed {calibration.seed}. Data set i depends on the seed and i alone, not on how many there are.",
    )


def _data_sets(calibration: Calibration) -> Table:
    summary = calibration.summary()
    rows = (
        ("analysed", str(len(calibration.analysed))),
        ("failed", str(calibration.failed)),
        ("sampler not converged", str(calibration.not_converged)),
        ("joint mode and MAP agree", str(summary["mode_agrees"])),
        ("effective draws, median", number(summary["median_ess"])),
        ("processor time of each, median", f"{summary['median_seconds']:.2g} s"),
        ("processor time of all", f"{summary['total_seconds'] / 60:.3g} min"),
    )
    return Table(f"What became of {len(calibration.data_sets)} data sets", ("", "Data sets"), rows, align="lr")


def _figure(calibration: Calibration) -> Figure:
    quantities = calibration.quantities
    words = "; ".join(f"{one.name} {'inside' if one.inside_band else 'outside'}" for one in quantities)
    caption = (
        "Empirical distribution of the ranks less the uniform one, with its simultaneous band. Above 0 throughout: "
        "draws lie above the truths. Above 0 on the left and below on the right: posteriors are too narrow."
    )
    return Figure(_FIGURE, caption, f"Ranks of the truths and their bands: {words}.", ranks_figure(quantities))


def ranks_figure(quantities: Sequence[QuantityCalibration]) -> str:
    """SVG text: for each quantity the distribution of its ranks less the uniform one, in its band."""
    columns = min(_COLUMNS, len(quantities))
    rows = -(-len(quantities) // columns)

    def draw(canvas: Canvas) -> None:
        axes = panels(canvas, rows, columns, top=0.25, apart=(0.3, 0.15), sharex=True, sharey=True)
        for ax, one in zip(axes.ravel(), quantities, strict=False):
            u, colour = one.band.position, SERIES_COLOURS[0 if one.inside_band else 1]
            ax.fill_between(u, one.band.low - u, one.band.high - u, step="post", color="0.85", lw=0)
            ax.step(u, one.shares - u, where="post", lw=1.0, color=colour)
            ax.set_title(one.name if one.inside_band else f"{one.name}: outside", fontsize=8)
        for ax in axes.ravel()[len(quantities) :]:
            ax.set_axis_off()
        for ax in axes[:, 0]:
            ax.set_ylabel("ECDF − uniform")
        for i, ax in enumerate(axes.ravel()[: len(quantities)]):
            if i + columns >= len(quantities):
                ax.set_xlabel("rank / draws")
                ax.tick_params(labelbottom=True)

    return svg(draw, 1.0 + 1.8 * columns, 0.6 + 1.7 * rows)


def ranks_csv(calibration: Calibration) -> str:
    """One row for each data set: what became of it, and truth, rank and interval of each quantity."""
    names = calibration.names
    stream = io.StringIO()
    table = csv.writer(stream, lineterminator="\n")
    each = [f"{name}.{part}" for name in names for part in ("rank", "truth", "low95", "high95")]
    table.writerow(["data_set", "status", "converged", "ess", "seconds", "error", *each])
    for one in calibration.data_sets:
        if one.error:
            table.writerow([one.index, "failed", "", "", round(one.seconds, 3), one.error, *[""] * len(each)])
            continue
        values = [x for parts in zip(one.rank, one.truth, one.low, one.high, strict=True) for x in parts]
        status = [one.index, "done", str(one.converged).lower(), round(one.ess, 1), round(one.seconds, 3), ""]
        table.writerow([*status, *values])
    return stream.getvalue()
