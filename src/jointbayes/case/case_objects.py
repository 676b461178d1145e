"""From the tables of each test of a case, and the files they name, to its objects, and from these to its problem.

What tests share is there once, what each has for itself with its name before it. A case of one
test has one without a name. A finite-element model that a case imports is read, and reduced once for all its ports.
"""

import itertools
import math
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from jointbayes.case.case_text import CaseText, find_outside
from jointbayes.case.spec import structure_tables
from jointbayes.case.spec.data_table import MeasuredSpec, SyntheticFrfSpec
from jointbayes.case.spec.fields import DataTable, KeyPath, metres
from jointbayes.case.spec.prior_tables import FactorPriorSpec, JointSpec
from jointbayes.case.spec.settings_tables import LeftOutSpec
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.errors import CaseError, MeasurementError, ModelError
from jointbayes.frf import (
    AnyStructure,
    MeasuredBody,
    NaturalFrequencies,
    Ports,
    Substructures,
    rigid_body_modes,
    synthesise_frf,
)
from jointbayes.inference import JointPrior, Marginal, NoiseModel, Nuisance, Problem, Test, default_prior
from jointbayes.inference.noise.base import NoiseChoice
from jointbayes.joint import COUPLED, RIGID, AnyJoint, Parametrisation, blocks_of, joints_of
from jointbayes.joint.quantities import prefixed
from jointbayes.structure import (
    Body,
    FeModel,
    FePart,
    FrameBody,
    ImportedRecipe,
    LossFactor,
    Port,
    StructureRecipe,
    family_of_recipe,
    read_structure,
    reduce_to_ports,
)
from jointbayes.structure.imported.beams import with_beams
from jointbayes.structure.imported.ports import nodes_in_box
from vibrecords import Data, split_modes
from vibrecords.arrays import Array
from vibrecords.errors import printable
from vibrecords.measurement_plan import MeasurementPlan
from vibrecords.signals.hits import HitSettings
from vibrecords.signals.spectra import ImpactSettings, ShakerSettings

_MOST_BYTES = 200_000_000
_MOST_ROWS = 2000

_NEARLY_GAUSSIAN = 400  # degrees of freedom: the mean square is half a per cent off
_DAMPING_FACTOR = 3.0  # either way, about damping ratios that were taken from the data


def plan_of(spec: CaseSpec) -> MeasurementPlan:
    """What a case with data in measurement files asks for of these."""
    files, joints = spec.files, joints_of(spec.joint_objects)
    assert files is not None
    free_gain = spec.uncertain.gain is not None
    asked = files.asked_for(spec.structure)
    return replace(plan_of_files(files), joint_dofs=joints.labels, free_gain=free_gain, **asked)


def plan_of_files(data: MeasuredSpec) -> MeasurementPlan:
    """What all tables of measurement files ask for of these."""
    signals: ImpactSettings | ShakerSettings | None = None
    if (spec := data.records) is not None:
        more = (spec.estimator, data.f_min_hz, data.f_max_hz)
        hits = HitSettings(spec.block_s, spec.pretrigger_s, force_range_n=spec.force_range_n)
        signals = ImpactSettings(hits, spec.force_window_s, spec.exponential_end, *more)
        if spec.method == "shaker":
            assert spec.block_s is not None
            signals = ShakerSettings(spec.block_s, spec.overlap, spec.window, *more)
    channels = {name: channel.built() for name, channel in data.channels.items()}
    variance, roving = data.variance.built() if data.variance else None, data.accelerometers == "roving"
    lines = data.quantity, data.f_min_hz, data.f_max_hz, data.thin
    stated: dict[str, Any] = {"layout": data.layout.model_dump(exclude_none=True) if data.layout else {}}
    stated |= {"exclude_hz": data.exclude_hz, "conjugate": data.conjugate, "window_tau_s": data.exponential_tau_s}
    return MeasurementPlan(channels, variance, *lines, roving, signals, virtual_points=data.points, **stated)


