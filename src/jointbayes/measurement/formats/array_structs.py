"""Structs that describe themselves, as Siemens Test.Lab and Polytec export them to MATLAB, under our own names.

A struct of Test.Lab has `x_values` (`start_value`, `increment`, `number_of_values`, or `values` of uneven lines),
`y_values` (`values`, one column for each channel) and `function_record` (`type`, `name`, channels); each axis has a
`quantity` with its `label`. Polytec's file access gives `x`, `y` (one row for each point) and `usd`, their description.
"""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.named_arrays import Block, is_text, size_of, strings
from jointbayes.measurement.formats.units import frequency_factor, frf_unit, parse_unit

_SECONDS = {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3}
_KINDS = (("coherence", "coh"), ("spectrum", "spectr|psd|fft|power|cross"), ("frf", "frf|transfer|frequency ?response"))


def described_blocks(block: Block) -> Iterator[Block] | None:
    """Columns of a struct that describes itself, each as a block of our own names; None of another struct.

    Raises
    ------
    MeasurementError
        On iteration, if its parts contradict each other, or it may be of time or of frequency.
    """
    if isinstance(block.get("x_values"), dict) and isinstance(block.get("y_values"), dict):
        return _test_lab(block)
    if isinstance(block.get("usd"), dict) and size_of(block.get("x")) > 1 and size_of(block.get("y")) > 1:
        return _polytec(block)
    return None


def _struct(block: Block, key: str) -> Block:
    value = block.get(key)
    return Block(value if isinstance(value, dict) else {}, f"{block.place}{key}.")


def _test_lab(block: Block) -> Iterator[Block]:
    x, y, about = (_struct(block, key) for key in ("x_values", "y_values", "function_record"))
    values = y.numbers("values", np.complex128)
    values = values.reshape(-1, 1) if values.ndim != 2 or len(values) == 1 else values
    axis = x.numbers("values").ravel() if size_of(x.get("values")) > 1 else _even_axis(x, len(values))
    if axis.size != len(values):
        raise MeasurementError(f"{y.where('values')}: found {len(values)} values; expected {axis.size}, as on the axis")
    struct = block.place.rstrip("./").rpartition(".")[2]
    kind = about.string("type") if is_text(about.get("type")) else struct
    count, inputs = values.shape[1], next((_labels(about, key) for key in about.arrays if "reference" in key), [])
    outputs = _labels(about, "primary_channel") or _labels(about, "name")
    if not inputs and all(label.count("/") == 1 for label in outputs):
        outputs, inputs = ([label.split("/")[side].strip() for label in outputs] for side in (0, 1))
    if len(outputs) != count:
        outputs = [f"{struct} {i + 1}" for i in range(count)] if count > 1 else [struct]
    inputs = inputs * count if len(inputs) == 1 else inputs
    labels = zip(outputs, inputs if len(inputs) == count else ["input 1"] * count, strict=True)
    unit, factor = _struct(y, "quantity").string("label"), _struct(_struct(y, "quantity"), "unit_transformation")
    of_label, stated = parse_unit(unit), factor.scalar("factor_to_si")
    if of_label and stated and not abs(stated / of_label.factor - 1) < 1e-3:
        unit = f"{unit} (factor_to_si {stated:g})"  # which is no unit: one of the two is wrong
    units = _struct(x, "quantity").string("label"), unit
    yield from _columns(block, "y_values.values", (axis, values), units, kind, list(labels))


def _even_axis(x: Block, count: int) -> Array:
    start, step, stated = (x.scalar(key) for key in ("start_value", "increment", "number_of_values"))
    if start is None or step is None or not (np.isfinite([start, step]).all() and step > 0):
        raise MeasurementError(
            f"{x.where('increment')}: found steps of {step} from {start}; expected 'start_value' and a step above 0"
        )
    return start + step * np.arange(float(count) if stated is None or not 0 <= stated <= 1e9 else stated)


def _labels(about: Block, key: str) -> list[str]:
    """Labels of one channel or of several: texts, or structs with a label or name."""
    value, labels = about.get(key), []
    for item in value if isinstance(value, list) else [value]:
        inner = Block(item) if isinstance(item, dict) else Block({"label": item})
        named = (inner.get(name) for name in ("label", "name", "point_id", "id"))
        labels += next((strings(text, about.where(key)) for text in named if is_text(text) and np.size(text)), [])
    return labels


def _polytec(block: Block) -> Iterator[Block]:
    x, values, usd = block.numbers("x").ravel(), block.numbers("y", np.complex128), _struct(block, "usd")
    values = values.reshape(1, -1) if values.size == x.size else values
    if values.ndim != 2 or x.size != values.shape[1]:
        raise MeasurementError(f"{block.where('y')}: found shape {values.shape}; expected rows of {x.size} values")
    kind = " ".join(usd.string(key) for key in ("functiontype", "name"))
    labels = [(f"point {i + 1}", "input 1") for i in range(len(values))]
    yield from _columns(block, "y", (x, values.T), (usd.string("xunit"), usd.string("yunit")), kind, labels)


def _columns(
    block: Block,
    name: str,
    over: tuple[Array, NDArray[Any]],
    units: tuple[str, str],
    kind: str,
    labels: list[tuple[str, str]],
) -> Iterator[Block]:
    """Columns over an axis; `units` are those of the axis and of the values, `kind` is what the file calls it."""
    (axis, values), path = over, f"{block.place}{name}"
    word, seconds = kind.lower(), _SECONDS.get(units[0].strip().lower())
    role = next((role for role, words in _KINDS if re.search(words, word)), "")
    if not units[0] and not role and re.search("signal|time", word):
        seconds = 1.0
    if seconds is None and frequency_factor(units[0]) is None and (units[0] or not role):
        raise MeasurementError(
            f"variable '{path}': found the unit {units[0]!r} of an axis that may be of time or frequency; expected s "
            f'or Hz; write frf = "{path}" with f_start_hz, f_step_hz, or samples with sample_rate_hz, in [data.layout]'
        )
    if not role and frf_unit(units[1]) is not None and np.any(values.imag):
        role = "frf"
    role = "samples" if seconds is not None else role or "spectrum"
    for (output, input_), column in zip(labels, values.T, strict=True):
        column = column if np.any(column.imag) else column.real
        arrays: dict[str, Any] = {"unit": units[1]}
        if seconds is not None:
            arrays |= {"samples": column, "channels": output, "time": axis * seconds}
        else:
            arrays |= {"frequency_hz": axis, role: column, "outputs": output, "inputs": input_}
            arrays |= {"frequency_hz_unit": units[0], "kind": kind}
        yield Block(arrays, written=dict.fromkeys(arrays, path))
