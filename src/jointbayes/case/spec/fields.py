"""Building blocks of the tables of a case file: described fields, findings, limits, DOF labels, the base model.

What is known of keys by their names: units at their end, and which of them name files.
"""

from __future__ import annotations

import itertools
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from types import UnionType
from typing import Annotated, Any, ClassVar, NamedTuple, Self, TypeVar

import pydantic
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, Strict
from pydantic_core import PydanticCustomError

from jointbayes.errors import JointBayesError
from jointbayes.joint import COUPLED

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


T = TypeVar("T")
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
_WITHIN: tuple[_Path, ...] = ((), ("tests", _ANY))


def named_files(data: Mapping[str, Any]) -> dict[_Path, _Path]:
    """Names of files that the tables of a case state, by key; not those of its tests."""
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


class Later:
    """A module that is imported where something of it is first asked for, as it takes NumPy."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 (anything the module has)
        return getattr(import_module(self._name), name)


KeyPath = tuple[str | int, ...]
_LONGEST = 40  # characters of a user's own text repeated in a message


@dataclass(frozen=True)
class Finding:
    """A fault found by a rule of the schema, placed relative to the value the rule looks at.

    ``expected`` may stay empty where the description of the field says it; a ``missing`` finding needs
    nothing but its place.
    """

    loc: KeyPath
    found: str = ""
    expected: str = ""
    remedy: str = ""
    missing: bool = False


def raise_findings(findings: Iterable[Finding]) -> None:
    """Raise what a schema rule found, if anything, as one `PydanticCustomError` that carries it all."""
    every = list(findings)
    if every:
        text = " | ".join(f"{show_key(f.loc)}: {f.found or 'missing'}; {f.expected}" for f in every)
        raise PydanticCustomError("case_findings", "{text}", {"text": text, "findings": every})


def show_key(path: Sequence[str | int]) -> str:
    """Write a key path as in the file; list positions are left to the text of the message."""
    parts = [p for p in path if isinstance(p, str)]
    return ".".join(p if re.fullmatch(r"[A-Za-z0-9_-]{1,60}", p) else quoted(p) for p in parts) or "file"


def quoted(text: str) -> str:
    """A text of the user in quotes, on one line and not too long."""
    shown = text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
    return f'"{shown}"' if shown.isprintable() else json.dumps(shown)


#: Of the sampler: beyond these a run fills the memory of any computer, or never ends.
MOST_ENSEMBLES, MOST_WALKERS, MOST_STEPS = 64, 10_000, 10_000_000
#: Entries of lists: DOFs of 501 points with 5 each; ratios, each of which may be uncertain; files.
MOST_LABELS, MOST_RATIOS, MOST_FILES = 2505, 100, 1000
#: Values of the FRFs of synthetic data: more fill the memory.
MOST_VALUES = 10_000_000


class Limits(NamedTuple):
    """The smallest and the largest magnitude of some keys, in their unit; zero is for the keys themselves to allow."""

    keys: str
    least: float
    most: float


#: One row for each kind of number.
TABLE = (
    Limits("length_mm spacing_mm offset_mm offset_against_mm", 1e-3, 1e6),
    Limits("diameter_mm outer_diameter_mm inner_diameter_mm width_mm height_mm wall_mm", 1e-3, 1e5),
    Limits("youngs_modulus_gpa", 1e-6, 1e15),
    Limits("density_kg_m3", 1e-9, 1e9),
    Limits("accelerometer_mass_g added_mass_g", 1e-12, 1e9),
    Limits("mass_kg masses_kg", 1e-12, 1e9),
    Limits("inertia_kg_m2", 1e-30, 1e9),
    Limits("points offsets_mm offset_mm box_mm at_mm place_mm sensors_mm directions", 1e-30, 1e9),
    Limits("node nodes", 1.0, 1e9),
    Limits("up", 1e-30, 1e30),
    Limits("stiffness_n_per_m damping_n_s_per_m", 1e-12, 1e15),
    Limits("stiffness mass damping_matrix", 1e-100, 1e100),
    Limits("loss_factor", 1e-12, 100.0),
    Limits("alpha_per_s", 1e-12, 1e9),
    Limits("beta_s", 1e-20, 1e3),
    Limits(f"{' '.join(quantity.name for quantity in COUPLED)} stiffness low high median guess mean sd", 1e-12, 1e15),
    Limits("sd_log decades", 1e-6, 100.0),
    Limits("sd_percent", 1e-6, 100.0),
    Limits("identified weakly_identified", 1.0, 1e6),
    Limits("contraction", 1e-3, 1.0),
    Limits("sd_mm low_mm high_mm", 1e-6, 1e6),
    Limits("low_factor high_factor scale_low_factor scale_high_factor", 1e-6, 1e6),
    Limits("scale_low scale_high scale_guess averages_factor", 1e-6, 1e6),
    Limits("dof scale_dof", 1e-6, 1e9),
    Limits("f_min_hz f_max_hz f_step_hz top_hz frequencies_hz natural_frequencies_hz exclude_hz bands_hz", 1e-6, 1e9),
    Limits("sd_hz length_low_hz length_high_hz sample_rate_hz", 1e-6, 1e9),
    Limits("relative floor", 1e-15, 1e3),
    Limits("sd_relative damping_sd_relative damping_ratios damping_sd force_noise response_noise", 1e-15, 10.0),
    Limits("frequency_error damping_error shape_error constant_error edge_error spring_error scatter", 1e-9, 10.0),
    Limits("error_factor spring_factor scatter_factor", 1.0, 1e3),
    Limits("eigenvalues eigenvalue_sd", 1e-12, 1e20),
    Limits("components values_per_kg sd_per_kg", 1e-15, 1e15),
    Limits("gain sensitivity", 1e-12, 1e12),
    Limits("coherence", 1e-6, 1.0),
    Limits("threshold", 1e-30, 1e3),
    Limits("line_weight", 1e-6, 10.0),
    Limits("block_s pretrigger_s force_window_s", 1e-9, 1e6),
    Limits("force_range_n axial_force_n", 1e-12, 1e12),
    Limits("kt_mpa kr", 1e-6, 1e6),
    Limits("speed_min_rpm speed_max_rpm", 1e-3, 1e9),
)

#: Limits by key.
LIMITS: Mapping[str, Limits] = {key: limits for limits in TABLE for key in limits.keys.split()}


def limit_text(value: float) -> str:
    """A limit as it stands in messages and in the documentation: 0.001, 100, 1e6."""
    mantissa, e, exponent = f"{value:g}".partition("e")
    return f"{mantissa}e{int(exponent)}" if e else (mantissa if value < 1e4 else f"1e{len(mantissa) - 1}")


def entries_of(kind: type[T] | UnionType, value: object, place: KeyPath = ()) -> Iterator[tuple[KeyPath, T]]:
    """Yield place and value of each entry of a kind in lists and tables; true and false are no numbers."""
    if isinstance(value, kind) and not isinstance(value, bool):
        yield place, value
        return
    parts = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list | tuple) else ()
    for key, entry in parts:
        yield from entries_of(kind, entry, (*place, key))


def key_field(description: str, example: object, default: Any = ..., **limits: Any) -> Any:  # noqa: ANN401 (as pydantic's)
    """Field with what is expected of it, and an example; without a default the key has to be there."""
    return Field(default, description=description, examples=[example], **limits)


def table_field(description: str, default: Any = ..., **limits: Any) -> Any:  # noqa: ANN401 (as pydantic's)
    """Field of a table, of which no example fits a line."""
    return Field(default, description=description, **limits)


def either(words: Iterable[str]) -> str:
    """Texts a key may be: one, another or a third."""
    *first, last = words
    return f"{', '.join(first)} or {last}" if first else last


def ascii_unit(unit: str) -> str:
    """A unit as messages print it: ``"N m/rad"``, ``"no unit"``."""
    return "no unit" if unit == "1" else unit.replace("·", " ")


OWN = key_field("true (each test has its own) or false (one for all tests)", True)
JOINED = key_field("false (nothing is joined: the free structure) or true (every joint acts)", False)
DATA_KIND = key_field(
    'the kind of data, "synthetic_frf", "natural_frequencies", "modes", "measured_frf" or "measured_frequencies"',
    "synthetic_frf",
)
ESTIMATOR = key_field('the estimator of the FRFs, "H1", "H2" or "Hv"', "H1")
FREQUENCIES = key_field("the frequencies in Hz, a list of numbers above 0 that increase", [120.0, 762.0])


def positive(what: str, example: float, default: Any = ...) -> Any:  # noqa: ANN401 (as pydantic's)
    """Field for a number above zero."""
    return key_field(f"{what}, a number greater than 0", example, default, gt=0)


def not_negative(what: str, example: float, default: Any = ...) -> Any:  # noqa: ANN401 (as pydantic's)
    """Field for a number of at least zero."""
    return key_field(f"{what}, a number of at least 0", example, default, ge=0)


def count_field(what: str, example: int, least: int, most: int = 2**32 - 1, step: int = 1, **default: Any) -> Any:  # noqa: ANN401
    """Field for a whole number within limits."""
    text = f"{what}, {'a whole' if step == 1 else 'an even'} number from {least} to {most}"
    return key_field(text, example, ge=least, le=most, multiple_of=step, **default)


#: A number from 1, or a word; of one body among several with the body's name before it.
POINT_LABEL = r"(?:[A-Za-z][A-Za-z0-9_-]{0,59}\.)?(?:[1-9][0-9]{0,8}|[A-Za-z][A-Za-z0-9_-]{0,59})"


def _label(text: str) -> str:
    if not re.fullmatch(POINT_LABEL + ":(x|y|z|rx|ry|rz)", text):
        guess = re.fullmatch(r"\s*0*([1-9][0-9]{0,8})\W*(r|rot|theta|phi)?_?([xyz])\s*", text.lower())
        remedy = f'did you mean "{guess[1]}:{"r" * bool(guess[2])}{guess[3]}"?' if guess else 'write for example "1:y"'
        expected = "a DOF label node:direction, nodes counted from 1, direction x, y, z, rx, ry or rz"
        raise_findings([Finding((), "", expected, remedy)])
    return text


def distinct(entries: tuple[str, ...]) -> tuple[str, ...]:
    """Refuses an entry that an earlier one is equal to."""
    first = {entry: i for i, entry in reversed(list(enumerate(entries)))}
    raise_findings(
        Finding((i,), f'"{entry}" is listed twice', "each entry once", "remove the repeated one")
        for i, entry in enumerate(entries)
        if first[entry] != i
    )
    return entries


def listed(words: Sequence[str], most: int = 12) -> str:
    """Words after each other, of many the first."""
    rest = len(words) - most
    return ", ".join(words[:most]) + (f" and {rest} more" if rest > 0 else "")


def max_length(count: int) -> BeforeValidator:
    """Refuse a longer list or table before its entries are looked at."""

    def check(value: object) -> object:
        if isinstance(value, list | dict) and len(value) > count:
            kind = "list" if isinstance(value, list) else "table"
            raise_findings([Finding((), f"found a {kind} of {len(value)}", f"at most {count} entries", "shorten it")])
        return value

    return BeforeValidator(check)


def _increasing(values: tuple[float, ...]) -> tuple[float, ...]:
    wrong = (
        Finding((i,), f"found entry {i + 1} = {b!r} after {a!r}", "", "sort the list, each value once")
        for i, (a, b) in enumerate(itertools.pairwise(values), 1)
        if b <= a
    )
    raise_findings(itertools.islice(wrong, 1))
    return values


def _uneven(value: object, place: KeyPath = ()) -> Iterator[Finding]:
    """Yield lists in lists of another length than the first of them."""
    lists = [entry for entry in value if isinstance(entry, tuple)] if isinstance(value, tuple) else []
    for i, entry in enumerate(lists):
        if len(entry) != len(lists[0]):
            found, expected = f"found a list of {len(entry)} beside one of {len(lists[0])}", "as many in each"
            yield Finding((*place, i), found, expected, "correct the list")
        yield from _uneven(entry, (*place, i))


def even(value: object) -> object:
    """Refuses lists in a list that are not all of one length."""
    raise_findings(_uneven(value))
    return value


def to_list(value: object) -> object:
    """A value alone, as the list of one that it stands for."""
    return value if isinstance(value, list | tuple) else [value]


def _word(most: int) -> AfterValidator:
    def check(text: str) -> str:
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", text) or len(text) > most:
            expected = f"a name of letters, digits, _ and -, at most {most}, a letter first"
            raise_findings([Finding((), "found a name that tables and figures cannot show", expected, "rename it")])
        return text

    return AfterValidator(check)


#: The name of a joint or of a test.
Name = Annotated[str, _word(40)]
#: The name of a body, of a part or of a port.
Word = Annotated[str, _word(60)]
# A TOML array is a list; the frozen models keep tuples, which strict mode would refuse to build from lists.
ListOf = Annotated[tuple[T, ...], Strict(False)]
Vector = Annotated[tuple[float, float, float], Strict(False)]
Label = Annotated[str, AfterValidator(_label)]
Labels = Annotated[ListOf[Label], AfterValidator(distinct), max_length(MOST_LABELS)]
Positive = Annotated[float, Field(gt=0)]
Fraction = Annotated[float, Field(gt=0, le=1)]
Frequencies = Annotated[ListOf[Positive], AfterValidator(_increasing)]
Ratio = Annotated[float, Field(ge=0, lt=1)]
Ratios = Annotated[ListOf[Ratio], Field(min_length=1), BeforeValidator(to_list), max_length(MOST_RATIOS)]


class Spec(BaseModel):
    """Frozen model that refuses unknown keys; subclasses add checks between keys in `_findings`."""

    #: Keys by fields of what the table describes, where they differ by more than a unit; of both parts in each other.
    field_keys: ClassVar[Mapping[str, str]] = {}
    #: By keys that serve some choices alone: the key of the choice, and these choices.
    used_with: ClassVar[Mapping[str, tuple[str, ...]]] = {}

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)

    @pydantic.model_validator(mode="after")
    def _check(self) -> Self:
        raise_findings(self._limit_findings())
        raise_findings((*self._unused(), *self._findings()))
        return self

    def _limit_findings(self) -> Iterator[Finding]:
        """Yield numbers that no machine has; NaN stands for none, where a key allows it."""
        fields = type(self).model_fields
        for key, limits in ((key, LIMITS[key]) for key in fields if key in LIMITS):
            for loc, value in entries_of(float | int, getattr(self, key), (key,)):
                if value != 0 and not limits.least <= abs(value) <= limits.most and not math.isnan(value):
                    what = str(fields[key].description).rstrip(".")
                    expected = f"{what}, of a magnitude from {limit_text(limits.least)} to {limit_text(limits.most)}"
                    yield Finding(loc, f"found {value!r}", expected, "correct the number or its unit")

    def _unused(self) -> Iterator[Finding]:
        """Yield what is stated for a choice that was not made, where it would be lost without a word."""
        for key, (switch, *choices) in self.used_with.items():
            value, chosen = getattr(self, key), getattr(self, switch)
            if chosen not in choices and value != type(self).model_fields[key].default:
                fault, names = f'found {value!r}, which {switch} = "{chosen}" does not use', (f'"{c}"' for c in choices)
                yield Finding((key,), fault, f"{switch} = {either(names)}", f"write {switch} so, or remove {key}")

    def _findings(self) -> Iterator[Finding]:
        """Yield what is wrong between keys that are each right by themselves."""
        yield from ()

    def built(self) -> Any:  # noqa: ANN401 (any object)
        """What the table describes, whose rules stand there; None where other tables are needed to make it."""
        return None

    def try_objects(self) -> None:
        """Make what the table describes: what it refuses is refused by the key here."""
        self.built()

    def object_findings(self, at: KeyPath = ()) -> Iterator[Finding]:
        """Yield what the objects refuse that this table, or one in it, describes; of tables in each other the inner."""
        inner = [
            finding for place, table in entries_of(Spec, dict(self), at) for finding in table.object_findings(place)
        ]
        if inner:
            yield from inner
            return
        try:
            self.try_objects()
        except JointBayesError as error:
            found, expected, remedy = error.words
            yield Finding((*at, *self._key_of(error.key)), found, expected, remedy or "correct it")
        except (ArithmeticError, ValueError, MemoryError):  # numbers too far apart: told where the case is built
            return

    def _key_of(self, field: KeyPath) -> KeyPath:
        """The key here of a field of an object."""
        for n in range(len(field), 0, -1):
            if stated := self.field_keys.get(".".join(map(str, field[:n]))):
                return (*stated.split("."), *field[n:])
        key = same_stem(str(field[0]), type(self).model_fields) if field else None
        return (key, *field[1:]) if key else ()


class DataTable(Spec):
    """A `[data]` table: what is asked of all of them, so that no code asks of which kind one is."""

    #: Whether the data are FRFs, and whether they are in measurement files.
    frfs: ClassVar[bool] = False
    in_files: ClassVar[bool] = False

    @property
    def labelled(self) -> Mapping[KeyPath, tuple[str, ...]]:
        """DOFs that the structure must have, by their keys."""
        return {}

    @property
    def loaded(self) -> tuple[str, ...]:
        """DOFs at which sensors sit, each once."""
        by_key = (labels for key, labels in self.labelled.items() if key[-1] != "inputs" or "channels" in key)
        return tuple(dict.fromkeys(itertools.chain.from_iterable(by_key)))

    @property
    def least_modes(self) -> Mapping[KeyPath, int]:
        """Number of modes that the structure must have, by the key that says so."""
        return {}

    @property
    def depends_on(self) -> frozenset[str]:
        """Uncertain quantities that say nothing to natural frequencies, and on which these data depend all the same."""
        return frozenset({"accelerometer_mass"})

    @property
    def band_hz(self) -> tuple[float, float] | None:
        """Lowest and highest frequency that is stated, Hz; None where the data are in files."""
        return None


def metres(millimetres: Iterable[float]) -> tuple[float, float, float]:
    """A vector in m from one in mm."""
    x, y, z = (number * 1e-3 for number in millimetres)
    return x, y, z


def band_lines(low: float, high: float, step: float) -> tuple[float, ...]:
    """Lines of a band in Hz; the last one is at its upper end or less than a step below."""
    # the allowance keeps the upper end itself where the division falls just short of a whole number
    return tuple(low + i * step for i in range(math.floor((high - low) / step + 1e-9) + 1))


def law_findings(law: Spec) -> Iterator[Finding]:
    """Yield that a law of noise states less than both of its parts."""
    yield from (Finding((key,), missing=True) for key in sorted({"relative", "floor"} - law.model_fields_set))


def not_above(low: float, high: float, low_key: str, high_key: str, unit: str) -> Iterator[Finding]:
    """Yield that the upper of two bounds does not lie above the lower one."""
    if high <= low:
        fault = f"found {high!r}, which is not above {low_key} = {low!r}"
        expected = f"a number greater than {low_key} {unit}".rstrip()
        yield Finding((high_key,), fault, expected, "exchange or correct them")