def recipe_of(
    spec: structure_tables.StructureBase, data: DataTable, measurement: Data | None = None
) -> StructureRecipe:
    """The structure of a case; accelerometers sit where translations are measured, as files or the case say."""
    if not data.in_files:
        return spec.recipe(data.loaded)
    loaded = measurement.provenance.loaded if measurement and measurement.provenance else ()
    return spec.recipe(tuple(label for label in loaded if spec.absent(label) is None))


def _synthetic(spec: CaseSpec) -> SyntheticFrfSpec:
    """The table of data that a truth makes, of a case that has one."""
    assert spec.synthetic is not None
    return spec.synthetic


def true_stiffness(spec: CaseSpec) -> Array:
    """Quantities of the joints that make the data, shape (q,)."""
    return _synthetic(spec).truth.values(spec.all_quantities)


def noise_of(case: CaseSpec, data: Data) -> tuple[NoiseModel, tuple[Nuisance, ...]]:
    """Distribution of the residuals, and the priors of its parameters; its module has the name of the distribution."""
    spec, error = case.noise, case.uncertain.model_error
    bounds, sizes = (spec.scale_low_factor, spec.scale_high_factor), error.built() if error else None
    choice = NoiseChoice(spec.scale, bounds, spec.scale_dof, spec.scale_guess, spec.dof, sizes)
    module = import_module(f"jointbayes.inference.noise.{spec.distribution}")
    return module.noise_of(choice, 1 if data.frfs is None else 2, data)


def measurement_of(case: CaseSpec, joint: AnyJoint, test: str = "") -> Data:
    """The data that a case states or makes; FRFs with those at the joint, which the paper's iteration needs.

    Of several tests each has noise of its own, by its name.
    """
    stated = case.data.built()
    if stated is not None:
        return stated
    spec = _synthetic(case)
    parametrisation, truth = case.parametrisation, true_stiffness(case)
    parametrisation.check(truth)
    # one virtual test: the joint's own DOFs come last, so that they leave the noise of the others as it is
    at_joint = tuple(dof for dof in joint.labels if dof not in spec.outputs)
    ports = Ports(np.array(spec.lines_hz()), spec.outputs + at_joint, spec.inputs)
    random = generator_of(spec.noise.seed, test) if spec.noise.added else None
    measured = synthesise_frf(
        true_family(case), joint, parametrisation.matrix(truth), ports, spec.noise.built(), spec.quantity, random,
        gain=spec.truth.gain,
    )  # fmt: skip
    return replace(measured.select(spec.outputs, spec.inputs), joint_frf=measured.frf)


def split_data(data: Data, left_out: LeftOutSpec) -> tuple[Data, Data | None]:
    """The data that enter the estimate, and those that are left out and predicted; None without any.

    Raises
    ------
    MeasurementError
        If there are no such data, or no others.
    """
    if data.modes is not None and left_out.modes:
        return split_modes(data.modes, left_out.modes)
    if data.frfs is not None and left_out.bands_hz:
        return data.frfs.split(left_out.bands_hz)
    return data, None


def generator_of(seed: int, test: str) -> np.random.Generator:
    """Random numbers of a test: independent of the others, and the same with any others."""
    spawn_key = (zlib.crc32(test.encode()),) if test else ()
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=spawn_key))


def true_family(spec: CaseSpec) -> Body:
    """The structure that makes the data: as analysed, but for what the truth states otherwise."""
    truth, structure = _synthetic(spec).truth, spec.structure
    keys = {"youngs_modulus_gpa", "density_kg_m3", "length_mm", "accelerometer_mass_g"}
    stated: dict[str, object] = {key: getattr(truth, key) for key in keys & type(structure).model_fields.keys()}
    if truth.damping_ratio is not None:
        stated["damping"] = structure_tables.ModalDampingSpec(law="modal", ratio=truth.damping_ratio)
    changed = {key: value for key, value in stated.items() if value is not None}
    return family_of_recipe(recipe_of(structure.model_copy(update=changed), spec.data))


@dataclass(frozen=True)
class CaseHome:
    """From where the names of files in a case count.

    Parameters
    ----------
    directory
        Of the case file.
    source
        Text of the case, or of one of its tests, for the places of keys.
    allow_outside
        Whether files may lie outside of the directory.
    """

    directory: Path
    source: CaseText
    allow_outside: bool = False

    def require_inside(self, path: KeyPath, names: Sequence[str]) -> None:
        """Refuse files outside the directory, by the key that names them, with a `CaseError`."""
        outside = None if self.allow_outside else find_outside(self.directory, names)
        if outside is not None:
            raise CaseError(self.source.fault((*path, outside[0]), *outside[1]))


