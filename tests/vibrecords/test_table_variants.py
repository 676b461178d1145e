"""Tables as analysers may write them, by kind of fault: each is right, asked with an answer that works, or refused.

The FRF is made of three modes. A row names the end: `RIGHT` values, `LISTED` as a spectrum and no FRF, `ASKED` for its
unit (what the case then states makes it right), or `REFUSED` in one line.
"""

import numpy as np
import pytest

from tests.vibrecords.reading import records_of
from vibrecords.errors import MeasurementError
from vibrecords.formats.channel_units import ChannelUnit, restate_frf
from vibrecords.records import FrfRecord, SpectrumRecord

RIGHT, LISTED, ASKED, REFUSED = "right", "listed", "asked", "refused"
MODES = ((38.2, 0.008, 0.05), (239.4, 0.006, 0.5), (670.3, 0.005, 2.0))
F = np.arange(10.0, 401.0)
G, LBF = 9.80665, 4.4482216152605


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

UNITS = {
    **dict.fromkeys(("m/s²/N", "(m/s²)/N", "m/s^2/N", "m/(s^2·N)", "m/(N s^2)", "1/kg", "kg^-1", "m s^-2 N^-1"), 1.0),
    **dict.fromkeys(("m·s⁻²·N⁻¹", "ms-2/N", "m/s²·N⁻¹", "m/s^2 * N^-1", "1/N*(m/s²)", "(m/s²)/(N)", "m/s2/N"), 1.0),
    **{"g/N": G, "gn/N": G, "g/lbf": G / LBF, "g/kN": G / 1e3, "mm/s^2/N": 1e-3, "cm/s²/N": 1e-2, "µm/s²/mN": 1e-3},
    **{"in/s^2/lbf": 0.0254 / LBF, "ft/s²/lbf": 0.3048 / LBF, "m/s**2/N": 1.0},
    **dict.fromkeys(("m/s^2*N", "m/s² N", "m/s2·N", "(m/s^2 N)", "m/s**2*N", "m/s^2N", "m/s·N", "m/N*s"), ASKED),
    **dict.fromkeys(("g/N*s", "m/N s", "mm/s^2*N", "in/s^2*lbf", "EU/EU", "V/N", "m/s²/V", "g"), ASKED),
    **dict.fromkeys(("(m/s^2)*N", "(m/s²)·N", "N*m/s^2", "N^2", "g*N", "N·g", "g²", "(m/s²)^2", "mm*mm/s"), LISTED),
    **dict.fromkeys(("g^2/Hz", "N²/Hz", "(m/s²)²/Hz", "m/s^2/Hz", "m/s^2*N/Hz", "(m/s^2*N)/Hz", "(m/s²)/√Hz"), LISTED),
    **dict.fromkeys(("m/s²/N/Hz", "N·s", "m/s²·s"), (ASKED, LISTED)),
}


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
    elif ASKED in end and frfs:
        (frf,) = frfs
        assert frf.factor is None
        assert any("left as written" in note for note in frf.notes)
        stated = restate_frf(frf, ChannelUnit("m/s^2"), ChannelUnit("N"))
        np.testing.assert_allclose(stated.values, H, rtol=1e-9)
        assert stated.quantity == "accelerance"
    else:
        assert LISTED in end
        assert not frfs
        assert len(spectra) == (1 if polar else 2)


# ---- spectra, and estimates of one FRF

RE_IM = (H.real, H.imag)
SPECTRA = {
    **{f"{name} by name": ([f"{name} Real", f"{name} Imag"], *RE_IM) for name in (
        "Gxf", "Sxf", "Pxy", "Gfx", "gyx", "S_xy", "G_{xf}", "Saf", "Gab", "CSD", "CPSD", "Cross spectrum",
        "Cross power", "Cross-spectrum tip / hammer", "Kreuzspektrum", "Kreuzleistungsdichte", "FFT tip",
        "Gxf tip/hammer")},
    **{f"{name} of one column": ([name], np.abs(H)) for name in (
        "Gxx", "Gff (N^2)", "Pxx (g^2)", "PSD tip", "ASD", "ESD (N^2)", "Autopower", "Auto spectrum", "RMS tip",
        "Autoleistungsspektrum", "Leistungsdichte", "Peak hold")},
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
    **{f"a channel {name}": ([f"{name} Real", f"{name} Imag"], *RE_IM) for name in (
        "Gap", "Pos", "Sub", "S12", "P11", "Pad", "Sig", "Gear", "Spindle", "Pxz 3")},
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


@pytest.mark.parametrize(("told", "rate"), [("1.953125E-5", 51200), ("0.00002", 51200), ("1.9531E-5", 51200)])
def test_the_rate_of_a_labview_file_is_that_of_its_header_where_the_instants_lie_on_it(tmp_path, told, rate):
    head = {"Channels": ["2"], "Samples": ["1024"] * 2, "Y_Unit_Label": ["N", "m/s^2"], "X_Dimension": ["Time"] * 2}
    head |= {"X0": ["0.0"] * 2, "Delta_X": [told] * 2}
    instants = [f"{n / rate:.6f}" for n in range(1024)]
    rows = "".join(f"{t}\t{x:.6g}\t{-x:.6g}\n" for t, x in zip(instants, SAMPLES, strict=True))
    fields = "".join("\t".join([key, *cells]) + "\n" for key, cells in head.items())
    text = "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tOne\n***End_of_Header***\t\n\n"
    text += f"{fields}***End_of_Header***\nX_Value\tForce\tAcceleration\tComment\n{rows}"
    force, motion = records_of(tmp_path / "a.lvm", text)
    assert force.sample_rate_hz == pytest.approx(rate, rel=1e-15 if told == "1.953125E-5" else 2e-5)
    np.testing.assert_allclose(motion.values, -SAMPLES, rtol=1e-5)
