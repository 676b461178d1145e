"""Tables as analysers may write them, by kind of fault: each is right, asked with an answer that works, or refused.

The FRF is made of three modes. The words of files are those of words.toml: values are right, listed as a spectrum and
no FRF, or asked for their unit, and what the case then states makes them right.
"""

from dataclasses import replace
from time import process_time

import numpy as np
import pytest

from tests.vibrecords.made_files import function_58
from tests.vibrecords.reading import WORDS, put, records_of
from tests.vibrecords.test_labview_layouts import xlsx
from vibrecords.assemble import read_measurement
from vibrecords.errors import MeasurementError
from vibrecords.formats.channel_units import ChannelUnit, restate_frf
from vibrecords.inspection import inspect_file
from vibrecords.measurement_plan import Channel, MeasurementPlan, VarianceSource
from vibrecords.records import FrfRecord, SpectrumRecord
from vibrecords.variance import RelativeNoise
from vibrecords.warnings.collector import find_warnings

RIGHT, REFUSED = "right", "refused"
MODES = ((38.2, 0.008, 0.05), (239.4, 0.006, 0.5), (670.3, 0.005, 2.0))
F = np.arange(10.0, 401.0)
G = 9.80665


def accelerance(f=F, added=0.0):
    """Of the modes in (m/s²)/N; `added` is a of an exponential window, 1/s: H(jω + a)."""
    s = 2j * np.pi * f + added
    omega = [2 * np.pi * fn for fn, _, _ in MODES]
    return sum(s**2 * r / (w**2 + 2 * z * w * s + s**2) for w, (_, z, r) in zip(omega, MODES, strict=True))


H = accelerance()


def table(names, *columns, sep=","):
    rows = [sep.join(f"{x:.12g}" for x in row) for row in zip(F, *columns, strict=True)]
    return "\n".join([sep.join(["Frequency (Hz)", *names]), *rows]) + "\n"


def ends(folder, content, **layout):
    """FRFs and spectra of a table."""
    records = records_of(folder / "a.csv", content, **layout)
    return ([r for r in records if isinstance(r, FrfRecord)], [r for r in records if isinstance(r, SpectrumRecord)])


# ---- units: the file holds H over this factor

UNITS = {label: float(factor) for factor, labels in WORDS["units"]["accelerance"].items() for label in labels}
UNITS = {label: factor for label, factor in UNITS.items() if "[" not in label}  # these stand around the unit already
UNITS |= {label: end for end in ("asked", "listed", "either") for label in WORDS["no_frf"][end]}


@pytest.mark.parametrize("parts", ["Real Imag", "Magnitude Phase"])
@pytest.mark.parametrize("label", UNITS)
def test_units(tmp_path, label, parts):
    end = UNITS[label]
    values = H / end if isinstance(end, float) else H
    polar = parts.startswith("Mag")
    names = [f"{parts.split()[0]} [{label}]", "Phase [deg]" if polar else f"Imag [{label}]"]
    columns = (np.abs(values), np.angle(values, deg=True)) if polar else (values.real, values.imag)
    frfs, spectra = ends(tmp_path, table(names, *columns))
    if isinstance(end, float):
        (frf,) = frfs
        np.testing.assert_allclose(frf.values, H, rtol=1e-9)
        assert (frf.quantity, spectra) == ("accelerance", [])
    elif end in ("asked", "either") and frfs:
        (frf,) = frfs
        assert frf.factor is None
        assert any("left as written" in note for note in frf.notes)
        stated = restate_frf(frf, ChannelUnit("m/s^2"), ChannelUnit("N"))
        np.testing.assert_allclose(stated.values, H, rtol=1e-9)
        assert stated.quantity == "accelerance"
    else:
        assert end in ("listed", "either")
        assert not frfs
        assert len(spectra) == (1 if polar else 2)


# ---- spectra, and estimates of one FRF

RE_IM = (H.real, H.imag)
SPECTRA = {
    **{f"{name} by name": ([f"{name} Real", f"{name} Imag"], *RE_IM) for name in WORDS["spectra"]["cross"]},
    **{f"{name} of one column": ([name], np.abs(H)) for name in WORDS["spectra"]["one"]},
    "magnitude and phase of a cross spectrum": (["Gxf mag [m/s^2*N]", "Gxf phase [deg]"], np.abs(H), np.angle(H)),
    "magnitude of a product, a phase": (["Magnitude [(m/s^2)*N]", "Phase [deg]"], np.abs(H), np.angle(H)),
    "decibels of a cross spectrum": (["Gxf [dB]", "Phase [deg]"], np.abs(H), np.angle(H)),
    "three of them": (["Gff (N^2)", "Gxf Real (m/s^2*N)", "Gxf Imag (m/s^2*N)"], np.abs(H), *RE_IM),
    "with the unit of an FRF": (["Gxf Real (m/s^2/N)", "Gxf Imag (m/s^2/N)"], *RE_IM),
}  # fmt: skip


