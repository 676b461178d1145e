"""Several tests: a table of all, what is said of the data of each, and ratios of what is each test's own."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointbayes.posterior.posterior import Posterior
from jointbayes.report.inputs import ReportInputs, TestInputs
from jointbayes.report.markup import foreign
from jointbayes.report.model import Block, Figure, Paragraph, ReportSection, Table
from jointbayes.rounding import number


def overview_section(inputs: ReportInputs) -> ReportSection | None:
    """A row for each test: its data, and whether the model explains them; None of a lone test."""
    if len(inputs.tests) == 1:
        return None
    of = [(test.problem.test, test.summary) for test in inputs.tests]
    columns = {
        "Test": [foreign(test.name) for test, _ in of],
        "Data": [f"{t.data.in_short(foreign)}{'' if t.joints.size else '; nothing joined'}" for t, _ in of],
        "Values": [str(summary.fit.n_data) for _, summary in of],
        "Residuals over noise": [number(math.sqrt(summary.fit.chi2_per_line)) for _, summary in of],
        "Explained": ["yes" if summary.check.explains else "no" for _, summary in of],
    }
    note = (
        "Residuals over noise: of the best fit to all tests, about 1 expected. Explained: whether the model explains "
        "its data. A quantity whose name begins with a test's is its own; all others are one for all."
    )
    kinds = tuple("" if explained == "yes" else "bad" for explained in columns["Explained"])
    table = Table.of("Tests", columns, note=note, row_kinds=kinds)
    return ReportSection("tests", "Tests", (table, *ratios_of_tests(inputs.posterior)))


def section_of_test(place: int, inputs: TestInputs, sections: Sequence[ReportSection]) -> ReportSection:
    """What the sections on the data say of one test, one after the other."""
    blocks: list[Block] = []
    for section in sections:
        blocks.append(Paragraph(f"**{section.title}.**"))
        blocks += (
            replace(b, identifier=f"test-{place}-{b.identifier}") if isinstance(b, Figure) else b
            for b in section.blocks
        )
    return ReportSection(f"test-{place}", f"Test {foreign(inputs.problem.test.name)}", tuple(blocks))


def ratios_of_tests(posterior: Posterior) -> tuple[Table, ...]:
    """Each test's own quantity over the same quantity of the first test; no table where tests share all."""
    owners: dict[str, list[str]] = {}
    for name in posterior.stiffness_names:
        for test in posterior.problem.tests:
            own = f"{test.name}."
            if name[: len(own)] == own:
                owners.setdefault(name[len(own) :], []).append(test.name)
    rows = []
    for name, (first, *others) in owners.items():
        for other in others:
            over, below = posterior[f"{other}.{name}"].values, posterior[f"{first}.{name}"].values
            if min(over.min(), below.min()) <= 0:  # of draws of either sign a ratio says nothing
                continue
            low, median, high = np.quantile(over / below, [0.025, 0.5, 0.975]).tolist()
            ends = f"{number(low, 4)} to {number(high, 4)}"
            rows.append((name, foreign(f"{other} over {first}"), number(median, 4), ends))
    head = ("Quantity", "Tests", "Ratio (median)", "95 % interval")
    note = "A ratio is often known better than its parts, which share material, damping and errors of the model."
    return (Table("Ratios of tests", head, tuple(rows), note=note),) if rows else ()
