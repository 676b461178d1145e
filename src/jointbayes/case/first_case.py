"""A first case from measurement files: all that they tell, and a question mark where only the user knows."""

import math
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy

from jointbayes.case.first_model import FirstModel, files_of_model
from jointbayes.case.toml_text import toml_text, toml_value
from jointbayes.errors import MeasurementError
from jointbayes.inference.workshop import WORKSHOP_SD_PERCENT
from jointbayes.structure.imported.read import UNITS
from vibrecords import FrfSet
from vibrecords.errors import printable, refusal
from vibrecords.formats.about import about_file
from vibrecords.formats.channel_units import unknown_sides
from vibrecords.formats.grid import cut_to_band, join_frfs, measured_lines
from vibrecords.formats.read import iter_records
from vibrecords.modal_fit import ModalFit, fit_modes
from vibrecords.provenance import SIGN_IN_DOUBT
from vibrecords.records import CoherenceRecord, FrfRecord, ModeRecord, TimeRecord
from vibrecords.signals.impact import frfs_of_hits, settings_of
from vibrecords.signals.spectra import ShakerSettings, frfs_of_shaker, sort_by_force
from vibrecords.warnings.collector import find_warnings

#: FRFs that are fitted to tell how noisy they are, where no coherence does.
_FITTED = 3
_STRUCTURE = (
    'structure = { length_mm = "?", section = { shape = "circle", diameter_mm = "?" }, youngs_modulus_gpa = 210.0, '
    "density_kg_m3 = 7800.0%s%s }"
)
_DAMPING = 'damping = { law = "modal", ratio = %s }'
_WHERE = (
    '# 3. Where were sensor and hammer? Node and direction of each: "11:y" is the end; "-11:y" if it points the\n'
    "#    other way. A channel that is not used may be taken out."
)
_BAND = "# From two lines above 0 Hz to where the anti-alias filter begins; shorten it to what the hammer excites."
#: A band that begins so far below its first resonance holds the first mode: a clamped beam has its second at six times.
_FIRST_MODE = 5.0
#: What a channel of a file without units is called that is a force.
_FORCE = re.compile(r"force|hammer|impact|load|shaker", re.IGNORECASE)


@dataclass
class _Content:
    """What the files hold."""

    channels: dict[str, set[str]] = field(default_factory=dict)  # label to what of it is open: "unit", "sensitivity"
    frfs: list[FrfRecord] = field(default_factory=list)
    pairs: Counter[tuple[str, str]] = field(default_factory=Counter)
    with_coherence: int = 0
    averages: set[int | None] = field(default_factory=set)
    no_quantity: bool = False
    no_unit: bool = False
    band: tuple[float, float] = (np.inf, 0.0)
    histories: list[TimeRecord] = field(default_factory=list)
    modes: list[ModeRecord] = field(default_factory=list)
    about: dict[str, str] = field(default_factory=dict)

    @cached_property
    def fit(self) -> tuple[FrfSet, ModalFit] | None:
        """The first FRF, and a modal fit of it; None where none fits."""
        try:
            used, _ = measured_lines([cut_to_band(self.frfs[0], "", 1e-6, None)], "")
            frf = join_frfs([FrfRecord("2", "1", r.frequency_hz, r.values, "accelerance") for r in used], "")
            return frf, fit_modes(frf)
        except (MeasurementError, IndexError):  # no FRF at all
            return None

    def add_frf(self, record: FrfRecord) -> None:
        """Take note of an FRF; the first ones are kept."""
        sides = unknown_sides(record.unit) if record.factor is None else (set(), set())
        for label, unknown in zip((record.response, record.reference), sides, strict=True):
            self.channels.setdefault(label, set()).update(unknown)
        self.pairs[record.response, record.reference] += 1
        self.with_coherence += record.coherence is not None
        self.averages.add(record.averages)
        self.no_quantity |= record.quantity is None and not any(sides)
        self.no_unit |= not record.unit
        lines = record.frequency_hz[np.isfinite(record.frequency_hz) & (record.frequency_hz > 0)]
        self.band = min(self.band[0], lines.min(initial=np.inf)), max(self.band[1], lines.max(initial=0.0))
        if len(self.frfs) < _FITTED:
            self.frfs.append(record)


