"""Every number in a sentence is that of its data: other data, other words; and no line is too long for a terminal."""

from dataclasses import replace

import pytest

from jointbayes.inference import Premises, UsedMode
from jointbayes.posterior.decision import premises_sentences
from jointbayes.posterior.diagnosis import Diagnosis, ModeError, PairFit
from jointbayes.posterior.identifiability import judge_by_rule
from jointbayes.posterior.model_errors import InferredError, MeshCheck
from jointbayes.posterior.sampled import RunRecord
from jointbayes.verdict_rule import RULE

RECORD = RunRecord("case", "", 1, True, "", {}, {}, {})  # type: ignore[typeddict-item]
DIAGNOSIS = Diagnosis((ModeError(100.0, 98.0, 1.2),), (PairFit("1:y", "1:y", 0.9, 1.0, False),), ())
MESH = MeshCheck("paper", 10, 1, 0.5, 0.1, {"k11": 0.2}, False, False)
ERROR = InferredError(0.01, 0.005, 0.02, 0.003)
MODES = Premises("why", None, ("length to 0.5 %",), (UsedMode("", 1, 120.0, 0.1),))


def told(steps: int, ess: float, *, converged: bool = True) -> str:
    return replace(RECORD, sampler={"steps": steps, "ess": {"k": ess, "l": 1e6}}, converged=converged).state


@pytest.mark.parametrize(
    ("one", "another", "words"),
    [
        (told(400, 2911.0), told(400, 611.0), ("Converged: 2 900 independent", "Converged: 610 independent")),
        (
            told(200, 5.0, converged=False),
            told(400, 5.0, converged=False),
            ("Not converged after 200 steps: do not use", "converged after 400 steps"),
        ),
        (
            str(judge_by_rule(RULE, 1.0, 0.31)[1]),
            str(judge_by_rule(RULE, 1.0, 0.01)[1]),
            ("removes 31 % of the prior's variance (50 % is needed)", "says nothing"),
        ),
        (
            str(judge_by_rule(RULE, 4.8, 0.9)[1]),
            str(judge_by_rule(RULE, 2.8, 0.9)[1]),
            ("a factor of 4.8 (limit 3)", "a factor of 2.8 (limit 1.25)"),
        ),
        (
            DIAGNOSIS.sentence,
            replace(DIAGNOSIS, modes=(ModeError(100.0, 97.0),), causes=("frequencies, unevenly",)).sentence,
            ("off by up to 2 %", "off by up to 3 %"),
        ),
        (DIAGNOSIS.sentence, replace(DIAGNOSIS, remedy="Look.").sentence, ("correlation is 0.9.", "is 0.9. Look.")),
        (MESH.sentence, replace(MESH, error_sd=0.7, shift_sd={"k11": 0.3}).sentence, ("than 0.5 sta", "than 0.7 sta")),
        (ERROR.words, replace(ERROR, median=0.02, high=0.03).words, ("about 1 % (up to 2 %)", "about 2 % (up to 3 %)")),
        (
            " ".join(premises_sentences(MODES, ERROR)),
            " ".join(premises_sentences(replace(MODES, reason="so", assumed=("density to 1 %",)), None)),
            ("The model misses each by about 1 %", "reason: so. Assumed, as the case does not state it: density"),
        ),
    ],
)
def test_other_data_have_other_words(one: str, another: str, words: tuple[str, str]) -> None:
    assert words[0] in one
    assert words[1] in another
    assert one != another
    assert max(map(len, (one, another))) <= 300  # of several sentences, each a line


def test_every_advice_is_a_line_of_its_own() -> None:
    causes = ("frequencies, unevenly", "frequencies, all the same way", "damping", "level", "one sensor")
    off = replace(DIAGNOSIS, causes=causes, sensor="1:y/1:y", ignores_noise=True)
    assert len(off.sentences) == 2 + len(causes)
    assert " ".join(off.sentences) == off.sentence
    assert max(map(len, off.sentences)) <= 200
