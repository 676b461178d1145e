"""What a report says, independent of how it is printed: formatted text, tables and figures, no physics.

Values arrive as strings that are already rounded (``"5.05e9"``, ``"1.52e6 N·m/rad"``); the renderers in
:mod:`jointbayes.report.html` and :mod:`jointbayes.report.pdf` decide only how they look. Every text field
may carry ``**bold**`` and `` `code` `` and nothing else (see :mod:`jointbayes.report.markup`).
"""

import datetime
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from itertools import chain, count
from typing import Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.report.markup import Kind as Kind
from jointbayes.rounding import align_columns
from vibrecords.arrays import Array

SeriesKind: TypeAlias = Literal["line", "points", "band"]

SERIES_COLOURS = ("#1f5a94", "#c1511b", "#2b7a55", "#8b4a8f", "#8a6d00", "#3d8fb0", "#5b6672", "#b03a5b")
"""Colours of the interactive series in order; a static figure that uses the same order matches its twin."""


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """One curve, set of points or band of an interactive plot.

    Parameters
    ----------
    name : str
        Legend entry.
    x : array_like, shape (n,)
        Strictly increasing, finite abscissae; series of one plot need not share them.
    y : array_like, shape (n,), optional
        Finite ordinates. A band may leave it empty, or give the centre line.
    kind : {"line", "points", "band"}
        How to draw it.
    y_low, y_high : array_like, shape (n,), optional
        Edges of a band, and only of a band.
    dashed : bool
        Draw the line dashed.
    """

    name: str
    x: ArrayLike
    y: ArrayLike = ()
    kind: SeriesKind = "line"
    y_low: ArrayLike = ()
    y_high: ArrayLike = ()
    dashed: bool = False

    @property
    def columns(self) -> tuple[Array, ...]:
        """x, y, y_low and y_high as arrays, shape (n,) each, or (0,) where there are none."""
        x, y, low, high = (np.asarray(values, dtype=float) for values in (self.x, self.y, self.y_low, self.y_high))
        return x, y, low, high


@dataclass(frozen=True, slots=True)
class LinePlot:
    """The interactive twin of a figure: the same numbers, to zoom and read off.

    Parameters
    ----------
    x_label, y_label : str
        Axis titles with units, plain text.
    series : tuple of Series
        Drawn bands first, then lines, then points; colours follow :data:`SERIES_COLOURS` in this order.
    log_y : bool
        Whether the vertical axis is logarithmic; then all ordinates are positive.
    """

    x_label: str
    y_label: str
    series: tuple[Series, ...]
    log_y: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class FrfCurve:
    """One FRF among others: its legend entry, complex values of shape (lines,), and how it is drawn.

    A curve that is `hidden` is drawn once the reader asks for it.
    """

    name: str
    values: NDArray[np.complex128]
    colour: str
    dashed: bool = False
    hidden: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class FrfPlot:
    """One FRF, measured and predicted: magnitude, phase, parts and Nyquist plot are views of the same numbers.

    Parameters
    ----------
    pair : tuple of str
        Labels of output and input.
    place : tuple of int
        Of the pair among outputs and inputs.
    quantity, unit : str
        What it is, such as ``"receptance"``, and its unit.
    frequency_hz : ndarray, shape (lines,)
        Lines, Hz.
    curves : tuple of FrfCurve
        Measured first, median last.
    band : tuple of ndarray, shape (lines,)
        Lower and upper end of the 95 % band as complex numbers: of the magnitude and of the phase.
    misfit : ndarray, shape (lines,)
        Distance of measurement and MAP in standard deviations of the stated noise.
    coherence : ndarray, shape (lines,), optional
        Coherence of the measurement.
    """

    pair: tuple[str, str]
    place: tuple[int, int]
    quantity: str
    unit: str
    frequency_hz: Array
    curves: tuple[FrfCurve, ...]
    band: tuple[NDArray[np.complex128], NDArray[np.complex128]]
    misfit: Array
    coherence: Array | None = None

    @property
    def worst_hz(self) -> float:
        """The line that the MAP explains worst, Hz."""
        return float(self.frequency_hz[np.argmax(self.misfit)])

    def phase_deg(self, values: NDArray[np.complex128]) -> Array:
        """Phase of one of the curves, within half a turn of the median's, degrees."""
        median = self.curves[-1].values
        turned: Array = np.angle(median, deg=True) + np.angle(values * np.conj(median), deg=True)
        return turned


@dataclass(frozen=True, slots=True, eq=False)
class Wireframe:
    """Modes of a structure, on paper.

    Parameters
    ----------
    points : ndarray, shape (lines, points, 2)
        Places at rest of the points that each line connects, m.
    names : tuple of str
        Each mode in words.
    shapes : ndarray, shape (modes, lines, points, 2)
        Displacements at the largest swing, m, as large as is drawn.
    """

    points: Array
    names: tuple[str, ...]
    shapes: Array


