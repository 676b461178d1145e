"""Structs that say of themselves what they hold, as Siemens Test.Lab and Polytec export them to MATLAB.

A struct of Test.Lab has `x_values` (`start_value`, `increment`, `number_of_values`, or `values` of uneven lines),
`y_values` (`values`, one column for each channel) and `function_record` (`type`, `name`, channels); each axis has a
`quantity` with its `label`. Polytec's file access gives `x`, `y` (one row for each point) and `usd`, their description.
"""

import re
from collections.abc import Iterator
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.named_arrays import Block, is_text, size_of, strings
from jointbayes.measurement.formats.units import (
    frequency_factor,
    frf_unit,
    parse_unit,
    read_frf_unit,
    read_sensor_unit,
    scaled,
)
from jointbayes.measurement.records import (
    CoherenceRecord,
    FrfRecord,
    Record,
    SpectrumRecord,
    TimeRecord,
    even_rate,
)

Q = TypeVar("Q")

_SECONDS = {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3}


def described_records(block: Block) -> Iterator[Record] | None:
    """Records of a struct that describes itself; None of another one.

    Raises
    ------
    MeasurementError
        On iteration, if its parts contradict each other, or it may be read in two ways.
    """
    if isinstance(block.get("x_values"), dict) and isinstance(block.get("y_values"), dict):
        return _test_lab(block)
    if isinstance(block.get("usd"), dict) and size_of(block.get("x")) > 1 and size_of(block.get("y")) > 1:
        return _polytec(block)
    return None


def _struct(block: Block, key: str) -> Block:
    value = block.get(key)
    return Block(value if isinstance(value, dict) else {}, f"{block.place}{key}.")


def _test_lab(block: Block) -> Iterator[Record]:
    x, y, about = (_struct(block, key) for key in ("x_values", "y_values", "function_record"))
    values = y.numbers("values", np.complex128)
    values = values.reshape(len(values), -1) if values.ndim and 1 not in values.shape[:1] else values.reshape(-1, 1)
    axis = _test_lab_axis(x, y, values)
    struct = block.place.rstrip("./").rpartition(".")[2]
    kind = about.string("type") if is_text(about.get("type")) else re.sub(r"[\W\d_]+$", "", struct)
    outputs = _labels(about, "primary_channel") or (
        strings(about.get("name"), "") if is_text(about.get("name")) else []
    )
    inputs = next((found for key in about.arrays if "reference" in key and (found := _labels(about, key))), [])
    pairs = [label.split("/") for label in outputs]
    if not inputs and pairs and all(len(pair) == 2 for pair in pairs):
        outputs, inputs = [pair[0].strip() for pair in pairs], [pair[1].strip() for pair in pairs]
    count = values.shape[1]
    if len(outputs) != count:
        outputs = [struct] if count == 1 else [f"{struct} {i + 1}" for i in range(count)]
    inputs = inputs * count if len(inputs) == 1 else inputs
    inputs = inputs if len(inputs) == count else ["input 1"] * count
    unit, transformation = (
        _struct(y, "quantity").string("label"),
        _struct(_struct(y, "quantity"), "unit_transformation"),
    )
    stated = transformation.numbers("factor_to_si").ravel() if size_of(transformation.get("factor_to_si")) == 1 else [0]
    x_unit = _struct(x, "quantity").string("label")
    yield from _records(
        block, (axis, x_unit), values, (unit, float(stated[0])), kind, list(zip(outputs, inputs, strict=True))
    )


def _test_lab_axis(x: Block, y: Block, values: NDArray[Any]) -> Array:
    if size_of(x.get("values")) > 1:
        axis = x.numbers("values").ravel()
    else:
        for key in ("start_value", "increment"):
            if size_of(x.get(key)) != 1:
                raise MeasurementError(f"{x.where(key)}: found no number; expected one; export it again")
        start, step = (float(x.numbers(key).ravel()[0]) for key in ("start_value", "increment"))
        if not (np.isfinite(start) and np.isfinite(step) and step > 0):
            raise MeasurementError(f"{x.where('increment')}: found {step:g} from {start:g}; expected a step above 0")
        axis = start + step * np.arange(len(values))
        stated = x.numbers("number_of_values").ravel() if size_of(x.get("number_of_values")) else axis[:0]
        if stated.size == 1 and stated[0] != len(values):
            raise MeasurementError(
                f"{y.where('values')}: found {len(values)} values; expected {stated[0]:g} (number_of_values)"
            )
    if axis.size != len(values):
        raise MeasurementError(
            f"{y.where('values')}: found {len(values)} values; expected one for each of the {axis.size} on the axis"
        )
    return axis


