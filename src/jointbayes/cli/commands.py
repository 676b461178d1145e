"""The command line: parse, call, print. Heavy imports wait until a command needs them."""

import atexit
import gc
import os
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jointbayes.errors import JointBayesError, ReportInterruptedError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from jointbayes.case.case import Case
    from jointbayes.case.plausibility import InputWarning
    from jointbayes.posterior import Posterior

__all__ = ["main"]

NOT_MATCHED = 1
BAD_INPUT = 2
NOT_CONVERGED = 3
INTERRUPTED = 130  # as shells have it: 128 + SIGINT
_WRITTEN = "jointbayes.written"  # in a command's context: what it has written

#: Formats of `simulate`, each with the endings that choose it.
_FORMATS: dict[str, tuple[str, ...]] = {
    "uff58": (".uff", ".unv", ".uf"),
    "uff58b": (),
    "mat": (".mat",),
    "mat73": (),
    "csv": (".csv",),
    "tsv": (".tsv", ".txt"),
    "npz": (".npz",),
    "hdf5": (".h5", ".hdf5"),
    "lvm": (".lvm",),
}


class _Commands(click.Group):
    """Prints what is wrong with the input on one line and exits 2: a traceback would be a bug."""

    def invoke(self, ctx: click.Context) -> Any:  # noqa: ANN401 (click's own signature)
        try:
            return super().invoke(ctx)
        except JointBayesError as error:
            if os.environ.get("JOINTBAYES_DEBUG"):
                traceback.print_exc()
            click.echo(f"jointbayes: {error}", err=True)
        except ReportInterruptedError as error:
            click.echo(f"jointbayes: {error}", err=True)
            sys.exit(INTERRUPTED)
        except KeyboardInterrupt:
            written = ctx.meta.get(_WRITTEN)
            what = f"{written} is whole" if written else "nothing was written"
            click.echo(f"jointbayes: interrupted; {what}", err=True)
            sys.exit(INTERRUPTED)
        except MemoryError:
            remedy = "lower sampling.walkers or sampling.ensembles, or use fewer lines"
            click.echo(f"jointbayes: found too little memory; expected room for all walkers; {remedy}", err=True)
        except OSError as error:
            place = f"{error.filename}: " if error.filename else ""
            click.echo(f"jointbayes: {place}{error.strerror or error}", err=True)
        sys.exit(BAD_INPUT)


_seed = click.option("--seed", type=click.IntRange(0, 2**32 - 1), help="Seed of the run; by default the case's.")
_config = click.argument("config", type=click.Path(path_type=Path))


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="jointbayes")
def main() -> None:
    """Joint stiffness from vibration measurements, with uncertainty.

    Exit status: 0 done, 1 the check does not match, 2 bad input, 3 the sampler has not converged, 130 interrupted.
    """
    # Small linear algebra takes up to ten times as long on several threads. Read when NumPy is loaded, so not yet.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    # Else a tenth of a run, and half a second at its end, goes into looking through modules, which stay, for garbage.
    gc.set_threshold(100_000)
    atexit.register(gc.freeze)


@main.command()
@click.argument("file", default="my_case.toml", type=click.Path(path_type=Path))
def init(file: Path) -> None:
    """Write a small case to start from, by default my_case.toml; FILE may be a directory."""
    from importlib.resources import files

    from jointbayes.errors import CaseError
    from jointbayes.whole_file import write_whole_file

    target = file / "my_case.toml" if file.is_dir() else file
    if target.exists():
        raise CaseError(f"{target}: found a file of this name; expected a new one; choose another name")
    write_whole_file(target, files("jointbayes.cli").joinpath("minimal.toml").read_bytes())
    click.echo(f"Case: {target}; next: jointbayes run {target}")