@pytest.mark.parametrize("name", SPECTRA)
def test_spectra_are_no_frfs(tmp_path, name):
    names, *columns = SPECTRA[name]
    frfs, spectra = ends(tmp_path, table(names, *columns))
    assert not frfs
    assert spectra


#: Columns of one FRF, whose values are H: names that only look like those of spectra, or spectra and other estimates
#: next to it.
H1_H2 = [(0.98 * H).real, (0.98 * H).imag]
ONE_FRF = {
    **{f"a channel {name}": ([f"{name} Real", f"{name} Imag"], *RE_IM) for name in WORDS["spectra"]["channels"]},
    "auto spectra next to it": (["Gff", "Real tip / hammer", "Imag tip / hammer", "Gxx"], np.abs(H), *RE_IM, np.abs(H)),
    "H1, H2, Hv": (["H1 Real", "H1 Imag", "H2 Real", "H2 Imag", "Hv Real", "Hv Imag"], *RE_IM, *H1_H2, *H1_H2),
    "H2, H1": (["H2 Real", "H2 Imag", "H1 Real", "H1 Imag"], *H1_H2, *RE_IM),
    "H1, Hv": (["Real H1", "Imag H1", "Real Hv", "Imag Hv"], *RE_IM, *H1_H2),
    "estimates of channels": (
        ["H1 tip/hammer Real", "H1 tip/hammer Imag", "H2 tip/hammer Real", "H2 tip/hammer Imag"], *RE_IM, *H1_H2),
    "magnitude, phase": (["H1 Mag", "H1 Phase [deg]", "H2 Mag", "H2 Phase [deg]"],
        *(np.abs(H), np.angle(H, deg=True), 1.02 * np.abs(H), np.angle(H, deg=True))),
    "H2 and Hv alone": (["Hv Real", "Hv Imag", "H2 Real", "H2 Imag"], *H1_H2, *RE_IM),
}  # fmt: skip


@pytest.mark.parametrize("name", ONE_FRF)
def test_one_frf(tmp_path, name):
    names, *columns = ONE_FRF[name]
    ((frf,), _) = ends(tmp_path, table(names, *columns))
    np.testing.assert_allclose(frf.values, H, rtol=1e-9)
    if sum("H" in name.upper() for name in names) > 3 and "Gap" not in names[0] and "Gff" not in names:
        assert any("estimates of one FRF" in note for note in frf.notes)


def test_channels_whose_names_look_like_estimates_stay_two(tmp_path):
    other = accelerance() * np.exp(1j * F / 50)
    names = ["H1 Real", "H1 Imag", "H2 Real", "H2 Imag"]
    first, second = ends(tmp_path, table(names, *RE_IM, other.real, other.imag))[0]
    np.testing.assert_allclose([first.values, second.values], [H, other], rtol=1e-9)
    assert [first.response, second.response] == ["H1", "H2"]


# ---- instants as they are printed: rate, digits, and what is told in the header

RNG = np.random.default_rng(52)
SAMPLES = RNG.normal(size=1024)


def decimals(count):
    return lambda t: f"{t:.{count}f}"


def digits(count):
    return lambda t: f"{t:.{count}g}"


