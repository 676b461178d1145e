"""A posterior file that is damaged, of other parts, or hostile: one line that names it, and nothing else happens."""

import json
import re
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from jointbayes.cli.common import directory_name
from jointbayes.errors import JointBayesError, MeasurementError
from jointbayes.posterior.storage import RECORD
from jointbayes.workflow import load_posterior
from tests.conftest import CONFIGS, shipped_text

WHOLE = sorted((Path(__file__).parents[1] / "fuzz" / "corpus" / "posterior").glob("whole-*.nc"))
FRF, ARRAYS = (next(path for path in WHOLE if path.stem == f"whole-{name}") for name in ("frf", "arrays"))


def copied(tmp_path, source, change_record=None, change_file=None):
    """A copy of a posterior file with another record or other arrays."""
    path = tmp_path / "found.nc"
    path.write_bytes(source.read_bytes())
    with h5py.File(path, "r+") as file:
        record = json.loads(file.attrs[RECORD])
        if change_record is not None:
            change_record(record)
        if change_file is not None:
            change_file(file)
        file.attrs[RECORD] = json.dumps(record)
    return path


def refusal(path):
    """The line by which a file is refused."""
    with pytest.raises(JointBayesError) as caught:
        load_posterior(path)
    line = str(caught.value)
    assert line.startswith(f"{path}: ")
    assert "; expected " in line or ": expected " in line
    assert len(line) < 700
    assert "\n" not in line
    return line


@pytest.mark.parametrize(
    "path",
    # the ends of its flat region take seconds
    [pytest.param(path, marks=pytest.mark.whole) if path.stem == "whole-frequencies" else path for path in WHOLE],
    ids=lambda path: path.stem,
)
def test_whole_files_are_read_and_summed_up(path):
    summary = load_posterior(path).summary().to_dict()
    assert all(p["r_hat"] for p in summary["parameters"].values())


def replaced(place, value):
    """Puts a value where the keys lead to."""

    def change(record):
        *way, last = place
        for key in way:
            record = record[key]
        if value is None:
            del record[last]
        else:
            record[last] = value

    return change


OTHER_RECORDS = {
    ("record", "sampler"): (None, "record.sampler: found nothing"),
    ("record", "sampler", "ess", "k11"): (None, r"record.sampler.ess: found \['k12', 'k22'\]"),
    ("record", "r_hat", "k12"): ("1", "record.r_hat.k12: found '1'"),
    ("record", "seed"): (-1, "record.seed: found -1"),
    ("record", "versions", "jointbayes"): (None, r"record.versions: found \[\]; expected \['jointbayes'\]"),
    ("record", "case_text"): ("k11 = 1", "found a problem in it that is none"),
    ("map", "starts", 2): (-1, "map.starts.2: found -1"),
    ("map", "theta"): ([1.0, 2.0], r"map.theta: found \(2,\); expected \(3,\)"),
    ("map", "theta", 0): (float("nan"), r"map.theta: found \[nan, .*\]; expected an array of finite numbers"),
    ("map", "covariance", 0): ([0.0, 0.0, 0.0], "map.covariance: found none; expected a covariance of 3 numbers"),
    ("map", "log_posterior"): (3.0, "found draws of another density than that of its problem"),
    ("mode", "theta", 1): (1e3, "found draws of another density"),
    ("found", "rows_of", 0, "known", "k11", "cls"): ("<b>", "k11.cls: found '<b>'"),
    ("found", "profiles_of", 0, "value"): ([], "profiles_of.0.value"),
}


@pytest.mark.parametrize(("place", "found"), [*OTHER_RECORDS.items()], ids=lambda part: str(part)[:50])
def test_a_record_with_another_field_is_refused_by_its_name(place, found, tmp_path):
    value, said = found
    assert re.search(said, refusal(copied(tmp_path, FRF, replaced(place, value))))


def spoilt(place, change):
    """Puts other values into an array."""

    def rewrite(file):
        values = change(file[place][()])
        del file[place]
        if values is not None:
            file[place] = values

    return rewrite


OTHER_ARRAYS = {
    "gone": ("prior/k11", lambda values: None, "found no variable prior/k11"),
    "transposed": ("posterior/k12", np.transpose, "shape|dimensions"),
    "text": ("sample_stats/lp", lambda values: values.astype("S8"), "lp: found what is no finite number"),
    "not finite": (
        "posterior/k11",
        lambda values: np.where(values == values.max(), np.inf, values),
        "no finite number",
    ),
    "no joint": ("posterior/k11", lambda values: -values, "found draws that are no joint"),
    "beyond the prior": ("posterior/k22", lambda values: values * 1e30, "found draws that its prior excludes"),
    "just beyond the prior": (
        "posterior/k11",
        lambda values: np.where(values == values.max(), 1.5e11, values),
        "found draws that its prior excludes",
    ),
    "of other data": ("posterior/k22", lambda values: values * 1.01, "found draws of another density"),
    "ensembles mixed": ("posterior/ensemble", lambda values: values[::-1], "expected ensembles of as many chains"),
    "data not finite": ("problem/array_1_real", lambda values: values * np.nan, "FRF set: found NaN"),
}


