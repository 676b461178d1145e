import dataclasses
import datetime
import os
import shutil
import subprocess
import sys
import tomllib

import numpy as np
import pandas
import pytest

import jointbayes as jb
from jointbayes.case.toml_text import toml_text
from jointbayes.errors import WriteError
from jointbayes.studies.campaign.campaign_run import CaseWork, case_seed, do_case, read_cases, run_cases
from jointbayes.studies.campaign.index import INDEX, campaign_directory, kept_rows, write_index
from jointbayes.studies.study_directory import append_line
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
    settings = {"seed": 1, "draws": 4000, "again": False, "progress": lambda _: None, "workers": 2, **settings}
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
        text, spec = changed.read()
        assert (spec.structure.length_mm, spec.data.noise.added, spec.data.outputs) == (400.5, False, ("10:y",))
        expected = tomllib.loads(BASE.read_text())
        expected["structure"]["length_mm"] = 400.5
        expected["data"]["noise"]["added"] = False
        expected["data"]["outputs"] = ["10:y"]
        expected["title"] = "Joint A"
        assert (tomllib.loads(text), tomllib.loads(same.read()[0])) == (expected, tomllib.loads(BASE.read_text()))

    def test_key_serial_and_date_are_the_joints_own(self, tmp_path):
        rows = "key;serial;date;data.truth.k11\na;SN 7;2026-03-31;5e9\n;SN-8;2026-03-31T14:05+02:00;6e9\n\n;;;7e9\n"
        found = read_cases([table_of(tmp_path, rows)], BASE)
        assert [(c.key, c.serial, c.order) for c in found] == [
            ("a", "SN 7", 0),
            ("SN-8", "SN-8", 1),
            ("00003", None, 2),
        ]
        assert found[1].date == datetime.datetime(2026, 3, 31, 12, 5)
        assert [c.where.rsplit(":", 1)[1] for c in found] == ["2", "3", "5"]

    def test_number_where_a_text_belongs_is_the_text(self, tmp_path):
        (case,) = read_cases([table_of(tmp_path, "title,data.truth.k11\n2026,5e9\n")], BASE)
        _, spec = case.read()
        assert spec.title == "2026"

    def test_each_row_may_have_a_base_of_its_own_beside_the_table(self, tmp_path):
        (tmp_path / "cases").mkdir()
        (tmp_path / "cases" / "b.toml").write_bytes(BASE.read_bytes())
        (case,) = read_cases([table_of(tmp_path, "case,key\ncases/b.toml,x\n")])
        assert (case.path, case.read()[1].structure.length_mm) == (tmp_path / "cases" / "b.toml", 383.0)

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

    def test_case_files_and_patterns_are_cases_by_their_names(self, tmp_path):
        for name in ("b", "a", "c"):
            (tmp_path / f"{name}.toml").write_bytes(BASE.read_bytes())
        assert [c.key for c in read_cases([tmp_path / "*.toml"])] == ["a", "b", "c"]
        assert [c.key for c in read_cases([tmp_path / "c.toml", tmp_path / "a.toml"])] == ["c", "a"]
        refused(lambda: read_cases([tmp_path / "*.tml"]), jb.CaseError, "found no such file")
        with pytest.raises(jb.CaseError, match=r"key: found 'a', which .*a.toml has already"):
            read_cases([tmp_path / "a.toml", tmp_path / "*.toml"])

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
        assert (index["key"].tolist(), index["order"].tolist()) == ([f"c{i}" for i in range(7)], list(range(7)))
        assert index["status"].tolist() == ["done", "done", "failed", "done", "killed its worker", "done", "done"]
        assert index["error"]["c2"] == "c2: found no start; expected one; correct the case"
        assert index["error"]["c4"] == "its worker ended by SIGKILL"
        assert index["attempts"].tolist() == [1, 1, 1, 1, 3, 1, 1]
        assert index["seed"].tolist() == [case_seed(1, f"c{i}") for i in range(7)]
        assert index["k11.median"]["c0"] == 1.0 + case_seed(1, "c0")
        assert np.isnan(index["k11.median"]["c2"])
        done = index[index["status"] == "done"]
        assert sorted((tmp_path / "out" / "cases").iterdir()) == [tmp_path / "out" / f for f in done["file"]]
        assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [".jointbayes", "cases", INDEX]

    def test_started_again_what_is_done_stays_and_what_failed_is_tried_once_more(self, tmp_path):
        pretend(tmp_path, ROWS)
        before = (tmp_path / "out/cases/c0.nc").stat().st_mtime_ns
        (tmp_path / "mended").touch()
        (
            tmp_path / "out/cases/.c9.nc.0123abcd.jointbayes"
        ).touch()  # as a worker leaves it that is killed while it writes
        index = pretend(tmp_path, ROWS)
        assert index["status"].tolist() == ["done"] * 4 + ["killed its worker"] + ["done"] * 2
        assert (index["attempts"]["c2"], [tries(tmp_path, f"c{i}") for i in range(7)]) == (2, [1, 1, 2, 1, 3, 1, 1])
        assert (tmp_path / "out/cases/c0.nc").stat().st_mtime_ns == before
        assert not list((tmp_path / "out/cases").glob(".*"))
        pretend(tmp_path, ROWS, again=True)
        assert tries(tmp_path, "c4") == 6

    @pytest.mark.parametrize("change", ["row", "seed", "draws", "file"])
    def test_case_is_done_again_where_what_it_depends_on_has_changed(self, tmp_path, change):
        rows = "key,title\na,go\nb,go\n"
        pretend(tmp_path, rows)
        if change == "file":
            (tmp_path / "out/cases/a.nc").unlink()
        settings = {"seed": 2} if change == "seed" else {"draws": 1000} if change == "draws" else {}
        pretend(tmp_path, rows.replace("a,go", "a,went") if change == "row" else rows, **settings)
        assert (tries(tmp_path, "a"), tries(tmp_path, "b")) == (2, (2 if change in ("seed", "draws") else 1))

    def test_serial_and_order_follow_the_table_without_sampling_again(self, tmp_path):
        pretend(tmp_path, "key,serial,title\na,1,go\nb,2,go\n")
        index = pretend(tmp_path, "key,serial,title\nb,two,go\na,one,go\n")
        assert list(index["serial"].items()) == [("b", "two"), ("a", "one")]
        assert tries(tmp_path, "a") == tries(tmp_path, "b") == 1

    def test_rows_of_a_driver_that_was_killed_are_known(self, tmp_path):
        """As after SIGKILL: rows in the order in which cases ended, the last of them torn."""
        rows = "key,title\n" + "".join(f"c{i},go\n" for i in range(4))
        index = pretend(tmp_path, rows)
        file = tmp_path / "out" / INDEX
        lines = file.read_text().splitlines()
        file.write_text("\n".join([lines[2], lines[0], lines[1], lines[3][:40]]))
        assert kept_rows(tmp_path / "out").keys() == {"c0", "c1", "c2"}
        assert pretend(tmp_path, rows).equals(index)
        assert [tries(tmp_path, f"c{i}") for i in range(4)] == [1, 1, 1, 2]

    def test_index_is_on_the_disk_row_by_row_and_in_the_order_of_the_table_at_the_end(self, tmp_path):
        for i in range(5):
            append_line(
                tmp_path / INDEX, {"key": f"c{i}", "status": "done", "order": 4 - i, "x.median": float(i), "date": None}
            )
            assert list(kept_rows(tmp_path)) == [f"c{k}" for k in range(i + 1)]
        write_index(tmp_path, kept_rows(tmp_path).values())
        assert list(kept_rows(tmp_path)) == ["c4", "c3", "c2", "c1", "c0"]

    def test_interrupted_campaign_keeps_what_is_done(self, tmp_path):
        rows = "key,title\n" + "".join(f"c{i},go\n" for i in range(6))

        def stop(now):
            if (tmp_path / "out" / INDEX).exists():
                assert len(kept_rows(tmp_path / "out")) == now.done  # also where nothing after this is ever run
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
        assert all(now.text.split(" failed, ")[0].isdigit() for now in seen)
        pretend(tmp_path, ROWS, progress=seen.append)
        assert (seen[-1].done, seen[-1].figures["failed"], seen[-1].earlier) == (7, 2, 6)


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
            "import sys; from jointbayes.studies.campaign.index import campaign_directory\n"
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
        with pytest.raises(jb.MeasurementError, match="case 'c2': found that it failed: c2: found no start"):
            done.posterior("c2")
        (tmp_path / "out" / INDEX).write_bytes(b"[1]\n")
        refused(lambda: pretend(tmp_path, ROWS), jb.MeasurementError, "found no index of a campaign in it")