#: FRFs without modes by what is wrong with them, see `vibrecords.warnings`.
_NO_MODE = {
    "constant": "an FRF of one value on all lines",
    "real_only": "an FRF without imaginary part",
    "noise_only": "an FRF of noise alone",
}


def complete_from_data(spec: CaseSpec, measured: Data) -> CaseSpec:
    """The case with what it leaves to its data.

    1. Take the damping ratios that the data show, where the case asks for them. For FRFs each ratio stays uncertain by
       a factor of 3 either way, unless the case says otherwise. The same data are in the likelihood, and a prior as
       narrow as the modal fit would count them twice.
    2. Let residuals be Student-t where the variance of FRFs was estimated line by line from few data, and the case does
       not choose a distribution. A residual over an estimated standard deviation is not Gaussian: with dof degrees of
       freedom its square is dof/(dof − 2) on average, not 1.

    Raises
    ------
    MeasurementError
        If the data show no mode with a damping ratio between 0 and 1, and the case asks for them.
    """
    # 1. Take the measured damping ratios.
    damping, uncertain = spec.structure.damping, spec.uncertain
    if damping.measured:
        assert measured.provenance is not None
        ratios = tuple(float(mode.damping_ratio) for mode in measured.provenance.modes)
        if not ratios or not all(0 < ratio < 1 for ratio in ratios):
            doubts = (_NO_MODE[w.key] for w in measured.provenance.warnings if w.key in _NO_MODE)
            found = f"the ratios {list(ratios)} in the data" if ratios else f"no mode in {next(doubts, 'the data')}"
            remedy = "look at the data, or write ratio = 0.01"
            where = "structure.damping.ratio"
            raise MeasurementError.of(where, (), f"found {found}", "ratios between 0 and 1", remedy)
        structure = spec.structure.model_copy(update={"damping": damping.model_copy(update={"ratio": ratios})})
        if uncertain.damping_ratio is None and measured.frfs is not None:
            high = max(min(_DAMPING_FACTOR, 0.9 / max(ratios)), 1.0)
            prior = FactorPriorSpec(low_factor=1 / _DAMPING_FACTOR, high_factor=high, own=True)
            uncertain = uncertain.model_copy(update={"damping_ratio": prior})
        spec = spec.model_copy(update={"structure": structure, "uncertain": uncertain})
    # 2. Choose the distribution of residuals.
    dof, noise = measured.variance_dof, spec.noise
    free = "distribution" not in noise.model_fields_set and noise.scale != "integrated"
    if dof is None or dof >= _NEARLY_GAUSSIAN or not free:
        return spec
    return spec.model_copy(update={"noise": noise.model_copy(update={"distribution": "student_t", "dof": float(dof)})})


def measured_bodies(spec: CaseSpec, used: Iterable[str], home: CaseHome) -> tuple[MeasuredBody, ...]:
    """Read the bodies of a case.

    Parameters
    ----------
    spec
        The case.
    used
        DOFs that joints and data name: others of a body are left out.
    home
        From where the names of files count.

    Raises
    ------
    CaseError
        If a file lies outside.
    MeasurementError
        If a file is missing or wrong, or lacks an FRF.
    """
    if spec.bodies:
        from vibrecords.assemble import read_measurement  # with all formats, which others do not need

    wanted, bodies = frozenset(used), []
    for name, body in spec.bodies.items():
        home.require_inside(("bodies", name, "file"), body.file)
        try:
            measured = read_measurement(body.file, home.directory, plan_of_files(body)).frfs
            assert measured is not None
            assert measured.provenance is not None  # as of all that is read
            whole = MeasuredBody.of(measured.frf, measured.variance, name)
            motions = {label: {label: 1.0} for label in whole.dofs if label in wanted}
            for label, rotation in body.rotations.items():
                if label in wanted:
                    assert rotation.spacing_mm is not None  # as its table asks
                    weights = rotation.rotation(label, rotation.spacing_mm).weights
                    motions[label] = dict(zip(rotation.stations, weights.tolist(), strict=True))
            if not motions:
                found = f"found no joint, output or input at its DOFs {', '.join(body.labels)}"
                remedy = "name its DOF in the joint, or remove the body"
                raise MeasurementError.of(f"measured body {name}", (), found, "a joint to one of them", remedy)
            bodies.append(replace(whole.seen_at(motions), files=measured.provenance.files))
        except MeasurementError as error:
            # messages of the files name the table of the data
            raise MeasurementError(str(error).replace("data.", f"bodies.{name}."), name, *error.key) from error
    return tuple(bodies)