INSTANTS = {
    **{f"{rate:g} Hz, {n} decimals": (rate, decimals(n)) for rate, n in (
        (51200, 6), (51200, 7), (25600, 6), (12800, 5), (10000, 4), (8192, 5), (4096, 4), (2048, 4), (1024, 4),
        (1000, 3), (400, 3), (51200, 9), (44100, 6), (48000, 6))},
    **{f"{rate:g} Hz, {n} digits": (rate, digits(n)) for rate, n in (
        (51200, 6), (51200, 7), (25600, 6), (10000, 6), (4096, 5), (2048, 5), (1024, 5), (51200, 8),
        (44100, 7), (1000, 4))},
    **{f"{rate:g} Hz, {n} decimals, comma": (rate, lambda t, n=n: f"{t:.{n}f}".replace(".", ",")) for rate, n in (
        (51200, 6), (4096, 5), (10240, 5))},
    **{f"{rate:g} Hz in ms, {n} decimals": (rate, lambda t, n=n: f"{1e3 * t:.{n}f}") for rate, n in (
        (51200, 3), (2560, 1), (4096, 2))},
}  # fmt: skip
UNEVEN = {
    "one sample is missing": (lambda t: np.delete(t, 500), decimals(6), "a step of 0.000391 s behind 0.0974[0-9]* s"),
    "a gap of a second": (lambda t: t + (t > 0.1), decimals(6), "a step of 1 s behind 0.1 s"),
    "jitter beyond the digits": (lambda t: t + 3e-5 * np.sin(np.arange(t.size)), decimals(6), "where most are"),
    "two rates": (lambda t: np.where(t > 0.1, 2 * t - 0.1, t), decimals(6), "a step of 0.000391 s"),
    "digits too few for the rate": (lambda t: t, decimals(4), "where most are 0.0002 s"),
    "a step back": (lambda t: np.where(np.arange(t.size) == 300, 0, t), decimals(6), "a step of 0.05879 s behind 0 s"),
    "full digits, uneven": (lambda t: t * (1 + t), digits(17), "where most are 0.00023"),
}


def records_at(folder, instants, write, header):
    between = ";" if "," in write(0.5) else ","
    text = "".join(f"{write(t)}{between}{x:.6g}\n".replace(".", "," if between == ";" else ".")
        for t, x in zip(instants, SAMPLES, strict=False))  # fmt: skip
    return records_of(folder / "a.csv", f"{header}{between}Force [N]\n{text}")


@pytest.mark.parametrize("name", INSTANTS)
@pytest.mark.parametrize("start", [0.0, -0.05])
def test_rounded_instants(tmp_path, name, start):
    rate, write = INSTANTS[name]
    instants = start + np.arange(SAMPLES.size) / rate
    (record,) = records_at(tmp_path, instants, write, "Time [ms]" if "in ms" in name else "Time [s]")
    assert record.sample_rate_hz == pytest.approx(rate, rel=2e-4)
    np.testing.assert_allclose(record.values, SAMPLES, rtol=1e-5)


@pytest.mark.parametrize("name", UNEVEN)
def test_uneven_instants_are_refused_with_the_largest_gap(tmp_path, name):
    bend, write, said = UNEVEN[name]
    instants = bend(np.arange(SAMPLES.size) / 5120)
    with pytest.raises(MeasurementError, match=f"not evenly spaced.*{said}.*expected one sampling rate"):
        records_at(tmp_path, instants, write, "Time [s]")


@pytest.mark.parametrize(
    ("told", "rate"), [("1.953125E-5", 51200), ("1.95314407E-5", 51199.5), ("0.00002", 51200), ("1.9531E-5", 51200)]
)
def test_the_rate_of_a_labview_file_is_that_of_its_header_where_the_instants_lie_on_it(tmp_path, told, rate):
    head = {"Channels": ["2"], "Samples": ["1024"] * 2, "Y_Unit_Label": ["N", "m/s^2"], "X_Dimension": ["Time"] * 2}
    head |= {"X0": ["0.0"] * 2, "Delta_X": [told] * 2}
    instants = [f"{n / rate:.6f}" for n in range(1024)]
    rows = "".join(f"{t}\t{x:.6g}\t{-x:.6g}\n" for t, x in zip(instants, SAMPLES, strict=True))
    fields = "".join("\t".join([key, *cells]) + "\n" for key, cells in head.items())
    text = "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tOne\n***End_of_Header***\t\n\n"
    text += f"{fields}***End_of_Header***\nX_Value\tForce\tAcceleration\tComment\n{rows}"
    force, motion = records_of(tmp_path / "a.lvm", text)
    exact = told in ("1.953125E-5", "1.95314407E-5")  # the others are rounded themselves
    assert force.sample_rate_hz == pytest.approx(1 / float(told) if exact else rate, rel=1e-14 if exact else 2e-5)
    np.testing.assert_allclose(motion.values, -SAMPLES, rtol=1e-5)


# ---- sheets of a workbook

STEPS = np.arange(300) / 1024


def sheet(names, *columns):
    return [names, *np.column_stack(columns).tolist()]


