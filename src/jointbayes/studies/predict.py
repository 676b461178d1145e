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
    uncertain = [(nuisance, own) for nuisance, own in quantities_of(spec) if nuisance.name != "gain"]
    of_all, of_own = tuple(n for n, _ in uncertain), frozenset(n.name for n, own in uncertain if own)
    name, quantity = Path(path).stem, asked.quantity
    return OtherCase(name, spec.title or name, recipe, joint, of_all, of_own, ports, quantity, source.text, asked.lobes)


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
    frf = found.frf
    for i, j in np.ndindex(frf.magnitude.shape[1:]):  # the highest peak of each FRF
        peak, ends = int(frf.magnitude[:, i, j].argmax()), (frf.magnitude, frf.magnitude_low, frf.magnitude_high)
        size, low, high = (number(float(values[peak, i, j]), 3) for values in ends)
        between, at = f"{frf.outputs[i]} / {frf.inputs[j]}", number(float(frf.frequency_hz[peak]), 4)
        unit = frf_unit(frf.quantity, frf.outputs[i], frf.inputs[j])
        lines.append(f"{between}: highest at {at} Hz, {size} {unit} ({low} to {high})")
    cut = lobes.lines() if lobes else []
    return [*lines, *cut, *joint_sentences(posterior), *found.premises, *found.never_asked]


def _run_of(posterior: Posterior) -> str:
    return posterior.record.case_name or posterior.problem.name


def percent(found: OtherStructure) -> str:
    """Probability inside each interval."""
    return f"{100 * found.frf.probability:g} %"


def build_prediction_report(
    found: OtherStructure, other: OtherCase, posterior: Posterior, lobes: Lobes | None = None
) -> Report:
    """Build the report of a prediction, natural frequencies first."""
    # 1. The first natural frequency, and what it rests on
    run, frf, first = _run_of(posterior), found.frf, found.rows()[0]
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
    # 2. Figures of the FRFs
    figures = []
    for i, j in np.ndindex(frf.magnitude.shape[1:]):
        output, input_ = between = frf.outputs[i], frf.inputs[j]
        low, median, high = (values[:, i, j] for values in (frf.magnitude_low, frf.magnitude, frf.magnitude_high))
        axes = {"yscale": "log", "xlabel": "Frequency (Hz)", "ylabel": f"|H| ({frf_unit(frf.quantity, *between)})"}
        drawing = _drawn(frf.frequency_hz, median, [("", 0.3, low, high)], 3.2, **axes)
        about = f"{output} / {input_}: median and {percent(found)} band of {frf.quantity}."
        what = f"Predicted {frf.quantity} of {output} by {input_}."
        figures.append(Figure(f"frf-{i + 1}-{j + 1}", about, what, drawing))
    sections = [
        ReportSection("modes", "Natural frequencies", (table,)),
        ReportSection("frfs", "FRFs", tuple(figures)),
        ReportSection("premises", "What this rests on", (joint, *premises)),
        settings_section(("Structure", foreign(other.recipe.what)), ("Joint of", foreign(run))),
    ]
    # 3. The lobes of a milling cut
    if lobes is not None and (asked := other.lobes) is not None:
        low, inner_low, median, inner_high, high = 1e3 * lobes.bands
        bands, most = [("95 %", 0.2, low, high), ("50 %", 0.4, inner_low, inner_high)], low[np.isfinite(low)]
        axes = {"xlabel": "Spindle speed (rev/min)", "ylabel": "Limiting depth of cut (mm)"}
        ends = (0, 1.3 * float(most.max()) if most.size else 1)
        drawing = _drawn(lobes.speeds, median, bands, 3.6, **axes, ylim=ends)
        text = "Depth of cut at which chatter begins: median, 50 and 95 % bands of the draws."
        cut = (
            f"{asked.teeth} teeth, {asked.milling} milling with {100 * asked.immersion:g} % of the diameter, "
            f"K_t = {asked.kt_mpa:g} MPa and K_r = {asked.kr:g}, taken as exact. Altintas and Budak (1995), zero order."
        )
        head = ("Speed (rev/min)", "Limiting depth (mm)", "50 % interval (mm)", "95 % interval (mm)")
        deepest = Table("The least depth, and the deepest lobes", head, tuple(lobes.rows()))
        blocks = Figure("stability-lobes", text, text, drawing), deepest, Paragraph(cut)
        sections.insert(2, ReportSection("lobes", "Stability lobes", blocks))
    return Report(
        title=f"Prediction: {foreign(other.title)}",
        subtitle=f"with the joint of {foreign(run)}",
        lead=tuple(lead),
        sections=tuple(sections),
    )


def _drawn(x: Array, median: Array, bands: list[tuple[str, float, Array, Array]], height: float, **axes: Any) -> str:  # noqa: ANN401
    """SVG of a median over bands, each with its label, its opacity and its ends."""

    def draw(canvas: Canvas) -> None:
        panel, colour = panels(canvas)[0, 0], SERIES_COLOURS[0]
        for label, opacity, low, high in bands:
            panel.fill_between(x, low, high, color=colour, alpha=opacity, lw=0, label=label)
        panel.plot(x, median, color=colour, lw=1.2, label="median")
        panel.set(**axes)
        if len(bands) > 1:
            panel.legend(loc="upper left")

    return svg(draw, 7.2, height)


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
    frf, head, columns = found.frf, ["frequency_hz"], [found.frf.frequency_hz]
    for i, j in np.ndindex(frf.magnitude.shape[1:]):
        head += [f"{frf.outputs[i]}/{frf.inputs[j]} {what}" for what in ("median", "low", "high", "phase_deg")]
        columns += [x[:, i, j] for x in (frf.magnitude, frf.magnitude_low, frf.magnitude_high, frf.phase_deg)]
    files = {"case.toml": other.text, "frf.csv": _table_text(head, columns)}
    if lobes is not None:
        head = ["speed_rpm", *(f"depth_mm {percent}" for percent in ("2.5 %", "25 %", "median", "75 %", "97.5 %"))]
        files["lobes.csv"] = _table_text(head, [lobes.speeds, *(1e3 * lobes.bands)])
    named = {"joint_of": _run_of(posterior), "case": other.name, "joint": list(joint_sentences(posterior))}
    files["prediction.json"] = json_text(json_ready(found.as_json() | named))
    return write_study(directory, A_PREDICTION, build_prediction_report(found, other, posterior, lobes), files)


def _table_text(head: list[str], columns: list[Array]) -> str:
    rows = np.column_stack(columns).tolist()
    return "\n".join([",".join(head), *(",".join(f"{x:.9g}" for x in row) for row in rows)]) + "\n"
