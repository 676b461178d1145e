"""Coverage of an imported solid: a bar of bricks held by a face, the springs unknown, FRFs of the whole model.

The data are dense solves of the unreduced model with noise; the analysis sees the reduced one. The 95 % intervals of
the springs should hold the truth in 95 of 100. The time of the likelihood stands beside that of a beam with as many
springs, lines and FRFs, in one process. Data sets are kept in build/solid as they come; the table goes to
docs/imported.md.

    python -m benchmarks.solid --sets 100
"""

import argparse
import json
import time
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

import jointbayes as jb
from benchmarks.bricks import brick_model, face
from benchmarks.coverage import kept_rows, measured_where, of_sets, row_of, summary
from benchmarks.page import table
from benchmarks.record import write_between
from jointbayes.inference import JointPrior, Problem, Test, Uniform
from jointbayes.joint import Joint, parametrisation_named
from jointbayes.posterior import Posterior
from jointbayes.sampling import SamplerSettings
from jointbayes.structure import (
    BeamMaterial,
    BeamRecipe,
    FeModel,
    LossFactor,
    ModalDamping,
    Port,
    Section,
    family_of_recipe,
    reduce_to_ports,
)
from jointbayes.structure.imported import port_forms
from vibrecords import FrfData, FrfSet

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks" / "solid.json", ROOT / "docs" / "imported.md"
KEPT, SETS, ENTROPY = ROOT / "build" / "solid", 100, 20261128
SETTINGS = SamplerSettings(walkers=24, max_steps=2000).for_one_of_many()

LOSS, NOISE, FLOOR = 0.01, 0.03, 0.01
LINES = np.linspace(100.0, 4000.0, 80)
WAYS = ("x", "y", "z", "rx", "ry", "rz")
OUTPUTS, INPUTS = ("corner:y", "corner:z", "corner:x"), ("corner:y", "other:z")
LOW, HIGH = np.array([1e7] * 3 + [1e3] * 3), np.array([1e9] * 3 + [1e5] * 3)


@cache
def solid() -> tuple[FeModel, dict[str, Port]]:
    """The bar, and where it is held and seen: no sensor lies in a plane of symmetry."""
    model = brick_model((8, 2, 2), (0.2, 0.02, 0.03))
    tip = face(model, 0.2)
    return model, {"root": Port(face(model, 0.0)), "corner": Port((tip[-1],)), "other": Port((tip[0],))}


def _forms(labels: tuple[str, ...]) -> Array:
    model, ports = solid()
    every = {
        f"{name}:{way}": form for name, port in ports.items() for way, form in port_forms(model, port, name).items()
    }
    return np.stack([every[label] for label in labels], axis=1)


def data_of(rng: np.random.Generator, springs: Array) -> FrfData:
    """FRFs of the whole model, each line solved, with noise."""
    model, _ = solid()
    k, m = model.stiffness.toarray() * (1 + 1j * LOSS), model.mass.toarray()
    held, loads, seen = (_forms(labels) for labels in (tuple(f"root:{w}" for w in WAYS), INPUTS, OUTPUTS))
    k = k + held @ np.diag(springs) @ held.T
    values = np.array([seen.T @ linalg.solve(k - w**2 * m, loads) for w in 2 * np.pi * LINES])
    part = NOISE * np.abs(values) + FLOOR * np.median(np.abs(values), axis=0)
    noisy = values + part * (rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape))
    return FrfData(FrfSet(LINES, noisy, OUTPUTS, INPUTS, "receptance"), 2 * part**2)


def problem_of(data: FrfData, modal: bool = False, ways: tuple[str, ...] = WAYS) -> Problem:
    """The analysis: the reduced model with springs in these directions."""
    model, ports = solid()
    law = ModalDamping((LOSS / 2,)) if modal else LossFactor(LOSS)
    body = family_of_recipe(reduce_to_ports(model, ports, float(LINES[-1]), law))
    joint, some = Joint(tuple(f"root:{way}" for way in ways)), [WAYS.index(way) for way in ways]
    prior = JointPrior(
        parametrisation_named("springs", ways),
        tuple(Uniform(np.log(a), np.log(b)) for a, b in zip(LOW[some] / 30, HIGH[some] * 30, strict=True)),
    )
    return Problem([Test("", body, joint, data)], prior, name="solid")


