"""What errors of the model do to a result: its elements against much richer ones, and the noise of measured bodies."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np

from jointbayes.frf import LowRankCoupling, NoisePropagation, Ports
from jointbayes.identification import refine
from jointbayes.inference import ErrorSizes, Problem
from jointbayes.posterior.sampled import Sampled, kept, once
from jointbayes.reproducibility import one_blas_thread
from jointbayes.rounding import attributes_of, number, percent
from vibrecords import quantity_factor
from vibrecords.arrays import Array

#: Largest error of a prediction that noise hides, in standard deviations of that line.
LARGEST_ERROR_SD = 0.05
#: The same for exact data, over the largest value of the FRF.
LARGEST_ERROR_OF_PEAK = 1e-7
#: A mesh that moves a stiffness by more than this many posterior standard deviations leaves no verdict on it.
LARGEST_SHIFT_SD = 0.5

_PRIOR_DRAWS, _FEW_PRIOR_DRAWS = 16, 3  # the few where a draw has more values than this
_MANY_VALUES = 500_000
#: Quantities that move all modes alike.
OF_ALL_MODES = ("youngs_modulus", "density", "length", "length_offset")
_SIZES, _STREAM = 8000, 7  # draws that tell the size of the model's error, and their random numbers
_EXACT = 1e-3  # of the stated noise: data with smaller residuals have none


#: Standard deviation of det(1 + A_jj K) relative to itself from which on the first order is doubtful: the variance that
#: it gives is then a fifth too small, since E|1/(1 + x) − 1|² = s² + 2s⁴ + … for x circular of standard deviation s.
DOUBTFUL = 0.3
#: Mean square of A_ab − A_ba over what their errors allow from which on a body is not what its variances say.
NOT_RECIPROCAL = 2.0


#: Errors of natural frequencies, as fractions, up to which a model is as good as models usually are, and up to which it
#: may be one of the structure at all; of a model that is stated to be worse, in its own measure. See
#: docs/what-can-be-wrong.md.
USUAL_ERROR, LARGEST_ERROR = 0.01, 0.03
#: The same of what springs to ground that are not modelled do to the lowest frequency, and of the shifts of length,
#: modulus, density and clamp's edge, in standard deviations of their priors.
USUAL_SPRING, LARGEST_SPRING = 0.02, 0.10
USUAL_SHIFT, LARGEST_SHIFT = 1.5, 2.0
NEGLIGIBLE_ERROR = 1e-4  # which no test can tell from none

ErrorGrade = Literal["negligible", "usual", "large", "impossible"]
#: What to look at where natural frequencies are off by more than usual.
DOUBTS = "length, modulus, the place of the clamp's edge, and the numbers of the modes"


@dataclass(frozen=True, slots=True)
class InferredError:
    """The model's error in natural frequencies, as fractions, as the data show it.

    Parameters
    ----------
    median, low, high
        Of the posterior of an error in each mode for itself: the middle, and the ends of the 95 % interval.
    stated
        Median of its prior.
    spring
        Posterior median of what springs to ground that are not modelled do to the lowest frequency.
    shifts
        By how many standard deviations of their priors what moves all modes alike is off, by the name of the quantity,
        ``"edge"`` of the place of a clamp's.
    misnumbered
        How the natural frequencies fit far better as those of other modes, in a phrase; empty where they do not.
    """

    median: float
    low: float
    high: float
    stated: float
    spring: float = 0.0
    shifts: Mapping[str, float] = field(default_factory=dict)
    misnumbered: str = ""

    @property
    def grade(self) -> ErrorGrade:
        """How good such a model is: residuals are small next to any error that is inferred. The worst of three."""
        shift = max(map(abs, self.shifts.values()), default=0.0)
        ends = (
            (self.median, max(USUAL_ERROR, self.stated), max(LARGEST_ERROR, 3 * self.stated)),
            (self.spring, USUAL_SPRING, LARGEST_SPRING),
            (shift, USUAL_SHIFT, LARGEST_SHIFT),
        )
        if self.misnumbered or any(size > largest for size, _, largest in ends):
            return "impossible"
        if any(size > usual for size, usual, _ in ends):
            return "large"
        return "negligible" if self.high < NEGLIGIBLE_ERROR else "usual"

    @property
    def words(self) -> str:
        """Such as ``"about 0.3 % (up to 0.9 %)"``."""
        return f"about {percent(self.median)} (up to {percent(self.high)})"

    @property
    def findings(self) -> tuple[str, ...]:
        """What is more than usual, in phrases; empty where nothing is."""
        found = [f"natural frequencies {self.misnumbered}"] if self.misnumbered else []
        if self.median > max(USUAL_ERROR, self.stated):
            found.append(f"natural frequencies are off by {self.words}, each for itself")
        if self.spring > USUAL_SPRING:
            found.append(
                f"something moves the lowest frequency by about {percent(self.spring)} as an unmodelled "
                "spring or a joint that softens does"
            )
        name, shift = max(self.shifts.items(), key=lambda item: abs(item[1]), default=("", 0.0))
        if abs(shift) > USUAL_SHIFT:
            found.append(f"the {_in_words(name)} is off by {number(abs(shift), 2)} times its uncertainty")
        return tuple(found)

    @property
    def causes(self) -> str:
        """What to look at where anything is more than usual."""
        if self.misnumbered:
            return "Check the numbers of the modes."
        looks = []
        if self.spring > USUAL_SPRING:
            looks.append("for a cable, a support or a joint that softens with level")
        if self.median > max(USUAL_ERROR, self.stated) or any(abs(s) > USUAL_SHIFT for s in self.shifts.values()):
            looks.append(DOUBTS)
        return f"Look {' and at '.join(looks)}." if looks[:1] != [DOUBTS] else f"Check {DOUBTS}."

    def as_json(self) -> dict[str, Any]:
        """What ``model_error`` of ``summary.json`` holds."""
        same = attributes_of(self, "median", "spring", "shifts", "misnumbered", "grade")
        return same | {"interval95": [self.low, self.high]}


def _in_words(quantity: str) -> str:
    own, _, name = quantity.rpartition(".")
    words = {"youngs_modulus": "Young's modulus", "edge": "place of the clamp's edge"}.get(name, name.replace("_", " "))
    return f"{words} of {own}" if own else words


@dataclass(frozen=True, slots=True)
class MeshCheck:
    """Predictions of the model's elements, compared with much richer elements.

    Parameters
    ----------
    kind
        ``"converged"`` or ``"paper"``, see `jointbayes.structure.ElementKind`; ``"reduced"`` of an imported model.
    elements, order
        Number of elements and their highest polynomial order; of vectors, and of the DOFs that they stand for.
    error_sd
        Largest error of any predicted value at the MAP and at draws of the prior, in standard deviations of the data.
    error_of_peak
        Largest error at the MAP over the largest value of the same FRF; for natural frequencies over the frequency.
    shift_sd
        How far the elements move each stiffness, in its posterior standard deviations.
    exact_data
        Whether the data are so much closer to the model than their stated noise that they have none.
    within
        Whether the error stays under its bound: 1/20 of a standard deviation, 1e-7 of the peak for exact data.
    """

    kind: str
    elements: int
    order: int
    error_sd: float
    error_of_peak: float
    shift_sd: Mapping[str, float]
    exact_data: bool
    within: bool

    def moves(self, name: str) -> bool:
        """Whether the mesh moves a stiffness by more than half a posterior standard deviation."""
        return abs(self.shift_sd.get(name, 0.0)) > LARGEST_SHIFT_SD

    @property
    def sentence(self) -> str:
        """The finding in plain words, with its figures."""
        return " ".join(self.sentences)

    @property
    def sentences(self) -> list[str]:
        """The same, sentence by sentence."""
        what = "of the paper's two-node elements" if self.kind == "paper" else f"elements of order {self.order} or less"
        error = f"{self.error_sd:.1g} standard deviations of the data"
        if self.exact_data:
            error = f"{self.error_of_peak:.1g} of the peak of the FRF"
        moved = ", ".join(f"{name} by {shift:+.1g}" for name, shift in self.shift_sd.items())
        mesh = f"Mesh: {self.elements} {what}"
        if self.kind == "reduced":
            mesh = f"Reduction: {self.elements} vectors stand for {self.order} DOFs"
        words = [f"{mesh}; no predicted value is off by more than {error}."]
        if moved:
            words.append(f"It moves {moved} posterior standard deviations.")
        if not self.within:
            limit = f"{LARGEST_ERROR_OF_PEAK:.0e} of the peak" if self.exact_data else f"{LARGEST_ERROR_SD:g}"
            remedies = {"paper": " Remove structure.element from the case.", "reduced": " Raise structure.top_hz."}
            remedy = remedies.get(self.kind, "")
            words.append(f"More than {limit} shows in the data.{remedy}")
        return words

    def as_json(self) -> dict[str, Any]:
        """What ``mesh`` of ``summary.json`` holds."""
        return attributes_of(self, "kind", "elements", "order", "shift_sd", "exact_data", "sentence") | {
            "largest_error_sd": self.error_sd,
            "largest_error_of_peak": self.error_of_peak,
            "within_bound": self.within,
        }


@one_blas_thread()
def check_mesh(problem: Problem, theta: Array, covariance: Array, draws: Array, seed: int) -> MeshCheck | None:
    """Compare a model's predictions with predictions of much richer elements.

    Parameters
    ----------
    problem
        The problem that was analysed.
    theta, covariance
        MAP, shape (d,), and its Laplace covariance, shape (d, d).
    draws
        Posterior draws of the joint's quantities, shape (n, q), for their standard deviations.
    seed
        For the draws from the prior.

    Returns
    -------
    MeshCheck, or None where the structure is given by matrices, which have no mesh
    """
    meshes = [part.test.structures_of_data.discretisation for part in problem.parts]
    elements = next((mesh for mesh in meshes if mesh is not None), None)
    if elements is None:
        return None
    reference = problem.with_reference(solved=True)
    count = _FEW_PRIOR_DRAWS if problem.log_posterior.likelihood.n_data > _MANY_VALUES else _PRIOR_DRAWS
    prior = problem.prior.sample(np.random.default_rng([seed, 3]), count)
    # 1. Errors: in standard deviations of one part over draws of the prior, and at the mode over the peak
    points = np.concatenate([theta[None], prior])
    here, there = (p.log_posterior.standardised(points) for p in (problem, reference))
    parts = np.sqrt(2) if np.iscomplexobj(here) else 1.0
    error_sd, error_of_peak = parts * float(np.abs(here - there).max()), 0.0
    for part, richer in zip(problem.parts, reference.parts, strict=True):
        own, exact = (p.log_posterior.predicted(theta)[0] for p in (part, richer))
        peak = np.abs(exact).max(axis=0) if part.test.data.frfs else exact
        error_of_peak = max(error_of_peak, float((np.abs(own - exact) / peak).max()))
    exact_data = bool(parts * np.sqrt(np.mean(np.abs(there[0]) ** 2)) < _EXACT)
    within = error_of_peak <= LARGEST_ERROR_OF_PEAK if exact_data else error_sd <= LARGEST_ERROR_SD
    # 2. How far the mode moves
    if within:  # to first order: where the richer elements have residual e + δ, their mode lies at θ − Σ Jᵀδ
        (residual, jacobian), (exact, _) = (p.log_posterior.residuals(theta) for p in (problem, reference))
        moved = covariance @ (jacobian.T @ (exact - residual))
    else:  # an error that shows is not small: by a climb on the richer elements
        mode, _ = refine(problem.with_reference(solved=False).log_posterior, theta)
        moved = theta - mode
    # 3. The same in standard deviations of the draws, of logarithms where signs allow it
    shift_sd, both = {}, problem.prior.values([theta, theta - moved]).T
    for quantity, (before, after), values in zip(problem.quantities, both, draws.T, strict=True):
        logarithmic = bool((values > 0).all()) and before > 0 and after > 0
        sd = float(np.log(values).std() if logarithmic else values.std())
        if sd > 0:
            shift_sd[quantity.name] = float(np.log(before / after) if logarithmic else before - after) / sd
    size = elements.kind, elements.elements, elements.order
    return MeshCheck(*size, error_sd, error_of_peak, shift_sd, exact_data, within)


@dataclass(frozen=True, slots=True)
class NoiseOfBodies:
    """The part of measured bodies in the noise, at the MAP.

    Parameters
    ----------
    bodies
        Their names.
    ignored
        Whether the likelihood takes them for exact.
    share
        Their part in the variance of the residuals, median over all values, 0 to 1; what it would be where it is
        ignored.
    largest_sd, largest_at_hz
        Largest standard deviation of det(1 + A_jj K) relative to itself, and its line, Hz.
    doubtful_lines, lines
        Lines at which it is above `DOUBTFUL`, and all lines.
    discrepancy
        Of each body the mean square of A_ab − A_ba over what their errors allow; None where nothing was measured both
        ways.
    test
        The test that has them; empty where there is one test.
    """

    bodies: tuple[str, ...]
    ignored: bool
    share: float
    largest_sd: float
    largest_at_hz: float
    doubtful_lines: int
    lines: int
    discrepancy: tuple[float | None, ...]
    test: str = ""

    @property
    def within(self) -> bool:
        """Whether the noise is not ignored, the first order will do, and the bodies are reciprocal."""
        return not (self.ignored or self.doubtful_lines or self.not_reciprocal)

    @property
    def not_reciprocal(self) -> tuple[str, ...]:
        """Names of the bodies whose FRFs differ by more than their errors when force and response change places."""
        pairs = zip(self.bodies, self.discrepancy, strict=True)
        return tuple(name for name, ratio in pairs if ratio is not None and ratio > NOT_RECIPROCAL)

    @property
    def noise(self) -> str:
        """What is counted or ignored, in words."""
        of = f" in test {self.test}" if self.test else ""
        return f"the noise of the measured {'body' if len(self.bodies) == 1 else 'bodies'} {', '.join(self.bodies)}{of}"

    @property
    def sentence(self) -> str:
        """The finding in plain words, with its figures."""
        return " ".join(self.sentences)

    @property
    def sentences(self) -> list[str]:
        """The same, sentence by sentence."""
        whose, share = f"T{self.noise[1:]}", f"{100 * self.share:.2g} % of the variance of the residuals"
        if self.ignored:
            words = [f"{whose} is ignored: it would be {share}, or more, at half of the values."]
            words.append("Intervals are too narrow.")
        else:
            words = [f"{whose} is propagated to first order: it is {share}, or more, at half of the values."]
        if self.doubtful_lines:
            words.append(
                f"At {self.doubtful_lines} of {self.lines} lines, most at {self.largest_at_hz:.5g} Hz, it is too large "
                f"for that ({self.largest_sd:.2g} of det(1 + A K); up to {DOUBTFUL:g} will do): leave these lines out, "
                "or measure the body with more averages."
            )
        for name in self.not_reciprocal:
            discrepancy = self.discrepancy[self.bodies.index(name)]
            words.append(
                f"FRFs of {name} differ by {discrepancy:.3g} times what their noise allows (mean square) when force "
                "and response change places: its noise is understated, or it is not linear."
            )
        return words

    def as_json(self) -> dict[str, Any]:
        """What ``measured_bodies`` of ``summary.json`` holds."""
        return asdict(self) | {"within_bound": self.within, "sentence": self.sentence}


def noise_of_bodies(problem: Problem, theta: Array) -> NoiseOfBodies | None:
    """The part of measured bodies in the noise at θ, shape (d,); None where nothing of the structure is measured.

    Of several tests the one that is worst: that ignores it, of which most lines are doubtful, of which it is most.
    """
    noise_by_test = [noise for part in problem.parts if (noise := _noise_in_test(part, theta)) is not None]
    return max(
        noise_by_test,
        key=lambda noise: (noise.ignored, bool(noise.not_reciprocal), noise.doubtful_lines / noise.lines, noise.share),
        default=None,
    )


def _noise_in_test(problem: Problem, theta: Array) -> NoiseOfBodies | None:
    bodies, data = problem.test.measured_bodies, problem.test.data.frfs
    if not bodies or data is None:
        return None
    frf, prior = data.frf, problem.prior
    model = problem.test.receptance_model(Ports(frf.frequency_hz, frf.outputs, frf.inputs))
    assert isinstance(model, LowRankCoupling)
    point = theta[None]
    propagation, matrix, factors = NoisePropagation(model), prior.matrix(point), prior.factors(point)
    roots = propagation.roots(matrix, problem.structural(factors))[0]
    level = problem.gain(factors)[0] * np.abs(quantity_factor(frf.frequency_hz, frf.quantity))[:, None]
    added = (np.abs(roots) ** 2).sum(axis=-1) * level**2
    measured_variance = data.variance.reshape(added.shape)
    sd = propagation.relative_sd(matrix, problem.structural(factors))[0]
    return NoiseOfBodies(
        tuple(body.name for body in bodies),
        problem.test.ignores_noise_of_bodies,
        float(np.median(added / (measured_variance + added))),
        float(sd.max()),
        float(frf.frequency_hz[int(sd.argmax())]),
        int((sd > DOUBTFUL).sum()),
        frf.n_lines,
        tuple(body.discrepancy for body in bodies),
        problem.test.name,
    )


@once
def model_error_of(posterior: Sampled) -> InferredError | None:
    """Return the model's error in natural frequencies as it was inferred; None where there is no place for one."""
    problem = posterior.problem
    prior, likelihood = problem.prior, problem.log_posterior.likelihood
    laws = (test.noise.shares for test in problem.tests if test.noise is not None)
    law = next((law for law in laws if isinstance(law, ErrorSizes)), None)
    if law is None:
        return None
    rng, theta = np.random.default_rng([posterior.record.seed, _STREAM]), posterior.thinned(_SIZES)
    matrices, factors = prior.matrix(theta), prior.factors(theta)
    sizes = likelihood.draw_error_size(law, matrices, factors, rng)
    assert sizes is not None
    low, middle, high = np.quantile(sizes[:, 0], [0.025, 0.5, 0.975]).tolist()
    away = (posterior.theta.reshape(-1, len(prior.names)).mean(axis=0) - prior.mean) / prior.sd
    shifts = {
        nuisance.name: float(shift)
        for nuisance, shift in zip(prior.nuisances, away[len(prior.marginals) :], strict=True)
        if nuisance.name.rpartition(".")[2] in OF_ALL_MODES
    }
    edges = likelihood.shift_of_edges(law, matrices, factors).mean(axis=0)
    if edges.size:
        shifts["edge"] = float(max(edges, key=abs))
    spring = float(np.median(sizes[:, 1]))
    return InferredError(middle, low, high, law.frequency, spring, shifts, problem.premises.misnumbered)


@kept
def mesh_of(posterior: Sampled) -> MeshCheck | None:
    """Check what the elements do to a posterior; None where the structure is given by its matrices."""
    estimate, seed = posterior.estimate, posterior.record.seed
    return check_mesh(posterior.problem, estimate.theta, estimate.covariance, posterior.stiffness, seed)


@once
def measured_bodies_of(posterior: Sampled) -> NoiseOfBodies | None:
    """Check what the errors of measured bodies do to a posterior; None where the structure is modelled throughout."""
    return noise_of_bodies(posterior.problem, posterior.estimate.theta)