#: Two joints whose posteriors take a quarter of a second each.
SMALL = (
    "key,data.truth.k22,data.noise.seed,data.noise.relative,sampling.ensembles,sampling.walkers,data.f_step_hz\n"
    "a,1.4e6,1,0.003,4,16,2\nb,1.5e6,2,0.003,4,16,2\n"
)


@pytest.mark.whole
def test_command_samples_each_case_as_if_it_were_alone_and_says_where_the_index_is(tmp_path):
    table = table_of(tmp_path, SMALL)
    ended = cli(*["campaign", str(table), "--base", str(BASE), "--workers", "1", "--out", str(tmp_path / "out")])
    assert ended.exit_code == 0, ended.output  # two joints make no population
    says(ended.stdout, "2 cases: 2 done, 0 failed, 0 not converged", f"Index: {tmp_path / 'out' / 'index.jsonl'}")
    assert {"report.html", "report.pdf", "summary.json"} <= {file.name for file in (tmp_path / "out").iterdir()}
    campaign = jb.Campaign(tmp_path / "out")
    (case,) = [case for case in read_cases([table], BASE) if case.key == "b"]
    whole = jb.case_from_text("b", case.read()[0])
    alone = jb.sample(whole, seed=case_seed(1, "b"), settings=whole.sampler.for_one_of_many())
    brief, row = alone.brief(), campaign.index.loc["b"]
    assert {name: None if pandas.isna(row[name]) else row[name] for name in brief} == brief
    kept = campaign.posterior("b")
    assert np.array_equal(kept.theta, alone.with_fewer_draws(4000).theta)
    assert kept.record.case_name == "b"


