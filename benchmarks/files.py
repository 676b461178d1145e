"""From a virtual test through a file to the posterior: `python -m benchmarks.files`.

A joint is drawn from the prior and measured in a virtual impact test: hammer pulses, noise on
both channels, averages, H1 and coherence. The FRFs are written in every format, read back by a case of kind
"measured_frf" with the variance from coherence, and analysed as `jointbayes run` does. Counted for each format: how
often the 95 % interval of each stiffness holds the truth. Formats that give the same data to the last bit have one
posterior, which is computed once; the table says how many different ones there were.
"""

import argparse
import hashlib
import re
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

import jointbayes as jb
from benchmarks.calibration_data import case_of
from benchmarks.virtual_test import VirtualTest, simulate
from benchmarks.written_files import FORMATS, write_records
from jointbayes.joint import LogStiffness
from vibrecords import FrfData

SETTINGS = jb.SamplerSettings(walkers=48, max_steps=4000)
AVERAGES = 10

_TEST = VirtualTest(method="impact", averages=AVERAGES, response_noise=0.01)
_DATA = """[data]
kind = "measured_frf"
file = "test.{format}"

[data.channels]
"Point:11:Y+" = "11:y"
"Point:6:Y+" = "6:y"

[data.variance]
source = "coherence"

"""


@dataclass(frozen=True)
class Outcome:
    """One virtual test: for each format which stiffnesses' intervals hold the truth."""

    index: int
    held: dict[str, tuple[bool, bool, bool]]
    posteriors: int
    converged: bool


def truth_text(stiffness: np.ndarray) -> str:
    """Case whose truth is a joint (k11, k12, k22), shape (3,)."""
    text = case_of("joint").text.replace('quantity = "receptance"', 'quantity = "accelerance"', 1)
    k11, k12, k22 = stiffness
    truth = f"[data.truth]\nk11 = {k11!r}\nk12 = {k12!r}\nk22 = {k22!r}\n\n"
    return re.sub(r"(?m)^\[data\.truth\][^\[]*", truth, text)


def measured_text(text: str, format: str) -> str:
    """The same case with its data from a file."""
    begin, end = text.index("\n[data]") + 1, text.index("\n[identification]") + 1
    return text[:begin] + _DATA.format(format=format) + text[end:]


def analyse(index: int) -> Outcome:
    """Draw a joint, measure it, write and read all formats, analyse."""
    rng = np.random.default_rng([20261121, index])
    truth = case_of("joint").problem.prior.values(case_of("joint").problem.prior.sample(rng, 1))[0]
    text = truth_text(np.array([float(k) for k in truth]).tolist())
    records = simulate(jb.case_from_text("virtual test", text), _TEST, seed=int(rng.integers(2**32)))
    seed = int(rng.integers(2**32))
    known: dict[str, tuple[bool, bool, bool]] = {}
    held, converged = {}, True
    with tempfile.TemporaryDirectory() as folder:
        for format in FORMATS:
            write_records(records, Path(folder) / f"test.{format}", format)
            config = Path(folder) / f"{format}.toml"
            config.write_text(measured_text(text, format), encoding="utf-8")
            case = jb.load_case(config)
            data = case.problem.test.data
            assert isinstance(data, FrfData)
            arrays = (data.frf.frequency_hz, data.frf.values, data.variance)
            print_ = hashlib.sha256(b"".join(a.tobytes() for a in arrays)).hexdigest()
            if print_ not in known:
                posterior = jb.sample(case, seed=seed, settings=SETTINGS)
                intervals = [posterior.interval(name, 0.95) for name in LogStiffness().stiffness_names]
                known[print_] = tuple(low <= k <= high for k, (low, high) in zip(truth, intervals, strict=True))
                converged &= posterior.converged
            held[format] = known[print_]
    return Outcome(index, held, len(known), converged)


def table(found: list[Outcome]) -> str:
    """Markdown table, one row for each format."""
    lines = [
        "| Format | Virtual tests | " + " | ".join(f"{n} held" for n in LogStiffness().stiffness_names) + " |",
        "|---|---|---|---|---|",
    ]
    for format in FORMATS:
        counts = np.array([one.held[format] for one in found]).sum(axis=0)
        shares = " | ".join(f"{c} ({100 * c / len(found):.1f} %)" for c in counts)
        lines.append(f"| {format} | {len(found)} | {shares} |")
    posteriors, converged = sum(one.posteriors for one in found), sum(one.converged for one in found)
    return "\n".join(lines) + f"\n\n{posteriors} different posteriors; converged in {converged} of {len(found)} tests."


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tests", type=int, default=200, help="virtual tests; default 200")
    parser.add_argument("--processes", type=int, default=1, help="worker processes; default 1")
    options = parser.parse_args()
    found = []
    with ProcessPoolExecutor(options.processes, mp_context=get_context("spawn")) as executor:
        for outcome in executor.map(analyse, range(options.tests)):
            found.append(outcome)
            print(outcome.index, outcome.posteriors, outcome.converged, outcome.held["npz"], flush=True)
    print(table(found))


if __name__ == "__main__":
    main()
