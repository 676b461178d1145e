"""Measurement files of all formats: what `inspect` and `read_frf` make of them."""

import random
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

from tests.fuzz.files import arrays, text
from tests.fuzz.target import Target


class FileTarget(Target):
    """A format of measurement files."""

    def __init__(self, name: str, damage: Callable[[random.Random, bytes], bytes]) -> None:
        self.name, self._damage = name, damage
        self.suffix = f".{name}"

    def mutate(self, rng: random.Random, content: bytes) -> bytes:
        """One to three damages that leave some of the format's structure."""
        return self._damage(rng, content)

    def prepare(self, directory: Path) -> None:
        """Load what readers and inspection load when they need it."""
        for path in self.corpus()[:6]:
            self._attempted(path)

    def attempt(self, path: Path) -> None:
        """Inspect the file and read its FRFs."""
        error = self._attempted(path)
        if error is not None:
            raise error

    def _attempted(self, path: Path) -> Exception | None:
        from jointbayes.errors import MeasurementError
        from vibrecords.formats import read_frf
        from vibrecords.inspection import contents_text, inspect_file, resonances_text

        refused: MeasurementError | None = None
        try:
            inspection = inspect_file(path, 2.0)
        except MeasurementError as error:
            refused = error
        else:
            list(contents_text(inspection))
            list(resonances_text(inspection))
            _maybe_drawn(inspection, path)
        try:
            read_frf(path)
        except MeasurementError as error:
            refused = refused or error
        return refused

    def message_fault(self, message: str, path: Path) -> str:
        """As for all targets; a blank of another width is as good as a blank."""
        from vibrecords.errors import printable

        return super().message_fault("".join(" " if c.isspace() and printable(c) == c else c for c in message), path)


def _maybe_drawn(inspection: Any, path: Path) -> None:
    """Of one file in a hundred the figure as well, which takes longer than all the rest."""
    if sha256(path.read_bytes()).digest()[0] >= 3:
        return
    from jointbayes.report.inspect_figure import inspect_figure

    traces = [(f"{t.channel} hit {t.hit.number}", t.hit.reason, t.time_s, t.force_n) for t in inspection.hits]
    inspect_figure(inspection.frfs, inspection.modes, traces)


TARGETS = [
    FileTarget("uff58", text.damaged_uff),
    FileTarget("uff58b", text.damaged_uff),
    FileTarget("csv", text.damaged_table),
    FileTarget("tsv", text.damaged_table),
    FileTarget("lvm", text.damaged_lvm),
    FileTarget("npz", arrays.damaged_npz),
    FileTarget("mat", arrays.damaged_mat),
    FileTarget("mat73", arrays.damaged_mat73),
    FileTarget("hdf5", arrays.damaged_hdf5),
]
