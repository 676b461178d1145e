"""What a part of the package that reads files has to say of itself to be fuzzed."""

import random
from pathlib import Path

CORPUS = Path(__file__).parent / "corpus"


class Target:
    """A reader under attack; one instance in the module `tests.fuzz.targets.<module>`, listed there in `TARGETS`.

    `attempt` may raise nothing but errors of the package, print nothing, warn of nothing, leave no file behind in the
    temporary directory, the working directory or beside its input, and end within `seconds` of computing.
    """

    #: Of this target on the command line, and of its directory in the corpus.
    name = "target"
    #: Ending of the file that `attempt` is given.
    suffix = ""
    #: Address space of the process that attempts, bytes; what the package needs to start counts as well.
    memory = 6 * 2**30
    #: Computing time of one input, with that of the processes that it started and waited for.
    seconds = 5.0
    #: Inputs after which the process is replaced by a fresh one.
    patience = 20_000

    def corpus(self) -> list[Path]:
        """Kept files, which `tests/fuzz/test_corpus.py` attempts in every run of the tests."""
        folder = CORPUS / self.name
        return sorted(path for path in folder.iterdir() if path.is_file()) if folder.is_dir() else []

    def seeds(self) -> list[bytes]:
        """Inputs that mutations start from; by default the kept files."""
        return [path.read_bytes() for path in self.corpus()]

    def mutate(self, rng: random.Random, content: bytes) -> bytes:
        """Another input, made from one of the seeds by nothing but the generator given."""
        raise NotImplementedError

    def prepare(self, directory: Path) -> None:
        """Load what is slow to load, and put files that inputs refer to into the directory of the inputs."""

    def attempt(self, path: Path) -> None:
        """Read the file as a user would."""
        raise NotImplementedError

    def message_fault(self, message: str, path: Path) -> str:
        """What is wrong with the message of an error; empty if nothing is."""
        return default_message_fault(message, path)


def default_message_fault(message: str, path: Path) -> str:
    """A message is one line of printable text that names the file."""
    if not message.isprintable():
        return "more than one line, or characters that no terminal should be sent"
    return "" if path.name in message else "the file is not named"
