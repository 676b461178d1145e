"""Posterior predictive checks: whether the model explains the data, before anything else is believed.

Residuals at draws of the posterior are brought to the scores that the noise model makes white with unit variance. Their
sum of squares has a level (far below, below, as, or above what the noise model expects), their correlation along
frequency a pattern (white, correlated) by Ljung and Box's statistic. Level, pattern and what the noise model absorbs
make one finding, with one remedy: the table is `jointbayes.posterior.checks`.

References
----------
Ljung, G. M., Box, G. E. P. (1978). On a measure of lack of fit in time series models. Biometrika 65(2), 297-303.
DOI 10.1093/biomet/65.2.297
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from jointbayes.errors import ModelError
from jointbayes.inference import NoiseModel, Problem
from jointbayes.inference.noise.base import Absorbed, residuals_of_values, squares_of, values_of_residuals
from jointbayes.posterior.sampled import Sampled, once
from jointbayes.rounding import number, p_value_in_words, told_apart
from vibrecords.arrays import Array

#: Neighbours whose residuals are compared: model error spans the lines of a resonance, so a few suffice.
LAGS = 5
#: Replicated records, the fewest and the most, their values together, and the most lines of one: the standardised
#: statistic's law hardly depends on the length.
_FEWEST, _MOST, _VALUES, _LONG = 2000, 5000, 4_000_000, 1000
_TAIL = 0.05  # of the replicated records, from which on their law is taken as exponential


@dataclass(frozen=True, slots=True, eq=False)
class Whiteness:
    """How residuals correlate along frequency.

    Parameters
    ----------
    statistic
        Ljung and Box's, mean over draws.
    replicated
        That of replicated white records, sorted, shape (replicates,).
    correlations
        Correlation of residuals 1, 2, ... lines apart, mean over draws.
    deviations
        The same in standard deviations of white residuals.
    """

    statistic: float
    replicated: Array
    correlations: tuple[float, ...]
    deviations: tuple[float, ...]

    @property
    def _tail(self) -> tuple[float, float]:
        """Where the tail of white records begins, and their mean excess: beyond it the law is taken as exponential."""
        begin = float(np.quantile(self.replicated, 1 - _TAIL))
        return begin, float((self.replicated[self.replicated > begin] - begin).mean())

    @property
    def p_value(self) -> float:
        """Probability that white residuals look as correlated."""
        begin, excess = self._tail
        if self.statistic > begin:
            return _TAIL * math.exp((begin - self.statistic) / excess)
        return 1 - float(np.searchsorted(self.replicated, self.statistic)) / len(self.replicated)

    def limit(self, level: float) -> float:
        """What the statistic of white residuals exceeds with this probability, 5 % at most."""
        begin, excess = self._tail
        return begin + excess * math.log(_TAIL / level)


def portmanteau(scores: NDArray[np.inexact], parts: int) -> tuple[Array, Array]:
    """Ljung-Box statistic (n,) and correlations (n, lags) of each row (n, lines, pairs).

    Correlations are those of each pair's residuals over their own sum of squares, so that a wrong level of noise plays
    no part, averaged over pairs.
    """
    n, lines, pairs = scores.shape
    # the real part of conj(a)·b is the scalar product of (Re a, Im a) with (Re b, Im b)
    flat = np.ascontiguousarray(scores.swapaxes(1, 2)).view(np.float64).reshape(n, pairs, parts * lines)
    norm = np.einsum("npk,npk->np", flat, flat)
    norm = np.where(norm > 0, norm, 1.0)
    sd = lag_sd(lines, pairs, parts)
    correlations = np.empty((n, len(sd)))
    for h in range(1, len(sd) + 1):
        product = np.einsum("npk,npk->np", flat[:, :, : -h * parts], flat[:, :, h * parts :])
        correlations[:, h - 1] = (product / norm).mean(axis=1)
    return ((correlations / sd) ** 2).sum(axis=1), correlations


def lag_sd(lines: int, pairs: int, parts: int) -> Array:
    """Standard deviation of the mean correlation of white records at each lag h, shape (lags,).

    Its variance is parts·(lines − h)/(M(M + 2)) over the pairs, with M = parts·lines.
    """
    m, h = parts * lines, np.arange(1, min(LAGS, lines - 1) + 1)
    return np.asarray(np.sqrt(parts * (lines - h) / (pairs * m * (m + 2))))


def replicated_portmanteau(lines: int, pairs: int, parts: int, rng: np.random.Generator) -> Array:
    """The same statistic of white residuals, shape (replicates,)."""
    length = min(lines, max(_LONG // pairs, 10 * LAGS))
    count = int(np.clip(_VALUES // (length * pairs * parts), _FEWEST, _MOST))
    block = max(1, 100_000 // (length * pairs))
    statistics = []
    for start in range(0, count, block):
        white = rng.standard_normal((min(block, count - start), length, pairs * parts))
        statistics.append(portmanteau(white.view(np.complex128) if parts == 2 else white, parts)[0])
    return np.concatenate(statistics)


Finding = Literal["explained", "misfit", "misfit below the noise", "noise overstated"]
ResidualLevel = Literal["far below", "below", "as expected", "above"]
ResidualPattern = Literal["white", "correlated"]


#: Opening of each finding, and what it means for the intervals; nothing where the model explains the data.
_WORDS: dict[Finding, tuple[str, str]] = {
    "explained": ("The model explains the {of}", ""),
    "misfit": ("The model does NOT explain the {of}", "Do not use intervals from this fit."),
    "misfit below the noise": ("The model does NOT explain the {of}", "Intervals are too wide, and may be shifted."),
    "noise overstated": ("The stated noise is overstated", "The model explains the {of}; intervals are too wide."),
}

_INFER = '([noise] scale = "sampled")'
_SMALLER = f"State the noise as small as it is, or infer its size {_INFER}."
_LARGER = f"The residuals look like noise that is larger than stated: state it so, or infer its size {_INFER}."
_TAILS = (
    "The residuals are larger than Student-t noise allows: state the noise as large as it is, or infer its size "
    f"{_INFER}."
)
_BOUND = "The size of the noise that was inferred lies at a bound of its prior: widen it."
_MODEL = (
    "No single cause stands out. Check lengths, masses and supports of the model, and what else holds the structure; "
    "of measured FRFs use the answer of their modes, which allows for an error of the model."
)
_BOTH = f"Infer the size of the noise {_INFER}, and look for what the model lacks."
_SD_LARGER = (
    "State standard deviations as large as they are, or allow for an error of the model ([uncertain.model_error])."
)
_SD_SMALLER = "State their standard deviations as small as they are."

#: What is checked where FRFs are analysed by their modes.
OF_FRFS = "modes that the FRFs show"
#: What the noise model absorbs: a column of the table each. Natural frequencies are too few for a pattern.
COLUMNS: tuple[Absorbed, ...] = ("nothing", "outliers", "size", "frequencies")
#: Of each level and pattern the finding, as ``summary.json`` has it, and what helps; nothing where nothing needs help.
# fmt: off
ROWS: dict[tuple[ResidualLevel, ResidualPattern], tuple[Finding, tuple[str, ...]]] = {
    # level and pattern              finding                    nothing   outliers  size    frequencies
    ("far below", "white"):        ("noise overstated",       (_SMALLER, _SMALLER, _BOUND, _SD_SMALLER)),
    ("far below", "correlated"):   ("noise overstated",       (_SMALLER, _SMALLER, _BOUND)),
    ("below", "white"):            ("noise overstated",       (_SMALLER, _SMALLER, _BOUND, _SD_SMALLER)),
    ("below", "correlated"):       ("misfit below the noise", (_BOTH,    _BOTH,    _MODEL)),
    ("as expected", "white"):      ("explained",              ("",       "",       "",     "")),
    ("as expected", "correlated"): ("misfit",                 (_MODEL,   _MODEL,   _MODEL)),
    ("above", "white"):            ("misfit",                 (_LARGER,  _TAILS,   _BOUND, _SD_LARGER)),
    ("above", "correlated"):       ("misfit",                 (_MODEL,   _MODEL,   _MODEL)),
}
# fmt: on


#: Probability that any of the tests of a run, on level and pattern of all its tests, fails with a right model and the
#: right noise, at most: each has this over their number (Bonferroni).
FALSE_ALARM = 0.01
#: One value stands out where the largest of so many would be as large this rarely.
OUTLIER_LEVEL = FALSE_ALARM / 10
#: Residuals below this share of the stated noise's variance, half its standard deviation, are far below it.
FAR_BELOW = 0.25
#: Draws whose residuals are checked; fewer where these are millions, among which draws make no difference.
_CHECK_DRAWS, _FEWEST_CHECKED, _CHECKED_VALUES = 200, 12, 25_000_000
_DRAWS_AT_ONCE = 8  # whose scores over all lines are held in memory


@dataclass(frozen=True, slots=True, eq=False)
class PredictiveCheck:
    """What a posterior predictive check found.

    Parameters
    ----------
    chi2_per_line
        Sum of squared residuals over what the noise model expects, per value, mean over draws: about 1.
    n_parts
        Real numbers squared in it: its law in replicated data is χ² with as many degrees of freedom.
    whiteness
        Correlation along frequency; None for natural frequencies.
    largest
        Largest residual of any value, in standard deviations of one part, mean over draws.
    largest_p_value
        Probability that the largest of as many values is larger.
    largest_at
        Line and pair (from 0) of the largest; for natural frequencies the frequency, and 0.
    chi2_by_line
        Mean over draws and pairs of the squared residual at each line, 1 expected, shape (lines,).
    absorbs
        What the noise model takes up of a misfit.
    inferred
        Sentences on what of the noise had to be inferred to explain the data.
    test
        Name of the test whose data they are, where there are several.
    n_tests
        Tests of all tests together; 0: of these data alone.
    of
        What was checked, after "the": where FRFs are analysed by their modes these alone.
    """

    chi2_per_line: float
    n_parts: int
    whiteness: Whiteness | None
    largest: float
    largest_p_value: float
    largest_at: tuple[int, int]
    chi2_by_line: Array
    absorbs: Absorbed = "nothing"
    inferred: tuple[str, ...] = ()
    test: str = ""
    n_tests: int = 0
    of: str = "data"

    @property
    def n_own_tests(self) -> int:
        """Tests of these data: of the level, and of the pattern where they have one."""
        return 1 if self.whiteness is None else 2

    @property
    def test_level(self) -> float:
        """Probability that one of the tests fails with a right model, so that any does with `FALSE_ALARM` at most."""
        return FALSE_ALARM / (self.n_tests or self.n_own_tests)

    @property
    def chi2_band(self) -> tuple[float, float]:
        """Central 1 − `test_level` of `chi2_per_line` in replicated data: outside it the level is another."""
        half, tail = self.n_parts / 2, self.test_level / 2
        return float(special.gammaincinv(half, tail) / half), float(special.gammainccinv(half, tail) / half)

    @property
    def chi2_p_value(self) -> float:
        """Probability that replicated data have a larger sum. Near 0: misfit. Near 1: the noise is overstated."""
        return float(special.gammaincc(self.n_parts / 2, self.n_parts / 2 * self.chi2_per_line))

    @property
    def whiteness_p_value(self) -> float | None:
        """Probability that white residuals look as correlated along frequency; None for natural frequencies."""
        return None if self.whiteness is None else self.whiteness.p_value

    @property
    def level(self) -> ResidualLevel:
        """Where the sum of squares lies to the band of replicated data."""
        low, high = self.chi2_band
        if self.chi2_per_line > high:
            return "above"
        if self.chi2_per_line >= low:
            return "as expected"
        return "far below" if self.chi2_per_line < FAR_BELOW else "below"

    @property
    def pattern(self) -> ResidualPattern:
        """Whether residuals follow each other along frequency, as model error does and noise does not."""
        white = self.whiteness is None or self.whiteness.statistic <= self.whiteness.limit(self.test_level)
        return "white" if white else "correlated"

    @property
    def finding(self) -> Finding:
        """The finding, one of four."""
        return ROWS[self.level, self.pattern][0]

    @property
    def remedy(self) -> str:
        """What helps; empty where nothing needs help."""
        return ROWS[self.level, self.pattern][1][COLUMNS.index(self.absorbs)]

    @property
    def smallest_p_value(self) -> float:
        """Probability that residuals of a right model are as large, or as correlated: the less likely of the two."""
        return min(2 * self.chi2_p_value, math.inf if self.whiteness is None else self.whiteness.p_value)

    @property
    def misfit_p_value(self) -> float:
        """Probability that any test fails as badly with a right model; below `FALSE_ALARM`: misfit."""
        return min(1.0, (self.n_tests or self.n_own_tests) * self.smallest_p_value)

    @property
    def explains(self) -> bool:
        """Whether the model explains the data: no misfit was found."""
        return self.finding in ("explained", "noise overstated")

    @property
    def sentence(self) -> str:
        """The finding in plain words, with the size or the rarity of the misfit."""
        test, (head, consequence) = f"Test {self.test}: " if self.test else "", _WORDS[self.finding]
        return f"{test}{head}: {self._misfit}. {consequence}".format(of=self.of).rstrip()

    @property
    def _misfit(self) -> str:
        size, low, high = told_apart(*map(math.sqrt, (self.chi2_per_line, *self.chi2_band)))
        text = f"the misfit is {size} times the noise (noise alone: {low} to {high})"
        if self.explains or self.whiteness is None or self.pattern == "white":
            return text
        pattern = "follows a pattern along frequency"
        if self.level != "as expected":
            return f"{text} {'and' if self.level == 'above' else 'but'} {pattern}"
        p = self.whiteness.p_value
        rarity = "less than once in 1000 tests" if p < 0.001 else f"once in {number(1 / p, 2)} tests"
        return f"the misfit {pattern} that noise alone makes {rarity}"

    @property
    def details(self) -> str:
        """The figures of the finding, and its advice."""
        return f"{self.figures} {self.advice}".rstrip()

    @property
    def advice(self) -> str:
        """What had to be inferred, what helps (of a misfit the diagnosis says that), and a value that stands out."""
        remedy = self.remedy if self.explains else ""
        return " ".join(word for word in (*self.inferred, remedy, self._outlier) if word)

    @property
    def figures(self) -> str:
        """What the finding rests on, for who knows the tests."""
        ratio, low, high = told_apart(self.chi2_per_line, *self.chi2_band)
        figures = (
            f"Squared residuals are {ratio} times the expected noise "
            f"({100 * (1 - self.test_level):.6g} % of replicated data: {low} to {high}; "
            f"p {p_value_in_words(self.chi2_p_value)})"
        )
        if self.whiteness is not None and self.finding != "noise overstated":
            figures += f" and residuals of nearby lines {self._correlation(self.whiteness)}"
        return f"{figures}."

    def _correlation(self, white: Whiteness) -> str:
        statistic, limit = told_apart(white.statistic, white.limit(self.test_level))
        test = f"Ljung-Box statistic {statistic}, white noise: up to {limit}; p {p_value_in_words(white.p_value)}"
        if self.pattern == "white":
            return f"do not correlate ({test})"
        lag = 1 + int(np.abs(white.deviations).argmax())
        apart = f"{lag} line{'s' if lag > 1 else ''} apart"
        by, sd = white.correlations[lag - 1], white.deviations[lag - 1]
        return f"correlate ({test}), most at {apart}: by {by:.2g}, {abs(sd):.2g} standard deviations of white noise"

    @property
    def _outlier(self) -> str:
        """That one value stands out, where it does and the sum of squares is not too large anyway."""
        if self.largest_p_value >= OUTLIER_LEVEL or self.level == "above":
            return ""
        other = "" if self.absorbs == "outliers" else ", or use Student-t noise"
        return (
            f"One value deviates by {self.largest:.1f} standard deviations (line {self.largest_at[0] + 1}): "
            f"inspect it{other}."
        )


@once
def checks_of(posterior: Sampled) -> tuple[PredictiveCheck, ...]:
    """Check each test of a posterior, at a level that allows for the checks of all."""
    each = []
    for index, part in enumerate(posterior.problem.parts):
        most = min(_CHECK_DRAWS, max(_FEWEST_CHECKED, _CHECKED_VALUES // part.log_posterior.likelihood.n_data))
        rng = np.random.default_rng([posterior.record.seed, 2, *([index] if index else [])])
        each.append(check_part(part, posterior.thinned(most), rng))
    n_tests = sum(check.n_own_tests for check in each)
    return tuple(replace(check, n_tests=n_tests) for check in each)


def check_of(posterior: Sampled) -> PredictiveCheck:
    """Return the check of the test that the model explains worst."""
    return min(checks_of(posterior), key=lambda check: (check.explains, check.smallest_p_value))


def check_part(part: Problem, theta: Array, rng: np.random.Generator) -> PredictiveCheck:
    """The check of the data of one test at draws θ, shape (n, d), of its problem."""
    likelihood, test = part.log_posterior.likelihood, part.test
    hyper, z = likelihood.hyper(part.prior.factors(theta)), part.log_posterior.standardised(theta)
    if test.data.frfs is not None:
        return replace(check_frfs(likelihood.noise, z, hyper, rng), test=test.name)
    absorbs: Absorbed = "nothing" if test.data.modes is None else "frequencies"
    of = "data" if test.data.shown_frfs is None else OF_FRFS
    return replace(check_frequencies(np.asarray(z.real), likelihood.noise, hyper, rng, absorbs), test=test.name, of=of)


def check_frfs(
    noise: NoiseModel, z: NDArray[np.inexact], hyper: ArrayLike, rng: np.random.Generator
) -> PredictiveCheck:
    """Posterior predictive check of FRFs.

    The mean over draws θ of the data's statistic T(y, θ) is compared with the law of T in data replicated from θ.
    Since the noise model makes scores white with unit variance for any hyperparameters, that law is one for all
    draws: for Σ|score|² it is a gamma distribution, taken exactly, and for the correlation along frequency that of
    replicated records.

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
    squares = np.array([np.vdot(residuals, residuals).real for residuals in z])
    noise, rows = noise.with_scale(squares, math.prod(z.shape[1:]), rows, rng)
    total, largest, observed = np.empty((3, len(z)))
    lags = np.empty((len(z), min(LAGS, z.shape[1] - 1)))
    mean = np.zeros(z.shape[1:])
    for begin in range(0, len(z), _DRAWS_AT_ONCE):
        some = slice(begin, begin + _DRAWS_AT_ONCE)
        scores = noise.scores(z[some], rows[some])
        square = 2 / noise.parts * squares_of(scores)  # 1 is expected
        total[some], largest[some] = square.sum(axis=(1, 2)), square.max(axis=(1, 2))
        mean += square.sum(axis=0) / len(z)
        observed[some], lags[some] = portmanteau(scores, noise.parts)
    replicated = replicated_portmanteau(z.shape[1], z.shape[2], noise.parts, rng)
    inferred = noise.words(dict(zip(noise.names, np.median(rows, axis=0).tolist(), strict=True)), z)
    correlations = lags.mean(axis=0)
    deviations = correlations / lag_sd(z.shape[1], z.shape[2], noise.parts)[: lags.shape[1]]
    by_lag = tuple(correlations.tolist()), tuple(deviations.tolist())
    whiteness = Whiteness(float(observed.mean()), np.sort(replicated), *by_lag)
    return _checked(total, largest, mean, noise.parts, whiteness, noise.absorbs, inferred)