@main.command()
@_config
@click.option("--out", type=click.Path(path_type=Path), help="Run directory; by default reports/<case name>.")
@_seed
def run(config: Path, out: Path | None, seed: int | None) -> None:
    """Identify, sample and write the report of a case file."""
    case = _load(config)
    from jointbayes.cli.progress import show_phase
    from jointbayes.report.kept_draws import draws_kept
    from jointbayes.report.run_directory import require_writable, write_run

    target = out or Path("reports") / case.name
    require_writable(target)
    posterior = _sample(case, seed)
    with draws_kept(posterior, target):
        _note_written(write_run(posterior, target, show_phase))
    _print_summary(posterior)
    click.echo(posterior.check.sentence)
    if not posterior.check.explains:
        click.echo(posterior.diagnosis.sentence)
    click.echo(f"Report: {target / 'report.html'} and {target / 'report.pdf'}")
    _exit_by_convergence(posterior)


@main.command()
@_config
def identify(config: Path) -> None:
    """Run the paper's sensitivity iteration and the MAP search; print both."""
    case = _load(config)
    from jointbayes.cli.progress import show_phase
    from jointbayes.workflow import find_map
    from jointbayes.workflow import identify as iterate

    provenance = case.problem.measurement.provenance
    if case.problem.measurement.joint_frf is not None:
        history = iterate(case)
        heads = [f"{f'{q.name} ({q.unit})':>12}" for q in case.problem.quantities]
        click.echo(f"{'step':>4} {'residual':>10} {' '.join(heads)}")
        for step, (norm, k) in enumerate(zip(history.residual_norm, history.stiffness_history, strict=True)):
            values = " ".join(f"{value:>{len(head)}.4e}" for value, head in zip(k, heads, strict=True))
            click.echo(f"{step:>4} {norm:>10.3e} {values}")
        click.echo(f"The paper's iteration {history.reason}.")
    elif provenance is not None and provenance.iteration:
        click.echo(f"The paper's iteration is left out. {provenance.iteration}.")
    estimate = find_map(case, tell=show_phase)
    stiffnesses = zip(case.problem.quantities, estimate.stiffness, strict=True)
    click.echo("MAP: " + ", ".join(f"{q.name} = {value:.4e} {q.unit}" for q, value in stiffnesses))
    edges = case.problem.prior.at_edge(estimate.theta)
    if edges:
        click.echo(f"No standard deviations: the MAP lies on an edge of the prior ({', '.join(edges)}); run the case.")
    else:
        sd = estimate.covariance.diagonal() ** 0.5
        words = ", ".join(f"{n} {s:.3g}" for n, s in zip(case.problem.prior.labels, sd, strict=True))
        click.echo(f"Linearised sd, without draws: {words}")
    if estimate.failed_starts:
        click.echo(f"Starts that ended elsewhere: {estimate.failed_text}")
    if estimate.sentence:
        click.echo(estimate.sentence)


@main.command()
@_config
@click.option("--out", type=click.Path(path_type=Path), help="Posterior file; by default <case name>.nc.")
@_seed
def sample(config: Path, out: Path | None, seed: int | None) -> None:
    """Sample a case and write the draws, without a report."""
    case = _load(config)
    from jointbayes.errors import CaseError
    from jointbayes.report.kept_draws import save_draws

    target = out or Path(f"{case.name}.nc")
    if not target.absolute().parent.is_dir():
        raise CaseError(f"{target}: found no directory {target.parent}; expected one that exists; make it first")
    if target.exists() and not target.is_file():
        kind = "a directory" if target.is_dir() else "no regular file"
        raise CaseError(f"{target}: found {kind}; expected a file; choose another --out")
    posterior = _sample(case, seed)
    save_draws(posterior, target)
    _note_written(target)
    _print_summary(posterior)
    click.echo(f"Draws: {target}")
    _exit_by_convergence(posterior)


