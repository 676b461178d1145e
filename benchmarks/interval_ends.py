"""Do the ends of 95 % intervals scatter over seeds as their stated Monte Carlo errors say, on every shipped case?

`python -m benchmarks.interval_ends`, a part of `make science`. Each case of configs/ is sampled at each seed. Of each
end of each stiffness's 95 % interval the standard deviation over the seeds is compared with the root mean square of the
stated errors. Their ranges go to docs/trust.md.

The rule. A case's figure is the root mean square of the ratios of all its ends, and should lie in 0.8 to 1.25. A
standard deviation over n seeds is itself uncertain, and the ends of one case move together: the lower ends of its
stiffnesses count as one, the upper ends as another, so that the figure has 2 (n - 1) degrees of freedom. A case fails
where its figure, divided by what chance does to such a figure in 95 of 100 studies, lies outside 0.8 to 1.25 as a
whole: with 20 seeds below 0.62 or above 1.53. The figure of all cases together, of as many degrees for each, must lie
in 0.8 to 1.25 as it stands.
"""

import sys
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy import stats

import jointbayes as jb
from benchmarks.record import ROOT
from benchmarks.study import Row, Study
from jointbayes.posterior.sampled import by_ensemble
from jointbayes.sampling import INTERVAL, quantile_error

CASES = tuple(sorted(path.stem for path in (ROOT / "configs").glob("*.toml")))

#: Between which the ratio of scatter to stated error should lie.
LIMITS = (0.8, 1.25)


def measure(case: str, seed: int) -> Row:
    """Ends [lower, upper] and stated errors of one case at one seed, by stiffness."""
    posterior = jb.sample(jb.load_case(ROOT / "configs" / f"{case}.toml"), seed=seed)
    names = posterior.stiffness_names
    draws = {name: by_ensemble(posterior, name) for name in names}
    return {
        "converged": posterior.converged,
        "ends": {name: np.quantile(draws[name], INTERVAL).tolist() for name in names},
        "errors": {name: [quantile_error(draws[name], p) for p in INTERVAL] for name in names},
    }


def ratios(rows: Sequence[Row]) -> dict[str, tuple[float, float]]:
    """Scatter of each end over the seeds, over the root mean square of its stated errors: (lower, upper) by name."""
    found = {}
    for name in rows[0]["ends"]:
        scatter = np.std([row["ends"][name] for row in rows], axis=0, ddof=1)
        stated = np.sqrt(np.mean(np.square([row["errors"][name] for row in rows]), axis=0))
        low, high = (scatter / stated).tolist()
        found[name] = low, high
    return found


def pooled(each: Iterable[tuple[float, float]]) -> float:
    """Root mean square of ratios."""
    return float(np.sqrt(np.mean(np.square(list(each)))))


def allowed(seeds: int) -> tuple[float, float]:
    """Between which a case's figure lies in 95 of 100 studies at least, if the true ratio is within the limits.

    Examples
    --------
    >>> [round(end, 2) for end in allowed(20)]
    [0.62, 1.53]
    """
    freedom = 2 * (seeds - 1)
    low, high = np.sqrt(stats.chi2(freedom).ppf((0.025, 0.975)) / freedom)
    return LIMITS[0] * float(low), LIMITS[1] * float(high)


def summary(rows: Sequence[Row]) -> Row:
    """A case's figure, its single ends, and the seeds at which it has not converged."""
    found = ratios(rows)
    ends = [end for pair in found.values() for end in pair]
    failed = [row["index"] for row in rows if not row["converged"]]
    return {"figure": pooled(found.values()), "least": min(ends), "most": max(ends), "not_converged": failed}


def wrong(results: Mapping[str, Row]) -> list[str]:
    """What the rule finds wrong, one sentence each; empty where it is met."""
    found = []
    for case, data in results.items():
        low, high = allowed(data["sets"])
        if not low <= data["figure"] <= high:
            found.append(f"{case}: {data['figure']:.2f} is outside {low:.2f} to {high:.2f}")
        found += [f"{case}: not converged at seeds {data['not_converged']}"] if data["not_converged"] else []
    if not LIMITS[0] <= _whole(results) <= LIMITS[1]:
        found.append(f"all cases: {_whole(results):.2f} is outside {LIMITS[0]} to {LIMITS[1]}")
    return found


def _whole(results: Mapping[str, Row]) -> float:
    return pooled([(data["figure"], data["figure"]) for data in results.values()])


def tables(results: Mapping[str, Row]) -> list[str]:
    """Return the ranges over all cases, and what fails."""
    rows = list(results.values())
    figures, least, most = (sorted(row[key] for row in rows) for key in ("figure", "least", "most"))
    ranges = f"{len(rows)} cases: {figures[0]:.2f} to {figures[-1]:.2f}, single ends {least[0]:.2f} to {most[-1]:.2f}."
    said = [f"- Failed: {line}." for line in wrong(results)] or ["None outside its band, and every run converged."]
    return [f"{ranges} All together: {_whole(results):.2f}.", "", *said]


STUDY = Study("interval_ends", "trust.md", dict.fromkeys(CASES, 20), measure, summary, tables)

if __name__ == "__main__":
    sys.exit(bool(wrong(STUDY.main())))
