"""Three signals of page one: whether the calculation, the model and the data can be trusted, a sentence each."""

import math

from jointbayes.phrases import NO_VERDICT_NO_USE
from jointbayes.posterior import PredictiveCheck
from jointbayes.posterior.compared_frfs import sentences_of_faults
from jointbayes.posterior.summary import Summary, TestSummary
from jointbayes.posterior.verdicts import default_priors, mode_agrees, mode_distance
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import foreign
from jointbayes.report.model import Kind, Light, Lights
from jointbayes.rounding import number, sentence_start, told_apart

_LONGEST = 180  # characters of a doubt
#: What may be found of calculation, model and data, and the colour of the light then.
FINDINGS: dict[str, tuple[str, Kind]] = {
    "not settled": ("Calculation", "bad"), "best fit missed": ("Calculation", "bad"),
    "edge of a stated prior": ("Calculation", "caution"), "coarse mesh": ("Calculation", "caution"),
    "settled": ("Calculation", "good"),
    "misfit": ("Model", "bad"), "noise of bodies ignored": ("Model", "bad"),
    "no model of this structure": ("Model", "bad"), "noise of bodies": ("Model", "caution"),
    "noise overstated": ("Model", "caution"), "large error": ("Model", "caution"),
    "usual error": ("Model", "good"), "explained": ("Model", "good"),
    "doubts": ("Data", "caution"), "computed": ("Data", "caution"), "measured": ("Data", "good"),
}  # fmt: skip


def lights_of(inputs: ReportInputs) -> Lights:
    """Calculation, model and data."""
    found = (_calculation(inputs), _model(inputs), _data(inputs))
    return Lights(tuple(Light(*FINDINGS[finding], text, finding) for finding, text in found))


def _calculation(inputs: ReportInputs) -> tuple[str, str]:
    """Finding on the calculation, and its sentence."""
    posterior, summary = inputs.posterior, inputs.summary
    if not posterior.converged:
        how = f"Run it longer ([sampling] {posterior.record.limit_to_raise})."
        return "not settled", f"Not converged: {NO_VERDICT_NO_USE}. {how}"
    if not mode_agrees(posterior):
        away = number(mode_distance(posterior), 2)
        return "best fit missed", f"The search missed the best fit: it lies {away} standard deviations away."
    # A default range is no statement of the user, so no one is asked to widen it.
    at_edge, default = posterior.problem.prior.coordinates_at_edge(posterior.best.theta), default_priors(posterior)
    edges = [name for name in at_edge if name not in default]
    if edges and not posterior.problem.premises.of_modes:
        text = f"The best fit lies on the edge of the prior of {foreign(', '.join(edges))}: widen it."
        return "edge of a stated prior", text
    if summary.mesh is not None and not summary.mesh.within:
        return "coarse mesh", foreign(summary.mesh.sentence)
    return "settled", posterior.record.state


def _model(inputs: ReportInputs) -> tuple[str, str]:
    """Finding on the model, and its sentence."""
    summary = inputs.summary
    worst = worst_test(summary)
    of_test = f" of test {foreign(worst.check.test)}" if worst.check.test else ""
    bodies, error = summary.measured_bodies, summary.model_error
    if bodies is not None and not bodies.within:
        return "noise of bodies ignored" if bodies.ignored else "noise of bodies", foreign(bodies.sentence)
    of_all = f" of all {len(summary.tests)} tests" if len(summary.tests) > 1 else ""
    if error is None or not worst.check.explains or worst.check.finding == "noise overstated":
        text = sentence_start(explained(worst.check, (of_all or of_test) if worst.check.explains else of_test))
        if worst.check.explains:
            return worst.check.finding, text
        suspect = f" Check the sensor of FRF {foreign(worst.diagnosis.sensor)}." if worst.diagnosis.sensor else ""
        return "misfit", f"{text} {worst.diagnosis.measure}{suspect}".rstrip()
    # The size of an inferred error says how good the model is: residuals are small next to any such size.
    if error.grade == "negligible":
        return "explained", f"Explains the modes{of_all}."
    if error.grade == "usual":
        text = f"Explains the modes{of_all}. Its natural frequencies are off by {error.words}, as is usual."
        return "usual error", text
    found = " and ".join(error.findings)
    if error.grade == "large":
        return "large error", f"More than usual: {found}. {error.causes}"
    return "no model of this structure", f"It is no model of this structure: {found}. {error.causes}"


def worst_test(summary: Summary) -> TestSummary:
    """The test that the model explains worst."""
    return min(summary.tests.values(), key=lambda test: test.check.smallest_p_value)


def explained(check: PredictiveCheck, of_tests: str = "") -> str:
    """Whether the model explains the data, after "the model", with residuals next to those that noise alone gives."""
    size, low, high = told_apart(*map(math.sqrt, (check.chi2_per_line, *check.chi2_band)))
    overstated = ", with noise stated too large" * (check.level in ("below", "far below"))
    pattern = ", in a pattern along frequency" if check.pattern == "correlated" and not check.explains else ""
    verb = "explains" if check.explains else "does not explain"
    said = f"{verb} the {check.of}{of_tests}{overstated}."
    return f"{said} Residuals are {size} times the noise{pattern}; noise alone gives {low} to {high}."


def _data(inputs: ReportInputs) -> tuple[str, str]:
    """Finding on the data, and its sentence."""
    summary = inputs.summary
    doubts = [text for test, frfs in summary.compared_frfs.items() for text in sentences_of_faults(frfs, test)]
    doubts += [
        f"Check {warning.where}: {warning.sentence}" for test in inputs.tests
        for warning in getattr(test.problem.test.data.provenance, "warnings", ())
    ]  # fmt: skip
    doubts += [f"Check {warning}" for warning in summary.warnings]
    if doubts:
        more = f" And {len(doubts) - 1} more, see below." if len(doubts) > 1 else ""
        first = doubts[0].rstrip(".")  # to its full stop, or as far as there is room
        first = f"{first}." if len(first) < _LONGEST else f"{first[: _LONGEST - 1].rstrip(' .,')} …"
        return "doubts", f"{foreign(first)}{more}"
    if inputs.computed:
        return "computed", f"Computed from {inputs.computed}, not measured."
    return "measured", f"{summary.fit.n_data} measured values; nothing in them looks doubtful."
