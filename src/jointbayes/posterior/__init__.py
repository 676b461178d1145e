"""The posterior: draws, verdicts, predictions, summary, storage."""

from jointbayes.posterior.checks import PredictiveCheck as PredictiveCheck
from jointbayes.posterior.diagnosis import diagnose as diagnose
from jointbayes.posterior.evidence import evidence as evidence
from jointbayes.posterior.evidence import nested_evidence as nested_evidence
from jointbayes.posterior.identifiability import assess as assess
from jointbayes.posterior.knowledge import Knowledge as Knowledge
from jointbayes.posterior.knowledge import UnderPremises as UnderPremises
from jointbayes.posterior.other_structure import OtherStructure as OtherStructure
from jointbayes.posterior.posterior import Posterior as Posterior
from jointbayes.posterior.posterior import gather_knowledge as gather_knowledge
from jointbayes.posterior.run_record import data_sha256 as data_sha256
from jointbayes.posterior.run_record import package_versions as package_versions
from jointbayes.posterior.sampled import RunRecord as RunRecord
from jointbayes.posterior.summary import summarise as summarise
