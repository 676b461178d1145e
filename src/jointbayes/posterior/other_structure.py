"""What the joint will do in a structure that was never tested: its FRFs, natural frequencies and damping.

Draws of the joint are those of the posterior. Of what else is uncertain, material is the tested structure's where
both are of one kind, and sizes are the new one's own. The error of the model, where the posterior allows for one, is
drawn for the modes of the new structure as large as the tested one's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import ModelError, require, require_probability
from jointbayes.frf import AnyStructure, AssembledShapes, Ports, receptance_model, rigid_body_modes
from jointbayes.inference import ModelErrorNoise, Nuisance, Problem
from jointbayes.inference.test import own_name
from jointbayes.joint import AnyJoint, JointMatrix, joint_matrix_of
from jointbayes.phrases import listed
from jointbayes.posterior.prediction import FrfPrediction, frf_band, simulate_at
from jointbayes.posterior.sampled import Sampled, equal_tailed
from jointbayes.rounding import attributes_of, number
from jointbayes.structure import LossFactor, ModalDamping, StructureRecipe, family_of_recipe
from jointbayes.structure.recipe import is_damping, is_damping_ratio
from vibrecords import ModeData, Observed, Quantity, quantity_factor
from vibrecords.arrays import Array

#: Quantities of a structure's own sizes: another one is measured again, and off by another error.
_OWN = frozenset({"length", "accelerometer_mass", "axial_force"})
_SEED = 9
_FEWEST_MODES, _MOST_MODES = 3, 40
_SURE = 1e-9  # of a natural frequency: nothing is measured here, so nothing is off by noise
_FAR = 1.5  # times the highest line of the data


@dataclass(frozen=True, eq=False)
class OtherStructure:
    """What a posterior's joint does in another structure.

    Parameters
    ----------
    frf
        Median and interval of each FRF, line by line.
    frequency_hz, damping_ratio
        Of the modes up to the highest line, of each draw, shape (draws, modes).
    values
        The FRFs of each draw, shape (draws, lines, outputs, inputs), SI units: for what is computed from them.
    premises
        What the prediction takes for granted, sentences.
    never_asked
        What the data never asked of the joint, sentences; empty where the prediction stays within them.
    """

    frf: FrfPrediction
    frequency_hz: Array
    damping_ratio: Array
    values: NDArray[np.complex128]
    premises: tuple[str, ...] = ()
    never_asked: tuple[str, ...] = ()

    def interval(self, mode: int, probability: float | None = None) -> tuple[float, float]:
        """Ends of the interval of a natural frequency, the first is mode 1, Hz."""
        return equal_tailed(
            self.frequency_hz[:, mode - 1], self.frf.probability if probability is None else probability
        )

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Number, median and interval of each natural frequency, and median damping ratio, as a table shows them."""
        return [
            (
                str(mode),
                f"{number(float(np.median(self.frequency_hz[:, mode - 1])), 5)} Hz",
                " to ".join(number(end, 5) for end in self.interval(mode)) + " Hz",
                f"{100 * float(np.median(self.damping_ratio[:, mode - 1])):.3g} %",
            )
            for mode in range(1, self.frequency_hz.shape[1] + 1)
        ]

    def __repr__(self) -> str:
        modes = [f"mode {mode}: {median} ({ends})" for mode, median, ends, _ in self.rows()]
        return "\n".join([repr(self.frf), *modes, *self.never_asked])

    def as_json(self) -> dict[str, Any]:
        """What ``prediction.json`` holds."""
        frf = self.frf
        modes = [
            {
                "frequency_hz": float(np.median(self.frequency_hz[:, i])),
                "interval": list(self.interval(i + 1)),
                "damping_ratio": float(np.median(self.damping_ratio[:, i])),
            }
            for i in range(self.frequency_hz.shape[1])
        ]
        return attributes_of(frf, "outputs", "inputs", "quantity", "probability") | {
            "band_hz": [float(frf.frequency_hz[0]), float(frf.frequency_hz[-1])],
            "modes": modes,
            "premises": list(self.premises),
            "never_asked": list(self.never_asked),
        }


