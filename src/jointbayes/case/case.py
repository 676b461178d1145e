"""A case: the TOML file turned into structure, joint, data and prior, with the settings of the run."""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from jointbayes.case import plausibility
from jointbayes.case.case_objects import (
    CaseHome,
    CaseTest,
    complete_from_data,
    default_priors_of,
    measured_bodies,
    measurement_of,
    noise_of,
    plan_of,
    prior_of,
    problem_of,
    read_matrices,
    recipe_of,
    reduce_imported,
    require_lowest,
    split_data,
    top_of,
)
from jointbayes.case.case_text import CaseText, InputWarning, case_text, read_case_text, texts_of_tests
from jointbayes.case.parse import first_joined, needs_files, parse_tests
from jointbayes.case.spec.fields import DATA_FILE, show_key
from jointbayes.case.spec.prior_tables import joint_table
from jointbayes.case.spec.settings_tables import LeftOutSpec
from jointbayes.case.spec.structure_tables import ImportedSpec
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.case.toml_text import fault_line, toml_text
from jointbayes.errors import CaseError, JointBayesError, MeasurementError, ModelError, require
from jointbayes.frf import MeasuredBody, Ports
from jointbayes.identification.numbering import find_above_rigid, find_numbering
from jointbayes.inference import ErrorSizes, Problem, in_workshop
from jointbayes.joint import Joint, Joints, joints_of
from jointbayes.reproducibility import one_blas_thread
from jointbayes.sampling import SamplerSettings
from jointbayes.structure import MemberRecipe, require_unbuckled
from jointbayes.verdict_rule import VerdictRule
from vibrecords import Data, quantity_factor
from vibrecords.arrays import Array

_LEVEL_LINES, _LEVEL_DRAWS = 100, 64  # of FRFs, and joints of the prior, by which their level is compared


