"""The report of a campaign: what is counted, named and written, from directories whose truth is known."""

import csv
import dataclasses
import json
import re
import shutil

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.cli.studies import _exit_by
from jointbayes.errors import WriteError
from jointbayes.posterior.identifiability import NO_VALID_VALUE
from jointbayes.report.markup import foreign
from jointbayes.report.model import Table
from jointbayes.studies.campaign import campaign_findings as findings_module
from jointbayes.studies.campaign import campaign_report, hierarchical
from jointbayes.studies.campaign import campaign_report as report_module
from jointbayes.studies.campaign.campaign_findings import OTHER_KIND, examine_campaign, read_draws
from jointbayes.studies.campaign.campaign_report import (
    campaign_lead,
    campaign_sections,
    joints_csv,
    write_campaign_report,
)
from jointbayes.studies.campaign.index import read_index
from tests.one_line import refused, says
from tests.studies import campaign_directory as made

JOINTS = 40
FILES = {"references.bib", "report.html", "report.pdf", "summary.json", "joints.csv", "index.jsonl", "cases", "figures"}


@pytest.fixture(scope="module")
def examined(tmp_path_factory, once):
    """A directory with its report, the rows it is of, and what was found in it; nobody may change it."""

    def report():
        directory = tmp_path_factory.mktemp("reports") / "line-7"
        rows, found = made.campaign_directory(directory, JOINTS), examine_campaign(directory)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(report_module, "examine_campaign", lambda *_: found)
            return write_campaign_report(directory), rows, found

    return once("campaign", report)


@pytest.fixture(scope="module")
def reported(examined):
    return examined[0]


@pytest.fixture(scope="module")
def rows(examined):
    return examined[1]


@pytest.fixture(scope="module")
def findings(examined):
    return examined[2]


@pytest.fixture(scope="module")
def summary(reported):
    return json.loads((reported / "summary.json").read_text(encoding="utf-8"))


@pytest.fixture
def blank_charts(monkeypatch):
    monkeypatch.setattr(
        campaign_report, "svg", lambda *_: '<svg xmlns="http://www.w3.org/2000/svg" width="9pt" height="9pt"/>'
    )


@pytest.fixture
def short_population(monkeypatch):
    """The population by few steps, where it does not matter."""
    monkeypatch.setattr(hierarchical, "_RUN", dataclasses.replace(hierarchical._RUN, max_steps=50))


@pytest.fixture
def copy(reported, tmp_path):
    return shutil.copytree(reported, tmp_path / reported.name)


@pytest.mark.whole
def test_the_directory_holds_report_and_numbers_and_nothing_is_left_behind(reported):
    directory = reported
    assert {file.name for file in directory.iterdir()} == FILES
    assert {file.name for file in (directory / "figures").iterdir()} == {
        "population.svg",
        *(f"ranking-{name}.svg" for name in ("k11", "k12", "k22")),
    }
    assert (directory / "report.pdf").read_bytes().startswith(b"%PDF-")
    assert (directory / "report.html").stat().st_size < 5_000_000


@pytest.mark.whole
@pytest.mark.usefixtures("blank_charts")
def test_a_population_that_has_not_converged_is_red_on_page_one_flagged_and_exit_3(
    copy, monkeypatch, summary, findings, capsys
):
    assert summary["population"]["converged"] is True
    reason = "ensembles of walkers: not converged after 10 steps (limit 10)"
    stopped = dataclasses.replace(findings.joints.population, converged=False, how=reason)
    monkeypatch.setattr(findings_module, "hierarchical_posterior", lambda *_: stopped)
    write_campaign_report(copy)
    assert json.loads((copy / "summary.json").read_text(encoding="utf-8"))["population"]["converged"] is False
    page = (copy / "report.html").read_text(encoding="utf-8")
    at = page.index("The population has NOT converged")
    says(page[at - 300 : at + 400], "bad", "not converged after 10 steps")
    rows = [{**row, "status": "done"} for row in jb.Campaign(copy).index.to_dict("records") if row["converged"]]
    made.write_index(copy, rows)
    with pytest.raises(SystemExit) as ended:
        _exit_by(jb.Campaign(copy))
    assert ended.value.code == 3
    assert "NOT CONVERGED: the population of all joints" in capsys.readouterr().out


def test_cases_are_counted_by_what_became_of_them(summary):
    assert summary["counts"] == {
        "cases": JOINTS,
        "done": JOINTS - 2,
        "failed": 1,
        "killed its worker": 1,
        "not converged": 1,
        "do not explain their data": 1,
        "in the population": JOINTS - 3,
    }
    assert (summary["schema_version"], summary["campaign"]) == (1, "line-7")


