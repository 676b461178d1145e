"""From the tables of one test of a case, and the files they name, to the objects they describe."""

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import numpy as np

from jointbayes.case.case_text import CaseText, find_outside
from jointbayes.case.spec.data_table import SyntheticFrfSpec
from jointbayes.case.spec.fields import DataTable, KeyPath
from jointbayes.case.spec.measured_table import ChannelSpec, MeasuredBodySpec, MeasuredSpec
from jointbayes.case.spec.prior_tables import FactorPriorSpec, UncertainSpec
from jointbayes.case.spec.settings_tables import LeftOutSpec
from jointbayes.case.spec.structure_kinds import MatricesSpec, Matrix, matrix_findings
from jointbayes.case.spec.structure_table import ModalDampingSpec, StructureBase
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.errors import CaseError, MeasurementError
from jointbayes.frf import MeasuredBody, Ports, synthesise_frf
from jointbayes.inference import NoiseModel, Nuisance
from jointbayes.inference.noise.base import ErrorSizes, NoiseChoice
from jointbayes.joint import AnyJoint, joints_of
from jointbayes.structure import Body, StructureRecipe, family_of_recipe
from vibrecords import Data, split_modes
from vibrecords.arrays import Array
from vibrecords.errors import printable
from vibrecords.formats.channel_units import ChannelUnit
from vibrecords.measurement_plan import Channel, MeasurementPlan
from vibrecords.signals.hits import HitSettings
from vibrecords.signals.impact import ImpactSettings
from vibrecords.signals.spectra import ShakerSettings

_MOST_BYTES = 200_000_000
_MOST_ROWS = 2000

_G = 1e-3
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
    return MeasurementPlan(
        {name: _channel(channel) for name, channel in data.channels.items()},
        data.variance.built() if data.variance else None,
        data.quantity,
        data.f_min_hz,
        data.f_max_hz,
        data.thin,
        data.accelerometers == "roving",
        _signals(data) if data.records else None,
        exclude_hz=data.exclude_hz,
        conjugate=data.conjugate,
        layout=data.layout.names if data.layout else {},
    )


def _channel(spec: ChannelSpec) -> Channel:
    unit = ChannelUnit(spec.unit, spec.quantity, spec.sensitivity)
    return Channel(spec.label, spec.sign, spec.gain, spec.accelerometer_mass_g * _G, unit)


def _signals(data: MeasuredSpec) -> ImpactSettings | ShakerSettings:
    spec, band = data.records, (data.f_min_hz, data.f_max_hz)
    assert spec is not None
    if spec.method == "shaker":
        assert spec.block_s is not None
        return ShakerSettings(spec.block_s, spec.overlap, spec.window, spec.estimator, *band)
    hits = HitSettings(spec.block_s, spec.pretrigger_s, force_range_n=spec.force_range_n)
    return ImpactSettings(hits, spec.force_window_s, spec.exponential_end, spec.estimator, *band)


def recipe_of(spec: StructureBase, data: DataTable, measurement: Data | None = None) -> StructureRecipe:
    """The structure of a case; accelerometers sit where translations are measured, as files or the case say."""
    if not isinstance(data, MeasuredSpec):
        return spec.recipe(data.loaded)
    loaded = measurement.provenance.loaded if measurement and measurement.provenance else ()
    return spec.recipe(tuple(label for label in loaded if spec.absent(label) is None))


def _synthetic(spec: CaseSpec) -> SyntheticFrfSpec:
    """The table of data that a truth makes, of a case that has one."""
    assert spec.synthetic is not None
    return spec.synthetic


def true_stiffness(spec: CaseSpec) -> Array:
    """Quantities of the joints that make the data, shape (q,)."""
    return np.array([_synthetic(spec).truth.stiffness_by_name[name] for name in spec.all_quantities])


def noise_of(case: CaseSpec, data: Data) -> tuple[NoiseModel, tuple[Nuisance, ...]]:
    """Distribution of the residuals, and the priors of its parameters; its module has the name of the distribution."""
    spec = case.noise
    complex_frf = data.frfs is not None and spec.residuals == "complex"
    choice = NoiseChoice(
        spec.scale,
        (spec.scale_low_factor, spec.scale_high_factor),
        spec.scale_dof,
        spec.scale_guess,
        spec.dof,
        model_error_of(case.uncertain),
    )
    module = import_module(f"jointbayes.inference.noise.{spec.distribution}")
    return module.noise_of(choice, 2 if complex_frf else 1, data)


