"""What a reader has to hold in mind at once stays small."""

import pytest
from benchmarks.size import ROOT, code_lines, longest_functions

SRC = ROOT / "src"


def test_no_function_has_more_than_60_lines():
    assert longest_functions(SRC) == []


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ("x = 1\n", 1),
        ("# why\n\nx = 1  # how\n", 1),
        ('"""What."""\n\n\ndef f():\n    """Long\n\n    story."""\n    return """two\nlines"""\n', 3),
        ("y = [\n    1,\n\n    2,\n]\n", 4),
    ],
)
def test_lines_of_code_are_those_with_a_token_that_is_no_comment_and_no_docstring(source, lines):
    assert code_lines(source) == lines
