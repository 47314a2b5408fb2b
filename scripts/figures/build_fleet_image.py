"""The picture of docs/fleet.md: one machine in two campaigns, between which its A axis wore, and a campaign that cannot
be read. The independent generator measures it.

Run it with the project's Python. Needs Chromium. Same code, same picture.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

import numpy as np
from independent import real_machines
from independent.campaign import Case, write_files
from independent.layouts import layout
from playwright.sync_api import sync_playwright

import mjsim

IMAGE = Path(__file__).resolve().parents[2] / "docs" / "images" / "fleet.png"
#: Folder of each campaign, its day and what hides in it.
CAMPAIGNS = (
    ("march", "2026-03-01", ()),
    ("june", "2026-06-01", ({"id": "backlash.A", "width_deg": 0.0024},)),
)
#: The folder that the page shows: campaigns lie in a scratch folder, whose name differs each time.
SHOWN = "/hall"


def main() -> None:
    """Measure, diagnose, and take the picture."""
    with tempfile.TemporaryDirectory() as scratch:
        hall, out = Path(scratch).resolve() / "hall", Path(scratch) / "fleet"
        small = tuple(real_machines.within("M1", np.random.default_rng(7)))
        for name, day, hidden in CAMPAIGNS:
            case = Case(name, "M1", tuple(layout("short"))[:5], hidden, seed=7, within=small, tolerance_stated=True)
            write_files(case, hall / "m1" / name)
            file = hall / "m1" / name / "campaign.toml"
            file.write_text(f"measured_on = {day}\n{file.read_text()}")
        (hall / "broken").mkdir()
        (hall / "broken" / "campaign.toml").write_text('name = "broken"\n')
        mjsim.run_fleet([hall], out)
        page = out / "fleet.html"
        page.write_text(page.read_text().replace(str(hall), SHOWN))
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
            tab = browser.new_page(viewport={"width": 1280, "height": 900})
            tab.goto(page.as_uri())
            tab.locator("details").evaluate_all("all => all.forEach(d => d.open = true)")
            tab.screenshot(path=IMAGE, full_page=True)
            browser.close()


if __name__ == "__main__":
    main()
