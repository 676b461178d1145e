"""The paper's beam and joint, and the cases of the repository."""

import fcntl
import os
import pickle
import re
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner, Result
from hypothesis import HealthCheck, settings
from numpy.typing import ArrayLike

from jointbayes.case import case
from jointbayes.case.case import Case, case_from_text
from jointbayes.case.case_text import read_case_text, without_key
from jointbayes.case.toml_text import toml_text
from jointbayes.cli.commands import main
from jointbayes.cli.common import FAULT_OF_THE_PROGRAM
from jointbayes.frf import AnyStructure
from jointbayes.identification import MapEstimate, ModeSearch
from jointbayes.inference import Likelihood, LogPosterior, Problem, Test, likelihood_of
from jointbayes.joint import AnyJoint, Joint, LogStiffness
from jointbayes.posterior import Posterior, gather_knowledge, knowledge
from jointbayes.posterior import posterior as posterior_module
from jointbayes.posterior.storage import imported_arviz
from jointbayes.report import ReportInputs, drawing, run_directory
from jointbayes.sampling import SamplerSettings, proposal
from jointbayes.structure import BeamMaterial, DampingLaw, ModalDamping, Section, Structure, beam
from jointbayes.verdict_rule import VerdictRule
from jointbayes.workflow import sample
from tests.cost import Cost
from tests.marks import first_in_ci as first_in_ci
from vibrecords import Data

# A shell's background job ignores interrupts, and whatever it starts would: the tests that send one could not see it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:  # under nohup
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

imported_arviz()  # before the tests do: at the first import of a day two processes may be in each other's way

