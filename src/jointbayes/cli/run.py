"""Commands on one case or its posterior: run, identify, sample, report, check."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from jointbayes.cli import common
from jointbayes.cli.common import force_option, require_free, require_outside
from jointbayes.cli.output import manner, open_option, report_written, say
from jointbayes.cli.progress_display import say_stages, show_progress, show_stage
from jointbayes.errors import CaseError
from jointbayes.progress import Progress

if TYPE_CHECKING:
    from jointbayes.workflow import TakenAs


@open_option
@click.command()
@common.config_argument
@common.outside_option
@click.option("--out", type=click.Path(path_type=Path), help="Run directory; by default reports/<case name>.")
@common.seed_option
@common.take_as_option
def run(config: Path, out: Path | None, seed: int | None, take_as: "TakenAs | None") -> None:
    """Identify, sample and write the report of a case file.

    \b
    Examples:
      jointbayes run my_case.toml --open
      jointbayes run my_case.toml --out reports/first --seed 2
    """
    case = common.load(config)
    from jointbayes.posterior.checks import checks_of
    from jointbayes.posterior.diagnosis import diagnoses_of
    from jointbayes.posterior.prediction import sentences_of_left_out
    from jointbayes.report.inputs import ReportInputs
    from jointbayes.report.run_directory import draws_kept, require_writable, room_of_run, write_run

    target = out or Path("reports") / case.name
    require_writable(target, room=room_of_run(case.problem, case.sampler, report=True))
    require_outside(target)
    posterior = common.draw(case, seed, take_as)
    inputs = ReportInputs(posterior)
    with draws_kept(posterior, target):
        common.print_answer(posterior)  # what takes most of the time from here on changes none of it
        manner().written = write_run(posterior, target, show_stage, inputs)
    common.print_caveats(posterior, inputs.knowledge)
    for check, diagnosis in zip(checks_of(posterior), diagnoses_of(posterior), strict=True):
        if check.finding != "explained" or check is posterior.check:
            say(check.sentence)
        say(*(() if check.explains else diagnosis.sentences))
    say(*sentences_of_left_out(inputs.summary.left_out))
    manner().result |= inputs.summary.to_dict()
    report_written(target)
    say_stages()
    common.exit_by_convergence(posterior)


@click.command()
@common.config_argument
@common.outside_option
@click.option("--paper", is_flag=True, help="Print the steps of the paper's sensitivity iteration as well.")
def identify(config: Path, *, paper: bool) -> None:
    """Find the best-fitting joint (MAP) of a case, with intervals from the curvature there; no sampling.

    \b
    Examples:
      jointbayes identify my_case.toml
      jointbayes identify my_case.toml --paper
    """
    case = common.load(config)
    from jointbayes.identification import missing_for_iteration
    from jointbayes.rounding import quantity_text, with_interval
    from jointbayes.workflow import find_map

    with show_progress() as progress:
        estimate = find_map(case, progress=progress)
    ends, found = estimate.laplace_ends(case.problem.prior), manner().result.setdefault("map", {})
    say("Best fit (MAP)" + (":" if ends is None else ", with 95 % intervals from its curvature (Laplace):"))
    for i, (quantity, value) in enumerate(zip(case.problem.quantities, estimate.values.tolist(), strict=True)):
        interval = None if ends is None else ends[:, i].tolist()
        found[quantity.name] = {"unit": quantity.unit, "value": value, "interval95": interval}
        shown = with_interval((value, *interval), quantity.unit) if interval else quantity_text(value, quantity.unit)
        say(f"  {quantity.name} = {shown}")
    if ends is None:
        edges = ", ".join(case.problem.prior.coordinates_at_edge(estimate.theta))
        say(f"No intervals: the best fit lies on an edge of the prior ({edges}); run the case.")
    if len(estimate.modes) > 1:
        say(f"{len(estimate.modes)} joints fit about as well: run the case.")
    if estimate.sentence:
        say(estimate.sentence)
    if not paper:
        return
    history = estimate.iteration
    if history is None:
        damped = "The iteration knows no damping of a joint" if case.problem.parametrisation.damped else ""
        say(f"The paper's iteration is left out. {damped or missing_for_iteration(case.problem)}.")
        return
    found = {"converged": history.converged, "stiffness_history": history.stiffness_history.tolist()}
    manner().result["paper"] = found
    heads = [f"{f'{q.name} ({q.unit})':>12}" for q in (case.problem.quantities[i] for i in history.iterated)]
    say(f"{'step':>4} {'residual':>10} {' '.join(heads)}")
    rows = history.stiffness_history[:, history.iterated]
    for step, (norm, k) in enumerate(zip(history.residual_norm, rows, strict=True)):
        values = " ".join(f"{value:>{len(head)}.4e}" for value, head in zip(k, heads, strict=True))
        say(f"{step:>4} {norm:>10.3e} {values}")
    say(f"The paper's iteration{history.on_test} {history.reason}.")


@click.command()
@common.config_argument
@common.outside_option
@click.option("--out", type=click.Path(path_type=Path), help="Posterior file; by default <case name>.nc.")
@common.seed_option
@common.take_as_option
@force_option
def sample(config: Path, out: Path | None, seed: int | None, take_as: "TakenAs | None") -> None:
    """Sample a case and write the draws, without a report.

    \b
    Examples:
      jointbayes sample my_case.toml --out draws.nc
      jointbayes sample my_case.toml --quiet --json
    """
    case = common.load(config)
    from jointbayes.report.run_directory import require_room, room_of_run, save_draws

    target = out or Path(f"{case.name}.nc")
    require_free(target, "--out", posterior=True)
    require_room(target, room_of_run(case.problem, case.sampler, report=False))
    posterior = common.draw(case, seed, take_as)
    require_free(target, "--out", posterior=True)  # once more: hours may have passed
    save_draws(posterior, target)
    manner().written = target
    common.print_summary(posterior)
    if manner().json:
        manner().result |= {**posterior.summary().to_dict(), "draws": str(target)}
    say(f"Draws: {target}")
    common.exit_by_convergence(posterior)


@open_option
@click.command()
@click.argument("posterior", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Run directory; by default reports/<case name>.")
@click.option("--one-page", "single", is_flag=True, help="Only one A4 page, for a customer: one-page.pdf, or --out.")
@force_option
def report(posterior: Path, out: Path | None, *, single: bool) -> None:
    """Write the report of a posterior file.

    POSTERIOR may be a run directory.

    \b
    Examples:
      jointbayes report reports/my_case --out reports/again
      jointbayes report reports/my_case --one-page
    """
    posterior = common.posterior_file(posterior)
    # before the seconds that the rest takes to load
    show_stage(Progress("reading the draws", str(posterior)), on_terminal_only=not posterior.is_file())
    from jointbayes.report.run_directory import draws_explained, require_writable, write_run
    from jointbayes.workflow import load_posterior

    page = out or posterior.parent / "one-page.pdf"
    manner().read.append(posterior)
    if single:
        require_free(page, "--out")
    loaded = load_posterior(posterior)
    if single:
        from jointbayes.report.run_directory import write_one_page

        manner().written = write_one_page(loaded, page, show_stage)
        manner().result["page"] = str(page)
        say(f"Page: {page}")
        common.exit_by_convergence(loaded)
        return
    target = out or Path("reports") / common.directory_name(loaded.record.case_name, posterior)
    require_writable(target)
    from jointbayes.report.inputs import ReportInputs

    inputs = ReportInputs(loaded)
    with draws_explained(posterior, target):
        manner().written = write_run(loaded, target, show_stage, inputs)
    manner().result |= inputs.summary.to_dict()
    report_written(target)
    common.exit_by_convergence(loaded)


#: Formats of `export`, and the endings that choose one; those of formats that went choose what is refused by name.
_EXPORTED = ("csv", "nastran", "abaqus", "calculix", "ansys")
_ENDINGS = {".csv": "csv", ".bdf": "nastran", ".nas": "nastran", ".inp": "abaqus", ".mac": "ansys"}
_GONE = {".uff": "uff58b", ".unv": "uff58b", ".uf": "uff58b", ".mat": "mat", ".npz": "npz", ".h5": "hdf5"}


@click.command()
@click.argument("posterior", type=click.Path(path_type=Path))
@click.option("--to", "target", required=True, type=click.Path(path_type=Path), help="File to write.")
@click.option(
    "--format", "form", metavar="FORMAT", help=f"{', '.join(_EXPORTED)}; by default that of the file's ending."
)
@click.option("--units", type=click.Choice(["SI", "mm-N-t"]), default="SI", help="Of the cards; by default SI.")
@click.option("--test", help="Test, where there are several; by default the first.")
@click.option("--node", "nodes", multiple=True, metavar="NAME=NUMBER", help="Number of a node with a name; repeatable.")
@click.option("--first-id", type=click.IntRange(1, 90_000_000), default=900001, help="First number that cards may use.")
@force_option
def export(
    posterior: Path,
    target: Path,
    form: str | None,
    units: Literal["SI", "mm-N-t"],
    test: str | None,
    nodes: tuple[str, ...],
    first_id: int,
) -> None:
    """Write predicted FRFs (csv), or the joint as cards for FE programs, of a posterior file.

    POSTERIOR may be a run directory.

    \b
    Examples:
      jointbayes export reports/my_case --to joint.bdf --units mm-N-t
      jointbayes export posterior.nc --to frf.csv
    """
    from jointbayes.report.export import export as write
    from jointbayes.workflow import load_posterior

    chosen = form or (_ENDINGS | _GONE).get(target.suffix.lower())
    if chosen is None:
        found, expected = f"found no format of the ending {target.suffix!r}", f"one of {', '.join(_ENDINGS)}"
        raise CaseError.of(f"{target}", (), found, expected, "choose another or give --format")
    pairs = [pair.rpartition("=") for pair in nodes]
    if wrong := [name + sign + number for name, sign, number in pairs if not (name and number.isdecimal())]:
        raise CaseError(f"--node: found {wrong[0]!r}; expected NAME=NUMBER, such as footA=17; correct it")
    source = common.posterior_file(posterior)
    manner().read.append(source)
    require_free(target, "--to")
    loaded = load_posterior(source)
    numbers = {name: int(number) for name, _, number in pairs}
    say(*write(loaded, target, chosen, test=test, units=units, nodes=numbers, first_id=first_id))
    manner().result |= {"written": str(target), "format": chosen}
    say(f"Written: {target} ({chosen})")
    common.exit_by_convergence(loaded)


_MARKS = {True: ("ok  ", "expected"), False: ("FAIL", "expected"), None: ("info", "published")}


@click.command()
@common.config_argument
@common.outside_option
@common.seed_option
def check(config: Path, seed: int | None) -> None:
    """Compare the posterior mode of a case with its [reference]: exit 0 where it matches, 1 where not.

    \b
    Examples:
      jointbayes check configs/clamped_beam.toml
    """
    case = common.load(config)
    from jointbayes.studies.reference_check import check_posterior, require_reference

    require_reference(case)
    result = check_posterior(case, common.draw(case, seed))
    say(f"{case.title}; seed {case.spec.sampling.seed if seed is None else seed}")
    for line in result.lines:
        mark, word = _MARKS[line.matches]
        say(f"{mark} {line.subject}: {line.found}; {word}: {line.expected}")
    manner().result |= {"matches": result.matches, "lines": [asdict(line) for line in result.lines]}
    say("The posterior mode matches." if result.matches else "The posterior mode does NOT match.")
    if not result.matches:
        sys.exit(common.NOT_MATCHED)