def propose_case(
    files: Sequence[Path], directory: Path, layout: Mapping[str, str] | None = None, example: str = ""
) -> str:
    """Return the text of a case with what measurement files tell; where only the user knows there is ``"?"``.

    Parameters
    ----------
    files
        FRFs, time histories of a hammer or a shaker, or modes of a modal test; with them the files of a finite-element
        model, which then is the structure.
    directory
        Of the case file, from which names of files count.
    layout
        As `iter_records` takes it.
    example
        Text of a case whose structure and joints are to be taken; without it the structure is a straight beam.

    Raises
    ------
    MeasurementError
        If a file cannot be read, lies outside of the directory, or holds nothing that is data.
    ModelError
        If the files of the model cannot be read.
    """
    of_model = files_of_model(files)
    files = [path for path in files if path not in of_model.values()]
    names = [_name_from(path, directory) for path in files]
    content, model = _Content(), None
    if "file" in of_model:
        named = {key: _name_from(path, directory) for key, path in of_model.items()}
        if example:
            raise MeasurementError(f"{of_model['file']}: found a model and --kind; expected one; leave --kind out")
        model = FirstModel.read(of_model, named, files)
    for path in files:
        content.about |= {key: text for key, text in about_file(path).items() if key not in content.about}
        for record in iter_records(path, layout):
            match record:
                case FrfRecord():
                    content.add_frf(record)
                case TimeRecord():
                    content.histories.append(record)
                case ModeRecord():
                    content.modes.append(record)
                case CoherenceRecord():
                    content.with_coherence += 1
                    content.averages.add(record.averages)
    if content.pairs or content.histories:
        data = list(_frf_lines(names, content, layout, model))
    elif content.modes:
        data = list(_mode_lines(content.modes))
    else:
        found = f"{', '.join(names)}: found" if names else f"{', '.join(map(str, of_model.values()))}: found a model,"
        raise MeasurementError(f"{found} no FRF, time history or mode; expected one of these; export the FRFs")
    damping, of_damping = ("", []) if content.modes and not content.pairs else _damping(content)
    # the answer of the modes of FRFs takes them for uncertain anyway, and the FRFs themselves take far longer with them
    sign = "# " if damping else ""
    uncertain = ["[uncertain]   # as in a workshop, and assumed where the report says so; state what you know better"]
    known = {name: percent for name, percent in WORKSHOP_SD_PERCENT.items() if not (model and name == "length")}
    uncertain += [f"{name} = {{ sd_percent = {percent} }}" for name, percent in known.items()]
    about = [f"about = {toml_value(content.about)}   # as the file says"] if content.about else []
    every = ", ".join(printable(name) for name in [*names, *(model.names.values() if model else ())])
    head = [f'# Written by jointbayes init from {every}. Answer each "?".']
    if example:
        shape = example.partition("\n[data]")[0].rstrip()
        head += [*about, "# 1. Structure and joint are an example: put in your sizes, materials and joints.", shape]
    else:
        head += [*about, *of_damping, *model.lines(damping)] if model else [*_head(damping), *about, *of_damping]
    return "\n".join([*head, "", "[data]", *data, "", *(f"{sign}{line}" for line in uncertain)]) + "\n"


def ask(text: str, answer_to: Callable[[str, Callable[[str], str]], str]) -> str:
    """Return a case that `propose_case` wrote with the answers to what no file knows: size, and place of the joint.

    Parameters
    ----------
    text
        The case.
    answer_to
        Puts a question. It is called with the question and a function that turns an answer into TOML, and raises
        ValueError for one that cannot be understood. It returns that TOML, or an empty text to leave the ``"?"``.
    """
    for marks, question, form in _QUESTIONS:
        mark = next((mark for mark in marks if mark in text), None)
        if mark is not None and (answer := answer_to(question, form)):
            text = text.replace(mark, answer, 1)
    return text


