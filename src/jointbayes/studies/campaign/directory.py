"""The directory of a campaign: what is in it, and who may write to it."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jointbayes.errors import MeasurementError
from jointbayes.own_directory import MARK, OwnDirectory
from jointbayes.studies.campaign.cases import DONE, INDEX

if TYPE_CHECKING:
    from jointbayes.posterior import Posterior


_KIND = "a campaign"


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
        from pyarrow import parquet

        return parquet.read_table(self._file).to_pandas().set_index("key", drop=False)

    @property
    def _file(self) -> Path:
        file = self.directory / INDEX
        if not file.is_file():
            raise MeasurementError(f"{file}: no such file; expected the directory of a campaign; give one")
        return file

    def posterior(self, key: str) -> "Posterior":
        """Posterior of one case.

        Raises
        ------
        MeasurementError
            If the case is not done, or there is no such case.
        """
        from jointbayes.workflow import load_posterior

        rows = self.index
        if key not in rows.index:
            raise MeasurementError(f"{self._file}: found no case {key!r}; expected one of its {len(rows)} keys")
        row = rows.loc[key]
        if row["status"] != DONE:
            raise MeasurementError(f"{self._file}: case {key!r}: found that it {row['status']}: {row['error']}")
        return load_posterior(self.directory / row["file"])


def campaign_directory(directory: str | os.PathLike[str]) -> OwnDirectory:
    """The directory of a campaign, new or of an earlier start; entered, it keeps other processes out."""
    remedy = f"choose another --out; of one that an older jointbayes made, write 'jointbayes: {_KIND}' into its {MARK}"
    return OwnDirectory(directory, _KIND, remedy)
