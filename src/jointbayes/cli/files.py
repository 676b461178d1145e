"""Commands on files before there is a posterior: init, validate, schema, inspect."""

import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jointbayes.cli import common
from jointbayes.cli.common import force_option, require_free
from jointbayes.cli.output import fail, manner, print_json, say, warn
from jointbayes.cli.progress_display import show_stage
from jointbayes.errors import CaseError
from jointbayes.progress import Progress

if TYPE_CHECKING:
    from jointbayes.case.case import Case
    from jointbayes.inference import Test


#: Examples that `init` writes.
_KINDS = ("clamp", "bolted", "spindle", "frame", "chain")


@click.command()
@click.argument("file", nargs=-1, type=click.Path(path_type=Path))
@click.option("--from", "measured", multiple=True, type=click.Path(path_type=Path), help="Measurement or FE model.")
@click.option("--kind", type=click.Choice(_KINDS), help="What is joined; by default a clamp.")
@common.layout_option
def init(file: tuple[Path, ...], measured: tuple[Path, ...], kind: str | None, layout: dict[str, str]) -> None:
    """Write a case to start from, by default my_case.toml.

    FILE is the case, or its directory. Without --from it is an example that runs as it stands, of the --kind: clamp
    (one end of a beam), bolted (two parts), spindle (and tool), frame, chain.

    With --from it is a case for your measurement, and for your FE model (.sti, .op4, .pch, .mtx, .rb, .npz, .mat) if
    you name that as well. It has a "?" where only you know, and a terminal asks. FILEs after --from that do not end in
    .toml are further files of yours.

    \b
    Examples:
      jointbayes init
      jointbayes init --kind bolted
      jointbayes init --from tip.csv
      jointbayes init --from tap.uff bracket.sti
    """
    from importlib.resources import files

    from vibrecords.files import write_whole_file

    cases = [path for path in file if not measured or path.suffix == ".toml" or path.is_dir()]
    if len(cases) > 1:
        raise CaseError(f"{cases[1]}: found a second case to write; expected one; write measurement files after --from")
    target = cases[0] if cases else Path("my_case.toml")
    target = target / "my_case.toml" if target.is_dir() else target
    if target.exists():
        raise CaseError(f"{target}: found a file of this name; expected a new one; choose another name")
    if target.suffix != ".toml":
        remedy = f"write {target}.toml, or make the directory first"
        raise CaseError(f"{target}: found neither a directory nor the name of a case; expected NAME.toml; {remedy}")
    require_free(target, "name")
    text = files("jointbayes.cli").joinpath(f"{kind or _KINDS[0]}.toml").read_text(encoding="utf-8")
    if measured:
        from jointbayes.case.first_case import ask, propose_case, sketch

        given = [*measured, *(path for path in file if path not in cases)]
        text = propose_case(given, target.parent, layout, text if kind else "")
        if sys.stdin.isatty() and sys.stdout.isatty() and not (manner().json or manner().quiet):
            text = ask(text, _answer)
            say(*sketch(text))
    write_whole_file(target, text.encode())
    lines = [i for i, line in enumerate(text.splitlines(), 1) if '"?' in line and not line.startswith("#")]
    manner().result |= {"case": str(target), "questions": lines}
    answer = f'answer each "?" (lines {", ".join(map(str, lines))}), then' if lines else "next"
    say(f"Case: {target}; {answer}: jointbayes run {target}")


def _answer(question: str, form: Callable[[str], str]) -> str:
    """An answer from the terminal, as TOML; Enter alone leaves it open."""

    def understood(answer: str) -> str:
        try:
            return form(answer) if answer.strip() else ""
        except ValueError as error:
            raise click.UsageError(f"found {answer!r}; {error}") from None

    return str(click.prompt(f"{question} (Enter: later)", default="", show_default=False, value_proc=understood))


@click.command("inspect")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--figure", type=click.Path(path_type=Path), help="SVG file to draw FRFs and hits into.")
@click.option("--mass", type=click.FloatRange(min=0, min_open=True), help="Mass of a structure that hangs free, kg.")
@click.option("--band", nargs=2, type=click.FloatRange(min=0), help="Seek resonances from LOW to HIGH only, Hz.",
              metavar="LOW HIGH")  # fmt: skip
