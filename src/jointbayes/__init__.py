"""Joint stiffness from vibration measurements, with uncertainty.

Names are loaded at first use, so that importing the package costs next to nothing. The one table of them is the stub
next to this file, which type checkers also read.
"""

from importlib import import_module
from typing import Any

from vibrecords.public_names import homes_in_stub

_HOME_OF = homes_in_stub(__name__)

__all__ = [*_HOME_OF]

#: Public names of rooms that stood at the top once: who still asks for them here is told where they are.
_MOVED = {
    name: room
    for room, names in {
        "jointbayes.errors": "ReportError WorkerError WriteError",
        "jointbayes.inference": "GaussianNoise IntegratedScale ProportionalNoise ScaledNoise",
        "jointbayes.joint": "ElasticCentre Joints Rigid",
        "jointbayes.posterior": "Knowledge OtherStructure PredictiveCheck UnderPremises gather_knowledge",
        "jointbayes.structure": "PointMass Rayleigh ViscousMatrix",
        "vibrecords": "mean_of_repeats iter_records write_records Inspection MeasuredMode MeasurementWarning FrfRecord "
        "TimeRecord find_warnings",
    }.items()
    for name in names.split()
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 (any public name)
    if name == "__version__":
        from importlib.metadata import version

        return version("jointbayes")
    if name not in _HOME_OF:
        from jointbayes.errors import WENT

        moved = f"; it is in {_MOVED[name]}" if name in _MOVED else ""
        moved = f"; it went in this version: {WENT[name]}" if name in WENT else moved
        raise AttributeError(f"module 'jointbayes' has no attribute {name!r}{moved}")
    return getattr(import_module(_HOME_OF[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
