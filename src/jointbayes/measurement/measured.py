"""A test from measurement files: the data, and what was done to the files to get them."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from jointbayes.frf import FrfSet
from jointbayes.measurement.channels import ChannelUse
from jointbayes.measurement.data import Measurement
from jointbayes.measurement.modal.fit import MeasuredMode

__all__ = ["MeasuredFile", "MeasuredTest", "NotedDoubt", "Provenance"]


@dataclass(frozen=True, slots=True)
class MeasuredFile:
    """A file by name, size in bytes, and SHA-256 of its content."""

    name: str
    size: int
    sha256: str


@dataclass(frozen=True, slots=True)
class NotedDoubt:
    """A doubt about the data, where it arose, and what may be done."""

    where: str
    sentence: str
    remedy: str


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where data come from and what was done to them; all of it can be written as JSON.

    Parameters
    ----------
    files
        Files in the order read.
    quantity
        What the FRFs are.
    lines
        Number of frequency lines used.
    band_hz
        First and last of them.
    averages
        Number of averages, if known.
    channels
        How channels were used.
    left_out
        Channels of the files that were not used.
    variance
        Where the variance comes from, in words.
    variance_dof
        Degrees of freedom from which the variance of each line was estimated; None where it is stated.
    notes
        What was changed on the way, in words.
    doubts
        What about the files is doubtful.
    modes
        Modes that the FRFs show, by rising frequency.
    loaded
        DOFs at which accelerometers sat.
    iteration
        Why the paper's iteration cannot run on these files; empty if it can.
    """

    files: tuple[MeasuredFile, ...]
    quantity: str
    lines: int
    band_hz: tuple[float, float]
    averages: int | None
    channels: tuple[ChannelUse, ...]
    left_out: tuple[str, ...]
    variance: str
    notes: tuple[str, ...] = ()
    doubts: tuple[NotedDoubt, ...] = ()
    modes: tuple[MeasuredMode, ...] = ()
    loaded: tuple[str, ...] = ()
    iteration: str = ""
    variance_dof: int | None = None

    def as_json(self) -> dict[str, Any]:
        """Plain dictionaries, lists, texts and numbers."""
        return asdict(self)

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> "Provenance":
        """From what `as_json` gave, also after a way through a JSON text."""
        parts: dict[str, type] = {
            "files": MeasuredFile,
            "channels": ChannelUse,
            "doubts": NotedDoubt,
            "modes": MeasuredMode,
        }
        given: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in record.items()
        }
        for key, kind in parts.items():
            given[key] = tuple(kind(**entry) for entry in given[key])
        return cls(**given)


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredTest:
    """Data of a test.

    Parameters
    ----------
    measurement
        What inference takes.
    joint_frf
        FRFs at the measured DOFs and at the joint, rotation included, for the paper's iteration; None where the files
        lack them, which `Provenance.iteration` explains.
    provenance
        Where they come from.
    """

    measurement: Measurement
    joint_frf: FrfSet | None
    provenance: Provenance
