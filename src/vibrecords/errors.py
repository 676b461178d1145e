"""The errors a user may see: each is one line that says where, what, what is expected and what to do."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from numpy.typing import NDArray

#: What `str.isspace` is true of and a terminal does not show as a blank.
_NO_BLANKS = "\t\n\v\f\r\x1c\x1d\x1e\x1f\x85\u2028\u2029"


def path_fault(error: OSError | ValueError) -> str:
    """What is wrong with a path; a null byte in it is a ValueError, which every Python words otherwise."""
    return (error.strerror or str(error)) if isinstance(error, OSError) else "embedded null byte"


def printable(text: str, keep: str = "") -> str:
    r"""Text with every character escaped that does not print, as `repr` escapes it.

    These are control characters (of C0 and C1, so that no name changes colours or moves the cursor), marks that turn
    the direction of writing, invisible ones, and halves of surrogate pairs. Blanks of all widths stay.

    Parameters
    ----------
    text
        Any text: a file's name, a label in a file.
    keep
        Characters that stay as they are.

    Examples
    --------
    >>> print(printable("tip\x1b[31m\u202e of Mößler"))
    tip\x1b[31m\u202e of Mößler
    """
    if text.isprintable():
        return text
    return "".join(
        c
        if c.isprintable() or c in keep or (c.isspace() and c not in _NO_BLANKS)
        else c.encode("unicode_escape").decode("ascii")
        for c in text
    )


class UserError(Exception):
    """Base of every error that a user's input can cause; a command prints it and exits 2.

    As text it is one line that is safe on a terminal, with any names of files and channels in it. What refuses its
    fields says by `key` which one is to blame, and by `words` what was found, what is expected and what to do, so that
    whoever read that field from a file can put file, line and key in front of them.
    """

    def __init__(self, message: str = "", *key: str | int) -> None:
        super().__init__(message)
        found, _, rest = message.partition("; expected ")
        expected, _, remedy = rest.partition("; ")
        self.key, self.words = key, (found, expected, remedy)

    @classmethod
    def of(cls, where: str, key: tuple[str | int, ...], found: str, expected: str, remedy: str = "") -> Self:
        """The error of one field, by its key: where: found; expected; what to do."""
        error = cls("; ".join((f"{where}: {found}", f"expected {expected}", *[remedy] * bool(remedy))), *key)
        error.words = found, expected, remedy
        return error

    def __str__(self) -> str:
        return printable(super().__str__())


class MeasurementError(UserError):
    """Measured data are malformed, inconsistent or not usable."""


def refusal(where: object, found: object, expected: object, remedy: object = "") -> MeasurementError:
    """Return the error to raise: where: found this; expected that; what to do."""
    return MeasurementError.of(f"{where}", (), f"found {found}", f"{expected}", f"{remedy}")


@contextmanager
def placed(where: object) -> Iterator[None]:
    """Put the place in front of what is refused within.

    Raises
    ------
    MeasurementError
        What the body raises, with its place.
    """
    try:
        yield
    except MeasurementError as error:
        raise MeasurementError(f"{where}: {error}") from None


class WriteError(UserError):
    """A file cannot be written: no room, no permission, or something else is there."""


def require_one_of(allowed: Collection[str], word: str, where: str, what: str = "", remedy: str = "correct it") -> None:
    """Refuse a word that is none of those allowed; `what` it is stands before it in the message.

    Raises
    ------
    MeasurementError
        Naming all that are allowed.
    """
    if word not in allowed:
        raise MeasurementError(f"{where}: found {what}{word!r}; expected one of {', '.join(allowed)}; {remedy}")


def require_at_most(most: int, count: int, where: str, what: str, remedy: str) -> None:
    """Refuse more of something than any measurement has.

    Raises
    ------
    MeasurementError
        Naming both numbers.
    """
    if count > most:
        raise MeasurementError(f"{where}: found {count} {what}; expected at most {most}; {remedy}")


def array_of(given: object, kind: type, what: str, error: type[UserError]) -> NDArray[Any]:
    """A copy of what a user gave, as an array of floats or complex numbers.

    Parameters
    ----------
    given
        Array, list or number.
    kind
        ``float`` or ``complex``.
    what
        What it is to be, for the message.
    error
        Raised where it is no array of such numbers: text, lists of different length, complex numbers for floats.
    """
    import numpy as np

    try:
        found = np.array(given, order="C")  # sums over the same numbers laid out otherwise differ in the last digit
        if found.dtype.kind not in ("biuf" if kind is float else "biufc") and found.dtype != object:
            raise TypeError
        with np.errstate(over="ignore"):
            if kind is float and np.iscomplexobj(found):
                raise TypeError
            return found.astype(kind)
    except (TypeError, ValueError, OverflowError):
        numbers = "real numbers" if kind is float else "numbers"
        raise error(f"{what}: found no array of {numbers}; expected one; convert it before") from None


def read_only(given: object, kind: type = float) -> NDArray[Any]:
    """The same for measured data, which cannot be written to."""
    copied = array_of(given, kind, "data", MeasurementError)
    copied.setflags(write=False)
    return copied
