"""The stiffnesses of a summary as a table: of pandas, and of a notebook."""

import math
import re
from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from jointbayes.posterior.identifiability import Identifiability
from jointbayes.posterior.rounding import engineering
from jointbayes.sampling import INTERVAL, quantile_error
from vibrecords.arrays import Array
from vibrecords.notebook_view import table_html

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


def quantity_frame(summary: Mapping[str, Any]) -> Any:  # noqa: ANN401 (a pandas.DataFrame)
    """One row for each quantity of what ``summary.json`` holds; what does not exist is NaN."""
    import pandas

    rows = {**summary["parameters"], **summary["nuisances"]}
    return pandas.DataFrame.from_dict({name: _cells(row) for name, row in rows.items()}, orient="index")


def _cells(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row without lists: of a pair of ends ``interval95`` as ``low95`` and ``high95``, and so on."""
    cells: dict[str, Any] = {}
    for name, value in row.items():
        if isinstance(value, list):
            stem = re.sub("_?(interval)?95", "_{}95", name).lstrip("_") if "95" in name else f"{name}_{{}}"
            cells |= {stem.format(side): end for side, end in zip(("low", "high"), value, strict=True)}
        else:  # inputs that a verdict needs exact are a table: of it the names
            cells[name] = ", ".join(value["quantities"]) if isinstance(value, dict) else value
    return {name: math.nan if value is None else value for name, value in cells.items()}


STIFFNESS_HEAD = ("Stiffness", "Median", "95 % interval", "Unit", "Verdict")


def stiffness_row(name: str, known: Identifiability) -> tuple[str, ...]:
    """What is printed of one stiffness, below `STIFFNESS_HEAD`."""
    ends = known.limit.removesuffix(f" {known.unit}") or known.interval()
    return name, known.row[0], f"{ends} {known.source}".strip(), known.unit, known.words


def summary_html(text: str, parameters: "Mapping[str, StiffnessSummary]") -> str:
    """A table of the stiffnesses between the lines of a summary that are no table."""
    rows = [stiffness_row(name, p.known) for name, p in parameters.items()]
    title, _, *rest = (block.replace("]]\n", "\n", 1) for block in text.removeprefix("[[").split("\n[["))
    return table_html(title, STIFFNESS_HEAD, rows, f"<pre>{escape(chr(10).join(rest))}</pre>")
