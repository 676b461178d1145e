"""What names and attributes of arrays say, the arrays of a struct or group by them, and time histories among these."""

import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, cast, get_args

import numpy as np
from numpy.typing import NDArray

from vibrecords.arrays import Array, Quantity, SensorQuantity
from vibrecords.errors import MeasurementError, refusal, require_one_of
from vibrecords.formats.matlab_5 import ATTRIBUTE, Unread
from vibrecords.formats.names import NAMES, RATE_KEY, float_of, words_of
from vibrecords.formats.units import TIME_S, read_sensor_unit, scaled, unit_attribute
from vibrecords.records import HIGHEST_HZ, MOST_AVERAGES, MOST_RECORDS, TimeRecord, even_rate, is_two_sided

#: Roles of axes of frequency and time.
_AXIS_ROLES = ("frequency", "omega", "time")
#: Names by which each array is known, the one we write first; compared without regard to case.
ALIASES = {key: tuple(names.split()) for key, names in NAMES["arrays"].items()}
#: Time histories that stand under the name of what was measured.
SENSORS = ("force", "displacement", "velocity", "acceleration", "response")
_TOKEN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\d_A-Z]+|\d+")
_ROLES, _QUANTITIES, _WORDS = (words_of(table) for table in ("roles", "quantities", "words"))
_FRF = _WORDS["frf"].union(*_QUANTITIES.values())


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a name says.

    Parameters
    ----------
    role
        ``frf``, ``coherence``, ``frequency``, ``time``, …; ``w`` for a name that may be of either axis; else empty.
    rest
        Words that are left: which FRF, or which channel.
    hints
        Units in the name.
    quantity
        What the FRF is.
    """

    role: str
    rest: frozenset[str]
    hints: frozenset[str]
    quantity: Quantity | None = None


def tokens_of(name: str) -> tuple[str, ...]:
    """Words of a name in small letters.

    Examples
    --------
    >>> tokens_of("frequencyBand"), tokens_of("H11_dB")
    (('frequency', 'band'), ('h', '11', 'db'))
    """
    apart = re.sub("dB|kHz|[Mm]Hz", lambda unit: f"_{unit[0]}_".lower(), name)
    return tuple(token.lower() for token in _TOKEN.findall(apart))


def meaning_of(name: str) -> Meaning:
    """What the name of an array says.

    Examples
    --------
    >>> meaning_of("Hf_coh_chan_2").role, meaning_of("Freq_domain").role, meaning_of("Data1_AI_1").role
    ('coherence', 'frequency', 'signal')
    """
    tokens, small = tokens_of(name), name.lower()
    words = frozenset(tokens)
    role = next((key for key, names in ALIASES.items() if small in names), "")
    role = {"frequency_hz": "frequency", "sample_rate_hz": "rate"}.get(role, role)
    if small in SENSORS or re.fullmatch(r"time_chan_\d+", small):
        role = "signal"
    role = role or next((role for role, its in _ROLES.items() if words & its), "") or _axis(words)
    if not role and (words & _FRF or not _WORDS["frf_first"].isdisjoint(tokens[:1])):
        role = "frf"
    if not role and words & _WORDS["signal"]:
        role = "signal"
    quantity = next((q for q, its in _QUANTITIES.items() if words & its), None)
    used = _ROLES.get(role, frozenset()) | _FRF | _WORDS["frf_first"] | _WORDS["hints"] | {"time", "chan", "channel"}
    return Meaning(role, words - used, words & _WORDS["hints"], cast(Quantity | None, quantity))


def _axis(words: frozenset[str]) -> str:
    """Role of a name of an axis, or of a number that makes one."""
    next_to_f = _WORDS["next_to_f"] | _WORDS["start"] | _WORDS["step"]
    frequency = words & _WORDS["frequency"] or ({"f"} <= words <= next_to_f)
    sampling = words & _WORDS["sampling"]
    if (sampling and words & (_WORDS["frequency"] | {"rate", "second"})) or words & _WORDS["rates"]:
        return "rate"
    if words in ({"dt"}, {"ts"}, {"delta", "t"}) or (sampling and words & _WORDS["interval"]):
        return "interval"
    if "omega" in words or (words & {"rad"} and (frequency or "w" in words)):
        return "omega"
    if words == {"w"} or words & _WORDS["limit"]:
        return "w" if words == {"w"} else ""
    if "df" in words or (frequency and words & _WORDS["step"]):
        return "f_step"
    if frequency:
        return "f_start" if words & _WORDS["start"] else "frequency"
    numbered = {word for word in words if not word.isdecimal()}  # t1, t2
    return "time" if words & _WORDS["time"] or numbered in ({"t"}, {"t", "s"}) else ""


# ---- arrays of one struct or group

Arrays = Mapping[str, Any]

#: Days of MATLAB's `datenum` in this century and the last; instants in seconds begin where the measurement does.
_DAYS = (690_000.0, 780_000.0)


#: What is no real number, by NumPy's letter for its kind.
_KINDS = {"U": "text", "S": "text", "O": "a struct or unlike cells", "c": "complex numbers", "b": "true and false"}


@dataclass(eq=False)
class Block:
    """Arrays of one struct or group.

    Parameters
    ----------
    arrays
        By their names in the file.
    place
        Struct or group that they stand in, with the sign that follows it; empty at the top.
    outer
        Block that this one stands in, whose axes are its own where it has none.
    written
        Names in the file of arrays that the user has given another name.
    label
        What it is called where it is one of an array of structs; empty elsewhere.
    notes
        What was done to its arrays so far.
    """

    arrays: Arrays
    place: str = ""
    outer: "Block | None" = None
    written: Mapping[str, str] = field(default_factory=dict)
    label: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        arrays = self.arrays
        self.meanings = {name: meaning_of(name) for name in arrays}
        of_struct = meaning_of(re.split(r"[./]", self.place)[-2] if re.search(r"[./]", self.place) else "")
        if of_struct.role in ("frf", "coherence"):  # frf.data
            self.meanings |= {name: of_struct for name in arrays if name.lower() in ("data", "values", "value")}
        self._lower = {name.lower(): name for name in reversed([*arrays])}  # the first of several
        if {"time", "interval", "rate"} & {meaning.role for meaning in self.meanings.values()}:
            for name in [n for n in arrays if n.lower() == "f" and size_of(arrays[n]) > 1 and not rises(arrays[n])]:
                self.meanings[name] = meaning_of("f" if self.is_two_sided(name) else "force signal")
        self._roles: dict[str, list[str]] = {}
        for name, meaning in self.meanings.items():
            self._roles.setdefault(meaning.role, []).append(name)

    def path(self, key: str) -> str:
        """How the file or the user calls an array."""
        name = self.name_of(key) or key
        return self.written.get(name) or self.place + name

    def where(self, key: str) -> str:
        """Place of an array in words."""
        return f"variable '{self.path(key)}'"

    def name_of(self, key: str) -> str | None:
        """Name in the file of what is known under a name."""
        if key in self.arrays:
            return key
        return next((self._lower[n] for n in ALIASES.get(key, (key,)) if n in self._lower), None)

    def get(self, key: str) -> Any:  # noqa: ANN401 - anything the file holds under that name
        """What is known under a name; None where nothing is."""
        name = self.name_of(key)
        return None if name is None else self.arrays[name]

    def stated(self, key: str) -> bool:
        """Whether the user has said which array this is."""
        return key in self.written

    def named(self, role: str, least: int = 2) -> list[str]:
        """Names of arrays of a role, of at least so many numbers."""
        return [name for name in self._roles.get(role, []) if size_of(self.arrays[name]) >= least]

    def rest(self, name: str) -> frozenset[str]:
        """Words of a name that tell which FRF or channel it is of."""
        return (self.meanings.get(name) or meaning_of(name)).rest

    def hints(self, name: str) -> frozenset[str]:
        """Units that a name or the unit next to it tells: ``deg``, ``rad``, ``db``, ``khz`` and others."""
        unit = re.match(r"[\[(]?(°|[A-Za-z]+)", self.unit_of(name))
        words = {*self.meanings[name].hints, *([unit[1].lower()] if unit else [])}
        short = {"deg": "deg", "°": "deg", "rad": "rad"}
        return frozenset(short.get(word[:3], word) for word in words)

    def scalar(self, role: str) -> float | None:
        """Number of a role or a name in this block or an outer one."""
        for name in (*self._roles.get(role, []), *filter(None, [self._lower.get(role)])):
            if size_of(self.arrays[name]) == 1:
                return float(self.numbers(name).ravel()[0])
        return None if self.outer is None else self.outer.scalar(role)

    def numbers(self, key: str, kind: type = np.float64) -> NDArray[Any]:
        """Array of real or complex numbers; anything else is refused."""
        return numbers(self.get(key), self.where(key), kind)

    def strings(self, key: str) -> list[str]:
        """Texts known under a name; none where nothing is, or something else under another name for it."""
        name = self.name_of(key)
        values = None if name is None else self.arrays[name]
        other = isinstance(values, dict) or (name is not None and name.lower() != key and not is_text(values))
        return [] if values is None or other else strings(values, self.where(key))

    def string(self, key: str) -> str:
        """First of the texts, or an empty one where there is no text."""
        return next(iter(self.strings(key)), "") if is_text(self.get(key)) else ""

    def is_two_sided(self, name: str) -> bool:
        """Whether an axis has a negative half."""
        value = self.get(name)
        return isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and is_two_sided(value.ravel())

    def unread(self, *read: str) -> list[str]:
        """Notes on arrays whose names say nothing: complex ones, and all of them where some were read as histories."""
        unnamed = [n for role in ("", "signal") for n in self.named(role) if is_complex(self.arrays[n]) or read]
        return [f"'{n}' not read: [data.layout] can name it" for n in unnamed if n not in read][:8]

    def units_of(self, name: str, count: int = 1, *, alone: bool = False) -> list[str]:
        """Unit of each column of an array: its own, else that of the block; of several for one the list, no unit.

        The block's own list is that of the columns only where the array is `alone`.
        """
        own = self._own_units(name)
        labels = own or self.strings("unit")
        if not (len(labels) == count and (own or alone)):
            labels = [", ".join(dict.fromkeys(labels))] * count
        factors = (("scale_factor", 1), ("add_offset", 0))
        stated = [key for key, neutral in factors if size_of(self.get(key)) and (self.numbers(key) != neutral).any()]
        open_ = ", ".join(stated)
        return [f"({open_}: applied?) {label}".strip() for label in labels] if open_ else labels

    def unit_of(self, name: str) -> str:
        """Unit that an array has for itself, as an axis; empty where it has none."""
        of_axis = ("xunit", "xunits", "x_unit", "x_units") if self.meanings[name].role in _AXIS_ROLES else ()
        return next(iter(self._own_units(name)), "") or next(filter(None, map(self.string, of_axis)), "")

    def quantity_of(self, name: str) -> str:
        """Word for what an array of its own measures, where it is one we know."""
        word = self.string(f"{name.lower()}_quantity").lower()
        return word if word in (*get_args(Quantity), *get_args(SensorQuantity)) else ""

    def averages(self) -> int | None:
        """Number of averages, where the block tells it."""
        if self.get("averages") is None:
            return None
        values, where = self.numbers("averages").ravel(), self.where("averages")
        if values.size != 1 or not (1 <= values[0] <= MOST_AVERAGES) or values[0] != int(values[0]):
            raise refusal(where, values[:3].tolist(), f"one whole number from 1 to {MOST_AVERAGES}", "correct it")
        return int(values[0])

    def square_error(self, name: str, shape: tuple[int, ...], what: str, key: str) -> MeasurementError:
        """Refusal of an array that may lie either way."""
        found = f"shape {shape}, of which either axis can be that of the {what}"
        remedy = f'write {key} = "{self.path(name)}(:,1)" or "{self.path(name)}(1,:)" in [data.layout]'
        return refusal(self.where(name), found, "it to be told by the shape", remedy)

    def _own_units(self, name: str) -> list[str]:
        """Texts under a name such as ``H_unit``, ``unit_H`` or ``frequency_units``, for an array of that name."""
        small = name.lower()
        held = (key for key in (f"{small}_unit", f"{small}_units", f"unit_{small}") if is_text(self.get(key)))
        listed = self.arrays.get(self._lower.get("units", ""))
        told = {n.lower(): text for n, text in listed.items()} if isinstance(listed, dict) else {}
        of_struct = [strings(told[small], self.where("units"))] if is_text(told.get(small)) else []
        return next((texts for texts in (*map(self.strings, held), *of_struct) if any(texts)), [])


def size_of(value: Any) -> int:  # noqa: ANN401
    """Count of the numbers of an array, or of the arrays of a cell array; 0 of what is neither."""
    if isinstance(value, list):
        return sum(map(size_of, value))
    return value.size if isinstance(value, np.ndarray) and value.dtype.kind in "iufc" else 0


def is_complex(value: Any) -> bool:  # noqa: ANN401
    """Whether an array, or one of the cells, is of complex numbers."""
    return any(map(is_complex, value)) if isinstance(value, list) else np.iscomplexobj(value)


def is_text(value: Any) -> bool:  # noqa: ANN401
    """Whether something in a file is text."""
    return isinstance(value, (str, bytes)) or (isinstance(value, np.ndarray) and value.dtype.kind in "US")


def rises(value: Any) -> bool:  # noqa: ANN401
    """Whether something is an array of numbers each of which is above the one before, as on an axis."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "iuf" or value.size < 2:
        return False
    return bool((value.ravel()[1:] > value.ravel()[:-1]).all())


