"""The posterior in numbers, its marginals and pairs, and whatever else was uncertain."""

from collections.abc import Iterable

import numpy as np

from jointbayes.phrases import published_values
from jointbayes.posterior import Posterior
from jointbayes.posterior.posterior import region_level
from jointbayes.posterior.sampled import prior_stiffness
from jointbayes.posterior.summary import Summary
from jointbayes.report import drawing
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import foreign, readable
from jointbayes.report.model import Block, Figure, Paragraph, ReportSection, Table
from jointbayes.rounding import contraction, fixed, interval, number
from vibrecords.arrays import Array

_MOST_IN_CORNER = 6  # coordinates of a figure in which each can be read


def posterior_section(inputs: ReportInputs) -> ReportSection:
    """Marginals, pairs, prior and the full table."""
    posterior, reference = inputs.posterior, inputs.reference
    blocks = list[Block]()
    labels, draws, prior, published, mode = corner_values(posterior)
    widest = np.sort(np.argsort(-draws.std(axis=0))[:_MOST_IN_CORNER])
    point = None if published is None else published[widest]
    of_widest = ([labels[i] for i in widest], draws[:, widest], prior[:, widest], point, mode[widest])
    svg = drawing.corner_plot(*of_widest)
    marks = "mode (orange, solid)"
    few = f" The {len(widest)} of {len(labels)} that are known least." if len(widest) < len(labels) else ""
    if published is not None:
        marks += f", published values (green, dashed; {inputs.reference_source})"
    blocks.append(
        Figure(
            "corner",
            f"Posterior of the logarithms: marginals and pairs with contours of 39, 68 and 95 % of the draws; "
            f"prior (grey, dotted), {marks}.{few}",
            "Corner plot of the posterior of the joint stiffnesses with prior density, mode and published values.",
            svg,
        )
    )
    blocks.append(Paragraph(verdict_sentences(inputs.summary, beside=inputs.knowledge.workshop is None)))
    if reference is not None:
        level = region_level(posterior, reference)
        blocks.append(Paragraph(f"The published values {published_values(level)}."))
    return ReportSection("posterior", "Posterior", tuple(blocks))


def corner_values(posterior: Posterior) -> tuple[list[str], Array, Array, Array | None, Array]:
    """Labels of the joint's coordinates, and draws, prior draws, published values and mode in their terms."""
    parametrisation = posterior.problem.parametrisation
    scale = np.array([axis.axis_scale for axis in parametrisation.axes])
    draws, prior = (parametrisation.coordinates(k) * scale for k in (posterior.stiffness, prior_stiffness(posterior)))
    point, reference = None, None if posterior.case is None else posterior.case.reference
    if reference is not None and parametrisation.describes(reference):
        point = parametrisation.coordinates(reference) * scale
    mode = posterior.problem.prior.joint(posterior.best.theta) * scale
    return [axis.axis_label for axis in parametrisation.axes], draws, prior, point, mode


def numbers_section(inputs: ReportInputs) -> ReportSection:
    """How the numbers came out: prior, contraction and how well the chains know each."""
    stiffnesses, others = inputs.summary.parameters, inputs.summary.nuisances
    # 1. Of stiffnesses everything.
    of = stiffnesses.values()
    columns = {
        "Damping or stiffness" if inputs.posterior.problem.parametrisation.damped else "Stiffness": stiffnesses,
        "Joint mode": [number(p.mode, 4) for p in of],
        "MAP": [number(p.map, 4) for p in of],
        "Mean": [number(p.mean, 4) for p in of],
        "sd of ln k": [number(p.known.sd_log) for p in of],
        "Prior 95 %": [interval(p.prior_interval95, 2) for p in of],
        "Contraction": [contraction(p.known.contraction, 4) for p in of],
        "R̂": [fixed(p.r_hat, 4) for p in of],
        "ESS bulk": [fixed(p.ess_bulk, 0) for p in of],
        "ESS tail": [fixed(p.ess_tail, 0) for p in of],
    }
    note = "Joint mode, MAP and mean in the stiffness's unit."
    tables = [Table.of("Posterior in numbers", columns, note=f"{note} {_what_contraction_is(columns['Contraction'])}")]
    # 2. Of all else how it was drawn.
    if others:
        columns = {
            "Quantity": [foreign(readable(name)) for name in others],
            "Contraction": [contraction(n.contraction, 2) for n in others.values()],
            "R̂": [fixed(n.r_hat, 4) for n in others.values()],
            "ESS bulk": [fixed(n.ess_bulk, 0) for n in others.values()],
            "ESS tail": [fixed(n.ess_tail, 0) for n in others.values()],
        }
        note = _what_contraction_is(columns["Contraction"])
        tables.append(Table.of("Other uncertain quantities, drawn", columns, note=note))
    return ReportSection("numbers", "Posterior in numbers", tuple(tables))


def _what_contraction_is(shown: Iterable[str]) -> str:
    none = "; none where the posterior is as wide as the prior or wider" if "none" in shown else ""
    return f"Contraction: 1, all from the test; 0, all from the prior{none}."


def nuisance_section(inputs: ReportInputs) -> ReportSection | None:
    """Prior and posterior of whatever else is uncertain; None where nothing is."""
    nuisances = inputs.summary.nuisances
    if not nuisances:
        return None
    of = nuisances.values()
    columns = {
        "Quantity": [foreign(readable(name)) for name in nuisances],
        "Stated": [number(n.nominal, 4) for n in of],
        "Prior 95 %": [interval(n.prior_interval95, 4) for n in of],
        "Median": [number(n.median, 4) for n in of],
        "Posterior 95 %": [interval(n.interval95, 4) for n in of],
        "Unit": [foreign(n.unit) for n in of],
    }
    table = Table.of("Other uncertain quantities", columns)
    return ReportSection("nuisances", "What else was uncertain", (table,))


def verdict_sentences(summary: Summary, *, beside: bool = True) -> str:
    """Each stiffness's verdict with its reasons, a sentence each; `beside`: also without what it takes as exact."""
    sentences = []
    for name, p in summary.parameters.items():
        reasons = [*map(str, p.known.reasons), *([p.known.next_to_it] if beside and p.known.next_to_it else [])]
        sentences.append(f"**{name}**: {p.known.words} ({'; '.join(reasons)}).")
    return " ".join(sentences)