@pytest.mark.whole
def test_full_campaign_samples_as_long_as_a_run(tmp_path):
    (case,) = read_cases([table_of(tmp_path, SMALL)], BASE)[:1]
    whole = jb.case_from_text(case.key, case.read()[0])
    few = CaseWork(case.key, whole.text, str(CONFIGS), 7, str(tmp_path / "few.nc"), 10**6)
    full = dataclasses.replace(few, file=str(tmp_path / "full.nc"), full=True)
    do_case(few)
    do_case(full)
    alone = jb.sample(whole, seed=7)
    assert jb.load_posterior(full.file).theta.tobytes() == alone.theta.tobytes()
    assert len(jb.load_posterior(few.file).theta) < len(alone.theta)


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
    (tmp_path / "case.toml").write_text(BODY_AND_MATRICES)
    for name in FILES:
        (tmp_path / name).write_text(name)
    (case,) = read_cases([tmp_path / "case.toml"])

    text, spec = case.read()
    files = case.files(spec)
    copies = [shutil.copy(file, tmp_path / f"copy of {file.name}") for file in files]
    marks = [case.fingerprint(text, files)]
    assert case.fingerprint(text, copies) == marks[0]  # by what they hold, wherever they are
    for name in FILES:
        (tmp_path / name).write_text("changed")
        marks.append(case.fingerprint(text, files))
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
