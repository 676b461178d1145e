"""MATLAB files up to version 7 (``save -v6``, ``save -v7``): named arrays and structs of them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jointbayes.measurement.formats.arrays.isolated import read_isolated
from jointbayes.measurement.formats.arrays.layout import Arrays
from jointbayes.measurement.formats.arrays.matlab_elements import check_elements

__all__ = ["read_matlab", "write_matlab"]


def read_matlab(path: Path) -> Iterator[tuple[str, Arrays]]:
    """Blocks of named arrays of a MAT file; a struct is a block of its own.

    Raises
    ------
    MeasurementError
        If the file is cut off or damaged, unpacks to far more than its size, or holds function handles or objects.
    """
    check_elements(path)
    yield from read_isolated(path, "mat")


def write_matlab(blocks: dict[str, dict[str, Any]], path: Path) -> None:
    """Write blocks of named arrays as variables, or as structs where there are several."""
    from scipy.io import savemat

    variables: dict[str, Any] = {}
    for name, block in blocks.items():
        cells = {key: _cells(value) for key, value in block.items()}
        variables |= {name: cells} if name else cells
    savemat(str(path), variables, appendmat=False, oned_as="column")


def _cells(value: Any) -> Any:  # noqa: ANN401
    if not isinstance(value, list):
        return value
    cells = np.empty((len(value), 1), dtype=object)
    cells[:, 0] = value
    return cells
