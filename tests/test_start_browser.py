"""The start page in a headless browser, from the empty page to the finding and the report; no file is edited. Skipped
where there is no Chromium.
"""

from importlib.util import find_spec

import pytest
import tomlkit
from commands import cut
from independent import r_test
from test_report_browser import BROWSER, FLAGS
from test_workbench_browser import Page, opened
from test_workbench_logs import write as write_log

from mjsim.campaign.files import read_campaign
from mjsim.io.resources import examples

playwright = pytest.importorskip("playwright.sync_api", reason="without playwright")
pytestmark = [
    pytest.mark.skipif(find_spec("nicegui") is None, reason="without the extra workbench"),
    pytest.mark.slow,
    pytest.mark.usefixtures("shared_results"),
    pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine: the start page is not opened"),
]
DIAGNOSED = ("cone15-centre-ccw", "cone15-centre-cw", "cone45-centre-ccw")  # paths that no sense of an axis changes


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as p:
        chromium = p.chromium.launch(executable_path=BROWSER, args=[*FLAGS, "--enable-unsafe-swiftshader"])
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def address():
    """The start page of one server, for all tests."""
    with opened() as (_, address):
        yield address


def begin(tab, layout):
    """From the empty start page to a chosen template."""
    tab.page.get_by_role("button", name="new campaign").click()
    tab.page.get_by_label(layout, exact=True).click()
    tab.page.get_by_text("believed within a factor").wait_for()


def drop(tab, *files):
    tab.page.locator("input[type=file]").set_input_files(list(map(str, files)))


def entry(tab, name):
    """The entry of a dropped file."""
    return tab.page.locator(f"[data-file='{name}']")


def test_a_recording_of_an_r_test(browser, address, tmp_path):
    place = {"kind": "r_test", "sphere_mm": [110.0, 20.0, 90.0], "setup": "sphere", "feed_mm_min": 4000.0}
    turn = {"name": "c-ccw", **place, "axis": "C", "from_deg": 0.0, "to_deg": 200.0, "trace": "traces/c-ccw.csv"}
    r_test.write(tmp_path, 5, tests=[turn])
    tab = Page(browser, address)
    tab.page.get_by_role("button", name="new campaign").click()
    drop(tab, tmp_path / "machine.toml")
    tab.page.get_by_text("the machine is M1").wait_for()
    tab.page.get_by_label("an R-test").click()
    tab.page.get_by_text("Drop recordings named as their tests").wait_for()
    drop(tab, tmp_path / "campaign.toml")
    tab.page.get_by_text("1 tests. Drop their traces.").wait_for()
    drop(tab, tmp_path / "traces" / "c-ccw.csv")
    entry(tab, "c-ccw.csv").locator("svg.preview").wait_for()
    tab.page.get_by_text("check: no mistake found").wait_for()


def test_from_the_empty_page_to_the_finding_and_the_report(browser, address, tmp_path):
    """A template and an example's files: two traces of tests that a campaign.toml describes, one by its form."""
    source, target = cut(tmp_path / "given", DIAGNOSED[:2]), tmp_path / "mine"
    given = source / "campaign.toml"
    tab = Page(browser, address)
    begin(tab, "trunnion-a")
    tab.page.get_by_label("A: turns of the motor per turn").fill("60")
    tab.page.keyboard.press("Tab")
    drop(tab, given)
    tab.page.get_by_text("2 tests. Drop their traces.").wait_for()
    drop(tab, *(source / "traces" / f"{name}.csv.gz" for name in DIAGNOSED[:2]))
    for name in DIAGNOSED[:2]:
        entry(tab, f"{name}.csv.gz").locator("svg.preview").wait_for()
    drop(tab, examples() / "hidden-backlash" / "traces" / f"{DIAGNOSED[2]}.csv.gz")
    form = entry(tab, f"{DIAGNOSED[2]}.csv.gz")
    form.get_by_label("half apex, °").fill("45")
    form.get_by_label("Table ball X, mm").fill("0")
    form.get_by_label("inclination, °").fill("30")
    form.get_by_label(f"use {DIAGNOSED[2]}.csv.gz").click()
    form.locator("svg.preview").wait_for()
    tab.page.get_by_text("check: no mistake found").wait_for()
    assert not target.exists()
    tab.page.get_by_label("New folder").fill(str(target))
    tab.page.get_by_role("button", name="write and open").click()
    tab.page.locator(".chip", has_text="multibody").wait_for()
    tab.button("diagnose").click()
    tab.page.locator(".card .head", has_text="backlash.A: width 0.00").wait_for()
    tab.page.locator(".card button", has_text="add").first.click()
    with tab.page.expect_download() as download:
        tab.button("report").click()
    report = tmp_path / "report.html"
    download.value.save_as(report)
    assert "backlash.A" in report.read_text(encoding="utf-8")
    campaign = read_campaign(target)
    assert {t.name for t in campaign.measured} == set(DIAGNOSED)
    tab.close()


