"""The pictures of the house and of the way of a run, which are drawn from the sources while the site is built."""

import re

import pytest
from benchmarks import house, size

PYPROJECT = """[tool.importlinter]
[[tool.importlinter.contracts]]
id = "floors"
layers = ["__main__", "roof", "left | right", "cellar"]
"""
SOURCES = {
    "vibrecords/__init__.py": '"""Reads."""\n',
    "jointbayes/cellar.py": '"""Below."""\nimport vibrecords.data\n',
    "jointbayes/left.py": '"""Left\nof it.\n\nMore."""\nfrom jointbayes.cellar import x\n',
    "jointbayes/right/__init__.py": '"""Right."""\n',
    "jointbayes/right/deep.py": "def f():\n    # why\n    import jointbayes.cellar\n",
    "jointbayes/roof.py": '"""Above."""\nfrom jointbayes.left import a\nfrom jointbayes.right.deep import f\n'
    "from jointbayes.cellar import x\nfrom vibrecords import y\n",
}


def test_rooms_stand_on_their_floors_and_arrows_are_the_imports_that_no_others_imply(tmp_path):
    (tmp_path / "pyproject.toml").write_text(PYPROJECT)
    for name, text in SOURCES.items():
        path = tmp_path / "src" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    built = house.rooms(tmp_path / "src")
    assert {room.name: (room.floor, room.files, room.lines) for room in built} == {
        "vibrecords": (0, 1, 0), "cellar": (1, 1, 1), "left": (2, 1, 1), "right": (2, 2, 2), "roof": (3, 1, 4),
    }  # fmt: skip
    assert next(room.sentence for room in built if room.name == "left") == "Left of it."
    drawn = {("roof", "left"), ("roof", "right"), ("left", "cellar"), ("right", "cellar"), ("cellar", "vibrecords")}
    assert (house.arrows(built), house.picture(built).count("<path")) == (drawn, len(drawn))


def test_the_page_has_every_room_and_all_its_lines():
    page = house.on_page_markdown(f"before\n{house.OPEN}\nelse\n{house.CLOSE}\nafter")
    assert page.startswith("before\n")
    assert page.endswith("\nafter")
    assert "else" not in page
    assert house.on_page_markdown("no place for it") == "no place for it"
    listed = {name: int(lines.replace(",", "")) for name, lines in re.findall(r"\| `(\w+)` .* ([\d,]+) \|\n", page)}
    lines, _ = size.sizes(house.ROOT / "src" / "jointbayes")
    packages = {name: count for name, count in lines.items() if name != "(top)"}
    assert {name: listed[name] for name in packages} == packages
    assert listed["vibrecords"] == size.sizes(house.ROOT / "src" / "vibrecords")[0].total()
    built = house.rooms()
    below = {room.name: room.floor for room in built}
    assert all(below[lower] < below[upper] for upper, lower in house.arrows(built))
    marked = (house.ROOT / "docs" / "developing.md").read_text(encoding="utf-8")
    assert marked.count(house.OPEN) == marked.count(house.CLOSE) == 1


def test_the_way_of_a_run_is_drawn_of_functions_that_there_are(monkeypatch):
    drawn = house.on_page_markdown(f"before\n\n{house.WAY_OPEN}\nelse\n{house.WAY_CLOSE}\n\nafter")
    assert drawn.startswith("before\n\n<svg ")
    assert drawn.endswith("</svg>\n\nafter")
    assert drawn.count("<rect ") == drawn.count("marker-end") + 1 == len(house.STEPS)
    assert (house.ROOT / "docs" / "method.md").read_text(encoding="utf-8").count(house.WAY_OPEN) == 1
    monkeypatch.setattr(house, "STEPS", (("draws", "jointbayes/workflow.py", "no_such_step"), *house.STEPS[1:]))
    with pytest.raises(SystemExit, match="found no no_such_step"):
        house.way()
