"""A campaign on the disk: its index as a table, its report, the posterior of each case."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jointbayes.errors import MeasurementError
from jointbayes.posterior import Posterior
from jointbayes.studies.campaign.campaign_report import write_campaign_report
from jointbayes.studies.campaign.index import COLUMNS, DONE, INDEX, read_index, rows_of_campaign
from jointbayes.workflow import load_posterior


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
