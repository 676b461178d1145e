"""`jointbayes inspect`: what it says of a file, its figure, its exit status, and that it streams."""

import os
import stat
import tracemalloc
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from jointbayes.cli.commands import main
from jointbayes.report.inspect_figure import inspect_figure
from tests.conftest import CONFIGS
from tests.vibrecords.test_warnings import DAMPING, FREQUENCY, LINES, hammer, records, times
from vibrecords import FrfSet, inspection
from vibrecords.formats import write_frf, write_records
from vibrecords.inspection import contents_of_records, inspect_file, with_resonances
from vibrecords.inspection_text import contents_text, resonances_text
from vibrecords.records import CoherenceRecord, FrfRecord, ModeRecord, SpectrumRecord, TimeRecord

COARSE = LINES[1::2]  # 1 Hz apart


def inspected(records):
    return with_resonances(contents_of_records(records))


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    path = tmp_path_factory.mktemp("inspect") / "tip.uff"
    write_records(records(np.random.default_rng(1), lines=COARSE), path, "uff58b")
    return path


@pytest.fixture(scope="module")
def found(clean):
    return inspect_file(clean)


@pytest.fixture(scope="module")
def hits(tmp_path_factory):
    """Five hits, the third a double one, and the velocity of one mode at 200 Hz with 2 % damping."""
    path = tmp_path_factory.mktemp("inspect") / "hits.npz"
    rng = np.random.default_rng(2)
    found = []
    for number in range(1, 6):
        force = hammer(rng, second=0.4 if number == 3 else 0.0, hit=number)
        t = np.arange(force.values.size) / force.sample_rate_hz
        omega, zeta = 2 * np.pi * 200.0, 0.02
        damped = omega * np.sqrt(1 - zeta**2)
        response = np.exp(-zeta * omega * t) * (np.cos(damped * t) - zeta * omega / damped * np.sin(damped * t))
        velocity = np.convolve(force.values, response)[: t.size] / force.sample_rate_hz
        velocity += 1e-4 * np.abs(velocity).max() * rng.standard_normal(t.size)
        found += [force, TimeRecord("laser", force.sample_rate_hz, velocity, "velocity", "m/s", number)]
    write_records(found, path, "npz")
    return path


def test_a_file_is_described(found):
    assert found.form == "uff"
    assert list(found.channels) == ["Point:1:Z+", "Point:2:Z+"]
    assert found.channels["Point:2:Z+"].as_response == found.channels["Point:2:Z+"].as_force == 2
    ((kind, count),) = found.kinds.items()
    assert (count, kind) == (4, "FRF: accelerance, unit (m/s^2)/N; 1595 lines, 5.5 to 1599.5 Hz every 1 Hz")
    assert found.averages == (10,)
    assert 0 < found.coherence[0] < found.coherence[1] < 1
    assert found.warnings == ()


def test_resonances_are_found_with_their_damping(found):
    assert [m.frequency_hz for m in found.modes] == pytest.approx(FREQUENCY, rel=1e-3)
    assert [m.damping_ratio for m in found.modes] == pytest.approx(DAMPING, rel=0.1)
    errors = [(m.frequency_hz - f) / m.frequency_sd_hz for m, f in zip(found.modes, FREQUENCY, strict=True)]
    assert np.abs(errors).max() < 4


def test_the_command_prints_it_all_and_draws_a_figure(clean, tmp_path):
    figure = tmp_path / "look.svg"
    result = CliRunner().invoke(main, ["inspect", str(clean), "--figure", str(figure)])
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
    result = CliRunner().invoke(main, ["inspect", str(path)])
    assert result.exit_code == 0
    lines = result.output.splitlines()
    at = next(i for i, part in enumerate(lines) if "[sign_flip]" in part)
    line = lines[at]
    assert line.startswith("  1. [sign_flip] data set ")
    assert "(Point:1:Z+/Point:1:Z+): the imaginary part of the accelerance" in line
    assert lines[at + 1].startswith("     What to do: turn the channel")