def numbers(values: Any, where: str, kind: type = np.float64) -> NDArray[Any]:  # noqa: ANN401
    """Array of numbers of a file as float or complex; of cells the columns of one."""
    if isinstance(values, list) and len({size_of(value) for value in values}) == 1 and size_of(values):
        return np.stack([numbers(value, where, kind).ravel() for value in values], axis=-1)
    array = np.asarray(None if isinstance(values, (list, dict)) else values)
    if array.dtype.kind == "c" and kind is np.float64 and not array.imag.any():
        array = array.real
    allowed, expected = ("iufc", "complex") if kind is np.complex128 else ("iuf", "real")
    if array.dtype.kind not in allowed:
        of_kind = _KINDS.get(array.dtype.kind, f"data of type {array.dtype}")
        what = values.what if isinstance(values, Unread) else of_kind
        raise refusal(where, what, f"{expected} numbers", "store it as a numeric array")
    return array.astype(kind, copy=False)


def strings(values: Any, where: str) -> list[str]:  # noqa: ANN401
    """Strings of a file: text, bytes, or an array or cell array of them; blanks at the end dropped."""
    if not is_text(values):
        raise refusal(where, "no text", "text", "store labels as strings")
    texts = np.ascontiguousarray(values).reshape(-1)
    if texts.dtype.kind == "S":
        return [text.decode("utf-8", errors="replace").rstrip() for text in texts.tolist()]
    # code points that no text has, which NumPy takes from a file as they are
    codes = texts.view(np.dtype(np.uint32).newbyteorder(texts.dtype.byteorder))
    bad = (codes > sys.maxunicode) | ((codes >= 0xD800) & (codes < 0xE000))
    if bad.any():
        raise refusal(where, f"the code {int(codes[np.argmax(bad)]):#x}, no character", "text", "save it again")
    return [text.rstrip() for text in texts.tolist()]


