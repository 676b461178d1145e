"""Other samplers on the same posterior: emcee's default move, dynesty, nautilus, and NUTS of blackjax on a JAX model.

Each is imported where it is run: a missing one costs one line of the table, not the benchmark.
"""

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import jax_model
from jointbayes.inference import Problem
from jointbayes.sampling.diagnostics import autocorrelation_time

Array = NDArray[np.float64]

KEPT_TAUS = 50.0  # emcee's own advice for the length of a run


@dataclass
class Run:
    """Draws of one sampler and what they cost; weights only where they are not all equal."""

    theta: Array
    ess: float
    evaluations: int
    seconds: float
    start_up_seconds: float = 0.0
    likelihood_seconds: float | None = None
    compile_seconds: float | None = None
    cpu_share: float = 1.0
    """Processor time over that of the clock while it ran."""
    seconds_to: Callable[[float], float] | None = None
    weights: Array | None = None
    note: str = ""

    @property
    def mean(self) -> Array:
        """Posterior mean of θ, shape (3,)."""
        return np.average(self.theta, axis=0, weights=self.weights)

    @property
    def sd(self) -> Array:
        """Posterior standard deviations of θ, shape (3,)."""
        return np.sqrt(np.average((self.theta - self.mean) ** 2, axis=0, weights=self.weights))


@dataclass
class StretchRun(Run):
    """A run of emcee, with what is needed to say how long it takes with another likelihood."""

    tau: float = 0.0
    walkers: int = 0
    burn_in: int = 0
    overhead_per_step: float = 0.0


@dataclass
class Counted:
    """A log-density that counts points and seconds."""

    log_density: Callable[[Array], Array]
    points: int = 0
    seconds: float = field(default=0.0)

    def __call__(self, theta: Array) -> Array:
        began = time.perf_counter()
        value = self.log_density(theta)
        self.seconds += time.perf_counter() - began
        self.points += len(value)
        return value


