"""What several commands share: reading a case, drawing, printing a posterior, exit codes, and what is written over."""

import math
import sys
from dataclasses import asdict
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jointbayes.cli.output import manner, manner_option, say, warn
from jointbayes.cli.progress_display import show_progress, show_stage
from jointbayes.errors import CaseError
from jointbayes.progress import Progress

if TYPE_CHECKING:
    from collections.abc import Iterable

    from jointbayes.case.case import Case
    from jointbayes.case.case_text import InputWarning
    from jointbayes.posterior import Knowledge, Posterior
    from jointbayes.workflow import TakenAs

import os

from vibrecords.errors import path_fault

force_option = manner_option("--force", "Replace a file that jointbayes did not write, too; never one that is read.")


def require_free(target: Path, option: str, *, posterior: bool = False) -> None:
    """Refuse a file to write in no directory, over what the command reads, or over what is not ours; before any work.

    Parameters
    ----------
    target
        The file to be. A link there is replaced, and what it leads to is kept; it counts as that.
    option
        Option that named it, for the message.
    posterior
        Whether it will be a posterior, which replaces posteriors alone; other files of ours replace each other.

    Raises
    ------
    CaseError
        If that is so.
    """
    if not target.absolute().parent.is_dir():
        raise CaseError(f"{target}: found no directory {target.parent}; expected one that exists; make it first")
    try:
        os.lstat(target)
    except FileNotFoundError:
        return
    except (OSError, ValueError) as error:  # too long
        words = f"found that it cannot be written ({path_fault(error)}); expected the path of a file"
        raise CaseError(f"{target}: {words}; choose another {option}") from None
    if not target.is_file():
        kind = "a directory" if target.is_dir() else "no regular file"
        raise CaseError(f"{target}: found {kind}; expected a file; choose another {option}")
    if any(_is_same(target, read) for read in manner().read):
        raise CaseError(f"{target}: found the file that is read; expected another one; choose another {option}")
    if not (manner().force or (_is_posterior if posterior else _is_ours)(target)):
        what = "a posterior" if posterior else "a file"
        expected = f"a new one, or {what} that jointbayes wrote"
        remedy = f"choose another {option}, or replace it by --force"
        raise CaseError.of(f"{target}", (), "found a file", expected, remedy)


def require_outside(directory: Path) -> None:
    """Refuse a directory to write that holds what the command reads.

    Raises
    ------
    CaseError
        If it does.
    """
    for read in manner().read:
        if directory.is_dir() and any(_is_same(directory, above) for above in Path(os.path.realpath(read)).parents):
            raise CaseError(f"{directory}: found {read.name} in it, which is read; expected another directory; choose "
                            "another --out")  # fmt: skip


def _is_same(one: Path, other: Path) -> bool:
    """Whether both lead to one file, by any names and links."""
    try:
        return one.samefile(other)
    except (OSError, ValueError):
        return False  # one of them is not there


def _is_ours(file: Path) -> bool:
    from vibrecords.files import OURS, WRITTEN_BY

    with file.open("rb") as stream:
        head = stream.read(200)
        stream.seek(max(0, file.stat().st_size - 200))
        tail = stream.read().rstrip().removesuffix(b"-->").rstrip()
    if head.startswith(b"%PDF"):  # it has its author among its data
        return b"<dc:creator><rdf:Seq><rdf:li>jointbayes " in file.read_bytes()
    figure = head.startswith(b"<?xml")  # SVG has no room at its beginning
    return bool(OURS.match(head)) or (figure and tail.endswith(WRITTEN_BY.encode()))


def _is_posterior(file: Path) -> bool:
    from jointbayes.posterior.storage import RECORD
    from vibrecords.formats.array_files import has_attribute

    return has_attribute(file, RECORD)


NOT_MATCHED = 1
CASES_FAILED = 1
BAD_INPUT = 2
NOT_CONVERGED = 3
FAULT_OF_THE_PROGRAM = 70  # EX_SOFTWARE of sysexits.h: no answer of any command has this code
INTERRUPTED = 130  # as shells have it: 128 + SIGINT
TERMINATED = 143  # the same with SIGTERM or SIGHUP
OUTPUT_CLOSED = 141  # the same with SIGPIPE

seed_option = click.option("--seed", type=click.IntRange(0, 2**32 - 1), help="Seed of the run; by default the case's.")
take_as_option = click.option(
    "--take-as",
    type=click.Choice(["usual", "exact"]),
    help="What measured FRFs are taken as: by their modes with an error of the model, or within their noise.",
)
config_argument = click.argument("config", type=click.Path(path_type=Path))


outside_option = manner_option("--allow-outside", "Let a case name measurement files outside its own directory.")


