"""What a posterior says in files of other programs: FRFs to the last bit, verdicts in comments, one-line refusals."""

import csv
import re

import numpy as np
import pytest

from jointbayes.errors import ModelError
from jointbayes.report.export import central_joint, export
from jointbayes.report.fe_cards import PROGRAMS
from tests.conftest import cli, unsettled
from tests.pages import DOCS, fenced
from vibrecords import FrfSet, write_frf
from vibrecords.formats import iter_records
from vibrecords.records import FrfRecord, SpectrumRecord

FREE_ROTATION = {"1": 101, "1:r": 102}


def written(posterior, path, form, **wishes):
    export(posterior, path, form, **wishes)
    return list(iter_records(path))


def of_kind(records, kind):
    return [record for record in records if isinstance(record, kind)]


@pytest.fixture(scope="module")
def band(cheap_posterior):
    return cheap_posterior.predict_frf()


def test_the_median_is_read_back_to_the_last_bit_and_its_band_is_no_frf(cheap_posterior, band, tmp_path):
    records = written(cheap_posterior, tmp_path / "a", "csv")
    (frf,) = of_kind(records, FrfRecord)
    assert (frf.response, frf.reference, frf.quantity) == ("5:y", "5:y", band.quantity)
    np.testing.assert_array_equal(frf.frequency_hz, band.frequency_hz)
    np.testing.assert_array_equal(frf.values, (band.magnitude * np.exp(1j * np.deg2rad(band.phase_deg)))[:, 0, 0])
    assert not of_kind(records, SpectrumRecord)


def lines_and_table(posterior, path):
    """Comments of an exported file, and its table by column."""
    export(posterior, path, "csv")
    lines = path.read_text(encoding="utf-8").splitlines()
    rows = [*csv.DictReader(line for line in lines if not line.startswith("#"))]
    return lines, {name: np.array([row[name] for row in rows], dtype=float) for name in rows[0]}


def test_both_ends_of_the_band_stand_beside_the_median(cheap_posterior, band, tmp_path):
    _, table = lines_and_table(cheap_posterior, tmp_path / "a.csv")
    for end, size in (("lower", band.magnitude_low), ("upper", band.magnitude_high)):
        np.testing.assert_array_equal(table[f"{end} end of 95 % / 5:y of 5:y"], size[:, 0, 0])


def test_frequencies_above_the_table_are_those_of_page_one(cheap_posterior, tmp_path):
    lines, _ = lines_and_table(cheap_posterior, tmp_path / "a.csv")
    modes = [re.fullmatch(r"# mode (\d): (\S+) Hz, damping ratio (\S+)", line) for line in lines]
    modes = [[float(number) for number in mode.groups()] for mode in modes if mode]
    draws = cheap_posterior.predict_natural_frequencies(3)
    np.testing.assert_allclose([hz for _, hz, _ in modes], np.median(draws, axis=0), rtol=1e-12)
    page = cheap_posterior.summary().natural_frequencies_hz.interval95
    assert all(low < hz < high for (_, hz, _), (low, high) in zip(modes, page, strict=True))
    assert [(number, ratio) for number, _, ratio in modes] == [(1, 0.01), (2, 0.01), (3, 0.01)]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves its file open
def test_the_six_lines_of_the_page_write_what_is_read_back(tmp_path, monkeypatch):
    pytest.importorskip("pyuff", reason="it writes universal files in the hands of the user")
    lines = np.arange(1.0, 9.0)
    values = np.array([1 + 2j, 3 - 1j]) * lines[:, None]
    write_frf(FrfSet(lines, values[:, :, None], ("11:Y+", "6:RZ-"), ("11:Y+",), "accelerance"), tmp_path / "tip.csv")
    monkeypatch.chdir(tmp_path)
    (code,) = [block for block in fenced(DOCS / "predict.md", "python") if "pyuff" in block]
    exec(code, {})  # the page as it stands
    first, second = iter_records(tmp_path / "tip.uff")
    assert [(r.response, r.reference, r.quantity) for r in (first, second)] == [
        ("11:Y+", "11:Y+", "accelerance"), ("6:RZ-", "11:Y+", "accelerance")]  # fmt: skip
    for record, column in zip((first, second), values.T, strict=True):
        np.testing.assert_allclose(record.values, column, rtol=1e-6)
        np.testing.assert_allclose(record.frequency_hz, lines, rtol=1e-6)


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
        verdict = known.cls if "identified" in known.cls and known.cls[0] != "n" else known.cls.upper()
        assert f"{name} = {known.median * factor:.10g} {unit}, 95 % interval " in said
        assert f": {verdict}" in said
    assert "NOT IDENTIFIED" in said
    assert ("mm, N, t, s" in said) == (units == "mm-N-t")


def test_a_run_that_has_not_converged_says_so_on_its_cards(cheap_posterior, tmp_path):
    export(unsettled(cheap_posterior, "stopped after 3 steps", apart=1.5), tmp_path / "a.bdf", "nastran")
    said = (tmp_path / "a.bdf").read_text().replace("\n$ ", " ")
    assert "NOT CONVERGED, DO NOT USE A NUMBER WITHOUT A VERDICT: stopped after 3 steps" in said
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
    assert theta is cheap_posterior.best.theta


def test_data_without_frfs_have_no_table(frequency_posterior, tmp_path):
    with pytest.raises(ModelError, match=r"found .* as data, and no FRFs for csv; expected FRFs; take the natural"):
        export(frequency_posterior, tmp_path / "a.csv", "csv")
    assert not (tmp_path / "a.csv").exists()


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
    [("a.csv", "# written by: jointbayes\n# Joint"), ("a.bdf", "$"), ("a.inp", "**"), ("a.mac", "!")],
)
def test_the_ending_chooses_the_format_and_a_run_directory_will_do(saved, tmp_path, name, begins):
    result = cli("export", saved, "--to", tmp_path / name)
    assert result.exit_code == 0
    assert f"Written: {tmp_path / name}" in result.output
    assert (tmp_path / name).read_bytes().startswith(begins.encode())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--to", "a.step"), "found no format of the ending '.step'; expected one of .csv"),
        (("--to", "posterior.nc", "--format", "csv"), "found the file that is read"),
        (("--to", "a.uff"), "found format 'uff58b', which went in this version"),
        (("--to", "a.x", "--format", "mat73"), "found format 'mat73', which went in this version"),
        (("--to", "a.bdf", "--node", "1"), "--node: found '1'; expected NAME=NUMBER, such as footA=17; correct it"),
        (("--to", "a.bdf", "--node", "1=x"), "--node: found '1=x'"),
        (("--to", "a.bdf", "--node", "1=0"), "DOF 1:y: found no node with a number"),
        (("--to", "a.inp", "--format", "calculix"), "found a rotation of node 1; expected the ROT NODE"),
        (("--to", "a.csv", "--test", "loud"), "found test 'loud'"),
    ],
)
def test_what_cannot_be_written_is_one_line(saved, tmp_path, monkeypatch, options, said):
    monkeypatch.chdir(saved)
    result = cli("export", "posterior.nc", *options)
    assert result.exit_code == 2
    assert said in result.output
    assert len(result.output.splitlines()) == 1
    assert sorted(path.name for path in saved.iterdir()) == ["posterior.nc"]
