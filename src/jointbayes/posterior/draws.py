"""Draws from a posterior in physical units, the mode, and what is computed from them alone."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError, require_count, require_probability
from jointbayes.frf import Ports
from jointbayes.identification import MapEstimate
from jointbayes.inference import ErrorSizes, Problem
from jointbayes.posterior.arviz_groups import arviz_tree
from jointbayes.posterior.checks import PredictiveCheck, check_part
from jointbayes.posterior.diagnosis import Diagnosis, diagnose
from jointbayes.posterior.model_errors import InferredError, MeshCheck, NoiseOfBodies, check_mesh, noise_of_bodies
from jointbayes.posterior.prediction import FrfPrediction, LeftOut, predict_frf, predict_left_out
from jointbayes.posterior.run_record import RunRecord, SampledCase
from jointbayes.posterior.storage import to_arviz
from vibrecords.arrays import Array

_KERNEL_DRAWS = 4000
#: Quantities that move all modes alike.
OF_ALL_MODES = ("youngs_modulus", "density", "length", "length_offset")
_SIZES, _STREAM = 8000, 7  # draws that the size of the model's error is told from, and their random numbers
#: Draws whose residuals are checked; fewer where these are millions, among which draws make no difference.
_CHECK_DRAWS, _FEWEST_CHECKED, _CHECKED_VALUES = 200, 12, 25_000_000


@dataclass(frozen=True, eq=False)
class PosteriorDraws:
    """Draws from the posterior of a joint's stiffnesses, not yet judged.

    Parameters
    ----------
    problem
        Structure, joint, data and prior.
    tree
        Groups ``posterior``, ``sample_stats`` (log density), ``prior`` and ``observed_data``, of several set-ups one of
        the last for each, ``observed_data_long``; draws have dimensions chain × draw, one chain per walker, with the
        walker's ensemble as a coordinate.
    estimate
        MAP with Laplace covariance.
    mode_theta, mode_log_density
        Joint mode: the best draw refined, shape (d,), and its log density.
    record
        How the draws came about.
    case
        The case that was sampled, for its report; None where there was none.
    """

    problem: Problem
    tree: xr.DataTree
    estimate: MapEstimate
    mode_theta: Array
    mode_log_density: float
    record: RunRecord
    case: SampledCase | None = None
    #: What `gather_knowledge` once found, as it was read with the draws.
    _kept_knowledge: Any = field(default=None, repr=False)

    def to_dataframe(self) -> Any:  # noqa: ANN401 (a pandas.DataFrame, loaded late)
        """The draws as a pandas.DataFrame: a row for each chain and draw, a column for each quantity, in its unit."""
        return self.draws.to_dataframe()

    @property
    def draws(self) -> xr.Dataset:
        """Draws in physical units, chain × draw: the quantities of the joint and what else is uncertain."""
        return self.tree["posterior"].to_dataset()

    @property
    def converged(self) -> bool:
        """Whether the sampler met its stop rule."""
        return self.record.converged

    @property
    def reason(self) -> str:
        """Why the sampler stopped, with figures."""
        return self.record.reason

    @property
    def mode(self) -> dict[str, float]:
        """Joint posterior mode (of the density over θ) in physical units, by name."""
        prior = self.problem.prior
        stiffness = dict(zip(self.stiffness_names, prior.values(self.mode_theta).tolist(), strict=True))
        names = (n.name for n in prior.nuisances)
        return stiffness | dict(zip(names, prior.nuisance_values(self.mode_theta).tolist(), strict=True))

    @property
    def mode_distance(self) -> float:
        """Largest distance of joint mode and MAP in Laplace standard deviations: 0 where they agree."""
        sd = np.sqrt(np.diag(self.estimate.covariance))
        return float(np.abs((self.mode_theta - self.estimate.theta) / sd).max())

    @property
    def mode_agrees(self) -> bool:
        """Whether joint mode and MAP are one point: within 0.01 standard deviations, or equal in density to 0.001.

        Along a direction that the data leave flat many points are equally the mode.
        """
        return self.mode_distance <= 0.01 or abs(self.mode_log_density - self.estimate.log_posterior) <= 1e-3

    @property
    def at_prior_edge(self) -> tuple[str, ...]:
        """Coordinates whose mode lies on an edge of the prior's support: there the prior decides, not the data."""
        return self.problem.prior.coordinates_at_edge(self.mode_theta)

    @property
    def stiffness_names(self) -> tuple[str, ...]:
        """Names of the joint's stiffnesses, in the order of `stiffness`."""
        return tuple(quantity.name for quantity in self.problem.quantities)

    def unit(self, name: str) -> str:
        """Unit of one stiffness or other quantity."""
        return str(_named(self.draws, name).attrs.get("units", ""))

    def values(self, name: str) -> Array:
        """All draws of one stiffness or other quantity, shape (chains, draws).

        Raises
        ------
        ModelError
            If there is no such quantity.
        """
        return _variable(self.draws, name)

    def prior_values(self, name: str) -> Array:
        """Draws of one stiffness from the prior, shape (1, draws)."""
        return _variable(self.tree["prior"].to_dataset(), name)

    @cached_property
    def stiffness(self) -> Array:
        """All draws of the joint's quantities, shape (n, q), chain after chain."""
        return np.stack([self.values(name).ravel() for name in self.stiffness_names], axis=-1)

    @property
    def prior_stiffness(self) -> Array:
        """Draws of the joint's quantities from the prior, shape (m, q)."""
        return np.stack([self.prior_values(name).ravel() for name in self.stiffness_names], axis=-1)

    @cached_property
    def theta(self) -> Array:
        """All draws of θ, shape (n, d), chain after chain."""
        prior = self.problem.prior
        rest = [n.coordinate(self.values(n.name).ravel()) for n in prior.nuisances]
        joint = prior.parametrisation.coordinates(self.stiffness)
        return np.concatenate([joint, *(column[:, None] for column in rest)], axis=1)

    @property
    def log_density(self) -> Array:
        """Log density over θ of each draw, up to the evidence, shape (chains, draws)."""
        return _variable(self.tree["sample_stats"].to_dataset(), "lp")

    def interval(self, name: str, probability: float = 0.95) -> tuple[float, float]:
        """Equal-tailed credible interval of one stiffness, in its unit.

        Raises
        ------
        ModelError
            If there is no such stiffness or the probability is not inside (0, 1).
        """
        require_probability(probability, "interval")
        tail = (1 - probability) / 2
        low, high = np.quantile(self.values(name), [tail, 1 - tail])
        return float(low), float(high)

    def by_ensemble(self, name: str) -> Array:
        """All draws of one quantity with walkers of an ensemble together, shape (ensembles, draws, walkers).

        Raises
        ------
        ModelError
            If there is no such quantity.
        """
        values = self.values(name)
        ensembles = len(np.unique(self.draws["ensemble"].values))
        return values.reshape(ensembles, -1, values.shape[1]).swapaxes(1, 2)

    @cached_property
    def check(self) -> PredictiveCheck:
        """Posterior predictive check of the data that were analysed, over draws evenly spaced among all.

        Of several set-ups that of the one which the model explains worst. The seed of the run also replicates the data.
        """
        return min(self.checks, key=lambda check: (check.explains, check.smallest_p_value))

    @cached_property
    def checks(self) -> tuple[PredictiveCheck, ...]:
        """The check of each set-up, at a level that allows for the tests of all."""
        each = [self._check(number, part) for number, part in enumerate(self.problem.parts)]
        n_tests = sum(check.n_own_tests for check in each)
        return tuple(replace(check, n_tests=n_tests) for check in each)

    def _check(self, number: int, part: Problem) -> PredictiveCheck:
        likelihood = part.log_posterior.likelihood
        theta = self.thinned(min(_CHECK_DRAWS, max(_FEWEST_CHECKED, _CHECKED_VALUES // likelihood.n_data)))
        return check_part(part, theta, np.random.default_rng([self.record.seed, 2, *([number] if number else [])]))

    @cached_property
    def model_error(self) -> InferredError | None:
        """The model's error in natural frequencies as it was inferred; None where there is no place for one."""
        prior, likelihood = self.problem.prior, self.problem.log_posterior.likelihood
        laws = (test.noise.shares for test in self.problem.tests if test.noise is not None)
        law = next((law for law in laws if isinstance(law, ErrorSizes)), None)
        if law is None:
            return None
        rng, theta = np.random.default_rng([self.record.seed, _STREAM]), self.thinned(_SIZES)
        matrices, factors = prior.matrix(theta), prior.factors(theta)
        sizes = likelihood.draw_error_size(law, matrices, factors, rng)
        assert sizes is not None
        low, middle, high = np.quantile(sizes[:, 0], [0.025, 0.5, 0.975]).tolist()
        away = (self.theta.reshape(-1, len(prior.names)).mean(axis=0) - prior.mean) / prior.sd
        shifts = {
            nuisance.name: float(shift)
            for nuisance, shift in zip(prior.nuisances, away[len(prior.marginals) :], strict=True)
            if nuisance.name.rpartition(".")[2] in OF_ALL_MODES
        }
        edges = likelihood.shift_of_edges(law, matrices, factors).mean(axis=0)
        if edges.size:
            shifts["edge"] = float(max(edges, key=abs))
        spring, misnumbered = float(np.median(sizes[:, 1])), self.problem.premises.misnumbered
        return InferredError(middle, low, high, law.frequency, spring, shifts, misnumbered)

    @cached_property
    def mesh(self) -> MeshCheck | None:
        """What the elements of the model do to the result; None where the structure is given by its matrices."""
        estimate = self.estimate
        return check_mesh(self.problem, estimate.theta, estimate.covariance, self.stiffness, self.record.seed)

    @cached_property
    def noise_of_bodies(self) -> NoiseOfBodies | None:
        """What the errors of measured bodies do to the result; None where the structure is modelled throughout."""
        return noise_of_bodies(self.problem, self.estimate.theta)

    @property
    def diagnosis(self) -> Diagnosis:
        """How far the MAP is from the data in an engineer's measure, and what its residuals point to.

        Of several set-ups that of the one which the model explains worst.
        """
        return self.diagnoses[[test.name for test in self.problem.tests].index(self.check.setup)]

    @cached_property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """The diagnosis of each set-up."""
        theta = self.mode_theta if self.mode_log_density > self.estimate.log_posterior else self.estimate.theta
        each = ((part, np.random.default_rng([self.record.seed, 4])) for part in self.problem.parts)
        return tuple(
            replace(diagnose(part.test.data, part, theta, rng), remedy=check.cell.remedy)
            for (part, rng), check in zip(each, self.checks, strict=True)
        )

    def region_level(self, stiffness: ArrayLike) -> float:
        """Probability of the smallest highest-density region that holds a joint, shape (q,).

        0.95 or less means that the point lies inside the joint 95 % region; 1 where it is impossible. Whatever else
        is uncertain is integrated out: the density is then that of a kernel estimate.
        """
        parametrisation = self.problem.parametrisation
        if not parametrisation.describes(stiffness):
            return 1.0
        point = parametrisation.coordinates(stiffness)
        if self.problem.prior.nuisances:
            from scipy.stats import gaussian_kde  # late: a quarter of a second

            draws = self.problem.prior.joint(self.thinned(_KERNEL_DRAWS)).T
            estimate = gaussian_kde(draws)
            return float((estimate(draws) > estimate(point)).mean())
        return float((self.log_density > self.problem.log_posterior(point)[0]).mean())

    def predict_frf(
        self,
        ports: Ports | None = None,
        *,
        probability: float = 0.95,
        max_draws: int = 400,
        setup: str | None = None,
    ) -> FrfPrediction:
        """Median and interval of FRFs over posterior draws, as the measurement would show them without its noise.

        An uncertain gain is in them, as in the measured FRFs, and what the errors of measured bodies make of them.

        Parameters
        ----------
        ports
            Lines and DOFs; by default those of the measured FRFs. In the quantity that was measured.
        probability
            Probability inside the band at each line.
        max_draws
            At most so many draws, evenly spaced, are evaluated.
        setup
            Name of the set-up, where there are several; by default the first.

        Raises
        ------
        ModelError
            If the data are natural frequencies and no lines are given, or a DOF does not exist.
        """
        part = self.problem.part(setup)
        frf = None if part.test.data.shown_frfs is None else part.test.data.shown_frfs.frf
        if ports is None:
            if frf is None:
                words = part.test.data.words
                raise ModelError(f"FRF prediction: the data are {words}; expected lines and DOFs; give ports")
            ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
        quantity = "receptance" if frf is None else frf.quantity
        return predict_frf(part, self.thinned(max_draws), ports, quantity, probability)

    def predict_natural_frequencies(self, count: int = 3, max_draws: int = 4000, *, setup: str | None = None) -> Array:
        """Natural frequencies of posterior draws, shape (draws, count), Hz.

        Those of the model: its own error, see ``[uncertain.model_error]``, is not in them. Of the set-up of that name,
        by default the first.
        """
        theta, prior = self.thinned(max_draws), self.problem.prior
        return self.problem.part(setup).natural_frequencies_hz(prior.values(theta), count, prior.factors(theta))

    def predict_left_out(self, probability: float = 0.95, max_draws: int = 2000) -> tuple[LeftOut, ...]:
        """What was left out of the data, and what the draws predict a measurement of it to show; empty without any.

        The intervals hold what is uncertain in joint and structure, the error of the model as far as the noise model
        states one, drawn anew for what was left out, and the noise of the measurement. Of FRFs the magnitude is
        compared, of at most 400 draws.

        Parameters
        ----------
        probability
            Probability inside each interval.
        max_draws
            At most so many draws, evenly spaced, are evaluated.

        Raises
        ------
        ModelError
            If the probability is not inside (0, 1).
        """
        require_probability(probability, "left out")
        return predict_left_out(self.problem, self.thinned(max_draws), probability, self.record.seed)

    def thinned(self, most: int) -> Array:
        """At most so many draws of θ, evenly spaced over all chains, shape (n, d)."""
        require_count(most, "max_draws: found")
        rows = np.linspace(0, len(self.theta) - 1, min(most, len(self.theta))).round().astype(int)
        return self.theta[rows]

    def to_arviz(self, megabytes: float = 200.0, max_draws: int = 1000) -> Any:  # noqa: ANN401 (type depends on the ArviZ version)
        """Return the draws as ArviZ takes them: InferenceData before ArviZ 1.0, a DataTree from 1.0 on.

        A chain is an ensemble, for its walkers are proposed from each other: the first half of every walker's draws,
        walker after walker, then the second half. R̂ and effective sizes are then as here, within 5 % where a walker
        is as long as the stop rule asks, 50 autocorrelation times.

        Groups are ``posterior``, ``sample_stats``, ``prior``, ``observed_data``, ``posterior_predictive``,
        ``log_likelihood`` value by value, and ``log_prior``: of it ``coordinates`` is the density over θ, as priors are
        stated, and with ``to_quantities`` it is that over the quantities in ``posterior``. Where values depend on each
        other there is no ``log_likelihood``, and an attribute of ``posterior`` says why. Data are ``data``, of several
        set-ups ``data_NAME``, by ``quantity``, or of FRFs by ``frequency`` (Hz), ``output`` and ``input``: the
        magnitude, beside ``data_real`` and ``data_imag``.

        Parameters
        ----------
        megabytes
            Size of ``log_likelihood`` and ``posterior_predictive`` together. Draws are left out evenly, of all groups
            alike, until they fit; 20 of each chain stay. 0 leaves out these two groups and no draw.
        max_draws
            Draws of a chain at most, so that a figure of all takes less than a minute; without effect at 0 megabytes.
        """
        theta = self.theta.reshape(*self.log_density.shape, -1)
        return to_arviz(arviz_tree(self.problem, self.tree, theta, self.record.seed, megabytes, max_draws))

    @property
    def measured_frequencies_hz(self) -> tuple[float, ...] | None:
        """Measured natural frequencies of the one test, if they are the lowest and data, or the case states any, Hz."""
        if self.case is not None:
            return self.case.measured_frequencies_hz
        return None if len(self.problem.tests) > 1 else self.problem.test.data.lowest_hz


def _named(dataset: xr.Dataset, name: str) -> xr.DataArray:
    if name not in dataset:
        raise ModelError(f"posterior: found parameter {name!r}; expected one of {', '.join(map(str, dataset))}")
    return dataset[name]


def _variable(dataset: xr.Dataset, name: str) -> Array:
    return np.asarray(_named(dataset, name).transpose("chain", "draw").values, dtype=float)