def _as_layout(_context: click.Context, _option: click.Parameter, values: tuple[str, ...]) -> dict[str, str]:
    pairs = [value.partition("=") for value in values]
    if wrong := next((value for value, (key, _, name) in zip(values, pairs, strict=True) if not (key and name)), None):
        raise click.BadParameter(f"found {wrong!r}; expected KEY=NAME, as frf=H1")
    return {key.strip(): name.strip() for key, _, name in pairs}


_LAYOUT = "What a variable of the file stands for, as [data.layout] says it; may be repeated."
layout_option = click.option("--layout", multiple=True, metavar="KEY=NAME", callback=_as_layout, help=_LAYOUT)


def load(config: Path) -> "Case":
    """Read a case file; what in it is probably a slip is said on standard error, before any work where possible."""
    from jointbayes.case.case_text import read_case_text, texts_of_tests
    from jointbayes.case.parse import parse_tests
    from jointbayes.case.plausibility import input_warnings
    from jointbayes.case.spec.whole import BEFORE_OBJECTS

    # what is wrong with the file itself is said before anything heavy is loaded
    show_stage(Progress("reading the case", str(config)), on_terminal_only=True)
    text = read_case_text(config, manner().allow_outside)
    manner().read += text.files
    loading = Progress("loading the data of the case and building its model")
    named = BEFORE_OBJECTS.set(cache(partial(show_stage, loading)))
    try:
        specs, texts = parse_tests(text), texts_of_tests(text)
    finally:
        BEFORE_OBJECTS.reset(named)
    each = (input_warnings(spec, texts[name], spec.data.band_hz) for name, spec in specs.items())
    early = tuple(dict.fromkeys(warning for warnings in each for warning in warnings))

    def tell(warnings: "Iterable[InputWarning]") -> None:
        for warning in warnings:
            warn(**asdict(warning))

    tell(early)
    from jointbayes.case.case import load_case

    case = load_case(config, allow_outside=manner().allow_outside)
    tell(warning for warning in case.warnings if warning not in early)
    return case


def draw(case: "Case", seed: int | None, take_as: "TakenAs | None" = None) -> "Posterior":
    """Sample a case with progress on standard error."""
    from jointbayes.workflow import sample as draw

    with show_progress() as progress:
        return draw(case, seed=seed, progress=progress, premises=take_as)


def print_answer(posterior: "Posterior") -> None:
    """Print whether the run has converged, and a line a stiffness."""
    from jointbayes.posterior.identifiability import LIMIT_NOTE
    from jointbayes.posterior.verdicts import line_of, reason_lines

    say(posterior.record.state)
    verdicts = {name: posterior.verdict(name) for name in posterior.stiffness_names}
    for name, verdict in verdicts.items():
        say(line_of(name, verdict))
        for line in reason_lines(verdict) if manner().verbose else ():
            say(f"    {line}")
    if any(math.isfinite(verdict.limit) for verdict in verdicts.values()):
        say(LIMIT_NOTE)


def print_caveats(posterior: "Posterior", knowledge: "Knowledge | None" = None) -> None:
    """Print what may be wrong with the answer."""
    from jointbayes.posterior.knowledge import assumptions_of
    from jointbayes.posterior.model_errors import measured_bodies_of, mesh_of
    from jointbayes.posterior.verdicts import solution_sentences

    bounds = knowledge.bounds_sentences if knowledge else ()
    say(*assumptions_of(posterior), *bounds, *solution_sentences(posterior))
    if posterior.estimate.sentence:
        say(posterior.estimate.sentence)
    for errors_of in (mesh_of(posterior), measured_bodies_of(posterior)):
        say(*(() if errors_of is None or errors_of.within else errors_of.sentences))


def print_summary(posterior: "Posterior", knowledge: "Knowledge | None" = None) -> None:
    """Print the answer and its caveats."""
    print_answer(posterior)
    print_caveats(posterior, knowledge)


def exit_by_convergence(posterior: "Posterior") -> None:
    """End with the exit code of a run that has not converged, where it has not."""
    if not posterior.converged:
        sys.exit(NOT_CONVERGED)


def directory_name(case_name: str, file: Path) -> str:
    """Name of a run directory by default: the name of the case, or of the file where the former is no name of one.

    A posterior file may be anybody's: what it says must not lead out of ``reports``.
    """
    plain = case_name.isprintable() and case_name == Path(case_name).name and len(case_name.encode()) < 200
    return case_name if plain and case_name not in ("", "..") and "\\" not in case_name else file.stem


def posterior_file(given: Path) -> Path:
    """The file that is given, or the one in a run directory; a case file is none."""
    if given.suffix == ".toml":
        words = "found a case file; expected a posterior.nc or a run directory"
        raise CaseError(f"{given}: {words}; run it first: jointbayes run {given}")
    return given / "posterior.nc" if given.is_dir() else given
