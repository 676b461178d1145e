"""Named arrays as npz, MAT and HDF5 files hold them, and the records they stand for."""

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, cast, get_args

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError
from jointbayes.frf import Quantity
from jointbayes.measurement.formats.units import read_frf_unit, read_sensor_unit, scaled, si_frf_unit, si_sensor_unit
from jointbayes.measurement.records import (
    HIGHEST_HZ,
    MOST_AVERAGES,
    MOST_RECORDS,
    FrfRecord,
    Record,
    SensorQuantity,
    TimeRecord,
    even_rate,
)

Arrays = Mapping[str, Any]

#: Names by which each array is known, the one we write first; compared without regard to case.
ALIASES: dict[str, tuple[str, ...]] = {
    "frequency_hz": ("frequency_hz", "frequency", "frequencies", "freq", "freqs", "freq_hz", "f_hz", "f"),
    "omega": ("omega_rad_s", "omega", "w"),
    "frf": ("frf", "h", "frfs"),
    "outputs": ("outputs", "output", "responses", "response_channels"),
    "inputs": ("inputs", "input", "references", "reference_channels"),
    "quantity": ("quantity",),
    "unit": ("unit", "units"),
    "coherence": ("coherence", "coh", "gamma2"),
    "averages": ("averages", "n_averages", "navg"),
    "sample_rate_hz": ("sample_rate_hz", "sample_rate", "fs"),
    "time": ("time", "time_s", "t"),
    "samples": ("samples",),
    "channels": ("channels", "channel"),
    "quantities": ("quantities",),
    "hits": ("hits",),
}
_SENSORS = ("force", "displacement", "velocity", "acceleration", "response")


def records_of(arrays: Arrays, place: str = "") -> Iterator[Record]:
    """Records of one block of named arrays.

    Parameters
    ----------
    arrays
        Arrays and strings by name.
    place
        Group or struct the block stands in, empty at the top.

    Raises
    ------
    MeasurementError
        If a name that is needed is missing, or shapes do not agree.
    """
    named = _Block(arrays, place)
    if named.has("frf"):
        yield from _frf_records(named)
    if named.has("samples") or any(named.raw(name) is not None for name in _SENSORS):
        yield from _time_records(named)


class _Block:
    """Arrays of one block under the names we use."""

    def __init__(self, arrays: Arrays, place: str) -> None:
        self._lower = {name.lower(): value for name, value in arrays.items()}
        self.place = place

    def where(self, name: str) -> str:
        return f"variable '{self.place}{name}'"

    def raw(self, name: str) -> Any:  # noqa: ANN401 - whatever the file holds under that name
        return self._lower.get(name)

    def has(self, key: str) -> bool:
        return self.get(key) is not None

    def get(self, key: str) -> Any:  # noqa: ANN401
        return next((self._lower[name] for name in ALIASES[key] if name in self._lower), None)

    def numbers(self, key: str, kind: type = np.float64) -> NDArray[Any]:
        """Array of real or complex numbers; anything else is refused."""
        return numbers(self.get(key), self.where(key), kind)

    def strings(self, key: str) -> list[str]:
        values = self.get(key)
        return [] if values is None else strings(values, self.where(key))

    def string(self, key: str) -> str:
        return next(iter(self.strings(key)), "")


def numbers(values: Any, where: str, kind: type = np.float64) -> NDArray[Any]:  # noqa: ANN401
    """Array of numbers of a file as float or complex."""
    array = np.asarray(values)
    allowed = "iufc" if kind is np.complex128 else "iuf"
    if array.dtype.kind not in allowed:
        raise MeasurementError(
            f"{where}: found {_kind_name(array)}; expected {'complex' if kind is np.complex128 else 'real'} numbers; "
            "store it as a numeric array"
        )
    return array.astype(kind, copy=False)


def _kind_name(array: NDArray[Any]) -> str:
    return {"U": "text", "S": "text", "O": "objects", "c": "complex numbers", "b": "true and false"}.get(
        array.dtype.kind, f"data of type {array.dtype}"
    )