def frf_sheet(kind, values):
    if kind == "polar":
        names = ["Frequency (Hz)", "Magnitude (g/N)", "Phase (deg)"]
        return sheet(names, F, np.abs(values) / G, np.angle(values, deg=True))
    if kind == "no names":
        return np.column_stack([F, values.real, values.imag]).tolist()
    return sheet(["Frequency (Hz)", "Real (g/N)", "Imag (g/N)"], F, values.real / G, values.imag / G)


#: A second sheet, the FRFs that it adds, and whether it is named as not read.
SECOND = {
    "an FRF": (frf_sheet("", 2 * H), 1, False),
    "an FRF without names": (frf_sheet("no names", 2 * H), 1, False),
    "nothing": ([], 0, False),
    "notes": ([["Beam"], ["Operator", "AM"]], 0, True),
    "modes": ([["Mode", "Frequency (Hz)", "Damping (%)"], [1, 38.2, 0.8], [2, 239.4, 0.6]], 0, True),
    "a word among numbers": ([["Frequency (Hz)", "Real", "Imag"], [1, 2, 3], [2, "x", 3], [3, 4, 5]], 0, True),
    "a record": (sheet(["Time (s)", "Force (N)"], STEPS, SAMPLES[:300]), 0, False),
    "a coherence": (sheet(["Frequency (Hz)", "Coherence"], F, 0.9 + 0 * F), 0, False),
    "a spectrum": (sheet(["Frequency (Hz)", "PSD (g^2/Hz)"], F, np.abs(H)), 0, False),
    "one column": ([["Averages"], [5], [6]], 0, True),
}


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("second", SECOND)
@pytest.mark.parametrize("first", ["", "polar", "no names"])
def test_all_sheets_are_read_or_named(tmp_path, first, second, order):
    cells, added, is_named = SECOND[second]
    sheets = dict([("h11", frf_sheet(first, H)), ("other", cells)][::order])
    records = records_of(tmp_path / "a.xlsx", xlsx(**sheets))
    frfs = {record.response: record for record in records if isinstance(record, FrfRecord)}
    alone = second in ("nothing", "notes", "one column", "a word among numbers")
    assert set(frfs) == ({"output 1" if alone else "h11"} | ({"other"} if added else set()))
    np.testing.assert_allclose(frfs["output 1" if alone else "h11"].values, H, rtol=1e-9)
    if added:
        np.testing.assert_allclose(frfs["other"].values, 2 * H, rtol=1e-9)
    assert len(records) == (1 if second in ("nothing", "notes", "one column", "modes") or is_named else 2)
    for record in records:
        assert any("sheet 'other' not read" in note for note in record.notes) == is_named


@pytest.mark.parametrize("count", [1, 2, 3, 6])
@pytest.mark.parametrize("channels", [("Force (N)",), ("Force (N)", "Tip (g)")])
def test_sheets_of_the_same_columns_are_hits(tmp_path, count, channels):
    hits = {f"hit {n}": sheet(["Time (s)", *channels], STEPS, *[n * SAMPLES[:300]] * len(channels))
        for n in range(1, count + 1)}  # fmt: skip
    records = records_of(tmp_path / "a.xlsx", xlsx(**hits))
    assert [record.hit for record in records] == (
        [None] * len(channels) if count == 1 else [n for n in range(1, count + 1) for _ in channels])  # fmt: skip
    for record in records:
        factor = G if record.channel == "Tip" else 1
        np.testing.assert_allclose(record.values, (record.hit or 1) * SAMPLES[:300] * factor, rtol=1e-12)


def test_sheets_of_one_channel_each_are_one_record(tmp_path):
    sheets = {"F": sheet(["Time (s)", "Force (N)"], STEPS, SAMPLES[:300])}
    sheets |= {"A": sheet(["Time (s)", "Tip (g)"], STEPS, SAMPLES[:300])}
    assert [record.hit for record in records_of(tmp_path / "a.xlsx", xlsx(**sheets))] == [None, None]


# ---- what stands above the numbers, and names

PLAIN = "".join(f"{f:g}\t{h.real:.12g}\t{h.imag:.12g}\n" for f, h in zip(F, H, strict=True))


@pytest.mark.parametrize("above", WORDS["above"])
@pytest.mark.parametrize("names", ["", "Frequency\tReal\tImag\n"])
def test_values_stated_above_the_numbers_count(tmp_path, above, names):
    factor, averages = WORDS["above"][above]
    (record,) = records_of(tmp_path / "a.txt", above + names + PLAIN)
    np.testing.assert_allclose(record.values, factor * H, rtol=1e-9)
    assert (record.quantity, record.averages) == ("accelerance", averages or None)


