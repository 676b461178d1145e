"""The command line: parse, call, print. Heavy imports wait until a command needs them."""

import atexit
import gc
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import click

from jointbayes.cli.common import BAD_INPUT, INTERRUPTED, OUTPUT_CLOSED, WRITTEN
from jointbayes.cli.files import init, inspect_command, simulate
from jointbayes.cli.output import is_closed, let_go, say
from jointbayes.cli.run import check, identify, report, run, sample
from jointbayes.cli.studies import compare, plan
from jointbayes.errors import JointBayesError, ReportInterruptedError, printable

__all__ = ["main"]


@contextmanager
def _well_behaved() -> Iterator[None]:
    """End quietly where nobody reads on, and print nothing of the command line that would steer the terminal."""
    try:
        yield
    except BrokenPipeError:
        if not is_closed(sys.stdout):
            raise
        let_go(sys.stdout)
        sys.exit(OUTPUT_CLOSED)
    except click.ClickException as error:
        object.__setattr__(error, "message", printable(error.message))  # click says that it is final
        raise


class _Commands(click.Group):
    """Prints what is wrong with the input on one line and exits 2: a traceback would be a bug."""

    def make_context(self, *args: Any, **kwargs: Any) -> click.Context:  # noqa: ANN401 (click's own signature)
        with _well_behaved():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: click.Context) -> Any:  # noqa: ANN401 (click's own signature)
        with _well_behaved():
            return self._invoke(ctx)

    def _invoke(self, ctx: click.Context) -> Any:  # noqa: ANN401
        try:
            return super().invoke(ctx)
        except JointBayesError as error:
            if os.environ.get("JOINTBAYES_DEBUG"):
                traceback.print_exc()
            for line in f"jointbayes: {error}".split("\n"):
                say(line, err=True)
        except ReportInterruptedError as error:
            say(f"jointbayes: {error}", err=True)
            sys.exit(INTERRUPTED)
        except KeyboardInterrupt:
            written = ctx.meta.get(WRITTEN)
            what = f"{written} is whole" if written else "nothing was written"
            say(f"jointbayes: interrupted; {what}", err=True)
            sys.exit(INTERRUPTED)
        except MemoryError:
            remedy = "lower sampling.walkers or sampling.ensembles, or use fewer lines"
            say(f"jointbayes: found too little memory; expected room for all walkers; {remedy}", err=True)
        except OSError as error:
            if isinstance(error, BrokenPipeError) and is_closed(sys.stdout):
                raise
            place = f"{error.filename}: " if error.filename else ""
            say(f"jointbayes: {place}{error.strerror or error}", err=True)
        sys.exit(BAD_INPUT)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="jointbayes")
def main() -> None:
    """Joint stiffness from vibration measurements, with uncertainty.

    Exit status: 0 done, 1 the check does not match, 2 bad input, 3 the sampler has not converged, 130 interrupted,
    141 nobody read the output.
    """
    # Small linear algebra takes up to ten times as long on several threads. Read when NumPy is loaded, so not yet.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    # Else a tenth of a run, and half a second at its end, goes into looking through modules, which stay, for garbage.
    gc.set_threshold(100_000)
    atexit.register(gc.freeze)


for command in (init, run, identify, sample, report, check, compare, plan, simulate, inspect_command):
    main.add_command(command)
