"""Figure and lines of docs/examples/spindle-tool.md, from examples/stability_lobes.py; and how true the band is.

The exact tool has the springs that made the data of the tap test. Its limiting depth should lie inside the 95 % band at
95 of 100 speeds, and all speeds hang together: one data set is one case.

    python -m benchmarks.lobes
"""

import contextlib
import importlib.util
import io
from pathlib import Path
from types import ModuleType

import numpy as np

import jointbayes as jb
from benchmarks.record import write_between
from jointbayes.frf import receptance_model
from jointbayes.structure import family_of_recipe

ROOT = Path(__file__).resolve().parents[1]
PAGE, FIGURE = ROOT / "docs" / "examples" / "spindle-tool.md", ROOT / "docs" / "figures" / "stability_lobes.svg"


def example() -> ModuleType:
    """examples/stability_lobes.py as a module."""
    spec = importlib.util.spec_from_file_location("stability_lobes", ROOT / "examples" / "stability_lobes.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def share_inside(lobes: ModuleType, draws: int, every: int = 1) -> float:
    """Share of speeds at which the exact tool's limiting depth lies in the 95 % band."""
    lobes.SPEEDS = lobes.SPEEDS[::every]
    case = jb.load_case(lobes.CASE)
    posterior = jb.sample(case, seed=1)
    tip = jb.Ports(lobes.LINES, ("tool.tip:y",), ("tool.tip:y",))
    recipe, alpha = lobes.longer_tool(case), lobes.averaged_coefficients(0.0, np.pi)
    found = posterior.predict(recipe, tip, max_draws=draws)
    low, high = np.quantile([lobes.limiting_depth(f[:, 0, 0], alpha) for f in found.values], [0.025, 0.975], axis=0)
    truth = np.log([6e8, 1.2e6, 2e8, 1e5])  # [data.truth] of the case
    matrix = case.problem.prior.matrix(truth[None])
    exact = receptance_model(family_of_recipe(recipe), case.problem.test.joints, tip).receptance(matrix)[0, :, 0, 0]
    depth = lobes.limiting_depth(exact, alpha)
    return float(((low <= depth) & (depth <= high)).mean())


def main() -> None:
    """Run the example, write its figure and lines, and the share of speeds."""
    lobes, printed = example(), io.StringIO()
    with contextlib.redirect_stdout(printed):
        lobes.main(str(FIGURE))
    share = share_inside(example(), 200)
    lines = f"```text\n{printed.getvalue()}```\n\n"
    lines += f"The limit of the exact tool lies inside the 95 % band at {100 * share:.0f} % of the speeds."
    print(lines)
    write_between(PAGE, "lobes.py", lines)


if __name__ == "__main__":
    main()