def read_matrices(spec: CaseSpec, home: CaseHome) -> CaseSpec:
    """The case with the matrices of files that its structure names.

    Raises
    ------
    CaseError
        If a file lies outside, cannot be read, or holds no square, symmetric matrix of the right size: file and key.
    """
    structure, read = spec.structure, dict[str, object]()
    if not isinstance(structure, structure_tables.MatricesSpec):
        return spec
    for loc, name in structure.matrices.items():
        if isinstance(name, str):
            path = ("structure", *loc)
            home.require_inside(path, [name])
            try:
                read[loc[-1]] = _matrix(home.directory / name)
            except CaseError as error:
                raise CaseError(home.source.fault(path, f"{printable(name)}: {error}")) from error
    damping = structure.damping.model_copy(update={key: read.pop(key) for key in ["damping_matrix"] if key in read})
    whole = structure.model_copy(update={**read, "damping": damping})
    for wrong in whole.object_findings(("structure",)):
        file = structure.matrices.get(tuple(map(str, wrong.loc[1:])))
        found = f"{printable(file)}: {wrong.found}" if isinstance(file, str) else wrong.found
        raise CaseError(home.source.fault(wrong.loc, found, wrong.expected, wrong.remedy))
    return spec.model_copy(update={"structure": whole})


def _matrix(file: Path) -> structure_tables.Matrix:
    """Matrix of a .npy or .csv file."""
    kinds = (".npy", ".csv")
    if file.suffix.lower() not in kinds:
        raise CaseError(f"found the ending {file.suffix!r}; expected {' or '.join(kinds)}; rename the file")
    try:
        if not file.is_file():  # nor a pipe, which might never end
            raise CaseError("found no such file; expected one with the matrix; correct the name")
        if file.stat().st_size > _MOST_BYTES:
            raise CaseError(f"found more than {_MOST_BYTES:g} bytes; expected a matrix of {_MOST_ROWS} rows")
        if file.suffix.lower() == ".npy":
            with np.errstate(over="raise"):  # mapped, because a header may claim more than the file holds
                array = np.load(file, allow_pickle=False, mmap_mode="r")
        else:
            array = np.loadtxt(file, delimiter=",", ndmin=2)
        if array.dtype.kind not in "biuf" or array.ndim not in (1, 2):
            raise ValueError(f"{array.ndim} dimensions, numbers of kind {array.dtype}")
    except (OSError, ValueError, EOFError, UnicodeError, ArithmeticError) as error:
        reason = " ".join(str(error).split())[:100]
        words = "expected numbers, in .csv separated by commas; correct it"
        raise CaseError(f"found no readable array ({reason}); {words}") from error
    if not np.isfinite(array).all():
        raise CaseError("found NaN or infinity; expected finite numbers; correct the file")
    return tuple(tuple(row) if array.ndim == 2 else row for row in array.astype(float).tolist())


DEFAULT_GUESS_FACTOR = 1e3  # of k11, relative to the beam's own stiffness

_ABOVE_RIGID = 1.15  # a measured mode so far above the mode with a rigid joint is another one


