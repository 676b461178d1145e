"""No case of a campaign is lost, done twice or changed when workers are killed while they work."""

import os
import signal
from pathlib import Path

import psutil
import pytest

import jointbayes as jb
from tests.conftest import CONFIGS

pytestmark = [pytest.mark.science, pytest.mark.long]
ROWS = "key,data.noise.seed,data.noise.relative,data.f_step_hz,sampling.walkers\n" + "".join(
    f"c{i},{i},0.003,2,16\n" for i in range(4)
)


def test_killed_workers_lose_no_case_and_change_no_draw(tmp_path):
    table = tmp_path / "joints.csv"
    table.write_text(ROWS, encoding="utf-8")
    killed = []

    def kill(now):
        """Kill the oldest worker when two cases are done, and two more."""
        me = psutil.Process()
        workers = [p for p in me.children(recursive=True) if p.ppid() != me.pid]
        if now.done >= 2 * (len(killed) + 1) and now.figures["running"] and workers:
            killed.append(min(workers, key=psutil.Process.create_time).pid)
            os.kill(killed[-1], signal.SIGKILL)

    base = CONFIGS / "clamped_beam.toml"
    quiet = jb.campaign(table, tmp_path / "quiet", base=base, workers=1)
    disturbed = jb.campaign(table, tmp_path / "disturbed", base=base, workers=2, progress=kill)
    assert killed
    assert (disturbed.index["status"] == "done").all()
    assert disturbed.index["key"].tolist() == quiet.index["key"].tolist()
    assert {path.name for path in Path(tmp_path / "disturbed" / "cases").iterdir()} == set(quiet.index["key"])
    for key in quiet.index["key"]:
        assert disturbed.posterior(key).theta.tobytes() == quiet.posterior(key).theta.tobytes()