def stretch_run(log_density: Callable[[Array], Array], start: Array, budget_seconds: float, seed: int) -> StretchRun:
    """emcee's default, one ensemble with the stretch move in ln k, for so long of the processor.

    It does not stop at 50 τ: on a skewed posterior τ is too small until the walkers have been all over the tail.
    """
    import emcee

    counted = Counted(log_density)
    walkers, dimension = start.shape
    sampler = emcee.EnsembleSampler(walkers, dimension, counted, vectorize=True)
    state = emcee.State(start, random_state=np.random.RandomState(seed).get_state())
    began, own = time.perf_counter(), time.process_time()
    steps = 0
    while time.process_time() - own < budget_seconds:
        block = max(100, steps // 10)  # each call copies the whole chain
        state = sampler.run_mcmc(state, block, skip_initial_state_check=steps > 0)
        steps += block
    seconds, own = time.perf_counter() - began, time.process_time() - own
    tau = float(autocorrelation_time(sampler.get_chain(discard=steps // 2)[None]).max())
    burn_in = _burn_in(steps, tau)
    kept = sampler.get_chain(discard=burn_in)
    tau = float(autocorrelation_time(kept[None]).max())
    taus = len(kept) / tau
    note = f"one ensemble of {walkers} walkers, {steps} steps, τ = {tau:.0f} steps, {taus:.0f} τ kept"
    if taus < KEPT_TAUS:
        note += f" (fewer than {KEPT_TAUS:.0f}: τ is rather a lower bound)"
    return StretchRun(
        theta=kept.reshape(-1, dimension),
        ess=kept.shape[0] * walkers / tau,
        evaluations=counted.points,
        seconds=seconds * len(kept) / steps,
        start_up_seconds=seconds * burn_in / steps,
        likelihood_seconds=counted.seconds,
        cpu_share=own / seconds,
        note=note,
        tau=tau,
        walkers=walkers,
        burn_in=burn_in,
        overhead_per_step=(seconds - counted.seconds) / steps,
    )


def _burn_in(steps: int, tau: float) -> int:
    return int(min(steps / 2, 5 * tau))


def prior_transform(problem: Problem) -> Callable[[Array], Array]:
    """θ from the unit cube, for uniform priors on ln k; joints off the cone are left to the likelihood."""
    low, high = problem.prior.support
    return lambda unit: low + (high - low) * unit


def log_likelihood_on_box(problem: Problem) -> Callable[[Array], Array]:
    """ln L of θ, shape (n, 3), −inf off the cone: what nested samplers call."""
    cut = problem.prior.log_normalisation  # the prior is uniform on the part of the box inside the cone
    volume = float(np.sum(np.log(np.diff(problem.prior.support, axis=0)))) + cut
    return lambda theta: problem.log_posterior(theta) + volume


def kish(weights: Array) -> float:
    """Effective number of draws with unequal weights."""
    return float(weights.sum() ** 2 / (weights**2).sum())


def dynesty_run(problem: Problem, seed: int, live: int = 500) -> Run:
    """dynesty's static sampler with its defaults; its effective samples grow in proportion to the live points."""
    import dynesty

    counted = Counted(log_likelihood_on_box(problem))
    began, own = time.perf_counter(), time.process_time()
    sampler = dynesty.NestedSampler(
        lambda theta: max(float(counted(theta[None])[0]), -1e300),
        prior_transform(problem),
        3,
        nlive=live,
        rstate=np.random.default_rng(seed),
    )
    with warnings.catch_warnings(record=True) as caught:  # it may repeat itself with every bound
        warnings.simplefilter("always")
        sampler.run_nested(print_progress=False)
    seconds, own = time.perf_counter() - began, time.process_time() - own
    weights = sampler.results.importance_weights()
    ess = kish(weights)
    note = f"{live} live points (default 500); the effective samples wanted are scaled in proportion to the live points"
    if caught:
        note += f"; it warned {len(caught)} times, the first time: {str(caught[0].message).split('. ')[0]}"
    return Run(
        theta=np.asarray(sampler.results.samples),
        ess=ess,
        evaluations=counted.points,
        seconds=seconds,
        likelihood_seconds=counted.seconds,
        cpu_share=own / seconds,
        seconds_to=lambda wanted: seconds * wanted / ess,
        weights=weights,
        note=note,
    )


def nautilus_run(problem: Problem, seed: int, wanted: float, live: int = 2000, budget_seconds: float = 240.0) -> Run:
    """nautilus until it has the effective samples wanted, with one network where its default is four.

    Training the networks takes most of its time here; with four it took about three times as long, for the same draws.
    """
    import nautilus

    counted = Counted(log_likelihood_on_box(problem))
    began, own = time.perf_counter(), time.process_time()
    sampler = nautilus.Sampler(
        prior_transform(problem),
        lambda theta: np.maximum(counted(theta), -1e300),
        n_dim=3,
        n_live=live,
        n_networks=1,
        vectorized=True,
        seed=seed,
    )
    done = sampler.run(n_eff=wanted, timeout=budget_seconds)
    seconds, own = time.perf_counter() - began, time.process_time() - own
    theta, log_weights, _ = sampler.posterior()
    weights = np.exp(log_weights - log_weights.max())
    note = f"{live} live points (default 2000), one network (default 4, slower here)"
    note += (
        f", run until it had {wanted:.0f} effective samples" if done else ", stopped before it was done: time was up"
    )
    return Run(
        theta=theta,
        ess=kish(weights),
        evaluations=counted.points,
        seconds=seconds,
        likelihood_seconds=counted.seconds,
        cpu_share=own / seconds,
        seconds_to=(lambda _: seconds) if done else None,
        weights=weights,
        note=note,
    )


def nuts_run(problem: Problem, start: Array, seed: int, warm_up: int = 500, draws: int = 1000) -> Run:
    """NUTS with blackjax's window adaptation of a dense mass matrix; one chain from each row of `start`."""
    import arviz
    import blackjax
    import jax

    density = jax_model.log_density(problem)
    adaptation = blackjax.window_adaptation(blackjax.nuts, density, is_mass_matrix_diagonal=False)
    adapt = jax.jit(lambda key, position: adaptation.run(key, position, num_steps=warm_up))

    def sample(key: Any, state: Any, parameters: Any) -> Any:
        step = blackjax.nuts(density, **parameters).step

        def advance(state: Any, key: Any) -> Any:
            state, info = step(key, state)
            return state, (state.position, info.num_integration_steps, info.is_divergent)

        return jax.lax.scan(advance, state, jax.random.split(key, draws))[1]

    keys = jax.random.split(jax.random.key(seed), 2 * len(start))
    position = jax.numpy.asarray(jax_model.to_unbounded(problem, start))
    began, own = time.perf_counter(), time.process_time()
    adapt = adapt.lower(keys[0], position[0]).compile()
    shapes, _ = jax.eval_shape(lambda k, p: adaptation.run(k, p, num_steps=warm_up), keys[0], position[0])
    sample = jax.jit(sample).lower(keys[0], shapes.state, shapes.parameters).compile()
    compiled = time.perf_counter()
    adapted = [jax.block_until_ready(adapt(k, p)) for k, p in zip(keys, position, strict=False)]
    warmed = time.perf_counter()
    chains = [
        jax.block_until_ready(sample(k, result.state, result.parameters))
        for k, (result, _) in zip(keys[len(start) :], adapted, strict=True)
    ]
    seconds, own = time.perf_counter() - warmed, time.process_time() - own
    theta = np.asarray(jax_model.to_theta(problem, jax.numpy.stack([c[0] for c in chains])))
    ess = min(float(arviz.ess(theta[..., i])) for i in range(3))
    r_hat = max(float(arviz.rhat(theta[..., i])) for i in range(3))
    leapfrogs = int(sum(c[1].sum() for c in chains))
    warming = int(sum(info.info.num_integration_steps.sum() for _, info in adapted))
    divergent = int(sum(c[2].sum() for c in chains))
    return Run(
        theta=theta.reshape(-1, 3),
        ess=ess,
        evaluations=leapfrogs + warming,
        seconds=seconds,
        start_up_seconds=warmed - compiled,
        likelihood_seconds=warmed - compiled + seconds,
        compile_seconds=compiled - began,
        cpu_share=own / (warmed + seconds - began),
        note=(
            f"{len(start)} chains of {warm_up} + {draws} steps, {leapfrogs / (len(start) * draws):.1f} gradients a "
            f"draw, {divergent} divergent, R̂ = {r_hat:.3f}; µs for value and gradient, NUTS included"
        ),
    )
