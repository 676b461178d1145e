"""A case file as a structure that was never tested, and the page of what the joint of a run does in it."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas

from jointbayes.case.case_objects import CaseHome, quantities_of, reduce_imported
from jointbayes.case.case_text import CaseText, read_case_text
from jointbayes.case.parse import parse_case
from jointbayes.case.spec.structure_tables import ImportedSpec
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.errors import CaseError, JointBayesError
from jointbayes.frf import Ports
from jointbayes.inference import Nuisance
from jointbayes.joint import AnyJoint, joints_of
from jointbayes.posterior import OtherStructure, Posterior
from jointbayes.report.canvas import panels, svg
from jointbayes.report.frf_curves import frf_unit
from jointbayes.report.line_plot import SERIES_COLOURS
from jointbayes.report.markup import foreign
from jointbayes.report.model import Block, Callout, Figure, Kind, Paragraph, Report, ReportSection, Table
from jointbayes.report.run_directory import json_text
from jointbayes.rounding import json_ready, number
from jointbayes.structure import StructureRecipe
from jointbayes.studies.study_directory import settings_section, write_study
from vibrecords import Quantity

#: Tables of a case on data that there are none of.
_OF_DATA = frozenset(
    {"data", "noise", "left_out", "plan", "compare", "reference", "identification", "sampling"} | {"tests", "bodies"}
)


@dataclass(frozen=True, eq=False)
class OtherCase:
    """A structure that was never tested, and what is wanted of it.

    Parameters
    ----------
    name, title
        Of the case file.
    recipe, joint
        The structure, and where the joint holds it.
    uncertain, own
        What is uncertain of it, and which of that is its own whatever the tested structure's is.
    ports, quantity
        Lines, DOFs and quantity.
    text
        The case as one text.
    """

    name: str
    title: str
    recipe: StructureRecipe
    joint: AnyJoint
    uncertain: tuple[Nuisance, ...]
    own: frozenset[str]
    ports: Ports
    quantity: Quantity
    text: str


def read_other(path: str | os.PathLike[str], allow_outside: bool = False) -> OtherCase:
    """Read a case file that describes another structure: its structure, joint, ``[uncertain]`` and ``[predict]``.

    It may build on the case of the run by ``extends``; data and what is to be done with them do not matter.

    Raises
    ------
    CaseError
        If the file cannot be read, or something in it is wrong: file, line and key.
    """
    source = read_case_text(path, allow_outside)
    table = source.data.get("predict")
    if not isinstance(table, Mapping):
        words = "missing", "a table with outputs, inputs, f_min_hz, f_max_hz and f_step_hz", "add [predict]"
        raise CaseError(source.fault(("predict",), *words))
    spec = parse_case(_without_data(source, table))
    asked = spec.predict
    assert asked is not None
    try:
        if spec.structure.damping.measured:
            words = "found no data to take damping ratios from", "a ratio", "state structure.damping.ratio"
            raise CaseError(source.fault(("structure", "damping", "ratio"), *words))
        joint = joints_of(spec.joint_objects)
        if isinstance(spec.structure, ImportedSpec):
            dofs = (*joint.labels, *asked.outputs, *asked.inputs)
            spec = reduce_imported(spec, CaseHome(Path(path).parent, source, allow_outside), dofs, asked.f_max_hz)
        sensors = asked.outputs if spec.structure.accelerometer_mass_g > 0 else ()
        recipe = spec.structure.recipe(sensors)
        joint.require_one_place(lambda label: recipe.positions.get(label.rpartition(":")[0]))
        lines = np.array(asked.lines_hz())
        ports = Ports(lines, asked.outputs, asked.inputs)
    except CaseError:
        raise
    except JointBayesError as error:
        raise CaseError(source.fault(("structure", *getattr(error, "key", ())), str(error))) from error
    return OtherCase(Path(path).stem, spec.title or Path(path).stem, recipe, joint, *_uncertain(spec), ports,
                     asked.quantity, source.text)  # fmt: skip


def _uncertain(spec: CaseSpec) -> tuple[tuple[Nuisance, ...], frozenset[str]]:
    of_structure = [(n, own) for n, own in quantities_of(spec) if n.name != "gain"]
    return tuple(n for n, _ in of_structure), frozenset(n.name for n, own in of_structure if own)


def _without_data(source: CaseText, asked: Mapping[str, Any]) -> CaseText:
    """The case with the DOFs that are asked as channels of a measurement that is never read."""
    rest = {key: value for key, value in source.data.items() if key not in _OF_DATA}
    if isinstance(uncertain := rest.get("uncertain"), Mapping):
        rest["uncertain"] = {key: value for key, value in uncertain.items() if key not in ("gain", "model_error")}
    each = [asked.get(key) for key in ("outputs", "inputs")]
    labels = [label for some in each if isinstance(some, list) for label in some if isinstance(label, str)]
    data = {"kind": "measured_frf", "file": "never read", "channels": {label: label for label in labels or ["1:x"]}}
    # what is wrong with a DOF is told at the key that asks for it
    data |= {key: some for key, some in zip(("outputs", "inputs"), each, strict=True) if isinstance(some, list)}
    places = {path: place for path, place in source.places.items() if path[0] not in _OF_DATA}
    places |= {("data", *path[1:]): place for path, place in source.places.items() if path[0] == "predict"}
    return replace(source, data=rest | {"data": data}, places=places)


#: What the directory of a prediction holds.
A_PREDICTION = "a prediction"


def prediction_lines(found: OtherStructure) -> list[str]:
    """What is printed of a prediction."""
    lines = [f"mode {mode}: {median}, {percent(found)} interval {ends}" for mode, median, ends, _ in found.rows()]
    return [*lines, *_bands(found), *found.premises, *found.never_asked]


def percent(found: OtherStructure) -> str:
    """Probability inside each interval."""
    return f"{100 * found.frf.probability:g} %"


def _bands(found: OtherStructure) -> list[str]:
    """The highest peak of each FRF with its interval."""
    frf, lines = found.frf, []
    for i, output in enumerate(frf.outputs):
        for j, input_ in enumerate(frf.inputs):
            peak = int(frf.magnitude[:, i, j].argmax())
            low, size, high = (x[peak, i, j] for x in (frf.magnitude_low, frf.magnitude, frf.magnitude_high))
            unit = frf_unit(frf.quantity, output, input_)
            lines.append(
                f"{output} / {input_}: highest at {number(float(frf.frequency_hz[peak]), 4)} Hz, "
                f"{number(float(size), 3)} {unit} ({number(float(low), 3)} to {number(float(high), 3)})"
            )
    return lines


def build_prediction_report(found: OtherStructure, other: OtherCase, run: str) -> Report:
    """Build the report of a prediction, natural frequencies first."""
    first = found.rows()[0]
    kind: Kind = "caution" if found.never_asked else "good"
    lead: list[Block] = [
        Callout(kind, f"**The first natural frequency will be {first[1]} ({first[2]}).**"),
        Paragraph(f"The joint is taken from {foreign(run)}; this structure was never tested with it."),
        *(Callout("caution", foreign(sentence)) for sentence in found.never_asked),
    ]
    head = ("Mode", "Natural frequency", f"{percent(found)} interval", "Damping ratio")
    table = Table("Natural frequencies", head, tuple(found.rows()))
    premises = tuple(Paragraph(foreign(sentence)) for sentence in found.premises)
    return Report(
        title=f"Prediction: {foreign(other.title)}",
        subtitle=f"with the joint of {foreign(run)}",
        lead=tuple(lead),
        sections=(
            ReportSection("modes", "Natural frequencies", (table,)),
            ReportSection("frfs", "FRFs", _figures(found)),
            ReportSection("premises", "What this rests on", premises),
            settings_section(("Structure", foreign(other.recipe.what)), ("Joint of", foreign(run))),
        ),
    )


def _figures(found: OtherStructure) -> tuple[Block, ...]:
    return tuple(
        Figure(
            f"frf-{i + 1}-{j + 1}",
            f"{output} / {input_}: median and {percent(found)} band of {found.frf.quantity}.",
            f"Predicted {found.frf.quantity} of {output} by {input_}.",
            _plot(found, i, j),
        )
        for i, output in enumerate(found.frf.outputs)
        for j, input_ in enumerate(found.frf.inputs)
    )


def _plot(found: OtherStructure, i: int, j: int) -> str:
    frf = found.frf
    unit = frf_unit(frf.quantity, frf.outputs[i], frf.inputs[j])

    def draw(canvas: Canvas) -> None:
        axes = panels(canvas)[0, 0]
        low, high = frf.magnitude_low[:, i, j], frf.magnitude_high[:, i, j]
        axes.fill_between(frf.frequency_hz, low, high, color=SERIES_COLOURS[0], alpha=0.3, lw=0)
        axes.plot(frf.frequency_hz, frf.magnitude[:, i, j], color=SERIES_COLOURS[0], lw=1.2)
        axes.set_yscale("log")
        axes.set_xlabel("Frequency (Hz)")
        axes.set_ylabel(f"|H| ({unit})")

    return svg(draw, 7.2, 3.2)


def write_prediction(
    found: OtherStructure, other: OtherCase, posterior: Posterior, directory: str | os.PathLike[str]
) -> Path:
    """Write a prediction into a new directory, or one of another prediction; each file is whole or absent.

    Returns
    -------
    Path
        The directory: ``report.html``, ``report.pdf``, ``prediction.json``, ``frf.csv``, ``case.toml``, ``figures/``.

    Raises
    ------
    WriteError
        If a file cannot be written, the directory holds something else, or another process is at work in it.
    """
    run = posterior.record.case_name or posterior.problem.name
    files = {"case.toml": other.text, "frf.csv": _csv(found)}
    files["prediction.json"] = json_text(json_ready(found.as_json() | {"joint_of": run, "case": other.name}))
    return write_study(directory, A_PREDICTION, build_prediction_report(found, other, run), files)


def _csv(found: OtherStructure) -> str:
    """Magnitude with its band, and phase, of each FRF by line."""
    frf, head, columns = found.frf, ["frequency_hz"], [found.frf.frequency_hz]
    for i, output in enumerate(frf.outputs):
        for j, input_ in enumerate(frf.inputs):
            head += [f"{output}/{input_} {what}" for what in ("median", "low", "high", "phase_deg")]
            columns += [x[:, i, j] for x in (frf.magnitude, frf.magnitude_low, frf.magnitude_high, frf.phase_deg)]
    rows = np.column_stack(columns).tolist()
    return "\n".join([",".join(head), *(",".join(f"{x:.9g}" for x in row) for row in rows)]) + "\n"
