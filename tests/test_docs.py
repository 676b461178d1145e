"""The documentation says what the code does: keys, defaults, commands and names are compared with it."""

import ast
import importlib
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from benchmarks import reference_pages

import jointbayes as jb
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.cli.commands import main
from jointbayes.joint import COORDINATES
from jointbayes.posterior import Posterior, summarise
from tests.conftest import CONFIGS, TABLE_3, edited, shipped_text
from tests.pages import DOCS, PAGES, README, ROOT, fenced, prose, text_of
from tests.report.conftest import posterior_about

pytestmark = pytest.mark.docs

HEADING = re.compile(r"^## +(.*)$", re.MULTILINE)
TABLE_ROW = re.compile(r"^\| `(\w+)` \|(.*)\|$", re.MULTILINE)


def _sections(page: Path) -> Iterator[tuple[str, str]]:
    """Give heading and text of each section of the second level."""
    parts = HEADING.split(text_of(page))
    yield from zip(parts[1::2], parts[2::2], strict=True)


def _documented_keys() -> dict[tuple[str, str], str]:
    """Give the default that docs/case-file.md states, without its backticks, by table and key."""
    stated = {}
    for heading, text in _sections(DOCS / "case-file.md"):
        tables = re.findall(r"`\[([\w.]+)\]`", heading) or [""]
        for key, cells in TABLE_ROW.findall(text):
            default = re.split(r"(?<!\\)\|", cells)[1].strip().strip("`")
            stated |= {(table, key): default for table in tables}
    return stated


def _said_elsewhere(table: str, key: str) -> bool:
    """Whether a key is one of many alike: of several joints, of the files of a body, of a prior of another kind."""
    if table.startswith("joints"):
        return (table, key) != ("joints", "shared")
    if table.startswith("bodies"):
        return (table, key) not in {("bodies", "kind"), ("bodies", "propagate")}
    coupled = {axis.name for axes in COORDINATES.values() for axis in axes}
    return table.startswith("prior.") and table.removeprefix("prior.") not in coupled


def test_every_key_of_the_case_file_is_documented_in_its_table_with_its_default():
    expected: dict[tuple[str, str], set[str]] = {}
    for table, key, field in reference_pages.keys_of(CaseSpec):
        if _said_elsewhere(table, key):
            continue
        expected.setdefault((table, key), set()).add(reference_pages.default_of(field))
    stated = _documented_keys()
    assert (stated.keys(), {k: d for k, d in stated.items() if d not in expected[k]}) == (expected.keys(), {})


def _tiny_posterior(data: str) -> tuple[jb.Case, Posterior]:
    """Build a posterior from made-up draws: only the form of its summary matters here."""
    case = jb.case_from_text(data, shipped_text(data).replace("f_step_hz = 1.0", "f_step_hz = 500.0"))
    return case, posterior_about(case, case.problem.parametrisation.coordinates(TABLE_3), np.full(3, 0.01))


def _leaf_tables(summary: dict[str, object]) -> Iterator[tuple[str, set[str]]]:
    yield "Top level", set(summary)
    for key in ("map", "natural_frequencies_hz", "fit"):
        yield f"`{key}`", set(summary[key])
    for entry in summary["parameters"].values():
        yield "`parameters.NAME`", set(entry)


@pytest.mark.parametrize("data", ["clamped_beam", "clamped_beam_frequencies"])
def test_every_key_of_the_summary_is_documented_in_its_section(data):
    case, posterior = _tiny_posterior(data)
    summary = summarise(posterior, case.problem.first_guess, case.measured_frequencies_hz).to_dict()
    page = DOCS / "summary-json.md"
    sections = {heading: {key for key, _ in TABLE_ROW.findall(text)} for heading, text in _sections(page)}
    for name, keys in _leaf_tables(summary):
        assert next(rows for heading, rows in sections.items() if heading.startswith(name)) == keys, name
    assert set(summary["parameters"]) == {"k11", "k12", "k22"}
    assert f"is **{summary['schema_version']}**" in text_of(page)


def test_every_figure_of_the_sampler_in_the_summary_is_documented():
    tree = ast.parse((ROOT / "src" / "jointbayes" / "posterior" / "run_record.py").read_text(encoding="utf-8"))
    (function,) = (node for node in tree.body if getattr(node, "name", "") == "sampler_figures")
    written = {key.value for key in function.body[-1].value.keys}
    assert {key for key, _ in TABLE_ROW.findall(dict(_sections(DOCS / "summary-json.md"))["`sampler`"])} == written


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_and_option_shown_exists(page):
    shown = re.findall(r"^(?:\$ )?(?:\.venv/bin/)?jointbayes ([a-z]+)((?: +[^\s`|]+)*)", _code(page), re.MULTILINE)
    for command, rest in shown:
        assert command in main.commands, f"jointbayes {command}"
        known = {name for option in main.commands[command].params for name in option.opts}
        assert set(re.findall(r"(?<!\S)--[a-z-]+", rest)) <= known, f"jointbayes {command}{rest}"


