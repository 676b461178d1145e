"""Cases whose data are in measurement files: what is read, what becomes of it, and what is said of it."""

import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from benchmarks.written_files import FORMATS, write_records
from click.testing import CliRunner

import jointbayes as jb
from jointbayes.cli.commands import main
from jointbayes.inference import GaussianNoise, StudentNoise
from tests.case.test_structures import MATRICES, text_of
from tests.conftest import TABLE_3, best_of, cheap_text, cli, edited, pair_matrix, plain_reports
from tests.one_line import refused
from tests.simulated import noisy_frf
from vibrecords import CoherenceNoise, FrfSet, Quantity
from vibrecords.formats import records_of_frf
from vibrecords.records import FrfRecord

LABELS = {"5:y": "Point:5:Y+", "4:y": "Point:4:Y+", "2:y": "Point:2:Y+", "1:y": "Point:1:Y+", "1:rz": "Point:1:RZ+"}
CHANNELS = '"Point:5:Y+" = "5:y"\n"Point:1:Y+" = "1:y"\n"Point:1:RZ+" = "1:rz"\n'
RELATIVE = '[data.variance]\nsource = "relative"\nrelative = 0.01\nfloor = 0.0\n'
COHERENCE = '[data.variance]\nsource = "coherence"\n'
FEWEST = jb.SamplerSettings(walkers=8, max_steps=100)
SMALL = jb.SamplerSettings(walkers=8, max_steps=600, tau_factor=10, r_hat_max=1.1, end_tolerance=0.1)


def truth(*changes: tuple[str, str]) -> jb.Case:
    return jb.case_from_text("truth", edited(cheap_text(), *changes))


@cache
def virtual(
    outputs: tuple[str, ...] = ("5:y", "1:y", "1:rz"),
    inputs: tuple[str, ...] = ("5:y",),
    *,
    quantity: Quantity = "accelerance",
    averages: int = 50,
    coherence: float = 0.998,
    seed: int = 4,
    changes: tuple[tuple[str, str], ...] = (),
) -> FrfSet:
    """Noisy FRFs with coherence of the small beam with the published joint, at DOFs of the model."""
    case = truth(*changes)
    lines = np.array(case.spec.data.lines_hz())
    model = case.problem.test.receptance_model(jb.Ports(lines, outputs, inputs))
    exact = FrfSet(lines, model.receptance(pair_matrix(TABLE_3))[0], outputs, inputs).converted("accelerance")
    noisy = noisy_frf(exact, CoherenceNoise(coherence, averages), averages, np.random.default_rng(seed))
    return noisy.converted(quantity)


def stored(frf: FrfSet, path: Path, kind: str = "npz", labels: dict[str, str] | None = None) -> None:
    """Write FRFs under the labels of a test rig's channels."""
    names = {**LABELS, **(labels or {})}
    records = [
        replace(record, response=names[record.response], reference=names[record.reference])
        for record in records_of_frf(frf)
    ]
    write_records(records, path, kind)


def text(data: str, *changes: tuple[str, str]) -> str:
    """The small case with other data."""
    whole = edited(cheap_text(), *changes)
    start, end = whole.index("[data]"), whole.index("[identification]")
    return f"{whole[:start]}{data}\n{whole[end:]}"


def frf_data(head: str = "", channels: str = CHANNELS, variance: str = COHERENCE, file: str = '"tip.npz"') -> str:
    return f'[data]\nkind = "measured_frf"\nfile = {file}\n{head}\n[data.channels]\n{channels}\n{variance}\n'


def loaded(folder: Path, data: str, *changes: tuple[str, str]) -> jb.Case:
    path = folder / "case.toml"
    path.write_text(text(data, *changes), encoding="utf-8")
    return jb.load_case(path)


TIP = frf_data('outputs = ["5:y"]')


def read(folder: Path, frf: FrfSet, data: str = TIP, *changes: tuple[str, str]) -> jb.Case:
    """The case with these FRFs in its file."""
    stored(frf, folder / "tip.npz")
    return loaded(folder, data, *changes)


