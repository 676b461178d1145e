"""The posterior: draws that are judged, summed up, and kept."""

import os
from dataclasses import asdict
from typing import Any, Self

import numpy as np
import xarray as xr

from jointbayes.inference import Problem
from jointbayes.posterior.information.knowledge import Knowledge
from jointbayes.posterior.run_record import RunRecord
from jointbayes.posterior.storage import estimate_from, estimate_record, write_tree
from jointbayes.posterior.stored_problem import with_problem
from jointbayes.posterior.summary import Summary, summarise
from jointbayes.posterior.verdicts import JudgedPosterior

__all__ = ["Posterior"]


class Posterior(JudgedPosterior):
    """Draws from the posterior of a joint's stiffnesses; built as `PosteriorDraws` is."""

    def summary(self, knowledge: Knowledge | None = None) -> Summary:
        """The numbers of the run: `print` shows a table, ``to_json`` gives what ``summary.json`` holds.

        Parameters
        ----------
        knowledge
            What `gather_knowledge` found of it, for the section on what is identifiable; by default without.
        """
        warnings = () if self.case is None else tuple(map(str, self.case.warnings))
        guess = self.problem.first_guess.tolist()
        return summarise(self, guess, self.measured_frequencies_hz, knowledge, warnings)

    @property
    def of_case_text(self) -> bool:
        """Whether the problem is the one that the text of its case states, from which it can be built again."""
        return self.case is not None and self.case.stated is self.problem

    def save(self, path: str | os.PathLike[str], knowledge: Knowledge | None = None) -> None:
        """Write the posterior to a netCDF file, whole or not at all; `jointbayes.load_posterior` reads it.

        Of a problem that a case file states its text is kept, with data from measurement files; of any other problem
        its matrices, data and priors, to the last bit.

        Parameters
        ----------
        path
            The file.
        knowledge
            What `gather_knowledge` found, kept with the draws so that a later report need not find it again; by
            default what was kept with them already.

        Raises
        ------
        WriteError
            If the file cannot be written; an older one is then still there.
        """
        record = {
            "record": asdict(self.record),
            "mode": {"theta": self.mode_theta.tolist(), "log_density": self.mode_log_density},
            "map": estimate_record(self.estimate),
            "knowledge": self.kept_knowledge if knowledge is None else knowledge.kept(),
        }
        tree = self.tree
        if not self.of_case_text:
            tree, record["problem"] = with_problem(tree, self.problem)
        write_tree(tree, record, path)

    @classmethod
    def restored(cls, problem: Problem, tree: xr.DataTree, record: dict[str, Any]) -> Self:
        """Rebuild a posterior from its problem and what `save` wrote."""
        mode = record["mode"]
        return cls(
            problem,
            tree,
            estimate_from(record["map"]),
            np.array(mode["theta"]),
            mode["log_density"],
            RunRecord(**record["record"]),
            kept_knowledge=record.get("knowledge"),
        )
