"""`jointbayes inspect`: what it prints, its figure, its exit status."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from benchmarks.written_files import write_records

from jointbayes.report.inspect_figure import inspect_figure
from tests.conftest import cli
from tests.vibrecords.test_inspection import COARSE, conjugated_file, write_hits
from tests.vibrecords.test_warnings import records, times
from vibrecords import inspection
from vibrecords.inspection import inspect_file
from vibrecords.records import FrfRecord


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    path = tmp_path_factory.mktemp("inspect") / "tip.uff"
    write_records(records(np.random.default_rng(1), lines=COARSE), path, "uff58b")
    return path


@pytest.mark.whole
def test_the_figure_has_a_panel_for_each_hit(tmp_path):
    found = inspect_file(write_hits(tmp_path / "hits.npz"))
    curves = [(t.channel, t.hit.reason, t.time_s, t.force_n) for t in found.hits]
    drawn = ElementTree.fromstring(inspect_figure(found.frfs, found.modes, curves))
    panels = [e for e in drawn.iter() if e.get("id", "").startswith("axes_")]
    assert len(panels) == 3 + 5


def test_the_command_prints_it_all_and_draws_a_figure(clean, tmp_path):
    figure = tmp_path / "look.svg"
    result = cli("inspect", clean, "--figure", figure)
    assert result.exit_code == 0, result.output
    for part in ("4 × FRF: accelerance", "averages: 10", "node 2, direction Z+", "Resonances of", "No warnings."):
        assert part in result.output
    assert f"Figure: {figure}" in result.output
    root = ElementTree.parse(figure).getroot()
    assert root.tag.endswith("svg")
    assert len([e for e in root.iter() if e.get("id", "").startswith("axes_")]) == 3  # magnitude, phase, coherence


def test_warnings_are_printed_with_place_and_remedy(clean, tmp_path):
    path = tmp_path / "turned.uff"
    turned = records(np.random.default_rng(1), lines=COARSE)
    write_records([times(turned[0], -1), *turned[1:]], path, "uff58b")
    result = cli("inspect", path)
    assert result.exit_code == 0
    lines = result.output.splitlines()
    at = next(i for i, part in enumerate(lines) if "[sign_flip]" in part)
    line = lines[at]
    assert line.startswith("  1. [sign_flip] data set ")
    assert "(Point:1:Z+/Point:1:Z+): the imaginary part of the accelerance" in line
    assert lines[at + 1].startswith("     What to do: turn the channel")


def test_the_mass_is_held_against_the_mass_line(tmp_path):
    path = tmp_path / "free.npz"
    free = records(np.random.default_rng(6), rigid_kg=4.0, floor=0.0)
    write_records([times(r, 1 / 9.80665) for r in free], path, "npz")
    for options, expected in (([], False), (["--mass", "4.0"], True)):
        result = cli("inspect", path, *options)
        assert ("[g_against_ms2]" in result.output) is expected


@pytest.mark.parametrize(
    ("content", "part"),
    [(b"", "empty"), (b"not a measurement\n" * 3, "expected"), (None, "No such file")],
    ids=["empty", "text", "missing"],
)
def test_what_is_no_measurement_is_one_line_and_exit_2(content, part, tmp_path):
    path = tmp_path / "broken.uff"
    if content is not None:
        path.write_bytes(content)
    result = cli("inspect", path)
    assert result.exit_code == 2
    assert result.output.count("jointbayes: ") == 1
    assert str(path) in result.output


def test_contents_and_warnings_are_printed_before_the_fit_and_progress_on_standard_error(clean, monkeypatch):
    """Whoever looks at a large file has its channels at once, also where the fit takes long or is interrupted."""

    def interrupted(*arguments, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr(inspection, "fit_modes", interrupted)
    result = cli("inspect", clean)
    assert result.exit_code != 0
    assert "Channels (2)" in result.stdout
    assert "No warnings." in result.stdout
    assert "Resonances" not in result.stdout
    assert "fitting resonances: 1595 lines" in result.stderr


def test_resonances_are_sought_in_a_band(clean):
    result = cli("inspect", clean, "--band", "300", "1000")
    lines = result.stdout.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("Resonances of"))
    assert [round(float(line.split()[1])) for line in lines[first + 1 :]] == [400, 820]
    for band in (["1000", "300"], ["300", "300"], ["nan", "300"], ["-1", "5"]):
        wrong = cli("inspect", clean, "--band", *band)
        assert (wrong.exit_code, wrong.stdout) == (2, "")


def test_labels_of_any_kind_are_drawn_as_they_are():
    lines = np.arange(1.0, 41.0)
    labels = ("$\\frac{", "a$b$c", "_first", "\x1b[31m\0", "試験", "<b>&amp;", "\u202e")
    for some in (labels[:4], labels[4:]):
        records = [FrfRecord(label, "b$", lines, lines + 1j, "mobility") for label in some]
        hits = [(f"{label} hit 1", "", np.arange(3.0), np.arange(3.0)) for label in some]
        ElementTree.fromstring(inspect_figure(records, [], hits))


def test_inspect_takes_the_conjugates_where_it_is_asked(tmp_path, clean):
    run = cli("inspect", conjugated_file(tmp_path / "conjugated.uff"), "--conjugate")
    assert run.exit_code == 0
    assert "No warnings." in run.stdout
    right = cli("inspect", clean, "--conjugate")
    assert "[conjugated]" in right.stdout
