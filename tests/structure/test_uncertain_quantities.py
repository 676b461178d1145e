"""Families of structures: the modes of a beam whose quantities are uncertain are those of the beam built anew."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import jointbayes as jb
from jointbayes.structure import shape_modes
from jointbayes.structure.matrices import Modes
from jointbayes.structure.shape_modes import ModeTable, _hopeless
from tests.conftest import CLAMP, STEEL, TABLE_3, pair_matrix
from tests.structure.dense import worst

PORTS = jb.Ports(np.arange(20.0, 2500.0, 53.0), ("11:y", "6:y"), ("11:y",))


def recipe(law=None, **more):
    return jb.BeamRecipe(0.383, jb.Section.circle(0.025), STEEL, law or jb.ModalDamping((0.01, 0.02)), **more)


def free_modes(family, size=1.0):
    """Its free modes for motions of its first two DOFs."""
    motions = size * np.eye(family.nominal.n_dofs)[:, :2]
    return family.free_modes(np.arange(len(motions)), motions)


def test_where_a_table_will_not_do_the_beam_is_solved_anew(monkeypatch):
    monkeypatch.setattr(shape_modes, "_NODES", (2,))
    ranges = {"section_size": (-0.05, 0.05), "shear_coefficient": (-0.3, 0.3)}
    family = jb.BeamFamily(recipe(), ranges)
    near = family.at(("1:y", "1:rz", *PORTS.outputs), 2500.0)
    motions = np.eye(near.nominal.n_dofs)[:, near.nominal.index(["1:y", "11:y"])]
    assert not isinstance(near.free_modes(np.arange(len(motions)), motions).bodies[0].modes, ModeTable)
    low, high = np.array(list(ranges.values())).T
    factors = np.exp(np.random.default_rng(1).uniform(low, high, (3, 2)))
    assert worst(family, CLAMP, pair_matrix(TABLE_3), PORTS, factors) < 1e-6


def test_factors_on_all_damping_ratios_and_on_one_multiply():
    assert_allclose(recipe().structure({"damping_ratio": 2.0, "damping_ratio_2": 3.0}).damping.ratios, (0.02, 0.12))


def test_the_last_listed_damping_ratio_holds_for_all_higher_modes():
    family = jb.BeamFamily(recipe(), {"damping_ratio_1": (-1.0, 1.0), "damping_ratio_2": (-1.0, 1.0)})
    ratios = family.damping_ratios(np.array([[1.5, 0.5]]), 22)
    assert_allclose(ratios[0, :4], [0.015, 0.01, 0.01, 0.01])
    assert ratios.shape == (1, 22)
    assert math.isclose(ratios[0, -1], 0.01)


@pytest.mark.science
def test_free_modes_that_were_asked_for_before_are_the_same_whoever_asks():
    beam, ranges = recipe(), {"length": (-0.01, 0.01), "section_size": (-0.02, 0.02)}
    first, again = (free_modes(jb.BeamFamily(beam, ranges)) for _ in range(2))
    assert again is first
    others = (
        free_modes(jb.BeamFamily(replace(beam, length=1.1 * beam.length), ranges)),
        free_modes(jb.BeamFamily(beam, {"length": (-0.02, 0.01)})),
        free_modes(jb.BeamFamily(beam, ranges, exact=True)),
        free_modes(jb.BeamFamily(beam, ranges), 2.0),
    )
    assert first not in others
    assert np.allclose(2 * first(np.ones((1, 2)))[1], others[-1](np.ones((1, 2)))[1])


def test_beams_that_are_described_by_lists_are_solved_all_the_same():
    beam = recipe()
    listed = replace(beam, supports=list(beam.supports))
    found, expected = (free_modes(jb.BeamFamily(one, {}))(np.ones((1, 0))) for one in (listed, beam))
    assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))


def test_forces_at_the_tip_of_many_responses_need_no_more_modes_than_at_the_tip_of_few():
    kept = []
    for elements in (20, 40):
        points = tuple(f"{n}:y" for n in range(2, elements + 2))
        ports = jb.Ports(np.array([20.0, 2500.0]), points, points[-1:])
        family = jb.BeamFamily(recipe(elements=elements), {}).at((*CLAMP.dofs, *ports.outputs), 2500.0)
        motions = np.hstack([CLAMP.selection(family), family.nominal.unit_forms(ports.outputs + ports.inputs)])
        forced = np.isin(np.arange(motions.shape[1]), (0, 1, motions.shape[1] - 1))
        kept.append(family.free_modes(np.arange(len(motions)), motions, forced)(np.ones((1, 0)))[0].shape[1])
    assert kept[0] == kept[1] < 30


@pytest.mark.parametrize(
    ("errors", "hopeless"),
    [
        ([1e-2, 1e-3, 1e-4], False),  # too few to tell
        ([1e-2, 1e-3, 1e-4, 1e-5], False),  # on its way
        ([1e-4, 1e-5, 1e-6, 2e-7, 9e-8], False),
        ([1.0, 0.9, 0.7, 0.4], True),  # falls, but not to 1e-8 at 36 points
        ([1.0, 0.9, 1.1, 1.0], True),
        ([5e-7, 3e-7, 4e-7, 3e-7], True),  # rounding
        ([1e-2, 1e-3, 1e-4, float("nan")], True),
    ],
)
def test_a_table_is_given_up_when_more_points_cannot_make_it_accurate(errors, hopeless):
    assert _hopeless(errors) is hopeless


def test_the_error_of_a_table_without_elastic_modes_below_is_a_number():
    mass = np.eye(3)
    modes = Modes(np.array([0.0, 0.0, 1.0]), np.eye(3))
    table = ModeTable(lambda _numbers: (modes, mass), np.eye(3)[:, :2], [(-1.0, 1.0)], [2])
    assert table.error(lambda _numbers: (modes, mass)) < 1e-12


def test_modes_that_change_places_are_not_tabulated_at_more_and_more_points():
    solved = []

    def modes_at(numbers):
        solved.append(tuple(numbers))
        jump = 1.0 if numbers[0] > 0.1 else 0.0
        return Modes(np.array([1.0 + jump, 3.0 + jump]), np.eye(2)), np.eye(2)

    assert shape_modes.tabulated(modes_at, np.eye(2)[:, :1], [(-1.0, 1.0)]) is None
    assert len(solved) < 4 + 6 + 8 + 11 + 15