@dataclass(frozen=True)
class Case:
    """One identification job.

    Parameters
    ----------
    name
        Short name: the file's, without its ending.
    source
        The TOML text, together with the texts of the files it builds on.
    spec
        The same, checked and typed; of several tests the first in which a joint acts.
    problem
        Structure, joint, data and prior; `replace` may put another one in its place.
    stated
        The problem that the text states; None where it was not built.
    tests
        Each test of it; one without a name where there is one test.
    """

    name: str
    source: CaseText
    spec: CaseSpec
    problem: Problem
    stated: Problem | None = None
    tests: tuple[CaseTest, ...] = ()

    def __repr__(self) -> str:
        return f"Case({self.name!r}: {self.title}; {self.problem!r})"

    @property
    def text(self) -> str:
        """TOML text that needs no other case file."""
        return self.source.text

    @property
    def title(self) -> str:
        """Title for people; without one in the file, the case's name."""
        return self.spec.title or self.name

    @property
    def about(self) -> dict[str, str]:
        """Title, specimen, date of the test, operator and instruments, as far as the file states them."""
        return {key: text for key, text in {"title": self.spec.title, **dict(self.spec.about)}.items() if text}

    @property
    def reference(self) -> Array | None:
        """Published stiffnesses in the order of the problem's quantities, shape (q,), if the case names any."""
        reference = self.spec.reference
        return reference.values(self.spec.all_quantities) if reference else None

    @property
    def reference_source(self) -> str:
        """Where the published stiffnesses are from; empty without any."""
        return self.spec.reference.source if self.spec.reference else ""

    @property
    def measured_frequencies_hz(self) -> tuple[float, ...] | None:
        """Measured natural frequencies, if the data of the one test, or the reference, hold any, Hz."""
        modes = None if len(self.problem.tests) > 1 else self.problem.test.data.modes
        if modes is not None:
            return modes.lowest_hz
        reference = self.spec.reference
        return reference.natural_frequencies_hz if reference else None

    @cached_property
    @one_blas_thread()
    def warnings(self) -> tuple[InputWarning, ...]:
        """What in the case is possible and yet probably a slip, such as a length in m in place of mm."""
        warnings: list[InputWarning] = []
        texts = texts_of_tests(self.source)
        specs = [(name, spec) for name, spec in parse_tests(self.source).items() if not spec.leaves_out(name)]
        if len(self.problem.tests) < len(specs):  # a test whose FRFs show no mode says nothing to an answer of modes
            analysed = {test.name for test in self.problem.tests}
            specs = [(name, spec) for name, spec in specs if name in analysed]
        for (name, spec), problem in zip(specs, self.problem.parts, strict=False):
            measured = problem.test.data.shown_frfs or problem.test.data
            warnings += plausibility.input_warnings(spec, texts[name], measured.band_hz)
            warnings += plausibility.sign_warnings(measured.provenance, texts[name])
            if not spec.bodies:  # of bodies that were measured alike the level may be off alike
                warnings += plausibility.level_warnings(_log_level(problem), "gain" in problem.names, texts[name])
            if problem.test.data.shown_frfs is None:  # modes that FRFs show were numbered as the answer was decided
                exact = "model" in problem.exact
                doubt = find_numbering(problem, None if exact else problem.model_error or ErrorSizes())
                above = find_above_rigid(problem)
                warnings += plausibility.numbering_warnings(doubt, above, texts[name], measured.provenance is not None)
        for test in self.tests:  # by the prior that the text states: another may be put in its place to a purpose
            found = plausibility.excluded_truths(test.spec, prior_of([test])[0], test.source.test)
            warnings += test.source.warnings("truth", found)
        return tuple(dict.fromkeys(warnings))

    @cached_property
    def default_priors(self) -> frozenset[str]:
        """Coordinates of joints whose prior is not stated; empty where the problem is not the text's."""
        return default_priors_of(parse_tests(self.source)) if self.problem is self.stated else frozenset()

    @property
    def verdict_rules(self) -> dict[str, VerdictRule]:
        """Thresholds of verdicts that the case states, by the stiffness."""
        return {name: VerdictRule(**dict(rule)) for name, rule in self.spec.verdict.items()}

    @cached_property
    def workshop_problem(self) -> Problem | None:
        """The same problem, but with material, length and damping as uncertain as in a workshop.

        E to 3 %, density to 1 %, length to 0.5 %, damping free within a decade either way; what the case itself calls
        uncertain stays as it says. None where the problem is not the text's, or was not built from it, and of an answer
        that was decided, which allows for all that already.
        """
        return self.freed_problem if self.tests else None

    @cached_property
    def freed_problem(self) -> Problem | None:
        """`workshop_problem`, also of a case that came with draws from a file, whose tests were not built from it."""
        if self.problem is not self.stated or self.problem.premises.reason:
            return None
        return in_workshop(self.problem)

    def with_uncertain(self, table: Mapping[str, object]) -> "Case":
        """The same case with another table `[uncertain]`, which says what its answer takes for granted.

        What tests state of their own stays. Its files are read again.

        Parameters
        ----------
        table
            As in a case file, such as ``{"exact": ["density"], "length": {"sd_percent": 1.0}}``.

        Raises
        ------
        CaseError
            If something in the table is wrong, or a file cannot be read.
        """
        file = Path(self.source.name)
        text = toml_text({**self.source.data, "uncertain": table})
        return _build(self.name, case_text(text, file.name), file.parent, None, allow_outside=True)

    @cached_property
    def sampler(self) -> SamplerSettings:
        """Sampler settings; where the file states no walkers, as many as its unknowns need."""
        spec = self.spec.sampling
        settings = SamplerSettings(**spec.model_dump(exclude={"seed"}))
        if "walkers" in spec.model_fields_set:
            return settings
        return settings.for_dimension(len(self.problem.prior.names))


