"""What cannot be is refused in one line: rows of ``refused.txt``, each an expression in the names of a test module."""

from importlib import import_module
from pathlib import Path

import pytest

import jointbayes as jb
from jointbayes import frf, inference, joint, structure
from tests.one_line import refused

ROOMS = {name: thing for room in (structure, frf, inference) for name, thing in vars(room).items()} | {"joint": joint}


def rows():
    """Module, expression and words of each row."""
    module = ""
    for line in Path(__file__).with_name("refused.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith("== "):
            module = line[3:]
        elif line and not line.startswith("# "):
            expression, _, words = line.partition(" ;; ")
            yield module, expression, words or "expected"


@pytest.mark.parametrize(("module", "expression", "words"), list(rows()))
def test_what_cannot_be_is_refused_in_one_line(tmp_path, module, expression, words):
    names = ROOMS | vars(import_module(module)) | {"tmp_path": tmp_path}
    refused(lambda: eval(expression, names), (jb.ModelError, jb.MeasurementError), words)
