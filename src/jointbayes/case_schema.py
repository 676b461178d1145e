"""The case file: its TOML schema as frozen models, and the reader that names every fault by file, line, key.

Each field's ``description`` is also the "expected …" of its error messages, and its first example the remedy.
Units are in the keys; nothing is converted here. Importing this module loads pydantic.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from typing import Annotated, Literal

import pydantic
from pydantic import Field

from jointbayes.case_errors import Finding, fault_lines
from jointbayes.case_fields import (
    Frequencies,
    Labels,
    Positive,
    Spec,
    count_field,
    key_field,
    not_negative,
    positive,
)
from jointbayes.case_structure import (
    BoxSpec,
    CircleSpec,
    DampingSpec,
    LossFactorDampingSpec,
    ModalDampingSpec,
    RayleighDampingSpec,
    RectangleSpec,
    SectionSpec,
    StructureSpec,
    TubeSpec,
    absent_dofs,
)
from jointbayes.errors import CaseError
from jointbayes.toml_text import parse_toml, read_text

__all__ = [
    "BoxSpec",
    "CaseSpec",
    "CircleSpec",
    "DampingSpec",
    "DataSpec",
    "DecadesPriorSpec",
    "IdentificationSpec",
    "JointSpec",
    "LogNormalPriorSpec",
    "LogUniformPriorSpec",
    "LossFactorDampingSpec",
    "ModalDampingSpec",
    "NaturalFrequenciesSpec",
    "NoiseSpec",
    "PriorSpec",
    "PriorsSpec",
    "RayleighDampingSpec",
    "RectangleSpec",
    "ReferenceSpec",
    "SamplingSpec",
    "SectionSpec",
    "StiffnessSpec",
    "StructureSpec",
    "SyntheticFrfSpec",
    "TubeSpec",
    "UniformPriorSpec",
    "parse_case",
    "read_case_file",
]

_MOST_LINES = 1_000_000  # frequency lines; more is a slip in f_step_hz, and would fill the memory


class StiffnessSpec(Spec):
    """A positive semidefinite joint matrix [[k11, k12], [k12, k22]]."""

    k11: Annotated[float, not_negative("the translational stiffness in N/m", 1e8)]
    k12: Annotated[float, key_field("the coupling stiffness in N, a number with k12² ≤ k11·k22", 0.0)]
    k22: Annotated[float, not_negative("the rotational stiffness in N m/rad", 1e6)]

    def _findings(self) -> Iterator[Finding]:
        bound = math.sqrt(self.k11) * math.sqrt(self.k22)  # not sqrt(k11 k22), which may overflow
        if abs(self.k12) > bound * (1 + 1e-12):
            squares = f"k12² = {self.k12 * self.k12:.6g} exceeds k11·k22 = {self.k11 * self.k22:.6g}"
            found = f"{squares}: the joint matrix is not positive semidefinite"
            yield Finding(("k12",), found, "k12² ≤ k11·k22", f"lower |k12| below {bound:.6g} N")


_DOFS = key_field("the translation and then the rotation, two DOF labels", ["1:y", "1:rz"])
_AGAINST = key_field("no DOF (joint to ground) or two, the other side's translation and rotation", ["9:y", "9:rz"])
_PARAMETRISATION = key_field('"log" (ln k11, ln k12, ln k22) or "signed" (ln k11, ln k22, rho)', "log")


class JointSpec(Spec):
    """The joint: where it acts, how it is parametrised, and the first guess of the paper's iteration."""

    dofs: Annotated[Labels, Field(min_length=2, max_length=2), _DOFS]
    against: Annotated[Labels, _AGAINST] = ()
    parametrisation: Annotated[Literal["log", "signed"], _PARAMETRISATION] = "log"
    initial: Annotated[StiffnessSpec, Field(description="the first guess: k11, k12, k22")]

    @property
    def parameters(self) -> tuple[str, str, str]:
        """Names of the parameters, each of which needs a prior."""
        return ("k11", "k12", "k22") if self.parametrisation == "log" else ("k11", "k22", "rho")

    def _findings(self) -> Iterator[Finding]:
        if len(self.against) not in (0, 2):
            yield Finding(("against",))
        for name, labels in (("dofs", self.dofs), ("against", self.against)):
            for i, (label, kind) in enumerate(zip(labels, ("translation", "rotation"), strict=False)):
                if (":r" in label) != (kind == "rotation"):
                    found = f'found entry {i + 1} = "{label}", which is no {kind}'
                    yield Finding((name, i), found, "", 'write for example ["1:y", "1:rz"]')
                    break  # two labels in the wrong order are one fault
        for i, (here, there) in enumerate(zip(self.dofs, self.against, strict=False)):
            if here.split(":")[1] != there.split(":")[1] or here == there:
                expected = f"the direction of joint.dofs, {here.split(':')[1]}, at another node"
                yield Finding(("against", i), f'found "{there}" against "{here}"', expected, "correct the label")


