"""What an answer takes for granted: which data it is of and why, an error of the model, what nobody stated."""

from dataclasses import dataclass

from jointbayes.inference.noise.base import ErrorSizes
from vibrecords.modal_ratios import MotionRatio


@dataclass(frozen=True, slots=True)
class UsedMode:
    """A measured resonance and the mode of the model that it is compared with, from 1.

    Or an antiresonance of the drive point `held`, and the mode of the model with that DOF held. With a resonance may
    come `ratios` of motions of sensors.
    """

    setup: str
    number: int
    frequency_hz: float
    sd_hz: float
    held: str = ""
    ratios: tuple[MotionRatio, ...] = ()

    @property
    def resonance(self) -> tuple[str, str, float]:
        """What was measured, whatever mode of a model it is compared with."""
        return self.setup, self.held, self.frequency_hz


@dataclass(frozen=True, slots=True)
class Premises:
    """What a problem takes for granted, beyond what its data, priors and noise say themselves.

    Parameters
    ----------
    reason
        Why the problem is not analysed as it is stated, a sentence without full stop; empty where it is.
    model_error
        Sizes of the model's error in each of these modes; None where the model is taken as exact.
    assumed
        What is as uncertain as in a workshop because nobody stated it, in words, one for each quantity.
    modes, left_out
        The modes that measured FRFs show and that are used, and sentences on resonances that are not.
    numbering
        Sentences on modes that are as probably others of the model, or more probably.
    misnumbered
        How typed-in modes fit far better as others, in a phrase; empty where they do not.
    asked
        What somebody asked for instead of what is usual, a sentence; empty where nobody did.
    """

    reason: str = ""
    model_error: ErrorSizes | None = None
    assumed: tuple[str, ...] = ()
    modes: tuple[UsedMode, ...] = ()
    left_out: tuple[str, ...] = ()
    numbering: tuple[str, ...] = ()
    misnumbered: str = ""
    asked: str = ""

    @property
    def of_modes(self) -> bool:
        """Whether the answer is that of the modes that measured FRFs show."""
        return bool(self.modes)

    @property
    def decision(self) -> str:
        """What follows from the reason, in a sentence without full stop; empty where the problem is as stated."""
        then = "so the answer is that of their modes" if self.of_modes else "so the usual error of the model is added"
        return f"{self.reason}, {then}" if self.reason else ""
