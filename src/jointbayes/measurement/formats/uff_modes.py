"""Data set 55 of a universal file, data at nodes: modes with frequency, damping, modal mass and shape; in and out.

References
----------
Structural Dynamics Research Lab, University of Cincinnati: Universal File Formats, data set 55.
"""

import math
import re
from collections.abc import Callable, Iterator

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.table_text import bad_number, float_of
from jointbayes.measurement.formats.uff_data_sets import LineError
from jointbayes.measurement.records import Dof, ModeRecord, dof_label, parse_dof

#: Bytes of one mode; the largest finite-element model has 10⁶ nodes in it.
MOST_MODE_BYTES = 2**27
_NORMAL, _COMPLEX = 2, (3, 7)  # analysis types with modes: normal, complex of first and of second order
_DIRECTIONS = {1: (0,), 3: (1, 2, 3), 6: (1, 2, 3, 4, 5, 6)}  # by the number of values at a node
_MOTIONS = {8: "", 11: "velocities", 12: "accelerations"}
_LIKELY_DAMPING = 0.2
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+|[+-]\d{3})?")


def read_mode(body: bytes, number: int, correct: Callable[[Array, Array], None]) -> ModeRecord | None:
    """The mode of a data set 55; None where it holds something else: static deflections, stresses, time steps.

    Parameters
    ----------
    body
        Content of the data set.
    number
        Of the data set, counted from 1.
    correct
        Adds the digits to the parameters and the values that did not fit the columns of our writer.

    Raises
    ------
    LineError
        If a field is no number or impossible, or a line is missing.
    """
    lines = body.decode("utf-8", errors="replace").splitlines()
    if len(lines) < 8:
        raise LineError(
            max(len(lines) - 1, 0),
            f"found {len(lines)} lines of a data set 55; expected 8 and the nodes; export the modes again",
        )
    _, analysis, _, motion, kind, per_node = _integers(lines, 5, 6)
    if analysis not in (_NORMAL, *_COMPLEX) or motion not in (0, 1, *_MOTIONS) or per_node not in _DIRECTIONS:
        return None
    if kind not in (2, 4, 5, 6):
        raise LineError(5, f"found data type {kind}; expected 2 (real) or 5 (complex); export the modes again")
    counts = _integers(lines, 6, 4)
    mode, n_real = counts[3], counts[1]
    if not (1 <= n_real <= 12 and n_real >= (2 if analysis in _COMPLEX else 1)):
        raise LineError(6, f"found {n_real} real parameters; expected those of a mode, 4 or 6; export the modes again")
    end = 7 + -(-n_real // 6)
    stated = np.array(list(_numbers(lines, 7, end, n_real)))
    nodes, values = _shape(lines, end, per_node * (2 if kind in (5, 6) else 1))
    correct(stated, values)
    shape = values.view(complex) if kind in (5, 6) else values
    labels = [dof_label(Dof("", node, direction)) for node in nodes for direction in _DIRECTIONS[per_node]]
    notes = [f"shape in {_MOTIONS[motion]}"] if _MOTIONS.get(motion) else []
    frequency, ratio, mass = _parameters(analysis, [*stated.tolist(), *[0.0] * 4], notes)
    told = re.search(r"(?:mode|freq)[^=]*?(\d+\.\d+)\s*Hz", " ".join(lines[:5]), re.IGNORECASE)
    if told and not math.isclose(float(told[1]), frequency, rel_tol=0.02, abs_tol=0.02):
        notes.append(f"frequency {frequency:.6g} Hz, and {told[1]} Hz in an ID line")
    sds = dict(word.split("=") for line in lines[:5] for word in line.split() if re.fullmatch(r"\w+_sd\w*=\S+", word))
    return ModeRecord(
        mode,
        frequency,
        float_of(sds.get("frequency_sd_hz", "")),
        ratio,
        float_of(sds.get("damping_sd", "")),
        dict(zip(labels, shape.ravel().astype(complex).tolist(), strict=True)),
        mass,
        f"data set {number}",
        tuple(notes),
    )


def _parameters(analysis: int, stated: list[float], notes: list[str]) -> tuple[float, float | None, float | None]:
    """Frequency, damping ratio and modal mass; what is doubtful goes to the notes."""
    if analysis == _NORMAL:
        frequency, mass, ratio, loss = stated[:4]
        if ratio == 0 and loss != 0:
            ratio = loss / 2
            notes.append(f"damping ratio half the hysteretic damping, {loss:g}")
    else:
        pole, mass = complex(stated[0], stated[1]), 0.0
        frequency = abs(pole) / (2 * math.pi)
        ratio = -pole.real / abs(pole) if pole else 0.0
    if not 0 <= frequency <= 1e9 or math.isnan(ratio):
        raise LineError(7, f"found {frequency:g} Hz and damping {ratio:g}; expected a mode's; export the modes again")
    if ratio < 0:
        notes.append(f"negative damping ratio {ratio:.3g}: the sign of the eigenvalue's real part, or unstable")
    if ratio > _LIKELY_DAMPING:
        taken = "not taken: above critical, or in percent" if ratio >= 1 else "is high: some programs write percent"
        notes.append(f"damping ratio {ratio:.3g} {taken}")
    return frequency, None if ratio == 0 or ratio >= 1 else ratio, mass or None


def _integers(lines: list[str], at: int, count: int) -> list[int]:
    fields = lines[at].split()[:count]
    if len(fields) < count or not all(re.fullmatch(r"[+-]?\d{1,10}", field) for field in fields):
        raise LineError(at, f"found {lines[at].strip()[:40]!r}; expected {count} whole numbers; export the modes again")
    return list(map(int, fields))


def _numbers(lines: list[str], first: int, end: int, count: int) -> Iterator[float]:
    """Numbers of a record, 13 columns each or separated by blanks."""
    for at in range(first, end):
        text = lines[at].rstrip() if at < len(lines) else ""
        wanted = min(6, count - 6 * (at - first))
        cells = [text[i : i + 13].strip() for i in range(0, 13 * wanted, 13)]
        if len(text) > 13 * wanted or not all(map(_NUMBER.fullmatch, cells)):
            cells = text.split()
        if len(cells) != wanted:
            raise LineError(
                min(at, len(lines) - 1),
                f"found {len(cells)} numbers; expected {wanted}; the data set is cut off or its counts are wrong, "
                "export the modes again",
            )
        for cell in cells:
            value = float(re.sub(r"(?<=\d)([+-]\d{3})$", r"E\1", cell)) if _NUMBER.fullmatch(cell) else math.nan
            if not math.isfinite(value):
                raise LineError(at, str(bad_number(cell, "")).removeprefix(": "))
            yield value


def _shape(lines: list[str], at: int, count: int) -> tuple[list[int], Array]:
    """Numbers of the nodes, and their values, shape (nodes, count)."""
    nodes: dict[int, int] = {}
    values: list[float] = []
    per_node = 1 + -(-count // 6)
    while at < len(lines):
        field = lines[at].strip()
        if not re.fullmatch(r"\d{1,9}", field) or int(field) in nodes:
            why = "a second time" if re.fullmatch(r"\d{1,9}", field) else "for a node"
            raise LineError(at, f"found {field[:30]!r} {why}; expected a new node's number; export the modes again")
        nodes[int(field)] = at
        values += _numbers(lines, at + 1, at + per_node, count)
        at += per_node
    return list(nodes), np.array(values).reshape(len(nodes), count)


def mode_lines(mode: ModeRecord) -> tuple[list[str], Array, Array]:
    """Lines of a data set 55, the numbers that they stand for, and those that will be read from them.

    Raises
    ------
    MeasurementError
        If a label of the shape is no node with a direction.
    """
    dofs = {label: parse_dof(label) for label in mode.shape}
    for label, dof in dofs.items():
        if dof is None or dof.entity or not dof.direction:
            raise MeasurementError(
                f"mode {mode.number}: found label {label[:30]!r}; expected that of a node, such as '12:Z+'; rename it"
            )
    rows: dict[int, list[complex]] = {}
    per_node = 6 if any(abs(dof.direction) > 3 for dof in dofs.values() if dof) else 3
    for label, dof in dofs.items():
        assert dof is not None
        value = mode.shape[label] if dof.direction > 0 else -mode.shape[label]
        rows.setdefault(dof.node, [0j] * per_node)[abs(dof.direction) - 1] = value
    complex_ = any(value.imag for value in map(complex, mode.shape.values()))
    sds = {"frequency_sd_hz": mode.frequency_sd_hz, "damping_sd": mode.damping_sd}
    told = " ".join(f"{key}={value!r}" for key, value in sds.items() if value is not None)
    stated = [mode.frequency_hz, mode.modal_mass or 0.0, mode.damping_ratio or 0.0, 0.0]
    lines = [f"Mode {mode.number}", told or "NONE", *["NONE"] * 3]
    definition = (1, _NORMAL, per_node // 3 + 1, 8, 5 if complex_ else 2, per_node)
    lines.append("".join(f"{number:10d}" for number in definition))
    lines += [f"{2:10d}{4:10d}{1:10d}{mode.number:10d}", "".join(f"{x:13.5E}" for x in stated)]
    true = list(stated)
    for node, row in rows.items():
        numbers = np.array(row, complex).view(float) if complex_ else np.array(row, complex).real
        cells = [f"{x:13.5E}" for x in numbers]
        lines += [f"{node:10d}", *("".join(cells[i : i + 6]) for i in range(0, len(cells), 6))]
        true += numbers.tolist()
    return lines, np.array(true), np.array([float(f"{x:13.5E}") for x in true])
