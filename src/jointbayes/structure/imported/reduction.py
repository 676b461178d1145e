"""An imported model reduced to what its ports see: its modes to above the band, and the residual of all others.

The residual is a Krylov space of the ports' forces at a shift below the band, S⁻¹P, S⁻¹MS⁻¹P and one block more, with
S = K + σM (MacNeal 1971; Rubin 1975, with further blocks). For stiff joints at rotations of averaged ports a third
block is worth a factor of 10³, more modes none. S is positive definite for a free model too. Rigid-body modes are
exact where the coordinates of all nodes are known; otherwise they are the eigenvectors at zero. All ports that may
ever be asked are reduced at once: each is a solve, and the factorisation of S is what costs.

References
----------
MacNeal, R. H. (1971). A hybrid method of component mode synthesis. Computers & Structures 1(4), 581-601.
DOI 10.1016/0045-7949(71)90031-9
Rubin, S. (1975). Improved component-mode representation for structural dynamic analysis. AIAA Journal 13(8), 995-1006.
DOI 10.2514/3.60497
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from jointbayes.errors import ModelError
from jointbayes.structure.imported.fe_model import FeModel, Sparse
from jointbayes.structure.imported.ports import rigid_motions
from vibrecords.arrays import Array

MODES_TO = 1.5  # times the band
_SHIFT_AT = 0.25  # of the band: σ = (2π · so much)²
_BLOCKS, _FINER_BLOCKS = 3, 5
_DENSE = 400  # a model of so few DOFs is solved whole
_MODES_FIRST, _MOST_MODES = 24, 600
_SOLVED = 1.0  # of a unit load at each DOF, which is some hundreds in length
_SAME = 1e-9  # a vector of which less than this is new adds rounding only
_NEAR_ZERO = 1e-2  # of the shift: an eigenvalue below may belong to a rigid-body mode
_POLISHED, _NEW = 3, 1e-6  # inverse iterations on such a mode, and what of it must be new
_STATIC = 1e-12  # part of the largest inverse eigenvalue below which a vector has no mass: it answers at once
#: A motion is a rigid body's if its strain energy is no more than so many times the rounding of φᵀ|K|φ, or than a few
#: times what the file's digits leave: ten to sixteen of them.
_RIGID, _LEFT, _ALIKE, _FEWEST_DIGITS, _EXACT = 30 * np.finfo(float).eps, 3, 10, 1e-9, 1e-12

#: Quantities of a part, and how its matrices grow with each: stiffness, bending, mass.
PART_QUANTITIES = {"youngs_modulus": (1, 1, 0), "density": (0, 0, 1), "thickness": (1, 3, 1)}


@dataclass(frozen=True, eq=False)
class ReducedPart:
    """A part of a reduced model, see `FePart`; bending is zero where there is none."""

    stiffness: Array
    mass: Array
    bending: Array


@dataclass(frozen=True, eq=False)
class ReducedModel:
    """A model in r coordinates, of which the first are rigid-body modes.

    Parameters
    ----------
    stiffness, mass
        K and M, shape (r, r); of rigid-body modes K is exactly 0.
    motions
        Motion of each port's DOF in the coordinates, shape (r, p).
    rigid
        Number of rigid-body modes.
    damping
        Viscous damping matrix, shape (r, r), or None.
    parts
        Parts with uncertain quantities, by name.
    seen
        Motion of DOFs that are only looked at, shape (r, s).
    """

    stiffness: Array
    mass: Array
    motions: Array
    rigid: int
    damping: Array | None = None
    parts: Mapping[str, ReducedPart] = field(default_factory=dict)
    seen: Array = field(default_factory=lambda: np.empty((0, 0)))


def reduce_model(
    model: FeModel,
    forms: Array,
    top_hz: float,
    ends: Mapping[str, tuple[float, float]] | None = None,
    seen: Sequence[int | None] = (),
) -> tuple[ReducedModel, ReducedModel]:
    """A model as it is seen at some motions up to a frequency, and the same with more vectors to compare it with.

    1. Take K and M as stated, and at each end of each uncertain quantity of a part.
    2. Of each take the modes up to above the band, and the blocks of vectors that stand for the others.
    3. Project the model on rigid-body modes, modes and three blocks, and on two blocks more.

    Parameters
    ----------
    model
        The model, without what supports hold.
    forms
        Motions of the ports as forms on the DOFs, shape (n, p).
    top_hz
        Highest frequency that is wanted, Hz.
    ends
        Smallest and largest factor on uncertain quantities of parts, such as ``"wall.thickness"``: the model is
        reduced at each of these ends, and the vectors of all serve together.
    seen
        Rows that are only looked at; None of what does not move.

    Raises
    ------
    ModelError
        If a motion has neither stiffness nor mass, or a negative stiffness, or too many modes lie below the frequency.
    """
    # 1. variants
    variants = [(model.stiffness, model.mass)]
    for name, both in (ends or {}).items():
        part, _, quantity = name.rpartition(".")
        of, (stiff, bend, heavy) = model.parts[part], PART_QUANTITIES[quantity]
        for factor in (factor for factor in both if factor != 1.0):
            stiffness = model.stiffness + (factor**stiff - 1) * of.stiffness
            if of.bending is not None:
                stiffness = stiffness + (factor**bend - 1) * of.bending
            variants.append((stiffness, model.mass + (factor**heavy - 1) * of.mass))
    # 2. vectors
    shift = (2 * np.pi * _SHIFT_AT * top_hz) ** 2
    rigid = np.empty((model.n_dofs, 0))
    modes: list[Array] = []
    blocks: list[list[Array]] = [[] for _ in range(_FINER_BLOCKS)]
    for stiffness, mass in variants:
        solve = _solver(stiffness + shift * mass, model.source)
        modes.append(_modes_below(stiffness, mass, solve, shift, MODES_TO * top_hz, model.source))
        if len(modes) == 1:
            rigid = _rigid_modes(model, modes[0], solve, shift)
        vectors = forms
        for block in blocks:
            vectors = solve(mass @ vectors if block is not blocks[0] else vectors)
            vectors = vectors / np.maximum(np.linalg.norm(vectors, axis=0), np.finfo(float).tiny)
            block.append(vectors)
    # 3. projections
    return tuple(  # type: ignore[return-value]  # two of them
        _projected(model, forms, rigid, [*modes, *itertools.chain(*blocks[:count])], shift, seen)
        for count in (_BLOCKS, _FINER_BLOCKS)
    )


def _solver(matrix: Sparse, source: str) -> Callable[[Array], Array]:
    """Solves S x = b for many b, shape (n, k), S symmetric and positive definite.

    A sparse S by PARDISO where the extra `fast-fe` is installed, else by SuperLU.
    """
    if matrix.shape[0] <= _DENSE:
        try:
            factor = linalg.cho_factor(matrix.toarray())
        except linalg.LinAlgError:
            raise _mechanism(source) from None
        return lambda b: np.asarray(linalg.cho_solve(factor, b))
    solve: Callable[[Array], Array]
    try:
        from pypardiso.pardiso_wrapper import PyPardisoError, PyPardisoSolver
    except ImportError:
        options = {"SymmetricMode": True}
        try:
            solve = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).solve
        except RuntimeError:  # exactly singular
            raise _mechanism(source) from None
    else:
        upper = sparse.csr_matrix(sparse.triu(matrix))
        solver = PyPardisoSolver(mtype=2)  # real, symmetric, positive definite
        try:
            solver.factorize(upper)
        except (ValueError, PyPardisoError):  # of an empty row, of a pivot
            raise _mechanism(source) from None
        solve = partial(solver.solve, upper)
    trial = np.random.default_rng(0).standard_normal((matrix.shape[0], 3))
    answer = solve(trial)  # the factors are not looked at: SuperLU copies them, which doubles the memory
    left = np.linalg.norm(matrix @ answer - trial, axis=0)
    if not (np.isfinite(answer).all() and ((answer * trial).sum(axis=0) > 0).all() and left.max() < _SOLVED):
        raise _mechanism(source)
    return lambda b: np.asarray(solve(np.ascontiguousarray(b)))


def _mechanism(source: str) -> ModelError:
    found = "found a motion without stiffness and without mass, or a negative stiffness"
    remedy = "constrain DOFs that nothing holds, such as rotations about a shell's normal, and export again"
    return ModelError.of(source, ("stiffness",), found, "K and M of a structure that holds together", remedy)


def _rigid_modes(model: FeModel, modes: Array, solve: Callable[[Array], Array], shift: float) -> Array:
    """Return the rigid-body modes of unit modal mass, shape (n, rigid).

    1. Take the rigid motions of the coordinates where all places are known: these are exact.
    2. Take the eigenvectors near zero, shape (n, m), which also move nodes without places and generalised coordinates.
    3. Keep what strains nothing: a support leaves some motions free and strains others.
    """
    found = np.empty((model.n_dofs, 0))
    near = modes[:, _energy(model, modes, 0.0) < _NEAR_ZERO * shift * (modes * (model.mass @ modes)).sum(axis=0)]
    for _ in range(_POLISHED):  # (K + σM)⁻¹ M keeps a motion at zero and takes away what is left of all others
        near = shift * solve(model.mass @ near)
    for motions_of_modes, motions in ((False, rigid_motions(model)), (True, near)):
        if motions is None or not motions.size:
            continue
        before = np.sqrt((motions * (model.mass @ motions)).sum(axis=0))
        motions = motions - found @ (found.T @ (model.mass @ motions))
        scale = np.sqrt(np.maximum((motions * (model.mass @ motions)).sum(axis=0), 0.0))
        there = scale > _NEW * before.max(initial=0.0)  # nodes in a line do not turn about it
        motions = motions[:, there] / scale[there]
        energy, weight = (_symmetric(motions.T @ (matrix @ motions)) for matrix in (model.stiffness, model.mass))
        values, turn = linalg.eigh(energy, weight) if there.any() else (np.empty(0), np.empty((0, 0)))
        turned = motions @ turn
        of_rows = abs(model.stiffness) @ np.abs(turned)
        size = (np.abs(turned) * of_rows).sum(axis=0)
        if motions_of_modes:  # the sum of the roundings of all entries, some of which are alike
            most = _ALIKE * model.rounding * np.sqrt((turned**2 * (model.stiffness.power(2) @ turned**2)).sum(axis=0))
        else:  # they show in nine of ten rows of exact motions: a support strains few rows
            left = np.abs(model.stiffness @ turned) / np.maximum(of_rows, np.finfo(float).tiny)
            most = np.minimum(_LEFT * np.quantile(left, 0.9, axis=0), _FEWEST_DIGITS) * size
        most = np.maximum(most, np.maximum(_RIGID * size, _EXACT * shift))
        # no support makes a value negative
        free = (values <= most) & (values >= -np.maximum(most, _FEWEST_DIGITS * size))
        found = np.hstack([found, turned[:, free]])
    return found


def _modes_below(
    stiffness: Sparse, mass: Sparse, solve: Callable[[Array], Array], shift: float, top_hz: float, source: str
) -> Array:
    """All modes below a frequency, shape (n, m), in any scale."""
    n, highest = mass.shape[0], (2 * np.pi * top_hz) ** 2
    if n <= _DENSE:
        inverse, shapes = linalg.eigh(mass.toarray(), (stiffness + shift * mass).toarray())
        return np.asarray(shapes[:, inverse > 1 / (highest + shift)])
    inverse_of = LinearOperator((n, n), matvec=solve, dtype=float)
    start = np.random.default_rng(0).standard_normal(n)
    count = _MODES_FIRST
    while True:
        count = min(count, n - 2)
        values, shapes = eigsh(stiffness, count, mass, sigma=-shift, OPinv=inverse_of, v0=start, tol=1e-12)
        if values.max() > highest or count == n - 2:
            return np.asarray(shapes[:, values < highest])
        if count >= _MOST_MODES:
            found = f"found more than {count} modes below {top_hz:.4g} Hz"
            remedy = "lower the band, or correct the units"
            raise ModelError.of(source, ("top_hz",), found, f"fewer than {_MOST_MODES}", remedy)
        count = min(2 * count, _MOST_MODES)


def _projected(
    model: FeModel, forms: Array, rigid: Array, vectors: list[Array], shift: float, seen: Sequence[int | None]
) -> ReducedModel:
    """The model in rigid-body modes and in what other vectors add to them.

    1. Take what each group of vectors adds to those before, orthonormal in S = K + σM, and to rigid-body modes in M.
    2. Turn them so that K and M become diagonal.
    3. Project all matrices.
    """
    # 1. a basis
    n_rigid, of_rigid, groups = rigid.shape[1], model.mass @ rigid, list[tuple[Array, Array]]()
    for group in vectors:
        for again in (False, True):  # a second time for what the first left by rounding
            left = group - rigid @ (of_rigid.T @ group)
            for others, energy_of in groups:
                left = left - others @ (energy_of.T @ left)
            if not again:
                before = np.sqrt(np.maximum(_energy(model, group, shift), np.finfo(float).tiny))
            after = np.sqrt(np.maximum(_energy(model, left, shift), 0.0))
            left = left[:, after > _SAME * before] / after[after > _SAME * before]
            work = model.stiffness @ left + shift * (model.mass @ left)
            size, axes = np.linalg.eigh(_symmetric(left.T @ work))
            kept = size > _SAME * size.max(initial=0.0)
            group = left @ (axes[:, kept] / np.sqrt(size[kept]))
            before = np.ones(group.shape[1])
        if group.shape[1]:
            groups.append((group, model.stiffness @ group + shift * (model.mass @ group)))
    basis = np.hstack([others for others, _ in groups])
    # 2. diagonal
    kinetic, strain = (_symmetric(basis.T @ (matrix @ basis)) for matrix in (model.mass, model.stiffness))
    inverse, turn = linalg.eigh(kinetic, strain + shift * kinetic)
    inverse, turn = np.maximum(inverse[::-1], _STATIC * inverse[-1]), turn[:, ::-1]
    if inverse.max() * shift >= 1:
        raise _mechanism(model.source)
    whole = np.hstack([rigid, basis @ (turn / np.sqrt(inverse))])
    eigenvalues = np.concatenate([np.zeros(n_rigid), 1 / inverse - shift])

    # 3. projections
    def projected(matrix: Sparse | None) -> Array:
        r = len(eigenvalues)
        return np.zeros((r, r)) if matrix is None else _symmetric(whole.T @ (matrix @ whole))

    parts = {
        name: ReducedPart(*(projected(m) for m in (part.stiffness, part.mass, part.bending)))
        for name, part in model.parts.items()
    }
    damping = None if model.damping is None else projected(model.damping)
    looked_at = np.array([np.zeros(len(eigenvalues)) if row is None else whole[row] for row in seen]).T
    unit = np.eye(len(eigenvalues))
    return ReducedModel(np.diag(eigenvalues), unit, whole.T @ forms, n_rigid, damping, parts, looked_at)


def _energy(model: FeModel, vectors: Array, shift: float) -> Array:
    """Twice the strain energy of vectors (n, k) in S, shape (k,)."""
    return np.asarray((vectors * (model.stiffness @ vectors + shift * (model.mass @ vectors))).sum(axis=0))


def _symmetric(matrix: Array) -> Array:
    return np.asarray((matrix + matrix.T) / 2)