@dataclass(frozen=True, eq=False)
class CaseTest:
    """One test of a case, built as far as it stands alone.

    Parameters
    ----------
    name
        Name; empty of a case of one test.
    source, spec
        Its tables: the rest of the file with what the test changes.
    recipe, bodies
        The structure, and bodies of it that are given by their measured FRFs.
    joint, data
        Where the joints act, and the data.
    noise, of_noise
        How the residuals are distributed, and the priors of its parameters.
    apart
        Data that are left out of the estimate and predicted, if any.
    """

    name: str
    source: CaseText
    spec: CaseSpec
    recipe: StructureRecipe
    bodies: tuple[MeasuredBody, ...]
    joint: AnyJoint
    data: Data
    noise: NoiseModel
    of_noise: tuple[Nuisance, ...]
    apart: Data | None = None

    @cached_property
    def structure(self) -> AnyStructure:
        """The structures that its priors think possible."""
        ranges = {n.name: n.range for n, _ in quantities_of(self.spec) if self.recipe.has_quantity(n.name)}
        family = family_of_recipe(self.recipe, ranges)
        if not self.bodies:
            return family
        return Substructures(family, self.bodies, next(iter(self.spec.bodies.values())).propagate)

    def named_nuisances(self) -> tuple[list[Nuisance], list[Nuisance]]:
        """Uncertain quantities, and those of the noise, by their names in the prior."""
        rest = [
            replace(nuisance, name=prefixed(self.name, nuisance.name)) if of_test else nuisance
            for nuisance, of_test in quantities_of(self.spec)
        ]
        owner = self.name if self.spec.noise.own else ""
        return rest, [replace(nuisance, name=prefixed(owner, nuisance.name)) for nuisance in self.of_noise]


def prior_of(tests: Sequence[CaseTest]) -> tuple[JointPrior, Array]:
    """Priors on the joints' coordinates and on all else that is uncertain; and the first guess of the joints, (q,)."""
    kinds: dict[str, Parametrisation | str] = {}
    marginals: list[Marginal] = []
    guesses: list[Array] = []
    for test in tests:
        for name, joint in test.spec.all_joints.items():
            named, owner = test.spec.joint_of_test(test.name, name)
            if named in kinds:
                continue
            kinds[named] = owner if named != owner else joint.parametrisation_object
            if named == owner:
                table, body = test.spec.structure, family_of_recipe(test.recipe)
                sides = [side for side in (joint.dofs, joint.against) if side and table.absent(side[0]) is None]
                extent, priors = test.recipe.extent, test.spec.priors_of(name)
                stated = {axis.name: getattr(priors, axis.name, None) for axis in joint.coordinates}
                all_stated = None not in stated.values()
                sizes = default_prior.own_stiffnesses(sides, joint.quantities, body, test.data, softest=not all_stated)
                of_joint = [
                    default_prior.default_marginal(axis, sizes, extent)
                    if (prior := stated[axis.name]) is None
                    else prior.marginal()
                    for axis in joint.coordinates
                ]
                marginals += of_joint
                guesses.append(guess_of(joint, sizes, of_joint))
    nuisances: dict[str, Nuisance] = {}
    of_noise: dict[str, Nuisance] = {}
    for test in tests:
        for named_here, among in zip(test.named_nuisances(), (nuisances, of_noise), strict=True):
            for nuisance in named_here:
                first = among.setdefault(nuisance.name, nuisance)
                if (first.unit, first.nominal) != (nuisance.unit, nuisance.nominal):  # one factor on what each states
                    among[nuisance.name] = Nuisance(first.name, "× stated", 1.0, first.prior)
    every = sorted(nuisances.values(), key=lambda n: n.name.rpartition(".")[2] == "gain")
    prior = JointPrior(blocks_of(kinds), tuple(marginals), (*every, *of_noise.values()))
    return prior, np.concatenate([[], *guesses])


def default_priors_of(specs: Mapping[str, CaseSpec]) -> frozenset[str]:
    """Coordinates of joints whose prior no one stated, by their names in the prior of all tests."""
    return frozenset(
        prefixed(spec.joint_of_test(test, name)[0], axis.name)
        for test, spec in specs.items()
        for name, joint in spec.stating_joints.items()
        for axis in joint.coordinates
        if getattr(spec.priors_of(name), axis.name, None) is None
    )


