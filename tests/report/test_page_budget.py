"""The pages before the appendix: order kept, nothing lost, room that one section leaves given to the next."""

import re
from html import unescape

import pytest

from jointbayes.report import render_html
from jointbayes.report.model import Figure, Paragraph, Table
from jointbayes.report.pdf import block_height, share_pages

SVG = '<svg xmlns="http://www.w3.org/2000/svg" width="{0}pt" height="{1}pt" viewBox="0 0 {0} {1}"/>'


def figure(name, height, width=400):
    return Figure(name, "A caption", "What it shows", SVG.format(width, height))


def test_nothing_is_lost_and_the_order_stays():
    blocks = [Paragraph(f"{i}. " + "word " * 30 * i) for i in range(1, 40)]
    ((page, rest),) = share_pages([blocks])
    assert page
    assert rest
    assert sorted([*page, *rest], key=blocks.index) == blocks
    assert list(page) == sorted(page, key=blocks.index)
    assert list(rest) == sorted(rest, key=blocks.index)
    assert sum(map(block_height, page)) < 697


def test_a_section_has_its_first_block_however_high_and_room_of_others():
    tall, wide = figure("tall", 900), figure("wide", 800, width=1600)
    assert share_pages([[tall]]) == [((tall,), ())]
    assert block_height(wide) < 300  # scaled down to the page
    plots = [figure(f"plot-{i}", 400) for i in range(3)]
    (alone,) = share_pages([plots])
    assert alone == ((plots[0],), (plots[1], plots[2]))
    lead = [figure("lead", 300), Paragraph("word " * 400)]
    assert share_pages([lead[::-1]]) == [(tuple(lead[::-1]), ())]  # the first figure as well, whatever stands above it
    with_room = share_pages([plots, [Paragraph("short")]])
    assert with_room[0] == ((plots[0], plots[1]), (plots[2],))
    assert with_room[1] == ((Paragraph("short"),), ())


def test_a_table_is_as_high_as_its_rows():
    heights = [block_height(Table("t", ("a", "b"), (("1", "2"),) * rows)) for rows in (1, 11, 21)]
    assert heights[1] - heights[0] == heights[2] - heights[1] > 100


@pytest.mark.whole
def test_the_report_of_a_clamp_has_at_most_2500_words(reports):
    seen = re.sub(r"(?s)<(script|style|details|svg|title)\b.*?</\1>", " ", render_html(reports["main"]))
    assert 1000 < len(unescape(re.sub(r"<[^>]+>", " ", seen)).split()) <= 2500
