"""What is known of keys by their names: units at their end, and which of them name files."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

#: Units at the end of a key: what each measures, its size in SI, and how it reads.
UNITS = {
    "m": ("length", 1.0, "in m"),
    "in": ("length", 0.0254, "in inches"),
    "cm": ("length", 1e-2, "in cm"),
    "mm": ("length", 1e-3, "in mm"),
    "um": ("length", 1e-6, "in µm"),
    "pa": ("pressure", 1.0, "in Pa"),
    "mpa": ("pressure", 1e6, "in MPa"),
    "gpa": ("pressure", 1e9, "in GPa"),
    "psi": ("pressure", 6894.757, "in psi"),
    "ksi": ("pressure", 6.894757e6, "in ksi"),
    "kpa": ("pressure", 1e3, "in kPa"),
    "hz": ("frequency", 1.0, "in Hz"),
    "khz": ("frequency", 1e3, "in kHz"),
    "kg": ("mass", 1.0, "in kg"),
    "g": ("mass", 1e-3, "in g"),
    "s": ("time", 1.0, "in s"),
    "ms": ("time", 1e-3, "in ms"),
    "n": ("force", 1.0, "in N"),
    "kn": ("force", 1e3, "in kN"),
    "n_per_m": ("stiffness", 1.0, "in N/m"),
    "kn_per_m": ("stiffness", 1e3, "in kN/m"),
    "n_per_mm": ("stiffness", 1e3, "in N/mm"),
    "kn_per_mm": ("stiffness", 1e6, "in kN/mm"),
    "n_per_um": ("stiffness", 1e6, "in N/µm"),
    "n_s_per_m": ("viscous damping", 1.0, "in N·s/m"),
    "n_s_per_mm": ("viscous damping", 1e3, "in N·s/mm"),
    "kg_m2": ("inertia", 1.0, "in kg·m²"),
    "kg_cm2": ("inertia", 1e-4, "in kg·cm²"),
    "kg_mm2": ("inertia", 1e-6, "in kg·mm²"),
    "kg_m3": ("density", 1.0, "in kg/m³"),
    "g_cm3": ("density", 1e3, "in g/cm³"),
    "t_mm3": ("density", 1e12, "in t/mm³"),
    "kg_mm3": ("density", 1e9, "in kg/mm³"),
    "lb_in3": ("density", 27679.9, "in lb/in³"),
    "percent": ("fraction", 1e-2, "in percent"),
    "relative": ("fraction", 1.0, "as a fraction"),
    "ratio": ("fraction", 1.0, "as a fraction"),
    "factor": ("factor", 1.0, "as a factor"),
    "log": ("logarithm", 1.0, "as a logarithm"),
}


def unit_of(key: str) -> str:
    """The unit at the end of a key, as `UNITS` has it, the longest; a fraction may be the whole key."""
    words = key.lower().split("_")
    ends = ["_".join(words[i:]) for i in range(1, len(words))]
    whole = key if key in UNITS and UNITS[key][0] == "fraction" else ""
    return next((end for end in ends if end in UNITS), whole)


def stem_of(key: str) -> str:
    """A key without its unit: nothing of one that is a unit, as ``relative`` and ``percent``."""
    return key[: len(key) - len(unit_of(key))].rstrip("_")


def same_stem(key: str, keys: Iterable[str]) -> str | None:
    """The key that differs in its unit alone, one whose unit measures the same first; None where none does."""
    alike = [name for name in keys if key == name or stem_of(name) == stem_of(key)]
    kind = UNITS.get(unit_of(key), ("",))[0]
    return min(alike, key=lambda name: (name != key, UNITS.get(unit_of(name), ("",))[0] != kind), default=None)


def other_units(unit: str) -> list[tuple[str, float]]:
    """Units that measure the same as one: how each reads, and the factor from a number in it to one in this unit."""
    kind, size, _ = UNITS[unit]
    return [(words, given / size) for other, given, words in UNITS.values() if other == kind and given != size]


_Path = tuple[str, ...]
_ANY = "*"  # each key of a table
DATA_FILE = ("data", "file")
_KEYS: tuple[_Path, ...] = (
    DATA_FILE,
    ("bodies", _ANY, "file"),
    ("structure", "stiffness"),  # and so on: numbers, or the name of a file
    ("structure", "mass"),
    ("structure", "damping", "damping_matrix"),
    *(("structure", key) for key in ("file", "mass_file", "damping_file", "dofs_file", "nodes_file")),
    *(("structure", "parts", _ANY, key) for key in ("file", "mass_file", "bending_file")),
)
#: Tables that state the same keys again, as tables of the file.
_WITHIN: tuple[_Path, ...] = ((), ("setups", _ANY), ("plan", "setups", _ANY))


def named_files(data: Mapping[str, Any]) -> dict[_Path, _Path]:
    """Names of files that the tables of a case state, by key; not those of its set-ups."""
    names: dict[_Path, _Path] = {}

    def note(path: _Path, name: str) -> str:
        names[path] = (*names.get(path, ()), name)
        return name

    for key in _KEYS:
        _changed(data, (), key, note)
    return names


def rename_files(data: Mapping[str, Any], change: Callable[[str], str]) -> dict[str, Any]:
    """Tables of a case file as they are read, with every name of a file changed.

    Parameters
    ----------
    data
        What the text is parsed to; not necessarily a case.
    change
        Gives the new name of a file.
    """
    whole: Any = dict(data)
    for within in _WITHIN:
        for key in _KEYS:
            whole = _changed(whole, (), (*within, *key), lambda _, name: change(name))
    return dict(whole)


def _changed(value: Any, path: _Path, key: _Path, change: Callable[[_Path, str], str]) -> Any:  # noqa: ANN401 (TOML)
    """A value at a path with the names of files changed that stand at a key below it."""
    if not key:
        if isinstance(value, list | tuple):
            return [change(path, entry) if isinstance(entry, str) else entry for entry in value]
        return change(path, value) if isinstance(value, str) else value
    if not isinstance(value, Mapping):
        return value
    first, *rest = key
    names = value if first == _ANY else {first} & value.keys()
    return {**value, **{name: _changed(value[name], (*path, name), tuple(rest), change) for name in names}}
