"""Cases for the calibration study: the main case with few lines, a proper prior and ever more that is uncertain.

The stated noise is a floor of the instruments, the same at all lines: 30 % of the median |H| of the nominal joint and
beam.
"""

import re
from functools import cache
from pathlib import Path

import jointbayes as jb
from tests.case.refusal_rows import parts_named
from tests.studies.calibration_cases import FREQUENCIES, TEXT

ROOT = Path(__file__).resolve().parents[2]
BASE = ROOT / "configs" / "clamped_beam.toml"

#: Edits of the main case: 151 lines at tip and mid-span, a noise floor, and a prior on the joint that is proper.
_KEYS = {"outputs": '["11:y", "6:y"]', "f_max_hz": "985.0", "f_step_hz": "6.5", "relative": "0.0", "floor": "0.3"}
_MEDIANS = {"k11": 5.05e9, "k12": 3.44e7, "k22": 1.52e6}
#: Of ln k: a factor of 7 either way, 95 % sure.
SD_LOG = 1.0

_BEAM = parts_named("rooms")["science/calibration_data beam"]
_SCALE = parts_named("rooms")["science/calibration_data scale"]

#: What each variant adds to the case with an uncertain joint and nothing else.
VARIANTS = {"joint": "", "nuisances": _BEAM, "noise scale": _SCALE, "all": _BEAM + _SCALE}

_WORKSHOP = _BEAM.partition("[uncertain.damping_ratio]")[0]
_RHO = '[prior.rho]\ndistribution = "uniform"\nlow = -0.95\nhigh = 0.95\n'
#: Further kinds, each a case by itself: a beam of few lines, of which an analysis takes a second.
SMALL = {
    "length and gain": TEXT + "[uncertain]\nlength.sd_percent = 0.5\ngain.sd_percent = 5.0\n",
    "Student-t of inferred scale": TEXT + '[noise]\ndistribution = "student_t"\nscale = "sampled"\n',
    "k12 of either sign": re.sub(r"\[prior\.k12\][^\[]*", _RHO, 'joint.parametrisation = "signed"\n' + TEXT),
    "two lengths": TEXT + "[tests.long]\n[tests.short]\nstructure.length_mm = 250.0\n",
    "natural frequencies": FREQUENCIES + _WORKSHOP,
    "and errors of the model": FREQUENCIES.replace("0.02", "0.001") + _WORKSHOP + "[uncertain.model_error]\n",
}


@cache
def case_of(variant: str) -> jb.Case:
    """The case of a variant, with the data of the nominal joint and beam."""
    if variant in SMALL:
        return jb.case_from_text(f"calibration {variant}", SMALL[variant])
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
