"""Sentences as they are kept: other data, other words, and no line is too long for a terminal.

`GOLDEN=update pytest -n 0 tests/posterior/test_sentences.py` keeps what they say now; read the diff.
"""

from dataclasses import replace
from math import log
from pathlib import Path
from types import SimpleNamespace

from jointbayes.identification.map_estimate import SearchEffort
from jointbayes.inference import Premises, UsedMode
from jointbayes.posterior.compared_frfs import ComparedFrf, sentences_of_faults
from jointbayes.posterior.decision import premises_sentences
from jointbayes.posterior.diagnosis import Diagnosis, ModeError, PairFit
from jointbayes.posterior.identifiability import ExactInputs, Verdict, judge_by_rule
from jointbayes.posterior.knowledge import SimplerJoint, UncertainInputsRow, effect_sentence, exclusion_sentences
from jointbayes.posterior.model_errors import InferredError, MeshCheck
from jointbayes.posterior.sampled import RunRecord
from jointbayes.posterior.what_decides import WhatDecides
from jointbayes.studies.compare import Comparison, PriorEdge
from jointbayes.studies.predict import joint_sentences
from jointbayes.studies.same import Change, JointChange
from jointbayes.verdict_rule import RULE
from tests.golden import require_lines
from tests.studies.test_comparison import made_up, of
from tests.studies.test_same import UNCHANGED

RECORD = RunRecord("case", "", 1, True, "", {}, {}, {})  # type: ignore[typeddict-item]
DIAGNOSIS = Diagnosis((ModeError(100.0, 98.0, 1.2),), (PairFit("1:y", "1:y", 0.9, 1.0, False),), ())
EFFORT = SearchEffort(squares=20.0, limit=1.2, starts=40, agreeing=17, rounds=1)
MESH = MeshCheck("paper", 10, 1, 0.5, 0.1, {"k11": 0.2}, False, False)
ERROR = InferredError(0.01, 0.005, 0.02, 0.003)
MODES = Premises("why", None, ("length to 0.5 %",), (UsedMode("", 1, 120.0, 0.1),))
LOOSER, UNKNOWN = Change("k22", "1", -0.062, -0.079, -0.044, 0.0), Change("k11", "1", 0.2, -0.9, 9.0, 0.5)
COUPLING, EFFECT = (
    Change("k12", "N", 1200.0, -300.0, 2700.0, 0.9),
    Change("natural frequency 1", "1", 0, -1e-4, 2e-4, 0.5),
)
LABELS = {"short": "length 360 mm", "long": "length 383 mm"}
JOINTS = of("a", -10.0, "springs"), of("a", -10.5, "full"), of("a", -60.0, "rigid"), of("a", -12.0, "rotation")


def told(steps, ess, *, converged=True):
    return replace(RECORD, sampler={"steps": steps, "ess": {"k": ess, "l": 1e6}}, converged=converged).state


def frf(output, faults=(), level=1.0, correlation=1.0):
    return ComparedFrf(output, "11:y", level, correlation, faults)


def known(low, high, cls="identified", **more):
    return Verdict(cls, (low, high), (low * high) ** 0.5, "N/m", **more)


def effect(freed, uncertain=("youngs_modulus", "length"), **exact):
    """The sentence on stiffnesses that are known so with inputs exact, and otherwise with them uncertain."""
    rows = [UncertainInputsRow((), "this run", exact), UncertainInputsRow(uncertain, "this run", exact | freed)]
    assert effect_sentence(rows) == effect_sentence(rows[::-1])
    return effect_sentence(rows)


def changed(*stiffness, two_log_b, together=None):
    return JointChange(stiffness, together, two_log_b, ("Assumed: all.",), True, "").lines


def of_prediction():
    exact = ExactInputs(("length", "density"), None, looked_at=False)
    known_so = {
        "k11": Verdict("not identified", (1.0, 9.0), 3.0, "N/m"),
        "k12": Verdict("weakly identified", (1.0, 2.0), 1.5, "N", exact=exact),
        "k22": Verdict("identified", (1.0, 1.1), 1.05, "N·m/rad", exact=exact),
    }
    needs, loose = joint_sentences(SimpleNamespace(stiffness_names=tuple(known_so), verdict=known_so.get))
    return needs, loose


def two_cases(low, **more):
    return Comparison((of("long", low), of("short", -10.0)), 1, "", **more).finding


