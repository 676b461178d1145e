"""The reduction of imported models of 100 000 DOFs, a bar and a plate, against direct solves of the whole.

Both ends are held by averaged ports of six DOFs; at one a joint of random stiffnesses over six decades holds the model,
at the other it is hit and observed. The error of an FRF is taken over the root of the peaks of both drive points. The
whole model is factorised at the lines where the reduced model and its finer one differ most over all joints, and at
some others; joints are then coupled to the free model exactly. What the finer model shows of the error stands beside
it. Time is that of the processor.

    python -m benchmarks.large_model              # minutes
    python -m benchmarks.large_model --quick      # a thousand DOFs
"""

import argparse
import json
import resource
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from benchmarks.bricks import brick_model, face
from benchmarks.coverage import write_between
from benchmarks.page import table
from benchmarks.record import environment
from jointbayes.structure import FeModel, Port, ReducedModel
from jointbayes.structure.imported import port_forms, reduce_model

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks" / "large_model.json", ROOT / "docs" / "imported.md"
ComplexArray = NDArray[np.complex128]
Array = NDArray[np.float64]

LOSS = 0.01
JOINTS, TOP_HZ, LINES = 50, 3000.0, 1200
SHAPES: dict[str, tuple[tuple[int, int, int], tuple[float, float, float]]] = {
    "bar": ((160, 14, 14), (0.4, 0.03, 0.02)),
    "plate": ((96, 72, 4), (0.4, 0.3, 0.012)),
}
QUICK = {"bar": ((20, 3, 3), (0.4, 0.03, 0.02)), "plate": ((16, 12, 1), (0.4, 0.3, 0.012))}


def joints(rng: np.random.Generator) -> Array:
    """Joints of six springs each, shape (joints, 6), N/m and N·m/rad, over six decades."""
    decades = rng.uniform(4.0, 10.0, (JOINTS, 6))
    return 10.0 ** (decades - np.array([0, 0, 0, 4, 4, 4]))


def free_reduced(of: ReducedModel, omega: Array) -> ComplexArray:
    """FRFs between all ports without a joint, shape (lines, p, p), loss factor."""
    values, shapes = np.linalg.eigh(of.stiffness)  # mass is one
    at = of.motions.T @ shapes
    return np.asarray(np.einsum("pm,lm,qm->lpq", at, 1 / (values * (1 + 1j * LOSS) - omega[:, None] ** 2), at))


def with_joint(free: ComplexArray, springs: Array) -> ComplexArray:
    """The same at the second port with springs at the first, shape (lines, 6, 6)."""
    at, across, seen = free[:, :6, :6], free[:, 6:, :6], free[:, 6:, 6:]
    return seen - across @ np.linalg.solve(np.eye(6) + springs[:, None] * at, springs[:, None] * free[:, :6, 6:])


def exact_free(model: FeModel, forms: Array, omega: float) -> ComplexArray:
    """FRFs between all ports of the whole model at one line, shape (p, p)."""
    dynamic = ((1 + 1j * LOSS) * model.stiffness - omega**2 * model.mass).tocsc()
    options = {"SymmetricMode": True}
    factor = splu(dynamic, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    return np.asarray(forms.T @ factor.solve(forms.astype(complex)))


def study(name: str, quick: bool) -> dict[str, Any]:
    """One shape: sizes, time, errors."""
    counts, sizes = (QUICK if quick else SHAPES)[name]
    model = brick_model(counts, sizes)
    ends = {"root": Port(face(model, 0.0)), "tip": Port(face(model, sizes[0]))}
    each = [port_forms(model, port, end) for end, port in ends.items()]
    forms = np.stack([form for of_port in each for form in of_port.values()], axis=1)
    before = time.process_time()
    reduced, finer = reduce_model(model, forms, TOP_HZ)
    took = time.process_time() - before
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6  # before the direct solves
    rng = np.random.default_rng(1)
    springs, omega = joints(rng), 2 * np.pi * np.linspace(20.0, TOP_HZ, LINES)
    free, free_finer = free_reduced(reduced, omega), free_reduced(finer, omega)
    here = np.array([with_joint(free, k) for k in springs])
    there = np.array([with_joint(free_finer, k) for k in springs])
    peak = np.abs(np.einsum("nlii->nli", there)).max(axis=1)
    scale = np.sqrt(peak[:, :, None] * peak[:, None, :])[:, None]
    told = (np.abs(here - there) / scale).max(axis=(2, 3))  # joints, lines
    worst = np.unravel_index(np.argsort(told, axis=None)[-3:], told.shape)[1]
    lines = np.unique([*worst, *rng.choice(LINES, 3, replace=False)])
    true = np.zeros((JOINTS, len(lines)))
    for i, line in enumerate(lines):
        free_here = exact_free(model, forms, float(omega[line]))[None]
        exact = np.array([with_joint(free_here, k)[0] for k in springs])
        true[:, i] = (np.abs(here[:, line] - exact) / scale[:, 0]).max(axis=(1, 2))
    seen = true > 1e-8  # the rest is rounding of the direct solve
    ratio = float((told[:, lines] / true)[seen].min()) if seen.any() else float("nan")
    return {
        "dofs": model.n_dofs,
        "vectors": len(reduced.mass),
        "cpu_s": took,
        "memory_gb": memory,
        "error": float(true.max()),
        "told": float(told.max()),
        "told_over_true": ratio,
        "lines": len(lines),
    }


def page_of(kept: dict[str, Any]) -> str:
    """The table."""
    rows = [
        [
            name,
            f"{r['dofs']}",
            f"{r['vectors']}",
            f"{r['cpu_s']:.0f}",
            f"{r['memory_gb']:.1f}",
            f"{r['error']:.1e}",
            f"{r['told']:.1e}",
            "–" if np.isnan(r["told_over_true"]) else f"{r['told_over_true']:.2f}",
        ]
        for name, r in kept["rows"].items()
    ]
    head = [
        "Model",
        "DOFs",
        "Vectors",
        "CPU (s)",
        "Memory (GB)",
        "Largest error",
        "As told by itself",
        "Told / true, least",
    ]
    where = kept["environment"]
    return "\n".join(table(head, rows)) + f"\n\n{where['date']}, {where['cpu']}, Python {where['python']}, one core."


def main() -> None:
    """Run the studies, keep the figures and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small models, to try the script; keeps nothing")
    parser.add_argument("--shape", choices=list(SHAPES), action="append")
    options = parser.parse_args()
    kept = json.loads(RESULTS.read_text()) if RESULTS.exists() else {"rows": {}}
    for name in options.shape or SHAPES:
        row = study(name, options.quick)
        print(name, row, flush=True)
        if not options.quick:
            kept = {"environment": environment(), "rows": kept["rows"] | {name: row}}
            RESULTS.write_text(json.dumps(kept, indent=1) + "\n")
            write_between(PAGE, "large_model.py", page_of(kept))


if __name__ == "__main__":
    main()
