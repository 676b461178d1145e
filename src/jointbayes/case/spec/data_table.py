"""The `[data]` table of a case file: what was measured, or how synthetic measurements are made.

Its kinds are synthetic FRFs or frequencies, what is in measurement files, with `[data.layout]` for what the variables
of a file stand for, and modes. A body that is given by its FRFs, `[bodies.NAME]`, has the table of such files.
"""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, Strict

import vibrecords
from jointbayes.case.spec.fields import (
    DATA_KIND,
    ESTIMATOR,
    FREQUENCIES,
    MOST_FILES,
    MOST_LABELS,
    MOST_VALUES,
    POINT_LABEL,
    DataTable,
    Finding,
    Fraction,
    Frequencies,
    KeyPath,
    Label,
    Labels,
    ListOf,
    Positive,
    Ratios,
    Spec,
    Vector,
    band_lines,
    count_field,
    distinct,
    even,
    key_field,
    law_findings,
    max_length,
    metres,
    not_above,
    not_negative,
    positive,
    raise_findings,
    table_field,
    to_list,
)
from jointbayes.case.spec.prior_tables import NamedStiffnessSpec
from jointbayes.case.spec.structure_tables import Direction, StructureBase
from jointbayes.errors import MeasurementError
from jointbayes.joint import DIRECTIONS

if TYPE_CHECKING:
    from vibrecords.measurement_plan import Channel, VarianceSource
    from vibrecords.rotations import Rotation
    from vibrecords.virtual_points import VirtualPoint


_VARIABLE = 'the variable of the file that holds {}, as "H", "run.H", "run(2).H" or, of a matrix, "data(:,2)"'
_Name = Annotated[str, Field(min_length=1, max_length=400)]


def _variable(held: str, example: str, or_number: str = "", **default: Any) -> Any:  # noqa: ANN401
    return key_field(_VARIABLE.format(held) + or_number, example, **default)


_OR = ", or the number itself in quotes"
_TABLE_AXIS = key_field('what the first column of a table is, "time" in s or "frequency_hz"', "time")


class LayoutSpec(Spec):
    """Names of variables by what they stand for; where one of values is given, nothing else of the file is read."""

    axis: Annotated[Literal["time", "frequency_hz"] | None, _TABLE_AXIS] = None
    frequency_hz: _Name | None = _variable("the frequency lines in Hz", "Freq", default=None)
    omega_rad_s: _Name | None = _variable("the lines in rad/s", "w", default=None)
    f_start_hz: _Name | None = _variable("the first line in Hz", "f0", _OR, default=None)
    f_step_hz: _Name | None = _variable("the distance of lines in Hz", "df", _OR, default=None)
    frf: _Name | None = _variable("the complex FRFs", "H1", default=None)
    real: _Name | None = _variable("the real part of the FRFs", "a", default=None)
    imaginary: _Name | None = _variable("their imaginary part", "b", default=None)
    magnitude: _Name | None = _variable("the magnitude of the FRFs", "A", default=None)
    magnitude_db: _Name | None = _variable("the magnitude in dB, as 20 log10", "A", default=None)
    phase: _Name | None = _variable("the phase, with its unit in its name", "P_deg", default=None)
    phase_deg: _Name | None = _variable("the phase in degrees", "P", default=None)
    phase_rad: _Name | None = _variable("the phase in radians", "P", default=None)
    coherence: _Name | None = _variable("the coherence", "C", default=None)
    time: _Name | None = _variable("the instants in s", "tt", default=None)
    sample_rate_hz: _Name | None = _variable("the sampling rate in Hz", "rate", _OR, default=None)
    samples: _Name | None = _variable("the samples of all channels, one column each", "data", default=None)
    force: _Name | None = _variable("the force, hits in columns", "data(:,1)", default=None)
    response: _Name | None = _variable("the response, hits in columns", "data(:,2)", default=None)
    mode_frequencies_hz: _Name | None = _variable("the natural frequencies of modes in Hz", "freqs", default=None)
    damping_ratios: _Name | None = _variable("the damping ratios of modes", "zeta", default=None)
    mode_shapes: _Name | None = _variable("the shapes of modes, channels × modes", "V", default=None)


SensorQuantity = Literal["force", "displacement", "velocity", "acceleration"]


def _signed(text: str) -> str:
    if not re.fullmatch(f"-?{POINT_LABEL}:(x|y|z|rx|ry|rz)", text):
        expected = 'a DOF such as "11:y", or "-11:y" if it points the other way'
        raise_findings([Finding((), f'found "{text[:40]}"', expected, 'write for example "11:y"')])
    return text


def _channel_table(value: object) -> object:
    """A channel that is a DOF alone, as the table it stands for; the JSON schema knows it by its name."""
    return {"dof": value} if isinstance(value, str) else value


_DOF = key_field('a DOF such as "11:y", or "-11:y" if it points the other way', "11:y")
_MEASURES = key_field('what it measures, "force", "displacement", "velocity" or "acceleration"', "acceleration")


