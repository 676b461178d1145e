"""Write what README and docs quote from runs and files, which `docs/numbers.json` records.

1. Sentences with numbers: `sentences.txt` has each as a template. ``{clamped_beam.k11.ratio:.3g}`` is a path in the
   record and a format. A page has the plain sentence, which is found by its words and written again.
2. Blocks: ``<!--numbers run clamped_beam-->`` on a line of its own, then the block, then ``<!--/numbers-->``. The kinds
   of blocks are the keys of `BLOCKS`.
"""

import math
import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks import reference_pages

ROOT = Path(__file__).resolve().parents[1]
Record = dict[str, Any]

#: Published estimates of one stiffness each, N/m, by what was minimised, where a publication has several.
OBJECTIVES: dict[str, dict[str, tuple[float, ...]]] = {
    "four_storeys": {
        "assurance criterion": (1295.4, 1373.2, 1526.5, 2684.2),
        "eigenvectors": (1317.5, 1280.3, 1543.3, 2762.6),
        "dynamic residual": (1275.2, 1311.6, 1547.4, 2684.6),
    },
    "three_storeys": {"mean of their draws": (52508.0, 56956.0, 66778.0)},
}
_PLACE = re.compile(r"\{([\w.]+)(?::([\w.%+]+))?\}")
BLOCK = re.compile(r"^<!--numbers ([^\n]*?)-->\n.*?^<!--/numbers-->$", re.MULTILINE | re.DOTALL)
MINUS = "\N{MINUS SIGN}"
_MOST_LISTED = 3  # stiffnesses of a case in the table of all cases


def pages() -> list[Path]:
    """README and all pages of the documentation."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def sentences() -> list[str]:
    """Return the templates of sentences, one a paragraph of `sentences.txt`."""
    return (ROOT / "benchmarks" / "sentences.txt").read_text(encoding="utf-8").strip().split("\n\n")


def found(template: str, text: str) -> list[re.Match[str]]:
    """Return where a page has the sentence of a template, with one group a number, whatever the line breaks."""
    parts, words = _PLACE.split(template), ""
    for part, style in zip(parts[::3], [*parts[2::3], ""], strict=True):
        place = r"([\N{MINUS SIGN}\d.]*\d%?)" if style else '([^\\n"]{1,120}?)'
        words += re.sub(r"(\\ )+", r"\\s+", re.escape(part)) + place
    return list(re.finditer(words.removesuffix(place), text))


def written(text: str, record: Record) -> str:
    """Return a page with every sentence and block as the record has it.

    Raises
    ------
    KeyError
        If a template or a block names something that the record does not have.
    """

    def block(match: re.Match[str]) -> str:
        kind, *arguments = match[1].split()
        body = "\n".join(BLOCKS[kind](record, *arguments))
        return f"<!--numbers {match[1]}-->\n{body}\n<!--/numbers-->"

    text = BLOCK.sub(block, text)
    for template in sentences():
        values = [printed(looked_up(record, path), style) for path, style in _PLACE.findall(template)]
        for match in reversed(found(template, text)):
            for group, value in reversed(list(enumerate(values, 1))):
                text = text[: match.start(group)] + value + text[match.end(group) :]
    return text


def looked_up(record: Record, path: str) -> Any:
    """A value of the record; the first part of the path may leave out ``cases``."""
    first, *rest = path.split(".")
    value: Any = record["cases"][first] if first in record["cases"] else record[first]
    while rest:
        # a stiffness of one joint among several has a point in its name
        taken = 2 if len(rest) > 1 and isinstance(value, dict) and f"{rest[0]}.{rest[1]}" in value else 1
        key = ".".join(rest[:taken])
        value, rest = value[int(key)] if isinstance(value, list) else value[key], rest[taken:]
    return value


def stiffnesses(case: Record) -> list[str]:
    """Names of the quantities of the joints of a case."""
    return [name for name, entry in case.items() if isinstance(entry, dict) and "verdict" in entry]


def printed(value: Any, style: str = "") -> str:
    """A value in a format of Python, or the style ``3e`` (1.36e10) or ``code``; text as it is."""
    if style == "code":
        return f"`{value}`"
    if not isinstance(value, int | float) or isinstance(value, bool):
        return str(value)
    if style.endswith("e"):
        return stiffness(value, int(style[:-1]))
    return format(value, style).replace("-", MINUS)


def stiffness(value: float, digits: int = 3) -> str:
    """Such as 1.36e10."""
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}e{int(exponent)}".replace("-", MINUS)


def _fenced(lines: list[str]) -> list[str]:
    return ["```text", *lines, "```"]


def _run(record: Record, name: str) -> list[str]:
    return _fenced(record["cases"][name]["printed"])


def _answer(record: Record, name: str) -> list[str]:
    """The line of each stiffness."""
    known = tuple(f"{k} {word} " for k in stiffnesses(record["cases"][name]) for word in ("=", "above", "below"))
    return _fenced([line for line in record["cases"][name]["printed"] if line.startswith(known)])


def _python(record: Record, name: str) -> list[str]:
    """Return what README's lines of Python print."""
    each = ((k, record["cases"][name][k]) for k in stiffnesses(record["cases"][name]))
    return _fenced([f"{k}: {e['low']:.2e} to {e['high']:.2e}, {e['words']}" for k, e in each])


