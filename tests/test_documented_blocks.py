"""Blocks that a reader may copy: TOML is a case or a part of one, and the lines of a shell are commands that there are.

Python is run by tests/test_documented_calls.py, the walk-throughs by tests/test_walk_through.py.
"""

import importlib.util
import itertools
import json
import re
import shlex
import tomllib
from contextlib import nullcontext
from pathlib import Path

import click
import pytest
from benchmarks import quoted

from jointbayes.case.case_text import read_case_text, without_key
from jointbayes.case.parse import parse_tests
from jointbayes.case.toml_text import toml_text
from jointbayes.cli.commands import main
from tests.case.refusal_rows import parts_named
from tests.pages import ROOT

pytestmark = pytest.mark.docs

PAGES = quoted.pages()
#: A block; those with a mark before them belong to a walk-through, which runs them, or show a file.
BLOCK = re.compile(r"^(<!--(?:numbers file .*|\w+)-->\n)?( *)```(\w*)[^\n]*\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)


def blocks(*kinds):
    """Text of every block of these kinds, named after its page; files that pages show, and walk-throughs, aside."""
    found = []
    for page in PAGES:
        every = BLOCK.findall(page.read_text(encoding="utf-8"))
        texts = [text for mark, _, kind, text in every if kind in kinds and not mark]
        found += [pytest.param(text, id=f"{page.stem}-{i}") for i, text in enumerate(texts, 1)]
    return found


def part_of(name):
    """The block of TOML of a page that another one goes on with."""
    return next(block.values[0] for block in blocks("toml") if block.id == name)


#: What stands around a block that is a part of a case, "@" another block; of others the case that `init` writes.
AROUND = parts_named("documented_blocks")


def written(folder, name, base, text):
    """A case file that lays a text over another file; a table with a kind takes nothing of that."""
    stated = tomllib.loads(text)
    gone = [(key,) for key, value in stated.items() if isinstance(value, dict) and "kind" in value]
    gone += [("joint",)] * ("joints" in stated) + [("data", "truth")] * ("data.truth" in text)
    data = read_case_text(folder / base).data
    for path in gone:
        data = without_key(data, path)
    (folder / f"rest_of_{name}").write_text(toml_text({"title": name, **data}), encoding="utf-8")
    head = "" if text.startswith("extends") else f'extends = "rest_of_{name}"\n'
    (folder / name).write_text(head + text, encoding="utf-8")


@pytest.mark.parametrize("text", blocks("toml"))
def test_every_block_of_toml_is_a_case_or_a_part_of_one(text, tmp_path, request):
    for shipped in [*(ROOT / "configs").glob("*.toml"), ROOT / "src" / "jointbayes" / "cli" / "clamp.toml"]:
        (tmp_path / shipped.name).write_bytes(shipped.read_bytes())
    around = AROUND.get(request.node.callspec.id, "")
    written(tmp_path, "around.toml", "clamp.toml", part_of(around[1:].strip()) if around.startswith("@") else around)
    written(tmp_path, "block.toml", "around.toml", text)
    source = read_case_text(tmp_path / "block.toml")
    assert parse_tests(source)


def shell_lines(text, prompts_only=False):
    """Commands of a block of a shell: whole lines, or those behind a prompt; comments aside."""
    lines = text.replace("\\\n", " ").splitlines()
    prompted = [line[2:] for line in lines if re.match(r"\$ (?:jointbayes|cat) ", line)]
    return [part for line in (prompted if prompted or prompts_only else lines) for part in split(line)]


def split(line):
    """The commands of one line as words, without what takes their output and the directory of the environment."""
    words = [word.removeprefix(".venv/bin/") for word in shlex.split(line, comments=True)]
    commands = [part.split("\0") for part in "\0".join(words).split("\0&&\0") if part]
    return [list(itertools.takewhile(lambda word: word not in ("|", ">"), command)) for command in commands]


def fault_of(words):
    """What is wrong with a command; empty if it can be run as it stands."""
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    match words:
        case ["jointbayes", name, *arguments] if name in main.commands:
            try:
                main.commands[name].make_context(name, list(arguments))
            except click.ClickException as error:
                return error.format_message()
            except click.exceptions.Exit:
                return ""
            return ""
        case ["jointbayes", "--help"] | ["cat", _] | ["python", "-c", _] | [".", "activate"]:
            return ""
        case ["make", target, *_]:
            return "" if target in targets else f"no target {target}"
        case ["python", script, *_] if script.startswith("examples/"):
            return "" if (ROOT / script).is_file() else f"no file {script}"
        case ["python" | "python3", "-m", module, *_]:
            return "" if module == "venv" or importlib.util.find_spec(module) else f"no module {module}"
        case ["eval", completion] | [completion, "jointbayes"] if "_JOINTBAYES_COMPLETE=" in completion:
            return ""
        case ["pip", "install", *_] | ["dask", "scheduler" | "worker", *_]:
            return ""
    return "an unknown command"


@pytest.mark.parametrize("text", blocks("bash", "console"))
def test_every_line_of_a_shell_is_a_command_that_there_is(text):
    lines = shell_lines(text)
    assert lines
    assert [(words, fault) for words in lines if (fault := fault_of(words))] == []


def test_every_prompt_in_a_block_of_text_is_a_command_that_there_is():
    shown = [words for block in blocks("text") for words in shell_lines(block.values[0], prompts_only=True)]
    assert len(shown) > 8
    assert [(words, fault) for words in shown if (fault := fault_of(words))] == []


def test_the_rule_of_the_page_on_ci_reads_a_summary(tmp_path, monkeypatch):
    words = [
        words for block in blocks("bash") for words in shell_lines(block.values[0]) if words[:2] == ["python", "-c"]
    ]
    ((_, _, rule),) = words
    monkeypatch.chdir(tmp_path)
    Path("build/clamp").mkdir(parents=True)
    for explains in (True, False):
        summary = {"converged": True, "check": {"explains": explains}}
        Path("build/clamp/summary.json").write_text(json.dumps(summary), encoding="utf-8")
        with nullcontext() if explains else pytest.raises(AssertionError):
            exec(rule, {})