# ---- what the attributes of a data set say: unit, quantity, scale, offset, and what holds for its group

_MEASURED = ("quantity", "quantity_name", "measurand", "physical_quantity")
#: Factors and offsets that no convention applies: whether the numbers have them already is open.
_OFFSETS = {"offset", "intercept"}
_OPEN = {"scale", "scaling", "gain", "factor", "multiplier", "conversion", "slope", "calibration", *_OFFSETS}
_PLAIN = ("", "none", "linear", "identity", "no")
_OF_CONVENTIONS = ("scale_factor", "add_offset", "wf_start_offset")
_NETCDF = ("scale_factor", "add_offset", "_fillvalue", "missing_value")
#: Attributes of one data set that hold for its group.
_OF_GROUP = tuple(name for key in ("averages", "channels", "outputs", "inputs", "hits") for name in ALIASES[key])


def apply_attributes(arrays: Mapping[str, Any], place: str = "") -> dict[str, Any]:
    """Arrays of a group, and of those within it, as the attributes of each say they are.

    1. `scale_factor` and `add_offset` of netCDF are applied, fill values become NaN.
    2. Another factor or offset leaves the unit in doubt, so that a case has to state it.
    3. Unit and quantity of an array ``x`` become ``x_unit`` and ``x_quantity``.
    4. Rates, steps, averages and labels are those of the group where its data sets agree on them.

    Raises
    ------
    MeasurementError
        If one of netCDF's attributes is no number.
    """
    found = {
        name: apply_attributes(value, f"{place}{name}/") if isinstance(value, dict) else value
        for name, value in arrays.items()
        if ATTRIBUTE not in name
    }
    told: dict[str, dict[str, Any]] = {}
    of_group: dict[str, list[Any]] = {}
    for key, value in arrays.items():
        name, sign, attribute = key.rpartition(ATTRIBUTE)
        if sign and found.get(name) is not None:
            told.setdefault(name, {})[attribute.strip().lower()] = value
    for name, attributes in told.items():
        value, where = found[name], f"variable '{place}{name}'"
        # 1. number = stored · scale_factor + add_offset
        of_netcdf = {key: _number(attributes[key]) for key in _NETCDF if key in attributes}
        if size_of(value) and of_netcdf:
            if wrong := next((key for key, number in of_netcdf.items() if number is None), ""):
                raise refusal(where, f"no number in its {wrong}", "one", "correct the attribute")
            stored = numbers(value, where, np.complex128 if is_complex(value) else np.float64)
            scale, offset, *fills = (of_netcdf.get(key) for key in _NETCDF)
            unpacked = stored * (1.0 if scale is None else scale) + (offset or 0.0)
            for fill in (fill for fill in fills if fill is not None):
                unpacked[stored == fill] = np.nan
            found[name] = unpacked
        # 2. what may have to be applied
        open_ = {
            key: text for key, text in attributes.items() if key not in _OF_CONVENTIONS and _OPEN & {*tokens_of(key)}
        }
        neutral = {key: 0.0 if _OFFSETS & {*tokens_of(key)} else 1.0 for key in open_}
        plain = {key for key, text in open_.items() if is_text(text) and _text(text) in _PLAIN}
        doubts = [key for key, text in open_.items() if _number(text) != neutral[key] and key not in plain]
        doubts = doubts if size_of(value) > 1 else []
        # 3. unit and quantity
        units = unit_attribute(attributes)
        labels = strings(units, where) if is_text(units) else [] if units is None else ["(not read)"]
        labels = [label.partition(" since ")[0].strip() for label in labels]  # seconds since 1970-01-01
        if doubts:
            labels = [f"(attribute {', '.join(doubts)[:60]}: applied?) {label}".strip() for label in labels or [""]]
        if labels:
            found.setdefault(f"{name}_unit", np.array(labels))
        quantity = next((attributes[key] for key in _MEASURED if is_text(attributes.get(key))), None)
        if quantity is not None:
            found.setdefault(f"{name}_quantity", quantity)
        # 4. what is of the group
        frequency = "hz" in _text(attributes.get("wf_xunit_string")) or "freq" in _text(attributes.get("wf_xname"))
        labview = {"wf_increment": "df" if frequency else "dt", "wf_start_offset": "f_start" if frequency else ""}
        for attribute, stated in attributes.items():
            key = labview.get(attribute, attribute)
            number = _number(np.array(_text(stated).removesuffix("hz").strip())) if is_text(stated) else None
            stated = stated if number is None else np.array(number)
            if key in _OF_GROUP or meaning_of(key).role in ("rate", "interval", "f_step", "f_start"):
                of_group.setdefault(key, []).append(stated)
    for key, values in of_group.items():
        if all(np.array_equal(values[0], other) for other in values[1:]):
            found.setdefault(key, values[0])
        elif meaning_of(key).role in ("rate", "interval"):
            remedy = "write sample_rate_hz with the number in [data.layout], or store a group for each rate"
            raise refusal(f"group '{place}'", f"data sets of different {key}", "one rate in a group", remedy)
    return found


