"""The report of a run: page one, five pages that bear it out, and behind them everything else."""

import datetime
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import chain
from typing import TypeAlias, TypeVar

from jointbayes.report.inputs import ReportInputs, TestInputs
from jointbayes.report.methods import methods_section, rules_of, terms_section
from jointbayes.report.model import Block, Figure, Paragraph, Report, ReportSection, Table
from jointbayes.report.pdf import share_pages
from jointbayes.report.sections.fit_to_data import check_section, fit_section, left_out_section
from jointbayes.report.sections.identifiable import (
    knowledge_section,
    likelihood_section,
    nuisance_section,
    numbers_section,
    posterior_section,
)
from jointbayes.report.sections.lead import answer_section, lead, worst_test
from jointbayes.report.sections.measured_data import (
    case_warnings_section,
    measured_bodies_section,
    measured_modes_section,
    measurement_section,
)
from jointbayes.report.sections.natural_frequencies import frequency_section, joint_in_modes_section, own_section
from jointbayes.report.sections.run_details import sampling_section, settings_section, starts_section
from jointbayes.report.sections.several_tests import overview_section, section_of_test

Inputs = TypeVar("Inputs")
Section: TypeAlias = Callable[[ReportInputs], ReportSection | None]
SectionOfData: TypeAlias = Callable[[TestInputs], ReportSection | None]

_OF_MODES = (frequency_section, own_section, joint_in_modes_section)
_OF_DATA = (measurement_section, measured_modes_section)
#: The pages in their order: identifier, title, sections on all tests together, then sections on the data of one. Each
#: section takes its inputs and returns None with nothing to say.
PAGES: tuple[tuple[str, str, tuple[Section, ...], tuple[SectionOfData, ...]], ...] = (
    ("fit", "Measured and predicted", (overview_section,), (fit_section,)),
    ("modes", "Natural frequencies and modes", (), _OF_MODES),
    ("posterior", "Stiffness", (answer_section, posterior_section), ()),
    ("known", "What the answer rests on", (knowledge_section, nuisance_section, left_out_section), ()),
    ("data", "Data", (case_warnings_section, measured_bodies_section), _OF_DATA),
)
#: Behind the pages.
APPENDIX: tuple[Section, ...] = (
    numbers_section,
    check_section,
    sampling_section,
    starts_section,
    likelihood_section,
    settings_section,
    methods_section,
)


def build_report(inputs: ReportInputs, date: datetime.date) -> Report:
    """Build the report: the answer first, then what bears it out, then the appendix."""
    pages, more = [], []
    worst = worst_test(inputs.summary)  # whose data the pages show
    shown = next(test for test in inputs.tests if test.summary is worst)
    shared = share_pages([_blocks(sections, inputs, of_data, shown) for _, _, sections, of_data in PAGES])
    for (identifier, title, *_), (page, rest) in zip(PAGES, shared, strict=True):
        pages += [ReportSection(identifier, title, page)] if page else []
        more += [ReportSection(f"{identifier}-more", f"{title}, the rest", rest, appendix=True)] if rest else []
    others = [test for test in enumerate(inputs.tests, 1) if test[1].problem.test.name != shown.problem.test.name]
    of_data = tuple(chain.from_iterable(page[3] for page in PAGES))
    more += [replace(section_of_test(n, test, _written(of_data, test)), appendix=True) for n, test in others]
    appendix = [replace(section, appendix=True) for section in _written(APPENDIX, inputs)]
    first = lead(inputs)
    said = " ".join(
        str(block)
        for block in chain(first, *(section.blocks for section in (*pages, *more, *appendix)))
        if not isinstance(block, Figure)
    )
    # tables are no wider than a page
    sections = [
        replace(section, blocks=tuple(b.turned() if isinstance(b, Table) else b for b in section.blocks))
        for section in (*pages, *more, *appendix)
    ]
    return _report(inputs, date, first, (*sections, terms_section(said, rules_of(inputs.posterior))))


def one_page(inputs: ReportInputs, date: datetime.date) -> Report:
    """Build page one as a document of its own, for the file of a customer: the same numbers and sentences."""
    return _report(inputs, date, lead(inputs, alone=True), ())


def _report(
    inputs: ReportInputs, date: datetime.date, first: tuple[Block, ...], sections: tuple[ReportSection, ...]
) -> Report:
    computed = " — computed data" if inputs.computed else ""
    version = inputs.posterior.record.versions["jointbayes"]
    return Report(inputs.title, f"Joint stiffness with uncertainty{computed}", first, sections, date, version)


def _blocks(
    sections: Sequence[Section], inputs: ReportInputs, of_data: Sequence[SectionOfData], shown: TestInputs
) -> list[Block]:
    """What the sections of a page say, one after the other."""
    blocks = list(chain.from_iterable(section.blocks for section in _written(sections, inputs)))
    of_test = list(chain.from_iterable(section.blocks for section in _written(of_data, shown)))
    if of_test and len(inputs.tests) > 1:
        which = "the one that the model explains worst; the others are in the appendix."
        blocks.append(Paragraph(f"**Test {shown.problem.test.name}**, {which}"))
    return [*blocks, *of_test]


def _written(sections: Iterable[Callable[[Inputs], ReportSection | None]], inputs: Inputs) -> list[ReportSection]:
    return [written for section in sections if (written := section(inputs)) is not None]
