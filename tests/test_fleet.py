"""Many campaigns: found, diagnosed side by side, resumed, failures as rows, tables and a page with the trends."""

import html
import json
import os
import shutil
from concurrent.futures import Executor, Future
from contextlib import nullcontext

import pytest
from commands import as_json, refused, run
from test_report import HOSTILE, _Checker, _plain

import mjsim
from mjsim.batch import fleet, fleet_page
from mjsim.batch.diagnoses import Options, campaigns_in, diagnosed, diagnosed_elsewhere, files_of, job_of, unpack
from mjsim.batch.scheduler import Crew
from mjsim.errors import InputError
from mjsim.io.files import locked

pd = pytest.importorskip("pandas")
FATAL = """\
import os
os._exit(7)
"""


@pytest.fixture(scope="module")
def folders(good, tmp_path_factory):
    """A campaign that can be diagnosed, one whose file is broken, and one whose effect ends the process."""
    root = tmp_path_factory.mktemp("fleet")
    shutil.copytree(good, root / "hall" / "one")
    shutil.copytree(good, root / "hall" / "one" / "heldout")
    shutil.copytree(good, root / "hall" / ".hidden")
    (root / "hall" / "two").mkdir()
    (root / "hall" / "two" / "campaign.toml").write_text('name = "x"\n')
    shutil.copytree(good, root / "fatal")
    (root / "fatal" / "fatal.py").write_text(FATAL)
    with (root / "fatal" / "machine.toml").open("a") as file:
        file.write('\n[[effect]]\nid = "fatal.X"\nfile = "fatal.py"\n')
    return root


@pytest.fixture(scope="module")
def result(folders, tmp_path_factory):
    return mjsim.run_fleet([folders], tmp_path_factory.mktemp("out"), as_is=True)


def test_campaigns_are_found_once_and_not_inside_of_others(folders):
    found = campaigns_in([folders, folders / "hall"])
    assert [f.relative_to(folders).as_posix() for f in found] == ["fatal", "hall/one", "hall/two"]
    with pytest.raises(InputError, match="no such folder"):
        campaigns_in([folders / "none"])
    with pytest.raises(InputError, match=r"has no campaign\.toml"):
        campaigns_in([folders / "hall" / "one" / "traces"])


def test_a_key_follows_from_files_and_options(folders, tmp_path):
    one, options = folders / "hall" / "one", Options()
    copy = shutil.copytree(one, tmp_path / "copy")
    assert job_of(copy, options).key == job_of(one, options).key
    assert job_of(one, Options(max_effects=2)).key != job_of(one, options).key
    (copy / "notes.txt").write_text("of no interest")
    assert job_of(copy, options).key == job_of(one, options).key
    trace = copy / "traces" / "turn.csv"
    trace.write_text(trace.read_text().replace(",0.0", ",0.1", 1))
    assert job_of(copy, options).key != job_of(one, options).key


def test_a_campaign_travels_as_its_files(folders, tmp_path):
    one = shutil.copytree(folders / "hall" / "one", tmp_path / "hall" / "one")
    shutil.move(one / "machine.toml", tmp_path / "hall" / "m.toml")
    text = (one / "campaign.toml").read_text()
    text = text.replace("[instrument]", 'machine = "../m.toml"\n[instrument]', 1)
    (one / "campaign.toml").write_text(text.replace("[[test]]", '[[test]]\ndriven_by = "record.csv"', 1))
    (one / "record.csv").write_text("what a control told the axes")
    files = files_of(one)
    assert set(files) == {"campaign.toml", "traces/turn.csv", "record.csv", "../m.toml"}
    there = unpack(files, tmp_path / "elsewhere")
    assert (there / ".." / "m.toml").read_bytes() == files["../m.toml"]
    with pytest.raises(InputError, match="lies outside"):
        unpack({str(tmp_path / "x"): b""}, tmp_path / "elsewhere" / "deep")


def test_failures_are_rows(result):
    rows = {os.path.basename(c["folder"]): c for c in result.campaigns}
    assert rows["one"]["error"] is None and rows["one"]["verdict"] == "nothing_found"
    assert "the key 'test' is missing" in rows["two"]["error"]
    assert "its process ended with status 7" in rows["fatal"]["error"]
    assert (result.diagnosed, result.failed) == (3, 2)
    table = result.to_dataframe("campaigns")
    assert list(table.error.notna()) == [True, False, True]
    assert table.verdict.dropna().tolist() == ["nothing_found"]
    assert result.to_dataframe("findings").empty and list(result.to_dataframe("calibration").columns)


