"""What a run is of, part by part, each as a short text: by it a run that goes on is known to be the same."""

import hashlib
import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import fields
from importlib.metadata import version
from typing import Any, Protocol

import numpy as np

from jointbayes.inference import Problem
from jointbayes.posterior.run_record import bodies_of, measurement_sha256
from jointbayes.posterior.stored_problem import described
from jointbayes.reproducibility import code_version
from jointbayes.sampling import SamplerSettings

#: Settings that change no draw, and tables of a case that are only shown or compared with the result.
_NO_MATTER = frozenset({"processes"})
_ONLY_SHOWN = frozenset({"title", "reference", "sampling", "compare", "plan", "virtual_test", "setups"})
_SHOWN = 60  # characters; of longer values a digest
_PACKAGES = ("numpy", "scipy", "numba", "emcee")


class StatedCase(Protocol):
    """What this asks of a case."""

    @property
    def stated(self) -> Problem | None:
        """The problem that its text states."""
        ...

    @property
    def setups(self) -> Sequence[Any]:
        """Its set-ups as they were built, each with `name` and `spec`, a pydantic model; empty if built of no text."""
        ...


def run_fingerprint(problem: Problem, case: StatedCase | None, seed: int, settings: SamplerSettings) -> dict[str, str]:
    """Parts of a run by name: seed, settings, versions, data, and the keys of the case or the parts of the problem.

    Parameters
    ----------
    problem
        What is sampled.
    case
        The case that states it, if one does.
    seed, settings
        Of the run.
    """
    parts = {"seed": str(seed), "data": "".join(measurement_sha256(part.measurement)[:16] for part in problem.parts)}
    for part in problem.parts:
        if (joint_frf := part.measurement.joint_frf) is not None:
            values = np.ascontiguousarray(joint_frf.values)
            name = f"data at the joint in {part.setup}" if part.setup else "data at the joint"
            parts[name] = hashlib.sha256(values.tobytes()).hexdigest()[:16]
    for name, body in bodies_of(problem).items():
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in body.arrays))
        parts[f"measured body {name}"] = digest.hexdigest()[:16]
    parts |= {
        f"sampling.{one.name}": str(getattr(settings, one.name))
        for one in fields(settings)
        if one.name not in _NO_MATTER
    }
    if case is not None and case.stated is problem and case.setups:
        for one in case.setups:
            tables = json.loads(one.spec.model_dump_json(exclude=set(_ONLY_SHOWN)))
            parts |= _flat(tables, f"setups.{one.name}." if one.name else "")
    else:
        parts |= {name: _short(part) for name, part in described(problem).items() if name != "name"}
    versions = {
        "python": platform.python_version(),
        **{name: version(name) for name in _PACKAGES},
        "jointbayes": code_version(),
    }
    return parts | {f"version of {name}": number for name, number in versions.items()}


def _flat(table: Mapping[str, Any], above: str = "") -> dict[str, str]:
    """Values by dotted key."""
    flat: dict[str, str] = {}
    for key, value in table.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{above}{key}.")
        elif value is not None:
            flat[f"{above}{key}"] = _short(value)
    return flat


def _short(value: object) -> str:
    """A value as a message may show it; of a long one its digest."""
    text = json.dumps(value, ensure_ascii=False, sort_keys=True)
    return text if len(text) <= _SHOWN else hashlib.sha256(text.encode()).hexdigest()[:16]
