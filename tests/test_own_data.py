"""A kind of data of one's own, from its class to a report: the example that docs/developing.md names."""

import ast
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from benchmarks.size import ROOT

import jointbayes as jb
from jointbayes.frf import DirectSolve, Ports, receptance_model
from jointbayes.inference import GaussianLikelihood, JointPrior, Uniform, likelihood_of
from jointbayes.report import compared_section
from jointbayes.report.markup import foreign
from jointbayes.report.model import ReportSection, Table
from tests.conftest import CLAMP, PAIR, TABLE_3, TO_CONVERGE, pair_matrix, rod
from tests.one_line import refused, says
from tests.science.calibration import simulated_problem
from vibrecords import Data, FrfSet


@dataclass(frozen=True, eq=False)
class StaticDeflections(Data):
    """Deflection under a static force, shape (outputs, inputs), m/N, with standard deviations of the same shape."""

    words: ClassVar[str] = "static deflections"

    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    deflection: np.ndarray
    sd: np.ndarray

    @property
    def dofs(self):
        return self.outputs + self.inputs

    @property
    def band_hz(self):
        return 0.0, 0.0

    def with_values(self, values):
        return replace(self, deflection=values.reshape(self.sd.shape))


class StaticModel:
    """Predicts them: the receptance at 0 Hz, the first of two lines."""

    def __init__(self, data, structure, joint):
        self._count = data.sd.size
        self._model = receptance_model(structure, joint, Ports(np.array([0.0, 1.0]), data.outputs, data.inputs))

    def predicted_values(self, matrices, factors=None):
        static = self._model.receptance(matrices, factors)[:, 0].real
        return static.reshape(len(static), self._count)  # there may be none

    def tangent(self, matrix, directions, factors=None):
        value, slope = self._model.tangent(matrix, directions, factors)
        return value[0].real.ravel(), slope[:, 0].real.reshape(len(slope), self._count)


@likelihood_of.register(StaticDeflections)
def static_likelihood(data, test, *, gain=False):
    model = StaticModel(data, test.structure, test.joints)
    return GaussianLikelihood(model, data.deflection.ravel(), data.sd.ravel(), test.structures.names, test.noise)


@compared_section.register(StaticDeflections)
def static_section(data, inputs):
    problem, theta = inputs.problem, inputs.posterior.estimate.theta
    predicted = problem.log_posterior.predicted(theta)[0]
    pairs = [foreign(f"{output}/{input_}") for output in data.outputs for input_ in data.inputs]
    rows = zip(pairs, data.deflection.ravel(), data.sd.ravel(), predicted, strict=True)
    texts = tuple((pair, *(f"{value:.4g}" for value in values)) for pair, *values in rows)
    table = Table("Static deflections", ("Pair", "Measured (m/N)", "sd", "MAP"), texts)
    return ReportSection("deflections", "Static deflections", (table,))


DOFS = ("1:y", "1:rz", "5:y")
BEAM = rod(elements=4)


@pytest.fixture(scope="module")
def problem():
    """A cantilever on its joint, loaded and measured at the joint and the tip."""
    exact = DirectSolve(BEAM, CLAMP, Ports(np.zeros(1), DOFS, DOFS)).receptance(pair_matrix(TABLE_3)[None])[0, 0].real
    sd = 0.01 * np.abs(exact)
    deflection = exact + sd * np.random.default_rng(1).normal(size=sd.shape)
    prior = JointPrior(PAIR, tuple(Uniform(np.log(k) - 2, np.log(k) + 2) for k in TABLE_3))
    data = StaticDeflections(DOFS, DOFS, deflection, sd)
    return jb.Problem(structure=BEAM, joint=CLAMP, data=data, prior=prior, name="static")


@pytest.fixture(scope="module")
def posterior(problem):
    return jb.sample(problem, seed=1, settings=TO_CONVERGE)


def test_the_example_predicts_what_solving_the_structure_with_its_joint_gives(problem):
    wanted = DirectSolve(BEAM, CLAMP, Ports(np.zeros(1), DOFS, DOFS)).receptance(pair_matrix(TABLE_3)[None])[0, 0].real
    np.testing.assert_allclose(problem.log_posterior.predicted(np.log(TABLE_3))[0], wanted.ravel(), rtol=1e-8)