def model_error_of(spec: UncertainSpec) -> ErrorSizes | None:
    """Sizes of the model's errors in modes; None where none are stated."""
    e = spec.model_error
    if e is None:
        return None
    single = e.frequency_error, e.error_factor, e.damping_error, e.shape_error, e.constant_error
    return ErrorSizes(*single, e.edge_error, e.spring_error, e.spring_factor)


def measurement_of(case: CaseSpec, joint: AnyJoint, setup: str = "") -> Data:
    """The data that a case states or makes; FRFs with those at the joint, which the paper's iteration needs.

    Of several set-ups each has noise of its own, by its name.
    """
    stated = case.data.stated()
    if stated is not None:
        return stated
    spec = _synthetic(case)
    parametrisation, truth = case.parametrisation, true_stiffness(case)
    parametrisation.check(truth)
    # one virtual test: the joint's own DOFs come last, so that they leave the noise of the others as it is
    at_joint = tuple(dof for dof in joint.labels if dof not in spec.outputs)
    ports = Ports(np.array(spec.lines_hz()), spec.outputs + at_joint, spec.inputs)
    measured = synthesise_frf(
        true_family(case),
        joint,
        parametrisation.matrix(truth),
        ports,
        spec.noise.law(),
        spec.quantity,
        generator_of(spec.noise.seed, setup) if spec.noise.added else None,
        gain=spec.truth.gain,
    )
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


def generator_of(seed: int, setup: str) -> np.random.Generator:
    """Random numbers of a set-up: independent of those of others, and the same whatever others there are."""
    spawn_key = (zlib.crc32(setup.encode()),) if setup else ()
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=spawn_key))


def true_family(spec: CaseSpec) -> Body:
    """The structure that makes the data: as analysed, but for what the truth states otherwise."""
    truth, structure = _synthetic(spec).truth, spec.structure
    keys = {"youngs_modulus_gpa", "density_kg_m3", "length_mm", "accelerometer_mass_g"}
    stated: dict[str, object] = {key: getattr(truth, key) for key in keys & type(structure).model_fields.keys()}
    if truth.damping_ratio is not None:
        stated["damping"] = ModalDampingSpec(law="modal", ratio=truth.damping_ratio)
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
        Text of the case, or of one of its set-ups, for the places of keys.
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


def complete_from_data(spec: CaseSpec, measured: Data) -> CaseSpec:
    """The case with what it leaves to its data: damping ratios, and the distribution of residuals.

    Residuals are Student-t where the variance of FRFs was estimated line by line from few data: a residual over an
    estimated standard deviation is not Gaussian, with dof degrees of freedom its square is dof/(dof − 2) on average,
    not 1. Only where the case does not choose a distribution itself, and nothing else forbids it.

    Raises
    ------
    MeasurementError
        If the data show no mode with a damping ratio between 0 and 1, and the case asks for them.
    """
    spec, dof, noise = _take_measured_damping(spec, measured), measured.variance_dof, spec.noise
    free = "distribution" not in noise.model_fields_set and noise.scale != "integrated"
    if dof is None or dof >= _NEARLY_GAUSSIAN or not free or noise.residuals != "complex":
        return spec
    return spec.model_copy(update={"noise": noise.model_copy(update={"distribution": "student_t", "dof": float(dof)})})


