"""What a posterior says, for other programs: predicted FRFs with their band, modes, and the joint as cards."""

import os
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import ModelError
from jointbayes.frf import AssembledShapes, Modal
from jointbayes.inference import Problem
from jointbayes.posterior import Posterior
from jointbayes.posterior.identifiability import CERTAINTY
from jointbayes.posterior.phrases import not_converged
from jointbayes.posterior.verdicts import lines_of
from jointbayes.report.fe_cards import PROGRAMS, JointElement, Units, ascii_lines, fe_cards, joint_element
from jointbayes.reproducibility import one_blas_thread
from vibrecords.arrays import Array
from vibrecords.files import whole_file, write_whole_file
from vibrecords.formats.array_files import write_matlab
from vibrecords.formats.uff_write import write_uff
from vibrecords.formats.units import si_frf_unit
from vibrecords.formats.write import arrays_of, write_table
from vibrecords.records import FrfRecord, ModeRecord, SpectrumRecord, dof_label, parse_dof

#: Measurement formats that FRFs and modes are written in.
FILES = ("uff58", "uff58b", "mat", "csv")
_IN_MM = {"N/m": (1e-3, "N/mm"), "N·m/rad": (1e3, "N·mm/rad")}
_FEWEST_MODES, _MOST_MODES, _DRAWS = 3, 20, 400


@one_blas_thread()
def export(
    posterior: Posterior,
    path: str | os.PathLike[str],
    form: str,
    *,
    test: str | None = None,
    units: Units = "SI",
    nodes: Mapping[str, int] | None = None,
    first_id: int = 900001,
) -> tuple[str, ...]:
    """Write what a posterior says into a file of another program, and say what was written.

    FRFs are the median of the draws, line by line; both ends of the 95 % band of its magnitude stand beside them, as
    functions of their own that are no FRFs. Natural frequencies and damping ratios are medians and standard deviations
    of the draws. Shapes and cards are those of the joint of the medians, or of the joint mode where no joint has these.

    Parameters
    ----------
    posterior
        The posterior.
    path
        The file, written whole or not at all.
    form
        ``"uff58"``, ``"uff58b"``, ``"mat"`` or ``"csv"`` for FRFs and modes (csv: FRFs alone), ``"nastran"``,
        ``"abaqus"``, ``"calculix"`` or ``"ansys"`` for cards of the joint.
    test
        Name of the test, where there are several; by default the first.
    units
        Of the cards: ``"SI"`` or ``"mm-N-t"``. Measurement files are in SI units.
    nodes
        Number of each node, where its name in the DOF labels is none: ``{"footA": 17}``.
    first_id
        Number of the first element, property and node that cards make.

    Raises
    ------
    ModelError
        If the format is unknown, a node has no number, or there is nothing to write.
    WriteError
        If the file cannot be written.
    """
    part, numbers, target = posterior.problem.part(test), dict(nodes or {}), Path(path)
    if form not in (*FILES, *PROGRAMS):
        raise ModelError(f"export: found format {form!r}; expected one of {', '.join((*FILES, *PROGRAMS))}; correct it")
    theta, of = central_joint(posterior)
    stiffness = part.parametrisation.matrix(part.prior.values(theta)).stiffness
    said = [f"Joint of {posterior.problem.name}: the {of}.", *_joint_lines(posterior, part, theta, units)]
    if form in PROGRAMS:
        elements, rigid = _elements(part, stiffness, units, numbers)
        write_whole_file(target, fe_cards(form, elements, [*said, *rigid], units, first_id).encode())
        return (f"Cards for {form} of the {of}: {part.test.joints}",)
    dofs = tuple(dict.fromkeys((*part.test.data.dofs, *part.test.joints.labels)))
    universal = form.startswith("uff")
    labels = _numbered_labels(dofs, numbers) if universal else dict(zip(dofs, dofs, strict=True))
    frfs, ends, band = ((), (), {}) if part.test.data.shown_frfs is None else _frfs(posterior, test, labels)
    modes = _modes(posterior, test, theta, labels)
    if not frfs and (form == "csv" or not modes):
        raise ModelError(
            f"export: found {part.test.data.words} as data, and no FRFs for {form}; expected FRFs; choose uff58 or mat"
        )
    said += [f"mode {m.number}: {m.frequency_hz!r} Hz, damping ratio {m.damping_ratio!r}" for m in modes]
    said += [f"node {number} is {name}" for name, number in numbers.items() if universal]
    with whole_file(target) as temporary:
        if form == "csv":
            write_table((*frfs, *ends), temporary, ",", ascii_lines(said))
        elif form == "mat":
            write_matlab(arrays_of(frfs) | band | _blocks(posterior, part, stiffness, modes), temporary)
        else:
            write_uff((*frfs, *ends, *modes), temporary, binary=form == "uff58b", remarks=ascii_lines(said))
    medians = f"{len(frfs)} FRFs: the median; with each both ends of its 95 % band, which are no FRFs"
    shapes = f"{len(modes)} modes: medians of the draws, shapes of the {of}"
    return (*([medians] if frfs else []), *([shapes] if modes else []))


