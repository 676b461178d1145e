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


FRF, MODES = part_of("measured-1"), part_of("modes-1")
SPRINGS = 'joint = { dofs = ["1:y", "1:rz"], kind = "springs" }\ndata.truth.stiffness = { ky = 1e8, krz = 1e5 }\n'
STEEL = 'kind = "frame", youngs_modulus_gpa = 210.0, density_kg_m3 = 7800.0, damping = { law = "modal", ratio = 0.01 }'
MODE = 'data = { kind = "natural_frequencies", frequencies_hz = [90.0], sd_relative = 0.01 }\n'
FRAME = (
    f"structure = {{ {STEEL} }}\n"
    'joint = { kind = "springs", dofs = ["holder.mouth:y"], against = ["tool.shank:y"] }\n' + MODE
)
BRACKET = (
    f'structure = {{ {STEEL}, directions = ["x", "y", "rz"], section = {{ shape = "circle", diameter_mm = 20.0 }}, '
    f"points = {{ tip = [0, 0, 0], end = [400, 0, 0] }} }}\n{MODE}"
)
#: What stands around a block that is a part of a case; of others the case that `init` writes.
AROUND = {
    "lapped-beams-1": 'extends = "lapped_beams.toml"\n',
    "spindle-tool-1": 'extends = "spindle_tool.toml"\n',
    "spindle-tool-2": 'extends = "spindle_tool.toml"\n',
    "frames-1": 'extends = "portal_frame.toml"\n',
    "case-file-2": 'joint = { dofs = ["foot:x"], kind = "springs" }\n' + MODE,
    "case-file-3": FRAME,
    "case-file-5": BRACKET,
    "imported-2": part_of("imported-1"),
    "joint-damping-1": SPRINGS.replace("krz = 1e5", "krz = 1e5, crz = 10.0, eta = 0.01"),
    "measured-2": FRF,
    "measured-3": FRF,
    "measured-4": FRF,
    "modes-2": MODES,
    "predict-2": '[predict]\noutputs = ["11:y"]\ninputs = ["11:y"]\nf_min_hz = 10\nf_max_hz = 900\nf_step_hz = 1\n',
    "what-can-be-wrong-1": MODES,
    "what-now-1": FRF,
    "what-now-3": FRF,
    "what-now-5": SPRINGS,
}


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
    written(tmp_path, "around.toml", "clamp.toml", AROUND.get(request.node.callspec.id, ""))
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