_DISTRIBUTION = key_field('the kind of prior, "log_uniform", "log_normal" or "decades"', "log_uniform")
_UNIT = "in the unit of the parameter (k11: N/m, k12: N, k22: N m/rad)"


class LogUniformPriorSpec(Spec):
    """Every order of magnitude between two bounds is equally probable."""

    distribution: Annotated[Literal["log_uniform"], _DISTRIBUTION]
    low: Annotated[float, positive(f"the lower bound {_UNIT}", 1e6)]
    high: Annotated[float, positive(f"the upper bound {_UNIT}", 1e11)]

    def _findings(self) -> Iterator[Finding]:
        yield from _not_above(self.low, self.high, "low", "high", _UNIT)


class LogNormalPriorSpec(Spec):
    """The logarithm of the stiffness is normal about the logarithm of the median."""

    distribution: Annotated[Literal["log_normal"], _DISTRIBUTION]
    median: Annotated[float, positive(f"the median {_UNIT}", 1e9)]
    sd_log: Annotated[float, positive("the standard deviation of the natural logarithm", 1.0)]


class DecadesPriorSpec(Spec):
    """A guess that is good to so many decades either way with 95 % probability."""

    distribution: Annotated[Literal["decades"], _DISTRIBUTION]
    guess: Annotated[float, positive(f"the guess {_UNIT}", 1e9)]
    decades: Annotated[float, positive("the decades the guess may be off, 95 % inside", 1.0)]


Correlation = Annotated[float, Field(ge=-1, le=1)]


class UniformPriorSpec(Spec):
    """Every coupling coefficient rho = k12/√(k11 k22) between two bounds is equally probable."""

    distribution: Annotated[Literal["uniform"], key_field('"uniform", the only kind of prior for rho', "uniform")]
    low: Annotated[Correlation, key_field("the lower bound, a number from -1 to 1", -1.0)]
    high: Annotated[Correlation, key_field("the upper bound, a number from -1 to 1", 1.0)]

    def _findings(self) -> Iterator[Finding]:
        yield from _not_above(self.low, self.high, "low", "high", "(from -1 to 1)")


def _not_above(low: float, high: float, low_key: str, high_key: str, unit: str) -> Iterator[Finding]:
    if high <= low:
        found = f"found {high!r}, which is not above {low_key} = {low!r}"
        yield Finding((high_key,), found, f"a number greater than {low_key} {unit}", "correct one of the two")


_StiffnessPrior = LogUniformPriorSpec | LogNormalPriorSpec | DecadesPriorSpec
PriorSpec = Annotated[_StiffnessPrior, Field(discriminator="distribution")]


def _prior(parameter: str, unit: str) -> object:
    return Field(description=f"the prior of {parameter} ({unit}): its distribution and constants")


class PriorsSpec(Spec):
    """The priors, one for each of `JointSpec.parameters`."""

    k11: Annotated[PriorSpec | None, _prior("k11", "N/m")] = None
    k12: Annotated[PriorSpec | None, _prior("k12", "N")] = None
    k22: Annotated[PriorSpec | None, _prior("k22", "N m/rad")] = None
    rho: Annotated[UniformPriorSpec | None, _prior("rho", "no unit")] = None


class NoiseSpec(Spec):
    """Noise of synthetic data: standard deviation of the real and of the imaginary part at each line."""

    relative: Annotated[float, not_negative("the standard deviation as a fraction of |H|", 0.03)]
    floor: Annotated[float, not_negative("the standard deviation as a fraction of the median |H|", 0.01)]
    seed: Annotated[int, count_field("the seed", 1, 0)]
    added: Annotated[bool, key_field("true (noise in the data) or false (in the likelihood only)", True)] = True

    def _findings(self) -> Iterator[Finding]:
        if self.relative + self.floor == 0:
            yield Finding(("relative",), "relative and floor are both 0", "at least one above 0", "raise one")


def _band(what: str, example: float) -> object:
    return Field(description=f"{what} in Hz, a number greater than 0", examples=[example])


_KIND = key_field('the kind of data, "synthetic_frf" or "natural_frequencies"', "synthetic_frf")
_FREQUENCIES = key_field("the frequencies in Hz, a list of numbers above 0 that increase", [120.0, 762.0])
_QUANTITY = key_field('the measured quantity, "receptance", "mobility" or "accelerance"', "receptance")


