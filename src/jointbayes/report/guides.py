"""How to read the figures of a report, and the terms in it: ``texts/guides.toml`` and ``texts/terms.toml``."""

import re
import tomllib
from collections.abc import Collection
from functools import cache
from importlib.resources import files
from typing import Any

from jointbayes.report.model import Guide
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
