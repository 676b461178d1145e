"""Whether a joint has changed between two tests: both are analysed together, each with a joint of its own.

What is uncertain in the structure, and the error of the model in each mode, are the same in two tests of one structure:
they move both joints alike and cancel in the change, which is known far better than either stiffness.

Two hypotheses are weighed by their evidences: one joint in both tests, and a joint in each. A joint that has changed is
taken to be up to a factor of two stiffer or softer in each coordinate (95 %), so that a wide prior of the stiffness
does not count against a change.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from jointbayes.errors import ModelError
from jointbayes.inference import JointPrior, ModelErrorNoise, Nuisance, Problem
from jointbayes.inference.problem import is_one_structure
from jointbayes.joint.blocks import Block, Blocks
from jointbayes.joint.quantities import prefixed
from jointbayes.phrases import listed, not_converged
from jointbayes.posterior.coordinates import coordinate_systems
from jointbayes.posterior.evidence import evidence
from jointbayes.posterior.evidence_table import STRONG, EvidenceTable
from jointbayes.progress import ProgressCallback
from jointbayes.rounding import interval
from jointbayes.structure.recipe import is_damping
from jointbayes.studies.same_modes import change_in_words
from jointbayes.workflow import draws_of, find_map
from vibrecords.arrays import Array

_TESTS = ("before", "new")
_MODES, _DRAWS = 3, 4000
_CHANGE_SD = math.log(2.0) / 1.96  # of each coordinate of the joint: a factor of two either way in 95 %
_NODES = 1000  # of the prior over which the prior of a change is normalised
_FEWEST = 400.0  # effective draws from which intervals are printed
_UNKNOWN = 4.0  # upper over lower end of a ratio, from which on a change by a factor of 2 would not show


@dataclass(frozen=True, slots=True)
class Change:
    """Change of one quantity: of a positive one new over before, less 1; else the difference in its unit.

    Parameters
    ----------
    name, unit
        Of the quantity; the unit is ``"1"`` where the change is relative.
    median, low95, high95
        Posterior median and ends of the 95 % credible interval.
    probability_higher
        That the new one is larger.
    """

    name: str
    unit: str
    median: float
    low95: float
    high95: float
    probability_higher: float

    @classmethod
    def of(cls, name: str, unit: str, first: Array, second: Array) -> "Change":
        """The change from draws before to the same draws of the new one, each shape (n,)."""
        relative = bool((first > 0).all() and (second > 0).all())
        change = second / first - 1 if relative else second - first
        low, median, high = np.quantile(change, [0.025, 0.5, 0.975]).tolist()
        return cls(name, "1" if relative else unit, median, low, high, float((change > 0).mean()))

    @property
    def known(self) -> bool:
        """Whether a change by a factor of 2 would show; for a difference there is no such scale."""
        return self.unit != "1" or (1 + self.high95) < _UNKNOWN * (1 + self.low95)

    @property
    def shown(self) -> bool:
        """Whether it is known, and the interval excludes no change."""
        return self.known and not self.low95 <= 0 <= self.high95

    @property
    def clarity(self) -> float:
        """Median over the width of the interval, which tells the clearest of several."""
        return abs(self.median) / max(self.high95 - self.low95, np.finfo(float).tiny) if self.known else -1.0

    @property
    def how_much(self) -> str:
        """Median and interval, with two digits of the interval's width."""
        scale, unit = (100.0, "%") if self.unit == "1" else (1.0, self.unit)
        ends = [scale * end for end in (self.median, self.low95, self.high95)]
        places = max(0, 1 - math.floor(math.log10(max(ends[2] - ends[1], 1e-9) / 2)))
        middle, low, high = (f"{end:+.{places}f}" for end in ends)
        return f"{middle} {unit} ({low} to {high} {unit})"