def predict_other(
    posterior: Sampled,
    structure: StructureRecipe | AnyStructure | Problem | Sampled,
    ports: Ports,
    joint: AnyJoint | None = None,
    *,
    uncertain: Sequence[Nuisance] = (),
    own: frozenset[str] = frozenset(),
    quantity: Quantity = "receptance",
    test: str | None = None,
    probability: float = 0.95,
    max_draws: int = 400,
) -> OtherStructure:
    """FRFs, natural frequencies and damping of another structure with the joint of a posterior.

    Parameters
    ----------
    posterior
        The posterior.
    structure
        The other structure without its joint: a recipe, such as `jb.BeamRecipe(…)`, or a body, such as `jb.Structure`.
        Or a case, problem or posterior of it, whose joint and uncertain quantities are then the default.
    ports
        Lines, outputs and inputs that are wanted.
    joint
        Where the joint acts there; None takes the DOFs of the test, or of the other problem.
    uncertain
        What is uncertain of the other structure. What the posterior knows by the same name is taken from there, unless
        it is in `own`. By itself material and damping are as uncertain as in the posterior, sizes as its prior says.
    own
        Names of quantities that are the other structure's own.
    quantity
        Receptance, mobility or accelerance.
    test
        The test whose joint it is, where there are several, as at several levels; by default the first.
    probability, max_draws
        Probability inside each interval, and how many draws are evaluated.

    Raises
    ------
    ModelError
        If a DOF does not exist, the joint is of another size, or a quantity is none of the structure.
    """
    given = getattr(structure, "problem", structure)
    if isinstance(given, Problem):
        joint, names = given.test.joints if joint is None else joint, given.test.structures.names
        uncertain = uncertain or [nuisance for nuisance in given.prior.nuisances if nuisance.name in names]
        given = given.test.structures
    other: Any = getattr(given, "recipe", given)
    kinds = "jb.BeamRecipe(…) or another recipe, jb.Structure(…), a case, a problem or a posterior; make one"
    require(other, StructureRecipe | AnyStructure, "prediction: found as structure", kinds)
    require(ports, Ports, "prediction: found as ports", "jb.Ports(frequency_hz, outputs, inputs); make it")
    require_probability(probability, "prediction")
    part, rng = posterior.problem.part(test), np.random.default_rng([posterior.record.seed, _SEED])
    theta = posterior.thinned(max_draws)
    there, theta_there = _other_problem(part, other, joint, tuple(uncertain), own, theta, rng)
    top_hz = float(ports.frequency_hz.max())
    modal, count = _modes_below(there, theta_there, top_hz)
    errors = _model_errors(posterior.problem, part, there, theta, theta_there, modal[0], rng)
    values = _frfs(there, theta_there, ports, errors, np.median(modal[0], axis=0))
    values *= quantity_factor(ports.frequency_hz, quantity)[:, None, None]
    frequency = modal[0] if errors is None else modal[0] * (1 + errors)
    return OtherStructure(
        frf_band(values, ports, quantity, probability),
        frequency[:, :count],
        modal[1][:, :count],
        values,
        _premises(part, there, errors),
        tuple(_never_asked(part, there, top_hz)),
    )


