"""The record of a posterior file, typed: what each part must be before anything is made of it.

A file may be damaged, of another version, or made by somebody else on purpose. What is here is checked by itself, each
number by its range; what must agree with the problem, by `jointbayes.posterior.stored_file`.
"""

import json
from dataclasses import asdict, dataclass, replace
from typing import Any

from jointbayes.errors import MeasurementError
from jointbayes.identification import MapEstimate
from jointbayes.posterior.knowledge import KeptKnowledge
from jointbayes.posterior.run_record import RunRecord
from jointbayes.posterior.storage import StoredProblem
from jointbayes.stored_values import StoredArray, stored_value

#: Of the file: raised when an older reader would misread it. Version 1 held the text of a case instead of a problem.
FILE_VERSION = 2


@dataclass(frozen=True, slots=True, eq=False)
class BestDraw:
    """The best draw refined, shape (d,), and its log density."""

    theta: StoredArray
    log_density: float


@dataclass(frozen=True, slots=True, eq=False)
class FileRecord:
    """Everything of a posterior file that is not an array of draws, or of its problem.

    Parameters
    ----------
    record
        How the draws came about.
    mode, map
        Joint mode, and MAP estimate without the paper's iteration.
    problem
        Description of the problem.
    knowledge
        What took time to find; None where nothing was kept.
    of_case_text
        Whether the text of the case states the problem.
    """

    record: RunRecord
    mode: BestDraw
    map: MapEstimate
    problem: StoredProblem
    knowledge: KeptKnowledge | None = None
    of_case_text: bool = False

    def as_text(self) -> str:
        """JSON text, of which `parse_record` makes the record again."""
        plain = asdict(self) | {"file_version": FILE_VERSION, "map": estimate_record(self.map)}
        return json.dumps(plain, default=lambda value: value.tolist())


def estimate_record(estimate: MapEstimate) -> dict[str, Any]:
    """JSON-ready form of a MAP estimate, but for its arrays."""
    plain = asdict(replace(estimate, iteration=None))
    return {"stiffness": plain.pop("values"), **plain}  # the name that the quantities had first


def parse_estimate(plain: Any, place: str) -> MapEstimate:  # noqa: ANN401
    """What `estimate_record` made of a MAP estimate, from JSON.

    Raises
    ------
    MeasurementError
        If it is something else: what.
    """
    return stored_value(MapEstimate, _with_values(plain), place)


def _with_values(plain: Any) -> Any:  # noqa: ANN401
    named = isinstance(plain, dict) and "stiffness" in plain
    return {**plain, "values": plain["stiffness"], "iteration": None} if named else plain


def parse_record(text: str, where: str) -> FileRecord:
    """Record from the JSON text in a file.

    Parameters
    ----------
    text
        What `FileRecord.as_text` gave.
    where
        The file, for messages.

    Raises
    ------
    MeasurementError
        If it is no record, of another version, or any field of it is not what it must be: which.
    """
    try:
        plain = json.loads(text)
        version = plain["file_version"]
        json.dumps(plain, ensure_ascii=False).encode()  # no report can be written of half a character
    except (ValueError, RecursionError, KeyError, TypeError) as error:
        raise MeasurementError(
            f"{where}: found no posterior in it ({type(error).__name__}); expected a posterior.nc written by "
            "jointbayes; give the path of one"
        ) from None
    if version == 1:
        raise MeasurementError(
            f"{where}: found file version 1, which holds the text of a case instead of a problem; expected "
            f"{FILE_VERSION}; sample again"
        )
    if version != FILE_VERSION or isinstance(version, float):
        raise MeasurementError(
            f"{where}: found file version {version!r:.60}; expected {FILE_VERSION} or less; "
            "read it with the jointbayes that wrote it, or a later one"
        )
    return stored_value(FileRecord, {**plain, "map": _with_values(plain.get("map"))}, f"{where}: record")
