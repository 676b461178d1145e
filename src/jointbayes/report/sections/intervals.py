"""The posterior in numbers, its marginals and pairs, and whatever else was uncertain."""

import numpy as np

from jointbayes.posterior.rounding import contraction, fixed, interval, number
from jointbayes.report import figures
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import foreign, readable
from jointbayes.report.model import Block, Figure, Paragraph, ReportSection, Table


def posterior_section(inputs: ReportInputs) -> ReportSection:
    """Marginals, pairs, prior and the full table."""
    posterior, reference = inputs.posterior, inputs.reference
    blocks: list[Block] = [_table(inputs), Paragraph(inputs.summary.map.mode_sentence)]
    parametrisation = posterior.problem.parametrisation
    scale = np.array([axis.axis_scale for axis in parametrisation.axes])
    draws, prior = (parametrisation.coordinates(k) * scale for k in (posterior.stiffness, posterior.prior_stiffness))
    point = None
    if reference is not None and parametrisation.describes(reference):
        point = parametrisation.coordinates(reference) * scale
    mode = posterior.problem.prior.joint(posterior.mode_theta) * scale
    labels = [axis.axis_label for axis in parametrisation.axes]
    svg = figures.corner_plot(labels, draws, prior, point, mode)
    marks = "mode (orange, solid)"
    if point is not None:
        marks += f", published values (green, dashed; {inputs.reference_source})"
    blocks.append(
        Figure(
            "corner",
            f"Posterior of the logarithms: marginals and pairs with contours of 39, 68 and 95 % of the draws; "
            f"prior (grey, dotted), {marks}.",
            "Corner plot of the posterior of the joint stiffnesses with prior density, mode and published values.",
            svg,
        )
    )
    if reference is not None:
        level = posterior.region_level(reference)
        blocks.append(
            Paragraph(f"The published point lies on the edge of the {100 * level:.1f} % highest-density region.")
        )
    return ReportSection("posterior", "Posterior", tuple(blocks))


def _table(inputs: ReportInputs) -> Table:
    """The full table."""
    head = (
        "Quantity" if inputs.posterior.problem.parametrisation.damped else "Stiffness",
        "Joint mode",
        "MAP",
        "Mean",
        "sd of ln k",
        "Prior 95 %",
        "Contraction",
        "R̂",
        "ESS bulk",
        "ESS tail",
    )
    rows = tuple(
        (
            name,
            number(p.mode, 4),
            number(p.map, 4),
            number(p.mean, 4),
            number(p.known.sd_log),
            interval(p.prior_interval95, 2),
            contraction(p.known.contraction, 4),
            fixed(p.r_hat, 4),
            fixed(p.ess_bulk, 0),
            fixed(p.ess_tail, 0),
        )
        for name, p in inputs.summary.parameters.items()
    )
    note = (
        "Joint mode, MAP and mean in the stiffness's unit, see above. Contraction: the share of the prior's variance "
        "of ln k (of k12 itself where it has both signs) that the data removed; none where the posterior is as wide as "
        "the prior or wider, because the data favour values near the prior's ends."
    )
    return Table("Posterior in numbers", head, rows, note=note)


def nuisance_section(inputs: ReportInputs) -> ReportSection | None:
    """Prior and posterior of whatever else is uncertain; None where nothing is."""
    nuisances = inputs.summary.nuisances
    if not nuisances:
        return None
    rows = tuple(
        (
            foreign(readable(name)),
            number(n.nominal, 4),
            interval(n.prior_interval95, 4),
            number(n.median, 4),
            interval(n.interval95, 4),
            foreign(n.unit),
            contraction(n.contraction, 2),
            fixed(n.r_hat, 3),
        )
        for name, n in nuisances.items()
    )
    head = ("Quantity", "Stated", "Prior 95 %", "Median", "Posterior 95 %", "Unit", "Contraction", "R̂")
    note = (
        "Contraction 0: the data say nothing about it, and the posterior is the prior; near 1: the data determine it; "
        "none: the posterior is as wide as the prior or wider."
    )
    return ReportSection(
        "nuisances",
        "What else was uncertain",
        (Table("Other uncertain quantities", head, rows, note=note),),
    )
