"""What every section of a report is written from."""

import math
from dataclasses import dataclass
from functools import cached_property

from jointbayes.inference import Problem
from jointbayes.posterior import Knowledge, Posterior, PredictiveCheck, gather_knowledge
from jointbayes.posterior.summary import Summary, TestSummary, specimen_line
from jointbayes.report.markup import foreign
from jointbayes.rounding import told_apart
from vibrecords.arrays import Array


def computed_from(posterior: Posterior) -> str:
    """From what the data in files were computed, where the case says that they were not measured."""
    return "" if posterior.case is None else posterior.case.about.get("computed", "")


@dataclass(frozen=True)
class TestInputs:
    """What the sections on the data of one test are written from.

    Parameters
    ----------
    posterior
        Of all tests.
    problem
        The problem of this one.
    summary
        The numbers of its data.
    """

    __test__ = False

    posterior: Posterior
    problem: Problem
    summary: TestSummary


@dataclass(frozen=True)
class ReportInputs:
    """A posterior, and what is computed of it once for all sections.

    Parameters
    ----------
    posterior
        The posterior, with the problem that was sampled and, if there was one, its case.
    """

    posterior: Posterior

    @property
    def tests(self) -> tuple[TestInputs, ...]:
        """Each test; a lone test is one."""
        parts, summaries = self.posterior.problem.parts, self.summary.tests
        return tuple(TestInputs(self.posterior, part, summaries[part.test.name]) for part in parts)

    @cached_property
    def knowledge(self) -> Knowledge:
        """Check of the model, directions, profiles, effect of uncertain inputs, next step."""
        return gather_knowledge(self.posterior)

    @cached_property
    def summary(self) -> Summary:
        """The numbers of the run, as in ``summary.json``."""
        return self.posterior.summary(self.knowledge)

    @property
    def title(self) -> str:
        """Title of the case, or the problem's name."""
        case = self.posterior.case
        return foreign(self.posterior.problem.name if case is None else case.title)

    @property
    def computed(self) -> str:
        """From what the data were computed; empty of measured data."""
        stated = "the joint and the noise that the case states" if self.summary.fit.synthetic_data else ""
        return stated or foreign(computed_from(self.posterior))

    @property
    def specimen(self) -> str:
        """What was tested, when, by whom and with what, in one line; empty where the case does not say."""
        return "" if self.posterior.case is None else foreign(specimen_line(self.posterior.case.about))

    @property
    def case_text(self) -> str:
        """TOML text of the case, where it states the problem that was sampled."""
        case = self.posterior.case
        return self.posterior.record.case_text if case is not None and case.stated is self.posterior.problem else ""

    @property
    def reference(self) -> Array | None:
        """Published (k11, k12, k22), shape (3,), if the case states any."""
        return None if self.posterior.case is None else self.posterior.case.reference

    @property
    def reference_source(self) -> str:
        """Where the published stiffnesses are from; empty without any."""
        return "" if self.posterior.case is None else foreign(self.posterior.case.reference_source)


def explained(check: PredictiveCheck, of_tests: str = "") -> str:
    """Whether the model explains the data, after "the model", with residuals next to those that noise alone gives."""
    size, low, high = told_apart(*map(math.sqrt, (check.chi2_per_line, *check.chi2_band)))
    overstated = ", with noise stated too large" * (check.level in ("below", "far below"))
    pattern = ", in a pattern along frequency" if check.pattern == "correlated" and not check.explains else ""
    verb = "explains" if check.explains else "does not explain"
    said = f"{verb} the {check.of}{of_tests}{overstated}."
    return f"{said} Residuals are {size} times the noise{pattern}; noise alone gives {low} to {high}."