def test_find_map_finds_the_joint_of_data_of_ones_own(problem):
    estimate = jb.find_map(problem)
    sd = np.sqrt(np.diag(estimate.covariance))
    assert (np.abs(estimate.theta - np.log(TABLE_3)) < 4 * sd).all()
    assert (sd < 0.5).all()


def test_draws_summary_and_check_take_data_of_ones_own(posterior):
    assert posterior.converged
    assert posterior.check.explains
    summary = posterior.summary()
    assert summary.fit.n_data == 9
    assert 0.1 < summary.fit.chi2_per_line < 3
    low, high = posterior.interval("k22")
    assert low < TABLE_3[2] < high
    stored = posterior.tree["observed_data"]["deflection"].values
    np.testing.assert_array_equal(stored, posterior.problem.test.data.deflection)


def test_a_misfit_of_data_of_ones_own_is_told(problem):
    data = problem.test.data
    wrong = problem.with_test(data=data.with_values(data.deflection * np.linspace(0.7, 1.4, 9).reshape(3, 3)))
    posterior = jb.sample(wrong, seed=1, settings=TO_CONVERGE)
    assert not posterior.check.explains
    assert "NOT explain" in posterior.check.sentence


def test_a_file_says_that_it_cannot_hold_data_of_ones_own_and_takes_the_problem(posterior, tmp_path):
    path = tmp_path / "posterior.nc"
    posterior.save(path)
    refused(
        lambda: jb.load_posterior(path), jb.ModelError, r"problem\.tests\[0\]\.data \(StaticDeflections\).*problem="
    )
    np.testing.assert_array_equal(jb.load_posterior(path, problem=posterior.problem).theta, posterior.theta)


@pytest.mark.whole
def test_the_report_has_the_section_of_data_of_ones_own(posterior, tmp_path):
    jb.write_report(posterior, tmp_path / "report")
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    says(page, "Static deflections", "5:y/1:rz")


def test_data_of_ones_own_stand_beside_frfs_and_are_simulated_for_a_calibration(problem):
    lines = np.arange(20.0, 500.0, 20.0)
    values = receptance_model(BEAM, CLAMP, Ports(lines, ("5:y",), ("5:y",))).receptance(pair_matrix(TABLE_3))[0]
    shaken = jb.FrfData(FrfSet(lines, values, ("5:y",), ("5:y",)), (0.01 * np.abs(values)) ** 2)
    tests = [replace(problem.test, name="pulled"), jb.Test("shaken", BEAM, CLAMP, shaken)]
    both = jb.Problem(tests=tests, prior=problem.prior)
    alone, together = jb.find_map(problem), jb.find_map(both)
    assert (np.diag(together.covariance) < np.diag(alone.covariance)).all()
    assert tests[0].data.in_short() == "static deflections"
    simulated = simulated_problem(both, both, together.theta, np.random.default_rng(2)).tests[0].data
    assert 0.2 < np.abs((simulated.deflection - problem.test.data.deflection) / simulated.sd).max() < 6


def test_data_without_a_likelihood_are_refused(problem):
    class Unknown(StaticDeflections):
        pass

    assert likelihood_of.dispatch(Unknown) is static_likelihood  # of its parent
    with pytest.raises(jb.ModelError, match=r"likelihood_of\.register"):
        likelihood_of.dispatch(Data)(problem.test.data, problem.test)


@pytest.mark.docs
def test_nothing_but_the_whole_case_asks_which_kind_of_data_or_of_their_table_it_is():
    tables = ("SyntheticFrf", "NaturalFrequencies", "Modes", "Measured", "MeasuredFrf", "MeasuredFrequencies")
    kinds = {"FrfData", "FrequencyData", "ModalData", "ModeData", *(f"{table}Spec" for table in tables)}
    asked = []
    for path in sorted((ROOT / "src").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            name = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id
            if (
                name in ("isinstance", "issubclass")
                and {getattr(part, "id", getattr(part, "attr", "")) for part in ast.walk(node)} & kinds
            ):
                asked.append(path.relative_to(ROOT).as_posix())
    assert asked == 2 * ["src/jointbayes/case/spec/whole.py"]  # where a whole case says which table it has
