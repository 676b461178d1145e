"""What the data determine and what the verdicts rest on: combinations, uncertain quantities, likelihood limits."""

import numpy as np

from jointbayes.inference import Problem
from jointbayes.posterior import Knowledge, Posterior
from jointbayes.posterior.identifiability import Verdict
from jointbayes.posterior.information.directions import NamedDirection
from jointbayes.posterior.information.uncertain_inputs import UncertainInputsRow
from jointbayes.posterior.summary import Summary
from jointbayes.posterior.verdicts import verdict_text
from jointbayes.report import figures
from jointbayes.report.format import contraction, factor, fixed, interval, number, rounded_interval
from jointbayes.report.model import Block, Figure, Paragraph, Section, Table

__all__ = [
    "coordinate_labels",
    "freed_blocks",
    "knowledge_section",
    "likelihood_section",
    "nuisance_section",
]

_READABLE = {
    "youngs_modulus": "Young's modulus",
    "density": "density",
    "length": "length",
    "section_size": "size of the section",
    "shear_coefficient": "shear coefficient",
    "damping_ratio": "damping ratio",
    "loss_factor": "loss factor",
    "accelerometer_mass": "accelerometer mass",
    "gain": "gain",
    "noise_scale": "noise, factor on the stated",
    "discrepancy_scale": "model discrepancy, in noise sd",
    "discrepancy_length": "its correlation length",
}
_SHORT = {
    "youngs_modulus": "ln E",
    "density": "ln density",
    "length": "ln L",
    "section_size": "ln size",
    "shear_coefficient": "ln κ",
    "damping_ratio": "ln ζ",
    "loss_factor": "ln η",
    "accelerometer_mass": "ln mass",
    "noise_scale": "ln noise",
    "discrepancy_scale": "ln discr.",
    "discrepancy_length": "ln Hz",
}
_KINDS = {"identified": "good", "weakly identified": "caution", "not identified": "bad"}


def knowledge_section(posterior: Posterior, knowledge: Knowledge, summary: Summary) -> Section:
    """Which combinations are known, correlations, and what the verdicts rest on: all of it from draws."""
    blocks: list[Block] = [Paragraph(f"**{knowledge.directions_sentence}**")]
    condition = "" if knowledge.check.explains else ", if the model were right"
    rows = tuple((d.quantity, *_figures(d), _words(d.verdict, condition)) for d in knowledge.directions)
    blocks.append(
        Table(
            "Combinations of the stiffnesses that are determined independently",
            ("Combination", "95 % credible interval (SI)", "Upper/lower end", "sd of its logarithm", "Verdict"),
            rows,
            note="Computed from the draws, best known first, with the verdicts of single stiffnesses. "
            "rho = k12/√(k11 k22). A dash: draws of both signs, or a one-sided limit of 95 % probability.",
            row_kinds=tuple(_kind(d.verdict, explained=knowledge.check.explains) for d in knowledge.directions),
        )
    )
    blocks.append(_correlations(posterior))
    if knowledge.freed:
        blocks += freed_blocks(knowledge)
    return Section("known", "What is known, and what it assumes", tuple(blocks))


def _words(verdict: Verdict, condition: str) -> str:
    """A verdict as on page one: what is not known is not known under any condition."""
    return verdict if verdict in ("not identified", "no verdict") else verdict + condition


def _figures(named: NamedDirection) -> tuple[str, str, str]:
    """Interval, ratio of its ends and spread; of a stiffness that is bounded its limit only."""
    if named.limit:
        return named.limit, "–", "–"
    ends = rounded_interval(named.interval95, named.interval95_error)
    return ends, factor(named.ratio), number(named.sd_log)


def _kind(verdict: str, *, explained: bool) -> str:
    """Colour of a verdict; none is green where the model does not explain the data."""
    kind = _KINDS.get(verdict, "caution")
    return "caution" if kind == "good" and not explained else kind


def _correlations(posterior: Posterior) -> Table:
    """Correlation of the draws, the joint's coordinates against all."""
    labels = coordinate_labels(posterior.problem)
    matrix = np.atleast_2d(np.corrcoef(posterior.theta.T))
    joint = labels[: len(posterior.problem.parametrisation.names)]
    rows = tuple((label, *(f"{matrix[i, j]:.2f}" for j in range(len(joint)))) for i, label in enumerate(labels))
    return Table(
        "Correlation of the draws",
        ("", *joint),
        rows,
        note="Near 1 or −1 the data determine a combination of the two, not each by itself.",
    )


