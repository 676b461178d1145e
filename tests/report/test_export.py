"""What a posterior says in files of other programs: FRFs to the last bit, verdicts in comments, one-line refusals."""

import csv

import numpy as np
import pytest
from scipy.io import loadmat

from jointbayes.errors import ModelError
from jointbayes.report import export as export_module
from jointbayes.report.export import FILES, _numbered_labels, central_joint, export
from jointbayes.report.fe_cards import PROGRAMS
from tests.conftest import cli, unsettled
from vibrecords.formats import iter_records
from vibrecords.records import FrfRecord, ModeRecord, SpectrumRecord, dof_label, parse_dof

FREE_ROTATION = {"1": 101, "1:r": 102}


def written(posterior, path, form, **wishes):
    export(posterior, path, form, **wishes)
    return list(iter_records(path))


def of_kind(records, kind):
    return [record for record in records if isinstance(record, kind)]


@pytest.fixture(scope="module")
def band(cheap_posterior):
    return cheap_posterior.predict_frf()


@pytest.mark.parametrize("form", [form for form in FILES if form != "uff58"])
def test_the_median_is_read_back_to_the_last_bit_and_its_band_is_no_frf(cheap_posterior, band, tmp_path, form):
    records = written(cheap_posterior, tmp_path / "a", form)
    (frf,) = of_kind(records, FrfRecord)
    dof = "5:Y+" if form == "uff58b" else "5:y"
    assert (frf.response, frf.reference, frf.quantity) == (dof, dof, band.quantity)
    np.testing.assert_array_equal(frf.frequency_hz, band.frequency_hz)
    np.testing.assert_array_equal(frf.values, (band.magnitude * np.exp(1j * np.deg2rad(band.phase_deg)))[:, 0, 0])
    assert len(of_kind(records, SpectrumRecord)) == (2 if form == "uff58b" else 0)


def test_both_ends_of_the_band_stand_beside_the_median(cheap_posterior, band, tmp_path):
    for form in ("mat", "csv"):
        export(cheap_posterior, tmp_path / form, form)
    lines = (tmp_path / "csv").read_text(encoding="utf-8").splitlines()
    rows = csv.DictReader(line for line in lines if not line.startswith("#"))
    table = {name: np.array(values, dtype=float) for name, values in transposed(rows).items()}
    arrays = loadmat(tmp_path / "mat", simplify_cells=True)["band95"]
    for end, side, size in (("lower", "low", band.magnitude_low), ("upper", "high", band.magnitude_high)):
        np.testing.assert_array_equal(table[f"{end} end of 95 % / 5:y of 5:y"], size[:, 0, 0])
        np.testing.assert_array_equal(np.reshape(arrays[side], size.shape), size)


def transposed(rows):
    found = {}
    for row in rows:
        for name, value in row.items():
            found.setdefault(name, []).append(value)
    return found


def test_functions_and_modes_of_one_file_have_the_same_nodes_and_none_has_the_number_of_another():
    nodes = {"tip": 7}
    labels = _numbered_labels(("headA:x", "3:y", "headA:rz", "tip:y", "headB:x"), nodes)
    assert labels == {"headA:x": "8:X+", "3:y": "3:Y+", "headA:rz": "8:RZ+", "tip:y": "7:Y+", "headB:x": "9:X+"}
    assert nodes == {"tip": 7, "headA": 8, "headB": 9}


def test_nodes_with_names_have_one_number_in_data_sets_58_and_55(cheap_posterior, tmp_path, monkeypatch):
    monkeypatch.setattr(
        export_module, "_numbered_labels", lambda dofs, _: dict.fromkeys(dofs, "12:Y+") | {"5:y": "41:Y+"}
    )
    records = written(cheap_posterior, tmp_path / "a.uff", "uff58")
    assert {(frf.response, frf.reference) for frf in of_kind(records, FrfRecord)} == {("41:Y+", "41:Y+")}
    assert all(mode.shape["41:Y+"] for mode in of_kind(records, ModeRecord))


