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
from jointbayes.case.spec.settings_tables import LobesSpec
from jointbayes.case.spec.structure_tables import ImportedSpec
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.errors import CaseError, JointBayesError, ModelError
from jointbayes.frf import Ports
from jointbayes.inference import Nuisance
from jointbayes.joint import AnyJoint, joints_of
from jointbayes.phrases import listed
from jointbayes.posterior import OtherStructure, Posterior
from jointbayes.report.canvas import panels, svg
from jointbayes.report.markup import Kind, foreign
from jointbayes.report.model import SERIES_COLOURS, Block, Callout, Figure, Paragraph, Report, ReportSection, Table
from jointbayes.report.run_directory import json_text
from jointbayes.report.sections.fit_to_data import frf_unit
from jointbayes.rounding import json_ready, number
from jointbayes.structure import StructureRecipe
from jointbayes.studies.lobes import Cut, Lobes, limiting_depth
from jointbayes.studies.study_directory import settings_section, write_study
from vibrecords import Quantity
from vibrecords.arrays import Array

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
        What is uncertain of it, and which of these quantities it does not share with the tested structure.
    ports, quantity
        Lines, DOFs and quantity.
    text
        The case as one text.
    lobes
        A milling cut whose stability lobes are wanted, if any.
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
    lobes: LobesSpec | None = None


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
            cut = (asked.lobes.x, asked.lobes.y) if asked.lobes else ()
            dofs = (*joint.labels, *asked.outputs, *asked.inputs, *cut)
            spec = reduce_imported(spec, CaseHome(Path(path).parent, source, allow_outside), dofs, asked.f_max_hz)
        sensors = asked.outputs if spec.structure.accelerometer_mass_g > 0 else ()
        recipe = spec.structure.recipe(sensors)
        joint.require_one_place(lambda label: recipe.positions.get(label.rpartition(":")[0]))
        for key, dof in (("x", asked.lobes.x), ("y", asked.lobes.y)) if asked.lobes else ():
            try:
                recipe.structure().index((dof,))
            except ModelError as error:
                raise CaseError(source.fault(("predict", "lobes", key), str(error))) from error
        ports = Ports(np.array(asked.lines_hz()), asked.outputs, asked.inputs)
    except CaseError:
        raise
    except JointBayesError as error:
        raise CaseError(source.fault(("structure", *getattr(error, "key", ())), str(error))) from error
    return OtherCase(Path(path).stem, spec.title or Path(path).stem, recipe, joint, *_uncertain(spec), ports,
                     asked.quantity, source.text, asked.lobes)  # fmt: skip


#: Distance of the lines of lobes, Hz: on lines of 2 Hz the limiting depth was up to 1.4 % too large.
_LOBE_STEP_HZ = 0.25
_LOBE_DRAWS, _SPEEDS = 200, 400


def predict_lobes(posterior: Posterior, other: OtherCase, test: str | None = None) -> Lobes | None:
    """Stability lobes of the cut that ``[predict.lobes]`` asks for, of draws; None where it asks for none.

    FRFs of both directions come from the same draws; the cutting coefficients are taken as exact.
    """
    if (asked := other.lobes) is None:
        return None
    band = other.ports.frequency_hz
    lines = np.arange(band[0], band[-1] + _LOBE_STEP_HZ / 2, _LOBE_STEP_HZ)
    frfs = {
        dof: posterior.predict(
            other.recipe, Ports(lines, (dof,), (dof,)), other.joint, uncertain=other.uncertain, own=other.own,
            test=test, max_draws=_LOBE_DRAWS,
        ).values[:, :, 0, 0]
        for dof in dict.fromkeys((asked.x, asked.y))
    }  # fmt: skip
    cut = Cut(asked.teeth, 1e6 * asked.kt_mpa, asked.kr, asked.immersion, asked.milling == "up")
    speeds = np.linspace(asked.speed_min_rpm, asked.speed_max_rpm, _SPEEDS)
    each = zip(frfs[asked.x], frfs[asked.y], strict=True)
    return Lobes(speeds, np.array([limiting_depth(cut, lines, x, y, speeds) for x, y in each]))


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
    # a wrong DOF is reported at the key that asks for it
    data |= {key: some for key, some in zip(("outputs", "inputs"), each, strict=True) if isinstance(some, list)}
    places = {path: place for path, place in source.places.items() if path[0] not in _OF_DATA}
    places |= {("data", *path[1:]): place for path, place in source.places.items() if path[0] == "predict"}
    return replace(source, data=rest | {"data": data}, places=places)


