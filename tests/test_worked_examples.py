"""What `docs/developing.md` says of adding a thing is carried out on a copy of the package, and the thing is used."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import jointbayes
import vibrecords
from tests.conftest import cheap_text

pytestmark = pytest.mark.docs

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "developing.md").read_text(encoding="utf-8")
FEW = ("max_steps = 20000", "max_steps = 200")


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
            [sys.executable, "-c", f"import jointbayes as jb\nassert {str(tmp_path)!r} in jb.__file__\n{script}"],
            cwd=tmp_path, env={"PYTHONPATH": str(tmp_path), "PATH": "/usr/bin:/bin"}, capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    return carry_out


@pytest.mark.long
def test_a_noise_model_is_chosen_by_a_case_inferred_and_stored(carried_out):
    text = cheap_text().replace(*FEW) + '\n[noise]\ndistribution = "floor"\n'
    said = carried_out(
        "A noise model",
        f"case = jb.case_from_text('floor', {text!r})\n"
        "posterior = jb.sample(case, seed=1)\n"
        "posterior.save('floor.nc')\n"
        "import subprocess, sys\n"
        "again = 'import jointbayes as jb; p = jb.load_posterior(\"floor.nc\"); '\n"
        "again += 'print(type(p.problem.test.noise).__name__, *p.problem.names, p.values(\"noise_floor\").min() > 0)'\n"
        "subprocess.run([sys.executable, '-c', again], check=True)\n",
    )
    assert said == "FloorNoise k11 k12 k22 noise_floor True\n"


def test_a_shape_of_cross_section_is_built_from_a_case(carried_out):
    section = '[structure.section]\nshape = "ellipse"\nwidth_mm = 30.0\nheight_mm = 20.0\n'
    text = re.sub(r"^\[structure\.section\]\n(?:[^\n\[]+\n)+", section, cheap_text(), flags=re.MULTILINE)
    assert section in text
    said = carried_out(
        "A shape of cross-section",
        f"case = jb.case_from_text('ellipse', {text!r})\n"
        "section = case.problem.test.structure.recipe.section\n"
        "print(section.shape, round(section.area * 1e6, 2), round(section.inertia_z * 1e12, 1))\n"
        "print(round(section.between(jb.Section.ellipse(0.01, 0.01), 0.5).area * 1e6, 2))\n",
    )
    # π a b and π a b³/4 with 15 and 10 mm; half way to a circle of 10 mm
    assert said == "ellipse 471.24 11781.0\n235.62\n"


def test_coordinates_of_a_joint_are_chosen_by_a_case_and_go_there_and_back(carried_out):
    priors = re.compile(r"^\[prior\.k11\].*?(?=^\[data\])", re.MULTILINE | re.DOTALL)
    text = cheap_text().replace('parametrisation = "log"', 'parametrisation = "span"')
    text = priors.sub(
        '[prior]\nk11 = { distribution = "log_uniform", low = 1e6, high = 1e11 }\n'
        'span = { distribution = "log_uniform", low = 1e-3, high = 1.0 }\n'
        'rho = { distribution = "uniform", low = -1.0, high = 1.0 }\n\n',
        text,
    )
    said = carried_out(
        "Coordinates of a joint",
        "import numpy as np\n"
        "from jointbayes.joint import parametrisation_named\n"
        f"case = jb.case_from_text('span', {text!r})\n"
        "theta = case.problem.prior.sample(np.random.default_rng(1), 5)\n"
        "pair, step = parametrisation_named('span'), 1e-6 * np.eye(3)\n"
        "by_differences = np.stack([(pair.values(theta + s) - pair.values(theta - s)) / 2e-6 for s in step], axis=-1)\n"
        "print(*case.problem.names, np.allclose(pair.derivative(theta), by_differences, rtol=1e-5),\n"
        "      np.allclose(pair.log_slope(theta), np.linalg.slogdet(by_differences)[1], atol=1e-5))\n"
        "found = jb.find_map(case, seed=1).values\n"
        "print(np.allclose(pair.values(pair.coordinates(found)), found))\n",
    )
    assert said == "k11 span rho True True\nTrue\n"


def test_a_file_format_is_told_and_read(carried_out):
    said = carried_out(
        "A file format",
        "open('a.txt', 'w').write('SWEEP tip hammer\\n' + ''.join(f'{f};{f / 10};-1\\n' for f in range(10, 20)))\n"
        "frf = jb.read_frf('a.txt')\n"
        "print(frf.outputs, frf.inputs, frf.quantity, frf.n_lines, frf.values[0, 0, 0])\n"
        "open('b.txt', 'w').write('SWEEP tip hammer\\n1;2\\n')\n"
        "try:\n    jb.read_frf('b.txt')\nexcept jb.MeasurementError as error:\n    print(error)\n",
    )
    assert said == (
        "('tip',) ('hammer',) accelerance 10 (1-1j)\n"
        "b.txt: found a line that is not three numbers; expected f;re;im; export it again\n"
    )


@pytest.mark.long
def test_a_section_of_the_report_is_printed(carried_out):
    text = cheap_text().replace(*FEW)
    said = carried_out(
        "A section of the report",
        f"posterior = jb.sample(jb.case_from_text('weakest', {text!r}), seed=1)\n"
        "jb.write_report(posterior, 'run')\n"
        "import re\n"
        "page = open('run/report.html', encoding='utf-8').read()\n"
        "print('Least known' in page, *re.findall(r'The data tell least of (k\\d+)', page))\n",
    )
    assert re.fullmatch(r"True (k11|k12|k22)\n", said)
