"""A campaign: what is still to do, who does it, what a worker does for a case, and what is on the disk of it."""

import hashlib
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jointbayes.errors import MeasurementError, ModelError
from jointbayes.posterior import Posterior
from jointbayes.posterior.posterior import Cell
from jointbayes.progress import Progress, ProgressCallback, callback_of
from jointbayes.reproducibility import code_version
from jointbayes.studies.campaign.campaign_report import write_campaign_report
from jointbayes.studies.campaign.case_table import CampaignCase, read_cases
from jointbayes.studies.campaign.index import (
    COLUMNS,
    DONE,
    FAILED,
    INDEX,
    KILLED,
    Row,
    campaign_directory,
    kept_rows,
    read_index,
    rows_of_campaign,
    write_index,
)
from jointbayes.studies.study_directory import append_line
from jointbayes.studies.workers import Outcome, run_tasks
from jointbayes.workflow import load_posterior
from vibrecords.files import real_directory, sweep

if TYPE_CHECKING:
    from distributed import Client


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
