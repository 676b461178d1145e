"""What is said of a joint that is not there? `python -m benchmarks.free_bar`.

A bar hangs free, and is analysed as a beam with a clamp at its end: k11, k12 and k22 with default priors. The data are
the closed-form natural frequencies of a free bar without shear and rotary inertia, which the model has (0.03 % in the
first mode, 0.4 % in the fifth), with a scatter of 0.1 %: the first three, four or five that bend, in turn. They are
analysed with `[uncertain.model_error]` by default, counted rightly, from mode 3 of a bar that a soft joint lets
swing and rock, or from mode 1, as of a clamped beam; with modulus, density and length exact, as they are, or off by 2,
1 and 0.3 % (one standard deviation) and uncertain by as much. Counted are verdicts, of which none may be "identified".

Part of `make science`; the table goes to docs/measured.md.
"""

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from benchmarks.page import table
from benchmarks.study import Row, Study

ENTROPY = 20261125

#: Number of the first mode of the list, and whether modulus, density and length are uncertain.
KINDS = {
    "from mode 3, all else certain": (3, False),
    "from mode 3, E, density and length uncertain": (3, True),
    "from mode 1, all else certain": (1, False),
}
VERDICTS = ("identified", "weakly identified", "bounded above", "bounded below", "not identified", "no verdict")
SCATTER = 0.001
ERRORS = {"youngs_modulus": 0.02, "density": 0.01, "length": 0.003}
#: βL of a free bar: cos βL cosh βL = 1.
ROOTS = np.array([4.730040744862704, 7.853204624095838, 10.995607838001671, 14.137165491257464, 17.278759657399480])
_DIAMETER, _LENGTH, _MODULUS, _DENSITY = 0.010, 1.0, 2.1e11, 7800.0
_CASE = """
[structure]
length_mm = 1000.0
elements = 10
youngs_modulus_gpa = 210.0
density_kg_m3 = 7800.0
section = { shape = "circle", diameter_mm = 10.0 }
damping = { law = "modal", ratio = 0.01 }

[joint]
dofs = ["1:y", "1:rz"]
parametrisation = "signed"

[uncertain.model_error]
"""


def frequencies_hz(off: Mapping[str, float] | None = None) -> NDArray[np.float64]:
    """The first five natural frequencies that bend of a free bar, quantities off by factors, Hz."""
    factor = dict.fromkeys(ERRORS, 1.0) | dict(off or {})
    speed = math.sqrt(_MODULUS * factor["youngs_modulus"] / (_DENSITY * factor["density"]))
    return np.asarray(ROOTS**2 / (2 * np.pi) * speed * _DIAMETER / 4 / (_LENGTH * factor["length"]) ** 2)


def case_of(kind: str, index: int) -> jb.Case:
    """One measurement of one bar."""
    first, uncertain = KINDS[kind]
    rng = np.random.default_rng([ENTROPY, index])
    off = {name: math.exp(sd * rng.standard_normal()) for name, sd in ERRORS.items()}
    measured = frequencies_hz(off if uncertain else None) * np.exp(SCATTER * rng.standard_normal(ROOTS.size))
    count = 3 + (index - 1) % 3
    text = _CASE + f'\n[data]\nkind = "modes"\nfrequencies_hz = {measured[:count].tolist()}\n'
    text += f"sd_relative = {SCATTER}\nnumbers = {list(range(first, first + count))}\n"
    if uncertain:
        text += "".join(f"\n[uncertain.{name}]\nsd_percent = {100 * sd}\n" for name, sd in ERRORS.items())
    else:
        text += f"\n[uncertain]\nexact = {json.dumps(list(ERRORS))}\n"
    return jb.case_from_text(f"{kind} {index}", text)


def analysed(kind: str, index: int) -> Row:
    """Verdict on each stiffness."""
    case = case_of(kind, index)
    posterior = jb.sample(case, seed=index, settings=case.sampler.for_one_of_many())
    return {"verdicts": {name: posterior.verdict(name).cls for name in posterior.stiffness_names}}


def summary(rows: Sequence[Row]) -> Row:
    """Counts of verdicts by stiffness."""
    return {"verdicts": {name: dict(Counter(row["verdicts"][name] for row in rows)) for name in rows[0]["verdicts"]}}


def tables(results: Mapping[str, Row]) -> list[str]:
    """A table of what was counted."""
    rows = (
        (kind, str(data["sets"]), *(_counts(data["verdicts"], verdict) for verdict in VERDICTS))
        for kind, data in results.items()
    )
    return ["Bars by verdict, of k11, k12, k22:", "", *table(("counted", "bars", *VERDICTS), rows)]


def _counts(verdicts: Mapping[str, Mapping[str, int]], verdict: str) -> str:
    """Bars with this verdict, by stiffness; once where all are alike."""
    counts = [str(of_one.get(verdict, 0)) for of_one in verdicts.values()]
    return counts[0] if len(set(counts)) == 1 else ", ".join(counts)


STUDY = Study("free_bar", "measured.md", dict.fromkeys(KINDS, 100), analysed, summary, tables)

if __name__ == "__main__":
    STUDY.main()
