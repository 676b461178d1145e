"""What a likelihood costs, as ratios within one process. Run by `make bench`.

"jointbayes" is `problem.log_posterior`, the public API, of joints about the true one in a batch of 64, as a sampler
asks for them, on one core. `--growth`, run by `make science`, measures how the likelihood grows with the data instead.
"""

import argparse
from functools import partial
from typing import Any

import numpy as np

import jointbayes as jb
from benchmarks import cases, peers, record
from benchmarks.timing import Contestant, Timing, interleaved, log_log_slope, peak_megabytes, resident_peak_megabytes
from jointbayes.frf import receptance_model
from jointbayes.inference import Likelihood, likelihood_of
from jointbayes.joint import Joint, Joints
from jointbayes.structure import BeamMaterial, DampingLaw, LossFactor, ModalDamping, Section, Structure, beam
from vibrecords import FrfData, RelativeNoise

BATCH = 64
#: A line-by-line solve of 64 joints takes seconds; it costs the same for each joint, so a few will do.
FEW = 4
#: Modes that somebody in a hurry sums alone: those of the band, and a few above it.
LOWEST = 8
STEEL = BeamMaterial(2.1e11, 0.3, 7800.0)
LAWS: dict[str, DampingLaw] = {"loss_factor": LossFactor(0.02), "modal": ModalDamping((0.01,))}
CLAMP = Joint(("1:y", "1:rz"))
CLAMP_STIFFNESS = np.array([[5.05e9, 3.44e7], [3.44e7, 1.52e6]])


def contestants(law: str, case: jb.Case, batch: int = BATCH) -> dict[str, Contestant]:
    """Every way to compute the likelihood of a case with this damping law."""
    theta, matrices = cases.joints(case, batch)
    test = peers.Test(case.problem)
    likelihood = case.problem.log_posterior.likelihood
    few = matrices[: min(FEW, batch)]

    def peer(make: Any, joints: np.ndarray) -> Contestant:
        log_likelihood = make(test)
        return Contestant(lambda: log_likelihood(joints), len(joints))

    entries = {
        "dense solve, line by line": peer(peers.dense_loop, few[:1]),
        "dense solve, batched over lines": peer(peers.dense_batched, few),
    }
    if law == "loss_factor":
        entries["2×2 coupling by batched numpy.linalg.solve"] = peer(peers.batched_solve, matrices)
        entries["2×2 coupling in closed form, NumPy"] = peer(peers.closed_form, matrices)
    else:
        some = matrices[: min(16, batch)]
        entries["SciPy eigh and modal sum, NumPy"] = peer(peers.modal_sum, some)
        entries[f"SciPy eigh and sum of {LOWEST} modes, NumPy"] = peer(partial(peers.modal_sum, count=LOWEST), some)
    log_posterior = case.problem.log_posterior
    entries["jointbayes"] = Contestant(lambda: log_posterior(theta), batch)
    entries["jointbayes, one joint"] = Contestant(lambda: log_posterior(theta[:1]), 1)
    entries["jointbayes, likelihood of joint matrices alone"] = Contestant(
        lambda: likelihood.log_likelihood(matrices), batch
    )
    entries["jointbayes, with gradient"] = Contestant(lambda: likelihood.gradient(matrices), batch)
    entries["jointbayes, residuals with Jacobian, one joint"] = Contestant(
        lambda: case.problem.log_posterior.residuals(theta[0]), 1
    )
    return entries


def synthetic(structure: Structure, joint: Joint | Joints, true: np.ndarray, ports: jb.Ports) -> Likelihood:
    """Likelihood of FRFs computed from a joint, with noise added."""
    exact = receptance_model(structure, joint, ports).receptance(true)[0]
    variance = RelativeNoise(0.03, 0.01).variance(exact)
    rng = np.random.default_rng(1)
    noise = rng.normal(size=exact.shape) + 1j * rng.normal(size=exact.shape)
    frf = jb.FrfSet(ports.frequency_hz, exact + np.sqrt(variance / 2) * noise, ports.outputs, ports.inputs)
    data = FrfData(frf, variance, synthetic=True)
    return likelihood_of(data, jb.Test("", structure, joint, data))


def rod(law: str, dofs_per_node: int = 2) -> Structure:
    """The main case's beam with another damping law."""
    return beam(0.383, Section.circle(0.025), STEEL, LAWS[law], elements=10, dofs_per_node=dofs_per_node)


