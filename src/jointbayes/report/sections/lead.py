"""Page one: banners, verdicts with their reasons, and what is said of the coupling stiffness."""

import math
from collections.abc import Mapping, Sequence

from jointbayes.joint import Quantity
from jointbayes.posterior.identifiability import RULE, Identifiability, ratio_of
from jointbayes.posterior.knowledge import quantities_taken_as_exact
from jointbayes.posterior.modes_answer import ModesAnswer
from jointbayes.posterior.prediction import sentence_of_left_out
from jointbayes.posterior.rounding import factor, number, rounded, rounded_interval
from jointbayes.posterior.summary import Summary
from jointbayes.posterior.uncertain_inputs import UncertainInputsRow
from jointbayes.posterior.verdicts import IF_MODEL_RIGHT, MOST_UNKNOWNS, verdict_text
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import foreign, kind_of
from jointbayes.report.model import Block, Callout, Paragraph, Table
from jointbayes.report.sections.measured_data import mode_table

_MOST_COUPLINGS = 6  # that page one says something of


def lead(inputs: ReportInputs) -> tuple[Block, ...]:
    """Banners, verdict table with the reason of each verdict, and the sentence on the coupling stiffness."""
    summary, modes = inputs.summary, inputs.knowledge.believed_modes
    return (
        *(Callout("caution", f"**Check the case file.** {foreign(str(warning))}.") for warning in summary.warnings),
        *(mode_table(inputs.setups[0]) if len(inputs.setups) == 1 else ()),
        *_banners(inputs),
        *(_answer_of_frfs(inputs) if modes is None else _answer_of_modes(inputs, modes)),
        *_explained(summary),
        *([Paragraph(f"**{foreign(sentence_of_left_out(summary.left_out))}**")] if summary.left_out else []),
    )


def _answer_of_frfs(inputs: ReportInputs) -> tuple[Block, ...]:
    """The verdicts of the draws with the reason of each, and what is said of couplings."""
    summary = inputs.summary
    verdicts = {name: (p.known, p.verdict) for name, p in summary.parameters.items()}
    return (
        _verdict_table(inputs, verdicts, _workshop_row(inputs.knowledge.freed)),
        Paragraph(verdict_sentences(summary)),
        *([Paragraph(f"**{sentence}**")] if (sentence := inputs.knowledge.bounds_sentence) else []),
        *([] if summary.no_verdict else map(Paragraph, _coupling_sentences(inputs))),
    )


def _answer_of_modes(inputs: ReportInputs, modes: ModesAnswer) -> tuple[Block, ...]:
    """The verdicts of the modes that measured FRFs show, with the reason of each."""
    each = (f"**{name}**: {known.verdict} ({known.verdict_reason})." for name, known in modes.known.items())
    return (
        _verdict_table(inputs, {name: (known, known.verdict) for name, known in modes.known.items()}),
        Paragraph(f"**{modes.sentence}** {modes.basis}"),
        Paragraph(" ".join(each)),
    )


def _banners(inputs: ReportInputs) -> list[Block]:
    posterior, summary = inputs.posterior, inputs.summary
    banners = _check_banners(summary)
    if posterior.converged:
        banners.append(Callout("good", f"**The sampler** {posterior.reason}"))
    else:
        reason = posterior.reason.removeprefix("not converged ")
        banners.append(Callout("bad", f"**The sampler has NOT converged, do not use these numbers**: {reason}"))
    if not posterior.mode_agrees:
        banners.append(
            Callout(
                "bad",
                f"**The best draw leads to another mode than the MAP**, {number(posterior.mode_distance)} Laplace "
                "standard deviations away: the MAP search missed it.",
            )
        )
    if summary.solutions:
        head, bracket, rest = summary.solutions.partition(" (")
        banners.append(Callout("bad", f"**{head}**{bracket}{foreign(rest)}"))
    if summary.no_verdict and inputs.knowledge.believed_modes is None:
        banners.append(Callout("bad", f"**No verdict on any stiffness**: {'; '.join(summary.no_verdict)}."))
    if summary.mesh is not None and not summary.mesh.within:
        banners.append(Callout("caution", f"**The mesh shows.** {summary.mesh.sentence}"))
    if summary.measured_bodies is not None and not summary.measured_bodies.within:
        text = f"**A measured body.** {foreign(summary.measured_bodies.sentence)}"
        banners.append(Callout("bad" if summary.measured_bodies.ignored else "caution", text))
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


def _explained(summary: Summary) -> list[Block]:
    """That the model explains all data, where it does; of several set-ups with the one that it explains worst."""
    if summary.check.finding != "explained":
        return []
    if len(summary.setups) == 1:
        return [Paragraph(_bold_head(summary.check.sentence))]
    if not all(setup.check.explains for setup in summary.setups.values()):
        return []
    all_of = f"**The model explains the data of all {len(summary.setups)} set-ups.**"
    return [Paragraph(f"{all_of} {summary.check.sentence}")]


def _check_banners(summary: Summary) -> list[Block]:
    """A banner for each set-up whose data the model does not explain, with what helps, or whose noise is overstated."""
    banners: list[Block] = []
    for setup in summary.setups.values():
        if not setup.check.explains:
            banners.append(Callout("bad", f"{_bold_head(setup.check.sentence)} {setup.diagnosis.sentence}"))
        elif setup.check.finding == "noise overstated":
            banners.append(Callout("caution", _bold_head(setup.check.sentence)))
    return banners


def _bold_head(sentence: str) -> str:
    """The sentence with what stands before its first colon in bold."""
    head, colon, rest = sentence.partition(":")
    return f"**{head}**{colon}{rest}"


