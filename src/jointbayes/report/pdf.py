"""The report as a tagged PDF (PDF/UA-1): typst in memory, embedded fonts only, same bytes on every run.

And what fits on its pages before the appendix, and what goes there.
"""

import datetime
import json
import math
import re
import warnings
from collections.abc import Sequence
from functools import partial
from importlib.resources import files
from typing import Any

import typst

from jointbayes.report.markup import SYMBOLS, Kind, badge, clean, parse, plain, plain_characters
from jointbayes.report.model import Block, Callout, Code, Figure, Lights, Paragraph, Report, Table

#: Height and width of the text on a page, points, and the share of the height that blocks may fill: headings and what
#: a figure leaves free at a page's end take the rest.
_HEIGHT, _WIDTH, _SHARE = 697.0, 465.0, 0.85
_LINE, _CHARACTERS = 14.5, 95  # of running text
_ROW, _CAPTION, _GAP = 17.0, 26.0, 17.0
_SIZE = re.compile(r'<svg[^>]*?\bviewBox="0 0 ([\d.]+) ([\d.]+)"')


def share_pages(sections: Sequence[Sequence[Block]]) -> list[tuple[tuple[Block, ...], tuple[Block, ...]]]:
    """Return the blocks of each section that the pages have room for, in order, and the others.

    There is a page for each section. What one leaves free the others may have, the first ones first. The first block
    and the first figure of each are always shown.
    """
    page = _SHARE * _HEIGHT
    left = page * len(sections)
    shown: list[set[int]] = []
    for blocks in sections:
        of_page = page
        chosen: set[int] = set()
        for i, block in enumerate(blocks):
            height = block_height(block)
            first_figure = isinstance(block, Figure) and not any(isinstance(blocks[j], Figure) for j in chosen)
            if height <= of_page or not chosen or first_figure:
                chosen.add(i)
                of_page -= height
                left -= height
        shown.append(chosen)
    for blocks, chosen in zip(sections, shown, strict=True):
        for i, block in enumerate(blocks):
            if i not in chosen and block_height(block) <= left:
                chosen.add(i)
                left -= block_height(block)
    return [
        (
            tuple(b for i, b in enumerate(blocks) if i in chosen),
            tuple(b for i, b in enumerate(blocks) if i not in chosen),
        )
        for blocks, chosen in zip(sections, shown, strict=True)
    ]


def block_height(block: Block) -> float:
    """About how high a block is in print, points."""
    match block:
        case Figure(svg=svg, caption=caption):
            found, height = _SIZE.search(svg), _HEIGHT / 3
            if found is not None:  # scaled down where it is wider than the text
                width, height = map(float, found.groups())
                height *= min(1.0, _WIDTH / width)
            return height + _text_height(caption) + 2 * _GAP
        case Table(head=head, rows=rows, note=note):
            # the longest cell of a row is broken into lines
            longest = [max(map(len, row)) * len(row) / (_CHARACTERS * 1.76) for row in (head, *rows)]
            in_rows = sum(_ROW + (_LINE - 3) * max(0, math.ceil(lines) - 1) for lines in longest)
            return _CAPTION + in_rows + _text_height(note) + 2 * _GAP
        case Paragraph(text) | Callout(text=text):
            return _text_height(text) + _GAP
        case Lights(lights):
            return max(_text_height(light.text) for light in lights) * len(lights) + _CAPTION
        case Code(text):
            return _LINE * (text.count("\n") + 2)


def _text_height(text: str) -> float:
    return _LINE * math.ceil(len(text) / _CHARACTERS)


_LONG_WORD = re.compile(r"\S{20,}")
_WORD_PIECE = re.compile(r"(.{12}|[/\\_.,;:=&?-]+)(?=.)")
_HEADER_LENGTH = 80
_LONG_TABLE = 300.0  # points: a table that is higher may break over pages
_NO_GLYPH = "could not be displayed with font"


