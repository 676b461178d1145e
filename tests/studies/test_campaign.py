import csv
import datetime
import io
import json
import os
import shutil
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.case.toml_text import toml_text
from jointbayes.errors import WriteError
from jointbayes.report.model import Table
from jointbayes.studies.campaign import (
    INDEX,
    campaign_directory,
    campaign_page,
    case_seed,
    kept_rows,
    read_cases,
    run_cases,
    write_index,
)
from tests.case.refusal_rows import parts_named
from tests.conftest import CONFIGS, cli, without_stages
from tests.one_line import refused, says
from tests.studies.task_functions import pretend_case

BODY_AND_MATRICES, WRONG = parts_named("campaign").values()
BASE = CONFIGS / "clamped_beam.toml"


def table_of(tmp_path, text, name="joints.csv"):
    table = tmp_path / name
    table.write_text(text, encoding="utf-8")
    return table


def fault_of(tmp_path, text, base=BASE):
    with pytest.raises(jb.CaseError) as caught:
        read_cases([table_of(tmp_path, text)], base)
    return str(caught.value)


def pretend(tmp_path, text, **settings):
    """Run a campaign whose cases are only pretended, and return its index."""
    directory = tmp_path / "out"
    with campaign_directory(directory):
        pass
    settings = {"seed": 1, "progress": lambda _: None, "workers": 2, **settings}
    run_cases(read_cases([table_of(tmp_path, text)], BASE), directory, do=pretend_case, **settings)
    return jb.Campaign(directory).index


def tries(tmp_path, key):
    return len(list((tmp_path / "tries").glob(f"{key}-*")))