def _other_problem(
    part: Problem,
    recipe: StructureRecipe | AnyStructure,
    joint: AnyJoint | None,
    uncertain: tuple[Nuisance, ...],
    own: frozenset[str],
    theta: Array,
    rng: np.random.Generator,
) -> tuple[Problem, Array]:
    """The other structure with the joint as a problem without data of its own, and draws of its coordinates."""
    test, known = part.test, {nuisance.name: i for i, nuisance in enumerate(part.prior.nuisances)}
    first = theta.shape[1] - len(known)
    base = getattr(test.structures, "recipe", None)
    is_like = type(base) is type(recipe) and getattr(base, "material", None) == getattr(recipe, "material", None)
    stated = {nuisance.name: nuisance for nuisance in uncertain}
    for name in test.structures.names:
        if name not in stated and _has(recipe, name):
            column = known[own_name(test.name, name, known) or name]
            stated[name] = replace(part.prior.nuisances[column], name=name)
    columns = []
    for name, nuisance in stated.items():
        if not isinstance(recipe, StructureRecipe):
            expected = "a recipe, whose quantities may be uncertain"
            raise ModelError.of("prediction", ("uncertain",), f"found {name} of a body", expected, "pass its recipe")
        recipe.require_quantity(name)
        among = own_name(test.name, name, known)
        shared = among is not None and is_like and name not in own and name.rpartition(".")[2] not in _OWN
        fresh = nuisance.prior.sample(rng, len(theta))
        columns.append(theta[:, first + known[among]] if shared and among is not None else fresh)
    nuisances = tuple(replace(n, name=name) for name, n in stated.items())
    ranges = {
        nuisance.name: _covering(nuisance.range, column) for nuisance, column in zip(nuisances, columns, strict=True)
    }
    body = family_of_recipe(recipe, ranges) if isinstance(recipe, StructureRecipe) else recipe
    joints = test.joints if joint is None else joint
    there = replace(test, structure=body, joints=joints, noise=None)
    if there.joints.size != test.joints.size:
        found = f"found a joint at {there.joints.size} DOFs for the stiffnesses of one at {test.joints.size}"
        raise ModelError.of("prediction", ("joint", "dofs"), found, "as many, in the same order", "correct the DOFs")
    body.index(there.joints.labels)
    prior = replace(part.prior, nuisances=nuisances)
    problem = replace(part, tests=(there,), prior=prior, left_out=(), extra_log_likelihood=None)
    return problem, np.column_stack([theta[:, :first], *columns])


def _has(recipe: StructureRecipe | AnyStructure, name: str) -> bool:
    """Whether a quantity is one of a structure with its damping law; a body without a recipe is exact."""
    if not isinstance(recipe, StructureRecipe):
        return False
    law = recipe.damping
    if is_damping(name):
        return isinstance(law, ModalDamping if is_damping_ratio(name) else LossFactor)
    return recipe.has_quantity(name)


def _covering(range_: tuple[float, float], column: Array) -> tuple[float, float]:
    """A range that holds all draws."""
    return min(range_[0], float(column.min())), max(range_[1], float(column.max()))


def _modes_below(there: Problem, theta: Array, top_hz: float) -> tuple[tuple[Array, Array], int]:
    """Frequencies and damping ratios of draws, each (n, modes), some beyond a frequency; and how many lie below it."""
    test = there.test
    body = test.structures.at((*test.joints.labels,), top_hz)
    most = min(_MOST_MODES, body.n_dofs - rigid_body_modes(body, test.joints) - test.joints.size)
    matrices, factors = there.prior.matrix(theta), there.structural(there.prior.factors(theta))
    count = min(most, _FEWEST_MODES)
    while True:
        modal = AssembledShapes(test.structures, test.joints, count).modes(matrices, factors)
        below = int((np.median(modal.frequency_hz, axis=0) <= top_hz).sum())
        if below < count or count == most:
            return (modal.frequency_hz, modal.damping_ratio), max(below, min(_FEWEST_MODES, count))
        count = min(most, 2 * count)


def _model_errors(
    problem: Problem,
    part: Problem,
    there: Problem,
    theta: Array,
    theta_there: Array,
    frequency: Array,
    rng: np.random.Generator,
) -> Array | None:
    """Errors of the model in natural frequencies, as fractions, shape (n, modes), as large as the data show them."""
    law = part.test.noise
    if not isinstance(law, ModelErrorNoise):
        return None
    middle = np.median(frequency, axis=0)
    data = ModeData(Observed(middle, _SURE * middle), numbers=tuple(range(1, middle.size + 1)))
    measured = there.with_test(data=data, noise=ModelErrorNoise.of(data, law.sizes))
    likelihood, prior = problem.log_posterior.likelihood, problem.prior
    size = likelihood.draw_error_size(law.shares, prior.matrix(theta), prior.factors(theta), rng)
    if size is None:
        return None
    noise = measured.log_posterior.likelihood.noise.draw(rng, size, middle.size, 1)
    return np.asarray(simulate_at(measured, theta_there, rng, noise) / frequency - 1)