def _numbers(answer: str, *counts: int) -> list[float]:
    with suppress(ValueError):
        found = [float(word) for word in re.split(r"[\s,;x×]+", answer.strip())]
        if len(found) in counts and all(map(math.isfinite, found)):
            return found
    raise ValueError(f"expected {' or '.join(map(str, counts))} numbers")


def _section(answer: str) -> str:
    sizes = _numbers(answer, 1, 2)
    keys = ("diameter_mm",) if len(sizes) == 1 else ("width_mm", "height_mm")
    shape = "circle" if len(sizes) == 1 else "rectangle"
    return f"section = {toml_value({'shape': shape, **dict(zip(keys, sizes, strict=True))})}"


def _clamps(answer: str) -> str:
    ends = [int(end) for end in _numbers(answer, 1, 2)]
    if not set(ends) <= set(range(1, 12)):
        raise ValueError("expected nodes from 1 to 11")
    return f"joint.dofs = {toml_value([f'{end}:{way}' for end in ends for way in ('y', 'rz')])}"


def _unit(answer: str) -> str:
    if answer.strip() not in UNITS:
        raise ValueError(f"expected one of {', '.join(UNITS)}")
    return f'length_unit = "{answer.strip()}"'


def _face(answer: str) -> str:
    found = _numbers(answer, 1, 6)
    return f"node = {int(found[0])}" if len(found) == 1 else f"box_mm = {toml_value([found[:3], found[3:]])}"


#: What no file knows: the mark in the text, the question, and what makes TOML of an answer.
_QUESTIONS: tuple[tuple[tuple[str, ...], str, Callable[[str], str]], ...] = (
    (('length_mm = "?"',), "Length of the beam, mm", lambda answer: f"length_mm = {_numbers(answer, 1)[0]}"),
    (
        ('section = { shape = "circle", diameter_mm = "?" }',),
        "Section, mm: diameter, or width and height, as 40 x 10 (bending is along the height)",
        _section,
    ),
    (('joint.dofs = ["?"]',), "Where is the joint? 1 is one end of the beam, 11 the other, 1 11 both", _clamps),
    (('length_unit = "?"',), "Unit of length of the model's files: m, mm, in or ft", _unit),
    (('box_mm = "?"', 'node = "?"'), "Where is the joint? A node, or two corners of a box in mm: x y z x y z", _face),
)


def sketch(text: str) -> list[str]:
    """Return the sketch in characters of a straight beam with its joint, sensors and forces; empty for other cases."""
    length = re.search(r"^structure = .*length_mm = ([\d.]+)", text, re.MULTILINE)
    joint = re.search(r"^joint\.dofs = (.*)", text, re.MULTILINE)
    if length is None or joint is None:
        return []
    clamped = {int(node) for node in re.findall(r"(\d+):", joint[1])}
    beam = "=====".join("#" if node in clamped else "+" for node in range(1, 12))
    return [f"  {beam}", "  " + "".join(f"{node:<6}" for node in range(1, 12)).rstrip(),
            f"  {float(length[1]):g} mm; # joint"]  # fmt: skip


def _name_from(path: Path, directory: Path) -> str:
    name = os.path.relpath(path, directory)
    if name.startswith(".."):
        remedy = f"write the case beside it: jointbayes init {path.parent / 'my_case.toml'} --from {path}"
        raise refusal(path, "outside of the directory of the case", "it there", remedy)
    return Path(name).as_posix()


def _damping(content: _Content) -> tuple[str, list[str]]:
    """The damping of the structure, and a line on it: as measured where the modes are surely counted from the first."""
    modes = content.fit[1].modes if content.fit else ()
    if content.fit and not modes:
        return _DAMPING % 0.01, ["# Damping: a usual one; no resonance was found in the first FRF, look at it first."]
    if not modes or content.band[0] * _FIRST_MODE <= modes[0].frequency_hz:
        return _DAMPING % toml_value("measured"), []
    ratio = float(f"{np.median([mode.damping_ratio for mode in modes]):.2g}")
    words = f"# Damping: the median of {len(modes)} modes. The file begins at {content.band[0]:.4g} Hz, and its first"
    return _DAMPING % ratio, [
        f"{words} resonance at {modes[0].frequency_hz:.4g} Hz",
        '#    may not be mode 1; write ratio = "measured", of each mode its own, where it is.',
    ]


