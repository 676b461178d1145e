"""Whether modes have changed between two files of one set-up: simulated files, false alarms, words and exit codes."""

import json

import numpy as np
import pytest
from benchmarks.exact_beam import ExactBeam, circle
from benchmarks.written_files import write_records

from jointbayes.errors import ModelError
from jointbayes.posterior.evidence_table import STRONG
from jointbayes.studies.same_modes import compare_modes, evidence_of_change
from tests.conftest import cli
from vibrecords.records import FrfRecord, ModeRecord

LINES = np.arange(20.0, 2400.0, 4.0)


def measured(path, factor=1.0, seed=1, loss=0.02):
    """An accelerance at the tip of a clamped bar whose joint is so many times as stiff, with 1 % of noise."""
    stiffness = factor * np.array([5.05e9, 3.44e7, 1.52e6])
    beam = ExactBeam(0.383, circle(0.025, 0.3), 2.1e11, 0.3, 7800.0, {1: 0.0, 11: 0.383}, tuple(stiffness))
    receptance = beam.receptance(LINES, ("11:y",), ("11:y",), loss_factor=loss)[:, 0, 0]
    noise = np.random.default_rng(seed).standard_normal((2, LINES.size))
    values = -((2 * np.pi * LINES) ** 2) * receptance * (1 + 0.007 * (noise[0] + 1j * noise[1]))
    write_records([FrfRecord("11:Y+", "11:Y+", LINES, values, "accelerance", "m/s^2/N")], path, "uff58b")
    return path


def test_two_files_of_one_joint_have_not_changed_and_a_softer_joint_has(tmp_path):
    before, again = measured(tmp_path / "before.uff"), measured(tmp_path / "again.uff", seed=2)
    softer = measured(tmp_path / "softer.uff", 0.8, seed=2)
    same, found = compare_modes(before, again), compare_modes(before, softer)
    assert not same.changed
    assert all(mode.probability < 0.5 for mode in same.frequencies)
    assert len(found.frequencies) == len(same.frequencies) == 3
    assert found.changed
    assert all(mode.probability > 0.9 and mode.change < 0 for mode in found.frequencies)
    assert found.two_log_b["damping ratios"] < STRONG  # the joint has no damping
    exact = [ExactBeam(0.383, circle(0.025, 0.3), 2.1e11, 0.3, 7800.0, {1: 0.0, 11: 0.383}, tuple(f * np.array(
        [5.05e9, 3.44e7, 1.52e6]))).modes(2400.0).omega[:3] for f in (1.0, 0.8)]  # fmt: skip
    off = [mode.change - (b / a - 1) for mode, a, b in zip(found.frequencies, *exact, strict=True)]
    assert np.all(np.abs(off) < 3 * np.array([mode.sd for mode in found.frequencies]))


def test_damping_alone_may_change(tmp_path):
    found = compare_modes(measured(tmp_path / "a.uff"), measured(tmp_path / "b.uff", seed=2, loss=0.04))
    assert found.two_log_b["frequencies"] < 0 < STRONG < found.two_log_b["damping ratios"]
    assert all(0.8 < mode.change < 1.2 for mode in found.damping_ratios)


@pytest.mark.parametrize("count", [1, 4])
def test_false_alarms_are_as_rare_as_the_evidence_says(count):
    """Of data without a change at most one in 20 has odds of 20 for one, whatever the standard deviations."""
    rng = np.random.default_rng(1)
    sd = np.exp(rng.uniform(np.log(1e-4), np.log(1e-2), (2000, count)))
    change = sd * rng.standard_normal(sd.shape)
    alarms = [2 * evidence_of_change(d, s, 5e-4, 0.1)[1] > STRONG for d, s in zip(change, sd, strict=True)]
    assert np.mean(alarms) < 0.05
    real = change + 0.02 * rng.standard_normal((2000, 1))
    seen = [2 * evidence_of_change(d, s, 5e-4, 0.1)[1] > STRONG for d, s in zip(real, sd, strict=True)]
    assert np.mean(seen) > 0.6


def test_the_evidence_is_that_of_a_dense_integral():
    change, sd = np.array([0.01, -0.002]), np.array([0.001, 0.004])
    sizes = np.exp(np.linspace(np.log(5e-4), np.log(0.1), 20_001))
    wide = np.sqrt(sd[:, None] ** 2 + sizes**2)
    ratio = np.exp(-0.5 * (change[:, None] / wide) ** 2) / wide
    none = np.exp(-0.5 * (change / sd) ** 2) / sd
    each, together = evidence_of_change(change, sd, 5e-4, 0.1)
    np.testing.assert_allclose(each, np.log(ratio.mean(axis=1) / none), atol=0.05)
    assert together == pytest.approx(np.log(ratio.prod(axis=0).mean() / none.prod()), abs=0.05)


def test_the_command_says_it_of_each_mode_and_ends_with_1_where_it_has_changed(tmp_path):
    before, softer = measured(tmp_path / "before.uff"), measured(tmp_path / "softer.uff", 0.8, seed=2)
    result = cli("same", before, softer)
    assert result.exit_code == 1
    assert result.stdout.startswith("Mode 1: 121.5")
    assert "The frequencies have changed: odds " in result.stdout
    assert "Which stiffness has changed, and by how much: give a case for each file." in result.stdout
    found = json.loads(cli("same", before, before, "--json").stdout)
    assert (found["exit_code"], found["changed"]) == (0, False)
    assert found["frequencies"][0]["change"] == 0.0


def test_modes_of_a_modal_test_count_and_those_in_one_file_are_named(tmp_path):
    tables = {"a.uff": (100.0, 200.0, 300.0), "b.uff": (101.0, 303.0), "c.uff": (900.0,)}
    for name, modes in tables.items():
        records = [ModeRecord(i + 1, f, 0.01, 0.01, 1e-4, shape={"1:Z+": 1.0}) for i, f in enumerate(modes)]
        write_records(records, tmp_path / name, "uff58b")
    found = compare_modes(tmp_path / "a.uff", tmp_path / "b.uff")
    assert [mode.name for mode in found.frequencies] == ["Mode 1", "Mode 3"]
    assert [mode.change for mode in found.frequencies] == pytest.approx([0.01, 0.01])
    assert found.alone == {str(tmp_path / "a.uff"): (200.0,), str(tmp_path / "b.uff"): ()}
    with pytest.raises(ModelError, match="found modes at 100, 200, 300 and 900 Hz; expected some in both files"):
        compare_modes(tmp_path / "a.uff", tmp_path / "c.uff")


def test_a_file_and_a_case_are_refused(tmp_path):
    before = measured(tmp_path / "before.uff")
    result = cli("same", before, "case.toml")
    assert (result.exit_code, "found one measurement file; expected two cases" in result.stderr) == (2, True)
