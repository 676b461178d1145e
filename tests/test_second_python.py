"""What can differ by the version of Python or of a package: imports, the loops once, each command once.

`.ci/run` runs these with its second Python, and the others marked `version` again.
"""

import importlib
import json
import pkgutil
from pathlib import Path

import numpy as np
import pytest

import jointbayes
import vibrecords
from jointbayes.cli.commands import main
from tests.conftest import CONFIGS, cheap_text, cli, edited

pytestmark = [pytest.mark.version, pytest.mark.whole, pytest.mark.second]

SMALL = edited(cheap_text(), ("max_steps = 20000", "max_steps = 200"))
#: Each with the exit codes that it may have: a run this short has not converged.
COMMANDS = [
    ("init", (0,)),
    ("validate small.toml", (0,)),
    ("identify small.toml", (0,)),
    ("inspect tip.csv", (0,)),
    ("sample small.toml --out draws.nc --quiet", (0, 3)),
    ("report draws.nc --out page", (0, 3)),
    ("export draws.nc --to joint.bdf", (0, 3)),
    ("predict draws.nc asked.toml --out predicted", (0, 3)),
    ("same draws.nc draws.nc --quiet", (0, 3)),
    ("run small.toml --out run --quiet", (0, 3)),
    ("check small.toml", (0, 1, 3)),
    ("compare small.toml --out compared", (0, 3)),
    ("plan small.toml --quiet", (0, 3)),
    ("campaign small.toml other.toml --workers 1 --out campaign", (0, 1, 3)),
    ("schema", (0,)),
]


def test_every_module_is_imported():
    for package in (jointbayes, vibrecords):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)


def test_each_command_runs(tmp_path, monkeypatch):
    assert {line.split()[0] for line, _ in COMMANDS} == set(main.commands)
    monkeypatch.chdir(tmp_path)
    Path("small.toml").write_text(SMALL, encoding="utf-8")
    Path("other.toml").write_text(SMALL, encoding="utf-8")
    frf = jointbayes.case_from_text("small", SMALL).problem.test.data.frf
    vibrecords.write_frf(frf, "tip.csv")
    asked = '[predict]\noutputs = ["5:y"]\ninputs = ["5:y"]\nf_min_hz = 20\nf_max_hz = 900\nf_step_hz = 20\n'
    Path("asked.toml").write_text(f"{SMALL}\n{asked}", encoding="utf-8")
    for line, codes in COMMANDS:
        result = cli(*line.split())
        assert result.exit_code in codes, f"{line}: {result.exit_code} {result.output[-2000:]} {result.exception!r}"
    assert {path.suffix for path in Path("run").iterdir() if path.is_file()} >= {".html", ".pdf", ".nc", ".json"}
    assert json.loads(Path("run/summary.json").read_text(encoding="utf-8"))["converged"] is False


@pytest.mark.parametrize("name", ["clamped_beam", "clamped_beam_loss_factor", "portal_frame"])
def test_each_kind_of_loop_gives_a_density(name):
    problem = jointbayes.load_case(CONFIGS / f"{name}.toml").problem
    assert np.unique(problem.log_posterior(problem.prior.sample(np.random.default_rng(1), 8))).size == 8
