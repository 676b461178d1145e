"""An imported model as a body: against dense solves of the whole model, in every frequency, joint and part."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.bricks import brick_model, face
from scipy import linalg, sparse

import jointbayes as jb
from jointbayes.frf import NaturalFrequencies, receptance_model
from jointbayes.identification import sensitivity_iteration
from jointbayes.structure import Rayleigh, ViscousMatrix, family_of_recipe
from jointbayes.structure.imported import ports, reduction
from jointbayes.structure.imported.ports import nodes_in_box
from tests.structure.imported.fe_models import plane_beam
from vibrecords import FrfSet

TOP_HZ, BAR = 6000.0, (8, 2, 2)
LOSS, NONE = jb.LossFactor(0.01), jb.LossFactor(0.0)
LINES = np.linspace(20.0, TOP_HZ, 300)


def dense_frfs(stiffness, mass, forms, at_joint, joint, eta=0.01):
    """FRFs of matrices as they are between forms with a joint at some of them, line by line."""
    held = stiffness * (1 + 1j * eta) + forms[:, at_joint] @ joint @ forms[:, at_joint].T
    return np.array([forms.T @ linalg.solve(held - w**2 * mass, forms) for w in 2 * np.pi * LINES])


def both_of(model):
    return model.stiffness.toarray(), model.mass.toarray()


def error_of_peaks(found, exact):
    """Largest error over the root of both drive points' peaks."""
    peak = np.abs(np.einsum("lii->li", exact)).max(axis=0)
    return float((np.abs(found - exact).max(axis=0) / np.sqrt(np.outer(peak, peak))).max())


def worst_frequency(recipe, stiffness, mass, top_hz=TOP_HZ, factors=None):
    """Largest relative error of a natural frequency below `top_hz` beside the nearest of the whole model."""
    exact = np.sqrt(np.maximum(linalg.eigvalsh(stiffness, mass), 1.0)) / (2 * np.pi)
    seen = recipe.structure(factors).modes().frequency_hz
    seen = seen[(seen > 0) & (seen < top_hz)]
    assert seen.size >= 1
    return np.abs(seen[:, None] / exact - 1).min(axis=1).max()


def forms_of(model, places):
    each = [ports.port_forms(model, port, name).values() for name, port in places.items()]
    return np.stack([form for of_port in each for form in of_port], axis=1)


@pytest.mark.parametrize("dense", [True, False])
def test_frfs_are_those_of_the_whole_model_for_joints_over_six_decades(dense, monkeypatch):
    rng = np.random.default_rng(1)
    model = brick_model(BAR)
    if not dense:
        monkeypatch.setattr(reduction, "_DENSE", 10)  # as a large model, by sparse factors and Lanczos
    patches = {"root": jb.Port(face(model, 0.0)), "tip": jb.Port(face(model, 0.2))}
    forms = forms_of(model, patches)
    assert forms.shape == (model.n_dofs, 12)
    small, finer = reduction.reduce_model(model, forms, TOP_HZ)
    assert small.rigid == 6
    assert len(small.mass) < model.n_dofs / 3
    at, sizes = np.arange(6), np.array([1, 1, 1, 1e-4, 1e-4, 1e-4])
    for exponent in np.linspace(4, 10, 5):
        stiffness = np.diag(10.0**exponent * sizes * rng.uniform(0.3, 3, 6))
        exact = dense_frfs(*both_of(model), forms, at, stiffness)
        found, better = (dense_frfs(of.stiffness, of.mass, of.motions, at, stiffness) for of in (small, finer))
        true, told = error_of_peaks(found, exact), error_of_peaks(found, better)
        assert true < 1e-5, f"10^{exponent:g} N/m: {true:.2g}"
        assert told > true / 4 - 1e-8, "the finer model does not show the error"


def test_a_free_model_has_exactly_six_rigid_body_modes_and_the_frequencies_of_the_whole():
    model = brick_model(BAR)
    recipe = jb.reduce_to_ports(model, {"tip": face(model, 0.2)}, TOP_HZ, LOSS)
    modes = recipe.structure().modes()
    assert (modes.eigenvalues[:6] == 0).all()
    assert modes.eigenvalues[6] > 0
    assert worst_frequency(recipe, *both_of(model)) < 1e-9
    moved = recipe.structure().rigid_motions(np.arange(3))
    mass = 7800 * 0.2 * 0.02 * 0.03
    assert np.einsum("pr,pr->p", moved, moved)[0] == pytest.approx(1 / mass, rel=1e-9)  # along the bar, no rotation


