"""The renderers of a report: literal text, self-contained pages, reproducible PDF, plots that really draw."""

import base64
import datetime
import hashlib
import html
import io
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser

import matplotlib as mpl
import numpy as np
import pytest
import typst
from matplotlib.figure import Figure as MplFigure

from jointbayes.report.html import render_html
from jointbayes.report.markup import Run, badge, format_numbers, parse, plain
from jointbayes.report.model import (
    Callout,
    Code,
    Figure,
    Guide,
    Light,
    Lights,
    LinePlot,
    Paragraph,
    Report,
    ReportSection,
    Series,
    Table,
)
from jointbayes.report.pdf import render_pdf
from tests.hostile import opened

HOSTILE = (
    '<script>alert(1)</script> #panic("x") $x^2$ @fig \\u{41} C:\\temp "double" \'single\' '
    "*star* _under_ = head // comment [x] {{ 7*7 }} {% raw %} & < > ~ #sys.inputs </style> <!-- -->"
)
NUMBER = "5.05\u00a0×\u00a010⁹"


def drawing():
    with mpl.rc_context({"svg.fonttype": "path", "svg.hashsalt": "test"}):
        figure = MplFigure(figsize=(4, 2))
        axes = figure.subplots()
        axes.loglog([10.0, 100.0, 1000.0], [1e-6, 1e-4, 1e-7])
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def plot(**changes):
    frequency = np.geomspace(10.0, 1000.0, 50)
    size = 1e-4 / frequency
    curve = Series("MAP </script>", tuple(frequency), tuple(size))
    band = Series("95 %", tuple(frequency), (), "band", tuple(0.9 * size), tuple(1.1 * size))
    points = Series("measured", tuple(frequency[::7]), tuple(size[::7]), "points")
    settings = {"log_y": True} | changes
    return LinePlot("Frequency (Hz)", "Receptance (m/N)", (band, curve, points), **settings)


def report(text="Nothing to see.", rows=3, interactive=True):
    verdicts = ("identified", "weakly identified", "not identified")
    table = Table(
        text,
        ("Parameter", "Mode", text),
        tuple((f"`k{i}`", "5.05e9", verdicts[i % 3]) for i in range(rows)),
        note=text,
        row_kinds=("good",) * rows,
    )
    listing = Code(f"{text}\n  k = 1e9", "toml")
    svg = drawing()
    figures = (
        Figure("frf", text, f"Receptance over frequency. {text}", svg, plot() if interactive else None),
        Figure("static", text, "No interactive twin", svg, guide=Guide(text, text, text, text)),
    )
    return Report(
        f"Clamp {text}",
        text,
        (
            *(Callout(kind, f"**Verdict:** {text}") for kind in ("good", "caution", "bad")),
            Lights((Light("Model", "good", text), Light("Data", "bad", text))),
        ),
        (
            ReportSection("fit", text, (Paragraph(text), *figures)),
            ReportSection("rest", "Rest", (table, listing, Paragraph("k is 5.05e9 N/m")), appendix=True),
        ),
        datetime.date(2026, 1, 5),
        "0.1.0",
    )


class Page(HTMLParser):
    """Elements, text and scripts of a page as a browser's parser would see them."""

    def __init__(self, source):
        super().__init__(convert_charrefs=True)
        self.elements, self.text, self.scripts, self.styles = [("", {})], [], [], []
        self.feed(source)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data):
        tag, attributes = self.elements[-1]
        if tag == "style" and self.cdata_elem:
            self.styles.append(data)
        elif tag == "script" and self.cdata_elem:
            if "type" not in attributes:
                self.scripts.append(data)
        else:
            self.text.append(data)

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


def pdf_text(data, tmp_path):
    if shutil.which("pdftotext") is None:
        pytest.skip("pdftotext (poppler-utils) is not installed: the text of the PDF cannot be read back")
    path = tmp_path / "report.pdf"
    path.write_bytes(data)
    done = subprocess.run(["pdftotext", "-raw", path, "-"], capture_output=True, check=True, timeout=60)
    return done.stdout.decode()


def squeezed(text):
    return re.sub(r"[\s\u200b\xad]+", "", text)


def test_hostile_text_is_literal_in_html():
    page = Page(render_html(report(HOSTILE)))
    words = squeezed("".join(page.text))
    # title, h1, subtitle, contents, heading, 3 callouts, 2 lights, 4 of a guide, paragraph, 2 captions, table caption,
    # head, note and code
    assert words.count(squeezed(HOSTILE)) == 21
    assert not any("alert(1)" in script for script in page.scripts)
    assert page.all("img")[0]["alt"] == f"Receptance over frequency. {HOSTILE}"


