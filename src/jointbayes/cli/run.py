"""Commands on one case or its posterior: run, identify, sample, report, check."""

import sys
from pathlib import Path
from typing import Literal

import click

from jointbayes.cli.common import (
    NOT_MATCHED,
    config_argument,
    directory_name,
    draw,
    exit_by_convergence,
    load,
    note_written,
    outside_option,
    print_summary,
    resume_option,
    seed_option,
    unfinished,
)
from jointbayes.cli.files import FORMATS, format_of_ending, require_other_file
from jointbayes.cli.output import say


@click.command()
@config_argument
@outside_option
@click.option("--out", type=click.Path(path_type=Path), help="Run directory; by default reports/<case name>.")
@seed_option
@resume_option
def run(config: Path, out: Path | None, seed: int | None, *, resume: bool) -> None:
    """Identify, sample and write the report of a case file."""
    case = load(config)
    from jointbayes.cli.progress_display import show_stage
    from jointbayes.errors import ReportError, ReportInterruptedError
    from jointbayes.posterior.prediction import sentence_of_left_out
    from jointbayes.report.inputs import ReportInputs
    from jointbayes.report.kept_draws import draws_kept
    from jointbayes.report.run_directory import require_writable, room_of_run, write_run

    target = out or Path("reports") / case.name
    require_writable(target, room=room_of_run(case.problem, case.sampler, report=True))
    with unfinished("run", config, out, target, seed, resume=resume) as kept:
        posterior = draw(case, seed, kept)
        inputs = ReportInputs(posterior)
        try:
            with draws_kept(posterior, target, kept.path) as draws:
                note_written(write_run(posterior, target, show_stage, inputs))
        except (ReportError, ReportInterruptedError):
            if not draws.exists():  # they are whole beside the run directory
                kept.discard()
            raise
        kept.discard()
    print_summary(posterior, inputs.knowledge)
    for check, diagnosis in zip(posterior.checks, posterior.diagnoses, strict=True):
        if check.finding != "explained" or check is posterior.check:
            say(check.sentence)
        if not check.explains:
            say(diagnosis.sentence)
    if inputs.summary.left_out:
        say(sentence_of_left_out(inputs.summary.left_out))
    say(f"Report: {target / 'report.html'} and {target / 'report.pdf'}")
    exit_by_convergence(posterior)


@click.command()
@config_argument
@outside_option
def identify(config: Path) -> None:
    """Run the paper's sensitivity iteration and the MAP search; print both."""
    case = load(config)
    from jointbayes.cli.progress_display import show_stage
    from jointbayes.identification import missing_for_iteration, part_to_iterate
    from jointbayes.posterior.rounding import join_unit
    from jointbayes.workflow import find_map
    from jointbayes.workflow import identify as iterate

    if case.problem.parametrisation.damped:
        say("The paper's iteration is left out: it knows no damping of a joint.")
    elif part_to_iterate(case.problem) is not None:
        history = iterate(case)
        heads = [f"{f'{q.name} ({q.unit})':>12}" for q in (case.problem.quantities[i] for i in history.iterated)]
        say(f"{'step':>4} {'residual':>10} {' '.join(heads)}")
        rows = history.stiffness_history[:, history.iterated]
        for step, (norm, k) in enumerate(zip(history.residual_norm, rows, strict=True)):
            values = " ".join(f"{value:>{len(head)}.4e}" for value, head in zip(k, heads, strict=True))
            say(f"{step:>4} {norm:>10.3e} {values}")
        say(f"The paper's iteration{history.on_setup} {history.reason}.")
    elif missing := missing_for_iteration(case.problem):
        say(f"The paper's iteration is left out. {missing}.")
    estimate = find_map(case, progress=show_stage)
    stiffnesses = zip(case.problem.quantities, estimate.values, strict=True)
    say("MAP: " + ", ".join(join_unit(f"{q.name} = {value:.4e}", q.unit) for q, value in stiffnesses))
    edges = case.problem.prior.coordinates_at_edge(estimate.theta)
    if edges:
        say(f"No standard deviations: the MAP lies on an edge of the prior ({', '.join(edges)}); run the case.")
    else:
        sd = estimate.covariance.diagonal() ** 0.5
        words = ", ".join(f"{n} {s:.3g}" for n, s in zip(case.problem.prior.labels, sd, strict=True))
        say(f"Linearised sd, without draws: {words}")
    if estimate.failed_starts:
        say(f"Starts that ended elsewhere: {estimate.failed_text}")
    if estimate.sentence:
        say(estimate.sentence)


