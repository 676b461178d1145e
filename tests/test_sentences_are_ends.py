"""No code reads, cuts or compares a sentence: texts for people are the last thing that is made.

The source is walked for calls that take a text apart, and for searches of words in one. Rooms that parse input are
left out whole. What else takes texts apart stands in ``texts_taken_apart.txt``.
"""

import ast
import re
from collections.abc import Iterator
from typing import get_args

from jointbayes.posterior.identifiability import VerdictClass
from tests.pages import ROOT

SOURCE = ROOT / "src"
CUTS = {"startswith", "endswith", "replace", *(f"{side}{how}" for side in ("", "r") for how in ("split", "partition"))}
CUTS |= {"removeprefix", "removesuffix"}
#: Rooms that parse what users give: measurement files, cases, files of FE programs.
PARSERS = ("vibrecords/", "jointbayes/case/", "jointbayes/structure/imported/")
#: A text that is more than the separator of a label, key or path: a blank between words, or a word.
PROSE = re.compile(r"\s|[A-Za-z]{3}")
#: File, what its texts are, and the functions that take them apart, "-" outside of any; those that are owed last.
TABLE = (ROOT / "tests" / "texts_taken_apart.txt").read_text(encoding="utf-8")
ROWS = [line.split(" ;; ") for line in TABLE.splitlines() if not line.startswith("#")]


def texts(node: ast.AST) -> list[str]:
    return [n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str)]


def takes_apart(node: ast.AST) -> bool:
    """Whether an expression takes a text apart by words, by a pattern, or looks for words in one."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        of, name = node.func.value, node.func.attr
        if isinstance(of, ast.Name) and of.id in ("np", "dataclasses"):
            return False
        if isinstance(of, ast.Name) and of.id == "re":
            return True
        if name not in CUTS or (name == "replace" and len(node.args) != 2):
            return False
        words = [text for argument in node.args for text in texts(argument)]
        return not words or any(map(PROSE.search, words))
    if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In | ast.NotIn | ast.Eq | ast.NotEq):
        word = node.left.value if isinstance(node.left, ast.Constant) else ""
        return isinstance(word, str) and " " in word and word.strip() != "" and word not in get_args(VerdictClass)
    return False


def found_in(node: ast.AST, function: str = "") -> Iterator[str]:
    """Functions, by name, that take texts apart; "" of what stands outside of any."""
    for child in ast.iter_child_nodes(node):
        own = child.name if isinstance(child, ast.FunctionDef) else function
        if takes_apart(child):
            yield own
        yield from found_in(child, own)


def test_no_sentence_is_read():
    found, used = {}, set()
    for path in sorted(SOURCE.rglob("*.py")):
        name = path.relative_to(SOURCE).as_posix()
        if name.startswith(PARSERS):
            continue
        functions = {function or "-" for function in found_in(ast.parse(path.read_text(encoding="utf-8")))}
        listed = [function for file, _, functions in ROWS if file == name for function in functions.split()]
        used |= {name} if functions else set()
        if functions ^ set(listed) and listed != ["*"]:
            found[name] = functions - set(listed), "or taken off the list", set(listed) - functions
    assert found == {}
    assert len(used) > 20


def test_what_reads_a_sentence_is_found():
    for line in (
        'text.startswith("No verdict")',
        'whole.partition("; ")',
        '"go on with" in text',
        're.sub(pattern, "", text)',
        "text.split()",
        "text.removeprefix(name)",
    ):
        assert list(found_in(ast.parse(line))) == [""], line
    for line in ('label.rpartition(":")', 'number.replace("-", "−")', 'cls == "no verdict"', '"k22" in names'):
        assert list(found_in(ast.parse(line))) == [], line
