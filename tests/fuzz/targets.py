"""The parts of the package that read files, as targets: what they are given, and what they do with it."""

import json
import random
import re
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, ClassVar

from tests.fuzz.damage import damaged_bytes, damaged_hdf5, damaged_mat, damaged_npz, damaged_text

ROOT = Path(__file__).resolve().parents[2]
CONFIGS = ROOT / "configs"
HERE = Path(__file__).parent
CORPUS, SEEDS = HERE / "corpus", HERE / "seeds"


class Target:
    """A reader under attack.

    `attempt` may raise nothing but errors of the package, print nothing, warn of nothing, leave no file behind in the
    temporary directory, the working directory or next to its input, and end within `seconds` of computing.
    """

    #: Of this target on the command line, and of its directory in the corpus.
    name = "target"
    #: Ending of the file that `attempt` is given.
    suffix = ""
    #: Address space of the process that attempts, bytes; what the package needs to start counts as well.
    memory = 6 * 2**30
    #: Computing time of one input, with that of the processes that it started and waited for.
    seconds = 5.0
    #: Inputs after which the process is replaced by a fresh one.
    patience = 20_000
    #: Another input from a seed and a further one, by nothing but the generator given.
    damage: Callable[[random.Random, bytes, bytes], bytes] = staticmethod(damaged_text)

    def corpus(self) -> list[Path]:
        """Kept files, which `tests/fuzz/test_corpus.py` attempts in every run of the tests."""
        folder = CORPUS / self.name
        return sorted(path for path in folder.iterdir() if path.is_file()) if folder.is_dir() else []

    def seeds(self) -> list[bytes]:
        """Inputs that damage starts from; by default the kept files."""
        return [path.read_bytes() for path in self.corpus()]

    def prepare(self, directory: Path) -> None:
        """Load what is slow to load, and put files that inputs refer to into the directory of the inputs."""

    def attempt(self, path: Path) -> None:
        """Read the file as a user would."""
        raise NotImplementedError

    def message_fault(self, message: str, path: Path) -> str:
        """What is wrong with the message of an error; empty if nothing is: one printable line that names the file."""
        from vibrecords.errors import printable

        # a blank of another width is as good as a blank
        message = "".join(" " if c.isspace() and printable(c) == c else c for c in message)
        if not message.isprintable():
            return "more than one line, or characters that no terminal should be sent"
        return "" if path.name in message else "the file is not named"


class FileTarget(Target):
    """Measurement files of a format: what `inspect` and `read_frf` make of them."""

    def __init__(self, name: str, damage: Callable[[random.Random, bytes, bytes], bytes] = damaged_text) -> None:
        self.name, self.damage, self.suffix = name, damage, f".{name}"

    def seeds(self) -> list[bytes]:
        """Of files of arrays the sound ones: what reads them to damage an array would die of the others."""
        sound = "" if self.damage is damaged_text else "seed-"
        return [path.read_bytes() for path in self.corpus() if path.name.startswith(sound)]

    def prepare(self, directory: Path) -> None:
        """Load what readers and inspection load when they need it."""
        from jointbayes.errors import MeasurementError

        for path in self.corpus()[:6]:
            with suppress(MeasurementError):
                self.attempt(path)

    def attempt(self, path: Path) -> None:
        """Inspect the file, draw the figure of one in a hundred, which takes longer than the rest, read its FRFs."""
        from jointbayes.errors import MeasurementError
        from jointbayes.report.inspect_figure import inspect_figure
        from vibrecords.formats import read_frf
        from vibrecords.inspection import contents_text, inspect_file, resonances_text

        refused: MeasurementError | None = None
        try:
            seen = inspect_file(path, 2.0)
        except MeasurementError as error:
            refused = error
        else:
            list(contents_text(seen))
            list(resonances_text(seen))
            if sha256(path.read_bytes()).digest()[0] < 3:
                traces = [(f"{t.channel} hit {t.hit.number}", t.hit.reason, t.time_s, t.force_n) for t in seen.hits]
                inspect_figure(seen.frfs, seen.modes, traces)
        try:
            read_frf(path)
        except MeasurementError as error:
            refused = refused or error
        if refused is not None:
            raise refused


class CaseTarget(Target):
    """What `load_case` does, with the warnings of a case and one value of its posterior density."""

    name = "case"
    suffix = ".toml"

    def seeds(self) -> list[bytes]:
        """The cases of the repository with fewer lines, so that each takes milliseconds, others, and the kept files."""
        from jointbayes.case.case_text import read_case_text

        found = []
        for path in sorted(CONFIGS.glob("*.toml")):
            text = read_case_text(path).text.replace("elements = 10\n", "elements = 3\n").replace(".uff", ".csv")
            text = text.replace('"2:y", "6:y", "9:y"', '"3:y"').replace('"11:', '"4:')
            text = re.sub(r'"[96]:', '"3:', text)
            found.append(re.sub(r"(?m)^f_step_hz = [\d.]+", "f_step_hz = 100.0", text).encode())
        found += [path.read_bytes() for path in sorted(SEEDS.glob("*.toml"))]
        return [*found, *(path.read_bytes() for path in self.corpus() if path.stat().st_size < 20_000)]

    def prepare(self, directory: Path) -> None:
        """Compile the loops, and make what the cases refer to: small measurements, and a case to build on."""
        from jointbayes.errors import JointBayesError
        from vibrecords.formats import iter_records, write_records
        from vibrecords.records import FrfRecord

        (directory / "data").mkdir()
        for name in ("virtual_test", "spindle_nose", "spindle_tip"):
            records = list(iter_records(CONFIGS / "data" / f"{name}.uff"))
            thinned = [record.at_lines(slice(None, None, 25)) for record in records if isinstance(record, FrfRecord)]
            write_records(thinned, directory / "data" / f"{name}.csv", "csv")
        (directory / "data" / "base.toml").write_bytes((SEEDS / "base.toml").read_bytes())
        path = directory / "warm.toml"
        for seed in self.seeds():
            path.write_bytes(seed)
            with suppress(JointBayesError):
                self.attempt(path)
        path.unlink()

    def attempt(self, path: Path) -> None:
        """Load the case and ask it for one value of the density."""
        import numpy as np

        import jointbayes as jb

        case = jb.load_case(path)
        assert all(str(warning).isprintable() for warning in case.warnings)
        value = case.problem.log_posterior(case.problem.prior.mean)
        assert value.shape == (1,)
        assert not np.isnan(value[0])
        assert value[0] < np.inf

    def message_fault(self, message: str, path: Path) -> str:
        """One line for each fault, each with line and file, be it the one that the case builds on; not too many."""
        lines = message.split("\n")
        if len(lines) > 25 or not all(line.isprintable() for line in lines):
            return "more than 25 lines, or characters that no terminal should be sent"
        places = rf"({re.escape(str(path))}|{re.escape(str(path.parent))}/data/base\.toml):\d+: "
        if not all(re.match(places, line) or line.startswith("and ") for line in lines):
            return "a line without file and line"
        return "more than 3000 characters in a line" if max(map(len, lines)) > 3000 else ""


