"""Pictures and film of the workbench for the documentation, taken from the real page in headless Chromium.

    .venv/bin/python scripts/figures/build_workbench_images.py [--film] [--all FOLDER] [--only start|log|part]

Writes docs/images/workbench-*.png and start-page.png, with --only one of them; with --film also
docs/images/workbench.gif, the mission in some 20 s. With --all the pages are also taken in other sizes and in the dark,
into a folder, to be looked at.
"""

from __future__ import annotations

import argparse
import io
import sys
import tempfile
from pathlib import Path

sys.path.extend(str(Path(__file__).resolve().parents[2] / name) for name in ("scripts/benchmarks", "tests"))

from commands import cut
from independent import logs
from PIL import Image
from workbench_page import Opened, slider_of

from mjsim.io.resources import examples

IMAGES = Path(__file__).resolve().parents[2] / "docs" / "images"
#: Size of the film, pixels, and its pictures' time, ms.
FILM, FRAME = (1024, 640), 500
#: Largest GIF, bytes.
MOST = 4_000_000


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--film", action="store_true", help="make the GIF as well")
    parser.add_argument("--all", type=Path, help="folder for pictures in other sizes and in the dark")
    parser.add_argument("--only", choices=("start", "log", "part"), help="one picture")
    options = parser.parse_args()
    pages = (
        ("start", start_page, "start-page.png"),
        ("log", log_page, "workbench-log.png"),
        ("part", part_page, "workbench-part.png"),
    )
    for name, take, picture in pages:
        if options.only in (None, name):
            take(IMAGES / picture)
            if name != "part":  # its error is told by colour
                _small(IMAGES / picture)
    if options.only:
        return 0
    mission(options.film)
    if options.all:
        options.all.mkdir(parents=True, exist_ok=True)
        for size in ((1280, 800), (1920, 1080)):
            for dark in (False, True):
                with Opened(size=size, dark=dark) as opened:
                    opened.settled()
                    slider_of(opened, "A", "backlash.A")
                    name = f"{size[0]}x{size[1]}-{'dark' if dark else 'light'}.png"
                    opened.page.screenshot(path=options.all / name)
                start_page(options.all / f"start-{name}", size, dark)
    return 0


def start_page(path: Path, size: tuple[int, int] = (1280, 800), dark: bool = False) -> None:
    """A new campaign: a plan for a machine of three axes, a trace of it, and one that does not fit."""
    with Opened(None, size, dark) as opened:
        page = opened.page
        page.get_by_role("button", name="new campaign").click()
        page.get_by_label("three-axes", exact=True).click()
        page.get_by_text("believed within a factor").wait_for()
        page.get_by_role("button", name="10 minutes").click()
        page.get_by_text("Tells from everything else").wait_for()
        page.get_by_role("button", name="take over these tests").click()
        page.get_by_text("Tests without a trace:").wait_for()
        traces = [examples() / "healthy" / "traces" / f"{n}.csv.gz" for n in ("circle-xy-ccw", "cone15-centre-ccw")]
        page.locator("input[type=file]").set_input_files(traces)
        page.locator(f"[data-file='{traces[1].name}']").wait_for()
        page.get_by_label(f"use {traces[1].name}").click()
        page.locator(".ask").first.wait_for()
        page.get_by_text("check: no mistake found").or_(page.locator(".problem", has_text="cone15")).first.wait_for()
        page.locator(".start").evaluate("e => e.scrollTop = e.scrollHeight")
        page.get_by_text("Nothing measured yet").evaluate("e => e.scrollIntoView({block: 'start'})")
        page.locator(".start").evaluate("e => e.scrollTop -= 110")
        page.wait_for_timeout(500)
        page.screenshot(path=path)


def log_page(path: Path) -> None:
    """The logs of an axis whose machine file lacks a torque ripple, diagnosed."""
    control, axis = logs.Control(), logs.Axis(coulomb=0.12, ripple=0.03, ripple_order=3.0, ripple_phase=0.7)
    command = logs.to_and_fro(control.sample)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "strokes.csv").write_text(logs.csv(command, *logs.record(axis, control, command, 0.02e-6)))
        (folder / "campaign.toml").write_text(logs.CAMPAIGN)
        (folder / "machine.toml").write_text(logs.machine_toml(axis, control, False, 0.12))
        with Opened(folder) as opened:
            page = opened.page
            page.locator("[data-effect='torque_ripple.X'] .percent").wait_for()
            page.locator("button[aria-label='diagnose']").click()
            page.locator(".card .head").first.wait_for()
            page.get_by_text("show it in the traces").click()
            page.wait_for_timeout(5000)
            page.screenshot(path=path)


