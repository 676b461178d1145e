"""Objects from what JSON has of them, each number by its type and range; arrays of finite numbers among them."""

import json
import math
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import PlainValidator, TypeAdapter, ValidationError

from jointbayes.errors import MeasurementError
from vibrecords.arrays import Array

Kind = TypeVar("Kind")

#: What to do about any file that holds something else.
REMEDY = "sample again, or take another copy of the file"
_SHOWN = 60  # characters of a wrong value in a message


def _finite_numbers(plain: object) -> Array:
    cells = np.array(plain, dtype=object)  # rows of several lengths stay lists, which are no numbers
    if not isinstance(plain, list) or any(type(x) not in (int, float) or not math.isfinite(x) for x in cells.flat):
        raise ValueError("an array of finite numbers")
    return cells.astype(float)


#: A field of a stored object that holds an array.
StoredArray = Annotated[Array, PlainValidator(_finite_numbers)]


def stored_value(kind: type[Kind], plain: Any, place: str) -> Kind:  # noqa: ANN401 (JSON)
    """A data class, or a dictionary of a type, from what JSON has of it.

    Fields that a later version adds do not matter, and one that has a default may be missing.

    Parameters
    ----------
    kind
        The type.
    plain
        What JSON has of it.
    place
        Where it stands, for the message.

    Raises
    ------
    MeasurementError
        If it is something else: where, and what.
    """
    try:
        return TypeAdapter(kind).validate_json(json.dumps(plain), strict=True)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        where = ".".join([place, *map(str, fault["loc"])])
        shown = "nothing" if fault["type"] == "missing" else repr(fault["input"])
        shown = shown if len(shown) <= _SHOWN else f"{shown[:_SHOWN]}…"
        expected = fault["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
        expected = "the field" if fault["type"] == "missing" else expected
        raise MeasurementError(f"{where}: found {shown}; expected {expected}; {REMEDY}") from None
