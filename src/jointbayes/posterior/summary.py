"""The numbers of a run: typed, as a table for people, and as `summary.json`, described in docs/summary-json.md."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from typing import Any

import numpy as np

from jointbayes.errors import went
from jointbayes.frf import rigid_body_modes
from jointbayes.inference import Premises, Problem
from jointbayes.posterior.checks import PredictiveCheck, check_of, checks_of
from jointbayes.posterior.compared_frfs import ComparedFrf, compared_frfs_of
from jointbayes.posterior.diagnosis import Diagnosis, diagnoses_of, diagnosis_of
from jointbayes.posterior.identifiability import LIMIT_NOTE, Verdict
from jointbayes.posterior.knowledge import Knowledge, verdict_of
from jointbayes.posterior.model_errors import (
    InferredError,
    MeshCheck,
    NoiseOfBodies,
    measured_bodies_of,
    mesh_of,
    model_error_of,
)
from jointbayes.posterior.prediction import LeftOut, left_out_json, left_out_of, sentence_of_left_out
from jointbayes.posterior.run_record import bodies_of, data_sha256
from jointbayes.posterior.sampled import RunRecord, Sampled, equal_tailed
from jointbayes.posterior.solutions import ModeSummary, solutions_of
from jointbayes.posterior.verdicts import (
    mode_agrees,
    mode_distance,
    mode_sentence,
    reasons_for_no_verdict,
    solution_sentences,
)
from jointbayes.rounding import align_columns, attributes_of, in_lines, json_ready, number, signed, with_interval
from jointbayes.sampling import INTERVAL, quantile_error
from jointbayes.sampling.diagnostics import effective_sizes
from vibrecords import MeasuredFile
from vibrecords.arrays import Array
from vibrecords.notebook_view import table_html

#: Raised when a reader of the older form would misread the newer one.
SCHEMA_VERSION = 5

Interval = tuple[float, float]
_LEAST_MODES, _MOST_MODES = 3, 12  # whose frequencies are told where none was measured, or as many as there are
_LEAST_CORRELATION, _MOST_CORRELATIONS = 0.1, 10  # that are printed


@dataclass(frozen=True, slots=True)
class FrequencySummary:
    """Natural frequencies, Hz: measured if they were, with the first guess of the joint, at the MAP, and over draws."""

    measured: tuple[float, ...] | None
    initial: tuple[float, ...]
    map: tuple[float, ...]
    interval95: tuple[Interval, ...]


@dataclass(frozen=True, slots=True)
class FitSummary:
    """How well the MAP fits the data: squared residuals over σ² as stated, and the log likelihood."""

    n_data: int
    chi2_per_line: float
    log_likelihood_map: float
    synthetic_data: bool


@dataclass(frozen=True, slots=True, eq=False)
class TestSummary:
    """What a run says of the data of one test."""

    __test__ = False

    fit: FitSummary
    check: PredictiveCheck
    diagnosis: Diagnosis
    natural_frequencies_hz: FrequencySummary
    data_sha256: str
    measurement: Mapping[str, Any] | None

    def as_json(self) -> dict[str, Any]:
        """What ``tests.NAME`` of ``summary.json`` holds."""
        return attributes_of(self, "data_sha256", "measurement") | {
            "natural_frequencies_hz": asdict(self.natural_frequencies_hz),
            "fit": fit_json(self.fit, self.diagnosis),
            "check": check_json(self.check, self.diagnosis),
        }


@dataclass(frozen=True, slots=True)
class StiffnessSummary:
    """One stiffness: what its draws say, in `unit`, and how well they were drawn; NaN where a number does not exist."""

    unit: str
    known: Verdict
    map: float
    mode: float
    mean: float
    prior_interval95: Interval
    r_hat: float
    ess_bulk: float
    ess_tail: float


@dataclass(frozen=True, slots=True)
class NuisanceSummary:
    """One quantity besides the joint, in `unit`; `sd_log` and `contraction` refer to its logarithm."""

    unit: str
    nominal: float
    map: float
    median: float
    sd_log: float
    interval95: Interval
    prior_interval95: Interval
    contraction: float
    r_hat: float
    ess_bulk: float
    ess_tail: float


@dataclass(frozen=True, slots=True)
class MapSummary:
    """The MAP, the joint mode next to it, and the starts of the search by name: whether each reached the mode."""

    log_posterior: float
    coordinates: tuple[str, ...]
    theta: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    mode_agrees: bool
    mode_sentence: str
    at_prior_edge: tuple[str, ...]
    mode_distance_sd: float
    starts: tuple[tuple[str, bool], ...]


@dataclass(frozen=True, eq=False)
class Summary:
    """The numbers of a run; `str` makes a table of them, `to_dict` what ``summary.json`` holds.

    Parameters
    ----------
    record
        How the draws came about.
    warnings
        What in the case is probably a slip.
    no_verdict
        Why the run gives no verdict on any stiffness; empty where it does.
    parameters, nuisances
        Each stiffness, and each uncertain quantity besides the joint, by name.
    map, natural_frequencies_hz, fit
        The MAP, natural frequencies there and over draws, and how well it fits.
    check, diagnosis
        Whether the model explains the data, and the misfit in an engineer's measure.
    mesh
        What the elements do to the result; None where the structure is given by matrices.
    measured_bodies
        What the errors of measured bodies do to the result; None where the structure is modelled throughout.
    files_of_bodies
        In which each of them was measured, by its name.
    knowledge
        What `gather_knowledge` found; None where it was not asked.
    data_sha256
        Fingerprint of the data.
    modes, solutions
        Every mode that has draws, where there are several; and what is said of them where they give different
        stiffnesses, empty where not.
    left_out
        What was left out of the data, with what is predicted of it.
    tests
        What is said of the data of each test, by its name; of a lone test under an empty name. Fit, check, diagnosis
        and natural frequencies above are then those of all data, of the test that fits worst, and of the first.
    premises, model_error
        What the answer takes for granted; and the model's error in natural frequencies as it was inferred, None where
        there is no place for one.
    assumptions
        The same in sentences, and what the verdicts take as exact where rows without that were not made.
    correlations
        Of the draws of two coordinates, by their names, where it is above 0.1 either way.
    about
        Title, specimen, date of the test, operator and instruments, as far as the case states them.
    """

    record: RunRecord
    warnings: tuple[str, ...]
    no_verdict: tuple[str, ...]
    parameters: Mapping[str, StiffnessSummary]
    nuisances: Mapping[str, NuisanceSummary]
    map: MapSummary
    natural_frequencies_hz: FrequencySummary
    fit: FitSummary
    check: PredictiveCheck
    diagnosis: Diagnosis
    mesh: MeshCheck | None
    measured_bodies: NoiseOfBodies | None
    files_of_bodies: Mapping[str, tuple[MeasuredFile, ...]]
    knowledge: Knowledge | None
    data_sha256: str
    modes: tuple[ModeSummary, ...]
    solutions: str
    left_out: tuple[LeftOut, ...]
    tests: Mapping[str, TestSummary]
    premises: Premises
    model_error: InferredError | None
    assumptions: tuple[str, ...]
    correlations: Mapping[tuple[str, str], float]
    about: Mapping[str, str]
    compared_frfs: Mapping[str, tuple[ComparedFrf, ...]]

    @property
    def _sections(self) -> list[tuple[str, list[str]]]:
        """Title and lines of each section of the table."""
        record, fit = self.record, self.fit
        known = [p.known for p in self.parameters.values()]
        words = [f"{k.plain_words}," if k.if_exact else k.plain_words for k in known]
        rows = [(f"{name}:", k.value, cls) for name, k, cls in zip(self.parameters, known, words, strict=True)]
        joint = []
        for line, k in zip(align_columns(rows) if known else [], known, strict=True):
            joint += [line, *in_lines(k.if_exact, 4)]
        joint += [LIMIT_NOTE] if any(math.isfinite(k.limit) for k in known) else []
        others = [(f"{name}:", with_interval((n.median, *n.interval95), n.unit)) for name, n in self.nuisances.items()]
        synthetic = ", synthetic" if fit.synthetic_data else ""
        said = [
            *(test.check.sentence for test in self.tests.values()),
            *([sentence_of_left_out(self.left_out)] if self.left_out else []),
            *([] if self.measured_bodies is None else [self.measured_bodies.sentence]),
            *([self.solutions] if self.solutions else []),
            *self.assumptions,
            *(f"No verdict: {reason}" for reason in self.no_verdict),
            *(f"Warning: {warning}" for warning in self.warnings),
        ]
        data = [f"{fit.n_data} values{synthetic}; χ² per value {number(fit.chi2_per_line)}"]
        data += [line for text in said for line in in_lines(text, 0, inside=4)]
        shown = sorted(self.correlations.items(), key=lambda pair: -abs(pair[1]))
        moves = [f"C({', '.join(names)}) = {signed(value)}" for names, value in shown[:_MOST_CORRELATIONS]]
        moves += [f"and {len(shown) - _MOST_CORRELATIONS} more"] if len(shown) > _MOST_CORRELATIONS else []
        told = (specimen_line(self.about), f"{record.state} Seed {record.seed}.")
        state = [line for text in told for line in in_lines(text, 0, inside=4)]
        sections = [
            (f"Posterior of {record.case_name!r}", state),
            ("Joint: median (95 % interval), verdict", joint),
            ("Other quantities: median (95 % interval)", align_columns(others) if others else []),
            ("Data", data),
            (f"Correlations of the draws (above {_LEAST_CORRELATION:g})", moves),
        ]
        return [(title, lines) for title, lines in sections if lines]

    def __str__(self) -> str:
        parts = [[f"[[{title}]]", *(f"    {line}" for line in lines)] for title, lines in self._sections]
        return "\n".join(line for part in parts for line in part)

    __repr__ = __str__  # what a notebook shows of the last line of a cell

    def _repr_html_(self) -> str:
        rows = [stiffness_row(name, p.known) for name, p in self.parameters.items()]
        (title, state), _, *rest = self._sections
        below = "\n".join(line for head, lines in rest for line in (head, *(f"    {text}" for text in lines)))
        return table_html("\n".join([title, *state]), STIFFNESS_HEAD, rows, f"<pre>{escape(below)}</pre>")

    def to_dataframe(self) -> Any:  # noqa: ANN401 (a pandas.DataFrame, loaded late)
        """A pandas.DataFrame with a row for each stiffness and each other uncertain quantity, in its unit."""
        return quantity_frame(self.to_dict())

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 (of names that went)
        raise went(self, name)

    def to_dict(self) -> dict[str, Any]:
        """What ``summary.json`` holds: no NaN or infinity, ``None`` where a number does not exist."""
        record, bodies = self.record, self.measured_bodies
        files = {name: [asdict(file) for file in each] for name, each in self.files_of_bodies.items()}
        summary = {
            "schema_version": SCHEMA_VERSION,
            "case": record.case_name,
            **attributes_of(record, "seed", "converged", "reason", "sampler", "versions"),
            **attributes_of(self, "about", "warnings", "no_verdict", "solutions", "data_sha256"),
            "parameters": {
                name: attributes_of(p, "unit", "map")
                | p.known.as_json()
                | attributes_of(p, "r_hat", "ess_bulk", "ess_tail")
                for name, p in self.parameters.items()
            },
            "nuisances": {name: asdict(n) for name, n in self.nuisances.items()},
            "modes": [asdict(mode) for mode in self.modes],
            "map": asdict(self.map) | {"starts": [{"name": n, "reached_mode": r} for n, r in self.map.starts]},
            "natural_frequencies_hz": asdict(self.natural_frequencies_hz),
            "fit": fit_json(self.fit, self.diagnosis),
            "check": check_json(self.check, self.diagnosis),
            "mesh": None if self.mesh is None else self.mesh.as_json(),
            "measured_bodies": None if bodies is None else bodies.as_json() | {"files": files},
            "under": {} if self.knowledge is None else self.knowledge.under_as_json(),
            "identifiability": None if self.knowledge is None else self.knowledge.as_json(),
            "left_out": left_out_json(self.left_out),
            "model_error": None if self.model_error is None else self.model_error.as_json(),
            "premises": asdict(self.premises),
            "measurement": next(iter(self.tests.values())).measurement,
            "tests": {name: test.as_json() for name, test in self.tests.items() if name},
            "compared_frfs": [{"test": test, **asdict(f)} for test, frfs in self.compared_frfs.items() for f in frfs],
        }
        return json_ready(summary)


def summarise(
    posterior: Sampled,
    initial: Sequence[float],
    measured_frequencies_hz: Sequence[float] | None = None,
    knowledge: Knowledge | None = None,
    warnings: Sequence[str] = (),
    assumptions: Sequence[str] = (),
    about: Mapping[str, str] | None = None,
) -> Summary:
    """Summarise a posterior.

    Parameters
    ----------
    posterior
        The posterior.
    initial
        First guess of the joint's quantities, for the frequencies before identification.
    measured_frequencies_hz
        Measured natural frequencies to compare with the predicted ones, if known.
    knowledge
        What `gather_knowledge` found; without it only the check of the model is made here.
    warnings
        What in the case is probably a slip, see `Case.warnings`.
    assumptions
        What the answer takes for granted, in sentences.
    about
        What was tested, see `Case.about`.
    """
    estimate, problem = posterior.estimate, posterior.problem
    tests = summaries_of_tests(posterior, initial, measured_frequencies_hz)
    first = next((test for test in problem.tests if test.joints.size), problem.tests[0])
    # Before the reasons for no verdict, because a stiffness that is held rigid is refused here.
    parameters = {name: stiffness_summary(posterior, i, name) for i, name in enumerate(posterior.stiffness_names)}
    return Summary(
        record=posterior.record,
        warnings=tuple(warnings),
        no_verdict=tuple(map(str, reasons_for_no_verdict(posterior))),
        parameters=parameters,
        nuisances={n.name: nuisance_summary(posterior, i) for i, n in enumerate(posterior.problem.prior.nuisances)},
        map=MapSummary(
            log_posterior=estimate.log_posterior,
            coordinates=posterior.problem.names,
            theta=tuple(estimate.theta.tolist()),
            covariance=tuple(map(tuple, estimate.covariance.tolist())),
            mode_agrees=mode_agrees(posterior),
            mode_sentence=mode_sentence(posterior),
            at_prior_edge=posterior.problem.prior.coordinates_at_edge(posterior.best.theta),
            mode_distance_sd=mode_distance(posterior),
            starts=tuple((s.name, s.reached_mode) for s in estimate.starts),
        ),
        natural_frequencies_hz=tests[first.name].natural_frequencies_hz,
        fit=fit_of(problem, estimate.theta),
        check=check_of(posterior),
        diagnosis=diagnosis_of(posterior),
        mesh=mesh_of(posterior),
        measured_bodies=measured_bodies_of(posterior),
        files_of_bodies={name: body.files for name, body in bodies_of(problem).items()},
        knowledge=knowledge,
        data_sha256=data_sha256(problem),
        modes=solutions_of(posterior).summaries(),
        solutions=" ".join(solution_sentences(posterior)),
        left_out=left_out_of(posterior),
        tests=tests,
        premises=problem.premises,
        model_error=model_error_of(posterior),
        assumptions=tuple(assumptions),
        correlations=_correlations(posterior),
        about=about or {},
        compared_frfs=compared_frfs_of(posterior),
    )


def measured_frequencies(posterior: Sampled) -> tuple[float, ...] | None:
    """Measured natural frequencies of the one test, if they are the lowest and data, or the case states any, Hz."""
    if posterior.case is not None:
        return posterior.case.measured_frequencies_hz
    tests = posterior.problem.tests
    return None if len(tests) > 1 else tests[0].data.lowest_hz


def summaries_of_tests(
    posterior: Sampled, initial: Sequence[float], measured_frequencies_hz: Sequence[float] | None
) -> dict[str, TestSummary]:
    """What is said of each test by its name; of a lone test by an empty one, with further measured frequencies."""
    summaries, parts = {}, posterior.problem.parts
    for part, check, diagnosis in zip(parts, checks_of(posterior), diagnoses_of(posterior), strict=True):
        test, provenance = part.test, part.test.data.provenance
        measured_hz = measured_frequencies_hz if len(parts) == 1 else test.data.lowest_hz
        summaries[test.name] = TestSummary(
            fit_of(part, posterior.estimate.theta),
            check,
            diagnosis,
            frequency_summary(posterior, part, initial, measured_hz, len(diagnosis.modes)),
            data_sha256(part),
            provenance.as_json() if provenance else None,
        )
    return summaries


def frequency_summary(
    posterior: Sampled, problem: Problem, initial: Sequence[float], measured: Sequence[float] | None, seen: int
) -> FrequencySummary:
    """Of as many modes as were measured, or as the FRFs show resonances."""
    theta, test = posterior.estimate.theta, problem.test
    count = len(measured) if measured else min(max(seen, _LEAST_MODES), _MOST_MODES)
    if not (measured or test.measured_bodies):  # a body that is given by its FRFs has none that are known
        body = test.structures_of_data
        count = min(count, body.n_dofs - rigid_body_modes(body, test.joints))
    fitted = problem.prior.factors(theta)  # the first guess is one of the joint, not of these

    def frequencies_of(stiffness: Sequence[float] | Array) -> tuple[float, ...]:
        return tuple(problem.natural_frequencies_hz(np.asarray(stiffness), count, fitted)[0].tolist())

    predicted = posterior.predict_natural_frequencies(count, test=test.name or None)
    ends = np.quantile(predicted, [0.025, 0.975], axis=0).T
    return FrequencySummary(
        measured=tuple(measured) if measured else None,
        initial=frequencies_of(initial),
        map=frequencies_of(problem.prior.values(theta)),
        interval95=tuple(map(tuple, ends.tolist())),
    )


def fit_of(problem: Problem, theta: Array) -> FitSummary:
    """How well θ, shape (d,), fits the data of all tests of a problem."""
    n_data, total = problem.log_posterior.likelihood.n_data, 0.0
    for part in problem.parts:
        # squared residuals over σ² as stated: expected 1 for each complex value or frequency
        total += float((np.abs(part.log_posterior.standardised(theta)) ** 2).sum())
    return FitSummary(
        n_data=n_data,
        chi2_per_line=total / n_data,
        log_likelihood_map=float(problem.log_posterior.log_likelihood(theta)[0]),
        synthetic_data=any(part.test.data.synthetic for part in problem.parts),
    )


def fit_json(fit: FitSummary, diagnosis: Diagnosis) -> dict[str, Any]:
    """What ``fit`` of ``summary.json`` holds."""
    return asdict(fit) | {
        "resonances": [
            {"measured_hz": m.measured_hz, "map_hz": m.predicted_hz, "error_percent": m.error_percent}
            for m in diagnosis.modes
        ],
        "frf_correlation": [
            {"output": p.output, "input": p.input, "correlation": p.correlation, "level": p.level}
            for p in diagnosis.pairs
        ],
    }


def check_json(check: PredictiveCheck, diagnosis: Diagnosis) -> dict[str, Any]:
    """What ``check`` of ``summary.json`` holds."""
    white = check.whiteness
    return {
        **attributes_of(check, "explains", "finding", "sentence", "details", "level"),
        **attributes_of(check, "chi2_per_line", "chi2_band", "chi2_p_value", "whiteness_p_value"),
        "causes": [] if check.explains else list(diagnosis.causes),
        "diagnosis": None if check.explains else diagnosis.sentence,
        "pattern": None if white is None else check.pattern,
        "whiteness": None if white is None else white.statistic,
        "whiteness_limit": None if white is None else white.limit(check.test_level),
        "lag_correlations": [] if white is None else list(white.correlations),
        "false_alarm": check.test_level,
        "largest_residual_sd": check.largest,
    }


#: What a case may say of its test, in words.
OF_A_TEST = {"specimen": "Specimen", "date": "Date of test", "operator": "Operator", "instruments": "Instruments"}


def specimen_line(about: Mapping[str, str]) -> str:
    """What was tested, when, by whom and with what, in one line; empty where nothing is stated."""
    return "; ".join(f"{words}: {about[key]}" for key, words in OF_A_TEST.items() if key in about)


def _correlations(posterior: Sampled) -> dict[tuple[str, str], float]:
    """Correlations of the coordinates' draws, of those that are not held."""
    moved = np.flatnonzero(np.ptp(posterior.theta, axis=0) > 0)
    matrix = np.atleast_2d(np.corrcoef(posterior.theta[:, moved].T)) if moved.size else np.empty((0, 0))
    names = [posterior.problem.names[i] for i in moved]
    pairs = zip(*np.triu_indices(len(names), 1), strict=True)
    return {(names[i], names[j]): float(matrix[i, j]) for i, j in pairs if abs(matrix[i, j]) > _LEAST_CORRELATION}