def _verdict_table(
    inputs: ReportInputs,
    verdicts: Mapping[str, tuple[Identifiability, str]],
    workshop: UncertainInputsRow | None = None,
) -> Table:
    """What is known of each stiffness, with the verdict as it is printed; and with all else as in a workshop."""
    reference = inputs.reference
    damped = inputs.posterior.problem.parametrisation.damped
    head = ["Quantity" if damped else "Stiffness", "Median", "95 % interval", "Unit", "Verdict"]
    rows: list[tuple[str, ...]] = []
    kinds = []
    for i, (name, (assessment, verdict)) in enumerate(verdicts.items()):
        both = [_answer(name, assessment, inputs.posterior.unit(name), verdict)]
        if workshop:
            both[0].insert(1, "as the case states" if inputs.knowledge.freed[0].uncertain else "exact")
        if workshop and name in workshop.known:
            known = workshop.known[name]
            row = _answer(name, known, known.unit, verdict_text(known.verdict, if_model_right=known.if_model_right))
            row.insert(1, "as in a workshop")
            # of what was measured nobody knows all else exactly, so that this is the answer
            both.insert(int(inputs.summary.fit.synthetic_data), row)
        if reference is not None:
            for cells, value in zip(both, (number(reference[i]), "–"), strict=False):
                cells.insert(2 if workshop else 1, value)
        rows += map(tuple, both)
        kinds += [kind_of(cells[-1]) for cells in both]
    if workshop:
        head.insert(1, "All else")
    if reference is not None:
        head.insert(2 if workshop else 1, "Published")
    note = (
        'Beside every verdict but "identified" each end of the 95 % interval is the more cautious of the draws\' and, '
        f"with up to {MOST_UNKNOWNS} unknowns, the likelihood's; beside \"identified\" it is the draws' equal-tailed "
        f"credible interval, with the digits that the Monte Carlo errors support. {RULE}."
    )
    if workshop:
        note += f" As in a workshop: {', '.join(inputs.knowledge.assumed)}, assumed as nobody stated them."
    if reference is not None:
        note += f" Published: {inputs.reference_source}."
    return Table(
        "Stiffness and damping of the joint" if damped else "Stiffness of the joint",
        tuple(head),
        tuple(rows),
        note=note,
        row_kinds=tuple(kinds),
    )


def _workshop_row(rows: Sequence[UncertainInputsRow]) -> UncertainInputsRow | None:
    """What is known with all else as in a workshop; None where the run takes nothing as exact, or nothing settled."""
    return rows[-1] if quantities_taken_as_exact(rows) and rows[-1].known else None


def _answer(name: str, known: Identifiability, unit: str, verdict: str) -> list[str]:
    """Row of a stiffness: median, interval or limit, unit, and verdict as it is printed."""
    ends = known.limit.removesuffix(f" {known.unit}") or known.interval()
    return [name, rounded(known.median, known.median_error), ends, "–" if unit == "1" else unit, verdict]


def verdict_sentences(summary: Summary) -> str:
    """Each stiffness's verdict with its reason, a sentence each."""
    sentences = []
    for name, p in summary.parameters.items():
        assessment = p.known
        reason = assessment.verdict_reason.removeprefix(f"{IF_MODEL_RIGHT}: ")
        reason += f"; {p.exact.words_if_uncertain}" if p.exact else ""
        limit = f" {assessment.limit_in_words}," if assessment.limit else ""
        ends = f" {assessment.source}" if assessment.source and not assessment.limit else ""
        volume = f" {assessment.prior_volume.capitalize()}." if assessment.prior_volume else ""
        sentences.append(f"**{name}**{ends}:{limit} {p.verdict} ({reason}).{volume}")
    return " ".join(sentences)


def _coupling_sentences(inputs: ReportInputs) -> list[str]:
    """One sentence on each coupling against the stiffness of the second motion that it couples."""
    quantities = [
        quantity for quantity in inputs.posterior.problem.quantities if quantity.role == "stiffness" and quantity.places
    ]
    diagonal = {quantity.places[0]: quantity for quantity in quantities if not quantity.may_be_negative}
    couplings = [quantity for quantity in quantities if quantity.may_be_negative][:_MOST_COUPLINGS]
    return [coupling_sentence(inputs.summary, coupling, diagonal[coupling.places[0][1:] * 2]) for coupling in couplings]


def coupling_sentence(summary: Summary, coupling: Quantity, rotation: Quantity) -> str:
    """What the data say of a coupling against the stiffness of the rotation, in words with its numbers."""
    k12, k22 = (summary.parameters[quantity.name].known for quantity in (coupling, rotation))
    verdict = summary.parameters[coupling.name].verdict
    ends = k12.interval95 if any(map(math.isnan, k12.printed95)) else k12.printed95
    interval = "95 % interval" if any(k12.printed_by_likelihood) and not k12.limit else "95 % credible interval"
    shown = f"{rounded_interval(k12.interval95, k12.interval95_error) if k12.limit else k12.interval()} {coupling.unit}"
    if ends[0] <= 0 <= ends[1]:
        return (
            f"**The coupling stiffness {coupling.name} is {verdict}**: its {interval}, "
            f"{shown}, contains zero, so that not even its sign is known."
        )
    text = (
        f"**The coupling stiffness {coupling.name} is {verdict}**: its {interval} spans a factor of "
        f"{factor(ratio_of(ends))} ({shown})"
    )
    if k12.sd_log > 0 and k22.sd_log > 0:
        ratio = k12.sd_log / k22.sd_log
        compared = f"{number(ratio, 2)} times" if ratio >= 1 else f"only {number(ratio, 2)} times"
        text += (
            f"; the relative standard deviation is {number(100 * k12.sd_log, 2)} %, {compared} that of {rotation.name} "
            f"({number(100 * k22.sd_log, 2)} %)"
        )
    return text + "."
