"""Reductions of large models kept on the disk, each by a hash of what it depends on: the next run reads it."""

import hashlib
import io
import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from jointbayes.structure.damping import LossFactor, ViscousMatrix
from jointbayes.structure.imported.imported_body import ImportedRecipe
from jointbayes.structure.imported.outline import Outline
from jointbayes.structure.imported.reduction import ReducedModel, ReducedPart
from vibrecords.errors import UserError
from vibrecords.files import write_whole_file

#: A reduction of fewer DOFs takes no time.
_LARGE = 5000
#: Of what writes another reduction, or other files of it.
_VERSION = "1"
_MOST = 20  # kept files
_PLAIN = ("stiffness", "mass", "motions", "seen")


def key_of(files: Iterable[Path], *options: object) -> str:
    """Hash of the contents of files and of options, by which a reduction is known."""
    digest = hashlib.sha256(_VERSION.encode())
    for file in files:
        with file.open("rb") as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    digest.update(repr(options).encode())
    return digest.hexdigest()


def place() -> Path:
    """The directory of kept reductions, in the user's own cache."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "jointbayes" / "reduced"


def kept_or_made(size: int, key: Callable[[], str], make: Callable[[], ImportedRecipe]) -> ImportedRecipe:
    """The reduction of a large model from the disk, or made and kept there; a cache that cannot be used is passed over.

    Parameters
    ----------
    size
        Number of DOFs of the model.
    key
        See `key_of`.
    make
        Makes it.
    """
    if size < _LARGE:
        return make()
    file = place() / f"{key()}.npz"
    with suppress(OSError, ValueError, KeyError, EOFError, BadZipFile):  # none, or damaged: made again
        return _read(file)
    recipe = make()
    with suppress(OSError, UserError):  # a cache that cannot be written is none
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole_file(file, _bytes_of(recipe))
        for old in sorted(file.parent.glob("*.npz"), key=lambda one: -one.stat().st_mtime)[_MOST:]:
            old.unlink()
    return recipe


def _bytes_of(recipe: ImportedRecipe) -> bytes:
    arrays: dict[str, Any] = {}
    for name in ("reduced", "finer"):
        of = getattr(recipe, name)
        arrays |= {f"{name}/{part}": getattr(of, part) for part in _PLAIN}
        arrays[f"{name}/rigid"] = np.array(of.rigid)
        if of.damping is not None:
            arrays[f"{name}/damping"] = of.damping
        for part, matrices in of.parts.items():
            arrays |= {f"{name}/parts/{part}/{f.name}": getattr(matrices, f.name) for f in fields(matrices)}
    places = np.array(list(recipe.positions.values())).reshape(-1, 3)
    arrays |= {"places": places, "numbers": np.array([recipe.top_hz, recipe.size])}
    texts = {"dofs": recipe.dofs, "points": tuple(recipe.positions), "source": (recipe.source,)}
    arrays |= {name: np.array(words) for name, words in texts.items()}
    if recipe.outline is not None:
        arrays |= {"outline": recipe.outline.places, "lines": recipe.outline.lines}
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def _read(file: Path) -> ImportedRecipe:
    with np.load(io.BytesIO(file.read_bytes()), allow_pickle=False) as stored:
        arrays = {name: stored[name] for name in stored.files}

    def model(name: str) -> ReducedModel:
        names = dict.fromkeys(key.split("/")[2] for key in arrays if key.startswith(f"{name}/parts/"))
        parts = {
            part: ReducedPart(*(arrays[f"{name}/parts/{part}/{f.name}"] for f in fields(ReducedPart))) for part in names
        }
        stiffness, mass, motions, seen = (arrays[f"{name}/{part}"] for part in _PLAIN)
        rigid, damping = int(arrays[f"{name}/rigid"]), arrays.get(f"{name}/damping")
        return ReducedModel(stiffness, mass, motions, rigid, damping, parts, seen)

    top_hz, size = arrays["numbers"].tolist()
    dofs, points = (tuple(map(str, arrays[name])) for name in ("dofs", "points"))
    positions = dict(zip(points, map(tuple, arrays["places"].tolist()), strict=True))
    reduced, finer, source = model("reduced"), model("finer"), str(arrays["source"][0])
    outline = Outline(arrays["outline"], arrays["lines"], reduced.seen) if "outline" in arrays else None
    recipe = ImportedRecipe(
        reduced, finer, dofs, top_hz, LossFactor(0.0), source, int(size), positions, outline=outline
    )
    own = recipe.reduced.damping
    return recipe if own is None else replace(recipe, damping=ViscousMatrix(own))
