"""What it costs a likelihood to have more uncertain than the joint: `python -m benchmarks.uncertain`."""

import argparse
import os

import numpy as np

from benchmarks.timing import Contestant, interleaved
from jointbayes.frf import Ports, synthesise_frf
from jointbayes.inference import JointPrior, NoiseModel, Normal, Nuisance, Problem, ScaledNoise, StudentNoise, Uniform
from jointbayes.joint import Joint, LogStiffness
from jointbayes.structure import BeamFamily, BeamMaterial, BeamRecipe, DampingLaw, LossFactor, ModalDamping, Section
from vibrecords import RelativeNoise

BATCH = 64
LINES = np.arange(10.0, 2508.1, 2.0)  # 1250
JOINT = Joint(("1:y", "1:rz"))
TRUTH = np.array([5.05e9, 3.44e7, 1.52e6])
MODAL, HYSTERETIC = ModalDamping((0.01,)), LossFactor(0.02)
MATERIAL = ("youngs_modulus", "density", "length")


def problem(law: DampingLaw, names: tuple[str, ...], noise: NoiseModel | None = None, mass: float = 0.0) -> Problem:
    """The clamped beam at 1250 lines with so much uncertain beside the joint, each to two per cent."""
    steel = BeamMaterial(2.1e11, 0.3, 7800.0)
    recipe = BeamRecipe(0.383, Section.circle(0.025), steel, law, accelerometer_mass=mass, accelerometer_dofs=("11:y",))
    structural = tuple(Nuisance(n, "1", 1.0, Normal(0.0, 0.02)) for n in names if n != "gain")
    rest = tuple(Nuisance(n, "1", 1.0, Normal(0.0, 0.02)) for n in names if n == "gain")
    hyper = tuple(Nuisance(n, "1", 1.0, Uniform(-3.0, 6.0)) for n in (noise.names if noise else ()))
    data = synthesise_frf(
        recipe.structure(),
        JOINT,
        LogStiffness().matrix(TRUTH),
        Ports(LINES, ("11:y",), ("11:y",)),
        RelativeNoise(0.03, 0.01),
        rng=np.random.default_rng(1),
    )
    marginals = tuple(Normal(m, 1.0) for m in np.log(TRUTH))
    prior = JointPrior(LogStiffness(), marginals, (*structural, *rest, *hyper))
    family = BeamFamily(recipe, {n.name: n.range for n in structural}) if structural else recipe.structure()
    return Problem(structure=family, joint=JOINT, data=data, prior=prior, noise=noise)


def problems() -> dict[str, Problem]:
    """What is compared."""
    both = (*MATERIAL, "damping_ratio")
    return {
        "nothing": problem(MODAL, ()),
        "E, density, damping ratio": problem(MODAL, ("youngs_modulus", "density", "damping_ratio")),
        "the same and the length": problem(MODAL, both),
        "the same and an accelerometer's mass": problem(MODAL, (*both, "accelerometer_mass"), mass=0.01),
        "the same and a gain": problem(MODAL, (*both, "gain")),
        "section size and shear coefficient as well": problem(MODAL, (*both, "section_size", "shear_coefficient")),
        "noise scale": problem(MODAL, (), ScaledNoise()),
        "Student-t residuals": problem(MODAL, (), StudentNoise()),
        "loss factor law: nothing": problem(HYSTERETIC, ()),
        "loss factor law: E, density, length, loss factor": problem(HYSTERETIC, (*MATERIAL, "loss_factor")),
    }


def main() -> None:
    """Print the table of docs/uncertain.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few rounds, to try the script")
    rounds = 2 if parser.parse_args().quick else 25
    rng = np.random.default_rng(2)
    entries = {}
    for name, one in problems().items():
        spread = 0.02 * np.ones(len(one.names))
        theta = np.concatenate([np.log(TRUTH), np.zeros(len(one.names) - 3)])
        points = theta + spread * rng.standard_normal((BATCH, theta.size))
        entries[name] = Contestant(lambda p=one, t=points: p.log_posterior(t), BATCH)
    times = interleaved(entries, rounds)
    print(f"{os.cpu_count()} cores, one used; {LINES.size} lines, batch of {BATCH}; least of {rounds} rounds\n")
    print("| Uncertain beside the joint | µs | times as long |\n|---|---|---|")
    base = times["nothing"].least
    for name, found in times.items():
        print(f"| {name} | {found.least:.3g} | {found.least / base:.2g} |")


if __name__ == "__main__":
    main()