class ChannelSpec(Spec):
    """What a channel of the file stands for; in a case file often the DOF alone: ``"Point:11:Y+" = "11:y"``."""

    dof: Annotated[str, AfterValidator(_signed), _DOF]
    quantity: Annotated[SensorQuantity | None, _MEASURES] = None
    unit: Annotated[str, max_length(60)] = key_field(
        'the unit of what it measures, as "g", "m/s^2" or "lbf", where the file does not say or is wrong', "g", ""
    )
    sensitivity: float | None = positive("the volts for one of its unit, where the file holds volts", 0.01, None)
    gain: float = positive("the factor by which the channel's signal is multiplied", 1.02, 1.0)
    accelerometer_mass_g: float = not_negative("the mass in g of the sensor, to be taken out of the FRFs", 2.0, 0.0)

    @property
    def label(self) -> str:
        """The DOF without its sign."""
        return self.dof.removeprefix("-")

    def built(self) -> Channel:
        """The channel."""
        from vibrecords.formats.channel_units import ChannelUnit
        from vibrecords.measurement_plan import Channel

        unit = ChannelUnit(self.unit, self.quantity, self.sensitivity)
        sign = -1.0 if self.dof.startswith("-") else 1.0
        return Channel(self.label, sign, self.gain, self.accelerometer_mass_g * 1e-3, unit)


_STATIONS = key_field("two or three translations in order along the structure", ["1:y", "2:y", "3:y"])
_SCHEME = key_field(
    'the differences, "first order" (two stations), "second order, end" or "second order, centre"', "first order"
)
_USE = key_field("true (the rotation is data, its stations are not) or false (it serves the iteration)", False)


class RotationSpec(Spec):
    """A rotation by differences of translations."""

    stations: Annotated[Labels, Field(min_length=2, max_length=3), _STATIONS]
    scheme: Annotated[Literal["first order", "second order, end", "second order, centre"], _SCHEME] = "first order"
    spacing_mm: float | None = positive("the distance of neighbouring stations in mm", 20.0, None)
    in_likelihood: Annotated[bool, _USE] = False
    axis: Literal["x", "y", "z"] = key_field('the axis along which the stations lie, "x", "y" or "z"', "x", "x")

    def rotation(self, label: str, spacing_mm: float) -> Rotation:
        """The rotation of this label, its stations so far apart; negative where they run backwards."""
        from vibrecords.rotations import Rotation

        return Rotation(label, self.stations, spacing_mm * 1e-3, self.scheme, self.in_likelihood, self.axis)


_SOURCE = key_field('where the variance comes from, "coherence", "repeats" or "relative"', "coherence")
_MEASURED_AVERAGES = key_field("the number of averages, a whole number from 1 to 1000000", 10, ge=1, le=10**6)


class VarianceSpec(Spec):
    """Variance of measured FRFs; the law of relative and floor is all of it, or the least that is believed."""

    used_with = {"averages": ("source", "coherence")}  # noqa: RUF012 (no field)

    source: Annotated[Literal["coherence", "repeats", "relative"], _SOURCE] = "coherence"
    relative: float = not_negative("the least standard deviation as a fraction of |H|", 0.001, 0.001)
    floor: float = not_negative("the least standard deviation as a fraction of the median |H|", 0.001, 0.0)
    averages: Annotated[int | None, _MEASURED_AVERAGES] = None

    def built(self) -> VarianceSource:
        """The variance; without a law where nothing is the least that is believed."""
        from vibrecords.measurement_plan import VarianceSource

        stated = self.source == "relative" or self.relative + self.floor > 0
        law = vibrecords.RelativeNoise(self.relative, self.floor) if stated else None
        return VarianceSource(self.source, law, self.averages, "relative" in self.model_fields_set)

    def _findings(self) -> Iterator[Finding]:
        if self.source == "relative":
            yield from law_findings(self)


_PULSE = Field(gt=0, description="how long after its trigger the force counts in s, above 0", examples=[0.005])
_END = key_field("what is left of the exponential window at the end of a block, above 0 and at most 1", 0.05)
_OVERLAP = Field(ge=0, lt=1, description="the overlap of blocks, a number of at least 0 and below 1", examples=[0.5])


class RecordsSpec(Spec):
    """How FRFs are made from the time histories of a file."""

    used_with = {  # noqa: RUF012 (no field)
        **dict.fromkeys(("pretrigger_s", "force_window_s", "exponential_end", "force_range_n"), ("method", "impact")),
        **dict.fromkeys(("overlap", "window"), ("method", "shaker")),
    }

    method: Literal["impact", "shaker"] = key_field('how the structure was excited, "impact" or "shaker"', "impact")
    estimator: Annotated[Literal["H1", "H2", "Hv"], ESTIMATOR] = "H1"
    block_s: float | None = positive("the length of a block in s", 1.0, None)
    pretrigger_s: float = not_negative("how long before its trigger a block begins, in s", 0.01, 0.0)
    force_window_s: Annotated[float | None, _PULSE] = None
    exponential_end: Annotated[Fraction, _END] = 1.0
    force_range_n: float | None = positive("the full scale of the force channel in N", 500.0, None)
    overlap: Annotated[float, _OVERLAP] = 0.5
    window: Literal["hann", "boxcar"] = key_field('the window of the blocks, "hann" or "boxcar"', "hann", "hann")

    def _findings(self) -> Iterator[Finding]:
        if self.method == "shaker" and self.block_s is None:
            yield Finding(("block_s",), missing=True)


_SENSORS_MM = key_field(
    'the place in mm of each sensor or hit, by what stands before the colon of the DOFs of its channels',
    {"101": [383.0, 20.0, 0.0]}, min_length=1,
)  # fmt: skip


