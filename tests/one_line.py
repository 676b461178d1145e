"""What cannot be is refused in one line that says what was expected."""

from collections.abc import Callable

import pytest


def refused(make: Callable[[], object], kind: type[Exception], words: str = "expected") -> None:
    """Hold the error that making something raises against what every refusal is."""
    with pytest.raises(kind) as caught:
        make()
    message = str(caught.value)
    assert words in message
    assert "expected" in message
    assert "\n" not in message
