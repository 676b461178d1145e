"""Questions that a customer asks, each answered by the text of page one, whatever was tested."""

import re
import shutil
import subprocess
from dataclasses import replace

import pytest

from jointbayes.posterior.checks import checks_of
from jointbayes.posterior.sampled import recall
from jointbayes.report import ReportInputs, render_html, render_pdf
from jointbayes.report.contents import build_report
from tests.conftest import TABLE_3, cheap_text, of_case, unsettled
from tests.hostile import browser
from tests.report.conftest import DATE, made_up, report_of

pytestmark = pytest.mark.science

#: What answers each question, as a reader finds it on the page.
ANSWERS = {
    "What was tested?": r"Tested\. .*(Beam, \d+ mm long, section \w+|Frame|Structure)\b.*(Joint|\d joints): \S+",
    "How was it measured?": r"(\d+ (computed )?(receptance|mobility|accelerance) FRFs?|\d+ natural frequenc(y|ies))",
    "In which band?": r"(lines )?(from )?[\d.]+ to [\d.]+ Hz|[\d.]+ Hz",
    "How noisy was it?": r"noise [\d.]+ % of \|H\||each known to [\d.]+ % \(standard deviation\)",
    "What if E is 3 % off?": r"as in a workshop \(.*to 3 %|Uncertain as the case states: |is taken as exact",
    "Can I trust the calculation?": r"Calculation.{0,20}(Converged|Not converged|The )",
    "Can I trust the model?": r"Model.{0,20}(Explains the data|Does not explain the data)",
    "How large are the residuals?": r"Residuals are [\d.]+ times the noise(?:, in a pattern along frequency)?; "
    r"noise alone gives [\d.]+ to [\d.]+",
    "Can I trust the data?": r"Data.{0,20}(Computed|\d+ measured values|Check )",
    "What limits the answer?": r"What limits the answer\. .{20,}",
    "What next?": r"Next\. .{20,}",
    "What does the answer rest on?": r"Rests on\. .{20,}",
}
NUMBER = r"[−\d.]+(?: × 10[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)?"
HOW_WELL = rf"{NUMBER} \({NUMBER} to {NUMBER}\) [GMk]?\S+|(above|below) {NUMBER} [GMk]?\S+"
VERDICT = r"(weakly identified|not identified|identified|bounded below|bounded above|no verdict|no valid value)"


@pytest.fixture(scope="module")
def runs(reports, cheap_posterior):
    """Reports of nine runs by name."""
    stopped = unsettled(cheap_posterior)
    off = replace(checks_of(cheap_posterior)[0], chi2_per_line=9.0)
    wrong = of_case(cheap_posterior)
    recall(wrong, {"checks_of": (off,)})
    own = report_of(of_case(stopped)), build_report(ReportInputs(wrong), DATE)
    small = report_of(made_up("small", cheap_text().replace("length_mm = 383.0", "length_mm = 200.0"), TABLE_3))
    names = ("main", "uncertain", "tests", "frequencies", "frame")
    long = report_of(made_up("long", cheap_text().replace("length_mm = 383.0", "length_mm = 600.0"), TABLE_3))
    made = {"stopped": own[0], "wrong": own[1], "short beam": small, "long beam": long}
    return {name: reports[name] for name in names} | made


def page_one(report):
    """Its text as a reader has it."""
    return seen(render_html(report).split('class="lead"', 1)[1].split('class="contents"', 1)[0])


def page_text(report):
    """The text of all its pages."""
    return seen(render_html(report).split("<body>", 1)[1])


def seen(page):
    page = re.sub(r"<script.*?</script>|<img[^>]*>|<details.*?</details>", " ", page, flags=re.DOTALL)
    text = re.sub(r"<[^>]+>", " ", page).replace("\u00a0", " ").replace("&#39;", "'")
    return re.sub(r"\s+", " ", text).replace(" .", ".").replace(" ,", ",").replace(" :", ":")


@pytest.mark.parametrize("question", ANSWERS)
def test_page_one_answers(runs, question):
    assert len(runs) == 9
    for name, report in runs.items():
        assert re.search(ANSWERS[question], page_one(report)), (name, page_one(report)[-900:])


def test_page_one_says_of_each_stiffness_whether_it_is_known_and_how_well(runs):
    for name, report in runs.items():
        text = page_one(report)
        stiffnesses = set(re.findall(r"\bk11|k12|k22|[A-D]\.k(?:x|y|rz)\b(?=,)", text))
        assert len(stiffnesses) >= 2, name
        for stiffness in stiffnesses:
            answer = rf"{re.escape(stiffness)}\b ?(,? (sideways|pushing|coupling|turning))? ({HOW_WELL}) \S* ?{VERDICT}"
            assert re.search(answer, text), (name, stiffness, text)


#: Text of what ends above the fold, in the order of the page.
ABOVE = """fold => [...document.querySelectorAll('.lead p, .lead tr, .lead li, .lead figcaption')]
    .filter(e => e.getBoundingClientRect().bottom <= fold).map(e => e.innerText).join(' ')"""


def test_every_question_is_answered_above_the_fold(runs, tmp_path):
    """Of a screen of 1280 by 900; nothing is said on the console or asked for; of one FRF at most 900 kB."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="NOT CHECKED: playwright is not installed")
    with sync_api.sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=browser(), args=["--no-sandbox"])
        for name, report in runs.items():
            path, said, asked = tmp_path / "report.html", [], []
            path.write_text(render_html(report), encoding="utf-8", newline="\n")
            page = running.new_page(viewport={"width": 1280, "height": 900})
            page.on("console", lambda message, said=said: said.append(message.text))
            page.on("request", lambda request, asked=asked: asked.append(request.url))
            page.goto(path.as_uri())
            text = re.sub(r"\s+", " ", page.evaluate(ABOVE, 900).replace("\u00a0", " "))
            unanswered = {question for question, answer in ANSWERS.items() if not re.search(answer, text)}
            assert unanswered == set(), (name, text)
            assert (said, asked) == ([], [path.as_uri()])
            assert path.stat().st_size <= (900_000 if name == "main" else 1_200_000), name
            page.close()
        running.close()


def test_page_one_is_one_page_long(runs, tmp_path):
    """In print too, with at most five pages behind it before the appendix begins."""
    for name, report in runs.items():
        pages = pdf_pages(report, tmp_path)
        appendix = next(n for n, text in enumerate(pages) if re.search(r"^ *A  ?\w", text, re.MULTILINE))
        assert appendix <= 6, name
        assert all(words in pages[0] for words in ("Next.", "Calculation", "What limits the answer.")), name
        blank = [n for n, text in enumerate(pages[1 : appendix + 1], 2) if len(text.split()) < 40]
        assert not blank, name


def pdf_pages(report, directory):
    """Text of each page."""
    if shutil.which("pdftotext") is None:
        pytest.skip("NOT CHECKED: pdftotext (poppler-utils) is not installed to count the pages of reports")
    path = directory / "report.pdf"
    path.write_bytes(render_pdf(report))
    text = subprocess.run(["pdftotext", "-layout", path, "-"], capture_output=True, check=True, text=True).stdout
    return text.split("\f")
