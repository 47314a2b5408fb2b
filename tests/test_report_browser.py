"""The report in headless Chromium: loads nothing, its controls work, it prints figures, and what it says is what
the JSON says.
"""

import json
import shutil
from datetime import date
from pathlib import Path

import pytest
import tomlkit
from click.testing import CliRunner

from mjsim.cli.main import main
from mjsim.io.resources import examples

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
BROWSER = next((p for p in map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome")) if p), None)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.usefixtures("shared_results"),
    pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine: the report is not opened in a browser"),
]
FLAGS = (
    "--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
).split()
TESTS = ("cone45-centre-ccw", "rotary-a-tangential-ccw")
HOSTILE = "</script><img src=x onerror=\"document.title='taken'\"> & <b>shop</b>"


def cut(target, name=HOSTILE, day=None):
    """A campaign with two tests of the hidden-backlash example, its names full of markup."""
    source = examples() / "hidden-backlash"
    (target / "traces").mkdir(parents=True)
    document = tomlkit.parse((source / "campaign.toml").read_text())
    document["name"] = name
    if day is not None:
        document["measured_on"] = day
    for i in reversed(range(len(document["test"]))):
        if document["test"][i]["name"] not in TESTS:
            del document["test"][i]
        else:
            document["test"][i]["setup"] = HOSTILE
    (target / "campaign.toml").write_text(tomlkit.dumps(document))
    for name in TESTS:
        shutil.copy(source / "traces" / f"{name}.csv.gz", target / "traces")
    machine = tomlkit.parse((source / "machine.toml").read_text())
    machine["name"] = HOSTILE
    (target / "machine.toml").write_text(tomlkit.dumps(machine))
    return target


def command(*args):
    """Run a command of mjsim; its JSON."""
    done = CliRunner().invoke(main, [*map(str, args), "--json", "--quiet"])
    assert (done.exit_code, done.stderr) == (0, ""), done.output
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def made(tmp_path_factory, shared_results):
    """Page and JSON of `mjsim report`, JSON of `mjsim diagnose`."""
    folder = tmp_path_factory.mktemp("report")
    campaign = cut(folder / "short")
    before = sorted(p.name for p in campaign.rglob("*"))
    data = command("report", campaign, "-o", folder / "page.html")
    assert sorted(p.name for p in campaign.rglob("*")) == before  # nothing of the user's is touched
    return folder / "page.html", data, command("diagnose", campaign)


class Watched:
    """A page that keeps every request, console message and dialog."""

    def __init__(self, browser, path, **viewport):
        self.requests, self.messages = [], []
        self.page = browser.new_page(**viewport)
        self.page.on("request", lambda r: self.requests.append(r.url))
        self.page.on("console", lambda m: self.messages.append((m.type, m.text)))
        self.page.on("pageerror", lambda e: self.messages.append(("error", str(e))))
        self.page.on("dialog", lambda d: (self.messages.append(("dialog", d.message)), d.dismiss()))
        self.page.goto(Path(path).as_uri())
        self.path = path

    def check(self):
        """No request but for the file itself, no error, no warning."""
        assert [r for r in self.requests if not r.startswith(("data:", "blob:"))] == [Path(self.path).as_uri()]
        assert self.messages == []


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as p:
        chromium = p.chromium.launch(executable_path=BROWSER, args=FLAGS)
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def watched(browser, made):
    w = Watched(browser, made[0], viewport={"width": 1280, "height": 900})
    w.page.locator("#cards .card").first.scroll_into_view_if_needed()
    w.page.wait_for_selector(".card .polar path[data-name]")
    yield w
    w.check()
    w.page.close()


def value(data, pointer):
    for key in pointer.split("/")[1:]:
        data = data[int(key)] if isinstance(data, list) else data[key]
    return data


def number(text):
    return float(text.replace("−", "-").replace(" µm", ""))


def test_numbers_on_the_page_are_those_of_the_json(watched, made):
    _, data, diagnosed = made
    page = watched.page
    assert json.loads(page.evaluate("document.getElementById('mjsim-numbers').textContent")) == data
    assert data["diagnosis"] == diagnosed
    shown = page.evaluate("[...document.querySelectorAll('[data-json]')].map(e => [e.dataset.json, e.textContent])")
    assert len(shown) > 60
    for pointer, text in shown:
        there = value(data, pointer)
        decimals = len(text.partition(".")[2])
        assert number(text) == pytest.approx(there, abs=0.5001 * 10.0**-decimals), pointer
    models, found = data["models"], diagnosed["effects"]
    assert [f["effect_id"] for f in data["findings"]] == [e["id"] for e in found] == ["backlash.A"]
    for row, effect in zip(data["findings"], found, strict=True):
        assert (row["rms_before_um"], row["rms_after_um"]) == (effect["rms_before_um"], effect["rms_after_um"])
        assert row["parameters"][0]["value"] == pytest.approx(effect["parameters"]["width_deg"], rel=1e-5)
    assert (models[data["start"]]["rms_um"], models[-1]["rms_um"]) == (
        diagnosed["rms_before_um"],
        diagnosed["rms_after_um"],
    )
    assert [m["label"] for m in models] == [
        "rigid kinematics", "+ drives", "machine as given", "+ backlash.A", "data sheet calibrated",
    ]  # fmt: skip
    assert models[-1]["rms_um"] < 0.3 * models[data["start"]]["rms_um"]
    assert [x["effect_id"] for x in data["not_testable"]] == diagnosed["not_testable"]
    assert data["noise_um"] == diagnosed["noise_um"]


def test_the_best_repair_is_the_hidden_backlash(made):
    what_if = made[1]["what_if"]
    rows = what_if["rows"]
    assert rows[0]["cause"] == "backlash.A" and rows[0]["how"] == "full simulation" and rows[0]["kind"] == "adjust"
    assert [r["gain_um"] for r in rows] == sorted((r["gain_um"] for r in rows), reverse=True)
    assert (
        rows[0]["gain_um"] == pytest.approx(what_if["rms_um"] - rows[0]["rms_um"], abs=2e-4)
        and rows[0]["gain_um"] > 0.3
    )
    assert rows[0]["gain_percent"] == pytest.approx(100.0 * rows[0]["gain_um"] / what_if["rms_um"], abs=0.06)
    assert {r["cause"]: r["kind"] for r in rows}["friction.A"] == "share"
    assert rows[0]["circle"] == TESTS[0]
    assert rows[0]["circle_um"] == pytest.approx(what_if["tests_um"][0] - rows[0]["tests_um"][0], abs=1e-3)


def test_names_of_the_user_stay_text(watched):
    page = watched.page
    assert HOSTILE in page.inner_text("h1")
    assert "taken" not in page.title().replace(HOSTILE, "")
    assert page.locator("b", has_text="shop").count() == 0 and page.locator("img[src=x]").count() == 0


def test_steps_through_the_models(watched, made):
    page, models = watched.page, made[1]["models"]
    last = len(models) - 1
    simulated = "document.querySelector('.card .polar [data-name=simulated]').getAttribute('d')"

    def at(k):
        assert page.inner_text("#model-name") == f"{k + 1} of {last + 1}: {models[k]['label']}"
        assert number(page.inner_text("#error-now")) == pytest.approx(models[k]["rms_um"], abs=0.0051)
        assert number(page.inner_text(".card p strong >> nth=0")) == pytest.approx(models[k]["tests_um"][0], abs=0.0051)
        return page.evaluate("document.getElementById('error-bar').style.width"), page.evaluate(simulated)

    traces = [at(last)]
    assert page.is_disabled("#next")
    for k in range(last - 1, -1, -1):
        page.click("#previous")
        traces.append(at(k))
    assert page.is_disabled("#previous")
    widths = [float(w.rstrip("%")) for w, _ in traces]
    assert widths[0] < widths[2] and widths[1] < widths[2]  # the bar falls when backlash is put in
    assert len({json.dumps(t) for _, t in traces}) == len(traces)  # every model draws another trace
    page.keyboard.press("ArrowRight")
    at(1)
    page.keyboard.press("ArrowLeft")
    at(0)
    page.focus("#model")
    page.keyboard.press("End")
    at(last)
    assert page.evaluate("document.querySelectorAll('#ladder-table td.now').length") == 1 + len(TESTS)


def test_tests_and_traces_can_be_toggled(watched):
    page = watched.page
    card = page.locator(f".card[data-test='{TESTS[1]}']")
    assert card.is_visible()
    page.uncheck(f"#tests-shown input[name='{TESTS[1]}']")
    assert not card.is_visible() and page.locator(".card:visible").count() == 1
    page.click("#tests-none")
    assert page.locator(".card:visible").count() == 0
    page.click("#tests-all")
    assert page.locator(".card:visible").count() == 2
    visible = "[...document.querySelectorAll('.card:first-child .polar [data-name]')].map(e => e.dataset.name)"
    page.locator(".card").first.scroll_into_view_if_needed()
    page.wait_for_selector(".card .polar path[data-name]")
    page.uncheck("#traces-shown input[name='measured']")
    assert "measured" not in page.evaluate(visible) and "simulated" in page.evaluate(visible)
    page.check("#traces-shown input[name='measured']")
    page.check("#traces-shown input[name='former']")
    assert {"measured", "simulated", "previous model"} <= set(page.evaluate(visible))
    page.uncheck("#traces-shown input[name='former']")
    marks = "[...document.querySelectorAll('.card:first-child .residual-plot [data-axis]')].map(e => e.dataset.axis)"
    assert "A" in page.evaluate(marks)
    page.uncheck("#traces-shown input[name='events']")
    assert page.evaluate(marks) == []
    page.check("#traces-shown input[name='events']")


def test_zoom_and_reset(watched):
    page = watched.page
    page.locator(".card").first.scroll_into_view_if_needed()
    trace = "document.querySelector('.card .{} path[data-name]').getAttribute('d')"
    rings = "document.querySelectorAll('.card .polar')[0].querySelectorAll('[data-ring]').length"
    division = page.locator(".card .polar .division").first
    before, polar = division.text_content(), page.evaluate(trace.format("polar"))
    page.select_option("#division", "20")
    assert division.text_content() == "1 div.: 20 µm" != before
    assert page.evaluate(rings) == 9 and page.evaluate(trace.format("polar")) != polar
    page.click("#reset")
    page.wait_for_selector(".card .polar path[data-name]")
    assert division.text_content() == before and page.evaluate(trace.format("polar")) == polar
    for plot in ("polar", "residual-plot"):
        whole = page.evaluate(trace.format(plot))
        host = page.locator(f".card .{plot}").first
        for back in (host.dblclick, lambda: page.click("#reset")):
            host.scroll_into_view_if_needed()
            box = host.bounding_box()
            page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 0.4 * box["height"])
            page.mouse.down()
            page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.6 * box["height"])
            page.mouse.up()
            assert page.evaluate(trace.format(plot)) != whole
            back()
            assert page.evaluate(trace.format(plot)) == whole


