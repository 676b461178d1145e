"""The draws behind the stories in docs/uncertain.md: `python -m benchmarks.stories`."""

import argparse

import jointbayes as jb
from jointbayes.report.format import interval

CASES = ("clamped_beam", "clamped_beam_uncertain", "clamped_beam_midspan")


def rows(name: str, seed: int | None = None) -> list[str]:
    """Verdicts of one case, one row for each stiffness."""
    posterior = jb.sample(jb.load_case(f"configs/{name}.toml"), seed)
    found = []
    for stiffness in ("k11", "k12", "k22"):
        known = posterior.identifiability(stiffness)
        ratio = f"{known.ratio:.3g}" if known.ratio < float("inf") else "either sign"
        ends = interval(known.interval95)
        found.append(f"| {name} | {stiffness} | {ends} | {ratio} | {known.verdict} |")
    if not posterior.converged:
        found.append(f"| {name} | NOT CONVERGED | | | |")
    return found


def main() -> None:
    """Print the table."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    print("| Case | Stiffness | 95 % interval | Upper/lower | Verdict |\n|---|---|---|---|---|")
    for name in CASES:
        print("\n".join(rows(name)))


if __name__ == "__main__":
    main()
