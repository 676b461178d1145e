"""Pages of the reference that are made from the code, which `benchmarks.numbers` writes into `docs/`."""

import inspect
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import click
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from jointbayes.case.spec.whole import CaseSpec
from jointbayes.cli.commands import main
from jointbayes.report.guides import terms

_NOTE = "<!-- `make pages` writes this page from the code: change the code. -->"
CASE_FILE = Path(__file__).resolve().parents[1] / "docs" / "case-file.md"


def command_line() -> str:
    """Every command with its arguments and options, as `--help` says it."""
    lines = ["# Command line", "", _NOTE, "", "Made from the program: the same as `jointbayes COMMAND --help`.", ""]
    lines += [*_paragraphs(main), *_options(main, click.Context(main, info_name="jointbayes", **main.context_settings))]
    lines += ["| Command | What it does |", "|---|---|"]
    lines += [
        f"| [`{name}`](#jointbayes-{name}) | {_escaped(_cell(c.get_short_help_str(200)))} |" for name, c in _commands()
    ]
    for name, command in _commands():
        context = click.Context(command, info_name=f"jointbayes {name}", **main.context_settings)
        usage = " ".join([context.command_path, *command.collect_usage_pieces(context)])
        lines += ["", f"## jointbayes {name}", "", "```text", usage, "```", "", *_paragraphs(command)]
        lines += _options(command, context)
    return "\n".join(lines) + "\n"


def _commands() -> list[tuple[str, click.Command]]:
    return [(name, command) for name, command in main.commands.items() if not command.hidden]


def _paragraphs(command: click.Command) -> Iterator[str]:
    """Help and epilog; what click is told not to wrap stands as it is."""
    text = "\n\n".join(inspect.cleandoc(part) for part in (command.help, command.epilog) if part)
    for paragraph in re.split(r"\n\s*\n", text):
        if paragraph.startswith("\b"):
            yield from ("```text", *paragraph.splitlines()[1:], "```", "")
        else:
            yield from (_escaped(paragraph), "")


def _options(command: click.Command, context: click.Context) -> list[str]:
    """A table of the options."""
    records = (p.get_help_record(context) for p in command.get_params(context) if isinstance(p, click.Option))
    rows = [f"| `{_cell(names)}` | {_escaped(_cell(text))} |" for names, text in filter(None, records)]
    return ["| Option | Meaning |", "|---|---|", *rows, ""]


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _escaped(text: str) -> str:
    return re.sub(r"([<>*_\[\]])", r"\\\1", text)


def keys_of(model: type[BaseModel], table: str = "") -> Iterator[tuple[str, str, FieldInfo]]:
    """Yield table, key and field of every plain key of the case file."""
    for key, field in model.model_fields.items():
        inner = _models(field.annotation)
        if not inner:
            yield table, key, field
        for part in inner:
            yield from keys_of(part, f"{table}.{key}".lstrip("."))


def _models(annotation: object) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]


def default_of(field: FieldInfo) -> str:
    """The default of a key as TOML has it; "required" or "none" where there is none."""
    if field.default is PydanticUndefined:
        return "required"
    if field.default is None:
        return "none"
    return re.sub(r"e-0(\d)$", r"e-\1", json.dumps(field.default))  # JSON writes 1e-8 as 1e-08


def case_keys() -> str:
    """Every key of the case file by its name, with the tables that have it, linked to their sections."""
    sections, tables = _sections_of_keys(), {}
    for table, key, _ in keys_of(CaseSpec):
        if anchor := sections.get((table, key)):
            link = f"[`{table}`]" if table else "[top level]"
            tables.setdefault(key, {})[f"{link}(case-file.md#{anchor})"] = None
    lines = ["# Keys of the case file by name", "", _NOTE, "", "| Key | Tables |", "|---|---|"]
    lines += [f"| `{key}` | {', '.join(links)} |" for key, links in sorted(tables.items())]
    return "\n".join(lines) + "\n"


def anchor_of(heading: str) -> str:
    """The name by which a link reaches a heading, as mkdocs makes it."""
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower())


def _sections_of_keys() -> dict[tuple[str, str], str]:
    """The anchor of the section of docs/case-file.md in which a key of a table is described."""
    parts = re.split(r"^## +(.*)$", CASE_FILE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    found = {}
    for heading, text in zip(parts[1::2], parts[2::2], strict=True):
        anchor = anchor_of(heading)
        for table in re.findall(r"`\[([\w.]+)\]`", heading) or [""]:
            found |= {(table, key): anchor for key in re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)}
    return found


def glossary() -> str:
    """The terms of reports, as their appendix has them."""
    rows = [f"| {_escaped(term)} | {_escaped(meaning)} |" for term, meaning in terms().items()]
    head = ["# Glossary", "", _NOTE, "", "As in the appendix of each report.", "", "| Term | Meaning |", "|---|---|"]
    return "\n".join([*head, *rows, ""])


#: Pages by name, and what writes them.
PAGES = {"command-line.md": command_line, "case-keys.md": case_keys, "glossary.md": glossary}
