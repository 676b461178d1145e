"""Pages of nine kinds of reports in a real browser: views, zoom, cursor, animation, paper, phone, and for everybody."""

import csv
import io
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from jointbayes.report import render_html, render_pdf
from tests.hostile import browser

pytestmark = pytest.mark.science

REASON = "NOT CHECKED: playwright is not installed to look at pages in a browser"
VIEWS = ("Magnitude", "Linear", "dB", "Phase", "Real", "Imaginary", "Nyquist")
WIDTHS = (360, 768, 1280, 2560)
LIKE_MAIN = ("uncertain", "tests", "frequencies", "frame")  # of the same sections
NAMES = ("main", "uncertain", "tests", "frequencies", "frame", "comparison", "campaign")


@pytest.fixture(scope="module")
def pages(reports, tmp_path_factory):
    """Address of each page by name."""
    directory = tmp_path_factory.mktemp("pages")
    assert set(reports) == set(NAMES)
    for name, report in reports.items():
        (directory / f"{name}.html").write_text(render_html(report), encoding="utf-8", newline="\n")
    return {name: (directory / f"{name}.html").as_uri() for name in NAMES}


@pytest.fixture(scope="module")
def chromium():
    sync_api = pytest.importorskip("playwright.sync_api", reason=REASON)
    with sync_api.sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=browser(), args=["--no-sandbox"])
        yield running
        running.close()


@pytest.fixture
def opened(chromium):
    """Opens a page; at the end it has said nothing, asked for nothing, and every script of it has run."""

    @contextmanager
    def open_page(address: str, width: int = 1280, **context: object) -> Iterator[object]:
        world = chromium.new_context(viewport={"width": width, "height": 900}, **context)
        page, said, asked = world.new_page(), [], []
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        page.goto(address)
        yield page
        assert said == []
        assert {url for url in asked if not url.startswith("blob:")} == {address}
        world.close()

    return open_page


def drawn(page, identifier):
    """A figure that the reader has come to, and its charts are there."""
    figure = page.locator(f"#{identifier}")
    figure.scroll_into_view_if_needed()
    figure.locator('.paper[data-drawn="true"]').wait_for()
    return figure


def pixels(figure):
    """What its first canvas shows."""
    return figure.locator("canvas").first.evaluate("canvas => canvas.toDataURL()")


def seen(page):
    """The whole page, read to its end."""
    for place in range(0, page.evaluate("document.documentElement.scrollHeight"), 800):
        page.evaluate(f"scrollTo(0, {place})")
        page.wait_for_timeout(20)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long) if name in LIKE_MAIN else name for name in NAMES]
)
def test_every_page_fits_every_screen_and_passes_axe(name, pages, opened):
    axe = pytest.importorskip("axe_playwright_python", reason="NOT CHECKED: axe-playwright-python is not installed")
    source = (Path(axe.__file__).parent / "axe.min.js").read_text(encoding="utf-8")
    for width in WIDTHS:
        with opened(pages[name], width) as page:
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            if width in (360, 1280):
                seen(page)
                assert page.evaluate("document.documentElement.scrollWidth") <= width
                assert page.locator("script.plot").count() == page.locator('[data-drawn="true"]').count()
            dark = width == 360 and name in ("main", "campaign")
            page.emulate_media(color_scheme="dark" if dark else "light")
            if width == 1280 or dark:
                page.evaluate(source)  # by the debugger, which the policy lets through
                violations = page.evaluate("axe.run()")["violations"]
                assert [(v["id"], v["nodes"][0]["html"]) for v in violations] == []


#: Width of the text on A4 as the page's style sets its margins, in pixels, and on the sheet, in points.
PAPER, SHEET = 657, 595.3
CUT = "[...document.querySelectorAll('.scroll')].filter(e => e.scrollWidth > e.clientWidth).map(e => e.innerText)"


@pytest.mark.parametrize("name", NAMES)
def test_no_table_scrolls_or_is_cut_on_screen_or_paper(name, pages, opened, reports, tmp_path):
    for width, media in ((360, "screen"), (1280, "screen"), (PAPER, "print")):
        with opened(pages[name], width) as page:
            page.emulate_media(media=media)
            assert page.evaluate(CUT) == [], (width, media)
    with opened(pages[name]) as page:
        page.pdf(path=tmp_path / "printed.pdf", format="A4", prefer_css_page_size=True)
    (tmp_path / "own.pdf").write_bytes(render_pdf(reports[name]))
    for path in tmp_path.glob("*.pdf"):
        words = words_of(path)
        assert len(words) > 50
        right = {word: place for word, place in words if place > SHEET - 50}
        assert right == {}, path.name


