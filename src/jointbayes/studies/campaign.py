"""A campaign: many cases from a table or from files, one run directory each, an index, and one page of all.

1. Read the table: each row is a base case with other values for some keys. All faults are named before any work.
2. Keep cases that are finished: their run directory is there, of the same case, data, seed and package.
3. Do the others, side by side. A row of the index is on the disk as soon as its case has ended.
4. Write the index in the order of the table, with the stiffnesses of all cases, and the page.
"""

import csv
import hashlib
import io
import json
import os
import re
import time
import tomllib
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jointbayes.case.case_text import CaseText, find_outside, read_case_text
from jointbayes.case.parse import parse_case
from jointbayes.case.spec.fields import named_files
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.case.toml_text import key_parts, toml_text
from jointbayes.errors import CaseError, MeasurementError, ModelError, WriteError, similar
from jointbayes.posterior import Posterior
from jointbayes.posterior.identifiability import limit_in_words
from jointbayes.progress import Progress, ProgressCallback, callback_of
from jointbayes.report import Report
from jointbayes.report.markup import foreign
from jointbayes.report.model import Callout, ReportSection, Table
from jointbayes.report.run_directory import write_into
from jointbayes.reproducibility import code_version
from jointbayes.rounding import engineering, join_unit
from jointbayes.studies.workers import Outcome, run_tasks
from jointbayes.workflow import load_posterior
from vibrecords.errors import path_fault, printable
from vibrecords.files import OwnDirectory, open_regular, real_directory, sweep, write_whole_file

if TYPE_CHECKING:
    from distributed import Client

#: File of the index, and the directory of run directories.
INDEX, CASES = "index.csv", "cases"
DONE, FAILED, KILLED = "done", "failed", "killed its worker"
#: Columns that an index has whatever its cases are; those up to "code" are written as soon as a case has ended.
COLUMNS = ("key", "serial", "date", "status", "error", "attempts", "seed", "seconds", "fingerprint", "code")
_OF_SUMMARY = ("converged", "reason", "explains")
_OF_STIFFNESS = ("unit", "map", "median", "low95", "high95", "limit", "verdict")
#: What workers have from the start: all that a case needs.
_PRELOAD = ("jointbayes.workflow", "jointbayes.case.case", "jointbayes.studies.campaign")
_OWN = ("key", "serial", "date", "case")  # columns that are no keys of a case file
_MEANT = {"name": "key", "id": "key"}
_MOST_BYTES, _MOST_CASES, _MOST_FAULTS, _LONGEST = 100_000_000, 200_000, 20, 80
_MOST_ROWS, _MOST_STIFFNESSES, _MOST_WORDS = 300, 4, 160  # on the page
_NAME = re.compile(r"\w[\w .+-]*", re.ASCII)  # of a file, on every system
_OF_BASE = re.compile(r"^(.+?:\d+): (.+?): ")  # line and key of a fault

Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class CampaignCase:
    """One case of a campaign.

    Parameters
    ----------
    key
        Name of the case and of its run directory.
    where
        Table and row, or the case file, for messages.
    path
        Case file, or base case; data files are looked for next to it.
    cells
        Values of the table in place of the base's, by dotted key; None of a case file.
    serial, date
        As the table has them; empty where it has none.
    allow_outside
        Whether the case may name files outside its directory.
    """

    key: str
    where: str
    path: Path
    cells: Mapping[str, str] | None = None
    serial: str = ""
    date: str = ""
    allow_outside: bool = False

    def read(self) -> tuple[str, CaseSpec]:
        """Return the text of the case, and the same checked.

        A cell is what TOML makes of it, ``0.5``, ``true`` or ``["11:y"]``. What is no TOML, and what the key wants as
        text, is text. An empty cell leaves the base's value.

        Raises
        ------
        CaseError
            One line for each fault, with the row and the column, or the line of the base.
        """
        if self.cells is None:
            source = read_case_text(self.path, self.allow_outside)
            return source.text, parse_case(source)
        base = _read_base(self.path, self.allow_outside)
        given = {key: cell.strip() for key, cell in self.cells.items() if cell.strip()}
        values = {key: _parsed(cell) for key, cell in given.items()}
        data, spec, faults = self._judged(base, values)
        if spec is None:  # a serial number as a title, for example, is a text
            texts = {k: cell for k, cell in given.items() if any(f": {k}: " in fault for fault in faults)}
            data, spec, _ = self._judged(base, values | texts)
        if spec is None:
            row = f"{printable(self.where)}: "
            raise CaseError("\n".join(f if f.startswith(row) else row + _OF_BASE.sub(r"\2, \1: ", f) for f in faults))
        return toml_text(data), spec

    def _judged(self, base: CaseText, values: Mapping[str, Any]) -> tuple[dict[str, Any], CaseSpec | None, list[str]]:
        data, places = dict(base.data), {(): (str(self.path), 1), **base.places}
        table, _, line = self.where.rpartition(":")
        for key, value in values.items():
            parts = key_parts(key)
            _set(data, parts, value, f"{self.where}: {key}")
            places = {at: place for at, place in places.items() if at[: len(parts)] != parts}
            places[parts] = table, int(line)
        try:
            return data, parse_case(CaseText(table, "", data, places)), []
        except CaseError as error:
            return data, None, str(error).splitlines()

    def require_inside(self, spec: CaseSpec) -> None:
        """Refuse files outside the directory of the case file, or of the base case."""
        for key, names in _named_files(spec).items():
            if (outside := find_outside(self.path.parent, names)) is not None:
                found, expected, remedy = outside[1]
                raise CaseError(f"{self.where}: {'.'.join(key)}: {found}; expected {expected}; {remedy}")

    def work(self, campaign_seed: int, full: bool) -> tuple[str, int, str]:
        """Return the text of the case, the seed of its draws, and a digest of all that its result depends on."""
        text, spec = self.read()
        stated = "seed" in spec.sampling.model_fields_set and self.cells is not None and "sampling.seed" in self.cells
        seed = spec.sampling.seed if stated else case_seed(campaign_seed, self.key)
        digest = hashlib.sha256(repr((text, code_version(), seed, full)).encode())
        for name in (name for names in _named_files(spec).values() for name in names):
            try:
                with (self.path.parent / name).open("rb") as stream:
                    digest.update(hashlib.file_digest(stream, "sha256").digest())
            except OSError as error:
                digest.update(type(error).__name__.encode())
        return text, seed, digest.hexdigest()


