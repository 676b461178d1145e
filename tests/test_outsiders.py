"""What people ask of a notebook who never read this package: ArviZ, corner, pandas, a noise and a sampler of their own.

`.ci/run` asks both of its Pythons, which have ArviZ 0.23 and 1.x.
"""

import importlib.util
import pickle
import re
import warnings

import numpy as np
import pytest
from scipy.special import logsumexp

import jointbayes as jb
from jointbayes.inference import GaussianNoise, GaussianSpread, NoiseModel, ScaledNoise
from tests.conftest import CONFIGS
from tests.structure.long_rod import LongRod
from tests.test_workflow import QUICK, TRUTH, from_arrays

pytestmark = pytest.mark.version


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    """What examples/five_questions.py says, with short runs; an example is no module of the package."""
    for package in ("arviz", "corner", "dynesty", "pandas"):
        pytest.importorskip(package)
    spec = importlib.util.spec_from_file_location("five_questions", CONFIGS.parent / "examples" / "five_questions.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of single values that count for much, of wide ellipsoids
        return example.main(tmp_path_factory.mktemp("asked") / "corner.png", settings=QUICK)


@pytest.mark.science
def test_a_first_posterior_from_arrays_finds_the_truth_with_five_names(asked):
    text = (CONFIGS.parent / "examples" / "five_questions.py").read_text(encoding="utf-8")
    first = text[text.index("def measured") : text.index("def ask_arviz")] + "jb.sample("
    assert set(re.findall(r"jb\.(\w+)", first)) == {"FrfData", "LossFactor", "Problem", "Structure", "sample"}
    low, high = np.quantile(asked["posterior"]["k22"], [0.0005, 0.9995])
    assert low < TRUTH[2] < high


@pytest.mark.science
def test_arviz_corner_and_pandas_take_draws_by_name(asked):
    posterior, table, loo = asked["posterior"], asked["table"], asked["loo"]
    assert list(table.index) == list(posterior) == ["k11", "k12", "k22"]
    assert table.loc["k22", "mean"] == pytest.approx(posterior["k22"].mean().item(), rel=0.05)
    assert 0 < (loo.p_loo if hasattr(loo, "p_loo") else loo.p) < 10
    assert asked["described"].loc["50%", "k22"] == pytest.approx(float(np.median(posterior["k22"])))
    assert asked["described"].loc[["2.5%", "97.5%"], "k22"].tolist() == pytest.approx(posterior.interval("k22"))


@pytest.mark.science
def test_a_noise_model_of_ones_own_widens_as_it_says(asked):
    widths = [np.diff(np.log(asked[name].interval("k22")))[0] for name in ("posterior", "coarse")]
    assert widths[1] / widths[0] == pytest.approx(3.0, rel=0.15)


@pytest.mark.science
def test_a_body_of_all_modes_of_two_matrices_is_that_structure(asked):
    np.testing.assert_allclose(asked["by_modes"].values, jb.find_map(asked["posterior"].problem).values, rtol=1e-4)


@pytest.mark.science
def test_a_nested_sampler_of_ones_own_finds_the_evidence(asked):
    problem, (found, error) = asked["few"], asked["evidence"]
    grid = (np.arange(200) + 0.5) / 200
    cells = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    known = logsumexp(problem.log_likelihood(problem.prior.transform(cells))) - np.log(len(cells))
    assert found == pytest.approx(known, abs=3.5 * error + 0.02)


class Plain(GaussianSpread):
    """A noise model from a notebook: the stated noise times a number."""

    parts = 2

    def __init__(self, factor):
        self.factor = factor

    def spread(self, hyper, n):
        return np.full((1, 1, 1), self.factor)


class Scaled(NoiseModel):
    """The same with the number unknown, written out in full."""

    parts, names = 2, ("noise_scale",)

    def log_likelihood(self, z, hyper):
        scale = np.asarray(hyper)[:, 0]
        return -(np.abs(z) ** 2).sum(axis=(1, 2)) / scale**2 - 2 * z[0].size * np.log(scale)

    def scores(self, z, hyper):
        return z / np.reshape(hyper, (-1, 1))[:, 0, None, None]

    def draw(self, rng, hyper, lines, pairs):
        white = rng.normal(size=(len(np.atleast_2d(hyper)), lines, pairs, 2)) @ [1, 1j] / np.sqrt(2)
        return np.reshape(hyper, (-1, 1))[:, 0, None, None] * white


SCALE = jb.Nuisance("noise_scale", "× stated", 1.0, jb.Uniform(np.log(0.1), np.log(10.0)))


def test_a_plain_noise_model_has_the_density_that_it_says():
    theta = np.log(TRUTH)[None] + [[0.0, 0.0, 0.0], [0.2, 0.1, 0.01]]
    known, plain = (from_arrays(noise=noise) for noise in (GaussianNoise(), Plain(2.0)))
    data = known.test.data
    chi2 = (np.abs(known.log_posterior.standardised(theta)) ** 2).sum(axis=(1, 2))
    expected = known.log_likelihood(theta) + chi2 * (1 - 0.25) - 2 * data.variance.size * np.log(2.0)
    np.testing.assert_allclose(plain.log_likelihood(theta), expected)
    np.testing.assert_allclose(pickle.loads(pickle.dumps(plain)).log_likelihood(theta), expected)
    prior = jb.JointPrior(known.prior.parametrisation, known.prior.marginals, (SCALE,))
    stated, own = (from_arrays(noise=noise, prior=prior) for noise in (ScaledNoise(2), Scaled()))
    theta = np.column_stack([theta, [0.3, -0.1]])
    np.testing.assert_allclose(own.log_posterior(theta), stated.log_posterior(theta))


def test_a_posterior_of_a_plain_noise_model_says_what_its_file_lacks(tmp_path):
    problem = from_arrays(noise=Plain(1.0))
    posterior = jb.sample(problem, settings=QUICK, premises="exact")
    assert posterior.check.explains
    posterior.save(tmp_path / "own.nc")
    with pytest.raises(jb.ModelError, match=r"parts that no file can hold: problem\.tests\[0\]\.noise \(Plain\);"):
        jb.load_posterior(tmp_path / "own.nc")
    np.testing.assert_array_equal(jb.load_posterior(tmp_path / "own.nc", problem=problem)["k22"], posterior["k22"])


class Rod(jb.Body):
    """A body from a notebook with the five things that a body has: a free rod along x, by the modes of `LongRod`."""

    def __init__(self):
        self.rod = LongRod().certain()
        self.labels, self.damping = self.rod.labels, jb.LossFactor(0.01)

    def reach_hz(self, count):
        return self.rod.reach_hz(count)

    def rigid_motions(self, dofs):
        return self.rod.rigid_motions(dofs)

    def free_modes(self, dofs, motions, forced=None):
        return self.rod.free_modes(dofs, motions, forced)


def test_a_plain_body_is_a_structure():
    lines = np.arange(200.0, 4000.0, 50.0)
    data = jb.FrfData.of_arrays(lines, np.full((lines.size, 1, 1), 1e-9 + 0j), 1e-10, ("100000:x",), ("100000:x",))
    plain, stated = (jb.Problem(structure=body, joint=("1:x",), data=data) for body in (Rod(), LongRod().certain()))
    assert plain.names == ("kx",)
    theta = plain.prior.sample(np.random.default_rng(1), 5)
    np.testing.assert_allclose(plain.log_posterior(theta), stated.log_posterior(theta))
    assert repr(plain.test.structure).startswith("Rod(100000 DOFs, 1:x to 100000:x")
