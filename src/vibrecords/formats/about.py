"""What the head of a measurement file says of the test: specimen, day, operator, instruments."""

import re
from collections.abc import Iterable, Iterator
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import Any

from vibrecords.formats.names import NAMES
from vibrecords.formats.read import detect_format
from vibrecords.formats.table_text import plain_text
from vibrecords.formats.uff_data_sets import scan
from vibrecords.records import refuse_damage

_LINE = re.compile(r"[\s#%;*/\"']*([A-Za-z][A-Za-z ._]{1,30}?)\s*[:=\t,;]\s*(.*?)[\s,;\"']*")
_ORDERS = ("%Y-%m-%d", "%Y/%m/%d", "%d-%b-%y", "%d-%b-%Y", "%d.%m.%Y", "%d %b %Y", "%d %B %Y", "%Y%m%d")
_HEAD, _LONGEST, _MOST_SETS = 40, 200, 50


def about_file(path: str | Path) -> dict[str, str]:
    """What a file says of its test: ``specimen``, ``date`` (as 2026-11-25), ``operator``, ``instruments``.

    Universal files say it in data sets 151 and the ID lines of 58, LVM and tables in the lines above the numbers, TDMS
    in the properties of the file. A day whose order is not plain, as 03/04/2026, is left out; so is what is not there.

    Parameters
    ----------
    path
        The file; of formats that say nothing of a test nothing is read.

    Raises
    ------
    MeasurementError
        If the file cannot be read.
    """
    path, about = Path(path), dict[str, str]()
    kind = detect_format(path)
    pairs = {"uff": _of_uff, "tdms": _of_tdms, "lvm": _of_text, "table": _of_text}.get(kind, lambda _path: ())
    for words, text in pairs(path):
        key = next((key for key, known in NAMES["about"].items() if re.fullmatch(known, words.strip().lower())), "")
        value = _day(text) if key == "date" else " ".join(text.split())[:_LONGEST]
        if key and value and value.isprintable() and value.lower() not in ("none", "n/a", "unknown"):
            about.setdefault(key, value)
    return about


def _day(text: str) -> str:
    """A day as 2026-11-25; empty where the text is none, or may be two."""
    for words in (text.strip().replace("T", " ").split(" ")[0], text.strip()):
        for order in _ORDERS:
            try:
                return datetime.strptime(words, order).date().isoformat()
            except ValueError:
                continue
    return ""


def _pairs(lines: Iterable[str]) -> Iterable[tuple[str, str]]:
    return [(found[1], found[2]) for line in lines if (found := _LINE.fullmatch(line))]


def _of_text(path: Path) -> Iterable[tuple[str, str]]:
    with path.open("rb") as file:
        return _pairs(plain_text(line) for line in islice(iter(lambda: file.readline(300), b""), _HEAD))


def _of_uff(path: Path) -> Iterator[tuple[str, str]]:
    with path.open("rb") as file:
        for data_set in scan(file):
            if data_set.number > _MOST_SETS:
                return
            behind = file.tell()
            if data_set.kind == 151:
                file.seek(data_set.start)
                lines = [plain_text(file.readline(200)).strip() for _ in range(4)]
                if lines[0].lower() not in lines[2].lower() and lines[0] != "jointbayes":  # the name of the program
                    yield "specimen", lines[0]
                yield "date", lines[3].split(" ")[0]
            if data_set.header is not None:
                yield from _pairs(data_set.header.ids)
                yield "date", data_set.header.ids[2]
            file.seek(behind)


def _of_tdms(path: Path) -> Iterator[tuple[str, str]]:
    import nptdms  # where it is missing, that was said as the records were read

    with refuse_damage(str(path), "a TDMS file; copy or export it again"):
        told: dict[str, Any] = dict(nptdms.TdmsFile.read_metadata(path).properties)
    for name, value in told.items():
        yield str(name).replace("_", " "), str(value)
