"""What a posterior says, for other programs: predicted FRFs with their band as CSV, and the joint as cards."""

import os
from collections.abc import Mapping
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import ModelError
from jointbayes.frf import AssembledShapes, Modal
from jointbayes.inference import Problem
from jointbayes.phrases import NO_VERDICT_NO_USE, not_converged
from jointbayes.posterior import Posterior
from jointbayes.posterior.identifiability import CERTAINTY
from jointbayes.posterior.verdicts import line_of, reason_lines
from jointbayes.report.fe_cards import PROGRAMS, JointElement, Units, ascii_lines, fe_cards, joint_element
from jointbayes.reproducibility import one_blas_thread
from vibrecords.arrays import Array
from vibrecords.files import whole_file, write_whole_file
from vibrecords.formats.units import si_frf_unit
from vibrecords.formats.write import require_written, write_table
from vibrecords.records import FrfRecord, SpectrumRecord

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

    FRFs are the median of the draws, line by line, with both ends of the 95 % band of its magnitude in columns of their
    own. Natural frequencies and damping ratios, medians of the draws, stand above the table. Cards hold the
    joint of the medians, or the joint mode if no joint has these.

    Parameters
    ----------
    posterior
        The posterior.
    path
        The file, written whole or not at all.
    form
        ``"csv"`` for FRFs, ``"nastran"``, ``"abaqus"``, ``"calculix"`` or ``"ansys"`` for cards of the joint.
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
    MeasurementError
        If the format is unknown, or went.
    ModelError
        If a node has no number, or there is nothing to write.
    WriteError
        If the file cannot be written.
    """
    part, numbers, target = posterior.problem.part(test), dict(nodes or {}), Path(path)
    require_written(form, "export", ("csv", *PROGRAMS))
    theta, of = central_joint(posterior)
    stiffness = part.parametrisation.matrix(part.prior.values(theta)).stiffness
    # 1. Say value, interval and verdict of each quantity, in capitals where it is not known.
    said = [f"Joint of {posterior.problem.name}: the {of}."]
    said += [] if posterior.converged else [not_converged(posterior.reason, NO_VERDICT_NO_USE)]
    for quantity, value in zip(part.parametrisation.quantities, part.prior.values(theta), strict=True):
        if not quantity.places:
            continue
        known, si_unit = posterior.verdict(quantity.name), posterior.unit(quantity.name)
        factor, unit = _IN_MM.get(si_unit, (1.0, si_unit)) if units == "mm-N-t" else (1.0, si_unit)
        low, high = (f"{end * factor:.4g}" for end in known.interval)
        verdict = known.words if known.cls in CERTAINTY else known.words.upper()
        said.append(f"{quantity.name} = {value * factor:.10g} {unit}, 95 % interval {low} to {high}: {verdict}.")
        said.append(f"In SI units: {line_of(quantity.name, known)} ({'; '.join(reason_lines(known))}).")
        if quantity.role != "stiffness":
            said.append(f"{quantity.name} IS DAMPING AND ON NO CARD.")
    # 2. Write the cards, or the table of FRFs.
    if form in PROGRAMS:
        elements, rigid = _elements(part, stiffness, units, numbers)
        write_whole_file(target, fe_cards(form, elements, [*said, *rigid], units, first_id).encode())
        return (f"Cards for {form} of the {of}: {part.test.joints}",)
    if part.test.data.shown_frfs is None:
        found = f"found {part.test.data.words} as data, and no FRFs for csv"
        raise ModelError.of("export", (), found, "FRFs", "take the natural frequencies from summary.json of the run")
    frfs, ends = _frfs(posterior, test)
    modes = _modes(posterior, test, theta)
    said += [f"mode {n}: {hz!r} Hz, damping ratio {ratio!r}" for n, (hz, ratio) in enumerate(modes, start=1)]
    with whole_file(target) as temporary:
        write_table((*frfs, *ends), temporary, ascii_lines(said))
    medians = f"{len(frfs)} FRFs: the median; with each both ends of its 95 % band, which are no FRFs"
    return (medians, *([f"{len(modes)} modes above the table: medians of the draws"] if modes else []))


def central_joint(posterior: Posterior) -> tuple[Array, str]:
    """θ, shape (d,), at the medians of all quantities, and what it is; the joint mode where no joint has them."""
    prior, medians = posterior.problem.prior, np.median(posterior.stiffness, axis=0)
    if not prior.parametrisation.describes(medians):
        return posterior.best.theta, "joint mode (no passive joint has the medians)"
    rest = [float(n.coordinate(np.median(posterior.values(n.name)))) for n in prior.nuisances]
    return np.concatenate([prior.parametrisation.coordinates(medians), rest]), "joint of the medians"


def _frfs(posterior: Posterior, test: str | None) -> tuple[list[FrfRecord], list[SpectrumRecord]]:
    """The median of each FRF, and both ends of the band of its magnitude."""
    band = posterior.predict_frf(test=test)
    turn: NDArray[np.complex128] = np.exp(1j * np.deg2rad(band.phase_deg))
    line, unit = band.frequency_hz, si_frf_unit(band.quantity)
    sizes = {"lower end of 95 %": band.magnitude_low, "upper end of 95 %": band.magnitude_high}
    frfs, ends = [], []
    for (i, output), (j, input_) in product(enumerate(band.outputs), enumerate(band.inputs)):
        frfs.append(FrfRecord(output, input_, line, (band.magnitude * turn)[:, i, j], band.quantity, unit))
        ends += [SpectrumRecord(output, f"{end} / {input_}", line, size[:, i, j], unit) for end, size in sizes.items()]
    return frfs, ends


def _modes(posterior: Posterior, test: str | None, theta: Array) -> list[tuple[float, float]]:
    """Median frequency, Hz, and damping ratio of the lowest modes; none of a structure with a measured body."""
    part = posterior.problem.part(test)
    one, most, rows = part.test, min(_MOST_MODES, part.test.most_modes), posterior.thinned(_DRAWS)
    if most < 1:
        return []

    def modal_at(at: Array, count: int) -> Modal:
        shapes = AssembledShapes(one.structures, one.joints, count, tuple(one.data.dofs))
        return shapes.modes(part.parametrisation.matrix(part.prior.values(at)), part.structural(part.prior.factors(at)))

    count = min(most, max(_FEWEST_MODES, int((modal_at(theta[None], most).frequency_hz[0] <= one.data.top_hz).sum())))
    frequency_hz = posterior.predict_natural_frequencies(count, test=test)  # those of page one
    middles = (np.median(frequency_hz, axis=0), np.median(modal_at(rows, count).damping_ratio, axis=0))
    return [(float(hz), float(ratio)) for hz, ratio in zip(*middles, strict=True)]


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
