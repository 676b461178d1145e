"""A campaign: its cases from files or a table, what is still to do, who does it, and what is on the disk of it."""

import csv
import datetime
import hashlib
import io
import json
import os
import re
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
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
from jointbayes.errors import CaseError, MeasurementError, ModelError, similar
from jointbayes.posterior import Posterior
from jointbayes.posterior.posterior import Cell
from jointbayes.progress import Progress, ProgressCallback, callback_of
from jointbayes.reproducibility import code_version
from jointbayes.studies.campaign.campaign_report import write_campaign_report
from jointbayes.studies.campaign.index import (
    COLUMNS,
    DONE,
    FAILED,
    INDEX,
    KILLED,
    Row,
    campaign_directory,
    date_of,
    kept_rows,
    read_index,
    rows_of_campaign,
    write_index,
)
from jointbayes.studies.study_directory import append_line
from jointbayes.studies.workers import Outcome, run_tasks
from jointbayes.workflow import load_posterior
from vibrecords.errors import path_fault, printable
from vibrecords.files import real_directory, sweep

if TYPE_CHECKING:
    from distributed import Client


@dataclass(frozen=True, eq=False)
class BaseCase:
    """The case over which rows of a table are laid.

    Parameters
    ----------
    path
        Its file; data files are looked for beside it.
    source
        Its text, with that of what it builds on.
    """

    path: Path
    source: CaseText

    def overridden(self, cells: Mapping[str, str], where: str) -> tuple[dict[str, Any], CaseSpec]:
        """The tables of the case with other values for some keys, and the same checked.

        A value is what TOML makes of a cell, ``0.5``, ``true`` or ``["11:y"]``; what is no TOML, and what the key wants
        as text, is text: names of files need no quotes. An empty cell leaves the base's value.

        Parameters
        ----------
        cells
            Cell of the table by dotted key.
        where
            Table and row, for messages.

        Raises
        ------
        CaseError
            One line for each fault, with the row and the column, or the line of the base.
        """
        given = {key: cell.strip() for key, cell in cells.items() if cell.strip()}
        values = {key: _parsed(cell) for key, cell in given.items()}
        data, spec, faults = self._judged(values, where)
        if spec is None:
            # a serial number as a title, say, is no number
            texts = {k: cell for k, cell in given.items() if any(f": {k}: " in fault for fault in faults)}
            data, spec, _ = self._judged(values | texts, where)
        if spec is None:
            row = f"{printable(where)}: "
            raise CaseError("\n".join(f if f.startswith(row) else row + _OF_BASE.sub(r"\2, \1: ", f) for f in faults))
        return data, spec

    def _judged(self, values: Mapping[str, Any], where: str) -> tuple[dict[str, Any], CaseSpec | None, list[str]]:
        data, places = dict(self.source.data), {(): (str(self.path), 1), **self.source.places}
        table, _, line = where.rpartition(":")
        for key, value in values.items():
            parts = _set(data, key, value, where)
            places = {at: place for at, place in places.items() if at[: len(parts)] != parts}
            places[parts] = table, int(line)
        try:
            return data, parse_case(CaseText(table, "", data, places)), []
        except CaseError as error:
            return data, None, str(error).splitlines()


#: Line and key of a fault.
_OF_BASE = re.compile(r"^(.+?:\d+): (.+?): ")


def _parsed(cell: str) -> Any:  # noqa: ANN401 (whatever TOML knows)
    try:
        parsed = tomllib.loads(f"value = {cell}")
    except (ValueError, RecursionError):
        return cell
    return parsed["value"] if parsed.keys() == {"value"} else cell


def _set(data: dict[str, Any], key: str, value: object, where: str) -> tuple[str, ...]:
    parts = key_parts(key)
    if not parts:
        raise CaseError(
            f"{where}: column {key!r}: found no key of a case file; expected one such as structure.length_mm, or key, "
            "serial, date or case; correct the first line of the table"
        )
    *above, last = parts
    table = data
    for name in above:
        below = table.get(name, {})
        table[name] = table = dict(below) if isinstance(below, dict) else below  # the base keeps its own
        if not isinstance(table, dict):
            raise CaseError(
                f"{where}: {key}: found that {name} is no table in the base case; expected one that holds {last}; "
                "correct the column's name"
            )
    table[last] = value
    return parts