@main.command()
@click.argument("posterior", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Run directory; by default reports/<case name>.")
def report(posterior: Path, out: Path | None) -> None:
    """Write the report of a posterior file."""
    from jointbayes.cli.progress import show_phase

    show_phase("reading the draws", on_terminal_only=True)  # before the seconds that the rest takes to load
    from jointbayes.report.kept_draws import draws_explained
    from jointbayes.report.run_directory import require_writable, write_run
    from jointbayes.workflow import load_posterior

    loaded = load_posterior(posterior)
    target = out or Path("reports") / loaded.record.case_name
    require_writable(target)
    with draws_explained(posterior, target):
        _note_written(write_run(loaded, target, show_phase))
    click.echo(f"Report: {target / 'report.html'} and {target / 'report.pdf'}")
    _exit_by_convergence(loaded)


@main.command()
@_config
@_seed
def check(config: Path, seed: int | None) -> None:
    """Compare the posterior mode of a case with its [reference]: exit 0 where it matches, 1 where not."""
    case = _load(config)
    from jointbayes.studies.reference_check import check_posterior, require_reference

    require_reference(case)
    result = check_posterior(case, _sample(case, seed))
    click.echo(f"{case.title}; seed {case.spec.sampling.seed if seed is None else seed}")
    for line in result.lines:
        mark, word = {True: ("ok  ", "expected"), False: ("FAIL", "expected"), None: ("info", "published")}[
            line.matches
        ]
        click.echo(f"{mark} {line.subject}: {line.found}; {word}: {line.expected}")
    click.echo("The posterior mode matches." if result.matches else "The posterior mode does NOT match.")
    if not result.matches:
        sys.exit(NOT_MATCHED)


@main.command()
@click.argument("config", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Run directory to write; by default none.")
@_seed
def compare(config: tuple[Path, ...], out: Path | None, seed: int | None) -> None:
    """Compare hypotheses on the joint, from rigid to a full matrix, in one case file or several of the same data."""
    from jointbayes.report.run_directory import require_writable
    from jointbayes.studies.comparison.compare import compare as weigh
    from jointbayes.studies.comparison.compare import require_same_data
    from jointbayes.studies.comparison.directory import COMPARISON_MARK, write_comparison
    from jointbayes.studies.comparison.report import evidence_table

    cases = [_load(path) for path in config]
    require_same_data(cases)
    if out is not None:
        require_writable(out, COMPARISON_MARK)
    comparison = weigh(cases, seed, lambda name: click.echo(f"weighing {name}", err=True))
    for line in evidence_table(comparison.summary(), method=True).lines():
        click.echo(line)
    for note in dict.fromkeys(c.loo_note for c in comparison.candidates if c.loo_note):
        click.echo(f"Cross-validation is {note}.")
    if out is not None:
        write_comparison(comparison, cases, out)
        click.echo(f"Report: {out / 'report.html'} and {out / 'report.pdf'}")
    if not comparison.trusted:
        click.echo("NOT TRUSTED: the error of an evidence is unknown, see the table.")
    click.echo(comparison.verdict)
    if not comparison.trusted:
        sys.exit(NOT_CONVERGED)


@main.command()
@_config
@click.option("--out", type=click.Path(path_type=Path), help="Directory for report and numbers; by default none.")
@click.option("--json", "as_json", is_flag=True, help="Print plan.json instead of a table.")
@click.option("--assume", nargs=3, type=float, metavar="K11 K12 K22", help="Plan for this joint, not the one found.")
@_seed
def plan(
    config: Path, out: Path | None, as_json: bool, assume: tuple[float, float, float] | None, seed: int | None
) -> None:
    """Recommend what to measure next, from simulated further measurements."""
    case = _load(config)
    import json

    from jointbayes.report.run_directory import require_writable
    from jointbayes.studies.planning.directory import PLAN_MARK, write_plan
    from jointbayes.studies.planning.plan import plan as ranked
    from jointbayes.studies.planning.report import plan_lines

    if out is not None:
        require_writable(out, PLAN_MARK)
    result = ranked(case, seed=seed, assume=assume, progress=lambda line: click.echo(line, err=True))
    if out is not None:
        write_plan(result, case, out)
    if as_json:
        click.echo(json.dumps(result.summary(), indent=2, ensure_ascii=False, allow_nan=False))
    else:
        for line in plan_lines(result):
            click.echo(line)
        if out is not None:
            click.echo(f"Report: {out / 'report.html'} and {out / 'report.pdf'}")
    if not result.converged:
        sys.exit(NOT_CONVERGED)


@main.command()
@_config
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Measurement file to write.")
@click.option("--format", "form", type=click.Choice(list(_FORMATS)), help="By default that of the file's ending.")
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), help="Seed of the test; by default that of [virtual_test].")
def simulate(config: Path, out: Path, form: str | None, seed: int | None) -> None:
    """Measure the truth of a case in a virtual test and write a measurement file."""
    import numpy as np

    from jointbayes.case.case import load_case
    from jointbayes.case.simulation import describe
    from jointbayes.case.simulation import simulate as measure
    from jointbayes.errors import CaseError
    from jointbayes.measurement.formats import write_records

    chosen = form or next((name for name, endings in _FORMATS.items() if out.suffix.lower() in endings), None)
    if chosen is None:
        raise CaseError(
            f"{out}: found no format of the ending {out.suffix!r}; expected one of "
            f"{', '.join(e for endings in _FORMATS.values() for e in endings)}; choose another or give --format"
        )
    case = load_case(config)
    records = measure(case, None, np.random.default_rng(case.spec.virtual_test.seed if seed is None else seed))
    write_records(records, out, chosen)
    for line in describe(records):
        click.echo(line)
    click.echo(f"Measurement: {out} ({chosen})")


