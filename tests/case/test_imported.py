"""A case that imports its structure: the same numbers as its matrices, one reduction, and every slip at its key."""

import json

import numpy as np
import pytest
from benchmarks.bricks import brick_model, face
from scipy import linalg

import jointbayes as jb
from jointbayes.case.case_objects import _read, _reduced
from jointbayes.posterior.model_errors import mesh_of
from jointbayes.structure.imported import reduction
from tests.case.refusal_rows import parts_named
from tests.conftest import FEW_STEPS
from tests.one_line import refused
from tests.structure.imported.fe_models import plane_beam

CASE, WITH_TOOL, ROD_CASE = parts_named("imported").values()


def save(model, path, **more):
    np.savez(path, K=model.stiffness.toarray(), M=model.mass.toarray(), dofs=model.dofs, nodes=model.nodes,
             xyz=model.places, **more)  # fmt: skip


@pytest.fixture(name="home")
def _home(tmp_path):
    _read.cache_clear()
    _reduced.cache_clear()
    save(plane_beam(20), tmp_path / "beam.npz")
    (tmp_path / "case.toml").write_text(CASE)
    return tmp_path


@pytest.fixture(name="counted")
def _counted(monkeypatch):
    """How often the whole model is factorised."""
    calls, real = [], reduction._solver
    monkeypatch.setattr(reduction, "_solver", lambda *given: calls.append(1) or real(*given))
    return calls


def write(home, *edits):
    text = CASE
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    (home / "case.toml").write_text(text)
    return home / "case.toml"


def test_it_is_the_problem_of_its_matrices(home):
    case = jb.load_case(home / "case.toml")
    model = plane_beam(20)
    dofs = [f"{node}:{'y' if way == 2 else 'rz'}" for node, way in model.dofs]
    np.save(home / "K.npy", model.stiffness.toarray())
    np.save(home / "M.npy", model.mass.toarray())
    text = CASE.replace('kind = "imported"\nfile = "beam.npz"', f'kind = "matrices"\nstiffness = "K.npy"\n'
                        f'mass = "M.npy"\ndofs = {json.dumps(dofs)}')  # fmt: skip
    text = (
        text.replace('length_unit = "m"\n', "")
        .replace("[structure.ports.tip]\nnode = 21\n", "")
        .replace("tip:y", "21:y")
    )
    prior = "".join(f'[prior.{k}]\ndistribution = "log_uniform"\nlow = {low}\nhigh = {high}\n'
                    for k, low, high in (("k11", 1e5, 1e10), ("k12", 1e2, 1e8), ("k22", 1e3, 1e8)))  # fmt: skip
    (home / "matrices.toml").write_text(text + prior)
    (home / "case.toml").write_text(CASE + prior)
    case, other = jb.load_case(home / "case.toml"), jb.load_case(home / "matrices.toml")
    theta = case.problem.prior.sample(np.random.default_rng(1), 50)
    mode = other.problem.parametrisation.coordinates(np.array([3e7, 1e5, 2e5]))
    theta = np.vstack([theta, mode + 0.01 * np.random.default_rng(2).standard_normal((50, 3))])
    exact, found = other.problem.log_posterior(theta), case.problem.log_posterior(theta)
    finite = np.isfinite(exact)
    assert finite.sum() > 60
    np.testing.assert_allclose(found[finite], exact[finite], rtol=1e-6, atol=1e-3)


@pytest.mark.science
def test_the_model_is_factorised_once_whatever_case_plan_and_report_ask(home, counted, tmp_path):
    jb.write_report(jb.sample(jb.load_case(home / "case.toml"), seed=1, settings=FEW_STEPS), tmp_path / "report")
    jb.load_case(home / "case.toml")
    assert len(counted) == 1


#: Three masses on two springs, free: as they are, and with a generalised coordinate that nothing moves.
ROD = {
    "K": 2e6 * np.array([[1, -1, 0], [-1, 2, -1], [0, -1, 1]]),
    "M": np.diag([1.0, 3, 1]),
    "dofs": [(1, 1), (2, 1), (3, 1)],
}
MORE = {"K": linalg.block_diag(ROD["K"], 4e6), "M": linalg.block_diag(ROD["M"], 1.0), "dofs": [*ROD["dofs"], (900, 0)],
        "nodes": [1, 2, 3], "xyz": [(0, 0, 0), (0.2, 0, 0), (0.4, 0, 0)]}  # fmt: skip