@lru_cache(maxsize=1000)
def _read_base(path: Path, allow_outside: bool) -> CaseText:
    return read_case_text(path, allow_outside)


def _parsed(cell: str) -> Any:  # noqa: ANN401 (whatever TOML knows)
    with suppress(ValueError, RecursionError):
        parsed = tomllib.loads(f"value = {cell}")
        return parsed["value"] if parsed.keys() == {"value"} else cell
    return cell


def _set(data: dict[str, Any], parts: tuple[str, ...], value: object, where: str) -> None:
    *above, last = parts
    table = data
    for name in above:
        below = table.get(name, {})
        table[name] = table = dict(below) if isinstance(below, dict) else below  # the base keeps its own
        if not isinstance(table, dict):
            raise CaseError(
                f"{where}: found that {name} is no table in the base case; expected one that holds {last}; "
                "correct the column's name"
            )
    table[last] = value


def _named_files(spec: CaseSpec) -> dict[tuple[str, ...], tuple[str, ...]]:
    """Names of files that a case and its tests state, by key."""
    tables = spec.model_dump()
    names = named_files(tables)
    for test, changed in tables["tests"].items():
        names |= {("tests", test, *key): files for key, files in named_files(changed).items()}
    return names


def case_seed(seed: int, key: str) -> int:
    """Seed of a case: of the campaign's seed and the case's key alone, so that no other case changes its draws."""
    return int.from_bytes(hashlib.sha256(f"{seed}:{key}".encode()).digest()[:4], "big")


