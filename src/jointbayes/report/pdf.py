"""The report as a tagged PDF (PDF/UA-1): typst in memory, embedded fonts only, same bytes on every run."""

import datetime
import json
import re
import warnings
from functools import partial
from importlib.resources import files
from typing import Any

import typst

from jointbayes.report.markup import SYMBOLS, Kind, badge, clean, parse, plain, plain_characters
from jointbayes.report.model import Block, Callout, Code, Figure, Lights, Paragraph, Report, Table
from jointbayes.report.page_budget import block_height

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
    compile_pdf = partial(
        typst.compile_with_warnings,
        template,
        ignore_system_fonts=True,
        format="pdf",
        sys_inputs={"data": json.dumps(_data(report), ensure_ascii=False)},
        timestamp=int(midnight.timestamp()),
    )
    try:
        pdf, complaints = compile_pdf(pdf_standards=["ua-1"])
    except typst.TypstError as error:
        if _NO_GLYPH not in error.message:
            raise
        # A name in a script without an embedded font must not cost the user the whole report.
        warnings.warn(
            f"PDF report: {error.message}; such characters are boxes in this PDF, which therefore does not "
            "claim PDF/UA; the HTML report shows them",
            RuntimeWarning,
            stacklevel=2,
        )
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