class TestTable:
    def test_row_changes_the_keys_of_its_columns_and_no_other(self, tmp_path):
        rows = (
            'key,structure.length_mm,data.noise.added,data.outputs,title\na,400.5,false,"[""10:y""]",Joint A\nb,,,,\n'
        )
        changed, same = read_cases([table_of(tmp_path, rows)], BASE)
        text, spec, _ = changed.read()
        assert (spec.structure.length_mm, spec.data.noise.added, spec.data.outputs) == (400.5, False, ("10:y",))
        expected = tomllib.loads(BASE.read_text())
        expected["structure"]["length_mm"] = 400.5
        expected["data"]["noise"]["added"] = False
        expected["data"]["outputs"] = ["10:y"]
        expected["title"] = "Joint A"
        assert (tomllib.loads(text), tomllib.loads(same.read()[0])) == (expected, tomllib.loads(BASE.read_text()))

    def test_key_serial_and_date_are_the_joints_own(self, tmp_path):
        rows = "key;serial;date;data.truth.k11\na;SN 7;2026-03-31;5e9\n;SN-8;31.3.26, 14:05;6e9\n\n;;;7e9\n"
        found = read_cases([table_of(tmp_path, rows)], BASE)
        assert [(c.key, c.serial, c.date) for c in found] == [
            ("a", "SN 7", "2026-03-31"),
            ("SN-8", "SN-8", "31.3.26, 14:05"),
            ("00003", "", ""),
        ]
        assert [c.where.rsplit(":", 1)[1] for c in found] == ["2", "3", "5"]

    def test_number_where_a_text_belongs_is_the_text(self, tmp_path):
        (case,) = read_cases([table_of(tmp_path, "title,data.truth.k11\n2026,5e9\n")], BASE)
        _, spec, _ = case.read()
        assert spec.title == "2026"

    def test_each_row_may_have_a_base_of_its_own_beside_the_table(self, tmp_path):
        (tmp_path / "cases").mkdir()
        (tmp_path / "cases" / "b.toml").write_bytes(BASE.read_bytes())
        (case,) = read_cases([table_of(tmp_path, "case,key\ncases/b.toml,x\n")])
        assert (case.directory, case.read()[1].structure.length_mm) == (tmp_path / "cases", 383.0)

    def test_fault_of_a_row_names_table_row_and_column(self, tmp_path):
        rows = "key,structure.length_mm,structure.elements\na,400,10\nb,-1,10\nc,400,ten\n"
        first, second = fault_of(tmp_path, rows).splitlines()
        assert first == (
            f"{tmp_path}/joints.csv:3: structure.length_mm: found -1; expected the length of the beam in mm, a number "
            "greater than 0; write for example length_mm = 383.0"
        )
        assert second.startswith(f'{tmp_path}/joints.csv:4: structure.elements: found the text "ten"; expected')

    def test_fault_of_the_base_names_its_line_too(self, tmp_path):
        base = tmp_path / "base.toml"
        base.write_text(BASE.read_text().replace("elements = 10", "elements = 0"), encoding="utf-8")
        message = fault_of(tmp_path, "key,structure.length_mm\na,400\n", base)
        assert message.startswith(f"{tmp_path}/joints.csv:2: structure.elements, {base}:13: found 0; expected")

    @pytest.mark.parametrize("line", WRONG.splitlines())
    def test_wrong_table_is_refused_before_any_work(self, tmp_path, line):
        rows, _, message = line.partition(" ;; ")
        assert message in fault_of(tmp_path, rows.replace("\\n", "\n"))

    def test_many_faults_are_cut_short(self, tmp_path):
        rows = "key,structure.length_mm\n" + "".join(f"a{i},-1\n" for i in range(100))
        lines = fault_of(tmp_path, rows).splitlines()
        assert (len(lines), lines[-1]) == (21, "there are more faults; these are the first")

    def test_case_files_are_cases_by_their_names(self, tmp_path):
        for name in ("a", "c"):
            (tmp_path / f"{name}.toml").write_bytes(BASE.read_bytes())
        assert [c.key for c in read_cases([tmp_path / "c.toml", tmp_path / "a.toml"])] == ["c", "a"]
        with pytest.raises(jb.CaseError, match=r"key: found 'a', which .*a.toml has already"):
            read_cases([tmp_path / "a.toml", tmp_path / "a.toml"])
        for sources, base in (([tmp_path / "a.toml"], BASE), ([tmp_path / "a.toml", tmp_path / "t.csv"], None)):
            refused(lambda at=sources, of=base: read_cases(at, of), jb.CaseError, "found a table with other files, or")

    def test_table_that_is_no_text_is_refused(self, tmp_path):
        (tmp_path / "t.csv").write_bytes(b"key,title\na,\xff\n")
        refused(lambda: read_cases([tmp_path / "t.csv"], BASE), jb.CaseError, "t.csv:2: found no UTF-8 text")


def test_toml_that_is_written_reads_back_as_it_was():
    data = {
        "title": 'a "b" \\ \x7f\n\x01 ü', "on": True, "n": -3, "x": [1.5, float("inf"), 1e-300],
        "day": datetime.date(2026, 1, 2), "empty": {}, "big": 2**60,
        "a": {"b": {"c": {"11:y": 1}, "list": [{"p q": [1, "x"]}]}},
    }  # fmt: skip
    assert tomllib.loads(toml_text(data)) == data


def test_seed_of_a_case_is_of_the_campaigns_seed_and_its_key_alone():
    seeds = {case_seed(seed, f"case-{i}") for seed in (1, 2) for i in range(500)}
    assert len(seeds) == 1000
    assert all(0 <= seed < 2**32 for seed in seeds)


ROWS = "key,serial,title\n" + "".join(
    f"c{i},SN{i},{'fail' if i == 2 else 'kill' if i == 4 else 'go'}\n" for i in range(7)
)


