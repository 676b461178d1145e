"""What the report says of the joint in each mode, against the eigenproblem of the assembled matrices."""

import re
from dataclasses import replace

import numpy as np
import pytest

from jointbayes.case.case import case_from_text
from jointbayes.report import ReportInputs
from jointbayes.report.sections.natural_frequencies import _sentence, joint_in_modes_section
from tests.conftest import cheap_text, edited, pair_matrix


def section_of(posterior, whose=None):
    """The section; `whose`: the posterior with whose summary, of which it needs the check alone."""
    inputs = ReportInputs(posterior)
    inputs.__dict__["summary"] = (whose or posterior).summary()  # without profiles
    return joint_in_modes_section(inputs.tests[0])


def table_of(posterior, whose=None):
    return section_of(posterior, whose).blocks[1]


def structure_of(problem):
    return problem.test.structures.at(problem.test.joints.dofs, problem.test.structures.reach_hz(3)).nominal


def test_frequencies_are_those_with_the_joint_and_with_a_clamp(cheap_posterior):
    problem, k = cheap_posterior.problem, cheap_posterior.estimate.values
    structure = structure_of(problem)
    at = structure.index(problem.test.joints.dofs)
    added = np.zeros_like(structure.stiffness)
    added[np.ix_(at, at)] = pair_matrix(k)
    joined, clamped = structure.modes(added), structure.fixed(problem.test.joints.dofs).modes()
    motion = joined.shapes[at, :3]
    share = 100 * np.einsum("im,ij,jm->m", motion, pair_matrix(k), motion) / joined.eigenvalues[:3]
    assert (share > 1).all()  # of strain energy
    for i, row in enumerate(table_of(cheap_posterior).rows):
        f, rigid = joined.frequency_hz[i], clamped.frequency_hz[i]
        assert row[:3] == (str(i + 1), f"{f:.2f}", f"{rigid:.2f}")
        assert float(row[3]) == pytest.approx(100 * (f / rigid - 1), abs=0.006)
        assert float(row[4]) == pytest.approx(share[i], rel=0.06)


def test_one_per_cent_more_of_a_stiffness_moves_a_frequency_as_the_table_says(cheap_posterior):
    problem, k = cheap_posterior.problem, cheap_posterior.estimate.values
    before = problem.natural_frequencies_hz(k, 3)[0]
    rows = table_of(cheap_posterior).rows
    for i in range(3):
        after = problem.natural_frequencies_hz(k * (1 + 0.01 * (np.arange(3) == i)), 3)[0]
        said = [float(row[5 + i]) for row in rows]
        np.testing.assert_allclose(said, 100 * (after / before - 1), rtol=0.1, atol=1e-9)


def test_the_sentence_propagates_the_error_of_a_natural_frequency(cheap_posterior):
    section = section_of(cheap_posterior)
    text, rows = section.blocks[0].text, section.blocks[1].rows
    mode, percent = re.search(r"^Mode (\d) is the most telling: .*\*\*k22\*\* to (\S+) %\.$", text).groups()
    assert float(percent) == pytest.approx(0.1 / float(rows[int(mode) - 1][7]), rel=0.06)


def test_stiffnesses_that_other_modes_show_best_have_their_modes():
    said = _sentence(np.array([1, 2]), ("k11", "k22"), np.array([[0.01, 0.1], [0.2, 0.1]]))
    assert said.endswith("it gives **k11** to 1 % (mode 2), **k22** to 0.5 % (mode 1).")


@pytest.mark.usefixtures("plain_reports")
def test_only_modes_of_the_measured_band_are_listed(cheap_posterior, frequency_posterior):
    def in_band(low, high):
        text = edited(
            cheap_text(), ("f_min_hz = 20.0", f"f_min_hz = {low}"), ("f_max_hz = 2500.0", f"f_max_hz = {high}")
        )
        other = replace(cheap_posterior, problem=case_from_text("band", text).problem)
        section = section_of(other, cheap_posterior)
        return None if section is None else [row[0] for row in section.blocks[1].rows]

    assert in_band(20.0, 2500.0) == ["1", "2", "3"]
    assert in_band(500.0, 1500.0) == ["2"]
    assert in_band(300.0, 600.0) is None
    measured = frequency_posterior.problem.test.data.frequency_hz
    assert len(table_of(frequency_posterior).rows) == measured.size


def test_near_the_edge_of_what_is_positive_semidefinite_the_strain_energy_is_still_a_share(frequency_posterior):
    stiff, soft = 3.577e10, 1e8
    coupled = np.array([np.log(stiff), np.log(soft), 0.9975])  # half a per cent less of k11 and the joint gives energy
    estimate = replace(frequency_posterior.estimate, theta=coupled)
    rows = table_of(replace(frequency_posterior, estimate=estimate), frequency_posterior).rows
    shares = [float(row[4]) for row in rows]
    assert all(0 < share < 100 for share in shares)
    # against the eigenvalue's own share: what is lost of the rigid joint's frequency is about twice that in the joint
    assert shares[0] == pytest.approx(-2 * float(rows[0][3]), rel=0.1)
