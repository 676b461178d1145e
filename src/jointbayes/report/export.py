"""What a posterior says, for other programs: predicted FRFs with their band, modes, and the joint as cards."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import ModelError
from jointbayes.frf import AssembledShapes, Modal
from jointbayes.inference import Problem
from jointbayes.joint import Joint, Joints
from jointbayes.posterior import Posterior
from jointbayes.posterior.identifiability import CERTAINTY
from jointbayes.posterior.verdicts import lines_of
from jointbayes.report.fe_cards import PROGRAMS, JointElement, Units, ascii_lines, fe_cards, joint_element
from jointbayes.reproducibility import one_blas_thread
from vibrecords.arrays import Array
from vibrecords.files import whole_file, write_whole_file
from vibrecords.formats.array_files import write_matlab
from vibrecords.formats.uff_write import write_uff
from vibrecords.formats.units import si_frf_unit
from vibrecords.formats.write import arrays_of, write_table
from vibrecords.records import FrfRecord, ModeRecord, dof_label, parse_dof

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
    setup: str | None = None,
    units: Units = "SI",
    nodes: Mapping[str, int] | None = None,
    first_id: int = 900001,
) -> tuple[str, ...]:
    """Write what a posterior says into a file of another program, and say what was written.

    FRFs are the median and both ends of the 95 % band of their magnitude, line by line, all with the median's phase.
    Modes and cards are those of the joint of the medians, or of the joint mode where no joint has these.

    Parameters
    ----------
    posterior
        The posterior.
    path
        The file, written whole or not at all.
    form
        ``"uff58"``, ``"uff58b"``, ``"mat"`` or ``"csv"`` for FRFs and modes (csv: FRFs alone), ``"nastran"``,
        ``"abaqus"``, ``"calculix"`` or ``"ansys"`` for cards of the joint.
    setup
        Name of the set-up, where there are several; by default the first.
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
    part, numbers, target = posterior.problem.part(setup), dict(nodes or {}), Path(path)
    if form not in (*FILES, *PROGRAMS):
        raise ModelError(f"export: found format {form!r}; expected one of {', '.join((*FILES, *PROGRAMS))}; correct it")
    theta, of = central_joint(posterior)
    stiffness = part.parametrisation.matrix(part.prior.values(theta)).stiffness
    said = [f"Joint of {posterior.problem.name}: the {of}.", *_joint_lines(posterior, part, theta, units)]
    if form in PROGRAMS:
        elements, rigid = _elements(part, stiffness, units, numbers)
        write_whole_file(target, fe_cards(form, elements, [*said, *rigid], units, first_id).encode())
        return (f"Cards for {form} of the {of}: {part.test.joints}",)
    frfs = () if part.test.data.shown_frfs is None else _frfs(posterior, setup)
    modes = _modes(posterior, part, theta, numbers)
    if not frfs and (form == "csv" or not modes):
        raise ModelError(
            f"export: found {part.test.data.words} as data, and no FRFs for {form}; expected FRFs; choose uff58 or mat"
        )
    said += [f"mode {m.number}: {m.frequency_hz!r} Hz, damping ratio {m.damping_ratio!r}" for m in modes]
    said += [f"node {number} is {name}" for name, number in numbers.items()]
    with whole_file(target) as temporary:
        if form == "csv":
            write_table(frfs, temporary, ",", ascii_lines(said))
        elif form == "mat":
            write_matlab(arrays_of(frfs) | _blocks(posterior, part, stiffness, modes), temporary)
        else:
            write_uff((*frfs, *modes), temporary, binary=form == "uff58b", remarks=ascii_lines(said))
    band, shapes = f"{len(frfs)} FRFs: median and both ends of the 95 % band", f"{len(modes)} modes of the {of}"
    return (*([band] if frfs else []), *([shapes] if modes else []))


def central_joint(posterior: Posterior) -> tuple[Array, str]:
    """θ, shape (d,), at the medians of all quantities, and what it is; the joint mode where no joint has them."""
    prior, medians = posterior.problem.prior, np.median(posterior.stiffness, axis=0)
    if not prior.parametrisation.describes(medians):
        return posterior.mode_theta, "joint mode (no passive joint has the medians)"
    rest = [float(n.coordinate(np.median(posterior.values(n.name)))) for n in prior.nuisances]
    return np.concatenate([prior.parametrisation.coordinates(medians), rest]), "joint of the medians"