@pytest.mark.parametrize("arrays", [ROD, MORE])
@pytest.mark.parametrize("scale", [1.0, 1.1, 1e2])
def test_a_free_model_runs_without_coordinates_and_with_a_generalised_one(home, arrays, scale):
    """Free frequencies: the middle mass at rest, √(k/m); and both ends against the middle, √(k (1/m + 2/3m))."""
    np.savez(home / "rod.npz", **arrays | {"K": scale * arrays["K"], "M": scale * arrays["M"]})
    (home / "case.toml").write_text(ROD_CASE)
    structure = jb.load_case(home / "case.toml").problem.test.structure.nominal
    found = structure.modes().frequency_hz
    assert found[0] == 0
    assert found[1:3] == pytest.approx([np.sqrt(2e6) / (2 * np.pi), np.sqrt(2e6 * 5 / 3) / (2 * np.pi)], rel=1e-9)
    assert found[1:3] == pytest.approx([225.08, 290.58], abs=0.005)
    moved = structure.rigid_motions(np.arange(1))
    assert (moved**2).sum() == pytest.approx(1 / (5 * scale), rel=1e-9)  # of 5 kg


def test_a_grid_may_have_a_number_of_eight_or_nine_digits(home):
    np.savez(home / "rod.npz", **ROD | {"dofs": [(20110010, 1), (99999999, 1), (999999999, 1)]})
    (home / "case.toml").write_text(ROD_CASE.replace("1:x", "20110010:x"))
    assert jb.load_case(home / "case.toml").problem.test.structure.labels == ("20110010:x",)


def test_a_stored_posterior_needs_no_model_any_more(home, tmp_path):
    posterior = jb.sample(jb.load_case(home / "case.toml"), seed=1, settings=FEW_STEPS)
    posterior.save(tmp_path / "posterior.nc")
    (home / "beam.npz").unlink()
    again = jb.load_posterior(tmp_path / "posterior.nc")
    theta = posterior.thinned(20)
    np.testing.assert_array_equal(again.problem.log_posterior(theta), posterior.problem.log_posterior(theta))
    assert mesh_of(again) is not None
    assert "vectors stand for 42 DOFs" in mesh_of(again).sentence


def test_the_reduction_is_checked_as_a_mesh_is(home):
    path = write(home, ('file = "beam.npz"', 'file = "beam.npz"\ntop_hz = 2000.0'))
    mesh = mesh_of(jb.sample(jb.load_case(path), seed=1, settings=FEW_STEPS))
    assert mesh is not None
    assert mesh.within
    assert mesh.kind == "reduced"


def test_parts_are_exports_of_themselves(home):
    model = brick_model((6, 1, 1), part_from=3)
    save(model, home / "bar.npz")
    part, rows = model.parts["end"], model.dofs[:, 0] > 12
    np.savez(home / "end.npz", K=part.stiffness.toarray()[np.ix_(rows, rows)],
             M=part.mass.toarray()[np.ix_(rows, rows)], dofs=model.dofs[rows])  # fmt: skip
    nodes = [list(face(model, x)) for x in (0.0, 0.2)]
    path = write(
        home,
        ('file = "beam.npz"', 'file = "bar.npz"\nparts.end.file = "end.npz"'),
        ("node = 21", f"nodes = {nodes[1]}\n[structure.ports.root]\nnodes = {nodes[0]}"),
        ('["1:y", "1:rz"]', '["root:y", "root:rz"]'),
        ('"11:y"', '"tip:z"'),
        ("[joint]", "[uncertain.bodies.end.density]\nsd_percent = 3.0\n[joint]"),
    )
    body = jb.load_case(path).problem.test.structures
    assert body.names == ("end.density",)
    heavier = body.recipe.structure({"end.density": 1.1}).rigid_motions(np.arange(1))
    assert (1 / (heavier**2).sum()) == pytest.approx(7800 * 0.2 * 0.02 * 0.03 * 1.05, rel=1e-9)


def test_supports_and_boxes(home):
    save(brick_model((6, 1, 1)), home / "bar.npz")
    path = write(
        home,
        ('file = "beam.npz"', 'file = "bar.npz"\nsupports = ["1:z"]'),
        ("node = 21", "box_mm = [[199, -1, -1], [201, 99, 99]]\n[structure.ports.root]\n"
                      "box_mm = [[-1, -1, -1], [1, 99, 99]]\nkind = \"rigid\"\nat_mm = [0, 0, 0]"),
        ('["1:y", "1:rz"]', '["root:y", "root:rz"]'),
        ('"11:y"', '"tip:z"'),
    )  # fmt: skip
    recipe = jb.load_case(path.with_name("case.toml")).problem.test.structures.recipe
    assert recipe.positions["root"] == pytest.approx((0, 0, 0))
    assert recipe.positions["tip"] == pytest.approx((0.2, 0.01, 0.015))


@pytest.mark.parametrize("link", [True, False])
def test_a_model_outside_the_directory_of_the_case_is_read_only_where_that_is_allowed(home, tmp_path_factory, link):
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "beam.npz"
    (home / "beam.npz").rename(elsewhere)
    if link:
        (home / "beam.npz").symlink_to(elsewhere)
    path = home / "case.toml" if link else write(home, ("beam.npz", str(elsewhere)))
    refused(
        lambda: jb.load_case(path), jb.CaseError, r"^[^\n]*case\.toml:3: structure\.file: found [^\n]*directory[^\n]*$"
    )
    assert jb.load_case(path, allow_outside=True).problem.test.structure.labels
