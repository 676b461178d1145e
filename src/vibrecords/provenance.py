"""Where measured data come from: files, channels, modes they show, and what is doubtful about them."""

from dataclasses import asdict, dataclass
from typing import Any, Literal

#: What a channel is to an FRF.
Role = Literal["response", "force"]
#: Warnings that leave open which sign, or which sign of i, the numbers of an FRF have.
SIGN_IN_DOUBT = ("conjugated", "sign_flip", "not_passive", "quantity")


@dataclass(frozen=True, slots=True)
class MeasuredFile:
    """A file of measurements by name, size in bytes, and SHA-256 of its content."""

    name: str
    size: int
    sha256: str


@dataclass(frozen=True, slots=True)
class ChannelUse:
    """How a channel of a file was used.

    Parameters
    ----------
    channel, dof
        Label in the file, and DOF it stands for.
    role
        Whether it is the response or the force of FRFs.
    factor
        Factor on its signal: sign times gain.
    reversed_direction
        Whether the file's direction is opposite to the mapped channel's, so that the sign was changed for it.
    accelerometer_mass
        Mass whose effect is taken out of the FRFs, kg.
    """

    channel: str
    dof: str
    role: Role
    factor: float
    reversed_direction: bool
    accelerometer_mass: float = 0.0


@dataclass(frozen=True, slots=True)
class MeasuredMode:
    """One mode found in measured FRFs.

    Parameters
    ----------
    frequency_hz, frequency_sd_hz
        Undamped natural frequency |λ|/2π and its standard deviation, Hz.
    damping_ratio, damping_sd
        Damping ratio −Re λ/|λ| and its standard deviation.
    """

    frequency_hz: float
    frequency_sd_hz: float
    damping_ratio: float
    damping_sd: float


@dataclass(frozen=True, slots=True)
class MeasurementWarning:
    """Something in measured data that contradicts something else.

    Parameters
    ----------
    key
        Which kind of contradiction, such as ``"sign_flip"``.
    sentence
        What was found, and why that cannot be right.
    remedy
        What to do.
    where
        Channel or place in the file.
    """

    key: str
    sentence: str
    remedy: str
    where: str = ""


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
    warnings
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
    warnings: tuple[MeasurementWarning, ...] = ()
    modes: tuple[MeasuredMode, ...] = ()
    loaded: tuple[str, ...] = ()
    iteration: str = ""
    variance_dof: int | None = None

    @property
    def sign_doubts(self) -> tuple[MeasurementWarning, ...]:
        """Warnings that leave the sign of the FRFs, their time factor or their quantity in doubt."""
        return tuple(warning for warning in self.warnings if warning.key in SIGN_IN_DOUBT)

    def as_json(self) -> dict[str, Any]:
        """Plain dictionaries, lists, texts and numbers."""
        return asdict(self)
