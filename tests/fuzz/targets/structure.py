"""Finite-element models in the files of other programs: what `read_structure` makes of them.

An input begins with a line that says which ending its file has, since some kinds are told by it.
"""

import random
import re
import tempfile
from pathlib import Path

from tests.fuzz.mutations import damaged_bytes, with_extreme_number
from tests.fuzz.target import Target, default_message_fault

SEEDS = Path(__file__).resolve().parents[1] / "seeds"
#: Files beside matrices that are right, and the argument that takes them.
_BESIDE = {"dof": "dofs", "mapping": "dofs", "map": "dofs", "asm": "dofs", "inp": "nodes", "xyz": "nodes"}


class StructureTarget(Target):
    """Matrices of every program, maps of their DOFs, and files of coordinates."""

    name = "structure"
    suffix = ".structure"

    def seeds(self) -> list[bytes]:
        """Files of a small frame by the writers of the tests, and the kept ones."""
        with tempfile.TemporaryDirectory() as place:
            found = [path.suffix[1:].encode() + b"\n" + path.read_bytes() for path in _written(Path(place))]
        return [*found, *super().seeds()]

    def mutate(self, rng: random.Random, content: bytes) -> bytes:
        """Damage behind the line that names the kind."""
        ending, _, content = content.partition(b"\n")
        for _ in range(rng.choice((1, 1, 2))):
            text = ending not in (b"npz", b"mat", b"op4", b"mat73")
            content = with_extreme_number(rng, content) if text and rng.random() < 0.5 else damaged_bytes(rng, content)
        return ending + b"\n" + content

    def prepare(self, directory: Path) -> None:
        """Put a model that is right where maps and coordinates are asked for."""
        import numpy as np

        from tests.structure.imported import small_frame as small

        np.savez(directory / "right.npz", K=small.K, M=small.M)
        small.write_map(directory / "right.csv")
        self._right = {"mass": directory / "right.npz", "dofs": directory / "right.csv"}

    def attempt(self, path: Path) -> None:
        """Read the file as stiffness, as a map or as coordinates."""
        import jointbayes as jb

        ending, _, content = path.read_bytes().partition(b"\n")
        word = re.sub(r"\W", "", ending.decode("latin-1"))[:8]
        with tempfile.TemporaryDirectory() as place:
            file = Path(place) / f"{path.stem}.{word}"
            file.write_bytes(content)
            if word in _BESIDE:
                jb.read_structure(
                    self._right["mass"], length_unit="m", **{"dofs": self._right["dofs"], _BESIDE[word]: file}
                )
                return
            try:
                jb.read_structure(file, length_unit="in")
            except jb.ModelError:  # of a file of one matrix: with what it lacks
                jb.read_structure(file, mass=file, dofs=self._right["dofs"], length_unit="m")

    def message_fault(self, message: str, path: Path) -> str:
        """As for all targets; files have other endings, and faults of two files may name the one beside."""
        from vibrecords.errors import printable

        message = "".join(" " if c.isspace() and printable(c) == c else c for c in message)
        return default_message_fault(message, Path(path.stem)) and default_message_fault(message, Path("right"))


def _written(place: Path) -> list[Path]:
    import numpy as np
    import pandas as pd
    from pyyeti.nastran import bulk, op4
    from scipy import io, sparse

    from tests.structure.imported import small_frame as small

    k, m, dofs = small.K, small.M, small.DOFS
    np.savez(place / "a.npz", K=k, M=m, dofs=dofs, nodes=small.NODES, xyz=small.PLACES)
    sparse.save_npz(place / "b.npz", sparse.csc_array(k))
    small.write_matlab_5(place / "a.mat", K=sparse.csc_array(k), M=m, dofs=dofs)
    small.write_matlab_73(place / "b.mat", K=sparse.csc_array(k), M=m, dofs=dofs)
    op4.write(str(place / "a.op4"), {"kaa": k, "maa": m}, binary=True, sparse="bigmat")
    op4.write(str(place / "b.op4"), {"kaa": k, "maa": m}, binary=False, sparse="nonbigmat")
    op4.write(str(place / "c.op4"), {"kaa": k, "maa": m}, binary=True, sparse="dense")
    index = pd.MultiIndex.from_tuples(list(map(tuple, dofs.tolist())))
    frames = {name: pd.DataFrame(matrix, index=index, columns=index) for name, matrix in (("KAAX", k), ("MAAX", m))}
    bulk.wtdmig(str(place / "a.pch"), frames)
    io.mmwrite(place / "array.mtx", k, symmetry="symmetric")
    written = [small.write_matrix_market(place / "a.mtx", k), small.write_harwell_boeing(place / "a.matrix", k)]
    written += [small.write_abaqus(place / "b.mtx", k), small.write_calculix(place / "a.sti", k)]
    written += [
        small.write_dof(place / "a.dof"),
        small.write_mapping(place / "a.mapping"),
        small.write_map(place / "a.map"),
    ]
    written += [small.write_places(place / "a.xyz")]
    seeds = (path for path in SEEDS.iterdir() if path.suffix != ".toml")
    return sorted(path for path in (*place.iterdir(), *seeds) if path.is_file())


TARGETS = [StructureTarget()]