def problem_of(case_tests: Sequence[CaseTest], name: str) -> Problem:
    """The problem of a case."""
    prior, guess = prior_of(case_tests)
    prior.log_density(prior.mean[None])  # that there is a joint at all, before all lines are computed with
    tests: list[Test] = []
    left_out: list[Test] = []
    for built in case_tests:
        test = Test(built.name, built.structure, built.joint, built.data, built.noise)
        (left_out if built.spec.leaves_out(built.name) else tests).append(test)
        if built.apart is not None:
            noise = built.noise.fitted_to(built.apart, built.noise.parts)  # type: ignore[arg-type]  # of its kind
            left_out.append(replace(test, data=built.apart, noise=noise))
    declared = [test.spec.uncertain.exact for test in case_tests]
    exact = [
        name if all(name in of_test for of_test in declared) else prefixed(test.name, name)
        for test in case_tests
        for name in test.spec.uncertain.exact
    ]
    joined = next((test for test in case_tests if test.spec.joined), case_tests[0])
    error = joined.spec.uncertain.model_error
    sizes = error.built() if error else None
    return Problem(tests, prior, guess, name=name, left_out=left_out, exact=dict.fromkeys(exact), model_error=sizes)


def guess_of(joint: JointSpec, sizes: Mapping[str, default_prior.OwnStiffness], marginals: Sequence[Marginal]) -> Array:
    """First guess of the quantities of a joint, (q,): as stated, or of a coupled pair a translational spring alone.

    Joints of other kinds begin far stiffer than the structure; those between measured bodies in the middle of their
    priors.
    """
    if joint.quantities and not sizes:
        guess = joint.parametrisation_object.middle(np.array([marginal.mean for marginal in marginals]))
        return guess if joint.initial is None else np.concatenate([joint.initial.values(), guess[len(COUPLED) :]])
    if joint.initial is not None:
        guess = joint.initial.values()
    else:
        yielding = joint.stiffnesses[:1] if joint.kind == "coupled" else joint.stiffnesses
        springs = [sizes[q.name].size if q in yielding and not q.may_be_negative else 0.0 for q in joint.stiffnesses]
        guess = DEFAULT_GUESS_FACTOR * np.array(springs)
    damping = [
        math.sqrt(math.prod(default_prior.DEFAULT_LOSS if q.unit == "1" else default_prior.DEFAULT_DASHPOT_FACTORS))
        * (1.0 if q.unit == "1" else sizes[q.name].size)
        for q in joint.damping
    ]
    return np.concatenate([guess, damping])


def quantities_of(spec: CaseSpec) -> list[tuple[Nuisance, bool]]:
    """Uncertain quantities of structure and measurement, those of the structure first; and whether a test's own."""
    stated = spec.structure.stated | {"gain": ("1", 1.0)}
    quantities: list[tuple[Nuisance, bool]] = []
    for name, prior in spec.uncertain.given.items():
        if name == "damping_ratio":
            ratios = spec.structure.damping.values[name]
            labels = [name] if len(ratios) == 1 else [f"{name}_{i + 1}" for i in range(len(ratios))]
            each = [Nuisance(n, "1", r, prior.marginal()) for n, r in zip(labels, ratios, strict=True)]
        else:
            unit, value = stated[name]
            each = [Nuisance(name, unit, value, prior.marginal(value))]
        quantities += [(nuisance, prior.own) for nuisance in each]
    return sorted(quantities, key=lambda quantity: quantity[0].name == "gain")


def require_lowest(spec: CaseSpec, recipe: StructureRecipe, joint: AnyJoint, measured: Data) -> None:
    """Refuse measured modes that cannot be the model's lowest ones, where the case takes them for these.

    No joint is stiffer than a rigid one, so that a mode far above its place with a rigid joint is a later one.

    Raises
    ------
    MeasurementError
        If natural frequencies, or damping ratios mode by mode, are taken from the data and a lower mode was missed.
    """
    modes = measured.provenance.modes if measured.provenance else ()
    if not modes or not (spec.structure.damping.measured or measured.modes is not None):
        return
    if measured.modes is not None and measured.shown_frfs is not None:  # a run read them off FRFs, and counted them
        return
    family = family_of_recipe(recipe)
    count = min(len(modes), family.n_dofs - rigid_body_modes(family, joint) - joint.size)
    if count < 1:  # nothing moves where the joint does not
        return
    rigid = NaturalFrequencies(family, joint, count).frequency_hz(np.eye(joint.size) * RIGID)[0]
    for number, (mode, highest) in enumerate(zip(modes, rigid, strict=False), 1):
        if mode.frequency_hz > _ABOVE_RIGID * highest:
            model = "correct Young's modulus, density, length or section"
            remedy = f"{model}, or lower f_min_hz if a mode was missed"
            if measured.modes is None:  # only the damping rests on the numbers of modes
                ratio = float(np.median([each.damping_ratio for each in modes]))
                remedy = f"write ratio = {ratio:.2g}, lower f_min_hz, or {model}"
            expected = f"{highest:.4g} Hz at most ({'rigid joint' if joint.size else 'free structure'})"
            raise MeasurementError(f"found mode {number} at {mode.frequency_hz:.4g} Hz; expected {expected}; {remedy}")


