"""The search ends at the mode of random frames, of which one kind of start alone misses some.

Reconstructed motions of the joints alone end 9000 and 18 below the mode of seeds 57 and 77 in log posterior.
"""

import pytest
from benchmarks.random_frames import search

from tests.conftest import first_in_ci


@pytest.mark.parametrize("seed", first_in_ci([77, 20, 21, 57, 0, 5], 3))
def test_the_mode_of_a_frame_of_four_to_eight_springs_is_found(seed):
    found = search(seed)
    assert found.found, found
    assert 0.85 < found.squares < 1.15  # the data are those of the model: another FE code, exact, made them
