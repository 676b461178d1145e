"""How the numbers of a report came about, in the words of ``texts/methods.toml``, what to cite for it, and its terms.

A text cites what ran by names in square brackets; exactly those are written as BibTeX to a file next to the report.
How to read the figures, and the terms, stand in ``texts/guides.toml`` and ``texts/terms.toml``.
"""

import math
import re
import tomllib
from collections.abc import Collection, Iterable
from functools import cache
from importlib.resources import files
from typing import Any

from jointbayes.phrases import listed
from jointbayes.posterior import Posterior
from jointbayes.posterior.checks import checks_of
from jointbayes.posterior.model_errors import MeshCheck
from jointbayes.posterior.verdicts import rule_of
from jointbayes.report.inputs import ReportInputs, TestInputs
from jointbayes.report.markup import foreign, readable
from jointbayes.report.model import Guide, Paragraph, ReportSection, Table
from jointbayes.reproducibility import code_version
from jointbayes.rounding import interval, join_unit
from jointbayes.sampling import SamplerSettings
from jointbayes.verdict_rule import RULE, VerdictRule


@cache
def packaged(name: str) -> dict[str, Any]:
    """A TOML file of the package's texts."""
    return tomllib.loads(files("jointbayes.report").joinpath("texts", name).read_text(encoding="utf-8"))


def guide_of(identifier: str) -> Guide | None:
    """How to read the figure with this identifier, by the longest beginning that has a guide; None without any."""
    own = re.sub(r"^test-\d+-", "", identifier)
    named = max((name for name in packaged("guides.toml") if own.startswith(name)), key=len, default=None)
    return None if named is None else Guide(**packaged("guides.toml")[named])


def terms(rules: Collection[VerdictRule] = (RULE,)) -> dict[str, str]:
    """Meaning of each term, in the order in which they are printed; `rules` are those of a run's stiffnesses."""
    each = {"identified": {rule.identified for rule in rules}, "weak": {rule.weakly_identified for rule in rules}}
    limits = {name: " or ".join(f"{limit:g}" for limit in sorted(some)) for name, some in each.items()}
    limits["r_hat"] = f"{SamplerSettings().r_hat_max:g}"
    return {term: meaning.format(**limits) for term, meaning in packaged("terms.toml").items()}


def report_text(key: str, **values: object) -> str:
    """A text of a report with its values."""
    return str(packaged("methods.toml")["text"][key].format(**values))


def references(*texts: str) -> str:
    """BibTeX of all that texts cite, in their order; empty where they cite nothing."""
    source = files("jointbayes.report").joinpath("texts", "references.bib").read_text(encoding="utf-8")
    entries = {entry.split("{", 1)[1].split(",", 1)[0]: entry for entry in source.strip().split("\n\n")}
    cited = re.findall(r"\w+", " ".join(re.findall(r"\[([\w, ]+)\]", " ".join(texts))))
    text = "\n\n".join(entries[key] for key in dict.fromkeys(cited) if key in entries)
    return text and text.replace("VERSION", code_version()) + "\n"


