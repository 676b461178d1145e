"""Simulation-based calibration of our own problems: `python -m tests.science.calibration "ten kinds" --count 20`.

1. Draw a truth from the prior, and data from the likelihood at the truth.
2. Sample the posterior of these data as a run does.
3. Rank the truth of each quantity among draws that are picked at random.

The ranks are uniform if prior, likelihood and sampler agree (Talts et al. 2018, arXiv:1804.06788). The variance that
the case states stays as it is: one computed from simulated FRFs would know where the true resonances lie.
"""

import argparse
import time
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from jointbayes.posterior.prediction import simulate_at
from jointbayes.sampling import SamplerSettings
from jointbayes.workflow import sample
from tests.science.calibration_data import SMALL, VARIANTS, case_of

KINDS = "ten kinds"  # all of them in turn, pooled
PICKED = 63  # draws among which a truth is ranked: far fewer than the effective ones
BINS = 8


def simulated_values(problem, theta, rng, noise=None):
    """What the one test of a problem would measure at a truth, shape (d,), with noise of its own noise model."""
    values = simulate_at(problem, theta[None], rng, noise)[0]
    assert np.isfinite(values).all()
    return values


def replace_values(problem, values):
    """The problem of one test with other measured values, and what it states of the noise as it is."""
    return problem.with_test(data=problem.test.data.with_values(values))


def simulated_problem(analysis, source, theta, rng):
    """The problem `analysis` with the data that `source` gives at a truth, shape (d,): those of every test."""
    shared = source.log_posterior.likelihood.draw_shared(source.prior.factors(theta[None]), rng)
    pairs = enumerate(zip(analysis.parts, source.parts, strict=True))
    simulated = [
        replace_values(part, simulated_values(its, theta, rng, shared.get(i))).test for i, (part, its) in pairs
    ]
    return replace(analysis, tests=tuple(simulated))


def rank_of(truth, draws, rng):
    """Ranks of truths, shape (d,), among `PICKED` of the draws, shape (n, d): 0 to `PICKED`; ties count at random."""
    picked = draws[rng.choice(len(draws), PICKED, replace=False)]
    return (picked < truth).sum(axis=0) + rng.integers(0, (picked == truth).sum(axis=0) + 1)


@dataclass
class Calibration:
    """Ranks, shape (n, m), and whether 95 % intervals hold the truth, of m quantities in n data sets."""

    names: tuple
    ranks: np.ndarray
    held: np.ndarray
    converged: int

    @property
    def p_values(self):
        """Probability of ranks that are as uneven, of each quantity: chi² over bins of equal width."""
        counts = [np.bincount(ranks * BINS // (PICKED + 1), minlength=BINS) for ranks in self.ranks.T]
        return np.array([stats.chisquare(count).pvalue for count in counts])

    @property
    def p_value(self):
        """Of all quantities together (Bonferroni)."""
        return min(1.0, len(self.names) * self.p_values.min())

    def row(self, name):
        """One line of the table in docs/trust.md."""
        n, share = len(self.ranks), 100 * self.held.mean(axis=0)
        return f"| {name} | {n} ({self.converged}) | {self.p_value:.2g} | {share.min():.1f} to {share.max():.1f} |"


def calibrated(problem, count, *, source=None, seed=1, tell=lambda _i, _seconds: None):
    """Calibrate the analysis of a problem by data sets of another one, or of itself.

    The log density at the truth is a further quantity: its rank finds errors that cancel in each quantity by itself.
    """
    source = source or problem
    ranks, held, converged = [], [], 0
    settings = SamplerSettings().for_dimension(len(problem.names)).for_one_of_many()
    for i in range(count):
        rng, began = np.random.default_rng([seed, i]), time.process_time()
        theta = source.prior.sample(rng, 1)[0]
        simulated = simulated_problem(problem, source, theta, rng)
        posterior = sample(simulated, seed=int(rng.integers(2**32)), settings=settings, premises="exact")
        truth = np.append(theta, simulated.log_posterior(theta[None])[0])
        draws = np.column_stack([posterior.theta, posterior.log_density.ravel()])
        low, high = np.quantile(draws, [0.025, 0.975], axis=0)
        ranks.append(rank_of(truth, draws, rng))
        held.append((low <= truth) & (truth <= high))
        converged += posterior.converged
        tell(i + 1, time.process_time() - began)
    return Calibration((*problem.names, "log density"), np.array(ranks), np.array(held), converged)


def pooled(found):
    """Calibrations of several problems as one, of what all have: the first two stiffnesses and the log density."""
    ranks, held = (np.concatenate([getattr(one, what)[:, [0, 1, -1]] for one in found]) for what in ("ranks", "held"))
    return Calibration(("first", "second", "log density"), ranks, held, sum(one.converged for one in found))


def main():
    """Calibrate one kind of problem, or ten kinds together, and print the row of docs/trust.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("variant", choices=[*VARIANTS, *SMALL, KINDS])
    parser.add_argument("--count", type=int, default=500, help="data sets of a kind; default 500")
    chosen = parser.parse_args()

    def tell(n, seconds):
        if n % 10 == 0:
            print(f"{n} of {chosen.count}, {seconds:.1f} s each", flush=True)

    found = []
    kinds = (*VARIANTS, *SMALL) if chosen.variant == KINDS else (chosen.variant,)
    for seed, kind in enumerate(kinds, 1):  # each kind has truths of its own, so that ranks are independent
        found.append(calibrated(case_of(kind).problem, chosen.count, seed=seed, tell=tell))
        print(found[-1].row(kind), flush=True)
    if chosen.variant == KINDS:
        print(pooled(found).row(KINDS))


if __name__ == "__main__":
    main()