def likelihood_section(knowledge: Knowledge, summary: Summary) -> Section | None:
    """Likelihood-ratio limits, which are no credible intervals; None where no residual depends on a coordinate."""
    if not knowledge.profiles:
        return None
    rows = []
    for profile in knowledge.profiles:
        low, high = map(profile.coordinate.value, profile.interval)
        ends = ("none" if profile.open_below else number(low), "none" if profile.open_above else number(high))
        known = summary.parameters.get(profile.name)
        rows.append((profile.name, *ends, interval(known.known.interval95) if known else "–"))
    others = [p.coordinate for p in knowledge.profiles if p.name not in summary.parameters]
    units = "".join(f"; {one.name} {'has none' if one.unit == '1' else f'in {one.unit}'}" for one in others)
    blocks: tuple[Block, ...] = (
        Paragraph(
            "These are likelihood-ratio confidence limits, not credible intervals. They bound the values at which the "
            "data can still be fitted with all else adjusted, however few joints fit so well, and use only the bounds "
            "of the joint's priors. The verdicts are based on the draws."
        ),
        Table(
            "Likelihood-ratio limits at 95 %",
            ("Parameter", "Lower limit", "Upper limit", "95 % credible interval (draws)"),
            tuple(rows),
            note=f"None: the data set no limit within the prior's bounds. Units as above{units}.",
        ),
        Figure(
            "profiles",
            "Profile likelihood: the best fit for each value of a parameter, as ln of its ratio to the best of all; "
            "dashed, the limit at 95 %.",
            f"Profile likelihood of {', '.join(p.name for p in knowledge.profiles)}.",
            figures.profiles(
                [(p.coordinate.axis_label, p.value * p.coordinate.axis_scale, p.log_ratio) for p in knowledge.profiles]
            ),
        ),
    )
    return Section("likelihood", "Likelihood-ratio limits", blocks)


def freed_blocks(knowledge: Knowledge) -> list[Block]:
    """The effect of uncertain inputs: a sentence and the table, whose first row is the run."""
    names = tuple(knowledge.freed[0].known)
    head = ("Uncertain besides the joint", *(f"{name}, 95 % interval" for name in names), "Verdicts", "Source")
    rows = tuple(_freed_row(row, names) for row in knowledge.freed)
    note = (
        "Each row is sampled with only these quantities uncertain and all others at their stated values. Interval ends "
        "from a short run are approximate. A dash: the short run did not converge."
    )
    lead = knowledge.freed_sentence
    if knowledge.assumed:
        lead = (
            "This case assumes that everything but the joint is exactly known. The effect of usual uncertainties "
            f"({', '.join(knowledge.assumed)}): {lead[0].lower()}{lead[1:]}"
        )
        note += " These uncertainties are assumed; state your own in [uncertain] to include them in the result."
    return [Paragraph(f"**{lead}**"), Table("Effect of uncertain inputs", head, rows, note=note, align=None)]


def _freed_row(row: UncertainInputsRow, names: tuple[str, ...]) -> tuple[str, ...]:
    uncertain = ", ".join(_readable(name) for name in row.uncertain) or "none"
    if not row.known:
        return (uncertain, *("–" for _ in names), "–", "–")
    known = row.known
    intervals = (rounded_interval(known[name].interval95, known[name].interval95_error) for name in names)
    verdicts = "; ".join(
        f"{name} {verdict_text(known[name].verdict, if_model_right=known[name].if_model_right)}" for name in names
    )
    return (uncertain, *intervals, verdicts, row.source)


def nuisance_section(summary: Summary) -> Section | None:
    """Prior and posterior of whatever else is uncertain; None where nothing is."""
    if not summary.nuisances:
        return None
    rows = tuple(
        (
            _readable(name),
            number(n.nominal, 4),
            interval(n.prior_interval95, 4),
            number(n.median, 4),
            interval(n.interval95, 4),
            n.unit,
            contraction(n.contraction, 2),
            fixed(n.r_hat, 3),
        )
        for name, n in summary.nuisances.items()
    )
    head = ("Quantity", "Stated", "Prior 95 %", "Median", "Posterior 95 %", "Unit", "Contraction", "R̂")
    note = (
        "Contraction 0: the data say nothing about it, and the posterior is the prior; near 1: the data determine it; "
        "none: the posterior is as wide as the prior or wider."
    )
    return Section(
        "nuisances",
        "What else was uncertain",
        (Table("Other uncertain quantities", head, rows, note=note),),
    )


def coordinate_labels(problem: Problem) -> list[str]:
    """Short label of each coordinate for an axis: of the joint, then of what else is uncertain."""
    axes = problem.parametrisation.axes
    return [axis.label for axis in axes] + [nuisance_label(name) for name in problem.names[len(axes) :]]


def nuisance_label(name: str) -> str:
    """Short label of an uncertain quantity for an axis."""
    if name.startswith("mode_frequency_"):
        return f"ln f{name.rsplit('_', 1)[1]}"
    if name.startswith("damping_ratio_"):
        return f"ln ζ{name.rsplit('_', 1)[1]}"
    return _SHORT.get(name, f"ln {name}")


def _readable(name: str) -> str:
    if name.startswith("mode_frequency_"):
        return f"natural frequency {name.rsplit('_', 1)[1]}"
    if name.startswith("damping_ratio_"):
        return f"damping ratio of mode {name.rsplit('_', 1)[1]}"
    return _READABLE.get(name, name)