def test_hostile_text_and_code_are_literal_in_pdf(tmp_path):
    for block in (Paragraph(HOSTILE), Code(HOSTILE, "toml")):
        hostile = Report("T", "", (block,), (), datetime.date(2026, 1, 5), "0.1.0")
        assert squeezed(HOSTILE) in squeezed(pdf_text(render_pdf(hostile), tmp_path))
    render_pdf(report(HOSTILE))  # every other place: compiles, so nothing was evaluated


def test_html_loads_nothing_from_anywhere():
    page = Page(render_html(report()))
    for tag, attributes in page.elements:
        for name in ("src", "href", "srcset", "poster", "data", "action"):
            address = attributes.get(name, "#")
            assert address.startswith(("#", "data:")), (tag, name, address)
        assert tag not in {"link", "iframe", "object", "embed", "base"}
    for style in page.styles:
        assert "url(" not in style
        assert "@import" not in style


def test_policy_forbids_by_default_and_names_every_script_and_style():
    page = Page(render_html(report()))
    policy = next(meta["content"] for meta in page.all("meta") if "http-equiv" in meta)
    assert policy.startswith("default-src 'none'; ")
    assert "unsafe" not in policy
    assert len(page.scripts) == len(page.styles) == 2
    for text in (*page.scripts, *page.styles):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy
    assert not any("style" in attributes or "onclick" in attributes for _, attributes in page.elements)


def test_html_without_interactive_plots_leaves_the_library_out():
    page = Page(render_html(report(interactive=False)))
    assert len(page.scripts) == len(page.styles) == 1
    assert "var uPlot" not in page.scripts[0]


def test_html_has_one_of_each_anchor_and_every_link_leads_somewhere():
    page = Page(render_html(report()))
    anchors = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(anchors) == len(set(anchors))
    assert {link["href"][1:] for link in page.all("a")} <= set(anchors)
    labels = {attributes.get("aria-labelledby") for _, attributes in page.elements} - {None}
    assert labels <= set(anchors)


def test_table_cells_say_what_they_are():
    page = Page(render_html(report()))
    assert [cell["scope"] for cell in page.all("th")] == ["col"] * 3 + ["row"] * 3
    assert len(page.all("caption")) == 1


def test_badges_have_a_symbol_besides_colour(tmp_path):
    source = render_html(report())
    words = pdf_text(render_pdf(report()), tmp_path)
    for verdict, symbol in (("identified", "✓"), ("weakly identified", "~"), ("not identified", "✗")):
        assert badge(verdict).symbol == symbol
        shown = f'<span class="badge {badge(verdict).kind}"><span aria-hidden="true">{symbol} </span>{verdict}'
        assert shown in source
        assert squeezed(f"{symbol}{verdict}") in squeezed(words)
    assert badge("an identified joint") is None


def test_appendix_is_lettered_behind_the_numbered_report(tmp_path):
    in_html = squeezed(" ".join(Page(render_html(report())).text))
    in_pdf = squeezed(pdf_text(render_pdf(report()), tmp_path))
    for text in (in_html, in_pdf):
        assert squeezed("1 Nothing to see.") in text
        assert squeezed("A Rest") in text


def test_numbers_look_the_same_in_both(tmp_path):
    words = pdf_text(render_pdf(report()), tmp_path)
    source = html.unescape(render_html(report()))
    assert f"k is {NUMBER} N/m" in source
    assert squeezed(f"k is {NUMBER} N/m") in squeezed(words)
    assert squeezed("k = 1e9") in squeezed(words)  # a listing stays as it is
    assert "  k = 1e9" in source


@pytest.mark.parametrize(
    ("written", "shown"),
    [
        ("5.05e9", "5.05 × 10⁹"),
        ("1.52E+06 N·m/rad", "1.52 × 10⁶ N·m/rad"),
        ("-3.1e-07", "−3.1 × 10⁻⁷"),
        ("4.1e9-6.0e9", "4.1 × 10⁹-6.0 × 10⁹"),
        ("(2e0, 3e12).", "(2, 3 × 10¹²)."),
        ("-0.5 dB", "−0.5 dB"),
        ("2026-01-05", "2026-01-05"),
        ("f7e10 1.2e3.4 k1e5 1e5f", "f7e10 1.2e3.4 k1e5 1e5f"),
    ],
)
def test_number_rule(written, shown):
    assert format_numbers(written).replace("\u00a0", " ") == shown


