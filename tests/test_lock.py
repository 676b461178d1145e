"""Dependencies are bounded, and what the check installs by hash lies within the bounds."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

pytestmark = pytest.mark.docs

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
LOCKED = (ROOT / ".ci" / "requirements.txt").read_text(encoding="utf-8")


@pytest.mark.parametrize("extra", ["", *EXTRAS])
def test_every_dependency_has_a_lower_and_an_upper_bound(extra):
    for one in EXTRAS[extra] if extra else PROJECT["dependencies"]:
        kinds = {part.operator for part in Requirement(one).specifier}
        assert kinds == {"=="} or kinds == {">=", "<"}, one


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
def test_the_lock_has_every_dependency_within_its_bounds(python):
    locked = {}
    for line in re.sub(r" \\\n +--hash=sha256:[0-9a-f]{64}", "", LOCKED).splitlines():
        if line.startswith("#"):
            continue
        entry = Requirement(line)
        if entry.marker is None or entry.marker.evaluate({"python_version": python}):
            (version,) = entry.specifier
            locked[canonicalize_name(entry.name)] = version.version
    for one in [*PROJECT["dependencies"], *(one for extra in ("test", "lint", "cluster") for one in EXTRAS[extra])]:
        wanted = Requirement(one)
        assert wanted.specifier.contains(locked[canonicalize_name(wanted.name)]), one


def test_every_locked_package_has_a_hash():
    entries = [part for part in re.split(r"\n(?=[a-z])", LOCKED) if not part.startswith("#")]
    assert len(entries) > 50
    assert all("--hash=sha256:" in entry for entry in entries)
