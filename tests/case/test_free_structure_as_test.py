"""A test in which nothing is joined: `joined = false` in its table."""

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.frf import NaturalFrequencies
from jointbayes.joint import Joints
from jointbayes.posterior.fisher import fisher_information
from tests.case.refusal_rows import parts_named
from tests.case.test_several_tests import BASE
from tests.conftest import FEW_STEPS, TABLE_3, plain_reports, shipped_text
from tests.science.calibration import simulated_problem

MATERIAL, FREE, HEARD_FREE, _ = parts_named("free_structure").values()
TWO = BASE + MATERIAL + FREE + "[tests.clamped]\n"


def built(text):
    return jb.case_from_text("case", text)


@pytest.fixture(scope="module")
def two():
    return built(TWO)


def test_a_test_that_is_not_joined_shares_the_material_and_no_stiffness(two):
    free, clamped = two.problem.tests
    assert ((free.name, clamped.name), free.joints) == (("free", "clamped"), Joints(()))
    assert clamped.joints.labels == ("1:y", "1:rz")
    assert two.problem.names == ("k11", "k12", "k22", "youngs_modulus", "density", "length")
    assert two.spec.joined  # what is said of the run is that of a test with its joint
    assert two.warnings == ()
    alone = built(BASE + MATERIAL)
    assert two.problem.prior.all_marginals == alone.problem.prior.all_marginals
    np.testing.assert_array_equal(two.problem.first_guess, alone.problem.first_guess)
    assert free.data.joint_frf.outputs == ("11:y",)


def test_the_data_of_a_free_test_are_made_by_the_free_structure(two):
    part = two.problem.part("free")
    exact = NaturalFrequencies(part.test.structures, Joints(()), 2).frequency_hz(np.zeros((1, 0, 0)), np.ones((1, 3)))
    np.testing.assert_allclose(part.natural_frequencies_hz(TABLE_3, 2), exact, rtol=1e-12)
    theta = np.array([*np.log(TABLE_3), 0.0, 0.0, 0.0])
    assert 0.7 < np.mean(np.abs(part.log_posterior.standardised(theta)) ** 2) < 1.3
    again = simulated_problem(two.problem, two.problem, theta, np.random.default_rng(1))
    assert 0.7 < np.mean(np.abs(again.part("free").log_posterior.standardised(theta)) ** 2) < 1.3


def test_natural_frequencies_of_the_free_structure_are_data_whose_numbers_begin_with_the_first_that_bends():
    case = built(BASE + MATERIAL + HEARD_FREE)
    assert (case.problem.tests[0].data.frequency_hz.tolist(), case.warnings) == ([778.4, 2103.5], ())
    part = case.problem.part("free")
    np.testing.assert_allclose(part.natural_frequencies_hz(TABLE_3, 2)[0], [778.4, 2103.5], rtol=1e-4)
    assert "numbers" in str(built(BASE + MATERIAL + HEARD_FREE.replace("778.4, 2103.5", "2103.5, 4012.0")).warnings[0])


def test_joints_of_each_test_are_those_of_joined_ones():
    problem = built(BASE.replace("[joint]", "[joint]\nown = true") + FREE + "[tests.a]\n[tests.b]\n").problem
    assert problem.names == ("a.k11", "a.k12", "a.k22", "b.k11", "b.k12", "b.k22")


def test_a_free_test_needs_no_table_of_a_joint():
    head, _, tail = BASE.partition("[joint]\n")
    dofs, _, rest = tail.partition("\n\n")
    assert built(f"{head}{rest}{FREE}[tests.clamped.joint]\n{dofs}\n").problem.names == ("k11", "k12", "k22")


def test_what_the_bar_tells_free_is_what_its_uncertain_material_took_from_the_stiffness_of_the_clamp():
    """Linearised at the truth: all exactly known, as in a workshop, hit free as well."""
    theta, sds = np.array([*np.log(TABLE_3), 0.0, 0.0, 0.0]), []
    for more in ("", MATERIAL, MATERIAL + FREE + "[tests.clamped]\n"):
        problem = built(shipped_text("clamped_beam") + more).problem
        sds.append(fisher_information(problem, theta[: len(problem.names)]).stiffness_sd()["k22"])
    assert sds[1] > 100 * sds[0]
    assert sds[2] < 2 * sds[0]


@pytest.mark.long
@pytest.mark.science
def test_a_run_with_a_free_test_is_told_and_written(tmp_path, two):
    posterior = jb.sample(two, seed=1, settings=FEW_STEPS)
    assert posterior.estimate.iteration.test == "clamped"
    with plain_reports():
        jb.write_report(posterior, tmp_path / "run")
    page = (tmp_path / "run" / "report.html").read_text()
    assert "; nothing joined" in page
    assert page.count("Which modes show the joint") <= 1
