"""What a reader has to hold in mind at once stays small."""

from benchmarks.page import table
from benchmarks.size import ROOT, longest_functions, sizes

SRC = ROOT / "src"
#: Code lines that each room is meant to have, and those that it may have by now. A room above its budget may shrink;
#: whoever adds to one moves its second figure, and says in the commit what the lines are for.
ROOMS = {
    "vibrecords": (6700, 8340),
    "structure": (1900, 3850),
    "joint": (1250, 1500),
    "frf": (1900, 2110),
    "inference": (1900, 2800),
    "identification": (1050, 1500),
    "sampling": (1450, 2400),
    "posterior": (3500, 5950),
    "studies": (3300, 4600),
    "case": (4000, 5210),
    "report": (2700, 3656),
    "cli and what stands alone": (1600, 1675),
}


def test_no_function_has_more_than_60_lines():
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