class VirtualPointSpec(Spec):
    """A point of a rigid face, whose DOFs follow from the sensors on the face."""

    place_mm: Vector = key_field("the place of the point in mm, [x, y, z]", [383.0, 0.0, 0.0])
    sensors_mm: Annotated[dict[str, Vector], max_length(MOST_LABELS), _SENSORS_MM]
    directions: Annotated[dict[Label, Vector], max_length(MOST_LABELS)] = key_field(
        "the direction of a channel's DOF, where it is not along the axis of its label", {"101:y": [0.0, 0.8, 0.6]}, {}
    )
    dofs: Annotated[ListOf[Direction], AfterValidator(distinct)] = key_field(
        "those of the point's six DOFs that are wanted", ["y", "rz"], DIRECTIONS, min_length=1
    )

    def point(self, name: str, channels: Iterable[str]) -> VirtualPoint:
        """The point of this name, with the sensors on its face among the DOFs of channels."""
        from vibrecords.virtual_points import VirtualPoint

        sensors = {}
        for label in channels:
            sensor, _, axis = label.rpartition(":")
            if sensor in self.sensors_mm:
                along = float(axis == "x"), float(axis == "y"), float(axis == "z")
                sensors[label] = metres(self.sensors_mm[sensor]), self.directions.get(label, along)
        return VirtualPoint(name, self.dofs, metres(self.place_mm), sensors)

    def _findings(self) -> Iterator[Finding]:
        for label, direction in self.directions.items():
            if not any(direction):
                yield Finding(("directions", label), "found a direction of no length", "another", "correct it")


_LAYOUT = Field(description="what the variables of the files stand for: frequency_hz, frf, time, force and others")
_FILE = key_field("the name of a measurement file, or a list of names", "tip.uff")
_MEASURED_QUANTITY = key_field(
    'what the FRFs are, "receptance", "mobility" or "accelerance", where the file does not say or is wrong',
    "accelerance",
)
_SENSORS = key_field('"fixed" (all sensors stay on) or "roving" (one sensor moves from output to output)', "fixed")
_EXCLUDED = key_field("a list of bands [lowest, highest] in Hz whose lines are left out", [[49.5, 50.5]])
_CONJUGATE = key_field("true (the FRFs have the time factor exp(-i omega t)) or false (exp(+i omega t))", True)
_TAU_TEXT = "the time constant in s of an exponential window on force and response, above 0 and at most 1000"
_VARIANCE = Field(description="the variance of the FRFs: source")
_FileName = Annotated[str, Field(min_length=1, max_length=1000)]


_Band = tuple[Annotated[float, Field(ge=0)], Positive]


class MeasuredSpec(DataTable):
    """What all data from files have: the files, what their channels stand for, and the lines that are used."""

    in_files: ClassVar[bool] = True
    file: Annotated[ListOf[_FileName], Field(min_length=1), BeforeValidator(to_list), max_length(MOST_FILES), _FILE]
    quantity: Annotated[Literal["receptance", "mobility", "accelerance"] | None, _MEASURED_QUANTITY] = None
    f_min_hz: float | None = positive("the lowest frequency used in Hz", 20.0, None)
    f_max_hz: float | None = positive("the highest frequency used in Hz", 2500.0, None)
    exclude_hz: Annotated[ListOf[Annotated[_Band, Strict(False)]], max_length(1000), _EXCLUDED] = ()
    conjugate: Annotated[bool, _CONJUGATE] = False
    exponential_tau_s: float | None = key_field(_TAU_TEXT, 0.25, None, gt=0, le=1000)
    thin: int | None = count_field("every how many lines one is kept", 2, 1, 10_000, default=None)
    accelerometers: Annotated[Literal["fixed", "roving"], _SENSORS] = "fixed"
    channels: dict[str, Annotated[ChannelSpec, BeforeValidator(_channel_table)]] = key_field(
        'a DOF for each channel that is used, as "Point:11:Y+" = "11:y"', {"Point:11:Y+": "11:y"}, min_length=1
    )
    layout: Annotated[LayoutSpec | None, _LAYOUT] = None
    records: RecordsSpec | None = table_field("how FRFs are made from time histories: method", None)
    variance: Annotated[VarianceSpec | None, _VARIANCE] = None
    virtual_points: dict[str, VirtualPointSpec] = key_field(
        "a table for each point of a rigid face whose DOFs follow from sensors, as [data.virtual_points.11]", {}, {}
    )

    @property
    def labelled(self) -> dict[KeyPath, tuple[str, ...]]:
        """DOFs of the channels; a virtual point takes the place of its sensors."""
        sensors = {sensor for point in self.virtual_points.values() for sensor in point.sensors_mm}
        labels = {name: channel.label for name, channel in self.channels.items()}
        of_channels: dict[KeyPath, tuple[str, ...]] = {
            ("data", "channels", name): (label,)
            for name, label in labels.items()
            if label.rpartition(":")[0] not in sensors
        }
        return of_channels | {
            ("data", "virtual_points", name, "dofs"): tuple(f"{name}:{dof}" for dof in point.dofs)
            for name, point in self.virtual_points.items()
        }

    @property
    def points(self) -> tuple[VirtualPoint, ...]:
        """The virtual points."""
        labels = [channel.label for channel in self.channels.values()]
        return tuple(point.point(name, labels) for name, point in self.virtual_points.items())

    def try_objects(self) -> None:
        """Its rotations, which know no distance of their stations yet."""
        for label, rotation in getattr(self, "rotations", {}).items():
            try:
                rotation.rotation(label, 1.0)
            except MeasurementError as error:
                error.key = "rotations", label, *rotation._key_of(error.key)
                raise

    def _findings(self) -> Iterator[Finding]:
        if self.f_min_hz is not None and self.f_max_hz is not None:
            yield from not_above(self.f_min_hz, self.f_max_hz, "f_min_hz", "f_max_hz", "in Hz")
        for i, (low, high) in enumerate(self.exclude_hz):
            if high <= low:
                fault = f"found the band from {low!r} to {high!r} Hz"
                yield Finding(("exclude_hz", i), fault, "the lower frequency first", "correct one of the two")
        labels = [channel.label for channel in self.channels.values()]
        for name, point in self.virtual_points.items():
            for sensor in point.sensors_mm:
                turns = [label for label in labels if label.startswith(f"{sensor}:r")]
                if turns or not any(label.rpartition(":")[0] == sensor for label in labels):
                    fault = f"found a channel for {turns[0]}" if turns else f"found no channel for {sensor}"
                    place = ("virtual_points", name, "sensors_mm", sensor)
                    yield Finding(place, fault, "channels that are translations of it", "correct [data.channels]")
        if self.conjugate and self.records is not None:
            fault = "found true with time histories, of which the FRFs are made here"
            yield Finding(("conjugate",), fault, "it for FRFs of a file", "remove it")
        if self.exponential_tau_s is not None and self.records is not None:
            fault = "found a time constant with time histories, of which the FRFs are made here"
            yield Finding(("exponential_tau_s",), fault, "exponential_end in [data.records]", "remove it")