def words_of(path):
    """Each word of a PDF, and how far right it ends, in points."""
    if shutil.which("pdftotext") is None:
        pytest.skip("NOT CHECKED: pdftotext (poppler-utils) is not installed to see where words of a PDF end")
    text = subprocess.run(["pdftotext", "-bbox", path, "-"], capture_output=True, check=True, text=True).stdout
    return [(word, float(end)) for end, word in re.findall(r'<word [^>]*xMax="([\d.]+)"[^>]*>(.*?)</word>', text)]


def test_each_view_of_an_frf_shows_other_curves_and_another_axis(pages, opened):
    with opened(pages["main"]) as page:
        figure = drawn(page, "frf-0-0")
        shown = {}
        for view in VIEWS:
            figure.get_by_role("button", name=view, exact=True).click()
            assert figure.locator('.switches [aria-pressed="true"]').inner_text() == view
            page.wait_for_timeout(50)
            shown[view] = pixels(figure)
        assert len(set(shown.values())) == len(VIEWS)
        figure.get_by_role("button", name="Magnitude", exact=True).click()
        page.wait_for_timeout(50)
        assert pixels(figure) == shown["Magnitude"]
        for layer in ("95 % band", "computed", "first guess", "paper's iteration", "MAP", "median"):
            button, before = figure.get_by_role("button", name=layer, exact=True), pixels(figure)
            pressed = button.get_attribute("aria-pressed")
            button.click()
            page.wait_for_timeout(50)
            assert button.get_attribute("aria-pressed") != pressed
            assert pixels(figure) != before, layer


def test_zoom_and_cursor_go_through_all_panels_and_figures(pages, opened):
    with opened(pages["main"]) as page:
        drawn(page, "residuals")
        figure = drawn(page, "frf-0-0")
        panels = figure.locator(".u-over")
        assert panels.count() == 2  # magnitude and misfit
        box = panels.first.bounding_box()
        page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 40)
        page.wait_for_timeout(50)
        at = re.search(
            r"Frequency \(Hz\): ([\d.]+) · 95 % band: .* · MAP: .* · Error", figure.locator(".hint").inner_text()
        )
        elsewhere = page.locator("#residuals .hint").inner_text()
        assert f"Frequency (Hz): {at[1]} · each line" in elsewhere
        # a drag zooms both panels of this figure, and no other
        untouched, before = (
            pixels(page.locator("#residuals")),
            [pixels(panels.nth(i).locator("xpath=..")) for i in (0, 1)],
        )
        page.mouse.down()
        page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 40)
        page.mouse.up()
        page.mouse.move(5, 5)
        page.wait_for_timeout(80)
        assert all(pixels(panels.nth(i).locator("xpath=..")) != before[i] for i in (0, 1))
        assert pixels(page.locator("#residuals")) == untouched
        figure.get_by_role("button", name="Nyquist", exact=True).click()  # of the lines that are zoomed to
        figure.get_by_role("button", name="Reset zoom").click()
        figure.get_by_role("button", name="Magnitude", exact=True).click()
        page.wait_for_timeout(80)
        assert pixels(panels.first.locator("xpath=..")) == before[0]
        assert figure.get_by_role("button", name="Reset zoom").count() == 0


def test_the_keyboard_moves_the_cursor_and_zooms(pages, opened):
    with opened(pages["main"]) as page:
        figure = drawn(page, "frf-0-0")
        stage, hint = figure.get_by_role("application"), figure.locator(".hint span")
        stage.focus()
        whole, said = pixels(figure), set()
        for key in ("ArrowRight", "ArrowRight", "ArrowLeft", "Shift+ArrowRight"):
            stage.press(key)
            said.add(hint.inner_text())
        assert len(said) == 3  # one step right and one left again is the same place
        assert hint.get_attribute("aria-live") == "polite"
        stage.press("+")
        page.wait_for_timeout(50)
        assert figure.get_by_role("button", name="Reset zoom").is_visible()
        stage.press("Escape")
        page.wait_for_timeout(50)
        assert pixels(figure) == whole