@main.command("inspect")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--figure", type=click.Path(path_type=Path), help="SVG file to draw FRFs and hits into.")
@click.option("--mass", type=click.FloatRange(min=0, min_open=True), help="Mass of a structure that hangs free, kg.")
def inspect_command(file: Path, figure: Path | None, mass: float | None) -> None:
    """List what a measurement file holds, and warn of what looks wrong in it."""
    from jointbayes.measurement.inspection.inspection import inspect_file
    from jointbayes.measurement.inspection.text import text_of

    inspection = inspect_file(file, mass)
    for line in text_of(inspection):
        click.echo(line)
    if figure is not None:
        from jointbayes.report.inspect_figure import inspect_figure

        traces = [(f"{t.channel} hit {t.hit.number}", t.hit.reason, t.time_s, t.force_n) for t in inspection.hits]
        figure.write_text(inspect_figure(inspection.frfs, inspection.modes, traces), encoding="utf-8")
        click.echo(f"Figure: {figure}")


def _load(config: Path) -> "Case":
    """Read a case file; what in it is probably a slip is said on standard error, before any work where possible."""
    from jointbayes.case.plausibility import input_warnings, stated_band_hz
    from jointbayes.case.schema.case import parse_case
    from jointbayes.case.toml_text import fault_line, read_text
    from jointbayes.cli.progress import show_phase

    # what is wrong with the file itself is said before anything heavy is loaded
    text = read_text(config)
    spec = parse_case(text, str(config))
    early = input_warnings(spec, text, stated_band_hz(spec))

    def tell(warnings: "Iterable[InputWarning]") -> None:
        for warning in warnings:
            place = fault_line(str(config), warning.line, warning.key, warning.text)
            click.echo(f"jointbayes: warning: {place}", err=True)

    tell(early)
    show_phase("reading the case", on_terminal_only=True)
    from jointbayes.case.case import load_case

    case = load_case(config)
    tell(warning for warning in case.warnings if warning not in early)
    return case


def _sample(case: "Case", seed: int | None) -> "Posterior":
    from jointbayes.cli.progress import show_phase, show_progress
    from jointbayes.workflow import sample as draw

    with show_progress() as progress:
        return draw(case, seed, progress=progress, tell=show_phase)


def _note_written(path: Path) -> None:
    """Keep in mind what an interrupted command has written already."""
    click.get_current_context().meta[_WRITTEN] = path


def _print_summary(posterior: "Posterior") -> None:
    from jointbayes.posterior.verdicts import verdict_line

    if not posterior.converged:
        click.echo("NOT CONVERGED: do not use these numbers.")
    click.echo(posterior.reason)
    for name in posterior.stiffness_names:
        click.echo(verdict_line(posterior, name))
    if posterior.estimate.sentence:
        click.echo(posterior.estimate.sentence)
    if posterior.mesh is not None and not posterior.mesh.within:
        click.echo(posterior.mesh.sentence)


def _exit_by_convergence(posterior: "Posterior") -> None:
    if not posterior.converged:
        sys.exit(NOT_CONVERGED)
