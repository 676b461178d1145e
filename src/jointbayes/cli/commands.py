"""The command line: parse, call, print. Heavy imports wait until a command needs them."""

import atexit
import gc
import logging
import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any

import click

from jointbayes.cli import common, files, run, studies
from jointbayes.cli.output import (
    EVERYWHERE,
    fail,
    is_closed,
    let_go,
    manner,
    open_closed_streams,
    print_json,
    say,
    warn,
)
from jointbayes.errors import WENT, JointBayesError, ReportError, ReportInterruptedError, TerminatedError
from vibrecords.errors import printable


@contextmanager
def _well_behaved(*, json: bool) -> Iterator[None]:
    """End quietly where the output is not read on, and print nothing of the command line that would steer the terminal.

    A wrong call is told in JSON as well, where that is asked for.
    """
    try:
        yield
    except BrokenPipeError:
        if not is_closed(sys.stdout):
            raise
        let_go(sys.stdout)
        sys.exit(common.OUTPUT_CLOSED)
    except OSError as error:  # standard output is full
        fail(f"{_place_of(error)}{error.strerror or error}")
        sys.exit(common.BAD_INPUT)
    except click.ClickException as error:
        if isinstance(error, click.NoSuchOption) and error.option_name in WENT:
            object.__setattr__(error, "possibilities", None)
            object.__setattr__(error, "message", f"{error.option_name}: it was removed: {WENT[error.option_name]}")
        object.__setattr__(error, "message", printable(error.message))  # click says that it is final
        if json:
            context = click.get_current_context(silent=True)
            told = {**manner().told, "errors": [{"message": error.format_message()}]}
            print_json({"command": context and context.invoked_subcommand, "exit_code": error.exit_code, **told})
        raise error from None


