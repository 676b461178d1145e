"""Results of the benchmarks as Markdown: for docs/trust.md, and three lines in README (`python -m benchmarks.page`)."""

import json
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

Data = Mapping[str, Any]

LAW = {"modal": "modal damping of the assembled structure", "loss_factor": "structural loss factor"}
CASE_FILE = {"modal": "configs/clamped_beam.toml", "loss_factor": "configs/clamped_beam_loss_factor.toml"}


#: Rows of our own that the page shows; the others are printed and kept in results.json.
_OURS = ("jointbayes", "jointbayes, one joint")


def page(results: Data) -> str:
    """Return what the page shows: a likelihood and samplers against others; the rest is in results.json."""
    likelihood, samplers = results["likelihood"], results["samplers"]
    rows = [row for row in likelihood["rows"] if row["what"] in _OURS or not row["what"].startswith("jointbayes")]
    measured = [{**one, "rows": [r for r in one["rows"] if not r["extrapolated"]]} for one in samplers["cases"]]
    shown = {"likelihood": {**likelihood, "rows": rows}, "samplers": {**samplers, "cases": measured}}
    return "\n".join(section(name, data) for name, data in shown.items())


def section(name: str, data: Data) -> str:
    """One section with where it was measured."""
    title, body = _SECTIONS[name]
    short = ["**A short run to try the script: these figures say nothing.**\n"] if data["quick"] else []
    return "\n".join([f"### {title}\n", *short, _where(data["environment"], name), "", *body(data)]) + "\n"


def number(value: float | None, digits: int = 3) -> str:
    """A figure with so many significant digits, written out; – where there is none."""
    if value is None:
        return "–"
    if value != 0 and not 1e-3 <= abs(value) < 1e7:
        return f"{value:.{digits - 1}e}"
    rounded = float(f"{value:.{digits - 1}e}")
    whole = len(f"{abs(rounded):.0f}") if abs(rounded) >= 1 else 0
    decimals = digits - whole
    if 0 < abs(rounded) < 1:
        decimals = digits + len(f"{abs(rounded):.10f}"[2:]) - len(f"{abs(rounded):.10f}"[2:].lstrip("0"))
    return f"{rounded:.{max(decimals, 0)}f}"


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """Lines of a Markdown table."""
    names = list(head)
    return [f"| {' | '.join(r)} |" for r in (names, ["---"] * len(names), *map(list, rows))]


#: Packages that a section measures or computes with; `results.json` has all.
_PACKAGES = ("jointbayes", "numpy", "scipy", "numba")
_PEERS = ("emcee", "dynesty", "nautilus-sampler", "blackjax")


def _where(environment: Data, section: str) -> str:
    names = _PACKAGES + (_PEERS if section == "samplers" else ())
    versions = ", ".join(f"{name} {v}" for name, v in environment["packages"].items() if v and name in names)
    return f"{environment['date']}, one core, {environment['cpu']}, Python {environment['python']}; {versions}."


def _likelihood(data: Data) -> list[str]:
    lines = [
        f"One FRF at {data['lines']} lines of the shipped cases; a joint of 2 DOFs where nothing else is said.",
        f'"jointbayes" is `problem.log_posterior` of {data["batch"]} points in a batch. The peers compute the same',
        "likelihood to 1e-8 from joint matrices, without a prior (`tests/test_benchmarks.py`).",
        "`python -m benchmarks.likelihood` repeats this.",
    ]
    for law in LAW:
        rows = [r for r in data["rows"] if r["law"] == law]
        if not rows:
            continue
        ours = next(r["cpu_us"] for r in rows if r["what"] == "jointbayes")
        # of another joint there is no ratio
        body = ((r["what"], number(r["cpu_us"]), number(r["ratio"] and r["cpu_us"] / ours)) for r in rows)
        lines += ["", *table((LAW[law], "µs of CPU", "times as long as jointbayes"), body)]
    return lines


def _growth(data: Data) -> list[str]:
    lines = [
        "Of joint matrices (`python -m benchmarks.likelihood --growth`). Exponent: slope of the logarithms over all",
        "points, 1 is proportional. Memory: the most that a call held besides data and FRFs of the structure.",
        "",
    ]
    rows = []
    for one in data["rows"]:
        first, last = one["points"][0], one["points"][-1]
        each = [[number(p["us"]), number(1e3 * p["us"] / p["values"]), number(p["peak_mb"])] for p in (first, last)]
        ends = (f"{a} to {b}" for a, b in zip([first["values"], *each[0]], [last["values"], *each[1]], strict=True))
        rows.append((LAW[one["law"]], f"more {one['kind']}", f"{one['slope']:.2f}", *ends))
    head = ("damping", "series", "exponent", "values", "µs per likelihood", "ns per value", "memory, MB")
    return lines + table(head, rows)


