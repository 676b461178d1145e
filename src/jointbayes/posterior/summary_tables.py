"""The stiffnesses of a summary as a table: of pandas, and of a notebook."""

from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from jointbayes.arrays import Array
from jointbayes.notebook_view import table_html
from jointbayes.posterior.rounding import engineering, rounded
from jointbayes.sampling import INTERVAL, quantile_error

if TYPE_CHECKING:
    from jointbayes.posterior.summary import StiffnessSummary


def value_rows(drawn: Mapping[str, tuple[Array, str]]) -> list[tuple[str, str, str, str]]:
    """Name, median, 95 % interval and unit of quantities, with the digits that their Monte Carlo errors support.

    Of each its draws, shape (ensembles, draws, walkers), and its unit.
    """
    rows, probabilities = [], (0.5, *INTERVAL)
    for name, (draws, unit) in drawn.items():
        errors = [quantile_error(draws, probability) for probability in probabilities]
        (middle, low, high), prefixed = engineering(np.quantile(draws, probabilities).tolist(), unit, errors)
        rows.append((name, middle, f"{low} to {high}", prefixed))
    return rows


def stiffness_frame(parameters: Mapping[str, Mapping[str, Any]]) -> Any:  # noqa: ANN401 (a pandas.DataFrame)
    """One row for each stiffness, from the part of ``summary.json`` on them; its interval as two columns."""
    import pandas

    frame = pandas.DataFrame.from_dict(parameters, orient="index")
    frame[["low95", "high95"]] = frame.pop("interval95").tolist()
    return frame


def summary_html(text: str, parameters: "Mapping[str, StiffnessSummary]") -> str:
    """A table of the stiffnesses between the lines of a summary that are no table."""
    rows = [
        (name, rounded(p.known.median, p.known.median_error), p.known.limit or p.known.interval(), p.unit, p.verdict)
        for name, p in parameters.items()
    ]
    title, rest = text.split("[[Joint")[0], text.partition("[[Fit")
    head = ("Stiffness", "Median", "95 % interval", "Unit", "Verdict")
    return table_html(title, head, rows, f"<pre>{escape(''.join(rest[1:]))}</pre>")