@contextmanager
def _answering_sigterm() -> Iterator[None]:
    """Answer SIGTERM and SIGHUP as Ctrl-C is: what has been made is kept, and nothing hidden stays behind."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    asked = {signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)}
    asked = {number for number in asked if signal.getsignal(number) == signal.SIG_DFL}  # nohup ignores SIGHUP

    def end(_number: int, _frame: FrameType | None) -> None:
        raise TerminatedError

    for number in asked:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in asked:
            signal.signal(number, signal.SIG_DFL)


#: Commands as `--help` groups them.
_GROUPS = {
    "Analyse": ("run", "identify", "sample", "report"),
    "Look": ("inspect", "validate", "check"),
    "Decide": ("compare", "same", "plan", "predict", "campaign"),
    "Files": ("init", "export", "schema"),
}
_EXIT_CODES = {
    "0": "done",
    str(common.NOT_MATCHED): "check: it does not match; same: changed; campaign: cases failed",
    str(common.BAD_INPUT): "bad input",
    str(common.NOT_CONVERGED): "the sampler has not converged",
    str(common.FAULT_OF_THE_PROGRAM): "a bug in jointbayes",
    f"{common.INTERRUPTED}, {common.TERMINATED}": "interrupted, terminated",
    str(common.OUTPUT_CLOSED): "the output is not read any more",
}


class _Commands(click.Group):
    """Prints what is wrong with the input on one line and exits 2: a traceback would be a bug."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List each command by its first example, with all of its first sentence."""
        for title, names in _GROUPS.items():
            rows = []
            for command in map(self.commands.__getitem__, names):
                sentence, _, examples = (command.help or "").partition("Examples:\n")
                example = examples.split("\n")[0].strip().removeprefix("jointbayes ")
                rows.append((example, " ".join(sentence.split("\n\n")[0].split())))
            with formatter.section(title):
                formatter.write_dl(rows)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the exit codes."""
        with formatter.section("Exit codes"):
            formatter.write_dl(list(_EXIT_CODES.items()))

    def make_context(self, *args: Any, **kwargs: Any) -> click.Context:  # noqa: ANN401 (click's own signature)
        open_closed_streams()
        json = "--json" in args[1]
        with _well_behaved(json=json):
            context = super().make_context(*args, **kwargs)
        context.meta["jointbayes.json"] = json
        return context

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in WENT and cmd_name not in self.commands:
            raise click.UsageError(f"{cmd_name}: it was removed: {WENT[cmd_name]}", ctx)
        return super().get_command(ctx, cmd_name)

    def invoke(self, ctx: click.Context) -> None:
        code = 0
        with _well_behaved(json=ctx.meta.get("jointbayes.json", False)), _answering_sigterm():
            try:
                self._invoke(ctx)
            except SystemExit as ended:
                code = int(ended.code or 0)
            if manner().json:
                print_json({"command": ctx.invoked_subcommand, "exit_code": code, **manner().result, **manner().told})
        if code:
            sys.exit(code)

    def _invoke(self, ctx: click.Context) -> None:
        try:
            super().invoke(ctx)
        except JointBayesError as error:
            if os.environ.get("JOINTBAYES_DEBUG"):
                traceback.print_exc()
            fail(str(error), whole=isinstance(error, ReportError))
        except ReportInterruptedError as error:
            fail(str(error), whole=True)
            sys.exit(common.TERMINATED if isinstance(error.__cause__, TerminatedError) else common.INTERRUPTED)
        except KeyboardInterrupt as error:
            how = manner()
            fail(f"interrupted; {f'{how.written} is whole' if how.written else how.unfinished}")
            sys.exit(common.TERMINATED if isinstance(error, TerminatedError) else common.INTERRUPTED)
        except MemoryError:
            remedy = "lower sampling.walkers or sampling.ensembles, or use fewer lines"
            fail(f"found too little memory; expected room for all walkers; {remedy}")
        except OSError as error:
            if isinstance(error, BrokenPipeError) and is_closed(sys.stdout):
                raise
            fail(f"{_place_of(error)}{error.strerror or error}")
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except Exception as error:  # Python's own exit code would be 1, which is an answer
            if os.environ.get("JOINTBAYES_DEBUG"):
                traceback.print_exc()
            # the last line of our own, wherever we are installed: this file is among them
            homes = tuple(str(Path(__file__).parents[2] / name) + os.sep for name in ("jointbayes", "vibrecords"))
            ours = [step for step in traceback.extract_tb(error.__traceback__) if step.filename.startswith(homes)]
            place = f"{Path(ours[-1].filename).name}:{ours[-1].lineno}"
            found = " ".join(f"{type(error).__name__} in {place}: {error}".split())
            remedy = "please report it, with the case and what JOINTBAYES_DEBUG=1 prints"
            fail(f"a bug in jointbayes: found {found}; expected a result or a refusal; {remedy}")
            sys.exit(common.FAULT_OF_THE_PROGRAM)
        else:
            return
        sys.exit(common.BAD_INPUT)


def _place_of(error: OSError) -> str:
    if error.filename:
        return f"{error.filename}: "
    with suppress(OSError):
        os.getcwd()
        return ""
    return "the working directory: "  # somebody has removed it


_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


FIRST_STEP = "First step: jointbayes init --from tip.csv (your measurement), or jointbayes init (an example)."
_HELP = f"""Joint stiffness from vibration measurements, with uncertainty.

{FIRST_STEP} Each command has more examples in its own --help."""


@click.group(cls=_Commands, invoke_without_command=True, context_settings=_SETTINGS, help=_HELP)
@click.version_option(package_name="jointbayes")
@click.pass_context
def main(context: click.Context) -> None:
    """Prepare what every command needs, and name the first step where there is none."""
    if context.invoked_subcommand is None:
        say(FIRST_STEP, "Then: jointbayes run my_case.toml. All commands: jointbayes --help.")
    # What a library warns of is one line like our own warnings, without the place in its source.
    warnings.showwarning = lambda message, kind, *_args, **_options: warn(str(message), code=kind.__name__)
    # Matplotlib says in three lines that the home directory cannot be written, which costs nothing here.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    # Small linear algebra takes up to ten times as long on several threads, and has another last bit: not the user's
    # to choose. Read when NumPy is loaded, so not yet.
    os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    # Else a tenth of a run, and half a second at its end, goes into looking through modules, which stay, for garbage.
    gc.set_threshold(1_000_000)
    atexit.register(gc.freeze)


for command in [c for module in (files, run, studies) for c in vars(module).values() if isinstance(c, click.Command)]:
    for option in EVERYWHERE:
        option(command)
    main.add_command(command)
