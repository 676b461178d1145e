"""The steps of a run on a problem made of arrays, without any file; what is saved of it is what was sampled."""

import dataclasses
import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import sparse, stats

import jointbayes as jb
from jointbayes.inference import JointPrior, Normal, Nuisance, Problem, ScaledNoise, Uniform
from jointbayes.joint import Joint, LogStiffness, PlainSprings, SignedCoupling
from jointbayes.posterior.storage import problem_arrays, problem_from
from jointbayes.workflow import _on_one_hill, _with_best_draw
from tests.conftest import cheap_frequencies_text, cheap_text, edited
from tests.euler_beam import euler_beam
from tests.inference import test_free_test, test_several_tests
from tests.one_line import refused
from tests.pages import fenced, text_of

LINES = np.arange(20.0, 1500.0, 10.0)
TRUTH = np.array([2e7, 5e5, 2e4])
LOSS = 0.01
QUICK = jb.SamplerSettings(walkers=16, max_steps=400, end_tolerance=0.1, tau_factor=10, r_hat_max=1.1)


LABELS = tuple(f"{node}:{way}" for node in range(1, 8) for way in ("y", "rz"))


def square_rod():
    """K and M of a square steel beam of 400 mm."""
    return euler_beam(0.4, 2.1e11 * 0.02**4 / 12, 7800.0 * 0.02**2, 6)


def receptances(k11, k12, k22, outputs=(12, 6), inputs=(12,)):
    """Exact receptances of that beam on a joint at its first node, by one dense solution for each line."""
    k, m = square_rod()
    whole = (1 + 1j * LOSS) * k
    whole[:2, :2] += np.array([[k11, k12], [k12, k22]])
    return np.array([np.linalg.inv(whole - (2 * np.pi * f) ** 2 * m)[np.ix_(outputs, inputs)] for f in LINES])


def measured():
    rng = np.random.default_rng(4)
    exact = receptances(*TRUTH)
    sd = 0.02 * np.abs(exact) + 0.005 * np.median(np.abs(exact))
    noise = sd * (rng.normal(size=exact.shape) + 1j * rng.normal(size=exact.shape)) / np.sqrt(2)
    return jb.FrfData(jb.FrfSet(LINES, exact + noise, ("7:y", "4:y"), ("7:y",)), sd**2)


def from_arrays(marginals=None, **changes):
    stiffness, mass = square_rod()
    wide = tuple(Uniform.of_logarithm(1e-2 * k, 1e2 * k) for k in TRUTH)
    parts = {
        "structure": jb.Structure(stiffness, mass, jb.LossFactor(LOSS), LABELS),
        "joint": Joint(("1:y", "1:rz")),
        "data": measured(),
        "prior": JointPrior(LogStiffness(), marginals or wide),
        "name": "rod",
    }
    return Problem(**(parts | changes))


@pytest.fixture(scope="module")
def sampled():
    return jb.sample(from_arrays(), settings=QUICK, premises="exact")


def test_a_problem_without_a_case_has_the_seed_1(sampled):
    assert sampled.record.seed == 1


def test_a_problem_of_arrays_has_the_density_of_a_dense_solution():
    problem = from_arrays()
    data = problem.test.data
    theta = np.log(TRUTH) + np.array([[0.0, 0.0, 0.0], [0.3, -0.2, 0.05]])
    for row, found in zip(theta, problem.log_posterior.log_likelihood(theta), strict=True):
        misfit = np.abs(receptances(*np.exp(row)) - data.frf.values) ** 2 / data.variance
        assert found == pytest.approx(-(np.log(np.pi * data.variance) + misfit).sum(), rel=1e-9)


def test_draws_are_asked_by_name(sampled):
    draws = sampled["k22"]
    assert (draws.dims, draws.attrs["units"]) == (("chain", "draw"), "N·m/rad")
    np.testing.assert_array_equal(draws, sampled.values("k22"))
    assert list(sampled) == ["k11", "k12", "k22"]
    assert ("k22" in sampled, "k33" in sampled, "ensemble" in sampled) == (True, False, False)
    refused(lambda: sampled["k33"], jb.ModelError, r"found parameter 'k33'; expected one of k11, k12, k22$")


