"""Three signals of page one: whether the calculation, the model and the data can be trusted, a sentence each."""

import math

from jointbayes.phrases import DO_NOT_USE
from jointbayes.posterior.compared_frfs import sentences_of_faults
from jointbayes.posterior.model_errors import InferredError
from jointbayes.posterior.summary import Summary, TestSummary
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import foreign
from jointbayes.report.model import Light, Lights
from jointbayes.rounding import number


def lights_of(inputs: ReportInputs) -> Lights:
    """Calculation, model and data."""
    return Lights((_calculation(inputs), _model(inputs), _data(inputs)))


def _calculation(inputs: ReportInputs) -> Light:
    posterior, summary = inputs.posterior, inputs.summary
    name = "Calculation"
    if not posterior.converged:
        how = f"Run it longer ([sampling] {posterior.record.limit_to_raise})."
        return Light(name, "bad", f"Not settled: {DO_NOT_USE}. {how}")
    if not posterior.mode_agrees:
        text = f"The search missed the best fit: it lies {number(posterior.mode_distance, 2)} standard deviations away."
        return Light(name, "bad", text)
    if posterior.at_prior_edge and not posterior.problem.premises.of_modes:
        text = f"The best fit lies on the edge of the prior of {foreign(', '.join(posterior.at_prior_edge))}: widen it."
        return Light(name, "caution", text)
    if summary.mesh is not None and not summary.mesh.within:
        return Light(name, "caution", foreign(summary.mesh.sentence))
    return Light(name, "good", posterior.record.state)


def _model(inputs: ReportInputs) -> Light:
    summary = inputs.summary
    name, worst = "Model", worst_test(summary)
    of_test = f" of test {foreign(worst.check.test)}" if worst.check.test else ""
    bodies = summary.measured_bodies
    if bodies is not None and not bodies.within:
        return Light(name, "bad" if bodies.ignored else "caution", foreign(bodies.sentence))
    if not worst.check.explains:
        misfit = f"{_misfit(worst)} {worst.diagnosis.measure}".strip()
        return Light(name, "bad", f"Does not explain the {worst.check.of}{of_test}. {misfit}")
    if worst.check.finding == "noise overstated":
        return Light(
            name, "caution", f"Explains the {worst.check.of}{of_test}, with noise stated too large. {_misfit(worst)}"
        )
    of_all = f" of all {len(summary.tests)} tests" if len(summary.tests) > 1 else ""
    if summary.model_error is not None:
        return _by_its_error(summary.model_error, of_all)
    return Light(name, "good", f"Explains the {worst.check.of}{of_all}. {_misfit(worst)}")


def _by_its_error(error: InferredError, of_all: str) -> Light:
    """Of a model whose error was inferred its size says how good it is: residuals are small beside any such size."""
    if error.grade == "negligible":
        return Light("Model", "good", f"Explains the modes{of_all}.")
    if error.grade == "usual":
        text = f"Explains the modes{of_all}. Its natural frequencies are off by {error.words}, as is usual."
        return Light("Model", "good", text)
    found = " and ".join(error.findings)
    if error.grade == "large":
        return Light("Model", "caution", f"More than usual: {found}. {error.causes}")
    return Light("Model", "bad", f"It is no model of this structure: {found}. {error.causes}")


def worst_test(summary: Summary) -> TestSummary:
    """The test that the model explains worst."""
    return min(summary.tests.values(), key=lambda test: test.check.smallest_p_value)


def _misfit(test: TestSummary) -> str:
    """The misfit in units of the noise, beside what noise alone gives."""
    check = test.check
    misfit, low, high = (f"{math.sqrt(square):#.3g}" for square in (check.chi2_per_line, *check.chi2_band))
    return f"Misfit {misfit} times the noise; noise alone gives {low} to {high}."


def _data(inputs: ReportInputs) -> Light:
    summary = inputs.summary
    doubts = [text for test, frfs in summary.compared_frfs.items() for text in sentences_of_faults(frfs, test)]
    doubts += [
        f"Check {warning.where}: {warning.sentence}" for test in inputs.tests
        for warning in getattr(test.problem.test.data.provenance, "warnings", ())
    ]  # fmt: skip
    doubts += [f"Check {warning}" for warning in summary.warnings]
    if doubts:
        more = f" And {len(doubts) - 1} more, see below." if len(doubts) > 1 else ""
        return Light("Data", "caution", f"{foreign(_short(doubts[0]))}{more}")
    if summary.fit.synthetic_data:
        return Light("Data", "caution", "Computed from the joint and the noise that the case states, not measured.")
    return Light("Data", "good", f"{summary.fit.n_data} measured values; nothing in them looks doubtful.")


def _short(text: str, most: int = 180) -> str:
    """A sentence to its full stop, or as far as there is room."""
    return f"{text.rstrip('.')}." if len(text) <= most else f"{text[: most - 1].rstrip(' .,')} …"