@lru_cache(maxsize=1000)
def read_base(path: Path, allow_outside: bool = False) -> BaseCase:
    """Read a base case; each file once.

    What it builds on must lie in its directory or below unless `allow_outside`.

    Raises
    ------
    CaseError
        If it cannot be read or is no TOML; whether it is a case is seen with the row.
    """
    return BaseCase(path, read_case_text(path, allow_outside))


_MEANT = {"name": "key", "id": "key"}
_OWN = ("key", "serial", "date", "case")  # columns that are no keys of a case file
_MOST_BYTES, _MOST_CASES = 100_000_000, 200_000
_MOST_FAULTS = 20
_NAME = re.compile(r"\w[\w .+-]*", re.ASCII)  # of a file, on every system
_LONGEST = 80


@dataclass(frozen=True, slots=True)
class CampaignCase:
    """One case of a campaign.

    Parameters
    ----------
    key
        By which it is known; the name of its file.
    order
        Its place in the table, from 0.
    where
        Table and row, or the case file, for messages.
    path
        Case file, or base case.
    cells
        What the table puts in place of the base's values, by dotted key; None of a case file.
    serial, date
        As the table has them.
    allow_outside
        Whether a case may build on files outside its directory.
    """

    key: str
    order: int
    where: str
    path: Path
    cells: Mapping[str, str] | None = None
    serial: str | None = None
    date: datetime.datetime | None = None
    allow_outside: bool = False

    def read(self) -> tuple[str, CaseSpec]:
        """Text of the case, and the same checked.

        Raises
        ------
        CaseError
            If it is no case.
        """
        if self.cells is None:
            source = read_case_text(self.path, self.allow_outside)
            return source.text, parse_case(source)
        data, spec = read_base(self.path, self.allow_outside).overridden(self.cells, self.where)
        return toml_text(data), spec

    def files(self, spec: CaseSpec) -> tuple[Path, ...]:
        """Files that it names: of measurements, measured bodies and matrices."""
        return tuple(self.path.parent / name for names in _named_files(spec).values() for name in names)

    def require_inside(self, spec: CaseSpec) -> None:
        """Refuse files outside the directory of the case file, or of the base case."""
        for key, names in _named_files(spec).items():
            if (outside := find_outside(self.path.parent, names)) is not None:
                found, expected, remedy = outside[1]
                raise CaseError(f"{self.where}: {'.'.join(key)}: {found}; expected {expected}; {remedy}")

    @staticmethod
    def fingerprint(text: str, files: Sequence[Path], *of_run: object) -> str:
        """Digest of what a result depends on: the case, its data, and what the run adds."""
        digest = hashlib.sha256(repr((text, *of_run)).encode())
        for file in files:
            try:
                with file.open("rb") as stream:
                    digest.update(hashlib.file_digest(stream, "sha256").digest())
            except OSError as error:
                digest.update(type(error).__name__.encode())
        return digest.hexdigest()


def _named_files(spec: CaseSpec) -> dict[tuple[str, ...], tuple[str, ...]]:
    """Names of files that a case and its tests state, by key."""
    tables = spec.model_dump()
    names = named_files(tables)
    for test, changed in tables["tests"].items():
        names |= {("tests", test, *key): files for key, files in named_files(changed).items()}
    return names


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
        Whether files that a case names may lie outside the directory of their case, or of the base case.

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
    listed = _rows(tables[0], base) if tables else _case_files(sources)
    cases = tuple(replace(case, allow_outside=allow_outside) for case in listed)
    _require_own_keys(cases)
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
    files: list[Path] = []
    for source in sources:
        matches = sorted(glob(str(source), recursive=True)) if not Path(source).exists() else [str(source)]
        if not matches:
            raise CaseError(f"{source}: found no such file; expected a table in CSV or case files; check the path")
        files += map(Path, matches)
    for order, path in enumerate(files):
        yield CampaignCase(_key(path.stem, str(path)), order, str(path), path)


