"""What cannot be is refused in one line that says what was expected."""

import re
from collections.abc import Callable

import pytest


def refused(make: Callable[[], object], kind: type[Exception], words: str = "expected") -> None:
    """Hold the error that making something raises against what every refusal is."""
    with pytest.raises(kind) as caught:
        make()
    message = str(caught.value)
    assert words in message or re.search(words, message), message
    assert "expected" in message
    assert "\n" not in message
