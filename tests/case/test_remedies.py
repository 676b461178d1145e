"""What messages on measurement files tell the user to write stands in the schema of cases."""

import ast
import re
from pathlib import Path
from string import Formatter

import pytest

import vibrecords
from jointbayes.case.spec.data_table import (
    ChannelSpec,
    LayoutSpec,
    MeasuredFrequenciesSpec,
    MeasuredFrfSpec,
    RecordsSpec,
    VarianceSpec,
)
from vibrecords.warnings.kinds import KINDS

KEYS = {
    "[data]": MeasuredFrfSpec.model_fields.keys() | MeasuredFrequenciesSpec.model_fields.keys() | {"frequencies_hz"},
    "[data.channels]": ChannelSpec.model_fields.keys(),
    "[data.layout]": LayoutSpec.model_fields.keys() | {"axis"},
    "[data.records]": RecordsSpec.model_fields.keys(),
    "[data.variance]": VarianceSpec.model_fields.keys(),
}
FILES = [*Path(vibrecords.__file__).parent.rglob("*.py")]
SOURCES = [path.read_text(encoding="utf-8") for path in FILES] + [kind["remedy"] for kind in KINDS.values()]
ALL_KEYS = set().union(*KEYS.values())


@pytest.mark.parametrize("key", KINDS)
def test_a_remedy_names_keys_of_the_schema(key):
    remedy = KINDS[key]["remedy"]
    assert set(re.findall(r"\[data[\w.]*\]", remedy)) <= KEYS.keys()
    assert set(re.findall(r"\b[a-z]+(?:_[a-z]+)+\b", remedy)) <= ALL_KEYS
    for name, table in re.findall(r"(\w+)(?: = [\w\"]+)?,? in (\[data[\w.]*\])", remedy):
        assert name in KEYS[table] | {"force", "noise", "write"}  # words that stand before "in"


def test_every_table_of_a_message_is_one_of_the_schema():
    named = {table for source in SOURCES for table in re.findall(r"\[data(?:\.\w+)*\]", source)}
    assert named <= KEYS.keys()
    stated = {pair for source in SOURCES for pair in re.findall(r"\b(\w+) = \S{1,20} in (\[data[.\w]*\])", source)}
    assert {(key, table) for key, table in stated if key not in KEYS[table]} == set()
    assert len(stated) > 3


def test_every_warning_fills_the_braces_of_its_row_and_every_row_is_used():
    used = set()
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in FILES]
    for call in (node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Call)):
        if getattr(call.func, "id", "") == "warn":
            for key in (node.value for node in ast.walk(call.args[0]) if isinstance(node, ast.Constant)):
                words = KINDS[key]["found"] + KINDS[key]["remedy"]
                fields = {name for _, name, _, _ in Formatter().parse(words) if name}
                assert fields == {keyword.arg for keyword in call.keywords}, key
                used.add(key)
    assert used == KINDS.keys()
    assert [path.name for path, text in zip(FILES, SOURCES, strict=False) if " MeasurementWarning(" in text] == [
        "kinds.py"
    ]
