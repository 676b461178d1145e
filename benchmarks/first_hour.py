"""First runs of newcomers, typed as a person would: `python -m benchmarks.first_hour [--short] [--kinds tip.csv ...]`.

A newcomer has one file of eight kinds, types `init --from FILE`, the answers to its questions with one of five slips,
and `run`. Where that is refused he does what the message says: no more than the line, the key and the remedy that stand
there are used, and what he alone knows, the answers. Counted are those who have a report after two rounds at most.
Cases that end in the same text are run to the report once; `--short` stops where `validate` accepts the case.
"""

import argparse
import re
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from click.testing import CliRunner
from nptdms import ChannelObject, RootObject, TdmsWriter

from benchmarks.page import table
from benchmarks.walk_through import exact_accelerance, hits, write_csv, write_frfs, write_lvm
from benchmarks.written_files import write_records
from jointbayes.cli.commands import main as jointbayes
from vibrecords.records import TimeRecord

RATE, LINES, ROUNDS = 5120.0, np.arange(20.0, 1000.0, 4.0), 2
#: What the newcomer knows, by the key that asks for it.
ANSWERS = {"length_mm": "383.0", "diameter_mm": "25.0", "dofs": '["1:y", "1:rz"]'}
#: Slips by name: what is typed in place of what.
SLIPS = {
    "decimal comma": ("length_mm = 383.0", "length_mm = 383,0"),
    "a length in m": ("length_mm = 383.0", "length_mm = 0.383"),
    "a radius": ("diameter_mm = 25.0", "radius_mm = 12.5"),
    "a question left open": ("diameter_mm = 25.0", 'diameter_mm = "?"'),
    "DOFs as one text": ('dofs = ["1:y", "1:rz"]', 'dofs = "1:y, 1:rz"'),
}
_VALUE = r'(?:"[^"\n]*"|\[[^\]\n]*\]|[^,}\n]*[^,}\s])'


def hit_table(path: Path, count: int) -> None:
    """One recording of some hits as a table of time, force and acceleration."""
    made = hits(count)
    force, response = (np.concatenate([one[side] for one in made]) for side in (0, 1))
    columns = zip((np.arange(force.size) / RATE).tolist(), force.tolist(), response.tolist(), strict=True)
    rows = [f"{time:.7f},{x!r},{y!r}" for time, x, y in columns]
    path.write_text("\n".join(["Time (s),hammer (N),acc (m/s^2)", *rows]), encoding="utf-8")


def hit_groups(path: Path) -> None:
    """Five hits as LabVIEW writes them into groups of a TDMS file."""
    objects = [RootObject({"Operator": "A. Miller", "datetime": np.datetime64("2026-11-25T08:00:00")})]
    clock = {"wf_increment": 1 / RATE, "wf_start_offset": 0.0}
    for number, signals in enumerate(hits(5)):
        for name, values, unit in zip(("hammer", "acc"), signals, ("N", "m/s^2"), strict=True):
            objects.append(ChannelObject(f"hit {number}", name, values, properties=clock | {"unit_string": unit}))
    with TdmsWriter(str(path)) as writer:
        writer.write_segment(objects)


def shaker(path: Path, samples: int = 2**17) -> None:
    """Random force of a shaker and the answer to it, 26 s of one recording."""
    rng = np.random.default_rng(3)
    force = rng.standard_normal(samples)
    lines = np.fft.rfftfreq(samples, 1 / RATE)
    frf = np.concatenate([[0], exact_accelerance(lines[1:])])
    response = np.fft.irfft(np.fft.rfft(force) * frf, samples) + 0.02 * rng.standard_normal(samples)
    records = [
        TimeRecord("force", RATE, force + 0.01 * rng.standard_normal(samples), "force", "N"),
        TimeRecord("acc", RATE, response, "acceleration", "m/s^2"),
    ]
    write_records(records, path, "uff58b")


def _frfs(kind: str) -> Callable[[Path], None]:
    return lambda path: write_frfs(path, LINES, kind, (("Point:3:Z+", "11:y"),))


#: Files by name, each with what writes it.
KINDS: Mapping[str, Callable[[Path], None]] = {
    "tip.csv": write_csv,
    "tip.uff": _frfs("uff58b"),
    "tip.mat": _frfs("mat"),
    "hits.lvm": write_lvm,
    "hits.tdms": hit_groups,
    "hit.csv": lambda path: hit_table(path, 1),
    "hits.csv": lambda path: hit_table(path, 5),
    "shaker.uff": shaker,
}


@dataclass
class Newcomer:
    """One newcomer: his file, his slip, and what became of it: rounds after the first, None without a report."""

    kind: str
    slip: str
    rounds: int | None = None
    text: str = ""
    said: list[str] = field(default_factory=list)


