"""Frequency response functions with their labels: an immutable set of lines × outputs × inputs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import get_args

import numpy as np

from vibrecords.arrays import Array, ComplexArray, OverFrequency, Quantity, convert_fields, quantity_factor
from vibrecords.errors import MeasurementError, read_only, refusal, require_one_of
from vibrecords.labels import list_labels
from vibrecords.notebook_view import frf_svg, table_html


@dataclass(frozen=True, slots=True, eq=False)
class FrfSet(OverFrequency):
    """FRFs between output and input DOFs; arrays are copied and read-only.

    Parameters
    ----------
    frequency_hz
        Frequency lines, strictly increasing and positive, shape (lines,), Hz.
    values
        Complex FRFs, shape (lines, outputs, inputs); SI units of the quantity per newton (or newton metre).
    outputs, inputs
        DOF labels such as ``"11:y"``.
    quantity
        ``"receptance"`` (displacement), ``"mobility"`` (velocity) or ``"accelerance"`` (acceleration).
    coherence
        γ² in [0, 1], shape as `values`, or None where unknown.
    averages
        Number of averages behind each FRF, or None where unknown.
    window_rate
        a of an exponential window whose damping is still in the values, 1/s; modes are listed without it.

    Raises
    ------
    MeasurementError
        If shapes disagree, a number is not finite, lines do not increase, a label occurs twice, or the
        quantity, coherence or number of averages is impossible.
    """

    frequency_hz: Array
    values: ComplexArray
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    quantity: Quantity = "receptance"
    coherence: Array | None = None
    averages: int | None = None
    window_rate: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", read_only(self.values, complex))
        convert_fields(self, read_only, "frequency_hz", "coherence")
        convert_fields(self, tuple, "outputs", "inputs")
        require_lines(self.frequency_hz, "FRF set")
        shape = (self.frequency_hz.size, len(self.outputs), len(self.inputs))
        if self.values.shape != shape:
            raise refusal("FRF set", f"values of shape {self.values.shape}", f"{shape} (lines, outputs, inputs)")
        if not np.isfinite(self.values).all():
            line, output, _ = np.argwhere(~np.isfinite(self.values))[0]
            found = f"NaN or infinity at {self.frequency_hz[line]:g} Hz, output {self.outputs[output]!r}"
            raise refusal("FRF set", found, "finite numbers", "drop or repair the line")
        for labels in (self.outputs, self.inputs):
            if len(set(labels)) != len(labels):
                raise refusal("FRF set", f"DOFs {labels}", "each label once")
        require_one_of(get_args(Quantity), self.quantity, "FRF set", "quantity ")
        if self.coherence is not None and (
            self.coherence.shape != shape or not ((self.coherence >= 0) & (self.coherence <= 1)).all()
        ):
            raise MeasurementError(f"FRF set: expected coherence in [0, 1] of shape {shape}; correct it, or drop it")
        if self.averages is not None and not (isinstance(self.averages, Integral) and self.averages >= 1):
            raise refusal("FRF set", f"{self.averages} averages", "1 or more")

    def __repr__(self) -> str:
        return f"FrfSet({self.in_full})"

    @property
    def in_full(self) -> str:
        """Quantity, DOFs and lines in words."""
        f = self.frequency_hz
        dofs = f"outputs {list_labels(self.outputs)}, inputs {list_labels(self.inputs)}"
        return f"{self.quantity}, {dofs}, {f.size} lines from {f[0]:g} to {f[-1]:g} Hz"

    def _repr_html_(self) -> str:
        rows = [(label, ", ".join(labels)) for label, labels in (("Outputs", self.outputs), ("Inputs", self.inputs))]
        drawing = frf_svg(self.frequency_hz, {f"{self.outputs[0]}/{self.inputs[0]}": self.values[:, 0, 0]})
        return table_html(f"{self.quantity.capitalize()}, {self.n_lines} lines", ("", "DOFs"), rows, drawing)

    @property
    def n_lines(self) -> int:
        """Number of frequency lines."""
        return self.frequency_hz.size

    def frf(self, output: str, input_: str) -> ComplexArray:
        """One FRF, shape (lines,).

        Raises
        ------
        MeasurementError
            If a DOF is not in the set.
        """
        return self.values[:, _position(self.outputs, output), _position(self.inputs, input_)]

    def select(self, outputs: Sequence[str], inputs: Sequence[str]) -> "FrfSet":
        """Return the FRFs between the given DOFs only, in the order given."""
        rows = [_position(self.outputs, label) for label in outputs]
        columns = [_position(self.inputs, label) for label in inputs]
        cut = np.ix_(range(self.n_lines), rows, columns)
        coherence = None if self.coherence is None else self.coherence[cut]
        return replace(self, values=self.values[cut], outputs=tuple(outputs), inputs=tuple(inputs), coherence=coherence)

    def converted(self, quantity: Quantity) -> "FrfSet":
        """Return the same FRFs as receptance, mobility jωH or accelerance −ω²H."""
        factor = quantity_factor(self.frequency_hz, quantity, self.quantity)
        return replace(self, values=self.values * factor[:, None, None], quantity=quantity)


def require_lines(frequency_hz: Array, where: str) -> None:
    """Refuse frequency lines that are none, not finite, not above 0 Hz or out of order.

    Raises
    ------
    MeasurementError
        Naming the first line that is wrong.
    """
    if frequency_hz.ndim != 1 or frequency_hz.size == 0:
        raise refusal(where, "no frequency lines", "a one-dimensional array of at least one")
    broken, low = np.flatnonzero(~np.isfinite(frequency_hz)), frequency_hz[frequency_hz <= 0]
    if broken.size:
        found = f"frequency {frequency_hz[broken[0]]} at line {broken[0] + 1}"
        raise refusal(where, found, "finite frequencies", "repair the file")
    if low.size:
        raise refusal(where, f"a line at {low[0]:g} Hz", "lines above 0 Hz", "drop it, or cut it away with f_min_hz")
    backwards = np.flatnonzero(np.diff(frequency_hz) <= 0)
    if backwards.size:
        i = int(backwards[0])
        found = f"{frequency_hz[i + 1]:g} Hz after {frequency_hz[i]:g} Hz (line {i + 2})"
        raise refusal(where, found, "strictly increasing frequencies", "sort the lines and drop doubled ones")


def _position(labels: tuple[str, ...], label: str) -> int:
    require_one_of(labels, label, "FRF set", "DOF ", "correct the label")
    return labels.index(label)
