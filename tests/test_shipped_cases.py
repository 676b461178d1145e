"""Every case file of the repository does what its comments say, run by the command line as a user runs it."""

import json
import re
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest
from benchmarks import example_figures, numbers, quoted

import jointbayes as jb
from jointbayes.cli.common import draw
from jointbayes.posterior.sampled import by_ensemble
from tests.conftest import cli, first_in_ci

pytestmark = pytest.mark.docs

CASES = numbers.shipped()
RECORD = json.loads(numbers.RECORD.read_text(encoding="utf-8"))
RUN = [name for name, path in CASES.items() if "run" in numbers.claims(path)]
#: FRFs synthetic and measured, modes with shapes, of a rotor and in blocks; CI leaves the others to `make science`.
SAMPLE = ("clamped_beam", "two_storeys_shape", "two_machines")
#: Draws differ on another machine or with another version of a package: median and ends of the interval then scatter by
#: a few per cent of its width, the end of a long tail by more.
SAME = 0.2


def comments(path: Path) -> str:
    """The comment lines of a case file as one text."""
    lines = (line[1:].strip() for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("#"))
    return " ".join(lines)


def test_every_case_says_what_its_commands_exit_with():
    assert {name: set(numbers.claims(path)) for name, path in CASES.items()} == {
        **{name: {"run", "check"} for name in CASES},
        **{name: {"run"} for name in (*example_figures.examples(), "clamped_beam_frequencies_360mm")},
    }


