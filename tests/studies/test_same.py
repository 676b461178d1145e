"""Whether two tests are of one joint: simulated pairs with and without a change, words, boundaries and exit codes."""

import numpy as np
import pytest
from benchmarks.exact_beam import ExactBeam, circle
from scipy import stats

import jointbayes as jb
from jointbayes.progress import tell_nobody
from jointbayes.studies import same
from jointbayes.studies.same import Change, compare_joints
from jointbayes.workflow import answered_case
from tests.case.refusal_rows import parts_named
from tests.conftest import CONFIGS, cli
from tests.marks import first_in_ci

#: Stiffness in the new test over that before.
KINDS = {"no change": 1.0, "0.5 % stiffer": 1.005, "5 % stiffer": 1.05}
_ERROR_OF_MODEL, _SCATTER, _MODES = 0.005, 0.0002, 4
_TESTED_TWICE = parts_named("rooms")["studies/same tested_twice"]


def exact_frequencies(ky, krz):
    """Lowest natural frequencies of the beam on these springs, Hz, without a mesh."""
    beam = ExactBeam(0.36, circle(0.025, 0.3), 2.1e11, 0.3, 7800.0, {1: 0.0, 11: 0.36}, (ky, 0.0, krz))
    return beam.modes(20_000.0).omega[:_MODES] / (2 * np.pi)


def pair_of(factor, index):
    """Two tests of one clamp that is so many times as stiff in the second; beam and noise are those of the index."""
    rng = np.random.default_rng([20261128, index])
    ky, krz = np.exp(rng.uniform(np.log(1e7), np.log(2e8))), np.exp(rng.uniform(np.log(2e4), np.log(2e5)))
    missed = np.exp(_ERROR_OF_MODEL * rng.standard_normal(_MODES))
    cases = []
    for name, times in (("before", 1.0), ("new", factor)):
        found = missed * exact_frequencies(times * ky, times * krz) * np.exp(_SCATTER * rng.standard_normal(_MODES))
        text = f"{_TESTED_TWICE}data.frequencies_hz = {found.tolist()}\ndata.sd_relative = {_SCATTER}\n"
        cases.append(jb.case_from_text(f"{name} {index}", text))
    return cases[0], cases[1]


def compared(factor, index):
    """What `jointbayes same` says of a pair."""
    before, new = (answered_case(case, 1, tell_nobody) for case in pair_of(factor, index))
    return compare_joints(before, new, 1, tell_nobody)


UNCHANGED = Change("k22", "1", 0.004, -0.011, 0.019, 0.7)


@pytest.fixture(scope="module")
def changes():
    """What is said of one pair of each truth, by what the table calls it."""
    return {kind: compared(factor, 1) for kind, factor in KINDS.items()}


def test_the_prior_of_a_change_is_normalised_wherever_the_joint_before_is():
    """The mean of the ratio over the prior of a joint in each test is 1, also at an end of a stiffness's range."""
    one, other = (answered_case(case, 1, tell_nobody) for case in pair_of(1.0, 2))
    own, _, _ = same._together(one, other)
    low, high = (ends[:2] for ends in own.prior.support)
    for share in (0.0, 0.01, 0.5, 1.0):
        nodes = np.linspace(low[0], high[0], 4001)
        theta = np.zeros((len(nodes), len(own.names)))
        theta[:, 0], theta[:, 2], theta[:, [1, 3]] = low[0] + share * (high[0] - low[0]), nodes, (low[1] + high[1]) / 2
        alone = np.exp(same._log_prior_of_change(own, theta)) / np.exp(same._log_prior_of_change(own, theta[:1]))
        normal = np.exp(-0.5 * ((nodes - theta[0, 0]) / (np.log(2) / 1.96)) ** 2)
        at = int(np.argmin(np.abs(nodes - theta[0, 0])))
        np.testing.assert_allclose(alone / alone[at], normal / normal[at], atol=1e-12)
        at_middle = np.exp(same._log_prior_of_change(own, theta))[at]
        sd = np.log(2) / 1.96
        inside = stats.norm.cdf(high[0], theta[0, 0], sd) - stats.norm.cdf(low[0], theta[0, 0], sd)
        expected = [(h - m) / (sd * np.sqrt(2 * np.pi)) / f for h, m, f in
                    ((high[0], low[0], inside), (high[1], low[1], 1.0))]  # fmt: skip
        assert at_middle == pytest.approx(np.prod(expected), rel=0.05)