def test_hover_says_angle_deviation_positions_and_event(watched):
    page = watched.page
    plot = page.locator(".card .residual-plot").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    page.mouse.move(box["x"] + 0.52 * box["width"], box["y"] + 0.5 * box["height"])
    text = page.wait_for_selector(".residual-plot .tip").text_content()
    for said in ("°", "µm", "X ", "mm", "reverses"):
        assert said in text, text
    polar = page.locator(".card .polar").first
    polar.scroll_into_view_if_needed()
    box = polar.bounding_box()
    text = None
    for k in range(60):  # outwards along 45° until the trace is met
        away = (0.1 + 0.006 * k) * box["height"]
        page.mouse.move(box["x"] + 0.5 * box["width"] + 0.7 * away, box["y"] + 0.5 * box["height"] - 0.7 * away)
        page.wait_for_timeout(60)
        found = page.locator(".polar .tip")
        if found.count():
            text = found.first.text_content()
            break
    assert text is not None and "µm" in text and "A " in text and ("measured" in text or "simulated" in text)
    page.mouse.move(5, 5)


def test_prints_figures_instead_of_controls(browser, made):
    w = Watched(browser, made[0], viewport={"width": 680, "height": 960})
    w.page.emulate_media(media="print")
    images = w.page.locator("img")
    assert images.count() >= 2 + 3 * len(TESTS)
    assert all(images.nth(i).is_visible() for i in range(images.count()))
    assert w.page.evaluate("[...document.images].every(i => i.complete && i.naturalWidth > 100)")
    before, after = (w.page.locator(".pair figure").nth(i).bounding_box() for i in (0, 1))
    assert (
        before["y"] == after["y"] and before["x"] < after["x"]
    )  # side by side on a sheet, though that is as narrow as a phone
    for control in ("#model", "#previous", "#tests-shown", "#cards", "#ladder-plot"):
        assert not w.page.is_visible(control)
    assert w.page.evaluate("document.documentElement.scrollWidth") <= 680
    w.page.emulate_media(media="screen")
    # on the screen all but the error by cause are drawn by the page itself
    shown = [images.nth(i).get_attribute("alt") for i in range(images.count()) if images.nth(i).is_visible()]
    assert all(alt.endswith("cause by cause") for alt in shown)
    w.check()
    w.page.close()