def render_pdf(report: Report) -> bytes:
    """Render a report as a PDF.

    Parameters
    ----------
    report : Report
        The report.

    Returns
    -------
    bytes
        The file; the same bytes for the same report.

    Warns
    -----
    RuntimeWarning
        For anything typst has to say about the document, and for characters that no embedded font has.

    Examples
    --------
    >>> render_pdf(Report("Clamp", "", (), (), datetime.date(2026, 1, 5), "0.1.0"))[:5]
    b'%PDF-'
    """
    template = files("jointbayes.report").joinpath("templates/report.typ").read_bytes()
    # The clock of the machine must not leak into the file, so time starts on the day of the report.
    midnight = datetime.datetime.combine(report.date, datetime.time(), tzinfo=datetime.UTC)
    options: dict[str, Any] = {"ignore_system_fonts": True, "format": "pdf", "timestamp": int(midnight.timestamp())}
    options["sys_inputs"] = {"data": json.dumps(_data(report), ensure_ascii=False)}
    compile_pdf = partial(typst.compile_with_warnings, template, **options)
    try:
        pdf, complaints = compile_pdf(pdf_standards=["ua-1"])
    except typst.TypstError as error:
        if _NO_GLYPH not in error.message:
            raise
        # A name in a script without an embedded font must not cost the user the whole report.
        message = f"PDF report: {error.message}; such characters are boxes in this PDF, which therefore does not claim "
        warnings.warn(f"{message}PDF/UA; the HTML report shows them", RuntimeWarning, stacklevel=2)
        pdf, complaints = compile_pdf()
    for complaint in complaints:
        message = "; ".join([complaint.message, *complaint.hints])
        warnings.warn(f"PDF report: {message}", RuntimeWarning, stacklevel=2)
    if not isinstance(pdf, bytes):
        raise TypeError(f"typst returned {type(pdf).__name__} for a PDF, expected bytes")
    return pdf


def _data(report: Report) -> dict[str, Any]:
    title = plain(report.title)
    return {
        "title_plain": title,
        "title_short": title if len(title) <= _HEADER_LENGTH else f"{title[: _HEADER_LENGTH - 1]}…",
        "subtitle": _runs(report.subtitle),
        "author": f"jointbayes {plain(report.version)}",
        "ymd": [report.date.year, report.date.month, report.date.day],
        "date": report.date.isoformat(),
        "lead": [_block(block) for block in report.lead],
        "sections": [
            {
                "number": number,
                "appendix": section.appendix,
                "title": _runs(section.title),
                "blocks": [_block(block) for block in section.blocks],
            }
            for number, section in report.numbered()
        ],
    }


def _block(block: Block) -> dict[str, Any]:
    match block:
        case Paragraph(text):
            content: dict[str, Any] = {"runs": _runs(text)}
        case Callout(kind, text):
            content = _signal(kind, text)
        case Lights(lights):
            content = {"lights": [_signal(light.kind, light.text) | {"name": _runs(light.name)} for light in lights]}
        case Table():
            content = {
                "caption": _runs(block.caption),
                "head": [_runs(title) for title in block.head],
                "rows": [[_cell(cell) for cell in row] for row in block.rows],
                "align": list(block.alignment),
                "note": _runs(block.note),
                "row_kinds": list(block.row_kinds),
                "bars": block.bars,
                "long": block_height(block) > _LONG_TABLE,
            }
        case Figure():
            content = {"caption": _runs(block.caption), "alt": plain(block.alt), "svg": clean(block.svg)}
        case Code(text, language):
            content = {"text": _breakable(clean(text)), "language": clean(language)}
    return {"tag": block.tag, **content}


def _signal(kind: Kind, text: str) -> dict[str, Any]:
    return {"kind": kind, "symbol": SYMBOLS[kind], "runs": _runs(text)}


def _cell(text: str) -> dict[str, Any]:
    value, _, below = text.partition("\n")
    mark = badge(below or value)
    if mark is None:
        return {"runs": _runs(text)}
    return {
        "kind": mark.kind,
        "symbol": mark.symbol,
        "text": (below or value).strip(),
        "above": _runs(value if below else ""),
    }


def _runs(text: str) -> list[dict[str, Any]]:
    return [
        {"text": _breakable(plain_characters(run.text)), "style": {"bold": run.bold, "code": run.code}}
        for run in parse(text)
    ]


def _breakable(text: str) -> str:
    """Allow breaks inside words too long for a line or a table column: paths, hashes."""
    return _LONG_WORD.sub(lambda word: _WORD_PIECE.sub("\\1\u200b", word.group()), text)
