"""What measured data are analysed as, decided before anything is drawn: FRFs by the modes they show, or as they are.

An FRF at a good signal-to-noise ratio states each resonance to a few parts in 10⁵, a model of a real structure misses
it by parts in 10³. The likelihood of the FRFs then takes the model's error for the joint. That of the modes has a place
for it, see `jointbayes.inference.ModelErrorNoise`, and so the wider, truer intervals.

Ratios of the motions of sensors know what frequencies alone do not: a body that is longer than it is said to be has
other shapes. Used alone they would do harm where a clamp's edge is not where it is modelled, so that they are data
where that has a place.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from jointbayes.errors import JointBayesError, ModelError
from jointbayes.frf import AnyStructure, AssembledShapes
from jointbayes.identification import MapEstimate, refine_where_possible
from jointbayes.identification.numbering import find_numbering
from jointbayes.inference import ErrorSizes, ModelErrorNoise, Premises, Problem, Test, UsedMode
from jointbayes.inference.common_errors import has_edge, with_common_errors
from jointbayes.inference.noise.model_error import LEAST_COMPONENT
from jointbayes.inference.test import likelihood_of, own_name
from jointbayes.phrases import listed
from jointbayes.posterior.checks import PredictiveCheck, check_part
from jointbayes.posterior.compared_frfs import compared_frfs_of, sentences_of_faults
from jointbayes.posterior.model_errors import OF_ALL_MODES, InferredError, model_error_of
from jointbayes.posterior.sampled import Sampled
from jointbayes.rounding import number, percent
from vibrecords import Antiresonances, FrfData, ModeData, ModeShapes, Observed
from vibrecords.arrays import Array
from vibrecords.modal_fit import identify_modes, identify_zeros
from vibrecords.modal_ratios import MotionRatio, identify_ratios
from vibrecords.mode_data import renumbered
from vibrecords.provenance import MeasuredMode

#: Ratios that no joint brings the model closer to than this, as a fraction of them or of 0.3, are not used.
FARTHEST_RATIO = 0.3


def with_ratios(
    part: Problem, tried: tuple[Array, Array], ratios: Sequence[Sequence[MotionRatio]], used: Sequence[UsedMode]
) -> tuple[list[UsedMode], str]:
    """Modes of a test with ratios of motions in them; and why there are none where they are not believed.

    Parameters
    ----------
    part
        Of that test.
    tried
        Stiffnesses (n, d) and factors (n, q), of which the nearest counts.
    ratios, used
        What was measured in each mode, and the mode of the model that it is.

    Returns
    -------
    modes, left_out : list, str
        The same modes; a sentence, empty where ratios are used or there are none.
    """
    each = [(mode.number, ratio) for mode, of_mode in zip(used, ratios, strict=True) for ratio in of_mode]
    if not each:
        return list(used), ""
    dofs = tuple(dict.fromkeys(dof for _, ratio in each for dof in (ratio.dof, ratio.reference)))
    if (nearest := _nearest(part, tried, each, dofs)) > FARTHEST_RATIO:
        where = f" of test {part.test.name}" if part.test.name else ""
        return list(used), (
            f"How much {', '.join(dofs)}{where} move relative to each other is not used: the nearest model misses it "
            f"by {percent(nearest)}, and {100 * FARTHEST_RATIO:g} % is allowed; look at signs, gains and "
            "places of the sensors."
        )
    return [replace(mode, ratios=tuple(of_mode)) for mode, of_mode in zip(used, ratios, strict=True)], ""


def measured_ratios(
    part: Problem, resonances: Sequence[MeasuredMode], kept: Sequence[int], sizes: ErrorSizes
) -> Sequence[Sequence[MotionRatio]]:
    """Ratios of motions in each of those resonances of a test of FRFs that are kept.

    Parameters
    ----------
    part
        As it is to be analysed: an edge moves modes as an uncertain length does, and without one there are no ratios.
    resonances, kept
        All that the FRFs show, and the places of those that are modes of the model.
    sizes
        Of the model's errors.
    """
    frfs, none = part.test.data.frfs, [()] * len(kept)
    if frfs is None or not sizes.edge or not has_edge(part):
        return none
    accelerance = frfs.converted("accelerance")
    try:
        ratios = identify_ratios(accelerance.frf, accelerance.variance, resonances)
    except (JointBayesError, np.linalg.LinAlgError):  # too few lines for so many modes
        return none
    return [ratios[place] for place in kept]


def _nearest(
    part: Problem, tried: tuple[Array, Array], each: Sequence[tuple[int, MotionRatio]], dofs: tuple[str, ...]
) -> float:
    """Largest error of any ratio, as a fraction of it or of 0.3, at the joint where that is least."""
    stiffness, factors = tried
    modes = np.array([number_of for number_of, _ in each]) - 1
    model = AssembledShapes(part.test.structures, part.test.joints, int(modes.max()) + 1, dofs)
    shapes = model.modes(part.parametrisation.matrix(stiffness), part.structural(factors)).shapes
    at, below = np.array([(dofs.index(ratio.dof), dofs.index(ratio.reference)) for _, ratio in each]).T
    values = np.array([ratio.value for _, ratio in each])
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.abs(shapes[:, modes, at] / shapes[:, modes, below] - values) / np.maximum(
            np.abs(values), LEAST_COMPONENT
        )
    return float(np.nanmin(error.max(axis=1), initial=np.inf))


def shapes_of(modes: Sequence[UsedMode]) -> ModeShapes | None:
    """The ratios of modes as shapes relative to what moves most in each; None where there are none."""
    dofs = tuple(dict.fromkeys(ratio.dof for mode in modes for ratio in mode.ratios))
    if not dofs:
        return None
    values, sd = np.full((2, len(modes), len(dofs)), np.nan)
    for row, mode in enumerate(modes):
        for ratio in mode.ratios:
            values[row, dofs.index(ratio.dof)], sd[row, dofs.index(ratio.dof)] = ratio.value, ratio.sd
    reference = tuple(mode.ratios[0].reference if mode.ratios else dofs[0] for mode in modes)
    return ModeShapes(dofs, reference, Observed(values, np.where(np.isnan(sd), 1.0, sd)))


#: A resonance that no predicted mode comes closer to than this, as a fraction, is compared with none.
FARTHEST = 0.1
#: Why typed-in modes are not analysed as they are stated.
TYPED = "the errors stated of the modes are those of their measurement, and no model is exact"
_DRAWS = 300  # of the prior, at which modes are counted besides the MAP
_MORE = 8  # modes of the model above the number of resonances
_LOOKS, _STREAM = 200, 7  # points about the best fit at which it is checked, and their random numbers
_PASSES = 2  # of what edge and springs do, each at the best joint with what the one before found
_SPREAD = 0.02  # of frequencies: errors well below it count by their square, those above hardly more


def decide(
    problem: Problem,
    estimate: MapEstimate,
    seed: int,
    *,
    sizes: ErrorSizes | None = None,
    freed: Problem | None = None,
    assumed: tuple[str, ...] = (),
    checked: Callable[[], MapEstimate] | None = None,
) -> Problem:
    """Return the problem whose posterior is the answer: of modes, typed in or shown by FRFs, with the model's error.

    FRFs of a structure that is modelled throughout are analysed as they are only where they show no mode, or where the
    error of the model is stated to be smaller than what their noise leaves open of the frequencies and the best fit
    passes the check. What is stated of typed-in modes are the errors of their measurement, so that the model's come on
    top. Computed FRFs are analysed as they are stated.

    Parameters
    ----------
    problem
        As it is stated.
    estimate
        Its MAP: says, with draws of the prior, which mode of the model a resonance is.
    seed
        Of these draws, and of the check.
    sizes
        Of the model's errors; by default 0.3 % of a natural frequency, known to a factor of 3.
    freed
        The same problem with more quantities uncertain, for which the answer is then to allow.
    assumed
        What is uncertain in it without being stated, in words.
    checked
        Gives the MAP on all lines of the FRFs, where it comes to the check; by default the `estimate`.

    Returns
    -------
    Problem
        `problem` itself, or one of modes whose `premises` say why.
    """
    sizes, best = sizes or ErrorSizes(), checked or (lambda: estimate)
    freed = (freed or problem).with_known_modes(problem.prior, estimate.places)
    typed = _with_usual_errors(problem, sizes, freed, assumed)
    of_modes = modes_problem(problem, estimate, seed, sizes, freed if typed is problem else typed)
    if of_modes is None:
        allowed = any(isinstance(test.noise, ModelErrorNoise) for test in typed.tests)
        return _with_common_errors(typed.with_known_modes(problem.prior, estimate.places)) if allowed else typed
    reason = why_by_modes(sizes, of_modes.premises.modes, lambda: check_best_fit(problem, best(), seed))
    if not reason:
        return problem
    return _with_common_errors(replace(of_modes, premises=replace(of_modes.premises, reason=reason, assumed=assumed)))


def _with_usual_errors(problem: Problem, sizes: ErrorSizes, freed: Problem, assumed: tuple[str, ...]) -> Problem:
    """The problem, with all else as in a workshop, whose typed-in modes have errors of the model; itself without such.

    Modes whose noise is of unknown size have a place for it already.
    """
    if all(test.data.modes is None for test in problem.tests):
        return problem
    tests, left_out = (
        tuple(test.with_model_error(sizes) if test.noise is None or test.noise.as_stated else test for test in some)
        for some in (freed.tests, freed.left_out)
    )
    if not assumed and all(test is stated for test, stated in zip(tests, freed.tests, strict=True)):
        return problem
    premises = Premises(TYPED, sizes, assumed)
    return _numbered_by_evidence(replace(freed, tests=tests, left_out=left_out, premises=premises))


def _with_common_errors(problem: Problem) -> Problem:
    """The problem with what a clamp's edge and springs do to its modes, at the best joint once more with these."""
    starts = np.vstack([problem.known_theta, problem.prior.mean])
    theta = starts[np.argmax(np.nan_to_num(problem.log_posterior(starts), nan=-np.inf))]
    for _ in range(_PASSES):
        theta, _ = refine_where_possible(problem.log_posterior, theta)
        problem = with_common_errors(problem, theta)
    return problem