class TestDriver:
    def test_each_case_has_one_row_and_those_that_fail_or_kill_are_named(self, tmp_path):
        index = pretend(tmp_path, ROWS)
        assert index["key"].tolist() == [f"c{i}" for i in range(7)]
        assert index["status"].tolist() == ["done", "done", "failed", "done", "killed its worker", "done", "done"]
        assert index["error"]["c2"] == "c2: found no start; expected one; correct the case"
        assert index["error"]["c4"] == "its worker ended by SIGKILL"
        assert index["attempts"].tolist() == [1, 1, 1, 1, 3, 1, 1]
        assert index["seed"].tolist() == [case_seed(1, f"c{i}") for i in range(7)]
        assert (index["k22.median"]["c0"], index["k22.low95"]["c0"]) == (1e6 + case_seed(1, "c0"), 9e5)
        assert np.isnan(index["k22.median"]["c2"])
        done = index[index["status"] == "done"]
        assert sorted(p.name for p in (tmp_path / "out" / "cases").iterdir()) == done["key"].tolist()
        names = {".jointbayes", "cases", INDEX, "report.html", "report.pdf"}
        assert {p.name for p in (tmp_path / "out").iterdir()} == names

    def test_started_again_what_is_done_stays_and_what_is_not_is_tried_again(self, tmp_path):
        pretend(tmp_path, ROWS)
        (tmp_path / "mended").touch()
        (tmp_path / "out/cases/.c9.0123abcd.jointbayes").touch()  # a worker that is killed while it writes leaves it
        for name in ("c2.posterior", "c2.posterior-2", "c2.posterior-a", "c4.posterior"):
            (tmp_path / f"out/cases/{name}.nc").touch()  # draws that a killed worker leaves: of c2 they are whole now
        index = pretend(tmp_path, ROWS)
        assert index["status"].tolist() == ["done"] * 4 + ["killed its worker"] + ["done"] * 2
        assert [tries(tmp_path, f"c{i}") for i in range(7)] == [1, 1, 2, 1, 6, 1, 1]
        assert not list((tmp_path / "out/cases").glob(".*"))
        assert {path.name for path in (tmp_path / "out/cases").glob("*.nc")} == {"c2.posterior-a.nc", "c4.posterior.nc"}

    @pytest.mark.parametrize("change", ["row", "seed", "full", "directory"])
    def test_case_is_done_again_where_what_it_depends_on_has_changed(self, tmp_path, change):
        rows = "key,title\na,go\nb,go\n"
        pretend(tmp_path, rows)
        if change == "directory":
            shutil.rmtree(tmp_path / "out/cases/a")
        settings = {"seed": 2} if change == "seed" else {"full": True} if change == "full" else {}
        pretend(tmp_path, rows.replace("a,go", "a,went") if change == "row" else rows, **settings)
        assert (tries(tmp_path, "a"), tries(tmp_path, "b")) == (2, (2 if settings else 1))

    def test_serial_and_order_follow_the_table_without_sampling_again(self, tmp_path):
        pretend(tmp_path, "key,serial,title\na,1,go\nb,2,go\n")
        index = pretend(tmp_path, "key,serial,title\nb,two,go\na,one,go\n")
        assert list(index["serial"].items()) == [("b", "two"), ("a", "one")]
        assert tries(tmp_path, "a") == tries(tmp_path, "b") == 1

    def test_half_a_row_of_an_earlier_version_is_no_case_that_is_done(self, tmp_path):
        rows = "key,title\n" + "".join(f"c{i},go\n" for i in range(4))
        index = pretend(tmp_path, rows)
        file = tmp_path / "out" / INDEX
        lines = file.read_text().splitlines()
        file.write_text("\n".join([lines[0], lines[3], lines[1], lines[2], lines[4][:10]]))
        assert kept_rows(file).keys() == {"c0", "c1", "c2"}
        again = pretend(tmp_path, rows)
        assert again.equals(index)
        assert [tries(tmp_path, f"c{i}") for i in range(4)] == [1, 1, 1, 2]

    def test_interrupted_campaign_keeps_what_is_done(self, tmp_path):
        rows = "key,title\n" + "".join(f"c{i},go\n" for i in range(6))

        def stop(now):
            assert len(kept_rows(tmp_path / "out" / INDEX)) == now.done  # also if nothing after this ever runs
            if now.done == 3:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            pretend(tmp_path, rows, progress=stop)
        kept = jb.Campaign(tmp_path / "out").index
        assert len(kept) == 3
        assert (pretend(tmp_path, rows)["status"] == "done").all()
        assert all(tries(tmp_path, key) == 1 for key in kept["key"])

    def test_progress_counts_cases_and_how_many_run(self, tmp_path):
        seen = []
        pretend(tmp_path, ROWS, progress=seen.append)
        assert (seen[-1].total, seen[-1].done, seen[-1].figures["failed"], seen[-1].earlier) == (7, 7, 2, 0)
        assert {now.figures["running"] for now in seen} == {0, 1, 2}
        assert str(seen[-1]).startswith("sampling: 7 of 7 cases, 2 failed, 0 running")
        pretend(tmp_path, ROWS, progress=seen.append)
        assert (seen[-1].done, seen[-1].figures["failed"], seen[-1].earlier) == (7, 2, 5)