@pytest.mark.whole
def test_each_hit_is_shown_and_the_frfs_of_the_hits_have_their_resonance(hits):
    found = inspect_file(hits)
    assert [t.hit.number for t in found.hits] == [1, 2, 3, 4, 5]
    assert [t.hit.kept for t in found.hits] == [True, True, False, True, True]
    text = "\n".join([*contents_text(found), *resonances_text(found)])
    assert "Point:1:Z+ hit 3: " in text
    assert "LEFT OUT: double hit, again after 2" in text
    first = next(line for line in text.splitlines() if "Point:1:Z+ hit 1: " in line)
    # a half sine is 20 dB down at 1.31 over its length, which is 1.5 times the width at half its height
    assert float(first.split("20 dB down at ")[1].split()[0]) * found.hits[0].hit.width_s == pytest.approx(
        0.87, rel=0.1
    )
    assert {d.key for d in found.warnings} == {"double_hit"}
    (mode,) = found.modes
    assert mode.frequency_hz == pytest.approx(200.0, abs=max(4 * mode.frequency_sd_hz, 0.02))
    assert mode.damping_ratio == pytest.approx(0.02, abs=max(4 * mode.damping_sd, 2e-4))
    curves = [(t.channel, t.hit.reason, t.time_s, t.force_n) for t in found.hits]
    drawn = ElementTree.fromstring(inspect_figure(found.frfs, found.modes, curves))
    panels = [e for e in drawn.iter() if e.get("id", "").startswith("axes_")]
    assert len(panels) == 3 + 5


def test_the_trace_of_a_double_hit_shows_both():
    third = contents_of_records([hammer(np.random.default_rng(3), second=0.4)]).hits[0]
    late = third.force_n[third.time_s > 0.01]
    assert late.max() > 0.2 * third.force_n.max()


def test_the_mass_is_held_against_the_mass_line(tmp_path):
    path = tmp_path / "free.npz"
    free = records(np.random.default_rng(6), rigid_kg=4.0, floor=0.0)
    write_records([times(r, 1 / 9.80665) for r in free], path, "npz")
    for options, expected in (([], False), (["--mass", "4.0"], True)):
        result = CliRunner().invoke(main, ["inspect", str(path), *options])
        assert ("[g_against_ms2]" in result.output) is expected


def test_why_there_are_no_resonances_is_said():
    quiet = [replace(r, quantity=None, unit="") for r in records(np.random.default_rng(3))]
    assert inspected(quiet).modes_note == "no FRF of a known quantity"
    noise = np.random.default_rng(4).standard_normal((2, LINES.size))
    flat = replace(quiet[0], quantity="mobility", values=noise[0] + 1j * noise[1], coherence=None)
    assert inspected([flat]).modes_note == "none stands out of the noise"
    assert "Resonances: none stands out of the noise" in list(resonances_text(inspected([flat])))
    shaken = TimeRecord("1:z", 2048.0, np.random.default_rng(5).standard_normal(4096), "force", "N")
    assert "not one hit each" in inspected([shaken]).modes_note


@pytest.mark.parametrize(
    ("content", "part"),
    [(b"", "empty"), (b"not a measurement\n" * 3, "expected"), (None, "No such file")],
    ids=["empty", "text", "missing"],
)
def test_what_is_no_measurement_is_one_line_and_exit_2(content, part, tmp_path):
    path = tmp_path / "broken.uff"
    if content is not None:
        path.write_bytes(content)
    result = CliRunner().invoke(main, ["inspect", str(path)])
    assert result.exit_code == 2
    assert result.output.count("jointbayes: ") == 1
    assert str(path) in result.output


