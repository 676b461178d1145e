"""Cases for the tests of calibration: few lines, so that an analysis takes a fraction of a second."""

import re
from concurrent.futures import Executor, Future

import jointbayes as jb
from jointbayes.case.case import case_from_text

TEXT = """
joint.dofs = ["1:y", "1:rz"]

[structure]
length_mm = 383.0
elements = 4
section = { shape = "circle", diameter_mm = 25.0 }
youngs_modulus_gpa = 210.0
density_kg_m3 = 7800.0
damping = { law = "modal", ratio = 0.03 }

[prior.k11]
distribution = "log_normal"
median = 5.0e8
sd_log = 0.5
[prior.k12]
distribution = "log_normal"
median = 5.0e6
sd_log = 0.5
[prior.k22]
distribution = "log_normal"
median = 3.0e5
sd_log = 0.5

[data]
kind = "synthetic_frf"
outputs = ["5:y", "3:y"]
inputs = ["5:y"]
f_min_hz = 20.0
f_max_hz = 1000.0
f_step_hz = 20.0
truth = { k11 = 5.0e8, k12 = 5.0e6, k22 = 3.0e5 }
noise = { relative = 0.0, floor = 0.3, seed = 1 }
"""

FREQUENCIES = re.sub(
    r"(?s)\[data\].*",
    '[data]\nkind = "natural_frequencies"\nfrequencies_hz = [100.0, 650.0, 1800.0]\nsd_relative = 0.02\nsd_hz = 1.0\n',
    TEXT,
)

#: The same, taken for what they are: without an error of the model, and with nothing as uncertain as in a workshop.
EXACT = FREQUENCIES + '\n[uncertain]\nexact = ["model", "youngs_modulus", "density", "length"]\n'


def small_case(extra="", name="small", text=TEXT):
    """The case, with further tables."""
    return case_from_text(name, text + extra)


def noisier_case(factor):
    """The same joint and priors, but data with so much more noise than `small_case` states."""
    text = TEXT.replace("floor = 0.3", f"floor = {0.3 * factor:g}")
    assert text != TEXT
    return case_from_text("noisier", text)


def write_case(path, case: jb.Case):
    """Its file, for the command line."""
    path.write_text(case.text, encoding="utf-8")
    return path


class Here(Executor):
    """Runs each call at once, in this process, where tests can change what is called."""

    _max_workers = 1

    def submit(self, function, /, *args, **kwargs):
        done = Future()
        done.set_result(function(*args, **kwargs))
        return done