def _labels(about: Block, key: str) -> list[str]:
    """Labels of one channel or of several: texts, or structs with a label or name."""
    value = about.get(key)
    labels: list[str] = []
    for item in value if isinstance(value, list) else [value]:
        if isinstance(item, dict):
            inner = Block(item, f"{about.place}{key}.")
            named = (inner.get(name) for name in ("label", "name", "point_id", "id"))
            item = next((text for text in named if is_text(text) and np.size(text)), None)
        if is_text(item):
            labels += strings(item, about.where(key))
    return labels


def _polytec(block: Block) -> Iterator[Record]:
    x, values, usd = block.numbers("x").ravel(), block.numbers("y", np.complex128), _struct(block, "usd")
    values = values.reshape(-1, 1) if values.size == x.size else values
    if values.ndim != 2 or x.size not in values.shape:
        raise MeasurementError(f"{block.where('y')}: found shape {values.shape}; expected rows of {x.size} values")
    values = values if values.shape[1] != x.size or values.shape[0] == x.size else values.T
    kind = " ".join(usd.string(key) for key in ("functiontype", "name") if is_text(usd.get(key)))
    labels = [(f"point {i + 1}", "input 1") for i in range(values.shape[1])]
    yield from _records(block, (x, usd.string("xunit")), values, (usd.string("yunit"), 0.0), kind, labels)


def _records(
    block: Block,
    x: tuple[Array, str],
    values: NDArray[Any],
    y_unit: tuple[str, float],
    kind: str,
    labels: list[tuple[str, str]],
) -> Iterator[Record]:
    """Records over an axis with its unit, of columns of values with their unit and its factor (0 where none is)."""
    axis, x_unit = x
    word, place = kind.lower(), f"variable '{block.place.rstrip('./')}'"
    hertz, seconds = frequency_factor(x_unit), _SECONDS.get(x_unit.strip().lower())
    if hertz is None and seconds is None:
        hertz = 1.0 if re.search(r"frf|coh|spectr|psd|fft", word) else None
        seconds = 1.0 if hertz is None and re.search(r"signal|time", word) else None
        if x_unit or (hertz is None and seconds is None):
            raise MeasurementError(
                f"{place}: found the unit {x_unit!r} of an axis that may be of time or frequency; expected s or Hz; "
                f'write frf = "{block.place}y_values.values" with f_start_hz and f_step_hz, or samples with '
                "sample_rate_hz, in [data.layout]"
            )
    is_real, is_frf = not np.any(values.imag), bool(re.search(r"frf|transfer|frequency ?response", word))
    if hertz is None and seconds is not None:
        rate = even_rate(axis * seconds, place)
        for (label, _), column in zip(labels, values.real.T, strict=True):
            factor, sensor, notes = _factor(read_sensor_unit(y_unit[0]), y_unit)
            samples, where, said = scaled(column, factor), f"{place}, {label!r}", tuple(notes)
            yield TimeRecord(label, rate, samples, sensor or "unknown", y_unit[0], None, where, said, factor)
        return
    assert hertz is not None
    lines = axis * hertz
    if is_frf and is_real:
        raise MeasurementError(
            f"{place}: found FRFs of real numbers, which may be magnitudes or real parts; expected complex numbers; "
            "export them as real and imaginary"
        )
    is_frf = is_frf or (not is_real and "coh" not in word and frf_unit(y_unit[0]) is not None)
    for (output, input_), column in zip(labels, values.T, strict=True):
        if is_frf:
            factor, quantity, notes = _factor(read_frf_unit(y_unit[0]), y_unit)
            where, noted = f"{place}, {output!r} over {input_!r}", tuple(notes)
            whole = scaled(column, factor)
            yield FrfRecord(output, input_, lines, whole, quantity, y_unit[0], None, None, where, noted, factor)
        elif "coh" in word:
            yield CoherenceRecord(output, input_, lines, column.real, None, place)
        else:
            yield SpectrumRecord(output, kind or "spectrum", lines, column, y_unit[0], place)


def _factor(read: tuple[float | None, Q, list[str]], unit: tuple[str, float]) -> tuple[float | None, Q, list[str]]:
    """Factor to SI by label and by the file's own number: none where the two contradict each other."""
    (factor, quantity, notes), (label, stated) = read, unit
    agree = bool(label) and factor is not None and abs(stated / factor - 1) < 1e-3
    if not stated or agree or (factor is None and parse_unit(label) is not None):
        return factor, quantity, notes
    if not np.isfinite(stated) or stated <= 0 or (label and factor is not None):
        return None, quantity, [f"unit {label!r} and factor_to_si {stated:g} differ, values left as written"]
    return stated, quantity, [f"multiplied by factor_to_si {stated:g} of the file"]