def _text(value: Any) -> str:  # noqa: ANN401
    """First text of an attribute in small letters; empty where there is none."""
    return str(np.ravel(value)[0]).lower() if is_text(value) and np.size(value) else ""


def _number(value: Any) -> float | None:  # noqa: ANN401
    """Number of an attribute, also of one stored as text; None of anything else."""
    plain = np.asarray(value)
    if plain.size != 1 or plain.dtype.kind not in "iufUS":
        return None
    return float_of(str(plain.astype(str).item())) if is_text(plain) else float(plain.item())


# ---- time histories

#: A time history: its channel, unit, the sensor that its name is, empty where it is none, and the hit.
_History = tuple[str, str, str, int | None]


def time_records(block: Block) -> Iterator[TimeRecord]:
    """Columns of `samples` with their channels, one array for each sensor with hits in columns, or arrays over time."""
    whole = size_of(block.get("samples")) > 1
    arrays = [("samples", _columns_of(block, "samples"))] if whole else [*_arrays_over_time(block)]
    left = block.unread(*(block.name_of(name) or name for name, _ in arrays))
    for name, samples in arrays:
        rate, notes = _rate(block, name, len(samples))
        histories = _histories_of(block, name, samples.shape[1])
        for (channel, unit, word, hit), values in zip(histories, samples.T, strict=True):
            if word:
                require_one_of(get_args(SensorQuantity), word, block.where("quantities"))
            factor, quantity, converted = read_sensor_unit(unit)
            if word and quantity not in (None, word):
                factor, converted = None, [f"unit {unit!r} is none of {word}, values left as written"]
            claimed = cast(SensorQuantity, word) if word else quantity or "unknown"
            place, said = f"{block.where(name)}, {channel!r}", (*notes, *converted, *left)
            yield TimeRecord(channel, rate, scaled(values, factor), claimed, unit, hit, place, said, factor)


