"""How far one has to follow imports inside a room: `python -m tests.chains` prints the longest chain of each.

An import counts wherever it stands, within a function and for a type checker too. A package's `__init__.py` hands names
on: whoever imports one from it imports the file that has it, and the `__init__.py` is no link of a chain.
"""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

from benchmarks.page import table
from benchmarks.size import ROOT

SRC = ROOT / "src"


@cache
def imports(src: Path = SRC) -> dict[str, frozenset[str]]:
    """Modules that each module imports, of those under a directory."""
    paths = {".".join(path.relative_to(src).with_suffix("").parts): path for path in sorted(src.rglob("*.py"))}
    named = {
        name: {
            (node.module or "", alias.asname or alias.name): (node.module or "", alias.name)
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        for name, path in paths.items()
    }

    def home(module: str, name: str) -> str:
        package = f"{module}.__init__"
        if f"{module}.{name}" in paths or package not in paths:
            return f"{module}.{name}" if f"{module}.{name}" in paths else module
        return next((home(*origin) for (_, known), origin in named[package].items() if known == name), package)

    found = {name: {home(*origin) for origin in named[name].values()} for name in paths}
    return {name: frozenset(found[name] & paths.keys() - {name}) for name in paths if not name.endswith("__init__")}


def longest_chain(room: str, src: Path = SRC) -> list[str]:
    """Modules of the longest chain inside a room, as "jointbayes.case"; a circle raises `graphlib.CycleError`."""
    known = {name: found for name, found in imports(src).items() if name.startswith(f"{room}.")}
    chains: dict[str, list[str]] = {}
    for name in TopologicalSorter({name: found & known.keys() for name, found in known.items()}).static_order():
        chains[name] = [name, *max((chains[each] for each in known[name] & known.keys()), key=len, default=[])]
    return max(chains.values(), key=len)


def rooms(src: Path = SRC) -> list[str]:
    """The rooms of jointbayes that are packages, and the readers."""
    return [
        "vibrecords",
        *sorted(f"jointbayes.{path.parent.name}" for path in (src / "jointbayes").glob("*/__init__.py")),
    ]


if __name__ == "__main__":
    found = [(room.rpartition(".")[2], chain) for room in rooms() for chain in [longest_chain(room)]]
    rows = [(room, str(len(chain)), " → ".join(name.split(".", 2)[-1] for name in chain)) for room, chain in found]
    print("\n".join(table(("room", "longest chain", "its files"), rows)))