class SyntheticFrfSpec(Spec):
    """FRFs computed from a stated truth, with noise; the frequencies are a band or a list."""

    kind: Annotated[Literal["synthetic_frf"], _KIND]
    outputs: Annotated[Labels, Field(min_length=1), key_field("a list of at least one measured DOF", ["11:y"])]
    inputs: Annotated[Labels, Field(min_length=1), key_field("a list of at least one excited DOF", ["11:y"])]
    quantity: Annotated[Literal["receptance", "mobility", "accelerance"], _QUANTITY]
    f_min_hz: Annotated[Positive | None, _band("the lowest frequency", 20.0)] = None
    f_max_hz: Annotated[Positive | None, _band("the highest frequency", 2500.0)] = None
    f_step_hz: Annotated[Positive | None, _band("the distance of the lines", 1.0)] = None
    frequencies_hz: Annotated[Frequencies | None, _FREQUENCIES] = None
    truth: Annotated[StiffnessSpec, Field(description="the joint that makes the data: k11, k12, k22")]
    noise: Annotated[NoiseSpec, Field(description="the noise: relative, floor, seed")]

    def lines_hz(self) -> tuple[float, ...]:
        """Return the frequency lines in Hz; the last one is at ``f_max_hz`` or less than a step below."""
        if self.f_min_hz is None or self.f_max_hz is None or self.f_step_hz is None:
            return self.frequencies_hz or ()
        # The allowance keeps f_max itself when the division falls just short of a whole number.
        steps = math.floor((self.f_max_hz - self.f_min_hz) / self.f_step_hz + 1e-9)
        return tuple(self.f_min_hz + i * self.f_step_hz for i in range(steps + 1))

    def _findings(self) -> Iterator[Finding]:
        band = {"f_min_hz": self.f_min_hz, "f_max_hz": self.f_max_hz, "f_step_hz": self.f_step_hz}
        given = [key for key, value in band.items() if value is not None]
        if self.frequencies_hz is not None:
            if given:
                found = f"given together with {', '.join(given)}"
                yield Finding(("frequencies_hz",), found, "a list or a band, not both", "remove one of the two")
            if len(self.frequencies_hz) < 2:
                yield Finding(("frequencies_hz",), "", "at least two frequencies in Hz", "add frequencies")
        elif not given:
            remedy = "add f_min_hz = 20.0, f_max_hz = 2500.0 and f_step_hz = 1.0 to [data]"
            yield Finding((), "no frequencies", "f_min_hz, f_max_hz, f_step_hz, or frequencies_hz", remedy)
        elif self.f_min_hz is None or self.f_max_hz is None or self.f_step_hz is None:
            yield from (Finding((key,), missing=True) for key in band if key not in given)
        else:
            yield from _not_above(self.f_min_hz, self.f_max_hz, "f_min_hz", "f_max_hz", "in Hz")
            steps = (self.f_max_hz - self.f_min_hz) / self.f_step_hz
            if 0 < steps < 1 - 1e-9:
                found = f"empty band: {self.f_step_hz!r} Hz leaves only the line at f_min_hz = {self.f_min_hz!r}"
                yield Finding(("f_step_hz",), found, "at least two lines up to f_max_hz", "lower f_step_hz")
            elif steps >= _MOST_LINES:
                found = f"{self.f_step_hz!r} Hz makes {steps:.3g} lines"
                yield Finding(("f_step_hz",), found, f"at most {_MOST_LINES} lines", "raise f_step_hz")


class NaturalFrequenciesSpec(Spec):
    """Measured natural frequencies, the lowest ones in order; the two deviations add in quadrature."""

    kind: Annotated[Literal["natural_frequencies"], _KIND]
    frequencies_hz: Annotated[Frequencies, Field(min_length=1), _FREQUENCIES]
    sd_relative: Annotated[float, not_negative("the standard deviation as a fraction", 0.005)]
    sd_hz: Annotated[float, not_negative("the standard deviation in Hz", 0.5)]

    def _findings(self) -> Iterator[Finding]:
        if self.sd_relative + self.sd_hz == 0:
            yield Finding(("sd_relative",), "sd_relative and sd_hz are both 0", "at least one above 0", "raise one")


DataSpec = Annotated[
    SyntheticFrfSpec | NaturalFrequenciesSpec,
    Field(discriminator="kind", description="the data: their kind and what belongs to it"),
]


class IdentificationSpec(Spec):
    """The paper's iteration; ``threshold`` is relative to the norm of the measured FRF."""

    sensitivity: Annotated[Literal["measured", "analytical"], key_field('"measured" or "analytical"', "measured")] = (
        "measured"
    )
    max_steps: Annotated[int, count_field("the largest number of steps", 30, 1, 10000)] = 30
    threshold: Annotated[float, positive("the residual to stop at, relative to the measured FRF", 1e-10)] = 1e-10
    line_weight: Annotated[
        float, not_negative("the exponent p of the weights |H|^-p of the lines, 0 as in the paper", 0.5)
    ] = 0.0