def strings(values: Any, where: str) -> list[str]:  # noqa: ANN401
    """Strings of a file: text, bytes, or an array or cell array of them; blanks at the end dropped."""
    if isinstance(values, (str, bytes)):
        values = [values]
    if isinstance(values, np.ndarray) and values.dtype.kind == "U":
        _require_unicode(values, where)
    texts = []
    for item in np.asarray(values, dtype=object).ravel():
        while isinstance(item, np.ndarray) and item.size == 1:
            item = item.ravel()[0]
        if isinstance(item, bytes):
            item = item.decode("utf-8", errors="replace")
        if not isinstance(item, str):
            raise MeasurementError(f"{where}: found {type(item).__name__}; expected text; store labels as strings")
        texts.append(item.rstrip())
    return texts


def _require_unicode(text: NDArray[Any], where: str) -> None:
    """Refuse code points that no text has, which NumPy takes from a file as they are."""
    codes = np.ascontiguousarray(text).reshape(-1).view(np.dtype(np.uint32).newbyteorder(text.dtype.byteorder))
    bad = (codes > sys.maxunicode) | ((codes >= 0xD800) & (codes < 0xE000))
    if bad.any():
        raise MeasurementError(
            f"{where}: found the code {int(codes[np.argmax(bad)]):#x}, no character; expected text; save it again"
        )


def _frf_records(block: _Block) -> Iterator[FrfRecord]:
    lines, notes = _lines(block)
    values, moved = _arrange_axes(block.numbers("frf", np.complex128), lines.size, block.where("frf"), block)
    outputs, named_out = _labels(block, "outputs", values.shape[1])
    inputs, named_in = _labels(block, "inputs", values.shape[2])
    notes += [*moved, *named_out, *named_in]
    coherence = None
    if block.has("coherence"):
        coherence, _ = _arrange_axes(block.numbers("coherence"), lines.size, block.where("coherence"), block)
        if coherence.shape != values.shape:
            raise MeasurementError(
                f"{block.where('coherence')}: found shape {coherence.shape}; expected {values.shape} as the FRFs; "
                "store one coherence for each FRF"
            )
    unit = block.string("unit")
    factor, unit_quantity, of_unit = read_frf_unit(unit)
    notes += of_unit
    quantity = _quantity(block) or unit_quantity
    averages = _averages(block)
    for i, output in enumerate(outputs):
        for j, input_ in enumerate(inputs):
            yield FrfRecord(
                output,
                input_,
                lines,
                scaled(values[:, i, j], factor),
                quantity,
                unit,
                None if coherence is None else coherence[:, i, j],
                averages,
                f"{block.where('frf')}, {output!r} over {input_!r}",
                tuple(notes),
                factor,
            )


def _lines(block: _Block) -> tuple[Array, list[str]]:
    if block.has("frequency_hz"):
        return block.numbers("frequency_hz").ravel(), []
    if block.has("omega"):
        return block.numbers("omega").ravel() / (2 * np.pi), ["frequency in rad/s converted to Hz"]
    raise MeasurementError(
        f"{block.where('frf')}: found no frequency lines with it; expected a variable 'frequency_hz' (or "
        "'omega_rad_s'); add it"
    )


def _arrange_axes(values: NDArray[Any], lines: int, where: str, block: _Block) -> tuple[NDArray[Any], list[str]]:
    """Array of shape (lines, outputs, inputs) from the shapes that occur in files."""
    shape, notes = values.shape, []
    if values.ndim == 0 or values.ndim > 3 or lines not in shape:
        raise MeasurementError(
            f"{where}: found shape {shape}; expected (lines, outputs, inputs) with {lines} lines; correct the array"
        )
    if shape[0] != lines:
        axis = shape.index(lines)
        values = np.moveaxis(values, axis, 0)
        notes.append(f"array of shape {shape} read with its lines along axis {axis + 1}")
    if values.ndim == 1:
        return values[:, None, None], notes
    if values.ndim == 2:
        one_output = len(block.strings("outputs")) == 1 and values.shape[1] > 1
        return (values[:, None, :] if one_output else values[:, :, None]), notes
    return values, notes


