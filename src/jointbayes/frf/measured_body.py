"""Bodies given by their measured FRFs, and structures that are joined from these and modelled ones.

Receptance coupling substructure analysis, RCSA: a spindle with its holder has no model to be trusted, but its
FRFs where the tool will sit can be measured.

References
----------
Schmitz, T. L., Donaldson, R. R. (2000). Predicting high-speed machining dynamics by substructure analysis. CIRP Annals
49(1), 303-308. DOI 10.1016/S0007-8506(07)62951-5
de Klerk, D., Rixen, D. J., Voormeeren, S. N. (2008). General framework for dynamic substructuring: history, review and
classification of techniques. AIAA Journal 46(5), 1169-1181. DOI 10.2514/1.33274
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import MeasurementError, ModelError
from jointbayes.structure import Body
from vibrecords import FrfSet, MeasuredFile, quantity_factor
from vibrecords.arrays import Array, ComplexArray, Indices, convert_fields
from vibrecords.errors import read_only

#: Lines whose frequencies differ by less than this, relative, are the same.
SAME_LINE = 1e-9
#: A_ab and A_ba that differ by this share of their size, at half of the lines, are of opposite sign or other DOFs.
NOT_RECIPROCAL = 0.5
_SYMMETRIC, _NEGATIVE = 1e-9, -1e-9


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredBody:
    """A body that is known by its measured receptances between m DOFs, and by the covariance of their errors.

    Reciprocity is used: what is stored, and what has errors, are the P = m(m + 1)/2 receptances A_ab with a ≤ b, in the
    order of `numpy.triu_indices`. `of` makes a body of FRFs.

    Parameters
    ----------
    name
        By which messages and reports know it.
    frequency_hz
        Lines, strictly increasing, shape (lines,), Hz.
    dofs
        Labels of the m DOFs, ``"spindle:y"`` or ``"101:y"``.
    receptance
        Without the joint, symmetric, shape (lines, m, m), m/N and its like for rotations and moments.
    covariance
        E[δA δA*] of the errors of the P receptances at each line, which are complex circular and independent from line
        to line; real, shape (lines, P, P).
    discrepancy
        Mean square of A_ab − A_ba over what the errors of both allow, 1 expected; None where no pair was measured both
        ways.
    files
        In which it was measured, if in any.

    Raises
    ------
    MeasurementError
        If shapes disagree, a number is not finite, lines do not increase, the receptances are not symmetric, or the
        covariance is none.
    """

    name: str
    frequency_hz: Array
    dofs: tuple[str, ...]
    receptance: ComplexArray
    covariance: Array
    discrepancy: float | None = None
    files: tuple[MeasuredFile, ...] = ()

    @property
    def arrays(self) -> tuple[Array, ComplexArray, Array]:
        """Lines, receptances and their covariance: what is measured, in numbers."""
        return self.frequency_hz, self.receptance, self.covariance

    def __post_init__(self) -> None:
        object.__setattr__(self, "receptance", read_only(self.receptance, complex))
        convert_fields(self, read_only, "frequency_hz", "covariance")
        convert_fields(self, tuple, "dofs", "files")
        lines, m = self.frequency_hz.size, len(self.dofs)
        pairs = m * (m + 1) // 2
        if m == 0 or len(set(self.dofs)) != m:
            raise MeasurementError.of(f"{self._where}", (), f"found DOFs {self.dofs}", "one or more, each label once")
        if self.frequency_hz.ndim != 1 or not lines or not (np.diff(self.frequency_hz) > 0).all():
            found, expected = "found lines that do not increase", "one or more frequencies, each above the one before"
            raise MeasurementError.of(f"{self._where}", (), found, expected, "sort them with their receptances")
        for what, array, shape in (
            ("receptances", self.receptance, (lines, m, m)),
            ("a covariance", self.covariance, (lines, pairs, pairs)),
        ):
            if array.shape != shape or not np.isfinite(array).all():
                found = f"found {what} of shape {array.shape}"
                raise MeasurementError.of(f"{self._where}", (), found, f"finite numbers of shape {shape}")
        if not _is_symmetric(self.receptance):
            found = "found receptances that are not symmetric"
            raise MeasurementError.of(f"{self._where}", (), found, "A_ab = A_ba", "use MeasuredBody.of")
        size = np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=1, axis2=2), 0.0))
        size = np.where(size > 0, size, 1.0)
        lowest = np.linalg.eigvalsh(self.covariance / (size[:, :, None] * size[:, None, :]))[:, 0]
        if not _is_symmetric(self.covariance) or not (lowest >= _NEGATIVE).all():
            found = "found a covariance that is not positive semidefinite at some line"
            raise MeasurementError.of(f"{self._where}", (), found, "one that is", "correct the variances")

    def __repr__(self) -> str:
        f = self.frequency_hz
        return f"MeasuredBody({self.name}: {', '.join(self.dofs)}; {f.size} lines from {f[0]:g} to {f[-1]:g} Hz)"

    @property
    def _where(self) -> str:
        return f"measured body {self.name}".rstrip()

    @classmethod
    def of(cls, frf: FrfSet, variance: ArrayLike, name: str = "body") -> "MeasuredBody":
        """The body of FRFs between its DOFs, each pair measured at least one way round.

        Of a pair that was measured both ways the two are averaged, each with the inverse of its variance.

        Parameters
        ----------
        frf
            FRFs of any quantity; outputs and inputs may differ as long as no pair of DOFs is missing.
        variance
            E|δH|² of each, in the same quantity, shape as ``frf.values``; 0 for exact ones.
        name
            Of the body.

        Raises
        ------
        MeasurementError
            If a pair was not measured, a variance is negative, or two FRFs that reciprocity makes equal are far from
            it.
        """
        factor = quantity_factor(frf.frequency_hz, "receptance", frf.quantity)[:, None, None]
        values, variances = frf.values * factor, np.asarray(variance, dtype=float) * np.abs(factor) ** 2
        if variances.shape != values.shape or not (np.isfinite(variances).all() and (variances >= 0).all()):
            found = f"found variances of shape {variances.shape}"
            raise MeasurementError.of(f"measured body {name}", (), found, f"{values.shape}, 0 or more")
        dofs = tuple(dict.fromkeys((*frf.outputs, *frf.inputs)))
        rows, columns = np.triu_indices(len(dofs))
        entries = np.empty((len(values), rows.size), dtype=complex)
        spread, off = np.empty((len(values), rows.size)), list[float]()
        for pair, (a, b) in enumerate(zip(rows, columns, strict=True)):
            both = dict.fromkeys(((dofs[a], dofs[b]), (dofs[b], dofs[a])))
            measured = [(o, i) for o, i in both if o in frf.outputs and i in frf.inputs]
            if not measured:
                raise MeasurementError(
                    f"measured body {name}: found no FRF between {dofs[a]} and {dofs[b]}; expected one way round at "
                    f"least of every pair of {', '.join(dofs)}; measure it, or leave the DOF out"
                )
            at = [(slice(None), frf.outputs.index(o), frf.inputs.index(i)) for o, i in measured]
            ways = [(values[place], variances[place]) for place in at]
            entries[:, pair], spread[:, pair] = _averaged(ways)
            if len(ways) == 1:
                continue
            (first, v1), (second, v2) = ways
            gap, noisy = np.abs(first - second), v1 + v2 > 0
            if np.median(gap) > NOT_RECIPROCAL * np.median((np.abs(first) + np.abs(second)) / 2):
                found = "found FRFs that differ by more than half of their size when response and force change places"
                expected, remedy = "them equal by reciprocity", "check directions, signs and labels of the channels"
                raise MeasurementError.of(f"measured body {name}: {dofs[a]} and {dofs[b]}", (), found, expected, remedy)
            if noisy.any():
                off.append(float(np.mean(gap[noisy] ** 2 / (v1 + v2)[noisy])))
        receptance = np.empty((len(values), len(dofs), len(dofs)), dtype=complex)
        receptance[:, rows, columns] = receptance[:, columns, rows] = entries
        covariance = spread[:, :, None] * np.eye(rows.size)
        discrepancy = float(np.mean(off)) if off else None
        return cls(name, frf.frequency_hz, dofs, receptance, covariance, discrepancy)

    def seen_at(self, motions: Mapping[str, Mapping[str, float]]) -> "MeasuredBody":
        """The body between other motions, each a sum of the measured ones: A′ = T A Tᵀ, with the covariance of it.

        For a joint that is not where the sensors are, and for rotations: two sensors at x = 10 and 30 mm on a rigid
        flange give y and rz at x = 0 as ``{"0:y": {"a:y": 1.5, "b:y": -0.5}, "0:rz": {"a:y": -50, "b:y": 50}}``.

        Parameters
        ----------
        motions
            Label of each motion, with the share of each measured DOF in it: 1 for the DOF itself, 1/m in rotations.

        Raises
        ------
        MeasurementError
            If a DOF was not measured.
        """
        turn = np.zeros((len(motions), len(self.dofs)))
        for row, (label, shares) in enumerate(motions.items()):
            for dof, share in shares.items():
                if dof not in self.dofs:
                    found, expected = f"found {dof} in the motion {label}", f"one of {', '.join(self.dofs)}"
                    raise MeasurementError.of(f"{self._where}", (), found, expected, "measure it or correct the label")
                turn[row, self.dofs.index(dof)] = share
        a, b = np.triu_indices(len(self.dofs))
        p, q = np.triu_indices(len(motions))
        # A′_pq = Σ T_pa T_qb A_ab, and each A_ab off the diagonal stands there twice
        spread = turn[p][:, a] * turn[q][:, b] + np.where(a == b, 0.0, 1.0) * turn[p][:, b] * turn[q][:, a]
        receptance = turn @ self.receptance @ turn.T
        receptance = (receptance + receptance.swapaxes(1, 2)) / 2
        covariance = spread @ self.covariance @ spread.T
        covariance = (covariance + covariance.swapaxes(1, 2)) / 2
        return replace(self, dofs=tuple(motions), receptance=receptance, covariance=covariance)

    def at_lines(self, frequency_hz: Array) -> "MeasuredBody":
        """The body at some of its lines.

        Raises
        ------
        ModelError
            If a line is none of its own: between lines a resonance may lie, so that nothing is interpolated.
        """
        wanted = np.asarray(frequency_hz, dtype=float)
        if wanted.shape == self.frequency_hz.shape and (wanted == self.frequency_hz).all():
            return self
        after = np.clip(np.searchsorted(self.frequency_hz, wanted), 1, max(self.frequency_hz.size - 1, 1))
        near = np.stack([after - 1, np.minimum(after, self.frequency_hz.size - 1)])
        apart = np.abs(self.frequency_hz[near] - wanted)
        row = near[apart.argmin(axis=0), np.arange(wanted.size)]
        off = np.abs(self.frequency_hz[row] - wanted) > SAME_LINE * wanted
        if off.any():
            first = int(off.argmax())
            raise ModelError(
                f"{self._where}: found no line at {wanted[first]:g} Hz ({int(off.sum())} of {wanted.size} lines are "
                f"missing; the nearest is {self.frequency_hz[row[first]]:g} Hz); expected FRFs of the body at the very "
                "lines of the data, since nothing is interpolated; measure both with the same lines, or cut the data"
            )
        chosen = self.frequency_hz[row], self.receptance[row], self.covariance[row]
        return replace(self, frequency_hz=chosen[0], receptance=chosen[1], covariance=chosen[2])


def _is_symmetric(arrays: NDArray[np.inexact]) -> bool:
    scale = np.abs(arrays).max(axis=(1, 2), initial=0.0)
    return bool((np.abs(arrays - arrays.swapaxes(1, 2)).max(axis=(1, 2), initial=0.0) <= _SYMMETRIC * scale).all())


def _averaged(ways: Sequence[tuple[ComplexArray, Array]]) -> tuple[ComplexArray, Array]:
    """Mean of one FRF or two, weighted by the inverse of their variances, and its variance."""
    if len(ways) == 1:
        return ways[0]
    (first, v1), (second, v2) = ways
    total = np.where(v1 + v2 > 0, v1 + v2, 1.0)
    share = np.where(v1 + v2 > 0, v2 / total, 0.5)
    return share * first + (1 - share) * second, np.where(v1 + v2 > 0, v1 * v2 / total, 0.0)


@dataclass(frozen=True, eq=False)
class Substructures:
    """Bodies that nothing but the joints holds together: modelled ones, and measured ones.

    Parameters
    ----------
    modelled
        Body without the joints. Modal damping acts in its own free modes, rigid-body modes
        not counted, since there are no modes of the assembled structure.
    measured
        Bodies given by their FRFs; joints, outputs and inputs name their DOFs like the DOFs of any other body.
    propagate
        Whether the errors of the measured FRFs count in the likelihood. If not, intervals are too narrow.

    Raises
    ------
    ModelError
        If two bodies share a name or the label of a DOF.
    """

    modelled: Body
    measured: tuple[MeasuredBody, ...]
    propagate: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "measured", tuple(self.measured))
        names = [body.name for body in self.measured]
        if len(set(names)) != len(names):
            raise ModelError.of("substructures", (), f"found bodies {', '.join(names)}", "each name once", "rename one")
        owner = dict.fromkeys(self.modelled.labels if self.measured else (), "the modelled structure")
        for body in self.measured:
            for label in body.dofs:
                if label in owner:
                    found = f"found DOF {label} in measured body {body.name} and in {owner[label]}"
                    expected = "each label in one body"
                    raise ModelError.of("substructures", (), found, expected, "rename it in one of them")
                owner[label] = f"measured body {body.name}"

    def __repr__(self) -> str:
        return f"Substructures({', '.join(map(repr, (self.modelled, *self.measured)))})"

    @property
    def n_dofs(self) -> int:
        """DOFs of all bodies; the DOFs of the modelled bodies come first."""
        return self.modelled.n_dofs + sum(len(body.dofs) for body in self.measured)

    def index(self, labels: Sequence[str]) -> Indices:
        """Row numbers of DOF labels among those of all bodies, shape (len(labels),).

        Raises
        ------
        ModelError
            If no body has the label.
        """
        rows = self._measured_rows
        places = np.empty(len(labels), dtype=np.intp)
        for i, label in enumerate(labels):
            places[i] = rows[label] if label in rows else self.modelled.index((label,))[0]
        return places

    def position(self, label: str) -> tuple[float, float, float] | None:
        """Return the position of a DOF of a modelled body, if it is known; a measured body has no positions."""
        return None if label in self._measured_rows else self.modelled.position(label)

    def at(self, dofs: Iterable[str], top_hz: float) -> "Substructures":
        """The same bodies, the modelled ones exact at these DOFs up to this frequency."""
        modelled = [label for label in dofs if label not in self._measured_rows]
        return replace(self, modelled=self.modelled.at(modelled, top_hz))

    @cached_property
    def _measured_rows(self) -> dict[str, int]:
        labels = [label for body in self.measured for label in body.dofs]
        return {label: self.modelled.n_dofs + i for i, label in enumerate(labels)}


AnyStructure = Body | Substructures
"""What forward models are made of."""


def substructures(structure: AnyStructure) -> Substructures:
    """Substructures as they are; a body as substructures without a measured one."""
    return structure if isinstance(structure, Substructures) else Substructures(structure, ())