def central_joint(posterior: Posterior) -> tuple[Array, str]:
    """θ, shape (d,), at the medians of all quantities, and what it is; the joint mode where no joint has them."""
    prior, medians = posterior.problem.prior, np.median(posterior.stiffness, axis=0)
    if not prior.parametrisation.describes(medians):
        return posterior.mode_theta, "joint mode (no passive joint has the medians)"
    rest = [float(n.coordinate(np.median(posterior.values(n.name)))) for n in prior.nuisances]
    return np.concatenate([prior.parametrisation.coordinates(medians), rest]), "joint of the medians"


def _frfs(
    posterior: Posterior, test: str | None, labels: Mapping[str, str]
) -> tuple[tuple[FrfRecord, ...], tuple[SpectrumRecord, ...], dict[str, dict[str, Any]]]:
    """The median of each FRF, both ends of the band of its magnitude, and these as arrays: lines, outputs, inputs."""
    band = posterior.predict_frf(test=test)
    turn: NDArray[np.complex128] = np.exp(1j * np.deg2rad(band.phase_deg))
    line, unit = band.frequency_hz, si_frf_unit(band.quantity)
    sizes = {"lower end of 95 %": band.magnitude_low, "upper end of 95 %": band.magnitude_high}
    frfs, ends = [], []
    for (i, output), (j, input_) in product(enumerate(band.outputs), enumerate(band.inputs)):
        pair = labels[output], labels[input_]
        frfs.append(FrfRecord(*pair, line, (band.magnitude * turn)[:, i, j], band.quantity, unit))
        ends += [
            SpectrumRecord(pair[0], f"{end} / {pair[1]}", line, size[:, i, j], unit) for end, size in sizes.items()
        ]
    return tuple(frfs), tuple(ends), {"band95": {"low": band.magnitude_low, "high": band.magnitude_high}}


def _modes(posterior: Posterior, test: str | None, theta: Array, labels: Mapping[str, str]) -> tuple[ModeRecord, ...]:
    """Lowest modes with unit modal mass at these DOFs of the model; none of a structure with a measured body."""
    part = posterior.problem.part(test)
    one, most, dofs = part.test, min(_MOST_MODES, part.test.most_modes), tuple(labels)
    if most < 1:
        return ()

    def modal_at(rows: Array, count: int) -> Modal:
        return AssembledShapes(one.structures, one.joints, count, dofs).modes(
            part.parametrisation.matrix(part.prior.values(rows)), part.structural(part.prior.factors(rows))
        )

    modal = modal_at(theta[None], most)
    count = min(most, max(_FEWEST_MODES, int((modal.frequency_hz[0] <= one.data.top_hz).sum())))
    frequency_hz = posterior.predict_natural_frequencies(count, test=test)  # those of page one
    damping_ratio = modal_at(posterior.thinned(_DRAWS), count).damping_ratio
    modes = []
    for n in range(count):
        middles = _median_and_sd(frequency_hz[:, n]), _median_and_sd(damping_ratio[:, n])
        shape = dict(zip(labels.values(), modal.shapes[0, n].astype(complex).tolist(), strict=True))
        modes.append(ModeRecord(n + 1, *middles[0], *middles[1], shape, 1.0))
    return tuple(modes)