def typed(*arguments: object) -> tuple[int, str]:
    """Exit status of a command, and all that it says."""
    result = CliRunner().invoke(jointbayes, [str(argument) for argument in arguments])
    return result.exit_code, result.output


def remedied(text: str, message: str) -> str:
    """The text after what a message says was done in the line that it names; as it was where that is not plain."""
    found = re.search(r"\.toml:(\d+): (\S+?): (.*)", message)
    if found is None:
        return text
    rows, at, key = text.splitlines(), int(found[1]) - 1, found[2].rpartition(".")[2]
    remedy = found[3].rpartition("; ")[2]
    if (number := re.search(r"write ([\d.]+) with a point", remedy)) is not None:
        old, new = number[1].replace(".", ","), number[1]
    elif (line := re.search(rf"write (for example )?(\w+) = ({_VALUE})", remedy)) is not None:
        stated = re.search(rf"\b{key} = {_VALUE}", rows[at])
        old = stated[0] if stated else ""
        new = f"{line[2]} = {ANSWERS.get(line[2], line[3]) if line[1] else line[3]}"
    else:
        return text
    rows[at] = rows[at].replace(old, new, 1) if old else rows[at]
    return "\n".join(rows) + "\n"


def first_try(kind: str, slip: str, folder: Path) -> Newcomer:
    """What a newcomer types, up to the case that `validate` accepts without a warning of a slip."""
    newcomer, case = Newcomer(kind, slip), folder / "my_case.toml"
    KINDS[kind](folder / kind)
    case.unlink(missing_ok=True)
    status, said = typed("init", case, "--from", folder / kind)
    newcomer.said.append(said)
    if status:
        return newcomer
    text = case.read_text(encoding="utf-8")
    for key, answer in ANSWERS.items():
        text = re.sub(rf'\b{key} = (?:"\?"|\["\?"\])', f"{key} = {answer}", text)
    text = re.sub(r'(?<== )"\?"', '"11:y"', text)
    right, wrong = SLIPS[slip]
    text = text.replace(right, wrong, 1)
    for number in range(ROUNDS + 1):
        case.write_text(text, encoding="utf-8")
        status, said = typed("validate", case)
        newcomer.said.append(said)
        messages = [line for line in said.splitlines() if line.startswith("jointbayes: ") and ".toml:" in line]
        if status == 0 and not messages:
            newcomer.rounds, newcomer.text = number, text
            break
        text = next((new for message in messages if (new := remedied(text, message)) != text), text)
    return newcomer


def first_hour(kinds: Iterable[str] = KINDS, slips: Iterable[str] = SLIPS, *, short: bool = False) -> list[Newcomer]:
    """All newcomers of some kinds of files and slips; with `short` none of them waits for the report."""
    newcomers, ended = [], dict[tuple[str, str], bool]()
    for kind in kinds:
        for slip in slips:
            with tempfile.TemporaryDirectory() as scratch:
                newcomer = first_try(kind, slip, Path(scratch))
                same = kind, "".join(line.partition("#")[0].strip() for line in newcomer.text.splitlines())
                same = kind, re.sub(r"(\d)\.0\b", r"\1", same[1])
                if newcomer.rounds is not None and not short:
                    if same not in ended:
                        status, said = typed("run", Path(scratch) / "my_case.toml", "--out", Path(scratch) / "out")
                        newcomer.said.append(said)
                        ended[same] = status == 0 and (Path(scratch) / "out" / "report.html").is_file()
                    newcomer.rounds = newcomer.rounds if ended[same] else None
                newcomers.append(newcomer)
    return newcomers


def rows_of(newcomers: Iterable[Newcomer]) -> list[tuple[str, ...]]:
    """Rounds of each, a row for each kind of file; a dash where there is no report."""
    by_kind: dict[str, list[str]] = {}
    for newcomer in newcomers:
        by_kind.setdefault(newcomer.kind, []).append("–" if newcomer.rounds is None else str(newcomer.rounds))
    return [(kind, *rounds) for kind, rounds in by_kind.items()]


def main() -> None:
    """Print the table, and of whom there is no report what was said to him last."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="up to the case that validate accepts, without the run")
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=list(KINDS))
    options = parser.parse_args()
    newcomers = first_hour(options.kinds, short=options.short)
    print("\n".join(table(("rounds after the first", *SLIPS), rows_of(newcomers))))
    ended = sum(newcomer.rounds is not None for newcomer in newcomers)
    print(f"\n{'valid' if options.short else 'with a report'} within {ROUNDS} rounds: {ended} of n = {len(newcomers)}")
    for newcomer in newcomers:
        if newcomer.rounds is None:
            print(f"\n{newcomer.kind}, {newcomer.slip}:\n{newcomer.said[-1][-1500:]}")


if __name__ == "__main__":
    main()