@pytest.mark.parametrize(("place", "change", "said"), OTHER_ARRAYS.values(), ids=OTHER_ARRAYS)
def test_arrays_that_do_not_belong_to_the_problem_are_refused(place, change, said, tmp_path):
    assert re.search(said, refusal(copied(tmp_path, FRF, None, spoilt(place, change))))


def test_a_file_with_a_case_in_place_of_its_problem_is_refused(tmp_path):
    def change(record):
        record["file_version"] = 1
        del record["problem"]

    assert "found file version 1, which holds the text of a case" in refusal(copied(tmp_path, FRF, change))


@pytest.mark.parametrize("version", [2, 3])
def test_of_a_file_of_an_earlier_version_the_draws_are_read_and_judged_again(version, tmp_path):
    def change(record):
        record["file_version"] = version
        record["knowledge"] = {"freed": [{"known": {"k11": {"verdict": "not identified"}}}]}

    old, new = load_posterior(copied(tmp_path, FRF, change)), load_posterior(FRF)
    assert {name: old.verdict(name) for name in old.stiffness_names} == {
        name: new.verdict(name) for name in new.stiffness_names
    }


# ---- hostile files


@pytest.mark.parametrize("name", ["measured_rotation", "spindle_measured"])
def test_files_that_a_stored_case_names_are_not_read(name, tmp_path, monkeypatch):
    path = copied(tmp_path, FRF, replaced(("record", "case_text"), shipped_text(name)))
    monkeypatch.chdir(CONFIGS)  # where the files that it names are
    opened = []
    sys.addaudithook(lambda event, arguments: opened.append(str(arguments[0])) if event == "open" else None)
    posterior = load_posterior(path)
    assert (posterior.case.workshop_problem is None) == (name == "spindle_measured")
    assert opened
    assert not [name for name in opened if name.endswith((".uff", ".csv", ".npz"))]


@pytest.mark.parametrize(
    ("plain", "said"),
    [
        ({"kind": "Path", "x": "/tmp"}, "a part of kind 'Path'"),
        ({"kind": "LogPosterior"}, "a part of kind 'LogPosterior'"),
        ({"kind": "run", "args": ["touch x"]}, "a part of kind 'run'"),
        ({"scipy.stats": "chi2_contingency", "args": [1]}, "found a prior 'chi2_contingency'"),
        ({"scipy.stats": "norm", "args": ["import os"]}, "other arguments than numbers"),
        ({"scipy.stats": "norm", "args": [1, 2, 3, 4, 5]}, "a prior norm that cannot be"),
        ({"mapping": [[1]]}, "no pairs"),
        ({"x": 1}, "a table of x"),
        ({"array": "array_99"}, "no variable problem/array_99"),
        (["deep"] * 3, "expected"),
        ("text", "expected"),
    ],
    ids=str,
)
def test_a_stored_problem_makes_nothing_but_data_classes_and_distributions(plain, said, tmp_path):
    path = copied(tmp_path, ARRAYS, replaced(("problem", "description", "prior"), plain))
    assert said in refusal(path)


def test_a_record_nested_too_deeply_is_refused(tmp_path):
    def nest(file):
        text = '{"file_version": 1, "record": ' + "[" * 200_000 + "]" * 200_000 + "}"
        file.attrs.create(RECORD, text, dtype=h5py.string_dtype())

    path = tmp_path / "found.nc"
    path.write_bytes(FRF.read_bytes())
    with h5py.File(path, "r+") as file:
        nest(file)
    assert "found no posterior in it (RecursionError)" in refusal(path)


@pytest.mark.parametrize("name", ["../x", "/etc/x", "..", ".", "", "a/b", "a\\b", "a\0b", "a\x1b[31m", "é" * 150])
def test_the_name_in_a_file_leads_nowhere(name):
    assert directory_name(name, Path("some/found.nc")) == "found"


def test_an_ordinary_name_is_that_of_the_directory():
    assert directory_name("Spannstelle 2 (links)", Path("found.nc")) == "Spannstelle 2 (links)"


def test_a_name_too_long_for_a_file_is_no_file():
    with pytest.raises(MeasurementError, match="no such file"):
        load_posterior("x" * 5000)