def _labels(block: _Block, key: str, count: int) -> tuple[list[str], list[str]]:
    labels = block.strings(key)
    if not labels:
        name = key[:-1]
        return [f"{name} {i + 1}" for i in range(count)], [f"no {key} named in the file, numbered instead"]
    if len(labels) != count or len(set(labels)) != count:
        raise MeasurementError(
            f"{block.where(key)}: found {len(labels)} labels, {len(set(labels))} different; expected {count}, one for "
            "each; correct them"
        )
    return labels, []


def _quantity(block: _Block) -> Quantity | None:
    word = block.string("quantity").lower()
    if not word:
        return None
    if word not in get_args(Quantity):
        raise MeasurementError(
            f"{block.where('quantity')}: found {word!r}; expected one of {', '.join(get_args(Quantity))}; correct it"
        )
    return cast(Quantity, word)


def _averages(block: _Block) -> int | None:
    if not block.has("averages"):
        return None
    values, where = block.numbers("averages").ravel(), block.where("averages")
    if values.size != 1 or not (1 <= values[0] <= MOST_AVERAGES) or values[0] != int(values[0]):
        raise MeasurementError(
            f"{where}: found {values[:3].tolist()}; expected one whole number from 1 to {MOST_AVERAGES}; correct it"
        )
    return int(values[0])


def _time_records(block: _Block) -> Iterator[TimeRecord]:
    """Columns of `samples` with their channels, or one array for each sensor with hits in columns."""
    if block.has("samples"):
        samples = _columns(block.numbers("samples"), block.where("samples"))
        rate = _rate(block, len(samples))
        count = samples.shape[1]
        channels = block.strings("channels") or [f"channel {i + 1}" for i in range(count)]
        units, words = block.strings("unit") or [""] * count, block.strings("quantities") or [""] * count
        hits = _hit_numbers(block) if block.has("hits") else [0] * count
        if not len(channels) == len(units) == len(words) == len(hits) == count:
            raise MeasurementError(
                f"{block.where('samples')}: found {count} columns; expected as many channels ({len(channels)}), units "
                f"({len(units)}), quantities ({len(words)}) and hits ({len(hits)}); correct them"
            )
        for i, channel in enumerate(channels):
            yield _time_record(block, channel, rate, samples[:, i], (units[i], words[i]), hits[i] or None)
        return
    for name in _SENSORS:
        if block.raw(name) is None:
            continue
        samples = _columns(numbers(block.raw(name), block.where(name)), block.where(name))
        rate = _rate(block, len(samples))
        for i in range(samples.shape[1]):
            word = "" if name == "response" else name
            yield _time_record(block, name, rate, samples[:, i], ("", word), i + 1 if samples.shape[1] > 1 else None)


def _hit_numbers(block: _Block) -> list[int]:
    hits = block.numbers("hits").ravel()
    with np.errstate(invalid="ignore"):  # of NaN that signal
        whole = (hits >= 0) & (hits <= MOST_RECORDS) & (hits == np.round(hits))
    if not whole.all():
        raise MeasurementError(
            f"{block.where('hits')}: found {hits[:3].tolist()}; expected whole numbers from 1, 0 for none; correct it"
        )
    return [int(hit) for hit in hits]


def _columns(values: NDArray[Any], where: str) -> NDArray[Any]:
    if values.ndim > 2 or values.size == 0:
        raise MeasurementError(f"{where}: found shape {values.shape}; expected (samples, channels); correct the array")
    return values.reshape(-1, 1) if values.ndim < 2 or 1 in values.shape else values


def _rate(block: _Block, samples: int) -> float:
    if block.has("sample_rate_hz"):
        rate = block.numbers("sample_rate_hz").ravel()
        if rate.size == 1 and 1 / HIGHEST_HZ <= rate[0] <= HIGHEST_HZ:
            return float(rate[0])
        raise MeasurementError(
            f"{block.where('sample_rate_hz')}: found {rate[:3].tolist()}; expected one number above 0 and up to "
            f"{HIGHEST_HZ:g} Hz; correct it"
        )
    if not block.has("time"):
        raise MeasurementError(
            f"{block.where('samples')}: found no sampling rate; expected 'sample_rate_hz' or 'time'; add it"
        )
    time = block.numbers("time").ravel()
    if time.size != samples:
        raise MeasurementError(
            f"{block.where('time')}: found {time.size} instants; expected {samples}, one for each sample; correct it"
        )
    return even_rate(time, block.where("time"))


