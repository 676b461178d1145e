"""What tests of readers share: a file of some content, its records held against what is expected, its refusal."""

import json
import re
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.vibrecords.array_trees import WRITERS
from vibrecords.errors import MeasurementError
from vibrecords.formats import iter_records
from vibrecords.records import CoherenceRecord, FrfRecord, ModeRecord, SpectrumRecord, TimeRecord

WORDS = tomllib.loads(Path(__file__).with_name("words.toml").read_text(encoding="utf-8"))
G, LBF = 9.80665, 4.4482216152605
F = 20.0 + 2.5 * np.arange(12)
T = np.arange(16) / 2048


def numbers(first, size):
    """Numbers of few digits, none of which is 0."""
    some = ((np.arange(size) + first) * 7 % 13 - 6) / 4
    return np.where(some == 0, 0.25, some)


H, H2 = (numbers(k, 12) + 1j * numbers(k + 3, 12) for k in (25, 31))
M, G2 = np.abs(H), 0.5 + ((np.arange(12) + 37) * 7 % 13 + 1) / 32
A, B, C = numbers(40, 48).reshape(3, 16)
ONE = np.ones(12)
_KINDS = {
    "FRF": (FrfRecord, {"response": "output 1", "reference": "input 1", "quantity": None, "coherence": None}),
    "time": (TimeRecord, {"sample_rate_hz": 2048.0, "quantity": "unknown", "hit": None}),
    "spectrum": (SpectrumRecord, {}),
    "coherence": (CoherenceRecord, {}),
    "mode": (ModeRecord, {}),
}


def _array(text):
    """Numbers that layouts.txt calls ``9.8 A``, ``G2 backwards`` or ``B 9``."""
    factor, name, back, count = re.fullmatch(r"(?:([\d.]+) )?([A-Z]+\d?)( backwards)?(?: (\d+))?", text).groups()
    return float(factor or 1) * globals()[name][:: -1 if back else 1][: count and int(count)]


def _expected(line):
    told = json.loads(line)
    kind, default = _KINDS[told.pop("type")]
    told = {"type": kind, **default, **({"factor": 1.0} if kind in (FrfRecord, TimeRecord) else {}), **told}
    told |= {key: _array(told[key]) for key in ("values", "coherence") if told.get(key)}
    told |= {"notes": tuple(told["notes"])} if "notes" in told else {}
    told |= {"shape": {dof: complex(value) for dof, value in told["shape"].items()}} if "shape" in told else {}
    return told if kind is TimeRecord or "values" not in told else told | {"frequency_hz": F}


@cache
def layouts():
    """Files of layouts.txt by name: content, and what is expected of its records."""
    table, found = Path(__file__).with_name("layouts.txt").read_text(encoding="utf-8"), {}
    for part in table.split("\n== ")[1:]:
        file, _, records = part.partition("\n--\n")
        name, _, content = file.partition("\n")
        found[name] = content + "\n", [_expected(line) for line in records.split("\n") if line.startswith("{")]
    return found


def put(path, content):
    """Write bytes, text, or a tree of arrays as MATLAB 5 has it; None leaves what is there."""
    if isinstance(content, dict):
        WRITERS["mat"](content, path)
    elif content is not None:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def records_of(path, content=None, **layout):
    """Records of a file of this content."""
    return list(iter_records(put(path, content), layout))


def only(path, content=None, **layout):
    """The one record of a file of this content."""
    (record,) = records_of(path, content, **layout)
    return record


def refusal(path, content=None, expected="", layout=None, read=None):
    """The one line by which a file with this content, bytes, text or a tree of arrays, is refused."""
    put(path, content)
    with pytest.raises(MeasurementError) as caught:
        read(path) if read else list(iter_records(path, layout))
    message = str(caught.value)
    assert message.startswith(f"{path}: "), message
    assert re.search(expected, message), message
    assert message.isprintable()
    assert "expected" in message
    assert len(message) < 1200
    return message


def require(records, expected, rtol=1e-12):
    """Hold records against what is expected of each: its kind, and some of its fields."""
    assert [type(record) for record in records] == [wanted["type"] for wanted in expected], records
    for record, wanted in zip(records, expected, strict=True):
        for key, value in wanted.items():
            found = getattr(record, key, None)
            if isinstance(value, (float, list, np.ndarray)):
                assert np.shape(found) == np.shape(value), key
                np.testing.assert_allclose(found, value, rtol=1e-15 if key == "factor" else rtol, err_msg=key)
            elif key != "type":
                assert found == value, key
