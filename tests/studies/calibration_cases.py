"""Cases for the tests of calibration: few lines, so that an analysis takes a fraction of a second."""

import re
from concurrent.futures import Executor, Future

import jointbayes as jb
from tests.case.refusal_rows import parts_named

(TEXT,) = parts_named("calibration").values()

FREQUENCIES = re.sub(
    r"(?s)\[data\].*",
    '[data]\nkind = "natural_frequencies"\nfrequencies_hz = [100.0, 650.0, 1800.0]\nsd_relative = 0.02\nsd_hz = 1.0\n',
    TEXT,
)

#: The same, taken for what they are: without an error of the model, and with nothing as uncertain as in a workshop.
EXACT = FREQUENCIES + '\n[uncertain]\nexact = ["model", "youngs_modulus", "density", "length"]\n'


def small_case(extra="", name="small", text=TEXT):
    """The case, with further tables."""
    return jb.case_from_text(name, text + extra)


def noisier_case(factor):
    """The same joint and priors, but data with so much more noise than `small_case` states."""
    text = TEXT.replace("floor = 0.3", f"floor = {0.3 * factor:g}")
    assert text != TEXT
    return jb.case_from_text("noisier", text)


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
