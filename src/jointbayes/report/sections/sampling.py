"""How the draws were made and how well they mixed."""

from jointbayes.posterior import Posterior
from jointbayes.posterior.rounding import fixed, number
from jointbayes.report import figures
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.labels import coordinate_labels
from jointbayes.report.markup import foreign
from jointbayes.report.model import Figure, Section, Table


def sampling_section(inputs: ReportInputs) -> Section:
    """How the draws were made and how well they mixed."""
    record = inputs.posterior.record
    s = record.sampler
    rows = (
        ("Ensembles × walkers", f"{s['ensembles']} × {s['walkers']}"),
        ("Steps (limit)", f"{s['steps']} ({s['max_steps']})"),
        ("Burn-in, thinning", f"{s['burn_in']} steps, every {s['thin']} steps"),
        ("Autocorrelation time τ", ", ".join(f"{n} {number(t)}" for n, t in s["tau"].items()) + " steps"),
        ("Acceptance", f"{100 * s['acceptance']:.0f} %"),
        *((f"– {foreign(name)}", f"{100 * share:.0f} %") for name, share in s["move_acceptance"].items()),
        ("Importance efficiency of the proposal", f"{100 * s['proposal_efficiency']:.0f} %"),
        ("Evaluations", f"{s['evaluations']}"),
        ("of these without a finite value", f"{s['singular']}"),
        ("Effective draws", ", ".join(f"{n} {fixed(e, 0)}" for n, e in s["ess"].items())),
        ("Time", f"{s['seconds']:.1f} s, {fixed(s['ess_per_second'], 0)} effective draws per second"),
        ("Seed", f"{record.seed}"),
    )
    return Section(
        "sampling",
        "Sampling",
        (
            Table("Sampler", ("Figure", "Value"), rows, align="ll"),
            *chain_figures(inputs.posterior, s["thin"]),
        ),
    )


def chain_figures(posterior: Posterior, thin: int) -> list[Figure]:
    """Traces and autocorrelation of all coordinates, in as many figures as there are colours for."""
    theta = posterior.theta.reshape(*posterior.log_density.shape, -1)
    ensemble = posterior.draws["ensemble"].values
    names = coordinate_labels(posterior.problem)
    pages = [slice(i, i + figures.MOST_CURVES) for i in range(0, len(names), figures.MOST_CURVES)]
    traces, correlations = [], []
    for count, page in enumerate(pages, 1):
        suffix = "" if count == 1 else f"-{count}"
        these = "" if len(pages) == 1 else f" of {', '.join(names[page])}"
        traces.append(
            Figure(
                f"traces{suffix}",
                f"Traces{these} after burn-in: median and 95 % range of each ensemble's walkers. Converged ensembles "
                "lie on top of each other and show no trend.",
                "Traces of the coordinates for each ensemble over the kept draws.",
                figures.traces(names[page], theta[..., page], ensemble),
            )
        )
        correlations.append(
            Figure(
                f"autocorrelation{suffix}",
                f"Autocorrelation{these or ' of the kept draws'}, averaged over walkers.",
                "Autocorrelation of each coordinate against lag in steps, falling to zero.",
                figures.autocorrelation(names[page], theta[..., page], thin),
            )
        )
    return [*traces, *correlations]