def _code(page: Path) -> str:
    """Give what stands in fences or backticks: the rest is prose, in which the word may be followed by any other."""
    lines = [line.split("  #")[0] for block in fenced(page, "bash", "text") for line in block.splitlines()]
    return "\n".join([*lines, *re.findall(r"`([^`\n]+)`", prose(page))])


def test_every_public_name_is_there_and_is_loaded_at_first_use_only():
    stub = (ROOT / "src" / "jointbayes" / "__init__.pyi").read_text(encoding="utf-8")
    assert len(jb.__all__) == len(set(jb.__all__)) == stub.count("\nfrom ")
    renamed = {"JointBayesError": "UserError"}  # the same class, so that it catches what vibrecords raises
    assert all(getattr(jb, name).__name__ == renamed.get(name, name) for name in jb.__all__)
    assert dir(jb) == sorted(jb.__all__)
    with pytest.raises(AttributeError, match="no attribute 'no_such_name'"):
        _ = jb.no_such_name
    assert len(jb._MOVED) == 27
    for name, room in jb._MOVED.items():
        assert getattr(import_module(room), name).__name__ == name
        with pytest.raises(AttributeError, match=f"no attribute '{name}'; it is in {room}$"):
            getattr(jb, name)
    for name in ("calibrate", "simulate", "hierarchical"):
        with pytest.raises(AttributeError, match=f"no attribute '{name}'; it went in this version: "):
            getattr(jb, name)
    code = "import sys, jointbayes; sys.exit(any(name in sys.modules for name in ('numpy', 'scipy', 'xarray')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def _api() -> str:
    """Give the text of both pages on Python."""
    return text_of("api.md") + text_of("api-problem.md")


def test_every_public_name_has_its_place_in_the_api_pages():
    shown = re.findall(r"^::: [\w.]+\.(\w+)$", _api(), re.MULTILINE)
    assert sorted(shown) == sorted([*jb.__all__, *jb._MOVED])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_case_file_named_exists(page):
    text = text_of(page)
    made_up = {"configs/typo.toml", "configs/three.toml", "configs/clamped_bem.toml"}
    for name in set(re.findall(r"configs/\w+\.toml", text)) - made_up:
        assert (ROOT / name).is_file(), name


def _anchors(page: Path) -> set[str]:
    """Names of the headings of a page to which both a code host and mkdocs lead: the latter joins dashes in a row."""
    headings = re.findall(r"^#+ +(.*)$", prose(page), re.MULTILINE)
    on_host = {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}
    return on_host & set(map(reference_pages.anchor_of, headings))


def test_every_local_link_leads_on_in_the_repository_as_it_is_checked_out():
    if not (ROOT / ".git").exists():
        pytest.skip("no clone: which files belong to the repository is not known")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    tracked = {ROOT / name for name in listed.split("\0") if name}
    there = tracked | {folder for path in tracked for folder in path.parents}
    dead, count = [], 0
    for page in sorted(path for path in tracked if path.suffix == ".md" and path.exists()):
        plain = re.sub(r"`[^`]*`", "", prose(page))
        for target, anchor in re.findall(r"\]\(([^)#:\s]*)(?:#([^)\s]+))?\)", plain):
            count += 1
            to = (page.parent / target).resolve() if target else page
            if to not in there or not to.exists() or (anchor and anchor not in _anchors(to)):
                dead.append(f"{page.relative_to(ROOT)}: {target}#{anchor}")
        if re.search(r"^ *--8<--", text_of(page), re.MULTILINE):
            dead.append(f"{page.relative_to(ROOT)}: an include, which only a build of the site would carry out")
    assert dead == []
    assert count > 220


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CONTRIBUTING.md"], ids=lambda page: page.name)
def test_every_module_and_python_file_named_exists(page):
    text = text_of(page)
    for name in set(re.findall(r"`((?:src|tests|benchmarks)/[\w/]+\.\w+)", text)):
        assert (ROOT / name).is_file(), name
    for name in set(re.findall(r"`(?:from |python -m )?((?:jointbayes|vibrecords|benchmarks)\.[\w.]*\w)`", text)):
        top, *parts = name.split(".")
        place = importlib.import_module(top)
        for part in parts:
            place = getattr(place, part, None) or importlib.import_module(f"{place.__name__}.{part}")


