"""Case texts that several tests change, and the table of changes to them that are refused or warned of."""

import re
from pathlib import Path
from unicodedata import category

HERE = Path(__file__).parent
ONE_LINE = re.compile(r"case\.toml:[1-9]\d*: [^\n]+?: [^\n]+; expected [^\n]+; [^\n]+")
JARGON = re.compile(r"input should|valid (number|integer|string)|literal|pydantic|type=|discriminator|NoneType")


def case_text_named(name: str) -> str:
    """The text of a case in ``texts``."""
    return (HERE / "texts" / f"{name}.toml").read_text(encoding="utf-8")


def parts_named(name: str) -> dict[str, str]:
    """Parts of cases in ``texts``, by what stands behind "== " before each."""
    _, *parts = re.split(r"^== ", (HERE / "texts" / f"{name}.txt").read_text(encoding="utf-8"), flags=re.MULTILINE)
    return dict(part.split("\n", 1) for part in parts)


def refusal_rows() -> dict[str, list[list[str]]]:
    """Rows of ``refusals.txt`` by their base: changes, key, words and, where it is not one, how many lines are told."""
    rows: dict[str, list[list[str]]] = {}
    for line in (HERE / "refusals.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith("== "):
            rows[line[3:]] = here = []
        elif line and not line.startswith("# "):
            here.append(line.split(" ;; "))
    return rows


def broken(text: str, changes: str) -> tuple[str, int]:
    """The text of a base with the changes of a row, and the line that the fault is to be told on."""
    changes = re.sub(r"(?<!\\)\\n", "\n", changes).replace("\\\\", "\\")
    for change in changes.split(" && "):
        old, new = change.split("=>")
        assert old in text, f"{old!r} is not in the text"
        marked = new if "@" in changes else f"@{new}"
        text = text.replace(old, marked, 1) if old else text + marked
    return text.replace("@", ""), text.count("\n", 0, text.rindex("@")) + 1


def lines_of(error: Exception | str) -> list[str]:
    """The lines of an error, each of which says where, and is printable and plain."""
    lines = str(error).split("\n")
    for line in lines:
        assert ONE_LINE.fullmatch(line) or re.fullmatch(r"and \d+ more", lines[-1]), line
        # spaces of every width are shown as they are
        assert "".join(" " if category(sign) == "Zs" else sign for sign in line).isprintable(), line
        assert not JARGON.search(line), line
    return lines
