"""What `docs/developing.md` says of adding a thing is carried out on a copy of the package, and the thing is used."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import jointbayes
import vibrecords
from tests.case.refusal_rows import parts_named
from tests.conftest import cheap_text
from tests.pages import text_of

pytestmark = pytest.mark.docs

PAGE = text_of("developing.md")
SCRIPTS = parts_named("worked_examples")
HEAD = f"import re\nimport jointbayes as jb\ntext = {cheap_text().replace('max_steps = 20000', 'max_steps = 200')!r}\n"


def blocks(heading):
    """Kind, file and text of each block of code below a heading."""
    (section,) = re.findall(rf"^### {heading}\n(.*?)(?=^##)", PAGE, re.MULTILINE | re.DOTALL)
    return re.findall(r'^```(python|diff) title="src/([^"]+)"\n(.*?)^```', section, re.MULTILINE | re.DOTALL)


def edits(text):
    """What stands in a file and what is to stand there, for each run of lines that begin with - and then +."""
    for old, new in re.findall(r"((?:^-.*\n)+)((?:^\+.*\n)+)", text, re.MULTILINE):
        yield tuple(re.sub(r"^[-+]", "", lines, flags=re.MULTILINE) for lines in (old, new))


@pytest.fixture
def carried_out(tmp_path):
    """Carries out what stands below a heading on a copy of the packages, in which a script is then run."""

    def carry_out(heading, script):
        for package in (jointbayes, vibrecords):
            shutil.copytree(
                Path(package.__file__).parent, tmp_path / package.__name__, ignore=shutil.ignore_patterns("*.pyc")
            )
        written = blocks(heading)
        assert {kind for kind, _, _ in written} == {"python", "diff"} or heading == "A shape of cross-section"
        for kind, name, text in written:
            path = tmp_path / name
            if kind == "python":
                assert not path.exists()
                path.write_text(text, encoding="utf-8")
                continue
            changed = path.read_text(encoding="utf-8")
            for old, new in edits(text):
                assert changed.count(old) == 1, old
                changed = changed.replace(old, new)
            path.write_text(changed, encoding="utf-8")
        done = subprocess.run(
            [sys.executable, "-c", f"{HEAD}assert {str(tmp_path)!r} in jb.__file__\n{script}"],
            cwd=tmp_path, env={"PYTHONPATH": str(tmp_path), "PATH": "/usr/bin:/bin"}, capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    return carry_out


@pytest.mark.parametrize("heading", ["A shape of cross-section", "A file format"])
def test_what_the_page_says_of_adding_a_thing_makes_one_that_works(heading, carried_out):
    script, _, prints = SCRIPTS[heading].partition("# prints\n")
    assert carried_out(heading, script) == prints
