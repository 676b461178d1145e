"""Every call that README and docs show is run: each block of Python as it stands, each call in a line of text."""

import re
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scipy import sparse

import jointbayes as jb
from tests.case.refusal_rows import parts_named
from tests.conftest import STEEL, rod
from tests.pages import PAGES, ROOT, fenced, prose, text_of
from tests.report.test_several_tests import OWN, TORQUES
from tests.structure.imported import small_frame as small
from tests.structure.imported.nastran_files import superelement, write_punch

pytestmark = pytest.mark.docs

#: Run by tests of their own, of tests/test_workflow.py and of those whose files they show.
ELSEWHERE = {"without-files.md", "developing.md"}
#: Pages whose blocks ask what is known under other premises.
OTHER_PREMISES = ("api.md",)
#: A block of Python, and the block of text that it prints.
PRINTED = re.compile(
    r"^```python\n(.*?)^```\n+prints\n+(?:<!--[^\n]*-->\n)?```text\n(.*?)^```", re.MULTILINE | re.DOTALL
)
NUMBER = re.compile(r"(-?\d+\.?\d*(?:e[+-]?\d+)?)")


def calls(page: Path) -> list[str]:
    """Calls of `jb` and of methods of a posterior between backticks in the text of a page."""
    spans = (re.sub(r"\s+", " ", span) for span in re.findall(r"`([^`]+)`", prose(page)))
    return [span for span in spans if re.search(r"\b(jb|posterior)\.\w+(\.\w+)*\(", span)]


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A directory with what the pages name: the shipped cases, a measurement, a table of two joints."""
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    (tmp_path / "tip.uff").symlink_to(ROOT / "configs" / "data" / "virtual_test.uff")
    (tmp_path / "joints.csv").write_text(
        "key,sampling.seed,sampling.max_steps\nSN-20007,1,200\nSN-20008,2,200\n", encoding="utf-8"
    )
    monkeypatch.chdir(tmp_path)
    return tmp_path


def spindle_and_tool() -> dict[str, object]:
    """What the page on measured bodies takes as given: FRFs of a spindle, a tool, and FRFs of both joined."""
    lines, dofs = np.arange(50.0, 1000.0, 10.0), ("spindle:y", "spindle:rz")
    dynamic = np.array([np.diag([1e8, 1e6]) * (1 + 0.02j) - (2 * np.pi * f) ** 2 * np.diag([5.0, 0.05]) for f in lines])
    frfs = jb.FrfSet(lines, np.linalg.inv(dynamic), dofs, dofs, "receptance")
    tool, joint = rod(damping=jb.LossFactor(0.01)), jb.Joint(("1:y", "1:rz"), dofs)
    prior = jb.JointPrior(jb.LogStiffness(), tuple(jb.Normal.from_decades(k, 0.3) for k in (1e8, 1e6, 1e5)))
    tip = jb.FrfSet(lines, np.full((lines.size, 1, 1), 1e-7 + 0j), ("11:y",), ("11:y",), "receptance")
    bodies = jb.Substructures(tool, (jb.MeasuredBody.of(frfs, np.abs(frfs.values) ** 2 * 1e-4, "spindle"),))
    guessed = jb.Problem(structure=bodies, joint=joint, data=jb.FrfData(tip, np.abs(tip.values) ** 2), prior=prior)
    values = guessed.test.receptance_model(jb.Ports(lines, ("11:y",), ("11:y",))).receptance(
        prior.matrix(prior.mean[None])
    )
    measured = jb.FrfSet(lines, values[0], ("11:y",), ("11:y",), "receptance")
    return {
        "jb": jb,
        "frfs": frfs,
        "variance": np.abs(frfs.values) ** 2 * 1e-4,
        "tool": tool,
        "data": jb.FrfData(measured, np.abs(values[0]) ** 2 * 1e-3),
        "prior": prior,
    }


def export_everywhere(folder: Path) -> None:
    """The files of each program that the page on FE models reads."""
    k, m = small.K, small.M
    small.write_matlab_5(folder / "bracket.mat", K=k, M=m, dofs=small.DOFS, nodes=small.NODES, xyz=small.PLACES)
    for name, matrix in (("k", k), ("m", m)):
        small.write_matrix_market(folder / f"{name}.mtx", matrix)
        small.write_matrix_market(folder / f"{name}.mmf", matrix)
        small.write_harwell_boeing(folder / f"{name}.matrix", matrix)
    small.write_mapping(folder / "k.mapping")
    small.write_map(folder / "dofs.csv")
    small.write_places(folder / "nodes.csv")
    small.write_calculix(folder / "bracket.sti", k)
    small.write_calculix(folder / "bracket.mas", m)
    small.write_dof(folder / "bracket.dof")
    for name, matrix in zip(("STIF", "MASS"), small.in_mm(k, m), strict=True):
        small.write_abaqus(folder / f"housing_{name}1.mtx", matrix)
    write_punch(folder / "plate.pch", KAAX=k, MAAX=m)
    superelement(folder, "outboard", name="outboard")


def reader_of_ansys() -> ModuleType:
    """What the page on FE models asks of the reader of Ansys' binary files: upper triangles, directions from 0."""
    places = SimpleNamespace(nnum=np.array(small.NODES), nodes=np.array(small.PLACES))
    triangles = (np.array(small.DOFS) - [0, 1], sparse.triu(small.K), sparse.triu(small.M))
    reader = ModuleType("ansys.mapdl.reader")
    reader.read_binary = lambda path: SimpleNamespace(mesh=places, load_km=lambda: triangles)
    return reader