def row_of(**cells):
    """A row of a case that is done, as the page gets it."""
    row = {"key": "a", "serial": "", "status": "done", "error": "", "converged": True, "explains": True, "reason": ""}
    for name, verdict in (("k11", "not identified"), ("k12", "bounded below"), ("k22", "identified")):
        of = {"unit": "N/m", "low95": 2.21e7, "high95": 2.43e7, "limit": 2.2e7, "verdict": verdict}
        row |= {f"{name}.{column}": value for column, value in of.items()}
    return row | cells


class TestPage:
    def test_each_joint_has_a_row_with_interval_limit_or_verdict_and_what_is_doubted(self):
        rows = [row_of(), row_of(key="b", serial="SN 7", converged=False, explains=False)]
        page = campaign_page("line-7", [*rows, row_of(key="c", status="failed", error="c: no file")])
        callout, joints, lost = page.lead
        assert callout.text == (
            "**2 of 3 cases are done.** 1 did not converge. In 1 the model does not explain the data."
        )
        known = ("not identified", "above 22.0 MN/m", "22.1 to 24.3 MN/m")
        assert joints.rows == (
            ("a", *known, ""),
            ("b (SN 7)", *known, "not converged; the model does not explain the data"),
        )
        assert lost.rows == (("c", "failed", "c: no file"),)

    def test_the_page_ends_where_a_reader_does_and_says_so(self):
        page = campaign_page("x", [row_of(key=f"c{i}") for i in range(301)])
        (joints,) = (block for block in page.lead if isinstance(block, Table))
        assert len(joints.rows) == 300
        assert "`index.csv` has all" in joints.note

    def test_what_a_spreadsheet_would_compute_has_an_apostrophe(self, tmp_path):
        texts = ["=1+1", "\uff1d1+1", " \uff20A1", "-2", "\u202e=1+1", "SN-7", "1 = 1"]
        write_index(tmp_path / INDEX, [{"key": f"{i}", "serial": text} for i, text in enumerate(texts)])
        rows = csv.DictReader(io.StringIO((tmp_path / INDEX).read_text(encoding="utf-8")))
        assert [row["serial"] for row in rows] == [*(f"'{text}" for text in texts[:4]), "\\u202e=1+1", *texts[5:]]


