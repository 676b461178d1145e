"""Combinations in words, on draws of which the right words are known, and never any that the draws contradict."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from jointbayes.posterior.directions import name_directions, summary_sentence
from jointbayes.posterior.fisher import spread_in_words
from jointbayes.posterior.identifiability import assess
from jointbayes.rounding import rounded, rounded_interval
from tests.conftest import PAIR

NAMES = ("k11", "k12", "k22")
COUPLED = np.array([1.0e9, 2.4e7, 1.0e6])  # ρ = 0.76: k22 and k22 − k12²/k11 are different things


def prior_draws(signed=False, n=20_000):
    rng = np.random.default_rng(0)
    k = np.exp(rng.uniform(np.log([1e6, 1e4, 1e3]), np.log([1e11, 1e10, 1e8]), (n, 3)))
    if signed:
        k[:, 1] = rng.uniform(-1, 1, n) * np.sqrt(k[:, 0] * k[:, 2])
    return k[PAIR.is_positive_semidefinite(k)]


def draws_of(*known, stiffness=COUPLED, n=20_000):
    """Draws whose logarithms have independent knowledge of combinations: (gradient over ln k, sd)."""
    rng = np.random.default_rng(1)
    rows = np.array([np.array(gradient, dtype=float) for gradient, _ in known])
    values = rng.normal(size=(n, 3)) * [sd for _, sd in known]
    return np.exp(np.log(stiffness) + values @ np.linalg.inv(rows).T)


def directions(*known, **options):
    return name_directions(draws_of(*known, **options), prior_draws())


def test_the_condensed_stiffness_is_recognised_along_its_curved_sheet():
    rng = np.random.default_rng(2)
    k11, k12 = 1e9 * np.exp(0.5 * rng.normal(size=20_000)), 2.4e7 * np.exp(0.25 * rng.normal(size=20_000))
    k22 = 4.2e5 * np.exp(0.004 * rng.normal(size=20_000)) + k12**2 / k11
    found = name_directions(np.stack([k11, k12, k22], axis=-1), prior_draws())
    assert found[0].quantity == "k22 − k12²/k11"
    assert found[0].sd_log == pytest.approx(0.004, rel=0.03)
    assert found[0].sentence == "k22 − k12²/k11 is identified: 420 (417 to 423) kN·m/rad"
    assert all(named.verdict != "identified" for named in found[1:])


def test_a_single_stiffness_is_named_singly():
    found = directions(((0, 0, 1), 0.006), ((0, 1, 0), 0.15), ((1, 0, 0), 1.2))
    assert [named.quantity for named in found] == ["k22", "k12", "k11"]
    assert [named.verdict for named in found] == ["identified", "weakly identified", "not identified"]
    assert found[0].sentence == "k22 is identified: 1.00e6 (9.88e5 to 1.01e6), SI units"


def test_products_and_ratios_of_small_powers_are_recognised():
    found = directions(((-1, 2, 0), 0.01), ((0, 0, 1), 0.1), ((1, 0, 0), 1.0))
    assert found[0].quantity == "k12²/k11"
    assert found[0].sd_log == pytest.approx(0.01, rel=0.03)
    assert found[-1].quantity == "k11"
    assert found[-1].sentence.endswith("(k12 moves with it: k12 ∝ k11^0.5)")


def test_a_direction_that_is_no_simple_quantity_is_a_product_of_powers_with_its_own_spread():
    gradient = np.array([0.3, -0.73, 1.0])
    values = draws_of((gradient, 0.02), ((1, 0, 0), 0.6), ((0, 1, 0), 0.6))
    best = name_directions(values, prior_draws())[0]
    powers = {k: float(p or 1) for k, p in re.findall(r"(k\d\d)(?:\^([\d.]+))?", best.quantity)}
    assert best.quantity == f"k11^{powers['k11']:g}·k22/k12^{powers['k12']:g}"
    product = values[:, 0] ** powers["k11"] * values[:, 2] / values[:, 1] ** powers["k12"]
    assert np.log(product).std() == pytest.approx(best.sd_log)
    assert best.sd_log < 0.02 * 1.4


def test_every_figure_is_that_of_the_draws_of_the_quantity():
    values = draws_of(((-1, 2, 0), 0.01), ((0, 0, 1), 0.1), ((1, 0, 0), 1.0))
    first = name_directions(values, prior_draws())[0]
    quantity = values[:, 1] ** 2 / values[:, 0]
    low, high = np.quantile(quantity, [0.025, 0.975])
    assert first.interval95 == pytest.approx((low, high))
    assert first.ratio == pytest.approx(high / low)
    ends = rounded_interval((low, high), (np.nan, np.nan))
    assert first.sentence.endswith(f": {rounded(first.median)} ({ends}), SI units")


@pytest.mark.parametrize(
    "known",
    [
        [((1, 0, 0), 0.4), ((0, 1, 0), 0.401), ((0, 0, 1), 0.402)],  # alike
        [((0, 1, -1), 0.0001), ((0, 1, 1), 0.004), ((1, 0, 0), 0.01)],  # all identified
    ],
)
def test_quantities_known_alike_or_all_identified_are_not_mixed(known):
    found = directions(*known)
    assert sorted(named.quantity for named in found) == ["k11", "k12", "k22"]
    assert not any("moves with" in named.sentence for named in found)


def test_a_coupling_of_either_sign_is_spoken_of_as_rho_and_no_power_of_k12_is_named():
    rng = np.random.default_rng(3)
    rho = np.clip(rng.normal(0.1, 0.2, 20_000), -0.99, 0.99)
    k11, k22 = 1e9 * np.exp(0.5 * rng.normal(size=20_000)), 1e6 * np.exp(0.01 * rng.normal(size=20_000))
    found = name_directions(np.stack([k11, rho * np.sqrt(k11 * k22), k22], axis=-1), prior_draws(signed=True))
    assert found[0].quantity == "k22"
    open_sign = next(named for named in found if named.quantity == "rho")
    assert open_sign.verdict == "not identified"
    assert math.isinf(open_sign.ratio)
    assert "contains zero" in open_sign.sentence
    assert not any(re.search(r"k12(?!²/k)", named.quantity) for named in found)


def test_a_combination_with_draws_of_both_signs_is_never_called_known():
    # most draws lie in a narrow band of k12, a few have the other sign: where a linearisation would see only the band
    rng = np.random.default_rng(4)
    rho = np.where(rng.random(20_000) < 0.05, rng.uniform(-0.3, 0.0, 20_000), rng.normal(0.93, 0.0006, 20_000))
    k11, k22 = np.exp(rng.normal(np.log([1e9, 1e6]), 1.0, (20_000, 2))).T
    draws = np.stack([k11, rho * np.sqrt(k11 * k22), k22], axis=-1)
    for named in name_directions(draws, prior_draws(signed=True)):
        assert named.verdict == "not identified"


def test_what_the_prior_says_alone_is_not_called_known():
    prior = prior_draws()
    assert all(named.verdict == "not identified" for named in name_directions(prior, prior))


def test_single_stiffnesses_keep_verdict_ends_and_limit_that_are_already_said():
    values = draws_of(((0, 0, 1), 0.006), ((0, 1, 0), 0.15), ((1, 0, 0), 1.2))
    k11, k22 = (assess(values[:, i], prior_draws()[:, i]) for i in (0, 2))
    bounded = replace(k11, cls="bounded below", limit=2.5e8, unit="N/m")
    known = {"k11": bounded, "k22": replace(k22, interval=(0.9, 1.5), ratio=1.5, cls="weakly identified")}
    found = {named.quantity: named for named in name_directions(values, prior_draws(), known)}
    assert (found["k22"].verdict, found["k22"].interval95) == ("weakly identified", (0.9, 1.5))
    assert found["k22"].ratio == 1.5 / 0.9
    assert "(0.900 to 1.50)" in found["k22"].sentence
    assert found["k11"].sentence == "k11 is bounded below: above 250 MN/m"


def test_where_a_failed_run_allows_no_verdict_no_combination_has_one():
    values = draws_of(((-1, 2, 0), 0.01), ((0, 0, 1), 0.1), ((1, 0, 0), 1.0))
    known = {n: replace(assess(values[:, i], prior_draws()[:, i]), cls="no verdict") for i, n in enumerate(NAMES)}
    found = name_directions(values, prior_draws(), known)
    assert {named.verdict for named in found} == {"no verdict"}
    assert {named.quantity for named in found} == set(NAMES)
    assert "is identified" not in summary_sentence(found)
    assert "k22 has no verdict: " in summary_sentence(found)


def test_plain_springs_have_no_coupling_to_speak_of():
    values = draws_of(((1, 0, 0), 0.5), ((0, 1, 0), 0.1), ((0, 0, 1), 0.01))
    values[:, 1] = 0.0
    found = name_directions(values, prior_draws())
    assert [named.quantity for named in found] == ["k22", "k11"]


@pytest.mark.parametrize("sd", [1e-4, 0.0569, 0.2, 0.201, 1.7, 3.1])
def test_a_forecast_is_printed_in_per_cent_and_where_it_is_wide_by_its_ends(sd):
    ratio = np.exp(2 * 1.959963984540054 * sd)
    words = spread_in_words(sd)
    assert ("times" in words) == (sd > 0.2)
    assert words.startswith("beyond") == (sd > 3)
    if words.endswith(" %"):
        assert float(words[1:-2]) == pytest.approx(196 * sd, rel=0.05)
    elif sd <= 3:
        low, high = map(float, words.removesuffix(" times").split(" to "))
        assert (1 / low, high) == pytest.approx((np.sqrt(ratio),) * 2, rel=0.05)


@pytest.mark.parametrize(("slope", "doubled"), [(0.2, "+0.14"), (-0.3, "-0.21")])
def test_a_coupling_that_moves_with_a_stiffness_is_told_by_what_it_changes_as_that_doubles(slope, doubled):
    # ρ = slope · ln(k11/1e9), so that twice the k11 adds slope · ln 2
    rng = np.random.default_rng(5)
    log_ratio = np.clip(rng.normal(0.0, 0.9, 20_000), -3, 3)
    k11, k22 = 1e9 * np.exp(log_ratio), 1e6 * np.exp(0.01 * rng.normal(size=20_000))
    draws = np.stack([k11, slope * log_ratio * np.sqrt(k11 * k22), k22], axis=-1)
    sentence = summary_sentence(name_directions(draws, prior_draws(signed=True)))
    assert f"(rho moves with it, {doubled} as k11 doubles)" in sentence