def test_modes_swing_until_they_are_stopped_and_not_for_who_wants_no_motion(pages, opened):
    for name in ("main", "frame"):
        with opened(pages[name]) as page:
            figure = drawn(page, "mode-shapes")
            play = figure.get_by_role("button", name="Pause")
            first = pixels(figure)
            page.wait_for_timeout(250)
            assert pixels(figure) != first
            play.focus()
            page.keyboard.press("Space")
            page.wait_for_timeout(50)
            stopped = pixels(figure)
            page.wait_for_timeout(150)
            assert pixels(figure) == stopped
            figure.get_by_role("button", name="Mode 2", exact=True).click()
            assert pixels(figure) != stopped
    with opened(pages["main"], reduced_motion="reduce") as page:
        figure = drawn(page, "mode-shapes")
        assert figure.get_by_role("button", name="Play").is_visible()
        still = pixels(figure)
        page.wait_for_timeout(250)
        assert pixels(figure) == still


def test_numbers_picture_and_comments_leave_the_page(pages, opened, reports, tmp_path):
    with opened(pages["main"]) as page:
        figure = drawn(page, "frf-0-0")  # before it is, a button of it may not listen yet

        def saved(button):
            with page.expect_download() as download:
                button.click()
            download.value.save_as(tmp_path / download.value.suggested_filename)
            return (tmp_path / download.value.suggested_filename).read_text(encoding="utf-8")

        head, *rows = csv.reader(io.StringIO(saved(figure.get_by_role("button", name="Data (CSV) of Figure 2"))))
        plot = next(b.plot for b in reports["main"].blocks() if getattr(b, "identifier", "") == "frf-0-0")
        values = dict(zip(head, np.array(rows, dtype=float).T, strict=True))
        np.testing.assert_allclose(values["Frequency (Hz)"], plot.frequency_hz)
        for curve in plot.curves:
            complex_values = values[f"{curve.name} real (m/N)"] + 1j * values[f"{curve.name} imaginary (m/N)"]
            np.testing.assert_allclose(np.abs(complex_values), np.abs(curve.values), rtol=0.01)
            assert np.abs(complex_values - curve.values).max() < 0.01 * np.abs(curve.values).max()
        np.testing.assert_allclose(values["Error (sd)"], plot.misfit, atol=1e-3)
        assert saved(figure.get_by_role("button", name="Picture (SVG) of Figure 2")).startswith("<?xml")
        export = page.get_by_role("button", name=re.compile("Export"))
        assert export.is_disabled()
        figure.get_by_role("button", name="Comment on Figure 2").click()
        page.keyboard.type('Why "this" dip? ü')
        page.reload()  # kept where a page from a disk may keep anything
        assert figure.get_by_role("textbox").input_value() == 'Why "this" dip? ü'
        (comment,) = json.loads(saved(export))["comments"]
        assert (comment["figure"], comment["comment"]) == ("frf-0-0", 'Why "this" dip? ü')
        assert comment["caption"].startswith("Figure 2.")


def test_what_is_printed_or_has_no_script_is_the_static_page(pages, opened):
    with opened(pages["main"]) as page:
        figure = drawn(page, "frf-0-0")
        assert not figure.locator("img").evaluate("image => image.getBoundingClientRect().width > 50")
        page.emulate_media(media="print")
        assert figure.locator("img").evaluate("image => image.getBoundingClientRect().width > 300")
        assert not figure.locator(".live, .tools").filter(visible=True).count()
    with opened(pages["main"], java_script_enabled=False) as page:
        figure = page.locator("#frf-0-0")
        figure.scroll_into_view_if_needed()
        assert figure.locator("img").bounding_box()["width"] > 300
        assert figure.locator("button").count() == 0


def test_dark_is_dark_and_on_a_phone_the_verdict_comes_first(pages, opened):
    with opened(pages["main"], 360, color_scheme="dark") as page:
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 25, 31)"
        row = page.locator(".cards tbody tr").first
        name, verdict = row.locator("th").bounding_box(), row.locator(".badge").first.bounding_box()
        others = [cell.bounding_box()["y"] for cell in row.locator("td").all()[1:]]
        assert name["y"] < verdict["y"] < min(others)
        assert verdict["x"] + verdict["width"] <= 360
