"""The sections of a report: words and tables from the numbers of a run."""

import numpy as np

from jointbayes.identification import IterationHistory
from jointbayes.joint import STIFFNESSES
from jointbayes.measurement import FrequencyMeasurement
from jointbayes.posterior import Posterior
from jointbayes.posterior.identifiability import RULE, Identifiability
from jointbayes.posterior.summary import Summary
from jointbayes.posterior.verdicts import IF_MODEL_RIGHT, verdict_text
from jointbayes.report import figures
from jointbayes.report.format import contraction, factor, fixed, interval, number, rounded, rounded_interval
from jointbayes.report.markup import badge
from jointbayes.report.model import Block, Callout, Code, Figure, Paragraph, Section, Table
from jointbayes.report.sections.check import bold_head, check_banners
from jointbayes.report.sections.knowledge import coordinate_labels

__all__ = [
    "chain_figures",
    "frequency_section",
    "lead",
    "posterior_section",
    "sampling_section",
    "settings_section",
    "starts_section",
]

Triple = tuple[float, float, float]


def lead(posterior: Posterior, reference: Triple | None, source: str, summary: Summary) -> tuple[Block, ...]:
    """Banner, verdict table with the reason of each verdict, and the sentence on the coupling stiffness."""
    return (
        *_banners(posterior, summary),
        _verdict_table(reference, source, summary),
        Paragraph(verdict_sentences(summary)),
        *([] if summary.no_verdict else [Paragraph(coupling_sentence(summary))]),
        *([Paragraph(bold_head(summary.check.sentence))] if summary.check.finding == "explained" else []),
    )


def _banners(posterior: Posterior, summary: Summary) -> list[Block]:
    banners: list[Block] = []
    banners += check_banners(summary)
    if posterior.converged:
        banners.append(Callout("good", f"**The sampler** {posterior.reason}"))
    else:
        found = posterior.reason.removeprefix("not converged ")
        banners.append(Callout("bad", f"**The sampler has NOT converged, do not use these numbers**: {found}"))
    if not posterior.mode_agrees:
        banners.append(
            Callout(
                "bad",
                f"**The best draw leads to another mode than the MAP**, {number(posterior.mode_distance)} Laplace "
                "standard deviations away: the MAP search missed it.",
            )
        )
    if summary.no_verdict:
        banners.append(Callout("bad", f"**No verdict on any stiffness**: {'; '.join(summary.no_verdict)}."))
    if summary.mesh is not None and not summary.mesh.within:
        banners.append(Callout("caution", f"**The mesh shows.** {summary.mesh.sentence}"))
    if posterior.at_prior_edge:
        names = ", ".join(posterior.at_prior_edge)
        text = f"**The mode lies on an edge of the prior: {names}.** There the prior limits it, not the data; widen it."
        banners.append(Callout("caution", text))
    if summary.fit.synthetic_data:
        banners.append(
            Callout(
                "caution",
                "**The FRF data are synthetic**: computed from the joint and the noise that the case states.",
            )
        )
    return banners


def _verdict_table(reference: Triple | None, source: str, summary: Summary) -> Table:
    head = ["Stiffness", "Median", "95 % credible interval", "Unit", "Verdict"]
    rows = []
    for i, (name, p) in enumerate(summary.parameters.items()):
        known = p.known
        row = [name, rounded(known.median, known.median_error), _interval(known), p.unit, _verdict(known)]
        if reference is not None:
            row.insert(1, number(reference[i]))
        rows.append(tuple(row))
    if reference is not None:
        head.insert(1, "Published")
    note = f"Equal-tailed interval; the digits shown are those that the Monte Carlo errors support. {RULE}."
    if reference is not None:
        note += f" Published: {source}."
    marks = [badge(_verdict(p.known)) for p in summary.parameters.values()]
    return Table(
        "Stiffness of the joint",
        tuple(head),
        tuple(rows),
        note=note,
        row_kinds=tuple(mark.kind if mark else "" for mark in marks),
    )


def _interval(known: Identifiability) -> str:
    return rounded_interval(known.interval95, known.interval95_error)


def _verdict(known: Identifiability) -> str:
    return verdict_text(known.verdict, if_model_right=known.if_model_right)


def verdict_sentences(summary: Summary) -> str:
    """Each stiffness's verdict with its reason, a sentence each."""
    sentences = []
    for name, p in summary.parameters.items():
        known, limit = p.known, ""
        reason = known.verdict_reason.removeprefix(f"{IF_MODEL_RIGHT}: ")
        if known.limit:
            limit = f" {known.limit} with 95 % probability,"
        sentences.append(f"**{name}**:{limit} {_verdict(known)} ({reason}).")
    return " ".join(sentences)