class MeasuredFrfSpec(MeasuredSpec):
    """FRFs of measurement files."""

    frfs: ClassVar[bool] = True

    kind: Annotated[Literal["measured_frf"], DATA_KIND]
    outputs: Labels = key_field("a list of the measured DOFs used; empty: all", ["11:y"], ())
    inputs: Labels = key_field("a list of the excited DOFs used; empty: all", ["11:y"], ())
    variance: Annotated[VarianceSpec, _VARIANCE] = VarianceSpec()
    rotations: dict[Label, RotationSpec] = key_field('a table for each rotation, as [data.rotations."1:rz"]', {}, {})

    def asked_for(self, structure: StructureBase) -> dict[str, Any]:
        """What a plan of the measurement asks for besides what all files give, by the names of `MeasurementPlan`.

        Stations of rotations are points of a straight beam.
        """
        rotations = []
        for label, rotation in self.rotations.items():
            first, second, *_ = (int(station.split(":")[0]) for station in rotation.stations)
            assert structure.spans is not None  # as the rules of the tables ask
            spacing = (second - first) * structure.stated["length"][1] / structure.spans
            if rotation.spacing_mm is not None:
                spacing = math.copysign(rotation.spacing_mm, spacing)
            rotations.append(rotation.rotation(label, spacing))
        return {"outputs": self.outputs, "inputs": self.inputs, "rotations": tuple(rotations)}

    def _findings(self) -> Iterator[Finding]:
        yield from super()._findings()
        for label, rotation in self.rotations.items():
            if rotation.axis != "x":
                place = ("rotations", label, "axis")
                yield Finding(place, f'found "{rotation.axis}"', '"x", along which the beam lies', "remove it")


class MeasuredFrequenciesSpec(MeasuredSpec):
    """Natural frequencies of the modes that FRFs of measurement files show, the lowest ones."""

    kind: Annotated[Literal["measured_frequencies"], DATA_KIND]
    modes: int | None = count_field("how many modes are used, the lowest ones", 3, 1, 1000, default=None)
    sd_relative: float = not_negative("the standard deviation as a fraction", 0.001, 0.0)
    sd_hz: float = not_negative("the standard deviation in Hz", 0.1, 0.0)

    def asked_for(self, structure: StructureBase) -> dict[str, Any]:
        """Natural frequencies."""
        from vibrecords.measurement_plan import FrequencyPlan

        return {"frequencies": FrequencyPlan(self.modes, self.sd_relative, self.sd_hz)}


_PROPAGATE = key_field(
    "true (the noise of the FRFs counts in the likelihood) or false (it is ignored: intervals are too narrow)", True
)
_BODY_ROTATIONS = key_field('a table for each rotation, as [bodies.spindle.rotations."spindle:rz"]', {})


class MeasuredBodySpec(MeasuredSpec):
    """A body given by its FRFs between the DOFs that its channels stand for, and rotations between them."""

    kind: Literal["measured"] = key_field('the kind of body, "measured"', "measured")
    variance: Annotated[VarianceSpec, _VARIANCE] = VarianceSpec()
    rotations: Annotated[dict[Label, RotationSpec], _BODY_ROTATIONS] = {}  # noqa: RUF012 (frozen model)
    propagate: Annotated[bool, _PROPAGATE] = True

    @property
    def labels(self) -> tuple[str, ...]:
        """DOFs that the body has: those of its channels, and its rotations."""
        return tuple(dict.fromkeys((*itertools.chain.from_iterable(self.labelled.values()), *self.rotations)))

    def _findings(self) -> Iterator[Finding]:
        yield from super()._findings()
        measured = set(itertools.chain.from_iterable(self.labelled.values()))
        for label, rotation in self.rotations.items():
            if rotation.spacing_mm is None:
                yield Finding(("rotations", label, "spacing_mm"), missing=True)
            if rotation.in_likelihood:
                expected = "false: a rotation of a body stands beside its stations, with the noise that they share"
                yield Finding(("rotations", label, "in_likelihood"), "found true", expected, "remove it")
            for i, station in enumerate(rotation.stations):
                if station not in measured:
                    fault = f'found "{station}", which no channel of the body stands for'
                    place = ("rotations", label, "stations", i)
                    yield Finding(place, fault, "a DOF of the body", "map its channel or correct the station")


