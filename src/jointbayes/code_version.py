"""Which code computed a result: the version of this package, and a fingerprint of its sources as they are installed."""

import hashlib
from functools import cache
from importlib.metadata import version
from pathlib import Path


@cache
def code_version() -> str:
    """Version of this package with a fingerprint of its sources as they are installed on this machine.

    Two that differ in a line may compute other numbers, whatever number they call themselves.
    """
    sources, digest = Path(__file__).parent, hashlib.sha256()
    for file in sorted(sources.rglob("*.py")):
        if not file.is_file():
            continue  # the lock of an editor is a link to nothing
        digest.update(file.relative_to(sources).as_posix().encode() + b"\0" + file.read_bytes())
    return f"{version('jointbayes')}+{digest.hexdigest()[:12]}"
