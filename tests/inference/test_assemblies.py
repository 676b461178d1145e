"""Scatter between assemblies: the prior against quadrature, its draws, and the scatter against a direct posterior."""

import math

import numpy as np
import pytest
from scipy import integrate, stats

import jointbayes as jb
from jointbayes.inference import AssemblyScatter
from jointbayes.studies.compare import hypothesis_problem
from tests.conftest import CONFIGS
from tests.one_line import refused

MEDIAN, FACTOR = 0.1, 3.0
SPRING = jb.parametrisation_named("springs", ("y",))
OF_SCATTER = stats.lognorm(math.log(FACTOR), scale=MEDIAN)


def prior_of(marginal, groups, scattered=True):
    """Assemblies with one spring each; `groups` are their numbers at each level."""
    names = [f"a{i}" for group in groups for i in group]
    among = tuple(tuple(f"a{i}.ky" for i in group) for group in groups if len(group) > 1)
    scatters = (AssemblyScatter("ky", among, MEDIAN, FACTOR),) if scattered else ()
    return jb.JointPrior(jb.blocks_of(dict.fromkeys(names, SPRING)), (marginal,) * len(names), scatters=scatters)


def direct_density(x, marginal, groups):
    """By quadrature over τ: each group's mean under the marginal, contrasts of a Helmert matrix under N(0, τ²)."""
    x, contrasts, log_mean = np.asarray(x), [], 0.0
    for group in groups:
        of_group = x[list(group)]
        n = len(group)
        helmert = np.linalg.qr(np.column_stack([np.ones(n), np.eye(n)[:, 1:]]))[0][:, 1:]
        contrasts += (helmert.T @ of_group).tolist()
        log_mean += float(marginal.log_density(np.array([of_group.mean()]))[0]) - 0.5 * math.log(n)

    def under(log_scatter):
        scatter = math.exp(log_scatter)
        return OF_SCATTER.pdf(scatter) * scatter * np.prod(stats.norm.pdf(contrasts, scale=scatter))

    value = integrate.quad(under, math.log(MEDIAN) - 6, math.log(MEDIAN) + 6, epsabs=0, epsrel=1e-9, limit=500)[0]
    return log_mean + math.log(value)


@pytest.mark.parametrize("marginal", [jb.Normal(17.0, 2.0), jb.Uniform(12.0, 25.0)])
@pytest.mark.parametrize("groups", [((0, 1),), ((0, 1, 2, 3, 4),), ((0, 1, 2), (3, 4), (5,))])
def test_the_density_is_that_of_the_mean_and_of_contrasts_whose_scatter_is_unknown(marginal, groups):
    prior, rng = prior_of(marginal, groups), np.random.default_rng(1)
    count = sum(map(len, groups))
    for size in (0.002, 0.1, 1.0):
        x = 18.0 + size * rng.standard_normal(count)
        assert prior.log_density(x)[0] == pytest.approx(direct_density(x, marginal, groups), abs=1e-6)


def test_draws_of_the_prior_have_that_density_and_stay_inside():
    groups = ((0, 1, 2),)
    draws = prior_of(jb.Normal(17.0, 2.0), groups).sample(np.random.default_rng(2), 20_000)
    means, away = draws.mean(axis=1), draws - draws.mean(axis=1, keepdims=True)
    assert stats.kstest(means, stats.norm(17.0, 2.0).cdf).pvalue > 0.01
    direct = OF_SCATTER.rvs(20_000, random_state=4)[:, None] * np.random.default_rng(5).standard_normal((20_000, 2))
    assert stats.ks_2samp((away**2).sum(axis=1), (direct**2).sum(axis=1)).pvalue > 0.01
    narrow = prior_of(jb.Uniform(17.0, 17.2), groups)
    inside = narrow.sample(np.random.default_rng(6), 2000)
    assert ((inside > 17.0) & (inside < 17.2)).all()
    assert np.isfinite(narrow.log_density(inside)).all()