def why_by_modes(sizes: ErrorSizes, used: Sequence[UsedMode], checked: Callable[[], Sequence[PredictiveCheck]]) -> str:
    """Why measured FRFs are analysed by their modes, a sentence without full stop; empty where as they are.

    Parameters
    ----------
    sizes
        Of the model's errors, as stated.
    used
        The modes that the FRFs show.
    checked
        Gives the check of the best fit to the FRFs, if it comes to that.
    """
    stated, smallest = sizes.frequency, min(mode.sd_hz / mode.frequency_hz for mode in used if not mode.held)
    if stated > smallest:
        return f"the FRFs are sharper ({percent(smallest)} of a natural frequency) than the model ({percent(stated)})"
    return (
        "" if all(check.explains for check in checked()) else "the model does not explain the FRFs within their noise"
    )


def check_best_fit(problem: Problem, estimate: MapEstimate, seed: int) -> list[PredictiveCheck]:
    """The check of each test at points about the best fit, drawn from its Laplace approximation."""
    rng = np.random.default_rng([seed, _STREAM])
    theta = np.vstack(
        [estimate.theta, rng.multivariate_normal(estimate.theta, estimate.covariance, _LOOKS, check_valid="ignore")]
    )
    possible = theta[np.isfinite(problem.log_posterior(theta))]
    return [check_part(part, possible, rng) for part in problem.parts]


