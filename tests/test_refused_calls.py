"""What Python is asked wrongly is refused in one line that names what was found: a table of calls for all rooms."""

import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure

import jointbayes as jb
from jointbayes import errors
from tests.one_line import refused
from vibrecords import FrfSet

#: Whose names the calls may use.
MODULES = [import_module(name) for name in (
    "jointbayes.frf", "jointbayes.joint", "jointbayes.inference", "jointbayes.inference.noise.base",
    "jointbayes.inference.noise.proportional", "jointbayes.posterior.checks", "jointbayes.posterior.prediction",
    "jointbayes.report.fe_cards", "jointbayes.sampling", "jointbayes.sampling.diagnostics", "jointbayes.structure",
    "jointbayes.posterior", "jointbayes.report.export", "jointbayes.verdict_rule", "vibrecords", "vibrecords.variance",
    "tests.inference.test_several_tests", "tests.sampling.test_sampling", "tests.sampling.test_proposal",
)]  # fmt: skip
TABLE = re.split(r"^== ", (Path(__file__).parent / "refused_calls.txt").read_text(encoding="utf-8"), flags=re.M)
ROWS = [
    (*room.split("\n", 1)[0].split(": "), *line.split(" ;; "))
    for room in TABLE[1:]
    for line in room.splitlines()[1:]
    if line
]


def frf_with(coherence, averages):
    array = None if coherence is None else np.array(coherence)[:, None, None]
    return FrfSet(np.array([1.0, 2.0]), np.ones((2, 1, 1)), ("1:y",), ("1:y",), "receptance", array, averages)


@pytest.fixture(scope="module")
def names(cheap_posterior, frequency_posterior):
    problem, frf = cheap_posterior.problem, cheap_posterior.problem.test.data.frf
    test = problem.test
    whole = {"structure": test.structure, "joint": test.joints, "data": test.data, "prior": problem.prior}
    return {
        "jb": jb, "np": np, "replace": replace, "frf_with": frf_with,
        "p": cheap_posterior, "f": frequency_posterior, "problem": problem, "body": test.structures.recipe,
        "ports": lambda outputs=("5:y",), lines=frf.frequency_hz: jb.Ports(lines, outputs, frf.inputs),
        "made": lambda **wrong: jb.Problem(**(whole | wrong)), "rng": np.random.default_rng(1),
    }  # fmt: skip


@pytest.mark.parametrize(("room", "kind", "call", "words"), ROWS, ids=[call for _, _, call, _ in ROWS])
def test_a_wrong_call_is_refused_in_one_line(room, kind, call, words, tmp_path, request):
    """A room that is a test module lends its own names."""
    used = {word: getattr(room, word) for word in re.findall(r"\w+", call) for room in MODULES if hasattr(room, word)}
    if room.startswith("tests."):
        own = vars(import_module(room)) | {"tmp_path": tmp_path}
    else:
        own = request.getfixturevalue("names") | {"two": Figure().subplots(2)}
    refused(lambda: eval(call, used | own), getattr(errors, kind), words)
    assert pyplot.get_fignums() == []
