"""Is the likelihood on a few lines that of all lines? `python -m benchmarks.quadrature --count 20`.

Quadrature is forced on FRFs that are too short for it to pay: those of every shipped case, and of random beams of the
ten kinds of `benchmarks.every_kind`, as they are, with joints that they do not determine and models that are wrong.
Each is tried at importance draws of the posterior: errors of ln p, importance efficiency of the draws on all lines,
draws that were computed on all lines anyway, and processor time of a draw in batches of 1000. The table goes to
docs/run-times.md.
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from benchmarks.coverage import write_between
from benchmarks.every_kind import KINDS, case_of
from benchmarks.page import table
from benchmarks.record import ROOT, environment
from jointbayes.identification import Images
from jointbayes.inference import Problem, on_nodes
from jointbayes.posterior.coordinates import coordinate_systems
from jointbayes.sampling import fit_each_mode

Array = NDArray[np.float64]
PAGE = ROOT / "docs" / "run-times.md"
_ABOUT, _PROPOSED, _DRAWS = 400, 4000, 2000


@dataclass(frozen=True, slots=True)
class Row:
    """What became of one problem: `directions` and `at_nodes` are 0 where all lines are used.

    Parameters
    ----------
    name
        Of the case, or the kind of beam.
    unknowns, values
        How many.
    directions, at_nodes
        Rank of the basis, and of the values those at the nodes; of several tests in sum.
    error, efficiency
        Largest error of ln p among the draws, and importance efficiency of these on all lines.
    on_all
        Share of the draws that were computed on all lines.
    exact_us, reduced_us
        Processor time of a draw, microseconds.
    """

    name: str
    unknowns: int
    values: int
    directions: int = 0
    at_nodes: int = 0
    error: float = 0.0
    efficiency: float = 1.0
    on_all: float = 1.0
    exact_us: float = 0.0
    reduced_us: float = 0.0


def tried(name: str, problem: Problem, seed: int = 1) -> Row:
    """One problem, by quadrature whatever its size."""
    rng, exact = np.random.default_rng(seed), problem.log_posterior
    images = Images.from_problem(problem).matrices
    starts = jb.find_map(problem, seed=seed).starts_for_draws
    proposal = fit_each_mode(exact, coordinate_systems(problem), starts, images, rng)
    about, _ = proposal.weighted_draws(problem.prior.log_density, rng, _ABOUT)
    density = on_nodes(problem, about, least_values=0)
    row = Row(name, len(problem.names), exact.likelihood.n_data)
    if density is exact:
        return row
    proposed, log_weight = proposal.weighted_draws(exact, rng, _PROPOSED)
    weight = np.exp(log_weight - log_weight.max())
    theta = proposed[rng.choice(len(proposed), _DRAWS, p=weight / weight.sum())]
    by_all, by_nodes = exact(theta), density(theta)
    ratio = np.exp(by_all - by_nodes)
    terms = [term for term in density.likelihood.terms if term.likelihood._reduced is not None]  # type: ignore[attr-defined]
    sums = [term.likelihood._reduced for term in terms]
    places = problem.prior.matrix(theta), problem.prior.factors(theta)
    relied_on = np.all([sum_of(*term.select(*places))[1] for sum_of, term in zip(sums, terms, strict=True)], axis=0)
    return Row(
        name,
        row.unknowns,
        row.values,
        sum(sum_of.basis.shape[1] for sum_of in sums),
        sum(sum_of.at_nodes.n_data for sum_of in sums),
        float(np.abs(by_all - by_nodes).max()),
        float(ratio.sum() ** 2 / (ratio.size * (ratio**2).sum())),
        float(1 - relied_on.mean()),
        _microseconds(exact, proposed[:1000]),
        _microseconds(density, proposed[:1000]),
    )


def _microseconds(density: Callable[[Array], Array], theta: Array) -> float:
    density(theta)
    began = time.process_time()
    density(theta)
    return (time.process_time() - began) / len(theta) * 1e6


def problems(count: int, folder: Path) -> Iterator[tuple[str, Problem]]:
    """Those of shipped cases with FRFs, and of so many random beams."""
    for path in sorted((ROOT / "configs").glob("*.toml")):
        problem = jb.load_case(path).problem
        if any(test.data.frfs is not None for test in problem.tests):
            yield path.stem, problem
    for number in range(count):
        kind = list(KINDS)[number % len(KINDS)]
        yield (
            f"{kind} {number // len(KINDS)}",
            jb.load_case(case_of(kind, "FRFs", number // len(KINDS), folder)).problem,
        )


def _line(name: str, rows: Sequence[Row]) -> tuple[str, ...]:
    """A row of the table: of one problem, or of several that were reduced, from the least to the largest."""
    unknowns, values = (_range([getattr(row, key) for row in rows], "d") for key in ("unknowns", "values"))
    nodes = _range([row.at_nodes for row in rows], "d")
    times = (_range([getattr(row, key) for row in rows], ".1f") for key in ("exact_us", "reduced_us"))
    return (name, unknowns, values, nodes, f"{max(row.error for row in rows):.1e}", *times)


def _range(values: Sequence[float], style: str) -> str:
    ends = dict.fromkeys(f"{end:{style}}" for end in (min(values), max(values)))
    return " to ".join(ends)


def section(rows: Sequence[Row]) -> str:
    """The table, and what holds for all."""
    head = (
        "case",
        "unknowns",
        "values",
        "at the nodes",
        "largest error of ln p",
        "µs a draw, all lines",
        "by quadrature",
    )
    reduced = [row for row in rows if row.at_nodes]
    beams = [row for row in reduced if not (ROOT / "configs" / f"{row.name}.toml").exists()]
    lines = [_line(row.name, [row]) for row in reduced if row not in beams]
    lines += [_line(f"{len(beams)} random beams", beams)] if beams else []
    good = sum(row.error <= 0.01 and row.efficiency >= 0.999 for row in reduced)
    where = environment()
    return "\n".join(
        [
            *table(head, lines),
            "",
            f"Of {len(rows)} problems {len(reduced)} were reduced, the others computed on all lines; of "
            f"these {len(reduced)}, {_DRAWS} draws each, {good} had ln p within 0.01 at all draws and an efficiency of "
            f"at least 0.999. Largest error {max(row.error for row in reduced):.1e}, least efficiency "
            f"{min(row.efficiency for row in reduced):.6f}. {where['date']}, {where['cpu']}, Python {where['python']}.",
        ]
    )


def main() -> None:
    """Try them all, print each as it comes, write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20, help="random beams")
    count, rows = parser.parse_args().count, []
    with tempfile.TemporaryDirectory() as folder:
        for name, problem in problems(count, Path(folder)):
            rows.append(tried(name, problem))
            print(rows[-1], flush=True)
    write_between(PAGE, "quadrature.py", section(rows))


if __name__ == "__main__":
    main()