#: Beyond the highest natural frequency that is data: a model that is a little wrong has it higher.
_BEYOND_MODES = 1.25

_Stamp = tuple[str, int, int]
"""A file by its path, its size and when it was written."""
Bodies = tuple[tuple[str, FrameBody], ...]
"""Bodies of beams in addition to the model, by their names."""


def top_of(spec: CaseSpec, data: Data | None) -> float:
    """The highest frequency that data ask of a model, Hz, also where they have not been made yet."""
    if data is not None:
        return data.band_hz[1] * (1.0 if data.frfs else _BEYOND_MODES)
    band = spec.data.band_hz
    assert band is not None  # data of files have been read
    return band[1] * (1.0 if spec.synthetic else _BEYOND_MODES)


def reduce_imported(spec: CaseSpec, home: CaseHome, dofs: Iterable[str], top_hz: float) -> CaseSpec:
    """A case of an imported model with that read and reduced.

    Everything that the case may ask of the model is reduced at once: ports, nodes that joints and data name, up
    to the highest line. Tests of one structure share one reduction.

    Parameters
    ----------
    spec
        The case.
    home
        From where the names of files count.
    dofs
        DOFs at which joints act, and those of data that were read from files.
    top_hz
        The highest frequency that is asked, Hz.

    Raises
    ------
    CaseError
        If a file lies outside.
    ModelError
        If one cannot be read, or the model cannot be reduced: by which key of the structure.
    """
    structure = spec.structure
    assert isinstance(structure, structure_tables.ImportedSpec)
    files: list[tuple[tuple[str, ...], _Stamp]] = []
    for key, name in structure.file_keys.items():
        home.require_inside(("structure", *key), [name])
        try:
            state = (home.directory / name).stat()
        except OSError:
            where, found = Path(name).name, "found no such file"
            raise ModelError.of(where, key, found, "the model's file", "correct the name") from None
        files.append((key, (str(home.directory / name), state.st_size, state.st_mtime_ns)))
    stamps = tuple(files)
    model = _read(stamps, structure.length_unit)
    labels = [*dofs, *spec.data.loaded, *itertools.chain(*spec.data.labelled.values())]
    named = dict.fromkeys(point for label in labels if (point := label.rpartition(":")[0]) not in structure.ports)
    ports = {name: _port(port, model, name) for name, port in structure.ports.items()}
    ports |= {point: Port((int(point),)) for point in named if point.isdecimal()}
    quantities = {nuisance.name: nuisance.range for nuisance, _ in quantities_of(spec)}
    whole = sum(max(map(abs, quantities.get(q, (0.0, 0.0)))) for q in ("youngs_modulus", "density")) / 2
    top_hz = max(structure.top_hz or 0.0, top_hz * float(np.exp(whole)))
    bodies = tuple((name, body.built()) for name, body in structure.bodies.items())
    beside, points = _with_beams(stamps, structure.length_unit, bodies, top_hz)
    ports |= {point: Port((points[point],)) for point in named if point in points}
    ends = {n: tuple(np.exp(r).tolist()) for n, r in quantities.items() if n.rpartition(".")[0] in beside.parts}
    held = ((node, way) for node, _, way in (support.rpartition(":") for support in structure.supports))
    supports = tuple((points.get(node) or int(node), way) for node, way in held)
    own_damping = isinstance(structure.damping, structure_tables.ModelDampingSpec)
    recipe = _reduced(
        stamps, structure.length_unit, bodies, tuple(ports.items()), top_hz, tuple(ends.items()), supports, own_damping
    )
    return spec.model_copy(update={"structure": structure.with_reduced(recipe)})