#: What is said by each function that composes sentences, of data that differ in what they are to say.
SAID = {
    "a run": [told(400, 2911.0), told(400, 611.0), *(told(steps, 5.0, converged=False) for steps in (200, 400))],
    "rule": [str(judge_by_rule(RULE, *given)[1]) for given in ((1.0, 0.31), (1.0, 0.01), (4.8, 0.9), (2.8, 0.9))],
    "search": [
        replace(EFFORT, **more).sentence for more in (
            {}, {"squares": 9.0, "starts": 50}, {"agreeing": 1}, {"last_gain": 5.0}, {"squares": 1.1},
            {"agreeing": 2, "rounds": 3, "gain": 812.3, "last_gain": 0.1},
        )
    ],
    "diagnosis": [
        DIAGNOSIS.sentence, replace(DIAGNOSIS, remedy="Look.").sentence,
        replace(DIAGNOSIS, modes=(ModeError(100.0, 97.0),), causes=("frequencies, unevenly",)).sentence,
    ],
    "mesh": [MESH.sentence, replace(MESH, error_sd=0.7, shift_sd={"k11": 0.3}).sentence],
    "error of the model": [ERROR.words, replace(ERROR, median=0.02, high=0.03).words],
    "premises": [
        *premises_sentences(MODES, ERROR),
        *premises_sentences(replace(MODES, reason="so", assumed=("density to 1 %",)), None),
    ],
    "simpler joints": [
        *exclusion_sentences(
            (SimplerJoint("a", "rigid", 30.0), SimplerJoint("b", "rigid", 3.0), SimplerJoint("b", "absent", -3.0))
        ),
        *exclusion_sentences((SimplerJoint("", "rigid", 2 * log(3e4)),)),
        *exclusion_sentences((SimplerJoint("", "rigid", 2 * log(3.0)),)),
        *exclusion_sentences(()),
    ],
    "FRFs": [
        *sentences_of_faults([]), *sentences_of_faults([frf("1:y"), frf("2:y")]),
        *sentences_of_faults([frf("1:y", ("level",), 4.591), frf("2:y")]),
        *sentences_of_faults([frf("1:y", ("sign", "level"), 0.1023, -0.98)], "long"),
        *sentences_of_faults([frf("1:y", ("level",), 1000.0), frf("2:y", ("level",), 1200.0)]),
        *sentences_of_faults([frf("1:y", ("level",), 2.0), frf("2:y", ("level",), 4.0)]),
        *sentences_of_faults([frf(f"{i}:y", ("shape",), 1.0, 0.5) for i in range(1, 6)]),
    ],
    "inputs, one at a time": [
        WhatDecides({"k": 0.01}, alone, {"k": 0.2}).sentence
        for alone in ({"density": {"k": 0.1}, "length": {"k": 0.0109}}, {"density": {"k": 0.0109}})
    ],
    "inputs as in a workshop": [
        effect({"k": known(1.0, 9.0, "not identified")}, k=known(1.0, 1.02)),
        effect({"k": known(1.01, 1.02)}, ("youngs_modulus",), k=known(1.0, 1.02)),
        effect({"k": known(0.5, 2.0, "weakly identified")}, ("length",), k=known(0.8, 1.2)),
        effect({"k": known(0.5, 2.0)}, ("length",), k=known(0.8, 1.2)),
    ],
    "a prediction": of_prediction(),
    "the same joint": [
        *changed(UNCHANGED, COUPLING, UNKNOWN, two_log_b=-19.0, together=EFFECT), *changed(LOOSER, two_log_b=30.0),
        *changed(UNCHANGED, two_log_b=6.1), *changed(LOOSER, two_log_b=5.9), *changed(LOOSER, two_log_b=-1.9),
        *changed(LOOSER, two_log_b=1.9),
    ],
    "a comparison": [
        two_cases(-20.0, labels=LABELS), two_cases(-40.0), two_cases(-10.5, labels=LABELS),
        Comparison((made_up(-10.0, at_edge=(PriorEdge("k22", "high", 0.4),)),), 1, "").finding,
        *Comparison(JOINTS, 1, "").sentences, *Comparison(JOINTS[1:], 1, "").sentences,
    ],
}  # fmt: skip


def test_sentences_are_as_they_are_kept():
    require_lines(
        Path(__file__).parent / "sentences.txt", [line for of, said in SAID.items() for line in (f"# {of}", *said)]
    )
    assert max(len(line) for said in SAID.values() for line in said) <= 300  # of several sentences, each a line
    assert max(len(text) for text in SAID["search"]) <= 200


def test_every_advice_is_a_line_of_its_own():
    causes = ("frequencies, unevenly", "frequencies, all the same way", "damping", "level", "one sensor")
    off = replace(DIAGNOSIS, causes=causes, sensor="1:y/1:y", ignores_noise=True)
    assert len(off.sentences) == 2 + len(causes)
    assert " ".join(off.sentences) == off.sentence
    assert max(map(len, off.sentences)) <= 200
