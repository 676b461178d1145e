"""Write .ci/requirements.txt: what pip resolves now for each Python given, with the hashes of the files it takes.

python .ci/lock.py PYTHON [PYTHON ...], for instance python3.11 python3.13, on the system that the check runs on.
Nothing but pip is needed; each Python makes an environment for the time being.
"""

import json
import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
EXTRAS = "test,lint,cluster"
HEAD = """\
# Written by .ci/lock.py: every package that .ci/run installs, with the SHA-256 of the files that may be taken for it.
# Pythons: {pythons}, on {platform}. Do not edit; after a change of pyproject.toml run the script again.
"""


def resolved(python: str) -> tuple[str, dict[str, tuple[str, str]]]:
    """Version of a Python, and version and SHA-256 of each package that it would install."""
    with tempfile.TemporaryDirectory() as scratch:
        subprocess.run([python, "-m", "venv", scratch], check=True)
        inside, report = str(Path(scratch) / "bin" / "python"), Path(scratch) / "report.json"
        command = [
            inside,
            "-m",
            "pip",
            "install",
            "--dry-run",
            "--ignore-installed",
            "--quiet",
            "--report",
            str(report),
        ]
        subprocess.run([*command, f"{ROOT}[{EXTRAS}]"], check=True)
        version = subprocess.run(
            [inside, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"], capture_output=True, check=True
        )
        found = {}
        for package in json.loads(report.read_text(encoding="utf-8"))["install"]:
            name = re.sub(r"[-_.]+", "-", package["metadata"]["name"]).lower()
            if name != "jointbayes":
                digest = package["download_info"]["archive_info"]["hashes"]["sha256"]
                found[name] = package["metadata"]["version"], digest
    return version.stdout.decode().strip(), found


def text_of(each: dict[str, dict[str, tuple[str, str]]], platform: str) -> str:
    """The file: one entry for a package, or one for each Python where versions differ or one does not need it."""
    lines = [HEAD.format(pythons=", ".join(each), platform=platform)]
    for name in sorted({name for found in each.values() for name in found}):
        entries: dict[str, dict[str, set[str]]] = defaultdict(lambda: {"pythons": set(), "hashes": set()})
        for python, found in each.items():
            if name in found:
                version, digest = found[name]
                entries[version]["pythons"].add(python)
                entries[version]["hashes"].add(digest)
        for version, entry in entries.items():
            marker = ""
            if len(entry["pythons"]) < len(each):
                marker = " ; " + " or ".join(f'python_version == "{python}"' for python in sorted(entry["pythons"]))
            hashes = "".join(f" \\\n    --hash=sha256:{digest}" for digest in sorted(entry["hashes"]))
            lines.append(f"{name}=={version}{marker}{hashes}\n")
    return "".join(lines)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    text = text_of(dict(map(resolved, sys.argv[1:])), f"{sys.platform} {__import__('platform').machine()}")
    (ROOT / ".ci" / "requirements.txt").write_text(text, encoding="utf-8")
