"""The posterior: draws, verdicts, predictions, summary, storage."""

from jointbayes.posterior.checks import PredictiveCheck
from jointbayes.posterior.diagnosis import diagnose
from jointbayes.posterior.evidence import evidence, importance_evidence, nested_evidence
from jointbayes.posterior.examination import gather_knowledge
from jointbayes.posterior.identifiability import assess
from jointbayes.posterior.knowledge import Knowledge
from jointbayes.posterior.other_structure import OtherStructure
from jointbayes.posterior.posterior import Posterior
from jointbayes.posterior.run_record import RunRecord, data_sha256, package_versions
from jointbayes.posterior.summary import summarise

__all__ = [
    "Knowledge",
    "OtherStructure",
    "Posterior",
    "PredictiveCheck",
    "RunRecord",
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
