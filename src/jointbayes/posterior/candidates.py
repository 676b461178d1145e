"""Further measurements, and what each would tell: the Fisher information of data that the model itself makes.

A further measurement is made by the present sensors. Their noise is absolute: where the structure hardly moves, as at a
clamp, a sensor sees little but its own noise.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from jointbayes.frf import Ports
from jointbayes.inference import ModelErrorNoise, Problem, Test
from jointbayes.joint import Joints
from jointbayes.posterior.fisher import fisher_information
from vibrecords import Antiresonances, FrfData, FrfSet, ModalData, ModeData, ModeShapes, Observed
from vibrecords.arrays import Array

ComplexArray = NDArray[np.complex128]
VarianceLaw = Callable[[ComplexArray], Array]
"""σ² = E|δH|² of FRFs from their values, both shape (lines, outputs, inputs)."""

#: Places of one further sensor that are looked at in each test.
_MOST_PLACES = 8
_AVERAGES = 4
#: Quantities of a body of which its frequencies say the same whether it is free or joined.
_OF_BODY = frozenset({"youngs_modulus", "density", "length"})
#: How well a scale knows the mass of a part, as a fraction.
_WEIGHED = 1e-3
#: How well a sensor that was calibrated next to another knows a ratio of components, as a fraction of it; and the noise
#: of the sensor, as a fraction of the component at the reference.
_CALIBRATED, _NOISE = 0.01, 1e-3
#: Standard deviation of natural frequencies next to a ratio, of which nothing is said, as a fraction.
_UNKNOWN = 1e3
_KNOWN = 1 + 1e-6  # factor by which the size of an error may be larger where it is known


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A further measurement, independent of the present ones given the parameters.

    Parameters
    ----------
    words
        The measurement, for a sentence: ``"an accelerometer at 191.5 mm (6:y)"``.
    price
        What it costs, for a sentence: ``"a sensor and its FRF"``.
    information
        Fisher information about θ that it adds, shape (d, d), where θ, shape (d,), is the truth.
    """

    words: str
    price: str
    information: Callable[[Array], Array]


def candidates_of(problem: Problem) -> Iterator[Candidate]:
    """Yield the further measurements that a problem could be given.

    1. The structure without its joints, where its material or length is uncertain: hit free, weighed, or both.
    2. In each test with FRFs: one sensor more, at several places, or four times the averages.
    3. In each test with modes: two modes more, one sensor more, or two antiresonances.
    """
    free_is_known = not all(part.test.joints.size for part in problem.parts)
    for part in problem.parts:
        measured, modes = part.test.data.frfs, part.test.data.modes
        if not free_is_known and _is_free_the_same_body(part.test):
            yield from _without_joints(part)
        if not part.test.joints.size:
            continue
        if measured is not None:
            yield from _next_to_frfs(part, measured)
        elif modes is not None:
            yield from _next_to_modes(part, modes)


# ---- the structure without its joints


def _is_free_the_same_body(test: Test) -> bool:
    """Whether the structure of a test without its joints is the same body, hangs on nothing else, and is uncertain.

    Where the edge of the clamp is uncertain as a length in mm the bar goes on behind it, and is another one free.
    """
    joints = test.joints.joints
    to_ground = joints and not any(joint.against for joint in joints) and not test.measured_bodies
    supports = getattr(getattr(test.structures, "recipe", None), "supports", ())
    uncertain = {name.rpartition(".")[2] for name in test.structures.names}
    return bool(to_ground and not supports and "length_offset" not in uncertain and uncertain & _OF_BODY)


