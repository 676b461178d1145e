"""Assemblies that cannot be, each in a file of its own: one line that names file, line and key."""

import re

import pytest

from jointbayes.case.case import load_case
from jointbayes.errors import CaseError
from tests.case.test_joints import DATA, TWO
from tests.conftest import edited

FRAME = """[structure]
kind = "frame"
directions = ["x", "y", "rz"]
youngs_modulus_gpa = 210.0
density_kg_m3 = 7800.0
section = { shape = "rectangle", width_mm = 40.0, height_mm = 20.0 }
damping = { law = "loss_factor", loss_factor = 0.005 }
bodies.one.points = { left = [0, 0, 0], right = [300, 0, 0] }
bodies.two.points = { start = [310, 0, 0], end = [600, 0, 0] }

[joint]
kind = "springs"
dofs = ["one.right:x", "one.right:y", "one.right:rz"]
against = ["two.start:x", "two.start:y", "two.start:rz"]
"""
PORTS = DATA.replace('"4:y", "9:y"', '"one.left:y", "two.end:y"').replace('"4:y"', '"one.left:y"')
SPRINGS = "[data.truth.stiffness]\nkx = 1e8\nky = 1e8\nkrz = 1e5\n"
LEFT = "k11 = 5e7\nk12 = 4e5\nk22 = 5e4"

CASES = {
    "K^J with k12 and k21": (
        edited(TWO, (LEFT, f"{LEFT}\nk21 = 5e5")),
        r"data\.truth\.stiffness(\.left)?: .*k21.*expected .*k11, left\.k12, left\.k22",
    ),
    "K that is not symmetric": (
        edited(
            TWO,
            (
                TWO[: TWO.index("[joints.left]")],
                '[structure]\nkind = "matrices"\ndofs = ["1:y", "1:rz", "4:y", "9:y", "11:y", "11:rz"]\n'
                "stiffness = [[2, 1, 0, 0, 0, 0], [0, 2, 0, 0, 0, 0], [0, 0, 2, 0, 0, 0], [0, 0, 0, 2, 0, 0], "
                "[0, 0, 0, 0, 2, 0], [0, 0, 0, 0, 0, 2]]\nmass = [1, 1, 1, 1, 1, 1]\n"
                'damping = { law = "loss_factor", loss_factor = 0.01 }\n',
            ),
        ),
        r"structure\.stiffness: .*symmetric",
    ),
    "sides at different places": (FRAME + PORTS + SPRINGS, r"joint\.against: .*different places.*offset_mm"),
    "a port outside the body": (
        edited(TWO, ('["4:y", "9:y"]', '["4:y", "14:y"]')),
        r'data\.outputs: "14:y": there is no node 14; expected a node from 1 to 11',
    ),
    "a port of no direction that the body has": (
        edited(TWO, ('["4:y", "9:y"]', '["4:y", "9:z"]')),
        r'data\.outputs: "9:z": no direction z',
    ),
    "a joint outside the body": (
        edited(TWO, ('["11:y", "11:rz"]', '["11:y", "12:rz"]')),
        r'joints\.right\.dofs: "12:rz": there is no node 12',
    ),
    "quantities shared between unlike joints": (
        edited(
            TWO,
            ('kind = "springs"\n', 'kind = "springs"\nshared = "left"\n'),
            ("[data.truth.stiffness.right]\nky = 2e7\nkrz = 3e4\n", ""),
        ),
        r"joints\.right\.shared: .*another kind",
    ),
    "a base that builds on the case": ('extends = "case.toml"\n' + TWO, r"extends: found a circle"),
}


@pytest.mark.parametrize(("text", "words"), CASES.values(), ids=list(CASES))
def test_an_assembly_that_cannot_be_is_one_line_with_file_line_and_key(tmp_path, text, words):
    path = tmp_path / "case.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CaseError) as caught:
        load_case(path)
    first, *others = str(caught.value).splitlines()
    assert not others, others
    assert re.match(rf".*case\.toml:\d+: {words}", first), first
    assert "; expected " in first


def test_sides_at_different_places_are_taken_where_an_offset_leads_from_one_to_the_other(tmp_path):
    path = tmp_path / "case.toml"
    linked = edited(FRAME, ('kind = "springs"\n', 'kind = "springs"\noffset_mm = [10, 0, 0]\n'))
    path.write_text(linked + PORTS + SPRINGS, encoding="utf-8")
    assert load_case(path).problem.names == ("kx", "ky", "krz")