def test_the_likelihood_is_asked_in_the_coordinates_of_the_posterior():
    problem = from_arrays()
    inside = problem.prior.sample(np.random.default_rng(1), 5)
    theta = np.vstack([inside, inside[:1] + 50.0])
    found = problem.log_likelihood(theta)
    np.testing.assert_allclose(found[:5] + problem.prior.log_density(inside), problem.log_posterior(inside))
    assert np.isneginf(found[5])
    assert problem.log_likelihood(theta[0]).shape == (1,)


@pytest.mark.parametrize(("initial", "theta"), [(TRUTH, np.log(TRUTH)), ([1e7, 0.0, 0.0], None), (None, None)])
def test_a_first_guess_in_coordinates_is_where_a_sampler_can_begin(initial, theta):
    problem = from_arrays(initial=initial)
    middle = problem.prior.transform([[0.5, 0.5, 0.5]])[0]
    np.testing.assert_allclose(problem.initial_theta, middle if theta is None else theta)
    assert np.isfinite(problem.log_posterior(problem.initial_theta)).all()


def test_lists_and_sparse_matrices_serve_as_well_and_stay_as_they_are():
    stiffness, mass = square_rod()
    law = jb.LossFactor(LOSS)
    listed = jb.Structure(stiffness.tolist(), sparse.csc_matrix(mass), law, list(LABELS))
    given = jb.Structure(stiffness, mass, law, LABELS)
    stiffness[0, 0] += 1.0  # the structure has its own copy, which nobody can change
    theta = np.log(TRUTH)
    density = [
        from_arrays(structure=one, joint=Joint(list(dofs))).log_posterior(theta)
        for one, dofs in ((listed, ("1:y", "1:rz")), (given, ("1:y", "1:rz")))
    ]
    np.testing.assert_array_equal(*density)
    with pytest.raises(ValueError, match="read-only"):
        given.stiffness[0, 0] = 1.0


def test_map_and_draws_of_a_problem_of_arrays_find_the_truth(sampled):
    estimate = jb.find_map(from_arrays())
    sd = np.sqrt(np.diag(estimate.covariance))
    assert (np.abs(np.log(estimate.values / TRUTH)) < 4 * sd).all()
    assert (sampled.record.case_name, sampled.record.case_text) == ("rod", "")
    np.testing.assert_allclose(np.log(sampled.stiffness).std(axis=0), sd, rtol=0.3)
    assert "[[Posterior of 'rod']]" in str(sampled.summary())


def test_a_first_guess_is_the_middle_of_the_prior_unless_one_is_given():
    np.testing.assert_allclose(from_arrays().first_guess, TRUTH, rtol=1e-12)
    far = (Uniform.of_logarithm(1e6, 1e8), Uniform.of_logarithm(1e8, 1e12), Uniform.of_logarithm(1e3, 1e5))
    np.testing.assert_allclose(from_arrays(far).first_guess, [1e7, 0.0, 1e4], rtol=1e-12)
    np.testing.assert_array_equal(from_arrays(initial=[1e6, 0.0, 1e4]).first_guess, [1e6, 0.0, 1e4])


def test_the_papers_iteration_runs_on_a_problem_with_frfs_at_the_joint():
    labels, numbers = ("7:y", "4:y", "1:y", "1:rz"), (12, 6, 0, 1)
    whole = jb.FrfSet(LINES, receptances(*TRUTH, outputs=numbers), labels, ("7:y",))
    history = jb.identify(from_arrays(data=dataclasses.replace(measured(), joint_frf=whole), initial=[1e7, 0.0, 1e4]))
    np.testing.assert_allclose(history.stiffness, TRUTH, rtol=0.05)
    with pytest.raises(jb.ModelError, match="rod: found no FRFs at the joint"):
        jb.identify(from_arrays())


