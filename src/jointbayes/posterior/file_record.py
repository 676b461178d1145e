"""The record of a posterior file, typed: what each field must be before anything is made of it.

A file may be damaged, of another version, or made by somebody else on purpose. What is here is checked by itself, each
number by its range; what must agree with the problem, by `jointbayes.posterior.stored_file`.
"""

import json
from collections.abc import Mapping
from dataclasses import fields
from typing import Annotated, Any, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    model_validator,
)

from jointbayes.errors import MeasurementError
from jointbayes.identification import LocalMode, MapEstimate, SearchEffort, StartOutcome
from jointbayes.joint import Coordinate
from jointbayes.posterior.identifiability import Identifiability
from jointbayes.posterior.information.excluded import SimplerJoint
from jointbayes.posterior.information.uncertain_inputs import Source
from jointbayes.posterior.run_record import RunRecord
from jointbayes.posterior.storage import FILE_VERSION
from jointbayes.posterior.stored_problem import fault_in_record

#: More coordinates, starts and so on than any run has; a reader must not build what takes all memory.
_MOST = 10_000
_STRICT = ConfigDict(strict=True, extra="ignore")


def _require_jointbayes(versions: dict[str, str]) -> dict[str, str]:
    if "jointbayes" not in versions:
        raise ValueError("expected the version of jointbayes among them")
    return versions


Finite = Annotated[float, Field(allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=2**63)]
Share = Annotated[float, Field(ge=0, le=1)]
Name = Annotated[str, Field(max_length=1000)]
Vector = Annotated[tuple[Finite, ...], Field(max_length=_MOST)]
Rows = Annotated[tuple[Vector, ...], Field(max_length=_MOST)]


class _StoredPart(BaseModel):
    """Fields that a later version adds do not matter: `FILE_VERSION` says which do."""

    model_config = ConfigDict(frozen=True, **_STRICT)


class _Sampler(_StoredPart):
    """Settings and figures of the sampler; NaN where a chain was too short for one."""

    ensembles: Count
    walkers: Count
    steps: Count
    max_steps: Count
    burn_in: Count
    thin: Annotated[int, Field(ge=1, le=2**31)]
    acceptance: Share
    move_acceptance: dict[Name, float]
    proposal_efficiency: float
    tau: dict[Name, float]
    ess: dict[Name, float]
    evaluations: Count
    singular: Count
    seconds: Annotated[float, Field(ge=0, le=1e12)]
    ess_per_second: float


class _Run(_StoredPart):
    case_name: Name
    case_text: Annotated[str, Field(max_length=10**7)]
    seed: Annotated[int, Field(ge=0, lt=2**128)]
    converged: bool
    reason: Annotated[str, Field(max_length=10_000)]
    sampler: _Sampler
    r_hat: dict[Name, float]
    versions: Annotated[dict[Name, Name], AfterValidator(_require_jointbayes)]


class _Mode(_StoredPart):
    theta: Vector
    log_density: Finite


class _Start(_StoredPart):
    name: Name
    start: Vector
    stiffness: Vector
    log_posterior: float
    reached_mode: bool


class _LocalMode(_StoredPart):
    theta: Vector
    covariance: Rows
    log_posterior: Finite
    inside: tuple[Vector, Rows] | None = None  # unknown to older files

    @property
    def mode(self) -> LocalMode:
        """The mode that it describes."""
        inside = self.inside and (np.array(self.inside[0]), np.array(self.inside[1]))
        return LocalMode(np.array(self.theta), np.array(self.covariance), self.log_posterior, inside)


