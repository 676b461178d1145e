"""Commands that make many posteriors: compare, plan, calibrate, campaign."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jointbayes.cli.common import (
    CASES_FAILED,
    NOT_CONVERGED,
    NOT_MATCHED,
    UNFINISHED,
    config_argument,
    directory_name,
    load,
    note_written,
    outside_allowed,
    outside_option,
    seed_option,
)
from jointbayes.cli.output import say
from jointbayes.cli.progress_display import show_progress, show_stage
from jointbayes.errors import CaseError, WorkerError, printable
from jointbayes.progress import Progress

if TYPE_CHECKING:
    from jointbayes.studies.campaign.index import Campaign


@click.command()
@click.argument("config", nargs=-1, required=True, type=click.Path(path_type=Path))
@outside_option
@click.option("--out", type=click.Path(path_type=Path), help="Run directory to write; by default none.")
@seed_option
def compare(config: tuple[Path, ...], out: Path | None, seed: int | None) -> None:
    """Compare hypotheses on the joint, from rigid to a full matrix, in one case file or several of the same data."""
    from jointbayes.own_directory import OwnDirectory
    from jointbayes.report.run_directory import require_room
    from jointbayes.studies.compare import compare as weigh
    from jointbayes.studies.compare import require_same_data
    from jointbayes.studies.comparison_report import A_COMPARISON, evidence_table

    cases = [load(path) for path in config]
    require_same_data(cases)
    if out is not None:
        require_room(out)
        if out.exists():
            with OwnDirectory(out, A_COMPARISON):  # what is not one is refused before any work
                pass
    with show_progress() as progress:
        comparison = weigh(cases, seed=seed, progress=progress)
    for line in evidence_table(comparison.summary(), method=True).lines():
        say(line)
    for note in dict.fromkeys(c.loo_note for c in comparison.candidates if c.loo_note):
        say(f"Cross-validation is {note}.")
    if out is not None:
        comparison.write(out)
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
    from jointbayes.report.run_directory import require_room
    from jointbayes.studies.planning.make_plan import plan as ranked
    from jointbayes.studies.planning.plan_report import plan_lines

    directory = out or Path("reports") / f"{directory_name(case.name, config)}-plan"
    require_room(directory)
    click.get_current_context().meta[UNFINISHED] = f"what is done is kept in {directory}; the same command goes on"
    with show_progress() as progress:
        result = ranked(case, seed=seed, assume=stated or None, directory=directory, progress=progress)
    result.write(directory)
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
@click.option("--near", is_flag=True, help="Draw truths from the posterior of the measured data, not from the prior.")
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
    near: bool,
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
    from jointbayes.studies.calibrate import calibrate as judged
    from jointbayes.studies.calibration import calibration_lines

    name = f"{directory_name(case.name, config)}-calibration{'-near' if near else ''}"
    if source is not None and data_from is not None:
        name += f"-by-{directory_name(source.name, data_from)}"
    directory = out or Path("reports") / name
    require_room(directory)
    click.get_current_context().meta[UNFINISHED] = (
        f"the data sets that are done are kept in {directory}, where the same command goes on"
    )
    with show_progress() as progress:
        calibration = judged(
            case,
            count,
            seed=seed,
            data_from=source,
            near=near,
            settings=case.sampler.for_one_of_many(full=full),
            directory=directory,
            workers=workers,
            scheduler=scheduler,
            progress=progress,
        )
    calibration.write(directory)
    for line in calibration_lines(calibration):
        say(line)
    say(f"Report: {directory / 'report.html'} and {directory / 'report.pdf'}")
    if not calibration.passed:
        sys.exit(NOT_MATCHED)


_TABLES = (".csv", ".tsv", ".txt")
_SHOWN = 10  # cases that are named on the terminal


@click.command()
@click.argument("cases", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--base", type=click.Path(path_type=Path), help="Case that the rows of a table change.")
@click.option("--out", type=click.Path(path_type=Path), help="Directory; by default reports/<name of the table>.")
@click.option("--workers", type=click.IntRange(1, 10_000), help="Processes; by default one for each processor.")
@click.option("--scheduler", help="Address of a Dask scheduler, tcp://host:port, whose workers are used instead.")
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=1, help="Seed of the campaign; by default 1.")
@click.option("--draws", type=click.IntRange(200), default=4000, help="Draws kept of each case; by default 4000.")
@click.option("--full", is_flag=True, help="Sample each case as long as `run` does, not only for 4000 effective draws.")
@click.option("--limit", "seconds", type=click.FloatRange(min=0, min_open=True), help="Longest time for a case, s.")
@outside_option
@click.option("--again", is_flag=True, help="Try cases again that killed their workers.")
def campaign(cases: tuple[Path, ...], out: Path | None, **settings: Any) -> None:  # noqa: ANN401 (as campaign has them)
    """Sample many cases: rows of a table in CSV over a base case, or case files; then report on all of them.

    Started again on the same directory it goes on: what is done is not done again.
    """
    show_stage(Progress("reading the cases"), on_terminal_only=True)
    from jointbayes.studies.campaign.campaign_run import campaign as sample_all

    target = out or Path("reports") / (cases[0].stem if cases[0].suffix.lower() in _TABLES else "campaign")
    kept = click.get_current_context().meta
    with show_progress() as progress:

        def tell(now: Progress) -> None:
            done = now.done - round(now.figures["failed"])
            kept[UNFINISHED] = f"{done} of {now.total} cases are done in {target}; the same command goes on"
            progress(now)

        try:
            ended = sample_all(cases, target, **settings, progress=tell, allow_outside=outside_allowed())
        except WorkerError as error:
            raise WorkerError(f"{error}; {kept[UNFINISHED]}" if UNFINISHED in kept else str(error)) from error
    show_stage(Progress("looking at all cases together, and writing the report"))
    note_written(ended.write_report())
    _exit_by(ended)


def _exit_by(ended: "Campaign") -> None:
    """Print what became of the cases, and end with the exit code that says so."""
    from jointbayes.studies.campaign.index import DONE, INDEX, read_index

    rows = read_index(ended.directory)
    failed = [row for row in rows if row.status != DONE]
    doubtful = [row for row in rows if row.status == DONE and not row.converged]
    say(f"{len(rows)} cases: {len(rows) - len(failed)} done, {len(failed)} failed, {len(doubtful)} not converged")
    for row in failed[:_SHOWN]:
        say(f"{row.status.upper()}: {row.key}: {row.error}")
    for row in doubtful[:_SHOWN]:
        say(f"NOT CONVERGED: {row.key}: {row.reason}")
    if max(len(failed), len(doubtful)) > _SHOWN:
        say(f"The first {_SHOWN} are shown; all stand in the index.")
    say(f"Index: {ended.directory / INDEX}")
    say(f"Report: {ended.directory / 'report.html'} and {ended.directory / 'report.pdf'}")
    population = json.loads((ended.directory / "summary.json").read_text(encoding="utf-8"))["population"]
    doubted = population is not None and not population["converged"]
    if doubted:
        say(f"NOT CONVERGED: the population of all joints: {population['how']}")
    if len(failed):
        sys.exit(CASES_FAILED)
    if len(doubtful) or doubted:
        sys.exit(NOT_CONVERGED)