def many_dof_contestants(f_step_hz: float, batch: int = BATCH) -> dict[str, Contestant]:
    """Joints of 6 and 12 DOFs, coupled throughout: all five of the first node, and springs further in."""
    dofs = ("1:x", "1:y", "1:z", "1:ry", "1:rz", "6:y", "6:x", "6:z", "6:ry", "6:rz", "3:y", "3:z")
    ports = jb.Ports(np.arange(2.0, 2500.5, f_step_hz), ("11:y",), ("11:y",))
    entries = {}
    for law, r in ((law, r) for law in LAWS for r in (6, 12)):
        scale = np.sqrt(np.resize([1e9, 5e9, 5e9, 1.5e6, 1.5e6, 1e6], r))
        factors = np.eye(r) + 0.1 * np.random.default_rng(2).normal(size=(batch, r, r))
        matrices = scale[:, None] * (factors @ factors.swapaxes(-1, -2)) * scale
        joints = Joints(tuple(Joint((label,), name=label) for label in dofs[:r]))
        likelihood = synthetic(rod(law, 5), joints, matrices[0], ports)
        entries[f"jointbayes, joint of {r} DOFs, {law}"] = Contestant(
            partial(likelihood.log_likelihood, matrices), batch
        )
    return entries


def growth_ports(quick: bool) -> dict[str, list[jb.Ports]]:
    """Measurements of rising size: more lines of one FRF, and more FRFs at the same lines."""
    lines = (100, 1000) if quick else (1000, 10_000, 100_000, 1_000_000)
    sides = (1, 3) if quick else (1, 3, 10, 20)
    at = tuple(f"{node}:{direction}" for node in range(11, 1, -1) for direction in ("y", "rz"))
    fixed = np.linspace(2.0, 2500.0, 100 if quick else 2500)
    return {
        "lines": [jb.Ports(np.linspace(2.0, 2500.0, n), ("11:y",), ("11:y",)) for n in lines],
        "FRFs": [jb.Ports(fixed, at[:n], at[:n]) for n in sides],
    }


def growth(law: str, quick: bool) -> list[dict[str, Any]]:
    """Time and memory of the likelihood as the data grow."""
    rows = []
    for kind, series in growth_ports(quick).items():
        points = []
        for ports in series:
            likelihood = synthetic(rod(law), CLAMP, CLAMP_STIFFNESS, ports)
            values = ports.frequency_hz.size * len(ports.outputs) * len(ports.inputs)
            # the same batch for all sizes: the data are read once for all of its joints
            matrices = CLAMP_STIFFNESS * np.linspace(0.9, 1.1, BATCH)[:, None, None]

            def run(likelihood: Likelihood = likelihood, matrices: np.ndarray = matrices) -> object:
                return likelihood.log_likelihood(matrices)

            timing = interleaved({"": Contestant(run, BATCH)}, rounds=1 if quick else 3)[""]
            points.append(
                {
                    "values": values,
                    "batch": BATCH,
                    "us": timing.median,
                    "peak_mb": peak_megabytes(run),
                    "resident_peak_mb": resident_peak_megabytes(run),
                }
            )
        sizes = [float(p["values"]) for p in points]
        slope = log_log_slope(sizes, [p["us"] for p in points])
        rows.append({"law": law, "kind": kind, "slope": slope, "points": points})
    return rows


def rows_of(law: str, timings: dict[str, Timing], entries: dict[str, Contestant]) -> list[dict[str, Any]]:
    """Results of one damping law as they are kept; ratios are against the line-by-line solve."""
    slowest = timings.get("dense solve, line by line")
    return [
        {
            "law": law,
            "what": name,
            "joints": entries[name].joints,
            "us": t.median,
            "us_least": t.least,
            "cpu_us": t.cpu,
            "rounds": t.rounds,
            "ratio": slowest.cpu / t.cpu if slowest else None,
        }
        for name, t in timings.items()
    ]


def measure(quick: bool) -> dict[str, Any]:
    """Figures of the likelihood."""
    step, rounds, batch = (50.0, 1, 8) if quick else (2.0, 7, BATCH)
    rows = []
    for law in cases.CASES:
        case = cases.quick_case(law) if quick else cases.case_with_lines(law)
        entries = contestants(law, case, batch)
        rows += rows_of(law, interleaved(entries, rounds), entries)
    entries = many_dof_contestants(step, batch)
    many = interleaved(entries, rounds)
    rows += [row for law in LAWS for row in rows_of(law, {n: t for n, t in many.items() if n.endswith(law)}, entries)]
    return {"lines": case.problem.test.data.frf.n_lines, "batch": batch, "rows": rows}


def main(arguments: list[str] | None = None) -> None:
    """Measure, print and keep the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    record.add_options(parser)
    parser.add_argument("--growth", action="store_true", help="how it grows with the data, instead; minutes")
    options = parser.parse_args(arguments)
    cases.one_core()
    if options.growth:
        rows = [row for law in LAWS for row in growth(law, options.quick)]
        record.keep("growth", {"rows": rows}, options)
    else:
        record.keep("likelihood", measure(options.quick), options)


if __name__ == "__main__":
    main()