def stiffness_summary(posterior: Sampled, index: int, name: str) -> StiffnessSummary:
    """The numbers of the stiffness at one place."""
    values, r_hat = posterior.values(name), posterior.record.r_hat
    ess_bulk, ess_tail = effective_sizes(np.log(values) if (values > 0).all() else values)
    return StiffnessSummary(
        unit=posterior.unit(name),
        known=verdict_of(posterior, name),
        map=float(posterior.estimate.values[index]),
        mode=posterior.mode[name],
        mean=float(values.mean()),
        prior_interval95=equal_tailed(posterior.prior_values(name), 0.95),
        r_hat=r_hat[posterior.problem.parametrisation.standing_for(name)],
        ess_bulk=ess_bulk,
        ess_tail=ess_tail,
    )


def nuisance_summary(posterior: Sampled, index: int) -> NuisanceSummary:
    """The numbers of the uncertain quantity at one place."""
    prior = posterior.problem.prior
    nuisance = prior.nuisances[index]
    values, before = posterior.values(nuisance.name), posterior.prior_values(nuisance.name)
    ess_bulk, ess_tail = effective_sizes(nuisance.coordinate(values))
    sd, prior_sd = (float(nuisance.coordinate(v).std()) for v in (values, before))
    return NuisanceSummary(
        unit=nuisance.unit,
        nominal=float(nuisance.value(0.0)),
        map=float(prior.nuisance_values(posterior.estimate.theta)[index]),
        median=float(np.median(values)),
        sd_log=sd,
        interval95=equal_tailed(values, 0.95),
        prior_interval95=equal_tailed(before, 0.95),
        contraction=1 - (sd / prior_sd) ** 2,
        r_hat=posterior.record.r_hat[nuisance.name],
        ess_bulk=ess_bulk,
        ess_tail=ess_tail,
    )