def test_what_is_there_is_not_diagnosed_again(result, folders):
    before = {f: f.stat().st_mtime_ns for f in (result.out / "diagnoses").glob("*.json")}
    again = mjsim.run_fleet([folders / "hall"], result.out, as_is=True)
    assert (again.diagnosed, again.failed) == (1, 1)  # the one that had failed
    kept = {f for f, t in before.items() if f.stat().st_mtime_ns == t}
    assert any(json.loads(f.read_text())["error"] is None for f in kept)


def test_a_campaign_that_takes_too_long_is_given_up(folders, tmp_path):
    result = mjsim.run_fleet(folders / "hall" / "one", tmp_path, time_limit=0.05)
    assert [row["error"] for row in result.campaigns] == ["stopped after 0.05 s, the limit for one campaign"]


def test_a_fleet_that_is_stopped_ends_its_processes(folders, tmp_path):
    """What was being diagnosed leaves no row behind."""

    def stop(stage, done, total):
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        mjsim.run_fleet([folders / "hall" / "two", folders / "hall" / "one"], tmp_path, progress=stop)
    assert len(list((tmp_path / "diagnoses").glob("*.json"))) == 1
    locked(tmp_path, "mjsim fleet").release()


def test_a_folder_in_use_is_refused(result, folders):
    lock = locked(result.out, "mjsim fleet")
    with pytest.raises(InputError, match="another mjsim fleet is writing there"):
        mjsim.run_fleet([folders / "hall"], result.out)
    lock.release()
    locked(result.out, "mjsim fleet").release()


class _Worker(Executor):
    """A cluster that does the work at once, and loses the worker that gets a fatal campaign."""

    def submit(self, work, files, options):
        assert work is diagnosed_elsewhere and all(isinstance(b, bytes) for b in files.values())
        done = Future()
        if b"fatal" in files["machine.toml"]:
            done.set_exception(ZeroDivisionError("lost"))
        else:
            done.set_result(campaign("2026-06-01", 0.0006))
        return done


def test_on_a_cluster_a_lost_worker_is_a_row(folders, tmp_path, monkeypatch):
    """Without a cluster: campaigns travel as bytes, and whatever the cluster raises becomes a row."""
    crew = nullcontext(Crew(_Worker(), lambda: 1, is_cluster=True))
    monkeypatch.setattr(fleet, "crew_of", lambda here, count, scheduler: crew)
    both = [folders / "hall" / "one", folders / "fatal"]
    one, fatal = mjsim.run_fleet(both, tmp_path, scheduler="tcp://here:1").campaigns
    assert one["error"] is None and one["folder"] == str(folders / "hall" / "one")
    assert fatal["campaign"] == "fatal"
    assert fatal["error"] == "the cluster gave it back: ZeroDivisionError: lost; run the same command to go on"


def test_a_campaign_elsewhere_gives_the_same(result, folders):
    here = next(c for c in result.campaigns if c["folder"].endswith("one"))
    there = diagnosed_elsewhere(files_of(folders / "hall" / "one"), Options(as_is=True))
    same = ("campaign", "machine", "verdict", "rms_before_um", "noise_um", "findings", "calibration")
    assert {k: here[k] for k in same} == {k: there[k] for k in same}


def test_a_missing_campaign_is_a_row(tmp_path):
    row = diagnosed(tmp_path / "none", Options())
    assert "campaign.toml" in row["error"] and row["campaign"] == "none"


# -- page and tables ---------------------------------------------------------------------------------------------------


def campaign(date, width, limit=0.0008, machine="M1", verdict="identified"):
    size = {"effect": "backlash.A", "title": "Backlash", "number": "width_deg", "unit": "°"}
    ends = {"value": width, "low": width - 1e-5, "high": width + 1e-5, "expected": 0.0, "limit": limit}
    mine = {**size, **ends}
    beyond = width > limit
    return {
        "folder": f"/x/{date}", "campaign": f"of {date}", "machine": machine, "configuration": "c", "date": date,
        "tests": 5, "verdict": verdict, "noise_um": 0.1, "rms_before_um": 1.0, "rms_after_um": 0.12,
        "unexplained": None, "error": None, "seconds": 9.0,
        "findings": [{**mine, "share": 0.8, "alternatives": ["servo_delay.A", "x"]}] if beyond else [],
        "calibration": []
        if beyond
        else [{**mine, "used_percent": 100 * width / limit, "observable": True, "rms_um": 0.3}],
    }  # fmt: skip