class TestDirectory:
    def test_directory_with_other_files_is_refused(self, tmp_path):
        (tmp_path / "x").mkdir()
        (tmp_path / "x/index.jsonl").touch()  # an older one of ours, or anybody's
        with pytest.raises(WriteError, match="holds other files, and no mark of jointbayes"):
            campaign_directory(tmp_path / "x").__enter__()
        refused(campaign_directory(tmp_path / "x/index.jsonl").__enter__, WriteError, "found a file")
        refused(campaign_directory(tmp_path / "x/index.jsonl/below").__enter__, WriteError, "cannot be written")
        assert [p.name for p in (tmp_path / "x").iterdir()] == ["index.jsonl"]
        for line in ("jointbayes: a campaign\n", "jointbayes: a campaign", "jointbayes: a campaign\r\n"):  # by hand
            (tmp_path / "x/.jointbayes").write_text(line, newline="")
            with campaign_directory(tmp_path / "x"):
                pass

    @pytest.mark.whole
    @pytest.mark.skipif(sys.platform == "win32", reason="locks of POSIX")
    def test_one_process_at_a_time(self, tmp_path):
        program = (
            "import sys; from jointbayes.studies.campaign import campaign_directory\n"
            "with campaign_directory(sys.argv[1]): print('in', flush=True)"
        )
        with campaign_directory(tmp_path / "x"):
            ended = subprocess.run(
                [sys.executable, "-c", program, tmp_path / "x"], capture_output=True, text=True, check=False,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            )  # fmt: skip
        assert f"found another process at work in it (process {os.getpid()} on " in ended.stderr
        assert [p.name for p in (tmp_path / "x").iterdir()] == [".jointbayes"]
        with campaign_directory(tmp_path / "x"):
            pass

    def test_campaign_without_index_or_case_says_so(self, tmp_path):
        with pytest.raises(jb.MeasurementError, match="found no case, or no such file"):
            jb.Campaign(tmp_path).index  # noqa: B018
        pretend(tmp_path, ROWS)
        done = jb.Campaign(tmp_path / "out")
        refused(lambda: done.posterior("x"), jb.MeasurementError, "found no case 'x'")
        with pytest.raises(jb.MeasurementError, match="found that case 'c2' failed: c2: found no start"):
            done.posterior("c2")
        (tmp_path / "out" / INDEX).write_bytes(b"a,b\n1,2\n")
        refused(lambda: pretend(tmp_path, ROWS), jb.MeasurementError, "found no index of a campaign in it")


#: Two joints whose posteriors take a quarter of a second each.
SMALL = (
    "key,data.truth.k22,data.noise.seed,data.noise.relative,sampling.ensembles,sampling.walkers,data.f_step_hz\n"
    "a,1.4e6,1,0.001,4,16,16\nb,1.5e6,2,0.001,4,16,16\n"
)


@pytest.mark.whole
def test_command_samples_a_case_as_if_it_were_alone_and_says_where_the_index_is(tmp_path):
    table = table_of(tmp_path, SMALL.replace("a,1.4e6,1,0.001,4,16,16\n", ""))
    ended = cli(*["campaign", str(table), "--base", str(BASE), "--workers", "1", "--out", str(tmp_path / "out")])
    assert ended.exit_code == 0, ended.output
    says(ended.stdout, "1 cases: 1 done, 0 failed, 0 not converged", f"Index: {tmp_path / 'out' / 'index.csv'}")
    assert {"report.html", "report.pdf", "index.csv"} <= {file.name for file in (tmp_path / "out").iterdir()}
    campaign = jb.Campaign(tmp_path / "out")
    (case,) = read_cases([table], BASE)
    whole = jb.case_from_text("b", case.read()[0])
    alone = jb.sample(whole, seed=case_seed(1, "b"), settings=whole.sampler.for_one_of_many())
    row, k22 = campaign.index.loc["b"], alone.summary().to_dict()["parameters"]["k22"]
    assert (row["k22.median"], row["k22.verdict"]) == (k22["median"], k22["verdict"])
    kept = campaign.posterior("b")
    assert np.array_equal(kept.theta, alone.theta)
    assert kept.record.case_name == "b"
    assert json.loads((tmp_path / "out/cases/b/summary.json").read_text(encoding="utf-8"))["seed"] == case_seed(1, "b")


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
def test_full_campaign_samples_each_case_as_long_as_a_run(tmp_path):
    with ThreadPoolExecutor(1) as executor:  # in this process, whose reports are plain
        jb.campaign(table_of(tmp_path, SMALL), tmp_path / "out", base=BASE, executor=executor, full=True)
    case = read_cases([table_of(tmp_path, SMALL)], BASE)[1]
    alone = jb.sample(jb.case_from_text("b", case.read()[0]), seed=case_seed(1, "b"))
    assert jb.Campaign(tmp_path / "out").posterior("b").theta.tobytes() == alone.theta.tobytes()