def refuses(folder: Path, data: str, words: str) -> None:
    refused(lambda: loaded(folder, data), jb.CaseError, words)


def frequencies(keys: str) -> str:
    return FREQUENCIES.replace("\n\n[data.ch", f"\n{keys}\n\n[data.ch")


def test_sensors_on_the_clamped_face_become_the_dofs_of_the_joint(tmp_path):
    motion, arms = virtual(("1:y", "1:rz")), (-0.01, 0.0, 0.02)
    values = np.stack([motion.values[:, 0] + arm * motion.values[:, 1] for arm in arms], axis=1)
    sensors = {f"{101 + i}:y": f"Point:{101 + i}:Y+" for i in range(3)}
    stored(replace(motion, values=values, outputs=tuple(sensors), coherence=None), tmp_path / "tip.npz", labels=sensors)
    channels = "".join(f'"{label}" = "{dof}"\n' for dof, label in sensors.items()) + '"Point:5:Y+" = "5:y"\n'
    places = ", ".join(f"{101 + i} = [{1e3 * arm}, 0, 0]" for i, arm in enumerate(arms))
    point = f'[data.virtual_points.1]\nplace_mm = [0, 0, 0]\nsensors_mm = {{ {places} }}\ndofs = ["y", "rz"]\n'
    case = loaded(tmp_path, frf_data(channels=channels, variance=point + RELATIVE))
    data = case.problem.test.data
    assert data.frf.outputs == data.joint_frf.outputs == ("1:y", "1:rz")
    np.testing.assert_allclose(data.frf.values, motion.values, rtol=1e-9)
    assert any("virtual point 1 leaves" in note for note in data.provenance.notes)


@pytest.mark.parametrize("kind", FORMATS)
def test_the_frfs_of_a_file_become_the_data_of_the_case(tmp_path, kind):
    frf = virtual()
    stored(frf, tmp_path / "tip.npz", kind)  # the ending says nothing
    case = loaded(tmp_path, TIP)
    measured = case.problem.test.data
    assert (measured.frf.outputs, measured.frf.inputs, measured.frf.quantity) == (("5:y",), ("5:y",), "accelerance")
    np.testing.assert_allclose(measured.frf.values, frf.values[:, :1], rtol=1e-12)
    np.testing.assert_allclose(measured.variance, jb.coherence_variance(frf)[:, :1], rtol=1e-9)
    assert measured.synthetic is False
    assert case.problem.test.data.joint_frf.outputs == ("5:y", "1:y", "1:rz")
    np.testing.assert_allclose(case.problem.test.data.joint_frf.values, frf.values, rtol=1e-12)


@pytest.mark.science
def test_file_to_posterior_finds_the_joint_of_the_virtual_test(run):
    posterior, _ = run
    for name, true in zip(("k11", "k12", "k22"), TABLE_3, strict=True):
        low, high = posterior.interval(name)
        assert low < true < high
    assert posterior.verdict("k22").cls == "identified"
    assert posterior.check.explains