def _without_joints(part: Problem) -> Iterator[Candidate]:
    """Yield tests of the structure without its joints, made as the present one is."""
    test = part.test
    free = replace(part, tests=(replace(test, name=test.name or "free", joints=Joints(())),), extra_log_likelihood=None)
    hit: Callable[[Array], Array] | None = None
    if (measured := test.data.frfs) is not None:
        frf = measured.frf
        ports, law = Ports(frf.frequency_hz, frf.outputs, frf.inputs), sensor_noise(measured, frf.outputs)
        hit = _information(lambda theta: frfs_there(free, ports, law, measured, theta))
    elif (modes := test.data.modes) is not None and (numbers := free_modes(test, modes)):
        hit = _information(lambda theta: modes_there(free, theta, numbers, scatter(modes)))
    # ln of the mass is ln of the density plus ln of the length
    names = [part.prior.nuisances[i].name for i in part.structural_columns]
    ends = [name.rpartition(".")[2] for name in test.structures.names]
    row = np.zeros(len(part.names))
    for name, end in zip(names, ends, strict=True):
        row[part.names.index(name)] = end in ("density", "length")
    mass = np.outer(row, row) / _WEIGHED**2 if ends.count("density") == 1 else None
    of_test = _of_test(test)
    if hit is not None:
        words = f"a test of the structure hit free, before it is joined{of_test}"
        yield Candidate(words, "a test without the joint", hit)
    if mass is not None:
        words = f"the structure weighed to {100 * _WEIGHED:g} %, before it is joined{of_test}"
        yield Candidate(words, "a scale", lambda _: mass)
    if hit is not None and mass is not None:
        words = f"the structure weighed to {100 * _WEIGHED:g} % and hit free, before it is joined{of_test}"
        yield Candidate(words, "a scale and a test without the joint", lambda theta: hit(theta) + mass)


def free_modes(test: Test, modes: ModalData) -> tuple[int, ...]:
    """Numbers of the natural frequencies that a test of the structure without its joints would give.

    As many as there are now; fewer where the structure has not as many up to where it is known, as an imported model.
    """
    most = modes.frequency_hz.size
    top_hz, nowhere = test.structures.reach_hz(most), np.empty(0, dtype=np.intp)
    eigenvalues, _ = test.structures.at((), top_hz).certain().free_modes(nowhere, np.empty((0, 0)))(np.empty((1, 0)))
    there = int(((eigenvalues > 0) & (eigenvalues <= (2 * np.pi * top_hz) ** 2)).sum())
    return tuple(range(1, min(most, there) + 1))


# ---- further FRFs


def _next_to_frfs(part: Problem, measured: FrfData) -> Iterator[Candidate]:
    """Yield one sensor more, with the present forces, at several places; and more averages."""
    frf, of_test = measured.frf, _of_test(part.test)
    directions = dict.fromkeys(dof.rpartition(":")[2] for dof in frf.outputs if ":r" not in dof)
    for label, place in _free_places(part, (*frf.outputs, *frf.inputs), directions):
        ports, law = Ports(frf.frequency_hz, (label,), frf.inputs), sensor_noise(measured, (label,))
        there = _frfs(part, ports, law, measured)
        yield Candidate(f"an accelerometer at {place}{of_test}", "a sensor and its FRF", there)
    # of n averages one part is in hand: the new part alone has the variance σ²/(n − 1)
    again = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    more = _frfs(part, again, lambda _: measured.variance / (_AVERAGES - 1), measured)
    yield Candidate(f"{_AVERAGES} times the averages{of_test}", f"{_AVERAGES} times the measuring time", more)


