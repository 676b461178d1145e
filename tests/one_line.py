"""What cannot be is refused in one line that says what was expected."""

import re
from collections.abc import Callable, Container

import pytest


def refused(make: Callable[[], object], kind: type[Exception], words: str = "expected") -> str:
    """Hold the error that making something raises against what every refusal is, and return what it says."""
    with pytest.raises(kind) as caught:
        make()
    message = str(caught.value)
    assert words in message or re.search(words, message), message
    assert "expected" in message
    assert "\n" not in message
    return message


def says(text: Container[object], *words: object) -> None:
    """Hold a text, or what else may hold something, against all that it has to hold."""
    assert [word for word in words if word not in text] == []