def _take_measured_damping(spec: CaseSpec, measured: Data) -> CaseSpec:
    """The case with the damping ratios that the data show, where it asks for them.

    For FRFs each ratio stays uncertain by a factor of 3 either way, unless the case says otherwise: the same data are
    in the likelihood, and a prior as narrow as the modal fit would count them twice.

    Raises
    ------
    MeasurementError
        If the data show no mode with a damping ratio between 0 and 1.
    """
    damping = spec.structure.damping
    if not damping.measured:
        return spec
    assert measured.provenance is not None
    ratios = tuple(float(mode.damping_ratio) for mode in measured.provenance.modes)
    if not ratios or not all(0 < ratio < 1 for ratio in ratios):
        raise MeasurementError(
            f"structure.damping.ratio: found the ratios {list(ratios)} in the data; expected some between 0 and 1; "
            "state a ratio"
        )
    structure = spec.structure.model_copy(update={"damping": damping.model_copy(update={"ratio": ratios})})
    uncertain = spec.uncertain
    if uncertain.damping_ratio is None and measured.frfs is not None:
        high = max(min(_DAMPING_FACTOR, 0.9 / max(ratios)), 1.0)
        prior = FactorPriorSpec(low_factor=1 / _DAMPING_FACTOR, high_factor=high, own=True)
        uncertain = uncertain.model_copy(update={"damping_ratio": prior})
    return spec.model_copy(update={"structure": structure, "uncertain": uncertain})


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
    wanted, bodies = frozenset(used), []
    for name, body in spec.bodies.items():
        home.require_inside(("bodies", name, "file"), body.file)
        try:
            bodies.append(_body(name, body, wanted, home.directory))
        except MeasurementError as error:
            # messages of the files name the table of the data
            raise MeasurementError(str(error).replace("data.", f"bodies.{name}."), name, *error.key) from error
    return tuple(bodies)


def _body(name: str, spec: MeasuredBodySpec, wanted: frozenset[str], directory: Path) -> MeasuredBody:
    from vibrecords.assemble import read_measurement  # with all formats, which others do not need

    measured = read_measurement(spec.file, directory, plan_of_files(spec)).frfs
    assert measured is not None
    assert measured.provenance is not None  # as of all that is read
    whole = MeasuredBody.of(measured.frf, measured.variance, name)
    motions = {label: {label: 1.0} for label in whole.dofs if label in wanted}
    for label, rotation in spec.rotations.items():
        if label in wanted:
            assert rotation.spacing_mm is not None  # as its table asks
            weights = rotation.built(label, rotation.spacing_mm).weights
            motions[label] = dict(zip(rotation.stations, weights.tolist(), strict=True))
    if not motions:
        raise MeasurementError(
            f"measured body {name}: found no joint, output or input at its DOFs {', '.join(spec.labels)}; expected a "
            "joint to one of them; name its DOF in the joint, or remove the body"
        )
    return replace(whole.seen_at(motions), files=measured.provenance.files)


def read_matrices(spec: CaseSpec, home: CaseHome) -> CaseSpec:
    """The case with the matrices of files that its structure names.

    Raises
    ------
    CaseError
        If a file lies outside, cannot be read, or holds no square, symmetric matrix of the right size: file and key.
    """
    structure, read = spec.structure, dict[str, object]()
    if not isinstance(structure, MatricesSpec):
        return spec
    for loc, name in structure.matrices.items():
        if isinstance(name, str):
            path = ("structure", *loc)
            home.require_inside(path, [name])
            try:
                read[loc[-1]] = _matrix(home.directory / name, len(structure.dofs))
            except CaseError as error:
                raise CaseError(home.source.fault(path, f"{printable(name)}: {error}")) from error
    damping = structure.damping.model_copy(update={key: read.pop(key) for key in ["damping_matrix"] if key in read})
    return spec.model_copy(update={"structure": structure.model_copy(update={**read, "damping": damping})})


def _matrix(file: Path, rows: int) -> Matrix:
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
            array = np.load(file, allow_pickle=False)
        else:
            array = np.loadtxt(file, delimiter=",", ndmin=2)
        if array.dtype.kind not in "biuf" or array.ndim not in (1, 2):
            raise ValueError(f"{array.ndim} dimensions, numbers of kind {array.dtype}")
    except (OSError, ValueError, EOFError, UnicodeError) as error:
        reason = " ".join(str(error).split())[:100]
        raise CaseError(
            f"found no readable array ({reason}); expected numbers, in .csv separated by commas; correct it"
        ) from error
    if not np.isfinite(array).all():
        raise CaseError("found NaN or infinity; expected finite numbers; correct the file")
    matrix: Matrix = tuple(tuple(row) if array.ndim == 2 else row for row in array.astype(float).tolist())
    for wrong in matrix_findings((), matrix, rows):
        raise CaseError(f"{wrong.found}; expected {wrong.expected}; {wrong.remedy}")
    return matrix