def sensor_noise(data: FrfData, outputs: Sequence[str]) -> VarianceLaw:
    """Return the variance of further FRFs as the present sensors would measure them.

    The standard deviation of each part is a|H| + c: a relative error a of all FRFs, and for each kind of sensor
    (translation, rotation) and each force an absolute noise c. Both come from a fit, relative deviations squared. No
    value is better known than the best known one of the present sensors. Otherwise a purely relative error would
    promise everything to a sensor where nothing moves.

    Parameters
    ----------
    data
        The present FRFs with their variance.
    outputs
        DOFs of the further FRFs; the inputs are the present ones.
    """
    here, magnitude, sd = data.frf.outputs, np.abs(data.frf.values), np.sqrt(data.variance / 2)
    kinds = [":r" in dof for dof in here]
    groups = [(kind, i) for kind in sorted(set(kinds)) for i in range(len(data.frf.inputs))]
    rows = {(kind, i): (slice(None), [k == kind for k in kinds], i) for kind, i in groups}
    size = np.array([np.median(magnitude[rows[group]]) for group in groups])
    terms = np.zeros((*magnitude.shape, 1 + len(groups)))
    terms[..., 0] = magnitude / sd
    for column, group in enumerate(groups, 1):
        terms[(*rows[group], column)] = size[column - 1] / sd[rows[group]]
    fitted, _ = optimize.nnls(terms.reshape(-1, terms.shape[-1]), np.ones(magnitude.size))
    noise = dict(zip(groups, fitted[1:] * size, strict=True))
    best = {group: sd[rows[group]].min() for group in groups}
    each = [[(":r" in dof, i) for i in range(len(data.frf.inputs))] for dof in outputs]
    absolute, least = (np.array([[of[group] for group in row] for row in each]) for of in (noise, best))

    def variance(values: ComplexArray) -> Array:
        return np.asarray(2 * np.maximum(fitted[0] * np.abs(values) + absolute, least) ** 2)

    return variance


def _frfs(part: Problem, ports: Ports, law: VarianceLaw, like: FrfData) -> Callable[[Array], Array]:
    return _information(lambda theta: frfs_there(part, ports, law, like, theta))


def frfs_there(part: Problem, ports: Ports, law: VarianceLaw, like: FrfData, theta: Array) -> Problem:
    """Return the problem of one test with other FRFs as its data, exact where θ, shape (d,), is the truth."""
    part, noise = replace(part, extra_log_likelihood=None), part.test.noise  # what else is known is known once
    quantity = like.frf.quantity
    values = part.frfs_as_measured(ports, quantity, part.prior.values(theta), part.prior.factors(theta))[0]
    frf = FrfSet(ports.frequency_hz, values, ports.outputs, ports.inputs, quantity)
    data = FrfData(frf, law(values), synthetic=True)
    return part.with_test(data=data, noise=noise and noise.fitted_to(data, noise.parts))


# ---- further modes


def _next_to_modes(part: Problem, modes: ModalData) -> Iterator[Candidate]:
    """Yield two modes more, one sensor more at several places, and two antiresonances of the place that moves most."""
    test, of_test, last = part.test, _of_test(part.test), max(modes.numbers)
    if test.most_modes < last + 2:
        return
    more = _modes(part, (last + 1, last + 2), scatter(modes))
    yield Candidate(f"modes {last + 1} and {last + 2}{of_test}", "a wider band", more)
    directions = dict.fromkeys(label.rpartition(":")[2] for label in test.joints.labels if ":r" not in label)
    places, zeros = _free_places(part, modes.dofs, directions), getattr(modes, "zeros", None)
    known = (*getattr(modes, "references", ()), *(zeros.dofs if zeros else ()))
    if not (places or known):
        return
    reference, at = (known[0], known[0]) if known else places.pop()
    for label, place in places[2::3]:
        words = f"an accelerometer at {place}, calibrated with the one at {at}{of_test}"
        there = _modes(part, modes.numbers, _CALIBRATED, dof=label, reference=reference)
        yield Candidate(words, "a sensor and its FRF", there)
    seen = zip(zeros.dofs, zeros.numbers, strict=True) if zeros else ()
    first = 1 + max((number for dof, number in seen if dof == reference), default=0)
    if test.most_modes - 1 < first + 1:  # with that place held there is a mode less
        return
    how = "in a wider band" if first > 1 else "by force and sensor there"
    words = f"antiresonances {first} and {first + 1} at {at}, {how}{of_test}"
    yield Candidate(words, "a force and a sensor at one place",
                    _modes(part, (first, first + 1), scatter(modes), held=reference))  # fmt: skip


def _modes(part: Problem, numbers: tuple[int, ...], relative: float, **where: str) -> Callable[[Array], Array]:
    return _information(lambda theta: modes_there(part, theta, numbers, relative, **where))


