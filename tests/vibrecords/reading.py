"""What tests of readers share: a file of some content, its records held against what is expected, its refusal."""

import re

import numpy as np
import pytest

from tests.vibrecords.array_trees import WRITERS
from vibrecords.errors import MeasurementError
from vibrecords.formats import iter_records


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


def refusal(path, content, expected="", layout=None, read=None):
    """The one line by which a file with this content, bytes, text or a tree of arrays, is refused."""
    put(path, content)
    with pytest.raises(MeasurementError) as caught:
        read(path) if read else list(iter_records(path, layout))
    message = str(caught.value)
    assert message.startswith(f"{path}: "), message
    assert re.search(expected, message), message
    assert "\n" not in message
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
