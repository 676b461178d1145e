"""The table of what is identifiable: an independent Fisher information, and the package's, and sampling."""

import contextlib
import dataclasses
import io
import math
import re
from pathlib import Path

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.frf import DirectSolve
from jointbayes.posterior.fisher import FisherInformation, fisher_information
from jointbayes.posterior.identifiability import judge_by_rule
from jointbayes.structure import beam
from jointbayes.verdict_rule import RULE
from tests.conftest import CLAMP, CONFIGS, STEEL, TABLE_3, edited, pair_matrix, rod
from tests.oracles import differences
from vibrecords import FrfData, FrfSet

FREQUENCY_HZ = np.arange(10.0, 2501.0, 2.0)
OUTPUTS = ("11:y", "6:y", "2:y", "1:y", "1:rz")
POINT = np.concatenate([np.log(TABLE_3), np.zeros(4)])  # then ln of E, L, ρ, ζ over their nominal values
PRIOR_SD = np.array([0.02, 0.005, 0.01, np.inf])

#: Measured outputs: sd of (ln k11, ln k12, ln k22) with all else known, then with E ±2 %, L ±0.5 %, ρ ±1 %, ζ free;
#: and the unit of the last digit that the table prints.
TABLE = {
    ("11:y",): ((0.35, 0.14, 0.006), (0.75, 1.97, 1.24), ((0.01, 0.01, 0.001), (0.01, 0.01, 0.01))),
    ("11:y", "6:y"): ((0.25, 0.10, 0.005), (0.28, 0.15, 0.008), ((0.01, 0.01, 0.001), (0.01, 0.01, 0.001))),
    ("11:y", "2:y"): ((0.16, 0.06, 0.004), (0.17, 0.09, 0.017), ((0.01, 0.01, 0.001), (0.01, 0.01, 0.001))),
    ("11:y", "1:y", "1:rz"): ((0.001,) * 3, (0.001, 0.001, 0.0015), ((0.001,) * 3, (0.001, 0.001, 0.0001))),
}


def receptance(theta, outputs):
    """Receptances by dense solves of a beam built anew, shape (lines, outputs)."""
    modulus, length, density, damping = np.exp(theta[3:])
    steel, law = jb.BeamMaterial(2.1e11 * modulus, 0.3, 7800.0 * density), jb.ModalDamping((0.01 * damping,))
    structure = beam(0.383 * length, jb.Section.circle(0.025), steel, law)
    solve = DirectSolve(structure, CLAMP, jb.Ports(FREQUENCY_HZ, outputs, ("11:y",)))
    return solve.receptance(pair_matrix(np.exp(theta[:3])))[0, :, :, 0]


def part_sd(values):
    """3 % of |H| and 1 % of its median over the lines, independent of each other: their squares add."""
    magnitude = np.abs(values)
    return np.hypot(0.03 * magnitude, 0.01 * np.median(magnitude, axis=0))


@pytest.fixture(scope="module")
def columns():
    """Real and imaginary parts of ∂H/∂θ over their standard deviation by output, shape (2 lines, outputs, 7)."""
    slope = differences(lambda theta: receptance(theta, OUTPUTS), POINT, 1e-4)
    scaled = np.moveaxis(slope / part_sd(receptance(POINT, OUTPUTS)), 0, -1)
    return np.concatenate([scaled.real, scaled.imag])


def independent_information(columns, outputs):
    """JᵀJ over E, L, ρ, ζ as well, from central differences, shape (7, 7)."""
    jacobian = columns[:, [OUTPUTS.index(o) for o in outputs]].reshape(-1, 7)
    return jacobian.T @ jacobian


def scaled_gap(found, expected):
    """Largest deviation of an entry of a matrix over the roots of both its diagonals."""
    return np.abs((found - expected) / np.sqrt(np.outer(np.diag(expected), np.diag(expected)))).max()


def agrees(found, printed, unit):
    """Within 5 % of the printed number, or printed so when rounded to its digits."""
    found, printed, unit = map(np.asarray, (found, printed, unit))
    return np.abs(found - printed) <= np.maximum(0.05 * printed, 0.5 * unit)


def problem_of(outputs) -> jb.Problem:
    """Exact data of Table 3's joint with the table's noise law stated."""
    values = receptance(POINT, outputs)[..., None]
    frf = FrfSet(FREQUENCY_HZ, values, outputs, ("11:y",))
    prior = jb.JointPrior(jb.LogStiffness(), tuple(jb.Uniform(mid - 5, mid + 5) for mid in POINT[:3]))
    data = FrfData(frf, 2 * part_sd(values) ** 2, synthetic=True)
    return jb.Problem(structure=rod(), joint=CLAMP, data=data, prior=prior)


@pytest.mark.parametrize("outputs", TABLE, ids=" + ".join)
def test_the_package_agrees_with_central_differences_of_dense_solves(columns, outputs):
    fisher = fisher_information(problem_of(outputs), POINT[:3])
    assert scaled_gap(fisher.data, independent_information(columns, outputs)[:3, :3]) < 1.1e-6
    printed, _, (unit, _) = TABLE[outputs]
    assert agrees(list(fisher.sd().values()), printed, unit).all()


