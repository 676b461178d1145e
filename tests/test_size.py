"""What a reader has to hold in mind at once stays small."""

from dataclasses import fields
from graphlib import CycleError

import pytest
from benchmarks.page import table
from benchmarks.size import ROOT, longest_functions, sizes

from jointbayes import Posterior
from tests.chains import imports, longest_chain, rooms

pytestmark = pytest.mark.docs

SRC = ROOT / "src"
#: Code lines that each room is meant to have, and those that it may have by now. A room above its budget may shrink;
#: whoever adds to one moves its second figure, and says in the commit what the lines are for.
ROOMS = {
    "vibrecords": (6500, 7830),
    "structure": (3300, 3803),
    "joint": (1200, 1419),
    "frf": (2000, 2060),
    "inference": (2500, 2772),
    "identification": (1250, 1413),
    "sampling": (1300, 1610),
    "posterior": (3700, 4920),
    "studies": (1700, 1695),
    "case": (4000, 4757),
    "report": (2900, 3440),
    "cli and what stands alone": (1400, 1858),
}


def test_no_function_has_more_than_100_lines():
    assert longest_functions(SRC) == []


def test_rooms_stay_within_their_lines():
    """Printed by ``pytest -s``."""
    lines, _ = sizes(SRC / "jointbayes")
    by_room = {"vibrecords": sizes(SRC / "vibrecords")[0].total()}
    by_room |= {room: count for room, count in lines.items() if room in ROOMS}
    by_room["cli and what stands alone"] = lines.total() - sum(by_room.values()) + by_room["vibrecords"]
    rows = [(room, str(by_room[room]), str(budget), str(most)) for room, (budget, most) in ROOMS.items()]
    total, budgets = sum(by_room.values()), sum(budget for budget, _ in ROOMS.values())
    print("\n".join(table(("room", "code lines", "budget", "at most"), [*rows, ("all", str(total), str(budgets), "")])))
    assert by_room.keys() == ROOMS.keys()
    assert {room: by_room[room] for room, (_, most) in ROOMS.items() if by_room[room] > most} == {}


def test_a_posterior_has_few_public_members():
    """Studies are functions of a posterior, see `jointbayes.posterior.sampled`."""
    members = {name for name in dir(Posterior) if not name.startswith("_")}
    members |= {each.name for each in fields(Posterior) if not each.name.startswith("_")}
    assert len(members) <= 30, sorted(members)


#: Files in the longest chain of imports inside a room.
MOST_IN_A_CHAIN = 6


@pytest.mark.parametrize("room", rooms())
def test_imports_lead_through_few_files_of_a_room(room):
    chain = longest_chain(room)
    assert len(chain) <= MOST_IN_A_CHAIN, " → ".join(chain)


def test_a_chain_goes_through_imports_in_functions_and_for_types_and_not_through_what_hands_on(tmp_path):
    texts = {
        "__init__": "from thing.first import one",
        "first": "def one():\n    from thing.second import two",
        "second": "from typing import TYPE_CHECKING\n\nif TYPE_CHECKING:\n    from thing.inner import three",
        "inner/__init__": "from thing.inner.third import three",
        "inner/third": "three = 3",
        "apart": "from thing import one",
    }
    for name, text in texts.items():
        path = tmp_path / "thing" / f"{name}.py"
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_text(text)
    assert longest_chain("thing", tmp_path) == ["thing.apart", "thing.first", "thing.second", "thing.inner.third"]
    (tmp_path / "thing" / "inner" / "third.py").write_text("from thing.apart import one\n\nthree = 3")
    imports.cache_clear()
    with pytest.raises(CycleError):
        longest_chain("thing", tmp_path)
