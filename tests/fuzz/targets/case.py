"""Case files: those of the repository with damaged bytes, lines and words and extreme numbers, and new ones."""

import random
import re
from collections.abc import Callable
from pathlib import Path

from tests.fuzz.mutations import EXTREMES, damaged_bytes, replaced, with_extreme_number, with_other_line
from tests.fuzz.target import Target

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
SEEDS = Path(__file__).resolve().parents[1] / "seeds"
_STEP = re.compile(rb"^f_step_hz = [\d.]+", re.MULTILINE)
_PAIR = re.compile(rb"^([A-Za-z0-9_]+) = ([^#\n]*)", re.MULTILINE)
_HEADER = re.compile(rb"^\[+([^\]\n]+)\]+", re.MULTILINE)
_NODE = re.compile(rb'"(11|9|6):')
_LABEL = re.compile(rb'"\d+:\w+"')
#: Values of every kind that TOML has, and some that it has not.
_VALUES = [
    b"true", b"false", b'""', b"''", b"[]", b"{}", b"[[]]", b"[[[]]]", b"{ a = 1 }", b"[1, 'a']", b"1979-05-27", b"7",
    b"1979-05-27T07:32:00Z", b'"""\n"""', b"'''x'''", b'"\\u0000"', b'"\\u202e\\u001b[31m"', '"ü"'.encode(), b'"1:y"',
    b'"0:y"', b'"99:y"', b'"1:q"', b'["1:y"]', b'["1:y", "1:rz"]', b'["1:rz", "1:y"]', b'["1:y", "1:y"]', b'"measured"',
    b'"log"', b'"signed"', b'"springs"', b'"elastic_centre"', b'"gaussian"', b'"student_t"', b'"proportional"',
    b'"log_uniform"', b'"log_normal"', b'"decades"', b'"paper"', b'"converged"', b'"accelerance"', b'"../secret.uff"',
    b'"/etc/passwd"', b'"/dev/zero"', b'"data"', b'"."', b'"\\u0000"', b'"data/virtual_test.csv"', b"[0.01, 0.02]",
]  # fmt: skip
_KEYS: list[bytes] = []


class CaseTarget(Target):
    """What `load_case` does, with the warnings of a case and one value of its posterior density."""

    name = "case"
    suffix = ".toml"

    def seeds(self) -> list[bytes]:
        """The cases of the repository with fewer lines, so that each takes milliseconds, others, and the kept files."""
        from jointbayes.case.case_text import read_case_text

        found = []
        for path in sorted(CONFIGS.glob("*.toml")):
            text = read_case_text(path).text.encode().replace(b"elements = 10\n", b"elements = 3\n")
            text = text.replace(b".uff", b".csv")
            text = text.replace(b'"2:y", "6:y", "9:y"', b'"3:y"')
            text = _NODE.sub(lambda node: b'"4:' if node[1] == b"11" else b'"3:', text)
            found.append(_STEP.sub(b"f_step_hz = 100.0", text))
        found += [path.read_bytes() for path in sorted(SEEDS.glob("*.toml"))]
        self._all = found
        if not _KEYS:
            _KEYS.extend(sorted({pair[1] for text in found for pair in _PAIR.finditer(text)}))
        return [*found, *(path.read_bytes() for path in self.corpus() if path.stat().st_size < 20_000)]

    def mutate(self, rng: random.Random, content: bytes) -> bytes:
        """One of the ways below, mostly one that leaves TOML."""
        if rng.random() < 0.08:
            return _from_grammar(rng)
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            content = rng.choices(_WAYS, _OFTEN)[0](rng, content)
        if rng.random() < 0.05:
            content = _spliced(rng, content, rng.choice(self._all))
        return content

    def prepare(self, directory: Path) -> None:
        """Compile the loops, and make what the cases refer to: small measurements, and a case to build on."""
        from vibrecords.formats import iter_records, write_records
        from vibrecords.records import FrfRecord

        (directory / "data").mkdir()
        for name in ("virtual_test", "spindle_nose", "spindle_tip"):
            records = list(iter_records(CONFIGS / "data" / f"{name}.uff"))
            thinned = [record.at_lines(slice(None, None, 25)) for record in records if isinstance(record, FrfRecord)]
            write_records(thinned, directory / "data" / f"{name}.csv", "csv")
        (directory / "data" / "base.toml").write_bytes((SEEDS / "base.toml").read_bytes())
        for number, seed in enumerate(self.seeds()):
            path = directory / f"warm{number}.toml"
            path.write_bytes(seed)
            self._try(path)
            path.unlink()

    def _try(self, path: Path) -> None:
        from jointbayes.errors import JointBayesError

        try:
            self.attempt(path)
        except JointBayesError:
            return

    def attempt(self, path: Path) -> None:
        """Load the case and ask it for one value of the density."""
        import numpy as np

        import jointbayes as jb

        case = jb.load_case(path)
        assert all(str(warning).isprintable() for warning in case.warnings)
        problem = case.problem
        value = problem.log_posterior(problem.prior.mean)
        assert value.shape == (1,)
        assert not np.isnan(value[0])
        assert value[0] < np.inf

    def message_fault(self, message: str, path: Path) -> str:
        """One line for each fault, each with line and file, be it the one that the case builds on; not too many."""
        lines = message.split("\n")
        if len(lines) > 25:
            return "more than 25 lines"
        if not all(line.isprintable() for line in lines):
            return "characters that no terminal should be sent"
        places = rf"({re.escape(str(path))}|{re.escape(str(path.parent))}/data/base\.toml):\d+: "
        if not all(re.match(places, line) or line.startswith("and ") for line in lines):
            return "a line without file and line"
        return "more than 3000 characters in a line" if max(map(len, lines)) > 3000 else ""


