"""`jointbayes inspect`: what it prints, its figure, its exit status."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from benchmarks.written_files import write_records

from jointbayes.report.inspect_figure import inspect_figure
from tests.conftest import cli
from tests.vibrecords.test_inspection import COARSE, write_hits
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


def test_the_mass_is_held_against_the_mass_line(tmp_path):
    path = tmp_path / "free.npz"
    free = records(np.random.default_rng(6), rigid_kg=4.0, floor=0.0)
    write_records([times(r, 1 / 9.80665) for r in free], path, "npz")
    for options, expected in (([], False), (["--mass", "4.0"], True)):
        result = cli("inspect", path, *options)
        assert ("[g_against_ms2]" in result.output) is expected


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


def test_labels_of_any_kind_are_drawn_as_they_are():
    lines = np.arange(1.0, 41.0)
    labels = ("$\\frac{", "a$b$c", "_first", "\x1b[31m\0", "試験", "<b>&amp;", "\u202e")
    for some in (labels[:4], labels[4:]):
        records = [FrfRecord(label, "b$", lines, lines + 1j, "mobility") for label in some]
        hits = [(f"{label} hit 1", "", np.arange(3.0), np.arange(3.0)) for label in some]
        ElementTree.fromstring(inspect_figure(records, [], hits))