def modes_there(
    part: Problem,
    theta: Array,
    numbers: tuple[int, ...],
    relative: float,
    *,
    dof: str = "",
    reference: str = "",
    held: str = "",
) -> Problem:
    """Return the problem of one test with other modes as its data, exact where θ, shape (d,), is the truth.

    Errors of the model in natural frequencies are those of the present ones, of which a further measurement of the same
    structure says nothing: next to ratios and antiresonances natural frequencies do not count.

    Parameters
    ----------
    numbers
        Of the modes, or of the antiresonances, from 1.
    relative
        Standard deviation of each value as a fraction of it.
    dof, reference
        Labels, for the ratio of each mode's component at one to the component at the other.
    held
        Label of the DOF at which force and sensor are, for antiresonances.
    """

    def data_of(values: Array) -> ModeData:
        frequency, ratios = np.split(values[: 2 * len(numbers)], [len(numbers)])
        if held:
            zeros = Antiresonances((held,) * len(ratios), Observed(ratios, relative * ratios), numbers)
            return ModeData(Observed(frequency, _UNKNOWN * frequency), numbers=numbers, zeros=zeros)
        if not dof:
            return ModeData(Observed(frequency, relative * frequency), numbers=numbers)
        sd = np.maximum(relative * np.abs(ratios), _NOISE)
        shapes = ModeShapes((dof,), reference, Observed(ratios[:, None], sd[:, None]))
        return ModeData(Observed(frequency, _UNKNOWN * frequency), shapes=shapes, numbers=numbers)

    def with_data(data: ModeData) -> Problem:
        noise = part.test.noise
        judged = noise and noise.fitted_to(data, noise.parts)  # type: ignore[arg-type]  # that of modes takes modes
        return replace(part, extra_log_likelihood=None).with_test(data=data, noise=judged)

    exact = with_data(data_of(np.ones(2 * len(numbers)))).log_posterior.predicted(theta)[0]
    there = with_data(data_of(exact))
    if not isinstance(there.test.noise, ModelErrorNoise):
        return there
    # errors of the model are as large as usual: data that fit exactly would say that there are none
    usual = there.test.with_model_error(replace(there.test.noise.sizes, factor=_KNOWN))
    return there.with_test(noise=usual.noise)


def scatter(modes: ModalData) -> float:
    """Standard deviation of natural frequencies that are measured as the present ones, as a fraction."""
    return float(np.median(modes.sd_hz / modes.frequency_hz))


def _information(there: Callable[[Array], Problem]) -> Callable[[Array], Array]:
    """Fisher information of further data alone, where θ is the truth, from the problem of these data there."""
    return lambda theta: fisher_information(there(theta), theta).data


def _of_test(test: Test) -> str:
    return f" in test {test.name}" if test.name else ""


def _free_places(part: Problem, measured: Collection[str], directions: Collection[str]) -> list[tuple[str, str]]:
    """Translations at which nothing is measured, in these directions, and where each is."""
    test = part.test
    positions = getattr(getattr(test.structures, "recipe", None), "positions", None) or {}
    points = tuple(positions) or tuple(dict.fromkeys(dof.partition(":")[0] for dof in test.structures.labels))
    taken = {dof.rpartition(":")[0] for dof in test.joints.labels}
    every = [
        f"{point}:{direction}" for point in points for direction in directions
        if point not in taken and f"{point}:{direction}" not in measured
    ]  # fmt: skip
    chosen = [every[i] for i in np.unique(np.linspace(0, len(every) - 1, _MOST_PLACES).astype(int))] if every else []
    return [(dof, _place(dof, positions.get(dof.rpartition(":")[0]))) for dof in chosen]


def _place(dof: str, position: tuple[float, float, float] | None) -> str:
    """Where a DOF is: at so many mm along the axis of a straight structure, else at its point."""
    if position is None or any(position[1:]):
        return dof
    return f"{1e3 * position[0]:.4g} mm ({dof})"