def coupling_sentence(summary: Summary) -> str:
    """What the data say of the coupling against the rotational stiffness, in words with its numbers."""
    _, coupling, rotation = STIFFNESSES
    k12, k22 = (summary.parameters[quantity.name].known for quantity in (coupling, rotation))
    low, high = k12.interval95
    if low <= 0 <= high:
        return (
            f"**The coupling stiffness {coupling.name} is {_verdict(k12)}**: its 95 % credible interval, "
            f"{_interval(k12)} {coupling.unit}, contains zero, so that not even its sign is known."
        )
    text = (
        f"**The coupling stiffness {coupling.name} is {_verdict(k12)}**: its 95 % credible interval spans a factor of "
        f"{factor(max(high / low, low / high))} ({_interval(k12)} {coupling.unit})"
    )
    if k12.sd_log > 0 and k22.sd_log > 0:
        ratio = k12.sd_log / k22.sd_log
        compared = f"{number(ratio, 2)} times" if ratio >= 1 else f"only {number(ratio, 2)} times"
        text += (
            f"; the relative standard deviation is {number(100 * k12.sd_log, 2)} %, {compared} that of {rotation.name} "
            f"({number(100 * k22.sd_log, 2)} %)"
        )
    return text + "."


def frequency_section(posterior: Posterior, summary: Summary) -> Section:
    """Natural frequencies: measured, first guess, MAP, interval."""
    frequencies = summary.natural_frequencies_hz
    measured = frequencies.measured
    rows = []
    for i, (guess, best, ends) in enumerate(
        zip(frequencies.initial, frequencies.map, frequencies.interval95, strict=True)
    ):
        row = [str(i + 1), f"{guess:.2f}", f"{best:.2f}", f"{ends[0]:.2f} … {ends[1]:.2f}"]
        if measured:
            row.insert(1, f"{measured[i]:.1f}")
        rows.append(tuple(row))
    head = ["Mode", "First guess (Hz)", "MAP (Hz)", "95 % interval (Hz)"]
    if measured:
        head.insert(1, "Measured (Hz)")
    blocks: list[Block] = [Table("Natural frequencies, undamped", tuple(head), tuple(rows))]
    measurement = posterior.problem.measurement
    if measured:
        sd = measurement.sd_hz if isinstance(measurement, FrequencyMeasurement) else None
        low, high = np.array(frequencies.interval95).T
        series = {"MAP": np.array(frequencies.map), "95 % interval": (low, high)}
        svg = figures.frequency_errors(np.array(measured), sd, series)
        caption = "Predicted natural frequencies against the measured ones."
        if summary.fit.synthetic_data:
            caption += " The FRF data are synthetic, so that these measured frequencies were not fitted."
        worst = max(abs(100 * (b / m - 1)) for b, m in zip(frequencies.map, measured, strict=True))
        alt = f"Deviation of predicted natural frequencies by mode; the largest at the MAP is {worst:.2f} per cent."
        blocks.append(Figure("frequencies-plot", caption, alt, svg))
    return Section("frequencies", "Natural frequencies", tuple(blocks))


def posterior_section(posterior: Posterior, reference: Triple | None, source: str, summary: Summary) -> Section:
    """Marginals, pairs, prior and the full table."""
    head = (
        "Stiffness",
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
        for name, p in summary.parameters.items()
    )
    note = (
        "Joint mode, MAP and mean in the stiffness's unit, see above. Contraction: the share of the prior's variance "
        "of ln k (of k12 itself where it has both signs) that the data removed; none where the posterior is as wide as "
        "the prior or wider, because the data favour values near the prior's ends."
    )
    blocks: list[Block] = [
        Table("Posterior in numbers", head, rows, note=note),
        Paragraph(summary.map.mode_sentence),
    ]
    parametrisation = posterior.problem.parametrisation
    scale = np.array([axis.axis_scale for axis in parametrisation.axes])
    draws, prior = (parametrisation.coordinates(k) * scale for k in (posterior.stiffness, posterior.prior_stiffness))
    known = reference is not None and bool(parametrisation.describes(reference))
    point = parametrisation.coordinates(np.array(reference)) * scale if known else None
    mode = posterior.problem.prior.joint(posterior.mode_theta) * scale
    labels = [axis.axis_label for axis in parametrisation.axes]
    svg = figures.corner_plot(labels, draws, prior, point, mode)
    marks = "mode (orange, solid)" + ("" if point is None else f", published values (green, dashed; {source})")
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
    return Section("posterior", "Posterior", tuple(blocks))