def _rows(table: Path, base: str | Path | None) -> Iterator[CampaignCase]:
    rows = _cells(table)
    head = [name.strip() for name in next(rows, (0, []))[1]]
    _require_columns(head, table, base)
    order = 0
    for number, cells in rows:
        where = f"{table}:{number}"
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(head):
            raise CaseError(
                f"{where}: found {len(cells)} cells; expected {len(head)}, one for each column; correct the row, and "
                "put cells with a separator in them into quotes"
            )
        if order == _MOST_CASES:
            raise CaseError(f"{where}: found more than {_MOST_CASES} cases; expected fewer; make several campaigns")
        row = dict(zip(head, (cell.strip() for cell in cells), strict=True))
        campaign_cells = {name: row.pop(name, "") for name in _OWN}
        if not campaign_cells["case"] and base is None:
            raise CaseError(f"{where}: case: found no base case; expected a case file; fill the cell or give --base")
        path = table.parent / campaign_cells["case"] if campaign_cells["case"] else Path(base or "")
        key = campaign_cells["key"] or campaign_cells["serial"] or f"{order + 1:05d}"
        date = _date(campaign_cells["date"], where) if campaign_cells["date"] else None
        yield CampaignCase(_key(key, where), order, where, path, row, campaign_cells["serial"] or None, date)
        order += 1
    if order == 0:
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
    first = text.split("\n", 1)[0]
    separator = max(",;\t", key=first.count)
    reader, number = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True), 1
    try:
        for cells in reader:
            yield number, cells
            number = reader.line_num + 1
    except csv.Error as error:
        raise CaseError(f"{table}:{number}: found no CSV ({error}); expected cells in rows; correct it") from None


def _require_columns(head: list[str], table: Path, base: str | Path | None) -> None:
    twice = next((name for name in head if head.count(name) > 1), None)
    if twice is not None or "" in head or not head:
        actual = "a column without a name" if "" in head or not head else f"two columns {twice!r}"
        raise CaseError(f"{table}:1: found {actual}; expected a name of its own for each; correct the first line")
    for name in (name for name in head if name not in _OWN and "." not in name):
        near = _MEANT.get(name.lower()) or similar(name, _OWN)
        if near and name not in CaseSpec.model_fields:
            raise CaseError(
                f"{table}:1: {name}: found no such column; expected a key of a case; did you mean {near!r}?"
            )
    if base is None and "case" not in head:
        raise CaseError(
            f"{table}:1: found no base case; expected a column `case`, or --base; give the case that the rows change"
        )


def _key(key: str, where: str) -> str:
    if len(key) > _LONGEST or not _NAME.fullmatch(key) or key.endswith((".", " ")):
        shown = ascii(key[:_LONGEST])
        raise CaseError(
            f"{where}: key: found {shown}; expected a name for a file of at most {_LONGEST} letters, digits, points, "
            "signs and spaces that begins with a letter or digit; give the case such a key"
        )
    return key


def _date(text: str, where: str) -> datetime.datetime:
    try:
        return date_of(text)
    except ValueError:
        raise CaseError(
            f"{where}: date: found {text[:_LONGEST]!a}; expected a date such as 2026-03-31 or 2026-03-31 14:05; "
            "correct it"
        ) from None


