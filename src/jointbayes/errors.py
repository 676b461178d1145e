"""The errors a user may see: each is one line that says where, what, what is expected and what to do."""

from __future__ import annotations

from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

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
        Characters that stay whatever they are.

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


class JointBayesError(Exception):
    """Base of every error that a user's input can cause; the CLI prints it and exits 2.

    As text it is one line that is safe on a terminal, whatever names of files and channels are in it.
    """

    def __str__(self) -> str:
        return printable(super().__str__())


class CaseError(JointBayesError):
    """A case file cannot be read or asks for something that does not exist; one line for each fault."""

    def __str__(self) -> str:
        return printable(Exception.__str__(self), keep="\n")


class MeasurementError(JointBayesError):
    """Measured data are malformed, inconsistent or not usable; `key` of the table of the data is to blame, if any."""

    def __init__(self, message: str, *key: str) -> None:
        super().__init__(message)
        self.key = key


class ModelError(JointBayesError):
    """A structure, joint or forward model is not physically or numerically possible."""


class SamplingError(JointBayesError):
    """The sampler was set up in a way that cannot give draws."""


class WorkerError(JointBayesError):
    """The processes that tasks are spread over cannot be had, or end one after the other."""


class CheckpointError(JointBayesError):
    """A run cannot go on from where it stopped, or must not be begun there."""


class WriteError(JointBayesError):
    """A file cannot be written: no room, no permission, or something else is there."""


class ReportError(JointBayesError):
    """A report failed after its draws were made; the message names the file that holds them."""


class ReportInterruptedError(KeyboardInterrupt):
    """A report was interrupted after its draws were made; the message names the file that holds them."""


class TerminatedError(KeyboardInterrupt):
    """The program was asked to end by SIGTERM or SIGHUP."""


def shown(given: object) -> str:
    """What a user gave, as a message names it: text, numbers and None as they are typed, all else by its kind."""
    return repr(given) if given is None or isinstance(given, str | bool | int | float) else type(given).__name__


def require(given: object, kind: Any, what: str, expected: str, within: Callable[[Any], bool] | None = None) -> None:  # noqa: ANN401
    """Refuse an argument that is of no such kind, or that `within` is not true of; True and False are no numbers.

    Parameters
    ----------
    given
        What a user gave.
    kind
        Type or union of types, as of `isinstance`.
    what
        Where it was given, before what was found.
    expected
        What is expected, and what to do.
    within
        What must be true of a value of this kind.

    Raises
    ------
    ModelError
        If it is something else: where, what, and what is expected.
    """
    if isinstance(given, bool) or not isinstance(given, kind) or (within is not None and not within(given)):
        raise ModelError(f"{what} {shown(given)}; expected {expected}")


def require_probability(given: object, where: str) -> None:
    """Refuse what is no probability inside (0, 1).

    Raises
    ------
    ModelError
        If it is none.
    """
    require(given, Real, f"{where}: found probability", "a number between 0 and 1, such as 0.95", lambda p: 0 < p < 1)


def require_count(given: object, what: str, least: int = 1) -> None:
    """Refuse what is no whole number, `least` or more.

    Raises
    ------
    ModelError
        If it is none.
    """
    require(given, Integral, what, f"a whole number, {least} or more; correct it", lambda count: count >= least)


def array_of(given: object, kind: type, what: str, error: type[JointBayesError]) -> NDArray[Any]:
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
