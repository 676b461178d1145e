"""Measurement files of a case lie in its directory, unless the user says otherwise."""

import pytest
from click.testing import CliRunner

import jointbayes as jb
from jointbayes.cli.commands import main
from tests.case.test_files import frf_data, stored, text, virtual
from tests.conftest import edited, without_stages
from tests.one_line import refused

TIP = 'outputs = ["5:y"]'
COMMANDS = ["run", "identify", "sample", "check", "compare", "plan"]


@pytest.fixture
def home(tmp_path):
    """The directory of a case, with a measurement in it, one below and one outside."""
    home = tmp_path / "cases"
    (home / "data").mkdir(parents=True)
    for folder in (tmp_path, home, home / "data"):
        stored(virtual(), folder / "tip.npz", "npz")
    (home / "link.npz").symlink_to("../tip.npz")
    (home / "inner.npz").symlink_to("data/tip.npz")
    (home / "folder").symlink_to("..")
    (tmp_path / "cases2").mkdir()
    stored(virtual(), tmp_path / "cases2" / "tip.npz", "npz")
    return home


def case_in(home, file):
    path = home / "case.toml"
    path.write_text(text(frf_data(TIP, file=file)), encoding="utf-8")
    return path


@pytest.mark.parametrize("name", [
    "tip.npz", "./tip.npz", "data/tip.npz", "data/../tip.npz", "../cases/tip.npz", "inner.npz", "folder/cases/tip.npz",
    "{home}/data/tip.npz",
])  # fmt: skip
def test_files_in_the_directory_of_the_case_or_below_are_read(home, name):
    assert jb.load_case(case_in(home, f'"{name.format(home=home)}"')).problem.test.data.frf.outputs == ("5:y",)


@pytest.mark.parametrize("name", ["../tip.npz", "{home}/../tip.npz", "link.npz", "folder/tip.npz", "../cases2/tip.npz"])
def test_files_elsewhere_are_refused_in_one_line_and_read_where_that_is_allowed(home, name):
    path = case_in(home, f'["tip.npz", "{name.format(home=home)}"]')
    message = refused(lambda: jb.load_case(path), jb.CaseError, "--allow-outside")
    line = 1 + next(i for i, row in enumerate(path.read_text("utf-8").splitlines()) if row.startswith("file = "))
    assert message.startswith(f'{path}:{line}: data.file: found "{name.format(home=home)}", which leads out of the ')
    path = case_in(home, f'"{name.format(home=home)}"')
    assert jb.load_case(path, allow_outside=True).problem.test.data.frf.outputs == ("5:y",)


def test_a_case_reached_by_a_link_has_the_directory_it_is_reached_in(home, tmp_path):
    (tmp_path / "short").symlink_to(home)
    case_in(home, '"tip.npz"')
    assert jb.load_case(tmp_path / "short" / "case.toml").problem.test.data.frf.outputs == ("5:y",)


def test_a_case_from_text_is_confined_to_the_directory_given(home):
    outside = text(frf_data(TIP, file='"../tip.npz"'))
    refused(lambda: jb.case_from_text("case", outside, directory=home), jb.CaseError, "leads out")
    measured = jb.case_from_text("case", outside, directory=home, allow_outside=True).problem.test.data
    again = jb.case_from_text("case", outside, directory=home, data=measured)  # as a report does: no file is read
    assert again.problem.test.data is measured


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_that_reads_a_case_has_the_option_and_tells_of_slips_first(home, monkeypatch, command):
    def stop(*_arguments, **_options):
        raise jb.CaseError("stopped here")

    for place in (
        "workflow.sample",
        "workflow.find_map",
        "workflow.identify",
        "studies.compare.compare",
        "studies.plan.plan",
    ):
        monkeypatch.setattr(f"jointbayes.{place}", stop)
    path = case_in(home, '"../tip.npz"')
    path.write_text(edited(path.read_text("utf-8"), ("length_mm = 383.0", "length_mm = 0.383")), encoding="utf-8")
    line = 1 + next(i for i, row in enumerate(path.read_text("utf-8").splitlines()) if row.startswith("length_mm"))
    slip = f"jointbayes: warning: {path}:{line}: structure.length_mm: found 0.383: "
    arguments = [command, str(path)]
    refused = CliRunner().invoke(main, arguments)
    assert (refused.exit_code, refused.stdout) == (2, "")
    *warnings, last = [line for line in without_stages(refused.stderr) if not line.startswith(" ")]
    assert [warning[: len(slip)] for warning in warnings] == [slip]
    assert "leads out of the directory of the case file" in last
    allowed = CliRunner().invoke(main, [*arguments, "--allow-outside"])
    assert (allowed.exit_code, allowed.stderr.splitlines()[-1]) == (2, "jointbayes: stopped here")
    assert without_stages(allowed.stderr)[0].startswith(slip)