def read_cases(
    sources: Sequence[str | Path], base: str | Path | None = None, allow_outside: bool = False
) -> tuple[CampaignCase, ...]:
    """Read what the cases of a campaign are, and check each as far as its text goes.

    Parameters
    ----------
    sources
        One table in CSV, or case files, whose names may hold ``*``, ``?`` and ``[…]``.
    base
        Base case of a table without a column `case`.
    allow_outside
        Whether files that a table or a case names may lie outside its directory.

    Raises
    ------
    CaseError
        If a table or a case is wrong: one line for each fault, with row and column; or if two cases share a key.
    """
    paths = [Path(source) for source in sources]
    tables = [path for path in paths if path.suffix.lower() in (".csv", ".tsv", ".txt")]
    if tables and len(paths) > 1:
        raise CaseError(f"{tables[0]}: found a table and {len(paths) - 1} more; expected one table, or case files")
    if not tables and base is not None:
        raise CaseError(f"{base}: found a base case with case files; expected it with a table; give a table in CSV")
    listed = _rows(tables[0], base, allow_outside) if tables else _case_files(sources)
    cases = tuple(replace(case, allow_outside=allow_outside) for case in listed)
    case_by_key: dict[str, CampaignCase] = {}
    for case in cases:
        if len(case.key) > _LONGEST or not _NAME.fullmatch(case.key) or case.key.endswith((".", " ")):
            raise CaseError(
                f"{case.where}: key: found {case.key[:_LONGEST]!a}; expected a name for a directory of at most "
                f"{_LONGEST} letters, digits, points, signs and spaces that begins with a letter or digit; give the "
                "case such a key"
            )
        other = case_by_key.setdefault(case.key.casefold(), case)  # some systems take A and a for one name
        if other is not case:
            raise CaseError(
                f"{case.where}: key: found {case.key!r}, which {other.where} has already; expected a key of its own "
                "for each case; change one of them"
            )
    faults: list[str] = []
    for case in cases:
        try:
            _, spec = case.read()
            if not allow_outside:
                case.require_inside(spec)
        except CaseError as error:
            faults += str(error).splitlines()
            if len(faults) > _MOST_FAULTS:
                faults[_MOST_FAULTS:] = ["there are more faults; these are the first"]
                break
    if faults:
        raise CaseError("\n".join(faults))
    return cases


def _case_files(sources: Sequence[str | Path]) -> Iterator[CampaignCase]:
    for source in sources:
        matches = sorted(glob(str(source), recursive=True)) if not Path(source).exists() else [str(source)]
        if not matches:
            raise CaseError(f"{source}: found no such file; expected a table in CSV or case files; check the path")
        yield from (CampaignCase(Path(match).stem, match, Path(match)) for match in matches)


def _rows(table: Path, base: str | Path | None, allow_outside: bool) -> Iterator[CampaignCase]:
    rows = _cells(table)
    head = [name.strip() for name in next(rows, (0, []))[1]]
    _require_columns(head, table, base)
    number = 0
    for line, cells in rows:
        where = f"{table}:{line}"
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(head):
            raise CaseError(
                f"{where}: found {len(cells)} cells; expected {len(head)}, one for each column; correct the row, and "
                "put cells with a separator in them into quotes"
            )
        number += 1
        if number > _MOST_CASES:
            raise CaseError(f"{where}: found more than {_MOST_CASES} cases; expected fewer; make several campaigns")
        row = dict(zip(head, (cell.strip() for cell in cells), strict=True))
        key, serial, date, case = (row.pop(name, "") for name in _OWN)
        if not case and base is None:
            raise CaseError(f"{where}: case: found no base case; expected a case file; fill the cell or give --base")
        if case and not allow_outside and (outside := find_outside(table.parent, [case])) is not None:
            found, expected, remedy = (text.replace("of the case file", "of the table") for text in outside[1])
            raise CaseError(f"{where}: case: {found}; expected {expected}; {remedy}")
        path = table.parent / case if case else Path(base or "")
        yield CampaignCase(key or serial or f"{number:05d}", where, path, row, serial, date)
    if number == 0:
        raise CaseError(f"{table}:1: found no row; expected one for each case below the names of the columns")


