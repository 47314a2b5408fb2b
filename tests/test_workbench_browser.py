"""The workbench in a headless browser: the mission, two tabs, a lost connection, campaigns with mistakes or traces
missing. Skipped where there is no Chromium.
"""

import gzip
import json
import os
import re
import signal
import subprocess
import sys
from contextlib import contextmanager
from importlib.util import find_spec

import pytest
import tomlkit
from commands import TESTS, cut, refused
from test_report_browser import BROWSER, FLAGS
from test_workbench_logs import write as write_log

playwright = pytest.importorskip("playwright.sync_api", reason="without playwright")
pytestmark = [
    pytest.mark.skipif(find_spec("nicegui") is None, reason="without the extra workbench"),
    pytest.mark.slow,
    pytest.mark.usefixtures("shared_results"),
    pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine: the workbench is not opened in a browser"),
]
START = "from mjsim.cli.main import main; main()"
#: Without a graphics card every picture of the machine is drawn by the processor: a few a second are enough here.
SELDOM = "const soon = requestAnimationFrame; requestAnimationFrame = f => setTimeout(() => soon(f), 200)"
#: Patience for one thing to appear on the page, ms; the machine may be busy.
PATIENCE = 240_000


@contextmanager
def opened(*arguments):
    """A running ``mjsim open``: its process and its address."""
    command = [sys.executable, "-c", START, "open", *map(str, arguments), "--no-browser", "--json"]
    # NiceGUI behaves otherwise where it finds itself in a test
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=environment) as process:
        text = ""
        while "}" not in text:
            line = process.stdout.readline()
            assert line, process.stderr.read()
            text += line
        try:
            yield process, json.loads(text)["address"]
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(20)
            finally:
                process.kill()


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as p:
        chromium = p.chromium.launch(executable_path=BROWSER, args=[*FLAGS, "--enable-unsafe-swiftshader"])
        yield chromium
        chromium.close()


class Page:
    """One tab that keeps requests to other hosts and errors."""

    def __init__(self, browser, address):
        self.faults = []
        self.page = browser.new_page(viewport={"width": 1280, "height": 800})
        self.page.set_default_timeout(PATIENCE)
        self.page.add_init_script(SELDOM)
        self.page.on("pageerror", lambda e: self.faults.append(str(e)))
        local = ("http://127.0.0.1:", "ws://127.0.0.1:", "data:", "blob:")
        self.page.on("request", lambda r: r.url.startswith(local) or self.faults.append(r.url))
        self.page.goto(address)

    def rms(self):
        """The error that the page shows, µm."""
        return float(re.match(r"[\d.]+", self.page.locator(".error-now .value").text_content())[0])

    def wait_for_error(self, low, high, engine="multibody"):
        """Wait until the page shows an error (µm) between two limits, simulated by an engine."""
        self.page.wait_for_function(
            "([low, high, engine]) => { const v = parseFloat(document.querySelector('.error-now .value')?.textContent);"
            " return v > low && v < high && document.querySelector('.chip').textContent == engine }",
            arg=[low, high, engine],
        )

    def button(self, name):
        return self.page.locator(f"button[aria-label='{name}']")

    def ladder(self):
        return self.page.locator(".rung .label").all_text_contents()

    def close(self):
        assert self.faults == []
        self.page.close()


def test_the_mission(browser, tmp_path):
    """See the jump, diagnose, add, undo, redo, save; the file and the history have it, and a second tab its own
    state.
    """
    campaign = cut(tmp_path / "hidden")
    given = (campaign / "machine.toml").read_text()
    with opened(campaign) as (process, address):
        one = Page(browser, address)
        one.wait_for_error(0.5, 5.0)
        before = one.rms()
        drawn = one.page.locator("svg.polar path.simulated").first.get_attribute("d")
        one.button("diagnose").click()
        one.page.locator(".card .head", has_text="backlash.A: width 0.002").wait_for()
        other = Page(browser, address)  # another tab begins with the file's model
        other.wait_for_error(before - 0.001, before + 0.001)
        one.page.get_by_text("show it in the traces").click()
        one.page.get_by_text("residual with backlash.A").wait_for(state="attached")
        one.page.locator(".card button", has_text="add").click()
        one.wait_for_error(0.05, 0.2)
        assert one.page.locator("svg.polar path.simulated").first.get_attribute("d") != drawn
        assert one.ladder() == ["+ backlash.A", "machine as given"]
        one.page.keyboard.press("Control+z")
        one.wait_for_error(before - 0.001, before + 0.001)
        one.page.keyboard.press("Control+y")
        one.wait_for_error(0.05, 0.2)
        assert other.rms() == before and other.ladder() == ["machine as given"]
        assert (campaign / "machine.toml").read_text() == given and not (campaign / ".mjsim").exists()
        one.page.reload()  # the tab keeps its state
        one.wait_for_error(0.05, 0.2)
        one.button("save").click()
        one.page.locator(".q-dialog button", has_text="save").click()
        one.page.get_by_text("machine.toml has + backlash.A").wait_for()
        effects = tomlkit.parse((campaign / "machine.toml").read_text())["effect"]
        assert effects[-1]["id"] == "backlash.A" and abs(effects[-1]["width_deg"] - 0.002) < 4e-5
        steps = json.loads((campaign / ".mjsim" / "history.json").read_text())["steps"]
        assert [(s["action"], s["effect"]) for s in steps] == [("start", ""), ("add", "backlash.A")]
        one.close()
        other.close()
    assert process.returncode in (0, 130, -signal.SIGINT)


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """A server of a campaign without traces."""
    with opened(cut(tmp_path_factory.mktemp("open") / "planned", TESTS[:2], traces=False)) as running:
        yield running


