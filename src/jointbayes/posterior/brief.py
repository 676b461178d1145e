"""What a table of many cases needs of each posterior: a few numbers, without what only a report shows."""

from collections.abc import Mapping

import numpy as np

from jointbayes.posterior.verdicts import JudgedPosterior

Cell = str | float | int | bool | None
"""One cell of a table of cases; None where a number does not exist."""


def brief(posterior: JudgedPosterior) -> dict[str, Cell]:
    """One row of a table of cases, by column.

    The numbers are those of `Posterior.summary`, which also predicts natural frequencies, diagnoses the misfit and
    sizes up the chains, and takes twice as long.

    Parameters
    ----------
    posterior
        The posterior.

    Returns
    -------
    dict
        ``seed``, ``converged``, ``reason``, ``explains``, ``misfit_p_value``; and for each stiffness and each other
        uncertain quantity q ``q.unit``, ``q.map``, ``q.median``, ``q.low95``, ``q.high95``, ``q.sd_log``,
        ``q.contraction``, and of a stiffness ``q.printed_low95``, ``q.printed_high95`` and ``q.verdict``.
    """
    record, check, prior = posterior.record, posterior.check, posterior.problem.prior
    row: dict[str, Cell] = {
        "seed": record.seed,
        "converged": record.converged,
        "reason": record.reason,
        "explains": check.explains,
        "misfit_p_value": check.misfit_p_value,
    }
    for index, name in enumerate(posterior.stiffness_names):
        known = posterior.identifiability(name)
        row |= _of_quantity(
            name,
            {
                "unit": posterior.unit(name),
                "map": float(posterior.estimate.stiffness[index]),
                "median": known.median,
                "low95": known.interval95[0],
                "high95": known.interval95[1],
                "printed_low95": known.printed95[0],
                "printed_high95": known.printed95[1],
                "sd_log": known.sd_log,
                "contraction": known.contraction,
                "verdict": known.verdict,
            },
        )
    for index, nuisance in enumerate(prior.nuisances):
        values = posterior.values(nuisance.name)
        low, median, high = np.quantile(values, [0.025, 0.5, 0.975]).tolist()
        sd, prior_sd = (float(nuisance.coordinate(v).std()) for v in (values, posterior.prior_values(nuisance.name)))
        row |= _of_quantity(
            nuisance.name,
            {
                "unit": nuisance.unit,
                "map": float(prior.nuisance_values(posterior.estimate.theta)[index]),
                "median": median,
                "low95": low,
                "high95": high,
                "sd_log": sd,
                "contraction": 1 - (sd / prior_sd) ** 2,
                "verdict": None,
            },
        )
    return row


def _of_quantity(name: str, cells: Mapping[str, Cell]) -> dict[str, Cell]:
    """Columns of one quantity; a number that is not finite is none."""
    return {
        f"{name}.{column}": None if isinstance(value, float) and not np.isfinite(value) else value
        for column, value in cells.items()
    }
