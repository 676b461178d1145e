"""The numbers of a run as one JSON-ready dictionary: `summary.json`, described in docs/summary-json.md."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from jointbayes.joint import STIFFNESS_NAMES, STIFFNESS_UNITS, joint_matrix
from jointbayes.measurement import FrfMeasurement
from jointbayes.posterior.arviz_bridge import effective_sizes
from jointbayes.posterior.checks import PredictiveCheck
from jointbayes.posterior.diagnosis import Diagnosis
from jointbayes.posterior.information.knowledge import Knowledge
from jointbayes.posterior.mesh import MeshCheck
from jointbayes.posterior.posterior import Posterior
from jointbayes.posterior.run_record import data_sha256
from jointbayes.posterior.verdicts import mode_sentence, reasons_for_no_verdict

__all__ = ["SCHEMA_VERSION", "summarise"]

#: Raised when a reader of the older form would misread the newer one.
SCHEMA_VERSION = 2


def summarise(
    posterior: Posterior,
    initial: Sequence[float],
    measured_frequencies_hz: Sequence[float] | None = None,
    knowledge: Knowledge | None = None,
    warnings: Sequence[str] = (),
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
    knowledge
        What `gather_knowledge` found; without it only the check of the model is made here.
    warnings
        What in the case is probably a slip, see `Case.warnings`.

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
        "warnings": list(warnings),
        "no_verdict": list(reasons_for_no_verdict(posterior)),
        "parameters": {
            name: _parameter(posterior, i, name, unit)
            for i, (name, unit) in enumerate(zip(STIFFNESS_NAMES, STIFFNESS_UNITS, strict=True))
        },
        "nuisances": {n.name: _nuisance(posterior, i) for i, n in enumerate(posterior.problem.prior.nuisances)},
        "map": _map(posterior),
        "natural_frequencies_hz": _frequencies(posterior, initial, measured_frequencies_hz),
        "fit": _fit(posterior),
        "check": _check(posterior.check, posterior.diagnosis),
        "mesh": _mesh(posterior.mesh),
        "identifiability": _identifiability(knowledge) if knowledge else None,
        "sampler": dict(record.sampler),
        "versions": dict(record.versions),
        "data_sha256": data_sha256(posterior.problem.measurement),
        "measurement": None if record.provenance is None else dict(record.provenance),
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
        "median": known.median,
        "median_error": known.median_error,
        "mean": float(values.mean()),
        "sd_log": known.sd_log,
        "interval95": list(known.interval95),
        "interval95_error": list(known.interval95_error),
        "prior_interval95": np.quantile(posterior.prior_values(name), [0.025, 0.975]).tolist(),
        "contraction": known.contraction,
        "verdict": known.verdict,
        "verdict_reason": known.verdict_reason,
        "if_model_right": known.if_model_right,
        "limit95": known.limit95,
        "limit95_error": known.limit95_error,
        "r_hat": r_hat[name if name in r_hat else "rho"],
        "ess_bulk": ess_bulk,
        "ess_tail": ess_tail,
    }


def _mesh(mesh: MeshCheck | None) -> dict[str, Any] | None:
    if mesh is None:
        return None
    return {
        "kind": mesh.kind,
        "elements": mesh.elements,
        "order": mesh.order,
        "largest_error_sd": mesh.error_sd,
        "largest_error_of_peak": mesh.error_of_peak,
        "shift_sd": dict(mesh.shift_sd),
        "exact_data": mesh.exact_data,
        "within_bound": mesh.within,
        "sentence": mesh.sentence,
    }


def _nuisance(posterior: Posterior, index: int) -> dict[str, Any]:
    """What became of a quantity beside the joint."""
    prior = posterior.problem.prior
    nuisance = prior.nuisances[index]
    values, before = posterior.values(nuisance.name), posterior.prior_values(nuisance.name)
    ess_bulk, ess_tail = effective_sizes(np.log(values))
    sd, prior_sd = float(np.log(values).std()), float(np.log(before).std())
    return {
        "unit": nuisance.unit,
        "nominal": nuisance.nominal,
        "map": float(prior.nuisance_values(posterior.estimate.theta)[index]),
        "median": float(np.median(values)),
        "sd_log": sd,
        "interval95": np.quantile(values, [0.025, 0.975]).tolist(),
        "prior_interval95": np.quantile(before, [0.025, 0.975]).tolist(),
        "contraction": 1 - (sd / prior_sd) ** 2,
        "r_hat": posterior.record.r_hat[nuisance.name],
        "ess_bulk": ess_bulk,
        "ess_tail": ess_tail,
    }


def _map(posterior: Posterior) -> dict[str, Any]:
    estimate = posterior.estimate
    return {
        "log_posterior": estimate.log_posterior,
        "coordinates": list(posterior.problem.names),
        "theta": estimate.theta.tolist(),
        "covariance": estimate.covariance.tolist(),
        "mode_agrees": posterior.mode_agrees,
        "mode_sentence": mode_sentence(posterior),
        "at_prior_edge": list(posterior.at_prior_edge),
        "mode_distance_sd": posterior.mode_distance,
        "starts": [{"name": s.name, "reached_mode": s.reached_mode} for s in estimate.starts],
    }


def _frequencies(posterior: Posterior, initial: Sequence[float], measured: Sequence[float] | None) -> dict[str, Any]:
    count = len(measured) if measured else 3
    problem = posterior.problem
    draws = posterior.predict_natural_frequencies(count)
    fitted = problem.prior.factors(posterior.estimate.theta)  # the first guess is one of the joint, not of these
    return {
        "measured": list(measured) if measured else None,
        "initial": problem.natural_frequencies_hz(np.asarray(initial), count, fitted)[0].tolist(),
        "map": _at_map(posterior, count),
        "interval95": np.quantile(draws, [0.025, 0.975], axis=0).T.tolist(),
    }


def _at_map(posterior: Posterior, count: int) -> list[float]:
    problem, theta = posterior.problem, posterior.estimate.theta
    frequency = problem.natural_frequencies_hz(problem.prior.stiffness(theta), count, problem.prior.factors(theta))
    found: list[float] = frequency[0].tolist()
    return found


def _fit(posterior: Posterior) -> dict[str, Any]:
    log_posterior, theta = posterior.problem.log_posterior, posterior.estimate.theta
    likelihood = log_posterior.likelihood
    log_likelihood = float(log_posterior.log_likelihood(theta)[0])
    deviance = _squares(posterior)
    measurement = posterior.problem.measurement
    return {
        "n_data": likelihood.n_data,
        "chi2_per_line": deviance / likelihood.n_data,
        "log_likelihood_map": log_likelihood,
        "synthetic_data": bool(isinstance(measurement, FrfMeasurement) and measurement.synthetic),
        "resonances": [
            {"measured_hz": m.measured_hz, "map_hz": m.predicted_hz, "error_percent": m.error_percent}
            for m in posterior.diagnosis.modes
        ],
        "frf_correlation": [
            {"output": p.output, "input": p.input, "correlation": p.correlation, "level": p.level}
            for p in posterior.diagnosis.pairs
        ],
    }


def _check(check: PredictiveCheck, diagnosis: Diagnosis) -> dict[str, Any]:
    return {
        "explains": check.explains,
        "finding": check.finding,
        "sentence": check.sentence,
        "causes": [] if check.explains else list(diagnosis.causes),
        "diagnosis": None if check.explains else diagnosis.sentence,
        "chi2_per_line": check.chi2_per_line,
        "chi2_band95": list(check.chi2_band),
        "chi2_p_value": check.chi2_p_value,
        "whiteness_p_value": check.whiteness_p_value,
        "lag1": check.lag1,
        "largest_residual_sd": check.largest,
    }


def _identifiability(knowledge: Knowledge) -> dict[str, Any]:
    return {
        "sentence": knowledge.directions_sentence,
        "directions": [
            {
                "quantity": d.quantity,
                "interval95": list(d.interval95),
                "ratio": d.ratio,
                "sd_log": d.sd_log,
                "verdict": d.verdict,
                "limit": d.limit,
                "sentence": d.sentence,
            }
            for d in knowledge.directions
        ],
        "profiles": {
            p.name: {"interval95": list(p.interval), "open_below": p.open_below, "open_above": p.open_above}
            for p in knowledge.profiles
        },
        "freed": [
            {
                "freed": list(row.uncertain),
                "source": row.source,
                "interval95": {name: list(found.interval95) for name, found in row.known.items()},
                "sd_log": {name: found.sd_log for name, found in row.known.items()},
                "verdict": row.verdict,
                "if_model_right": {name: found.if_model_right for name, found in row.known.items()},
            }
            for row in knowledge.freed
        ],
        "freed_assumed": bool(knowledge.assumed),
        "freed_assumptions": list(knowledge.assumed),
        "freed_sentence": knowledge.freed_sentence,
    }


def _squares(posterior: Posterior) -> float:
    """Squared residuals over σ² as stated, at the MAP: expected 1 for each complex value, frequency or magnitude."""
    prior, theta = posterior.problem.prior, posterior.estimate.theta
    z = posterior.problem.log_posterior.likelihood.standardised(
        joint_matrix(prior.stiffness(theta))[None], prior.factors(theta)[None]
    )
    whole = 2.0 if posterior.problem.residual_kind == "log_magnitude" else 1.0
    return whole * float((np.abs(z) ** 2).sum())


def _json_ready(value: Any) -> Any:  # noqa: ANN401 (walks any JSON-like value)
    if isinstance(value, dict):
        return {str(k): _json_ready(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_json_ready(v) for v in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
