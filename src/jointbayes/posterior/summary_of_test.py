"""What a run says of the data of each test: fit, check, misfit in an engineer's measure, natural frequencies."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from jointbayes.frf import rigid_body_modes
from jointbayes.inference import Level, Problem
from jointbayes.posterior.any_posterior import AnyPosterior
from jointbayes.posterior.checks import PredictiveCheck
from jointbayes.posterior.diagnosis import Diagnosis
from jointbayes.posterior.run_record import data_sha256
from vibrecords.arrays import Array

Interval = tuple[float, float]
_LEAST_MODES, _MOST_MODES = 3, 12  # whose frequencies are told where none was measured, or as many as there are


@dataclass(frozen=True, slots=True)
class FrequencySummary:
    """Natural frequencies, Hz: measured if they were, with the first guess of the joint, at the MAP, and over draws."""

    measured: tuple[float, ...] | None
    initial: tuple[float, ...]
    map: tuple[float, ...]
    interval95: tuple[Interval, ...]


@dataclass(frozen=True, slots=True)
class FitSummary:
    """How well the MAP fits the data: squared residuals over σ² as stated, and the log likelihood."""

    n_data: int
    chi2_per_line: float
    log_likelihood_map: float
    synthetic_data: bool


@dataclass(frozen=True, slots=True, eq=False)
class TestSummary:
    """What a run says of the data of one test; `level` and what it was are those of the test, if it had any."""

    __test__ = False

    level: Level | None
    fit: FitSummary
    check: PredictiveCheck
    diagnosis: Diagnosis
    natural_frequencies_hz: FrequencySummary
    data_sha256: str
    measurement: Mapping[str, Any] | None

    def as_json(self) -> dict[str, Any]:
        """What ``tests.NAME`` of ``summary.json`` holds."""
        return {
            "level": None if self.level is None else asdict(self.level),
            "natural_frequencies_hz": asdict(self.natural_frequencies_hz),
            "fit": fit_json(self.fit, self.diagnosis),
            "check": check_json(self.check, self.diagnosis),
            "data_sha256": self.data_sha256,
            "measurement": self.measurement,
        }


def summaries_of_tests(
    posterior: AnyPosterior, initial: Sequence[float], measured_frequencies_hz: Sequence[float] | None
) -> dict[str, TestSummary]:
    """What is said of each test by its name; of a lone test by an empty one, with frequencies measured beside it."""
    tests = posterior.problem.tests
    measured_hz = [measured_frequencies_hz] if len(tests) == 1 else [test.data.lowest_hz for test in tests]
    return {test.name: _one_test(posterior, n, initial, measured_hz[n]) for n, test in enumerate(tests)}


def _one_test(
    posterior: AnyPosterior, number: int, initial: Sequence[float], measured_hz: Sequence[float] | None
) -> TestSummary:
    part = posterior.problem.parts[number]
    measured = part.test.data
    return TestSummary(
        part.test.level,
        fit_of(part, posterior.estimate.theta),
        posterior.checks[number],
        posterior.diagnoses[number],
        frequency_summary(posterior, part, initial, measured_hz, len(posterior.diagnoses[number].modes)),
        data_sha256(part),
        measured.provenance.as_json() if measured.provenance else None,
    )


def frequency_summary(
    posterior: AnyPosterior, problem: Problem, initial: Sequence[float], measured: Sequence[float] | None, seen: int
) -> FrequencySummary:
    """Of as many modes as were measured, or as the FRFs show resonances."""
    theta, test = posterior.estimate.theta, problem.test
    count = len(measured) if measured else min(max(seen, _LEAST_MODES), _MOST_MODES)
    if not (measured or test.measured_bodies):  # of a body that is given by its FRFs nobody knows any
        body = test.structures_of_data
        count = min(count, body.n_dofs - rigid_body_modes(body, test.joints))
    fitted = problem.prior.factors(theta)  # the first guess is one of the joint, not of these

    def frequencies_of(stiffness: Sequence[float] | Array) -> tuple[float, ...]:
        return tuple(problem.natural_frequencies_hz(np.asarray(stiffness), count, fitted)[0].tolist())

    predicted = posterior.predict_natural_frequencies(count, test=test.name or None)
    ends = np.quantile(predicted, [0.025, 0.975], axis=0).T
    return FrequencySummary(
        measured=tuple(measured) if measured else None,
        initial=frequencies_of(initial),
        map=frequencies_of(problem.prior.values(theta)),
        interval95=tuple(map(tuple, ends.tolist())),
    )


def fit_of(problem: Problem, theta: Array) -> FitSummary:
    """How well θ, shape (d,), fits the data of all tests of a problem."""
    n_data, total = problem.log_posterior.likelihood.n_data, 0.0
    for part in problem.parts:
        # squared residuals over σ² as stated: expected 1 for each complex value, frequency or magnitude
        whole = 2.0 if part.test.residual_kind == "log_magnitude" else 1.0
        total += whole * float((np.abs(part.log_posterior.standardised(theta)) ** 2).sum())
    return FitSummary(
        n_data=n_data,
        chi2_per_line=total / n_data,
        log_likelihood_map=float(problem.log_posterior.log_likelihood(theta)[0]),
        synthetic_data=any(part.test.data.synthetic for part in problem.parts),
    )


def fit_json(fit: FitSummary, diagnosis: Diagnosis) -> dict[str, Any]:
    """What ``fit`` of ``summary.json`` holds."""
    return asdict(fit) | {
        "resonances": [
            {"measured_hz": m.measured_hz, "map_hz": m.predicted_hz, "error_percent": m.error_percent}
            for m in diagnosis.modes
        ],
        "frf_correlation": [
            {"output": p.output, "input": p.input, "correlation": p.correlation, "level": p.level}
            for p in diagnosis.pairs
        ],
    }


def check_json(check: PredictiveCheck, diagnosis: Diagnosis) -> dict[str, Any]:
    """What ``check`` of ``summary.json`` holds."""
    white = check.whiteness
    return {
        "explains": check.explains,
        "finding": check.finding,
        "sentence": check.sentence,
        "details": check.details,
        "causes": [] if check.explains else list(diagnosis.causes),
        "diagnosis": None if check.explains else diagnosis.sentence,
        "chi2_per_line": check.chi2_per_line,
        "chi2_band": list(check.chi2_band),
        "chi2_p_value": check.chi2_p_value,
        "level": check.level,
        "pattern": None if white is None else check.pattern,
        "whiteness": None if white is None else white.statistic,
        "whiteness_limit": None if white is None else white.limit(check.test_level),
        "whiteness_p_value": check.whiteness_p_value,
        "lag_correlations": [] if white is None else list(white.correlations),
        "false_alarm": check.test_level,
        "largest_residual_sd": check.largest,
    }