def modes_problem(
    problem: Problem, estimate: MapEstimate, seed: int, sizes: ErrorSizes, freed: Problem | None = None
) -> Problem | None:
    """The problem with the modes that its measured FRFs show in the place of these, see `decide`.

    Returns
    -------
    Problem
        Its `premises` list the modes. None where FRFs were computed, show no mode, or are of a structure that has none:
        one with a measured body; and where those of the only test of a joint show none.
    """
    answered = freed or problem
    if not is_of_measured_frfs(problem) or problem.extra_log_likelihood is not None:
        return None
    tests, used, left_out = [], list[UsedMode](), list[str]()
    names = [nuisance.name for nuisance in problem.prior.nuisances]
    found = dict(zip(names, problem.prior.factors(estimate.theta).tolist(), strict=True))
    for part, answered_part in zip(problem.parts, answered.parts, strict=True):
        test = answered_part.test
        frfs = test.data.frfs
        if frfs is None:
            tests.append(test)
            continue
        # modes are counted at the MAP, at other modes and at draws of the prior
        theta = np.vstack([estimate.places, part.prior.sample(np.random.default_rng(seed), _DRAWS)])
        resonances, tried = resonances_of(frfs), (part.prior.values(theta), part.prior.factors(theta))
        zeros = {dof: fit for dof, fit in _zeros(frfs).items() if fit and dof not in test.joints.labels}
        (numbers, far), *of_zeros = _counted(part, tried, resonances, zeros)
        left_out += [_far_in_words(test, resonances[place]) for place in far]
        kept = [place for place in range(len(resonances)) if place not in far]
        if kept:
            ratios = measured_ratios(answered_part, resonances, kept, sizes)
            of_test = _used(test, [resonances[place] for place in kept], numbers)
            of_test, not_believed = with_ratios(part, tried, ratios, of_test)
            left_out += [not_believed] if not_believed else []
            for (dof, fit), (numbers, far) in zip(zeros.items(), of_zeros, strict=True):
                near = [zero for place, zero in enumerate(fit) if place not in far]
                of_test += [replace(mode, held=dof) for mode in _used(test, near, numbers)]
            tests.append(replace(_test_of_modes(test, of_test, sizes), structure=_certainly_damped(test, found)))
            used += of_test
    if not used:
        return None
    premises = Premises(model_error=sizes, modes=tuple(used), left_out=tuple(left_out))
    unseen = tuple(replace(test, structure=_certainly_damped(test, found)) for test in answered.left_out)
    of_modes = _with_tests(replace(answered, left_out=unseen), tests, premises)
    return _numbered_by_evidence(of_modes) if all(quantity.places for quantity in of_modes.quantities) else None