def check_frequencies(
    residuals: Array,
    noise: NoiseModel | None = None,
    hyper: ArrayLike = (),
    rng: np.random.Generator | None = None,
    absorbs: Absorbed = "frequencies",
) -> PredictiveCheck:
    """Posterior predictive check of natural frequencies, or of others few values: of the sum of squares only.

    With no more values than parameters a right and a wrong model fit alike, and the check cannot tell.

    Parameters
    ----------
    residuals
        (predicted − measured)/sd at draws of the posterior, shape (draws, count).
    noise, hyper, rng
        Law of the residuals, its hyperparameters at these draws, shape (draws, q), and what draws a scale that it
        integrates out; without a law that of the stated standard deviations.
    absorbs
        What takes up a misfit where the noise is as stated.

    Raises
    ------
    ModelError
        If there are none, or one is not finite.
    """
    if residuals.ndim != 2 or residuals.size == 0 or not np.isfinite(residuals).all():
        raise ModelError(
            f"posterior check: found residuals of shape {residuals.shape}; expected finite ones, (draws, count)"
        )
    square: Array = residuals**2
    inferred: tuple[str, ...] = ()
    if noise is not None and not noise.as_stated:
        noise, rows = noise.with_scale(square.sum(axis=1) / 2, residuals.shape[1], np.asarray(hyper, dtype=float), rng)
        z = residuals_of_values(residuals)
        square, absorbs = values_of_residuals(noise.scores(z, rows)) ** 2, noise.absorbs
        inferred = noise.words(dict(zip(noise.names, np.median(rows, axis=0).tolist(), strict=True)), z)
    return _checked(square.sum(axis=1), square.max(axis=1), square.mean(axis=0)[:, None], 1, None, absorbs, inferred)


def _checked(
    total: Array, largest: Array, mean: Array, parts: int, whiteness: Whiteness | None, absorbs: Absorbed,
    inferred: tuple[str, ...],
) -> PredictiveCheck:  # fmt: skip
    """The check from squared scores, 1 expected: their sum and largest (draws,), and their mean (lines, pairs)."""
    n_values = mean.size
    # P(one value larger), then of the largest of all; by log1p since the first may be tiny
    beyond = np.clip(special.gammaincc(parts / 2, parts / 2 * largest), 0, 1 - 1e-16)
    line, pair = np.unravel_index(int(mean.argmax()), mean.shape)
    return PredictiveCheck(
        chi2_per_line=float(total.mean()) / n_values,
        n_parts=parts * n_values,
        whiteness=whiteness,
        largest=float(np.sqrt(parts * largest).mean()),
        largest_p_value=float(-np.expm1(n_values * np.log1p(-beyond)).mean()),
        largest_at=(int(line), int(pair)),
        chi2_by_line=mean.mean(axis=1),
        absorbs=absorbs,
        inferred=inferred,
    )
