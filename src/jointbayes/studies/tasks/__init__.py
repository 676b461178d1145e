"""Many independent tasks on processes, a Dask cluster or any executor; workers may die, tasks are not lost."""

from jointbayes.studies.tasks.run import Outcome, run_tasks

__all__ = ["Outcome", "run_tasks"]
