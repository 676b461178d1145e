"""Files like those that were once read wrong, where no other test has them.

Each is a variant of one of the kinds that analysers write. A file counts as
right where each number of it is the truth, as asked where its unit stays open or one line names the key whose value
makes it right, and as wrong where it is read as something else without a word.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from tests.vibrecords import made_files
from tests.vibrecords.made_files import binary_58, clock, function_58
from vibrecords.errors import MeasurementError
from vibrecords.formats import iter_records
from vibrecords.records import FrfRecord, ModeRecord, Record, TimeRecord

RNG = np.random.default_rng(3636)
G = 9.80665
#: Lines in Hz, a modal FRF and a coherence on them; samples of a force and of a motion at 1024 Hz.
F = np.arange(1, 257) * 2.0
H = sum(F**2 / (f**2 - F**2 + 2j * z * f * F) for f, z in ((41.0, 0.01), (117.0, 0.008), (260.0, 0.012))) / 0.7
COHERENCE = 0.99 - 0.4 * RNG.random(F.size) ** 2
RATE = 1024.0
TIME = np.arange(200) / RATE
FORCE, TIP = RNG.normal(size=(2, 200))
MODES = np.array([41.0, 117.0, 260.0]), np.array([0.01, 0.004, 0.02]), RNG.normal(size=(4, 3))
_SIZE, _DEGREES = np.abs(H), np.degrees(np.angle(H))
_DB = 20 * np.log10(_SIZE)


@dataclass(frozen=True)
class Variant:
    """A file and what is in it: FRFs by values, histories by channel, modes; with the answer, if one is asked for."""

    write: Callable[[Path], None]
    frfs: Sequence[np.ndarray] = ()
    lines: np.ndarray = field(default_factory=lambda: F)
    quantity: str | None = None
    histories: Mapping[str, np.ndarray] = field(default_factory=dict)
    rates: Mapping[str, float] = field(default_factory=dict)
    coherence: np.ndarray | None = None
    modes: bool = False
    #: The layout that a person would write after reading the refusal; its keys must stand in it.
    layout: Mapping[str, str] = field(default_factory=dict)
    #: What the refusal asks for where no key helps, as ``export it again``, and the file that this gives.
    remedy: tuple[str, Callable[[Path], None]] | None = None
    #: The file may leave its unit open: values as written, and the case asks.
    open_unit: bool = False


def _close(found: Any, expected: Any, rtol: float = 1e-9) -> bool:
    found, expected = np.asarray(found), np.asarray(expected)
    return found.shape == expected.shape and np.allclose(found, expected, rtol=rtol, atol=1e-12)


def is_right(variant: Variant, records: Sequence[Record], rtol: float = 1e-4) -> str:
    """Nothing where the records are what the file holds; else what is not."""
    frfs = [record for record in records if isinstance(record, FrfRecord)]
    histories = {record.channel: record for record in records if isinstance(record, TimeRecord)}
    modes = [record for record in records if isinstance(record, ModeRecord)]
    if len(frfs) != len(variant.frfs):
        return f"{len(frfs)} FRFs for {len(variant.frfs)}"
    for record, values in zip(frfs, variant.frfs, strict=True):
        coherence = variant.coherence
        right = {
            "lines": _close(record.frequency_hz, variant.lines, rtol),
            "values": _close(record.values, values, rtol),
            "quantity": variant.quantity in (None, record.quantity),
            "coherence": coherence is None or (record.coherence is not None and _close(record.coherence, coherence)),
            "unit": variant.open_unit == (record.factor is None),
        }
        if not all(right.values()):
            return f"other {', '.join(what for what, good in right.items() if not good)}"
    if set(histories) != set(variant.histories):
        return f"histories {sorted(histories)} for {sorted(variant.histories)}"
    for name, values in variant.histories.items():
        record = histories[name]
        if (
            not _close(record.values, values, rtol)
            or abs(record.sample_rate_hz / variant.rates.get(name, RATE) - 1) > 1e-6
        ):
            return f"other samples of {name}"
    if variant.modes:
        frequency, damping, shape = MODES
        found = np.array([(mode.frequency_hz, mode.damping_ratio) for mode in modes]).T
        if not _close(found, [frequency, damping], rtol):
            return f"other frequencies or damping ratios {found.tolist()}"
        if not all(_close([x for x in m.shape.values() if x], s, rtol) for m, s in zip(modes, shape.T, strict=True)):
            return "other shapes"
    return "" if variant.modes or not modes else "modes, where none are"


def outcome(variant: Variant, folder: Path) -> tuple[str, str]:
    """How a variant ends: `right`, `asked`, `refused` (without a remedy that works) or `wrong`; and the line."""
    path = folder / "file"
    variant.write(path)
    try:
        records = list(iter_records(path))
    except MeasurementError as error:
        line = str(error)
        if not variant.layout and not variant.remedy:
            return "refused", line
        if variant.remedy:
            variant.remedy[1](path)
        missing = [key for key in (variant.remedy[:1] if variant.remedy else variant.layout) if key not in line]
        if missing:
            return "refused", f"(no word of {missing}) {line}"
        try:
            fault = is_right(variant, list(iter_records(path, variant.layout)))
        except MeasurementError as again:
            return "refused", f"(remedy fails: {again}) {line}"
        return ("wrong", f"(after the remedy: {fault}) {line}") if fault else ("asked", line)
    fault = is_right(variant, records)
    notes = "; ".join(note for record in records for note in record.notes)[:300]
    if fault:
        return "wrong", f"{fault} ({notes})"
    return "asked" if variant.open_unit else "right", notes


# ---- writers


def _mat(**arrays: Any) -> Callable[[Path], None]:
    return lambda path: scipy.io.savemat(path, arrays, appendmat=False)


def _npz(**arrays: Any) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with path.open("wb") as file:
            np.savez(file, **arrays)

    return write


def write_bytes(text: str | bytes) -> Callable[[Path], None]:
    return lambda path: path.write_bytes(text.encode() if isinstance(text, str) else text) and None


def _columns(head: str, *columns: Any, sep: str = ",", form: str = "{!r}", end: str = "\n") -> str:
    rows = zip(*(np.asarray(c).tolist() for c in columns), strict=True)
    return head + "".join(sep.join(x if isinstance(x, str) else form.format(x) for x in row) + end for row in rows)


def _test_lab(label: str, values: np.ndarray, *, factor: float | None, info: str | None) -> dict[str, Any]:
    """The struct that Test.Lab saves a function as."""
    is_frf = np.iscomplexobj(values)
    step = 2.0 if is_frf else 1 / RATE
    quantity: dict[str, Any] = {"label": label}
    if factor is not None:
        quantity["unit_transformation"] = {"log_reference": 1.0, "factor": factor, "offset": 0.0}
    if info is not None:
        quantity["info"] = info
    start = step if is_frf else 0.0
    axis = {"start_value": start, "increment": step, "number_of_values": float(values.size)}
    axis["quantity"] = {"label": "Hz" if is_frf else "s", "unit_transformation": {"factor": 1.0, "offset": 0.0}}
    return {"x_values": axis, "y_values": {"values": values, "quantity": quantity}}


def _complex(form: Callable[[complex], str], sep: str, head: str = "") -> Callable[[Path], None]:
    return write_bytes(head + "".join(f"{f!r}{sep}{form(z)}\n" for f, z in zip(F.tolist(), H.tolist(), strict=True)))


def _sign(x: float) -> str:
    return "-" if x < 0 else "+"


MKS = "Data saved by Test.Lab in MKS"
SEEN = {"hammer": FORCE, "tip": TIP}
_TWO = np.r_[0.0, F, -F[-2::-1]]  # 0, 2, ..., 512, -510, ..., -2
_TWO_H = np.r_[0.1, H, H[-2::-1].conj()]
_ACC: dict[str, Any] = {"frfs": [H], "quantity": "accelerance"}
_FRF: dict[str, Any] = {"frfs": [H]}
_OPEN: dict[str, Any] = {"frfs": [H], "open_unit": True}
_SLOW = RNG.normal(size=5)
_CELL = np.empty((1, 3), object)
_CELL[0, :] = ["a", np.eye(2), {"x": 1.0}]
_NONE = np.zeros((0,), dtype=[("a", object), ("b", object)])
_REST = {"comment": "bench 4", "cells": _CELL, "flag": True, "none": np.empty((0, 0)), "count": np.int64(7)}
_LBF = _test_lab("lbf", FORCE, factor=1 / 4.4482216, info=MKS)
_FAST = [("hammer", FORCE, clock("N", 1 / RATE)), ("tip", TIP, clock("m/s^2", 1 / RATE))]
_GROUPS = {"fast": _FAST, "slow": [("temperature", _SLOW, clock("degC", 0.5))]}
_PANDAS = np.array([f"({z.real!r}{z.imag:+.17g}j)" for z in H.tolist()])
_TURNED = np.degrees(np.unwrap(np.angle(H))) - 360
_WHOLE_58 = function_58(H, first=2.0, step=2.0)
_FN, _ZETA, _PHI = MODES
_TABLE = {"Frequency_Hz": _FN, "DampingRatio": _ZETA, "Phi": _PHI}
_EACH = [dict(zip(_TABLE, each, strict=True)) for each in zip(_FN, _ZETA, _PHI.T, strict=True)]
_LATE = _PHI[:, 0].repeat(2)[:5]


def _with_slow(**how: str) -> Callable[[Path], None]:
    """Two channels and a third of another rate, as LabVIEW writes them."""
    header = made_files.head(["N", "m/s^2", "C"], [200, 200, 5], step=[1 / RATE, 1 / RATE, 0.5])
    return write_bytes(made_files.lvm(["hammer", "tip", "temperature"], [TIME, FORCE, TIP, _SLOW], header, **how))


def _table(head: str, *columns: Any, **how: Any) -> Callable[[Path], None]:
    return write_bytes(_columns(head, *columns, **how))


#: Kind, name: the file, and what is in it.
ROWS: dict[str, dict[str, tuple[Callable[[Path], None], dict[str, Any]]]] = {
    "SI under another label": {
        "g/N, factor alone": (_mat(FRF=_test_lab("g/N", H, factor=1 / G, info=None)), _ACC),
        "mm/s^2/N with its factor": (_mat(h=_test_lab("mm/s^2/N", H, factor=1e3, info=MKS)), _ACC),
        "histories": (_mat(hammer=_LBF, tip=_test_lab("g", TIP, factor=1 / G, info=MKS)), {"histories": SEEN}),
    },
    "two-sided and whole axes": {
        "whole Hz as int16": (_mat(fs=1024.0, freq=F.astype(np.int16), H=H), _FRF),
        "text, negative lines last": (_table("f [Hz],re [m/N],im [m/N]\n", _TWO, _TWO_H.real, _TWO_H.imag),
                                      {"frfs": [np.r_[0.1, H]], "lines": np.r_[0.0, F]}),
        "numbers of lines with df": (_npz(df=2.0, bin=np.arange(257), FRF=np.r_[0.1, H]), {
            "frfs": [np.r_[0.1, H]], "lines": np.r_[0.0, F], "layout": {"f_start_hz": "0"}}),
    },
    "what else a MAT file holds": {
        "cells, text, flags": (_mat(freq=F, FRF=H, **_REST), _FRF),
        "an empty struct array": (_mat(freq=F, FRF=H, info=_NONE), _FRF),
        "sparse beside": (_mat(freq=F, FRF=H, K=scipy.sparse.eye(5).tocsc()), _FRF),
        "within a struct of structs": (_mat(test={"run": {"f": F, "FRF": H}, "by": "AM", "set": {"n": 3.0}}), _FRF),
        "a column of nan beside": (_mat(freq=F, FRF=H, spare=np.full(256, np.nan)), _FRF),
    },
    "another clock or length": {
        "LVM, commas": (_with_slow(separator="Comma"), {"histories": SEEN}),
        "LVM, decimal comma": (_with_slow(decimal=","), {"histories": SEEN}),
        "TDMS, a slow group": (write_bytes(made_files.tdms(_GROUPS)),
                               {"histories": {**SEEN, "temperature": _SLOW}, "rates": {"temperature": 2.0}}),
        "MAT, five temperatures": (_mat(fs=RATE, **SEEN, temperature=_SLOW), {"histories": SEEN}),
        "FRF beside five readings": (_mat(freq=F, FRF=H, temperature=_SLOW), _FRF),
        "two clocks, t1 and t2": (_mat(t1=TIME, hammer=FORCE, tip=TIP, t2=TIME[:5] * 64, slow=_LATE),
                                  {"histories": {**SEEN, "slow": _LATE}, "rates": {"slow": RATE / 64}}),
    },
    "complex numbers as text": {
        "e of three digits": (_complex(
            lambda z: f"{z.real:.12e}{z.imag:+.12e}i".replace("e-0", "e-00").replace("e+0", "e+00"), "\t"), _FRF),
        "I of SymPy": (_complex(lambda z: f"{z.real!r} {_sign(z.imag)} {abs(z.imag)!r}*I", ","), _FRF),
        "one file of pandas": (_table(",Frequency (Hz),H\n", np.arange(256), F, _PANDAS), _FRF),
    },
    "magnitude and phase, coherence": {
        "text, decibels": (_table("Frequency (Hz),FRF (dB),Phase (deg)\n", F, _DB, _DEGREES), _OPEN),
        "text, amplitude": (_table("Hz;Amplitude (m/s2/N);Phase (rad)\n", F, _SIZE, np.angle(H), sep=";"), _ACC),
        "phase unwrapped": (_table("f [Hz],Mag [m/s^2/N],Phase [deg]\n", F, _SIZE, _TURNED), _ACC),
        "gamma squared": (_table("Frequency [Hz],Real [m/s²/N],Imag [m/s²/N],γ²\n", F, H.real, H.imag, COHERENCE),
                          {**_FRF, "coherence": COHERENCE}),
    },
    "universal files": {
        "binary, Ctrl-Z": (
            write_bytes(binary_58(H, first=2.0, step=2.0, tail=b"\n") + b"\x1a"), _ACC),
        "no delimiter at the end": (write_bytes(_WHOLE_58.rstrip("\n").removesuffix("    -1")),
                                    {**_FRF, "remedy": ("export it again", write_bytes(_WHOLE_58))}),
    },
    "modes": {
        "damping in percent": (_mat(Frequency_Hz=_FN, Damping_percent=100 * _ZETA, Phi=_PHI), {"modes": True}),
        "in a struct": (_mat(Modes=_TABLE), {"modes": True}),
        "names of another program": (
            _mat(NaturalFrequencies=_FN, DampingRatios=_ZETA, ModeShapes=_PHI), {"modes": True}),
        "names that say little": (_mat(Freq=_FN, Damp=_ZETA, Phi=_PHI), {"modes": True, "layout": {
            "mode_frequencies_hz": "Freq", "damping_ratios": "Damp", "mode_shapes": "Phi"}}),
        "npz": (_npz(fn=_FN, zeta=_ZETA, phi=_PHI), {"modes": True}),
        "an array of structs": (_mat(Mode=_EACH), {"modes": True}),
    },
}  # fmt: skip
VARIANTS = {
    f"{kind}: {name}": Variant(write, **more) for kind, rows in ROWS.items() for name, (write, more) in rows.items()
}
