"""A loop that is compiled in no time, for `test_compiled`."""

from jointbayes.frf.kernels.compiled import compiled


@compiled
def doubled(number: int) -> int:
    return 2 * number