def test_fits_a_phone_and_works_without_script(browser, made):
    w = Watched(browser, made[0], viewport={"width": 390, "height": 844})
    assert w.page.evaluate("document.documentElement.scrollWidth") == 390
    w.check()
    w.page.close()
    context = browser.new_context(java_script_enabled=False, viewport={"width": 1280, "height": 900})
    page = context.new_page()
    page.goto(made[0].as_uri())
    assert page.locator("img").first.is_visible() and page.locator("noscript").count() == 1
    assert not page.is_visible("#model")
    context.close()


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory):
    """Two dated campaigns of one machine, the later one with more backlash in its machine file, and one of another
    machine.
    """
    folder = tmp_path_factory.mktemp("trend")
    early, late, other = (cut(folder / n, n, date(2026, m, 1)) for n, m in (("early", 3), ("late", 5), ("other", 6)))
    for width, campaign in ((0.001, early), (0.002, late)):
        text = (campaign / "machine.toml").read_text()
        (campaign / "machine.toml").write_text(f'{text}\n[[effect]]\nid = "backlash.A"\nwidth_deg = {width}\n')
    (other / "machine.toml").write_text((other / "machine.toml").read_text().replace("taken", "another"))
    return early, late, other


def test_trend_of_two_campaigns(browser, campaigns, tmp_path):
    early, late, _ = campaigns
    data = command("report", late, early, "--no-diagnose", "-o", tmp_path / "trend.html")
    assert [(r["name"], r["date"]) for r in data["campaigns"]] == [("early", "2026-03-01"), ("late", "2026-05-01")]
    assert data["campaigns"][1]["rms_before_um"] < 0.5 * data["campaigns"][0]["rms_before_um"]
    by_name = {s["name"]: s for s in data["series"]}
    assert by_name["backlash.A width_deg"]["values"] == [0.001, 0.002]
    assert by_name["backlash.A width_deg"]["verdict"] == "cannot be said"  # a machine file has no intervals
    assert by_name[f"G {TESTS[0]}"]["verdict"] == "within uncertainty"  # the same trace twice
    w = Watched(browser, tmp_path / "trend.html", viewport={"width": 1280, "height": 900})
    w.page.wait_for_selector(".trend-plot path[data-name]", state="attached")
    shown = w.page.evaluate("[...document.querySelectorAll('[data-json]')].map(e => [e.dataset.json, e.textContent])")
    assert len(shown) > 20
    for pointer, text in shown:
        there = value(data, pointer)
        decimals = len(text.partition(".")[2])
        assert text == "–" if there is None else number(text) == pytest.approx(there, abs=0.5001 * 10.0**-decimals), (
            pointer
        )
    visible = "[...document.querySelectorAll('[data-group=figure] path[data-name]')].map(e => e.dataset.name)"
    before = w.page.evaluate(visible)
    w.page.uncheck(f"input[name='{before[0]}']")
    assert w.page.evaluate(visible) == before[1:]
    w.page.emulate_media(media="print")
    assert w.page.locator("img").count() == 2 and all(w.page.locator("img").nth(i).is_visible() for i in range(2))
    assert not w.page.is_visible(".trend-plot >> nth=0")
    w.check()
    w.page.close()