class EstimateRecord(_StoredPart):
    """A MAP estimate, as `estimate_record` wrote it."""

    theta: Vector
    stiffness: Vector
    covariance: Rows
    log_posterior: Finite
    starts: Annotated[tuple[_Start, ...], Field(max_length=_MOST)]
    modes: Annotated[tuple[_LocalMode, ...], Field(max_length=_MOST)] = ()  # files of version 0.1 know one mode
    effort: SearchEffort | None = None  # unknown to older files

    @property
    def estimate(self) -> MapEstimate:
        """The estimate that it describes."""
        starts = [(s.name, np.array(s.start), np.array(s.stiffness), s.log_posterior, s.reached_mode)
                  for s in self.starts]  # fmt: skip
        return MapEstimate(
            np.array(self.theta),
            np.array(self.stiffness),
            np.array(self.covariance),
            self.log_posterior,
            tuple(StartOutcome(*start) for start in starts),
            tuple(mode.mode for mode in self.modes),
            self.effort,
        )


class _Profile(_StoredPart):
    coordinate: Coordinate
    value: Annotated[Vector, Field(min_length=1)]
    log_ratio: Vector
    theta: Rows
    level: Annotated[float, Field(gt=0, lt=1)]
    interval: tuple[float, float]
    open_below: bool
    open_above: bool

    @model_validator(mode="after")
    def _one_ratio_a_value(self) -> Self:
        if not len(self.value) == len(self.log_ratio) == len(self.theta) or (np.diff(self.value) <= 0).any():
            raise ValueError("expected rising values, each with its log ratio and theta")
        return self


class _Freed(_StoredPart):
    uncertain: tuple[Name, ...]
    source: Source
    known: dict[Name, Identifiability]


class _Knowledge(_StoredPart):
    profiles: Annotated[tuple[_Profile, ...], Field(max_length=_MOST)]
    freed: Annotated[tuple[_Freed, ...], Field(max_length=_MOST)]
    assumed: Annotated[tuple[Name, ...], Field(max_length=_MOST)]
    simpler: Annotated[tuple[SimplerJoint, ...], Field(max_length=_MOST)] | None = None  # unknown to older files


class _Problem(_StoredPart):
    description: dict[str, Any]
    own: dict[str, str]
    sha256: Annotated[str, Field(max_length=64)]


class FileRecord(_StoredPart):
    """Everything of a posterior file that is not an array."""

    file_version: int
    record: _Run
    mode: _Mode
    map: EstimateRecord
    knowledge: _Knowledge | None = None
    problem: _Problem
    of_case_text: bool = False  # whether the text of the case states the problem
    _plain: dict[str, Any] = PrivateAttr(default_factory=dict)

    @property
    def run(self) -> RunRecord:
        """How the draws came about."""
        plain = self._plain["record"]
        return RunRecord(**{entry.name: plain[entry.name] for entry in fields(RunRecord)})

    @property
    def stored_problem(self) -> Mapping[str, Any]:
        """What `add_problem` gave."""
        plain: Mapping[str, Any] = self._plain["problem"]
        return plain


def parse_estimate(plain: Mapping[str, Any], where: str) -> EstimateRecord:
    """What `estimate_record` made of a MAP estimate, typed.

    Raises
    ------
    MeasurementError
        If it is something else: what.
    """
    try:
        return EstimateRecord.model_validate_json(json.dumps(plain))
    except ValidationError as error:
        raise MeasurementError(f"{where}: {fault_in_record(error)}") from None


def parse_record(text: str, where: str) -> FileRecord:
    """Record from the JSON text in a file.

    Parameters
    ----------
    text
        What `write_tree` wrote.
    where
        The file, for messages.

    Raises
    ------
    MeasurementError
        If it is no record, of a later version, or any field of it is not what it must be: which.
    """
    try:
        plain = json.loads(text)
        version = plain["file_version"]
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
    if isinstance(version, int) and version > FILE_VERSION:
        raise MeasurementError(
            f"{where}: found file version {version}; expected {FILE_VERSION} or less; "
            "read it with the jointbayes that wrote it, or a later one"
        )
    try:
        record = FileRecord.model_validate_json(text)
    except ValidationError as error:
        raise MeasurementError(f"{where}: {fault_in_record(error)}") from None
    record._plain.update(plain)
    return record