def _samplers(data: Data) -> list[str]:
    wanted = number(data["wanted"], 4)
    lines = [_SAMPLER_NOTES.format(wanted=wanted)]
    for case in data["cases"]:
        if case["law"] != "modal":  # in `results.json`; the order is the same
            continue
        lines += [
            f"`{CASE_FILE[case['law']]}`, {case['values']} values, {LAW[case['law']]}:",
            "",
            *table((h.format(wanted=wanted) for h in _SAMPLER_HEAD), (_sampler_row(r) for r in case["rows"])),
            "",
            *(f"- {r['method']}: {r['note']}" for r in case["rows"] if r.get("note") and r["method"] != "jointbayes"),
            "",
        ]
    return lines


_SAMPLER_HEAD = (
    "sampler",
    "ESS",
    "evaluations per effective sample",
    "s of CPU to {wanted} ESS",
    "mean off by, sd",
    "sd ratio",
)

_SAMPLER_NOTES = """\
Draws from the posterior of (ln k11, ln k12, ln k22) on one core. ESS is the smallest over the three: draws/τ for
ensembles, ArviZ's bulk ESS for NUTS, Kish's (Σw)²/Σw² for nested samplers. CPU time counts everything but compiling:
search for the mode, burn-in or adaptation, sampling. Extrapolated: measured time of a likelihood with τ and draws of
emcee. Last two columns: difference to the jointbayes row. `python -m benchmarks.samplers` repeats this, `--nuts` with
NUTS.
"""


def _sampler_row(row: Data) -> tuple[str, ...]:
    name = row["method"] + (" (extrapolated)" if row["extrapolated"] else "")
    if row.get("missing"):
        return (name, row["missing"], *["–"] * (len(_SAMPLER_HEAD) - 2))
    figures = ("ess", "evaluations_per_effective", "cpu_to_wanted", "mean_difference", "sd_ratio")
    return (name, *(number(row.get(figure)) for figure in figures))


_SECTIONS = {
    "likelihood": ("Cost of a likelihood", _likelihood),
    "growth": ("Growth with the data", _growth),
    "samplers": ("Samplers", _samplers),
}


def in_short(results: Data) -> str:
    """What README says of the benchmarks, as three points: each against the fastest other one that was measured."""
    lines = results["likelihood"]["lines"]
    (us, other, times), (us_loss, other_loss, times_loss) = (_against_best(results, law) for law in LAW)
    rows = results["likelihood"]["rows"]
    one = next(row for row in rows if row["what"] == "jointbayes, one joint" and row["law"] == "modal")
    alone = number(one["cpu_us"], 2)
    samplers = results["samplers"]
    rows = next(case for case in samplers["cases"] if case["law"] == "modal")["rows"]
    ours = next(row for row in rows if row["method"] == "jointbayes")
    peers = [row for row in rows if row is not ours and not row["extrapolated"] and row.get("cpu_to_wanted")]
    peer = min(peers, key=lambda row: row["cpu_to_wanted"])
    seconds, peer_seconds = (number(row["cpu_to_wanted"], 2) for row in (ours, peer))
    where = samplers["environment"]
    points = (
        f"`problem.log_posterior` of one FRF with {lines} lines takes {us} µs of CPU a point in batches, {alone} µs "
        f"one at a time, with modal damping; the fastest other way ({other}) takes {times} times as long as in "
        f"batches. With a loss factor it takes {us_loss} µs, the fastest other way ({other_loss}) "
        f"{times_loss} times as long.",
        f"{samplers['wanted']:.0f} effective draws of the main case take {seconds} s of CPU, the search for the mode "
        f"included; the fastest other sampler on the same likelihood, {peer['method'].split(',')[0]}, takes "
        f"{peer_seconds} s.",
        f"Measured on {where['date']} on one core of an {where['cpu'].replace('(R)', '')}; `make bench` repeats it in "
        "less than five minutes: [Trust](docs/trust.md#how-fast).",
    )
    return "\n".join(textwrap.fill(point, 118, initial_indent="- ", subsequent_indent="  ") for point in points)


def _against_best(results: Data, law: str) -> tuple[str, str, str]:
    """Our µs per likelihood, the fastest other way, and how many times as long that takes."""
    rows = [row for row in results["likelihood"]["rows"] if row["law"] == law]
    ours = next(row for row in rows if row["what"] == "jointbayes")
    best = min((row for row in rows if not row["what"].startswith("jointbayes")), key=lambda row: row["cpu_us"])
    return number(ours["cpu_us"], 2), best["what"], number(best["cpu_us"] / ours["cpu_us"], 2)


if __name__ == "__main__":
    print(in_short(json.loads((Path(__file__).parent / "results.json").read_text(encoding="utf-8"))))
