"""Files of Nastran: what pyyeti writes, and those of Nastran's own that come with it."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.structure.imported.small_frame import DOFS, NODES, PLACES


def write_punch(path, **named):
    bulk = pytest.importorskip("pyyeti.nastran.bulk", reason="pyyeti, which writes DMIG, is not installed")
    frames = {}
    for name, matrix in named.items():
        used = np.flatnonzero(np.abs(matrix).sum(axis=0))  # each matrix has its own list of DOFs
        index = pd.MultiIndex.from_tuples([tuple(DOFS[row]) for row in used])
        frames[name] = pd.DataFrame(matrix[np.ix_(used, used)], index=index, columns=index)
    with path.open("w") as file:
        file.write("DTI     TUG1           0      30\n*              1               2\n")  # pyyeti fails on these
        for node, place in zip(NODES, PLACES, strict=True):
            file.write(f"{'GRID*':8}{node:16d}{0:16d}{place[0]:16.9E}{place[1]:16.9E}\n{'*':8}{place[2]:16.9E}\n")
        bulk.wtdmig(file, frames)
    return path


def superelement(folder, which, changed=None, name="a"):
    """Files of a real superelement that Nastran wrote, which come with pyyeti."""
    tests = pytest.importorskip("pyyeti.tests", reason="pyyeti, whose tests hold files of Nastran, is not installed")
    source = Path(tests.__path__[0]) / "nas2cam_extseout"
    for suffix in (".op4", ".asm", ".pch"):
        content = (source / f"{which}{suffix}").read_bytes()
        (folder / f"{name}{suffix}").write_bytes(content if changed is None else changed(suffix, content))
    return folder / f"{name}.op4"
