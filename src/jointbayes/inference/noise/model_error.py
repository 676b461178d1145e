"""Errors of the model in each mode, shared by all tests of one structure: no structure is exactly as it is modelled."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError
from jointbayes.inference.marginals import Nuisance
from jointbayes.inference.noise.base import ErrorSizes, NoiseModel, Residuals, finite_or_impossible
from vibrecords import Data, ModalData
from vibrecords.arrays import Array
from vibrecords.errors import read_only

#: Errors of a component of a shape are a fraction of it, or of this where it is less: near a node they do not vanish.
LEAST_COMPONENT = 0.3
#: Sizes over which is integrated, in standard deviations of the prior of their logarithm: of a factor of 3 the steps
#: are small next to what twenty frequencies leave open of the size; a spring's effect shows to a factor at best.
_NODES, _SPRING_NODES = np.linspace(-5.0, 5.0, 41), np.linspace(-3.0, 3.0, 19)


def noise_of(sizes: ErrorSizes, data: ModalData) -> tuple[NoiseModel, tuple[Nuisance, ...]]:
    """The noise model of measured modes with errors of the model, which has no parameters."""
    return ModelErrorNoise.of(data, sizes), ()


@dataclass(frozen=True, eq=False)
class ModelErrorNoise(NoiseModel):
    """The stated errors of measured modes, and an error of the model in each value that repeats in every test.

    With r the residuals over their standard deviations, E r rᵀ = 1 + Σ_k a_k a_kᵀ + e eᵀ + a² B Bᵀ. Here k runs over
    the frequencies, antiresonances, damping ratios, components of shapes and modal constants, and a_k holds the size of
    the model's error in k, over the standard deviation, at each place where k was measured: in repetitions, or in
    several tests of one structure. A frequency, also of an antiresonance, is off by s times itself, with s unknown; the
    others are of known size. e is what a clamp's edge does that is not where it is modelled, B Bᵀ what springs to
    ground do outside the model, of unknown size a: see `jointbayes.inference.common_errors`. What an error does to
    several tests alike is no evidence of a change of the joint between them. All is in closed form: for each a the
    covariance is turned once, so that it is diagonal for every s, and the density is the mean over the log-normal
    priors of s and a. Sampled, they and the residuals would make a funnel where there are as many stiffnesses as
    frequencies.

    Parameters
    ----------
    parts
        1: residuals are real.
    quantity
        What each value is, as `ModalData.value_names`; the same where it is that of one error; shape (m,).
    relative
        What the errors are fractions of, over the standard deviations: values, of eigenvalues twice, of components of
        shapes 0.3 if they are less; shape (m,).
    sizes
        Of the errors.
    edges
        What one standard deviation of the place of each clamp's edge does to the residuals, shape (m, edges); by
        default there is none.
    springs
        What springs do to them that move the lowest frequency, together, by its value, shape (m, places).
    clamp
        Which clamp has the edge: tests of one clamp have one.

    References
    ----------
    Kennedy, M. C., O'Hagan, A. (2001). Bayesian calibration of computer models. Journal of the Royal Statistical
    Society B 63(3), 425-464. DOI 10.1111/1467-9868.00294
    """

    parts: int
    quantity: tuple[str, ...]
    relative: Array
    sizes: ErrorSizes
    edges: Array = field(default_factory=lambda: np.zeros((0, 0)))
    springs: Array = field(default_factory=lambda: np.zeros((0, 0)))
    clamp: str = ""

    names: ClassVar[tuple[str, ...]] = ()
    takes_white_residuals: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "relative", read_only(self.relative))
        for name in ("edges", "springs"):
            given = np.asarray(getattr(self, name))
            object.__setattr__(self, name, read_only(given if given.size else np.zeros((len(self.relative), 0))))

    @classmethod
    def of(cls, data: ModalData, sizes: ErrorSizes) -> Self:
        """The model of measured modes."""
        kinds = [name.split()[0] for name in data.value_names]
        size = np.abs(data.values)
        unit = np.where(np.equal(kinds, "shape"), np.maximum(size, LEAST_COMPONENT), size)
        unit = unit * np.where(np.equal(kinds, "eigenvalue"), 2, 1)
        names = tuple(name.replace("eigenvalue", "frequency") for name in data.value_names)
        return cls(1, names, unit / data.sd, sizes)

    def fitted_to(self, data: Data, parts: int) -> Self:
        """The same law for the values of another measurement, without what edge and springs do to these."""
        if data.modes is None:
            raise ModelError.of("model error of modes", (), f"found {data.words}", "modes")
        return type(self).of(data.modes, self.sizes)

    @property
    def shares(self) -> ErrorSizes:
        """Tests share errors whose sizes have one prior."""
        return self.sizes

    def shared(self, noises: "Sequence[ModelErrorNoise]", bodies: Sequence[int]) -> "ModelErrorNoise":
        """Join the models of several tests of one body: the tests share its errors and one size s."""
        pairs = list(zip(noises, bodies, strict=True))
        clamps = [next(other.clamp or str(of) for other, of in pairs if of == body) for _, body in pairs]
        return replace(
            self,
            quantity=tuple(f"{name} of body {body}" for noise, body in pairs for name in noise.quantity),
            relative=np.concatenate([noise.relative for noise in noises]),
            edges=_side_by_side([noise.edges for noise in noises], clamps),
            springs=_side_by_side([noise.springs for noise in noises], bodies),
        )

    @cached_property
    def _known(self) -> Array:
        """Size of the error of each value that is known, shape (m,); 0 of those that are s."""
        known = {"damping": self.sizes.damping, "shape": self.sizes.shape, "constant": self.sizes.constant}
        return np.array([known.get(name.split()[0], 0.0) for name in self.quantity])

    @cached_property
    def _spring_sizes(self) -> tuple[Array, Array]:
        """Sizes a and ln of their prior weights, shape (A,): 0 alone where there is no spring."""
        if not self.springs.any():
            return np.zeros(1), np.zeros(1)
        weight = np.exp(-0.5 * _SPRING_NODES**2)
        return self.sizes.spring * self.sizes.spring_factor**_SPRING_NODES, np.log(weight / weight.sum())

    @cached_property
    def _base(self) -> tuple[Array, Array, Array, Array]:
        """B (m, m), and of the first R of B r the errors F without springs, G (R, R) and the springs' effects.

        The sizes act on these alone: of many components of shapes they move few directions. The others of B r are
        white, and independent of the first.
        """
        same = np.equal.outer(self.quantity, self.quantity)
        repeated = np.where(same, np.outer(self.relative, self.relative), 0.0)
        known = np.eye(len(same)) + np.outer(self._known, self._known) * repeated + self.edges @ self.edges.T
        frequency = self._known == 0
        of_frequencies = np.outer(frequency, frequency) * repeated
        _, each = np.unique(self.quantity, return_index=True)
        moved = np.hstack([of_frequencies[:, each], self.springs])
        moved = moved[:, moved.any(axis=0)]
        if moved.shape[1] >= len(known):
            return np.eye(len(known)), known, of_frequencies, self.springs
        white = np.linalg.inv(np.linalg.cholesky(known))
        moved = white @ moved
        basis, _ = np.linalg.qr(moved / np.linalg.norm(moved, axis=0), mode="complete")
        base, first = basis.T @ white, slice(moved.shape[1])
        of_first = (base @ of_frequencies @ base.T)[first, first]
        return base, np.eye(len(of_first)), of_first, (base @ self.springs)[first]

    def _based(self, residuals: Array) -> tuple[Array, Array]:
        """The first R values of B r, shape (n, R), and the others, of residuals (n, m)."""
        base, known, _, _ = self._base
        rows = residuals @ base.T
        return rows[:, : len(known)], rows[:, len(known) :]

    @cached_property
    def _turned(self) -> tuple[Array, Array, Array]:
        """W (A, R, R), g (A, R) and ln det of W B (A,) of each a, with W (1 + F + s² G) Wᵀ = 1 + s² diag(g).

        F are the errors of known size, with that a.
        """
        base, known, of_frequencies, springs = self._base
        size = self._spring_sizes[0][:, None, None]
        lower = np.linalg.cholesky(known + size**2 * (springs @ springs.T))
        inverse = np.linalg.inv(lower)
        growth, turn = np.linalg.eigh(inverse @ of_frequencies @ inverse.swapaxes(1, 2))
        log_det = np.linalg.slogdet(base)[1] - np.log(np.diagonal(lower, axis1=1, axis2=2)).sum(axis=1)
        return turn.swapaxes(1, 2) @ inverse, np.maximum(growth, 0.0), log_det

    @cached_property
    def _by_node(self) -> tuple[Array, Array]:
        """Of each a and s the precision of turned residuals (A, k, R), and ln of prior weight and peak (A, k)."""
        size = self.sizes.frequency * self.sizes.factor**_NODES
        variance = 1.0 + size[:, None] ** 2 * self._turned[1][:, None, :]
        weight = np.exp(-0.5 * _NODES**2)
        log_weight = np.log(weight / weight.sum()) + (self._spring_sizes[1] + self._turned[2])[:, None]
        return 1 / variance, log_weight - 0.5 * np.log(variance).sum(axis=2)

    def _by_size(self, first: Array) -> Array:
        """Logarithm of prior times likelihood of each pair of sizes, shape (A, k, n): quickest with draws in rows."""
        turned = self._turned[0] @ np.ascontiguousarray(first.T)
        precision, peak = self._by_node
        by_size: Array = precision @ turned**2
        return np.subtract(peak[:, :, None], by_size, out=by_size)

    def log_likelihood(self, z: Residuals, hyper: ArrayLike) -> Array:
        """ln L (n,) of residuals (n, m, 1), without the constant; −inf where a residual is not finite."""
        with np.errstate(all="ignore"):
            first, others = self._based(z[:, :, 0])
            by_size = self._by_size(first).reshape(self._by_node[1].size, len(z))
            most = by_size.max(axis=0)
            by_size -= most
            most -= (others**2).sum(axis=1)
            return finite_or_impossible(most + np.log(np.exp(by_size, out=by_size).sum(axis=0)))

    def _given(self, z: Residuals) -> Array:
        """The probability of each pair of sizes given residuals, shape (n, A, k); the prior's if not finite."""
        finite = np.isfinite(z).all(axis=(1, 2), keepdims=True)
        by_size = self._by_size(self._based(np.where(finite, z, 0.0)[:, :, 0])[0])
        share = np.exp(by_size - by_size.max(axis=(0, 1)))
        return np.moveaxis(share / share.sum(axis=(0, 1)), 2, 0)

    def _precision(self, share: Array) -> Array:
        """Mean precision of the first R of B r over the sizes that all residuals leave, shape (n, R, R)."""
        of_turned = (np.moveaxis(share, 1, 0) @ self._by_node[0]).swapaxes(0, 1).reshape(len(share), -1)
        turn = self._turned[0].reshape(of_turned.shape[1], -1)
        pairs = (turn[:, :, None] * turn[:, None, :]).reshape(len(turn), -1)
        return (of_turned @ pairs).reshape(len(share), turn.shape[1], turn.shape[1])

    def scores(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Residuals turned by a root of their mean precision over the sizes that all of them leave."""
        first, others = self._based(z[:, :, 0])
        return np.hstack([np.einsum("npq,np->nq", self._root(self._given(z)), first), others])[:, :, None]

    def whiten(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Residuals and their derivatives (k, m, 1) by the precision of the former: ∇ ln L is then −Jᵀe."""
        (root,), (first, others) = self._root(self._given(z[:1])), self._based(z[:, :, 0])
        return np.hstack([first @ root, others])[:, :, None]

    def _root(self, share: Array) -> Array:
        """Root X (n, R, R) with X Xᵀ the mean precision: of turned residuals, which without springs are independent."""
        turn = self._turned[0][len(self._turned[0]) // 2]
        back = np.linalg.inv(turn)
        return np.asarray(turn.T @ np.linalg.cholesky(back.T @ self._precision(share) @ back))

    def draw(self, rng: np.random.Generator, hyper: ArrayLike, lines: int, pairs: int) -> Residuals:
        """Replicated residuals, shape (n, m, 1), one for each row of `hyper`: (n, 2) of these sizes, (n, 0) of any."""
        sizes = np.atleast_2d(np.asarray(hyper, dtype=float))
        n = len(sizes)
        if not sizes.shape[1]:
            medians, factors = (self.sizes.frequency, self.sizes.spring), (self.sizes.factor, self.sizes.spring_factor)
            sizes = np.array(medians) * np.array(factors) ** rng.standard_normal((n, 2))
        each, place = np.unique(self.quantity, return_inverse=True)
        own = np.where(self._known > 0, self._known, sizes[:, :1]) * self.relative
        errors = rng.standard_normal((n, lines)) + own * rng.standard_normal((n, len(each)))[:, place]
        errors += rng.standard_normal((n, self.edges.shape[1])) @ self.edges.T
        errors += sizes[:, 1:] * (rng.standard_normal((n, self.springs.shape[1])) @ self.springs.T)
        return math.sqrt(0.5) * errors[:, :, None]

    def draw_size(self, rng: np.random.Generator, z: Residuals) -> Array:
        """Sizes s of the error of a frequency and a of springs, as fractions, (n, 2), given residuals (n, m, 1)."""
        share = self._given(z)
        flat = share.reshape(len(share), share.shape[1] * share.shape[2])
        node = (flat.cumsum(axis=1) < rng.random((len(flat), 1))).sum(axis=1).clip(max=flat.shape[1] - 1)
        spring, frequency = np.divmod(node, len(_NODES))
        within = (_NODES[1] - _NODES[0]) * (rng.random(len(flat)) - 0.5)
        sizes = self.sizes.frequency * self.sizes.factor ** (_NODES[frequency] + within)
        between = (_SPRING_NODES[1] - _SPRING_NODES[0]) * (rng.random(len(flat)) - 0.5)
        return np.column_stack([sizes, self._spring_sizes[0][spring] * self.sizes.spring_factor**between])

    def shift_of_edges(self, z: Residuals) -> Array:
        """Mean of the place of each clamp's edge given residuals (n, m, 1), in its standard deviations, (n, edges)."""
        first, others = self._based(math.sqrt(2) * z[:, :, 0])  # z = r/(√2 sd)
        moved, others_moved = (side.T for side in self._based(self.edges.T))
        precise = np.einsum("npq,np->nq", self._precision(self._given(z)), first)
        return np.asarray(precise @ moved + others @ others_moved)

    def words(self, values: Mapping[str, float], z: Residuals) -> tuple[str, ...]:
        """The size of the error that residuals at draws show, in a sentence."""
        size = np.median(self.draw_size(np.random.default_rng(0), z)[:, 0])
        return (f"The model's error in a natural frequency was inferred as {100 * size:.2g} %.",)


def _side_by_side(blocks: Sequence[Array], owners: Sequence[object]) -> Array:
    """Stack the columns of several tests: one owner's columns are one effect, other owners get columns of their own."""
    columns = dict.fromkeys(owner for owner, block in zip(owners, blocks, strict=True) if block.shape[1])
    width = {o: max(b.shape[1] for other, b in zip(owners, blocks, strict=True) if other == o) for o in columns}
    first = dict(zip(columns, np.cumsum([0, *width.values()]).tolist(), strict=False))
    whole = np.zeros((sum(map(len, blocks)), sum(width.values())))
    row = 0
    for owner, block in zip(owners, blocks, strict=True):
        if block.shape[1]:
            whole[row : row + len(block), first[owner] : first[owner] + block.shape[1]] = block
        row += len(block)
    return whole