NUISANCES = ("youngs_modulus", "length", "density", "damping_ratio")
DOCS = (Path(__file__).resolve().parents[2] / "docs" / "identifiability.md").read_text(encoding="utf-8")


def independent_fisher(columns, outputs) -> FisherInformation:
    data = independent_information(columns, outputs)
    precision = np.diag(np.concatenate([np.zeros(3), PRIOR_SD**-2.0]))
    prior_sd = np.concatenate([np.full(3, 5.0), PRIOR_SD])
    return FisherInformation(("k11", "k12", "k22", *NUISANCES), POINT, data, precision, prior_sd, jb.LogStiffness())


def uncertain_problem(outputs) -> jb.Problem:
    """The package's own problem with E, length, density and damping uncertain."""
    # the table was computed with the paper's elements, as the independent matrix is here
    recipe = jb.BeamRecipe(0.383, jb.Section.circle(0.025), STEEL, jb.ModalDamping((0.01,)), element="paper")
    flat = jb.Uniform(math.log(0.1), math.log(10.0))
    priors = (jb.Normal(0.0, 0.02), jb.Normal(0.0, 0.005), jb.Normal(0.0, 0.01), flat)
    nuisances = tuple(jb.Nuisance(name, "1", 1.0, prior) for name, prior in zip(NUISANCES, priors, strict=True))
    known = problem_of(outputs).with_test(structure=jb.BeamFamily(recipe, {n.name: n.range for n in nuisances}))
    return dataclasses.replace(known, prior=dataclasses.replace(known.prior, nuisances=nuisances))


@pytest.mark.parametrize("outputs", TABLE, ids=" + ".join)
def test_with_what_else_is_uncertain_the_package_reproduces_the_table(columns, outputs):
    found = fisher_information(uncertain_problem(outputs), POINT)
    independent = independent_fisher(columns, outputs)
    assert scaled_gap(found.data, independent.data) < 5e-4  # what differences of 1e-4 leave at 1 % damping
    _, printed, (_, unit) = TABLE[outputs]
    assert agrees([found.sd()[name] for name in ("k11", "k12", "k22")], printed, unit).all()


def freed_rows(fisher):
    """Standard deviations of the stiffnesses with nothing, each quantity alone, and all of them free."""
    sets = [(), *((name,) for name in NUISANCES), NUISANCES]
    return {freed: fisher.stiffness_sd((*fisher.parametrisation.names, *freed)) for freed in sets}


@pytest.mark.docs
@pytest.mark.parametrize("outputs", TABLE, ids=" + ".join)
def test_the_table_of_what_is_free_is_that_of_the_documentation(columns, outputs):
    rows = freed_rows(independent_fisher(columns, outputs))
    _, printed, (_, unit) = TABLE[outputs]
    assert agrees(list(rows[NUISANCES].values()), printed, unit).all()
    for row in rows if outputs in (("11:y",), ("11:y", "6:y")) else ((), NUISANCES):
        freed = ", ".join(row) if len(row) < len(NUISANCES) else "all four"
        values = " | ".join(f"{sd:.3g}" for sd in rows[row].values())
        assert f"| {', '.join(outputs)} | {freed or 'nothing'} | {values} |" in DOCS


def verdicts(known):
    return {name: judge_by_rule(RULE, np.exp(min(2 * 1.96 * sd, 700.0)), 1.0)[0] for name, sd in known.items()}


def test_the_tip_alone_loses_k12_and_k22_and_an_accelerometer_at_mid_span_brings_them_back(columns):
    tip = freed_rows(independent_fisher(columns, ("11:y",)))
    assert verdicts(tip[()]) == {"k11": "not identified", "k12": "weakly identified", "k22": "identified"}
    assert set(verdicts(tip[NUISANCES]).values()) == {"not identified"}
    both = freed_rows(independent_fisher(columns, ("11:y", "6:y")))
    assert verdicts(both[NUISANCES]) == {"k11": "weakly identified", "k12": "weakly identified", "k22": "identified"}


@pytest.mark.docs
def test_the_example_of_the_documentation_prints_what_stands_below_it(monkeypatch):
    monkeypatch.chdir(CONFIGS.parent)
    code, printed = re.search(r"```python\n(.*?)```\n.*?```text\n(.*?)```", DOCS, re.DOTALL).groups()
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(code, {})
    assert out.getvalue() == printed


@pytest.mark.science
def test_sampled_standard_deviations_agree_where_the_posterior_is_gaussian():
    text = edited(
        (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8"),
        ('outputs = ["11:y"] ', 'outputs = ["11:y", "1:y", "1:rz"] '),
        ("f_step_hz = 1.0", "f_step_hz = 4.0"),
    )
    case = jb.case_from_text("joint measured", text)
    posterior = jb.sample(case, seed=1, settings=jb.SamplerSettings(walkers=24, max_steps=2000))
    sampled = np.log(posterior.stiffness).std(axis=0)
    expected = fisher_information(case.problem, posterior.best.theta).sd()
    np.testing.assert_allclose(sampled, list(expected.values()), rtol=0.05)
