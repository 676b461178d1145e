"""The two tables of the README, from the figures that `make bench` kept; `tests/test_benchmarks.py` compares them."""

import json
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results.json"

#: A sampler whose spread is further than this from the reference's has not seen the same posterior.
SPREAD = 0.75


def _three(value: float) -> str:
    """Three digits, without an exponent."""
    return f"{float(f'{value:.3g}'):,.10g}".replace(",", " ")


def samplers_table(results: dict[str, Any], law: str = "modal") -> str:
    """Effective samples per second and seconds to the wanted number of them, for each sampler."""
    rows = next(case for case in results["samplers"]["cases"] if case["law"] == law)["rows"]
    lines = [
        "| Sampler | µs per likelihood | effective draws per second | seconds to 2000 of them |",
        "|---|---|---|---|",
    ]
    for row in rows:
        star = "" if SPREAD < row["sd_ratio"] < 1 / SPREAD else " *"
        figures = (row["us_per_likelihood"], row["ess_per_second"], row["seconds_to_wanted"])
        lines.append(f"| {row['method']}{star} | {' | '.join(_three(x) for x in figures)} |")
    return "\n".join(lines)


def likelihood_table(results: dict[str, Any]) -> str:
    """Microseconds per likelihood and what the line-by-line solve takes, for each way and damping law."""
    lines = ["| Damping | Likelihood | µs | line-by-line solve takes |", "|---|---|---|---|"]
    for row in results["likelihood"]["rows"]:
        if "one joint" not in row["what"]:
            ratio = f"{_three(row['ratio'])} times as long" if row["ratio"] else "–"
            lines.append(f"| {row['law'].replace('_', ' ')} | {row['what']} | {_three(row['us'])} | {ratio} |")
    return "\n".join(lines)


def main() -> None:
    """Print both tables."""
    results = json.loads(RESULTS.read_text(encoding="utf-8"))
    print(samplers_table(results), likelihood_table(results), sep="\n\n")


if __name__ == "__main__":
    main()