@dataclass(frozen=True, slots=True)
class JointChange:
    """Whether a joint has changed between two tests.

    Parameters
    ----------
    stiffness
        The change of each, the best known first; where the joint has changed, the clearest.
    together
        What the whole joint does to the natural frequency of the structure before that shows it most clearly; None
        where none are known, as for a measured body.
    two_log_b
        2 ln B for a joint in each test against one joint in both: positive where the joint has changed.
    premises
        What is taken for granted, sentences.
    converged, reason
        Whether evidences and intervals can be trusted, and why not.
    """

    stiffness: tuple[Change, ...]
    together: Change | None
    two_log_b: float
    premises: tuple[str, ...]
    converged: bool
    reason: str

    @property
    def changed(self) -> bool:
        """Whether the evidence for a change is strong."""
        return self.two_log_b > STRONG

    @property
    def lines(self) -> Iterator[str]:
        """What is printed, the answer first."""
        if self.changed and not self.stiffness[0].shown:
            yield "The joint has changed; which stiffness is not clear."
        for k in self.stiffness:
            if not k.known:
                yield f"{k.name} is not known well enough: {interval((1 + k.low95, 1 + k.high95))} times before."
            elif k.shown and not self.changed:
                yield f"{k.name} has not changed by more than chance, all stiffnesses together: {k.how_much}."
            else:
                yield f"{k.name} has {'' if k.shown else 'not '}changed: {k.how_much}."
        yield change_in_words("joint has", self.two_log_b, "all stiffnesses together")
        if self.together:
            yield f"The whole joint moves {self.together.name} by {self.together.how_much}."
        yield from self.premises
        if not self.converged:
            yield not_converged(self.reason)


def compare_joints(before: Problem, new: Problem, seed: int, progress: ProgressCallback) -> JointChange:
    """Compare the joints of two problems of one test each, as both were answered.

    Raises
    ------
    ModelError
        If one has several tests, or their joints have other quantities.
    """
    # 1. Both hypotheses; the one with a joint for each test is also searched from the mode of one joint
    own, shared, premises = _together(before, new)
    one = find_map(shared, seed=seed, progress=progress)
    two = find_map(own, np.tile(one.values, 2), seed=seed, progress=progress)
    rng, found = np.random.default_rng([seed, 5]), []
    for problem, estimate in ((shared, one), (own, two)):
        chains = draws_of(problem, estimate, seed, progress)
        found.append((chains, evidence(problem.log_posterior, coordinate_systems(problem), chains.draws(), rng)))
    # 2. Evidences; the one with a joint for each test takes changes of a likely size
    (of_one, z_one), (of_two, z_two) = found
    theta = of_two.draws().theta.reshape(-1, len(own.names))
    likely = float(np.logaddexp.reduce(_log_prior_of_change(own, theta))) - math.log(len(theta))
    table = EvidenceTable({"one joint": z_one.log_z, "a joint each": z_two.log_z + likely})
    fewest, error = min(of_one.ess.min(), of_two.ess.min()), max(z_one.error, z_two.error)
    trusted = z_one.trusted and z_two.trusted and of_one.converged and of_two.converged and fewest >= _FEWEST
    reason = f"{fewest:.0f} effective draws of at least {_FEWEST:.0f}, standard error of ln Z {error:.2g}"
    # 3. The change of each stiffness, and of the natural frequency that shows it best
    theta = theta[rng.permutation(len(theta))[:_DRAWS]]
    values, half = own.prior.values(theta), len(before.quantities)
    of_joint = [(i, q) for i, q in enumerate(before.quantities) if q.places]
    each = [Change.of(q.name, q.unit, values[:, i], values[:, half + i]) for i, q in of_joint]
    two_log_b = table.two_log_b("one joint", "a joint each")
    each.sort(key=lambda k: -k.clarity if two_log_b > STRONG else (k.unit != "1") + k.high95 - k.low95)
    if two.effort is not None and not two.effort.explains:
        premises = (*premises, "The model does not explain the data: what it lacks may look like a change.")
    return JointChange(tuple(each), _effect(own, theta), two_log_b, premises, trusted, reason)


def _log_prior_of_change(own: Problem, theta: Array) -> Array:
    """ln of the ratio of two priors at θ, (n, d): changes of a likely size over independent joints, shape (n,).

    The new joint has its own prior times a normal density about the joint before, normalised for each.
    """
    half, ratio = len(own.prior.marginals) // 2, np.zeros(len(theta))
    for i, marginal in enumerate(own.prior.marginals[half:]):
        nodes = np.sort(marginal.ppf((np.arange(_NODES) + 0.5) / _NODES))
        normal = stats.norm(scale=_CHANGE_SD).pdf
        weight = np.interp(theta[:, i], nodes, normal(nodes[None] - nodes[:, None]).mean(axis=1))
        ratio += np.log(normal(theta[:, half + i] - theta[:, i]) + np.finfo(float).tiny) - np.log(weight)
    return ratio