def whole_and_reduced(beam, law, nodes, top_hz):
    """A plane beam as its matrices are, and reduced to some nodes."""
    labels = tuple(f"{node}:{'y' if way == 2 else 'rz'}" for node, way in beam.dofs)
    reduced = jb.reduce_to_ports(beam, {str(node): node for node in nodes}, top_hz, law)
    return family_of_recipe(jb.MatrixRecipe(*both_of(beam), labels, law)), family_of_recipe(reduced)


def rounded(matrix, digits):
    matrix = sparse.csc_array(matrix)
    matrix.eliminate_zeros()
    size = 10.0 ** (np.floor(np.log10(np.abs(matrix.data))) + 1 - digits)
    data = np.round(matrix.data / size) * size
    return sparse.csc_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)


@pytest.mark.parametrize(("digits", "support"), [(16, 1.0), (13, 10.0), (10, 1e4)])
@pytest.mark.parametrize("places", [True, False])
def test_a_model_of_few_digits_floats_and_one_on_soft_supports_does_not(digits, support, places):
    model = brick_model(BAR)
    few = replace(model, stiffness=rounded(model.stiffness, digits), rounding=0.5 * 10.0 ** (1 - digits))
    ports = {"tip": face(model, 0.2)}
    if not places:
        few, ports = replace(few, nodes=few.nodes[:0], places=few.places[:0]), {"tip": face(model, 0.2)[0]}
    floating = jb.reduce_to_ports(few, ports, TOP_HZ, LOSS).structure().modes().frequency_hz
    assert (floating[:6] == 0).all()
    assert floating[6] > 1000
    soft = np.zeros(model.n_dofs)
    soft[[model.row(node, way) for node in face(model, 0.0) for way in "xyz"]] = support  # N/m
    held = replace(few, stiffness=few.stiffness + sparse.diags_array(soft))
    assert jb.reduce_to_ports(held, ports, TOP_HZ, LOSS).reduced.rigid == 0


@pytest.mark.parametrize("law", [jb.ModalDamping((0.01, 0.02)), LOSS, Rayleigh(4.0, 1e-6)])
def test_a_likelihood_cannot_tell_a_reduced_model_from_its_matrices(law):
    model = plane_beam()
    whole, small = whole_and_reduced(model, law, (1, 26, 51), 3000.0)
    joint, seen = jb.Joint(("1:y", "1:rz")), jb.Ports(np.linspace(10, 3000, 600), ("51:y", "26:y"), ("51:y",))
    matrices = np.array([[[1e7, 1e4], [1e4, 1e5]], [[1e5, 0.0], [0.0, 1e3]], [[1e10, 0.0], [0.0, 1e8]]])
    exact, found = (receptance_model(body, joint, seen).receptance(matrices) for body in (whole, small))
    assert np.abs(found - exact).max() < 1e-7 * np.abs(exact).max()
    exact, found = (NaturalFrequencies(body, joint, 3).frequency_hz(matrices) for body in (whole, small))
    assert found == pytest.approx(exact, rel=1e-8)


def test_a_damping_matrix_of_the_model_is_reduced_with_it():
    model = plane_beam(20)
    own = replace(model, damping=2.0 * model.mass + 1e-6 * model.stiffness)
    recipe = jb.reduce_to_ports(own, {"1": 1, "21": 21}, 3000.0)
    assert isinstance(recipe.damping, ViscousMatrix)
    joint, seen = jb.Joint(("1:y", "1:rz")), jb.Ports(np.linspace(10, 3000, 200), ("21:y",), ("21:y",))
    law = family_of_recipe(jb.reduce_to_ports(model, {"1": 1, "21": 21}, 3000.0, Rayleigh(2.0, 1e-6)))
    k = np.diag([1e7, 1e4])[None]
    exact, found = (receptance_model(b, joint, seen).receptance(k) for b in (law, family_of_recipe(recipe)))
    assert np.abs(found - exact).max() < 1e-6 * np.abs(exact).max()


def test_uncertain_parts_are_those_of_the_model_assembled_anew():
    model = brick_model((8, 1, 1), part_from=5)
    name = {"end.youngs_modulus": (np.log(0.7), np.log(1.4)), "end.density": (-0.2, 0.2), "youngs_modulus": (-0.3, 0.3)}
    ends = {q: tuple(np.exp(r)) for q, r in name.items() if "." in q}
    places = {"root": face(model, 0.0), "tip": face(model, 0.2)}
    law = LOSS
    small = family_of_recipe(jb.reduce_to_ports(model, places, TOP_HZ, law, ends=ends), name)
    labels = small.labels
    forms = forms_of(model, {name: jb.Port(nodes) for name, nodes in places.items()})
    k = np.diag([1e8, 1e8, 1e8, 1e4, 1e4, 1e4])
    seen = jb.Ports(LINES, labels[6:], labels[6:])
    for factors in ([0.8, 1.1, 1.2], [1.3, 0.9, 0.8], [1.0, 1.0, 1.0]):
        stiffer, heavier, all_stiffer = factors
        part = model.parts["end"]
        stiffness = all_stiffer * (model.stiffness + (stiffer - 1) * part.stiffness).toarray()
        mass = (model.mass + (heavier - 1) * part.mass).toarray()
        exact = dense_frfs(stiffness, mass, forms, np.arange(6), k)[:, 6:, 6:]
        found = receptance_model(small, jb.Joint(labels[:6]), seen).receptance(k[None], np.array([factors]))[0]
        assert error_of_peaks(found, exact) < 1e-4