def test_command_says_what_is_wrong_before_it_begins_and_what_failed_at_its_end(tmp_path):
    table = table_of(tmp_path, "key,structure.length_mm\na,-3\n")
    out = tmp_path / "out"
    ended = cli("campaign", table, "--base", BASE, "--out", out)
    assert ended.exit_code == 2
    assert without_stages(ended.stderr)[0].startswith(f"jointbayes: {table}:2: structure.length_mm: found -3; expected")
    assert not out.exists()
    measured = table_of(tmp_path, "key,data.file\na,missing.uff\n")
    ended = cli("campaign", measured, "--base", CONFIGS / "measured_stations.toml", "--out", out)
    assert ended.exit_code == 1
    says(ended.stdout, "1 cases: 0 done, 1 failed", "FAILED: a: a:", "missing.uff")


FILES = ("tip.uff", "nose.uff", "back.uff", "K.npy", "M.npy", "C.npy")


def test_a_change_in_any_file_that_a_case_names_makes_it_another_case(tmp_path):
    for home in (tmp_path, tmp_path / "elsewhere"):
        home.mkdir(exist_ok=True)
        (home / "case.toml").write_text(BODY_AND_MATRICES)
        for name in FILES:
            (home / name).write_text(name)

    def mark(home=tmp_path):
        (case,) = read_cases([home / "case.toml"])
        return case.work(1, False)[2]

    marks = [mark()]
    assert mark(tmp_path / "elsewhere") == marks[0]  # by what they hold, wherever they are
    for name in FILES:
        (tmp_path / name).write_text("changed")
        marks.append(mark())
    assert len(set(marks)) == len(FILES) + 1


@pytest.mark.parametrize(("file", "key"), [
    ("tip.uff", "data.file"), ("nose.uff", "bodies.spindle.file"), ("back.uff", "bodies.spindle.file"),
    ("K.npy", "structure.stiffness"), ("M.npy", "structure.mass"), ("C.npy", "structure.damping.damping_matrix"),
])  # fmt: skip
def test_any_file_elsewhere_is_refused_by_its_key(file, key, tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(BODY_AND_MATRICES.replace(file, f"../{file}"))
    with pytest.raises(jb.CaseError, match=rf'^{path}: {key}: found "../{file}", which leads out of the directory'):
        read_cases([path])
    assert read_cases([path], allow_outside=True)


def test_measurement_files_elsewhere_are_refused_with_their_row_before_any_work(tmp_path):
    table = table_of(tmp_path, "key,data.file\na,data/virtual_test.uff\nb,../README.md\n")
    base, out = CONFIGS / "measured_stations.toml", tmp_path / "out"
    command = ["campaign", str(table), "--base", str(base), "--out", str(out)]
    ended = cli(*command)
    (line,) = without_stages(ended.stderr)
    assert ended.exit_code == 2
    assert line.startswith(f'jointbayes: {table}:3: data.file: found "../README.md", which leads out of the')
    assert not out.exists()
    ended = cli(*command[:1], table_of(tmp_path, "key,data.file\nb,../README.md\n"), *command[2:], "--allow-outside")
    assert ended.exit_code == 1
    assert "1 cases: 0 done, 1 failed" in ended.stdout
    assert "leads out" not in ended.stdout


def test_a_base_case_elsewhere_is_opened_only_if_asked(tmp_path):
    (tmp_path / "tables").mkdir()
    (tmp_path / "other.toml").write_bytes(BASE.read_bytes())
    table = table_of(tmp_path / "tables", "key,case\na,../other.toml\n")
    refused(lambda: read_cases([table]), jb.CaseError, 'joints.csv:2: case: found "../other.toml", which leads out of')
    (case,) = read_cases([table], allow_outside=True)
    assert case.read()[1].structure.length_mm == 383.0


def test_a_base_that_builds_on_another_reaches_the_worker_whole(tmp_path):
    (tmp_path / "base.toml").write_bytes(BASE.read_bytes())
    (tmp_path / "own.toml").write_text('extends = "base.toml"\n[structure]\nlength_mm = 380.0\n', encoding="utf-8")
    (case,) = read_cases([table_of(tmp_path, "key,structure.elements\na,12\n")], tmp_path / "own.toml")
    spec = jb.case_from_text("a", case.read()[0]).spec  # as the worker reads it
    assert (spec.structure.length_mm, spec.structure.elements) == (380.0, 12)
