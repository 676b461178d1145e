"""No case of a campaign is lost, done twice or changed when workers are killed while they work."""

import pytest
from benchmarks.campaign import PARTS, run_part

pytestmark = [pytest.mark.science, pytest.mark.long]


def test_killed_workers_lose_no_case_and_change_no_draw(tmp_path):
    pytest.importorskip("distributed", reason="install jointbayes[cluster] for the test on Dask")
    found = {part: run_part(part, tmp_path, 10, cases=3, cheap=True) for part in PARTS}
    for part, counts in found.items():
        assert (counts["done"], counts["lost"], counts["double"], counts["left_over"]) == (10, 0, 0, 0), part
        assert counts["equal"] == counts["compared"] == 10, part
    assert found["local"]["kills"] >= 3
    assert found["dask"]["kills"] >= 3