@pytest.mark.parametrize(
    ("truth", "noise", "draws"),
    [(0.06, 0.02, 100_000), pytest.param(0.02, 0.1, 400_000, marks=(pytest.mark.science, pytest.mark.long))],
)
def test_the_scatter_of_five_assemblies_is_that_of_a_direct_posterior(truth, noise, draws):
    """Normal data of each: μ is integrated out by hand, τ over a grid. Here: weighted draws about the data, then τ."""
    rng, count = np.random.default_rng(7), 5
    measured = 17.0 + truth * rng.standard_normal(count) + noise * rng.standard_normal(count)
    prior = prior_of(jb.Uniform(10.0, 25.0), (tuple(range(count)),))
    theta = measured + noise * np.random.default_rng(8).standard_normal((draws, count))  # the likelihood itself
    weight = np.exp(prior.log_density(theta) - prior.log_density(measured))
    chosen = rng.choice(len(theta), 20_000, p=weight / weight.sum())
    (scatter,) = prior.scatters
    drawn = scatter.draw_scatter(theta[chosen], prior.names, rng)

    grid = np.exp(np.linspace(math.log(MEDIAN) - 6, math.log(MEDIAN) + 6, 4001))
    total = grid**2 + noise**2  # of the contrasts of what was measured
    squares = ((measured - measured.mean()) ** 2).sum()
    density = OF_SCATTER.pdf(grid) * grid * total ** (-(count - 1) / 2) * np.exp(-squares / 2 / total)
    steps = np.cumsum(density) / density.sum()
    asked = (0.025, 0.25, 0.5, 0.75, 0.975)
    assert np.log(np.quantile(drawn, asked)) == pytest.approx(np.log(np.interp(asked, steps, grid)), abs=0.06)


def test_what_is_no_scatter_is_refused():
    pair = (("a.ky", "b.ky"),)
    refused(lambda: AssemblyScatter("ky", (("a.ky",),)), jb.ModelError, "expected two assemblies at least")
    refused(lambda: AssemblyScatter("ky", pair, -1.0), jb.ModelError, "found a scatter of -1 times 3")
    prior = jb.JointPrior(SPRING, (jb.Normal(1.0, 1.0),), scatters=(AssemblyScatter("ky", pair),))
    refused(lambda: prior.log_density([1.0]), jb.ModelError, "found no prior of a.ky, b.ky")
    problem = case_of(ASSEMBLIES).problem
    scatters = "found a joint that scatters between assemblies"
    refused(lambda: hypothesis_problem(problem, "rigid"), jb.ModelError, scatters)


ASSEMBLIES = """
extends = "clamped_beam_frequencies_360mm.toml"
remove = ["data", "joint", "prior"]
joint = { kind = "springs", dofs = ["1:y", "1:rz"], own = true }
prior.ky = { distribution = "log_uniform", low = 1e6, high = 1e11 }
prior.krz = { distribution = "log_uniform", low = 1e3, high = 1e8 }
data = { kind = "natural_frequencies", frequencies_hz = [110.0, 690.0, 1900.0], sd_relative = 0.0005 }
assembly = { scatter = 0.2, scatter_factor = 2.0 }
tests.first = {}
tests.second = {}
"""


def case_of(text):
    return jb.case_from_text("assemblies", text, directory=CONFIGS)


def test_a_case_states_what_scatters_and_how_much():
    first, second = case_of(ASSEMBLIES).problem.prior.scatters
    assert first == AssemblyScatter("ky", (("first.ky", "second.ky"),), 0.2, 2.0)
    assert second.quantity == "krz"
    levels = ASSEMBLIES[: ASSEMBLIES.index("tests")] + 'level.name = "torque"\n'
    torques = {"first": 5, "second": 5, "third": 9, "fourth": 9, "fifth": 12}
    levels += "".join(f"tests.{name}.level = {torque}\n" for name, torque in torques.items())
    first, _ = case_of(levels).problem.prior.scatters
    assert first.groups == (("first.ky", "second.ky"), ("third.ky", "fourth.ky"))
    assert case_of(ASSEMBLIES.replace("assembly = ", "# ")).problem.prior.scatters == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ((", own = true", ""), "assembly: found no joint that is each test's own; expected two assemblies"),
        (("tests.second = {}", ""), "assembly: found 1 tests; expected two assemblies"),
        (("scatter = 0.2", "scatter = 0"), "assembly.scatter: found 0; expected the usual standard deviation"),
        (("_factor = 2.0", "_factor = 1"), "assembly.scatter_factor: found 1; expected the factor"),
    ],
)
def test_assemblies_of_nothing_are_refused_in_one_line(change, message):
    with pytest.raises(jb.CaseError, match=message):
        case_of(ASSEMBLIES.replace(*change))
