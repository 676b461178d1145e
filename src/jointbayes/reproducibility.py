"""What a result depends on besides its input: the code that computed it, and the threads of the linear algebra."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.metadata import version
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

import vibrecords

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

_lock = Lock()
_inside: list[Any] = []  # the limit that the first to enter has set, once for each that is inside


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Keep BLAS to one thread in a block or a decorated function, and give it back the number that it had.

    Several threads add up a product in another order than one, and a sampler makes another walk of a last bit. The
    small matrices here gain nothing from them. The number is the process's: while one thread is inside, it is 1 for
    all, and the last to leave restores it.

    Examples
    --------
    >>> with one_blas_thread():
    ...     {library["num_threads"] for library in _controller().info() if library["user_api"] == "blas"}
    {1}
    """
    with _lock:
        _inside.append(_inside[0] if _inside else _controller().limit(limits=1, user_api="blas"))
    try:
        yield
    finally:
        with _lock:
            limit = _inside.pop()
            if not _inside:
                limit.restore_original_limits()


@cache
def _controller() -> "ThreadpoolController":
    import numpy as np  # noqa: F401  (NumPy and SciPy come with a BLAS each, which must be there to be found)
    import scipy.linalg  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@cache
def code_version() -> str:
    """Version of this package with a fingerprint of its sources and those of vibrecords, as installed on this machine.

    Two that differ in a line may compute other numbers, also under one version number.
    """
    digest = hashlib.sha256()
    for sources in (Path(__file__).parent, Path(vibrecords.__file__).parent):
        for file in sorted(sources.rglob("*.py")):
            if not file.is_file():
                continue  # the lock of an editor is a link to nothing
            digest.update(file.relative_to(sources.parent).as_posix().encode() + b"\0" + file.read_bytes())
    return f"{version('jointbayes')}+{digest.hexdigest()[:12]}"
