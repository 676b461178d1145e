"""Five questions of a notebook: ArviZ, corner and pandas, a noise model, a body and a sampler of your own.

A steel bar on a joint, from arrays alone; each answer is a function that runs by itself.

    python examples/five_questions.py
"""

from functools import partial
from pathlib import Path

import arviz as az
import corner
import dynesty
import numpy as np
from matplotlib import pyplot
from scipy.linalg import eigh

import jointbayes as jb
from jointbayes.inference import GaussianSpread

TRUTH, LOSS = {"k11": 2e7, "k12": 5e5, "k22": 2e4}, 0.01  # N/m, N, N·m/rad
LINES = np.arange(20.0, 1500.0, 10.0)
#: A prior of your own: two springs, each within three decades.
SPRINGS = jb.JointPrior(
    jb.parametrisation_named("springs", ("y", "rz")),
    (jb.Uniform.of_logarithm(1e6, 1e9), jb.Uniform.of_logarithm(1e3, 1e6)),
)


def bar(length=0.4, side=0.02, elements=6, modulus=2.1e11, density=7800.0):
    """K and M of a free square bar, deflection and slope at seven nodes, and their labels."""
    h, inertia, mass = length / elements, side**4 / 12, density * side**2 * length / elements
    bend = np.array(
        [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
         [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]
    )  # fmt: skip
    inert = np.array(
        [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
         [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]
    )  # fmt: skip
    k, m = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    for i in range(0, 2 * elements, 2):
        k[i : i + 4, i : i + 4] += modulus * inertia / h**3 * bend
        m[i : i + 4, i : i + 4] += mass / 420 * inert
    return k, m, [f"{node}:{way}" for node in range(1, elements + 2) for way in ("y", "rz")]


def measured(lines=LINES, percent=2.0):
    """Receptances at the tip and the middle for a hammer at the tip, with noise, from an exact solution."""
    k, m, _ = bar()
    held = (1 + 1j * LOSS) * k
    held[:2, :2] += [[TRUTH["k11"], TRUTH["k12"]], [TRUTH["k12"], TRUTH["k22"]]]
    exact = np.array([np.linalg.inv(held - (2 * np.pi * f) ** 2 * m)[np.ix_([12, 6], [12])] for f in lines])
    sd = percent / 100 * np.abs(exact) + 0.005 * np.median(np.abs(exact))
    noise = np.random.default_rng(1).normal(size=(*exact.shape, 2)) @ [1, 1j] / np.sqrt(2)
    return jb.FrfData.of_arrays(lines, exact + sd * noise, sd, ("7:y", "4:y"), ("7:y",))


def problem(structure=None, data=None, **more):
    """The bar on its joint to ground, with the default prior: all that a first posterior needs."""
    k, m, labels = bar()
    structure = structure or jb.Structure(k, m, jb.LossFactor(LOSS), labels)
    return jb.Problem(structure=structure, joint=("1:y", "1:rz"), data=data or measured(), **more)


def ask_arviz(posterior):
    """az.summary, az.loo and a figure, in ArviZ 0.23 and 1.x."""
    idata = posterior.to_arviz()
    table = az.summary(idata, var_names=list(posterior), round_to="none")
    az.plot_rank(idata, var_names=["k22"])
    pyplot.close("all")
    return table, az.loo(idata, var_name="data")


def ask_corner_and_pandas(posterior, figure):
    """A corner plot of the logarithms, and every draw as a row of a table."""
    frame = posterior.to_dataframe()
    corner.corner(np.log10(frame[list(posterior)].to_numpy()), labels=[f"log10 {k}" for k in posterior]).savefig(figure)
    pyplot.close("all")
    return frame.describe(percentiles=[0.025, 0.5, 0.975])


class Coarser(GaussianSpread):
    """The stated noise times a factor. `spread` is all that a law of independent Gaussian values needs."""

    parts = 2  # residuals of FRFs are complex

    def __init__(self, factor):
        self.factor = factor

    def spread(self, hyper, n):
        return np.full((1, 1, 1), self.factor)  # or of shape (n, lines, pairs)


def unchanged(eigenvalues, shapes, factors):
    """Modes that depend on nothing uncertain, as a function of the factors on what is."""
    return eigenvalues, shapes[None]


class BarByModes(jb.Body):
    """A body: the same bar by all of its modes, so that nothing above the band has to be made up for."""

    def __init__(self):
        k, m, self.labels = bar()
        self.damping = jb.LossFactor(LOSS)
        self.eigenvalues, self.shapes = eigh(k, m)  # of unit modal mass
        self.eigenvalues[:2] = 0.0  # it floats

    def reach_hz(self, count):
        rising = np.append(np.sqrt(self.eigenvalues) / (2 * np.pi), np.inf)
        return rising[min(count + 6, len(rising)) - 1]

    def rigid_motions(self, dofs):
        return self.shapes[dofs, :2]

    def free_modes(self, dofs, motions, forced=None):
        return partial(unchanged, self.eigenvalues[None], motions.T @ self.shapes[dofs])


def ask_own_sampler(asked, seed=1):
    """ln evidence and its error by dynesty; nautilus and others take the same two functions."""
    sampler = dynesty.NestedSampler(
        lambda theta: asked.log_likelihood(theta)[0],
        lambda u: asked.prior.transform(u)[0],
        len(asked.names),
        nlive=200,
        rstate=np.random.default_rng(seed),
    )
    sampler.run_nested(print_progress=False, dlogz=0.1)
    found = sampler.results
    return found.samples_equal(rstate=np.random.default_rng(seed)), found.logz[-1], found.logzerr[-1]


def main(figure="corner.svg", settings=None):
    """Ask all five, print what they say, and return it by name."""
    pyplot.switch_backend("Agg")
    posterior = jb.sample(problem(), seed=1, settings=settings, premises="exact")
    print(posterior.summary())
    table, loo = ask_arviz(posterior)
    described = ask_corner_and_pandas(posterior, Path(figure))
    coarse = jb.sample(problem(noise=Coarser(3.0)), seed=1, settings=settings, premises="exact")
    by_modes = jb.find_map(problem(BarByModes()))
    few = problem(data=measured(LINES[::12], percent=20.0), prior=SPRINGS)
    nested, evidence, error = ask_own_sampler(few)
    print(table, loo, described, f"ln evidence {evidence:.2f} ± {error:.2f}", sep="\n\n")
    return {
        "posterior": posterior, "table": table, "loo": loo, "described": described, "coarse": coarse,
        "by_modes": by_modes, "few": few, "nested": nested, "evidence": (evidence, error),
    }  # fmt: skip


if __name__ == "__main__":
    main()