@pytest.mark.science
def test_many_frfs_are_streamed():
    lines = np.arange(10, 6410) * 0.25
    one = records(np.random.default_rng(7), lines=lines)[1]

    def many(count):
        for node in range(count):
            # values of their own, as read from a file
            yield replace(one, response=f"Point:{node + 2}:Z+", values=one.values * (1 + 0.01 * node))

    peak = {}
    for count in (20, 70):
        tracemalloc.start()
        contents_of_records(many(count))  # the fit is not what is measured
        peak[count] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    # an FRF with its axis and coherence is 200 kB; what is kept of each is a fiftieth of that
    assert (peak[70] - peak[20]) / 50 < 8_000


def test_contents_and_warnings_are_printed_before_the_fit_and_progress_on_standard_error(clean, monkeypatch):
    """Whoever looks at a large file has its channels at once, also where the fit takes long or is interrupted."""

    def interrupted(*arguments, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr(inspection, "fit_modes", interrupted)
    result = CliRunner().invoke(main, ["inspect", str(clean)])
    assert result.exit_code != 0
    assert "Channels (2)" in result.stdout
    assert "No warnings." in result.stdout
    assert "Resonances" not in result.stdout
    assert "fitting resonances: 1595 lines" in result.stderr


def test_resonances_are_sought_in_a_band(clean):
    result = CliRunner().invoke(main, ["inspect", str(clean), "--band", "300", "1000"])
    lines = result.stdout.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("Resonances of"))
    assert [round(float(line.split()[1])) for line in lines[first + 1 :]] == [400, 820]
    for band in (["1000", "300"], ["300", "300"], ["nan", "300"], ["-1", "5"]):
        wrong = CliRunner().invoke(main, ["inspect", str(clean), "--band", *band])
        assert (wrong.exit_code, wrong.stdout) == (2, "")


def test_all_kinds_of_records_are_listed():
    f = np.arange(1.0, 21.0)
    modes = [
        ModeRecord(1, 12.5, 0.01, 0.004, 2e-4, {"1:z": 1 + 0j, "2:z": -0.5 + 0j}),
        ModeRecord(2, 40.0),
    ]
    listed = inspected(
        [
            CoherenceRecord("1:z", "2:z", f, np.full(20, 0.9), 8),
            SpectrumRecord("acc", "PSD", f, np.ones(20), "g²/Hz"),
            *modes,
        ]
    )
    assert listed.kinds == {
        "coherence, without its FRF; 20 lines, 1 to 20 Hz every 1 Hz": 1,
        "spectrum, no FRF: PSD, unit g²/Hz; 20 lines, 1 to 20 Hz every 1 Hz": 1,
        "mode": 2,
    }
    assert (listed.averages, listed.coherence) == ((8,), (0.9, 0.9))
    assert listed.listed_modes == tuple(modes)
    text = "\n".join([*contents_text(listed), *resonances_text(listed)])
    assert "Modes in the file (2)\n    1        12.5 ± 0.01 Hz   damping 0.4 % ± 0.02 %   shape at 2 DOFs\n" in text
    assert "acc  no direction; 1 spectra" in text
    assert "Resonances: there is no FRF" in text


# ---- hostile and careless input


def test_a_coherence_that_is_not_finite_is_warned_of():
    lines = np.arange(1.0, 21.0)
    for bad, where in ((np.inf, 3), (np.nan, 0)):
        coherence = np.full(20, 0.9)
        coherence[where] = bad
        record = FrfRecord("1:Z+", "2:Z+", lines, lines + 1j, "mobility", "m/s/N", coherence, 5)
        found = [w.sentence for w in contents_of_records([record]).warnings if w.key == "coherence_range"]
        assert found == ["coherence is NaN or infinite on 1 of 20 lines, not 0 to 1"]


def test_too_few_lines_to_fit_are_said_without_a_band_that_nobody_gave():
    lines = np.arange(1.0, 14.0)
    record = FrfRecord("1:Z+", "2:Z+", lines, lines + 1j, "mobility")
    assert inspected([record]).modes_note.startswith("modal fit: found 13 lines; expected 16 or more")


