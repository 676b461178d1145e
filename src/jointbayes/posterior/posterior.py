"""The posterior: draws that are judged, summed up, and kept."""

import os
from dataclasses import asdict, replace
from typing import Any, Self

import xarray as xr

from jointbayes.posterior.brief import Cell, brief
from jointbayes.posterior.curve import Curve, curve_of
from jointbayes.posterior.information.knowledge import Knowledge
from jointbayes.posterior.storage import estimate_record, log_prior_of_joint, write_tree
from jointbayes.posterior.stored_problem import with_problem
from jointbayes.posterior.summary import Summary, summarise
from jointbayes.posterior.verdicts import JudgedPosterior
from jointbayes.reproducibility import one_blas_thread


class Posterior(JudgedPosterior):
    """Draws from the posterior of a joint's stiffnesses; built as `PosteriorDraws` is."""

    @one_blas_thread()
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

    def curve(self, name: str, probability: float = 0.95) -> Curve:
        """A quantity over the levels of the set-ups: its median and interval at each.

        Parameters
        ----------
        name
            The quantity as each set-up calls it: ``"k11"`` of ``"low.k11"`` and ``"high.k11"``.
        probability
            Inside the interval at each level.

        Raises
        ------
        ModelError
            If set-ups have no levels, or none has this quantity for itself.
        """
        return curve_of(self, name, probability)

    def brief(self) -> dict[str, Cell]:
        """One row of a table of many cases: fit, and estimate, interval and verdict of each quantity, by column.

        The same numbers as those of `summary`, in half its time; see `jointbayes.posterior.brief`.
        """
        return brief(self)

    def with_fewer_draws(self, most: int) -> Self:
        """The same posterior with at most so many draws, for a small file: equally spaced ones of every walker.

        Parameters
        ----------
        most
            Draws at most; no fewer than four of each walker are kept.
        """
        chains, draws = self.log_density.shape
        every = max(1, -(-draws // max(4, most // chains)))
        rows = {"posterior": every, "sample_stats": every, "prior": -(-self.prior_stiffness.shape[0] // most)}
        groups = {
            f"/{name}": group.to_dataset().isel(draw=slice(None, None, rows[name]))
            if name in rows
            else group.to_dataset()
            for name, group in self.tree.children.items()
        }
        return replace(self, tree=xr.DataTree.from_dict(groups))

    def save(self, path: str | os.PathLike[str], knowledge: Knowledge | None = None) -> None:
        """Write the posterior to a netCDF file, whole or not at all; `jointbayes.load_posterior` reads it.

        Its problem is kept with it, matrices, data and priors to the last bit, with the text of its case, and so is
        the prior's density at each draw.

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
        record: dict[str, Any] = {
            "record": asdict(self.record),
            "mode": {"theta": self.mode_theta.tolist(), "log_density": self.mode_log_density},
            "map": estimate_record(self.estimate),
            "knowledge": self.kept_knowledge if knowledge is None else knowledge.kept(),
            "of_case_text": self.case is not None and self.case.stated is self.problem,
        }
        tree, record["problem"] = with_problem(self.tree, self.problem)
        if self.problem.prior.marginals:
            before = log_prior_of_joint(self.problem.prior, self.theta.reshape(*self.log_density.shape, -1))
            groups = {name: node.to_dataset() for name, node in tree.children.items()}
            tree = xr.DataTree.from_dict({**groups, "log_prior": before})
        write_tree(tree, record, path)