def _median_and_sd(values: Array) -> tuple[float, float | None]:
    """Median and standard deviation; no deviation of what the model holds fixed, but for rounding."""
    sd = float(values.std())
    return float(np.median(values)), sd if sd > 1e-9 * float(np.abs(values).max()) else None


def _numbered_labels(dofs: tuple[str, ...], nodes: dict[str, int]) -> dict[str, str]:
    """Labels of DOFs as a universal file has them; a node without a number gets one in `nodes` that is free."""
    names = {dof: dof.rpartition(":")[0] for dof in dofs}
    taken = {0, *nodes.values(), *(int(name) for name in names.values() if name.isdigit() and name not in nodes)}
    labels = {}
    for dof, name in names.items():
        if not name.isdigit() and name not in nodes:
            nodes[name] = max(taken) + 1
            taken.add(nodes[name])
        numbered = f"{nodes.get(name, name)}:{dof.rpartition(':')[2]}"
        parsed = parse_dof(numbered)
        labels[dof] = numbered if parsed is None else dof_label(parsed)
    return labels


def _elements(
    part: Problem, stiffness: Array, units: Units, nodes: Mapping[str, int]
) -> tuple[list[JointElement], list[str]]:
    """The joints in the units of the cards, and what is said of each."""
    row, elements, said = 0, [], []
    for joint in part.test.joints.joints:
        rows = slice(row, row + joint.size)
        rigid = [i - row for i in part.parametrisation.held if row <= i < rows.stop]
        elements.append(joint_element(joint, stiffness[rows, rows], rigid, units, nodes))
        said.append(f"Joint {joint}.")
        said += [f"{joint.dofs[i]} IS HELD RIGID AND NOT ON THESE CARDS: ADD A RIGID ELEMENT." for i in rigid]
        row = rows.stop
    return elements, said


def _joint_lines(posterior: Posterior, part: Problem, theta: Array, units: Units) -> list[str]:
    """Value, interval and verdict of each quantity, in capitals where it is not known."""
    said = [] if posterior.converged else [not_converged(posterior.reason)]
    for quantity, value in zip(part.parametrisation.quantities, part.prior.values(theta), strict=True):
        if not quantity.places:
            continue
        known, si_unit = posterior.verdict(quantity.name), posterior.unit(quantity.name)
        factor, unit = _IN_MM.get(si_unit, (1.0, si_unit)) if units == "mm-N-t" else (1.0, si_unit)
        low, high = (f"{end * factor:.4g}" for end in known.ends[0])
        verdict = known.words if known.verdict in CERTAINTY else known.words.upper()
        said.append(f"{quantity.name} = {value * factor:.10g} {unit}, 95 % interval {low} to {high}: {verdict}.")
        said.append(f"In SI units: {'; '.join(map(str.strip, lines_of(quantity.name, known)))}.")
        if quantity.role != "stiffness":
            said.append(f"{quantity.name} IS DAMPING AND ON NO CARD.")
    return said


def _blocks(
    posterior: Posterior, part: Problem, stiffness: Array, modes: tuple[ModeRecord, ...]
) -> dict[str, dict[str, Any]]:
    """Modes and joint as named arrays; of the modes the names are those that pyOMA made usual."""
    names = [quantity.name for quantity in part.parametrisation.quantities if quantity.places]
    known = [posterior.verdict(name) for name in names]
    joint = {
        "stiffness": stiffness,
        "dofs": [dof for joint in part.test.joints.joints for dof in joint.dofs],
        "names": names,
        "units": [posterior.unit(name) for name in names],
        "median": np.array([each.median for each in known]),
        "interval95": np.array([each.interval95 for each in known]),
        "verdict": [each.verdict for each in known],
    }
    if not modes:
        return {"joint": joint}
    of_modes = {
        "Fn": np.array([mode.frequency_hz for mode in modes]),
        "Fn_std": np.array([mode.frequency_sd_hz for mode in modes], dtype=float),
        "Xi": np.array([mode.damping_ratio for mode in modes]),
        "Xi_std": np.array([mode.damping_sd for mode in modes], dtype=float),
        "Phi": np.array([list(mode.shape.values()) for mode in modes]).T,
        "dofs": list(modes[0].shape),
    }
    return {"modes": of_modes, "joint": joint}
