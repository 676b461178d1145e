"""Everything that defines an inference: tests, and a prior over all that is uncertain in them."""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError, require
from jointbayes.frf import AnyStructure, NaturalFrequencies, Ports
from jointbayes.inference.default_prior import default_prior
from jointbayes.inference.likelihood_base import Sharing, Term, TestsLikelihood
from jointbayes.inference.log_posterior import ExtraLogLikelihood, LogPosterior
from jointbayes.inference.noise.base import ErrorSizes, NoiseModel
from jointbayes.inference.prior import JointPrior
from jointbayes.inference.test import Test, arranged, columns_of_names, likelihood_of, own_name, require_own_bodies
from jointbayes.joint import AnyJoint, Joint, Parametrisation, Quantity, joints_of
from vibrecords import Data, quantity_factor
from vibrecords import Quantity as FrfQuantity
from vibrecords.arrays import Array, ComplexArray, Indices
from vibrecords.modal_ratios import MotionRatio


@dataclass(frozen=True, slots=True)
class UsedMode:
    """A measured resonance and the mode of the model that it is compared with, from 1.

    Or an antiresonance of the drive point `held`, and the mode of the model with that DOF held. With a resonance may
    come `ratios` of motions of sensors.
    """

    test: str
    number: int
    frequency_hz: float
    sd_hz: float
    held: str = ""
    ratios: tuple[MotionRatio, ...] = ()

    @property
    def resonance(self) -> tuple[str, str, float]:
        """What was measured, without the modes of a model that it is compared with."""
        return self.test, self.held, self.frequency_hz


@dataclass(frozen=True, slots=True)
class Premises:
    """What a problem takes for granted, beyond what its data, priors and noise say themselves.

    Parameters
    ----------
    reason
        Why the problem is not analysed as it is stated, a sentence without full stop; empty where it is.
    model_error
        Sizes of the model's error in each of these modes; None where the model is taken as exact.
    assumed
        What is as uncertain as in a workshop because it is not stated, in words, one for each quantity.
    modes, left_out
        The modes that measured FRFs show and that are used, and sentences on resonances that are not.
    numbering
        Sentences on modes that are as probably others of the model, or more probably.
    misnumbered
        How typed-in modes fit far better as others, in a phrase; empty where they do not.
    asked
        What was asked for instead of what is usual, a sentence; empty where nothing was.
    """

    reason: str = ""
    model_error: ErrorSizes | None = None
    assumed: tuple[str, ...] = ()
    modes: tuple[UsedMode, ...] = ()
    left_out: tuple[str, ...] = ()
    numbering: tuple[str, ...] = ()
    misnumbered: str = ""
    asked: str = ""

    @property
    def of_modes(self) -> bool:
        """Whether the answer rests on the modes that measured FRFs show."""
        return bool(self.modes)

    @property
    def decision(self) -> str:
        """What follows from the reason, in a sentence without full stop; empty where the problem is as stated."""
        of_modes = "so natural frequencies are fitted, with the model's error, and not every line of the FRFs"
        then = of_modes if self.of_modes else "so the usual error of the model is added"
        return f"{self.reason}, {then}" if self.reason else ""


_AS_STATED = Premises()


