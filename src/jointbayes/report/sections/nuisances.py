"""What was uncertain besides the joint, before and after."""

from jointbayes.posterior.rounding import contraction, fixed, interval, number
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.labels import readable
from jointbayes.report.markup import foreign
from jointbayes.report.model import Section, Table


def nuisance_section(inputs: ReportInputs) -> Section | None:
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
    return Section(
        "nuisances",
        "What else was uncertain",
        (Table("Other uncertain quantities", head, rows, note=note),),
    )
