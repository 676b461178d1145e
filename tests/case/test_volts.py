"""FRFs over the volts of a shaker: refused as data in SI, used for their modes, and with an uncertain gain."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.walk_through import accelerance

import jointbayes as jb
from tests.case.refusal_rows import parts_named

LINES = np.arange(20.0, 1000.0, 4.0)  # a mode narrower than a line, without coherence, could be a tone
NEWTON_PER_VOLT = 0.037
(CASE,) = parts_named("volts").values()
VARIANCE = '[data.variance]\nsource = "relative"\nrelative = 0.03\nfloor = 0.0\n'


def loaded(
    folder: Path, more: str = "", *, kind: str = "measured_frf", force: str = '"11:y"', unit: str = "m/s^2/V"
) -> jb.Case:
    values = NEWTON_PER_VOLT * accelerance(LINES)
    rows = [f"{f},{h.real!r},{h.imag!r}" for f, h in zip(LINES.tolist(), values.tolist(), strict=True)]
    head = f"Frequency [Hz],Real acc / shaker [{unit}],Imag acc / shaker [{unit}]"
    (folder / "tip.csv").write_text("\n".join([head, *rows]), encoding="utf-8")
    (folder / "case.toml").write_text(CASE.replace("KIND", kind).replace("FORCE", force) + more, encoding="utf-8")
    return jb.load_case(folder / "case.toml")


@pytest.mark.parametrize("unit", ["m/s^2/V", "EU", "V/V", "furlong/N"])
def test_an_frf_in_no_si_unit_is_refused_with_the_ways_out(tmp_path, unit):
    words = (
        r"no motion over a force in SI units; expected the units of response and force: unit = \"g\" and, of volts, "
    )
    with pytest.raises(jb.CaseError, match=words + r"sensitivity .*measured_frequencies.*uncertain.gain"):
        loaded(tmp_path, f'quantity = "accelerance"\n{VARIANCE}', unit=unit)


def test_a_stated_sensitivity_makes_newtons_of_volts(tmp_path):
    force = f'{{ dof = "11:y", unit = "N", sensitivity = {1 / NEWTON_PER_VOLT} }}'
    frf = loaded(tmp_path, VARIANCE, force=force).problem.test.data.frf
    np.testing.assert_allclose(frf.values[:, 0, 0], accelerance(LINES), rtol=1e-12)


def test_modes_need_no_unit(tmp_path):
    case = loaded(tmp_path, "modes = 2\nsd_relative = 0.002\n", kind="measured_frequencies")
    np.testing.assert_allclose(case.problem.test.data.frequency_hz, [121.5, 752.4], rtol=1e-3)


@pytest.mark.science
def test_with_an_uncertain_gain_the_joint_and_the_gain_are_found(tmp_path):
    problem = loaded(tmp_path, VARIANCE + "[uncertain.gain]\nlow_factor = 0.001\nhigh_factor = 1000.0\n").problem
    estimate = jb.find_map(problem)
    assert problem.prior.values(estimate.theta)[2] == pytest.approx(1.52e6, rel=0.15)
    assert np.exp(estimate.theta[problem.names.index("gain")]) == pytest.approx(NEWTON_PER_VOLT, rel=0.02)