@pytest.mark.whole
def test_a_change_is_told_from_none_where_the_error_of_the_model_is_larger_than_either(changes):
    for kind, factor in KINDS.items():
        change = changes[kind]
        assert change.converged
        assert change.changed == (factor != 1)
        for stiffness in change.stiffness:
            assert stiffness.low95 - 0.002 < factor - 1 < stiffness.high95 + 0.002
            assert stiffness.high95 - stiffness.low95 < 0.1
        assert (change.together.low95 > 0) == (factor > 1)
        assert "cancels: density, length, Young's modulus and error of the model in each mode." in change.premises[-1]
    alone = jb.sample(pair_of(1.0, 1)[0], seed=1).interval("krz")
    assert alone[1] / alone[0] > 1.1  # of which the change is known to a tenth: what both have in common cancels


@pytest.mark.science
@pytest.mark.parametrize("count", first_in_ci([3, 12], 1))
@pytest.mark.parametrize("kind", ["no change", "5 % stiffer"])
def test_few_of_many_unchanged_joints_are_called_changed(kind, count):
    changed = sum(compared(KINDS[kind], index).changed for index in range(1, count + 1))
    print(f"{kind}: {changed} of n = {count} called changed")
    if kind == "no change":
        assert changed <= 1  # two or more of 12 at 1 % in 0.6 % of such samples
    else:
        assert changed == count


def test_another_structure_shares_nothing_and_another_joint_is_refused():
    first, second = pair_of(1.0, 2)
    longer = jb.case_from_text("longer", second.text.replace("length_mm = 360.0", "length_mm = 380.0"))
    one, other = (answered_case(case, 1, tell_nobody) for case in (first, longer))
    own, shared, premises = same._together(one, other)
    assert premises[0] == "The two structures are stated differently: nothing of them cancels."
    assert {"before.density", "new.density"} < set(own.names)
    assert shared.names[:2] == one.names[:2]
    own, _, premises = same._together(one, one)
    assert {"density", "length", "youngs_modulus"} < set(own.names)
    assert own.names[:4] == ("before.ky", "before.krz", "new.ky", "new.krz")
    clamp = jb.load_case(CONFIGS / "clamped_beam.toml").problem
    with pytest.raises(jb.ModelError, match=r"same: found .*; expected one joint, tested twice; state both alike"):
        compare_joints(one, clamp, 1, tell_nobody)
    several = jb.load_case(CONFIGS / "two_overhangs.toml").problem
    with pytest.raises(
        jb.ModelError, match=r"same: found the tests long, short in .*; expected one; give a case of each"
    ):
        compare_joints(several, clamp, 1, tell_nobody)


def test_damping_and_noise_are_each_tests_own():
    nominal = jb.load_case(CONFIGS / "clamped_beam_uncertain.toml").problem
    own, _, premises = same._together(nominal, nominal)
    assert {"before.damping_ratio", "new.damping_ratio", "density"} < set(own.names)
    assert premises[-1] == "Uncertain in each by itself: before.damping ratio and new.damping ratio."
    assert np.isfinite(own.log_posterior(own.prior.sample(np.random.default_rng(1), 50))).any()


@pytest.fixture
def files(cheap_posterior, tmp_path):
    (tmp_path / "run").mkdir()
    cheap_posterior.save(tmp_path / "run" / "posterior.nc")
    return tmp_path / "run", tmp_path / "run" / "posterior.nc"


@pytest.mark.whole
def test_a_run_compared_with_itself_has_not_changed(files):
    result = cli("same", *files, "--quiet")
    assert result.exit_code == 0, result.output
    assert "The joint has not changed: odds " in result.output
