"""The `[data]` table of a case whose data are modes: frequencies, damping, shapes, antiresonances, modal constants."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, Strict

from jointbayes.case.spec.fields import (
    DATA_KIND,
    MOST_LABELS,
    DataTable,
    Finding,
    KeyPath,
    Label,
    Labels,
    Spec,
    even,
    key_field,
    max_length,
    to_list,
)
from vibrecords.errors import MeasurementError

if TYPE_CHECKING:
    from vibrecords import Antiresonances, ModalConstants, ModeData, Observed

_MOST_REPETITIONS, _MOST_MODES = 10_000, 1000


def _depth(value: object) -> int:
    """Lists in lists, as their first entries go."""
    return 1 + (_depth(value[0]) if value else 0) if isinstance(value, list | tuple) else 0


def _repeated(depth: int) -> BeforeValidator:
    """Takes the list of one repetition for the list of one such list that it stands for."""
    return BeforeValidator(lambda value: [value] if _depth(value) == depth - 1 else value)


_Number = Annotated[float, Field(allow_inf_nan=True)]  # NaN where nothing was observed
_Row = Annotated[tuple[_Number, ...], Strict(False), Field(min_length=1), max_length(_MOST_MODES)]
_Rows = Annotated[
    tuple[_Row, ...], Strict(False), Field(min_length=1), AfterValidator(even), _repeated(2),
    max_length(_MOST_REPETITIONS),
]  # fmt: skip
_Shape = Annotated[tuple[_Number, ...], Strict(False), Field(min_length=1), max_length(MOST_LABELS)]
_Shapes = Annotated[tuple[_Shape, ...], Strict(False), Field(min_length=1), max_length(_MOST_MODES)]
_AllShapes = Annotated[
    tuple[_Shapes, ...], Strict(False), Field(min_length=1), AfterValidator(even), _repeated(3),
    max_length(_MOST_REPETITIONS),
]  # fmt: skip
_EachLabel = Annotated[
    tuple[Label, ...], Strict(False), Field(min_length=1), BeforeValidator(to_list), max_length(_MOST_MODES)
]
_EachMode = Annotated[
    tuple[Annotated[float, Field(ge=0)], ...],
    Strict(False),
    Field(min_length=1),
    BeforeValidator(to_list),
    max_length(_MOST_MODES),
]
_Numbers = Annotated[
    tuple[Annotated[int, Field(ge=1, le=_MOST_MODES)], ...], Strict(False), Field(min_length=1), max_length(_MOST_MODES)
]

_EACH = "a number of at least 0, or a list of such numbers, one for each mode"
_EACH_ZERO = _EACH.replace("mode", "antiresonance")
_FREQUENCIES = key_field(
    "the natural frequencies in Hz, a list with one above 0 for each mode, or a list of such lists, one for each "
    "repetition of the test; nan where none was found",
    [12.1, 31.4],
)
_EIGENVALUES = key_field(
    "the eigenvalues (2 pi f)^2 in rad2/s2 in place of the frequencies, a list for each repetition of the test",
    [5780.0],
)
_RATIOS = key_field(
    "the damping ratios, from 0 to below 1, a list for each repetition of the test as the frequencies", [0.01, 0.012]
)
_DOFS = key_field("a list of at least one DOF at which shapes were measured, without the reference", ["1:y", "6:y"])
_REFERENCE = key_field("the DOF whose component is 1, or a list of such, one for each mode", "11:y")
_COMPONENTS = key_field(
    "the components of the shapes over that at the reference: a list for each mode of one for each DOF, or a list of "
    "such lists, one for each repetition of the test; nan where none was found",
    [[0.1, 0.4], [-0.3, -0.6]],
)
_ZERO_DOF = key_field("the DOF that was excited and measured, or a list of such, one for each antiresonance", "11:y")
_ZEROS = key_field(
    "the antiresonances in Hz, a list for each repetition of the test, as the frequencies", [82.0, 520.0]
)
_ZERO_NUMBERS = key_field(
    "the number of each antiresonance among those of its DOF, from 1; by default the lowest, as they stand", [1, 2]
)
_PAIR_OUTPUTS = key_field("a list of the measured DOFs", ["6:y", "11:y"])
_PAIR_INPUTS = key_field("the DOF that was excited, or a list of such, one for each of outputs", "11:y")
_CONSTANTS = key_field(
    "the modal constants of unit modal mass in 1/kg, with signs: lists as of components of shapes", [[0.4, 1.2]]
)
_MATCH = key_field('how modes are matched, by "number" or by "shape"', "number")
_NUMBERS = key_field(
    "the number of each mode among those of the assembled structure, from 1; by default the lowest", [1, 3]
)


class ModeShapesSpec(Spec):
    """Components of mode shapes relative to a reference DOF."""

    dofs: Annotated[Labels, Field(min_length=1), _DOFS]
    reference: Annotated[_EachLabel, _REFERENCE]
    components: Annotated[_AllShapes, _COMPONENTS]
    sd: Annotated[_EachMode, key_field(f"the standard deviation of a component, {_EACH}", 0.02)]


class AntiresonancesSpec(Spec):
    """Antiresonances of drive points."""

    field_keys = {  # noqa: RUF012 (no field)
        "dofs": "dof", "frequency.values": "frequencies_hz", "frequency.sd": "sd_relative"
    }  # fmt: skip

    dof: Annotated[_EachLabel, _ZERO_DOF]
    frequencies_hz: Annotated[_Rows, _ZEROS]
    sd_relative: Annotated[_EachMode, key_field(f"the standard deviation as a fraction, {_EACH_ZERO}", 0.005)] = (0.0,)
    sd_hz: Annotated[_EachMode, key_field(f"the standard deviation in Hz, {_EACH_ZERO}", 0.5)] = (0.0,)
    numbers: Annotated[_Numbers | None, _ZERO_NUMBERS] = None

    @property
    def highest(self) -> int:
        """Highest number of any DOF."""
        return max(self.numbers or Counter(self.dof * (len(self.frequencies_hz[0]) // len(self.dof))).values())

    def stated(self) -> Antiresonances:
        """The antiresonances."""
        from vibrecords import Antiresonances

        dofs = self.dof[0] if len(self.dof) == 1 else self.dof
        return Antiresonances(dofs, _observed(self, self.frequencies_hz, "sd_relative", "sd_hz"), self.numbers or ())

    def try_objects(self) -> None:
        """The antiresonances."""
        self.stated()


class ConstantsSpec(Spec):
    """Modal constants of pairs of DOFs."""

    outputs: Annotated[_EachLabel, _PAIR_OUTPUTS]
    inputs: Annotated[_EachLabel, _PAIR_INPUTS]
    values_per_kg: Annotated[_AllShapes, _CONSTANTS]
    sd_relative: Annotated[_EachMode, key_field(f"the standard deviation as a fraction, {_EACH}", 0.05)] = (0.0,)
    sd_per_kg: Annotated[_EachMode, key_field(f"the standard deviation in 1/kg, {_EACH}", 0.02)] = (0.0,)

    def stated(self) -> ModalConstants:
        """The modal constants."""
        from vibrecords import ModalConstants

        inputs = self.inputs * len(self.outputs) if len(self.inputs) == 1 else self.inputs
        return ModalConstants(self.outputs, inputs, _observed(self, self.values_per_kg, "sd_relative", "sd_per_kg"))

    def try_objects(self) -> None:
        """The modal constants."""
        self.stated()


_SHAPES_TABLE = "the mode shapes: dofs, reference, components, sd"
_ZEROS_TABLE = "the antiresonances of drive points: dof, frequencies_hz, sd_relative or sd_hz, numbers"
_CONSTANTS_TABLE = "the modal constants: outputs, inputs, values_per_kg, sd_relative or sd_per_kg"


class ModesSpec(DataTable):
    """Modes of a modal test, or of several repetitions of it."""

    field_keys = {  # noqa: RUF012 (no field)
        "frequency.values": "frequencies_hz", "frequency.sd": "sd_relative", "eigenvalues.sd": "sd_relative",
        "damping.values": "damping_ratios", "damping.sd": "damping_sd_relative", "shapes.components.sd": "shapes.sd",
        "constants.values": "constants.values_per_kg", "constants.sd": "constants.sd_relative",
    }  # fmt: skip

    kind: Annotated[Literal["modes"], DATA_KIND]
    frequencies_hz: Annotated[_Rows | None, _FREQUENCIES] = None
    eigenvalues: Annotated[_Rows | None, _EIGENVALUES] = None
    sd_relative: Annotated[_EachMode, key_field(f"the standard deviation as a fraction, {_EACH}", 0.005)] = (0.0,)
    sd_hz: Annotated[_EachMode, key_field(f"the standard deviation in Hz, {_EACH}", 0.5)] = (0.0,)
    eigenvalue_sd: Annotated[
        _EachMode, key_field(f"the standard deviation of an eigenvalue in rad2/s2, {_EACH}", 24.0)
    ] = (0.0,)
    damping_ratios: Annotated[_Rows | None, _RATIOS] = None
    damping_sd_relative: Annotated[
        _EachMode, key_field(f"the standard deviation of a damping ratio as a fraction of it, {_EACH}", 0.1)
    ] = (0.0,)
    damping_sd: Annotated[_EachMode, key_field(f"the standard deviation of a damping ratio, {_EACH}", 0.001)] = (0.0,)
    numbers: Annotated[_Numbers | None, _NUMBERS] = None
    match: Annotated[Literal["number", "shape"], _MATCH] = "number"
    shapes: Annotated[ModeShapesSpec | None, Field(description=_SHAPES_TABLE)] = None
    zeros: Annotated[AntiresonancesSpec | None, Field(description=_ZEROS_TABLE)] = None
    constants: Annotated[ConstantsSpec | None, Field(description=_CONSTANTS_TABLE)] = None

    @property
    def frequencies(self) -> tuple[tuple[float, ...], ...]:
        """Natural frequencies in Hz, each repetition, also of eigenvalues."""
        if self.eigenvalues is not None:
            return tuple(tuple(math.sqrt(value) / (2 * math.pi) for value in row) for row in self.eigenvalues)
        return self.frequencies_hz or ()

    @property
    def count(self) -> int:
        """Number of measured modes."""
        return len(self.frequencies[0])

    @property
    def least_modes(self) -> Mapping[KeyPath, int]:
        """Number of the highest mode; an antiresonance lies between the mode of its number and the next."""
        key = "numbers" if self.numbers else "frequencies_hz"
        highest: dict[KeyPath, int] = {("data", key): max(self.numbers or (self.count,))}
        return highest if self.zeros is None else highest | {("data", "zeros", "dof"): 1 + self.zeros.highest}

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest natural frequency of any repetition, Hz."""
        seen = [f for row in self.frequencies for f in row if not math.isnan(f)]
        return min(seen), max(seen)

    @property
    def depends_on(self) -> frozenset[str]:
        """Damping, if its ratios are stated, and masses of sensors, if DOFs are."""
        damping = {"damping_ratio", "loss_factor"} if self.damping_ratios is not None else set()
        return frozenset(damping | ({"accelerometer_mass"} if self.labelled else set()))

    @property
    def labelled(self) -> dict[KeyPath, tuple[str, ...]]:
        """DOFs of shapes with their references, of antiresonances, and of modal constants."""
        labelled: dict[KeyPath, tuple[str, ...]] = {}
        for table, keys in (
            ("shapes", ("dofs", "reference")),
            ("zeros", ("dof",)),
            ("constants", ("outputs", "inputs")),
        ):
            if (given := getattr(self, table)) is not None:
                labelled |= {("data", table, key): getattr(given, key) for key in keys}
        return labelled

    def stated(self) -> ModeData:
        """The modes."""
        import numpy as np

        from vibrecords import ModeData, ModeShapes, Observed

        damping = shapes = None
        if self.damping_ratios is not None:
            damping = _observed(self, self.damping_ratios, "damping_sd_relative", "damping_sd")
        if (given := self.shapes) is not None:
            reference = given.reference[0] if len(given.reference) == 1 else given.reference
            components = Observed(np.array(given.components), np.array(given.sd)[:, None])
            shapes = ModeShapes(given.dofs, reference, components)
        rows = self.frequencies_hz or self.eigenvalues
        assert rows is not None
        of_eigenvalues = self.eigenvalues is not None
        frequency = _observed(self, rows, "sd_relative", "eigenvalue_sd" if of_eigenvalues else "sd_hz")
        made = ModeData(frequency, damping, shapes, self.numbers or (), self.match, of_eigenvalues)
        if self.zeros is not None:
            made = replace(made, zeros=self.zeros.stated())
        return made if self.constants is None else replace(made, constants=self.constants.stated())

    def try_objects(self) -> None:
        """The modes."""
        self.stated()

    def _findings(self) -> Iterator[Finding]:
        given = [key for key in ("frequencies_hz", "eigenvalues") if getattr(self, key) is not None]
        if len(given) != 1:
            if given:
                fault = "given together with frequencies_hz"
                yield Finding(("eigenvalues",), fault, "one of the two", "remove one of the two")
            else:
                yield Finding(("frequencies_hz",), missing=True)
            return
        key = given[0]
        absolute, other = ("eigenvalue_sd", "sd_hz") if key == "eigenvalues" else ("sd_hz", "eigenvalue_sd")
        if max(getattr(self, other)) > 0:
            yield Finding((other,), f"found it with {key}", f"sd_relative or {absolute}", f"state {absolute}")


def _observed(table: Spec, rows: Sequence[object], relative_key: str, absolute_key: str) -> Observed:
    """Values with standard deviations that are fractions of their means over repetitions, or absolute, or both."""
    import numpy as np

    from vibrecords import Observed

    values = np.array(rows, dtype=float)
    for key in (relative_key, absolute_key):
        if (given := len(getattr(table, key))) not in (1, values.shape[1]):
            found, expected = f"found {given} for {values.shape[1]}", "one, or one for each"
            raise MeasurementError.of("modes", (key,), found, expected, "correct the list")
    # a fraction of the mean over repetitions: the spread does not depend on what one of them happened to give
    seen = ~np.isnan(values)
    mean = np.where(seen, values, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    each = (slice(None), None) if values.ndim > 2 else ...  # of a mode, at each of its DOFs
    relative, absolute = (np.array(getattr(table, key))[each] for key in (relative_key, absolute_key))
    return Observed(values, np.hypot(relative * np.abs(mean), absolute))