# ---- storage


def beam_with_uncertain_quantities():
    """Everything that a problem may hold at once, but the parts that no file can hold."""
    recipe = jb.BeamRecipe(
        0.4, jb.Section.rectangle(0.02, 0.02), jb.BeamMaterial(2.1e11, 0.3, 7800.0), jb.ModalDamping((0.01, 0.02)),
        accelerometer_mass=0.004, accelerometer_dofs=("11:y",),
    )  # fmt: skip
    nuisances = (
        Nuisance("youngs_modulus", "GPa", 210.0, Normal(0.0, 0.02)),
        Nuisance("length", "mm", 400.0, stats.norm(0.0, 0.005)),
        Nuisance("noise_scale", "1", 1.0, Uniform(-1.0, 1.0)),
    )
    ranges = {n.name: n.range for n in nuisances[:2]}
    frf = measured().frf
    data = jb.FrfData(
        jb.FrfSet(
            LINES, frf.values[:, :1], ("11:y",), ("11:y",), coherence=np.full((LINES.size, 1, 1), 0.9), averages=8
        ),
        measured().variance[:, :1],
    )
    marginals = Normal(17.0, 1.0), stats.t(4, loc=10.0, scale=0.8), Uniform(-0.9, 0.9)
    prior = JointPrior(SignedCoupling(), marginals, nuisances)
    return Problem(
        structure=jb.BeamFamily(recipe, ranges),
        joint=Joint(("1:y", "1:rz")),
        data=data,
        prior=prior,
        noise=ScaledNoise(),
        initial=TRUTH,
    )


PROBLEMS = {
    "matrices": from_arrays,
    "uncertain beam": beam_with_uncertain_quantities,
    "two sides": lambda: from_arrays(joint=Joint(("1:y", "1:rz"), ("2:y", "2:rz"))),
    "frequencies": lambda: from_arrays(
        data=jb.FrequencyData(np.array([80.0, 500.0, 1400.0]), np.array([0.1, 0.2, 0.3]))
    ),
    "springs": lambda: from_arrays(prior=JointPrior(PlainSprings(("k22",)), (Normal(10.0, 1.0),))),
    "tests": lambda: Problem(tests=[test_several_tests.LONG, test_several_tests.HEARD], prior=test_several_tests.PRIOR),
    "a free structure": lambda: Problem([test_free_test.FREE, test_free_test.CLAMPED], test_free_test.PRIOR),
}


def posterior_of(problem, sampled):
    """A posterior whose draws do not matter, but that they are of the problem."""
    theta = problem.prior.sample(np.random.default_rng(1), 400)
    value = problem.log_posterior(theta)
    theta, value = theta[np.isfinite(value)][:40], value[np.isfinite(value)][:40]
    from jointbayes.identification import MapEstimate
    from jointbayes.posterior.sampled import BestDraw
    from jointbayes.posterior.storage import draws_tree
    from jointbayes.sampling import Draws

    best, height = theta[value.argmax()], float(value.max())
    draws = Draws(theta.reshape(4, 10, -1), value.reshape(4, 10), np.arange(4))
    tree = draws_tree(problem, draws, problem.prior.sample(np.random.default_rng(2), 50))
    estimate = MapEstimate(best, problem.prior.values(best), np.eye(len(best)), height, ())
    figures = dict.fromkeys(problem.names, 1.0)
    sampler = {**sampled.record.sampler, "tau": figures, "ess": figures}
    record = dataclasses.replace(sampled.record, case_name=problem.name, sampler=sampler, r_hat=figures)
    return dataclasses.replace(
        sampled, problem=problem, tree=tree, record=record, estimate=estimate, best=BestDraw(best, height)
    )


