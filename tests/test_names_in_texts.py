"""Every name that a message or a page tells a user to write exists: in `jb`, of a posterior, in a case file."""

import ast
import re
from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

import jointbayes as jb
from jointbayes.case.spec.whole import CaseSpec
from tests.pages import ROOT

SOURCES = sorted((ROOT / "src").rglob("*.py"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "docs").rglob("*.ipynb"))]
#: Words in brackets that are units, indices, parts of commands or of patterns, and no tables of a case file.
NO_TABLES = {*re.findall(r"\w+", "deg rad s ms ij xyz ab gsp afiquvxy cb table pace jointbayes list")}


@cache
def texts(path: Path) -> tuple[str, ...]:
    """String literals of a source, docstrings included; a page whole."""
    text = path.read_text(encoding="utf-8")
    return (text,) if path.suffix != ".py" else tuple(_literals(text))


def _literals(text: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.JoinedStr):
            yield "".join(part.value if isinstance(part, ast.Constant) else "{}" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def tables(annotation: Any) -> list[Any]:
    """Models of tables that an annotation allows, and of the values of names that a user chooses."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in get_args(annotation) for model in tables(inner)]


def takes_names(annotation: Any) -> bool:
    """Whether a table's keys are names that a user chooses."""
    origin = getattr(annotation, "__origin__", None)
    return (isinstance(origin, type) and issubclass(origin, dict)) or any(map(takes_names, get_args(annotation)))


def there_is(path: list[str], models: list[Any]) -> bool:
    """Whether a case file may have a key at a path."""
    if not path:
        return True
    for model in models:
        field = model.model_fields.get(path[0]) or next(
            (f for f in model.model_fields.values() if path[0] == f.alias), None
        )
        if field is not None:
            chosen = path[2:] if takes_names(field.annotation) and len(path) > 1 else path[1:]
            within = tables(field.annotation)
            if there_is(chosen, within) or there_is(path[1:], within):
                return True
    return False


def unknown_tables(text: str, pattern: str) -> set[str]:
    found = {path for path in re.findall(pattern, text) if path not in NO_TABLES}
    return {path for path in found if not there_is([part.strip('"') for part in path.split(".")], [CaseSpec])}


@pytest.mark.parametrize("paths", [SOURCES, PAGES], ids=["sources", "pages"])
def test_every_name_of_the_package_exists(paths):
    named = {name for path in paths for text in texts(path) for name in re.findall(r"\bjb\.(\w+)", text)}
    assert len(named) > 3
    assert {name for name in named if not hasattr(jb, name)} <= {"NAME"}


@pytest.mark.parametrize("paths", [SOURCES, PAGES], ids=["sources", "pages"])
def test_every_member_of_a_posterior_exists(paths):
    pattern = r"(?<![\w/.])posterior\.(\w+)"
    named = {name for path in paths for text in texts(path) for name in re.findall(pattern, text)}
    known = {*dir(jb.Posterior), *(field.name for field in fields(jb.Posterior))}
    assert {"verdict", "under"} <= named
    assert named - known <= {"nc"}  # the file's ending


def test_every_table_that_a_message_names_is_one_of_the_schema():
    pattern = r"(?<![\w\]\[(])\[([a-z_]+(?:\.[\w\"]+)*)\](?![\w(+*?{])"
    odd = {path.name: found for path in SOURCES for text in texts(path) if (found := unknown_tables(text, pattern))}
    assert odd == {}


def test_every_table_that_a_page_names_is_one_of_the_schema():
    pattern = r"(?m)(?:`|^)\[([a-z_]+(?:\.[\w\"]+)*)\](?:`|$|\s+#)"
    odd = {path.name: found for path in PAGES for text in texts(path) if (found := unknown_tables(text, pattern))}
    assert odd == {}


def test_every_key_that_a_message_puts_into_a_table_is_one_of_the_schema():
    pattern = r"\b([a-z_]+) = [^\s,]{1,20},? (?:in|to|under) \[([a-z_.]+)\]"
    named = {pair for path in SOURCES for text in texts(path) for pair in re.findall(pattern, text)}
    assert len(named) > 3
    assert {pair for pair in named if not there_is([*pair[1].split("."), pair[0]], [CaseSpec])} == set()


def test_a_name_that_does_not_exist_is_found():
    assert unknown_tables("state [uncertain.colour] in [data.layout]", r"\[([a-z_.]+)\]") == {"uncertain.colour"}
    assert not there_is(["joint", "colour"], [CaseSpec])
