"""What commands may write over: a file that jointbayes wrote, and nothing that the command reads."""

import os
from pathlib import Path

from jointbayes.cli.output import manner, manner_option
from jointbayes.errors import CaseError
from vibrecords.errors import path_fault

force_option = manner_option("--force", "Replace a file that jointbayes did not write, too; never one that is read.")


def require_free(target: Path, option: str, *, posterior: bool = False) -> None:
    """Refuse a file to write in no directory, over what the command reads, or over what is not ours; before any work.

    Parameters
    ----------
    target
        The file to be. A link there is replaced, and what it leads to is kept; it counts as that.
    option
        Option that named it, for the message.
    posterior
        Whether it will be a posterior, which replaces posteriors alone; other files of ours replace each other.

    Raises
    ------
    CaseError
        If that is so.
    """
    if not target.absolute().parent.is_dir():
        raise CaseError(f"{target}: found no directory {target.parent}; expected one that exists; make it first")
    try:
        os.lstat(target)
    except FileNotFoundError:
        return
    except (OSError, ValueError) as error:  # too long
        words = f"found that it cannot be written ({path_fault(error)}); expected the path of a file"
        raise CaseError(f"{target}: {words}; choose another {option}") from None
    if not target.is_file():
        kind = "a directory" if target.is_dir() else "no regular file"
        raise CaseError(f"{target}: found {kind}; expected a file; choose another {option}")
    if any(_is_same(target, read) for read in manner().read):
        raise CaseError(f"{target}: found the file that is read; expected another one; choose another {option}")
    if not (manner().force or (_is_posterior if posterior else _is_ours)(target)):
        what = "a posterior" if posterior else "a file"
        raise CaseError(
            f"{target}: found a file; expected a new one, or {what} that jointbayes wrote; choose another {option}, or "
            "replace it by --force"
        )


def require_outside(directory: Path) -> None:
    """Refuse a directory to write that holds what the command reads.

    Raises
    ------
    CaseError
        If it does.
    """
    for read in manner().read:
        if directory.is_dir() and any(_is_same(directory, above) for above in Path(os.path.realpath(read)).parents):
            raise CaseError(f"{directory}: found {read.name} in it, which is read; expected another directory; choose "
                            "another --out")  # fmt: skip


def _is_same(one: Path, other: Path) -> bool:
    """Whether both lead to one file, by whatever names and links."""
    try:
        return one.samefile(other)
    except (OSError, ValueError):
        return False  # one of them is not there


def _is_ours(file: Path) -> bool:
    from vibrecords.files import OURS, WRITTEN_BY

    with file.open("rb") as stream:
        head = stream.read(200)
        stream.seek(max(0, file.stat().st_size - 200))
        tail = stream.read().rstrip().removesuffix(b"-->").rstrip()
    if head.startswith(b"%PDF"):  # it has its author among its data
        return b"<dc:creator><rdf:Seq><rdf:li>jointbayes " in file.read_bytes()
    figure = head.startswith(b"<?xml")  # SVG has no room at its beginning
    return bool(OURS.match(head)) or (figure and tail.endswith(WRITTEN_BY.encode()))


def _is_posterior(file: Path) -> bool:
    from jointbayes.posterior.storage import RECORD
    from vibrecords.formats.array_files import has_attribute

    return has_attribute(file, RECORD)