_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_.:-]*")
_NUMERIC_CELL = re.compile(r"[-+−±<>≤≥≈~]?\s*\.?(?!\d+:[a-z]|\d+ natural)\d.*")  # not 11:y/11:y, 3 natural frequencies
_NOT_ISOLATED = dict.fromkeys(map(ord, "\u2068\u2069"))  # a terminal has no use for them, see `markup.foreign`
_MOST_COLUMNS = 9  # of a table that a page of paper holds
_ABSENT_CELL = frozenset({"", "-", "–", "—", "n/a"})


def _check_identifier(identifier: str) -> None:
    """Refuse an identifier that could not be both an HTML id and a URL fragment as it stands."""
    if not _IDENTIFIER.fullmatch(identifier):
        raise ValueError(
            f"identifier {identifier!r}: expected a letter followed by letters, digits, '_', '.', ':' or '-'"
        )


@dataclass(frozen=True, slots=True)
class Paragraph:
    """Running text.

    Parameters
    ----------
    text : str
        Plain text; ``**bold**`` and `` `code` `` are the only markup, line breaks count as spaces.
    """

    tag: ClassVar[str] = "paragraph"
    text: str


@dataclass(frozen=True, slots=True)
class Callout:
    """A banner the reader must not miss: converged, weakly identified, not converged.

    Parameters
    ----------
    kind : {"good", "caution", "bad"}
        Colour and symbol of the banner.
    text : str
        The message; starting it with a bold answer reads best.
    """

    tag: ClassVar[str] = "callout"
    kind: Kind
    text: str


@dataclass(frozen=True, slots=True)
class Light:
    """One signal of `Lights`.

    Parameters
    ----------
    name : str
        What it is about: calculation, model, data.
    kind : {"good", "caution", "bad"}
        Colour and symbol.
    text : str
        One sentence.
    finding : str
        Code of what was found, see `jointbayes.report.sections.lead.FINDINGS`.
    """

    name: str
    kind: Kind
    text: str
    finding: str = ""


@dataclass(frozen=True, slots=True)
class Lights:
    """Signals side by side: whether calculation, model and data can be trusted."""

    tag: ClassVar[str] = "lights"
    lights: tuple[Light, ...]


@dataclass(frozen=True, slots=True)
class Guide:
    """How to read a figure: what it shows, what better and worse look like, and what to do then."""

    shows: str
    better: str
    worse: str
    action: str