def test_trend_of_two_machines_is_refused_before_the_work(campaigns, tmp_path):
    early, _, other = campaigns
    done = CliRunner().invoke(main, ["report", str(early), str(other), "-o", str(tmp_path / "trend.html")])
    assert done.exit_code == 1 and done.stderr.count("\n") == 1
    assert "not of the same machine" in done.stderr and not (tmp_path / "trend.html").exists()


def test_report_without_diagnosis_and_without_force(campaigns, tmp_path):
    page, machine = tmp_path / "page.html", tmp_path / "machine.toml"
    machine.write_text(
        (campaigns[0] / "machine.toml").read_text() + '\n[[effect]]\nid = "squareness.XY"\nangle_urad = 5.0\n'
    )
    options = ("--no-diagnose", "-o", page, "--machine", machine)
    data = command("report", campaigns[0], *options)
    assert (data["verdict"], data["diagnosis"], data["findings"], data["date"]) == (None, None, [], "2026-03-01")
    assert [m["label"] for m in data["models"]] == ["rigid kinematics", "+ drives", "machine as given"]
    rows = data["what_if"]["rows"]
    assert (rows[0]["cause"], rows[-1]["cause"]) == ("backlash.A", "all repairs together")
    assert rows[-1]["gain_um"] > rows[0]["gain_um"] > 0.05 and rows[-1]["how"] == "full simulation"
    before = page.read_bytes()
    done = CliRunner().invoke(main, ["report", str(campaigns[0]), *map(str, options)])
    assert done.exit_code == 1 and "exists already" in done.stderr
    assert page.read_bytes() == before
    assert command("report", campaigns[0], *options, "--force") == data
    assert page.read_bytes() == before  # the same input gives the same page
