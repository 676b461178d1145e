"""Directions in words, on informations of which the right words are known."""

import numpy as np
import pytest

from jointbayes.joint import LogStiffness, SignedCoupling
from jointbayes.posterior.directions import (
    interval_ratio,
    name_directions,
    spread_in_words,
    summary_sentence,
    verdict_of,
)
from jointbayes.posterior.fisher import FisherInformation

COUPLED = np.array([1.0e9, 2.4e7, 1.0e6])  # ρ = 0.76: k22 and k22 − k12²/k11 are different things


def fisher_of(*known, stiffness=COUPLED, parametrisation=None, nuisance=None) -> FisherInformation:
    """Information from independent knowledge of quantities: (gradient of ln q over the coordinates, sd of ln q)."""
    parametrisation = parametrisation or LogStiffness()
    rows = np.array([np.array(gradient, dtype=float) / sd for gradient, sd in known])
    d = 3
    names = parametrisation.names
    prior = np.zeros((3, 3))
    if nuisance is not None:
        rows = np.column_stack([rows, np.asarray(nuisance)])
        d, names, prior = 4, (*names, "length"), np.diag([0, 0, 0, 1.0])
    theta = np.concatenate([parametrisation.coordinates(stiffness), np.zeros(d - 3)])
    return FisherInformation(names, theta, rows.T @ rows, prior, np.full(d, 5.0), parametrisation)


def condensed(stiffness, h=1e-6):
    """Gradient of ln(k22 − k12²/k11) over ln k, by central differences."""

    def log_q(t):
        k11, k12, k22 = np.exp(t)
        return np.log(k22 - k12**2 / k11)

    t = np.log(stiffness)
    return np.array([(log_q(t + e) - log_q(t - e)) / (2 * h) for e in h * np.eye(3)])


def sentences(*known, **options):
    return [named.sentence for named in name_directions(fisher_of(*known, **options))]


def test_the_condensed_stiffness_is_recognised_and_the_rest_is_not_known():
    found = sentences((condensed(COUPLED), 0.004), ((1, 0.5, 0), 2.0), ((0, 1, 0), 0.9))
    assert found[0] == "k22 − k12²/k11 is known to 0.4 %"
    assert all("is not known: a factor of" in sentence for sentence in found[1:])


def test_a_single_stiffness_is_named_singly():
    found = sentences(((0, 0, 1), 0.006), ((0, 1, 0), 0.15), ((1, 0, 0), 1.97))
    assert found == [
        "k22 is known to 0.6 %",
        "k12 is known roughly, to 16 %",
        "k11 is not known: a factor of 7.2",
    ]


def test_a_direction_a_little_beside_a_stiffness_is_named_by_it_with_its_own_spread():
    beside = np.array([0.0, -0.1, 0.995])
    found = name_directions(fisher_of((beside, 0.003), ((0, 0.995, 0.1), 0.05), ((1, 0, 0), 0.5)))
    assert found[0].quantity == "k22"
    assert found[0].sd == pytest.approx(np.hypot(0.995 * 0.003, 0.1 * 0.05), rel=1e-3)


def test_products_and_ratios_of_small_powers_are_recognised():
    found = name_directions(fisher_of(((-1, 2, 0), 0.01), ((0, 0, 1), 0.1), ((2, 1, 0), 2.0)))
    assert found[0].quantity == "k12²/k11"
    assert found[0].sd == pytest.approx(0.01)
    assert found[0].sentence == "k12²/k11 is known to 1 %"
    assert found[2].sentence.startswith("k11 along k12 (k12 ∝ k11^0.5) is not known: a factor of ")


def test_a_direction_that_is_no_simple_quantity_is_a_product_of_powers_known_exactly_so_well():
    gradient = np.array([0.3, -0.73, 1.0])
    fisher = fisher_of((gradient, 0.02), ((1, 0, 0), 3.0), ((0, 1, 0), 3.0))
    best = name_directions(fisher)[0]
    assert best.quantity == "k11^0.3·k22/k12^0.73"
    assert best.sentence == "k11^0.3·k22/k12^0.73 is known to 2 %"
    assert best.sd == pytest.approx(0.02, rel=1e-3)


def test_what_moves_along_and_against_an_unknown_direction_is_said():
    weak = np.array([0.4, 1.0, -0.6])
    weak /= np.linalg.norm(weak)
    others = np.linalg.svd(weak[None])[2][1:]
    found = name_directions(fisher_of((weak, 2.0), (others[0], 0.001), (others[1], 0.01)))[2]
    assert found.quantity == "k12 against k22 and along k11 (k22 ∝ k12^−0.6, k11 ∝ k12^0.4)" or (
        found.quantity == "k12 along k11 and against k22 (k22 ∝ k12^−0.6, k11 ∝ k12^0.4)"
    )
    assert found.sd == pytest.approx(2.0 * weak[1], rel=1e-4)
    assert found.verdict == "not identified"


