"""The posterior: draws, verdicts, predictions, summary, storage."""

from jointbayes.posterior.checks import PredictiveCheck
from jointbayes.posterior.diagnosis import Diagnosis, diagnose
from jointbayes.posterior.evidence import Evidence, evidence, importance_evidence, nested_evidence
from jointbayes.posterior.identifiability import Identifiability, assess
from jointbayes.posterior.knowledge import Knowledge, gather_knowledge
from jointbayes.posterior.modes_answer import ModesAnswer
from jointbayes.posterior.posterior import Posterior
from jointbayes.posterior.prediction import FrfPrediction, LeftOut
from jointbayes.posterior.run_record import RunRecord, data_sha256, package_versions
from jointbayes.posterior.summary import summarise
from jointbayes.sampling import WeightedDraws

__all__ = [
    "Diagnosis",
    "Evidence",
    "FrfPrediction",
    "Identifiability",
    "Knowledge",
    "ModesAnswer",
    "LeftOut",
    "Posterior",
    "PredictiveCheck",
    "RunRecord",
    "WeightedDraws",
    "assess",
    "data_sha256",
    "diagnose",
    "gather_knowledge",
    "evidence",
    "importance_evidence",
    "nested_evidence",
    "package_versions",
    "summarise",
]