def test_a_number_keeps_its_per_cent_sign_on_its_line():
    assert format_numbers("95 % of 2.5 % and a % b") == "95\u00a0% of 2.5\u00a0% and a % b"


def test_markup_knows_bold_and_code_and_nothing_else():
    assert parse("a **b `c`** `1e9 **d**` *e* **f") == (
        Run("a "),
        Run("b ", bold=True),
        Run("c", bold=True, code=True),
        Run(" "),
        Run("1e9 **d**", code=True),
        Run(" *e* **f"),
    )
    assert plain("**a** `b`\n c\x07 \ud800") == "a b c ?"


def test_pdf_is_the_same_on_every_run_and_has_pages():
    first, second = render_pdf(report()), render_pdf(report())
    assert first == second
    assert first.startswith(b"%PDF")
    assert len(re.findall(rb"/Type\s*/Page\b", first)) > 0
    assert b"pdfuaid:part" in first
    assert b"D:20260105" in first


def test_pdf_repeats_the_head_of_a_long_table(tmp_path):
    text = pdf_text(render_pdf(report(rows=150)), tmp_path)
    pages = [page for page in text.split("\f") if page.strip()]
    with_rows = [page for page in pages if re.search(r"\bk\d+\b", page)]
    assert len(with_rows) > 2
    assert all("Parameter" in page for page in with_rows)


def test_a_table_that_is_higher_than_a_page_breaks(tmp_path):
    rows = tuple((f"start {i}", ", ".join(["3.577e10"] * 60)) for i in range(11))
    whole = replace(report(), lead=(Table("Starts", ("Start", "Joint"), rows),))
    pages = pdf_text(render_pdf(whole), tmp_path).split("\f")
    on_page = [len(re.findall(r"\bstart \d+\b", page)) for page in pages]
    assert sum(on_page) == 11
    assert max(on_page) < 11  # else those that the page has no room for lie over its foot


def test_typst_warnings_become_python_warnings(monkeypatch):
    class Complaint:
        message, hints = "odd font", ["use another"]

    compile_quietly = typst.compile_with_warnings

    def compile_with_complaint(*args, **kwargs):
        return compile_quietly(*args, **kwargs)[0], [Complaint()]

    monkeypatch.setattr(typst, "compile_with_warnings", compile_with_complaint)
    with pytest.warns(RuntimeWarning, match="odd font; use another"):
        render_pdf(report())


def test_script_without_embedded_font_warns_and_still_gives_a_pdf():
    with pytest.warns(RuntimeWarning, match="could not be displayed"):
        assert render_pdf(report("夹具")).startswith(b"%PDF")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Table("t", (), ()), "at least one column"),
        (lambda: Table("t", ("a",), (("1", "2"),)), "row 1: 2 cells, expected 1"),
        (lambda: Table("t", ("a",), (), align="c"), "align 'c'"),
        (lambda: Table("t", ("a",), (), row_kinds=("good",)), "1 row kinds for 0 rows"),
        (lambda: Table("t", ("a",), (("1",),), row_kinds=("red",)), "unknown row kinds"),
        (lambda: Figure("f", "", " ", "<svg/>"), "alternative text"),
        (lambda: Figure("f", "", "alt", "plot.svg"), "not an SVG"),
        (lambda: ReportSection("1 a", "", ()), "identifier '1 a'"),
        (lambda: replace(report(), title=" "), "title is empty"),
        (lambda: replace(report(), sections=(ReportSection("a", "", ()),) * 2), "used twice"),
    ],
)
def test_model_refuses(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_columns_of_numbers_go_to_the_right():
    rows = (("11:y/11:y", "-1.5e3 N/m", "—", "5 averages"), ("6:y/11:y", "< 2", "3", "none"))
    assert Table("t", ("", "", "", ""), rows).alignment == "lrrl"
    assert Table("t", ("", "", "", ""), rows, align="llll").alignment == "llll"


def in_browser(source, tmp_path):
    """A page as a browser has it."""
    (tmp_path / "report.html").write_text(source, encoding="utf-8", newline="\n")
    return Page(opened(tmp_path / "report.html", tmp_path)[0])


@pytest.mark.whole
def test_policy_stops_a_script_that_came_with_the_data_in_a_browser(tmp_path):
    intruder = "<script>document.body.append(document.createElement('canvas'))</script></body>"
    page = in_browser(render_html(report(interactive=False)).replace("</body>", intruder), tmp_path)
    assert not page.all("canvas")