_MOST_REPETITIONS, _MOST_MODES = 10_000, 1000


def _depth(value: object) -> int:
    """Lists in lists, as their first entries go."""
    return 1 + (_depth(value[0]) if value else 0) if isinstance(value, list | tuple) else 0


def _repeated(depth: int) -> BeforeValidator:
    """Takes the list of one repetition for the list of one such list that it stands for."""
    return BeforeValidator(lambda value: [value] if _depth(value) == depth - 1 else value)


_Number = Annotated[float, Field(allow_inf_nan=True)]  # NaN where nothing was observed
_Row = Annotated[ListOf[_Number], Field(min_length=1), max_length(_MOST_MODES)]
_Repeated = Field(min_length=1), AfterValidator(even), max_length(_MOST_REPETITIONS)
_Rows = Annotated[ListOf[_Row], *_Repeated, _repeated(2)]
_Shape = Annotated[ListOf[_Number], Field(min_length=1), max_length(MOST_LABELS)]
_Shapes = Annotated[ListOf[_Shape], Field(min_length=1), max_length(_MOST_MODES)]
_AllShapes = Annotated[ListOf[_Shapes], *_Repeated, _repeated(3)]
_EachLabel = Annotated[ListOf[Label], Field(min_length=1), BeforeValidator(to_list), max_length(_MOST_MODES)]
_EachMode = Annotated[
    ListOf[Annotated[float, Field(ge=0)]], Field(min_length=1), BeforeValidator(to_list), max_length(_MOST_MODES)
]
_Numbers = Annotated[ListOf[Annotated[int, Field(ge=1, le=_MOST_MODES)]], Field(min_length=1), max_length(_MOST_MODES)]

_EACH = "a number of at least 0, or a list of such numbers, one for each mode"
_EACH_ZERO = _EACH.replace("mode", "antiresonance")
_FREQUENCIES = key_field(
    "the natural frequencies in Hz, a list with one above 0 for each mode, or a list of such lists, one for each "
    "repetition of the test; nan where none was found",
    [12.1, 31.4],
)
_EIGENVALUES = key_field(
    "the eigenvalues (2 pi f)^2 in rad2/s2 in place of the frequencies, a list for each repetition of the test",
    [5780.0],
)
_RATIOS = key_field(
    "the damping ratios, from 0 to below 1, a list for each repetition of the test as the frequencies", [0.01, 0.012]
)
_DOFS = key_field("a list of at least one DOF at which shapes were measured, without the reference", ["1:y", "6:y"])
_ZERO_DOF = key_field("the DOF that was excited and measured, or a list of such, one for each antiresonance", "11:y")
_ZERO_NUMBERS = key_field(
    "the number of each antiresonance among those of its DOF, from 1; by default the lowest, as they stand", [1, 2]
)
_MATCH = key_field('how modes are matched, by "number" or by "shape"', "number")


class ModeShapesSpec(Spec):
    """Components of mode shapes relative to a reference DOF."""

    dofs: Annotated[Labels, Field(min_length=1), _DOFS]
    reference: _EachLabel = key_field("the DOF whose component is 1, or a list of such, one for each mode", "11:y")
    components: _AllShapes = key_field(
        "the components of the shapes over that at the reference: a list for each mode of one for each DOF, or a list "
        "of such lists, one for each repetition of the test; nan where none was found",
        [[0.1, 0.4], [-0.3, -0.6]],
    )
    sd: _EachMode = key_field(f"the standard deviation of a component, {_EACH}", 0.02)