def _check(record: Record, name: str) -> list[str]:
    return _fenced(record["cases"][name]["check"]["printed"])


def _identify(record: Record, name: str, part: str = "all") -> list[str]:
    """All lines or those of the iteration, but of many steps only the first nine and the last."""
    lines = record["identify"][name]["printed"]
    if part == "iteration":
        lines = lines[next(i for i, line in enumerate(lines) if line.startswith("step")) :]
    steps = [i for i, line in enumerate(lines) if re.match(r" *\d+ ", line)]
    if len(steps) > 12:
        lines = [*lines[: steps[9]], "   …", *lines[steps[-1] :]]
    return _fenced(lines)


def _ends(entry: Record) -> str:
    """Both ends, with the digits that their errors support, else three or as many as tell them apart."""
    low, high = entry["low"], entry["high"]
    if entry.get("limit") is not None:
        return f"{'above' if 'below' in entry['verdict'] else 'below'} {stiffness(entry['limit'])}, one-sided"
    relative = (high - low) / max(abs(low), abs(high))
    digits = max(3, math.ceil(-math.log10(relative)) + 1)
    ends = (
        stiffness(entry[end], supported(entry[end], entry[f"{end}_error"]) if f"{end}_error" in entry else digits)
        for end in ("low", "high")
    )
    return " to ".join(ends)


def _median(entry: Record) -> str:
    error = entry.get("median_error")
    return stiffness(entry["median"], 3 if error is None else supported(entry["median"], error))


def supported(value: float, error: float) -> int:
    """Digits of a value of which the last stands where the first of its error does, one to five."""
    if not (value and error > 0):
        return 5
    return min(max(math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) + 1, 1), 5)


def _ratio(entry: Record) -> str:
    """Upper end over lower: its difference from 1 with a digit at least."""
    ratio = entry["ratio"]
    if ratio is None:
        return "either sign"
    return f"{ratio:.3g}" if ratio >= 10 else f"{ratio:.{max(2, math.ceil(-math.log10(ratio - 1)))}f}"


def _verdicts(record: Record, name: str) -> list[str]:
    lines = [
        "| Stiffness | True value | Median | 95 % credible interval | Upper/lower | Verdict |",
        "|---|---|---|---|---|---|",
    ]
    for k in stiffnesses(record["cases"][name]):
        e = record["cases"][name][k]
        cells = (k, f"{stiffness(e['reference'])} {e['unit']}", _median(e), _ends(e), _ratio(e), e["words"])
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _intervals(record: Record, *names: str) -> list[str]:
    lines = ["| Case | Stiffness | 95 % credible interval | Upper/lower | Verdict |", "|---|---|---|---|---|"]
    for name in names:
        for k in stiffnesses(record["cases"][name]):
            e = record["cases"][name][k]
            lines.append(f"| {name} | {k} | {_ends(e)} | {_ratio(e)} | {e['words']} |")
    return lines


