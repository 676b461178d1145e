"""How the run went, and what it takes to repeat it: starts, sampler, chains, settings and versions."""

import numpy as np
from numpy.typing import NDArray

from jointbayes.identification import missing_for_iteration
from jointbayes.posterior import Posterior
from jointbayes.posterior.verdicts import mode_agrees, mode_distance
from jointbayes.report import drawing
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import coordinate_labels, foreign, listed_names
from jointbayes.report.model import Block, Code, Figure, Paragraph, ReportSection
from jointbayes.rounding import number
from vibrecords.arrays import Array


def starts_section(inputs: ReportInputs) -> ReportSection:
    """Where the mode came from: the starts, and the paper's iteration or what is missing for it."""
    posterior, estimate = inputs.posterior, inputs.posterior.estimate
    every = len(estimate.starts)
    text = f"The best fit was found from {every - len(estimate.failed_starts)} of {every} starting points; "
    away = number(mode_distance(posterior), 2)
    missed = f"a draw leads to another, {away} standard deviations away."
    text += "none was better." if mode_agrees(posterior) else missed
    if estimate.sentence:
        text += f" {estimate.sentence}"
    blocks: list[Block] = [Paragraph(text)]
    if estimate.iteration is not None:
        history, published = estimate.iteration, inputs.reference
        fifth = history.stiffness_history[min(5, history.steps)]
        norm, iterated = history.residual_norm, [posterior.problem.quantities[i] for i in history.iterated]
        settled = ", ".join(
            f"{q.name} {100 * abs(fifth[i] / history.stiffness[i] - 1):.1f} %"
            for i, q in zip(history.iterated, iterated, strict=True)
            if history.stiffness[i] != 0
        )
        name = "**The paper's iteration (Eqs. 3–9)**"
        text = f"{' '.join(filter(None, (name, foreign(history.on_test), history.reason)))}. "
        text += f"Step 5 differs from the last step by: {foreign(settled)}."
        at, titles = list(history.iterated), [f"{q.name} ({q.unit})" for q in iterated]
        printed = None if published is None else published[at]
        named = listed_names([q.name for q in iterated])
        if len(iterated) < len(posterior.problem.quantities):
            text += " Quantities that do not act in that test stay at the first guess."
        caption = "Norm of the residual FRF over the iteration, as in the paper's Fig. 7."
        alt = f"Residual norm falls from {number(norm[0])} to {number(norm[-1])} in {history.steps} steps."
        svg = drawing.draw_alone(drawing.draw_residual_norm, norm)
        blocks += [Paragraph(text), Figure("iteration-norm", caption, alt, svg)]
        caption = "Stiffnesses over the iteration, as in the paper's Fig. 8."
        alt = f"History of {named} over the iteration steps with the published values."
        shown = titles, history.stiffness_history[:, at], printed
        svg = drawing.in_rows(drawing.draw_histories, *shown, **drawing.HISTORIES)
        blocks.append(Figure("iteration-stiffness", caption, alt, svg))
    elif missing := missing_for_iteration(posterior.problem):
        blocks.append(Paragraph(f"**Left out**: {foreign(missing)}."))
    return ReportSection("starts", "Starting points and the paper's iteration", tuple(blocks))


def sampling_section(inputs: ReportInputs) -> ReportSection:
    """Describe how the draws were made and how well they mixed."""
    record = inputs.posterior.record
    s = record.sampler
    if not s["move_acceptance"]:  # no walkers
        drawn = f"{len(inputs.posterior.theta)} independent draws by importance sampling in {s['seconds']:.1f} s"
        return ReportSection("sampling", "Sampling", (Paragraph(f"{drawn}, seed {record.seed}."),))
    effective = f"{min(s['ess'].values()):.0f} effective draws in {s['seconds']:.1f} s, seed {record.seed}"
    moves = ", ".join(f"{foreign(name)} {100 * share:.0f} %" for name, share in s["move_acceptance"].items())
    text = (
        f"{s['ensembles']} × {s['walkers']} walkers took {s['steps']} of at most {s['max_steps']} steps and left "
        f"{effective}. Accepted: {100 * s['acceptance']:.0f} % of the proposals ({moves}). "
        f"Longest autocorrelation time: {number(max(s['tau'].values()))} steps."
    )
    text += f" {s['singular']} of {s['evaluations']} evaluations had no finite value." if s["singular"] else ""
    return ReportSection("sampling", "Sampling", (Paragraph(text), *chain_figures(inputs.posterior, s["thin"])))


def chain_values(posterior: Posterior) -> tuple[list[str], Array, NDArray[np.intp]]:
    """Return labels of all coordinates, draws of shape (chains, draws, coordinates), and each chain's ensemble."""
    theta = posterior.theta.reshape(*posterior.log_density.shape, -1)
    return coordinate_labels(posterior.problem), theta, posterior.draws["ensemble"].values


def chain_figures(posterior: Posterior, thin: int) -> list[Figure]:
    """Traces and autocorrelation of all coordinates, in figures of about as many each as there are colours for."""
    names, theta, ensemble = chain_values(posterior)
    each = -(-len(names) // -(-len(names) // drawing.MOST_CURVES))
    pages = [slice(i, i + each) for i in range(0, len(names), each)]
    traces, correlations = [], []
    for count, page in enumerate(pages, 1):
        suffix = "" if count == 1 else f"-{count}"
        these = "" if len(pages) == 1 else f" of {', '.join(names[page])}"
        caption = f"Traces{these} after burn-in: median and 95 % range of each ensemble's walkers. Converged ensembles "
        caption += "lie on top of each other and show no trend."
        alt = "Traces of the coordinates for each ensemble over the kept draws."
        svg = drawing.traces(names[page], theta[..., page], ensemble)
        traces.append(Figure(f"traces{suffix}", caption, alt, svg))
        caption = f"Autocorrelation{these or ' of the kept draws'}, averaged over walkers."
        alt = "Autocorrelation of each coordinate against lag in steps, falling to zero."
        svg = drawing.draw_alone(drawing.draw_autocorrelation, names[page], theta[..., page], thin)
        correlations.append(Figure(f"autocorrelation{suffix}", caption, alt, svg))
    return [*traces, *correlations]


def settings_section(inputs: ReportInputs) -> ReportSection:
    """Everything needed to repeat the run."""
    summary = inputs.summary
    versions = ", ".join(foreign(f"{name} {version}") for name, version in summary.record.versions.items())
    stated = bool(inputs.case_text)
    case = "The case is in `case.toml`, its numbers in `summary.json`, both in this directory. " * stated
    text = f"{case}Fingerprint of the data (SHA-256): `{summary.data_sha256}`. Versions: {versions}."
    mesh: list[Block] = [] if summary.mesh is None else [Paragraph(summary.mesh.sentence)]
    blocks = (*mesh, Paragraph(text), *([] if stated else [Code(str(inputs.posterior.problem), "text")]))
    return ReportSection("settings", "Settings and versions", blocks)
