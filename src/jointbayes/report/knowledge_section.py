"""What the data determine and what the verdicts rest on: directions, profiles, freed quantities, the other unknowns."""

from typing import Any

import numpy as np

from jointbayes.measurement import FrfMeasurement
from jointbayes.posterior import Knowledge, Posterior
from jointbayes.report import figures
from jointbayes.report.format import contraction, fixed, interval, number
from jointbayes.report.model import Block, Figure, Paragraph, Section, Table

__all__ = ["check_blocks", "coordinate_label", "knowledge_section", "nuisance_section"]

Summary = dict[str, Any]
_READABLE = {
    "youngs_modulus": "Young's modulus",
    "density": "density",
    "length": "length",
    "section_size": "size of the section",
    "shear_coefficient": "shear coefficient",
    "damping_ratio": "damping ratio",
    "loss_factor": "loss factor",
    "accelerometer_mass": "accelerometer mass",
    "gain": "gain",
    "noise_scale": "noise, factor on the stated",
    "discrepancy_scale": "model discrepancy, in noise sd",
    "discrepancy_length": "its correlation length",
}
_SHORT = {
    "rho": "ρ",
    "youngs_modulus": "ln E",
    "density": "ln density",
    "length": "ln L",
    "section_size": "ln size",
    "shear_coefficient": "ln κ",
    "damping_ratio": "ln ζ",
    "loss_factor": "ln η",
    "accelerometer_mass": "ln mass",
    "noise_scale": "ln noise",
    "discrepancy_scale": "ln discr.",
    "discrepancy_length": "ln Hz",
}
_KINDS = {"identified": "good", "weakly identified": "caution", "not identified": "bad"}


def check_blocks(posterior: Posterior, knowledge: Knowledge) -> list[Block]:
    """Whether the model explains the data, and where it does not."""
    check = knowledge.check
    blocks: list[Block] = [Paragraph(check.sentence)]
    measurement = posterior.problem.measurement
    if isinstance(measurement, FrfMeasurement):
        svg = figures.squares_by_line(measurement.frf.frequency_hz, check.chi2_by_line)
        worst = measurement.frf.frequency_hz[int(np.argmax(check.chi2_by_line))]
        blocks.append(
            Figure(
                "residuals",
                "Squared residual of each line over what the noise model expects, mean over posterior draws; the line "
                "is a running mean over 1 % of the lines. Where it stays above 1 the model is wrong.",
                f"Squared residual by frequency; the largest is at {worst:.0f} Hz.",
                svg,
            )
        )
    return blocks


def knowledge_section(posterior: Posterior, knowledge: Knowledge, summary: Summary) -> Section:
    """Which combinations are known, correlations, likelihood intervals, and what becomes of the verdicts."""
    blocks: list[Block] = [Paragraph(f"**{knowledge.directions_sentence}**")]
    rows = tuple((d.quantity, number(d.sd), d.verdict) for d in knowledge.directions)
    blocks.append(
        Table(
            "Combinations that the data determine independently",
            ("Combination", "sd of its logarithm", "Verdict"),
            rows,
            note="Eigen-directions of the Fisher information at the MAP, all other uncertain quantities integrated "
            "out, priors of the joint left out.",
            row_kinds=tuple(_KINDS[d.verdict] for d in knowledge.directions),
        )
    )
    blocks.append(_correlations(posterior))
    if knowledge.profiles:
        blocks += _profile_blocks(knowledge, summary)
    if knowledge.freed:
        blocks += _freed_blocks(knowledge)
    return Section("known", "What is known, and what it rests on", tuple(blocks))


def _correlations(posterior: Posterior) -> Table:
    """Correlation of the draws, the joint's coordinates against all."""
    names = posterior.problem.names
    matrix = np.atleast_2d(np.corrcoef(posterior.theta.T))
    joint = posterior.problem.parametrisation.names
    rows = tuple(
        (coordinate_label(name), *(f"{matrix[i, j]:.2f}" for j in range(len(joint)))) for i, name in enumerate(names)
    )
    return Table(
        "Correlation of the draws",
        ("", *(coordinate_label(name) for name in joint)),
        rows,
        note="Near 1 or −1 the data know a combination of the two, not each by itself.",
    )


