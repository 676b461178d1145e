"""Commands that make many posteriors: compare, same, plan, campaign."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jointbayes.cli import common
from jointbayes.cli.common import require_outside
from jointbayes.cli.output import manner, open_option, report_written, say
from jointbayes.cli.progress_display import show_progress, show_stage
from jointbayes.errors import CaseError, WorkerError
from jointbayes.progress import Progress

if TYPE_CHECKING:
    from jointbayes.studies.same import JointChange
    from jointbayes.studies.same_modes import ModesChange


def _require_place(directory: Path, kind: str) -> None:
    """Refuse, before any work, a directory that cannot be written or holds anything but such a study."""
    from jointbayes.report.run_directory import require_room
    from vibrecords.files import OwnDirectory

    require_outside(directory)
    require_room(directory)
    if directory.exists():
        with OwnDirectory(directory, kind):
            pass


@open_option
@click.command()
@click.argument("config", nargs=-1, required=True, type=click.Path(path_type=Path))
@common.outside_option
@click.option("--out", type=click.Path(path_type=Path), help="Run directory to write; by default none.")
@common.seed_option
@click.option("--nested", is_flag=True, help="Find ln Z by nested sampling, which takes minutes, not from the draws.")
def compare(config: tuple[Path, ...], out: Path | None, seed: int | None, nested: bool) -> None:
    """Compare hypotheses on the joint, from rigid to a full matrix, in one case file or several of the same data.

    \b
    Examples:
      jointbayes compare my_case.toml
      jointbayes compare springs.toml full.toml --out reports/compared
    """
    cases = [common.load(path) for path in config]
    from jointbayes.studies.compare import A_COMPARISON, evidence_table, require_same_data
    from jointbayes.studies.compare import compare as weigh

    require_same_data(cases)
    if out is not None:
        _require_place(out, A_COMPARISON)
    with show_progress() as progress:
        comparison = weigh(cases, seed=seed, progress=progress, nested=nested)
    say(*comparison.sentences, *evidence_table(comparison.summary()).lines())
    if out is not None:
        comparison.write(out)
        report_written(out)
    manner().result |= comparison.summary()
    if not comparison.trusted:
        say("NOT TRUSTED: the error of an evidence is unknown, see the table.")
        sys.exit(common.NOT_CONVERGED)


@open_option
@click.command()
@click.argument("posterior", type=click.Path(path_type=Path))
@click.argument("other", type=click.Path(path_type=Path))
@common.outside_option
@click.option("--out", type=click.Path(path_type=Path), help="Directory to write; by default reports/NAME-prediction.")
@click.option("--test", help="Test whose joint it is, where there are several; by default the first.")
def predict(posterior: Path, other: Path, out: Path | None, test: str | None) -> None:
    """Predict FRFs and natural frequencies of a structure that was never tested, held by the joint of a run.

    POSTERIOR is a posterior file or a run directory. OTHER is a case file with [structure], [joint] and [predict].

    \b
    Examples:
      jointbayes predict reports/my_case longer_tool.toml
    """
    from jointbayes.studies.predict import A_PREDICTION, predict_lobes, prediction_lines, read_other, write_prediction
    from jointbayes.workflow import load_posterior

    source = common.posterior_file(posterior)
    manner().read += [source, other]
    directory = out or Path("reports") / f"{other.stem}-prediction"
    _require_place(directory, A_PREDICTION)
    show_stage(Progress("building the model of the other structure", str(other)))
    asked = read_other(other, manner().allow_outside)
    loaded = load_posterior(source)
    show_stage(Progress("predicting", f"{len(asked.ports.frequency_hz)} lines"))
    stated: dict[str, Any] = {"uncertain": asked.uncertain, "own": asked.own, "quantity": asked.quantity}
    found = loaded.predict(asked.recipe, asked.ports, asked.joint, test=test, **stated)
    if asked.lobes is not None:
        show_stage(Progress("predicting the stability lobes", f"{asked.lobes.teeth} teeth"))
    lobes = predict_lobes(loaded, asked, test)
    say(*prediction_lines(found, loaded, lobes))
    manner().written = write_prediction(found, asked, loaded, directory, lobes)
    manner().result |= found.as_json()
    report_written(directory)
    common.exit_by_convergence(loaded)


@click.command()
@click.argument("before", type=click.Path(path_type=Path))
@click.argument("new", type=click.Path(path_type=Path))
@common.outside_option
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=1, help="Seed of all that is random; by default 1.")
def same(before: Path, new: Path, seed: int) -> None:
    """Say whether a joint has changed between two tests, and by how much; exit 1 where it has.

    BEFORE and NEW are case files, posterior files or run directories of one test each: the stiffnesses are compared.
    Or they are measurement files of one set-up: the modes are compared, which needs no case.

    \b
    Examples:
      jointbayes same reference.toml today.toml
      jointbayes same before.uff after.uff
      jointbayes same reports/before reports/new --json
    """
    measured = [given for given in (before, new) if given.is_file() and given.suffix not in (".toml", ".nc")]
    if len(measured) == 1:
        words = "expected two cases or posteriors, or two measurement files; write a case for it"
        raise CaseError(f"{measured[0]}: found one measurement file; {words}: jointbayes init --from {measured[0]}")
    change: JointChange | ModesChange
    if measured:
        show_stage(Progress("fitting resonances"))
        from jointbayes.studies.same_modes import compare_modes

        change = compare_modes(before, new)
    else:
        from jointbayes.studies.same import compare_joints
        from jointbayes.workflow import answered_case, load_posterior

        with show_progress() as progress:
            one, other = [
                answered_case(common.load(given), seed, progress)
                if given.suffix == ".toml"
                else load_posterior(common.posterior_file(given)).problem
                for given in (before, new)
            ]
            change = compare_joints(one, other, seed, progress)
    say(*change.lines)
    manner().result |= asdict(change) | {"changed": change.changed}
    if not change.converged:
        sys.exit(common.NOT_CONVERGED)
    if change.changed:
        sys.exit(common.NOT_MATCHED)


@click.command()
@click.argument("given", metavar="GIVEN", type=click.Path(path_type=Path))
@common.outside_option
@common.seed_option
def plan(given: Path, seed: int | None) -> None:
    """Rank further measurements: "Next" of the report's page one in full, with price and gain of each.

    GIVEN is a case file, which is sampled first, a posterior file or a run directory.

    \b
    Examples:
      jointbayes plan my_case.toml
      jointbayes plan reports/my_case
    """
    case = common.load(given) if given.suffix == ".toml" else None
    from jointbayes.studies.plan import plan as ranked
    from jointbayes.workflow import load_posterior

    with show_progress() as progress:
        result = ranked(case or load_posterior(common.posterior_file(given)), seed=seed, progress=progress)
    manner().result |= result.as_json()
    say(*result.lines)
    if not result.converged:
        sys.exit(common.NOT_CONVERGED)


_SHOWN = 10  # cases that are named on the terminal


@open_option
@click.command()
@click.argument("cases", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--base", type=click.Path(path_type=Path), help="Case that the rows of a table change.")
@click.option("--out", type=click.Path(path_type=Path), help="Directory; by default reports/<name of the table>.")
@click.option("--workers", type=click.IntRange(1, 10_000), help="Processes; by default one for each processor.")
@click.option("--scheduler", help="Address of a Dask scheduler, tcp://host:port, whose workers are used instead.")
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=1, help="Seed of the campaign; by default 1.")
@click.option("--full", is_flag=True, help="Sample each case as long as `run` does, not only for 4000 effective draws.")
@common.outside_option
def campaign(cases: tuple[Path, ...], out: Path | None, **settings: Any) -> None:  # noqa: ANN401 (as campaign has them)
    """Run many cases: rows of a table in CSV over a base case, or case files; one run directory each, and an index.

    Started again on the same directory it goes on: what is done is not done again.

    \b
    Examples:
      jointbayes campaign joints.csv --base my_case.toml --workers 4
    """
    show_stage(Progress("reading the cases"))
    from jointbayes.studies.campaign import campaign as run_all

    target = out or Path("reports") / ("campaign" if cases[0].suffix.lower() == ".toml" else cases[0].stem)
    kept = manner()
    kept.read += [*cases, *filter(None, [settings["base"]])]
    require_outside(target)
    with show_progress() as progress:

        def tell(now: Progress) -> None:
            done = now.done - round(now.figures["failed"])
            kept.unfinished = f"{done} of {now.total} cases are done in {target}; the same command goes on"
            progress(now)

        try:
            ended = run_all(cases, target, **settings, progress=tell, allow_outside=kept.allow_outside)
        except WorkerError as error:
            raise WorkerError(f"{error}; {kept.unfinished}") from error
    kept.written = target
    rows = ended.index
    failed = rows[rows["status"] != "done"]
    doubtful = rows[(rows["status"] == "done") & (rows["converged"] != True)]  # noqa: E712 (a column of objects)
    say(f"{len(rows)} cases: {len(rows) - len(failed)} done, {len(failed)} failed, {len(doubtful)} not converged")
    for row in failed[:_SHOWN].itertuples():
        say(f"{row.status.upper()}: {row.key}: {row.error}")
    for row in doubtful[:_SHOWN].itertuples():
        say(f"NOT CONVERGED: {row.key}: {row.reason}")
    if max(len(failed), len(doubtful)) > _SHOWN:
        say(f"The first {_SHOWN} are shown; all stand in the index.")
    say(f"Index: {target / 'index.csv'}")
    report_written(target)
    manner().result |= {"cases": len(rows), "failed": list(failed["key"]), "not_converged": list(doubtful["key"])}
    if len(failed):
        sys.exit(common.CASES_FAILED)
    if len(doubtful):
        sys.exit(common.NOT_CONVERGED)
