"""The errors a user may see: each is one line that says where, what, what is expected and what to do."""

__all__ = [
    "CaseError",
    "JointBayesError",
    "MeasurementError",
    "ModelError",
    "ReportError",
    "ReportInterruptedError",
    "SamplingError",
    "WriteError",
]


class JointBayesError(Exception):
    """Base of every error that a user's input can cause; the CLI prints it and exits 2."""


class CaseError(JointBayesError):
    """A case file cannot be read or asks for something that does not exist."""


class MeasurementError(JointBayesError):
    """Measured data are malformed, inconsistent or not usable."""


class ModelError(JointBayesError):
    """A structure, joint or forward model is not physically or numerically possible."""


class SamplingError(JointBayesError):
    """The sampler was set up in a way that cannot give draws."""


class WriteError(JointBayesError):
    """A file cannot be written: no room, no permission, or something else is there."""


class ReportError(JointBayesError):
    """A report failed after its draws were made; the message names the file that holds them."""


class ReportInterruptedError(KeyboardInterrupt):
    """A report was interrupted after its draws were made; the message names the file that holds them."""