def _numbered_by_evidence(problem: Problem) -> Problem:
    """The problem with doubts of the modes' numbers named; those that FRFs show get the most probable ones."""
    tests, premises = [], problem.premises
    for part in problem.parts:
        test, modes, doubt = part.test, part.test.data.modes, find_numbering(part)
        if modes is None or doubt is None:
            tests.append(test)
            continue
        where = f" of test {test.name}" if test.name else ""
        named = f"The natural frequencies{where} {doubt.words}."
        premises = replace(premises, numbering=(*premises.numbering, named))
        if doubt.better and modes.shown_frfs is None:
            premises = replace(premises, misnumbered=premises.misnumbered or doubt.words)
        elif doubt.better:
            shift = doubt.other[0] - doubt.stated[0]
            test = replace(test, data=renumbered(modes, shift)).with_model_error(premises.model_error)
            premises = replace(premises, modes=tuple(_moved(mode, test.name, shift) for mode in premises.modes))
        tests.append(test)
    return replace(problem, tests=tuple(tests), premises=premises)


def _moved(mode: UsedMode, test: str, shift: int) -> UsedMode:
    """The mode with a number higher by `shift` where it is of that test."""
    return replace(mode, number=mode.number + shift) if mode.test == test else mode


def only_modes(problem: Problem, resonances: Collection[tuple[str, str, float]]) -> Problem:
    """The problem of modes with these of those that its FRFs show, by `UsedMode.resonance`.

    Raises
    ------
    ModelError
        If a test has none of them.
    """
    used = [mode for mode in problem.premises.modes if mode.resonance in resonances]
    tests = []
    for test in problem.tests:
        of_test = [mode for mode in used if mode.test == test.name]
        if any(mode.test == test.name for mode in problem.premises.modes):
            if all(mode.held for mode in of_test):
                raise ModelError(
                    f"modes: found no resonance {f'of test {test.name} ' if test.name else ''}near a mode of every "
                    f"model; expected one within {100 * FARTHEST:g} %; leave a case out"
                )
            assert isinstance(test.noise, ModelErrorNoise)
            test = _test_of_modes(test, of_test, test.noise.sizes)
        tests.append(test)
    modes = _with_tests(problem, tests, replace(problem.premises, modes=tuple(used)))
    return _with_common_errors(modes)