@pytest.mark.parametrize("variance", [COHERENCE, '[data.variance]\nsource = "relative"\nrelative = 0.02\nfloor = 0.01'])
def test_the_posterior_does_not_depend_on_the_quantity_of_the_file(tmp_path, variance):
    densities, damping = [], []
    quantities: tuple[Quantity, ...] = ("receptance", "mobility", "accelerance")
    for quantity in quantities:
        data = frf_data('outputs = ["5:y"]', variance=variance)
        case = read(tmp_path, virtual(quantity=quantity), data, ("ratio = 0.01", 'ratio = "measured"'))
        assert case.problem.test.data.frf.quantity == quantity
        values = case.problem.log_posterior(case.problem.prior.sample(np.random.default_rng(2), 200))
        inside = np.isfinite(values)
        assert inside.sum() > 20
        densities.append((values - values[inside][0])[inside])
        damping.append(case.spec.structure.damping.ratio)
    for other in densities[1:]:
        np.testing.assert_allclose(other, densities[0], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(damping[1:], [damping[0]] * 2, rtol=1e-8)


def test_band_and_thinning_choose_the_lines(tmp_path):
    frf = virtual()
    case = read(tmp_path, frf, frf_data("f_min_hz = 100.0\nf_max_hz = 1000.0\nthin = 3"))
    lines = frf.frequency_hz[(frf.frequency_hz >= 100) & (frf.frequency_hz <= 1000)][::3]
    np.testing.assert_array_equal(case.problem.test.data.frf.frequency_hz, lines)
    assert "Of 3 lines one was kept." in case.problem.test.data.provenance.notes


def test_the_quantity_of_the_case_wins_and_the_contradiction_is_said(tmp_path):
    case = read(tmp_path, virtual(), frf_data('quantity = "mobility"'))
    assert case.problem.test.data.frf.quantity == "mobility"
    assert any("the file says accelerance" in str(w) and "the case mobility" in str(w) for w in case.warnings)
    agreeing = loaded(tmp_path, frf_data('quantity = "accelerance"'))
    assert not any("the file says" in str(warning) for warning in agreeing.warnings)


def test_warnings_about_the_file_are_kept_and_a_sign_put_right_by_the_mapping_is_none(tmp_path):
    frf = virtual(("5:y",))
    wrong = read(tmp_path, replace(frf, values=-frf.values), frf_data(channels='"Point:5:Y+" = "5:y"\n'))
    assert any("5:y/5:y" in warning.where for warning in wrong.problem.test.data.provenance.warnings)
    records = [replace(r, response="acc", reference="hammer") for r in records_of_frf(frf)]
    write_records([replace(r, values=-r.values) for r in records], tmp_path / "tip.npz", "npz")
    right = loaded(tmp_path, frf_data(channels='"acc" = "-5:y"\n"hammer" = "5:y"\n'))
    assert right.problem.test.data.provenance.warnings == ()
    np.testing.assert_allclose(right.problem.test.data.frf.values, frf.values, rtol=1e-12)


def test_a_file_that_does_not_say_its_quantity_needs_one(tmp_path):
    records = [
        replace(r, response=LABELS[r.response], reference=LABELS[r.reference], quantity=None, unit="")
        for r in records_of_frf(virtual())
    ]
    write_records(records, tmp_path / "tip.npz", "npz")
    refuses(tmp_path, TIP, r'does not say what it is.*write for example quantity = "accelerance"')
    assert loaded(tmp_path, frf_data('quantity = "accelerance"')).problem.test.data.frf.quantity == "accelerance"


def test_one_frf_in_several_files_is_one_only_as_repeats(tmp_path):
    for i in range(2):
        stored(virtual(seed=i), tmp_path / f"run{i}.npz")
    files = '["run0.npz", "run1.npz"]'
    case = loaded(tmp_path, frf_data(variance='[data.variance]\nsource = "repeats"\n', file=files))
    assert [file.name for file in case.problem.test.data.provenance.files] == ["run0.npz", "run1.npz"]
    assert case.problem.test.data.variance_dof == 2
    refuses(tmp_path, frf_data(file=files), r'run1.npz.*another FRF of 5:y over 5:y.*source = "repeats"')


def test_several_files_make_one_set(tmp_path):
    frf = virtual()
    stored(frf.select(("5:y",), ("5:y",)), tmp_path / "tip.npz")
    stored(frf.select(("1:y", "1:rz"), ("5:y",)), tmp_path / "joint.uff", "uff58b")
    case = loaded(tmp_path, frf_data(file='["tip.npz", "joint.uff"]'))
    np.testing.assert_allclose(case.problem.test.data.frf.values, frf.values, rtol=1e-12)


def test_one_average_falls_back_on_a_stated_floor_only(tmp_path):
    frf = replace(virtual(), averages=1)
    stored(replace(frf, coherence=np.ones(frf.values.shape)), tmp_path / "tip.npz")
    refuses(tmp_path, TIP, "found 1 average")
    stated = '[data.variance]\nsource = "coherence"\nrelative = 0.02\nfloor = 0.01\n'
    case = loaded(tmp_path, frf_data(variance=stated))
    magnitude = np.abs(frf.values)
    expected = 2 * (0.02 * magnitude + 0.01 * np.median(magnitude, axis=0)) ** 2
    ratio = case.problem.test.data.variance / expected  # that of a modal fit over that of the noisy |H|
    assert np.median(ratio) == pytest.approx(1.0, abs=0.01)
    assert ratio.std() < 0.05
    assert "of one average coherence says nothing" in case.problem.test.data.provenance.variance


def test_a_variance_estimated_from_few_averages_makes_residuals_student_t(tmp_path):
    assert read(tmp_path, virtual(averages=10), TIP).problem.test.noise == StudentNoise(2, 18.0)
    stated = TIP + '\n[noise]\ndistribution = "gaussian"\n'
    assert isinstance(loaded(tmp_path, stated).problem.test.noise, GaussianNoise)
    relative = frf_data(variance='[data.variance]\nsource = "relative"\nrelative = 0.02\nfloor = 0.01\n')
    assert isinstance(loaded(tmp_path, relative).problem.test.noise, GaussianNoise)
    assert isinstance(read(tmp_path, virtual(averages=300), TIP).problem.test.noise, GaussianNoise)


def test_without_frfs_at_the_joint_the_iteration_is_left_out_and_says_why(tmp_path):
    case = read(tmp_path, virtual(("5:y",)), frf_data(channels='"Point:5:Y+" = "5:y"\n'))
    assert case.problem.test.data.joint_frf is None
    assert "no FRF of 1:y" in case.problem.test.data.provenance.iteration
    refused(lambda: jb.identify(case), jb.ModelError, "no FRF of 1:y, a DOF of the joint")
    result = cli("identify", tmp_path / "case.toml", "--paper")
    assert (result.exit_code, "The paper's iteration is left out." in result.output) == (0, True)


STATIONS = '"Point:5:Y+" = "5:y"\n"Point:1:Y+" = "1:y"\n"Point:2:Y+" = "2:y"\n'


def test_stations_give_the_rotation_that_the_iteration_needs_and_stay_in_the_likelihood(tmp_path):
    frf = virtual(("5:y", "1:y", "2:y"))
    stored(frf, tmp_path / "tip.npz")
    rotation = '[data.rotations."1:rz"]\nstations = ["1:y", "2:y"]\n'
    case = loaded(tmp_path, frf_data(channels=STATIONS, variance=COHERENCE + rotation))
    assert case.problem.test.data.frf.outputs == ("5:y", "1:y", "2:y")
    assert case.problem.test.data.joint_frf.outputs == ("5:y", "1:y", "2:y", "1:rz")
    derived = (frf.frf("2:y", "5:y") - frf.frf("1:y", "5:y")) / (0.383 / 4)
    np.testing.assert_allclose(case.problem.test.data.joint_frf.frf("1:rz", "5:y"), derived, rtol=1e-10)
    assert jb.identify(case).steps > 0


def test_a_rotation_in_the_likelihood_replaces_its_stations(tmp_path):
    frf = virtual(("5:y", "1:y", "2:y"))
    stored(frf, tmp_path / "tip.npz")
    rotation = '[data.rotations."1:rz"]\nstations = ["1:y", "2:y"]\nspacing_mm = 50.0\nin_likelihood = true\n'
    measured = loaded(tmp_path, frf_data(channels=STATIONS, variance=COHERENCE + rotation)).problem.test.data
    assert measured.frf.outputs == ("5:y", "1:rz")
    variance = jb.coherence_variance(frf)[:, 1:, 0].sum(axis=1) / 0.05**2
    np.testing.assert_allclose(measured.variance[:, 1, 0], variance, rtol=1e-9)
    refuses(
        tmp_path,
        frf_data('outputs = ["1:y"]', channels=STATIONS, variance=COHERENCE + rotation),
        "found 1:y, which a rotation in the likelihood replaces",
    )


FREQUENCIES = (
    '[data]\nkind = "measured_frequencies"\nfile = "tip.npz"\n\n[data.channels]\n"Point:5:Y+" = "5:y"\n' + COHERENCE
)


def test_natural_frequencies_are_found_in_a_file_and_feed_the_frequency_likelihood(tmp_path):
    case = read(tmp_path, virtual(("5:y",)), frequencies("sd_relative = 0.001"))
    measured = case.problem.test.data
    true = truth().problem.natural_frequencies_hz(TABLE_3, 3)[0]
    assert np.abs((measured.frequency_hz - true) / measured.sd_hz).max() < 3
    assert measured.sd_hz[2] >= 0.001 * measured.frequency_hz[2]
    assert case.problem.test.data.joint_frf is None
    assert jb.find_map(case).values[2] == pytest.approx(TABLE_3[2], rel=0.5)


def test_a_missed_first_mode_is_noticed(tmp_path):
    stored(virtual(("5:y",)), tmp_path / "tip.npz")
    refuses(
        tmp_path,
        frequencies("f_min_hz = 300.0"),
        r"structure: found mode 1 at 75\d.*; correct Young's.* f_min_hz if a mode",
    )
    refuses(tmp_path, frequencies("modes = 4"), r"found 3 modes; expected at least 4")


def test_what_the_modal_fit_cannot_know_adds_in_squares_to_the_deviations_of_frequencies(tmp_path):
    stored(virtual(("5:y",)), tmp_path / "tip.npz")
    bare, more = (
        loaded(tmp_path, frequencies(lines)).problem.test.data
        for lines in ("sd_relative = 0.0\nsd_hz = 0.0", "sd_relative = 0.002\nsd_hz = 0.7")
    )
    added = np.sqrt(more.sd_hz**2 - bare.sd_hz**2)
    np.testing.assert_allclose(added, np.hypot(0.002 * bare.frequency_hz, 0.7), rtol=1e-6)


@pytest.mark.parametrize(("above", "missed"), [(1.10, False), (1.20, True)])
def test_a_mode_counts_as_missed_from_15_percent_above_that_of_a_rigid_joint(tmp_path, above, missed):
    rigid, found = (truth().problem.natural_frequencies_hz(k, 1)[0, 0] for k in ([1e13, 0.0, 1e13], TABLE_3))
    # frequencies of a slender beam go with 1/length²
    length = 383.0 * np.sqrt(found / rigid / above)
    stored(virtual(("5:y",), changes=(("length_mm = 383.0", f"length_mm = {length:.3f}"),)), tmp_path / "tip.npz")
    if missed:
        refuses(tmp_path, FREQUENCIES, r"found mode 1 at .* if a mode was missed")
    else:
        assert loaded(tmp_path, FREQUENCIES).problem.test.data.frequency_hz[0] > 1.08 * rigid


def test_damping_ratios_come_from_the_data_and_stay_uncertain(tmp_path):
    stored(virtual(("5:y",)), tmp_path / "tip.npz")
    channels = '"Point:5:Y+" = "5:y"\n'
    case = loaded(tmp_path, frf_data(channels=channels), ("ratio = 0.01", 'ratio = "measured"'))
    ratios = case.spec.structure.damping.ratio
    assert ratios == tuple(mode.damping_ratio for mode in case.problem.test.data.provenance.modes)
    assert np.allclose(ratios, 0.01, rtol=0.05)
    ranges = {n.name: np.exp(n.range) for n in case.problem.prior.nuisances}
    assert list(ranges) == ["damping_ratio_1", "damping_ratio_2", "damping_ratio_3"]
    for low, high in ranges.values():
        assert (low, high) == pytest.approx((1 / 3, 3))
    stated = ("[data]", "[uncertain.damping_ratio]\nsd_percent = 5.0\n[data]")
    own = edited(text(frf_data(channels=channels), ("ratio = 0.01", 'ratio = "measured"')), stated)
    assert jb.case_from_text("own", own, directory=tmp_path).spec.uncertain.damping_ratio.sd_percent == 5.0


@pytest.mark.science
def test_stations_find_the_joint_and_a_rotation_by_coarse_differences_does_not(configs):
    start = {"published": TABLE_3}
    stations, rotation = (jb.load_case(configs / f"measured_{name}.toml") for name in ("stations", "rotation"))
    assert stations.problem.test.data.frf.outputs == ("11:y", "1:y", "2:y", "3:y")
    assert rotation.problem.test.data.frf.outputs == ("11:y", "1:rz")
    assert stations.problem.test.data.joint_frf.outputs == ("11:y", "1:y", "2:y", "3:y", "1:rz")
    np.testing.assert_allclose(best_of(stations.problem.log_posterior, start).values, TABLE_3, rtol=0.005)
    assert np.abs(best_of(rotation.problem.log_posterior, start).values / TABLE_3 - 1).max() > 0.1


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> tuple[jb.Posterior, Path]:
    folder = tmp_path_factory.mktemp("run")
    stored(virtual(), folder / "tip.npz")
    posterior = jb.sample(loaded(folder, TIP), seed=1, settings=SMALL, premises="exact")
    posterior.save(folder / "posterior.nc")
    return posterior, folder


@pytest.fixture(scope="module")
def reported(run) -> tuple[jb.Posterior, Path]:
    """The same with its report, and the file gone."""
    posterior, folder = run
    with plain_reports():
        jb.write_report(posterior, folder / "before")
    shutil.move(folder / "tip.npz", folder / "gone.npz")
    return run


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
def test_draws_are_loaded_and_reported_without_the_file(reported, monkeypatch):
    posterior, folder = reported
    monkeypatch.chdir("/")
    again = jb.load_posterior(folder / "posterior.nc")
    first, second = posterior.problem.test.data.shown_frfs, again.problem.test.data.shown_frfs
    np.testing.assert_array_equal(first.frf.values, second.frf.values)
    np.testing.assert_array_equal(first.variance, second.variance)
    assert second.provenance == first.provenance
    jb.write_report(again, folder / "after")
    for name in ("summary.json", "report.html", "case.toml"):
        assert (folder / "before" / name).read_bytes() == (folder / "after" / name).read_bytes()


@pytest.mark.whole
@pytest.mark.usefixtures("rough_proposals")
@pytest.mark.parametrize("kind", ["one test", "two tests", "matrices"])
def test_draws_are_loaded_where_the_files_of_the_case_are_not(kind, tmp_path, monkeypatch):
    (tmp_path / "files").mkdir()
    stored(virtual(), tmp_path / "files" / "tip.npz")
    np.save(tmp_path / "files" / "K.npy", np.array([[2e5, -1e4], [-1e4, 1e3]]))
    given = {
        "one test": text(TIP + "[tests.only]\n"),
        "two tests": text(TIP + "[tests.one]\n[tests.two]\n"),
        "matrices": text_of(MATRICES, "1:y", "1:y").replace("[[2e5, -1e4], [-1e4, 1e3]]", '"K.npy"'),
    }
    (tmp_path / "files" / "case.toml").write_text(given[kind])
    posterior = jb.sample(jb.load_case(tmp_path / "files" / "case.toml"), seed=1, settings=FEWEST, premises="exact")
    posterior.save(tmp_path / "posterior.nc")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    again = jb.load_posterior(tmp_path / "posterior.nc")
    theta = posterior.problem.prior.sample(np.random.default_rng(3), 16)
    np.testing.assert_array_equal(again.problem.log_posterior(theta), posterior.problem.log_posterior(theta))
    np.testing.assert_array_equal(again.theta, posterior.theta)
    assert again.summary().to_dict() == posterior.summary().to_dict()
    assert kind != "matrices" or len(posterior.summary().natural_frequencies_hz.map) == 2  # all that there are
    assert again.case.stated is again.problem  # so that a report shows the text
    again.save(tmp_path / "again.nc")  # which needs the files as little as the first
    assert jb.load_posterior(tmp_path / "again.nc").case.title == posterior.case.title


@pytest.mark.whole
def test_summary_and_report_name_the_file_and_its_fingerprint(reported):
    import hashlib
    import json

    folder = reported[1]
    summary = json.loads((folder / "before" / "summary.json").read_text(encoding="utf-8"))["measurement"]
    digest = hashlib.sha256((folder / "gone.npz").read_bytes()).hexdigest()
    assert summary["files"] == [{"name": "tip.npz", "size": (folder / "gone.npz").stat().st_size, "sha256": digest}]
    html = (folder / "before" / "report.html").read_text(encoding="utf-8")
    assert digest in html
    assert html.index("Stiffness of the joint") < html.index("Measured natural frequencies and damping")
    assert "synthetic data" not in html


def spoilt(frf: FrfSet, values: dict[int, complex], coherence: dict[int, float]) -> list[FrfRecord]:
    """Records of FRFs whose first one has these values and coherences on some lines."""
    first, *others = (
        replace(record, response=LABELS[record.response], reference=LABELS[record.reference])
        for record in records_of_frf(frf)
    )
    assert first.coherence is not None
    h, gamma = first.values.copy(), first.coherence.copy()
    for changed, entries in ((h, values), (gamma, coherence)):
        for line, value in entries.items():
            changed[line] = value
    return [replace(first, values=h, coherence=gamma), *others]


def test_bad_lines_are_left_out_and_named(tmp_path):
    frf = virtual()
    bad = {3: complex(np.nan, 0.0), 7: 0.0}, {11: 0.0, 15: 1.2, 19: np.nan}
    write_records(spoilt(frf, *bad), tmp_path / "tip.npz", "npz")
    case = loaded(tmp_path, frf_data())
    good = np.delete(np.arange(frf.n_lines), [3, 7, 11, 15, 19])
    measured = case.problem.test.data
    np.testing.assert_array_equal(measured.frf.frequency_hz, frf.frequency_hz[good])
    np.testing.assert_array_equal(measured.frf.values, frf.values[good])
    note = next(note for note in measured.provenance.notes if "left out" in note)
    assert f"Of {frf.n_lines} lines 5 were left out" in note
    assert ", ".join(f"{frf.frequency_hz[k]:g}" for k in (3, 7, 11, 15, 19)) in note
    assert {"not_finite", "zero_lines", "coherence_range"} <= {w.key for w in measured.provenance.warnings}


def test_a_bad_coherence_that_nobody_asks_for_costs_no_line(tmp_path):
    frf = virtual()
    write_records(spoilt(frf, {}, {11: 0.0, 15: 1.2}), tmp_path / "tip.npz", "npz")
    case = loaded(tmp_path, frf_data(variance='[data.variance]\nsource = "relative"\nrelative = 0.01\nfloor = 0.0\n'))
    assert case.problem.test.data.frf.n_lines == frf.n_lines


@pytest.mark.parametrize(("values", "coherence", "expected"), [
    (lambda n: dict.fromkeys(range(n // 2 + 1), 0.0), lambda n: {}, "found exactly 0 at"),
    (lambda n: dict.fromkeys(range(n), complex(np.nan)), lambda n: {}, "found NaN or infinity at"),
    (lambda n: {}, lambda n: dict.fromkeys(range(n), 0.0), "found a coherence of 0 at"),
    (lambda n: {}, lambda n: dict.fromkeys(range(n), 1.2), "found coherence 1.2 at"),
])  # fmt: skip
def test_a_file_of_bad_lines_is_refused(tmp_path, values, coherence, expected):
    frf = virtual()
    write_records(spoilt(frf, values(frf.n_lines), coherence(frf.n_lines)), tmp_path / "tip.npz", "npz")
    refuses(tmp_path, frf_data(), expected)


def test_bands_can_be_left_out_of_the_middle(tmp_path):
    frf = virtual()
    stored(frf, tmp_path / "tip.npz")
    f = frf.frequency_hz
    bands = f"exclude_hz = [[{f[4]}, {f[6]}], [{f[9]}, {f[9]}], [0.0, {f[0]}]]".replace(
        f"[{f[9]}, {f[9]}]", f"[{f[9] - 1e-3}, {f[9] + 1e-3}]"
    )
    measured = loaded(tmp_path, frf_data(bands)).problem.test.data
    np.testing.assert_array_equal(measured.frf.frequency_hz, np.delete(f, [0, 4, 5, 6, 9]))
    assert any("5 were left out, as exclude_hz asks" in note for note in measured.provenance.notes)
    assert not any(w.key == "uneven_lines" for w in measured.provenance.warnings)


def test_one_line_is_refused_before_any_work():
    problem = truth().problem
    one = replace(problem.test.data, frf=problem.test.data.frf.at_lines([0]), variance=np.ones((1, 1, 1)))
    refused(lambda: jb.sample(problem.with_test(data=one)), jb.MeasurementError, "found 1 line")


@pytest.mark.parametrize("quantity", ["accelerance", "receptance"])
def test_a_conjugated_file_is_named_everywhere_and_its_remedy_gives_the_right_data(tmp_path, quantity, monkeypatch):
    # the modes that the FRFs show, which take most of the time, are not asked
    monkeypatch.setattr("vibrecords.assemble.modes_and_doubtful", lambda *_: ((), ()))
    frf = virtual(quantity=quantity)
    assert not read(tmp_path, frf, frf_data()).warnings
    warnings = read(tmp_path, replace(frf, values=frf.values.conj()), frf_data()).warnings
    (warning,) = (w for w in warnings if "conjugate" in w.text)
    assert "conjugate = true in [data]" in warning.text
    assert warning.key == "data.file"
    if quantity == "accelerance":
        monkeypatch.setattr("jointbayes.workflow.find_map", None)  # after what is told
        told = CliRunner().invoke(main, ["identify", str(tmp_path / "case.toml")])
        assert "write conjugate = true in [data]" in told.stderr
    right = loaded(tmp_path, frf_data("conjugate = true"))
    assert not right.warnings
    np.testing.assert_allclose(right.problem.test.data.frf.values, frf.values, rtol=1e-12)
    assert any("complex conjugates" in note for note in right.problem.test.data.provenance.notes)


def test_a_layout_names_the_variables_of_a_file_that_nobody_would_know(tmp_path):
    frf = virtual()
    variables = {"a": frf.values[:, :, 0], "b": frf.frequency_hz, "outputs": np.array(["p", "q", "r"])}
    np.savez(tmp_path / "tip.npz", **variables, inputs=np.array(["hammer"]))
    channels = '"p" = "5:y"\n"q" = "1:y"\n"r" = "1:rz"\n"hammer" = "5:y"'
    variance = '[data.variance]\nsource = "relative"\nrelative = 0.02\nfloor = 0.01'
    data = frf_data('outputs = ["5:y"]\nquantity = "accelerance"', channels, variance)
    case = loaded(tmp_path, f'{data}\n[data.layout]\nfrf = "a"\nfrequency_hz = "b"\n')
    np.testing.assert_allclose(case.problem.test.data.frf.values, frf.values[:, :1], rtol=1e-12)
    refuses(tmp_path, data, "found neither FRFs nor time histories in 'a'")
    refuses(tmp_path, f'{data}\n[data.layout]\nfrff = "a"\n', r'data.layout.frff: unknown key.* did you mean "frf"')
