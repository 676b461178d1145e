"""Warnings: each has a file that raises it and a clean file that does not, and clean noisy files raise none."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.written_files import write_records

from vibrecords import quantity_factor
from vibrecords.formats import iter_records
from vibrecords.records import FrfRecord, TimeRecord
from vibrecords.warnings.clear_frf import ClearFrf
from vibrecords.warnings.collector import WarningCollector, find_warnings

UNITS = {"receptance": "m/N", "mobility": "m/s/N", "accelerance": "m/s^2/N"}
LINES = np.arange(10, 3201) * 0.5
PAIRS = ((0, 0), (1, 0), (0, 1), (1, 1))
FREQUENCY = np.array([140.0, 400.0, 820.0, 1310.0])
SHAPES = np.array([[1.0, -0.8, 0.9, 0.7], [0.8, 0.6, -0.7, 0.9]])
DAMPING = np.array([0.01, 0.012, 0.008, 0.01])


def records(rng, quantity="accelerance", *, relative=0.02, floor=0.01, lines=LINES, rigid_kg=None, modal=None):
    """The FRFs between two points with coherence of ten averages: both drive points and both transfers."""
    frequency, damping, shapes = modal or (FREQUENCY, DAMPING, SHAPES)
    omega, omega_r = 2 * np.pi * lines[:, None], 2 * np.pi * frequency
    found = []
    for response, reference in PAIRS:
        receptance = shapes[response] * shapes[reference] / (omega_r**2 - omega**2 + 2j * damping * omega_r * omega)
        exact = receptance.sum(axis=1) - (0 if rigid_kg is None else 1 / (rigid_kg * omega[:, 0] ** 2))
        exact = exact * quantity_factor(lines, quantity)
        sd = relative * np.abs(exact) + floor * np.median(np.abs(exact))
        noisy = exact + sd * (rng.standard_normal(lines.size) + 1j * rng.standard_normal(lines.size))
        pair, coherence = (
            (f"Point:{n + 1}:Z+" for n in (response, reference)),
            1 / (1 + 18 * sd**2 / np.abs(exact) ** 2),
        )
        told = quantity, UNITS[quantity], coherence, 10, f"data set {len(found) + 1}"
        found.append(FrfRecord(*pair, lines, noisy, *told))
    return found


def times(record, factor):
    return replace(record, values=record.values * factor)


def each(**changes):
    return lambda found: [replace(r, **changes) for r in found]


def first(**changes):
    return lambda found: [replace(found[0], **changes)]


def lines_kept(keep):
    return lambda found: [record.at_lines(keep) for record in found]


def with_values(index, value):
    def broken(found):
        values = np.array(found[0].values)
        values[index] = value
        return [replace(found[0], values=values)]

    return broken


def conjugates(found):
    return [r.conjugate for r in found]


def delayed(found):
    return [times(found[0], np.exp(-2j * np.pi * LINES * 1e-4))]


#: Warning, quantity of the clean file, and what makes a file of it that must raise the warning.
BROKEN = {
    "mobility called accelerance":
        ("quantity_phase", "mobility", first(quantity="accelerance", unit=UNITS["accelerance"])),
    "transfer mobility called receptance":
        ("quantity_phase", "mobility", lambda r: [replace(r[1], quantity="receptance", unit=UNITS["receptance"])]),
    "sign of accelerance": ("sign_flip", "accelerance", lambda r: [times(r[0], -1)]),
    "sign of mobility": ("sign_flip", "mobility", lambda r: [times(r[3], -1)]),
    "sign of receptance": ("sign_flip", "receptance", lambda r: [times(r[0], -1)]),
    "direction against the label": ("sign_flip", "accelerance", first(response="Point:1:Z-")),
    "receptance called accelerance":
        ("sign_flip", "receptance", first(quantity="accelerance", unit=UNITS["accelerance"])),
    "conjugated accelerance": ("conjugated", "accelerance", conjugates),
    "conjugated mobility": ("conjugated", "mobility", conjugates),
    "conjugated receptance": ("conjugated", "receptance", conjugates),
    "conjugated transfer alone": ("conjugated", "receptance", lambda r: conjugates(r[1:2])),
    "conjugated drive point of the other sign": ("sign_flip", "accelerance", lambda r: [times(conjugates(r)[0], -1)]),
    "one of four conjugated": ("conjugated", "accelerance", lambda r: [*r[:3], *conjugates(r[3:])]),
    "sign of a transfer": ("reciprocity", "accelerance", lambda r: [r[1], times(r[2], -1)]),
    "another sensitivity": ("reciprocity", "accelerance", lambda r: [r[1], times(r[2], 1.5)]),
    "another place": ("reciprocity", "accelerance", lambda r: [r[1], replace(r[3], response="Point:1:Z+")]),
    "repeat of another place":
        ("repeats_differ", "accelerance", lambda r: [r[0], replace(r[1], response="Point:1:Z+")]),
    "drive point beside the force": ("not_passive", "accelerance", lambda r: [replace(r[1], response="Point:1:Z+")]),
    "delay": ("not_passive", "accelerance", delayed),
    "antiresonance": ("antiresonance_missing", "accelerance", lambda r: [replace(r[1], response="Point:1:Z+")]),
    "no coherence": ("coherence_missing", "accelerance", each(coherence=None)),
    "coherence of 1": ("coherence_one", "accelerance", each(coherence=np.ones(LINES.size))),
    "coherence above 1": ("coherence_range", "accelerance", each(coherence=np.full(LINES.size, 1.5))),
    "no averages": ("averages_missing", "accelerance", each(averages=None)),
    "no quantity": ("quantity_missing", "accelerance", each(unit="", quantity=None)),
    "a line left out": ("uneven_lines", "accelerance", lines_kept(np.arange(LINES.size) != 50)),
    "lines doubled": ("lines_out_of_order", "accelerance", lines_kept(np.sort(np.r_[np.arange(LINES.size), 7]))),
    "axis in rad/s": ("rad_per_s", "accelerance", each(frequency_hz=2 * np.pi * LINES)),
    "axis in rad/s, single precision":
        ("rad_per_s", "accelerance", each(frequency_hz=(2 * np.pi * LINES).astype(np.float32))),
    "g in one of two transfers": ("g_against_ms2", "accelerance", lambda r: [times(r[1], 1 / 9.80665), r[2]]),
    "g in a repeat": ("g_against_ms2", "accelerance", lambda r: [r[0], times(r[0], 9.80665)]),
    "NaN": ("not_finite", "accelerance", with_values(5, np.nan)),
    "zeros": ("zero_lines", "accelerance", with_values(slice(3), 0.0)),
}  # fmt: skip


def keys(found, **more):
    return {warning.key for warning in find_warnings(found, **more)}


@pytest.mark.parametrize("name", BROKEN)
def test_a_file_that_is_wrong_raises_its_warning_and_the_clean_one_does_not(name, tmp_path):
    key, quantity, breaks = BROKEN[name]
    clean = records(np.random.default_rng(1), quantity)
    for file, content, expected in (("clean", clean, False), ("broken", breaks(clean), True)):
        path = tmp_path / f"{file}.npz"
        write_records(content, path, "npz")
        assert (key in keys(iter_records(path))) is expected, file
    for warning in find_warnings(breaks(clean)):
        assert warning.where
        assert "\n" not in warning.where + warning.sentence + warning.remedy


@pytest.mark.parametrize("form", ["uff58", "uff58b"])
def test_universal_files_carry_warnings_over(form, tmp_path):
    clean = records(np.random.default_rng(2))
    for name, content, expected in (
        ("clean", clean, set()),
        ("broken", [times(clean[0], -1), *clean[1:]], {"sign_flip"}),
    ):
        write_records(content, tmp_path / name, form)
        assert keys(iter_records(tmp_path / name)) == expected


def test_a_unit_that_contradicts_the_axis_types_or_is_not_there_is_warned_of(tmp_path):
    path = tmp_path / "tip.uff"
    write_records(records(np.random.default_rng(2))[:1], path, "uff58")
    text = path.read_text(encoding="ascii")
    assert keys(iter_records(path)) == set()
    changes = {
        "quantity_units": [("m/s^2", "m    ")],
        "unit_missing": [("m/s^2", "NONE "), ("Force                N   ", "Force                NONE")],
        "unit_unknown": [("m/s^2", "volts")],
        "unit_system": [("1.00000000000000000E+00", "1.00000000000000000E+03")],
    }
    for key, edits in changes.items():
        changed = text.replace("Force                N", "Force                N   ")
        for old, new in edits:
            assert old in changed
            changed = changed.replace(old, new, 1)
        path.write_text(changed, encoding="ascii")
        assert keys(iter_records(path)) == {key}


@pytest.mark.parametrize("unit", ["N/m", "N/mm", "N/(m/s)", "kg", "lbf/g"])
def test_the_peaks_of_a_force_over_a_motion_are_no_modes(unit, tmp_path):
    np.savez(tmp_path / "a.npz", f=np.arange(1.0, 65.0), H=1 / (1 + 1j * np.arange(64.0)), unit=unit)
    (warning,) = (w for w in find_warnings(iter_records(tmp_path / "a.npz")) if w.key.startswith("unit"))
    assert warning.key == "unit_inverse"
    assert "natural frequencies need none" not in warning.remedy


def test_a_clean_file_raises_nothing_over_many_structures_and_noises():
    alarms = {}
    for seed in range(60):
        rng = np.random.default_rng(seed)
        modes = int(rng.integers(1, 10))
        frequency = np.sort(rng.uniform(30, 2000, modes))
        modal = (frequency, 10 ** rng.uniform(-3, -1.5, modes), rng.standard_normal((2, modes)))
        noise = {"relative": 10 ** rng.uniform(-3, -0.7), "floor": 10 ** rng.uniform(-3, -0.7)}
        lines = np.arange(10, 1000) * rng.choice([0.5, 1.0, 2.5, 25600 / 8192])
        found = keys(records(rng, str(rng.choice(list(UNITS))), lines=lines, modal=modal, **noise))
        if found:
            alarms[seed] = found
    assert alarms == {}


def test_a_turned_direction_with_a_turned_label_is_right():
    clean = records(np.random.default_rng(3))
    turned = [replace(times(r, -1), response=r.response.replace("Z+", "Z-")) for r in clean]
    assert keys(turned) == set()


def test_what_one_frf_cannot_tell_is_not_claimed():
    # a transfer FRF has no sign of its own, and no FRF alone shows g against m/s²
    clean = records(np.random.default_rng(4))
    assert keys([times(clean[1], -1 / 9.80665)]) == set()


def test_the_sentence_names_what_else_it_may_be():
    receptance = records(np.random.default_rng(5), "receptance")
    (warning,) = find_warnings([replace(receptance[0], quantity="accelerance", unit=UNITS["accelerance"])])
    assert "or the FRF is receptance and not accelerance" in warning.sentence
    (mobility,) = find_warnings([times(records(np.random.default_rng(5), "mobility")[0], -1)])
    assert "or the FRF is" not in mobility.sentence


def test_the_mass_of_a_free_structure_shows_an_accelerometer_in_g():
    free = records(np.random.default_rng(6), rigid_kg=4.0, floor=0.0)
    assert keys(free, mass_kg=4.0) == set()
    (warning,) = find_warnings([times(free[0], 1 / 9.80665)], mass_kg=4.0)
    assert warning.key == "g_against_ms2"
    assert keys([times(free[0], 1 / 9.80665)]) == set()  # without the mass nobody can tell


def test_two_quantities_of_one_sensor_show_an_axis_in_rad_per_s():
    lines = np.linspace(20.0, 1500.3, 1200)  # not a round step, so that the axis alone says nothing
    pair = [records(np.random.default_rng(7), q, lines=lines)[0] for q in ("receptance", "accelerance")]
    assert keys(pair) == set()
    assert keys([replace(r, frequency_hz=2 * np.pi * r.frequency_hz) for r in pair]) == {"rad_per_s"}


def test_lines_above_what_the_time_histories_can_show_are_in_rad_per_s():
    lines = np.linspace(20.0, 800.3, 1200)
    history = TimeRecord("Point:1:Z+", 2048.0, np.random.default_rng(8).standard_normal(4096), "acceleration", "m/s^2")
    frf = records(np.random.default_rng(8), lines=lines)[0]
    assert keys([history, frf]) == set()
    assert keys([replace(frf, frequency_hz=2 * np.pi * lines), history]) == {"rad_per_s"}


def test_one_warning_stands_for_many_records():
    clean = records(np.random.default_rng(9))
    (warning,) = find_warnings([replace(r, coherence=None) for r in clean])
    assert warning.where.startswith("data set 1 (Point:1:Z+/Point:1:Z+), ")
    assert warning.where.endswith(" and 1 more")


def test_the_first_line_at_zero_hz_is_named():
    clean = records(np.random.default_rng(10))[0]
    more = {"frequency_hz": np.r_[0.0, 0.5 * np.arange(1, 10), LINES]}
    pad = np.full(10, clean.values[0])
    dc = replace(clean, values=np.r_[pad, clean.values], coherence=np.r_[np.full(10, 0.5), clean.coherence], **more)
    assert "zero_hz" in keys([dc])
    assert "zero_hz" not in keys([clean])


# ---- time histories


def hammer(rng, *, seconds=1.0, rate=12800.0, second=0.0, hit=1):
    """Force of a hammer with noise; `second` is the size of a rebound after 20 ms."""
    t = np.arange(int(seconds * rate)) / rate
    width = rng.uniform(0.5e-3, 2e-3)

    def pulse(start, size):
        u = (t - start) / width
        return np.where((u > 0) & (u < 1), size * np.sin(np.pi * u), 0.0)

    force = pulse(0.05, 200.0) + pulse(0.07, 200.0 * second)
    return TimeRecord("Point:1:Z+", rate, force + 0.3 * rng.standard_normal(t.size), "force", "N", hit, "data set 1")


def ringing(rng):
    t = np.arange(12800) / 12800.0
    decay = sum(
        rng.standard_normal() * np.exp(-0.02 * 2 * np.pi * f * t) * np.sin(2 * np.pi * f * t) for f in FREQUENCY / 2
    )
    return TimeRecord("acc", 12800.0, decay + 1e-3 * rng.standard_normal(t.size), "acceleration", "m/s^2", 1, "record")


def shaken(rng):
    return TimeRecord("Point:1:Z+", 2048.0, 10 * rng.standard_normal(20480), "force", "N", None, "data set 1")


BROKEN_TIMES = {
    "double hit": ("double_hit", lambda rng: hammer(rng), lambda rng: hammer(rng, second=0.4)),
    "double hit in a long record": (
        "double_hit",
        lambda rng: hammer(rng, seconds=3.0, hit=None),
        lambda rng: hammer(rng, seconds=3.0, hit=None, second=0.4),
    ),
    "force cut off": ("overload", hammer, lambda rng: cut_off(hammer(rng))),
    "response cut off": ("overload", ringing, lambda rng: cut_off(ringing(rng))),
    "shaker cut off": ("overload", shaken, lambda rng: cut_off(shaken(rng))),
    "offset of the force": ("offset", hammer, lambda rng: raised(hammer(rng))),
    "offset of the response": ("offset", ringing, lambda rng: raised(ringing(rng))),
    "cable off": ("dead_channel", hammer, lambda rng: replace(hammer(rng), values=np.zeros(12800))),
    "no unit": ("quantity_missing", hammer, lambda rng: replace(hammer(rng), quantity="unknown", unit="")),
    "NaN": ("not_finite", hammer, lambda rng: replace(hammer(rng), values=np.r_[np.nan, hammer(rng).values])),
}


def cut_off(record):
    end = 0.6 * np.abs(record.values).max()
    return replace(record, values=np.clip(record.values, -end, end))


def raised(record):
    return replace(record, values=record.values + 0.1 * np.abs(record.values).max())


@pytest.mark.parametrize("name", BROKEN_TIMES)
def test_a_time_history_that_is_wrong_raises_its_warning_and_a_clean_one_none(name):
    key, clean, broken = BROKEN_TIMES[name]
    for seed in range(10):
        assert keys([clean(np.random.default_rng(seed))]) == set()
        assert key in keys([broken(np.random.default_rng(seed))]), seed


def test_the_next_hit_of_a_long_record_is_no_double_hit():
    rng = np.random.default_rng(1)
    one = hammer(rng, hit=None)
    several = replace(one, values=np.tile(one.values, 4))
    assert keys([several]) == set()


def test_of_many_records_only_sketches_are_kept():
    rng = np.random.default_rng(11)
    lines = np.arange(10, 20_010) * 0.125
    one = records(rng, lines=lines)[0]
    collector = WarningCollector()
    for node in range(30):
        collector.add(replace(one, response=f"Point:{node + 1}:Z+"))
    kept = [s for sketches in collector._sketches.values() for s in sketches]
    size = sum(s.frequency_hz.nbytes + s.mobility.nbytes + s.noise.nbytes for s in kept)
    assert len(kept) == 30
    assert size < 30 * 4096  # of 640 kB each


def random_file(seed):
    """FRFs of a random structure on lines fine or coarse, hardly or very noisy."""
    rng = np.random.default_rng(seed)
    modes = int(rng.integers(1, 7))
    modal = (np.sort(rng.uniform(100, 1500, modes)), rng.uniform(1e-3, 0.03, modes), rng.normal(size=(2, modes)))
    lines = np.arange(100, 1600, (0.5, 2.0, 5.0)[seed % 3])
    return records(rng, list(UNITS)[seed % 2], modal=modal, lines=lines, relative=(0.02, 0.2, 0.001)[seed % 3])


@pytest.mark.science
def test_a_conjugate_and_a_turned_sign_are_told_apart_in_drive_points_and_transfers():
    seen = {"conjugate": 0, "turned": 0}
    for seed in range(40):
        clean = random_file(seed)
        turned = [times(r, -1) for r in clean]
        assert not keys(clean) & {"conjugated", "sign_flip", "not_passive"}, seed
        assert "conjugated" not in keys(turned), seed
        both = keys(conjugates(turned))
        if "conjugated" not in keys(conjugates(clean)):
            continue
        seen["conjugate"] += 1
        assert "sign_flip" not in keys(conjugates(clean)), seed
        if "sign_flip" in keys(turned):
            seen["turned"] += 1
            assert both >= {"conjugated", "sign_flip"}, seed
    assert seen["conjugate"] >= 36
    assert seen["turned"] >= 25


def test_a_resonance_has_the_lines_of_its_half_power_bandwidth():
    f, centre, ratio = np.arange(100.0, 1000.0), 500.3, 0.02
    mobility = 1j * f / (centre**2 - f**2 + 2j * ratio * centre * f)
    record = FrfRecord("1:z", "1:z", f, mobility, "mobility")
    (resonance,) = ClearFrf.of(record).resonances
    assert resonance.lines == pytest.approx(2 * ratio * centre, abs=1.0)


def test_a_drive_point_that_does_not_tell_is_judged_by_what_the_others_say():
    """Its resonances fall between its lines: alone it says nothing, among conjugates it is one of them."""
    found = records(np.random.default_rng(1))
    lines, values = found[0].frequency_hz[::80], found[0].values[::80].conj()
    alone = replace(found[0], frequency_hz=lines, values=values, coherence=None, where="the coarse one")
    assert "conjugated" not in keys([alone])
    (among,) = [w for w in find_warnings([alone, *conjugates(found[1:3])]) if w.key == "conjugated"]
    assert "the coarse one" in among.where
    assert "conjugate = true in [data]" in among.remedy
