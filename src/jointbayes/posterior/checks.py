"""Posterior predictive checks: whether the model explains the data, before anything else is believed.

Residuals at draws of the posterior are brought to the scores that the noise model makes white with unit variance, and
their sum of squares and correlation along frequency are compared with those of replicated data. One of three things is
found: the model explains the data; it does not; or the residuals are so far below the stated noise that it is the noise
which is wrong, and how they follow each other says nothing against the model.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from jointbayes.errors import ModelError
from jointbayes.inference import NoiseModel
from jointbayes.inference.noise.base import squares_of

__all__ = ["FALSE_ALARM", "Finding", "PredictiveCheck", "check_frequencies", "check_frfs"]

Array = NDArray[np.float64]

#: Share of right models that are said not to explain the data, at most: half of it for each of the two p-values.
FALSE_ALARM = 0.01
#: One value stands out where the largest of so many would be as large this rarely.
OUTLIER_LEVEL = FALSE_ALARM / 10
#: Residuals below this share of the stated noise's variance, half its standard deviation, are far below it.
FAR_BELOW = 0.25
#: Neighbours whose residuals are compared: model error spans the lines of a resonance, so a few suffice.
_LAGS = 5
#: Replicated records, for a p-value of 1/2001 at the least, and the most values in each: the standardised statistic's
#: law hardly depends on the length.
_REPLICATES, _LONG = 2000, 1000
_DRAWS_AT_ONCE = 8  # whose scores over all lines are held in memory

Finding = Literal["explained", "misfit", "noise overstated"]


@dataclass(frozen=True, slots=True, eq=False)
class PredictiveCheck:
    """What a posterior predictive check found.

    Parameters
    ----------
    chi2_per_line
        Sum of squared residuals over what the noise model expects, per value, mean over draws: about 1.
    chi2_band
        Central 95 % of it in replicated data.
    chi2_p_value
        Probability that replicated data have a larger sum. Near 0: misfit. Near 1: the noise is overstated.
    whiteness_p_value
        Probability that white residuals look as correlated along frequency; None for natural frequencies.
    lag1
        Correlation of the residuals of neighbouring lines, mean over draws; None for natural frequencies.
    largest
        Largest residual of any value, in standard deviations of one part, mean over draws.
    largest_p_value
        Probability that the largest of as many values is larger.
    largest_at
        Line and pair (from 0) of the largest; for natural frequencies the frequency, and 0.
    chi2_by_line
        Mean over draws and pairs of the squared residual at each line, 1 expected, shape (lines,).
    inferred
        Sentences on what of the noise had to be inferred to explain the data.
    setup
        Name of the set-up whose data they are, where there are several.
    """

    chi2_per_line: float
    chi2_band: tuple[float, float]
    chi2_p_value: float
    whiteness_p_value: float | None
    lag1: float | None
    largest: float
    largest_p_value: float
    largest_at: tuple[int, int]
    chi2_by_line: Array
    inferred: tuple[str, ...] = ()
    setup: str = ""

    @property
    def _level(self) -> float:
        return FALSE_ALARM / (1 if self.whiteness_p_value is None else 2)

    @property
    def misfit(self) -> bool:
        """Whether residuals are larger than the noise allows."""
        return self.chi2_p_value < self._level

    @property
    def correlated(self) -> bool:
        """Whether residuals follow each other along frequency, as model error does and noise does not."""
        return self.whiteness_p_value is not None and self.whiteness_p_value < self._level

    @property
    def misfit_p_value(self) -> float:
        """Probability that a right model misfits as much in size or in correlation; below `FALSE_ALARM`: misfit."""
        both = [p for p in (self.chi2_p_value, self.whiteness_p_value) if p is not None]
        return min(1.0, len(both) * min(both))

    @property
    def overstated(self) -> bool:
        """Whether residuals are smaller than the noise should make them; no reason to distrust the model."""
        return self.chi2_p_value > 1 - self._level

    @property
    def finding(self) -> Finding:
        """Which one of three: residuals far below the noise are no misfit, however they follow each other."""
        if self.overstated and self.chi2_per_line < FAR_BELOW:
            return "noise overstated"
        if self.misfit or self.correlated:
            return "misfit"
        return "noise overstated" if self.overstated else "explained"

    @property
    def explains(self) -> bool:
        """Whether the model explains the data: no misfit was found."""
        return self.finding != "misfit"

    @property
    def sentence(self) -> str:
        """The finding in plain words, with its figures."""
        return f"Set-up {self.setup}: {self._said}" if self.setup else self._said

    @property
    def _said(self) -> str:
        low, high = self.chi2_band
        ratio = f"{self.chi2_per_line:#.3g}".rstrip(".")  # 1.00, not 1
        squares = (
            f"squared residuals are {ratio} times the expected noise "
            f"(95 % of replicated data: {low:.3g} to {high:.3g}; p {_p(self.chi2_p_value)})"
        )
        if self.finding == "noise overstated":
            head = f"The stated noise is overstated: {squares}. The model explains the data; intervals are too wide."
            return " ".join([head, *self.inferred, *self._remarks()])
        parts = [squares]
        if self.lag1 is not None and self.whiteness_p_value is not None:
            parts.append(
                f"residuals of neighbouring lines correlate by {self.lag1:.2f} (white noise: 0; "
                f"p {_p(self.whiteness_p_value)})"
            )
        head = "The model explains the data" if self.explains else "The model does NOT explain the data"
        return " ".join([f"{head}: {' and '.join(parts)}.", *self.inferred, *self._remarks()])

    def _remarks(self) -> list[str]:
        """What follows from the finding."""
        words = []
        if self.finding == "misfit":
            words.append("Intervals based on it are too narrow.")
        if self.largest_p_value < OUTLIER_LEVEL and not self.misfit:
            words.append(
                f"One value deviates by {self.largest:.1f} standard deviations (line {self.largest_at[0] + 1}): "
                "inspect it, or use Student-t noise."
            )
        return words


def check_frfs(
    noise: NoiseModel, z: NDArray[np.inexact], hyper: ArrayLike, rng: np.random.Generator
) -> PredictiveCheck:
    """Posterior predictive check of FRFs.

    For each draw θ the data's statistic T(y, θ) is compared with its law in data replicated from θ; the p-value is
    the mean over draws of P(T(y_rep, θ) ≥ T(y, θ)). Since the noise model makes scores white with unit variance
    whatever its hyperparameters, that law is one for all draws: for Σ|score|² it is a gamma distribution, taken
    exactly, and for the correlation along frequency it is replicated.

    Parameters
    ----------
    noise
        Law of the residuals.
    z
        Standardised residuals at draws of the posterior, shape (draws, lines, pairs).
    hyper
        The noise's hyperparameters at these draws, shape (draws, q).
    rng
        Replicates the data.

    Raises
    ------
    ModelError
        If there are fewer than two lines, no draws, or a residual is not finite.

    References
    ----------
    Gelman, A., Meng, X.-L., Stern, H. (1996). Posterior predictive assessment of model fitness via realized
    discrepancies. Statistica Sinica 6(4), 733-760.
    Ljung, G. M., Box, G. E. P. (1978). On a measure of lack of fit in time series models. Biometrika 65(2), 297-303.
    DOI 10.1093/biomet/65.2.297
    """
    if z.ndim != 3 or z.size == 0 or z.shape[1] < 2 or not np.isfinite(z).all():
        raise ModelError(
            f"posterior check: found residuals of shape {z.shape}; expected finite ones, at one draw, two lines "
            "and one pair at least"
        )
    rows = np.broadcast_to(np.asarray(hyper, dtype=float), (len(z), np.shape(hyper)[-1]))
    squares = np.array([np.vdot(one, one).real for one in z])
    noise, rows = noise.with_scale(squares, math.prod(z.shape[1:]), rows, rng)
    total, largest, observed, lag1 = np.empty((4, len(z)))
    mean = np.zeros(z.shape[1:])
    for begin in range(0, len(z), _DRAWS_AT_ONCE):
        some = slice(begin, begin + _DRAWS_AT_ONCE)
        scores = noise.scores(z[some], rows[some])
        square = 2 / noise.parts * squares_of(scores)  # 1 is expected
        total[some], largest[some] = square.sum(axis=(1, 2)), square.max(axis=(1, 2))
        mean += square.sum(axis=0) / len(z)
        observed[some], lag1[some] = _portmanteau(scores, noise.parts)
    replicated = np.sort(_replicated_portmanteau(z.shape[1], z.shape[2], noise.parts, rng))
    above = _REPLICATES - np.searchsorted(replicated, observed)
    inferred = noise.words(dict(zip(noise.names, np.median(rows, axis=0).tolist(), strict=True)))
    whiteness = float(np.mean((1 + above) / (1 + _REPLICATES)))
    return _found(total, largest, mean, noise.parts, whiteness, float(lag1.mean()), inferred)


def check_frequencies(residuals: Array) -> PredictiveCheck:
    """Posterior predictive check of natural frequencies: of the sum of squares only, since they are few.

    With no more frequencies than parameters a right and a wrong model fit alike, and the check cannot tell.

    Parameters
    ----------
    residuals
        (predicted − measured)/sd at draws of the posterior, shape (draws, count).

    Raises
    ------
    ModelError
        If there are none, or one is not finite.
    """
    if residuals.ndim != 2 or residuals.size == 0 or not np.isfinite(residuals).all():
        raise ModelError(
            f"posterior check: found residuals of shape {residuals.shape}; expected finite ones, (draws, count)"
        )
    square = residuals**2
    return _found(square.sum(axis=1), square.max(axis=1), square.mean(axis=0)[:, None], 1, None, None, ())


def _found(
    total: Array, largest: Array, mean: Array, parts: int, whiteness: float | None, lag1: float | None,
    inferred: tuple[str, ...],
) -> PredictiveCheck:  # fmt: skip
    """The check from squared scores, 1 expected: their sum and largest (draws,), and their mean (lines, pairs)."""
    n_values = mean.size
    half = parts * n_values / 2
    p_value = float(special.gammaincc(half, parts / 2 * total).mean())
    low, high = special.gammaincinv(half, [0.025, 0.975]) / half
    # P(one value larger), then of the largest of all; by log1p since the first may be tiny
    beyond = np.clip(special.gammaincc(parts / 2, parts / 2 * largest), 0, 1 - 1e-16)
    line, pair = np.unravel_index(int(mean.argmax()), mean.shape)
    return PredictiveCheck(
        chi2_per_line=float(total.mean()) / n_values,
        chi2_band=(float(low), float(high)),
        chi2_p_value=p_value,
        whiteness_p_value=whiteness,
        lag1=lag1,
        largest=float(np.sqrt(parts * largest).mean()),
        largest_p_value=float(-np.expm1(n_values * np.log1p(-beyond)).mean()),
        largest_at=(int(line), int(pair)),
        chi2_by_line=mean.mean(axis=1),
        inferred=inferred,
    )


def _portmanteau(scores: NDArray[np.inexact], parts: int) -> tuple[Array, Array]:
    """Ljung-Box statistic and correlation of neighbours of each row (n, lines, pairs), each shape (n,).

    Correlations are those of each pair's residuals over their own sum of squares, so that a wrong level of noise plays
    no part, averaged over pairs. At lag h that of a white record has variance parts·(lines − h)/(M(M + 2)) with
    M = parts·lines.
    """
    n, lines, pairs = scores.shape
    m = parts * lines
    # the real part of conj(a)·b is the scalar product of (Re a, Im a) with (Re b, Im b)
    flat = np.ascontiguousarray(scores.swapaxes(1, 2)).view(np.float64).reshape(n, pairs, m)
    norm = np.einsum("npk,npk->np", flat, flat)
    norm = np.where(norm > 0, norm, 1.0)
    total, lag1 = np.zeros(n), np.zeros(n)
    for h in range(1, min(_LAGS, lines - 1) + 1):
        product = np.einsum("npk,npk->np", flat[:, :, : -h * parts], flat[:, :, h * parts :])
        correlation = (product / norm).mean(axis=1)
        lag1 = correlation if h == 1 else lag1
        total += correlation**2 * pairs * m * (m + 2) / (parts * (lines - h))
    return total, lag1


def _replicated_portmanteau(lines: int, pairs: int, parts: int, rng: np.random.Generator) -> Array:
    """The same statistic of white residuals, shape (replicates,)."""
    length = min(lines, max(_LONG // pairs, 10 * _LAGS))
    block = max(1, 100_000 // (length * pairs))
    out = []
    for start in range(0, _REPLICATES, block):
        shape = (min(block, _REPLICATES - start), length, pairs * parts)
        white = rng.standard_normal(shape)
        out.append(_portmanteau(white.view(np.complex128) if parts == 2 else white, parts)[0])
    return np.concatenate(out)


def _p(value: float) -> str:
    """A p-value in words."""
    return "< 0.001" if value < 0.001 else "> 0.999" if value > 0.999 else f"= {value:.2g}"