@pytest.mark.whole
@pytest.mark.parametrize("kind", PROBLEMS)
def test_a_problem_of_arrays_comes_back_to_the_last_bit(kind, sampled, tmp_path):
    problem = PROBLEMS[kind]()
    posterior_of(problem, sampled).save(tmp_path / "kept.nc")
    loaded = jb.load_posterior(tmp_path / "kept.nc").problem
    theta = problem.prior.sample(np.random.default_rng(3), 64)
    before, after = problem.log_posterior(theta), loaded.log_posterior(theta)
    assert np.isfinite(before).any()
    np.testing.assert_array_equal(after, before)
    assert str(loaded) == str(problem)
    np.testing.assert_array_equal(loaded.first_guess, problem.first_guess)


@pytest.mark.parametrize(("left", "message"), [([], None), ([1.0], "no JointPrior can be made")])
def test_what_an_earlier_version_had_may_be_absent_if_it_was_empty(left, message):
    problem = from_arrays()
    arrays, record = problem_arrays(problem)
    record["description"]["prior"]["scatters"] = left

    def array(name):
        return (
            arrays[name].values
            if name in arrays
            else arrays[f"{name}_real"].values + 1j * arrays[f"{name}_imag"].values
        )

    def read():
        return problem_from(array, record, "kept.nc")

    if message is None:
        assert str(read()) == str(problem)
    else:
        refused(read, jb.ModelError, message)


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
def test_draws_summary_and_report_of_a_problem_come_back(sampled, tmp_path):
    sampled.save(tmp_path / "kept.nc")
    loaded = jb.load_posterior(tmp_path / "kept.nc")
    np.testing.assert_array_equal(loaded.theta, sampled.theta)
    assert loaded.summary().to_dict() == sampled.summary().to_dict()
    for posterior, name in ((sampled, "run"), (loaded, "again")):
        jb.write_report(posterior, tmp_path / name)
    run, again = tmp_path / "run", tmp_path / "again"
    for name in ("report.html", "summary.json"):
        assert (run / name).read_bytes() == (again / name).read_bytes()
    assert not (run / "case.toml").exists()
    page = (run / "report.html").read_text(encoding="utf-8")
    assert "structure: Structure(14 DOFs, 1:y to 7:rz, LossFactor)" in page
    assert json.loads((run / "summary.json").read_text(encoding="utf-8"))["case"] == "rod"


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
def test_a_replaced_problem_is_saved_as_it_was_sampled(tmp_path):
    case = jb.case_from_text("cheap", cheap_text())
    problem = case.problem
    softer = dataclasses.replace(
        problem, prior=dataclasses.replace(problem.prior, marginals=(Normal(22.0, 0.5), *problem.prior.marginals[1:]))
    ).with_test(data=dataclasses.replace(problem.test.data, variance=2 * problem.test.data.variance))
    posterior = jb.sample(dataclasses.replace(case, problem=softer), seed=1, settings=QUICK)
    posterior.save(tmp_path / "kept.nc")
    loaded = jb.load_posterior(tmp_path / "kept.nc")
    theta = softer.prior.sample(np.random.default_rng(3), 64)
    np.testing.assert_array_equal(loaded.problem.log_posterior(theta), softer.log_posterior(theta))
    assert not np.allclose(loaded.problem.log_posterior(theta), problem.log_posterior(theta))
    assert loaded.case.title == case.title
    np.testing.assert_array_equal(loaded.estimate.iteration.stiffness, posterior.estimate.iteration.stiffness)
    jb.write_report(loaded, tmp_path / "run")
    assert not (tmp_path / "run" / "case.toml").exists()
    assert "prior of ln k11: Normal(mean=22.0, sd=0.5)" in (tmp_path / "run" / "report.html").read_text("utf-8")


def run_page_without_files(*changes):
    blocks = fenced(edited(text_of("without-files.md"), *changes), "python")
    assert len(blocks) == 6
    names = {}
    for block in blocks:
        exec(compile(block, "without-files.md", "exec"), names)
    return names, jb.load_posterior("rod.nc")