class AntiresonancesSpec(Spec):
    """Antiresonances of drive points."""

    field_keys = {  # noqa: RUF012 (no field)
        "dofs": "dof", "frequency.values": "frequencies_hz", "frequency.sd": "sd_relative"
    }  # fmt: skip

    dof: Annotated[_EachLabel, _ZERO_DOF]
    frequencies_hz: _Rows = key_field(
        "the antiresonances in Hz, a list for each repetition of the test, as the frequencies", [82.0, 520.0]
    )
    sd_relative: _EachMode = key_field(f"the standard deviation as a fraction, {_EACH_ZERO}", 0.005, (0.0,))
    sd_hz: _EachMode = key_field(f"the standard deviation in Hz, {_EACH_ZERO}", 0.5, (0.0,))
    numbers: Annotated[_Numbers | None, _ZERO_NUMBERS] = None

    @property
    def highest(self) -> int:
        """Highest number of any DOF."""
        return max(self.numbers or Counter(self.dof * (len(self.frequencies_hz[0]) // len(self.dof))).values())

    def built(self) -> vibrecords.Antiresonances:
        """The antiresonances."""
        dofs = self.dof[0] if len(self.dof) == 1 else self.dof
        return vibrecords.Antiresonances(
            dofs, _observed(self, self.frequencies_hz, "sd_relative", "sd_hz"), self.numbers or ()
        )


class ConstantsSpec(Spec):
    """Modal constants of pairs of DOFs."""

    outputs: _EachLabel = key_field("a list of the measured DOFs", ["6:y", "11:y"])
    inputs: _EachLabel = key_field("the DOF that was excited, or a list of such, one for each of outputs", "11:y")
    values_per_kg: _AllShapes = key_field(
        "the modal constants of unit modal mass in 1/kg, with signs: lists as of components of shapes", [[0.4, 1.2]]
    )
    sd_relative: _EachMode = key_field(f"the standard deviation as a fraction, {_EACH}", 0.05, (0.0,))
    sd_per_kg: _EachMode = key_field(f"the standard deviation in 1/kg, {_EACH}", 0.02, (0.0,))

    def built(self) -> vibrecords.ModalConstants:
        """The modal constants."""
        inputs = self.inputs * len(self.outputs) if len(self.inputs) == 1 else self.inputs
        return vibrecords.ModalConstants(
            self.outputs, inputs, _observed(self, self.values_per_kg, "sd_relative", "sd_per_kg")
        )


_SHAPES_TABLE = "the mode shapes: dofs, reference, components, sd"
_ZEROS_TABLE = "the antiresonances of drive points: dof, frequencies_hz, sd_relative or sd_hz, numbers"
_CONSTANTS_TABLE = "the modal constants: outputs, inputs, values_per_kg, sd_relative or sd_per_kg"


class ModesSpec(DataTable):
    """Modes of a modal test, or of several repetitions of it."""

    field_keys = {  # noqa: RUF012 (no field)
        "frequency": "frequencies_hz", "frequency.values": "frequencies_hz", "frequency.sd": "sd_relative",
        "eigenvalues.sd": "sd_relative", "damping.values": "damping_ratios", "damping.sd": "damping_sd_relative",
        "shapes.components.sd": "shapes.sd",
        "constants.values": "constants.values_per_kg", "constants.sd": "constants.sd_relative",
    }  # fmt: skip

    kind: Annotated[Literal["modes"], DATA_KIND]
    frequencies_hz: Annotated[_Rows | None, _FREQUENCIES] = None
    eigenvalues: Annotated[_Rows | None, _EIGENVALUES] = None
    sd_relative: _EachMode = key_field(f"the standard deviation as a fraction, {_EACH}", 0.005, (0.0,))
    sd_hz: _EachMode = key_field(f"the standard deviation in Hz, {_EACH}", 0.5, (0.0,))
    eigenvalue_sd: _EachMode = key_field(f"the standard deviation of an eigenvalue in rad2/s2, {_EACH}", 24.0, (0.0,))
    damping_ratios: Annotated[_Rows | None, _RATIOS] = None
    damping_sd_relative: _EachMode = key_field(
        f"the standard deviation of a damping ratio as a fraction of it, {_EACH}", 0.1, (0.0,)
    )
    damping_sd: _EachMode = key_field(f"the standard deviation of a damping ratio, {_EACH}", 0.001, (0.0,))
    numbers: _Numbers | None = key_field(
        "the number of each mode among those of the assembled structure, from 1; by default the lowest", [1, 3], None
    )
    match: Annotated[Literal["number", "shape"], _MATCH] = "number"
    shapes: ModeShapesSpec | None = table_field(_SHAPES_TABLE, None)
    zeros: AntiresonancesSpec | None = table_field(_ZEROS_TABLE, None)
    constants: ConstantsSpec | None = table_field(_CONSTANTS_TABLE, None)

    @property
    def frequencies(self) -> tuple[tuple[float, ...], ...]:
        """Natural frequencies in Hz, each repetition, also of eigenvalues."""
        if self.eigenvalues is not None:
            return tuple(tuple(math.sqrt(value) / (2 * math.pi) for value in row) for row in self.eigenvalues)
        return self.frequencies_hz or ()

    @property
    def least_modes(self) -> Mapping[KeyPath, int]:
        """Number of the highest mode; an antiresonance lies between the mode of its number and the next."""
        key = "numbers" if self.numbers else "frequencies_hz"
        highest: dict[KeyPath, int] = {("data", key): max(self.numbers or (len(self.frequencies[0]),))}
        return highest if self.zeros is None else highest | {("data", "zeros", "dof"): 1 + self.zeros.highest}

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest natural frequency of any repetition, Hz."""
        seen = [f for row in self.frequencies for f in row if not math.isnan(f)]
        return min(seen), max(seen)

    @property
    def depends_on(self) -> frozenset[str]:
        """Damping, if its ratios are stated, and masses of sensors, if DOFs are."""
        damping = {"damping_ratio", "loss_factor"} if self.damping_ratios is not None else set()
        return frozenset(damping | ({"accelerometer_mass"} if self.labelled else set()))

    @property
    def labelled(self) -> dict[KeyPath, tuple[str, ...]]:
        """DOFs of shapes with their references, of antiresonances, and of modal constants."""
        labelled: dict[KeyPath, tuple[str, ...]] = {}
        tables = {"shapes": ("dofs", "reference"), "zeros": ("dof",), "constants": ("outputs", "inputs")}
        for table, keys in tables.items():
            if (given := getattr(self, table)) is not None:
                labelled |= {("data", table, key): getattr(given, key) for key in keys}
        return labelled

    def built(self) -> vibrecords.ModeData:
        """The modes."""
        import numpy as np

        damping = shapes = None
        if self.damping_ratios is not None:
            damping = _observed(self, self.damping_ratios, "damping_sd_relative", "damping_sd")
        if (given := self.shapes) is not None:
            reference = given.reference[0] if len(given.reference) == 1 else given.reference
            components = vibrecords.Observed(np.array(given.components), np.array(given.sd)[:, None])
            shapes = vibrecords.ModeShapes(given.dofs, reference, components)
        rows = self.frequencies_hz or self.eigenvalues
        assert rows is not None
        of_eigenvalues = self.eigenvalues is not None
        frequency = _observed(self, rows, "sd_relative", "eigenvalue_sd" if of_eigenvalues else "sd_hz")
        made = vibrecords.ModeData(frequency, damping, shapes, self.numbers or (), self.match, of_eigenvalues)
        if self.zeros is not None:
            made = replace(made, zeros=self.zeros.built())
        return made if self.constants is None else replace(made, constants=self.constants.built())

    def _findings(self) -> Iterator[Finding]:
        given = [key for key in ("frequencies_hz", "eigenvalues") if getattr(self, key) is not None]
        if len(given) != 1:
            both = Finding(("eigenvalues",), "given together with frequencies_hz", "one of the two", "remove the other")
            yield both if given else Finding(("frequencies_hz",), missing=True)
            return
        key = given[0]
        if bad := [value for row in getattr(self, key) for value in row if value <= 0]:
            remedy = "correct it, or write nan where none was found"
            yield Finding((key,), f"found {bad[0]:g}", "numbers above 0", remedy)
        absolute, other = ("eigenvalue_sd", "sd_hz") if key == "eigenvalues" else ("sd_hz", "eigenvalue_sd")
        if max(getattr(self, other)) > 0:
            yield Finding((other,), f"found it with {key}", f"sd_relative or {absolute}", f"state {absolute}")


def _observed(table: Spec, rows: Sequence[object], relative_key: str, absolute_key: str) -> vibrecords.Observed:
    """Values with standard deviations that are fractions of their means over repetitions, or absolute, or both."""
    import numpy as np

    values = np.array(rows, dtype=float)
    for key in (relative_key, absolute_key):
        if (given := len(getattr(table, key))) not in (1, values.shape[1]):
            found, expected = f"found {given} for {values.shape[1]}", "one, or one for each"
            raise MeasurementError.of("modes", (key,), found, expected, "correct the list")
    # a fraction of the mean over repetitions: the spread does not depend on what one of them happened to give
    seen = ~np.isnan(values)
    mean = np.where(seen, values, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    each = (slice(None), None) if values.ndim > 2 else ...  # of a mode, at each of its DOFs
    relative, absolute = (np.array(getattr(table, key))[each] for key in (relative_key, absolute_key))
    return vibrecords.Observed(values, np.hypot(relative * np.abs(mean), absolute))


_MOST_LINES = 1_000_000  # frequency lines; more is a slip in f_step_hz, and would fill the memory


_COHERENCE = Field(gt=0, lt=1, description="the coherence γ², a number above 0 and below 1", examples=[0.98])
# One average makes every coherence 1, so that it says nothing about the noise.
_AVERAGES = Field(ge=2, le=10**6, description="the number of averages, a whole number from 2 to 1000000", examples=[10])
_MASS = not_negative("the mass in g of each accelerometer that makes the data", 2.0)
_RATIO = key_field("the damping ratio that makes the data, from 0 to below 1, or a list of such numbers", 0.01)


class NoiseSpec(Spec):
    """Noise of synthetic data: relative to |H| with a floor, or the one that a coherence leaves after averaging."""

    relative: float = not_negative("the standard deviation as a fraction of |H|", 0.03, 0.0)
    floor: float = not_negative("the standard deviation as a fraction of the median |H|", 0.01, 0.0)
    coherence: Annotated[float | None, _COHERENCE] = None
    averages: Annotated[int | None, _AVERAGES] = None
    seed: int = count_field("the seed", 1, 0)
    added: bool = key_field("true (noise in the data) or false (in the likelihood only)", True, True)

    def built(self) -> vibrecords.NoiseLaw:
        """The law."""
        if self.coherence is not None and self.averages is not None:
            return vibrecords.CoherenceNoise(self.coherence, self.averages, self.floor)
        return vibrecords.RelativeNoise(self.relative, self.floor)

    def _findings(self) -> Iterator[Finding]:
        if self.coherence is None and self.averages is None:
            yield from law_findings(self)
        elif self.coherence is None or self.averages is None:
            yield Finding(("coherence" if self.coherence is None else "averages",), missing=True)
        elif self.relative > 0:
            fault = f"found {self.relative!r} together with coherence"
            expected = "relative, or coherence and averages, not both"
            yield Finding(("relative",), fault, expected, "remove one of the two")


class TruthSpec(NamedStiffnessSpec):
    """The joint that makes the data, and where the structure that makes them differs from `[structure]`."""

    youngs_modulus_gpa: float | None = positive("Young's modulus in GPa that makes the data", 210.0, None)
    density_kg_m3: float | None = positive("the density in kg/m³ that makes the data", 7800.0, None)
    length_mm: float | None = positive("the length of the beam in mm that makes the data", 360.0, None)
    accelerometer_mass_g: Annotated[float | None, _MASS] = None
    gain: float = positive("the factor on the measured FRFs", 1.02, 1.0)
    damping_ratio: Annotated[Ratios | None, _RATIO] = None


_QUANTITY = key_field('the measured quantity, "receptance", "mobility" or "accelerance"', "receptance")


class SyntheticFrfSpec(DataTable):
    """FRFs computed from a stated truth, with noise; the frequencies are a band or a list."""

    frfs: ClassVar[bool] = True

    kind: Annotated[Literal["synthetic_frf"], DATA_KIND]
    outputs: Annotated[Labels, Field(min_length=1)] = key_field("a list of at least one measured DOF", ["11:y"])
    inputs: Annotated[Labels, Field(min_length=1)] = key_field("a list of at least one excited DOF", ["11:y"])
    quantity: Annotated[Literal["receptance", "mobility", "accelerance"], _QUANTITY] = "receptance"
    f_min_hz: float | None = positive("the lowest frequency in Hz", 20.0, None)
    f_max_hz: float | None = positive("the highest frequency in Hz", 2500.0, None)
    f_step_hz: float | None = positive("the distance of the lines in Hz", 1.0, None)
    frequencies_hz: Annotated[Frequencies | None, FREQUENCIES] = None
    truth: TruthSpec = Field(description="the joint that makes the data: k11, k12, k22")
    noise: NoiseSpec = Field(description="the noise: relative, floor, seed")

    @property
    def labelled(self) -> dict[KeyPath, tuple[str, ...]]:
        """Outputs and inputs."""
        return {("data", "outputs"): self.outputs, ("data", "inputs"): self.inputs}

    @property
    def band_hz(self) -> tuple[float, float]:
        """First and last line, Hz."""
        lines = self.lines_hz()
        return lines[0], lines[-1]

    def lines_hz(self) -> tuple[float, ...]:
        """Return the frequency lines in Hz; the last one is at ``f_max_hz`` or less than a step below."""
        if self.f_max_hz is None or self.f_step_hz is None:
            return self.frequencies_hz or ()
        return band_lines(self.f_min_hz or self.f_step_hz, self.f_max_hz, self.f_step_hz)

    def _findings(self) -> Iterator[Finding]:
        band = {"f_min_hz": self.f_min_hz, "f_max_hz": self.f_max_hz, "f_step_hz": self.f_step_hz}
        given = [key for key, value in band.items() if value is not None]
        if self.frequencies_hz is not None:
            if given:
                fault = f"given together with {', '.join(given)}"
                yield Finding(("frequencies_hz",), fault, "a list or a band, not both", "remove one of the two")
            if len(self.frequencies_hz) < 2:
                yield Finding(("frequencies_hz",), "", "at least two frequencies in Hz", "add frequencies")
        elif not given:
            remedy = "add f_max_hz = 2500.0 and f_step_hz = 1.0 to [data]"
            yield Finding((), "no frequencies", "f_max_hz and f_step_hz, or frequencies_hz", remedy)
        elif self.f_max_hz is None or self.f_step_hz is None:
            yield from (Finding((key,), missing=True) for key in ("f_max_hz", "f_step_hz") if key not in given)
        else:
            low_key, lowest = ("f_min_hz", self.f_min_hz) if self.f_min_hz else ("f_step_hz", self.f_step_hz)
            yield from not_above(lowest, self.f_max_hz, low_key, "f_max_hz", "in Hz")
            steps = (self.f_max_hz - lowest) / self.f_step_hz
            if 0 < steps < 1 - 1e-9:
                fault = f"empty band: {self.f_step_hz!r} Hz leaves only the line at {low_key} = {lowest!r}"
                yield Finding(("f_step_hz",), fault, "at least two lines up to f_max_hz", "lower f_step_hz")
            elif steps >= _MOST_LINES:
                fault = f"{self.f_step_hz!r} Hz makes {steps:.3g} lines"
                yield Finding(("f_step_hz",), fault, f"at most {_MOST_LINES} lines", "raise f_step_hz")
            elif steps * len(self.outputs) * len(self.inputs) > MOST_VALUES:
                frfs = len(self.outputs) * len(self.inputs)
                fault = f"{self.f_step_hz!r} Hz makes {steps:.3g} lines in each of {frfs} FRFs"
                yield Finding(("f_step_hz",), fault, f"at most {MOST_VALUES} values", "raise f_step_hz")


class NaturalFrequenciesSpec(DataTable):
    """Measured natural frequencies, the lowest ones in order; the two deviations add in quadrature."""

    field_keys = {"sd_hz": "sd_relative"}  # noqa: RUF012 (no field)

    kind: Annotated[Literal["natural_frequencies"], DATA_KIND]
    frequencies_hz: Annotated[Frequencies, FREQUENCIES] = Field(min_length=1)
    sd_relative: float = not_negative("the standard deviation as a fraction", 0.005, 0.0)
    sd_hz: float = not_negative("the standard deviation in Hz", 0.5, 0.0)

    @property
    def least_modes(self) -> Mapping[KeyPath, int]:
        """Number of the highest mode."""
        return {("data", "frequencies_hz"): len(self.frequencies_hz)}

    @property
    def depends_on(self) -> frozenset[str]:
        """Nothing else."""
        return frozenset()

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest natural frequency, Hz."""
        return self.frequencies_hz[0], self.frequencies_hz[-1]

    def built(self) -> vibrecords.FrequencyData:
        """The natural frequencies."""
        import numpy as np

        frequency = np.array(self.frequencies_hz)
        return vibrecords.FrequencyData(frequency, np.hypot(self.sd_relative * frequency, self.sd_hz))


DataSpec = Annotated[
    SyntheticFrfSpec | NaturalFrequenciesSpec | ModesSpec | MeasuredFrfSpec | MeasuredFrequenciesSpec,
    Field(discriminator="kind", description="the data: their kind and what belongs to it"),
]