def _together(before: Problem, new: Problem) -> tuple[Problem, Problem, tuple[str, ...]]:
    """Both tests with a joint each, with one joint, and what is taken for granted."""
    for several in (p for p in (before, new) if len(p.tests) > 1):
        names = ", ".join(test.name for test in several.tests)
        raise ModelError(f"same: found the tests {names} in {several.name}; expected one; give a case of each test")
    given, prior = before.parametrisation, before.prior
    if before.test.joints != new.test.joints or given != new.parametrisation:
        found = " and ".join(f"{p.test.joints} ({', '.join(q.name for q in p.quantities)})" for p in (before, new))
        raise ModelError(f"same: found {found}; expected one joint, tested twice; state both alike")
    alike = is_one_structure(before.test, new.test)
    named = [
        [replace(n, name=n.name.removeprefix(f"{p.test.name}.")) for n in p.prior.nuisances] for p in (before, new)
    ]
    common = {n.name for n in named[0] if alike and n in named[1] and n.name in before.test.structures.names}
    common = {name for name in common if not is_damping(name)}
    structural: list[Nuisance] = []
    of_noise: list[Nuisance] = []
    for test, problem, every in zip(_TESTS, (before, new), named, strict=True):
        own_named = [n if n.name in common else replace(n, name=prefixed(test, n.name)) for n in every]
        end = len(every) - problem.log_posterior.likelihood.hyper_count  # the noise's coordinates are the last
        structural += [n for n in own_named[:end] if n not in structural]
        of_noise += own_named[end:]
    blocks = given.blocks if isinstance(given, Blocks) else (Block("", given, (0,)),)
    both = Blocks(tuple(_named(block, test) for test in _TESTS for block in blocks))
    tests = [replace(p.test, name=test) for test, p in zip(_TESTS, (before, new), strict=True)]
    whole = JointPrior(both, prior.marginals + new.prior.marginals, (*structural, *of_noise))
    guess = np.concatenate([before.first_guess, new.first_guess])
    own = Problem(tests, whole, guess, name="same", premises=before.premises)
    shared = replace(own, prior=replace(whole, parametrisation=given, marginals=prior.marginals), initial=None)
    apart = [n.name.replace("_", " ") for n in whole.nuisances if n.name not in common]
    return own, shared, _premises(own, sorted(common), apart, alike=alike)


def _named(block: Block, test: str) -> Block:
    name, *joints = (prefixed(test, name) if name else test for name in (block.name, *block.joints))
    return replace(block, name=name, joints=tuple(joints))


def _premises(own: Problem, common: list[str], apart: list[str], *, alike: bool) -> tuple[str, ...]:
    same = [name.replace("_", " ") for name in common]
    laws = [test.noise.shares if isinstance(test.noise, ModelErrorNoise) else None for test in own.tests]
    if alike and not apart and laws[0] is not None and laws[0] == laws[1]:
        same.append("error of the model in each mode")
    one = "Assumed: one structure in both tests, so that only the joint can have changed."
    sentences = [one if alike else "The two structures are stated differently: nothing of them cancels."]
    sentences += [f"Assumed to be the same in both, so that it cancels: {listed(same)}."] if same else []
    sentences += [f"Uncertain in each by itself: {listed(apart)}."] if apart else []
    return tuple(sentences)


def _effect(own: Problem, theta: Array) -> Change | None:
    """Change of the natural frequency that shows most clearly what the new joint does in the structure before."""
    part, prior = own.part(_TESTS[0]), own.prior
    count, values, factors = min(_MODES, part.test.most_modes), prior.values(theta), prior.factors(theta)
    new = np.tile(values[:, values.shape[1] // 2 :], 2)  # quantities before, then the new ones
    hz = [part.natural_frequencies_hz(k, count, factors) for k in (values, new)] if count > 0 else []
    each = [Change.of(f"natural frequency {i + 1}", "Hz", hz[0][:, i], hz[1][:, i]) for i in range(len(hz) and count)]
    return max(each, key=lambda change: change.clarity, default=None)