#: What the directory of a prediction holds.
A_PREDICTION = "a prediction"


def prediction_lines(found: OtherStructure, posterior: Posterior, lobes: Lobes | None = None) -> list[str]:
    """What is printed of a prediction."""
    lines = [f"mode {mode}: {median}, {percent(found)} interval {ends}" for mode, median, ends, _ in found.rows()]
    cut = lobes.lines() if lobes else []
    return [*lines, *_bands(found), *cut, *joint_sentences(posterior), *found.premises, *found.never_asked]


def _run_of(posterior: Posterior) -> str:
    return posterior.record.case_name or posterior.problem.name


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


def build_prediction_report(
    found: OtherStructure, other: OtherCase, posterior: Posterior, lobes: Lobes | None = None
) -> Report:
    """Build the report of a prediction, natural frequencies first."""
    run = _run_of(posterior)
    first = found.rows()[0]
    cautions = (*joint_sentences(posterior), *found.never_asked)
    kind: Kind = "caution" if cautions else "good"
    lead: list[Block] = [
        Callout(kind, f"**The first natural frequency will be {first[1]} ({first[2]}).**"),
        Paragraph(f"The joint is taken from {foreign(run)}; this structure was never tested with it."),
        *(Callout("caution", foreign(sentence)) for sentence in cautions),
    ]
    head = ("Mode", "Natural frequency", f"{percent(found)} interval", "Damping ratio")
    table = Table("Natural frequencies", head, tuple(found.rows()))
    verdicts = {name: posterior.verdict(name) for name in posterior.stiffness_names}
    joint = Table(
        "The joint that is taken over",
        ("Stiffness", "Median and 95 % interval", "Verdict", "Without these premises"),
        tuple((foreign(name), each.value, each.words, each.next_to_it) for name, each in verdicts.items()),
        align="llll",
    )
    premises = tuple(Paragraph(foreign(sentence)) for sentence in found.premises)
    sections = [
        ReportSection("modes", "Natural frequencies", (table,)),
        ReportSection("frfs", "FRFs", _figures(found)),
        ReportSection("premises", "What this rests on", (joint, *premises)),
        settings_section(("Structure", foreign(other.recipe.what)), ("Joint of", foreign(run))),
    ]
    if lobes is not None:
        sections.insert(2, ReportSection("lobes", "Stability lobes", _lobe_blocks(lobes, other)))
    return Report(
        title=f"Prediction: {foreign(other.title)}",
        subtitle=f"with the joint of {foreign(run)}",
        lead=tuple(lead),
        sections=tuple(sections),
    )


def joint_sentences(posterior: Posterior) -> tuple[str, ...]:
    """What the verdicts on the joint mean for a prediction; empty where each stiffness is identified as it is used.

    A premise that a verdict needs is one that the prediction needs: without it the draws of the joint would lie wider.
    """
    verdicts = {name: posterior.verdict(name) for name in posterior.stiffness_names}
    sentences, by_premises = [], dict[str, list[str]]()
    for name, verdict in verdicts.items():
        if verdict.if_exact:
            by_premises.setdefault(verdict.if_exact, []).append(name)
    for words, names in by_premises.items():
        held = ", ".join(f"{name} is {verdicts[name].plain_words}" for name in names)
        without = "; ".join(f"{name} {verdicts[name].next_to_it}" for name in names if verdicts[name].next_to_it)
        sentences.append(f"The prediction holds {words}. Only then {held}.{without and f' {without}.'}")
    if loose := [name for name, verdict in verdicts.items() if verdict.cls in ("not identified", "no verdict")]:
        sentences.append(
            f"{listed(loose)} {'is' if len(loose) == 1 else 'are'} not known from the test. Where this structure loads "
            f"{'it' if len(loose) == 1 else 'them'} more than the tested one did, the prior decides the prediction."
        )
    return tuple(sentences)