def _cells(table: Path) -> Iterator[tuple[int, list[str]]]:
    """Rows of cells with the line on which each begins."""
    try:
        if table.stat().st_size > _MOST_BYTES:
            raise CaseError(
                f"{table}: found more than {_MOST_BYTES / 1e6:.0f} MB; expected a table of cases; divide it"
            )
        text = table.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise CaseError(f"{table}:{line}: found no UTF-8 text; expected a table in CSV; save it as UTF-8") from None
    except (OSError, ValueError) as error:
        reason = path_fault(error)
        raise CaseError(f"{table}: found that it cannot be read ({reason}); expected a table in CSV") from None
    separator = max(",;\t", key=text.split("\n", 1)[0].count)
    reader, number = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True), 1
    try:
        for cells in reader:
            yield number, cells
            number = reader.line_num + 1
    except csv.Error as error:
        raise CaseError(f"{table}:{number}: found no CSV ({error}); expected cells in rows; correct it") from None


def _require_columns(head: list[str], table: Path, base: str | Path | None) -> None:
    """Refuse columns without a name, that are there twice, or that name no key of a case."""
    twice = next((name for name in head if head.count(name) > 1), None)
    if twice is not None or "" in head or not head:
        actual = "a column without a name" if "" in head or not head else f"two columns {twice!r}"
        raise CaseError(f"{table}:1: found {actual}; expected a name of its own for each; correct the first line")
    for name in (name for name in head if name not in _OWN):
        if name == "extends":
            raise CaseError(
                f"{table}:1: extends: found a column of base cases; expected them in the column case; rename it"
            )
        if not key_parts(name):
            raise CaseError(
                f"{table}:1: column {name!r}: found no key of a case file; expected one such as structure.length_mm, "
                "or key, serial, date or case; correct the first line of the table"
            )
        near = _MEANT.get(name.lower()) or similar(name, _OWN)
        if "." not in name and near and name not in CaseSpec.model_fields:
            raise CaseError(
                f"{table}:1: {name}: found no such column; expected a key of a case; did you mean {near!r}?"
            )
    if base is None and "case" not in head:
        raise CaseError(
            f"{table}:1: found no base case; expected a column `case`, or --base; give the case that the rows change"
        )


@dataclass(frozen=True, slots=True)
class Campaign:
    """A campaign on the disk.

    Parameters
    ----------
    directory
        Its directory.
    """

    directory: Path

    def __post_init__(self) -> None:
        object.__setattr__(self, "directory", Path(self.directory))  # a path may be given as text

    @property
    def index(self) -> Any:  # noqa: ANN401 (a pandas.DataFrame, loaded late)
        """The index as a pandas.DataFrame, one row a case in the order of the table; see docs/campaigns.md.

        Raises
        ------
        MeasurementError
            If there is none.
        """
        import pandas

        file = self.directory / INDEX
        if not kept_rows(file):
            raise MeasurementError(
                f"{file}: found no case, or no such file; expected the index that `jointbayes campaign` writes; give "
                "its directory"
            )
        texts = dict.fromkeys(("key", "serial", "date", "fingerprint"), str)
        return pandas.read_csv(file, dtype=texts).set_index("key", drop=False)

    def posterior(self, key: str) -> Posterior:
        """Return the posterior of one case.

        Raises
        ------
        MeasurementError
            If the case is not done, or there is no such case.
        """
        row = kept_rows(self.directory / INDEX).get(key)
        if row is None or row["status"] != DONE:
            found = f"no case {key!r}" if row is None else f"that case {key!r} {row['status']}: {row['error']}"
            raise MeasurementError(f"{self.directory / INDEX}: found {found}; expected the key of a case that is done")
        return load_posterior(self.directory / CASES / key / "posterior.nc")


def campaign_directory(directory: str | os.PathLike[str]) -> OwnDirectory:
    """The directory of a campaign, new or of an earlier start; entered, it keeps other processes out."""
    return OwnDirectory(directory, "a campaign")


