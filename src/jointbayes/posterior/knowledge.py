"""What the data say beyond the draws: does the model explain them, what is known of the joint, and resting on what.

What is known when other quantities are uncertain, or are not, is a row each, from draws of its own. The first row is
the run itself. Every further one belongs to the same density with other quantities free, those left out held at their
stated values. Where its draws do not settle nothing is said.

Bounds on each stiffness say little of all together: "k11 above, k22 above" may be read as a rigid joint that the same
data exclude. So joints that are rigid, absent or uncoupled are weighed against the sampled one by their evidences, as
`compare` weighs hypotheses.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cache, partial
from itertools import product
from typing import Any, Literal

import numpy as np
import xarray as xr

from jointbayes.errors import JointBayesError, ModelError, require_probability
from jointbayes.identification import ModeSearch
from jointbayes.inference import Normal, Nuisance, Problem, hypothesis_problem
from jointbayes.phrases import IF_MODEL_RIGHT, listed
from jointbayes.posterior.checks import PredictiveCheck, checks_of
from jointbayes.posterior.coordinates import by_names, coordinate_systems, draw_problem
from jointbayes.posterior.decision import premises_of
from jointbayes.posterior.diagnosis import Diagnosis
from jointbayes.posterior.directions import NamedDirection, name_directions, summary_sentence
from jointbayes.posterior.evidence import (
    OUT_OF_QUESTION,
    constant_evidence,
    evidence,
    laplace_evidence,
)
from jointbayes.posterior.evidence_table import odds
from jointbayes.posterior.forecast import NextStep
from jointbayes.posterior.identifiability import CERTAINTY, RANK, ExactInputs, Verdict, VerdictClass, assess
from jointbayes.posterior.limits import LikelihoodRegion, ProfileLikelihood
from jointbayes.posterior.model_errors import MeshCheck
from jointbayes.posterior.sampled import Sampled, equal_tailed, is_found, kept, prior_stiffness
from jointbayes.posterior.solutions import solutions_of
from jointbayes.posterior.storage import to_arviz
from jointbayes.posterior.verdicts import MOST_UNKNOWNS, conclude, judge_stiffness, line_of, region_of, rule_of
from jointbayes.posterior.what_decides import WhatDecides, what_decides
from jointbayes.progress import Budget
from jointbayes.reproducibility import one_blas_thread
from jointbayes.sampling import Draws, SamplerSettings, quantile_spread
from jointbayes.stored_values import StoredArray
from jointbayes.verdict_rule import VerdictRule

#: Where draws come from; by importance sampling only in files of before November 2026.
Source = Literal["this run", "sampling", "importance sampling", "none"]
#: An interval that is wider, or whose ends lie further out, by more than this share of its width is another one.
LARGEST_CHANGE = 0.5
_REGION_DRAWS = 4000
_KEPT = 2000  # draws of a row, with the run
#: Residuals times unknowns of a row: with more, climbs from the whole prior take many minutes and end nowhere.
_AFFORDABLE = 50_000


@dataclass(frozen=True, slots=True)
class UncertainInputsRow:
    """What is known of the stiffnesses while some quantities are uncertain and the others exactly known.

    Parameters
    ----------
    uncertain
        Names of the uncertain quantities; empty where all are exactly known.
    source
        Where the draws come from; ``"none"`` where there are none that can be trusted.
    known
        What the draws say of each stiffness, by name; empty where there are none.
    draws
        Independent draws of the stiffnesses, in the order of `known` and their units, shape (n, q), at most 2000; those
        of the run itself are the posterior's.
    """

    uncertain: tuple[str, ...]
    source: Source
    known: Mapping[str, Verdict]
    draws: StoredArray = field(default_factory=lambda: np.empty((0, 0)), repr=False, compare=False)

    @property
    def verdict(self) -> dict[str, VerdictClass]:
        """Class of each stiffness."""
        return {name: assessment.cls for name, assessment in self.known.items()}


class UnderPremises:
    """A small posterior of the stiffnesses under other premises: what `Posterior.under` holds.

    Parameters
    ----------
    row
        What was found, with draws.

    Examples
    --------
    >>> workshop = posterior.under["workshop"]  # doctest: +SKIP
    >>> workshop.interval("k22"), workshop.verdict("k22").words  # doctest: +SKIP
    >>> az.plot_posterior(workshop.to_arviz())  # doctest: +SKIP
    """

    def __init__(self, row: UncertainInputsRow) -> None:
        self._row = row

    def __repr__(self) -> str:
        lines = [line_of(name, verdict) for name, verdict in self._row.known.items()]
        return "\n".join([f"With {listed(self.uncertain) or 'nothing else'} uncertain:", *lines])

    @property
    def uncertain(self) -> tuple[str, ...]:
        """Names of what is uncertain besides the joint."""
        return self._row.uncertain

    @property
    def draws(self) -> xr.Dataset:
        """Independent draws of the stiffnesses in their units, at most 2000: one chain × draw."""
        columns = zip(self._row.known.items(), self._row.draws.T, strict=True)
        variables = {name: (("chain", "draw"), k[None], {"units": known.unit}) for (name, known), k in columns}
        return xr.Dataset(variables, {"chain": [0], "draw": np.arange(len(self._row.draws))})

    def verdict(self, name: str) -> Verdict:
        """Class of a stiffness with its interval, limit and reasons.

        Raises
        ------
        ModelError
            If there is no such stiffness.
        """
        if name not in self._row.known:
            expected = f"one of {', '.join(self._row.known)}"
            raise ModelError.of("under", (), f"found no draws of {name!r}", expected, "correct the name")
        return self._row.known[name]

    def interval(self, name: str, probability: float = 0.95) -> tuple[float, float]:
        """Equal-tailed credible interval of a stiffness, in its unit; at 95 % the one of its verdict, of all draws.

        Raises
        ------
        ModelError
            If there is no such stiffness, or the probability is not inside (0, 1).
        """
        require_probability(probability, "under: found")
        known = self.verdict(name)
        if probability == VerdictRule.INTERVAL:
            return known.interval
        return equal_tailed(self.draws[name].values, probability)

    def to_arviz(self) -> Any:  # noqa: ANN401 (type depends on the ArviZ version)
        """Return the draws as ArviZ takes them: InferenceData before ArviZ 1.0, a DataTree from 1.0 on."""
        return to_arviz(xr.DataTree.from_dict({"posterior": self.draws}))


def uncertain_quantities(problem: Problem) -> tuple[str, ...]:
    """Uncertain quantities on which the prediction depends; parameters of the noise are none."""
    count = len(problem.prior.nuisances) - problem.log_posterior.likelihood.hyper_count
    return tuple(n.name for n in problem.prior.nuisances[:count])


def taken_as_exact(problem: Problem, freed: Problem | None) -> tuple[str, ...]:
    """Names of what is uncertain in a workshop and not in the problem."""
    stated, names = uncertain_quantities(problem), () if freed is None else uncertain_quantities(freed)
    return tuple(name for name in names if name not in stated)


def quantities_taken_as_exact(rows: Sequence[UncertainInputsRow]) -> tuple[str, ...]:
    """Names of what the run, the first row, takes as exact and another row does not."""
    most = max((row.uncertain for row in rows), key=len, default=())
    return tuple(name for name in most if name not in rows[0].uncertain)


def known_in_workshop(rows: Sequence[UncertainInputsRow]) -> Mapping[str, Verdict] | None:
    """What is known with all uncertain that the run takes as exact; None where there is nothing, or it is not known."""
    return rows[-1].known or None if quantities_taken_as_exact(rows) else None


def inputs_taken_as_exact(rows: Sequence[UncertainInputsRow]) -> dict[str, ExactInputs]:
    """The stiffnesses whose verdict holds only if what the run takes as exact is so, by name.

    A verdict does where the run's interval is another one with these quantities uncertain, see `LARGEST_CHANGE`, where
    its class is worse, its one-sided limit is weaker by a factor of 1.5, or where this could not be shown.
    """
    exact = quantities_taken_as_exact(rows)
    if not exact:
        return {}
    run, most = rows[0], max(rows, key=lambda row: len(row.uncertain))
    return {
        name: ExactInputs(exact, most.known.get(name))
        for name, assessment in run.known.items()
        if assessment.cls != "not identified" and (not most.known or _is_weaker(most.known[name], assessment))
    }


def _is_weaker(freed: Verdict, run: Verdict) -> bool:
    """Whether less is known than the run says, beyond the Monte Carlo error of either."""
    limits = np.array([run.limit, freed.limit])
    if RANK[freed.cls] > RANK[run.cls] or (np.isfinite(limits).all() and freed.cls != run.cls):
        return True
    if np.isfinite(limits).all():
        weaker = math.log(limits[0] / limits[1]) * (1 if run.cls == "bounded below" else -1)
        return bool(weaker > math.log(1 + LARGEST_CHANGE))
    low, high = run.interval
    ends = np.array([run.interval, freed.interval])
    errors = np.nan_to_num(np.array([run.interval_error, freed.interval_error]))
    median = freed.median
    if (ends > 0).all() or (ends < 0).all():
        errors, ends = errors / np.abs(ends), np.sort(np.log(np.abs(ends)), axis=1)
    (low_run, high_run), (low_freed, high_freed) = ends
    width, error = high_run - low_run, float(np.sqrt((errors**2).sum()))
    change = max(high_freed - low_freed - width, low_run - low_freed, high_freed - high_run)
    return bool(not low <= median <= high or change > max(LARGEST_CHANGE * width, 2 * error))


def effect_of_uncertain_inputs(posterior: Sampled, freed: Problem | None = None) -> tuple[UncertainInputsRow, ...]:
    """What the verdicts rest on: the run, then other sets of uncertain quantities.

    Parameters
    ----------
    posterior
        The run, which is the first row. Where it has uncertain quantities, there is one with none uncertain.
    freed
        The same problem with more quantities uncertain. Where the run takes any of them as exactly known, the last row
        is that with all uncertain.

    Returns
    -------
    tuple of UncertainInputsRow
        Empty where there is nothing to free, and where the run allows no verdict.
    """
    present = uncertain_quantities(posterior.problem)
    more = () if freed is None else uncertain_quantities(freed)
    problem = freed if freed is not None and set(more) > set(present) else posterior.problem
    every = uncertain_quantities(problem)
    if not every:
        return ()
    run = UncertainInputsRow(present, "this run", {n: judge_stiffness(posterior, n) for n in posterior.stiffness_names})
    if "no verdict" in run.verdict.values():
        return ()
    rng = np.random.default_rng([posterior.record.seed, 3])
    sets: list[tuple[str, ...]] = [()] if present else []
    sets += [every] if set(every) > set(present) else []
    budget = Budget.usual(len(problem.names))
    return run, *(_row(posterior, problem, names, rng, budget) for names in sets)


def _row(
    posterior: Sampled, problem: Problem, uncertain: tuple[str, ...], rng: np.random.Generator, budget: Budget
) -> UncertainInputsRow:
    """Draws of the problem with only these quantities uncertain, and what they say, by the rule of a run.

    All rows share the budget.
    """
    held = set(uncertain_quantities(problem)) - set(uncertain)
    free = np.array([i for i, name in enumerate(problem.names) if name not in held])
    estimate, none = posterior.estimate, UncertainInputsRow(uncertain, "none", {})
    found = np.array([mode.theta for mode in estimate.modes or [estimate]])
    modes = by_names(found, posterior.problem.names, problem.names)
    if problem.log_posterior.likelihood.n_data * free.size > _AFFORDABLE:
        return none
    settings = SamplerSettings().for_dimension(free.size).for_one_of_many()
    try:
        chains, _ = draw_problem(problem, modes, rng, settings, free=free, budget=budget)
    except (JointBayesError, np.linalg.LinAlgError):
        return none
    if not chains.converged:
        return none
    draws, effective = chains.draws().theta.reshape(-1, free.size), chains.worth
    theta = by_names(draws, [problem.names[i] for i in free], problem.names)
    values = problem.prior.values(theta)
    region = cache(lambda: LikelihoodRegion(problem.log_posterior, theta[:: -(-len(theta) // _REGION_DRAWS)]))
    known = {}
    for name, column in zip(posterior.stiffness_names, values.T, strict=True):
        error = partial(quantile_spread, column, effective=effective)
        drawn = assess(column, posterior.prior_values(name), error, posterior.unit(name), rule_of(posterior, name))
        known[name] = conclude(posterior, name, drawn, theta, region)
    return UncertainInputsRow(uncertain, "sampling", known, values[:: -(-len(theta) // _KEPT)])


def workshop_of(posterior: Sampled) -> Problem | None:
    """The same problem with more quantities uncertain, as its case has it; None without a case, or any more."""
    return None if posterior.case is None else posterior.case.workshop_problem


@kept
@one_blas_thread()
def rows_of(posterior: Sampled) -> tuple[UncertainInputsRow, ...]:
    """Find what is known with other quantities uncertain or exactly known; the first row is the run itself.

    Empty where there is nothing to free, and where the run allows no verdict.
    """
    return effect_of_uncertain_inputs(posterior, workshop_of(posterior))


def verdict_of(posterior: Sampled, name: str) -> Verdict:
    """Judge one stiffness, and name what the verdict takes as exact.

    Inputs that a workshop does not know exactly are looked at where `rows_of` was made, or kept. Else the verdict
    names them all.

    Raises
    ------
    ModelError
        If there is no such quantity, or the joint's coordinates hold it rigid: there is nothing to judge.
    """
    if np.ptp(posterior.prior_values(name)) == 0:
        raise ModelError(
            f"posterior: found {name} held rigid; expected a joint whose stiffnesses are all uncertain, for "
            "verdicts, summary and report; use draws, mode and intervals of the others"
        )
    found = judge_stiffness(posterior, name)
    unsaid = found.cls in ("no verdict", "not identified")
    return found if unsaid else replace(found, exact=exact_inputs_of(posterior).get(name))


def judged_names(posterior: Sampled) -> list[str]:
    """Names of the stiffnesses that are uncertain."""
    return [name for name in posterior.stiffness_names if np.ptp(posterior.prior_values(name)) > 0]


def exact_inputs_of(posterior: Sampled) -> Mapping[str, ExactInputs]:
    """What verdicts take as exact, by stiffness; the same for all where `rows_of` was not made."""
    if is_found(posterior, rows_of) and (rows := rows_of(posterior)):  # there are none of a run that has not converged
        return inputs_taken_as_exact(rows)
    freed = None if posterior.case is None else posterior.case.freed_problem
    taken = taken_as_exact(posterior.problem, freed)
    unseen = ExactInputs(taken, None, looked_at=False)
    return dict.fromkeys(posterior.stiffness_names, unseen) if taken else {}


def assumptions_of(posterior: Sampled) -> tuple[str, ...]:
    """Say what an answer rests on, and where `rows_of` was not made how to see what is known without exact inputs."""
    unseen = next((exact for exact in exact_inputs_of(posterior).values() if not exact.looked_at), None)
    if unseen is None or not posterior.converged:
        return premises_of(posterior)
    name = listed(unseen.quantities)
    return (*premises_of(posterior), f"What is known with {name} uncertain: posterior.under, and the report.")


@kept
def assumed_of(posterior: Sampled) -> tuple[str, ...]:
    """Say how well each quantity is taken to be known that only the last of `rows_of` takes as uncertain."""
    return assumed_beyond(posterior.problem, workshop_of(posterior))


@kept
def directions_of(posterior: Sampled) -> tuple[NamedDirection, ...]:
    """Find the combinations of stiffnesses that the draws determine independently, best known first."""
    judged = {name: verdict_of(posterior, name) for name in posterior.stiffness_names}
    return name_directions(
        posterior.stiffness,
        prior_stiffness(posterior),
        judged,
        posterior.problem.parametrisation,
        partial(rule_of, posterior),
    )


@kept
def profiles_of(posterior: Sampled) -> tuple[ProfileLikelihood, ...]:
    """Find the profile likelihood of each coordinate of the joint; none of many unknowns."""
    profiles: list[ProfileLikelihood] = []
    if len(posterior.problem.names) > MOST_UNKNOWNS:
        return ()
    for name in posterior.problem.parametrisation.names:
        with suppress(ModelError):  # no residual depends on it: its prior is all there is, and the verdict says so
            profiles.append(region_of(posterior).profile(name))
    return tuple(profiles)


def what_decides_of(posterior: Sampled) -> WhatDecides | None:
    """Find what each input does alone; None of fewer than two, and where the model does not explain the data."""
    inputs = max((row.uncertain for row in rows_of(posterior)), key=len, default=())
    if len(inputs) < 2 or not all(check.explains for check in checks_of(posterior)):
        return None
    run, freed = posterior.problem, workshop_of(posterior)
    problem = run if freed is None or set(inputs) <= set(uncertain_quantities(run)) else freed
    if not set(inputs) <= set(problem.names):  # rows of a file without the case that freed them
        return None
    return what_decides(problem, inputs, by_names(posterior.best.theta[None], run.names, problem.names)[0])


def assumed_beyond(problem: Problem, freed: Problem | None) -> tuple[str, ...]:
    """How well each quantity that is uncertain in `freed` alone is taken to be known, in words, from its very prior."""
    if freed is None:
        return ()
    beyond = taken_as_exact(problem, freed)
    return tuple(_prior_words(nuisance) for nuisance in freed.prior.nuisances if nuisance.name in beyond)


def _prior_words(nuisance: Nuisance) -> str:
    name = listed((nuisance.name,))
    if nuisance.additive:
        ends = nuisance.value(nuisance.range)
        sd = float(nuisance.value(nuisance.prior.sd))
        spread = f"±{sd:g}" if isinstance(nuisance.prior, Normal) else f"between {ends[0]:.3g} and {ends[1]:.3g}"
        return f"{name} to {spread} {nuisance.unit}"
    if isinstance(nuisance.prior, Normal):
        return f"{name} to {100 * nuisance.prior.sd:g} %"
    low, high = (math.exp(end) for end in nuisance.prior.support)
    return f"{name} to between {low:.3g} and {high:.3g} times the stated"


_MOST_TOLD = 4  # stiffnesses in a sentence
#: What ``summary.json`` holds of each combination.
_OF_DIRECTION = ("quantity", "median", "interval95", "ratio", "sd_log", "verdict", "limit", "sentence")


def effect_sentence(rows: Sequence[UncertainInputsRow]) -> str:
    """The table in words: whose verdict is worse, and whose interval another, with all quantities uncertain."""
    settled = [row for row in rows if row.known]
    least, most = (pick(settled, key=lambda row: len(row.uncertain)) for pick in (min, max))
    if not most.uncertain or least.uncertain or len(settled) < 2:
        return "Whether other uncertain quantities matter is open: the calculation that would show it did not settle."
    parts, wider = [], dict.fromkeys(inputs_taken_as_exact((least, most)))
    for name, verdict in least.verdict.items():
        if RANK[most.verdict[name]] <= RANK[verdict]:
            continue
        parts.append(
            f"{name} goes from {least.known[name].value}, {verdict}, to {most.known[name].value}, {most.verdict[name]}"
        )
        wider.pop(name, None)
    for name in wider:
        parts.append(
            f"{name} stays {most.verdict[name]}, but goes from {least.known[name].value} to {most.known[name].value}"
        )
    if not parts:
        return (
            f"With {listed(most.uncertain)} uncertain every verdict holds, and no interval of a stiffness that is "
            f"known moves or widens by more than {100 * LARGEST_CHANGE:g} % of its width."
        )
    more = [f"{len(parts) - _MOST_TOLD} more change, see the table"] if len(parts) > _MOST_TOLD else []
    return f"With {listed(most.uncertain)} uncertain: {'; '.join([*parts[:_MOST_TOLD], *more])}."


#: 2 ln of the odds against a simpler joint above which the data exclude it. The odds exceed 1000 to 1 by chance in at
#: most one of 1000 tests of such a joint.
EXCLUDED = 2 * math.log(1000)
_TRIED_SIMPLER = 100  # draws of the run from which a search for a simpler joint starts
_CLIMBED = 3  # of these
_LARGEST, _TOLD = 1e9, 2 * math.log(1e6)  # 2 ln B that is kept at most, and told
_SIMPLER = {"rigid": "rigid", "absent": "absent", "springs": "uncoupled"}  # hypotheses by what they are called


@dataclass(frozen=True, slots=True)
class SimplerJoint:
    """A joint that is rigid, absent or uncoupled, against the one that was sampled.

    Parameters
    ----------
    joint
        Its name; empty where there is one.
    kind
        What it would be: ``"rigid"``, ``"absent"`` or ``"uncoupled"``.
    two_log_b
        2 ln of the odds against it, if both were equally probable before the data.
    """

    joint: str
    kind: str
    two_log_b: float

    @property
    def excluded(self) -> bool:
        """Whether the data exclude it."""
        return self.two_log_b > EXCLUDED

    @property
    def odds(self) -> str:
        """Odds against it, or for it where it is the more probable joint."""
        size = abs(self.two_log_b)
        return f"{odds(size) if size < _TOLD else 'more than 10⁶ to 1'} {'against' if self.two_log_b > 0 else 'for'} it"


def known_by_bounds(posterior: Sampled) -> tuple[str, ...]:
    """Joints of which most stiffnesses are neither identified nor weakly identified, by name; none without verdicts.

    One that is not identified only because solutions differ in it is known by more than bounds.
    """
    verdicts: dict[str, list[str]] = {}
    for quantity in posterior.problem.quantities:
        if quantity.role == "stiffness" and quantity.name not in solutions_of(posterior).split:
            verdict = judge_stiffness(posterior, quantity.name).cls
            verdicts.setdefault(quantity.name.rpartition(".")[0], []).append(verdict)
    if any("no verdict" in each for each in verdicts.values()):
        return ()
    return tuple(name for name, each in verdicts.items() if 2 * sum(v in CERTAINTY for v in each) < len(each))


@kept
def weighed_joints(posterior: Sampled) -> tuple[SimplerJoint, ...]:
    """Weigh rigid, absent and uncoupled joints in place of each that is known by bounds at most; none of damped joints.

    1. Find ln Z of the run from its draws.
    2. Climb to the mode of each simpler joint from the draws, with everything else fitted again.
    3. Find its ln Z: by Laplace's approximation where it is out of the question, or of many unknowns, else by draws.
    """
    problem, joints = posterior.problem, known_by_bounds(posterior) if posterior.converged else ()
    if not joints or problem.parametrisation.damped or problem.extra_log_likelihood is not None:
        return ()
    # 1. the run
    rng, simpler = np.random.default_rng([posterior.record.seed, 11]), list[SimplerJoint]()
    shape, ensemble = posterior.log_density.shape, posterior.draws["ensemble"].values
    drawn = Draws(posterior.theta.reshape(*shape, -1).copy(), posterior.log_density.copy(), ensemble.copy())
    run = evidence(problem.log_posterior, coordinate_systems(problem), drawn, rng)
    modes = np.array([posterior.best.theta, *(mode.theta for mode in posterior.estimate.modes)])
    places = np.vstack([modes, posterior.thinned(_TRIED_SIMPLER)])
    for joint, (hypothesis, kind) in product(joints if run.trusted else (), _SIMPLER.items()):
        other = hypothesis_problem(problem, hypothesis, joint)
        if other.parametrisation == problem.parametrisation:
            continue
        density = other.log_posterior
        if not other.names:
            found = constant_evidence(density)
        else:
            # 2. its mode
            starts = other.with_known_modes(problem.prior, places).known_theta
            best = starts[np.argsort(-np.nan_to_num(density(starts), nan=-np.inf))[:_CLIMBED]]
            search = ModeSearch(density)
            search.climb({str(number): theta for number, theta in enumerate(best)})
            estimate = search.estimate()
            # 3. its evidence
            found = laplace_evidence(estimate.starts_for_draws[0], estimate.log_posterior)
            if found.log_z > run.log_z - OUT_OF_QUESTION and len(problem.names) <= MOST_UNKNOWNS:
                settings = SamplerSettings().for_dimension(len(other.names)).for_one_of_many()
                chains, _ = draw_problem(other, estimate.places, rng, settings)
                found = evidence(density, coordinate_systems(other), chains.draws(), rng)
        against = SimplerJoint(joint, kind, float(np.clip(2 * (run.log_z - found.log_z), -_LARGEST, _LARGEST)))
        # draws that miss a part make its evidence too small: it is then not excluded
        simpler += [against] if found.trusted or not against.excluded else []
    return tuple(simpler)


def exclusion_sentences(joints: tuple[SimplerJoint, ...]) -> tuple[str, ...]:
    """What is excluded and what is not, joint by joint; empty without any."""
    sentences = []
    for name in dict.fromkeys(simpler.joint for simpler in joints):
        what = f"joint {name}" if name else "the joint"
        for excluded, words in ((True, "rule out"), (False, "do not rule out")):
            of_it = [joint for joint in joints if (joint.joint, joint.excluded) == (name, excluded)]
            kinds = [f"{joint.kind} (odds {joint.odds})" for joint in of_it]
            if kinds:
                sentences.append(f"The data {words} that {what} is {' or '.join(kinds)}.")
    return tuple(sentences)


@dataclass(frozen=True, eq=False, kw_only=True)
class Knowledge:
    """How far the numbers of a posterior carry.

    Parameters
    ----------
    check
        Posterior predictive check.
    directions
        Combinations of the joint's stiffnesses that are determined independently, best known first, by the draws.
    profiles
        Profile likelihood of each coordinate of the joint.
    freed
        What is known with other quantities uncertain or exactly known; the first row is the run. Empty where there is
        nothing to free.
    assumed
        The uncertainties that were assumed for `freed` in words, one for each quantity; empty where they are the case's
        own.
    weighed
        Rigid, absent and uncoupled joints in place of each that is known by bounds at most.
    next_steps
        Forecasts of further measurements, the best first, with all else as in a workshop where `workshop` is not None;
        empty where the draws have not converged, or the model does not explain the data.
    advice
        What to do next, in words: the first of `next_steps`, or what comes before any further measurement.
    decides
        Which uncertain input matters most; None where there are fewer than two, or no stiffness is known with all of
        them exact.
    mesh
        What the elements of the model do to the result; None where the structure is given by its matrices.
    diagnoses
        What the misfit of each test points to.
    """

    check: PredictiveCheck
    directions: tuple[NamedDirection, ...] = ()
    profiles: tuple[ProfileLikelihood, ...]
    freed: tuple[UncertainInputsRow, ...]
    assumed: tuple[str, ...]
    weighed: tuple[SimplerJoint, ...] = ()
    next_steps: tuple[NextStep, ...] = ()
    advice: str = ""
    decides: WhatDecides | None = None
    mesh: MeshCheck | None = None
    diagnoses: tuple[Diagnosis, ...] = ()

    @property
    def workshop(self) -> Mapping[str, Verdict] | None:
        """What is known of each stiffness with all else as in a workshop; None where the run takes nothing as exact."""
        return known_in_workshop(self.freed)

    @property
    def exact(self) -> dict[str, ExactInputs]:
        """The stiffnesses whose verdict holds only if what the run takes as exact is so, by name."""
        return inputs_taken_as_exact(self.freed)

    @property
    def bounds_sentence(self) -> str:
        """What is known of joints of which each stiffness is known by bounds at most; empty where there are none."""
        return " ".join(self.bounds_sentences)

    @property
    def bounds_sentences(self) -> tuple[str, ...]:
        """The same, sentence by sentence."""
        if not self.weighed:
            return ()
        text, *rest = exclusion_sentences(self.weighed)
        if self._condition:
            text = f"With {self._condition}: {text[0].lower()}{text[1:]}"
        text = self._if_right(text)
        best = next((d.as_flexibility or d.sentence for d in self.directions if d.verdict in CERTAINTY), "")
        known = f"Best known{self._condition and ', on the same condition'}: {best}."
        return (text, *rest, *([known] if best else []))

    @property
    def _condition(self) -> str:
        """What combinations are known with: what the run takes as exact, unless freeing it was seen to change nothing.

        Of stiffnesses that are not identified anyway that cannot be seen, while combinations may be known well.
        """
        exact = quantities_taken_as_exact(self.freed)
        seen = exact and any(verdict != "not identified" for verdict in self.freed[0].verdict.values())
        return f"{listed(exact)} exactly known" if exact and (self.exact or not seen) else ""

    def _if_right(self, text: str, mark: str = ":") -> str:
        """A sentence, under the model being right where it does not explain the data."""
        if self.check.explains:
            return text
        return f"{IF_MODEL_RIGHT.capitalize()}{mark} {text[0].lower()}{text[1:]}"

    @property
    def directions_sentence(self) -> str:
        """Which combinations are known, in one sentence; conditional as the verdicts are."""
        text = summary_sentence(self.directions)
        if self._condition:
            text = f"With {self._condition}: {text}"
        return text if any(d.verdict == "no verdict" for d in self.directions) else self._if_right(text)

    @property
    def freed_sentence(self) -> str:
        """What the verdicts rest on, in one sentence."""
        if not self.freed:
            return ""
        return self._if_right(effect_sentence(self.freed), ",")

    def under_as_json(self) -> dict[str, Any]:
        """What ``under`` of ``summary.json`` holds: the verdicts under other premises, by these."""
        settled = {"workshop" if row.uncertain else "exact": row for row in self.freed[1:] if row.known}
        return {
            premises: {name: {"unit": known.unit, **known.as_json()} for name, known in row.known.items()}
            for premises, row in settled.items()
        }

    def as_json(self) -> dict[str, Any]:
        """What ``identifiability`` of ``summary.json`` holds."""
        return {
            "sentence": self.directions_sentence,
            "directions": [{key: getattr(d, key) for key in _OF_DIRECTION} for d in self.directions],
            "bounds_sentence": self.bounds_sentence,
            "simpler_joints": [asdict(joint) | {"excluded": joint.excluded} for joint in self.weighed],
            "profiles": {
                p.name: {"interval95": list(p.interval), "open_below": p.open_below, "open_above": p.open_above}
                for p in self.profiles
            },
            "freed_sentence": self.freed_sentence,
            "freed_assumptions": list(self.assumed),
            "what_decides": None if self.decides is None else self.decides.as_json(),
        }