def value_rows(drawn: Mapping[str, tuple[Array, str]]) -> list[tuple[str, str]]:
    """Name of quantities, and median with 95 % interval and unit.

    Of each its draws, shape (ensembles, draws, walkers), and its unit.
    """
    rows, probabilities = [], (0.5, *INTERVAL)
    for name, (draws, unit) in drawn.items():
        errors = [quantile_error(draws, probability) for probability in probabilities]
        rows.append((name, with_interval(np.quantile(draws, probabilities).tolist(), unit, errors)))
    return rows


def quantity_frame(summary: Mapping[str, Any]) -> Any:  # noqa: ANN401 (a pandas.DataFrame)
    """One row for each quantity of what ``summary.json`` holds; what does not exist is NaN."""
    import pandas

    rows = {**summary["parameters"], **summary["nuisances"]}
    return pandas.DataFrame.from_dict({name: _cells(row) for name, row in rows.items()}, orient="index")


def _cells(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row without lists: ``interval95`` as ``low95`` and ``high95``, reasons and conditions as texts."""
    cells: dict[str, Any] = {}
    for name, value in row.items():
        if name in _PAIRS:
            cells |= dict(zip(_PAIRS[name], value, strict=True))
        elif name == "reasons":
            cells[name] = "; ".join(reason["text"] for reason in value)
        else:
            cells[name] = ", ".join(value) if isinstance(value, list) else value
    return {name: math.nan if value is None else value for name, value in cells.items()}


#: Columns of what ``summary.json`` holds as a pair.
_PAIRS = {
    "interval95": ("low95", "high95"),
    "interval95_error": ("low95_error", "high95_error"),
    "likelihood95": ("likelihood_low95", "likelihood_high95"),
    "prior_interval95": ("prior_low95", "prior_high95"),
}
STIFFNESS_HEAD = ("Stiffness", "Median (95 % interval)", "Verdict")


def stiffness_row(name: str, known: Verdict) -> tuple[str, ...]:
    """What is printed of one stiffness, below `STIFFNESS_HEAD`."""
    return name, known.value, known.words