def _time_record(
    block: _Block, channel: str, rate: float, samples: NDArray[Any], unit_and_quantity: tuple[str, str], hit: int | None
) -> TimeRecord:
    unit, word = unit_and_quantity
    if word and word not in get_args(SensorQuantity):
        raise MeasurementError(
            f"{block.where('quantities')}: found {word!r}; expected one of {', '.join(get_args(SensorQuantity))}"
        )
    factor, quantity, notes = read_sensor_unit(unit)
    claimed = cast(SensorQuantity, word) if word else quantity or "unknown"
    place, values = f"{block.where('samples')}, {channel!r}", scaled(samples, factor)
    return TimeRecord(channel, rate, values, claimed, unit, hit, place, tuple(notes), factor)


def arrays_of(records: Iterable[Record]) -> dict[str, dict[str, Any]]:
    """Blocks of named arrays for records: one block for FRFs on one grid and one rate, else one for each record.

    Returns
    -------
    dict
        Name of the block to its arrays; the name is empty where there is one block only.
    """
    records = list(records)
    frfs = [record for record in records if isinstance(record, FrfRecord)]
    times = [record for record in records if isinstance(record, TimeRecord)]
    blocks = [_frf_block(group) for group in (_grids(frfs))]
    same = len({(record.sample_rate_hz, record.values.size) for record in times}) == 1
    blocks += [_time_block(group) for group in ([times] if same else [[record] for record in times])]
    return {"": blocks[0]} if len(blocks) == 1 else {f"record_{i + 1}": block for i, block in enumerate(blocks)}


def _grids(frfs: Sequence[FrfRecord]) -> list[list[FrfRecord]]:
    """All records as one grid where they form one, in grid order; else each by itself."""
    if not frfs:
        return []
    first = frfs[0]
    pairs = {(record.response, record.reference): record for record in frfs}
    outputs, inputs = (tuple(dict.fromkeys(pair[side] for pair in pairs)) for side in (0, 1))
    complete = len(pairs) == len(frfs) == len(outputs) * len(inputs)
    alike = all(
        (r.quantity, r.averages, r.coherence is None) == (first.quantity, first.averages, first.coherence is None)
        and np.array_equal(r.frequency_hz, first.frequency_hz)
        for r in frfs
    )
    if complete and alike:
        return [[pairs[output, input_] for output in outputs for input_ in inputs]]
    return [[record] for record in frfs]


def _frf_block(group: list[FrfRecord]) -> dict[str, Any]:
    first = group[0]
    outputs, inputs = (list(dict.fromkeys(getattr(r, side) for r in group)) for side in ("response", "reference"))
    shape = (len(outputs), len(inputs), first.frequency_hz.size)
    block: dict[str, Any] = {
        "frequency_hz": first.frequency_hz,
        "frf": np.moveaxis(np.array([r.values for r in group]).reshape(shape), -1, 0),
        "outputs": outputs,
        "inputs": inputs,
    }
    if first.quantity is not None:
        block |= {"quantity": first.quantity, "unit": si_frf_unit(first.quantity)}
    if first.coherence is not None:
        block["coherence"] = np.moveaxis(np.array([r.coherence for r in group]).reshape(shape), -1, 0)
    if first.averages is not None:
        block["averages"] = float(first.averages)
    return block


def _time_block(group: list[TimeRecord]) -> dict[str, Any]:
    return {
        "sample_rate_hz": group[0].sample_rate_hz,
        "samples": np.array([r.values for r in group]).T,
        "channels": [r.channel for r in group],
        "quantities": [r.quantity for r in group],
        "units": [si_sensor_unit(r.quantity) or " " for r in group],
        "hits": np.array([float(r.hit or 0) for r in group]),
    }