def _arrays_over_time(block: Block) -> Iterator[tuple[str, Array]]:
    """Arrays that are time histories, sensors first, with their samples in columns."""
    sensors = [name for name, value in block.arrays.items() if name.lower() in SENSORS and size_of(value) > 1]
    timed = block.named("time") or (block.outer and block.outer.named("time"))
    clocked = timed or {block.scalar("rate"), block.scalar("interval")} != {None}
    others = [n for role in ("signal", "outputs", "inputs") for n in block.named(role) if n not in sensors]
    counts = {size_of(block.get(name)) for name in (*sensors, *others)}
    others += [n for n in block.named("") if block.named("time") or size_of(block.get(n)) in counts]
    for name in sorted(sensors, key=lambda name: SENSORS.index(name.lower())):
        yield name, _columns_of(block, name)
    for name in (n for n in others if clocked and not is_complex(block.get(n))):
        values = block.numbers(name)
        time = _instants(block, name, values.shape)
        if values.ndim > 2 or (time is None and (block.named("time") or values.size < 8)):
            continue
        if time is None:
            yield name, _columns_of(block, name)
            continue
        if values.ndim == 2 and values.shape[0] == values.shape[1]:
            raise block.square_error(name, values.shape, "instants", "response")
        values = values.reshape(values.shape[0], -1)  # as many along one axis as there are instants
        yield name, values if len(values) == time.size else values.T


