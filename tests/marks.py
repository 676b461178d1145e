"""Marks that tests of every room share."""

from collections.abc import Sequence

import pytest


def first_in_ci(items: Sequence[object], count: int) -> list[object]:
    """Parameters of a test, of which CI takes the first; `make science` takes the rest, and all of a science test."""
    rest = (item if isinstance(item, tuple) else (item,) for item in items[count:])
    marks = pytest.mark.science, pytest.mark.long
    return [*items[:count], *(pytest.param(*item, marks=marks) for item in rest)]