def test_logs_from_the_empty_page_to_the_finding_and_the_report(browser, address, tmp_path):
    """Recordings of an axis: the control is the instrument; the machine file of the user is dropped."""
    source, target = write_log(tmp_path), tmp_path / "mine"
    tab = Page(browser, address)
    begin(tab, "three-axes")
    tab.page.get_by_text("the control (axis logs)").click()
    tab.page.get_by_text("Drop recordings").wait_for()
    drop(tab, source / "machine.toml")
    tab.page.get_by_text("machine.toml: the machine is").wait_for()
    drop(tab, source / "strokes.csv")
    entry(tab, "strokes.csv").locator("svg.preview").wait_for()
    assert "X command in mm" in entry(tab, "strokes.csv").text_content()
    tab.page.get_by_label("New folder").fill(str(target))
    tab.page.get_by_role("button", name="write and open").click()
    tab.wait_for_error(5.0, 20.0, "drives alone")
    tab.button("diagnose").click()
    tab.page.locator(".card .head", has_text="torque_ripple.X: amplitude").wait_for()
    tab.page.locator(".card button", has_text="add").first.click()
    with tab.page.expect_download() as download:
        tab.button("report").click()
    download.value.save_as(tmp_path / "report.html")
    assert "torque_ripple.X" in (tmp_path / "report.html").read_text(encoding="utf-8")
    tab.close()


def test_a_plan_its_programs_and_its_traces_later(browser, address, tmp_path):
    """Ten minutes on a machine of three axes: told what they tell, NC programs, a folder; traces are dropped later."""
    target = tmp_path / "planned"
    tab = Page(browser, address)
    begin(tab, "three-axes")
    tab.page.get_by_role("button", name="10 minutes").click()
    tab.page.get_by_text("Tells from everything else").wait_for()
    tab.page.get_by_role("button", name="take over these tests").click()
    tab.page.get_by_text("Tests without a trace:").wait_for()
    with tab.page.expect_download() as download:
        tab.page.get_by_role("button", name="NC programs").click()
    assert download.value.suggested_filename == "programs.zip"
    tab.page.get_by_label("New folder").fill(str(target))
    tab.page.get_by_role("button", name="write, measure later").click()
    tab.page.get_by_text(f"Traces of {target}").wait_for()
    tests = [str(t["name"]) for t in tomlkit.parse((target / "campaign.toml").read_text(encoding="utf-8"))["test"]]
    assert len(tests) == 3 and "circle-xy-ccw" in tests
    drop(tab, examples() / "healthy" / "traces" / "circle-xy-ccw.csv.gz")
    entry(tab, "circle-xy-ccw.csv.gz").locator("svg.preview").wait_for()
    assert [t.name for t in read_campaign(target).measured] == ["circle-xy-ccw"]
    tab.close()


def test_what_is_wrong_is_one_sentence_and_nothing_is_written(browser, address, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)))
    (tmp_path / "table.csv").write_text("a;b\n1;2\n")
    tab = Page(browser, address)
    tab.page.get_by_role("button", name="new campaign").click()
    drop(tab, tmp_path / "table.csv")
    tab.page.get_by_text("No machine is chosen yet; choose one first.").wait_for()
    tab.page.get_by_label("three-axes", exact=True).click()
    tab.page.get_by_text("believed within a factor").wait_for()
    drop(tab, tmp_path / "picture.png")
    tab.page.locator(".problem", has_text="picture.png").wait_for()
    tab.page.get_by_label("Position gain, as set in the control").fill("100000")
    tab.page.keyboard.press("Tab")
    tab.page.locator(".problem", has_text="position gain 100000; allowed: 1 to 1000 1/s").wait_for()
    tab.page.get_by_role("button", name="write and open").click()
    tab.page.locator(".problem", has_text="has no test yet").wait_for()
    tab.page.get_by_role("button", name="10 minutes").click()
    tab.page.get_by_role("button", name="take over these tests").click()
    tab.page.get_by_text("Tests without a trace:").wait_for()
    tab.page.get_by_label("New folder").fill(str(tmp_path / "full"))
    tab.page.get_by_role("button", name="write and open").click()
    tab.page.locator(".problem", has_text="is not empty, it holds 'mine.txt'").wait_for()
    assert [p.name for p in (tmp_path / "full").iterdir()] == ["mine.txt"]
    tab.close()