def _profile_blocks(knowledge: Knowledge, summary: Summary) -> list[Block]:
    rows = []
    for profile in knowledge.profiles:
        low, high = profile.interval if profile.name == "rho" else tuple(np.exp(profile.interval).tolist())
        ends = ("none" if profile.open_below else number(low), "none" if profile.open_above else number(high))
        known = summary["parameters"].get(profile.name)
        rows.append((profile.name, *ends, interval(known["interval95"]) if known else "–"))
    return [
        Table(
            "Likelihood-ratio limits at 95 %",
            ("Parameter", "Lower limit", "Upper limit", "Posterior 95 %"),
            tuple(rows),
            note="From the profile likelihood, which leaves the priors of the joint out but for their bounds. None: "
            "within the bounds of the prior the data set no limit. Units as above; rho has none.",
        ),
        Figure(
            "profiles",
            "Profile likelihood: the best fit for each value of a parameter, as ln of its ratio to the best of all; "
            "dashed, the limit at 95 %.",
            f"Profile likelihood of {', '.join(p.name for p in knowledge.profiles)}.",
            figures.profiles([(p.name, p.value, p.log_ratio) for p in knowledge.profiles]),
        ),
    ]


def _freed_blocks(knowledge: Knowledge) -> list[Block]:
    names = tuple(knowledge.freed[0].sd_log)
    head = ("Uncertain beside the joint", *(f"sd of ln {name}" for name in names), "Verdicts")
    rows = tuple(
        (
            ", ".join(_readable(name) for name in row.freed) or "nothing",
            *(number(row.sd_log[name]) for name in names),
            "; ".join(f"{name} {row.verdict[name]}" for name in names),
        )
        for row in knowledge.freed
    )
    note = "From the Fisher information at the MAP, priors included."
    lead = knowledge.freed_sentence
    if knowledge.assumed:
        lead = (
            "This case takes everything beside the joint as exactly known. If Young's modulus were known to 2 %, the "
            f"density to 1 %, the length to 0.5 % and the damping not at all: {lead[0].lower()}{lead[1:]}"
        )
        note += " The uncertainties are assumed; state your own in [uncertain] to have them in the result."
    return [Paragraph(f"**{lead}**"), Table("What freeing other quantities does", head, rows, note=note, align=None)]


def nuisance_section(summary: Summary) -> Section | None:
    """Prior and posterior of whatever else is uncertain; None where nothing is."""
    if not summary["nuisances"]:
        return None
    rows = tuple(
        (
            _readable(name),
            number(n["nominal"], 4),
            interval(n["prior_interval95"], 4),
            number(n["median"], 4),
            interval(n["interval95"], 4),
            n["unit"],
            contraction(n["contraction"], 2),
            fixed(n["r_hat"], 3),
        )
        for name, n in summary["nuisances"].items()
    )
    head = ("Quantity", "Stated", "Prior 95 %", "Median", "Posterior 95 %", "Unit", "Contraction", "R̂")
    note = (
        "Contraction 0: the data say nothing about it and it keeps its prior; 1: they say all; none: it is as wide as "
        "its prior or wider."
    )
    return Section(
        "nuisances",
        "What else was uncertain",
        (Table("Other uncertain quantities", head, rows, note=note),),
    )


def coordinate_label(name: str) -> str:
    """Short label of a coordinate for an axis."""
    if name.startswith("mode_frequency_"):
        return f"ln f{name.rsplit('_', 1)[1]}"
    if name.startswith("damping_ratio_"):
        return f"ln ζ{name.rsplit('_', 1)[1]}"
    return _SHORT.get(name, f"ln {name}")


def _readable(name: str) -> str:
    if name.startswith("mode_frequency_"):
        return f"natural frequency {name.rsplit('_', 1)[1]}"
    if name.startswith("damping_ratio_"):
        return f"damping ratio of mode {name.rsplit('_', 1)[1]}"
    return _READABLE.get(name, name)