def part_page(path: Path) -> None:
    """The cone frustum on a machine whose hidden backlash was found in three tests and added."""
    with tempfile.TemporaryDirectory() as scratch, Opened(cut(Path(scratch) / "hidden-backlash")) as opened:
        page = opened.page
        opened.settled()
        page.locator("button[aria-label='diagnose']").click()
        page.locator(".card button", has_text="add").click()
        opened.settled()
        page.locator("button[aria-label='part']").click()
        cone = page.get_by_role("option", name="cone")
        while not cone.is_visible():  # a dialog that still opens closes the list again
            page.locator(".part-ask .q-select").first.click()
            page.wait_for_timeout(1500)
        cone.click()
        page.get_by_text("predict", exact=True).click()
        page.locator(".part-table").first.wait_for()
        page.wait_for_timeout(2500)
        page.screenshot(path=path)


def mission(film: bool) -> None:
    """Play the mission: see the jump, try by hand, diagnose, add, save."""
    frames: list[Image.Image] = []
    with Opened() as opened:
        page = opened.page

        def shot(times: int = 1) -> None:
            if film:
                frames.extend([_picture(page)] * times)

        opened.settled()
        opened.until("!document.querySelector('.title .soft').textContent.startsWith('computing')")
        opened.until("document.querySelector('.percent')")
        page.wait_for_timeout(1500)
        page.screenshot(path=IMAGES / "workbench-start.png")
        shot(4)
        slider_of(opened, "A", "backlash.A")
        shot(3)
        thumb = page.locator(".detail .q-slider [tabindex='0']").first
        for _ in range(6):
            thumb.press("PageDown" if _ < 2 else "ArrowRight")
            page.wait_for_timeout(700)
            shot()
        opened.settled()
        page.screenshot(path=IMAGES / "workbench-slider.png")
        while not page.locator("button[aria-label='undo']").is_disabled():
            page.locator("button[aria-label='undo']").click()
            page.wait_for_timeout(300)
        opened.settled()
        shot(3)
        page.locator("button[aria-label='diagnose']").click()
        page.locator(".card").first.wait_for()
        for _ in range(5):
            page.wait_for_timeout(1500)
            shot()
        page.locator(".card .head").first.wait_for()
        page.wait_for_timeout(500)
        shot(4)
        page.get_by_text("show it in the traces").click()
        page.get_by_text("residual with").wait_for(state="attached")
        page.wait_for_timeout(700)
        page.screenshot(path=IMAGES / "workbench-diagnosis.png")
        shot(4)
        page.locator(".card button", has_text="add").click()
        page.wait_for_timeout(600)
        shot(2)
        opened.settled()
        page.wait_for_timeout(500)
        page.screenshot(path=IMAGES / "workbench-added.png")
        shot(4)
        page.locator("button[aria-label='save']").click()
        page.wait_for_timeout(700)
        shot(2)
        page.locator(".q-dialog button", has_text="save").click()
        page.get_by_text("machine.toml has").wait_for()
        page.wait_for_timeout(400)
        shot(4)
    for name in ("start", "slider", "diagnosis", "added"):
        _small(IMAGES / f"workbench-{name}.png")
    if film:
        _write_film(frames)


def _picture(page) -> Image.Image:
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB").resize(FILM, Image.Resampling.LANCZOS)


def _small(path: Path) -> None:
    """Few colours are enough for a page, and a quarter of the bytes."""
    Image.open(path).convert("RGB").quantize(160, dither=Image.Dither.NONE).save(path, optimize=True)


def _write_film(frames: list[Image.Image]) -> None:
    colours = frames[0].quantize(96, dither=Image.Dither.NONE)
    reduced = [f.quantize(palette=colours, dither=Image.Dither.NONE) for f in frames]
    path = IMAGES / "workbench.gif"
    reduced[0].save(path, save_all=True, append_images=reduced[1:], duration=FRAME, loop=0, optimize=True)
    size = path.stat().st_size
    print(f"{path.name}: {len(frames) * FRAME / 1e3:.0f} s, {size / 1e6:.1f} MB")
    if size > MOST:
        raise SystemExit(f"{path.name} has {size / 1e6:.1f} MB; allowed: {MOST / 1e6:g}")


if __name__ == "__main__":
    sys.exit(main())