def is_of_measured_frfs(problem: Problem) -> bool:
    """Whether FRFs of a structure that is modelled throughout are among the data, and none was computed."""
    frfs = [test.data.frfs for test in problem.tests if test.data.frfs is not None]
    modelled = not any(test.measured_bodies for test in problem.tests)
    return bool(frfs) and modelled and not any(data.synthetic for data in frfs)


def resonances_of(frfs: FrfData) -> Sequence[MeasuredMode]:
    """Modes that FRFs show; those that were found as they were read."""
    if frfs.provenance is not None:
        return frfs.provenance.modes
    accelerance = frfs.converted("accelerance")
    try:
        return identify_modes(accelerance.frf, accelerance.variance)
    except JointBayesError:  # too few lines
        return ()


def _zeros(frfs: FrfData) -> Mapping[str, Sequence[MeasuredMode]]:
    """Antiresonances of each drive point that FRFs show."""
    accelerance = frfs.converted("accelerance")
    try:
        return {dof: fit.modes for dof, fit in identify_zeros(accelerance.frf, accelerance.variance).items()}
    except JointBayesError:  # too few lines
        return {}


def _counted(
    part: Problem,
    tried: tuple[Array, Array],
    resonances: Sequence[MeasuredMode],
    zeros: Mapping[str, Sequence[MeasuredMode]],
) -> list[tuple[NDArray[np.intp], tuple[int, ...]]]:
    """Numbers of the resonances among the model's modes, and places of those that are none; the same of each `zeros`.

    All are counted at one point: a mode more below the first resonance is one more below the first antiresonance.
    """
    stiffness, factors = tried
    count = min(part.test.most_modes, len(resonances) + _MORE)
    if not count or not resonances:
        return [(np.empty(0, dtype=np.intp), tuple(range(len(resonances))))]
    predicted_hz = part.natural_frequencies_hz(stiffness, count, factors)
    nearest = int(np.argmin([_matched(resonances, row)[2] for row in predicted_hz]))
    counted = [_matched(resonances, predicted_hz[nearest])[:2]]
    matrix, structural = part.parametrisation.matrix(stiffness[[nearest]]), part.structural(factors[[nearest]])
    for dof, fit in zeros.items():
        numbers = range(1, max(min(part.test.most_modes - 1, len(fit) + _MORE), 0) + 1)
        held = [(dof, number) for number in numbers]
        model = AssembledShapes(part.test.structures.solved_anew(), part.test.joints, 1, (), held)
        counted.append(_matched(fit, model.modes(matrix, structural).zeros_hz[0])[:2])
    return counted


def _matched(modes: Sequence[MeasuredMode], predicted_hz: Array) -> tuple[NDArray[np.intp], tuple[int, ...], float]:
    """Numbers of measured frequencies among predicted ones, places of those that are none, and how far all are."""
    measured_hz = np.array([mode.frequency_hz for mode in modes])
    away = np.abs(np.log(measured_hz[:, None] / predicted_hz))
    cost = np.log1p((away / _SPREAD) ** 2)
    places, numbers = scipy.optimize.linear_sum_assignment(cost)
    near = away[places, numbers] <= FARTHEST
    far = tuple(sorted({*range(len(measured_hz))} - {*places[near].tolist()}))
    return numbers[near] + 1, far, float(cost[places, numbers].sum())


def _used(test: Test, modes: Sequence[MeasuredMode], numbers: NDArray[np.intp]) -> list[UsedMode]:
    return [
        UsedMode(test.name, int(number), mode.frequency_hz, mode.frequency_sd_hz)
        for number, mode in zip(numbers, modes, strict=True)
    ]


def _far_in_words(test: Test, mode: MeasuredMode) -> str:
    where = f" of test {test.name}" if test.name else ""
    return (
        f"The resonance at {number(mode.frequency_hz, 4)} Hz{where} is not used: the model has no mode within "
        f"{100 * FARTHEST:g} % of it."
    )


