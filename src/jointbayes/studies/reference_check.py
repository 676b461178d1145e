"""The check for continuous integration: whether the posterior mode matches the published stiffnesses."""

from dataclasses import dataclass

import numpy as np

from jointbayes.case.case import AnyCase, Case, require_case
from jointbayes.errors import CaseError
from jointbayes.joint import COUPLED
from jointbayes.phrases import published_values
from jointbayes.posterior import Posterior
from jointbayes.posterior.posterior import region_level
from jointbayes.posterior.verdicts import mode_agrees, mode_distance
from jointbayes.reproducibility import one_blas_thread
from jointbayes.rounding import signed

#: Largest relative difference of mode and reference where the data are exact.
EXACT_TOLERANCE = 0.005
#: Largest relative difference of k22 where they are noisy.
NOISY_TOLERANCE_K22 = 0.02
#: Highest-density region that must hold the reference where they are noisy.
REGION = 0.99


@dataclass(frozen=True, slots=True)
class CheckLine:
    """One comparison: what was compared, found and expected.

    Parameters
    ----------
    subject, found, expected
        In words, with units.
    matches
        Whether found is as expected; None where the line informs only, because nothing is asked of it.
    """

    subject: str
    found: str
    expected: str
    matches: bool | None


@dataclass(frozen=True, slots=True)
class CheckResult:
    """All comparisons of a check."""

    lines: tuple[CheckLine, ...]

    @property
    def matches(self) -> bool:
        """Whether every line that is judged matches."""
        return all(line.matches is None or line.matches for line in self.lines)


def require_reference(case: Case) -> np.ndarray:
    """Return the published stiffnesses of the case, shape (q,).

    Raises
    ------
    CaseError
        If the case names none.
    """
    if case.reference is None:
        raise CaseError(
            f"{case.name}: found no [reference] table; expected published stiffnesses to compare with; add the table"
        )
    return case.reference


@one_blas_thread()
def check_posterior(case: AnyCase, posterior: Posterior) -> CheckResult:
    """Compare the posterior mode with the case's reference.

    Exact data: every stiffness within 0.5 %. Noisy data: the reference inside the joint 99 % highest-density region.
    Of one coupled pair k22 also within 2 %, while k11 and k12, which one noisy FRF does not pin down, are stated only;
    of other joints each published stiffness inside its own 95 % interval. In any case the run must have converged and
    mode and MAP agree.

    Raises
    ------
    CaseError
        If the case has no reference.
    """
    case = require_case(case)
    reference = require_reference(case)
    apart = f"{mode_distance(posterior):.1e} sd apart"
    lines = [
        CheckLine("sampler", posterior.record.state.rstrip("."), "converged", posterior.converged),
        CheckLine("mode against MAP", apart, "the same point", mode_agrees(posterior)),
    ]
    exact = case.spec.data.kind == "synthetic_frf" and not case.spec.data.noise.added
    lines += [_of_quantity(posterior, i, published, exact) for i, published in enumerate(reference)]
    if not exact:
        level = region_level(posterior, reference)
        found = published_values(level, REGION)
        lines.append(CheckLine("published values", found, f"at most {100 * REGION:g} %", level <= REGION))
    return CheckResult(tuple(lines))


def _of_quantity(posterior: Posterior, index: int, published: float, exact: bool) -> CheckLine:
    quantities = posterior.problem.quantities
    name, unit = quantities[index].name, quantities[index].unit
    mode = posterior.mode[name]
    difference = mode / published - 1 if published else np.inf
    found = f"{mode:.4g} {unit} ({signed(100 * difference)} %)"
    if quantities != COUPLED and not exact:
        low, high = posterior.interval(name)
        found = f"95 % interval {low:.4g} to {high:.4g} {unit}, mode {mode:.4g}"
        return CheckLine(name, found, f"{published:.4g} {unit} inside", bool(low <= published <= high))
    # one noisy FRF pins down the last one alone
    limit = EXACT_TOLERANCE if exact else NOISY_TOLERANCE_K22 if index == len(quantities) - 1 else None
    expected = f"{published:.4g} {unit}" + ("" if limit is None else f" within {100 * limit:g} %")
    return CheckLine(f"mode of {name}", found, expected, None if limit is None else bool(abs(difference) <= limit))