def methods_text(inputs: ReportInputs) -> str:
    """One paragraph on what ran, from model and data to the seed, with what to cite in square brackets."""
    posterior, summary, knowledge = inputs.posterior, inputs.summary, inputs.knowledge
    say, record, estimate = packaged("methods.toml")["run"], posterior.record, posterior.estimate
    told = [text for test in inputs.tests for text in _model_and_data(test, summary.mesh)]
    axes = zip(posterior.problem.parametrisation.axes, posterior.problem.prior.marginals, strict=True)
    priors = ", ".join(f"{_words(law)} in {axis.label}" for axis, law in axes)
    of_joint = [(name, p.prior_interval95, p.unit) for name, p in summary.parameters.items()]
    told.append(say["priors"].format(priors, _ranges(of_joint, 2)))
    others = [(readable(name), n.prior_interval95, n.unit) for name, n in summary.nuisances.items()]
    told.append(say["uncertain"].format(_ranges(others, 4)) if others else say["exact"])
    iteration = say["iteration"] if estimate.iteration is not None else ""
    reached = len(estimate.starts) - len(estimate.failed_starts)
    told.append(say["search"].format(len(estimate.starts), iteration, reached))
    moves = dict.fromkeys(name.partition(",")[0] for name in record.sampler["move_acceptance"])
    figures = record.sampler | {"ess": min(record.sampler["ess"].values()), "draws": posterior.theta.shape[0]}
    how = say["sampler" if moves else "importance"]
    told.append(how.format(**figures | {"moves": ", ".join(say.get(move, move) for move in moves)}))
    told.append(say["stop"].format(record.reason))
    told += [say["check"].format(check.sentence) for check in checks_of(posterior)]
    ran = {
        "whiteness": any(check.whiteness is not None for check in checks_of(posterior)),
        "likelihood": any(math.isfinite(p.known.limit) for p in summary.parameters.values()),
        "profiles": knowledge.profiles,
        "simpler": knowledge.weighed,
    }
    told += [say[name] for name, happened in ran.items() if happened]
    rules = rules_of(posterior)
    told += [f"{f'{listed(names)}: ' if len(rules) > 1 else ''}{rule}." for rule, names in rules.items()]
    told += [say["software"].format(**record.versions, seed=record.seed, data=summary.data_sha256)]
    return foreign(" ".join(told))


def _model_and_data(inputs: TestInputs, mesh: MeshCheck | None) -> Iterable[str]:
    """What was modelled, measured and assumed of the noise in one test."""
    test, say = inputs.problem.test, packaged("methods.toml")["run"]
    body, name = test.structures, f"{test.name}: " if test.name else ""
    cut = say["matrices"]
    if mesh:
        how = say["reduced" if mesh.kind == "reduced" else "elements"]
        cut = how.format(**{key: getattr(mesh, key) for key in mesh.__slots__})
    yield say["structure"].format(name, _words(body), _words(body.damping), cut, test.joints)
    if test.measured_bodies:
        counts = say["ignored" if test.ignores_noise_of_bodies else "counts"]
        yield say["measured"].format(", ".join(measured.name for measured in test.measured_bodies), counts)
    synthetic = say["synthetic"] if test.data.synthetic else ""
    yield say["data"].format(name, test.data.in_short(), synthetic, inputs.summary.fit.n_data, _words(test.noise))


def _words(part: object) -> str:
    """What a part of the problem is, by its class; of a class of one's own its name."""
    name = type(part).__name__
    return str(packaged("methods.toml")["words"].get(name, name))


def _ranges(quantities: Iterable[tuple[str, tuple[float, float], str]], digits: int) -> str:
    return ", ".join(f"{name} ({join_unit(interval(ends, digits), unit)})" for name, ends, unit in quantities)


def methods_section(inputs: ReportInputs) -> ReportSection:
    """A paragraph to paste into a paper; what it cites is in a file of the run directory."""
    return ReportSection("methods", "Methods", (Paragraph(methods_text(inputs)),), appendix=True)


def rules_of(posterior: Posterior) -> dict[VerdictRule, list[str]]:
    """Stiffnesses by the thresholds that they are judged by."""
    rules: dict[VerdictRule, list[str]] = {}
    for name in posterior.stiffness_names:
        rules.setdefault(rule_of(posterior, name), []).append(name)
    return rules


def terms_section(text: str, rules: Collection[VerdictRule] = (RULE,)) -> ReportSection:
    """Explain the terms that a report's text contains; `rules` are the verdict rules of its stiffnesses."""
    used = tuple(row for row in terms(rules).items() if any(term in text for term in row[0].split(", ")))
    table = Table("Terms", ("Term", "Meaning"), used, align="ll")
    return ReportSection("terms", "Terms", (table,), appendix=True)
