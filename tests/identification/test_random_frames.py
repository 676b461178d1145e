"""The search ends at the mode of random frames, of which one kind of start alone misses some.

Reconstructed motions of the joints alone end 18 to 9000 below the mode of the first three in log posterior.
"""

import pytest
from benchmarks.random_frames import search


@pytest.mark.parametrize("seed", [37, 57, 77, 20, 21, 3])
def test_the_mode_of_a_frame_of_four_to_eight_springs_is_found(seed):
    found = search(seed)
    assert found.found, found
    assert 0.85 < found.squares < 1.15  # the data are those of the model: another FE code, exact, made them