def test_without_traces_and_by_keyboard(browser, planned):
    tab = Page(browser, planned[1])
    tab.page.locator(".chip", has_text="multibody").wait_for()
    assert tab.page.get_by_text("nothing was measured").count() == 2
    polar = tab.page.locator("svg.polar").first
    still = polar.inner_html()
    tab.page.get_by_placeholder("filter").fill("scale")
    tab.page.locator("[data-effect='scale_error.X']").click()
    switch = tab.page.get_by_label("In the model")
    switch.focus()
    tab.page.keyboard.press("Space")
    slider = tab.page.locator(".detail .q-slider [tabindex='0']").first
    slider.focus()
    tab.page.keyboard.press("PageUp")
    tab.page.wait_for_function("was => document.querySelector('svg.polar').innerHTML != was", arg=still)
    assert tab.ladder()[-1] == "machine as given" and "+ scale_error.X" in tab.ladder()
    assert tab.button("save").is_disabled()
    tab.page.get_by_placeholder("filter").focus()
    tab.page.keyboard.press("Tab")
    tab.page.evaluate("document.activeElement.blur()")
    tab.page.keyboard.press("w")  # the part: a dialog whose button has the focus
    tab.page.locator(".part-ask").wait_for()
    tab.page.wait_for_function("document.activeElement.textContent.includes('predict')")
    tab.page.keyboard.press("Enter")
    tab.page.locator(".part-table").first.wait_for()
    assert "Largest deviation" in tab.page.locator(".part-dialog").text_content()
    tab.page.keyboard.press("Escape")
    tab.page.locator(".part-ask").wait_for(state="detached")
    tab.close()


def test_a_lost_connection_keeps_the_state(browser, planned):
    tab = Page(browser, planned[1])
    tab.page.locator(".chip", has_text="multibody").wait_for()
    tab.page.context.set_offline(True)
    tab.page.evaluate("window.socket.disconnect()")
    tab.page.context.set_offline(False)
    tab.page.evaluate("window.socket.connect()")
    tab.page.locator(".chip", has_text="multibody").wait_for()
    tab.page.locator(f"button.small-one[title='{TESTS[1]}']").click()
    tab.page.wait_for_function(
        "name => document.querySelector('svg.polar').getAttribute('aria-label').startsWith(name)", arg=TESTS[1]
    )
    tab.close()


def test_a_campaign_with_mistakes_shows_the_sentence(browser, tmp_path):
    campaign = cut(tmp_path / "turned", TESTS[:2])
    file = campaign / "traces" / f"{TESTS[0]}.csv.gz"
    head, *rows = gzip.decompress(file.read_bytes()).decode().splitlines()
    turned = [f"{time},{-float(value)}" for time, value in (row.split(",") for row in rows)]
    file.write_bytes(gzip.compress("\n".join([head, *turned]).encode()))
    with opened(campaign) as (_, address):
        tab = Page(browser, address)
        said = tab.page.locator(".sentence", has_text="campaign.toml:").text_content()
        assert "mjsim check" in said and "the sign is the other way round" in said
        tab.close()


def test_a_log(browser, tmp_path):
    """Diagnose a campaign of axis logs, look at a cause, add it; the error falls to the noise."""
    with opened(write_log(tmp_path)) as (_, address):
        tab = Page(browser, address)
        tab.wait_for_error(5.0, 20.0, "drives alone")
        bar = "document.querySelector(\"[data-effect='torque_ripple.X'] .percent\")?.textContent"
        tab.page.wait_for_function(f"parseInt({bar}) > 90")
        tab.page.keyboard.press("d")
        tab.page.locator(".card .head", has_text="torque_ripple.X: amplitude 0.03").wait_for()
        tab.page.get_by_text("show it in the traces").click()
        tab.page.locator(".card button", has_text="add").focus()
        tab.page.keyboard.press("Enter")
        tab.wait_for_error(0.01, 0.1, "drives alone")
        assert tab.ladder() == ["+ torque_ripple.X", "machine as given"]
        tab.page.keyboard.press("Control+z")  # while a button has the focus
        tab.wait_for_error(5.0, 20.0, "drives alone")
        tab.page.keyboard.press("Control+y")
        tab.wait_for_error(0.01, 0.1, "drives alone")
        tab.page.keyboard.press("s")
        tab.page.wait_for_function("document.activeElement.closest('.q-dialog')")
        tab.page.keyboard.press("Enter")
        tab.page.get_by_text("machine.toml has + torque_ripple.X").wait_for()
        tab.close()


def test_another_token_has_no_page(browser, planned):
    response = browser.new_page().goto(planned[1][:-3] + "abc")
    assert response.status == 404


def test_what_cannot_be_read_is_one_sentence_before_the_server(tmp_path):
    refused(tmp_path, ["open", tmp_path, "--no-browser"], "campaign.toml")
