"""Modes in a file of arrays under the names that pyOMA gives them: Fn, Xi, Phi and their standard deviations."""

from collections.abc import Iterator

import numpy as np

from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.named_arrays import Block, size_of
from jointbayes.measurement.records import HIGHEST_HZ, ModeRecord


def mode_records(block: Block) -> Iterator[ModeRecord]:
    """Modes of a block: frequencies ``Fn``, Hz, damping ratios ``Xi``, shapes ``Phi`` (channels x modes).

    Raises
    ------
    MeasurementError
        If a frequency is none, or shapes do not agree.
    """
    if not size_of(block.get("fn")):
        return
    of_modes = {key: block.numbers(key).ravel() for key in ("fn", "fn_std", "xi", "xi_std") if size_of(block.get(key))}
    frequency, notes, where = of_modes["fn"], [], block.where("fn")
    count = frequency.size
    shapes = block.numbers("phi", np.complex128) if size_of(block.get("phi")) else np.empty((0, count))
    shapes = shapes.reshape(-1, 1) if shapes.ndim == 1 and count == 1 else shapes
    if shapes.ndim == 2 and shapes.shape[0] == count > 1:
        square = shapes.shape[1] == count
        notes.append("square shapes read as channels x modes" if square else "shapes read as modes x channels")
        shapes = shapes if square else shapes.T
    sizes = {key: values.size for key, values in of_modes.items()}
    if shapes.ndim != 2 or shapes.shape[1] != count or set(sizes.values()) != {count}:
        raise MeasurementError(
            f"{where}: found {sizes} values and shapes 'Phi' of shape {shapes.shape}; expected one of each for each of "
            f"{count} modes, channels x modes; correct them"
        )
    if not ((frequency >= 0) & (frequency <= HIGHEST_HZ)).all():
        raise MeasurementError(f"{where}: found no frequencies; expected 0 to {HIGHEST_HZ:g} Hz; leave the others out")
    doubtful = [key for key in ("Fn_cov", "Xi_cov") if block.has(key.lower())]
    notes += [f"{key} not taken: a variance or a relative one" for key in doubtful]
    if "xi" in of_modes and not (np.abs(of_modes["xi"]) < 1).all():
        notes.append("Xi not taken: above critical, or in percent")
        of_modes = {key: values for key, values in of_modes.items() if "xi" not in key}
    labels = block.strings("dofs") or block.strings("channels") or [f"channel {i + 1}" for i in range(len(shapes))]
    if len(set(labels)) != len(shapes):
        found = f"found {len(labels)} channels for {len(shapes)} rows"
        raise MeasurementError(f"{block.where('phi')}: {found}; expected one for each; correct them")
    for i in range(count):
        sd, ratio, ratio_sd = (float(of_modes[k][i]) if k in of_modes else None for k in ("fn_std", "xi", "xi_std"))
        shape, place = dict(zip(labels, shapes[:, i].tolist(), strict=True)), f"{where}, mode {i + 1}"
        yield ModeRecord(i + 1, float(frequency[i]), sd, ratio, ratio_sd, shape, None, place, tuple(notes))