def _head(damping: str) -> Iterator[str]:
    yield "# 1. What is the structure, without its joint? A straight beam of steel here: node 1 at one end, node 11 at"
    yield '#    the other, evenly spaced. Other structures: "The case file" in the documentation, [structure].'
    yield _STRUCTURE % (", " * bool(damping), damping)
    yield '# 2. Where is the joint? Its DOFs: a clamp of node 1 that yields is ["1:y", "1:rz"].'
    yield 'joint.dofs = ["?"]'


def _channels(open_of: Mapping[str, set[str]], model: FirstModel | None) -> Iterator[str]:
    dofs = {label: model.dof(label) if model else "?" for label in open_of}
    if model and "?" not in dofs.values():
        yield f"# 3. Sensors and hammer, {model.how}: is this right? A minus turns a sensor, as in"
        yield f'#    "-{next(iter(dofs.values()), "").removeprefix("-")}". A channel that is not used may be taken out.'
    else:
        yield _WHERE
    entries = {
        label: {"dof": dofs[label]} | dict.fromkeys(sorted(keys), "?") if keys else dofs[label]
        for label, keys in open_of.items()
    }
    if len(entries) <= 4:
        yield f"channels = {toml_value(entries)}"
    else:
        yield toml_text({"data": {"channels": entries}})


def _frf_lines(
    names: Sequence[str], content: _Content, layout: Mapping[str, str] | None, model: FirstModel | None
) -> Iterator[str]:
    """The table of FRFs in files, or of time histories that FRFs are made of."""
    yield 'kind = "measured_frf"'
    yield f"file = {toml_value(names[0] if len(names) == 1 else list(names))}"
    yield from [f"layout = {toml_value(layout)}"] * bool(layout)
    made, longest = not content.pairs, 0.0
    if made:
        for record in content.histories:
            of_channel = {"unit"} if record.quantity == "unknown" else set()
            content.channels.setdefault(record.channel, set()).update(of_channel)
        rate = content.histories[0].sample_rate_hz
        longest = max(record.values.size / record.sample_rate_hz for record in content.histories)
        content.band = max(20.0, round(2 / longest, 3)), round(rate / 2.56, 3)
        yield _BAND
    elif content.no_quantity:
        yield 'quantity = "?"   # the file does not say it: receptance, mobility or accelerance'
    if not made and content.no_unit:
        yield '# The file states no unit, SI was taken: m/s² and N. Else { dof = "11:y", unit = "g" } for a channel.'
    yield f"f_min_hz = {float(content.band[0])}"
    yield f"f_max_hz = {float(content.band[1])}"
    yield from _records(content, longest) if made else ()
    yield from _signs(content.frfs)
    yield from _channels(content.channels, model)
    if not made or (content.frfs and content.frfs[0].coherence is None):
        yield ""
        yield "[data.variance]"
        yield from _noise(content, "one hit") if made else _variance(content)


def _variance(content: _Content) -> Iterator[str]:
    times, surplus = divmod(content.pairs.total(), len(content.pairs))
    if times > 1 and not surplus:
        yield f'source = "repeats"   # {times} measurements of each FRF'
    elif content.with_coherence >= content.pairs.total() and content.averages != {1}:
        told = " or ".join(str(count) for count in sorted(filter(None, content.averages)))
        yield 'source = "coherence"' + (f"   # {told} averages, as the file says" if told else "")
        if None in content.averages:
            yield 'averages = "?"   # the number of averages, which the file does not say'
    else:
        yield from _noise(content)