def test_a_sheet_grows_with_the_third_power_of_its_thickness_in_bending_alone():
    model = brick_model((4, 1, 1), part_from=2)
    part = model.parts["end"]
    bent = replace(model, parts={"end": type(part)(0.25 * part.stiffness, part.mass, 0.75 * part.stiffness)})
    recipe = jb.reduce_to_ports(bent, {"tip": face(model, 0.2)}, TOP_HZ, NONE, ends={"end.thickness": (0.8, 1.2)})
    grown = 0.25 * 1.1 + 0.75 * 1.1**3 - 1
    whole = (model.stiffness + grown * part.stiffness).toarray(), (model.mass + 0.1 * part.mass).toarray()
    assert worst_frequency(recipe, *whole, factors={"end.thickness": 1.1}) < 1e-4


def test_accelerometers_weigh_at_their_port_as_masses_of_the_whole_model():
    model = brick_model((8, 1, 1))
    tip = face(model, 0.2)
    mass = {"accelerometer_mass": 0.02, "accelerometer_dofs": ("tip:y",)}
    recipe = jb.reduce_to_ports(model, {"tip": tip}, TOP_HZ, NONE, **mass)
    forms = forms_of(model, {"tip": jb.Port(tip)})[:, :3]
    k, m = both_of(model)
    assert worst_frequency(recipe, k, m + 0.02 * forms @ forms.T) < 1e-7


class TestPorts:
    def test_a_patch_moves_as_the_rigid_body_that_it_is_part_of(self):
        model = brick_model((4, 2, 3))
        turn, shift, at = np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, 3.0]), (0.21, 0.0, 0.01)
        moved = (shift + np.cross(turn, model.places)).ravel()
        forms = ports.port_forms(model, jb.Port(face(model, 0.2), at=at), "tip")
        found = [float(forms[way] @ moved) for way in ("x", "y", "z", "rx", "ry", "rz")]
        assert found == pytest.approx([*(shift + np.cross(turn, at)), *turn], rel=1e-12)

    def test_nodes_in_one_line_do_not_tell_how_they_turn_about_it(self):
        model = brick_model((4, 2, 2))
        line = tuple(n for n in face(model, 0.2) if np.isclose(model.place(n)[1], 0.0))
        assert sorted(ports.port_forms(model, jb.Port(line), "edge")) == ["rx", "ry", "x", "y", "z"]

    def test_a_rigid_patch_is_the_model_with_its_nodes_tied(self):
        model = brick_model((4, 1, 1))
        tip = face(model, 0.2)
        recipe = jb.reduce_to_ports(model, {"tip": jb.Port(tip, rigid=True)}, 20000.0, NONE)
        arms = model.places - np.array(model.places)[np.isin(model.nodes, tip)].mean(axis=0)
        free = ~np.isin(model.dofs[:, 0], tip)
        tie = np.zeros((model.n_dofs, free.sum() + 6))
        tie[np.flatnonzero(free), np.arange(free.sum())] = 1
        for row in np.flatnonzero(~free):
            node, way = model.dofs[row]
            arm = arms[node - 1]
            tie[row, free.sum() + way - 1] = 1
            tie[row, free.sum() + 3 :] = np.cross(np.eye(3), arm)[:, way - 1]  # what each rotation moves there
        whole = tie.T @ model.stiffness @ tie, tie.T @ model.mass @ tie
        assert worst_frequency(recipe, *whole, top_hz=20000.0) < 1e-8
        assert recipe.positions["tip"] == pytest.approx((0.2, 0.01, 0.015))

    def test_a_box_takes_the_nodes_in_it(self):
        model = brick_model((4, 2, 2))
        assert nodes_in_box(model, (0.199, -1, -1), (0.201, 1, 1)) == face(model, 0.2)