def _frfs(posterior: Posterior, setup: str | None) -> tuple[FrfRecord, ...]:
    band = posterior.predict_frf(setup=setup)
    turn: NDArray[np.complex128] = np.exp(1j * np.deg2rad(band.phase_deg))
    unit = si_frf_unit(band.quantity)
    ends = {"lower end of 95 %": band.magnitude_low, "upper end of 95 %": band.magnitude_high}
    of_band = {"median": band.magnitude, **ends}
    return tuple(
        FrfRecord(f"{output} {name}", input_, band.frequency_hz, (size * turn)[:, i, j], band.quantity, unit)
        for i, output in enumerate(band.outputs)
        for j, input_ in enumerate(band.inputs)
        for name, size in of_band.items()
    )


def _modes(posterior: Posterior, part: Problem, theta: Array, nodes: dict[str, int]) -> tuple[ModeRecord, ...]:
    """Lowest modes with unit modal mass at the nodes of the model; none of a structure with a measured body."""
    test, most = part.test, min(_MOST_MODES, part.test.most_modes)
    if most < 1:
        return ()
    dofs = tuple(dict.fromkeys((*test.data.dofs, *test.joints.labels)))
    labels = [_label(dof, nodes) for dof in dofs]

    def modal_at(rows: Array, count: int) -> Modal:
        return AssembledShapes(test.structures, test.joints, count, dofs).modes(
            part.parametrisation.matrix(part.prior.values(rows)), part.structural(part.prior.factors(rows))
        )

    modal = modal_at(theta[None], most)
    count = min(most, max(_FEWEST_MODES, int((modal.frequency_hz[0] <= test.data.top_hz).sum())))
    drawn = modal_at(posterior.thinned(_DRAWS), count)
    modes = []
    for n in range(count):
        frequency = float(modal.frequency_hz[0, n]), _sd(drawn.frequency_hz[:, n])
        damping = float(modal.damping_ratio[0, n]), _sd(drawn.damping_ratio[:, n])
        shape = dict(zip(labels, modal.shapes[0, n].astype(complex).tolist(), strict=True))
        modes.append(ModeRecord(n + 1, *frequency, *damping, shape, 1.0))
    return tuple(modes)


def _sd(values: Array) -> float | None:
    """Standard deviation; None of what the model holds fixed, but for rounding."""
    sd = float(values.std())
    return sd if sd > 1e-9 * float(np.abs(values).max()) else None


def _label(dof: str, nodes: dict[str, int]) -> str:
    """Label of a DOF as a universal file has it; a node without a number gets the next one that is free."""
    name, _, direction = dof.rpartition(":")
    if not name.isdigit() or name in nodes:
        dof = f"{nodes.setdefault(name, max([0, *nodes.values()]) + 1)}:{direction}"
    parsed = parse_dof(dof)
    return dof if parsed is None else dof_label(parsed)


def _elements(
    part: Problem, stiffness: Array, units: Units, nodes: Mapping[str, int]
) -> tuple[list[JointElement], list[str]]:
    """The joints in the units of the cards, and what is said of each."""
    row, elements, said = 0, [], []
    for joint in _joints(part):
        rows = slice(row, row + joint.size)
        rigid = [i - row for i in part.parametrisation.held if row <= i < rows.stop]
        elements.append(joint_element(joint, stiffness[rows, rows], rigid, units, nodes))
        said.append(f"Joint {joint}.")
        said += [f"{joint.dofs[i]} IS HELD RIGID AND NOT ON THESE CARDS: ADD A RIGID ELEMENT." for i in rigid]
        row = rows.stop
    return elements, said


def _joint_lines(posterior: Posterior, part: Problem, theta: Array, units: Units) -> list[str]:
    """Value, interval and verdict of each quantity, in capitals where it is not known."""
    said = [] if posterior.converged else [f"NOT CONVERGED, DO NOT USE THESE NUMBERS: {posterior.reason}"]
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
        "dofs": [dof for joint in _joints(part) for dof in joint.dofs],
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


def _joints(part: Problem) -> tuple[Joint, ...]:
    joints = part.test.joints
    return joints.joints if isinstance(joints, Joints) else (joints,)
