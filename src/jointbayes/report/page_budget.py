"""What fits on the printed pages before the appendix, and what goes there."""

import math
import re
from collections.abc import Sequence

from jointbayes.report.model import Block, Callout, Code, Figure, Lights, Paragraph, Table

#: Height and width of the text on a page, points, and the share of the height that blocks may fill: headings and what
#: a figure leaves free at a page's end take the rest.
_HEIGHT, _WIDTH, _SHARE = 697.0, 465.0, 0.85
_LINE, _CHARACTERS = 14.5, 95  # of running text
_ROW, _CAPTION, _GAP = 17.0, 26.0, 17.0
_SIZE = re.compile(r'<svg[^>]*?\bviewBox="0 0 ([\d.]+) ([\d.]+)"')


def share_pages(sections: Sequence[Sequence[Block]]) -> list[tuple[tuple[Block, ...], tuple[Block, ...]]]:
    """Of each section the blocks that the pages have room for, in order, and the others.

    There is a page for each section. What one leaves free the others may have, the first ones first; the first block
    of each is always shown.
    """
    page = _SHARE * _HEIGHT
    left = page * len(sections)
    shown: list[set[int]] = []
    for blocks in sections:
        of_page = page
        chosen: set[int] = set()
        for i, block in enumerate(blocks):
            height = block_height(block)
            if height <= of_page or not chosen:
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
            return _figure_height(svg) + _text_height(caption) + 2 * _GAP
        case Table(head=head, rows=rows, note=note):
            return _CAPTION + sum(_row_height(row) for row in (head, *rows)) + _text_height(note) + 2 * _GAP
        case Paragraph(text) | Callout(text=text):
            return _text_height(text) + _GAP
        case Lights(lights):
            return max(_text_height(light.text) for light in lights) * len(lights) + _CAPTION
        case Code(text):
            return _LINE * (text.count("\n") + 2)


def _figure_height(svg: str) -> float:
    """Height of a drawing, scaled down where it is wider than the text."""
    found = _SIZE.search(svg)
    if found is None:
        return _HEIGHT / 3
    width, height = map(float, found.groups())
    return height * min(1.0, _WIDTH / width)


def _row_height(row: Sequence[str]) -> float:
    """A row of cells, the longest of which is broken into lines."""
    per_cell = _CHARACTERS * 1.1 / len(row)
    return _ROW + (_LINE - 3) * max(0, math.ceil(max(map(len, row)) / (1.6 * per_cell)) - 1)


def _text_height(text: str) -> float:
    return _LINE * math.ceil(len(text) / _CHARACTERS)
