"""Coverage beside a measured body: a spindle known by its FRFs with 1 % noise, a modelled tool, the joint unknown.

Each data set has its own errors of the spindle's FRFs and of the tool's. The 95 % intervals of the joint's stiffnesses
should hold the truth in 95 of 100, and do; with the spindle's noise ignored they do not.

    python -m benchmarks.measured_body               # 100 data sets, prints and writes measured_body.json
    python -m benchmarks.measured_body --sets 10 --ignore
"""

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jointbayes.frf import FrfSet, MeasuredBody, Ports, Substructures, receptance_model
from jointbayes.inference import JointPrior, Problem, Uniform
from jointbayes.joint import Joint, LogStiffness
from jointbayes.measurement import FrfMeasurement
from jointbayes.posterior import Posterior
from jointbayes.sampling import SamplerSettings
from jointbayes.structure import BeamMaterial, LossFactor, Section, Structure, beam
from jointbayes.workflow import sample

Array = NDArray[np.float64]

STEEL = BeamMaterial(2.1e11, 0.3, 7800.0)
LINES = np.arange(100.0, 3000.0, 20.0)
TRUTH = np.array([1.5e8, 1.2e6, 6e4])
NOISE = 0.01
TAPER = Joint(("1:y", "1:rz"), ("spindle:y", "spindle:rz"))
SETTINGS = SamplerSettings(walkers=16, max_steps=2000, tau_factor=20, end_tolerance=0.05)


def tool() -> Structure:
    """A tool of 90 mm, 20 mm thick, free."""
    return beam(0.09, Section.circle(0.02), STEEL, LossFactor(0.02), elements=6)


def spindle() -> Structure:
    """A stub of 300 mm on two bearings, much damped; what the analysis knows of it is its FRFs at the nose."""
    free = beam(0.3, Section.circle(0.05), STEEL, LossFactor(0.06), elements=6)
    stiffness = np.array(free.stiffness)
    for label, bearing in (("1:y", 8e7), ("5:y", 1.2e8)):
        stiffness[free.dofs.index(label), free.dofs.index(label)] += bearing
    nose = {"7:y": "spindle:y", "7:rz": "spindle:rz"}
    return Structure(stiffness, free.mass, free.damping, tuple(nose.get(label, f"b{label}") for label in free.dofs))


def noisy(values: NDArray[np.complex128], rng: np.random.Generator) -> tuple[NDArray[np.complex128], Array]:
    """Values with complex circular errors of 1 % of each, and the variance that a test would state."""
    white = rng.standard_normal((*values.shape, 2)) @ [1, 1j] / np.sqrt(2)
    measured = values * (1 + NOISE * white)
    return measured, (NOISE * np.abs(measured)) ** 2


def data_set(seed: int, *, propagate: bool = True) -> Problem:
    """Noisy FRFs of the spindle by itself and of the tool's end in it."""
    rng, ground = np.random.default_rng([seed, 2026]), Joint(("spindle:y",), name="none")
    alone = Ports(LINES, TAPER.against, TAPER.against)
    values = receptance_model(spindle(), ground, alone).receptance(np.zeros((1, 1)))[0]
    measured, variance = noisy(values, rng)
    body = MeasuredBody.of(FrfSet(LINES, measured, alone.outputs, alone.inputs), variance, "spindle")
    exact = MeasuredBody.of(FrfSet(LINES, values, alone.outputs, alone.inputs), np.zeros(values.shape), "spindle")
    ports = Ports(LINES, ("7:y", "4:y"), ("7:y",))
    true = receptance_model(Substructures(tool(), (exact,)), TAPER, ports)
    frf, spread = noisy(true.receptance(LogStiffness().matrix(TRUTH))[0], rng)
    data = FrfMeasurement(FrfSet(LINES, frf, ports.outputs, ports.inputs), spread, synthetic=True)
    prior = JointPrior(LogStiffness(), tuple(Uniform(np.log(k / 30), np.log(30 * k)) for k in TRUTH))
    return Problem(Substructures(tool(), (body,), propagate), TAPER, data, prior, name=f"spindle {seed}")


def held(posterior: Posterior) -> list[bool]:
    """Whether the 95 % interval of each stiffness holds the truth."""
    pairs = zip(posterior.stiffness_names, TRUTH, strict=True)
    return [low <= k <= high for (low, high), k in ((posterior.interval(name), k) for name, k in pairs)]


def study(sets: int, *, propagate: bool) -> dict[str, object]:
    """Coverage over data sets, and what one of them says."""
    count, explained, converged, doubtful = np.zeros(3, dtype=int), 0, 0, 0
    sd, start, sentence = [], time.perf_counter(), ""
    for seed in range(1, sets + 1):
        posterior = sample(data_set(seed, propagate=propagate), seed=seed, settings=SETTINGS)
        count += held(posterior)
        explained += posterior.check.explains
        converged += posterior.converged
        found = posterior.noise_of_bodies
        assert found is not None
        doubtful += found.doubtful_lines > 0
        sentence = sentence or found.sentence
        sd.append([float(np.log(posterior.values(name)).std()) for name in posterior.stiffness_names])
    return {
        "sets": sets,
        "propagate": propagate,
        "held": dict(zip(LogStiffness().stiffness_names, count.tolist(), strict=True)),
        "median_sd_log": np.median(sd, axis=0).round(5).tolist(),
        "explained": explained,
        "converged": converged,
        "with_doubtful_lines": doubtful,
        "sentence_of_the_first": sentence,
        "seconds": round(time.perf_counter() - start, 1),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--ignore", action="store_true", help="only with the noise of the spindle ignored")
    parser.add_argument("--out", type=Path, help="file for the figures")
    given = parser.parse_args(arguments)
    results = [study(given.sets, propagate=way) for way in ((False,) if given.ignore else (True, False))]
    print(json.dumps(results, indent=2))
    if given.out:
        given.out.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
