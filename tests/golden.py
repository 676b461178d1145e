"""Golden pages: what was said is kept in files; words are compared one by one, numbers to a share of them.

`GOLDEN=update pytest -n 0 tests/…` keeps what is said now; read the diff.
"""

import os
from itertools import zip_longest

import pytest

from tests.same.compare import masked
from tests.same.record import NUMBER, number

#: Numbers of a page may differ by this share, for a climb ends elsewhere by another arithmetic.
NEAR = 0.02


def require_kept(path, found, loose=()):
    """Compare lines with those that a file keeps, numbers loosely where a line begins so."""
    if os.environ.get("GOLDEN") == "update":
        path.parent.mkdir(exist_ok=True)
        path.write_text("\n".join(found) + "\n", encoding="utf-8")
    kept = path.read_text(encoding="utf-8").splitlines()
    for one, other in zip_longest(kept, found, fillvalue=""):
        assert masked(other) == masked(one), f"{path.name}: kept {one!r}"
        values = [[number(text) for text in NUMBER.findall(line)] for line in (one, other)]
        if not one.startswith(loose):
            assert values[1] == pytest.approx(values[0], rel=NEAR, abs=1e-4), f"{path.name}: {one!r}, found {other!r}"


def require_lines(path, found):
    """Compare lines with those that a file keeps, each to the last letter."""
    if os.environ.get("GOLDEN") == "update":
        path.write_text("\n".join(found) + "\n", encoding="utf-8")
    assert found == path.read_text(encoding="utf-8").splitlines()
