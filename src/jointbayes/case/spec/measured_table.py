"""The tables of what is in measurement files: `[data]` of a case, and bodies given by their FRFs, `[bodies.NAME]`."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, Strict

from jointbayes.case.spec.fields import (
    DATA_KIND,
    ESTIMATOR,
    MOST_FILES,
    POINT_LABEL,
    DataTable,
    Finding,
    Fraction,
    Label,
    Labels,
    Positive,
    Spec,
    count_field,
    key_field,
    law_findings,
    listed,
    max_length,
    not_above,
    not_negative,
    positive,
    raise_findings,
    to_list,
)
from jointbayes.case.spec.layout_table import LayoutSpec
from jointbayes.errors import MeasurementError

if TYPE_CHECKING:
    from jointbayes.case.spec.structure_table import StructureBase
    from vibrecords.measurement_plan import VarianceSource
    from vibrecords.rotations import Rotation


SensorQuantity = Literal["force", "displacement", "velocity", "acceleration"]


def _signed(text: str) -> str:
    if not re.fullmatch(f"-?{POINT_LABEL}:(x|y|z|rx|ry|rz)", text):
        expected = 'a DOF such as "11:y", or "-11:y" if it points the other way'
        raise_findings([Finding((), f'found "{text[:40]}"', expected, 'write for example "11:y"')])
    return text


def _channel_table(value: object) -> object:
    """A channel that is a DOF alone, as the table it stands for."""
    return {"dof": value} if isinstance(value, str) else value


_DOF = key_field('a DOF such as "11:y", or "-11:y" if it points the other way', "11:y")
_UNIT = key_field(
    'the unit of what it measures, as "g", "m/s^2" or "lbf", where the file does not say or is wrong', "g"
)
_MEASURES = key_field('what it measures, "force", "displacement", "velocity" or "acceleration"', "acceleration")
_SENSITIVITY = positive("the volts for one of its unit, where the file holds volts", 0.01)
_SENSOR_MASS = not_negative("the mass in g of the sensor, to be taken out of the FRFs", 2.0)


class ChannelSpec(Spec):
    """What a channel of the file stands for; in a case file often the DOF alone: ``"Point:11:Y+" = "11:y"``."""

    dof: Annotated[str, AfterValidator(_signed), _DOF]
    quantity: Annotated[SensorQuantity | None, _MEASURES] = None
    unit: Annotated[str, max_length(60), _UNIT] = ""
    sensitivity: Annotated[float | None, _SENSITIVITY] = None
    gain: Annotated[float, positive("the factor by which the channel's signal is multiplied", 1.02)] = 1.0
    accelerometer_mass_g: Annotated[float, _SENSOR_MASS] = 0.0

    @property
    def label(self) -> str:
        """The DOF without its sign."""
        return self.dof.removeprefix("-")

    @property
    def sign(self) -> float:
        """−1 where the channel points the other way."""
        return -1.0 if self.dof.startswith("-") else 1.0

    def _findings(self) -> Iterator[Finding]:
        from vibrecords.formats.units import sensor_unit

        measured = sensor_unit(self.unit)
        if self.unit and measured is None:
            expected = 'the unit of a force or a motion, such as "N", "lbf", "g", "m/s^2", "mm/s" or "um"'
            yield Finding(("unit",), f'found "{self.unit}"', expected, "correct it")
        elif self.sensitivity is not None and not self.unit:
            yield Finding(("unit",), missing=True)
        elif measured and self.quantity not in (None, measured[1]):
            fault = f'found "{self.quantity}" beside unit = "{self.unit}", which is one of {measured[1]}'
            yield Finding(("quantity",), fault, "one that fits", "correct or remove one of the two")


_STATIONS = key_field("two or three translations in order along the structure", ["1:y", "2:y", "3:y"])
_SCHEME = key_field(
    'the differences, "first order" (two stations), "second order, end" or "second order, centre"', "first order"
)
_SPACING = positive("the distance of neighbouring stations in mm", 20.0)
_AXIS = key_field('the axis along which the stations lie, "x", "y" or "z"', "x")
_USE = key_field("true (the rotation is data, its stations are not) or false (it serves the iteration)", False)


class RotationSpec(Spec):
    """A rotation by differences of translations."""

    stations: Annotated[Labels, Field(min_length=2, max_length=3), _STATIONS]
    scheme: Annotated[Literal["first order", "second order, end", "second order, centre"], _SCHEME] = "first order"
    spacing_mm: Annotated[float | None, _SPACING] = None
    in_likelihood: Annotated[bool, _USE] = False
    axis: Annotated[Literal["x", "y", "z"], _AXIS] = "x"

    def built(self, label: str, spacing_mm: float) -> Rotation:
        """The rotation of this label, its stations so far apart; negative where they run backwards."""
        from vibrecords.rotations import Rotation

        return Rotation(label, self.stations, spacing_mm * 1e-3, self.scheme, self.in_likelihood, self.axis)


_SOURCE = key_field('where the variance comes from, "coherence", "repeats" or "relative"', "coherence")
_AVERAGES = Field(ge=1, le=10**6, description="the number of averages, a whole number from 1 to 1000000", examples=[10])


class VarianceSpec(Spec):
    """Variance of measured FRFs; the law of relative and floor is all of it, or the least that is believed."""

    used_with = {"averages": ("source", "coherence")}  # noqa: RUF012 (no field)

    source: Annotated[Literal["coherence", "repeats", "relative"], _SOURCE] = "coherence"
    relative: Annotated[float, not_negative("the least standard deviation as a fraction of |H|", 0.001)] = 0.001
    floor: Annotated[float, not_negative("the least standard deviation as a fraction of the median |H|", 0.001)] = 0.0
    averages: Annotated[int | None, _AVERAGES] = None

    def built(self) -> VarianceSource:
        """The variance; without a law where nothing is the least that is believed."""
        from vibrecords import RelativeNoise
        from vibrecords.measurement_plan import VarianceSource

        stated = self.source == "relative" or self.relative + self.floor > 0
        law = RelativeNoise(self.relative, self.floor) if stated else None
        return VarianceSource(self.source, law, self.averages, "relative" in self.model_fields_set)

    def try_objects(self) -> None:
        """The variance."""
        self.built()

    def _findings(self) -> Iterator[Finding]:
        if self.source == "relative":
            yield from law_findings(self)


_METHOD = key_field('how the structure was excited, "impact" or "shaker"', "impact")
_WINDOW = key_field('the window of the blocks, "hann" or "boxcar"', "hann")
_LENGTH = positive("the length of a block in s", 1.0)
_PULSE = Field(gt=0, description="how long after its trigger the force counts in s, above 0", examples=[0.005])
_END = key_field("what is left of the exponential window at the end of a block, above 0 and at most 1", 0.05)
_RANGE = positive("the full scale of the force channel in N", 500.0)
_OVERLAP = Field(ge=0, lt=1, description="the overlap of blocks, a number of at least 0 and below 1", examples=[0.5])


class RecordsSpec(Spec):
    """How FRFs are made from the time histories of a file."""

    used_with = {  # noqa: RUF012 (no field)
        **dict.fromkeys(("pretrigger_s", "force_window_s", "exponential_end", "force_range_n"), ("method", "impact")),
        **dict.fromkeys(("overlap", "window"), ("method", "shaker")),
    }

    method: Annotated[Literal["impact", "shaker"], _METHOD]
    estimator: Annotated[Literal["H1", "H2", "Hv"], ESTIMATOR] = "H1"
    block_s: Annotated[float | None, _LENGTH] = None
    pretrigger_s: Annotated[float, not_negative("how long before its trigger a block begins, in s", 0.01)] = 0.0
    force_window_s: Annotated[float | None, _PULSE] = None
    exponential_end: Annotated[Fraction, _END] = 1.0
    force_range_n: Annotated[float | None, _RANGE] = None
    overlap: Annotated[float, _OVERLAP] = 0.5
    window: Annotated[Literal["hann", "boxcar"], _WINDOW] = "hann"

    def _findings(self) -> Iterator[Finding]:
        if self.method == "shaker" and self.block_s is None:
            yield Finding(("block_s",), missing=True)


_RECORDS = Field(description="how FRFs are made from time histories: method")
_LAYOUT = Field(description="what the variables of the files stand for: frequency_hz, frf, time, force and others")
_FILE = key_field("the name of a measurement file, or a list of names", "tip.uff")
_MAP = key_field('a table from channel to DOF, as "Point:11:Y+" = "11:y"', {})
_QUANTITY = key_field(
    'what the FRFs are, "receptance", "mobility" or "accelerance", where the file does not say or is wrong',
    "accelerance",
)
_SENSORS = key_field('"fixed" (all sensors stay on) or "roving" (one sensor moves from output to output)', "fixed")
_EXCLUDED = key_field("a list of bands [lowest, highest] in Hz whose lines are left out", [[49.5, 50.5]])
_CONJUGATE = key_field("true (the FRFs have the time factor exp(-i omega t)) or false (exp(+i omega t))", True)
_VARIANCE = Field(description="the variance of the FRFs: source")
_FileName = Annotated[str, Field(min_length=1, max_length=1000)]


_Band = tuple[Annotated[float, Field(ge=0)], Positive]
_Channels = dict[str, Annotated[ChannelSpec, BeforeValidator(_channel_table)]]


class MeasuredSpec(DataTable):
    """What all data from files have: the files, what their channels stand for, and the lines that are used."""

    file: Annotated[
        tuple[_FileName, ...],
        Strict(False),
        Field(min_length=1),
        BeforeValidator(to_list),
        max_length(MOST_FILES),
        _FILE,
    ]
    quantity: Annotated[Literal["receptance", "mobility", "accelerance"] | None, _QUANTITY] = None
    f_min_hz: Annotated[float | None, positive("the lowest frequency used in Hz", 20.0)] = None
    f_max_hz: Annotated[float | None, positive("the highest frequency used in Hz", 2500.0)] = None
    exclude_hz: Annotated[tuple[Annotated[_Band, Strict(False)], ...], Strict(False), max_length(1000), _EXCLUDED] = ()
    conjugate: Annotated[bool, _CONJUGATE] = False
    thin: Annotated[int | None, count_field("every how many lines one is kept", 2, 1, 10_000)] = None
    accelerometers: Annotated[Literal["fixed", "roving"], _SENSORS] = "fixed"
    channels: Annotated[_Channels, _MAP]
    layout: Annotated[LayoutSpec | None, _LAYOUT] = None
    records: Annotated[RecordsSpec | None, _RECORDS] = None
    variance: Annotated[VarianceSpec | None, _VARIANCE] = None

    @property
    def loaded(self) -> tuple[str, ...]:
        """DOFs of the channels."""
        return tuple(channel.label for channel in self.channels.values())

    @property
    def band_key(self) -> str:
        """The files."""
        return "file"

    def asked_for(self, structure: StructureBase) -> dict[str, Any]:
        """What a plan of the measurement asks for beside what all files give, by the names of `MeasurementPlan`."""
        return {}

    def structure_findings(self, structure: StructureBase) -> Iterator[Finding]:
        """Yield what the structure lacks for it."""
        yield from ()

    def try_objects(self) -> None:
        """Its rotations, which know no distance of their stations yet."""
        for label, rotation in getattr(self, "rotations", {}).items():
            try:
                rotation.built(label, 1.0)
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
        if self.conjugate and self.records is not None:
            fault = "found true with time histories, of which the FRFs are made here"
            yield Finding(("conjugate",), fault, "it for FRFs of a file", "remove it")
        if not self.channels:
            fault, remedy = "found no channel", 'write for example "Point:11:Y+" = "11:y" in [data.channels]'
            yield Finding(("channels",), fault, "a DOF for each channel that is used", remedy)


class MeasuredFrfSpec(MeasuredSpec):
    """FRFs of measurement files."""

    frfs: ClassVar[bool] = True

    kind: Annotated[Literal["measured_frf"], DATA_KIND]
    outputs: Annotated[Labels, key_field("a list of the measured DOFs used; empty: all", ["11:y"])] = ()
    inputs: Annotated[Labels, key_field("a list of the excited DOFs used; empty: all", ["11:y"])] = ()
    variance: Annotated[VarianceSpec, _VARIANCE] = VarianceSpec()
    rotations: Annotated[
        dict[Label, RotationSpec], key_field('a table for each rotation, as [data.rotations."1:rz"]', {})
    ] = {}  # noqa: RUF012 (frozen model)

    def asked_for(self, structure: StructureBase) -> dict[str, Any]:
        """Outputs, inputs and rotations, whose stations are points of a straight beam."""
        rotations = []
        for label, rotation in self.rotations.items():
            first, second, *_ = (int(station.split(":")[0]) for station in rotation.stations)
            assert structure.spans is not None  # as the rules of the tables ask
            spacing = (second - first) * structure.stated["length"][1] / structure.spans
            if rotation.spacing_mm is not None:
                spacing = math.copysign(rotation.spacing_mm, spacing)
            rotations.append(rotation.built(label, spacing))
        return {"outputs": self.outputs, "inputs": self.inputs, "rotations": tuple(rotations)}

    def structure_findings(self, structure: StructureBase) -> Iterator[Finding]:
        """Yield rotations of a structure without evenly spaced points, or from other points than these."""
        if self.rotations and structure.spans is None:
            fault = f'found rotations in a structure of kind = "{structure.kind}"'
            yield Finding(("data", "rotations"), fault, 'kind = "beam", whose points are evenly spaced', "remove it")
            return
        for label, rotation in self.rotations.items():
            loc, last = ("data", "rotations", label), (structure.spans or 0) + 1
            nodes = [int(station.split(":")[0]) for station in rotation.stations]
            steps = {b - a for a, b in itertools.pairwise(nodes)}
            if len(steps) != 1 or 0 in steps or max(nodes) > last:
                fault = f"found nodes {', '.join(map(str, nodes))}"
                expected = f"different nodes, evenly spaced in one direction, from 1 to {last}"
                yield Finding((*loc, "stations"), fault, expected, "correct the stations")
            if (words := structure.absent(label)) is not None:
                yield Finding(loc, *words)

    def _findings(self) -> Iterator[Finding]:
        yield from super()._findings()
        measured = dict.fromkeys(channel.label for channel in self.channels.values())
        for key in ("outputs", "inputs"):
            for i, label in enumerate(getattr(self, key)):
                if label not in measured:
                    fault = f'found "{label}", which no channel stands for'
                    yield Finding((key, i), fault, f"one of {listed(list(measured))}", "map its channel or remove it")
        for label, rotation in self.rotations.items():
            if rotation.axis != "x":
                place = ("rotations", label, "axis")
                yield Finding(place, f'found "{rotation.axis}"', '"x", along which the beam lies', "remove it")


class MeasuredFrequenciesSpec(MeasuredSpec):
    """Natural frequencies of the modes that FRFs of measurement files show, the lowest ones."""

    kind: Annotated[Literal["measured_frequencies"], DATA_KIND]
    modes: Annotated[int | None, count_field("how many modes are used, the lowest ones", 3, 1, 1000)] = None
    sd_relative: Annotated[float, not_negative("the standard deviation as a fraction", 0.001)] = 0.0
    sd_hz: Annotated[float, not_negative("the standard deviation in Hz", 0.1)] = 0.0

    def asked_for(self, structure: StructureBase) -> dict[str, Any]:
        """Natural frequencies."""
        from vibrecords.measurement_plan import FrequencyPlan

        return {"frequencies": FrequencyPlan(self.modes, self.sd_relative, self.sd_hz)}


_BODY_KIND = key_field('the kind of body, "measured"', "measured")
_PROPAGATE = key_field(
    "true (the noise of the FRFs counts in the likelihood) or false (it is ignored: intervals are too narrow)", True
)
_BODY_ROTATIONS = key_field('a table for each rotation, as [bodies.spindle.rotations."spindle:rz"]', {})


class MeasuredBodySpec(MeasuredSpec):
    """A body given by its FRFs between the DOFs that its channels stand for, and rotations between them."""

    kind: Annotated[Literal["measured"], _BODY_KIND]
    variance: Annotated[VarianceSpec, _VARIANCE] = VarianceSpec()
    rotations: Annotated[dict[Label, RotationSpec], _BODY_ROTATIONS] = {}  # noqa: RUF012 (frozen model)
    propagate: Annotated[bool, _PROPAGATE] = True

    @property
    def labels(self) -> tuple[str, ...]:
        """DOFs that the body has: those of its channels, and its rotations."""
        return tuple(dict.fromkeys((*(channel.label for channel in self.channels.values()), *self.rotations)))

    def _findings(self) -> Iterator[Finding]:
        yield from super()._findings()
        measured = {channel.label for channel in self.channels.values()}
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
