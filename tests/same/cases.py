"""The cases of the net: all of `configs/`, and four that are made here, by exact beams without a mesh."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmarks import walk_through

import jointbayes as jb
from tests.conftest import CONFIGS, edited, shipped_text

Edits = tuple[tuple[str, str], ...]
#: These are run by .ci/run: computed FRFs, natural frequencies, a rotation by differences, dampers, several tests. None
#: has a verdict or a mode that hangs on a threshold: they say the same with the BLAS kernels of three processors.
IN_CI = ("clamped_beam", "clamped_beam_frequencies", "measured_rotation", "rotor_dampers", "two_overhangs")
#: Cases that would take minutes are run without profiles, effect of freed inputs and doubts of the numbering, as
#: `plain_reports`: the others show these. They are begun first.
DEAR = ("spindle_measured", "eighteen_storeys", "portal_frame", "spindle_tool", "lapped_beams")
#: Lines farther apart, where there are many unknowns. Nothing else is changed in any case.
THINNED: dict[str, Edits] = {
    "lapped_beams": (("f_step_hz = 5.0", "f_step_hz = 25.0"),),
    "portal_frame": (("f_step_hz = 2.0", "f_step_hz = 20.0"),),
    "spindle_tool": (("f_step_hz = 10.0", "f_step_hz = 50.0"),),
    "two_overhangs": (("f_step_hz = 2.0", "f_step_hz = 8.0"),),
}

_BEAM = """
title = "{title}"
structure = {{ length_mm = {length}, section = {{ shape = "circle", diameter_mm = 25.0 }}, youngs_modulus_gpa = 210.0, \
density_kg_m3 = 7800.0, damping = {{ law = "modal", ratio = "measured" }} }}
joint.dofs = ["1:y", "1:rz"]
data = {{ kind = "measured_frf", file = "{file}", f_min_hz = 20.0, f_max_hz = {highest}, {more} }}
"""
#: Without it material and length are uncertain as in a workshop, and the answer of the modes takes a minute.
_EXACT = 'uncertain.exact = ["youngs_modulus", "density", "length", "damping_ratio"]\n'
STEPS = 200
_CALM = 12  # unknowns up to which so many steps give verdicts
_LINES = np.arange(20.0, 2400.0, 16.0)
_SENSORS = (("Point:3:Z+", "11:y"), ("Point:2:Z+", "6:y"), ("Point:1:Z+", "1:y"))


def _of_sensors(folder: Path, title: str, length: float, count: int) -> str:
    """Case on the FRFs of the first so many sensors of a beam of 383 mm; its file is written."""
    walk_through.write_frfs(folder / "tip.uff", _LINES, "uff58b", _SENSORS[:count])
    channels = ", ".join(f'"{channel}" = "{dof}"' for channel, dof in _SENSORS[:count])
    more = f'channels = {{ {channels} }}, variance.source = "coherence"'
    return _BEAM.format(title=title, length=length, file="tip.uff", highest=2390.0, more=more)


def _wrong_length(folder: Path) -> str:
    return _of_sensors(folder, "A beam that is 1 % shorter than it is said to be", 387.0, 1)


def _several_sensors(folder: Path) -> str:
    # the length stays uncertain: the ratios of the sensors' motions are data too
    return _of_sensors(folder, "Three sensors", 383.0, 3) + _EXACT.replace('"length", ', "")


def _hammer_records(folder: Path) -> str:
    walk_through.write_lvm(folder / "hits.lvm")
    more = 'records.method = "impact", channels = { hammer = "11:y", "acc tip" = "11:y" }'
    return _BEAM.format(title="Ten hits of a hammer", length=383.0, file="hits.lvm", highest=1000.0, more=more) + _EXACT


#: Frequencies of an exact beam on two springs, 5 % stiffer at the second torque; the model is wrong by 0.5 %.
_TWO_LEVELS = """
title = "One clamp at two torques"
structure = { length_mm = 360.0, youngs_modulus_gpa = 210.0, poissons_ratio = 0.3, density_kg_m3 = 7800.0, \
section = { shape = "circle", diameter_mm = 25.0 }, damping = { law = "modal", ratio = 0.01 } }
joint = { dofs = ["1:y", "1:rz"], kind = "springs", own = true }
prior.ky = { distribution = "log_uniform", low = 1e6, high = 1e11 }
prior.krz = { distribution = "log_uniform", low = 1e3, high = 1e8 }
data.kind = "natural_frequencies"
data.frequencies_hz = [109.97873366105966, 637.5564954187803, 1507.7643742570735, 2850.761838592125]
data.sd_relative = 0.0002
uncertain.exact = ["youngs_modulus", "density", "length"]
uncertain.model_error = {}
tests.low = {}
tests.high.data.frequencies_hz = [110.99896851372999, 642.9967992331588, 1523.1028353611446, 2866.4288839412275]
"""


MADE: dict[str, Callable[[Path], str]] = {
    "wrong_length": _wrong_length,
    "several_sensors": _several_sensors,
    "hammer_records": _hammer_records,
    "two_levels": lambda _: _TWO_LEVELS,
}
NAMES = (*(path.stem for path in sorted(CONFIGS.glob("*.toml"))), *MADE)


@contextmanager
def made(name: str) -> Iterator[jb.Case]:
    """The case; its measurement files are there as long as it is used."""
    if name in MADE:
        with TemporaryDirectory() as folder:
            yield jb.case_from_text(name, MADE[name](Path(folder)), directory=folder)
    else:
        yield jb.case_from_text(name, edited(shipped_text(name), *THINNED.get(name, ())), directory=CONFIGS)


def quick(settings: jb.SamplerSettings, *, full: bool = False) -> jb.SamplerSettings:
    """Settings of a run that ends early, converged or not: what is kept says what changed, not what is true.

    The stop rule is as loose as the calmer cases need to converge and so to have verdicts.
    """
    del full  # it stands for `SamplerSettings.for_one_of_many` as well
    loose = {"check_every": 25, "tau_factor": 15.0, "tau_tolerance": 0.1, "r_hat_max": 1.05, "end_tolerance": 0.1}
    return replace(settings, max_steps=STEPS, **loose)


def quick_run(case: jb.Case) -> jb.SamplerSettings:
    """The same for the run of a case, with as few walkers as its unknowns allow."""
    unknowns = len(case.problem.prior.names)
    steps = STEPS if unknowns <= _CALM else 2 * STEPS
    return replace(quick(case.sampler), walkers=max(16, 2 * unknowns), max_steps=steps)
