"""Measurements as inference takes them: values with the variance of their noise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError
from jointbayes.frf import FrfSet, Quantity, quantity_factor
from jointbayes.frf.frf_set import read_only
from jointbayes.measurement.provenance import Provenance


@dataclass(frozen=True, slots=True, eq=False)
class FrfData:
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

    frf: FrfSet
    variance: Array
    synthetic: bool = False
    variance_dof: int | None = None
    joint_frf: FrfSet | None = None
    provenance: Provenance | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "variance", read_only(self.variance))
        if self.variance.shape != self.frf.values.shape:
            raise MeasurementError(
                f"noise: found a variance of shape {self.variance.shape}; expected {self.frf.values.shape}"
            )
        if not (np.isfinite(self.variance).all() and (self.variance > 0).all()):
            raise MeasurementError("noise: found a variance that is not above zero at some line; raise the noise floor")

    def __repr__(self) -> str:
        return f"FrfData({self.frf!r}{', synthetic' if self.synthetic else ''})"

    @property
    def top_hz(self) -> float:
        """Highest frequency, Hz."""
        return float(self.frf.frequency_hz[-1])

    def require_lines(self) -> None:
        """Refuse FRFs of one line, of which nobody can say whether a model explains them.

        Raises
        ------
        MeasurementError
            If there are fewer than two lines.
        """
        if self.frf.n_lines < 2:
            raise MeasurementError(
                f"FRFs: found {self.frf.n_lines} line, at {self.top_hz:g} Hz; expected two or more, so that residuals "
                "can be compared with each other; widen the band"
            )

    def converted(self, quantity: Quantity) -> "FrfData":
        """The same as receptance, mobility or accelerance."""
        factor = np.abs(quantity_factor(self.frf.frequency_hz, quantity, self.frf.quantity))[:, None, None]
        return replace(self, frf=self.frf.converted(quantity), variance=self.variance * factor**2)

    def select(self, outputs: Sequence[str], inputs: Sequence[str]) -> "FrfData":
        """The FRFs between the given DOFs only, in the order given."""
        rows, columns = [self.frf.outputs.index(o) for o in outputs], [self.frf.inputs.index(i) for i in inputs]
        return replace(self, frf=self.frf.select(outputs, inputs), variance=self.variance[:, rows][:, :, columns])


class ModalData:
    """What a list of natural frequencies and a table of modes have in common: values of modes, each with its sd.

    Natural frequencies stand in `frequency_hz`, shape (n,), with their `sd_hz`; what enters the likelihood, these or
    more, in `values` and `sd`, shape (m,).
    """

    __slots__ = ()
    frequency_hz: Array
    sd_hz: Array

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
    def most_modes(self) -> int:
        """How many of the lowest modes of a structure the data may show."""
        return max(self.numbers)

    @property
    def lowest(self) -> bool:
        """Whether they are the lowest modes, each of them, in rising order."""
        return True

    @property
    def dofs(self) -> tuple[str, ...]:
        """DOFs at which something was measured."""
        return ()

    @property
    def top_hz(self) -> float:
        """Highest frequency, Hz."""
        return float(self.frequency_hz.max())

    @property
    def joint_frf(self) -> None:
        """None: modes come without FRFs at the joint."""
        return

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All numbers that were measured or stated."""
        return self.frequency_hz, self.sd_hz


@dataclass(frozen=True, slots=True, eq=False)
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
        object.__setattr__(self, "frequency_hz", read_only(self.frequency_hz))
        object.__setattr__(self, "sd_hz", read_only(self.sd_hz))
        if self.frequency_hz.ndim != 1 or self.frequency_hz.size == 0 or self.frequency_hz.shape != self.sd_hz.shape:
            raise MeasurementError(
                "natural frequencies: expected a list of at least one, and as many standard deviations as frequencies"
            )
        if not (np.isfinite(self.frequency_hz).all() and (np.diff(self.frequency_hz, prepend=0.0) > 0).all()):
            raise MeasurementError(
                f"natural frequencies: found {self.frequency_hz.tolist()} Hz; "
                "expected positive, strictly increasing values; sort them"
            )
        if not (np.isfinite(self.sd_hz).all() and (self.sd_hz > 0).all()):
            raise MeasurementError("natural frequencies: expected standard deviations above 0 Hz; correct them")

    def __repr__(self) -> str:
        pairs = zip(self.frequency_hz, self.sd_hz, strict=True)
        return f"FrequencyData({', '.join(f'{f:g} ± {sd:.2g} Hz' for f, sd in pairs)})"

    def with_values(self, values: Array) -> "FrequencyData":
        """The same with other frequencies, shape (n,), Hz."""
        return FrequencyData(values, self.sd_hz)
