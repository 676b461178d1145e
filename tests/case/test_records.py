"""Cases on the time histories of a hammer or a shaker: from raw records to the data of the likelihood."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.written_files import write_records

import jointbayes as jb
from tests.conftest import TABLE_3, best_of, cheap_text, pair_matrix
from tests.simulated import ChannelNoise, Hammer, Rig, hammer_records, shaker_records
from vibrecords.formats import iter_records
from vibrecords.records import TimeRecord

VARIANCE = '[data.variance]\nsource = "coherence"\nrelative = 0.003\n'


def measure(
    path: Path, hammer: Hammer | None = None, averages: int = 0, block_s: float = 1.4, kind: str = "npz"
) -> None:
    """Write hits on the tip of the small beam with the published joint, or blocks of a shaker there."""
    model = jb.case_from_text("beam", cheap_text()).problem.test

    def accelerance(lines: np.ndarray) -> np.ndarray:
        receptance = model.receptance_model(jb.Ports(lines, ("5:y",), ("5:y",))).receptance(pair_matrix(TABLE_3))[0]
        return (2j * np.pi * lines[:, None, None]) ** 2 * receptance

    block, noise, rng = round(8000 * block_s), ChannelNoise(0.0005, 0.001), np.random.default_rng(3)
    rig = Rig(accelerance, ("5:y",), ("5:y",), "accelerance", 8000.0, block, 2.6)
    made = hammer_records(rig, hammer, noise, rng) if hammer else shaker_records(rig, averages * block, noise, rng)
    write_records(list(made), path, kind)


def loaded(folder: Path, records: str, variance: str = VARIANCE) -> jb.Case:
    whole = cheap_text()
    start, end = whole.index("[data]"), whole.index("[identification]")
    data = (
        '[data]\nkind = "measured_frf"\nfile = "hits.npz"\nf_min_hz = 20.0\nf_max_hz = 1000.0\n\n'
        f'[data.channels]\n"Point:5:Y+" = "5:y"\n\n{records}\n{variance}\n'
    )
    path = folder / "case.toml"
    path.write_text(f"{whole[:start]}{data}\n{whole[end:]}", encoding="utf-8")
    return jb.load_case(path)


def require_the_joint(case: jb.Case) -> None:
    """The published joint fits nearly as well as the best one, and the data know k22.

    Seeds 1 to 8 of the noise have 2 Δ ln L of 0.5 to 8.5; k22 at the mode, often at the edge of possible joints, is
    there up to 3.4 % off, many of Laplace's standard deviations.
    """
    log_posterior, best = case.problem.log_posterior, best_of(case.problem.log_posterior, {"published": TABLE_3})
    joint = case.problem.prior.parametrisation.coordinates(TABLE_3)
    truth = np.concatenate([joint, best.theta[len(joint) :]])
    here, there = log_posterior(np.array([best.theta, truth]))
    assert 2 * (here - there) < 16.3  # 99.9 % of χ² with three degrees of freedom
    assert np.sqrt(best.covariance[2, 2]) < 0.05


def test_hammer_records_become_frfs_and_find_the_joint(tmp_path):
    measure(tmp_path / "hits.npz", Hammer(6, 1e-3, double_hits=1, overloads=1), kind="uff58b")
    case = loaded(tmp_path, '[data.records]\nmethod = "impact"\nforce_window_s = 0.004')
    assert case.problem.test.data.frf.averages == 6
    assert any("from 6 of 8 hits" in note for note in case.problem.test.data.provenance.notes)
    assert any(
        "Left out of the hits on Point:5:Y+" in n and "double" in n for n in case.problem.test.data.provenance.notes
    )
    require_the_joint(case)


def recording(path: Path, gap_s: float) -> None:
    """The hits of a file in one recording, each after what is left of a block and a gap in which only noise is."""
    by_channel: dict[str, list[TimeRecord]] = {}
    for record in iter_records(path):
        by_channel.setdefault(f"{record.channel} {record.quantity}", []).append(record)
    rng, records = np.random.default_rng(3), []
    for hits in by_channel.values():
        noise = [
            1e-4 * np.abs(hit.values).max() * rng.standard_normal(round(gap_s * hit.sample_rate_hz)) for hit in hits
        ]
        values = np.concatenate(
            [part for pair in zip(noise, (hit.values for hit in hits), strict=True) for part in pair]
        )
        records.append(replace(hits[0], values=values, hit=None))
    write_records(records, path, "uff58b")


@pytest.mark.parametrize("gap_s", [None, 0.1])
def test_hits_need_no_more_than_a_channel_map_and_a_band(tmp_path, gap_s):
    measure(tmp_path / "hits.npz", Hammer(10, 1e-3), kind="uff58b")
    if gap_s:
        recording(tmp_path / "hits.npz", gap_s)
    case = loaded(tmp_path, "", variance="")
    assert case.problem.test.data.frf.averages >= 9
    notes = case.problem.test.data.provenance.notes
    assert notes[0].startswith("FRFs were made of the hits of a hammer, H1, ")
    assert ("blocks of" in notes[0]) == bool(gap_s)
    assert case.problem.test.data.provenance.variance.startswith("from the coherence of")
    require_the_joint(case)


def test_a_force_of_no_hammer_needs_to_be_told_how(tmp_path):
    measure(tmp_path / "hits.npz", averages=3, block_s=1.0)
    with pytest.raises(jb.CaseError, match=r"no hammer's; expected hits.*write method = \"shaker\" and block_s"):
        loaded(tmp_path, "", variance="")


def test_shaker_records_become_frfs(tmp_path):
    measure(tmp_path / "hits.npz", averages=21, block_s=4.0)  # each half a block further: 41 blocks
    case = loaded(tmp_path, '[data.records]\nmethod = "shaker"\nblock_s = 4.0')
    assert np.diff(case.problem.test.data.frf.frequency_hz) == pytest.approx(0.5)  # Hann: of two lines one
    assert case.problem.test.data.frf.averages == pytest.approx(40, abs=1)
    assert [round(m.frequency_hz) for m in case.problem.test.data.provenance.modes] == [122, 752]