def _lines(content: bytes) -> list[bytes]:
    return content.split(b"\n")


def _value_replaced(rng: random.Random, content: bytes) -> bytes:
    pairs = list(_PAIR.finditer(content))
    values = (lambda: rng.choice(_VALUES), lambda: rng.choice(EXTREMES).encode(), lambda: rng.choice(pairs)[2])
    return replaced(rng, content, pairs, lambda _: rng.choice(values)(), 2)


def _word_replaced(rng: random.Random, content: bytes) -> bytes:
    """A key or a table under the name of another, or of none."""
    words = [*_PAIR.finditer(content), *_HEADER.finditer(content)]
    names = [b"x", b'""', b"a.b", b'"\\u001b"', *(word[1] for word in words[:1])]
    return replaced(
        rng,
        content,
        words,
        lambda word: rng.choice((*names, rng.choice(words)[1], word[1][:-1] or b"k", word[1] + b"s")),
        1,
    )


def _label_replaced(rng: random.Random, content: bytes) -> bytes:
    new = f'"{rng.choice((0, 1, 2, 3, 4, 5, 11, 9999999))}:{rng.choice(("x", "y", "z", "rx", "ry", "rz", "q"))}"'
    return replaced(rng, content, _LABEL.finditer(content), lambda _: new.encode())


def _key_added(rng: random.Random, content: bytes) -> bytes:
    """A key that some table has, or a table, where there may be none."""
    lines = _lines(content)
    value = rng.choice((rng.choice(_VALUES), rng.choice(EXTREMES).encode()))
    at = rng.randrange(len(lines) + 1)
    lines.insert(at, rng.choice((b"[%s]", b"[[%s]]", b"%s = " + value)) % rng.choice(_KEYS or [b"a"]))
    return b"\n".join(lines)


def _grown(rng: random.Random, content: bytes) -> bytes:
    """Something that repeats often enough to show time that is more than linear."""
    count = rng.choice((10, 300, 3000))
    part = rng.choice((
        b"[" + b"a." * count + b"a]\n", b"a." * count + b"a = 1\n", b"x = [" + b'"1:y",' * count + b"]\n",
        b"x = " + b"[" * count + b"]" * count + b"\n", b'x = "' + b"\\u0041" * count + b'"\n', b"[[t]]\n" * count,
        b"".join(b"k%d = 1\n" % i for i in range(count)), b"".join(b"[t%d]\n" % i for i in range(count)),
        b"x = {" + b",".join(b"k%d=1" % i for i in range(count)) + b"}\n",
    ))  # fmt: skip
    lines = _lines(content)
    lines.insert(rng.randrange(len(lines) + 1), part)
    return b"\n".join(lines)


def _spliced(rng: random.Random, content: bytes, other: bytes) -> bytes:
    mine, others = _lines(content), _lines(other)
    return b"\n".join([*mine[: rng.randrange(len(mine) + 1)], *others[rng.randrange(len(others) + 1) :]])


def _from_grammar(rng: random.Random) -> bytes:
    """Valid TOML, or nearly, of random keys and values: of the case file's words as often as of none."""
    return b"".join(_statement(rng) for _ in range(rng.randint(0, 25)))


def _word(rng: random.Random) -> bytes:
    return rng.choice((rng.choice(_KEYS or [b"a"]), b"structure", b"joint", b"prior", b"data", b"noise", b'"x y"'))


def _statement(rng: random.Random) -> bytes:
    path = b".".join(_word(rng) for _ in range(rng.choice((1, 1, 2, 3))))
    return rng.choice((b"[%s]\n" % path, b"[[%s]]\n" % path, b"%s = %s\n" % (path, _value(rng, 3)), b"# %s\n" % path))


def _value(rng: random.Random, depth: int) -> bytes:
    kind = rng.random()
    if depth and kind < 0.15:
        return b"[" + b", ".join(_value(rng, depth - 1) for _ in range(rng.randint(0, 4))) + b"]"
    if depth and kind < 0.3:
        pairs = (b"%s = %s" % (_word(rng), _value(rng, depth - 1)) for _ in range(rng.randint(0, 3)))
        return b"{" + b", ".join(pairs) + b"}"
    number = b"%d" % rng.randint(-5, 50), b"%.3g" % rng.gauss(0, 1e3)
    return rng.choice((rng.choice(_VALUES), rng.choice(EXTREMES).encode(), *number))


_WAYS: list[Callable[[random.Random, bytes], bytes]] = [
    with_extreme_number, _value_replaced, _word_replaced, _label_replaced, with_other_line, _key_added, damaged_bytes,
    _grown,
]  # fmt: skip
_OFTEN = [30, 15, 8, 8, 18, 8, 10, 0.5]

TARGETS = [CaseTarget()]
