"""Records of a measurement file, whatever its format."""

from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

from jointbayes.errors import MeasurementError
from jointbayes.frf import FrfSet, Quantity
from jointbayes.measurement.formats.arrays.layout import Arrays, records_of
from jointbayes.measurement.formats.arrays.read import read_isolated, read_npz
from jointbayes.measurement.formats.detect import detect_format
from jointbayes.measurement.formats.grid import in_band, join_frfs
from jointbayes.measurement.formats.limits import MOST_RECORDS, require_short
from jointbayes.measurement.formats.lvm import read_lvm
from jointbayes.measurement.formats.table import read_table
from jointbayes.measurement.formats.uff.read import read_uff
from jointbayes.measurement.records import FrfRecord, Record


def iter_records(path: str | Path) -> Iterator[Record]:
    """FRFs and time histories of a file, one after the other, in SI units and otherwise as the file has them.

    Parameters
    ----------
    path
        UFF, MAT, CSV or TSV, npz, HDF5 or LVM; told apart by content.

    Yields
    ------
    FrfRecord or TimeRecord
        A universal file is streamed: no more than one record is in memory.

    Raises
    ------
    MeasurementError
        One line that names the file, the place in it, and what is expected.
    """
    path = Path(path)
    found = 0
    kind = detect_format(path)
    try:
        with closing(_READERS[kind](path)) as records:  # a reading process ends here, whatever happens
            for record in records:
                found += 1
                if found > MOST_RECORDS:
                    raise MeasurementError(
                        f"content: found more than {MOST_RECORDS} FRFs and time histories; expected fewer; split it"
                    )
                require_short(record.where[:60], *_names(record))
                yield record
    except MeasurementError as error:
        raise MeasurementError(f"{path}: {error}") from None
    except OSError as error:
        raise MeasurementError(
            f"{path}: found a fault on reading ({error}); expected a readable file; copy it again"
        ) from None
    if not found:
        raise MeasurementError(
            f"{path}: found neither FRFs nor time histories; expected variables such as 'frequency_hz' and 'frf'; "
            "see the layout in the documentation of measurement files"
        )


def _names(record: Record) -> tuple[str, ...]:
    if isinstance(record, FrfRecord):
        return record.response, record.reference, record.unit
    return record.channel, record.unit


def read_frf(
    path: str | Path,
    *,
    f_min_hz: float | None = None,
    f_max_hz: float | None = None,
    quantity: Quantity | None = None,
) -> FrfSet:
    """FRFs of a file as one set; outputs and inputs are the file's channel labels.

    Parameters
    ----------
    path
        File in any of the formats.
    f_min_hz, f_max_hz
        Lines outside the band are cut away before anything is checked.
    quantity
        What the FRFs are, whatever the file says.

    Raises
    ------
    MeasurementError
        As `iter_records`, and if the FRFs do not form one set.
    """
    frfs = (record for record in iter_records(path) if isinstance(record, FrfRecord))
    cut = (in_band(record, str(path), f_min_hz, f_max_hz) for record in frfs)
    return join_frfs((replace(r, quantity=quantity) if quantity else r for r in cut), str(path))


def _blocks(
    read: Callable[[Path], Generator[tuple[str, Arrays], None, None]],
) -> Callable[[Path], Generator[Record, None, None]]:
    def records(path: Path) -> Generator[Record, None, None]:
        with closing(read(path)) as blocks:
            for place, arrays in blocks:
                yield from records_of(arrays, place)

    return records


_READERS: dict[str, Callable[[Path], Generator[Record, None, None]]] = {
    "uff": read_uff,
    "table": read_table,
    "npz": _blocks(read_npz),
    "mat": _blocks(partial(read_isolated, kind="mat")),
    "mat73": _blocks(partial(read_isolated, kind="mat73")),
    "hdf5": _blocks(partial(read_isolated, kind="hdf5")),
    "lvm": read_lvm,
}