@click.command()
@config_argument
@outside_option
@click.option("--out", type=click.Path(path_type=Path), help="Posterior file; by default <case name>.nc.")
@seed_option
@resume_option
def sample(config: Path, out: Path | None, seed: int | None, *, resume: bool) -> None:
    """Sample a case and write the draws, without a report."""
    case = load(config)
    from jointbayes.errors import CaseError
    from jointbayes.report.kept_draws import save_draws
    from jointbayes.report.run_directory import require_room, room_of_run

    target = out or Path(f"{case.name}.nc")
    if not target.absolute().parent.is_dir():
        raise CaseError(f"{target}: found no directory {target.parent}; expected one that exists; make it first")
    if target.exists() and not target.is_file():
        kind = "a directory" if target.is_dir() else "no regular file"
        raise CaseError(f"{target}: found {kind}; expected a file; choose another --out")
    require_room(target, room_of_run(case.problem, case.sampler, report=False))
    with unfinished("sample", config, out, target, seed, resume=resume) as kept:
        posterior = draw(case, seed, kept)
        save_draws(posterior, target)
        note_written(target)
        kept.discard()
    print_summary(posterior)
    say(f"Draws: {target}")
    exit_by_convergence(posterior)


@click.command()
@click.argument("posterior", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Run directory; by default reports/<case name>.")
def report(posterior: Path, out: Path | None) -> None:
    """Write the report of a posterior file."""
    from jointbayes.cli.progress_display import show_stage
    from jointbayes.progress import Progress

    show_stage(Progress("reading the draws"), on_terminal_only=True)  # before the seconds that the rest takes to load
    from jointbayes.report.kept_draws import draws_explained
    from jointbayes.report.run_directory import require_writable, write_run
    from jointbayes.workflow import load_posterior

    loaded = load_posterior(posterior)
    target = out or Path("reports") / directory_name(loaded.record.case_name, posterior)
    require_writable(target)
    with draws_explained(posterior, target):
        note_written(write_run(loaded, target, show_stage))
    say(f"Report: {target / 'report.html'} and {target / 'report.pdf'}")
    exit_by_convergence(loaded)


#: Formats of `export`, each with the endings that choose it.
_EXPORTED = {
    **{form: FORMATS[form] for form in ("uff58", "uff58b", "mat", "csv")},
    **{"nastran": (".bdf", ".nas"), "abaqus": (".inp",), "calculix": (), "ansys": (".mac",)},
}


@click.command()
@click.argument("posterior", type=click.Path(path_type=Path))
@click.option("--to", "target", required=True, type=click.Path(path_type=Path), help="File to write.")
@click.option("--format", "form", type=click.Choice(list(_EXPORTED)), help="By default that of the file's ending.")
@click.option("--units", type=click.Choice(["SI", "mm-N-t"]), default="SI", help="Of the cards; by default SI.")
@click.option("--setup", help="Set-up, where there are several; by default the first.")
@click.option("--node", "nodes", multiple=True, metavar="NAME=NUMBER", help="Number of a node with a name; repeatable.")
@click.option("--first-id", type=click.IntRange(1, 90_000_000), default=900001, help="First number that cards may use.")
def export(
    posterior: Path,
    target: Path,
    form: str | None,
    units: Literal["SI", "mm-N-t"],
    setup: str | None,
    nodes: tuple[str, ...],
    first_id: int,
) -> None:
    """Write predicted FRFs and modes (uff, mat, csv), or the joint as cards for FE programs, of a posterior file.

    POSTERIOR may be a run directory.
    """
    from jointbayes.errors import CaseError
    from jointbayes.report.export import export as write
    from jointbayes.workflow import load_posterior

    chosen = form or format_of_ending(target, _EXPORTED)
    pairs = [pair.rpartition("=") for pair in nodes]
    if wrong := [name + sign + number for name, sign, number in pairs if not (name and number.isdecimal())]:
        raise CaseError(f"--node: found {wrong[0]!r}; expected NAME=NUMBER, such as footA=17; correct it")
    source = posterior / "posterior.nc" if posterior.is_dir() else posterior
    require_other_file(target, source, "--to")
    loaded = load_posterior(source)
    numbers = {name: int(number) for name, _, number in pairs}
    for line in write(loaded, target, chosen, setup=setup, units=units, nodes=numbers, first_id=first_id):
        say(line)
    say(f"Written: {target} ({chosen})")
    exit_by_convergence(loaded)


@click.command()
@config_argument
@outside_option
@seed_option
def check(config: Path, seed: int | None) -> None:
    """Compare the posterior mode of a case with its [reference]: exit 0 where it matches, 1 where not."""
    case = load(config)
    from jointbayes.studies.reference_check import check_posterior, require_reference

    require_reference(case)
    result = check_posterior(case, draw(case, seed))
    say(f"{case.title}; seed {case.spec.sampling.seed if seed is None else seed}")
    for line in result.lines:
        mark, word = {True: ("ok  ", "expected"), False: ("FAIL", "expected"), None: ("info", "published")}[
            line.matches
        ]
        say(f"{mark} {line.subject}: {line.found}; {word}: {line.expected}")
    say("The posterior mode matches." if result.matches else "The posterior mode does NOT match.")
    if not result.matches:
        sys.exit(NOT_MATCHED)