@click.option("--conjugate", is_flag=True, help="Take the complex conjugates of the FRFs, as [data] of a case may.")
@common.layout_option
@force_option
def inspect_command(
    file: Path,
    figure: Path | None,
    mass: float | None,
    band: tuple[float, float] | None,
    conjugate: bool,
    layout: dict[str, str],
) -> None:
    """List what a measurement file holds, and warn of what looks wrong in it; then look for resonances.

    \b
    Examples:
      jointbayes inspect tip.csv
      jointbayes inspect hits.uff --band 20 2500 --figure hits.svg
    """
    show_stage(Progress("reading the file", str(file)), on_terminal_only=not file.is_file())
    from vibrecords.files import WRITTEN_BY, write_whole_file
    from vibrecords.inspection import contents_text, inspect_file, resonances_text, with_resonances

    if figure is not None:
        manner().read.append(file)
        require_free(figure, "--figure")
    if band and not band[0] < band[1]:
        raise CaseError(f"--band: found {band[0]:g} {band[1]:g}; expected LOW below HIGH, in Hz; exchange them")
    band_hz = band or (None, None)
    inspection = inspect_file(file, mass, conjugate=conjugate, band_hz=band_hz, layout=layout, resonances=False)
    say(*contents_text(inspection))
    if inspection.frfs:
        show_stage(Progress("fitting resonances", f"{inspection.frfs[0].frequency_hz.size} lines"))
    inspection = with_resonances(inspection, band_hz)
    say(*resonances_text(inspection))
    manner().result |= {"file": inspection.source, "format": inspection.form, "records": dict(inspection.kinds)}
    manner().result |= {"channels": list(inspection.channels), "averages": list(inspection.averages)}
    manner().result["doubts"] = [asdict(warning) for warning in inspection.warnings]
    manner().result["resonances"] = [asdict(mode) for mode in inspection.modes]
    if figure is not None:
        from jointbayes.report.inspect_figure import inspect_figure

        traces = [(f"{t.channel} hit {t.hit.number}", t.hit.reason, t.time_s, t.force_n) for t in inspection.hits]
        drawn = inspect_figure(inspection.frfs, inspection.modes, traces)
        write_whole_file(figure, f"{drawn}<!-- {WRITTEN_BY} -->\n".encode())
        say(f"Figure: {figure}")


@click.command()
@click.argument("cases", nargs=-1, required=True, type=click.Path(path_type=Path))
@common.outside_option
def validate(cases: tuple[Path, ...]) -> None:
    """Check case files and their data without any analysis: print what was understood, or every fault.

    Exit status: 0 if all of them are valid, 2 if not. Warnings are values that are probably slips.

    \b
    Examples:
      jointbayes validate my_case.toml
      jointbayes validate configs/*.toml --json
    """
    told, entries = manner().told, manner().result.setdefault("cases", [])
    for path in cases:
        at = len(told["warnings"])
        try:
            case = common.load(path)
        except CaseError as error:
            fail(str(error), show_source=True)
            entries.append({"file": str(path), "valid": False})
            continue
        for doubt in (d for test in case.problem.tests for d in getattr(test.data.provenance, "warnings", ())):
            warn(f"{doubt.where}: {doubt.sentence}", doubt.remedy, code=doubt.key)
        warnings = told["warnings"][at:]
        entries.append({"file": str(path), "valid": True, "warnings": warnings, "understood": _understood(case)})
        say(f"{path}: valid, {f'warnings: {len(warnings)}' if warnings else 'no warnings'}; {case.title}")
        for line in _understood(case):
            say(f"  {line}")
    if told["errors"]:
        sys.exit(common.BAD_INPUT)


