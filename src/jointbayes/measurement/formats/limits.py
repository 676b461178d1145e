"""How large a measurement file may be: far beyond any measurement, so that no file takes hours or all memory."""

from jointbayes.errors import MeasurementError

#: Bytes of a file; the largest that was tried, a universal file of 10 000 FRFs, has 2 GB.
MOST_BYTES = 16 * 2**30
#: FRFs and time histories in a file; data sets of other types count in a universal file.
MOST_RECORDS = 100_000
#: Averages of an FRF.
MOST_AVERAGES = 10**6
#: Columns of a table.
MOST_COLUMNS = 50_000
#: Characters of a channel label or a unit.
LONGEST_LABEL = 300


def require_short(where: str, *labels: str) -> None:
    """Refuse labels and units that are none.

    Raises
    ------
    MeasurementError
        If one is longer than `LONGEST_LABEL`.
    """
    for label in labels:
        if len(label) > LONGEST_LABEL:
            raise MeasurementError(
                f"{where}: found a name of {len(label)} characters ({label[:20]!r}…); expected at most "
                f"{LONGEST_LABEL}; shorten it"
            )
