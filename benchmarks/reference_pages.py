"""Parts of the reference that are made from the code, which `benchmarks.quoted` puts into the pages."""

import inspect
import json
import re
from collections import Counter
from collections.abc import Iterator
from typing import get_args

import click
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from jointbayes.cli.commands import main
from jointbayes.report.methods import terms


def command_line() -> list[str]:
    """Every command with its arguments and options, as `--help` says it; what many have alike is said once."""
    of_all, shared = _shared_options()
    lines = ["## Commands", "", ", ".join(f"[`{name}`](#jointbayes-{name})" for name, _ in _commands()) + ".", ""]
    lines += ["## Options of every command", "", *_listed(of_all)]
    lines += ["## Options of several commands", "", *_listed(shared)]
    for name, command in _commands():
        context = click.Context(command, info_name=f"jointbayes {name}", **main.context_settings)
        usage = " ".join([context.command_path, *command.collect_usage_pieces(context)])
        options = _options(command, context)
        own = [option for option in options if option not in of_all + shared]
        also = ", ".join(f"`{option[0].split()[0]}`" for option in options if option in shared)
        lines += [f"## jointbayes {name}", "", f"`{usage}`", "", *_paragraphs(command)]
        lines += [*(_listed(own) if own else ()), *((f"Also {also}.", "") if also else ())]
    return "\n".join(lines).rstrip().splitlines()


def _shared_options() -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """Names and meaning of the options that every command has, and of those that three or more have alike."""
    contexts = [(c, click.Context(c, info_name=name, **main.context_settings)) for name, c in _commands()]
    found = Counter(option for command, context in contexts for option in _options(command, context))
    of_all = [option for option, count in found.items() if count == len(contexts)]
    return of_all, [option for option, count in found.most_common() if 2 < count < len(contexts)]


def _commands() -> list[tuple[str, click.Command]]:
    return [(name, command) for name, command in main.commands.items() if not command.hidden]


def _paragraphs(command: click.Command) -> Iterator[str]:
    """Help and epilog without what click is told not to wrap: examples."""
    text = "\n\n".join(inspect.cleandoc(part) for part in (command.help, command.epilog) if part)
    for paragraph in re.split(r"\n\s*\n", text):
        if not paragraph.startswith("\b"):
            yield from (_escaped(paragraph), "")


def _options(command: click.Command, context: click.Context) -> list[tuple[str, str]]:
    """Names and meaning of each option; help is that of the group: click keeps a command's by its first use."""
    help_ = main.get_help_option(click.Context(main, **main.context_settings))
    records = (p.get_help_record(context) for p in (*command.params, help_) if isinstance(p, click.Option))
    return [(names, text) for names, text in filter(None, records)]


def _listed(options: list[tuple[str, str]]) -> list[str]:
    return [*(f"- `{names}`: {_escaped(' '.join(text.split()))}" for names, text in options), ""]


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


def anchor_of(heading: str) -> str:
    """The name by which a link reaches a heading, as mkdocs makes it."""
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower())


def glossary() -> list[str]:
    """Return a table of the terms of reports, as their appendix has them."""
    rows = (f"| {_escaped(term)} | {_escaped(meaning)} |" for term, meaning in terms().items())
    return ["| Term | Meaning |", "|---|---|", *rows]
