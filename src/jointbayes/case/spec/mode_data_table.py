"""The `[data]` table of a case whose data are modes: frequencies, damping ratios, shapes, of one or several tests."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BeforeValidator, Field, Strict

from jointbayes.case.spec.fields import (
    DATA_KIND,
    MOST_LABELS,
    DataTable,
    Finding,
    KeyPath,
    Label,
    Labels,
    Spec,
    key_field,
    max_length,
    numbers_in,
    repeated,
    to_list,
)

if TYPE_CHECKING:
    from jointbayes.measurement import ModeData, Observed

_MOST_REPETITIONS, _MOST_MODES = 10_000, 1000


def _depth(value: object) -> int:
    """Lists in lists, as their first entries go."""
    return 1 + (_depth(value[0]) if value else 0) if isinstance(value, list | tuple) else 0


def _repeated(depth: int) -> BeforeValidator:
    """Takes the list of one repetition for the list of one such list that it stands for."""
    return BeforeValidator(lambda value: [value] if _depth(value) == depth - 1 else value)


_Number = Annotated[float, Field(allow_inf_nan=True)]  # NaN where nothing was observed
_Row = Annotated[tuple[_Number, ...], Strict(False), Field(min_length=1), max_length(_MOST_MODES)]
_Rows = Annotated[tuple[_Row, ...], Strict(False), Field(min_length=1), _repeated(2), max_length(_MOST_REPETITIONS)]
_Shape = Annotated[tuple[_Number, ...], Strict(False), Field(min_length=1), max_length(MOST_LABELS)]
_Shapes = Annotated[tuple[_Shape, ...], Strict(False), Field(min_length=1), max_length(_MOST_MODES)]
_AllShapes = Annotated[
    tuple[_Shapes, ...], Strict(False), Field(min_length=1), _repeated(3), max_length(_MOST_REPETITIONS)
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
_MATCH = key_field('how modes are matched, by "number" or by "shape"', "number")
_NUMBERS = key_field(
    "the number of each mode among those of the assembled structure, from 1; by default the lowest", [1, 3]
)


class ModeShapesSpec(Spec):
    """Components of mode shapes relative to a reference DOF."""

    dofs: Annotated[Labels, Field(min_length=1), _DOFS]
    reference: Annotated[
        tuple[Label, ...],
        Strict(False),
        Field(min_length=1),
        BeforeValidator(to_list),
        max_length(_MOST_MODES),
        _REFERENCE,
    ]
    components: Annotated[_AllShapes, _COMPONENTS]
    sd: Annotated[_EachMode, key_field(f"the standard deviation of a component, {_EACH}", 0.02)]

    def _findings(self) -> Iterator[Finding]:
        if min(self.sd) == 0:
            yield Finding(("sd",), "found 0", "a number above 0", "state what a component is uncertain by")
        if len(self.reference) == 1 and self.reference[0] in self.dofs:
            fault = f'found the reference "{self.reference[0]}"'
            place = ("dofs", self.dofs.index(self.reference[0]))
            yield Finding(place, fault, "other DOFs, since its component is 1", "remove it and its components")
        n = len(self.components[0])
        for key, given in (("reference", self.reference), ("sd", self.sd)):
            if len(given) not in (1, n):
                yield Finding(
                    (key,), f"found {len(given)} for {n} modes", "one, or one for each mode", "correct the list"
                )
        for i, shapes in enumerate(self.components):
            for j, shape in enumerate(shapes):
                if len(shape) != len(self.dofs):
                    fault = f"found {len(shape)} components of mode {j + 1} at {len(self.dofs)} DOFs"
                    yield Finding(("components", i), fault, "one for each of dofs, nan where none", "correct the list")
            if len(shapes) != n:
                fault = f"found {len(shapes)} shapes in repetition {i + 1} and {n} in the first"
                yield Finding(("components", i), fault, "as many, nan where none was found", "correct the list")
        if any(math.isinf(value) for _, value in numbers_in(self.components)):
            yield Finding(("components",), "found inf", "", "write nan where nothing was found")


class ModesSpec(DataTable):
    """Modes of a modal test, or of several repetitions of it."""

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
    shapes: Annotated[ModeShapesSpec | None, Field(description="the mode shapes: dofs, reference, components, sd")] = (
        None
    )

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
    def most_modes(self) -> int:
        """Number of the highest mode."""
        return max(self.numbers or (self.count,))

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest natural frequency of any repetition, Hz."""
        seen = [f for row in self.frequencies for f in row if not math.isnan(f)]
        return min(seen), max(seen)

    @property
    def depends_on(self) -> frozenset[str]:
        """Damping, if its ratios are stated, and masses of sensors, if shapes are."""
        damping = {"damping_ratio", "loss_factor"} if self.damping_ratios is not None else set()
        return frozenset(damping | ({"accelerometer_mass"} if self.shapes is not None else set()))

    @property
    def labelled(self) -> dict[KeyPath, tuple[str, ...]]:
        """DOFs of shapes, and their references."""
        place, shapes = ("data", "shapes"), self.shapes
        return {} if shapes is None else {(*place, "dofs"): shapes.dofs, (*place, "reference"): shapes.reference}

    def stated(self) -> ModeData:
        """The modes."""
        import numpy as np

        from jointbayes.measurement import ModeData, ModeShapes, Observed

        damping = shapes = None
        if self.damping_ratios is not None:
            damping = _observed(self.damping_ratios, self.damping_sd_relative, self.damping_sd)
        if (given := self.shapes) is not None:
            reference = given.reference[0] if len(given.reference) == 1 else given.reference
            components = Observed(np.array(given.components), np.array(given.sd)[:, None])
            shapes = ModeShapes(given.dofs, reference, components)
        rows = self.frequencies_hz or self.eigenvalues
        assert rows is not None
        of_eigenvalues = self.eigenvalues is not None
        frequency = _observed(rows, self.sd_relative, self.eigenvalue_sd if of_eigenvalues else self.sd_hz)
        return ModeData(frequency, damping, shapes, self.numbers or (), self.match, of_eigenvalues)

    def _findings(self) -> Iterator[Finding]:
        given = [key for key in ("frequencies_hz", "eigenvalues") if getattr(self, key) is not None]
        if len(given) != 1:
            if given:
                fault = "given together with frequencies_hz"
                yield Finding(("eigenvalues",), fault, "one of the two", "remove one of the two")
            else:
                yield Finding(("frequencies_hz",), missing=True)
            return
        (key,) = given
        rows = getattr(self, key)
        yield from self._row_findings(key, rows, len(rows[0]))
        if any(value <= 0 or math.isinf(value) for _, value in numbers_in(rows)):
            yield Finding((key,), "found one that is not above 0", "", "correct it, or write nan where none was found")
            return
        absolute, other = ("eigenvalue_sd", "sd_hz") if key == "eigenvalues" else ("sd_hz", "eigenvalue_sd")
        if max(getattr(self, other)) > 0:
            yield Finding((other,), f"found it with {key}", f"sd_relative or {absolute}", f"state {absolute}")
        n = len(rows[0])
        yield from self._sd_findings("sd_relative", absolute, n)
        if self.damping_ratios is not None:
            yield from self._row_findings("damping_ratios", self.damping_ratios, n)
            if any(not 0 <= value < 1 for _, value in numbers_in(self.damping_ratios) if not math.isnan(value)):
                yield Finding(("damping_ratios",), "found one outside 0 to 1", "", "write 0.01 for 1 %")
            yield from self._sd_findings("damping_sd_relative", "damping_sd", n)
        yield from self._number_findings(n)

    def _row_findings(self, key: str, rows: Sequence[Sequence[float]], n: int) -> Iterator[Finding]:
        """Yield repetitions that hold other numbers of modes, and modes that none holds."""
        for i, row in enumerate(rows):
            if len(row) != n:
                fault = f"found {len(row)} modes in repetition {i + 1} and {n} in the first of the frequencies"
                yield Finding((key, i), fault, "as many, nan where none was found", "correct the list")
                return
        if key != "damping_ratios" and any(all(math.isnan(row[i]) for row in rows) for i in range(n)):
            fault, remedy = "found a mode without any", "leave the mode out"
            yield Finding((key,), fault, "a frequency of each mode in one repetition at least", remedy)

    def _sd_findings(self, relative: str, absolute: str, n: int) -> Iterator[Finding]:
        """Yield standard deviations that are 0, or not one for each mode."""
        for key in (relative, absolute):
            given = getattr(self, key)
            if len(given) not in (1, n):
                yield Finding(
                    (key,), f"found {len(given)} for {n} modes", "one, or one for each mode", "correct the list"
                )
                return
        if min(getattr(self, relative)) + min(getattr(self, absolute)) == 0:
            fault, expected = f"{relative} and {absolute} are both 0", "at least one above 0, for each mode"
            yield Finding((relative,), fault, expected, "raise one")

    def _number_findings(self, n: int) -> Iterator[Finding]:
        """Yield numbers of modes, and shapes, that are not one for each mode."""
        if self.numbers is not None and len(self.numbers) != n:
            yield Finding(
                ("numbers",), f"found {len(self.numbers)} for {n} modes", "one for each mode", "correct the list"
            )
        for i, number in repeated(map(str, self.numbers or ())):
            yield Finding(("numbers", i), f"found {number} twice", "each number once", "correct the list")
        if self.match == "shape" and self.shapes is None:
            yield Finding(("match",), 'found "shape" without shapes', '"number", or [data.shapes]', "add [data.shapes]")
        if self.shapes is not None and len(self.shapes.components[0]) != n:
            fault = f"found {len(self.shapes.components[0])} shapes for {n} modes"
            yield Finding(
                ("shapes", "components"), fault, "one for each mode, nan where none was found", "correct the list"
            )


def _observed(
    rows: tuple[tuple[float, ...], ...], relative: tuple[float, ...], absolute: tuple[float, ...]
) -> Observed:
    import numpy as np

    from jointbayes.measurement import Observed

    values = np.array(rows)
    # a fraction of the mean over repetitions: the spread does not depend on what one of them happened to give
    seen = ~np.isnan(values)
    mean = np.where(seen, values, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    return Observed(values, np.hypot(np.array(relative) * mean, absolute))