@pytest.mark.parametrize("form", ["uff58", "uff58b"])
def test_pyuff_reads_the_same(cheap_posterior, tmp_path, form):
    pyuff = pytest.importorskip("pyuff", reason="the oracle of universal files is not installed")
    records = written(cheap_posterior, tmp_path / "a.uff", form)
    theirs = pyuff.UFF(str(tmp_path / "a.uff")).read_sets()
    assert {151, 164, 58, 55} <= {each["type"] for each in theirs}
    for record, each in zip(of_kind(records, FrfRecord), of_type(theirs, 58, func_type=4), strict=True):
        assert (each["rsp_node"], each["rsp_dir"], each["ref_node"], each["ref_dir"]) == (5, 2, 5, 2)
        np.testing.assert_allclose(each["data"], record.values, rtol=1e-12)
        np.testing.assert_allclose(each["x"], record.frequency_hz, rtol=1e-12)
    for record, each in zip(of_kind(records, ModeRecord), of_type(theirs, 55), strict=True):
        assert (each["mode_n"], each["freq"]) == (record.number, pytest.approx(record.frequency_hz, rel=1e-5))
        assert each["r2"][list(each["node_nums"]).index(5)] == pytest.approx(record.shape["5:Y+"].real, rel=1e-5)


def of_type(sets, number, **more):
    return [each for each in sets if each["type"] == number and more.items() <= each.items()]


def test_frequencies_and_their_standard_deviations_are_those_of_page_one(cheap_posterior, tmp_path):
    modes = of_kind(written(cheap_posterior, tmp_path / "a.uff", "uff58"), ModeRecord)
    draws = cheap_posterior.predict_natural_frequencies(3)
    np.testing.assert_allclose([mode.frequency_hz for mode in modes], np.median(draws, axis=0), rtol=1e-5)
    np.testing.assert_allclose([mode.frequency_sd_hz for mode in modes], draws.std(axis=0), rtol=1e-6)
    page = cheap_posterior.summary().natural_frequencies_hz.interval95
    assert all(low < mode.frequency_hz < high for mode, (low, high) in zip(modes, page, strict=True))
    assert {mode.modal_mass for mode in modes} == {1.0}
    assert [(mode.damping_ratio, mode.damping_sd) for mode in modes] == [(0.01, None)] * 3


def test_modes_and_shapes_come_back_from_matlab(cheap_posterior, tmp_path):
    modes = of_kind(written(cheap_posterior, tmp_path / "a.uff", "uff58"), ModeRecord)
    for mode, back in zip(modes, of_kind(written(cheap_posterior, tmp_path / "a.mat", "mat"), ModeRecord), strict=True):
        for key in ("number", "frequency_sd_hz", "damping_sd"):
            assert getattr(back, key) == getattr(mode, key)
        for key in ("frequency_hz", "damping_ratio"):
            assert getattr(back, key) == pytest.approx(getattr(mode, key), rel=1e-5)
        there = {dof_label(parse_dof(label)): value for label, value in back.shape.items()}
        assert there == pytest.approx({label: mode.shape[label] for label in there}, rel=1e-5)


def test_matlab_has_modes_and_joint_by_name(cheap_posterior, tmp_path):
    modes = of_kind(written(cheap_posterior, tmp_path / "a.uff", "uff58"), ModeRecord)
    export(cheap_posterior, tmp_path / "a.mat", "mat")
    file = loadmat(tmp_path / "a.mat", simplify_cells=True)
    np.testing.assert_allclose(file["modes"]["Fn"], [mode.frequency_hz for mode in modes], rtol=1e-5)
    np.testing.assert_array_equal(file["modes"]["Fn_std"], [mode.frequency_sd_hz for mode in modes])
    by_label = dict(zip(file["modes"]["dofs"], file["modes"]["Phi"], strict=True))
    np.testing.assert_allclose(by_label["5:y"], [mode.shape["5:Y+"] for mode in modes], rtol=1e-5)
    medians = np.median(cheap_posterior.stiffness, axis=0)
    np.testing.assert_allclose(file["joint"]["stiffness"], [medians[:2], medians[1:]], rtol=1e-14)
    assert list(file["joint"]["names"]) == ["k11", "k12", "k22"]
    assert list(file["joint"]["verdict"]) == [cheap_posterior.verdict(n).verdict for n in ("k11", "k12", "k22")]
    intervals = [cheap_posterior.interval(name) for name in ("k11", "k12", "k22")]
    np.testing.assert_allclose(file["joint"]["interval95"], intervals, rtol=1e-12)