def _test_of_modes(test: Test, used: Sequence[UsedMode], sizes: ErrorSizes) -> Test:
    """The test with modes and antiresonances as data, with errors of the model in each."""
    modes = sorted((mode for mode in used if not mode.held), key=lambda mode: mode.number)
    held = [mode for mode in used if mode.held]
    zeros = (
        Antiresonances(tuple(z.held for z in held), _observed(held), tuple(z.number for z in held)) if held else None
    )
    data = ModeData(
        _observed(modes),
        numbers=tuple(mode.number for mode in modes),
        shapes=shapes_of(modes),
        provenance=test.data.provenance,
        zeros=zeros,
        read_off=test.data.shown_frfs,
    )
    return replace(test, data=data).with_model_error(sizes)


def _certainly_damped(test: Test, found: Mapping[str, float]) -> AnyStructure:
    """Its structure with the damping that was found: unknowns that no datum sees keep draws from settling."""
    if test.measured_bodies:
        return test.structure
    named = {name: own_name(test.name, name, found) for name in test.structures.names}
    return test.structures.with_certain_damping({name: found[own] for name, own in named.items() if own is not None})


def _observed(modes: Sequence[UsedMode]) -> Observed:
    return Observed(np.array([mode.frequency_hz for mode in modes]), np.array([mode.sd_hz for mode in modes]))


def _with_tests(problem: Problem, tests: Sequence[Test], premises: Premises) -> Problem:
    """The problem of other tests, with what of all that is uncertain they and those left out depend on."""
    nuisances, every = problem.prior.nuisances, (*tests, *problem.left_out)
    names = [nuisance.name for nuisance in nuisances]
    used = {own_name(test.name, name, names) for test in every for name in likelihood_of(test.data, test).names}
    prior = replace(problem.prior, nuisances=tuple(n for n in nuisances if n.name in used))
    return replace(problem, tests=tuple(tests), prior=prior, premises=premises)


def premises_of(posterior: Sampled) -> tuple[str, ...]:
    """Say what an answer rests on where data are not taken as stated, and what is off of FRFs that it does not fit."""
    modes = [test.name for test in posterior.problem.tests if test.data.modes is not None]
    faults = [text for test in modes for text in sentences_of_faults(compared_frfs_of(posterior)[test], test)]
    stated = premises_sentences(posterior.premises, model_error_of(posterior))
    return (*stated, *unseen_inputs(posterior.problem), *faults)


def unseen_inputs(problem: Problem) -> tuple[str, ...]:
    """Say what modes cannot show of inputs that move all of them alike, where no shape was measured."""
    own = [nuisance.name.rpartition(".")[2] for nuisance in problem.prior.nuisances]
    inputs = [name for name in OF_ALL_MODES if name in own]
    more = any(test.data.modes is None or test.data.shows_shapes for test in problem.tests)
    if not problem.premises.reason or not inputs or more:
        return ()
    what = listed(inputs, "or")
    return (f"Natural frequencies alone hardly show that {what} is further off than assumed: measure it.",)


def premises_sentences(premises: Premises, model_error: InferredError | None) -> tuple[str, ...]:
    """What an answer of modes rests on, with the model's error as it was inferred; of data as stated what was asked."""
    if not premises.reason:
        return (premises.asked,) if premises.asked else ()
    held = dict.fromkeys(mode.held for mode in premises.modes)
    where = {dof: ", ".join(number(m.frequency_hz, 4) for m in premises.modes if m.held == dof) for dof in held}
    zeros = "".join(f", and the antiresonances of {held} at {text} Hz" for held, text in where.items() if held)
    dofs = dict.fromkeys(dof for mode in premises.modes for r in mode.ratios for dof in (r.dof, r.reference))
    ratios = f", and the ratios of the motions of {', '.join(dofs)} in them" if dofs else ""
    sentences = [f"The reason: {premises.reason}."]
    if premises.of_modes:
        sentences.insert(0, f"The answer comes from the modes that the FRFs show at {where['']} Hz{zeros}{ratios}.")
    else:
        sentences = ["The answer allows for an error of the model in each mode.", *sentences]
    if model_error is not None:
        sentences.append(f"The model misses each by {model_error.words}, as inferred.")
    if premises.assumed:
        sentences.append(f"Assumed, as the case does not state it: {', '.join(premises.assumed)}.")
    return (*sentences, *premises.left_out, *premises.numbering)
