"""What the errors of measured bodies do to a result: their part in the noise, and where the first order is doubtful."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from jointbayes.arrays import Array
from jointbayes.frf import LowRankCoupling, NoisePropagation, Ports, quantity_factor
from jointbayes.inference import Problem
from jointbayes.measurement import FrfMeasurement

#: Standard deviation of det(1 + A_jj K) relative to itself from which on the first order is doubtful: the variance that
#: it gives is then a fifth too small, since E|1/(1 + x) − 1|² = s² + 2s⁴ + … for x circular of standard deviation s.
DOUBTFUL = 0.3
#: Mean square of A_ab − A_ba over what their errors allow from which on a body is not what its variances say.
NOT_RECIPROCAL = 2.0


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
    setup
        The set-up that has them; empty where there is one test.
    """

    bodies: tuple[str, ...]
    ignored: bool
    share: float
    largest_sd: float
    largest_at_hz: float
    doubtful_lines: int
    lines: int
    discrepancy: tuple[float | None, ...]
    setup: str = ""

    @property
    def within(self) -> bool:
        """Whether the noise is not ignored, the first order will do, and the bodies are reciprocal."""
        return not (self.ignored or self.doubtful_lines or self.not_reciprocal)

    @property
    def not_reciprocal(self) -> tuple[str, ...]:
        """Names of the bodies whose FRFs differ by more than their errors when force and response change places."""
        pairs = zip(self.bodies, self.discrepancy, strict=True)
        return tuple(name for name, found in pairs if found is not None and found > NOT_RECIPROCAL)

    @property
    def narrow(self) -> str:
        """Why intervals are too narrow, as a phrase; empty where the noise counts."""
        return f"{self._noise} is ignored, so that the interval is too narrow" if self.ignored else ""

    @property
    def _noise(self) -> str:
        of = f" in set-up {self.setup}" if self.setup else ""
        return f"the noise of the measured {'body' if len(self.bodies) == 1 else 'bodies'} {', '.join(self.bodies)}{of}"

    @property
    def sentence(self) -> str:
        """The finding in plain words, with its figures."""
        whose, share = f"T{self._noise[1:]}", f"{100 * self.share:.2g} % of the variance of the residuals"
        if self.ignored:
            words = [f"{whose} is ignored: it would be {share}, or more, at half of the values."]
            words.append("Intervals are too narrow.")
        else:
            words = [f"{whose} is propagated to first order: it is {share}, or more, at half of the values."]
        if self.doubtful_lines:
            words.append(
                f"At {self.doubtful_lines} of {self.lines} lines, most at {self.largest_at_hz:.5g} Hz, it changes "
                f"det(1 + A K) by {DOUBTFUL:g} of itself or more (up to {self.largest_sd:.2g}), and the first order is "
                "doubtful; leave these lines out, or measure the body with more averages."
            )
        for name in self.not_reciprocal:
            found = self.discrepancy[self.bodies.index(name)]
            words.append(
                f"FRFs of {name} differ by {found:.3g} times what their noise allows (mean square) when force and "
                "response change places: its noise is understated, or it is not linear."
            )
        return " ".join(words)

    def as_json(self) -> dict[str, Any]:
        """What ``measured_bodies`` of ``summary.json`` holds."""
        return asdict(self) | {"within_bound": self.within, "sentence": self.sentence}


def noise_of_bodies(problem: Problem, theta: Array) -> NoiseOfBodies | None:
    """The part of measured bodies in the noise at θ, shape (d,); None where nothing of the structure is measured.

    Of several set-ups the one that is worst: that ignores it, of which most lines are doubtful, of which it is most.
    """
    found = [one for part in problem.parts if (one := _of_setup(part, theta)) is not None]
    return max(found, key=_badness, default=None)


def _badness(found: NoiseOfBodies) -> tuple[bool, bool, float, float]:
    return found.ignored, bool(found.not_reciprocal), found.doubtful_lines / found.lines, found.share


def _of_setup(problem: Problem, theta: Array) -> NoiseOfBodies | None:
    bodies, measurement = problem.measured_bodies, problem.measurement
    if not bodies or not isinstance(measurement, FrfMeasurement):
        return None
    frf, prior = measurement.frf, problem.prior
    model = problem.receptance_model(Ports(frf.frequency_hz, frf.outputs, frf.inputs))
    assert isinstance(model, LowRankCoupling)
    point = theta[None]
    propagation, matrix, factors = NoisePropagation(model), prior.matrix(point), prior.factors(point)
    roots = propagation.roots(matrix, problem.structural(factors))[0]
    level = problem.gain(factors)[0] * np.abs(quantity_factor(frf.frequency_hz, frf.quantity))[:, None]
    added = (np.abs(roots) ** 2).sum(axis=-1) * level**2
    own = measurement.variance.reshape(added.shape)
    sd = propagation.relative_sd(matrix, problem.structural(factors))[0]
    return NoiseOfBodies(
        tuple(body.name for body in bodies),
        problem.ignores_noise_of_bodies,
        float(np.median(added / (own + added))),
        float(sd.max()),
        float(frf.frequency_hz[int(sd.argmax())]),
        int((sd > DOUBTFUL).sum()),
        frf.n_lines,
        tuple(body.discrepancy for body in bodies),
        problem.setup,
    )