@pytest.mark.parametrize("name", WORDS["points"])
def test_points_that_a_stroke_parts_without_blanks(tmp_path, name):
    ((frf,), _) = ends(tmp_path, table([f"{name} Real", f"{name} Imag"], *RE_IM))
    assert [frf.response, frf.reference] == WORDS["points"][name]


AXES = {
    "microseconds with jitter": (5684 + np.cumsum(RNG.uniform(9e3, 1.3e4, 400)), REFUSED),
    "milliseconds with jitter": (12 + np.cumsum(RNG.uniform(9, 13, 400)), REFUSED),
    "even microseconds": (1000.0 * np.arange(2000, 4000), REFUSED),
    "even lines": (F, RIGHT), "log lines": (np.geomspace(5, 2000, 300), RIGHT),
    "rounded lines": (np.round(10 + 1.5625 * np.arange(300)), RIGHT),
    "lines left out": (np.delete(F, [40, 41, 90]), RIGHT), "a falling step": (1e3 - np.geomspace(900, 1, 200), RIGHT),
}  # fmt: skip


@pytest.mark.parametrize("name", AXES)
def test_a_first_column_without_a_name(tmp_path, name):
    x, end = AXES[name]
    text = "".join(f"{f!r},{np.sin(f):.17g},{np.cos(f):.17g}\n" for f in x.tolist())
    if end == RIGHT:
        (record,) = records_of(tmp_path / "a.csv", text)
        np.testing.assert_allclose(record.frequency_hz, x)
    else:
        with pytest.raises(MeasurementError, match="expected to know whether they are time"):
            records_of(tmp_path / "a.csv", text)


def test_many_lines_are_read_fast_and_as_one_by_one(tmp_path):
    count = 50_000
    time, force = np.arange(count) / 51200, RNG.normal(size=count)
    lines = [f"{t!r};{x!r}" for t, x in zip(time.tolist(), force.tolist(), strict=True)]
    plain = "Time [s];Force [N]\n" + "\n".join(lines) + "\n"
    lines[30_000] = lines[30_000].replace(";", ';"') + '"'
    lines.insert(45_000, "# a comment")
    quoted = "Time [s];Force [N]\n" + "\n".join(lines) + "\n"
    before = process_time()
    (record,) = records_of(tmp_path / "a.csv", plain)
    assert process_time() - before < 0.5  # 3e6 lines within 5 s need a tenth of it
    (other,) = records_of(tmp_path / "b.csv", quoted)
    np.testing.assert_array_equal(record.values, force)
    np.testing.assert_array_equal(other.values, force)
    with pytest.raises(MeasurementError, match=r"line 40002: found '1,5'|points and commas"):
        records_of(tmp_path / "c.csv", plain.replace(plain.split("\n")[40_001], "0,78125;1,5"))


# ---- exponential windows that a file states: e^(-a t) makes H(jω + a) of H(jω)

TAU = 0.25
RATES = {"known": 1 / TAU, "unknown": np.nan, "none": 0.0}
WINDOWS = {above: RATES[kind] for kind, said in WORDS["windows"].items() for above in said}


def windowed(above, mark, values):
    lines = "".join(f"{mark}{line}\n" for line in above.split("\n"))
    return lines + table(["Real [m/s^2/N]", "Imag [m/s^2/N]"], values.real, values.imag)


@pytest.mark.parametrize("above", WINDOWS)
@pytest.mark.parametrize("mark", ["", "# "])
def test_what_a_file_says_of_an_exponential_window(tmp_path, above, mark):
    rate = WINDOWS[above]
    values = accelerance(added=np.nan_to_num(rate))
    ((frf,), _) = ends(tmp_path, windowed(above, mark, values))
    np.testing.assert_allclose(frf.window_rate, rate, rtol=1e-9)
    keys = {warning.key for warning in find_warnings(frf)}
    assert ("exponential_window" in keys) == np.isnan(rate)
    assert any("as the file states" in note for note in frf.notes) == (rate > 0)


def test_an_id_line_of_a_universal_file_states_a_window(tmp_path):
    text = function_58(accelerance(added=1 / TAU)).split("\n")
    text[3] = "Exponential window, tau = 0.25 s"
    (frf,) = records_of(tmp_path / "a.uff", "\n".join(text))
    assert frf.window_rate == pytest.approx(1 / TAU)


