"""No code reads, cuts or compares a sentence: texts for people are the last thing that is made.

The source is walked for calls that take a text apart, and for searches of words in one. Rooms that parse input are
left out whole. What else takes texts apart stands in `ALLOWED`, by file and function, with what the texts are.
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
ALLOWED = {
    # names of the package, of classes, modules, files and quantities
    "jointbayes/__init__.py": ("names of the package", {""}),
    "jointbayes/cli/files.py": ("text of a case; names of classes", {"_kind_in_words"}),
    "jointbayes/cli/targets.py": ("heads of files", {"_is_ours"}),
    "jointbayes/joint/quantities.py": ("names of hypotheses", {"split_hypothesis"}),
    "jointbayes/inference/problem.py": ("names of arguments", {"__init__"}),
    "jointbayes/phrases.py": ("names of quantities", {"listed"}),
    "jointbayes/structure/frame.py": ("names of points", {""}),
    "jointbayes/structure/frame_recipe.py": ("names of bodies and points", {"", "mesh"}),
    "jointbayes/structure/given_matrices.py": ("names of kinds of connection", {"_connection_matrix"}),
    "jointbayes/structure/recipe.py": ("names of quantities", {"is_damping_ratio"}),
    "jointbayes/posterior/model_errors.py": ("names of quantities", {"_in_words"}),
    "jointbayes/studies/same.py": ("names of quantities", {"_together", "_premises"}),
    "jointbayes/posterior/storage.py": ("names of arrays and classes", {"arviz_tree", "_own", "_public_class"}),
    "jointbayes/studies/compare.py": ("names of keys with their units; labels", {"what_differs", "_won"}),
    # input: faults that pydantic, Dask or Python word; the source line that a fault names
    "jointbayes/cli/commands.py": ("words of Python's errors; docstrings of commands", {"_invoke", "format_commands"}),
    "jointbayes/cli/output.py": ("place of a fault; endless names", {"", "source_lines", "fail"}),
    "jointbayes/posterior/stored_file.py": ("words of Python's errors", {"one_line_of"}),
    "jointbayes/report/kept_draws.py": ("words of Python's errors", {"_one_line"}),
    "jointbayes/stored_values.py": ("words of pydantic's errors", {"stored_value"}),
    "jointbayes/studies/workers.py": ("words of Python's errors", {"attempt", "_cluster"}),
    # markup: what typesets a text as a whole, whatever it says
    "jointbayes/posterior/sampled.py": ("groups of digits", {"state"}),
    "jointbayes/progress.py": ("colon of a progress bar", {"report"}),
    "jointbayes/report/canvas.py": ("formulas of axes", {"", "text"}),
    "jointbayes/report/drawing.py": ("line break in a title", {"draw_wireframes"}),
    "jointbayes/report/guides.py": ("identifiers of figures", {"guide_of"}),
    "jointbayes/report/html.py": ("markup", {""}),
    "jointbayes/report/markup.py": ("markup; names of quantities", None),
    "jointbayes/report/methods.py": ("keys of references; terms that a page has", {"references", "terms_section"}),
    "jointbayes/report/model.py": ("identifiers; cells of numbers", {""}),
    "jointbayes/report/page_budget.py": ("markup", {""}),
    "jointbayes/report/pdf.py": ("lines of a cell; words that are too long for a line", {"", "_cell"}),
}
#: What still takes a text for people apart. A line goes where it is mended; none is added.
OWED = {
    "jointbayes/identification/numbering.py": {"_nearest_first"},  # value names of modes: "frequency 3 of tip"
    "jointbayes/inference/common_errors.py": {"_springs", "_components"},
    "jointbayes/inference/noise/model_error.py": {"of", "_known"},
    "jointbayes/report/sections/lead.py": {"_premises"},  # what is assumed, in words
    "jointbayes/studies/campaign.py": {"", "_parsed", "read_cases", "_rows", "campaign_page"},
}


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
        functions = set(found_in(ast.parse(path.read_text(encoding="utf-8"))))
        allowed = ALLOWED.get(name, ("", set()))[1]
        used |= {name} if functions else set()
        if allowed is not None and (odd := functions - allowed - OWED.get(name, set())):
            found[name] = odd
        if gone := (allowed or set()) - functions:
            found[f"{name}, allowed for nothing"] = gone
        if gone := OWED.get(name, set()) - functions:
            found[f"{name}, mended: take it off the list"] = gone
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