def campaign(
    cases: str | Path | Sequence[str | Path],
    directory: str | os.PathLike[str],
    *,
    base: str | Path | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: "str | Client | None" = None,
    seed: int = 1,
    full: bool = False,
    seconds: float | None = None,
    allow_outside: bool = False,
    progress: ProgressCallback | bool | None = None,
) -> Campaign:
    """Run many cases side by side: one run directory a case, an index, and a page of all.

    Started again on the same directory it goes on: cases that are done are not done again unless the case, its data,
    the seed or the package have changed. Those that failed are tried again.

    Parameters
    ----------
    cases
        A table in CSV, each row a case; or case files, or a pattern of such names.
    directory
        Where to write: ``index.csv``, ``report.html``, ``report.pdf`` and the run directories ``cases/<key>``.
    base
        The case that the rows of a table change.
    workers
        Number of processes of this machine, by default one a processor; else the most cases under way.
    executor
        An executor of concurrent.futures in place of own processes.
    scheduler
        Address of a Dask scheduler, or a client; its workers must see the same files under the same names.
    seed
        Of the campaign; each case has one of its own from this and its key. A row's ``sampling.seed`` goes before.
    full
        Sample each case as long as a run of its own does, see `SamplerSettings.for_one_of_many`.
    seconds
        Longest time for a case; one that takes longer counts as one that killed its workers.
    allow_outside
        Whether measurement files and base cases may lie outside the directory of the file that names them.
    progress
        Called as cases begin and end.

    Raises
    ------
    CaseError
        If the table or a case is wrong, before any work.
    WorkerError
        If no workers can be had.
    WriteError
        If the index cannot be written, the directory holds something else, or another process is at work in it.
    """
    table = read_cases([cases] if isinstance(cases, str | Path) else list(cases), base, allow_outside)
    if not 0 <= seed < 2**32:
        raise ModelError(f"campaign: found seed = {seed}; expected a seed of 32 bits")
    with campaign_directory(directory) as locked:
        run_cases(
            table, locked.path, seed=seed, full=full, progress=callback_of(progress), workers=workers,
            executor=executor, scheduler=scheduler, seconds=seconds,
        )  # fmt: skip
    return Campaign(locked.path)


def do_case(key: str, text: str, home: str, seed: int, target: str, allow_outside: bool, full: bool) -> float:
    """Run a case and write its run directory, in a worker; return how many seconds it took.

    Raises
    ------
    JointBayesError
        If the case is wrong, or its directory cannot be written.
    """
    from jointbayes.case.case import case_from_text
    from jointbayes.report.run_directory import write_report
    from jointbayes.workflow import sample

    begin = time.monotonic()
    case = case_from_text(key, text, directory=home, allow_outside=allow_outside)
    posterior = sample(case, settings=case.sampler.for_one_of_many(full=full), seed=seed)
    write_report(posterior, target)
    return time.monotonic() - begin


def run_cases(
    cases: Sequence[CampaignCase],
    directory: Path,
    *,
    seed: int,
    progress: ProgressCallback,
    full: bool = False,
    do: Callable[..., float] = do_case,
    **workers: Any,  # noqa: ANN401 (passed on)
) -> None:
    """Do what is not done of a campaign whose directory is ours; arguments as for `campaign`.

    `do` is what a worker does for a case: a function at the top of a module.
    """
    # 2. Keep what is finished.
    file, place = directory / INDEX, real_directory(directory / CASES)
    sweep(place)  # what workers that were killed while they wrote have left
    earlier, rows = kept_rows(file), {}
    for case in cases:
        row = earlier.get(case.key, {})
        is_there = row.get("status") == DONE and (place / case.key / "summary.json").is_file()
        if is_there and row["fingerprint"] == case.work(seed, full)[2]:
            rows[case.key] = row | {"serial": case.serial, "date": case.date}
    write_index(file, rows.values())
    todo = {case.key: case for case in cases if case.key not in rows}
    works: dict[str, tuple[int, str]] = {}  # seed and fingerprint of each case under way
    kept, ended, began = len(rows), Counter[str](), time.monotonic()
    running: tuple[str, ...] = ()

    def tasks() -> Iterator[tuple[str, tuple[Any, ...]]]:
        for case in todo.values():
            text, of_seed, mark = case.work(seed, full)
            works[case.key] = of_seed, mark
            home, target = str(case.path.absolute().parent), str((place / case.key).absolute())
            yield case.key, (case.key, text, home, of_seed, target, case.allow_outside, full)

    def tell(now: tuple[str, ...]) -> None:
        nonlocal running
        running, figures = now, {"failed": ended["failed"], "running": len(now)}
        before = f"{kept} of these at an earlier start, " if kept else ""
        words = f"{ended['failed']} failed, {before}{len(running)} running"
        done = kept + ended.total()
        progress(Progress("sampling", words, done, len(cases), "cases", kept, time.monotonic() - began, figures))

    # 3. Do the others.
    tell(())
    try:
        outcomes = run_tasks(do, tasks(), watch=tell, preload=_PRELOAD, **workers)
        with closing(outcomes):  # type: ignore[type-var]  # a generator
            for outcome in outcomes:
                row = _row(todo[outcome.key], outcome, *works.pop(outcome.key), directory)
                rows[outcome.key] = row
                _append(file, row)
                ended.update([DONE if row["status"] == DONE else "failed"])
                tell(tuple(key for key in running if key != outcome.key))
    finally:
        # 4. Write the index in the order of the table.
        sweep(place)
        in_order = [rows[case.key] for case in cases if case.key in rows]
        in_order = [row | (_found(place / row["key"]) if row["status"] == DONE else {}) for row in in_order]
        write_index(file, in_order)
    write_into(directory, campaign_page(directory.resolve().name or "campaign", in_order), {})