def _freed(record: Record, name: str) -> list[str]:
    """The intervals with all else exactly known, and with what a workshop does not know."""
    case = record["cases"][name]
    lines = ["| Uncertain besides the joints | " + " | ".join(stiffnesses(case)) + " |"]
    lines.append("|---" * (len(stiffnesses(case)) + 1) + "|")
    for row in case["freed"]["rows"]:
        cells = [", ".join(word.replace("_", " ") for word in row["freed"]) or "nothing"]
        for k in stiffnesses(case):
            low, high = row["interval95"][k]
            cells.append(f"{_ends({'low': low, 'high': high, 'verdict': ''})}: {row['verdict'][k]}")
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _cases(record: Record) -> list[str]:
    """Every case that can be run: what it is, and what came out."""
    lines = ["| File | What it is | 95 % credible interval |", "|---|---|---|"]
    for name, case in record["cases"].items():
        names = stiffnesses(case)
        each = (_found(k, case[k]) for k in names)
        counts = Counter(case[k]["verdict"] for k in names)
        many = ", ".join(f"{count} of {len(names)} stiffnesses {verdict}" for verdict, count in counts.items())
        found = many if len(names) > _MOST_LISTED else "; ".join(each)
        wrong = "" if case["explains"] else "; the model does not explain the data"
        lines.append(f"| `{name}.toml` | {case['title']} | {found}{wrong} |")
    return lines


def _found(name: str, entry: Record) -> str:
    """Return interval and verdict of a stiffness, without what the verdict takes as exact."""
    words = re.sub(r", if .* exact$", " on condition", entry["words"])
    return f"{name} {_ends(entry)} {entry['unit']}: {words}"


def _compare(record: Record) -> list[str]:
    lines = ["| Joint | Case | ln Z | Method | 2 ln B | Evidence against it |", "|---|---|---|---|---|---|"]
    for row in record["compare"]["candidates"]:
        error = f" ± {row['log_z_error']:.1g}" if row["log_z_error"] else ""
        words = "; ".join(
            [row["words"], *(f"{edge['name']} at its {edge['side']} edge" for edge in row["at_prior_edge"])]
        )
        log_z = f"{row['log_z']:.2f}".replace("-", MINUS)
        cells = (
            f"`{row['hypothesis']}`",
            f"`{row['case']}`",
            f"{log_z}{error}",
            row["method"],
            f"{row['two_log_b']:.1f}",
        )
        lines.append(f"| {' | '.join(cells)} | {words} |")
    return lines


def _made(record: Record) -> list[str]:
    e = record["environment"]
    packages = ", ".join(f"{name} {version}" for name, version in e["packages"].items())
    return [f"Runs of {e['date']}, {e['system']}, Python {e['python']}, {packages}."]


def _file(_: Record, path: str) -> list[str]:
    """Return a file of the repository in a fence, a case without the comment at its top: the page says that."""
    lines = (ROOT / path).read_text(encoding="utf-8").strip("\n").splitlines()
    suffix = path.rpartition(".")[2]
    if suffix == "toml":
        lines = lines[next(i for i, line in enumerate(lines) if line and not line.startswith("#")) :]
    return [f"```{'python' if suffix == 'py' else suffix}", *lines, "```"]


BLOCKS: dict[str, Callable[..., list[str]]] = {
    "run": _run,
    "answer": _answer,
    "python": _python,
    "check": _check,
    "identify": _identify,
    "verdicts": _verdicts,
    "intervals": _intervals,
    "freed": _freed,
    "cases": _cases,
    "compare": _compare,
    "made": _made,
    "file": _file,
    "commands": lambda _: reference_pages.command_line(),
    "terms": lambda _: reference_pages.glossary(),
}
