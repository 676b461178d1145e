"""The comparison of joints on the measured frequencies: evidences that were computed otherwise, ranking, winner."""

import numpy as np
import pytest

from jointbayes.case.case import load_case
from jointbayes.inference import hypothesis_problem
from jointbayes.studies.compare import compare
from tests.conftest import CONFIGS, on_paper_elements

pytestmark = pytest.mark.science

LONG, SHORT = "clamped_beam_frequencies", "clamped_beam_frequencies_360mm"
#: ln Z by nested sampling of another implementation (the rigid joint: its likelihood).
KNOWN = {
    (LONG, "rigid"): -16.19,
    (LONG, "springs"): -17.8,
    (LONG, "full"): -16.0,
    (SHORT, "rigid"): -950.9,
    (SHORT, "springs"): -14.2,
    (SHORT, "full"): -14.5,
}


@pytest.fixture(scope="module")
def cases():
    return {name: on_paper_elements(name) for name in (LONG, SHORT)}


@pytest.fixture(scope="module")
def comparison(cases):
    return compare(list(cases.values()), seed=1)


@pytest.fixture(scope="module")
def found(comparison):
    return {(c.case, c.hypothesis): c for c in comparison.candidates}


@pytest.mark.long
def test_the_measured_frequencies_speak_for_360_mm_and_two_plain_springs(comparison):
    assert (comparison.best.case, comparison.best.hypothesis) == (SHORT, "springs")
    assert comparison.best.at_edge == ()
    log10 = np.log10(comparison.best.stiffness[[0, 2]])
    assert (np.abs(log10 - [8.56, 5.11]) < [0.13, 0.02]).all()


def test_evidences_agree_with_nested_sampling_elsewhere_within_half_a_unit(found):
    for key, expected in KNOWN.items():
        assert found[key].evidence.log_z == pytest.approx(expected, abs=0.5), key
        assert not found[key].evidence.error > 0.05


@pytest.mark.parametrize("case", [LONG, SHORT])
@pytest.mark.parametrize("hypothesis", ["translation", "rotation", "springs"])
def test_evidences_of_springs_agree_with_quadrature(cases, found, case, hypothesis):
    """Midpoints of a fine grid over the prior's box: no random numbers, no proposal, no other coordinates."""
    problem = hypothesis_problem(cases[case].problem, hypothesis)
    low, high = problem.prior.support
    cells = 20_000 if low.size == 1 else 300
    axes = [lo + (hi - lo) * (np.arange(cells) + 0.5) / cells for lo, hi in zip(low, high, strict=True)]
    theta = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=-1)
    log_likelihood = problem.log_posterior.log_likelihood(theta)
    expected = np.log(np.exp(log_likelihood - log_likelihood.max()).mean()) + log_likelihood.max()
    evidence = found[case, hypothesis].evidence
    laplace = evidence.method == "Laplace"  # without an error, and only where the hypothesis is out of the question
    assert evidence.log_z == pytest.approx(expected, abs=0.1 if laplace else 4 * evidence.error + 1e-3)
    assert laplace == ((case, hypothesis) == (SHORT, "translation"))
    assert laplace or evidence.error < 0.01


@pytest.mark.docs
def test_the_page_on_comparison_shows_the_evidences_that_are_found():
    shipped = compare([load_case(CONFIGS / f"{name}.toml") for name in (LONG, SHORT)], seed=1)
    found = {(c.case, c.hypothesis): c for c in shipped.candidates}
    page = (CONFIGS.parent / "docs" / "comparison.md").read_text(encoding="utf-8")
    lines = [line.strip("|").split("|") for line in page.splitlines() if line[:3] == "| `"]
    rows = [[cell.strip(" `") for cell in line] for line in lines]
    shown = {(case, hypothesis): log_z for hypothesis, case, log_z, *_ in rows if case in (LONG, SHORT)}
    assert shown.keys() == found.keys()
    for key, text in shown.items():
        assert float(text.split("±")[0].replace("−", "-")) == pytest.approx(found[key].evidence.log_z, abs=0.02), key