@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("units", ["SI", "mm-N-t"])
def test_cards_say_median_interval_and_verdict(cheap_posterior, tmp_path, program, units):
    nodes = FREE_ROTATION if program == "calculix" else {}
    export(cheap_posterior, tmp_path / "a", program, units=units, nodes=nodes)
    text = (tmp_path / "a").read_text(encoding="ascii")
    said = " ".join(line.lstrip("$*! ") for line in text.splitlines())
    for name, factor, unit in (("k11", 1e-3, "N/mm"), ("k12", 1.0, "N"), ("k22", 1e3, "N*mm/rad")):
        known = cheap_posterior.verdict(name)
        factor, unit = (factor, unit) if units != "SI" else (1.0, unit.replace("mm", "m"))
        verdict = known.verdict if "identified" in known.verdict and known.verdict[0] != "n" else known.verdict.upper()
        assert f"{name} = {known.median * factor:.10g} {unit}, 95 % interval " in said
        assert f": {verdict}" in said
    assert "NOT IDENTIFIED" in said
    assert ("mm, N, t, s" in said) == (units == "mm-N-t")


def test_a_run_that_has_not_converged_says_so_on_its_cards(cheap_posterior, tmp_path):
    export(unsettled(cheap_posterior, "stopped after 3 steps"), tmp_path / "a.bdf", "nastran")
    said = (tmp_path / "a.bdf").read_text().replace("\n$ ", " ")
    assert "NOT CONVERGED, DO NOT USE THESE NUMBERS: stopped after 3 steps" in said
    assert "NO VERDICT" in said


def test_where_no_joint_has_the_medians_the_mode_is_written(cheap_posterior, monkeypatch):
    theta, of = central_joint(cheap_posterior)
    assert of == "joint of the medians"
    np.testing.assert_allclose(
        cheap_posterior.problem.prior.values(theta), np.median(cheap_posterior.stiffness, axis=0)
    )
    kind = type(cheap_posterior.problem.parametrisation)
    monkeypatch.setattr(kind, "describes", lambda *_: False)
    theta, of = central_joint(cheap_posterior)
    assert of.startswith("joint mode")
    assert theta is cheap_posterior.mode_theta


def test_data_without_frfs_have_modes_and_no_table(frequency_posterior, tmp_path):
    records = written(frequency_posterior, tmp_path / "a.uff", "uff58")
    assert {type(record) for record in records} == {ModeRecord}
    assert len(records) >= 3
    assert len(written(frequency_posterior, tmp_path / "a.mat", "mat")) == len(records)
    with pytest.raises(ModelError, match=r"found .* as data, and no FRFs for csv; expected FRFs; choose uff58 or mat"):
        export(frequency_posterior, tmp_path / "a.csv", "csv")
    assert not (tmp_path / "a.csv").exists()


def test_an_unknown_format_is_refused(cheap_posterior, tmp_path):
    with pytest.raises(ModelError, match="found format 'step'; expected one of uff58, uff58b, mat, csv, nastran"):
        export(cheap_posterior, tmp_path / "a", "step")


# ---- command line


@pytest.fixture(scope="module")
def saved(cheap_posterior, tmp_path_factory):
    directory = tmp_path_factory.mktemp("export") / "out"
    directory.mkdir()
    cheap_posterior.save(directory / "posterior.nc")
    return directory


@pytest.mark.whole
@pytest.mark.parametrize(
    ("name", "begins"),
    [
        ("a.uff", "    -1"),
        ("a.csv", "# written by: jointbayes\n# Joint"),
        ("a.bdf", "$"),
        ("a.inp", "**"),
        ("a.mac", "!"),
    ],
)
def test_the_ending_chooses_the_format_and_a_run_directory_will_do(saved, tmp_path, name, begins):
    result = cli("export", saved, "--to", tmp_path / name)
    assert result.exit_code == 0
    assert f"Written: {tmp_path / name}" in result.output
    assert (tmp_path / name).read_bytes().startswith(begins.encode())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--to", "a.step"), "found no format of the ending '.step'; expected one of .uff"),
        (("--to", "posterior.nc", "--format", "uff58"), "found the file that is read"),
        (("--to", "a.bdf", "--node", "1"), "--node: found '1'; expected NAME=NUMBER, such as footA=17; correct it"),
        (("--to", "a.bdf", "--node", "1=x"), "--node: found '1=x'"),
        (("--to", "a.bdf", "--node", "1=0"), "DOF 1:y: found no node with a number"),
        (("--to", "a.inp", "--format", "calculix"), "found a rotation of node 1; expected the ROT NODE"),
        (("--to", "a.uff", "--test", "loud"), "found test 'loud'"),
    ],
)
def test_what_cannot_be_written_is_one_line(saved, tmp_path, monkeypatch, options, said):
    monkeypatch.chdir(saved)
    result = cli("export", "posterior.nc", *options)
    assert result.exit_code == 2
    assert said in result.output
    assert len(result.output.splitlines()) == 1
    assert sorted(path.name for path in saved.iterdir()) == ["posterior.nc"]