def _row(case: CampaignCase, outcome: Outcome, seed: int, fingerprint: str, directory: Path) -> Row:
    """Row of the index for a case that has ended."""
    status, error = KILLED if outcome.killed_worker else DONE if outcome.error is None else FAILED, outcome.error
    if status == DONE and not (directory / CASES / case.key / "summary.json").is_file():
        status = FAILED
        error = f"{CASES}/{case.key}: found no run directory; expected workers that see {directory} under this name"
    cells = (case.key, case.serial, case.date, status, error or "", outcome.attempts, seed, outcome.value or "")
    return dict(zip(COLUMNS, (*cells, fingerprint, code_version()), strict=True))


def _found(run: Path) -> Row:
    """What the index says of a case that is done, from its ``summary.json``."""
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    row = {"converged": summary["converged"], "reason": summary["reason"]}
    row["explains"] = (summary["check"] or {}).get("explains")
    for name, known in summary["parameters"].items():
        cells = known | dict(zip(("low95", "high95"), known["interval95"], strict=True))
        row |= {f"{name}.{column}": cells.get(column) for column in _OF_STIFFNESS}
    return row


def kept_rows(file: Path) -> dict[str, Row]:
    """Rows of an index by key, without one that was cut off; none where there is no index.

    Raises
    ------
    MeasurementError
        If it is no index of a campaign.
    """
    try:
        with open_regular(file, "rb") as stream:
            text = stream.read().decode("utf-8-sig", errors="replace")
    except FileNotFoundError:
        return {}
    try:
        rows = list(csv.DictReader(io.StringIO(text, newline="")))
    except csv.Error:
        rows = [{}]
    if rows and not {"key", "status", "fingerprint"} <= rows[0].keys():
        raise MeasurementError(
            f"{file}: found no index of a campaign in it; expected the one that `jointbayes campaign` writes; give "
            "another directory, or remove the file, and all cases are done again"
        )
    return {row["key"]: row for row in rows if row["code"]}


def write_index(file: Path, rows: Iterable[Row]) -> None:
    """Write an index, whole: the columns of every index, and those of all stiffnesses of its rows.

    Raises
    ------
    WriteError
        If it cannot be written.
    """
    rows = list(rows)
    head = dict.fromkeys((*COLUMNS, *_OF_SUMMARY, *(name for row in rows for name in row)))
    lines = _csv([list(head), *([row.get(name) for name in head] for row in rows)])
    write_whole_file(file, lines.encode())


def _append(file: Path, row: Row) -> None:
    """Append a row without stiffnesses to an index, and force it to the disk."""
    try:
        with open_regular(file, "a+b") as stream:
            stream.seek(0)
            head = stream.readline().decode().rstrip("\r\n").split(",")
            stream.write(_csv([[row.get(name) for name in head]]).encode())
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise WriteError(
            f"{file}: found that it cannot be written ({error.strerror or error}); expected a place with room; make "
            "room, and start again: what is done is not done again"
        ) from error


