"""Likelihood-ratio limits, which are no credible intervals."""

from jointbayes.posterior.rounding import interval, number
from jointbayes.report import figures
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.model import Block, Figure, Paragraph, Section, Table


def likelihood_section(inputs: ReportInputs) -> Section | None:
    """Likelihood-ratio limits, which are no credible intervals; None where no residual depends on a coordinate."""
    knowledge, summary = inputs.knowledge, inputs.summary
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