class SamplingSpec(Spec):
    """The sampler: independent ensembles of walkers, and the most steps of each."""

    seed: Annotated[int, count_field("the seed", 1, 0)] = 1
    ensembles: Annotated[int, count_field("the number of ensembles", 4, 4)] = 4
    walkers: Annotated[int, count_field("the number of walkers", 48, 8, step=2)] = 48
    max_steps: Annotated[int, count_field("the largest number of steps", 20000, 200)] = 20000
    processes: Annotated[int, count_field("the number of processes", 2, 1)] = 1


class ReferenceSpec(StiffnessSpec):
    """Published values to compare with; ``paper_audit`` appends the audit of the paper's tables."""

    source: Annotated[str, Field(min_length=1), key_field("a text: where the values are published", "Table 3")]
    natural_frequencies_hz: Annotated[Frequencies, _FREQUENCIES] = ()
    paper_audit: Annotated[bool, key_field("true (append the audit of the paper's tables) or false", True)] = False


_TITLE = Field(
    min_length=1,
    max_length=200,
    pattern=r"^[^\r\n]*$",
    description="a text of one line, at most 200 characters",
    examples=["Clamped beam"],
)


class CaseSpec(Spec):
    """A whole case file."""

    title: Annotated[str, _TITLE]
    structure: Annotated[StructureSpec, Field(description="the structure without its joint")]
    joint: Annotated[JointSpec, Field(description="the joint: dofs, initial")]
    prior: Annotated[PriorsSpec, Field(description="a table for the prior of each parameter, as [prior.k11]")]
    data: DataSpec
    identification: Annotated[IdentificationSpec, Field(description="settings of the iteration")] = IdentificationSpec()
    sampling: Annotated[SamplingSpec, Field(description="settings of the sampler")] = SamplingSpec()
    reference: Annotated[ReferenceSpec | None, Field(description="published values to compare with")] = None

    def _findings(self) -> Iterator[Finding]:
        structure, joint, data = self.structure, self.joint, self.data
        labelled = {("joint", "dofs"): joint.dofs, ("joint", "against"): joint.against}
        if isinstance(data, SyntheticFrfSpec):
            labelled |= {("data", "outputs"): data.outputs, ("data", "inputs"): data.inputs}
        else:
            free = structure.nodes * len(structure.directions) - len(structure.supports)
            if len(data.frequencies_hz) > free:
                found = f"{len(data.frequencies_hz)} frequencies for {free} free DOFs"
                yield Finding(
                    ("data", "frequencies_hz"),
                    found,
                    f"at most {free} frequencies",
                    "raise structure.elements",
                )
        for loc, labels in labelled.items():
            yield from absent_dofs(structure, labels, loc)
            for i, label in enumerate(labels):
                if label in structure.supports:
                    found = f'"{label}" is held fixed by structure.supports'
                    yield Finding((*loc, i), found, "a DOF that can move", "choose another or free this one")
        yield from self._prior_findings()

    def _prior_findings(self) -> Iterator[Finding]:
        needed, parametrisation = self.joint.parameters, self.joint.parametrisation
        given = {name for name in PriorsSpec.model_fields if getattr(self.prior, name) is not None}
        missing = [name for name in needed if name not in given]
        for name in sorted(given.difference(needed)):
            found = f'there is no {name} with joint.parametrisation = "{parametrisation}"'
            other = "signed" if parametrisation == "log" else "log"
            swap = f'replace it by {missing.pop()} or write parametrisation = "{other}"' if missing else ""
            yield Finding(("prior", name), found, f"priors of {', '.join(needed)}", swap or "remove it")
        yield from (Finding(("prior", name), missing=True) for name in missing)


def parse_case(text: str, name: str = "case") -> CaseSpec:
    """Read a case from TOML text.

    Parameters
    ----------
    text : str
        The TOML text.
    name : str
        The file name that error messages show.

    Returns
    -------
    CaseSpec
        The checked case.

    Raises
    ------
    CaseError
        If anything is wrong; one line for each fault, ``FILE:LINE: key: found; expected; what to do``.
    """
    data = parse_toml(text, name)
    try:
        return CaseSpec.model_validate(data)
    except pydantic.ValidationError as error:
        faults = fault_lines(error, CaseSpec, data, text, name)
    raise CaseError("\n".join(faults))


def read_case_file(path: str | os.PathLike[str]) -> CaseSpec:
    """Read a case file: `parse_case` for the text of a file, whose troubles are `CaseError` as well."""
    return parse_case(read_text(path), os.fspath(path))