def test_numbers_that_no_measurement_gives_are_warned_of_and_nothing_else_is_judged():
    lines = np.arange(1.0, 41.0)
    for size in (1e300, 1e-300):
        record = FrfRecord("1:Z+", "1:Z+", lines, size * (lines + 1j), "mobility", "m/s/N")
        keys = {w.key for w in contents_of_records([record]).warnings}
        assert keys == {"not_finite", "coherence_missing"}


def test_labels_of_any_kind_are_drawn_as_they_are():
    lines = np.arange(1.0, 41.0)
    labels = ("$\\frac{", "a$b$c", "_first", "\x1b[31m\0", "試験", "<b>&amp;", "\u202e")
    for some in (labels[:4], labels[4:]):
        records = [FrfRecord(label, "b$", lines, lines + 1j, "mobility") for label in some]
        hits = [(f"{label} hit 1", "", np.arange(3.0), np.arange(3.0)) for label in some]
        ElementTree.fromstring(inspect_figure(records, [], hits))


def test_a_figure_never_replaces_the_measurement(tmp_path):
    path = tmp_path / "me.csv"
    write_frf(FrfSet(np.arange(1.0, 21.0), np.ones((20, 1, 1)) + 1j, ("a",), ("b",), "mobility"), path, "csv")
    before = path.read_bytes()
    (tmp_path / "link.svg").symlink_to(path)
    (tmp_path / "hard.svg").hardlink_to(path)
    os.mkfifo(tmp_path / "pipe.svg")
    for name in ("me.csv", "link.svg", "hard.svg", "pipe.svg", "."):
        done = CliRunner().invoke(main, ["inspect", str(path), "--figure", str(tmp_path / name)])
        assert done.exit_code == 2, done.output
        assert "expected" in done.stderr
        assert done.stderr.count("jointbayes: ") == 1
    assert path.read_bytes() == before
    assert stat.S_ISFIFO((tmp_path / "pipe.svg").stat().st_mode)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["hard.svg", "link.svg", "me.csv", "pipe.svg"]
    done = CliRunner().invoke(main, ["inspect", str(path), "--figure", str(tmp_path / "new.svg")])
    assert done.exit_code == 0
    ElementTree.parse(tmp_path / "new.svg")


def test_a_measurement_never_replaces_its_case_or_a_device(tmp_path):
    case = tmp_path / "case.toml"
    case.write_bytes((CONFIGS / "virtual_test.toml").read_bytes())
    os.mkfifo(tmp_path / "pipe.csv")
    for name in ("case.toml", "pipe.csv"):
        done = CliRunner().invoke(main, ["simulate", str(case), "--out", str(tmp_path / name), "--format", "csv"])
        assert (done.exit_code, done.stderr.count("jointbayes: ")) == (2, 1)
    assert case.read_bytes() == (CONFIGS / "virtual_test.toml").read_bytes()
    assert stat.S_ISFIFO((tmp_path / "pipe.csv").stat().st_mode)


def conjugated_file(path):
    exact = records(np.random.default_rng(1), lines=COARSE)
    write_records([replace(r, values=r.values.conj()) for r in exact], path, "uff58b")
    return path


def test_a_file_of_conjugates_shows_the_resonances_of_the_structure(found, tmp_path):
    conjugated = inspect_file(conjugated_file(tmp_path / "conjugated.uff"))
    assert [w.key for w in conjugated.warnings] == ["conjugated"]
    assert any("complex conjugates" in note for note in conjugated.notes)
    hz = [mode.frequency_hz for mode in conjugated.modes]
    np.testing.assert_allclose(hz, [mode.frequency_hz for mode in found.modes], rtol=1e-6)


def test_inspect_takes_the_conjugates_where_it_is_asked(tmp_path, clean):
    run = CliRunner().invoke(main, ["inspect", str(conjugated_file(tmp_path / "conjugated.uff")), "--conjugate"])
    assert run.exit_code == 0
    assert "No warnings." in run.stdout
    right = CliRunner().invoke(main, ["inspect", str(clean), "--conjugate"])
    assert "[conjugated]" in right.stdout