@lru_cache(maxsize=4)
def _read(stamps: tuple[tuple[tuple[str, ...], _Stamp], ...], length_unit: str) -> FeModel:
    files = {key: Path(path) for key, (path, _, _) in stamps}
    further = {key: files.get((f"{key}_file",)) for key in ("mass", "damping", "dofs", "nodes")}
    model = read_structure(files["file",], length_unit=length_unit, **further)
    maps = {key: further[key] for key in ("dofs", "nodes")}
    parts = {}
    for name in dict.fromkeys(key[1] for key in files if key[0] == "parts"):
        of = {key[2]: file for key, file in files.items() if key[:2] == ("parts", name)}
        part = read_structure(of["file"], length_unit=length_unit, mass=of.get("mass_file"), **maps)
        bending = None
        if "bending_file" in of:
            bending = read_structure(of["bending_file"], length_unit=length_unit, mass=of.get("mass_file"), **maps)
        parts[name] = _part(model, part, bending, name)
    return replace(model, parts={**model.parts, **parts})


@lru_cache(maxsize=4)
def _with_beams(
    stamps: tuple[tuple[tuple[str, ...], _Stamp], ...], length_unit: str, bodies: Bodies, top_hz: float
) -> tuple[FeModel, dict[str, int]]:
    model = _read(stamps, length_unit)
    return with_beams(model, dict(bodies), top_hz) if bodies else (model, {})


def _part(model: FeModel, part: FeModel, bending: FeModel | None, name: str) -> FePart:
    """A part on the rows of the whole model."""
    missing = [row for row in map(tuple, part.dofs.tolist()) if row not in model.row_of]
    if missing:
        node, way = missing[0]
        found = f"found DOF {way} of node {node} in {part.source}, which {model.source} does not have"
        remedy = "export both with one numbering"
        raise ModelError.of(part.source, ("parts", name, "file"), found, "a part of it", remedy)
    rows = [model.row_of[row] for row in map(tuple, part.dofs.tolist())]
    place = sparse.eye_array(model.n_dofs, format="csc")[:, rows]
    stiffness, mass = (place @ matrix @ place.T for matrix in (part.stiffness, part.mass))
    if bending is None:
        return FePart(stiffness, mass)
    bent = _part(model, bending, None, name).stiffness
    return FePart(stiffness - bent, mass, bent)


def _port(spec: structure_tables.PortSpec, model: FeModel, name: str) -> Port:
    nodes: tuple[int, ...] = (spec.node,) if spec.node is not None else spec.nodes
    if spec.box_mm is not None:
        corners = np.sort([metres(corner) for corner in spec.box_mm], axis=0)
        nodes = nodes_in_box(model, *corners)
        if not nodes:
            ends = [f"{low:g} to {high:g}" for low, high in zip(*(1e3 * np.array(model.extent)), strict=True)]
            found = f"found no node of {model.source} in the box"
            expected = f"some of its {len(model.nodes)}, which lie at x {ends[0]}, y {ends[1]}, z {ends[2]} mm"
            raise ModelError.of(f"port {name}", ("ports", name, "box_mm"), found, expected, "correct the corners")
    return Port(nodes, spec.kind == "rigid", None if spec.at_mm is None else metres(spec.at_mm))


@lru_cache(maxsize=8)
def _reduced(
    stamps: tuple[tuple[tuple[str, ...], _Stamp], ...],
    length_unit: str,
    bodies: Bodies,
    ports: tuple[tuple[str, Port], ...],
    top_hz: float,
    ends: tuple[tuple[str, tuple[float, float]], ...],
    supports: tuple[tuple[int, str], ...],
    own_damping: bool,
) -> ImportedRecipe:
    model, _ = _with_beams(stamps, length_unit, bodies, top_hz)
    law = None if own_damping else LossFactor(0.0)
    return reduce_to_ports(model, dict(ports), top_hz, law, ends=dict(ends), supports=supports)