def _histories_of(block: Block, name: str, count: int) -> list[_History]:
    """The columns of an array over time: hits of a sensor, channels, or of `samples` what the lists with it say."""
    small, units, several = name.lower(), block.units_of(name, count), count > 1
    if small in SENSORS:
        word = small if small != "response" else block.quantity_of(name)
        return [(small, unit, word, i + 1 if several else None) for i, unit in enumerate(units)]
    label, word = re.sub(r"(?i)^time_chan_(\d+)$", r"channel \1", name), block.quantity_of(name)
    if small in ("data", "values", "value") and block.place:  # of a struct or group for each channel
        label = re.split(r"[./]", block.place)[-2]
    if name != "samples":
        return [(f"{label} {i + 1}" if several else label, unit, word, None) for i, unit in enumerate(units)]
    channels = block.strings("channels") or [f"channel {i + 1}" for i in range(count)]
    units, words = block.units_of(name, count, alone=True), block.strings("quantities") or [""] * count
    hits = block.numbers("hits").ravel() if block.name_of("hits") else np.zeros(count)
    if not ((hits >= 0) & (hits <= MOST_RECORDS) & (hits == np.round(hits))).all():
        raise refusal(block.where("hits"), hits[:3].tolist(), "whole numbers from 1, 0 for none", "correct it")
    if not len(channels) == len(units) == len(words) == len(hits) == count:
        raise MeasurementError(
            f"{block.where('samples')}: found {count} columns; expected as many channels ({len(channels)}), units "
            f"({len(units)}), quantities ({len(words)}) and hits ({len(hits)}); correct them"
        )
    listed = zip(channels, units, words, hits, strict=True)
    return [(channel, unit, word, int(hit) or None) for channel, unit, word, hit in listed]