def test_the_population_holds_the_truth_of_the_joints_it_was_made_of(summary):
    found = summary["population"]
    assert (found["joints"], found["parametrisation"]) == (JOINTS - 3, "log")
    for i, name in enumerate(("k11", "k12")):  # k22 has outliers
        one = found["coordinates"][name]
        assert abs(one["mean"]["median"] - made.MEAN[i]) < 3 * made.SCATTER[i] / np.sqrt(JOINTS) * 1.5
        assert one["scatter"]["low95"] < 1.2 * made.SCATTER[i]
        assert one["scatter"]["high95"] > 0.6 * made.SCATTER[i]
        k = found["stiffness"][name]
        assert k["median"]["low95"] < k["median"]["median"] < k["median"]["high95"]
        assert k["median"]["median"] == pytest.approx(np.exp(one["mean"]["median"]), rel=0.02)
        assert k["scatter"]["median"] == pytest.approx(one["scatter"]["median"], rel=0.05)
    prior = found["coordinates"]["k11"]["prior_of_mean"]
    assert prior["mean"] == pytest.approx((made.LOW[0] + made.HIGH[0]) / 2)
    assert prior["sd"] == pytest.approx((made.HIGH[0] - made.LOW[0]) / np.sqrt(12))


def test_what_is_odd_is_named_the_gravest_first(summary, rows):
    looks = summary["need_a_look"]
    why = {one["key"]: "; ".join(one["reasons"]) for one in looks}
    keys = [one["key"] for one in looks]
    assert (looks[0]["status"], looks[1]["status"]) == ("killed its worker", "failed")
    assert "found no record of 11:y" in why[keys[1]]
    assert "R̂ 1.08" in why[rows[JOINTS // 5]["key"]]
    assert "k22 is an outlier, low" in why[rows[JOINTS // 2]["key"]]
    assert "k22 is an outlier, high" in why[rows[JOINTS // 3]["key"]]
    assert "does not explain" in why[rows[JOINTS - 2]["key"]]
    assert "k11 is not identified, of most joints weakly identified" in why[rows[JOINTS - 1]["key"]]
    outliers = [one["key"] for one in summary["outliers"]["k22"]["outliers"]]
    assert outliers == [rows[JOINTS // 2]["key"], rows[JOINTS // 3]["key"]]
    assert not summary["outliers"]["k11"]["outliers"]
    assert summary["answer"].startswith(f"{summary['counts']['in the population']} joints: k11 ")
    assert re.search(r"; k22 \S+ \(\S+ to \S+\) MN·m/rad, scatter \S+ % \(.*\)\. Outliers: SN", summary["answer"])


def test_every_case_has_a_line_with_its_numbers(reported, rows):
    with (reported / "joints.csv").open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    assert [line["key"] for line in lines] == [row["key"] for row in rows]
    for line, row in zip(lines, rows, strict=True):
        if row["status"] != "done" or not row["converged"]:
            assert line["k11.median (N/m)"] == ""
            continue
        assert float(line["k12.median (N)"]) == pytest.approx(row["k12.median"], rel=0.02)
        assert float(line["k12.low95 (N)"]) == pytest.approx(row["k12.low95"], rel=0.1)
        low, median, high = (float(line[f"k11.given_all.{end} (N/m)"]) for end in ("low95", "median", "high95"))
        assert low < median < high
        assert 1 <= float(line["k11.rank_low95"]) <= float(line["k11.rank"]) <= float(line["k11.rank_high95"]) <= JOINTS


def test_estimates_are_drawn_together_and_narrower_given_the_others(findings):
    found = findings.joints
    for q in found.quantities[:2]:
        own, shrunken = np.log(q.unpooled), np.log(q.shrunken)
        assert shrunken[:, 1].std() < own[:, 1].std()
        assert np.median((shrunken[:, 2] - shrunken[:, 0]) / (own[:, 2] - own[:, 0])) < 0.9


@pytest.mark.whole
@pytest.mark.long
def test_a_second_report_is_the_same_and_replaces_the_first(copy):
    before = {name: (copy / name).read_bytes() for name in ("report.html", "report.pdf", "summary.json", "joints.csv")}
    for old in ("ranking-old.svg", "mine.svg"):
        (copy / "figures" / old).write_text("<svg/>")
    (copy / "report.html").write_text("old")
    write_campaign_report(copy)
    assert {name: (copy / name).read_bytes() for name in before} == before
    assert not (copy / "figures" / "ranking-old.svg").exists()
    assert (copy / "figures" / "mine.svg").exists()  # no report of ours has such a figure
    assert {file.name for file in copy.iterdir()} == FILES


@pytest.mark.whole
def test_the_ranking_counts_joints_from_the_softest_up(findings):
    (ranking,) = (section for section in campaign_sections(findings) if section.identifier == "ranking")
    tables = [block for block in ranking.blocks if isinstance(block, Table)]
    assert len(tables) == len(findings.joints.quantities)
    for table, quantity in zip(tables, findings.joints.quantities, strict=True):
        order = np.argsort(quantity.shrunken[:, 1])
        places = [int(row[0]) for row in table.rows]
        assert (places, (places[0], places[-1])) == (sorted(places), (1, len(order)))
        labels = [findings.joints.draws.rows[order[place - 1]].label for place in places]
        assert [row[1] for row in table.rows] == list(map(foreign, labels))


@pytest.mark.usefixtures("blank_charts")
def test_a_report_that_fails_leaves_the_last_one(copy, findings, monkeypatch):
    before = (copy / "report.html").read_bytes()

    def fails(_report):
        raise RuntimeError("no PDF")

    monkeypatch.setattr(report_module, "examine_campaign", lambda *_: findings)
    monkeypatch.setattr("jointbayes.report.run_directory.render_pdf", fails)
    with pytest.raises(RuntimeError):
        write_campaign_report(copy)
    assert ((copy / "report.html").read_bytes(), {file.name for file in copy.iterdir()}) == (before, FILES)


@pytest.mark.usefixtures("blank_charts")
@pytest.mark.parametrize("joints", [0, 1, 2])
def test_few_joints_give_a_report_without_a_population(tmp_path, joints):
    rows, theta = made.campaign_rows(4, draws=60)
    for j, row in enumerate(rows):
        if j < joints:
            made.write_case(tmp_path / row["file"], theta[j])
        else:
            row |= {"status": "failed", "error": "no data", "converged": False}
    made.write_index(tmp_path, rows)
    write_campaign_report(tmp_path)
    found = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert found["population"] is None
    assert len(found["need_a_look"]) == 4 - joints
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"It needs 3 joints that are done and converged; found {joints}." in page
    assert ("Stiffness of every joint" in page) == (joints > 0)


def springs_row(row, **cells):
    """The row with two springs in place of a coupled pair."""
    kept = {name: value for name, value in row.items() if "." not in name}
    one = {"unit": "N/m", "median": 16.8e6, "low95": 13.0e6, "high95": 60.5e6, "verdict": "not identified"}
    other = {"unit": "N/m", "median": 23.2e6, "low95": 22.1e6, "high95": 24.3e6, "verdict": "identified"}
    both = [("first.kx", one | {"printed_low95": 12.5e6, "printed_high95": 63.3e6}), ("second.kx", other | cells)]
    return kept | {f"{name}.{column}": value for name, of in both for column, value in of.items()}


def test_joints_of_another_kind_stand_in_the_first_table_and_are_said_to_be_in_no_population(tmp_path):
    rows, theta = made.campaign_rows(4, draws=60)
    limit = {"verdict": "bounded below", "limit95": 2.2e7, "words": "bounded below"}
    rows = [springs_row(row, **(limit if row is rows[1] else {})) for row in rows]
    rows[2] |= {"explains": False}
    made.write_campaign(tmp_path, rows, theta, kind="springs")
    findings = examine_campaign(tmp_path)
    assert findings.joints is None
    assert set(findings.left_out.values()) == {OTHER_KIND}
    assert all(look.gravity > 2 for look in findings.look)  # the kind of most joints is no reason to look at one
    blocks = campaign_lead(findings)
    known = "first.kx known of none of them, second.kx 23.2 MN/m (known of 3)"
    assert blocks[0].text.startswith(f"**4 joints, each by itself: {known}.** 4 of 4 cases are done")
    table = next(block for block in blocks if isinstance(block, Table))
    assert [row[2:] for row in table.rows[:4]] == [
        ("16.8", "12.5 to 63.3", "MN/m", "not identified"),
        ("23.2", "22.1 to 24.3", "MN/m", "identified"),
        ("16.8", "12.5 to 63.3", "MN/m", "not identified"),
        ("–", "above 22.0", "MN/m", "bounded below"),
    ]
    assert (table.rows[5][-1], len(table.rows)) == (NO_VALID_VALUE, 8)
    says(blocks[-1].text, OTHER_KIND, "found 0. Left out 4 cases")
    lines = list(csv.DictReader(joints_csv(findings).splitlines()))
    assert [line["second.kx.verdict"] for line in lines] == ["identified", "bounded below", "identified", "identified"]
    assert float(lines[0]["first.kx.high95 (N/m)"]) == 63.3e6


def test_no_text_of_a_table_is_written_as_a_formula(tmp_path, short_population):
    rows, theta = made.campaign_rows(6, draws=60)
    serials = ["=1+1", "\uff1d1+1", "\u202e=1+1", " \uff20A1", "\uff0d1", "A=1"]
    rows = [row | {"serial": serial} for row, serial in zip(rows, serials, strict=True)]
    made.write_campaign(tmp_path, rows, theta)
    lines = csv.DictReader(joints_csv(examine_campaign(tmp_path)).splitlines())
    written = {line["key"]: line["serial"] for line in lines}
    expected = ["'=1+1", "'\uff1d1+1", "\\u202e=1+1", "' \uff20A1", "'\uff0d1", "A=1"]
    assert [written[row["key"]] for row in rows] == expected


def test_one_case_of_another_kind_among_pairs_is_named_on_page_one_and_to_be_looked_at(tmp_path, short_population):
    rows, theta = made.campaign_rows(6, draws=60)
    made.write_campaign(tmp_path, rows, theta)
    rows[0] = springs_row(rows[0])
    made.write_case(tmp_path / rows[0]["file"], theta[0], kind="springs")
    made.write_index(tmp_path, rows)
    findings = examine_campaign(tmp_path)
    assert findings.counts["in the population"] == 5
    assert [(look.row.key, look.reasons) for look in findings.look if look.gravity == 2] == [
        (rows[0]["key"], (OTHER_KIND,))
    ]
    assert any(
        "Not in the population.** Left out 1 case: its joint" in getattr(b, "text", "") for b in campaign_lead(findings)
    )


def test_the_first_table_ends_where_a_page_does(tmp_path, findings):
    many = dataclasses.replace(findings, rows=findings.rows * 3)
    (table,) = (block for block in campaign_lead(many) if isinstance(block, Table) and "Verdict" in block.head)
    assert len(table.rows) == 120
    assert table.note.startswith("The first 40 of 114; `joints.csv` has all.")


@pytest.mark.whole
@pytest.mark.usefixtures("short_population")
def test_posteriors_that_cannot_be_read_are_named(tmp_path):
    rows, theta = made.campaign_rows(8, draws=60)
    made.write_campaign(tmp_path, rows, theta)
    (tmp_path / rows[0]["file"]).unlink()
    (tmp_path / rows[1]["file"]).write_bytes(b"\x89HDF\r\n\x1a\nno more")
    made.write_case(tmp_path / rows[2]["file"], theta[2], density=np.zeros((1, 3)))
    made.write_case(tmp_path / rows[3]["file"], np.where(theta[3] > 0, np.nan, 0.0))
    shutil.move(tmp_path / rows[4]["file"], tmp_path.parent / "outside.nc")
    rows[4]["file"] = "../outside.nc"
    made.write_index(tmp_path, rows)
    findings = examine_campaign(tmp_path)
    assert (set(findings.left_out), findings.counts["in the population"]) == ({row["key"] for row in rows[:5]}, 3)
    assert all("cannot be read" in look.reasons[0] for look in findings.look if look.gravity == 2)


def test_cases_in_other_coordinates_are_carried_over(tmp_path):
    # the same joints, some of them sampled in signed coordinates under a prior uniform there
    rows, theta = made.campaign_rows(30, draws=300)
    log, signed = jb.parametrisation_named("log"), jb.parametrisation_named("signed")
    for j, (row, draws) in enumerate(zip(rows, theta, strict=True)):
        if j % 3:
            made.write_case(tmp_path / row["file"], draws)
        else:
            other = signed.coordinates(log.values(draws))
            ends = {"low": [made.LOW[0], made.LOW[2], -1.0], "high": [made.HIGH[0], made.HIGH[2], 1.0]}
            made.write_case(tmp_path / row["file"], other, "signed", mean=[19.0, 12.0, 0.0], sd=[3.0, 3.0, 0.6], **ends)
    made.write_index(tmp_path, rows)
    found, _ = read_draws(tmp_path, read_index(tmp_path))
    assert found.parametrisation.key == "log"
    np.testing.assert_allclose(found.draws.theta, theta, rtol=1e-9)
    # π over θ of the log coordinates is |∂ρ/∂ln k12| = ρ times that over ρ, by hand
    given = found.draws.log_prior[0] - np.log(signed.coordinates(log.values(theta[0]))[:, 2])
    np.testing.assert_allclose(given, given[0], atol=1e-9)
    assert not found.draws.log_prior[1].any()


@pytest.mark.usefixtures("blank_charts")
def test_a_coupling_of_either_sign_is_compared_by_its_coordinate(tmp_path):
    rng = np.random.default_rng(1)
    rows, _ = made.campaign_rows(20, draws=10, dates=False)
    middle = np.array([22.3, 14.2, 0.0]) + [0.2, 0.1, 0.2] * rng.normal(size=(20, 3))
    for row, at in zip(rows, middle, strict=True):
        draws = at + [0.1, 0.05, 0.1] * rng.normal(size=(200, 3))
        ends = {"low": [14.0, 7.0, -1.0], "high": [25.0, 18.0, 1.0], "mean": [20.0, 12.0, 0.0], "sd": [3.0, 3.0, 0.6]}
        made.write_case(tmp_path / row["file"], draws, "signed", **ends)
    made.write_index(tmp_path, rows)
    write_campaign_report(tmp_path)
    found = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert list(found["outliers"]) == ["k11", "rho", "k22"]
    assert found["population"]["stiffness"]["k12"]["scatter_of"] == "N"
    low, high = (
        found["population"]["stiffness"]["k12"][f"{end}_end_of_95_percent_of_joints"] for end in ("low", "high")
    )
    assert low["median"] < 0 < high["median"]
    assert (tmp_path / "figures" / "ranking-rho.svg").is_file()


@pytest.mark.whole
@pytest.mark.usefixtures("short_population")
def test_draws_at_an_end_of_the_prior_are_told(tmp_path):
    rows, theta = made.campaign_rows(6, draws=100)
    theta[2, :, 0] = made.HIGH[0] - 0.02 * np.abs(np.random.default_rng(1).normal(size=100))
    made.write_campaign(tmp_path, rows, theta)
    look = {one.row.key: one.reasons for one in examine_campaign(tmp_path).look}
    assert "upper end of the prior of k11" in "; ".join(look[rows[2]["key"]])
    assert sum("end of the prior" in "; ".join(told) for told in look.values()) == 1


@pytest.mark.parametrize("content", [None, b"", b"PAR1 no table", "table"])
def test_what_is_no_campaign_is_refused_in_one_line(tmp_path, content):
    if content == "table":
        made.write_index(tmp_path, [{"name": "x"}])
    elif content is not None:
        (tmp_path / "index.jsonl").write_bytes(content)
    refused(lambda: write_campaign_report(tmp_path), jb.MeasurementError, r"index.jsonl: .*expected the index")


@pytest.mark.usefixtures("blank_charts")
def test_a_directory_in_the_place_of_a_file_is_refused(copy, findings, monkeypatch):
    monkeypatch.setattr(report_module, "examine_campaign", lambda *_: findings)
    (copy / "report.html").unlink()
    (copy / "report.html").mkdir()
    refused(lambda: write_campaign_report(copy), WriteError, r"report\.html")


def test_a_posterior_as_it_is_saved_has_what_the_report_reads(cheap_posterior, tmp_path):
    rows, theta = made.campaign_rows(3, draws=50)
    made.write_campaign(tmp_path, rows, theta)
    cheap_posterior.with_fewer_draws(500).save(tmp_path / rows[0]["file"])
    made.write_index(tmp_path, rows)
    found, left_out = read_draws(tmp_path, read_index(tmp_path))
    assert not left_out
    loaded, count = jb.load_posterior(tmp_path / rows[0]["file"]), found.draws.counts[0]
    np.testing.assert_allclose(found.draws.theta[0, :count], loaded.thinned(count), rtol=1e-9)
    prior = loaded.problem.prior
    whole = prior.log_density(loaded.thinned(count)) + prior.log_normalisation
    np.testing.assert_allclose(found.draws.log_prior[0, :count], whole, atol=1e-9)
    np.testing.assert_allclose(found.prior_mean[0], prior.mean[:3])
    np.testing.assert_allclose(found.prior_sd[0], prior.sd[:3])