def test_a_claim_is_read_from_comments_only(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text('# `run` exits 0,\n# and `check` exits 1.\ntitle = "`compare` exits 3"\n', encoding="utf-8")
    assert numbers.claims(path) == {"run": 0, "check": 1}


@pytest.fixture
def drawn_once(monkeypatch):
    """`run` and `check` of one case draw the same posterior: it is drawn once."""
    kept = {}

    def remembered(case, seed, take_as=None):
        if case.source.text not in kept:
            kept[case.source.text] = draw(case, seed, take_as)
        return kept[case.source.text]

    monkeypatch.setattr("jointbayes.cli.common.draw", remembered)


@pytest.mark.science
@pytest.mark.usefixtures("plain_reports")  # `make numbers` writes whole ones of the same cases
@pytest.mark.parametrize("name", first_in_ci([*SAMPLE, *(name for name in RUN if name not in SAMPLE)], len(SAMPLE)))
def test_a_shipped_case_runs_and_checks_as_its_comments_say_and_the_pages_quote(name, tmp_path, drawn_once):
    path, claims = CASES[name], numbers.claims(CASES[name])
    result = cli("run", path, "--out", tmp_path / "run")
    assert result.exit_code == claims["run"], result.output
    summary = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
    assert summary["converged"]
    require_what_is_said(name, summary)
    require_the_figures_of_arviz(jb.load_posterior(tmp_path / "run" / "posterior.nc"), summary)
    if "check" in claims:
        result = cli("check", path)
        assert result.exit_code == claims["check"], result.output
        assert ("FAIL" in result.stdout) == (result.exit_code == 1)
        # nothing that lies far off may be called ok
        for line in result.stdout.splitlines():
            off = re.search(r"\(([+-][\d.]+) %\)", line)
            assert not (line.startswith("ok") and off and abs(float(off[1])) > 2), line


def require_the_figures_of_arviz(posterior, summary):
    """R̂ over ensembles, and effective sizes and Monte Carlo errors over walkers, are what ArviZ finds in the draws."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # of its import
        import arviz
    for name, entry in summary["parameters"].items():
        values = posterior.values(name)
        # each ensemble one chain, in the order of its steps: the halves are then those of all its walkers
        pooled = np.ascontiguousarray(by_ensemble(posterior, name)).reshape(by_ensemble(posterior, name).shape[0], -1)
        assert entry["r_hat"] == pytest.approx(float(arviz.rhat(pooled)), abs=2e-3)
        scale = np.log(values) if (values > 0).all() else values
        for method in ("bulk", "tail"):
            assert entry[f"ess_{method}"] == pytest.approx(float(arviz.ess(scale, method=method)), rel=1e-6)
        for probability, error in zip((0.025, 0.975), entry["interval95_error"], strict=True):
            theirs = float(arviz.mcse(values, method="quantile", prob=probability))
            # theirs takes walkers for independent chains, which never makes the error larger than it is
            assert 0.8 < error / theirs < 3


def require_what_is_said(name, summary):
    """Verdicts and intervals are those of the case's comments and of the pages."""
    said, kept = comments(CASES[name]), RECORD["cases"][name]
    assert summary["check"]["explains"] == ("does not explain the data" not in said)
    assert (summary["check"]["explains"], quoted.stiffnesses(kept)) == (kept["explains"], list(summary["parameters"]))
    for k in summary["parameters"]:
        entry = summary["parameters"][k]
        assert entry["verdict"] == kept[k]["verdict"]
        found = np.array([entry["median"], *entry["interval95"]])
        stated = np.array([kept[k][key] for key in ("median", "low", "high")])
        # logarithms far above the median, differences far below it, where an interval may end on either side of zero
        here, there = (np.arcsinh(values / abs(stated[0])) for values in (found, stated))
        assert np.abs(here - there).max() < SAME * abs(there[2] - there[1]), (k, found, stated)
    verdicts = {entry["verdict"] for entry in summary["parameters"].values()}
    if "none of the three stiffnesses is then identified" in said:
        assert not verdicts & {"identified", "weakly identified"}
    if "all three stiffnesses are identified" in said:
        assert verdicts == {"identified"}


def test_what_is_left_out_is_predicted_and_quoted():
    """Modes 3 and 4 of the measured frame, as the publication leaves them to be predicted."""
    kept = RECORD["cases"]["four_storeys"]["left_out"]
    assert [value["name"] for value in kept["values"]][:2] == ["frequency 3", "frequency 4"]
    assert kept["inside"] == kept["count"] == 6
    assert kept["sentence"] in RECORD["cases"]["four_storeys"]["printed"]


def test_of_eighteen_storeys_eight_combinations_are_known():
    """Of ln k to 10 %, by the Fisher information at the truth, with NumPy alone; the draws give seven, nearly eight."""
    spec = tomllib.loads(CASES["eighteen_storeys"].read_text(encoding="utf-8"))
    mass = np.array(list(spec["structure"]["masses_kg"].values()))
    seen = [int(label.split(":")[0]) - 1 for label in spec["data"]["shapes"]["dofs"]]

    def values(log_k):
        k = np.append(np.exp(log_k), 0.0)
        stiffness = np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
        eigenvalues, shapes = np.linalg.eigh(stiffness / np.sqrt(np.outer(mass, mass)))
        shapes = shapes[:, :4] / np.sqrt(mass)[:, None]
        return np.concatenate([0.5 * np.log(eigenvalues[:4]) / 0.005, (shapes[seen] / shapes[-1]).T.ravel() / 0.05])

    truth = np.log([joint["kx"] for joint in spec["reference"]["stiffness"].values()])
    slope = np.array([values(truth + step) - values(truth - step) for step in 1e-5 * np.eye(18)]) / 2e-5
    assert (np.linalg.eigvalsh(slope @ slope.T) > 100).sum() == 8
    record = RECORD["cases"]["eighteen_storeys"]
    assert record["directions"]["known"] == 7
    assert record["directions"]["sd"][7] < 0.105
    # the three that the data tell least of have lost less than half of the prior's variance of ln k
    storeys = [record[f"s{i:02d}.kx"] for i in range(1, 19)]
    widest = sorted(storeys, key=lambda storey: storey["ratio"])[-3:]
    assert [storey["verdict"] for storey in storeys] == [
        "not identified" if storey in widest else "weakly identified" for storey in storeys
    ]
