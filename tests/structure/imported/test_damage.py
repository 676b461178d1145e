"""A file that is cut off or damaged is refused in one line, or what is left is a whole model; never a traceback."""

import random
import resource

import numpy as np
import pytest

import jointbayes as jb
from tests.fuzz.damage import damaged_bytes
from tests.fuzz.targets import StructureTarget
from tests.structure.imported import small_frame as small

TARGET = StructureTarget()


@pytest.fixture(scope="module")
def seeds():
    pytest.importorskip("pyyeti", reason="pyyeti, which writes the files of Nastran, is not installed")
    return TARGET.seeds()


@pytest.fixture(scope="module")
def attempt(tmp_path_factory):
    directory = tmp_path_factory.mktemp("in")
    TARGET.prepare(directory)

    def run(content):
        path = directory / "input.structure"
        path.write_bytes(content)
        try:
            TARGET.attempt(path)
        except jb.ModelError as error:
            fault = TARGET.message_fault(str(error), path)
            return pytest.fail(fault) if fault else False
        return True

    return run


def test_cut_anywhere(attempt, seeds):
    """Text that is cut at the end of a line may still be whole, as a map or as coordinates."""
    for seed in seeds:
        for at in np.linspace(seed.index(b"\n") + 1, len(seed) - 1, 25).astype(int):
            attempt(seed[:at])


@pytest.mark.parametrize("kind", [b"npz", b"mat", b"op4", b"pch", b"sti", b"mtx"])
def test_matrices_cut_within_a_line_or_array_are_never_taken(attempt, seeds, kind):
    end = 120 if kind == b"op4" else 1  # Nastran's last column says nothing
    chosen = [seed for seed in seeds if seed.startswith(kind)]
    assert chosen
    for seed in chosen:
        for at in np.linspace(seed.index(b"\n") + 2, len(seed) - end, 15).astype(int):
            assert seed[at - 1 : at] == b"\n" or not attempt(seed[:at])


def test_damaged_bytes(attempt, seeds):
    rng = random.Random(1)
    for seed in seeds:
        head = seed.index(b"\n") + 1
        for _ in range(15):
            attempt(seed[:head] + damaged_bytes(rng, seed[head:]))


@pytest.mark.parametrize(
    ("ending", "content"),
    [
        ("mtx", b"%%MatrixMarket matrix array real general\n2999999 2999999\n1\n"),
        ("mtx", b"%%MatrixMarket matrix coordinate real symmetric\n3000000 3000000 1\n3000000 1 1.0\n"),
        ("sti", b"1 1 1.0\n3000000 3000000 1.0\n"),
        ("mtx", b"1,1,1,1,2.0\n99999999999,1,99999999999,1,2.0\n"),
        ("op4", f"{2000000000:8d}"[:8].encode() + b"20000000" + b"       6       2KAA     1P,3E24.16\n" + b" " * 60),
        ("pch", b"DMIG*   KAAX%20d%16d\n*%23d%16d 2.0D+03\n" % (900_000_000, 1, 900_000_001, 1)),
    ],
)
def test_counts_in_a_short_file_make_no_room(attempt, ending, content):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    attempt(ending.encode() + b"\n" + content)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000  # kB


def test_more_dofs_than_anything_solves(tmp_path):
    (tmp_path / "k.mtx").write_text("%%MatrixMarket matrix coordinate real symmetric\n3000001 3000001 1\n1 1 1.0\n")
    with pytest.raises(jb.ModelError, match=r"k.mtx, line 2: found the sizes '3000001 3000001 1'; expected rows"):
        jb.read_structure(
            tmp_path / "k.mtx", mass=tmp_path / "k.mtx", dofs=small.write_map(tmp_path / "map.csv"), length_unit="m"
        )