def test_the_page_on_exit_codes_has_those_of_the_command_line():
    from jointbayes.cli import common as cli

    page = text_of("command-line.md")
    stated = {int(code) for code in re.findall(r"^\| (\d+) \|", page, re.MULTILINE)}
    stopped = {cli.FAULT_OF_THE_PROGRAM, cli.INTERRUPTED, cli.OUTPUT_CLOSED, cli.TERMINATED}
    assert stated == {0, cli.NOT_MATCHED, cli.CASES_FAILED, cli.BAD_INPUT, cli.NOT_CONVERGED} | stopped
    assert f"| {cli.NOT_MATCHED} | the check does not match" in page
    assert f"| {cli.BAD_INPUT} | bad input" in page
    assert f"| {cli.NOT_CONVERGED} | the sampler has not converged" in page


def test_pages_are_few_and_short():
    # the bars of tables are no words
    counted = {page.name: len(page.read_text(encoding="utf-8").replace("|", " ").split()) for page in PAGES}
    assert len(counted) - 1 <= 30, "merge a page with one that answers the same question"  # README aside
    assert sum(counted.values()) <= 40_000, "shorten a page"
    assert {name for name, count in counted.items() if count > 3500} == {"case-file.md"}


def test_the_page_made_from_the_command_line_has_every_command_and_option():
    page = text_of("command-line.md")
    sections = dict(re.findall(r"^## jointbayes (\w+)\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL))
    assert set(sections) == set(main.commands)
    of_every = page[page.index("## Options of every command") : page.index("## Options of several commands")]
    for name, command in main.commands.items():
        options = {option for parameter in command.params for option in parameter.opts if option.startswith("--")}
        assert [option for option in options if f"`{option}" not in sections[name] + of_every] == [], name


def test_the_list_of_cases_has_every_case_of_the_repository():
    listed = text_of("cases.md")
    assert sorted(set(re.findall(r"`(\w+\.toml)`", listed))) == sorted(path.name for path in CONFIGS.glob("*.toml"))
    rows = re.findall(r"^\| `(\w+\.toml)` \|", listed, re.MULTILINE)
    assert sorted(rows) == sorted(path.name for path in CONFIGS.glob("*.toml"))


def test_every_page_is_in_the_navigation_once_and_behind_its_links():
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[1]
    listed = re.findall(r": ([\w/-]+\.md)$", navigation, re.MULTILINE)
    assert sorted(listed) == sorted(page.relative_to(DOCS).as_posix() for page in PAGES if page != README)
    top = re.findall(r"^  - (.*?):", navigation, re.MULTILINE)
    assert top == ["Start", "How to", "Why", "Reference"]


def test_the_reasons_that_the_how_to_explains_are_those_of_the_verdicts():
    written = (ROOT / "src" / "jointbayes" / "phrases.py").read_text(encoding="utf-8")
    section = text_of("what-now.md").partition("### Read the reason\n")[2].partition("\n### ")[0]
    reasons = [row.split("|")[1] for row in section.splitlines() if row.startswith("| ")][1:]
    assert len(reasons) >= 6
    for reason in reasons:
        for part in filter(None, map(str.strip, re.split("…|, more than 3", reason))):
            assert part.strip("% ") in written, part


def test_the_errors_shown_are_those_of_the_slips_described(tmp_path, monkeypatch):
    shown = text_of("command-line.md")
    right = (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8")
    slips = {
        "typo": (("length_mm = 383.0", "lenght_mm = 383.0"),),
        "three": (("length_mm = 383.0", 'length_mm = "383"'), ("diameter_mm = 25.0", "diameter_mm = -25.0")),
    }
    (tmp_path / "configs").mkdir()
    monkeypatch.chdir(tmp_path)
    for name, changes in slips.items():
        path = Path("configs") / f"{name}.toml"
        path.write_text(edited(right, *changes), encoding="utf-8")
        with pytest.raises(jb.CaseError) as caught:
            jb.load_case(path)
        assert f"jointbayes: {caught.value}\n" in shown, caught.value
    Path("configs/clamped_beam.toml").write_text(right, encoding="utf-8")
    with pytest.raises(jb.CaseError) as caught:
        jb.load_case("configs/clamped_bem.toml")
    assert f"jointbayes: {caught.value}\n" in shown
    with pytest.raises(jb.MeasurementError) as caught:
        jb.load_posterior("missing.nc")
    assert f"jointbayes: {caught.value}\n" in shown
