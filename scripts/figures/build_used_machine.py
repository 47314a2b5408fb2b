"""Pictures of docs/used-machine.md, from the real commands: docs/images/used-*.png; prints what the page quotes.

Run it with the project's Python. Needs Chromium.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from base64 import b64decode
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from benchmark_diagnosis import removed
from playwright.sync_api import Page, sync_playwright

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.io.resources import examples

IMAGES = Path(__file__).resolve().parents[2] / "docs" / "images"
EXAMPLE, SHOWN = "used-machine", "squareness.XY"
#: Width of the report's page, pixels, and rows of the table that are shown.
WIDTH, ROWS = 1120, 16
_START = "from mjsim.cli.main import main; main()"


def main() -> None:
    """Write all pictures and print the numbers."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(shutil.copytree(examples() / EXAMPLE, Path(scratch) / EXAMPLE))
        fitted, report = folder / "fitted.toml", folder / "report.html"
        mjsim("diagnose", folder, "--write", fitted)
        mjsim("explain", folder, SHOWN)
        mjsim("report", folder, "-o", report)
        shutil.copy(folder / ".mjsim" / f"explain-{SHOWN}.png", IMAGES / "used-explain.png")
        of_report(report)
        machine = read_machine(fitted)
        error, share = removed(folder / "heldout", machine)
        left = error * (1.0 - share) ** 0.5
        tests = len(read_campaign(folder / "heldout").tests)
        print(f"{tests} tests that are not in the campaign: {left:.2f} µm left of {error:.2f}, {share:.2%} removed")


def mjsim(*arguments: str | Path) -> None:
    """Run one command and show what it prints."""
    command = [str(a) for a in arguments]
    print("$ mjsim", *command, flush=True)
    subprocess.run([sys.executable, "-c", _START, *command], check=True)


def of_report(report: Path) -> None:
    """The waterfall and the top of the calibration table."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page: Page = browser.new_page(viewport={"width": WIDTH, "height": 900})
        page.goto(report.as_uri())
        source = page.locator("#causes ~ figure img").first.get_attribute("src") or ""
        (IMAGES / "used-causes.png").write_bytes(b64decode(source.partition("base64,")[2]))
        words = page.get_by_text("Observed with these tests").bounding_box()
        last = page.locator("#calibration ~ div.wide").first.locator("tbody tr").nth(ROWS - 1).bounding_box()
        assert words is not None and last is not None
        top, bottom = words["y"] - 4, last["y"] + last["height"]
        clip = {"x": last["x"] - 8, "y": top, "width": last["width"] + 16, "height": bottom - top}
        page.screenshot(path=IMAGES / "used-calibration.png", clip=clip, full_page=True)
        browser.close()


if __name__ == "__main__":
    main()