@pytest.mark.parametrize("dense", [True, False])
def test_a_mechanism_is_refused(dense, monkeypatch):
    if not dense:
        monkeypatch.setattr(reduction, "_DENSE", 3)
    model = plane_beam(3)
    loose, mass = both_of(model)
    loose[3, :] = loose[:, 3] = mass[3, :] = mass[:, 3] = 0.0
    broken = jb.FeModel(loose, mass, model.dofs, model.nodes, model.places)
    with pytest.raises(jb.ModelError, match="without stiffness and without mass"):
        jb.reduce_to_ports(broken, {"1": 1}, 1000.0, NONE)


def test_supports_hold_what_they_say():
    model = plane_beam(20)
    recipe = jb.reduce_to_ports(model, {"21": 21}, 3000.0, NONE, supports=[(1, "y"), (1, "rz")])
    # cantilever: f = 1.87510²/2π √(EI/ρA L⁴)
    root = np.sqrt(2.1e11 * 0.025**2 / 12 / 7800) / 0.383**2
    assert recipe.structure().modes().frequency_hz[0] == pytest.approx(1.8751041**2 / (2 * np.pi) * root, rel=1e-5)
    assert recipe.structure().rigid == 0


def test_the_paper_iteration_converges_to_what_its_reduction_allows(monkeypatch):
    monkeypatch.setattr(reduction, "_BLOCKS", 1)  # a poor one, whose error shows
    model = plane_beam(60)
    joint, truth = jb.Joint(("1:y", "1:rz")), np.array([3e7, 1e5, 2e5])
    whole, small = whole_and_reduced(model, LOSS, (1, 61), 2000.0)
    seen = jb.Ports(np.linspace(10, 2000, 300), ("61:y", "1:y", "1:rz"), ("61:y",))
    matrix = np.array([[[truth[0], truth[1]], [truth[1], truth[2]]]])
    values = receptance_model(whole, joint, seen).receptance(matrix)[0]
    measured = FrfSet(seen.frequency_hz, values, seen.outputs, seen.inputs)
    found = sensitivity_iteration(small, joint, measured, ("61:y",), (2.98e7, 9.9e4, 1.99e5), sensitivity="analytical")
    assert found.converged, found.reason
    assert found.stiffness == pytest.approx(truth, rel=1e-2)
    assert "threshold 1e-09" not in found.reason  # which no joint of the reduced model reaches


class Factor:
    """What pypardiso offers, by a dense Cholesky factor; like it, it takes the upper triangle."""

    asked: list[int] = []  # noqa: RUF012

    def __init__(self, mtype):
        assert mtype == 2  # symmetric and positive definite

    def factorize(self, upper):
        assert (upper - sparse.triu(upper)).nnz == 0
        self.asked.append(upper.shape[0])
        whole = (upper + sparse.triu(upper, 1).T).toarray()
        try:
            self.factor = linalg.cho_factor(whole)
        except linalg.LinAlgError as error:
            raise ArithmeticError(str(error)) from None

    def solve(self, _, right):
        return linalg.cho_solve(self.factor, right)


@pytest.mark.parametrize("stand_in", [True, False])
def test_the_factor_of_the_extra_is_used_where_it_is_installed_and_gives_the_same(stand_in, monkeypatch):
    monkeypatch.setattr(reduction, "_DENSE", 0)
    monkeypatch.setitem(sys.modules, "pypardiso", None)  # not installed
    model = brick_model((6, 2, 1))
    tip = {"tip": jb.Port(face(model, 0.2))}
    by_scipy = jb.reduce_to_ports(model, tip, TOP_HZ, LOSS)
    if stand_in:
        package = SimpleNamespace(PyPardisoSolver=Factor, PyPardisoError=ArithmeticError)
        monkeypatch.setitem(sys.modules, "pypardiso", package)
        monkeypatch.setitem(sys.modules, "pypardiso.pardiso_wrapper", package)
        Factor.asked.clear()
    else:
        monkeypatch.delitem(sys.modules, "pypardiso")
        pytest.importorskip("pypardiso", reason="pypardiso, the extra fast-fe, is not installed")
    by_extra = jb.reduce_to_ports(model, tip, TOP_HZ, LOSS)
    if stand_in:
        assert Factor.asked == [model.n_dofs]
    found, expected = (one.structure().modes().frequency_hz[6:] for one in (by_extra, by_scipy))
    np.testing.assert_allclose(found[found < 2 * TOP_HZ], expected[expected < 2 * TOP_HZ], rtol=1e-9)
    loose = replace(model, stiffness=model.stiffness - 1e9 * sparse.eye_array(model.n_dofs, format="csc"))
    with pytest.raises(jb.ModelError, match="a motion without stiffness"):
        jb.reduce_to_ports(loose, tip, TOP_HZ, LOSS)