def analyse(index: int) -> tuple[Posterior, Mapping[str, float]]:
    """One data set."""
    rng = np.random.default_rng([ENTROPY, index])
    springs = np.exp(rng.uniform(np.log(LOW), np.log(HIGH)))
    problem = problem_of(data_of(rng, springs))
    posterior = jb.sample(problem, seed=index, settings=SETTINGS, premises="exact")
    return posterior, dict(zip(posterior.stiffness_names, springs.tolist(), strict=True))


def seconds_of(problem: Problem, theta: Array) -> float:
    """Least CPU time of ln p of one draw among batches of these, s."""
    problem.log_posterior(theta[:2])
    least = np.inf
    for _ in range(7):
        began = time.process_time()
        problem.log_posterior(theta)
        least = min(least, time.process_time() - began)
    return least / len(theta)


def ratios() -> dict[str, float]:
    """Likelihood of the solid over that of a beam of as many lines and FRFs, for both kinds of damping."""
    rng, found = np.random.default_rng(1), {}
    data = data_of(rng, np.sqrt(LOW * HIGH))
    for name, modal in (("loss_factor", False), ("modal", True)):
        law = ModalDamping((LOSS / 2,)) if modal else LossFactor(LOSS)
        steel = BeamMaterial(2.1e11, 0.3, 7800.0)
        bar = family_of_recipe(BeamRecipe(0.2, Section.rectangle(0.03, 0.02), steel, law, dofs_per_node=5))
        dofs = {"corner:y": "11:y", "corner:z": "11:z", "corner:x": "11:x", "other:z": "11:z"}
        frf = data.frf
        renamed = FrfSet(
            LINES, frf.values, tuple(dofs[o] for o in frf.outputs), tuple(dofs[i] for i in frf.inputs), "receptance"
        )
        ways = ("x", "y", "z", "ry", "rz")
        prior = JointPrior(parametrisation_named("springs", ways), tuple(Uniform(*np.log([1e3, 1e9])) for _ in ways))
        joint = Joint(tuple(f"1:{way}" for way in ways))
        beam_like = Problem([Test("", bar, joint, FrfData(renamed, data.variance))], prior, name="beam")
        here = problem_of(data, modal, ways)
        theta = [p.prior.sample(rng, 400) for p in (here, beam_like)]
        found[name] = seconds_of(here, theta[0]) / seconds_of(beam_like, theta[1])
    return found


def main() -> None:
    """Run the study, keep the figures and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=SETS, help="data sets")
    options = parser.parse_args()
    KEPT.mkdir(parents=True, exist_ok=True)
    rows = kept_rows(KEPT / "solid.jsonl", "solid", options.sets, partial(row_of, analyse=analyse, judged="ky"))
    results: dict[str, Any] = {"solid": summary(rows, "ky")}
    likelihood = ratios()
    text = page_of(results | {"likelihood": likelihood})
    print(text)
    RESULTS.write_text(json.dumps(results | {"likelihood": likelihood}, indent=1) + "\n")
    write_between(PAGE, "solid.py", text)


def page_of(results: dict[str, Any]) -> str:
    """Table and sentences of the page."""
    study, likelihood = results["solid"], results["likelihood"]
    head = ["Spring", "Held by its 95 % interval"]
    text = "\n".join(table(head, [[name, of_sets(study, name)] for name in study["coverage"]]))
    none = study["verdicts"].get("no verdict", 0)
    text += (
        f"\n\nIn {none} of {study['data_sets']} of these short runs there is no verdict: the axial resonance, by which "
    )
    text += (
        "kx shows, is narrower than the 49 Hz between lines, so that the density along kx is a comb, and a draw leads "
    )
    text += "to a higher tooth than the search. "
    text += f"The likelihood takes {likelihood['loss_factor']:.2f} times a beam's with a loss factor, "
    text += f"{likelihood['modal']:.2f} times with modal damping."
    return f"{text}\n\n{measured_where({'solid': study})}"


if __name__ == "__main__":
    main()
