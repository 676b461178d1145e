"""The table of a package's public names: its stub, which type checkers read as well."""

import re
from pkgutil import get_data


def homes_in_stub(package: str) -> dict[str, str]:
    """Module of each name that the stub of a package imports.

    Examples
    --------
    >>> homes_in_stub("vibrecords")["read_frf"]
    'vibrecords.formats'
    """
    stub = (get_data(package, "__init__.pyi") or b"").decode()
    return {name: home for home, name in re.findall(r"^from (\S+) import (\w+) as \2", stub, re.MULTILINE)}
