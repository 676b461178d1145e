"""The numbers of a run as one JSON-ready dictionary: `summary.json`, described in docs/summary-json.md."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from jointbayes.joint import STIFFNESS_NAMES, STIFFNESS_UNITS, joint_matrix
from jointbayes.measurement import FrfMeasurement
from jointbayes.posterior.arviz_bridge import effective_sizes
from jointbayes.posterior.result import Posterior, data_sha256

__all__ = ["SCHEMA_VERSION", "summarise"]

#: Raised when a reader of the older form would misread the newer one.
SCHEMA_VERSION = 1


def summarise(
    posterior: Posterior, initial: Sequence[float], measured_frequencies_hz: Sequence[float] | None = None
) -> dict[str, Any]:
    """Summarise a posterior.

    Parameters
    ----------
    posterior
        The posterior.
    initial
        First guess of (k11, k12, k22), for the frequencies before identification.
    measured_frequencies_hz
        Measured natural frequencies to set beside the predicted ones, if known.

    Returns
    -------
    dict
        JSON-ready: no NaN or infinity, ``None`` where a number does not exist.
    """
    record = posterior.record
    summary = {
        "schema_version": SCHEMA_VERSION,
        "case": record.case_name,
        "seed": record.seed,
        "converged": record.converged,
        "reason": record.reason,
        "parameters": {
            name: _parameter(posterior, i, name, unit)
            for i, (name, unit) in enumerate(zip(STIFFNESS_NAMES, STIFFNESS_UNITS, strict=True))
        },
        "map": _map(posterior),
        "natural_frequencies_hz": _frequencies(posterior, initial, measured_frequencies_hz),
        "fit": _fit(posterior),
        "sampler": dict(record.sampler),
        "versions": dict(record.versions),
        "data_sha256": data_sha256(posterior.problem.measurement),
    }
    cleaned: dict[str, Any] = _json_ready(summary)
    return cleaned


def _parameter(posterior: Posterior, index: int, name: str, unit: str) -> dict[str, Any]:
    values = posterior.values(name)
    known = posterior.identifiability(name)
    ess_bulk, ess_tail = effective_sizes(np.log(values) if (values > 0).all() else values)
    r_hat = posterior.record.r_hat
    return {
        "unit": unit,
        "map": float(posterior.estimate.stiffness[index]),
        "mode": posterior.mode[name],
        "median": float(np.median(values)),
        "mean": float(values.mean()),
        "sd_log": known.sd_log,
        "interval95": list(known.interval95),
        "prior_interval95": np.quantile(posterior.prior_values(name), [0.025, 0.975]).tolist(),
        "contraction": known.contraction,
        "verdict": known.verdict,
        "r_hat": r_hat[name if name in r_hat else "rho"],
        "ess_bulk": ess_bulk,
        "ess_tail": ess_tail,
    }


def _map(posterior: Posterior) -> dict[str, Any]:
    estimate = posterior.estimate
    return {
        "log_posterior": estimate.log_posterior,
        "coordinates": list(posterior.problem.parametrisation.names),
        "theta": estimate.theta.tolist(),
        "covariance": estimate.covariance.tolist(),
        "mode_agrees": posterior.mode_agrees,
        "at_prior_edge": list(posterior.at_prior_edge),
        "mode_distance_sd": posterior.mode_distance,
        "starts": [{"name": s.name, "reached_mode": s.reached_mode} for s in estimate.starts],
    }


def _frequencies(posterior: Posterior, initial: Sequence[float], measured: Sequence[float] | None) -> dict[str, Any]:
    count = len(measured) if measured else 3
    problem = posterior.problem
    draws = posterior.predict_natural_frequencies(count)
    return {
        "measured": list(measured) if measured else None,
        "initial": problem.natural_frequencies_hz(np.asarray(initial), count)[0].tolist(),
        "map": problem.natural_frequencies_hz(posterior.estimate.stiffness, count)[0].tolist(),
        "interval95": np.quantile(draws, [0.025, 0.975], axis=0).T.tolist(),
    }


def _fit(posterior: Posterior) -> dict[str, Any]:
    likelihood = posterior.problem.log_posterior.likelihood
    stiffness = joint_matrix(posterior.estimate.stiffness)
    log_likelihood = float(likelihood.log_likelihood(stiffness[None])[0])
    deviance = 2 * (likelihood.constant - log_likelihood)
    measurement = posterior.problem.measurement
    # Σ|r|²/σ² is half the sum over real and imaginary parts: expected 1 per complex value and 1 per frequency
    frf = isinstance(measurement, FrfMeasurement)
    return {
        "n_data": likelihood.n_data,
        "chi2_per_line": (deviance / 2 if frf else deviance) / likelihood.n_data,
        "log_likelihood_map": log_likelihood,
        "synthetic_data": bool(isinstance(measurement, FrfMeasurement) and measurement.synthetic),
    }


def _json_ready(value: Any) -> Any:  # noqa: ANN401 (walks any JSON-like value)
    if isinstance(value, dict):
        return {str(k): _json_ready(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_json_ready(v) for v in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