def _csv(rows: Iterable[Iterable[object]]) -> str:
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows([_cell(value) for value in row] for row in rows)
    return stream.getvalue()


def _cell(value: object) -> object:
    """A value as a spreadsheet shows it without computing it: an apostrophe goes before text that may be a formula.

    Compatible forms count as the sign, such as the full-width ＝, and marks that do not print are escaped.
    """
    if not isinstance(value, str):
        return value
    text = printable(value)
    return f"'{text}" if unicodedata.normalize("NFKC", text).lstrip().startswith(("=", "+", "-", "@")) else text


def campaign_page(name: str, rows: Sequence[Row]) -> Report:
    """Build the page of a campaign: what became of its cases, and a row for each joint."""
    done = [row for row in rows if row["status"] == DONE]
    doubtful = [row for row in done if not row["converged"]]
    misfits = [row for row in done if row["explains"] is False]
    parts = [f"**{len(done)} of {len(rows)} cases are done.**"]
    parts += [f"{len(doubtful)} did not converge."] if doubtful else []
    parts += [f"In {len(misfits)} the model does not explain the data."] if misfits else []
    whole = len(done) == len(rows) and not doubtful and not misfits
    names = list(dict.fromkeys(key.removesuffix(".verdict") for row in done for key in row if key.endswith(".verdict")))
    blocks: list[Callout | Table] = [Callout("good" if whole else "caution", " ".join(parts))]
    if done:
        cells = [(_label(row), *(_known(row, k) for k in names[:_MOST_STIFFNESSES]), _doubt(row)) for row in done]
        note = f"95 % intervals, each joint from its own test alone. Its report: `{CASES}/NAME/report.html`."
        if len(done) > _MOST_ROWS or len(names) > _MOST_STIFFNESSES:
            note += (
                f" The page shows {_MOST_ROWS} joints and {_MOST_STIFFNESSES} stiffnesses at most; `{INDEX}` has all."
            )
        head = ("Joint", *map(foreign, names[:_MOST_STIFFNESSES]), "Doubts")
        kinds = tuple("bad" if cell[-1] else "" for cell in cells[:_MOST_ROWS])
        blocks.append(
            Table("Joints", head, tuple(cells[:_MOST_ROWS]), align="l" * len(head), note=note, row_kinds=kinds)
        )
    if len(done) < len(rows):
        lost = [(_label(row), row["status"], foreign(row["error"])) for row in rows if row["status"] != DONE]
        more = f"The first {_MOST_ROWS}; `{INDEX}` has all." if len(lost) > _MOST_ROWS else ""
        blocks.append(Table("Not done", ("Joint", "Status", "Why"), tuple(lost[:_MOST_ROWS]), align="lll", note=more))
    versions = Table("Versions", ("Item", "Value"), (("jointbayes", foreign(code_version())),), align="ll")
    section = ReportSection("settings", "Settings and versions", (versions,))
    title = foreign(name) if name.casefold().startswith("campaign") else f"Campaign {foreign(name)}"
    return Report(title, "Stiffness of many joints, each by itself", tuple(blocks), (section,))


def _label(row: Row) -> str:
    return foreign(_cut(row["key"] if row["serial"] in ("", row["key"]) else f"{row['key']} ({row['serial']})"))


def _known(row: Row, name: str) -> str:
    """Interval or limit of one stiffness of a row, or its verdict where it is not known."""
    verdict = row.get(f"{name}.verdict")
    if verdict is None or verdict in ("not identified", "no verdict"):
        return verdict or "–"
    low, high, limit, unit = (row[f"{name}.{column}"] for column in ("low95", "high95", "limit", "unit"))
    if verdict in ("bounded below", "bounded above"):
        return limit_in_words(verdict, limit, unit)
    ends, in_unit = engineering((low, high), unit)
    return join_unit(" to ".join(ends), in_unit)


def _doubt(row: Row) -> str:
    doubts = [] if row["converged"] else ["not converged"]
    return "; ".join([*doubts, *(["the model does not explain the data"] if row["explains"] is False else [])])


def _cut(text: str) -> str:
    return text if len(text) <= _MOST_WORDS else f"{text[: _MOST_WORDS - 1]}…"
