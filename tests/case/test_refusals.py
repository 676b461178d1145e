"""What is wrong with a case is one line that names file, line and key and says what to do; what is odd is a warning."""

import re

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.cli.output import shortened
from tests.case.refusal_rows import broken, case_text_named, lines_of, refusal_rows
from tests.case.test_bodies import write_measurements
from tests.case.test_files import frf_data, stored, virtual
from tests.case.test_files import text as text_of_file
from tests.case.test_imported import CASE as IMPORTED
from tests.case.test_imported import WITH_TOOL, save
from tests.case.test_joints import TWO
from tests.case.test_modes import BASE as MODES
from tests.case.test_modes import ZEROS
from tests.case.test_several_tests import BASE
from tests.case.test_shared_among_tests import HEARD_ALL
from tests.case.test_structures import CHAIN, LAPPED, MATRICES, PORTAL, SPINDLE, SPRINGS, STRAIGHT, text_of
from tests.conftest import cheap_text, shipped_text
from tests.structure.imported.fe_models import plane_beam

BEAM = shipped_text("clamped_beam")
VARIANCE = '[data.variance]\nsource = "relative"\nrelative = 0.03\nfloor = 0.01\n'
CHANNELS = 'channels = { "output 1" = "11:y", "input 1" = "11:y" }\n'
RECORDS = f'f_min_hz = 20.0\nf_max_hz = 1000.0\n\n[data.channels]\n"Point:5:Y+" = "5:y"\n\n[data.records]\n{VARIANCE}'
BASES = {
    "beam": BEAM,
    "frequencies": shipped_text("clamped_beam_frequencies"),
    "every key": case_text_named("every_key"),
    "loss factor": shipped_text("clamped_beam_loss_factor"),
    "uncertain": shipped_text("clamped_beam_uncertain"),
    "matrices": text_of(MATRICES, "1:y", "1:y"),
    "portal": text_of(PORTAL, "3:y", "1:x"),
    "spindle": text_of(SPINDLE, "tool.tip:y", "tool.tip:y"),
    "tests": BASE,
    "two joints": TWO,
    "modes": MODES + ZEROS,
    "measured body": case_text_named("measured_spindle"),
    "measured": f'{BEAM.partition("[data]")[0]}[data]\nkind = "measured_frf"\nfile = "tip.csv"\n{CHANNELS}\n{VARIANCE}',
    "bolted": case_text_named("bolted"),
    "measured file": text_of_file(frf_data()),
    "records": text_of_file(f'[data]\nkind = "measured_frf"\nfile = "hits.npz"\n{RECORDS}'),
    "measured frequencies": HEARD_ALL,
    "small beam": cheap_text(),
    "chain": CHAIN + SPRINGS,
    "lapped": LAPPED,
    "straight": text_of(STRAIGHT, "tool.tip:y", "tool.tip:y"),
    "imported": IMPORTED,
    "imported tool": WITH_TOOL,
}
ROWS = [(base, *row) for base, rows in refusal_rows().items() if "slips" not in base for row in rows]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A directory with the files that the cases name, and with some that are named by mistake."""
    folder = tmp_path_factory.mktemp("refused")
    lines = np.arange(20.0, 600.0)
    squared = (2 * np.pi * lines) ** 2
    values = -squared / (1e5 * (1 + 0.02j) - 0.1 * squared)
    for name, unit in (("tip.csv", " (m/s²/N)"), ("no_units.csv", "")):
        rows = (f"{f:g},{h.real:.6g},{h.imag:.6g}" for f, h in zip(lines, values, strict=True))
        (folder / name).write_text(f"Frequency (Hz),Real{unit},Imaginary{unit}\n" + "\n".join(rows), encoding="utf-8")
    (folder / "photo.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))
    write_measurements(folder)
    stored(virtual(), folder / "tip.npz")
    save(plane_beam(20), folder / "beam.npz")
    np.save(folder / "K.npy", np.array([[2e5, -1e4], [-2e4, 1e3]]))
    np.save(folder / "M.npy", np.eye(3))
    (folder / "K.csv").write_text("1,2\n3")
    (folder / "K.txt").write_text("1")
    for name, shape in (("huge", (10**6, 10**6)), ("beyond", (10**12, 10**12))):  # of which the file holds nothing
        with (folder / f"{name}.npy").open("wb") as file:
            np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return folder


def told(folder, text):
    """What is said of a case: faults, or warnings where it has none."""
    try:
        case = jb.case_from_text("case.toml", text, directory=folder)
    except jb.CaseError as error:
        return lines_of(str(error).replace(f"{folder}/", "")), True
    return [f"case.toml:{warning.line}: {warning}" for warning in case.warnings], False


@pytest.mark.parametrize("base", [base for base in BASES if base not in ("records", "measured frequencies")])
def test_the_bases_have_no_fault(folder, base):
    assert told(folder, BASES[base]) == ([], False)


@pytest.mark.parametrize(("base", "changes", "key", "words"), [(*row[:3], row[3:]) for row in ROWS])
def test_what_is_wrong_is_told_by_line_and_key_with_what_to_do(folder, base, changes, key, words):
    base, warned, _ = base.partition(", warnings")
    text, number = broken(BASES[base], changes)
    lines, is_fault = told(folder, text)
    assert is_fault != bool(warned)
    count = int(words[-1].split()[0]) if words and re.fullmatch(r"\d+ lines", words[-1]) else 1
    assert len(lines) == count, lines
    place = f"case.toml:{number}: {key}: "
    line = next((one for one in lines if one.startswith(place) and words[0] in one), "")
    assert line, (place, lines)
    assert all(word in line for word in words[: -1 if count > 1 else None]), line
    if is_fault:  # the terminal shows what was expected and what to do, however long the line is
        assert "; expected " in line
        assert shortened(f"jointbayes: {line}") == f"jointbayes: {line}"