@dataclass(frozen=True, slots=True)
class Table:
    """A table whose first column names its rows.

    Parameters
    ----------
    caption : str
        Shown above the table, after its number.
    head : tuple of str, shape (n_columns,)
        Column titles.
    rows : tuple of tuple of str, shape (n_rows, n_columns)
        Formatted cells. A cell or its second line that is exactly a verdict, as `Verdict.plain_words` has it,
        becomes a badge with colour and symbol.
    align : str, optional
        One letter per column, ``"l"`` or ``"r"``. By default a column of numbers is set to the right.
    note : str, optional
        Small print under the table.
    bars : tuple, optional
        Of each row the bars drawn in its last cell: lower end, middle and upper end as shares of the bar.
    row_kinds : tuple of str, optional
        One of ``""``, ``"good"``, ``"caution"``, ``"bad"`` per row: a tint. Colour must only repeat what a
        cell already says, since not every reader sees it.

    Raises
    ------
    ValueError
        If the head is empty, a row, `align` or `row_kinds` has the wrong length, or a letter or kind is
        unknown.
    """

    tag: ClassVar[str] = "table"
    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    align: str | None = None
    note: str = ""
    row_kinds: tuple[str, ...] = ()
    bars: tuple[tuple[tuple[float, float, float], ...], ...] = ()

    def __post_init__(self) -> None:
        where, width = f"table {self.caption!r}", len(self.head)
        if width == 0:
            raise ValueError(f"{where}: expected at least one column")
        for number, row in enumerate(self.rows, start=1):
            if len(row) != width:
                raise ValueError(f"{where}, row {number}: {len(row)} cells, expected {width}")
        if self.align is not None and (len(self.align) != width or set(self.align) - set("lr")):
            raise ValueError(f"{where}: align {self.align!r}, expected {width} letters, each 'l' or 'r'")
        if self.row_kinds and len(self.row_kinds) != len(self.rows):
            raise ValueError(f"{where}: {len(self.row_kinds)} row kinds for {len(self.rows)} rows")
        if unknown := set(self.row_kinds) - {"", *get_args(Kind)}:
            raise ValueError(f"{where}: unknown row kinds {sorted(unknown)}")

    @classmethod
    def of(cls, caption: str, columns: Mapping[str, Iterable[str]], **options: Any) -> "Table":  # noqa: ANN401 (fields)
        """Make a table of its columns by their titles."""
        return cls(caption, tuple(columns), tuple(zip(*columns.values(), strict=True)), **options)

    def turned(self) -> "Table":
        """Rows as columns where it is wider than a page and higher than it is wide then; itself elsewhere."""
        if len(self.head) <= _MOST_COLUMNS or len(self.rows) >= len(self.head) or self.bars:
            return self
        head, *rows = zip(self.head, *self.rows, strict=True)
        return replace(self, head=head, rows=tuple(rows), align=None, row_kinds=())

    @property
    def alignment(self) -> str:
        """One letter per column: `align`, or "r" for columns in which every filled cell is a number."""
        return self.align or "".join(map(self._natural_alignment, range(len(self.head))))

    def lines(self) -> list[str]:
        """Head and rows in columns, as a terminal shows them."""
        rows = [tuple(cell.translate(_NOT_ISOLATED) for cell in row) for row in (self.head, *self.rows)]
        return align_columns(rows, self.alignment)

    def _natural_alignment(self, column: int) -> str:
        filled = [row[column] for row in self.rows if row[column].strip() not in _ABSENT_CELL]
        return "r" if filled and all(map(_NUMERIC_CELL.fullmatch, filled)) else "l"


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure: static everywhere, interactive where a browser runs scripts.

    Parameters
    ----------
    identifier : str
        Unique in the report; the HTML anchor.
    caption : str
        Shown below the figure, after its number.
    alt : str
        What the figure shows, for those who cannot see it; plain text, never empty.
    svg : str
        The drawing, text as paths (matplotlib: ``svg.fonttype = "path"``).
    plot : LinePlot, FrfPlot or Wireframe, optional
        The same data as an interactive plot.
    guide : Guide, optional
        How to read it.

    Raises
    ------
    ValueError
        If the alternative text is empty, the identifier is malformed or `svg` is not an SVG document.
    """

    tag: ClassVar[str] = "figure"
    identifier: str
    caption: str
    alt: str
    svg: str
    plot: LinePlot | FrfPlot | Wireframe | None = None
    guide: Guide | None = None

    def __post_init__(self) -> None:
        _check_identifier(self.identifier)
        if not self.alt.strip():
            raise ValueError(f"figure {self.identifier!r}: alternative text is empty")
        if "<svg" not in self.svg:
            raise ValueError(f"figure {self.identifier!r}: svg is not an SVG document")


@dataclass(frozen=True, slots=True)
class Code:
    """A listing, printed as it is.

    Parameters
    ----------
    text : str
        The listing; line breaks and spaces are kept.
    language : str
        Name of the language, such as ``"toml"``.
    """

    tag: ClassVar[str] = "code"
    text: str
    language: str


Block: TypeAlias = Paragraph | Callout | Lights | Table | Figure | Code


@dataclass(frozen=True, slots=True)
class ReportSection:
    """A titled run of blocks, numbered by its place in the report.

    Parameters
    ----------
    identifier : str
        Unique in the report; the HTML anchor.
    title : str
        Heading.
    blocks : tuple of Block
        Content in reading order.
    appendix : bool
        Whether it stands behind the report proper, lettered instead of numbered.

    Raises
    ------
    ValueError
        If the identifier is malformed.
    """

    identifier: str
    title: str
    blocks: tuple[Block, ...]
    appendix: bool = False

    def __post_init__(self) -> None:
        _check_identifier(self.identifier)


@dataclass(frozen=True, slots=True)
class Report:
    """A whole report.

    Parameters
    ----------
    title, subtitle : str
        Head of the report; the subtitle may be empty.
    lead : tuple of Block
        Shown before the first section: the answer comes first.
    sections : tuple of ReportSection
        The body.
    date : datetime.date
        Printed on the report, by default today; also the time stamp inside the PDF, so that reruns are byte-identical.
    version : str
        Version of jointbayes that wrote the report, by default this one.

    Raises
    ------
    ValueError
        If the title is empty, or two sections or figures share an identifier.
    """

    title: str
    subtitle: str
    lead: tuple[Block, ...]
    sections: tuple[ReportSection, ...]
    date: datetime.date = field(default_factory=lambda: datetime.datetime.now(datetime.UTC).date())
    version: str = field(default_factory=lambda: version("jointbayes"))

    def __post_init__(self) -> None:
        if not self.title.strip():
            raise ValueError("report: the title is empty")
        seen: set[str] = set()
        figures = [block.identifier for block in self.blocks() if isinstance(block, Figure)]
        for identifier in (*(section.identifier for section in self.sections), *figures):
            if identifier in seen:
                raise ValueError(f"identifier {identifier!r} is used twice in the report")
            seen.add(identifier)

    def numbered(self) -> list[tuple[str, ReportSection]]:
        """Sections with their numbers: 1, 2, 3 ... and then A, B, C ... of the appendix."""
        letters, numbers = map(chr, count(ord("A"))), map(str, count(1))
        return [(next(letters if section.appendix else numbers), section) for section in self.sections]

    def blocks(self) -> tuple[Block, ...]:
        """All blocks in reading order, the lead first."""
        return (*self.lead, *chain.from_iterable(section.blocks for section in self.sections))