def _log_level(problem: Problem) -> float:
    """ln of measured FRFs over the FRFs of the nearest joint of the prior; 0 if a joint comes close, or without FRFs.

    A quantity in doubt is told as that.
    """
    data, prior = problem.test.data.frfs, problem.prior
    if data is None or data.provenance is None or data.provenance.sign_doubts:
        return 0.0
    frf = data.frf.at_lines(slice(None, None, max(data.frf.n_lines // _LEVEL_LINES, 1)))
    theta = prior.sample(np.random.default_rng(0), _LEVEL_DRAWS)
    model = problem.test.receptance_model(Ports(frf.frequency_hz, frf.outputs, frf.inputs))
    predicted = model.receptance(prior.matrix(theta), problem.structural(prior.factors(theta)))
    measured = frf.values / quantity_factor(frf.frequency_hz, frf.quantity)[:, None, None]
    with np.errstate(divide="ignore"):
        ratio = np.median(np.log(np.abs(measured / predicted)).reshape(len(theta), -1), axis=1)
    return max(float(ratio.min()), 0.0) + min(float(ratio.max()), 0.0)


def load_case(path: str | os.PathLike[str], allow_outside: bool = False) -> Case:
    """Read a case file.

    Parameters
    ----------
    path
        TOML file; see docs/case-file.md.
    allow_outside
        Whether measurement files, and case files that it builds on, may lie outside the directory of the case file.

    Raises
    ------
    CaseError
        If the file cannot be read or anything in it is wrong: file, line, key, what is expected; or if a measurement
        file, or one it builds on, lies outside the directory of the case file and that is not allowed.

    Examples
    --------
    >>> import jointbayes as jb
    >>> jb.load_case("configs/clamped_beam.toml").name  # doctest: +SKIP
    'clamped_beam'
    """
    file = Path(path)
    return _build(file.stem, read_case_text(file, allow_outside), file.parent, None, allow_outside)


#: A case, or the path of its file.
AnyCase = Case | str | os.PathLike[str]


def require_case(given: AnyCase, expected: str = "a case") -> Case:
    """The case, read from its file where its path is given; what is neither is refused: `expected` it was."""
    if isinstance(given, str | os.PathLike):
        return load_case(given)
    require(given, Case, "found", f"{expected} or the path of a case file; load_case reads such a file")
    return given


def case_from_text(
    name: str,
    text: str,
    *,
    directory: str | os.PathLike[str] = ".",
    data: Data | None = None,
    allow_outside: bool = False,
) -> Case:
    """Build a case from TOML text; errors as for `load_case`, with `name` for the file.

    Parameters
    ----------
    name, text
        Name of the case, and its text.
    directory
        Where measurement files, and case files that it builds on, are looked for.
    data
        Data of a case of one test, as they were read or made before; its files are then not needed.
    allow_outside
        Whether such files may lie outside that directory.
    """
    source = case_text(text, name, Path(directory) / f"{name}.toml", allow_outside)
    return _build(name, source, Path(directory), data, allow_outside)


def case_around(problem: Problem, text: str, *, stated: bool = False) -> Case:
    """A case whose problem was not built from its text: for what the text says of title and reference.

    Parameters
    ----------
    problem
        The problem.
    text
        TOML text that needs no other case file.
    stated
        Whether the text states this problem, with files that are not read again.
    """
    source = case_text(text, problem.name)
    specs = parse_tests(source)
    tests: tuple[CaseTest, ...] = ()
    if stated and not needs_files(specs):
        texts, data = texts_of_tests(source), {test.name: test.data for test in (*problem.left_out, *problem.tests)}
        for name, spec in specs.items():  # what is left out of the data of a test is out of them already
            if name not in data:  # its FRFs show no mode, and the answer rests on modes
                continue
            whole = spec.model_copy(update={"left_out": LeftOutSpec(tests=spec.left_out.tests)})
            tests = (*tests, _one_test(name, CaseHome(Path(), texts[name]), whole, data[name]))
    return Case(problem.name, source, first_joined(specs.values()), problem, problem if stated else None, tests)


@one_blas_thread()
def _build(name: str, source: CaseText, directory: Path, data: Data | None, allow_outside: bool) -> Case:
    texts = texts_of_tests(source)
    tests = [
        _one_test(test, CaseHome(directory, texts[test], allow_outside), spec, data)
        for test, spec in parse_tests(source).items()
    ]
    first = next(test for test in tests if test.spec.joined)
    with _told_of(first.source if len(tests) == 1 else source, first.spec) as tell:
        tell("prior")
        problem = problem_of(tests, name)
        tell("structure")
        problem.log_posterior  # noqa: B018 (built here so that a DOF that does not exist is found now)
    return Case(name, source, first.spec, problem, problem, tuple(tests))


def _one_test(name: str, home: CaseHome, spec: CaseSpec, data: Data | None) -> CaseTest:
    source = home.source
    stated = spec = read_matrices(spec, home)
    with _told_of(source, spec) as tell:
        tell("joints" if spec.joints else "joint")
        joint = joints_of(spec.joint_objects)
        _require_dofs_of_offsets(spec, source)
        if spec.files is not None:
            from vibrecords.assemble import read_measurement  # with all formats, which others do not need

            tell("data")
            if data is None:
                home.require_inside(("data", "file"), spec.files.file)
            data = data or read_measurement(spec.files.file, home.directory, plan_of(spec))
            spec = complete_from_data(spec, data)
        tell("structure")
        if isinstance(spec.structure, ImportedSpec):
            dofs = (*joint.labels, *(data.dofs if data else ()))
            spec = reduce_imported(spec, home, dofs, top_of(spec, data))
        recipe = recipe_of(spec.structure, spec.data, data)
        for joint_name, side in zip(
            spec.all_joints, joint.joints if isinstance(joint, Joints) else (joint,), strict=True
        ):
            try:
                side.require_one_place(lambda label: recipe.positions.get(label.rpartition(":")[0]))
            except ModelError as error:
                raise CaseError(source.fault((*joint_table(joint_name), *error.key), *error.words)) from error
        if isinstance(recipe, MemberRecipe):
            require_unbuckled(recipe, joint.labels)
        tell("data")
        data = data or measurement_of(spec, joint, name)
        tell("left_out")
        used, apart = (data, None) if spec.leaves_out(name) else split_data(data, spec.left_out)
        tell("noise")
        noise, of_noise = noise_of(spec, used)
        bodies: tuple[MeasuredBody, ...] = ()
        if spec.bodies:
            tell("bodies")
            bodies = measured_bodies(spec, (*joint.labels, *data.dofs), home)
        tell("structure")  # the measured modes are above those of a rigid joint: modulus or sizes come first
        require_lowest(stated, recipe, joint, data)
        tell("data")
        used.require_enough()
    return CaseTest(name, source, spec, recipe, bodies, joint, used, noise, of_noise, apart)


def _require_dofs_of_offsets(spec: CaseSpec, source: CaseText) -> None:
    """Refuse own axes and offsets of joints that need DOFs which the structure lacks, by their keys."""
    for name, joint in spec.all_joints.items():
        sides = (
            ("offset_mm", joint.dofs, joint.offset_mm),
            ("offset_against_mm", joint.against, joint.offset_against_mm),
        )
        for key, dofs, offset in sides:
            if not dofs:
                continue
            turned = Joint(dofs, axes=joint.axes).labels
            for label in Joint(dofs, axes=joint.axes, offset_m=offset).labels:
                absent, held = spec.structure.absent(label) is not None, label in spec.structure.supports
                if label in spec.measured_labels or not (absent or held):
                    continue
                path = (*joint_table(name), "axes" if label in turned else key)
                what = "which is held fixed" if held else "which the structure does not have"
                words = f"found that {', '.join(dofs)} then move with {label}, {what}", "DOFs that move"
                raise CaseError(source.fault(path, *words, "let the structure have it, or correct this"))


@contextmanager
def _told_of(source: CaseText, spec: CaseSpec) -> Iterator[Callable[[str], None]]:
    """Name file, line and key in errors of what is built from a case, yielding what is called with each table's turn.

    The key is the one that looks like a slip, where one does, and else the table, where the file has it.
    """
    tables = ["file"]
    try:
        yield tables.append
    except CaseError:
        raise
    except (JointBayesError, ArithmeticError, np.linalg.LinAlgError, MemoryError) as error:
        table = tables[-1]
        of_file = table == DATA_FILE[0] and isinstance(error, MeasurementError) and DATA_FILE in source.places
        at = DATA_FILE if of_file else (table,)
        if (named := (table, *getattr(error, "key", ()))) in source.places and len(named) > 1:
            at = named
        place, path = source.place(at), source.written(at)
        key = show_key(path if at in source.places else path[:-1])
        slips = (
            () if isinstance(error, MeasurementError) else plausibility.input_warnings(spec, source, spec.data.band_hz)
        )
        if slips:
            place, key = (slips[0].file, slips[0].line), slips[0].key
        message = str(error).removeprefix(f"{'.'.join(DATA_FILE)}: ")
        if isinstance(error, MemoryError):
            message = "found too little memory; expected room for the matrices; use fewer lines, DOFs or elements"
        elif not isinstance(error, JointBayesError):
            message = (
                f"found numbers that are too far apart to be computed with ({error}); expected those of one machine; "
                "check sizes, material and stiffnesses"
            )
        raise CaseError(fault_line(*place, key, message)) from error
