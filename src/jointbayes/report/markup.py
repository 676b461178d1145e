r"""The one reading of report text that HTML and PDF share: bold, code, numbers, and words that are not ours.

Text is parsed here, in Python, into runs that the templates print as they are. No template evaluates a
user's text, so neither ``<script>`` nor ``#panic()`` in a case name can do anything but be read. What comes from a
file, `foreign`, is not read for markup either, and is isolated: it turns nothing around it from right to left.
"""

import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from jointbayes.inference import Problem
from jointbayes.phrases import NO_VALID_VALUE
from jointbayes.posterior.identifiability import VerdictClass

Kind: TypeAlias = Literal["good", "caution", "bad"]
#: Uncertain quantities in a sentence, and on an axis.
_WORDS = {
    "youngs_modulus": ("Young's modulus", "ln E"),
    "density": ("density", "ln density"),
    "length": ("length", "ln L"),
    "length_offset": ("offset of the length", "L offset"),
    "section_size": ("size of the section", "ln size"),
    "shear_coefficient": ("shear coefficient", "ln κ"),
    "axial_force": ("axial force", "ln N"),
    "damping_ratio": ("damping ratio", "ln ζ"),
    "loss_factor": ("loss factor", "ln η"),
    "accelerometer_mass": ("accelerometer mass", "ln mass"),
    "gain": ("gain", "ln gain"),
    "noise_scale": ("noise, factor on the stated", "ln noise"),
}

_BOLD = re.compile(r"\*\*(?=\S)(.+?)(?<=\S)\*\*")
_CODE = re.compile(r"`([^`]+)`")
# A digit, dot or letter on either side means the "number" is a piece of something longer (hash, version).
_SCIENTIFIC = re.compile(r"(?<![\w.])([-+−]?)(\d+(?:\.\d+)?)[eE]([-+−]?)(\d{1,3})(?!\w|\.\d)")
_NEGATIVE = re.compile(r"(?<![\w.)\]-])-(?=\.?\d)")
_PERCENT = re.compile(r"(?<=\d) (?=%)")
_BLANKS = re.compile(r"[ \t\n]+")  # not \s: a no-break space is there on purpose
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ufff9-\ufffb\ufffe\uffff]")
#: What turns the direction of all that follows; they are shown as `repr` shows them.
_TURNS = re.compile("[\u202a-\u202e\u2066\u2067]")
_OPEN, _CLOSE = "\u2068", "\u2069"  # first strong isolate, pop directional isolate
#: A stretch of foreign text as `Run.text` holds it: its words are the group.
ISOLATED = re.compile(f"{_OPEN}([^{_OPEN}{_CLOSE}]*){_CLOSE}")
_PLACE = "\ufff9"  # stands for such a stretch while markup is read; no text has it, see _CONTROL
SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
#: Mark of a callout of each kind.
SYMBOLS: dict[Kind, str] = {"good": "✓", "caution": "!", "bad": "✗"}


def coordinate_labels(problem: Problem) -> list[str]:
    """Short label of each coordinate for an axis: of the joint, then of what else is uncertain."""
    axes = problem.parametrisation.axes
    return [axis.label for axis in axes] + [nuisance_label(name) for name in problem.names[len(axes) :]]


def _worded(name: str) -> tuple[str, str]:
    """An uncertain quantity in a sentence and on an axis; of one body or test with its name."""
    owner, _, quantity = name.rpartition(".")
    if owner:
        words, label = _worded(quantity)
        return f"{words} of {owner}", f"{label} {owner}"
    if name.startswith("damping_ratio_"):
        mode = name.rsplit("_", 1)[1]
        return f"damping ratio of mode {mode}", f"ln ζ{mode}"
    return _WORDS.get(name, (name, f"ln {name}"))


def nuisance_label(name: str) -> str:
    """Short label of an uncertain quantity for an axis."""
    return _worded(name)[1]


def readable(name: str) -> str:
    """Name of an uncertain quantity in a sentence."""
    return _worded(name)[0]


