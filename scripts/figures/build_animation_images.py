"""Pictures of docs/animation.md, from the real code: a frame of a test's video, and the ladder as a GIF.

Run it with the project's Python. Same code, same pictures.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from mjsim.animation.ladder import animate_ladder
from mjsim.animation.layout import Layout
from mjsim.animation.movie import pictures
from mjsim.animation.scene import Stage
from mjsim.animation.story import tell
from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import machine_of
from mjsim.commands import history as ladder
from mjsim.commands.compare import compare
from mjsim.effects.registry import make
from mjsim.io.resources import examples

IMAGES = Path(__file__).resolve().parents[2] / "docs" / "images"
TESTS = ("cone15-centre-ccw", "cone45-x50-ccw", "cone15-y50-ccw", "rotary-a-tangential-ccw")


def main() -> None:
    """Write both."""
    with tempfile.TemporaryDirectory() as scratch:
        campaign = read_campaign(shutil.copytree(examples() / "hidden-backlash", Path(scratch) / "hidden-backlash"))
        machine = machine_of(campaign)
        test = next(t for t in campaign.tests if t.name == "cone15-y50-ccw")
        layout = Layout(1280, 720)
        with Stage(test, 800, 720, shadows=True) as stage:
            story = tell(campaign, machine, test)
            frame = list(pictures(story, stage, layout, "overview", np.linspace(0.0, 0.506 * story.duration, 60), 1.0))[
                -1
            ]
        file = IMAGES / "animation.png"
        Image.fromarray(frame).save(file, optimize=True)
        better = machine.with_effect(make("backlash.A", width_deg=0.002))
        kept = [("start", "", compare(campaign, machine)), ("add", "backlash.A", compare(campaign, better))]
        ladder.record(campaign, [ladder.step_of(*names, campaign.machine_file, c) for *names, c in kept])
        film = animate_ladder(campaign, IMAGES / "ladder.gif", TESTS, "800x450", force=True)
    for path in (file, film.file):
        print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