@dataclass(frozen=True, eq=False, init=False)
class Problem:
    """Joints to be identified from one test, or from several of the same joints.

    ``Problem(structure=…, joint=…, data=…)`` makes the problem of a lone test.

    Parameters
    ----------
    tests
        What was tested and measured. Quantities of the prior whose names begin with a test's name are its own.
    prior
        Prior over all that is uncertain; carries the parametrisation of the joint, or of all, see
        `jointbayes.joint.blocks_of`. Or marginals by the names of some coordinates, ``{"k22": …}``; all others then
        have the prior of a case file that states none, see `jointbayes.inference.default_prior.default_prior`.
    initial
        First guess of the joint's quantities, shape (q,), N/m, N, N·m/rad; by default the middle of the prior. It may
        be no point of the prior (k12 = 0): `initial_theta` is in the coordinates of `log_posterior`.
    extra_log_likelihood
        A further term of the log likelihood: a function of θ, shape (n, d) with the coordinates `names`, that gives
        shape (n,), −inf where impossible. For what else is known of the joint: a static test, another test.
    name
        Short name, by which its results are known.
    left_out
        Tests of the same joints, or further data of the tests under the same names, that do not enter the likelihood:
        `jointbayes.posterior.prediction.left_out_of` predicts them.
    premises
        What is taken for granted beyond that; by default nothing.
    exact
        What is exactly known, for `jointbayes.sample`: ``"model"``, of which nothing is added to the problem then, or
        some of ``"youngs_modulus"``, ``"density"``, ``"length"``, ``"damping_ratio"``, ``"accelerometer_mass"``, of
        one test ``"long.density"``.
    model_error
        Sizes of the model's errors in modes that FRFs show; by default the usual ones.
    known_modes
        Modes that were found of problems of the same joints, each by the names of its quantities and uncertain
        quantities, see `with_known_modes`. Every search for the mode starts from them as well.
    structure, joint, data, noise
        Those of a lone test, see `Test`, in place of `tests`; several joints in a sequence, each with a name; one to
        ground by the labels of its DOFs, ``("1:y", "1:rz")``.

    Raises
    ------
    ModelError
        If joints and parametrisation do not belong together, a test has a name twice or a quantity of the prior no
        test, or the first guess is not positive semidefinite.
    """

    tests: tuple[Test, ...]
    prior: JointPrior
    initial: ArrayLike | None
    extra_log_likelihood: ExtraLogLikelihood | None
    name: str
    left_out: tuple[Test, ...]
    premises: Premises
    exact: tuple[str, ...]
    model_error: ErrorSizes | None
    known_modes: tuple[Mapping[str, float], ...]

    def __init__(
        self,
        tests: Iterable[Test] = (),
        prior: JointPrior | Mapping[str, object] | None = None,
        initial: ArrayLike | None = None,
        extra_log_likelihood: ExtraLogLikelihood | None = None,
        name: str = "problem",
        *,
        structure: AnyStructure | None = None,
        joint: AnyJoint | Sequence[Joint] | Sequence[str] | None = None,
        data: Data | None = None,
        noise: NoiseModel | None = None,
        left_out: Iterable[Test] = (),
        premises: Premises = _AS_STATED,
        exact: Iterable[str] = (),
        model_error: ErrorSizes | None = None,
        known_modes: Iterable[Mapping[str, float]] = (),
    ) -> None:
        tests = tuple(tests) if isinstance(tests, Iterable) else (tests,)
        for test in tests:
            named = "tests, or structure, joint, data and prior of a lone one by these names; name them"
            require(test, Test, "problem: found as a test", named)
        own = {"structure": structure, "joint": joint, "data": data}
        if tests:
            extra = [f for f, value in (own | {"noise": noise}).items() if value is not None]
            if extra:
                found = f"found {', '.join(extra)} besides tests, which have their own"
                remedy = f"change a lone test by problem.with_test({extra[0].replace('joint', 'joints')}=…)"
                raise ModelError.of("problem", (), found, "the one or the other", remedy)
        elif structure is not None and joint is not None and data is not None:
            tests = (Test("", structure, joints_of(joint), data, noise),)
        if not tests:
            missing = [name for name, value in own.items() if value is None]
            found = f"found no {', '.join(missing)}"
            raise ModelError.of("problem", (), found, "structure, joint and data, or tests", "pass them")
        names = [test.name for test in tests]
        if len(names) > 1 and (len(set(names)) != len(names) or "" in names):
            listed = ", ".join(map(repr, names))
            raise ModelError.of("problem", (), f"found tests named {listed}", "a name for each", "rename them")
        require_own_bodies(tests)
        if prior is None or isinstance(prior, Mapping):
            prior = default_prior([(test.structure, test.joints, test.data) for test in tests], prior)
        some = 'jb.JointPrior(parametrisation, marginals), or some marginals by name, {"k22": …}; make one'
        require(prior, JointPrior, "problem: found as prior", some)
        parametrisation = arranged(prior.parametrisation, tests)
        if parametrisation != prior.parametrisation:
            prior = replace(prior, parametrisation=parametrisation)
        if initial is not None:
            parametrisation.check(initial)
        own_parts = tests, prior, initial, extra_log_likelihood, name, tuple(left_out), premises
        values = (*own_parts, tuple(exact), model_error, tuple(known_modes))
        for field, value in zip(fields(self), values, strict=True):
            object.__setattr__(self, field.name, value)

    def __repr__(self) -> str:
        tests = "; ".join(map(repr, self.tests))
        joints = "; ".join(dict.fromkeys(str(test.joints) for test in self.tests if test.joints.size)) or "none"
        return f"Problem(joint {joints}; unknown: {', '.join(self.names)}; {tests})"

    def __str__(self) -> str:
        priors = zip(self.prior.labels, self.prior.all_marginals, strict=True)
        lines = (
            *map(str, self.tests),
            *(f"prior of {label}: {marginal!r}" for label, marginal in priors),
            *(["further term of the log likelihood: a function of one's own"] if self.extra_log_likelihood else []),
        )
        return "\n".join(lines)

    @property
    def test(self) -> Test:
        """The test of a problem of one.

        Raises
        ------
        ModelError
            If there are several.
        """
        if len(self.tests) > 1:
            found = f"found {len(self.tests)} tests, {', '.join(test.name for test in self.tests)}"
            raise ModelError.of(f"{self.name}", (), found, "one", "ask a part of the problem, problem.part(name)")
        return self.tests[0]

    def with_test(self, **changes: object) -> "Problem":
        """The problem of one test with other fields of it."""
        return replace(self, tests=(replace(self.test, **changes),))  # type: ignore[arg-type]

    def with_premises(self, premises: Premises) -> "Problem":
        """The problem that takes other things for granted: the model as exact, or with these errors in each mode.

        What is uncertain besides the joint is said by the priors, in a case by its table `[uncertain]`.
        """
        tests, left_out = (
            tuple(test.with_model_error(premises.model_error) for test in some) for some in (self.tests, self.left_out)
        )
        exact = self.exact if premises.model_error or "model" in self.exact else (*self.exact, "model")
        return replace(self, tests=tests, left_out=left_out, premises=premises, exact=exact)

    def with_known_modes(self, prior: JointPrior, theta: ArrayLike) -> "Problem":
        """Return the problem with further modes from which every search starts, next to its own starts.

        A quantity of the joint is known by its name, or by its places in K^J if it has another name here.

        Parameters
        ----------
        prior
            Of the problem in which the modes were found: other data, premises or parametrisation of the same joints.
        theta
            Modes in the coordinates of that prior, shape (n, d).
        """
        points = np.atleast_2d(np.asarray(theta, dtype=float))
        names = [name for q in prior.parametrisation.quantities for name in (_place(q), q.name)]
        names += [nuisance.name for nuisance in prior.nuisances]
        rows = np.column_stack([np.repeat(prior.values(points), 2, axis=1), points[:, len(prior.marginals) :]])
        modes = [dict(zip(names, row, strict=True)) for row in rows.tolist()]
        return replace(self, known_modes=(*self.known_modes, *(m for m in modes if m not in self.known_modes)))

    @property
    def known_theta(self) -> Array:
        """The known modes as points of the prior's support, shape (n, d).

        What a mode does not say is 0 for a coupling, and in the middle of its prior for all else.
        """
        prior, guess, points = self.prior, self.first_guess.tolist(), []
        for mode in self.known_modes:
            middle = [0.0 if q.may_be_negative else k for q, k in zip(self.quantities, guess, strict=True)]
            named = zip(self.quantities, middle, strict=True)
            joint = [mode.get(q.name, mode.get(_place(q), k)) for q, k in named]
            rest = [mode.get(nuisance.name, nuisance.prior.mean) for nuisance in prior.nuisances]
            points.append(prior.nearest(joint, rest))
        return np.array([theta for theta in points if prior.feasible(theta)]).reshape(-1, len(self.names))

    @cached_property
    def parts(self) -> tuple["Problem", ...]:
        """A problem of the same unknowns for each test, with its data alone; this one itself if it is of one."""
        if len(self.tests) == 1:
            return (self,)
        return tuple(self._alone(test) for test in self.tests)

    def _alone(self, test: Test) -> "Problem":
        return replace(self, tests=(test,), extra_log_likelihood=None, left_out=())

    @cached_property
    def left_out_parts(self) -> tuple["Problem", ...]:
        """The same for each of what is left out."""
        return tuple(self._alone(test) for test in self.left_out)

    def part(self, name: str | None) -> "Problem":
        """The problem of one test by its name; of the first, or the only one, by None.

        Raises
        ------
        ModelError
            If there is no such test.
        """
        for part in self.parts:
            if name in (None, part.test.name):
                return part
        names = ", ".join(test.name for test in self.tests) or "one without a name"
        raise ModelError.of(f"{self.name}", (), f"found test {name!r}", f"one of {names}", "correct the name")

    @cached_property
    def log_posterior(self) -> LogPosterior:
        """Posterior density over θ.

        Raises
        ------
        ModelError
            If data name a DOF that their structure does not have, or a quantity of the prior belongs to no test.
        """
        terms, row = [], 0
        for test in self.tests:
            terms.append(self._term(test, row))
            row += test.joints.size
        every = (*terms, *(self._term(test, 0) for test in self.left_out))
        used = {int(column) for term in every for column in term.columns}
        idle = [name for i, name in enumerate(self._nuisances) if i not in used]
        idle += [quantity.name for quantity in self.quantities if not quantity.places]
        if idle and not (len(self.tests) == 1 and self.tests[0].name):  # one of several, see `parts`, leaves some out
            found, expected = f"found priors of {', '.join(idle)}, on which no test depends", "quantities of the tests"
            raise ModelError.of(f"{self.name}", (), found, expected, "correct the names or leave them out")
        # tests whose noise models share errors; those of one structure, joined alike, with the same unknowns, all
        by_law: dict[Hashable, list[int]] = {}
        for place, term in enumerate(terms):
            by_law.setdefault(term.likelihood.noise.shares, []).append(place)
        sharing = []
        for places in (places for law, places in by_law.items() if law is not None and len(places) > 1):
            bodies: list[int] = []
            for place in places:
                alike = (i for i in dict.fromkeys(bodies) if np.array_equal(terms[i].columns, terms[place].columns))
                same = (first for first in alike if is_one_structure(self.tests[first], self.tests[place]))
                bodies.append(next(same, place))
            noises = [terms[place].likelihood.noise for place in places]
            sharing.append(Sharing(tuple(places), noises[0].shared(noises, bodies)))
        likelihood = TestsLikelihood(self._nuisances, terms, sharing)
        return LogPosterior(self.prior, likelihood, self.extra_log_likelihood)

    def log_likelihood(self, theta: ArrayLike) -> Array:
        """ln L, shape (n,), of θ, shape (n, d), in the coordinates of `log_posterior`: for a sampler of one's own.

        −inf outside the prior's support. A nested sampler takes it with `prior.transform`, from the unit cube to θ.

        Raises
        ------
        ModelError
            If θ has another shape, or is no array of numbers.
        """
        rows = self.log_posterior.rows_of(theta)
        inside = np.isfinite(self.prior.log_density(rows))
        value = np.full(len(rows), -np.inf)
        if inside.any():
            value[inside] = self.log_posterior.log_likelihood(rows[inside])
        return value

    def _term(self, test: Test, row: int) -> Term:
        """The likelihood of a test, and where its joints and its uncertain quantities stand among all."""
        likelihood = likelihood_of(test.data, test, gain=own_name(test.name, "gain", self._nuisances) is not None)
        columns = columns_of_names(test.name, likelihood.names, self._nuisances)
        return Term(likelihood, slice(row, row + test.joints.size), columns)

    @cached_property
    def _nuisances(self) -> tuple[str, ...]:
        return tuple(nuisance.name for nuisance in self.prior.nuisances)

    def with_reference(self, *, solved: bool) -> "Problem":
        """The same problem with much richer elements in every test, see `Body.reference`."""
        return replace(self, tests=tuple(test.with_reference(solved=solved) for test in self.tests))

    @property
    def first_guess(self) -> Array:
        """Quantities of the joint, shape (q,), from which a search starts: `initial`, or the middle of the prior."""
        if self.initial is not None:
            return np.asarray(self.initial, dtype=float)
        return self.parametrisation.middle(self.prior.joint(self.prior.mean))

    @property
    def initial_theta(self) -> Array:
        """θ, shape (d,), in the coordinates of `log_posterior`: `initial` where the prior has it, else its middle."""
        theta, count = self.prior.mean.copy(), len(self.prior.marginals)
        if self.initial is not None and self.parametrisation.describes(self.initial):
            theta[:count] = self.parametrisation.coordinates(self.initial)
            if np.isfinite(self.prior.log_density(theta)[0]):
                return theta
        return self.prior.transform(np.full((1, len(self.names)), 0.5))[0]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all coordinates: of the joint, then of everything else that is uncertain."""
        return self.prior.names

    @property
    def parametrisation(self) -> Parametrisation:
        """How θ, quantities and K^J belong together."""
        return self.prior.parametrisation

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """The joint's stiffnesses: names, units and places in K^J, in the order of `JointPrior.values`."""
        return self.parametrisation.quantities

    def structural(self, factors: ArrayLike) -> Array:
        """Select from the nuisances' factors (..., q) the ones of the only test's structure, shape (..., f)."""
        return np.asarray(factors, dtype=float)[..., self.structural_columns]

    @cached_property
    def structural_columns(self) -> Indices:
        """Which nuisances concern the structure of the one test, in the order of its quantities."""
        return columns_of_names(self.test.name, self.test.structures.names, self._nuisances)

    def gain(self, factors: ArrayLike) -> Array:
        """Factor on the FRFs of the one test, shape (...), at factors (..., q) of the nuisances; 1 where certain."""
        rows, name = np.asarray(factors, dtype=float), own_name(self.test.name, "gain", self._nuisances)
        return np.ones(rows.shape[:-1]) if name is None else rows[..., self._nuisances.index(name)]

    def frfs_as_measured(
        self, ports: Ports, quantity: FrfQuantity, stiffness: ArrayLike, factors: ArrayLike
    ) -> ComplexArray:
        """Return FRFs of the first test as its measurement would show them without noise, an uncertain gain included.

        Parameters
        ----------
        ports, quantity
            Lines, DOFs and quantity.
        stiffness
            Quantities of the joint, shape (n, q).
        factors
            Factors of all uncertain quantities in the order of the prior, shape (n, q).

        Returns
        -------
        ndarray, shape (n, lines, outputs, inputs)
            SI units of the quantity.

        Raises
        ------
        ModelError
            If a DOF does not exist.
        """
        rows, part = np.asarray(factors, dtype=float), self.part(None)
        receptance = part.test.receptance_model(ports).receptance(
            part.parametrisation.matrix(stiffness), part.structural(rows)
        )
        receptance *= part.gain(rows)[..., None, None, None]
        receptance *= quantity_factor(ports.frequency_hz, quantity)[:, None, None]
        return receptance

    @cached_property
    def _frequency_models(self) -> dict[int, NaturalFrequencies]:
        """Models of the lowest so many natural frequencies that have been asked for."""
        return {}

    def natural_frequencies_hz(self, stiffness: ArrayLike, count: int, factors: ArrayLike | None = None) -> Array:
        """Lowest natural frequencies of the one test, shape (n, count), Hz, for quantities of the joint (n, q) or (q,).

        At the nominal structure, or at factors (n, q) of the nuisances. Shape (n, 0) where a body is given by its FRFs:
        the modes of the assembled structure are then unknown.

        Raises
        ------
        ModelError
            If the last axis is not as long as the joint's quantities, or there are several tests.
        """
        if np.shape(stiffness)[-1:] != (len(self.quantities),):
            raise ModelError(
                f"natural frequencies: found an array of shape {np.shape(stiffness)}; expected the joint's quantities "
                f"along its last axis: {', '.join(quantity.name for quantity in self.quantities)}"
            )
        if self.test.measured_bodies:
            return np.empty((len(np.atleast_2d(np.asarray(stiffness, dtype=float))), 0))
        model = self._frequency_models.get(count)
        if model is None:  # a fit asks hundreds of times
            model = NaturalFrequencies(self.test.structures, self.test.joints, count)
            self._frequency_models[count] = model
        if factors is None:
            return model.frequency_hz(self.parametrisation.matrix(stiffness))
        return model.frequency_hz(self.parametrisation.matrix(stiffness), self.structural(factors))


def _place(quantity: Quantity) -> str:
    """What a quantity does and where, as a text."""
    return f"{quantity.role} {quantity.places}"


def is_one_structure(first: Test, second: Test) -> bool:
    """Whether two tests are of structures that are made alike and joined at the same places."""
    return first.joints == second.joints and _is_same_body(first.structure, second.structure)


def _is_same_body(first: Any, second: Any) -> bool:  # noqa: ANN401
    """Whether two structures, or parts of them, are the same object, or made by the same recipe."""
    if first is second:
        return True
    first, second = (getattr(part, "recipe", part) for part in (first, second))
    if type(first) is not type(second):
        return False
    if is_dataclass(first):
        return all(_is_same_body(getattr(first, f.name), getattr(second, f.name)) for f in fields(first))
    if isinstance(first, tuple):
        return len(first) == len(second) and all(map(_is_same_body, first, second))
    return bool(np.array_equal(first, second)) if isinstance(first, np.ndarray) else bool(first == second)
