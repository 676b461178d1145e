"""A campaign: many cases from a table or from files, one run directory each, an index, and one page of all.

1. Read the table: each row is a base case with other values for some keys. All faults are named before any work.
2. Keep cases that are finished: their run directory is there, of the same case, data, seed and package.
3. Do the others, side by side. The index is written again, whole, each time that a case has ended.
4. Write the page.
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
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jointbayes.case.case_text import CaseText, find_outside, read_case_text
from jointbayes.case.parse import parse_case
from jointbayes.case.spec.fields import named_files
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.case.toml_text import key_parts, toml_text
from jointbayes.errors import CaseError, MeasurementError
from jointbayes.posterior import Posterior
from jointbayes.posterior.identifiability import limit_in_words
from jointbayes.progress import Progress, ProgressCallback, callback_of
from jointbayes.report import Report
from jointbayes.report.markup import foreign
from jointbayes.report.model import Callout, ReportSection, Table
from jointbayes.report.run_directory import write_into
from jointbayes.reproducibility import code_version
from jointbayes.rounding import engineering, join_unit
from jointbayes.studies.workers import run_tasks
from jointbayes.workflow import load_posterior
from vibrecords.errors import path_fault, printable
from vibrecords.files import OwnDirectory, open_regular, real_directory, sweep, write_whole_file

if TYPE_CHECKING:
    from distributed import Client

#: File of the index, and the directory of run directories.
INDEX, CASES = "index.csv", "cases"
DONE, FAILED, KILLED = "done", "failed", "killed its worker"
#: Columns that every index has.
COLUMNS = ("key", "serial", "date", "status", "error", "attempts", "seed", "seconds", "fingerprint", "code")
_OF_SUMMARY = ("converged", "reason", "explains")
_OF_STIFFNESS = ("unit", "map", "median", "low95", "high95", "limit", "verdict")
#: What workers have from the start: all that a case needs.
_PRELOAD = ("jointbayes.workflow", "jointbayes.case.case", "jointbayes.studies.campaign")
_OWN = ("key", "serial", "date", "case")  # columns that are no keys of a case file
_MOST_FAULTS, _LONGEST = 20, 80
_MOST_ROWS, _MOST_STIFFNESSES, _MOST_LETTERS = 300, 4, 160  # on the page
_NAME = re.compile(r"\w[\w .+-]*(?<![. ])", re.ASCII)  # of a file, on every system
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
    base
        Text of the case file, or of the base case.
    directory
        Directory of that file, in which data files are looked for.
    cells
        Values of the table in place of the base's, by dotted key.
    serial, date
        As the table has them; empty where it has none.
    allow_outside
        Whether the case may name files outside its directory.
    """

    key: str
    where: str
    base: CaseText
    directory: Path
    cells: Mapping[str, str]
    serial: str = ""
    date: str = ""
    allow_outside: bool = False

    def read(self) -> tuple[str, CaseSpec, tuple[str, ...]]:
        """Return the text of the case, the same checked, and the names of the files that it names.

        A cell is what TOML makes of it, ``0.5``, ``true`` or ``["11:y"]``. What is no TOML, and what the key wants as
        text, is text.

        Raises
        ------
        CaseError
            One line for each fault, with the row and the column, or the line of the base.
        """
        text, spec = self._parsed() if self.cells else (self.base.text, parse_case(self.base))
        tables = spec.model_dump()
        files = named_files(tables)
        for test, changed in tables["tests"].items():
            files |= {("tests", test, *key): names for key, names in named_files(changed).items()}
        for key, names in files.items():
            if not self.allow_outside and (outside := find_outside(self.directory, names)) is not None:
                raise CaseError.of(f"{self.where}: {'.'.join(key)}", (), *outside[1])
        return text, spec, tuple(name for names in files.values() for name in names)

    def _parsed(self) -> tuple[str, CaseSpec]:
        """Text and spec of the base with the cells in it."""
        table, _, line = self.where.rpartition(":")
        faults: list[str] = []
        for _ in range(2):  # again with text where no other value is taken, such as a serial number as a title
            data, places = dict(self.base.data), {(): (self.base.name, 1), **self.base.places}
            for key, cell in self.cells.items():
                value, parts = cell, key_parts(key)
                if not any(f": {key}: " in fault for fault in faults):
                    with suppress(ValueError, RecursionError):
                        parsed = tomllib.loads(f"value = {cell}")
                        value = parsed["value"] if parsed.keys() == {"value"} else cell
                inside = data
                for name in parts[:-1]:
                    below = inside.get(name, {})
                    if not isinstance(below, dict):
                        found, expected = f"found that {name} is no table in the base case", f"one with {parts[-1]}"
                        raise CaseError.of(f"{self.where}: {key}", (), found, expected, "correct the column's name")
                    inside[name] = inside = dict(below)  # the base keeps its own
                inside[parts[-1]] = value
                places = {at: place for at, place in places.items() if at[: len(parts)] != parts}
                places[parts] = table, int(line)
            try:
                return toml_text(data), parse_case(CaseText(table, "", data, places))
            except CaseError as error:
                faults = faults or str(error).splitlines()
        row = f"{printable(self.where)}: "
        raise CaseError("\n".join(f if f.startswith(row) else row + _OF_BASE.sub(r"\2, \1: ", f) for f in faults))

    def work(self, campaign_seed: int, full: bool) -> tuple[str, int, str]:
        """Return the text of the case, the seed of its draws, and a digest of all that its result depends on."""
        text, spec, files = self.read()
        seed = spec.sampling.seed if "sampling.seed" in self.cells else case_seed(campaign_seed, self.key)
        digest = hashlib.sha256(repr((text, code_version(), seed, full)).encode())
        for name in files:
            try:
                with (self.directory / name).open("rb") as stream:
                    digest.update(hashlib.file_digest(stream, "sha256").digest())
            except OSError as error:
                digest.update(type(error).__name__.encode())
        return text, seed, digest.hexdigest()


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
        One table in CSV, or case files, ``*.toml``.
    base
        Base case of the rows of a table whose column `case` names none.
    allow_outside
        Whether files that a table or a case names may lie outside its directory.

    Raises
    ------
    CaseError
        If a table or a case is wrong: one line for each fault, with row and column; or if two cases share a key.
    """
    paths = [Path(source) for source in sources]
    is_table = any(path.suffix.lower() != ".toml" for path in paths)
    if (is_table and len(paths) > 1) or (base is not None and not is_table):
        found = "found a table with other files, or a base case without a table"
        raise CaseError.of("campaign", (), found, "one table in CSV, or case files alone", "drop what is too much")
    files = ((str(path), path.parent, {"key": path.stem, "case": path.name}) for path in paths)
    cases: dict[str, CampaignCase] = {}
    texts: dict[Path, CaseText] = {}
    faults: list[str] = []
    for number, (where, home, row) in enumerate(_rows(paths[0]) if is_table else files, 1):
        key, serial, date, own = (row.pop(name, "") for name in _OWN)
        key = key or serial or f"{number:05d}"
        if len(key) > _LONGEST or not _NAME.fullmatch(key):
            expected = (
                f"a name for a directory: {_LONGEST} letters, digits, points, signs or spaces at most, no sign first"
            )
            raise CaseError.of(f"{where}: key", (), f"found {key[:_LONGEST]!a}", expected, "change it")
        if key.casefold() in cases:  # some systems take A and a for one name
            found = f"found {key!r}, which {cases[key.casefold()].where} has already"
            raise CaseError.of(f"{where}: key", (), found, "a key of its own for each case", "change one of them")
        if not own and base is None:
            raise CaseError.of(f"{where}: case", (), "found no base case", "one in the cell, or --base")
        if not allow_outside and own and (outside := find_outside(home, [own])) is not None:
            words = (text.replace("of the case file", "of the table") for text in outside[1])
            raise CaseError.of(f"{where}: case", (), *words)
        path = home / own if own else Path(base or "")
        texts[path] = texts.get(path) or read_case_text(path, allow_outside)
        case = CampaignCase(key, where, texts[path], path.parent, row, serial, date, allow_outside)
        try:
            cases.setdefault(key.casefold(), case).read()
        except CaseError as error:
            faults += str(error).splitlines()
    if len(faults) > _MOST_FAULTS:
        faults[_MOST_FAULTS:] = ["there are more faults; these are the first"]
    if faults:
        raise CaseError("\n".join(faults))
    return tuple(cases.values())


def _rows(table: Path) -> Iterator[tuple[str, Path, dict[str, str]]]:
    """Rows that are not blank: file and line, directory of the table, and cells that are not empty by column."""
    number, lines = 1, []
    try:
        text = table.read_bytes().decode("utf-8-sig")
        separator = max(",;\t", key=text.split("\n", 1)[0].count)
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
        for cells in reader:
            lines.append((number, [cell.strip() for cell in cells]))
            number = reader.line_num + 1
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise CaseError.of(f"{table}:{line}", (), "found no UTF-8 text", "a table in CSV", "save it as UTF-8") from None
    except csv.Error as error:
        raise CaseError.of(f"{table}:{number}", (), f"found no CSV ({error})", "cells in rows", "correct it") from None
    except (OSError, ValueError) as error:
        found = f"found that it cannot be read ({path_fault(error)})"
        raise CaseError.of(str(table), (), found, "a table in CSV", "check the path") from None
    head = lines[0][1] if lines else [""]
    for name in head:
        found = "found a column without a name" if not name else ""
        if head.count(name) > 1:
            found = f"found two columns {name!r}"
        elif name not in _OWN and (name == "extends" or not {*key_parts(name)[:1]} & CaseSpec.model_fields.keys()):
            found = found or f"column {name!r}: found no key of a case file"
        if found:
            expected = "a key such as structure.length_mm, or key, serial, date or case (the base case), once each"
            raise CaseError.of(f"{table}:1", (), found, expected, "correct it")
    if not any(any(cells) for _, cells in lines[1:]):
        raise CaseError.of(f"{table}:1", (), "found no row", "one for each case below the names of the columns")
    for number, cells in lines[1:]:
        if any(cells) and len(cells) != len(head):
            found, expected = f"found {len(cells)} cells", f"{len(head)}, one for each column"
            raise CaseError.of(f"{table}:{number}", (), found, expected, "put cells with a separator in quotes")
        row = {name: cell for name, cell in zip(head, cells, strict=False) if cell}
        if row:
            yield f"{table}:{number}", table.parent, row


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
            raise MeasurementError(f"{file}: found no case, or no such file; expected that of a campaign; correct it")
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
    allow_outside: bool = False,
    progress: ProgressCallback | bool | None = None,
) -> Campaign:
    """Run many cases side by side: one run directory a case, an index, and a page of all.

    Started again on the same directory it goes on: cases that are done are not done again unless the case, its data,
    the seed or the package have changed. Those that failed are tried again.

    Parameters
    ----------
    cases
        A table in CSV, each row a case; or case files.
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
    with campaign_directory(directory) as locked:
        run_cases(
            table, locked.path, seed=seed, full=full, progress=callback_of(progress), workers=workers,
            executor=executor, scheduler=scheduler,
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
    write_report(sample(case, settings=case.sampler.for_one_of_many(full=full), seed=seed), target)
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
    earlier, rows = kept_rows(file), dict[str, Row]()
    for case in cases:
        row, run = earlier.get(case.key, {}), place / case.key
        is_there = row.get("status") == DONE and (run / "summary.json").is_file()
        if is_there and row["fingerprint"] == case.work(seed, full)[2]:
            rows[case.key] = {name: row[name] for name in COLUMNS} | {"serial": case.serial, "date": case.date}
            rows[case.key] |= _found(run)
    write_index(file, rows.values())
    todo = {case.key: case for case in cases if case.key not in rows}
    works: dict[str, tuple[int, str]] = {}  # seed and fingerprint of each case under way
    kept, failed, began = len(rows), 0, time.monotonic()
    running: tuple[str, ...] = ()

    def tasks() -> Iterator[tuple[str, tuple[Any, ...]]]:
        for case in todo.values():
            text, of_seed, mark = case.work(seed, full)
            works[case.key] = of_seed, mark
            home, target = str(case.directory.absolute()), str((place / case.key).absolute())
            yield case.key, (case.key, text, home, of_seed, target, case.allow_outside, full)

    def tell(now: tuple[str, ...]) -> None:
        nonlocal running
        running, figures = now, {"failed": failed, "running": len(now)}
        words = f"{failed} failed, {f'{kept} of these at an earlier start, ' if kept else ''}{len(now)} running"
        progress(Progress("sampling", words, len(rows), len(cases), "cases", kept, time.monotonic() - began, figures))

    # 3. Do the others.
    tell(())
    outcomes = run_tasks(do, tasks(), watch=tell, preload=_PRELOAD, **workers)
    try:
        with closing(outcomes):  # type: ignore[type-var]  # a generator
            for outcome in outcomes:
                case, run, error = todo[outcome.key], place / outcome.key, outcome.error
                if error is None and not (run / "summary.json").is_file():
                    error = f"{run}: found no run directory; expected workers that see {directory} under this name"
                status = KILLED if outcome.killed_worker else DONE if error is None else FAILED
                if status == DONE:  # draws that a killed worker left are in the run directory as well
                    names = re.compile(rf"{re.escape(outcome.key)}\.posterior(-\d+)?\.nc")
                    for left in (path for path in place.glob("*.nc") if names.fullmatch(path.name)):
                        left.unlink(missing_ok=True)
                cells = (case.key, case.serial, case.date, status, error or "", outcome.attempts)
                of_seed, mark = works.pop(case.key)
                row = dict(zip(COLUMNS, (*cells, of_seed, outcome.value or "", mark, code_version()), strict=True))
                rows[case.key] = row | (_found(run) if status == DONE else {})
                write_index(file, [rows[case.key] for case in cases if case.key in rows])
                failed += status != DONE
                tell(tuple(key for key in running if key != outcome.key))
    finally:
        sweep(place)
    # 4. Write the page.
    write_into(directory, campaign_page(directory.resolve().name or "campaign", [rows[c.key] for c in cases]), {})


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
    """Rows of an index by key; none where there is no index.

    Raises
    ------
    MeasurementError
        If it is no index of a campaign.
    """
    try:
        with open_regular(file, "rb") as stream:
            text = stream.read().decode("utf-8-sig", errors="replace")
        rows = list(csv.DictReader(io.StringIO(text, newline="")))
    except FileNotFoundError:
        return {}
    except csv.Error:
        rows = [{}]
    if rows and not rows[0].keys() >= set(COLUMNS):
        found = f"{file}: found no index of a campaign in it; expected what `jointbayes campaign` writes"
        raise MeasurementError(f"{found}; give another directory, or remove the file: all cases are done again")
    return {row["key"]: row for row in rows if row["code"]}  # earlier versions may have left half a row


def write_index(file: Path, rows: Iterable[Row]) -> None:
    """Write an index, whole: the columns of every index, and the columns of all stiffnesses of its rows.

    Text that a spreadsheet may take for a formula has an apostrophe before it. Compatible forms count as the sign, such
    as the full-width ＝, and marks that do not print are escaped.

    Raises
    ------
    WriteError
        If it cannot be written.
    """
    rows = list(rows)
    head = dict.fromkeys((*COLUMNS, *_OF_SUMMARY, *(name for row in rows for name in row)))
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    for values in (head, *([row.get(name) for name in head] for row in rows)):
        cells = [printable(cell) if isinstance(cell, str) else cell for cell in values]
        plain = [unicodedata.normalize("NFKC", cell).lstrip() if isinstance(cell, str) else "" for cell in cells]
        writer.writerow(
            [f"'{c}" if p.startswith(("=", "+", "-", "@")) else c for c, p in zip(cells, plain, strict=True)]
        )
    write_whole_file(file, stream.getvalue().encode())


def campaign_page(name: str, rows: Sequence[Row]) -> Report:
    """Build the page of a campaign: how its cases ended, and a row for each joint."""
    done = [row for row in rows if row["status"] == DONE]
    doubtful, misfits = sum(not row["converged"] for row in done), sum(row["explains"] is False for row in done)
    words = f"**{len(done)} of {len(rows)} cases are done.**"
    words += f" {doubtful} did not converge." if doubtful else ""
    words += f" In {misfits} the model does not explain the data." if misfits else ""
    whole = len(done) == len(rows) and not doubtful and not misfits
    blocks: list[Callout | Table] = [Callout("good" if whole else "caution", words)]
    names = list(dict.fromkeys(key.removesuffix(".verdict") for row in done for key in row if key.endswith(".verdict")))
    joints, lost = [], []
    for row in rows:
        label = row["key"] if row["serial"] in ("", row["key"]) else f"{row['key']} ({row['serial']})"
        label = foreign(label if len(label) <= _MOST_LETTERS else f"{label[: _MOST_LETTERS - 1]}…")
        if row["status"] != DONE:
            lost.append((label, row["status"], foreign(row["error"])))
            continue
        doubts = ["not converged"] * (not row["converged"])
        doubts += ["the model does not explain the data"] * (row["explains"] is False)
        joints.append((label, *(_known(row, name) for name in names[:_MOST_STIFFNESSES]), "; ".join(doubts)))
    more = f" The page shows {_MOST_ROWS} joints and {_MOST_STIFFNESSES} stiffnesses at most; `{INDEX}` has all."
    if joints:
        note = f"95 % intervals, each joint from its own test alone. Its report: `{CASES}/NAME/report.html`."
        note += more if len(joints) > _MOST_ROWS or len(names) > _MOST_STIFFNESSES else ""
        head, cells = ("Joint", *map(foreign, names[:_MOST_STIFFNESSES]), "Doubts"), tuple(joints[:_MOST_ROWS])
        kinds = tuple("bad" if cell[-1] else "" for cell in cells)
        blocks.append(Table("Joints", head, cells, align="l" * len(head), note=note, row_kinds=kinds))
    if lost:
        note = more.strip() if len(lost) > _MOST_ROWS else ""
        blocks.append(Table("Not done", ("Joint", "Status", "Why"), tuple(lost[:_MOST_ROWS]), align="lll", note=note))
    versions = Table("Versions", ("Item", "Value"), (("jointbayes", foreign(code_version())),), align="ll")
    settings = (ReportSection("settings", "Settings and versions", (versions,)),)
    title = foreign(name) if name.casefold().startswith("campaign") else f"Campaign {foreign(name)}"
    return Report(title, "Stiffness of many joints, each by itself", tuple(blocks), settings)


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
