"""What a worker does for one case: sample, judge, write one file, return one row."""

import time
from dataclasses import dataclass
from pathlib import Path

from jointbayes.code_version import code_version
from jointbayes.posterior.brief import Cell


@dataclass(frozen=True, slots=True)
class CaseWork:
    """One case as it is sent to a worker.

    Parameters
    ----------
    key
        Of the case, its name.
    text
        TOML text.
    directory
        Where its measurement files are looked for.
    seed
        Of its draws.
    file
        Posterior file to write.
    draws
        Draws to keep in it at most.
    allow_outside
        Whether its measurement files may lie outside that directory.
    full
        Whether to sample it as long as a run of its own.
    """

    key: str
    text: str
    directory: str
    seed: int
    file: str
    draws: int
    allow_outside: bool = False
    full: bool = False


def do_case(work: CaseWork) -> dict[str, Cell]:
    """Sample a case, write its posterior and return its row of the index.

    The row is of all draws, the file holds fewer. Doing it twice writes the same file twice.

    Raises
    ------
    JointBayesError
        If the case is wrong, or its file cannot be written.
    """
    from jointbayes.case.case import case_from_text
    from jointbayes.workflow import sample

    begin = time.monotonic()
    case = case_from_text(work.key, work.text, directory=work.directory, allow_outside=work.allow_outside)
    # the cases are what is spread over processes; the draws are the same
    posterior = sample(case, work.seed, settings=case.sampler.for_one_of_many(full=work.full))
    row = posterior.brief()
    posterior.with_fewer_draws(work.draws).save(Path(work.file))
    return {"seconds": time.monotonic() - begin, "code": code_version(), **row}
