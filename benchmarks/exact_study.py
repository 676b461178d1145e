"""How far results can be trusted, against data of an exact beam: `python -m benchmarks.exact_study`.

Random joints on four structures, each data set analysed as a user would, with the settings of the copied main case: how
often do intervals hold the true stiffness? Last kind: truths beyond a bound of the prior. What verdict do they get?

Part of `make science`; the tables go to docs/trust.md.
"""

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence

import jointbayes as jb
from benchmarks.exact_data import SUBJECTS, Edits, beyond, draw
from benchmarks.page import table
from benchmarks.study import Row, Study, coverage, holds, outcome
from jointbayes.posterior.verdicts import mode_agrees

#: Kind of those data sets whose truth lies beyond a bound.
BEYOND = "beyond a bound"
#: Errors of the ends of 95 % intervals as a share of their width, for a run that shall know the 99.9 % interval.
LONGER = 0.003


def analysed(kind: str, index: int, edits: Edits = ()) -> Row:
    """What a run says of each stiffness; `judged` is the one beyond its bound."""
    bound, data = beyond(index - 1, edits) if kind == BEYOND else (None, draw(kind, index - 1, edits))
    posterior = jb.sample(data.case, seed=index)
    truth = dict(zip(posterior.stiffness_names, data.truth.tolist(), strict=True))
    row = outcome(posterior, truth)
    longer = None
    for name, known in row["known"].items():
        known["interval999"] = list(posterior.interval(name, 0.999))
        known["if_model_right"] = bool(posterior.verdict(name).if_model_right)
        if posterior.converged and not holds(known, "interval999"):
            # some ten draws lie beyond each end in a run of default length: they are known to a tenth of the interval
            settings = dataclasses.replace(data.case.sampler, end_tolerance=LONGER)
            longer = longer or jb.sample(data.case, seed=index, settings=settings)
            known["interval999"] = list(longer.interval(name, 0.999))
    return {**row, "mode_agrees": mode_agrees(posterior), "judged": bound and bound[0]}


def summary(rows: Sequence[Row]) -> Row:
    """How often intervals hold the truth, and how far off stiffnesses called identified are."""
    by_name = {name: [row["known"][name] for row in rows] for name in rows[0]["known"]}
    judged = [row["known"][row["judged"]] for row in rows if row["judged"]]
    said = (one["verdict"] + ", if the model were right" * one["if_model_right"] for one in judged)
    return {
        **coverage(rows),
        "held999": {name: sum(holds(one, "interval999") for one in said) for name, said in by_name.items()},
        "wrong_identified": {
            name: sum(one["verdict"] == "identified" and not holds(one, "interval999") for one in said)
            for name, said in by_name.items()
        },
        "beyond": dict(Counter(said).most_common()),
        "beyond_identified": sum(one["verdict"] in ("identified", "weakly identified") for one in judged),
    }


def tables(results: Mapping[str, Row]) -> list[str]:
    """The two tables of the page."""
    rows = []
    for kind, data in results.items():
        if kind == BEYOND:
            continue
        identified = [said.get("identified", 0) for said in data["verdicts"].values()]
        columns = (data["held"].values(), identified, data["wrong_identified"].values())
        counts = (", ".join(map(str, column)) for column in columns)
        rows.append((SUBJECTS[kind].title, f"{data['sets']} ({data['converged']})", *counts))
    head = (
        *("structure", "data sets (converged)", "95 % intervals hold k11, k12, k22"),
        *("identified", "of these outside 99.9 %"),
    )
    lines = ["### Do intervals hold the truth?", "", *table(head, rows)]
    if BEYOND in results:
        data = results[BEYOND]
        verdicts = ", ".join(f"{verdict} {count}" for verdict, count in data["beyond"].items())
        called = f'Called "identified" or "weakly identified": {data["beyond_identified"]} of {data["sets"]}.'
        lines += ["", "### Truths beyond the prior's bounds", "", f"Verdicts: {verdicts}. {called}"]
    return lines


STUDY = Study("exact_study", "trust.md", dict.fromkeys(SUBJECTS, 100) | {BEYOND: 40}, analysed, summary, tables)

if __name__ == "__main__":
    STUDY.main()
