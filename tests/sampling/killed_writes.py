"""`python -m tests.sampling.killed_writes STRIDE`: a small run killed around each of its writes, and resumed."""

import itertools
import os
import signal
import sys
import tempfile
from pathlib import Path

import numpy as np
from benchmarks.disk_faults import each_change, killed_at

import jointbayes.sampling.moves  # noqa: F401  (children are forked with all of it loaded)
from jointbayes.sampling import Proposal, SamplerSettings, StudentT, UnfinishedRun, run_adapted
from jointbayes.sampling import checkpoint as checkpoints
from jointbayes.sampling.coordinate_maps import Identity

SETTINGS = SamplerSettings(walkers=4, max_steps=40, check_every=10, end_tolerance=1e-6)


def gaussian(theta):
    return -0.5 * (theta**2).sum(axis=1)


def draws(place):
    """Run or resume, discard, and return the draws."""
    rng = np.random.default_rng(3)
    proposal = Proposal(StudentT(np.zeros(2), np.eye(2), 5.0), 0.3, 0)
    start = rng.normal(size=(4, 4, 2))
    with UnfinishedRun(place, resume=True) as keeper:
        keeper.begin({"seed": "4"})
        if keeper.estimate is None:
            keeper.keep_estimate({"found": 1})
        given = {"systems": [Identity()], "proposal": proposal, "keeper": keeper}
        chains, _ = run_adapted(gaussian, start, np.random.default_rng(4), SETTINGS, **given)
        keeper.discard()
    return chains.theta.tobytes()


def forked(place, number=None):
    """Draws that a child made; None where it was killed at a write."""
    receive, send = os.pipe()
    child = os.fork()
    if not child:
        try:
            if number is None:
                content = draws(place)
            else:
                with each_change(place.parent, killed_at(number)):
                    content = draws(place)
            os.write(send, content)
            os._exit(0)
        except BaseException as error:
            print(f"{number}: {error!r}", file=sys.stderr)
            os._exit(1)
    os.close(send)
    with os.fdopen(receive, "rb") as stream:
        content = stream.read()
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        assert os.WTERMSIG(status) == signal.SIGKILL
        return None
    assert not status, f"exit status {status}"
    return content


def main(stride):
    """Kill at every moment, a stride apart, until a run ends by itself; print kills and identical draws."""
    checkpoints.SECONDS_BETWEEN, checkpoints._TIMES_THE_COST = 0.0, 0
    kills = identical = 0
    with tempfile.TemporaryDirectory() as folder:
        expected = forked(Path(folder) / "undisturbed")
        for number in itertools.count(2, stride):
            place = Path(folder) / f"place-{number}" / "run"
            place.parent.mkdir()
            if forked(place, number) is not None:
                break
            kills += 1
            again = forked(place)
            left = list(place.parent.iterdir())
            if again == expected and not left:
                identical += 1
            else:
                print(f"{number}: same draws {again == expected}, left {left}", file=sys.stderr)
    print(kills, identical)


if __name__ == "__main__":
    main(int(sys.argv[1]))