def axis_of(
    block: Block, name: str, shape: tuple[int, ...], roles: tuple[str, ...], key: str
) -> tuple[Block, str] | None:
    """The axis that belongs to an array, with its block: of the array's own name, or the one that fits its shape.

    It stands in the array's block or in the innermost outer one that has an axis; None where there is none that fits.

    Raises
    ------
    MeasurementError
        If two fit that differ, with `key` as the key of a layout that decides.
    """
    holder: Block | None = block
    while holder is not None:
        for role in roles:
            axes = holder.named(role)
            alike = [axis for axis in axes if holder.rest(axis) == block.rest(name)]
            fitting = [a for a in alike or axes if size_of(holder.get(a)) in shape and not is_complex(holder.get(a))]
            fitting = [axis for axis in fitting if holder.stated(axis)] or fitting
            for other in fitting[1:]:
                if not np.array_equal(holder.numbers(fitting[0]).ravel(), holder.numbers(other).ravel()):
                    found = f"found two axes for it, '{fitting[0]}' and '{other}', which differ"
                    either = f'{key} = "{holder.path(fitting[0])}" or "{holder.path(other)}"'
                    remedy = f"write {either} in [data.layout]"
                    raise MeasurementError.of(block.where(name), (), found, "one", remedy)
            if fitting:
                return holder, fitting[0]
        if roles == ("time",) and holder.named("time"):
            return None
        holder = holder.outer
    return None


def _instants(block: Block, name: str, shape: tuple[int, ...]) -> Array | None:
    """The time vector that belongs to an array."""
    found = axis_of(block, name, shape, ("time",), "time")
    return None if found is None else found[0].numbers(found[1]).ravel()


def _columns_of(block: Block, name: str) -> Array:
    """Samples in columns."""
    values = block.numbers(name)
    if values.ndim > 2 or values.size == 0:
        where = block.where(name)
        raise refusal(where, f"shape {values.shape}", "(samples, channels)", "correct the array")
    return values.reshape(-1, 1) if values.ndim < 2 or 1 in values.shape else values


def _rate(block: Block, name: str, samples: int) -> tuple[float, list[str]]:
    """Sampling rate of an array, in Hz, with notes; refused where two that are told differ by 1 %."""
    interval, axes = block.scalar("interval"), block.named("time")
    rates = [rate for rate in (block.scalar("rate"), 1 / interval if interval else None) if rate is not None]
    possible = all(1 / HIGHEST_HZ <= rate <= HIGHEST_HZ for rate in rates)
    if not possible or (not rates and block.name_of("sample_rate_hz")):
        found, remedy = f"{rates[0]:g}" if rates else "no one number", "correct it"
        raise refusal(block.where("sample_rate_hz"), found, f"one number above 0 and up to {HIGHEST_HZ:g} Hz", remedy)
    time, notes = None if block.stated("sample_rate_hz") else _instants(block, name, (samples,)), []
    where = block.where(axes[0] if axes else "time")
    if time is not None:
        unit = next(filter(None, map(block.unit_of, axes)), "ms" if any("ms" in block.hints(a) for a in axes) else "s")
        scale = TIME_S.get(unit.lower())
        if unit == "s" and time.size and _DAYS[0] <= time.min() and time.max() <= _DAYS[1] and np.ptp(time) < 1:
            unit, scale = "days (datenum of MATLAB)", 86400.0
        if scale is None:
            raise refusal(where, f"the unit {unit!r}", "s or ms", "correct it")
        notes = [f"instants in {unit} converted to s"] if scale != 1 else []
        instants = (time - time[:1]) * scale
        span = max(float(np.ptp(instants)), 1 / HIGHEST_HZ)
        rates.append((time.size - 1) / span if rates else even_rate(instants, where))
    elif not rates and axes:
        count = size_of(block.get(axes[0]))
        raise refusal(where, f"{count} instants", f"{samples}, one for each", "correct it")
    elif not rates:
        found = "no sampling rate"
        raise refusal(block.where(name), found, "'sample_rate_hz' or 'time'", f"write in [data.layout] {RATE_KEY}")
    if not max(rates) / min(rates) - 1 < 1e-2:
        by_axis = f'time = "{block.path(axes[0])}" or ' if axes else f'sample_rate_hz = "{rates[-1]:.9g}" or '
        found = f"sampling rates of {rates[-1]:.6g} Hz and {rates[0]:.6g} Hz"
        raise refusal(where, found, "one", f'write {by_axis}sample_rate_hz = "{rates[0]:.9g}" in [data.layout]')
    return rates[0], notes
