"""What was left out of the estimate, measured and predicted."""

from jointbayes.posterior.prediction import sentence_of_left_out
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.markup import foreign
from jointbayes.report.model import Paragraph, ReportSection, Table
from jointbayes.rounding import interval, number


def left_out_section(inputs: ReportInputs) -> ReportSection | None:
    """Each value against its interval; None where nothing was left out."""
    predicted = inputs.summary.left_out
    if not predicted:
        return None
    rows = [
        (
            foreign(f"{each.test} {each.names[i]}".strip()),
            number(each.measured[i], 4),
            number(each.median[i], 4),
            interval((each.low[i], each.high[i]), 4),
            "yes" if each.inside[i] else "no",
        )
        for each in predicted
        for i in each.shown
    ]
    count = sum(each.inside.size for each in predicted)
    note = (
        "The intervals are those of a measurement: what is uncertain in joint and structure, the error of the model "
        "where [noise] states one, and the stated noise. Frequencies in Hz, FRFs as magnitudes."
    )
    note += f" Of {count} values those outside." if len(rows) < count else ""
    head = ("Left out", "Measured", "Median", "95 % interval", "Inside")
    kinds = tuple("" if row[-1] == "yes" else "bad" for row in rows)
    table = Table("Left out and predicted", head, tuple(rows), note=note, row_kinds=kinds)
    text = Paragraph(foreign(sentence_of_left_out(predicted)))
    return ReportSection("left-out", "Left out and predicted", (text, table))