def test_the_page_shows_each_machine_over_time():
    rows = [campaign("2026-06-01", 0.0024), campaign("2026-03-01", 0.0006, verdict="nothing_found")]
    other = campaign("2026-01-01", 0.0003, machine="M2", verdict="nothing_found")
    data = fleet_page.content([other, *rows])
    assert [m["name"] for m in data["machines"]] == ["M1", "M2"]  # the one with a finding first
    first, last = data["machines"][0]["campaigns"]
    assert first["date"] < last["date"]
    (series,) = data["machines"][0]["series"]
    assert series["verdict"] == "grew" and series["change"] == pytest.approx(0.0018)
    assert [p["finding"] for p in series["points"]] == [False, True]
    assert series["points"][0]["y"] > series["points"][1]["y"]  # larger is higher
    assert data["frequent"] == [{"effect": "backlash.A", "title": "Backlash", "campaigns": 1, "machines": 1}]
    text = html.unescape(_plain(fleet_page.render([other, *rows])))
    assert "Fleet of 2 machines" in text and "grew by 0.001800 °" in text and "limit ±0.0008" in text
    assert "backlash.A width_deg 0.002400 [0.002390, 0.002410] °, 80 %" in text


def test_the_page_loads_nothing_and_escapes_names():
    row = campaign("2026-06-01", 0.0024, machine=HOSTILE)
    row |= {"campaign": HOSTILE, "folder": HOSTILE}
    failed = {"folder": HOSTILE, "campaign": HOSTILE, "machine": "", "error": HOSTILE}
    text = fleet_page.render([row, {**row, "date": "2026-07-01"}, failed])
    checker = _Checker()
    checker.feed(text)
    assert checker.open == [] and "<script src" not in text and "&lt;script src" in text
    assert all(link.startswith(("data:", "#")) for link in checker.links)


def test_tables_have_a_row_for_each_number(tmp_path):
    rows = [campaign("2026-06-01", 0.0024), campaign("2026-03-01", 0.0006)]
    rows.append({"folder": "/x", "campaign": "broken", "machine": "", "error": "why", "seconds": None})
    files = fleet.write_tables(tmp_path, rows)
    campaigns, findings, calibration = (pd.read_parquet(f) for f in files)
    assert campaigns.error.tolist()[2] == "why" and len(campaigns) == 3
    assert findings.alternatives.tolist() == ["servo_delay.A, x"] and findings.share.tolist() == [0.8]
    assert calibration.used_percent.tolist() == pytest.approx([75.0])
    for file, name in zip(files, fleet.TABLES, strict=True):
        import pyarrow.parquet as pq

        schema = pq.read_schema(file)
        assert schema.names == list(fleet.TABLES[name])
        assert all(schema.field(n).metadata[b"meaning"] for n in schema.names)


# -- command -----------------------------------------------------------------------------------------------------------


def test_the_command(folders, result):
    data = as_json("fleet", folders / "hall" / "one", "--out", result.out, "--as-is")
    assert (data["campaigns"], data["diagnosed"], data["failed"]) == (1, 0, 0)
    assert data["results"][0]["verdict"] == "nothing_found"
    assert data["files"][-1].endswith("fleet.html")


def test_where_nothing_could_be_diagnosed_the_command_says_so(folders, tmp_path):
    done = run("fleet", folders / "hall" / "two", "--out", tmp_path / "out")
    assert done.exit_code == 1 and "no campaign could be diagnosed" in done.stderr
    assert "diagnosed in" not in done.stdout and "Verdicts" not in done.stdout
    assert "the key 'test' is missing" in done.stdout.replace("\n  ", " ")


def test_what_is_no_fleet_is_refused(tmp_path):
    refused(tmp_path, ["fleet", tmp_path / "none", "--out", tmp_path / "out"], "no such folder")