DAMPING = [(fn, zeta) for fn, zeta, _ in MODES[:2]]


@pytest.mark.parametrize("stated", [True, False])
def test_the_damping_of_a_window_is_taken_out(tmp_path, stated):
    """Of modes that are listed, of FRFs that are data, and of natural frequencies."""
    content = windowed(
        "Window: Exponential, tau = 0.25 s" if stated else "Window: Exponential", "# ", accelerance(added=1 / TAU)
    )
    path = put(tmp_path / "a.csv", content)
    inspection = inspect_file(path)
    found = [(mode.frequency_hz, mode.damping_ratio) for mode in inspection.modes]
    if stated:
        np.testing.assert_allclose(found, DAMPING, rtol=1e-3)
    else:  # what the warning asks for
        (warning,) = (w for w in inspection.warnings if w.key == "exponential_window")
        assert "exponential_tau_s in [data]" in warning.remedy
        assert found[0][1] == pytest.approx(0.0247, rel=2e-3)
    channels = {"output 1": Channel("11:y"), "input 1": Channel("1:y")}
    noise = VarianceSource("relative", RelativeNoise(0.01, 0.0))
    plan = MeasurementPlan(channels, noise, line_step=1, window_tau_s=None if stated else TAU)
    data = read_measurement(["a.csv"], tmp_path, plan)
    np.testing.assert_allclose(data.frf.values[:, 0, 0], H, rtol=0.02, atol=0.02 * np.abs(H).max())
    near = np.abs(F - 38.2) < 3
    np.testing.assert_allclose(data.frf.values[near, 0, 0], H[near], rtol=0.02)
    listed = [(mode.frequency_hz, mode.damping_ratio) for mode in data.provenance.modes]
    np.testing.assert_allclose(listed, DAMPING, rtol=2e-2)  # a third mode lies above the band
    assert not any(warning.key == "exponential_window" for warning in data.provenance.warnings)
    thinned = read_measurement(["a.csv"], tmp_path, replace(plan, line_step=None)).frf.frequency_hz
    assert np.diff(thinned).max() == 4  # e^-4 is left at the end of 1 s: a line of 3 at 5 %, of 5 at 1 %
    assert any("Damping of the exponential window" in note for note in data.provenance.notes)


# ---- advice that is followed


def of_case(folder, content, unit="", **more):
    put(folder / "a.csv", content)
    channels = {
        "output 1": Channel("11:y", unit=ChannelUnit(unit)),
        "input 1": Channel("1:y", unit=ChannelUnit("N" * bool(unit))),
    }
    plan = MeasurementPlan(channels, VarianceSource("relative", RelativeNoise(0.01, 0.0)), **more)
    return read_measurement(["a.csv"], folder, plan).frf


@pytest.mark.parametrize("label", ["m/s^2*N", "m/s² N", "(m/s^2 N)"])
def test_a_unit_of_two_readings_is_asked_for_with_both_and_the_channels_answer(tmp_path, label):
    content = table([f"Real [{label}]", f"Imag [{label}]"], *RE_IM)
    for stated in ({}, {"quantity": "accelerance"}):
        with pytest.raises(MeasurementError, match=r"\(m/s\^2\)\*N or m/\(s\^2\*N\).*; expected .*in \[data"):
            of_case(tmp_path, content, **stated)
    np.testing.assert_allclose(of_case(tmp_path, content, "m/s^2").values[:, 0, 0], H, rtol=1e-9)
    frf = of_case(tmp_path, content.replace(label, "m/(s^2*N)"))
    np.testing.assert_allclose(frf.values[:, 0, 0], H, rtol=1e-9)


def test_spectra_alone_are_refused_and_their_quotient_is_the_frf(tmp_path):
    force = 2.5e-7 * (1 + F / 500)
    cross = H * force
    names = ["Gff (N^2)", "Gxf Real (m/s^2*N)", "Gxf Imag (m/s^2*N)"]
    with pytest.raises(
        MeasurementError, match=r"3 spectra.*expected an FRF; export it, or divide the cross spectrum by"
    ):
        of_case(tmp_path, table(names, force, cross.real, cross.imag))
    quotient = cross / force
    frf = of_case(tmp_path, table(["Real [m/s^2/N]", "Imag [m/s^2/N]"], quotient.real, quotient.imag))
    np.testing.assert_allclose(frf.values[:, 0, 0], H, rtol=1e-9)