def _noise(content: _Content, what: str = "file") -> Iterator[str]:
    """Noise relative to |H|, and to its median, as a modal fit leaves it; a usual one where none fits."""
    relative, floor, words = 0.03, 0.01, f"a usual one: the {what} has no coherence; state what you know"
    if content.fit is not None:
        frf, fit = content.fit
        # of a part with the standard deviation a|H| + b the magnitude of both is on average √(π/2) times it
        size, middle = np.abs(fit.values).ravel(), float(np.median(np.abs(fit.values)))
        left, weight = np.abs(frf.values - fit.values).ravel() * np.sqrt(2 / np.pi), 1 / (size + 0.1 * middle)
        columns = np.column_stack([size, np.full(size.size, middle)]) * weight[:, None]
        found, rest = map(float, scipy.optimize.nnls(columns, left * weight)[0])
        if fit.modes and found <= 0.2:
            # the floor keeps lines near zero from counting without end; more of it would overstate the noise
            relative, floor = max(found, 0.002), max(rest, 1e-5)
            words = f"what a modal fit leaves: the {what} has no coherence"
    yield f'source = "relative"   # {words}'
    yield f"relative = {relative:.2g}"
    yield f"floor = {floor:.2g}"


def _records(content: _Content, longest: float) -> Iterator[str]:
    """How FRFs are made of time histories, and what came of it; channels without a unit are forces by their names."""
    named = [_named(record) for record in content.histories]
    try:
        sort_by_force(named)
    except MeasurementError:
        return
    low, high = content.band
    try:
        settings = settings_of(named, low, high)
    except MeasurementError:  # no hits
        block_s = float(f"{longest / 16:.3g}")
        line, made = f'method = "shaker", block_s = {block_s:g}', None
        with suppress(MeasurementError):
            made = frfs_of_shaker(named, ShakerSettings(block_s, f_min_hz=low, f_max_hz=high))
    else:
        hits, made = settings.hits, None
        block = f", block_s = {hits.block_s:g}, pretrigger_s = {hits.pretrigger_s:g}" if hits.block_s else ""
        line = f'method = "impact"{block}'
        with suppress(MeasurementError):
            made = frfs_of_hits(named, settings)
    content.frfs = list(made.frfs[:_FITTED]) if made else []
    yield f"records = {{ {line} }}   # {content.frfs[0].notes[0]}" if content.frfs else f"records = {{ {line} }}"
    yield from (f"# {printable(note)}" for note in (made.notes if made else ()))


def _named(record: TimeRecord) -> TimeRecord:
    """A time history of an unknown quantity as one of force or of acceleration, by its name."""
    if record.quantity != "unknown":
        return record
    return replace(record, quantity="force" if _FORCE.search(record.channel) else "acceleration")


def _signs(frfs: Sequence[FrfRecord]) -> Iterator[str]:
    """What is found of signs at drive points, which the DOF of a channel is to say."""
    for doubt in find_warnings(frfs):
        if doubt.key in SIGN_IN_DOUBT:
            yield f"# At {printable(doubt.where)} {printable(doubt.sentence)}: {printable(doubt.remedy)}."


def _mode_lines(modes: Sequence[ModeRecord]) -> Iterator[str]:
    """Modes of a modal test as a table of the case: nothing of the file is read again."""
    modes = sorted(modes, key=lambda mode: mode.frequency_hz)
    yield 'kind = "modes"'
    yield f"frequencies_hz = [{', '.join(repr(float(mode.frequency_hz)) for mode in modes)}]"
    if all(mode.frequency_sd_hz for mode in modes):
        yield f"sd_hz = [{', '.join(f'{mode.frequency_sd_hz:.4g}' for mode in modes)}]"
    else:
        yield "sd_relative = 0.005   # the file does not say it: mounting the structure anew changes them so much"
    yield "# 3. Which modes of the structure are these, counted from the lowest? And if shapes are to be data, which"
    yield '#    DOFs are their channels? See [data.shapes] in "The case file".'
    yield 'numbers = "?"'
    labels = list(dict.fromkeys(label for mode in modes for label in mode.shape))
    if labels:
        yield f"# The file has shapes at {', '.join(printable(label) for label in labels[:12])}."