def _require_own_keys(cases: Sequence[CampaignCase]) -> None:
    case_by_key: dict[str, CampaignCase] = {}
    for case in cases:
        other = case_by_key.setdefault(case.key.casefold(), case)  # some systems take A and a for one name
        if other is not case:
            raise CaseError(
                f"{case.where}: key: found {case.key!r}, which {other.where} has already; expected a key of its own "
                "for each case; change one of them"
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

        rows = rows_of_campaign(self.directory)
        names = dict.fromkeys((*COLUMNS, *(name for row in rows for name in row)))
        table = pandas.DataFrame(rows, columns=list(names))
        table["date"] = pandas.to_datetime(table["date"])
        return table.set_index("key", drop=False)

    def write_report(self, *, seed: int = 1) -> Path:
        """Write the report of the campaign and its population into its directory; `seed` is that of the population.

        Raises
        ------
        MeasurementError
            If there is no campaign in the directory.
        WriteError
            If a file cannot be written.
        """
        return write_campaign_report(self.directory, seed)

    @property
    def answer(self) -> str:
        """What its report says first; empty before there is one."""
        file = self.directory / "summary.json"
        return str(json.loads(file.read_text(encoding="utf-8")).get("answer", "")) if file.is_file() else ""

    def posterior(self, key: str) -> Posterior:
        """Posterior of one case.

        Raises
        ------
        MeasurementError
            If the case is not done, or there is no such case.
        """
        rows = {row.key: row for row in read_index(self.directory)}
        if key not in rows:
            raise MeasurementError(
                f"{self.directory / INDEX}: found no case {key!r}; expected one of its {len(rows)} keys"
            )
        row = rows[key]
        if row.status != DONE:
            raise MeasurementError(f"{self.directory / INDEX}: case {key!r}: found that it {row.status}: {row.error}")
        return load_posterior(self.directory / row.file)


@dataclass(frozen=True, slots=True)
class CaseWork:
    """One case as it is sent to a worker.

    Parameters
    ----------
    key
        Of the case, its name.
    text
        TOML text.
    directory
        Where its measurement files are looked for.
    seed
        Of its draws.
    file
        Posterior file to write.
    draws
        Draws to keep in it at most.
    allow_outside
        Whether its measurement files may lie outside that directory.
    full
        Whether to sample it as long as a run of its own.
    """

    key: str
    text: str
    directory: str
    seed: int
    file: str
    draws: int
    allow_outside: bool = False
    full: bool = False


def do_case(work: CaseWork) -> dict[str, Cell]:
    """Sample a case, write its posterior and return its row of the index.

    The row is of all draws, the file holds fewer. Doing it twice writes the same file twice.

    Raises
    ------
    JointBayesError
        If the case is wrong, or its file cannot be written.
    """
    from jointbayes.case.case import case_from_text
    from jointbayes.workflow import sample

    begin = time.monotonic()
    case = case_from_text(work.key, work.text, directory=work.directory, allow_outside=work.allow_outside)
    # the cases are what is spread over processes; the draws are the same
    posterior = sample(case, settings=case.sampler.for_one_of_many(full=work.full), seed=work.seed)
    row = posterior.brief()
    posterior.with_fewer_draws(work.draws).save(Path(work.file))
    return {"seconds": time.monotonic() - begin, "code": code_version(), **row}


_FORM = 1  # of what a case is reduced to: raised where all cases must be done again
#: What workers have from the start: all that a case needs.
_PRELOAD = ("jointbayes.workflow", "jointbayes.case.case", "jointbayes.studies.campaign.campaign_run")


def case_seed(seed: int, key: str) -> int:
    """Seed of a case: of the campaign's seed and the case's key alone, so that no other case changes its draws."""
    return int.from_bytes(hashlib.sha256(f"{seed}:{key}".encode()).digest()[:4], "big")


def campaign(
    cases: str | Path | Sequence[str | Path],
    directory: str | os.PathLike[str],
    *,
    base: str | Path | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: "str | Client | None" = None,
    seed: int = 1,
    draws: int = 4000,
    full: bool = False,
    seconds: float | None = None,
    again: bool = False,
    allow_outside: bool = False,
    progress: ProgressCallback | bool | None = None,
) -> Campaign:
    """Sample many cases side by side: one posterior file a case, and an index of all.

    Started again on the same directory it goes on: cases that are done are not done again unless the case, its data,
    the seed or the package have changed; those that failed are tried once more.

    Parameters
    ----------
    cases
        A table in CSV, each row a case; or case files, or a pattern of such names.
    directory
        Where to write: ``index.jsonl`` and ``cases/<key>.nc``.
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
    draws
        Draws kept in each file at most; the index is of all draws.
    full
        Sample each case as long as a run of its own does, see `SamplerSettings.for_one_of_many`.
    seconds
        Longest time for a case; one that takes longer counts as one that killed its workers.
    again
        Try cases again that killed their workers at an earlier start.
    allow_outside
        Whether measurement files may lie outside the directory of their case, or of the base case.
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
    if not draws > 0 or not 0 <= seed < 2**32:
        raise ModelError(f"campaign: found draws = {draws}, seed = {seed}; expected draws above 0, a seed of 32 bits")
    with campaign_directory(directory) as locked:
        run_cases(
            table, locked.path, seed=seed, draws=draws, full=full, again=again, progress=callback_of(progress),
            workers=workers, executor=executor, scheduler=scheduler, seconds=seconds,
        )  # fmt: skip
    return Campaign(locked.path)


def run_cases(
    cases: Sequence[CampaignCase],
    directory: Path,
    *,
    seed: int,
    draws: int,
    again: bool,
    full: bool = False,
    progress: ProgressCallback,
    do: Callable[[CaseWork], Row] = do_case,
    **workers: Any,  # noqa: ANN401 (passed on)
) -> None:
    """Do what is not done of a campaign whose directory is ours; arguments as for `campaign`.

    `do` is what a worker does for a case: a function at the top of a module.
    """
    real_directory(directory / "cases")
    sweep(directory / "cases")  # what workers that were killed as they wrote have left
    earlier = kept_rows(directory)
    kept: dict[str, Row] = {}
    for case in cases:
        row = earlier.get(case.key)
        if row is not None and (row["status"] == DONE or (row["status"] == KILLED and not again)):
            _, mark, _ = _content(case, seed, draws, full)
            lacks_file = row["status"] == DONE and not (directory / row["file"]).is_file()
            if row.get("fingerprint") == mark and not lacks_file:
                kept[case.key] = {**row, "order": case.order, "serial": case.serial, "date": case.date}
    tries = {key: int(row.get("attempts") or 0) for key, row in earlier.items() if row["status"] != DONE}
    write_index(directory, kept.values())
    count = _Counter(progress, len(cases), kept.values())
    by_key = {case.key: case for case in cases if case.key not in kept}
    del kept, earlier
    marks: dict[str, tuple[str, int]] = {}  # fingerprint and seed of each case under way

    def tasks() -> Iterator[tuple[str, tuple[CaseWork]]]:
        for case in by_key.values():
            text, mark, of_seed = _content(case, seed, draws, full)
            marks[case.key] = mark, of_seed
            file = str((directory / "cases" / f"{case.key}.nc").absolute())
            home = str(case.path.absolute().parent)
            yield case.key, (CaseWork(case.key, text, home, of_seed, file, draws, case.allow_outside, full),)

    try:
        outcomes = run_tasks(do, tasks(), watch=count.running, preload=_PRELOAD, **workers)
        with closing(outcomes):  # type: ignore[type-var]  # a generator
            for outcome in outcomes:
                case, (mark, of_seed) = by_key[outcome.key], marks.pop(outcome.key)
                row = _row(case, outcome, directory, of_seed) | {"fingerprint": mark}
                row["attempts"] += tries.get(case.key, 0)
                append_line(directory / INDEX, row)
                count.ended(row)
    finally:
        sweep(directory / "cases")
        write_index(directory, kept_rows(directory).values())


def _content(case: CampaignCase, seed: int, draws: int, full: bool) -> tuple[str, str, int]:
    """Text of a case, the fingerprint of all that its row depends on, and the seed of its draws."""
    text, spec = case.read()
    states_seed = "seed" in spec.sampling.model_fields_set and case.cells is not None and "sampling.seed" in case.cells
    of_seed = spec.sampling.seed if states_seed else case_seed(seed, case.key)
    return text, case.fingerprint(text, case.files(spec), _FORM, code_version(), of_seed, draws, full), of_seed


def _row(case: CampaignCase, outcome: Outcome, directory: Path, seed: int) -> Row:
    """Row of the index for a case that has ended."""
    file = f"cases/{case.key}.nc"
    status = KILLED if outcome.killed_worker else DONE if outcome.error is None else FAILED
    error = outcome.error
    if status == DONE and not (directory / file).is_file():
        status, error = FAILED, f"{file}: found no file; expected workers that see {directory} under this name"
    values = outcome.value if status == DONE else {}
    return {
        "key": case.key, "file": file if status == DONE else None, "status": status, "attempts": outcome.attempts,
        "error": error, "serial": case.serial, "date": case.date, "order": case.order, "seed": seed, **values,
    }  # fmt: skip


class _Counter:
    """Counts cases that have ended, and tells."""

    def __init__(self, tell: ProgressCallback, total: int, kept: Iterable[Row]) -> None:
        self._tell, self._began, self._total = tell, time.monotonic(), total
        self._ended: Counter[str] = Counter()
        self._running: tuple[str, ...] = ()
        for row in kept:
            self._count(row)
        self._earlier = self._ended["cases"]
        self.running(())

    def _count(self, row: Row) -> None:
        done = row["status"] == DONE
        self._ended.update(cases=1, failed=int(not done), not_converged=int(done and not row["converged"]))

    def ended(self, row: Row) -> None:
        """Count a case that has ended."""
        self._count(row)
        self.running(tuple(key for key in self._running if key != row["key"]))

    def running(self, keys: tuple[str, ...]) -> None:
        """Tell which cases run."""
        self._running, ended = keys, self._ended
        figures = {"failed": ended["failed"], "not_converged": ended["not_converged"], "running": len(keys)}
        earlier = f"{self._earlier} of these at an earlier start, " if self._earlier else ""
        text = f"{ended['failed']} failed, {earlier}{len(keys)} running"
        elapsed = time.monotonic() - self._began
        self._tell(Progress("sampling", text, ended["cases"], self._total, "cases", self._earlier, elapsed, figures))
