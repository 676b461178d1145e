"""Data sets drawn from a case's own prior and noise model, for the calibration study.

The stated noise is a floor of the instruments, the same at all lines, fixed before any truth is drawn: 30 % of the
median |H| of the nominal joint and beam. A variance computed from each data set's own FRF would be a function of the
truth that the analysis takes as given, and would tell it where the resonances lie.
"""

import re
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from jointbayes.frf import DirectSolve, FrfSet, Ports
from jointbayes.inference import GaussianNoise
from jointbayes.joint import joint_matrix
from jointbayes.measurement import FrfMeasurement

__all__ = ["VARIANTS", "DataSet", "case_of", "draw_data"]

ROOT = Path(__file__).resolve().parents[1]
BASE = ROOT / "configs" / "clamped_beam.toml"
Array = NDArray[np.float64]

#: Edits of the main case: 151 lines at tip and mid-span, a noise floor, and a prior on the joint that is proper.
_KEYS = {
    "outputs": '["11:y", "6:y"]',
    "f_max_hz": "985.0",
    "f_step_hz": "6.5",
    "relative": "0.0",
    "floor": "0.3",
}
_MEDIANS = {"k11": 5.05e9, "k12": 3.44e7, "k22": 1.52e6}
#: Of ln k: a factor of 7 either way, 95 % sure.
SD_LOG = 1.0

_BEAM = """
[uncertain.youngs_modulus]
sd_percent = 2.0
[uncertain.length]
sd_percent = 0.5
[uncertain.density]
sd_percent = 1.0
[uncertain.damping_ratio]
low_factor = 0.3
high_factor = 3.0
"""
_SCALE = """
[noise]
scale = "sampled"
scale_low_factor = 0.3
scale_high_factor = 3.0
"""
_DISCREPANCY = """
[noise.discrepancy]
scale_low = 0.3
scale_high = 10.0
length_low_hz = 10.0
length_high_hz = 300.0
"""

#: What each variant adds to the case with an uncertain joint and nothing else.
VARIANTS = {
    "joint": "",
    "nuisances": _BEAM,
    "noise scale": _SCALE,
    "discrepancy": _DISCREPANCY,
    "all": _BEAM + _SCALE + _DISCREPANCY,
}


@dataclass(frozen=True)
class DataSet:
    """A truth drawn from the prior, and the case with data from it."""

    theta: Array
    case: jb.Case


@cache
def case_of(variant: str) -> jb.Case:
    """The case of a variant, with the data of the nominal joint and beam."""
    text = BASE.read_text(encoding="utf-8")
    for key, value in _KEYS.items():
        text, count = re.subn(rf"(?m)^{key} = [^\n,#]*[^\s,#]", f"{key} = {value}", text)
        if count != 1:
            raise ValueError(f"{BASE}: expected {key} once, found it {count} times")
    for name, median in _MEDIANS.items():
        prior = f'[prior.{name}]\ndistribution = "log_normal"\nmedian = {median}\nsd_log = {SD_LOG}\n'
        text, count = re.subn(rf"(?m)^\[prior\.{name}\][^\[]*", prior + "\n", text)
        if count != 1:
            raise ValueError(f"{BASE}: expected [prior.{name}] once, found it {count} times")
    return jb.case_from_text(f"calibration {variant}", text + VARIANTS[variant])


def draw_data(variant: str, rng: np.random.Generator) -> DataSet:
    """Draw a truth from the prior and data from it: dense solution of that structure, noise of the case's own model."""
    base = case_of(variant)
    problem = base.problem
    prior, nominal = problem.prior, problem.measurement
    assert isinstance(nominal, FrfMeasurement)
    joint_frf = nominal.joint_frf
    assert joint_frf is not None
    theta = prior.sample(rng, 1)[0]
    factors = prior.factors(theta)
    structure = problem.structures.structure(problem.structural(factors))
    # the paper's iteration, one of the starts, also wants FRFs at the joint; these come last
    ports = Ports(joint_frf.frequency_hz, joint_frf.outputs, joint_frf.inputs)
    values = DirectSolve(structure, problem.joint, ports).receptance(joint_matrix(prior.stiffness(theta)))[0]
    measured = len(nominal.frf.outputs)
    noise = problem.noise or GaussianNoise()
    hyper = factors[None, factors.size - len(noise.names) :]
    z = noise.draw(rng, hyper, ports.frequency_hz.size, measured * len(ports.inputs))
    values[:, :measured] += np.sqrt(nominal.variance) * z.reshape(values[:, :measured].shape)
    rest = values[:, measured:]
    values[:, measured:] += 0.05 * np.abs(rest) * (rng.normal(size=rest.shape) + 1j * rng.normal(size=rest.shape))
    frf = FrfSet(ports.frequency_hz, values, ports.outputs, ports.inputs, "receptance")
    used = replace(nominal, frf=frf.select(nominal.frf.outputs, nominal.frf.inputs), joint_frf=frf)
    return DataSet(theta, replace(base, problem=replace(problem, measurement=used)))