def _frfs(there: Problem, theta: Array, ports: Ports, errors: Array | None, frequency: Array) -> NDArray[np.complex128]:
    """Receptances of draws, shape (n, lines, outputs, inputs), each line with the error of the mode that is nearest.

    A structure and a joint that are both stiffer by (1 + e)² have a mode higher by a fraction e.
    """
    test, matrices = there.test, joint_matrix_of(there.prior.matrix(theta))
    factors = there.structural(there.prior.factors(theta))
    recipe = getattr(test.structures, "recipe", None)
    if errors is None or recipe is None or not recipe.has_quantity("youngs_modulus"):
        return receptance_model(test.structure, test.joints, ports).receptance(matrices, factors)
    nearest = np.abs(np.log(ports.frequency_hz[:, None] / frequency)).argmin(axis=1)
    names = list(test.structures.names)
    values = np.empty((len(theta), len(ports.frequency_hz), len(ports.outputs), len(ports.inputs)), dtype=complex)
    for mode in np.unique(nearest):
        lines, stiffer = nearest == mode, (1 + errors[:, mode]) ** 2
        own = factors[:, names.index("youngs_modulus")] if "youngs_modulus" in names else np.ones(len(theta))
        columns = dict(zip(names, factors.T, strict=True)) | {"youngs_modulus": own * stiffer}
        ranges = {
            name: test.structures.ranges[name] if name != "youngs_modulus" else (0.0, 0.0)  # type: ignore[attr-defined]
            for name in columns
        }
        ranges["youngs_modulus"] = _covering((0.0, 0.0), np.log(columns["youngs_modulus"]))
        body, grown = family_of_recipe(recipe, ranges), stiffer[:, None, None]
        k, c, h = matrices.sides
        joint = JointMatrix(k * grown, c * np.sqrt(grown), h * grown) if matrices.damped else JointMatrix(k * grown)
        some = Ports(ports.frequency_hz[lines], ports.outputs, ports.inputs)
        model = receptance_model(body, test.joints, some)
        values[:, lines] = model.receptance(joint, np.column_stack([columns[name] for name in body.names]))
    return values


def _premises(part: Problem, there: Problem, errors: Array | None) -> tuple[str, ...]:
    """What the prediction takes for granted, in addition to the run's own premises."""
    names = listed(there.test.structures.names)
    held = f"Uncertain in addition to the joint: {names}." if names else "The new structure is taken as exact."
    sentences = [f"The joint is that of {part.test.name or part.name}: {part.test.joints}.", held]
    if errors is not None:
        sd = 100 * float(np.median(errors.std(axis=0)))
        sentences.append(f"The model's error in natural frequencies is {sd:.2g} %, as the data of the run show it.")
    return tuple(sentences)


def _never_asked(part: Problem, there: Problem, top_hz: float) -> list[str]:
    """What the data never asked of the joint: lines far beyond theirs, directions in which it was not loaded."""
    said, measured = [], float(part.test.data.band_hz[1])
    if top_hz > _FAR * measured:
        said.append(
            f"The data end at {number(measured, 4)} Hz and the prediction at {number(top_hz, 4)} Hz: how the joint's "
            "stiffness depends on frequency was never asked."
        )
    joint, labels = there.test.joints, set(there.test.structures.labels)
    held = {label.rpartition(":")[0]: set[str]() for label in joint.labels}
    for label in joint.labels:
        held[label.rpartition(":")[0]].add(label.rpartition(":")[2])
    for point, ways in held.items():
        free = [way for way in ("x", "y", "z", "rx", "ry", "rz") if f"{point}:{way}" in labels and way not in ways]
        if free:
            said.append(
                f"The joint was never asked how it holds {point} along {', '.join(free)}: nothing holds it there."
            )
    return said