def _lobe_blocks(lobes: Lobes, other: OtherCase) -> tuple[Block, ...]:
    asked = other.lobes
    assert asked is not None
    low, inner_low, median, inner_high, high = 1e3 * lobes.bands

    def draw(canvas: Canvas) -> None:
        axes = panels(canvas)[0, 0]
        axes.fill_between(lobes.speeds, low, high, color=SERIES_COLOURS[0], alpha=0.2, lw=0, label="95 %")
        axes.fill_between(lobes.speeds, inner_low, inner_high, color=SERIES_COLOURS[0], alpha=0.4, lw=0, label="50 %")
        axes.plot(lobes.speeds, median, color=SERIES_COLOURS[0], lw=1.2, label="median")
        finite = low[np.isfinite(low)]
        axes.set(xlabel="Spindle speed (rev/min)", ylabel="Limiting depth of cut (mm)")
        axes.set_ylim(0, 1.3 * float(finite.max()) if finite.size else 1)
        axes.legend(loc="upper left")

    text = "Depth of cut at which chatter begins: median, 50 and 95 % bands of the draws."
    cut = (
        f"{asked.teeth} teeth, {asked.milling} milling with {100 * asked.immersion:g} % of the diameter, "
        f"K_t = {asked.kt_mpa:g} MPa and K_r = {asked.kr:g}, taken as exact. Altintas and Budak (1995), zero order."
    )
    head = ("Speed (rev/min)", "Limiting depth (mm)", "50 % interval (mm)", "95 % interval (mm)")
    table = Table("The least depth, and the deepest lobes", head, tuple(lobes.rows()))
    return Figure("stability-lobes", text, text, svg(draw, 7.2, 3.6)), table, Paragraph(cut)


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
    found: OtherStructure,
    other: OtherCase,
    posterior: Posterior,
    directory: str | os.PathLike[str],
    lobes: Lobes | None = None,
) -> Path:
    """Write a prediction into a new directory, or one of another prediction; each file is whole or absent.

    Returns
    -------
    Path
        The directory: ``report.html``, ``report.pdf``, ``prediction.json``, ``frf.csv``, ``case.toml``, ``figures/``;
        with lobes ``lobes.csv``, the points at 2.5, 25, 50, 75 and 97.5 % of the depth by speed.

    Raises
    ------
    WriteError
        If a file cannot be written, the directory holds something else, or another process is at work in it.
    """
    files = {"case.toml": other.text, "frf.csv": _csv(found)}
    if lobes is not None:
        head = ["speed_rpm", *(f"depth_mm {percent}" for percent in ("2.5 %", "25 %", "median", "75 %", "97.5 %"))]
        files["lobes.csv"] = _table_text(head, [lobes.speeds, *(1e3 * lobes.bands)])
    named = {"joint_of": _run_of(posterior), "case": other.name, "joint": list(joint_sentences(posterior))}
    files["prediction.json"] = json_text(json_ready(found.as_json() | named))
    return write_study(directory, A_PREDICTION, build_prediction_report(found, other, posterior, lobes), files)


def _csv(found: OtherStructure) -> str:
    """Magnitude with its band, and phase, of each FRF by line."""
    frf, head, columns = found.frf, ["frequency_hz"], [found.frf.frequency_hz]
    for i, output in enumerate(frf.outputs):
        for j, input_ in enumerate(frf.inputs):
            head += [f"{output}/{input_} {what}" for what in ("median", "low", "high", "phase_deg")]
            columns += [x[:, i, j] for x in (frf.magnitude, frf.magnitude_low, frf.magnitude_high, frf.phase_deg)]
    return _table_text(head, columns)


def _table_text(head: list[str], columns: list[Array]) -> str:
    rows = np.column_stack(columns).tolist()
    return "\n".join([",".join(head), *(",".join(f"{x:.9g}" for x in row) for row in rows)]) + "\n"