# Hypothesis would fail an example that takes 0.2 s on the clock, which on a busy machine any does.
settings.register_profile("no clock", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("no clock")


def pytest_configure(config: pytest.Config) -> None:
    """Measure what the tests cost."""
    config.pluginmanager.register(Cost())


Made = TypeVar("Made")

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
STEEL = BeamMaterial(2.1e11, 0.3, 7800.0)  # Table 1
TABLE_3 = np.array([5.05e9, 3.44e7, 1.52e6])
CLAMP = Joint(("1:y", "1:rz"))
#: The paper's joint, and its K^J of (k11, k12, k22).
PAIR = LogStiffness()


def pair_matrix(stiffness):
    """K^J of joints without damping, shape (..., 2, 2)."""
    return PAIR.matrix(stiffness).stiffness


#: A run that ends without having converged, in half a second.
FEW_STEPS = SamplerSettings(walkers=16, max_steps=200)
#: Enough for a cheap case to converge, the ends of its intervals less well known than by default.
TO_CONVERGE = SamplerSettings(walkers=16, max_steps=1500, tau_factor=20, end_tolerance=0.05)


@dataclass(frozen=True)
class StatedCase:
    """What a report says of a case besides its posterior, as a test states it; nothing else is uncertain in it."""

    title: str = "Clamp"
    about: Mapping[str, str] = field(default_factory=dict)
    stated: Problem | None = None
    reference: np.ndarray | None = None
    reference_source: str = ""
    measured_frequencies_hz: tuple[float, ...] | None = None
    workshop_problem: Problem | None = None
    default_priors: frozenset[str] = frozenset()
    verdict_rules: Mapping[str, VerdictRule] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def freed_problem(self) -> Problem | None:
        return self.workshop_problem


def of_case(posterior: Posterior, **stated: object) -> Posterior:
    """The posterior as one of a case that states this."""
    return replace(posterior, case=StatedCase(**({"stated": posterior.problem} | stated)))  # type: ignore[arg-type]


def unsettled(
    posterior: Posterior, reason: str = "not converged after 200 steps (limit 200): τ is not known", apart: float = 1.0
) -> Posterior:
    """The posterior as one of a run that did not converge, the last ensemble at joints so many times as stiff."""
    tree = posterior.tree.copy()
    draws = tree["posterior"].to_dataset()
    factor = xr.where(draws["ensemble"] == draws["ensemble"].max(), apart, 1.0)
    stiffer = {name: draws[name] * factor for name in posterior.stiffness_names} if apart != 1.0 else {}
    tree["posterior"] = xr.DataTree(draws.assign({n: k.assign_attrs(draws[n].attrs) for n, k in stiffer.items()}))
    return replace(posterior, tree=tree, record=replace(posterior.record, converged=False, reason=reason))


def rod(length: float = 0.383, damping: DampingLaw | None = None, **stated: Any) -> Structure:
    """Table 1's rod, free."""
    return beam(length, Section.circle(0.025), STEEL, damping or ModalDamping((0.01,)), **stated)


def lone_likelihood(structure: AnyStructure, joint: AnyJoint, data: Data, **stated: object) -> Likelihood:
    """Likelihood of the data of one test without a name."""
    return likelihood_of(data, Test("", structure, joint, data, **stated))  # type: ignore[arg-type]


def shipped_text(name: str) -> str:
    """Text of a case of the repository, whole: with that of the cases it builds on."""
    return read_case_text(CONFIGS / f"{name}.toml").text


def cli(*arguments: object) -> Result:
    """What a command leaves, run in this process; whatever it was given, it ends by an exit status."""
    result = CliRunner().invoke(main, [str(a) for a in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), repr(result.exception)
    assert result.exit_code != FAULT_OF_THE_PROGRAM, result.output
    assert "Traceback" not in result.output or "JOINTBAYES_DEBUG" in os.environ
    return result


def without_stages(told: str) -> list[str]:
    """Lines of standard error but for those that say what a command is at, which begin with the seconds."""
    return [line for line in told.splitlines() if not re.match(r" *\d+\.\d s  ", line)]


@contextmanager
def plain_reports() -> Iterator[None]:
    """Reports with blank figures, without profiles, freed inputs and doubts of numbers.

    A third of the price and less: for claims about none of these.
    """
    blank = '<svg xmlns="http://www.w3.org/2000/svg" width="72pt" height="36pt"/>'
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawing, "svg", lambda *_: blank)
        patch.setattr(posterior_module, "profiles_of", lambda *_: ())
        patch.setattr(case, "find_numbering", lambda *_: None)
        # not kept with a posterior that other tests share: what they ask of it is whole
        for module in (posterior_module, knowledge, run_directory):
            patch.setattr(module, "rows_of", knowledge.effect_of_uncertain_inputs)
        patch.setattr(knowledge, "exact_inputs_of", lambda _: {})
        yield


_PRINTED = np.get_printoptions()


@pytest.fixture(autouse=True)
def _print_as_before() -> Iterator[None]:
    """With NumPy's way to print arrays as it was: pyyeti, which some tests load, changes it for all that follow."""
    with np.printoptions(**_PRINTED):
        yield


@pytest.fixture(name="plain_reports")
def _plain_reports() -> Iterator[None]:
    with plain_reports():
        yield


@pytest.fixture(name="rough_proposals")
def _rough_proposals() -> Iterator[None]:
    """Runs whose proposal is fitted in one round: half the price of few steps, for claims about none of their draws."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(proposal, "_ROUNDS", 1)
        yield


def judged_as(again: Posterior, posterior: Posterior) -> Posterior:
    """A posterior with what was already found of another one of the same draws: its ends are not searched again."""
    own = {key for key in posterior._found if key[0] in ("judge_stiffness", "weighed_joints", "directions_of")}
    again._found.update({key: posterior._found[key] for key in posterior._found.keys() - again._found.keys() - own})
    vars(again).update({name: found for name, found in vars(posterior).items() if name not in vars(again)})
    return again


@pytest.fixture(scope="session")
def configs() -> Path:
    return CONFIGS


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Callable[[str, Callable[[], Made]], Made]:
    """Makes something that takes seconds in the first process that asks for it; the others read it."""

    def made_once(name: str, make: Callable[[], Made]) -> Made:
        if worker_id == "master":
            return make()
        kept = tmp_path_factory.getbasetemp().parent / f"{name}.pickle"
        with kept.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not kept.exists():
                kept.write_bytes(pickle.dumps(make()))
            return pickle.loads(kept.read_bytes())

    return made_once


def best_of(
    log_posterior: LogPosterior, starts: Mapping[str, ArrayLike], screened: Sequence[ArrayLike] = ()
) -> MapEstimate:
    """The mode that climbs from these joints (k11, k12, k22), and then from further points θ, lead to."""
    search = ModeSearch(log_posterior)
    search.climb_stiffnesses(starts)
    search.climb({f"screened draw {i}": np.asarray(theta) for i, theta in enumerate(screened, 1)})
    return search.estimate()


def on_one_line(shown):
    """What `print` shows of an object, on one line."""
    return " ".join(str(shown).split())


def edited(text: str, *changes: tuple[str, str]) -> str:
    """The text with the first occurrence of each old string, which must be there, replaced by the new one."""
    for old, new in changes:
        assert old in text, f"{old!r} is not in the text"
        text = text.replace(old, new, 1)
    return text


def shipped_without(name: str, *keys: str) -> str:
    """The text of a shipped case without some keys or tables, ``"joints.taper.prior"``."""
    data = read_case_text(CONFIGS / f"{name}.toml").data
    for key in keys:
        data = without_key(data, tuple(key.split(".")))
    return toml_text(data)


def on_paper_elements(name: str) -> Case:
    """A shipped case on ten of the paper's elements, with which figures known from elsewhere were computed."""
    text = shipped_text(name)
    return case_from_text(name, edited(text, ("elements = 10", 'elements = 10\nelement = "paper"')))


def cheap_text() -> str:
    """The repository's FRF case made small: five nodes, 249 lines, less noise; one verdict of each kind."""
    return edited(
        (CONFIGS / "clamped_beam.toml").read_text(encoding="utf-8"),
        ("elements = 10", "elements = 4"),
        ('outputs = ["11:y"]', 'outputs = ["5:y"]'),
        ('inputs = ["11:y"]', 'inputs = ["5:y"]'),
        ("f_step_hz = 1.0", "f_step_hz = 10.0"),
        ("relative = 0.03", "relative = 0.008"),
        ("floor = 0.01", "floor = 0.0016"),
        ("walkers = 48", "walkers = 8"),
    )


def cheap_frequencies_text() -> str:
    """The repository's natural-frequency case at 360 mm made small."""
    text = shipped_text("clamped_beam_frequencies_360mm")
    return edited(text, ("elements = 10", "elements = 4"), ("walkers = 48", "walkers = 8"))


@pytest.fixture(scope="session")
def cheap_case() -> Case:
    return case_from_text("cheap", cheap_text())


@pytest.fixture(scope="session")
def frequency_case() -> Case:
    return case_from_text("frequencies", cheap_frequencies_text())


@pytest.fixture(scope="session")
def cheap_posterior(cheap_case: Case) -> Posterior:
    """A converged FRF posterior of a few seconds; nobody may change it."""
    settings = SamplerSettings(walkers=16, max_steps=1500, tau_factor=20, end_tolerance=0.03)
    return sample(cheap_case, seed=1, settings=settings)


@pytest.fixture(scope="session")
def cheap_inputs(cheap_case: Case, cheap_posterior: Posterior) -> ReportInputs:
    """What its report is written from, with the effect of usual uncertainties; nobody may change it."""
    gather_knowledge(cheap_posterior)  # found once, for the posterior by itself too
    stated = of_case(cheap_posterior, workshop_problem=cheap_case.workshop_problem)
    return ReportInputs(judged_as(stated, cheap_posterior))


@pytest.fixture(scope="session")
def frequency_posterior(frequency_case: Case) -> Posterior:
    """A natural-frequency posterior in which k12 has both signs; nobody may change it."""
    settings = SamplerSettings(walkers=8, max_steps=8000, tau_factor=10, r_hat_max=1.1, end_tolerance=0.1)
    return sample(frequency_case, seed=1, settings=settings)