def listed_names(names: Sequence[str]) -> str:
    """Names in a sentence."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


@dataclass(frozen=True, slots=True)
class Run:
    """A stretch of text in one style.

    Parameters
    ----------
    text : str
        Literal text; numbers outside code are already typeset. Foreign words stand between U+2068 and U+2069.
    bold, code : bool
        Style.
    """

    text: str
    bold: bool = False
    code: bool = False


@dataclass(frozen=True, slots=True)
class Badge:
    """How a verdict is shown: by colour and by symbol, since colour alone is lost on some readers.

    Parameters
    ----------
    kind : {"good", "caution", "bad"}
        Colour.
    symbol : str
        One character.
    """

    kind: Kind
    symbol: str


_BADGES: dict[VerdictClass | str, Badge] = {
    "identified": Badge("good", "✓"),
    "weakly identified": Badge("caution", "~"),
    "not identified": Badge("bad", "✗"),
    "bounded below": Badge("caution", "≥"),
    "bounded above": Badge("caution", "≤"),
    "no verdict": Badge("bad", "✗"),
    NO_VALID_VALUE: Badge("bad", "✗"),
}


def badge(cell: str) -> Badge | None:
    """Badge of a table cell that is a verdict on identifiability, None for any other cell.

    Examples
    --------
    >>> badge("not identified")
    Badge(kind='bad', symbol='✗')
    >>> badge("5.05e9") is None
    True
    """
    return _BADGES.get(cell.strip())


def kind_of(verdict: str) -> Kind | Literal[""]:
    """Colour of a row that says this verdict; empty for what is no verdict.

    Examples
    --------
    >>> kind_of("weakly identified"), kind_of("identified"), kind_of("12.5")
    ('caution', 'good', '')
    """
    mark = badge(verdict)
    return mark.kind if mark else ""


def clean(text: str) -> str:
    r"""Text without what neither HTML nor PDF can carry, and without what turns the direction of lines.

    Examples
    --------
    >>> clean("a\x00b\udc80")
    'ab?'
    """
    text = _CONTROL.sub("", text.encode("utf-8", "replace").decode("utf-8").replace("\r\n", "\n"))
    return _TURNS.sub(_escaped, text)


def _escaped(match: re.Match[str]) -> str:
    return match.group().encode("unicode_escape").decode("ascii")


def foreign(text: str) -> str:
    r"""Text of a file or a user, for a place in a report's text: literal, and isolated from the words around it.

    Text that is neither markup nor runs from right to left needs nothing and stays as it is.

    Examples
    --------
    >>> [run.text for run in parse("of **" + foreign("a**2 `b`") + "**")]
    ['of ', '\u2068a**2 `b`\u2069']
    """
    words = re.sub(f"[{_OPEN}{_CLOSE}]", _escaped, clean(text))
    words = _BLANKS.sub(" ", words).strip(" ")
    return f"{_OPEN}{words}{_CLOSE}" if "**" in words or "`" in words or _runs_leftward(words) else words


def _typeset(match: re.Match[str]) -> str:
    sign, mantissa, exponent_sign, digits = match.groups()
    shown = ("−" if sign in ("-", "−") and sign else sign) + mantissa
    exponent = int(digits)
    if exponent == 0:
        return shown
    power = f"{'-' if exponent_sign in ('-', '−') and exponent_sign else ''}{exponent}"
    # No-break spaces: a power of ten alone on the next line would be misread.
    return f"{shown}\u00a0×\u00a010{power.translate(SUPERSCRIPTS)}"


def format_numbers(text: str) -> str:
    r"""Text with its numbers typeset: powers of ten, true minus signs, and per cent signs on the line of their number.

    Superscripts are characters, not styling, so that a number copied from a report stays the same number.

    Parameters
    ----------
    text : str
        Text in which numbers are written as Python writes them.

    Returns
    -------
    str
        The text for the reader.

    Examples
    --------
    >>> format_numbers("1.52e+06 N·m/rad").replace("\xa0", " ")
    '1.52 × 10⁶ N·m/rad'
    >>> format_numbers("-3.1e-7 to -0.5").replace("\xa0", " ")
    '−3.1 × 10⁻⁷ to −0.5'
    >>> format_numbers("a1e5 2026-01-05 1.2e3.4")
    'a1e5 2026-01-05 1.2e3.4'
    """
    return _PERCENT.sub("\u00a0", _NEGATIVE.sub("−", _SCIENTIFIC.sub(_typeset, text)))


def _code_runs(text: str, *, bold: bool) -> list[Run]:
    # Splitting on one group alternates text, code, text, ...
    return [
        Run(piece if index % 2 else format_numbers(piece), bold=bold, code=bool(index % 2))
        for index, piece in enumerate(_CODE.split(text))
        if piece
    ]


def parse(text: str) -> tuple[Run, ...]:
    """Split a text with ``**bold**`` and `` `code` `` into runs; everything else is literal.

    Parameters
    ----------
    text : str
        Text of a report; line breaks count as spaces, marks that are not closed and `foreign` words are literal.

    Returns
    -------
    tuple of Run
        In reading order; numbers outside code are typeset by :func:`format_numbers`.

    Examples
    --------
    >>> [(run.text, run.bold, run.code) for run in parse("**Converged:** see `k12`")]
    [('Converged:', True, False), (' see ', False, False), ('k12', False, True)]
    """
    text = _BLANKS.sub(" ", clean(text)).strip(" ")
    words = iter(ISOLATED.findall(text))
    text = re.sub(f"[{_OPEN}{_CLOSE}]", "", ISOLATED.sub(_PLACE, text))
    runs: list[Run] = []
    end = 0
    # bold stretches, except asterisks that belong to a code span (``a**2 * b**2`` is an expression)
    code = [match.span() for match in _CODE.finditer(text)]
    hidden = list(text)
    for start, stop in code:
        hidden[start:stop] = "\ufffc" * (stop - start)
    for match in _BOLD.finditer("".join(hidden)):
        runs += _code_runs(text[end : match.start()], bold=False)
        runs += _code_runs(text[match.start(1) : match.end(1)], bold=True)
        end = match.end()
    runs += _code_runs(text[end:], bold=False)
    return tuple(replace(run, text=_restore_words(run, words)) for run in runs)


def _restore_words(run: Run, words: Iterator[str]) -> str:
    """The text of a run with the foreign words that its places stand for."""
    typeset = str if run.code else format_numbers
    return re.sub(_PLACE, lambda _: f"{_OPEN}{typeset(next(words))}{_CLOSE}", run.text)


def plain_characters(text: str) -> str:
    """Text of a run for places that take only characters: isolates stay where words run from right to left."""
    return ISOLATED.sub(lambda words: words[0] if _runs_leftward(words[1]) else words[1], text)


def _runs_leftward(words: str) -> bool:
    return not words.isascii() and any(unicodedata.bidirectional(character) in ("R", "AL", "AN") for character in words)


def plain(text: str) -> str:
    """Text without its markup, for places that take only characters (document title, alternative text).

    Examples
    --------
    >>> plain("Stiffness of `k12`")
    'Stiffness of k12'
    """
    return plain_characters("".join(run.text for run in parse(text)))
