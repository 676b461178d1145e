"""Measurements as inference takes them: values with the variance of their noise."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibrecords.arrays import Array, Lines, Quantity, convert_fields, quantity_factor
from vibrecords.errors import MeasurementError, read_only, refusal
from vibrecords.frf_set import FrfSet
from vibrecords.labels import list_labels
from vibrecords.provenance import Provenance

_MORE = 3  # modes above the highest number stated, among which shapes are looked for
Match = Literal["number", "shape"]


class Data(ABC):
    """Measured values with their noise: what is asked of all kinds of data, whichever kind it is.

    A kind of data inherits from it and states what is not as here. What other rooms make of its values it registers:
    its likelihood with `jointbayes.inference.likelihood_of`, and, if it has any to give, a diagnosis of misfits with
    `jointbayes.posterior.diagnose`, and a section of the report with `jointbayes.report.compared_section`.
    """

    __slots__ = ()
    #: What they are, in the words of a message.
    words: ClassVar[str] = "values"
    #: Whether they were computed, not measured.
    synthetic: bool = False
    #: Degrees of freedom from which variances were estimated; None where they are stated.
    variance_dof: int | None = None
    #: FRFs at the measured DOFs and at the joint, which the paper's iteration needs.
    joint_frf: FrfSet | None = None
    #: Where the data come from; None for data that come from no file.
    provenance: Provenance | None = None

    @property
    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """All numbers that were measured or stated, by name: the fields of the data class that are arrays."""
        values = ((field.name, getattr(self, field.name)) for field in fields(self))  # type: ignore[arg-type]
        return {name: value for name, value in values if isinstance(value, np.ndarray)}

    @property
    @abstractmethod
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest measured frequency, Hz; both 0 of a static test."""

    @property
    def layout(self) -> dict[str, object]:
        """What must be the same of other data for these to stand for them, in the words of a message."""
        shapes = [array.shape for array in self.arrays.values()]
        return {"data": self.words, f"number of {self.words}": shapes, "DOFs": self.dofs}

    @abstractmethod
    def with_values(self, values: NDArray[Any]) -> "Data":
        """The same with other values and the stated noise.

        Raises
        ------
        MeasurementError
            If they are no possible measurement.
        """

    def in_short(self, quote: Callable[[str], str] = str) -> str:
        """What was measured, for a table; `quote` marks what a user wrote."""
        return self.words

    @property
    def in_full(self) -> str:
        """What was measured, with every number that fits into a line."""
        return self.words

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.in_full})"

    @property
    def top_hz(self) -> float:
        """Highest measured frequency, Hz."""
        return self.band_hz[1]

    @property
    def dofs(self) -> tuple[str, ...]:
        """DOFs at which something was measured or excited."""
        return ()

    @property
    def frfs(self) -> "FrfData | None":
        """The FRFs over lines of frequency, if that is what the data are."""
        return None

    @property
    def shown_frfs(self) -> "FrfData | None":
        """The measured FRFs, also where the data are the modes that were read off them."""
        return self.frfs

    @property
    def modes(self) -> "ModalData | None":
        """The natural frequencies, with what else is known of modes, if that is what the data are."""
        return None

    @property
    def shows_shapes(self) -> bool:
        """Whether mode shapes are among the data."""
        return False

    @property
    def lowest_hz(self) -> tuple[float, ...] | None:
        """Natural frequencies that are the data, if they are the lowest, each of them, in rising order, Hz."""
        return None

    def require_enough(self) -> None:
        """Refuse data that are too few to say whether a model explains them.

        Raises
        ------
        MeasurementError
            If they are too few.
        """
        return


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FrfData(Data):
    """Measured FRFs, the variance of their noise, and where both come from.

    Parameters
    ----------
    frf
        The FRFs.
    variance
        σ² = E|δH|² of the complex noise, half of it in each part, shape as ``frf.values``.
    synthetic
        True where the FRFs were computed, not measured.
    variance_dof
        Degrees of freedom from which the variance of each line was estimated; None where it is stated.
    joint_frf
        FRFs at the measured DOFs and at the joint, rotation included, which the paper's iteration needs; None where
        they were not measured.
    provenance
        Where the data come from, and what was done to them; None for data that come from no file.

    Raises
    ------
    MeasurementError
        If a variance is not finite and positive or its shape differs from the FRFs'.
    """

    words: ClassVar[str] = "FRFs"

    frf: FrfSet
    variance: Array
    synthetic: bool = False
    variance_dof: int | None = None
    joint_frf: FrfSet | None = None
    provenance: Provenance | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "variance", read_only(self.variance))
        if self.variance.shape != self.frf.values.shape:
            raise refusal("noise", f"a variance of shape {self.variance.shape}", str(self.frf.values.shape))
        if not (np.isfinite(self.variance).all() and (self.variance > 0).all()):
            raise refusal("noise", "an impossible variance", "all above 0", "raise the noise floor")

    @classmethod
    def of_arrays(
        cls, frequency_hz: ArrayLike, values: ArrayLike, sd: ArrayLike, outputs: Sequence[str], inputs: Sequence[str],
        quantity: Quantity = "receptance",
    ) -> "FrfData":  # fmt: skip
        """Those of lines, values (lines, outputs, inputs) and the standard deviation √(E|δH|²) of their noise.

        The deviation is of the shape of the values, or one number, or one that broadcasts to them.

        Raises
        ------
        MeasurementError
            If the values are real: magnitudes, or real parts alone, are no FRF.
        """
        if not np.iscomplexobj(values):
            remedy = "of magnitude and phase take magnitude * np.exp(1j * phase)"
            raise refusal("FRFs: values", "real values", "complex ones", remedy)
        frf = FrfSet(np.asarray(frequency_hz), np.asarray(values), tuple(outputs), tuple(inputs), quantity)
        return cls(frf, np.broadcast_to(np.asarray(sd, dtype=float) ** 2, frf.values.shape))

    @property
    def in_full(self) -> str:
        """Quantity, DOFs and lines in words."""
        return f"{self.frf.in_full}{', synthetic' if self.synthetic else ''}"

    @property
    def frfs(self) -> "FrfData":
        """These."""
        return self

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Lines, values and their variance."""
        return {"frequency_hz": self.frf.frequency_hz, "values": self.frf.values, "variance": self.variance}

    @property
    def band_hz(self) -> tuple[float, float]:
        """First and last line, Hz."""
        return float(self.frf.frequency_hz[0]), float(self.frf.frequency_hz[-1])

    @property
    def dofs(self) -> tuple[str, ...]:
        """Outputs, then inputs."""
        return self.frf.outputs + self.frf.inputs

    @property
    def layout(self) -> dict[str, object]:
        """What must be the same of other FRFs for these to stand for them."""
        frf = self.frf
        lines = tuple(frf.frequency_hz.tolist())
        return {"data": "FRFs", "quantity": frf.quantity, "outputs": frf.outputs, "inputs": frf.inputs, "lines": lines}

    def with_values(self, values: NDArray[Any]) -> "FrfData":
        """The same with other values, computed, without FRFs at the joint, which these do not hold."""
        return FrfData(replace(self.frf, values=values), self.variance, synthetic=True, variance_dof=self.variance_dof)

    def in_short(self, quote: Callable[[str], str] = str) -> str:
        """Quantity, DOFs and lines."""
        pairs = f"{list_labels(self.frf.outputs)} / {list_labels(self.frf.inputs)}"
        return f"{self.frf.quantity} {quote(pairs)}, {self.frf.n_lines} lines to {self.top_hz:g} Hz"

    def require_enough(self) -> None:
        """Refuse FRFs of one line, which cannot say whether a model explains them.

        Raises
        ------
        MeasurementError
            If there are fewer than two lines.
        """
        if self.frf.n_lines < 2:
            raise refusal("FRFs", f"{self.frf.n_lines} line, at {self.top_hz:g} Hz", "two or more", "widen the band")

    def converted(self, quantity: Quantity) -> "FrfData":
        """The same as receptance, mobility or accelerance."""
        factor = np.abs(quantity_factor(self.frf.frequency_hz, quantity, self.frf.quantity))[:, None, None]
        return replace(self, frf=self.frf.converted(quantity), variance=self.variance * factor**2)

    def split(self, bands_hz: Sequence[tuple[float, float]]) -> tuple["FrfData", "FrfData"]:
        """The FRFs at the lines outside of some bands, and those at the lines inside, ends included.

        Raises
        ------
        MeasurementError
            If there is no line on one of the two sides.
        """
        lines = self.frf.frequency_hz[:, None]
        low, high = np.array(bands_hz).T
        inside = ((lines >= low) & (lines <= high)).any(axis=1)
        if inside.all() or not inside.any():
            found = f"{inside.sum()} of {inside.size} lines in the bands"
            raise refusal("left out", found, "some, but not all", "correct the bands")
        return self.at_lines(~inside), self.at_lines(inside)

    def at_lines(self, lines: Lines) -> "FrfData":
        """Some of the lines: a mask or indices over lines, or a slice."""
        at_joint = None if self.joint_frf is None else self.joint_frf.at_lines(lines)
        return replace(self, frf=self.frf.at_lines(lines), variance=self.variance[lines], joint_frf=at_joint)

    def select(self, outputs: Sequence[str], inputs: Sequence[str]) -> "FrfData":
        """The FRFs between the given DOFs only, in the order given."""
        rows, columns = [self.frf.outputs.index(o) for o in outputs], [self.frf.inputs.index(i) for i in inputs]
        return replace(self, frf=self.frf.select(outputs, inputs), variance=self.variance[:, rows][:, :, columns])


class ModalData(Data):
    """What a list of natural frequencies and a table of modes have in common: values of modes, each with its sd.

    Natural frequencies stand in `frequency_hz`, shape (n,), with their `sd_hz`; what enters the likelihood, these or
    more, in `values` and `sd`, shape (m,).
    """

    __slots__ = ()
    words: ClassVar[str] = "natural frequencies"
    #: Whether measured modes are compared with those of their number, or of the nearest shape.
    match: Match = "number"
    frequency_hz: Array
    sd_hz: Array

    @property
    def modes(self) -> "ModalData":
        """These."""
        return self

    @property
    def values(self) -> Array:
        """Measured values, shape (m,)."""
        return self.frequency_hz

    @property
    def sd(self) -> Array:
        """Their standard deviations, shape (m,)."""
        return self.sd_hz

    @property
    def numbers(self) -> tuple[int, ...]:
        """Number of each mode, from 1, as far as the data state it: the place of its natural frequency."""
        return tuple(range(1, self.frequency_hz.size + 1))

    @property
    def value_names(self) -> tuple[str, ...]:
        """What each of `values` is: ``"frequency 2"``, or ``"eigenvalue"``, ``"damping"`` or ``"shape"`` of a mode."""
        return tuple(f"frequency {number}" for number in self.numbers)

    @property
    def most_modes(self) -> int:
        """How many of the lowest modes of a structure the data may show."""
        return max(self.numbers) + (_MORE if self.match == "shape" else 0)

    @property
    def lowest_hz(self) -> tuple[float, ...] | None:
        """Natural frequencies, if they are the lowest, each of them, in rising order, Hz."""
        return tuple(self.frequency_hz.tolist())

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest natural frequency, Hz."""
        return float(self.frequency_hz.min()), float(self.frequency_hz.max())

    def in_short(self, quote: Callable[[str], str] = str) -> str:
        """How many."""
        return f"{self.frequency_hz.size} {self.words}"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FrequencyData(ModalData):
    """Measured natural frequencies, lowest first, with standard deviations; both shape (n,), Hz.

    `provenance` as in `FrfData`.

    Raises
    ------
    MeasurementError
        If frequencies do not increase or a standard deviation is not positive.
    """

    frequency_hz: Array
    sd_hz: Array
    provenance: Provenance | None = None

    def __post_init__(self) -> None:
        convert_fields(self, read_only, "frequency_hz", "sd_hz")
        if self.frequency_hz.ndim != 1 or self.frequency_hz.size == 0 or self.frequency_hz.shape != self.sd_hz.shape:
            raise MeasurementError(
                "natural frequencies: expected a list of at least one, and as many standard deviations as frequencies"
            )
        if not (np.isfinite(self.frequency_hz).all() and (np.diff(self.frequency_hz, prepend=0.0) > 0).all()):
            raise refusal("natural frequencies", f"{self.frequency_hz.tolist()} Hz", "rising ones above 0", "sort them")
        if not (np.isfinite(self.sd_hz).all() and (self.sd_hz > 0).all()):
            found, expected = f"found standard deviations {self.sd_hz.tolist()} Hz", "all above 0"
            raise MeasurementError.of("natural frequencies", ("sd_hz",), found, expected, "correct them")

    @property
    def in_full(self) -> str:
        """Each natural frequency with its standard deviation."""
        pairs = zip(self.frequency_hz, self.sd_hz, strict=True)
        return ", ".join(f"{f:g} ± {sd:.2g} Hz" for f, sd in pairs)

    def with_values(self, values: Array) -> "FrequencyData":
        """The same with other frequencies, shape (n,), Hz."""
        return FrequencyData(values, self.sd_hz)
