"""Commands that make many posteriors: compare, plan, calibrate."""

import sys
from pathlib import Path

import click

from jointbayes.cli.common import (
    NOT_CONVERGED,
    NOT_MATCHED,
    UNFINISHED,
    config_argument,
    directory_name,
    load,
    outside_option,
    seed_option,
)
from jointbayes.cli.output import say
from jointbayes.cli.progress import show_calibration, show_steps
from jointbayes.errors import CaseError, printable


@click.command()
@click.argument("config", nargs=-1, required=True, type=click.Path(path_type=Path))
@outside_option
@click.option("--out", type=click.Path(path_type=Path), help="Run directory to write; by default none.")
@seed_option
def compare(config: tuple[Path, ...], out: Path | None, seed: int | None) -> None:
    """Compare hypotheses on the joint, from rigid to a full matrix, in one case file or several of the same data."""
    from jointbayes.report.run_directory import require_writable
    from jointbayes.studies.comparison.compare import compare as weigh
    from jointbayes.studies.comparison.compare import require_same_data
    from jointbayes.studies.comparison.directory import COMPARISON_MARK, write_comparison
    from jointbayes.studies.comparison.report import evidence_table

    cases = [load(path) for path in config]
    require_same_data(cases)
    if out is not None:
        require_writable(out, COMPARISON_MARK)
    comparison = weigh(cases, seed, lambda name: say(f"weighing {name}", err=True))
    for line in evidence_table(comparison.summary(), method=True).lines():
        say(line)
    for note in dict.fromkeys(c.loo_note for c in comparison.candidates if c.loo_note):
        say(f"Cross-validation is {note}.")
    if out is not None:
        write_comparison(comparison, cases, out)
        say(f"Report: {out / 'report.html'} and {out / 'report.pdf'}")
    if not comparison.trusted:
        say("NOT TRUSTED: the error of an evidence is unknown, see the table.")
    say(comparison.verdict)
    if not comparison.trusted:
        sys.exit(NOT_CONVERGED)


def _stated(text: str) -> tuple[str, float]:
    """Name and value of NAME=VALUE."""
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise CaseError(
            f"--assume: found {text!r}; expected a quantity of the joint and its value, as in k11=1e9; correct it"
        ) from None


@click.command()
@config_argument
@outside_option
@click.option("--out", type=click.Path(path_type=Path), help="Directory; by default reports/NAME-plan.")
@click.option("--json", "as_json", is_flag=True, help="Print plan.json instead of a table.")
@click.option(
    "--assume", multiple=True, metavar="NAME=VALUE",
    help="Plan for this joint, not the one found: one for each of its quantities, as in --assume k11=1e9.",
)  # fmt: skip
@seed_option
def plan(config: Path, out: Path | None, as_json: bool, assume: tuple[str, ...], seed: int | None) -> None:
    """Recommend what to measure next, from simulated further measurements.

    Simulations that are done are kept in the directory: the same command goes on where it was cut off.
    """
    case = load(config)
    stated = dict(_stated(text) for text in assume)
    import json

    from jointbayes.report.run_directory import require_room
    from jointbayes.studies.planning.directory import write_plan
    from jointbayes.studies.planning.plan import plan as ranked
    from jointbayes.studies.planning.report import plan_lines

    directory = out or Path("reports") / f"{directory_name(case.name, config)}-plan"
    require_room(directory)
    click.get_current_context().meta[UNFINISHED] = f"what is done is kept in {directory}; the same command goes on"
    result = ranked(case, seed=seed, assume=stated or None, directory=directory, progress=show_steps())
    write_plan(result, case, directory)
    if as_json:
        text = json.dumps(result.summary(), indent=2, ensure_ascii=False, allow_nan=False)
        if printable(text, keep="\n") != text:  # an escape of JSON's own stays JSON
            text = json.dumps(result.summary(), indent=2, allow_nan=False)
        for line in text.split("\n"):
            say(line)
    else:
        for line in plan_lines(result):
            say(line)
        say(f"Report: {directory / 'report.html'} and {directory / 'report.pdf'}")
    if not result.converged:
        sys.exit(NOT_CONVERGED)


@click.command()
@config_argument
@outside_option
@click.option("--n", "count", type=click.IntRange(1), default=1000, show_default=True, help="Number of data sets.")
@click.option(
    "--data-from", type=click.Path(path_type=Path), help="Case that gives truths and data, in place of CONFIG."
)
@click.option("--workers", type=click.IntRange(1), help="Processes; by default one for each processor.")
@click.option("--scheduler", help="Address of a Dask scheduler, tcp://host:port, whose workers are used instead.")
@click.option(
    "--full", is_flag=True, help="Sample each data set as long as `run` does, not only for 4000 effective draws."
)
@click.option("--out", type=click.Path(path_type=Path), help="Directory; by default reports/NAME-calibration.")
@seed_option
def calibrate(
    config: Path,
    count: int,
    data_from: Path | None,
    workers: int | None,
    scheduler: str | None,
    full: bool,
    out: Path | None,
    seed: int | None,
) -> None:
    """Judge the analysis of a case by simulated data with known truths; exit 1 where it is not calibrated.

    Data sets that are done are kept in the directory: the same command goes on where it was cut off.
    """
    case = load(config)
    source = load(data_from) if data_from is not None else None
    from jointbayes.report.run_directory import require_room
    from jointbayes.studies.calibration.calibrate import calibrate as judged
    from jointbayes.studies.calibration.directory import write_calibration
    from jointbayes.studies.calibration.report import calibration_lines

    name = f"{directory_name(case.name, config)}-calibration"
    if source is not None and data_from is not None:
        name += f"-by-{directory_name(source.name, data_from)}"
    directory = out or Path("reports") / name
    require_room(directory)
    click.get_current_context().meta[UNFINISHED] = (
        f"the data sets that are done are kept in {directory}, where the same command goes on"
    )
    found = judged(
        case,
        count,
        seed=seed,
        data_from=source,
        settings=case.sampler.for_one_of_many(full=full),
        directory=directory,
        workers=workers,
        scheduler=scheduler,
        progress=show_calibration(),
    )
    write_calibration(found, directory, case)
    for line in calibration_lines(found):
        say(line)
    say(f"Report: {directory / 'report.html'} and {directory / 'report.pdf'}")
    if not found.passed:
        sys.exit(NOT_MATCHED)
