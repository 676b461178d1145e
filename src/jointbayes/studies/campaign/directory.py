"""The directory of a campaign: what is in it, and who may write to it."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jointbayes.errors import CaseError, MeasurementError, WriteError
from jointbayes.studies.campaign.cases import DONE, INDEX
from jointbayes.studies.campaign.index import LINES
from jointbayes.whole_file import LOCK

if TYPE_CHECKING:
    from jointbayes.posterior import Posterior

__all__ = ["Campaign", "require_campaign_directory"]

_BEGUN = {LOCK, "cases", LINES}  # what a campaign that was cut off before its first index may have left


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


def require_campaign_directory(directory: str | os.PathLike[str]) -> Path:
    """Make the directory of a campaign, or find an earlier one there.

    Raises
    ------
    CaseError
        If something else is there.
    WriteError
        If it cannot be made or written to.
    """
    target = Path(directory)
    remedy = "expected a new directory or that of an earlier campaign; choose another --out"
    if target.is_dir():
        inside = {entry.name for entry in target.iterdir()}
        if not (target / INDEX).is_file() and not inside <= _BEGUN:
            raise CaseError(f"{target}: found a directory that holds other files; {remedy}")
    elif os.path.lexists(target):
        raise CaseError(f"{target}: found a file; {remedy}")
    try:
        target.mkdir(parents=True, exist_ok=True)
        if not os.access(target, os.W_OK | os.X_OK):
            raise PermissionError(13, "Permission denied")
    except OSError as error:
        raise WriteError(f"{target}: found that it cannot be written ({error.strerror}); {remedy}") from error
    return target