@pytest.mark.docs
@pytest.mark.usefixtures("plain_reports", "rough_proposals")
def test_the_page_on_problems_without_files_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names, rod = run_page_without_files(("walkers=32", "walkers=32, max_steps=200"))
    assert rod.problem.names == names["again"].problem.names == ("k11", "k12", "k22")
    assert (tmp_path / "reports" / "rod" / "report.pdf").is_file()


@pytest.mark.docs
@pytest.mark.long
def test_the_page_on_problems_without_files_runs_as_it_stands(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names, rod = run_page_without_files()
    low, high = rod.interval("k22", 0.999)
    assert rod.converged
    assert low < 2e4 < high
    assert (tmp_path / "reports" / "rod" / "report.pdf").is_file()
    # with a term of one's own the model counts as exact: a static test to 3 % then adds nothing to what vibration says
    assert np.ptp(names["again"].interval("k22")) < 0.1 * np.ptp(rod.interval("k22"))


# ---- own priors and an own term of the likelihood


def triangle(middle, half):
    """A prior that is triangular over a width about a middle."""
    return stats.triang(0.5, loc=middle - half, scale=2 * half)


def one_spring(prior, extra=None):
    """One coordinate, so that a grid gives the posterior; the data are three natural frequencies, roughly measured."""
    data = jb.FrequencyData(np.array([78.0]), np.array([4.0]))
    return from_arrays(data=data, prior=JointPrior(PlainSprings(("k22",)), (prior,)), extra_log_likelihood=extra)


def static_test(theta):
    return -0.5 * ((theta[:, 0] - 9.6) / 0.1) ** 2


OWN = {"scipy": (stats.laplace(9.4, 0.15), None), "triangle and extra term": (triangle(9.4, 0.5), static_test)}


def on_grid(prior, extra):
    """Grid of θ and the normalised posterior there, from the prior's own density and the dense matrices."""
    theta = np.linspace(7.5, 11.0, 20001)
    log_prior = prior.logpdf(theta)
    known = one_spring(Uniform(5.0, 13.0)).log_posterior.log_likelihood(theta[:, None])
    value = log_prior + known + (0 if extra is None else extra(theta[:, None]))
    density = np.exp(value - value.max())
    return theta, density / density.sum()


@pytest.mark.whole
@pytest.mark.parametrize("kind", OWN)
def test_own_priors_and_terms_act_on_draws_and_map_as_on_a_grid(kind):
    prior, extra = OWN[kind]
    problem = one_spring(prior, extra)
    theta, density = on_grid(prior, extra)
    assert jb.find_map(problem).theta[0] == pytest.approx(theta[np.argmax(density)], abs=2e-3)
    settings = jb.SamplerSettings(walkers=32, max_steps=2000)
    posterior = jb.sample(problem, seed=2, settings=settings, premises="exact")
    assert posterior.converged
    mean = theta @ density
    sd = np.sqrt((theta - mean) ** 2 @ density)
    assert posterior.theta.mean() == pytest.approx(mean, abs=0.05 * sd)
    assert posterior.theta.std() == pytest.approx(sd, rel=0.05)
    ends = np.interp([0.025, 0.975], np.cumsum(density), theta)
    np.testing.assert_allclose(np.quantile(posterior.theta, [0.025, 0.975]), ends, atol=0.12 * sd)


@pytest.mark.parametrize("given", [stats.norm(1.0, 2.0), stats.beta(2.0, 5.0), triangle(2.0, 1.0)])
def test_an_own_prior_has_quantiles_that_fit_its_density(given):
    marginal = of_prior(given).marginals[0]
    probability = np.array([0.05, 0.5, 0.9])
    theta = marginal.ppf(probability)
    np.testing.assert_allclose(marginal.cdf(theta), probability, atol=1e-3)
    grid = np.linspace(marginal.ppf(1e-4), marginal.ppf(1 - 1e-4), 4001)
    density = np.exp(marginal.log_density(grid))
    assert np.trapezoid(density, grid) == pytest.approx(1.0, abs=2e-3)
    np.testing.assert_allclose(np.interp(theta, grid, np.cumsum(density) * (grid[1] - grid[0])), probability, atol=0.01)


def test_a_summary_of_springs_held_rigid_is_refused_in_one_line(sampled):
    problem = PROBLEMS["springs"]()
    with pytest.raises(
        jb.ModelError, match="found k11 held rigid; expected a joint whose stiffnesses are all uncertain"
    ):
        posterior_of(problem, sampled).summary()


def test_parts_that_no_file_can_hold_are_named_and_asked_for(sampled, tmp_path):
    own = tuple(triangle(np.log(k), 3.0) for k in TRUTH)
    problem = from_arrays(own, extra_log_likelihood=lambda theta: -theta[:, 0])
    path = tmp_path / "kept.nc"
    posterior_of(problem, sampled).save(path)
    refused(lambda: jb.load_posterior(path), jb.ModelError, "problem.extra_log_likelihood")
    assert jb.load_posterior(path, problem=problem).problem is problem
    other = dataclasses.replace(problem, extra_log_likelihood=lambda theta: -2 * theta[:, 0])
    refused(lambda: jb.load_posterior(path, problem=other), jb.ModelError, "found draws of another density")
    data = dataclasses.replace(problem.test.data, variance=2 * problem.test.data.variance)
    with pytest.raises(jb.ModelError, match=r"of another problem .*: other numbers in its arrays"):
        jb.load_posterior(path, problem=problem.with_test(data=data))
    with pytest.raises(jb.ModelError, match=r"of another problem .*: other joint"):
        jb.load_posterior(path, problem=problem.with_test(joints=Joint(("2:y", "2:rz"))))


@pytest.mark.whole
def test_a_path_is_taken_for_its_case(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(cheap_frequencies_text(), encoding="utf-8")
    np.testing.assert_array_equal(jb.find_map(path).theta, jb.find_map(jb.load_case(path)).theta)
    refused(lambda: jb.sample("none.toml"), jb.CaseError, "none.toml:1: file: no such file; expected a case file")


def test_python_dash_m_is_the_command_line():
    command = [sys.executable, "-m", "jointbayes", "--version"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.startswith("jointbayes, version")


ALIKE = stats.norm(1.0, 1e-300)
NO_PRIOR = {"scipy.stats": "chi2_contingency", "args": [[1, 2]], "kwds": {"mapping": []}}


def of_prior(given):
    return JointPrior(PlainSprings(("k11",)), (given,))


def test_a_higher_mode_that_independent_draws_lead_to_is_taken(frequency_posterior):
    problem, estimate = frequency_posterior.problem, frequency_posterior.estimate
    theta = frequency_posterior.thinned(200)[None]
    chains = SimpleNamespace(theta=theta, log_density=problem.log_posterior(theta[0])[None])
    assert _with_best_draw(problem, estimate, chains) is estimate
    missed = dataclasses.replace(estimate, theta=theta[0, 0], log_posterior=float(chains.log_density[0, 0]), modes=())
    found = _with_best_draw(problem, missed, chains)
    assert (found.log_posterior, found.starts) == (pytest.approx(estimate.log_posterior, abs=1e-6), missed.starts)


@pytest.mark.parametrize(("dip", "same"), [(0.0, True), (0.8, True), (1.2, False)])
def test_two_tops_are_one_mode_where_no_valley_between_them_holds_walkers_up(dip, same):
    def log_posterior(theta):
        return theta[:, 0] - dip * np.exp(-(((theta[:, 0] - 0.1) / 0.2) ** 2)) - 0.1 * (dip > 0)

    problem = SimpleNamespace(log_posterior=log_posterior)
    assert _on_one_hill(problem, np.array([0.0, 1.0]), 0.0, np.array([1.0, 1.0])) == same
