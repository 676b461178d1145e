"""Files of the kinds that were once read wrong: each is right, or asked in one line whose remedy makes it right."""

import pytest

from tests.vibrecords.file_variants import VARIANTS, outcome
from tests.vibrecords.public_layouts import LAYOUTS


@pytest.mark.parametrize("name", VARIANTS | LAYOUTS)
def test_a_variant_is_read_right_or_asked(tmp_path, name):
    end, line = outcome((VARIANTS | LAYOUTS)[name], tmp_path)
    assert end in ("right", "asked"), line