class PosteriorTarget(Target):
    """What `jointbayes report` does: load, sum up, and for one file in fifty the whole report."""

    name = "posterior"
    suffix = ".nc"
    patience = 2000
    seconds = 15.0
    damage = staticmethod(damaged_hdf5)

    def seeds(self) -> list[bytes]:
        """The whole files of the corpus; others in it are kept because they were once read wrongly."""
        return [path.read_bytes() for path in self.corpus() if path.name.startswith("whole-")]

    def prepare(self, directory: Path) -> None:
        """Compile the loops and load what a report needs."""
        whole = directory / "whole.nc"
        for content in self.seeds():
            whole.write_bytes(content)
            self.attempt(whole)
        whole.unlink()

    def attempt(self, path: Path) -> None:
        """Read the file, and report it where its bytes say so, so that the same ones do it every time."""
        import jointbayes as jb

        posterior = jb.load_posterior(path)
        json.dumps(posterior.summary().to_dict(), allow_nan=False)
        if sha256(path.read_bytes()).digest()[0] < 5:
            jb.write_report(posterior, Path("report"))
            shutil.rmtree("report")


class StructureTarget(Target):
    """Finite-element models of other programs: what `read_structure` makes of them.

    An input begins with a line that says which ending its file has, since some kinds are told by it.
    """

    name = "structure"
    suffix = ".structure"
    #: Files next to matrices that are right, and the argument that takes them.
    _BESIDE: ClassVar = {"dof": "dofs", "mapping": "dofs", "map": "dofs", "asm": "dofs", "inp": "nodes", "xyz": "nodes"}

    def seeds(self) -> list[bytes]:
        """Files of a small frame by the writers of the tests, and the kept ones."""
        from tests.structure.imported import small_frame as small

        with tempfile.TemporaryDirectory() as place:
            written = [*small.write_all(Path(place)), *(path for path in SEEDS.iterdir() if path.suffix != ".toml")]
            found = [path.suffix[1:].encode() + b"\n" + path.read_bytes() for path in sorted(written)]
        return [*found, *super().seeds()]

    @staticmethod
    def damage(rng: random.Random, content: bytes, other: bytes) -> bytes:
        """Damage behind the line that names the kind."""
        ending, _, content = content.partition(b"\n")
        binary = ending in (b"npz", b"mat", b"op4", b"mat73")
        damaged = damaged_bytes(rng, content) if binary or rng.random() < 0.5 else damaged_text(rng, content, other)
        return ending + b"\n" + damaged

    def prepare(self, directory: Path) -> None:
        """Put a model that is right where maps and coordinates are asked for."""
        import numpy as np

        from tests.structure.imported import small_frame as small

        np.savez(directory / "right.npz", K=small.K, M=small.M)
        small.write_map(directory / "right.csv")
        self._right: dict[str, Any] = {"mass": directory / "right.npz", "dofs": directory / "right.csv"}

    def attempt(self, path: Path) -> None:
        """Read the file as stiffness, as a map or as coordinates."""
        import jointbayes as jb

        ending, _, content = path.read_bytes().partition(b"\n")
        word = re.sub(r"\W", "", ending.decode("latin-1"))[:8]
        with tempfile.TemporaryDirectory() as place:
            file = Path(place) / f"{path.stem}.{word}"
            file.write_bytes(content)
            if word in self._BESIDE:
                more = {"dofs": self._right["dofs"], self._BESIDE[word]: file}
                jb.read_structure(self._right["mass"], length_unit="m", **more)
                return
            try:
                jb.read_structure(file, length_unit="in")
            except jb.ModelError:  # of a file of one matrix: with what it lacks
                jb.read_structure(file, mass=file, dofs=self._right["dofs"], length_unit="m")

    def message_fault(self, message: str, path: Path) -> str:
        """As for all targets; files have other endings, and faults of two files may name the one next to them."""
        fault = super().message_fault(message, Path(path.stem))
        return fault and super().message_fault(message, Path("right"))


FILES = [
    *map(FileTarget, ("uff58", "uff58b", "csv", "tsv", "lvm")),
    FileTarget("npz", damaged_npz),
    FileTarget("mat", damaged_mat),
    FileTarget("mat73", damaged_hdf5),
    FileTarget("hdf5", damaged_hdf5),
]
TARGETS = {target.name: target for target in (CaseTarget(), *FILES, PosteriorTarget(), StructureTarget())}