def test_a_stiffness_without_any_information_is_not_known_at_all():
    assert sentences(((1, 0, 0), 0.01), ((0, 0, 1), 0.05)) == [
        "k11 is known to 1 %",
        "k22 is known to 5.1 %",
        "k12 is not known: more than a factor of 1000",
    ]


def test_directions_known_alike_are_not_mixed():
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    known = [(row, sd) for row, sd in zip(turn, (0.4, 0.401, 0.402), strict=True)]
    found = name_directions(fisher_of(*known))
    assert sorted(named.quantity for named in found) == ["k11", "k12", "k22"]
    assert all(named.sd == pytest.approx(0.4, rel=0.03) for named in found)


def test_where_every_stiffness_is_identified_no_combination_is_named():
    found = name_directions(fisher_of(((0, 1, -1), 0.0001), ((0, 1, 1), 0.004), ((1, 0, 0), 0.01)))
    assert sorted(named.quantity for named in found) == ["k11", "k12", "k22"]
    assert found[-1].sentence == "k11 is known to 1 %"


def test_nuisances_are_marginalised():
    # the only quantity known is k22 times an unknown, which is known to within a factor e
    alone = sentences(((0, 0, 1), 0.01), ((0, 1, 0), 0.02), ((1, 0, 0), 0.3))
    with_nuisance = sentences(((0, 0, 1), 0.01), ((0, 1, 0), 0.02), ((1, 0, 0), 0.3), nuisance=[100.0, 0.0, 0.0])
    assert alone[0] == "k22 is known to 1 %"
    assert with_nuisance[-1] == "k22 is not known: a factor of 2.7"


def test_the_signed_parametrisation_gets_the_same_words():
    known = ((condensed(COUPLED), 0.004), ((0, 1, 0), 0.02), ((1, 0, 0), 0.1))
    assert sentences(*known)[0] == "k22 − k12²/k11 is known to 0.4 %"
    logs = fisher_of(*known)
    signed = SignedCoupling()
    theta = signed.coordinates(COUPLED * [1, -1, 1])
    slope = signed.derivative(theta) / (COUPLED * [1, -1, 1])[:, None]
    turned = FisherInformation(
        signed.names, theta, slope.T @ logs.data @ slope, np.zeros((3, 3)), np.full(3, 5.0), signed
    )
    assert [n.sentence for n in name_directions(turned)] == [n.sentence for n in name_directions(logs)]


def test_a_coupling_of_open_sign_is_spoken_of_as_rho():
    stiffness = np.array([1e9, 0.0, 1e6])
    found = sentences(
        ((1, 0, 0), 0.5), ((0, 1, 0), 0.01), ((0, 0, 1), 0.1), stiffness=stiffness, parametrisation=SignedCoupling()
    )
    assert found == ["k22 is known to 1 %", "rho is known roughly, to ±0.1", "k11 is not known: a factor of 1.6"]
    mixed = name_directions(
        fisher_of(
            ((0, 1, 0.4), 0.01), ((1, 0, 0), 1.0), ((0, -0.4, 1), 1.5),
            stiffness=stiffness, parametrisation=SignedCoupling(),
        )
    )  # fmt: skip
    assert mixed[0].sentence == "k22·exp(0.4 rho) is known to 1 %"
    assert "is not known" in mixed[1].sentence


def test_the_condensed_stiffness_is_recognised_through_rho():
    stiffness = np.array([1e9, 0.5e7 * np.sqrt(10), 1e6])  # ρ = 0.5, known to ±0.6 only
    found = sentences(
        ((0, 1, -4 / 3), 0.01), ((1, 0, 0), 1.0), ((0, 4 / 3, 1), 2.0),
        stiffness=stiffness, parametrisation=SignedCoupling(),
    )  # fmt: skip
    assert found[0] == "k22 − k12²/k11 is known to 1 %"


@pytest.mark.parametrize("sd", [1e-4, 0.0569, 0.057, 0.28, 0.281, 3.0])
def test_verdicts_are_those_of_the_rule(sd):
    ratio = interval_ratio(sd)
    assert ratio == pytest.approx(np.exp(2 * 1.959964 * sd), rel=1e-5)
    expected = "identified" if ratio <= 1.25 else "weakly identified" if ratio <= 3 else "not identified"
    assert verdict_of(sd) == expected
    assert ("factor" in spread_in_words(sd)) == (expected == "not identified")


def test_one_sentence_holds_all():
    named = name_directions(fisher_of(((0, 0, 1), 0.006), ((0, 1, 0), 0.15), ((1, 0, 0), 1.97)))
    assert summary_sentence(named) == (
        "k22 is known to 0.6 %; k12 is known roughly, to 16 %; k11 is not known: a factor of 7.2."
    )