@pytest.mark.science
@pytest.mark.parametrize(
    "page",
    [pytest.param(page, id=page.name) for page in PAGES if fenced(page, "python") and page.name not in ELSEWHERE],
)
def test_every_block_of_python_runs_and_prints_what_the_page_says(page, clone, request, capsys, monkeypatch):
    if page.name == "imported.md":
        export_everywhere(clone)
        module = ModuleType("ansys.mapdl")
        module.reader = reader_of_ansys()
        monkeypatch.setitem(sys.modules, "ansys.mapdl", module)
    if page.name not in OTHER_PREMISES:
        request.getfixturevalue("plain_reports")
    names = {"__name__": "__main__"} | (spindle_and_tool() if page.name == "imported.md" else {})
    shown = dict(PRINTED.findall(text_of(page)))
    for block in fenced(page, "python"):
        if "import pyuff" in block:  # tests/report/test_export.py runs it
            continue
        capsys.readouterr()
        exec(compile(block, page.name, "exec"), names)
        if block in shown:
            found, expected = (NUMBER.split(text) for text in (capsys.readouterr().out.strip(), shown[block].strip()))
            assert found[::2] == expected[::2]
            # another machine has other draws: a long tail scatters by a fifth
            np.testing.assert_allclose([*map(float, found[1::2])], [*map(float, expected[1::2])], rtol=0.2)


#: What a call in a line of text leaves to its reader.
FILLED_IN = dict(line.split(" ;; ") for line in parts_named("documented_calls")["filled in"].splitlines())


@pytest.mark.science
@pytest.mark.usefixtures("plain_reports", "rough_proposals")
@pytest.mark.filterwarnings("ignore:Estimated shape parameter of Pareto:UserWarning")  # `az.loo` of few draws
def test_every_call_in_a_line_of_text_is_run(clone):
    import arviz as az

    case = jb.load_case("configs/two_storeys.toml")
    torques = jb.case_from_text("torques", OWN + TORQUES).problem
    jb.campaign("joints.csv", "reports/joints", base="configs/two_storeys.toml")
    frf = torques.parts[0].test.data.frf
    section = jb.Section.circle(0.02)
    names = {
        "jb": jb,
        "jointbayes": jb,
        "az": az,
        "case": case,
        "problem": case.problem,
        "torques": torques,
        "tests": torques.tests,
        "joint": jb.LogStiffness(),
        "body": torques.parts[0].test.structure,
        "data": torques.parts[0].test.data,
        "posterior": jb.sample(torques, settings=jb.SamplerSettings(walkers=20, max_steps=100)),
        "path": "fewer.nc",
        "low": 1.0,
        "high": 2.0,
        "mean": 2.0,
        "sd": 0.1,
        "averages": 8,
        "frequencies": [120.0],
        "sds": [0.5],
        "parametrisation": jb.parametrisation_named("springs", ("y", "rz")),
        "frf": replace(frf, coherence=np.full(frf.values.shape, 0.99), averages=8),
        "section": section,
        "steel": STEEL,
        "law": jb.LossFactor(0.01),
        "strip": jb.FrameBody({"1": (0, 0, 0), "2": (1, 0, 0)}, (jb.Member(("1", "2"), section, STEEL),)),
    }
    failed = []
    for call in sorted({call for page in PAGES for call in calls(page)}):
        try:
            exec(FILLED_IN.get(call, call), names)
        except Exception as error:
            failed.append(f"{call}: {type(error).__name__}: {error}")
    assert not failed, "\n".join(failed)