def _understood(case: "Case") -> list[str]:
    """What a case says, line by line: structure, joints, data and noise of each test; unknowns."""
    import numpy as np

    from jointbayes.posterior.summary import specimen_line
    from jointbayes.rounding import number

    rows = [line for line in (specimen_line(case.about),) if line]
    for test in case.problem.tests:
        materials = _materials(test)
        rows += [f"test: {test.name}"] if test.name else []
        rows.append(f"structure: {_structure_in_words(test, materials)}")
        rows += [f"joint: {joint}" for joint in test.joints.joints] or [f"joint: {test.joints}"]
        rows.append(f"data: {test.data.in_full}")
        rows.append(f"noise: {'Gaussian' if test.noise is None else _kind_in_words(test.noise)}")
        if getattr(getattr(test.structures, "recipe", None), "kind", "") != "beam":
            for words, of in materials.items():
                which = f" of {', '.join(dict.fromkeys(of))}" if len(materials) > 1 else ""
                rows.append(f"material and section{which}: {words}")
        rows += _places(test)
    prior = case.problem.prior
    theta = prior.sample(np.random.default_rng(0), 20_000)  # as the report: what no joint can be is cut off
    values = np.column_stack([prior.values(theta), prior.nuisance_values(theta)])
    units = {quantity.name: quantity.unit for quantity in prior.parametrisation.quantities}
    units |= {nuisance.name: nuisance.unit for nuisance in prior.nuisances}
    for (name, unit), column in zip(units.items(), values.T, strict=True):
        low, high = (number(float(end), 3) for end in np.quantile(column, [0.025, 0.975]))
        rows.append(f"unknown {name}: 95 % of the prior from {low} to {high}{'' if unit == '1' else f' {unit}'}")
    return rows


def _kind_in_words(thing: object) -> str:
    """Name of a class in words: ``"modal damping"``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(thing).__name__).capitalize()


def _structure_in_words(test: "Test", materials: Mapping[str, object]) -> str:
    """What the structure is, its damping, its measured bodies and what is uncertain."""
    from jointbayes.phrases import listed
    from jointbayes.structure.recipe import is_damping_ratio

    body, recipe = test.structures, getattr(test.structures, "recipe", None)
    parts = [f"{body.n_dofs} DOFs" if recipe is None else recipe.what]
    parts = [f"beam {parts[0]}", *materials] if getattr(recipe, "kind", "") == "beam" else parts
    parts.append(_kind_in_words((recipe or body).damping).lower())
    for measured in test.measured_bodies:
        f = measured.frequency_hz
        parts.append(f"{measured.name}: {', '.join(measured.dofs)}, {f.size} lines from {f[0]:g} to {f[-1]:g} Hz")
    ratios = [name for name in body.names if is_damping_ratio(name)]
    names = [name for name in body.names if name not in ratios[1:]]
    if len(ratios) > 1:
        first, last = (ratio.rpartition("_")[2] for ratio in (ratios[0], ratios[-1]))
        names[names.index(ratios[0])] = f"damping of modes {first} to {last}"
    return ", ".join(parts) + (f"; uncertain: {listed(names)}" if names else "")


def _materials(test: "Test") -> dict[str, list[str]]:
    """Names of the bodies, or ends of the members, of each material and section in words."""
    from jointbayes.structure.frame_recipe import MemberRecipe

    recipe, alike = getattr(test.structures, "recipe", None), dict[str, list[str]]()
    for name, body in recipe.bodies if isinstance(recipe, MemberRecipe) else ():
        for member in body.members:
            made, section = member.material, member.section
            sizes = [f"{1e3 * size:g}" for size in section.dimensions if size]
            shape = "circle" if section.shape == "tube" and len(sizes) == 1 else section.shape
            words = f"{shape} {' × '.join(sizes)} mm, E {made.youngs_modulus / 1e9:g} GPa, {made.density:g} kg/m³"
            alike.setdefault(words, []).append(name or f"{member.points[0]} to {member.points[-1]}")
    return alike


def _places(test: "Test") -> Iterator[str]:
    """Where the DOFs are at which something acts or is seen."""
    from jointbayes.structure.frame_recipe import MemberRecipe

    recipe = getattr(test.structures, "recipe", None)
    members = recipe if isinstance(recipe, MemberRecipe) else None  # which need no mesh to tell
    at: dict[str, list[str]] = {}
    for label in dict.fromkeys((*test.joints.labels, *test.data.dofs)):
        place = members.positions.get(label.rpartition(":")[0]) if members else test.structures.position(label)
        if place is not None:
            x, *across = (f"{1e3 * number:.6g}" for number in place)
            at.setdefault(f"{x} mm" if not any(place[1:]) else f"({x}, {', '.join(across)}) mm", []).append(label)
    for where, labels in at.items():
        yield f"at {where}: {', '.join(labels)}"


@click.command()
def schema() -> None:
    """Print the JSON Schema of case files, by which editors complete keys and check them.

    \b
    Examples:
      jointbayes schema > case.schema.json
    """
    from jointbayes.case.json_schema import case_schema

    print_json(case_schema())
    manner().json = False  # it is that one object
