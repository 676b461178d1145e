"""What the attributes of a data set say of its numbers: unit, quantity, scale, offset, and what holds for its group."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from vibrecords.errors import refusal
from vibrecords.formats.matlab_5 import ATTRIBUTE
from vibrecords.formats.named_arrays import (
    ALIASES,
    is_complex,
    is_text,
    meaning_of,
    numbers,
    size_of,
    strings,
    tokens_of,
)
from vibrecords.formats.table_text import float_of
from vibrecords.formats.units import unit_attribute

_QUANTITIES = ("quantity", "quantity_name", "measurand", "physical_quantity")
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
        quantity = next((attributes[key] for key in _QUANTITIES if is_text(attributes.get(key))), None)
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
