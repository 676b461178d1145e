"""How often the check finds something in exact data: `python -m benchmarks.false_alarms`.

Six kinds of case, each analysed with the very model and noise that made its data: the main case; with material, length
and damping uncertain; four FRFs of a coherence, with Student-t noise; natural frequencies; two tests; a frame. Every
data set has noise of its own. A finding other than "explained" is a false alarm: of runs at the level `FALSE_ALARM` as
many in a hundred are allowed.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

import jointbayes as jb
from benchmarks.page import table
from benchmarks.record import ROOT
from benchmarks.study import Row, Study
from jointbayes.case.case_text import read_case_text
from jointbayes.posterior.checks import FALSE_ALARM, checks_of

#: Shipped case of each kind.
KINDS = {
    "main": "clamped_beam",
    "uncertain": "clamped_beam_uncertain",
    "several FRFs": "measured_stations",
    "natural frequencies": "clamped_beam_frequencies_360mm",
    "two tests": "two_overhangs",
    "frame": "spindle_tool",
}
_TRUTH = np.array([5.05e9, 3.44e7, 1.52e6])  # of the paper's Table 3, whose natural frequencies are the data


def text_of(kind: str, index: int) -> str:
    """The case with noise of its own."""
    text = read_case_text(ROOT / "configs" / f"{KINDS[kind]}.toml").text
    if kind == "natural frequencies":
        problem = jb.case_from_text("nominal", text).problem
        exact = problem.natural_frequencies_hz(_TRUTH, 3)[0]
        rng = np.random.default_rng([7, index])
        noisy = exact + np.hypot(0.005 * exact, 0.5) * rng.standard_normal(3)
        # the stated sd is a fraction of the measured frequency: a second-order difference
        return re.sub(r"(?m)^frequencies_hz = .*$", f"frequencies_hz = {noisy.round(6).tolist()}", text, count=1)
    if kind == "several FRFs":  # of a file: `problem_of` draws their noise
        return text + '\n[noise]\ndistribution = "student_t"\ndof = 6.0\n'
    before, table, after = text.partition("[data.noise]")
    if not table:
        raise SystemExit(f"{KINDS[kind]}: found no [data.noise]; expected its seed")
    return before + table + re.sub(r"(?m)^seed = \d+", f"seed = {1000 + index}", after, count=1)


def problem_of(kind: str, index: int, case: jb.Case) -> jb.Problem:
    """The problem of a case; with Student-t noise its data are made anew, as a case makes Gaussian ones only."""
    problem = case.problem
    if kind != "several FRFs":
        return problem
    theta = problem.parametrisation.coordinates(_TRUTH)
    density, measured = problem.log_posterior, problem.test.data
    exact, variance = density.predicted(theta)[0], density.variance(theta)[0]
    shape = (len(exact), exact[0].size)
    z = density.likelihood.noise.draw(np.random.default_rng([8, index]), np.empty((1, 0)), *shape)[0]
    frf = replace(measured.frf, values=exact + np.sqrt(variance) * z.reshape(exact.shape))
    return problem.with_test(data=replace(measured, frf=frf, joint_frf=None))


def analyse(kind: str, index: int, settings: jb.SamplerSettings | None = None) -> Row:
    """Make data set number so many of a kind, and check the model that made it."""
    case = jb.case_from_text(f"{kind} {index}", text_of(kind, index), directory=ROOT / "configs")
    problem = problem_of(kind, index, case)
    subject = case if problem is case.problem else replace(case, problem=problem)
    posterior = jb.sample(subject, seed=index, settings=settings or case.sampler)
    return {"findings": [check.finding for check in checks_of(posterior) if check.finding != "explained"]}


def summary(rows: Sequence[Row]) -> Row:
    """Number of false alarms."""
    return {"alarms": sum(bool(row["findings"]) for row in rows)}


def tables(results: Mapping[str, Row]) -> list[str]:
    """False alarms by kind, and what is allowed of all."""
    sets, alarms = (sum(data[key] for data in results.values()) for key in ("sets", "alarms"))
    most = int(stats.binom(sets, FALSE_ALARM).ppf(0.999))
    rows = [(kind, str(data["sets"]), str(data["alarms"])) for kind, data in results.items()]
    rows.append(("all", str(sets), f"{alarms} (at {100 * FALSE_ALARM:g} % more than {most}: once in 1000)"))
    return table(("Kind", "Data sets", "False alarms"), rows)


STUDY = Study("false_alarms", "", dict.fromkeys(KINDS, 34), analyse, summary, tables)

if __name__ == "__main__":
    STUDY.main()
