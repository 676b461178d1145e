"""vibrecords stands alone: it is imported, its README and its tests run, where there is no jointbayes."""

import re
import subprocess
import sys

import numpy as np
import pytest
from benchmarks.size import ROOT
from benchmarks.written_files import write_frf

from tests.pages import fenced
from tests.vibrecords.rod import measured
from vibrecords import RelativeNoise

#: Begins a script to which `import jointbayes` fails.
HIDDEN = """
import sys
class Hidden:
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] == "jointbayes":
            raise ModuleNotFoundError(f"{name} is hidden", name=name)
sys.meta_path.insert(0, Hidden)
"""
README = (ROOT / "src" / "vibrecords" / "README.md").read_text(encoding="utf-8")
EXAMPLES = fenced(README, "python")
TESTS = ROOT / "tests" / "vibrecords"


def alone(script, cwd):
    """Standard output of a script that runs with jointbayes hidden."""
    done = subprocess.run(
        [sys.executable, "-c", HIDDEN + script],
        cwd=cwd,
        env={"PYTHONPATH": f"{ROOT / 'src'}:{ROOT}", "PATH": "/usr/bin:/bin", "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return done.stdout


def test_all_of_it_is_imported_without_what_only_inference_needs(tmp_path):
    loaded = alone(
        "import importlib, pkgutil, vibrecords\n"
        "print('numpy' in sys.modules)\n"
        "for module in pkgutil.walk_packages(vibrecords.__path__, 'vibrecords.'):\n"
        "    importlib.import_module(module.name)\n"
        "print(sorted({name.partition('.')[0] for name in sys.modules}))\n",
        tmp_path,
    )
    at_once, in_all = loaded.splitlines()
    assert at_once == "False"
    heavy = {"arviz", "click", "dynesty", "emcee", "jinja2", "jointbayes", "matplotlib", "numba", "pandas", "pydantic"}
    assert not (heavy | {"typst", "xarray"}) & set(re.findall(r"\w+", in_all))


def test_every_public_name_is_there_once():
    import vibrecords

    stub = (ROOT / "src" / "vibrecords" / "__init__.pyi").read_text(encoding="utf-8")
    assert len(set(vibrecords.__all__)) == len(vibrecords.__all__) == stub.count("\nfrom ")
    assert dir(vibrecords) == sorted(vibrecords.__all__)
    assert all(getattr(vibrecords, name) for name in vibrecords.__all__)
    with pytest.raises(AttributeError, match="module 'vibrecords' has no attribute 'read_frfs'"):
        _ = vibrecords.read_frfs


def test_the_examples_of_its_readme_run(tmp_path):
    lines, noise = np.arange(20.0, 2500.0, 2.0), RelativeNoise(0.02, 0.005)
    data = measured(lines, noise, np.random.default_rng(1), quantity="accelerance")
    write_frf(data.frf, tmp_path / "tip.uff", "uff58b")
    reads, fits = EXAMPLES
    told = alone(reads, tmp_path).splitlines()
    assert told[0].startswith("FrfRecord data set ")
    assert told[-1] == "accelerance ('11:y',) ('11:y',) (991, 1, 1)"
    assert (tmp_path / "tip.csv").is_file()
    numbers = [[float(x) for x in re.findall(r"[\d.]+", line)] for line in alone(fits, tmp_path).splitlines()]
    assert len(numbers) == 4  # two modes of 121 and 757 Hz, 1 % damping
    for (value, sd), true in zip(numbers[1::2], (0.01, 0.01), strict=True):
        assert abs(value - true) < 4 * sd < 0.002


def test_every_module_that_its_readme_names_is_there():
    rows = re.findall(r"^\| (`.*?) \|", README, re.MULTILINE)
    for name in re.findall(r"`(\w+)`", " ".join(rows)):
        assert list((ROOT / "src" / "vibrecords").glob(f"{name}*")), name


@pytest.mark.whole
@pytest.mark.parametrize("done", ["collected", pytest.param("passed", marks=[pytest.mark.science, pytest.mark.long])])
def test_its_tests_are_collected_and_pass_alone(done):
    options = [f"--confcutdir={TESTS}", "-p", "no:cacheprovider", "-q", "-m", "not science and not whole"]
    options += ["--collect-only"] * (done == "collected")
    told = alone(f"import pytest\nsys.exit(pytest.main({[str(TESTS), *options]!r}))\n", ROOT)
    assert int(re.search(rf"(\d+)(?:/\d+)? (?:tests )?{done}", told)[1]) > 50
