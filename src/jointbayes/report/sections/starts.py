"""Where the mode came from: the starts of the search, and the paper's iteration."""

from jointbayes.arrays import Array
from jointbayes.identification import IterationHistory, missing_for_iteration
from jointbayes.joint import Quantity
from jointbayes.posterior.rounding import number
from jointbayes.report import figures
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import foreign
from jointbayes.report.model import Block, Figure, Paragraph, Section, Table


def starts_section(inputs: ReportInputs) -> Section:
    """Where the mode came from: the starts, and the paper's iteration or what is missing for it."""
    posterior, estimate = inputs.posterior, inputs.posterior.estimate
    rows = tuple(
        (
            foreign(start.name),
            ", ".join(number(k) for k in start.start),
            ", ".join(number(k) for k in start.stiffness),
            number(start.log_posterior, 7),
            "yes" if start.reached_mode else "no",
        )
        for start in estimate.starts
    )
    head = ("Start", f"{foreign(', '.join(posterior.stiffness_names))} from", "to", "ln p", "Mode reached")
    reached = len(rows) - len(estimate.failed_starts)
    text = f"{reached} of {len(rows)} starts reach the mode"
    text += f"; these do not: {foreign(estimate.failed_text)}." if estimate.failed_starts else "."
    text += (
        f" The joint mode refined from the best draw lies {number(posterior.mode_distance, 2)} Laplace sd from the MAP."
    )
    if estimate.sentence:
        text += f" {estimate.sentence}"
    blocks: list[Block] = [Paragraph(text), Table("Starts of the MAP search, and where each led", head, rows)]
    if estimate.iteration is not None:
        blocks += _iteration_blocks(estimate.iteration, posterior.problem.quantities, inputs.reference)
    elif missing := missing_for_iteration(posterior.problem):
        blocks.append(Paragraph(f"**The paper's iteration was left out.** {foreign(missing)}."))
    return Section("starts", "Starting points and the paper's iteration", tuple(blocks))


def _iteration_blocks(
    history: IterationHistory, quantities: tuple[Quantity, ...], published: Array | None
) -> list[Block]:
    norm, iterated = history.residual_norm, [quantities[i] for i in history.iterated]
    settled = ", ".join(
        f"{q.name} {100 * abs(history.stiffness_history[min(5, history.steps), i] / history.stiffness[i] - 1):.1f} %"
        for i, q in zip(history.iterated, iterated, strict=True)
        if history.stiffness[i] != 0
    )
    text = f"**The paper's iteration (Eqs. 3–9)**{foreign(history.on_setup)} {history.reason}. "
    text += f"Step 5 differs from the last step by: {foreign(settled)}."
    if len(iterated) < len(quantities):
        text += " Quantities that do not act in that set-up stay at the first guess."
    return [
        Paragraph(text),
        Figure(
            "iteration-norm",
            "Norm of the residual FRF over the iteration, as in the paper's Fig. 7.",
            f"Residual norm falls from {number(norm[0])} to {number(norm[-1])} in {history.steps} steps.",
            figures.residual_norm(norm),
        ),
        Figure(
            "iteration-stiffness",
            "Stiffnesses over the iteration, as in the paper's Fig. 8.",
            f"History of {_listed([q.name for q in iterated])} over the iteration steps with the published values.",
            figures.histories(
                [f"{q.name} ({q.unit})" for q in iterated],
                history.stiffness_history[:, history.iterated],
                None if published is None else published[list(history.iterated)],
            ),
        ),
    ]


def _listed(names: list[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last