def sampling_section(posterior: Posterior, summary: Summary) -> Section:
    """How the draws were made and how well they mixed."""
    s = summary.record.sampler
    rows = (
        ("Ensembles × walkers", f"{s['ensembles']} × {s['walkers']}"),
        ("Steps (limit)", f"{s['steps']} ({s['max_steps']})"),
        ("Burn-in, thinning", f"{s['burn_in']} steps, every {s['thin']} steps"),
        ("Autocorrelation time τ", ", ".join(f"{n} {number(t)}" for n, t in s["tau"].items()) + " steps"),
        ("Acceptance", f"{100 * s['acceptance']:.0f} %"),
        *((f"– {name}", f"{100 * share:.0f} %") for name, share in s["move_acceptance"].items()),
        ("Importance efficiency of the proposal", f"{100 * s['proposal_efficiency']:.0f} %"),
        ("Evaluations", f"{s['evaluations']}"),
        ("of these without a finite value", f"{s['singular']}"),
        ("Effective draws", ", ".join(f"{n} {fixed(e, 0)}" for n, e in s["ess"].items())),
        ("Time", f"{s['seconds']:.1f} s, {fixed(s['ess_per_second'], 0)} effective draws per second"),
        ("Seed", f"{summary.record.seed}"),
    )
    return Section(
        "sampling",
        "Sampling",
        (
            Table("Sampler", ("Figure", "Value"), rows, align="ll"),
            *chain_figures(posterior, s["thin"]),
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


def starts_section(
    posterior: Posterior, history: IterationHistory | None, reference: Triple | None, missing: str = ""
) -> Section:
    """Where the mode came from: the starts, and the paper's iteration or what is `missing` for it."""
    estimate = posterior.estimate
    rows = tuple(
        (
            start.name,
            ", ".join(number(k) for k in start.start),
            ", ".join(number(k) for k in start.stiffness),
            number(start.log_posterior, 7),
            "yes" if start.reached_mode else "no",
        )
        for start in estimate.starts
    )
    head = ("Start", "k11, k12, k22 from", "to", "ln p", "Mode reached")
    reached = len(rows) - len(estimate.failed_starts)
    text = f"{reached} of {len(rows)} starts reach the mode"
    text += f"; these do not: {estimate.failed_text}." if estimate.failed_starts else "."
    text += (
        f" The joint mode refined from the best draw lies {number(posterior.mode_distance, 2)} Laplace sd from the MAP."
    )
    if estimate.sentence:
        text += f" {estimate.sentence}"
    blocks: list[Block] = [Paragraph(text), Table("Starts of the MAP search, and where each led", head, rows)]
    if history is not None:
        blocks += _iteration_blocks(history, reference)
    elif missing:
        blocks.append(Paragraph(f"**The paper's iteration was left out.** {missing}."))
    return Section("starts", "Starting points and the paper's iteration", tuple(blocks))


def _iteration_blocks(history: IterationHistory, reference: Triple | None) -> list[Block]:
    norm = history.residual_norm
    published = None if reference is None else np.array(reference)
    settled = ", ".join(
        f"{q.name} {100 * abs(history.stiffness_history[min(5, history.steps), i] / history.stiffness[i] - 1):.1f} %"
        for i, q in enumerate(STIFFNESSES)
        if history.stiffness[i] != 0
    )
    return [
        Paragraph(
            f"**The paper's iteration (Eqs. 3–9)** {history.reason}. Step 5 differs from the last step by: {settled}."
        ),
        Figure(
            "iteration-norm",
            "Norm of the residual FRF over the iteration, as in the paper's Fig. 7.",
            f"Residual norm falls from {number(norm[0])} to {number(norm[-1])} in {history.steps} steps.",
            figures.residual_norm(norm),
        ),
        Figure(
            "iteration-stiffness",
            "Stiffnesses over the iteration, as in the paper's Fig. 8.",
            "History of k11, k12 and k22 over the iteration steps with the published values.",
            figures.histories([f"{q.name} ({q.unit})" for q in STIFFNESSES], history.stiffness_history, published),
        ),
    ]


def settings_section(posterior: Posterior, summary: Summary) -> Section:
    """Everything needed to repeat the run."""
    versions = tuple(summary.record.versions.items())
    return Section(
        "settings",
        "Settings and versions",
        (
            *([] if summary.mesh is None else [Paragraph(summary.mesh.sentence)]),
            Paragraph(f"Fingerprint of the data (SHA-256): `{summary.data_sha256}`."),
            Table("Versions", ("Package", "Version"), versions, align="ll"),
            Code(posterior.record.case_text, "toml")
            if posterior.of_case_text
            else Code(str(posterior.problem), "text"),
        ),
    )
