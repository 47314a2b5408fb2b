"""Pictures of machines of many chains: one contact sheet and frames of a head-table machine for the documentation,
and one for each layout of the machine templates (alone with --templates).
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from mjsim.campaign.machine_templates import LAYOUTS
from mjsim.campaign.new import new_machine
from mjsim.cli.main import main as command
from mjsim.instruments.ball_bar.kinds import KINDS
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import Placement, chain_of
from mjsim.machine.modelling import whole_scene
from mjsim.units import DEG

IMAGES = Path(__file__).resolve().parents[2] / "docs" / "images"
SIZE = 400, 330
_LEANING = (("B", Placement((0.0, 1.0, 1.0))),)
#: Caption, configuration, placements.
MACHINES = (
    ("tilting table A", "w-C'A'Y'bXZ-t", ()),
    ("tilting table B", "w-C'B'X'bYZ-t", ()),
    ("tilting table on two slides", "w-C'A'X'Y'bZ-t", ()),
    ("moving column, tilting table", "w-C'B'bXYZ-t", ()),
    ("tilting table on a knee", "w-C'A'Z'bXY-t", ()),
    ("two tilting axes", "w-B'A'Y'bXZ-t", ()),
    ("swivel head B, table C", "w-C'X'bYZB-t", ()),
    ("swivel head A, table C", "w-C'bXYZA-t", ()),
    ("swivel head B, moving table", "w-C'Y'bXZB-t", ()),
    ("swivel head B, tilting table A", "w-A'bXYZB-t", ()),
    ("fork head C, A", "w-bXYZCA-t", ()),
    ("fork head C, B", "w-X'bYZCB-t", ()),
    ("gimbal head A, B", "w-X'Y'bZAB-t", ()),
    ("nutating table", "w-C'B'Y'bXZ-t", _LEANING),
    ("nutating head, table C", "w-C'bXYZB-t", _LEANING),
    ("nutating head C, B", "w-bXYZCB-t", _LEANING),
    ("swivel head B with a quill", "w-C'bXYBZ-t", ()),
    ("slide on the table C, head A", "w-X'C'bYZA-t", ()),
    ("four axes, table C", "w-C'bXYZ-t", ()),
    ("four axes, table A", "w-A'X'bYZ-t", ()),
    ("four axes, head B", "w-bXYZB-t", ()),
    ("three axes", "w-X'Y'bZ-t", ()),
)


#: The test of the animation.
_CAMPAIGN = """name = "play of a head"
[[test]]
name = "cone"
kind = "cone_frustum"
half_apex_deg = 15
inclination_deg = 10
sensitive_direction = "perpendicular"
direction = "CCW"
revolutions = 1
table_ball_mm = [50, 0, 155]
bar_length_mm = 100
feed_mm_min = 1000
"""


def pose(chain, phi: float) -> tuple[np.ndarray, BallBarTest]:
    """Axis positions in the middle of a test that moves as many axes as there are."""
    test = BallBarTest("t", "circular", (0.05, 0.0, 0.155), 0.1, 0.02, chain=chain)
    if len(chain.rotary) == 2:
        test = BallBarTest("t", "cone_frustum", (0.05, 0.0, 0.155), 0.1, 0.02, 20 * DEG, 15 * DEG, chain=chain)
    if KINDS[test.kind].wrong(test):  # a slide on the table cannot follow a whole turn
        first, *_ = chain.rotary
        test = BallBarTest("t", "simultaneous", (0.05, 0.0, 0.155), 0.1, 0.02, axis=first, sensitive="Z", chain=chain)
        test = replace(test, stop=50 * DEG, more={"second_start": 0.0, "second_stop": 40 * DEG})
        return Program(test).path(np.array([0.4]))[0], test
    q = Program(test).path(np.linspace(0.0, phi, 200))[-1]
    if len(chain.rotary) == 1:  # turned a little, to be seen
        axis = chain.rotary[0]
        turn = BallBarTest("t", "rotary", (0.1, 0.02, 0.155), 0.1, 0.02, chain=chain, axis=axis, sensitive="axial")
        q = Program(turn).path(np.array([0.5]))[-1]
        test = turn
    return q, test


def picture(chain) -> np.ndarray:
    """The machine in the middle of a test, (height, width, 3)."""
    spec = mujoco.MjSpec.from_string(whole_scene(chain))
    spec.visual.quality.offsamples = 4
    model = spec.compile()
    q, test = pose(chain, 2.2)
    model.body("table_fixture").pos[:] = test.table_ball
    data = mujoco.MjData(model)
    for letter, value in zip(chain.letters, q, strict=True):
        data.joint(letter).qpos[0] = value
    mujoco.mj_forward(model, data)
    renderer = mujoco.Renderer(model, SIZE[1], SIZE[0])
    renderer.update_scene(data, "overview")
    image = renderer.render().copy()
    renderer.close()
    return image


def pictures_of_templates() -> None:
    """One small picture for each layout, for the start page."""
    folder = IMAGES.parent.parent / "mjsim" / "workbench" / "start" / "pictures"
    for layout in LAYOUTS:
        image = Image.fromarray(picture(chain_of(layout.configuration, layout.placements)))
        image.resize((240, 198)).save(folder / f"{layout.name}.jpg", quality=80, optimize=True)


def main() -> None:
    pictures_of_templates()
    if "--templates" in sys.argv:
        return
    columns, caption = 4, 44
    rows = -(-len(MACHINES) // columns)
    sheet = Image.new("RGB", (columns * SIZE[0], rows * (SIZE[1] + caption)), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(17)
    for number, (name, configuration, placements) in enumerate(MACHINES):
        x, y = number % columns * SIZE[0], number // columns * (SIZE[1] + caption)
        sheet.paste(Image.fromarray(picture(chain_of(configuration, placements))), (x, y))
        draw.text((x + 8, y + SIZE[1] + 2), name, "black", font)
        draw.text((x + 8, y + SIZE[1] + 22), configuration, (80, 80, 80), font)
    sheet.save(IMAGES / "machines.jpg", quality=84, optimize=True)
    if "--sheet" not in sys.argv:
        animation()


def animation() -> None:
    """A cone on a machine with a swivel head over a rotary table; the head's play shows."""
    with tempfile.TemporaryDirectory() as folder:
        machine, campaign = Path(folder) / "machine", Path(folder) / "campaign"
        new_machine(machine, "w-C'bXYZB-t", name="swivel head over rotary table")
        campaign.mkdir()
        play = '\n[[effect]]\nid = "backlash.B"\nwidth_deg = 0.003\n'
        (campaign / "machine.toml").write_text((machine / "machine.toml").read_text() + play)
        (campaign / "campaign.toml").write_text(_CAMPAIGN)
        made = ["animate", str(campaign), "--test", "cone", "-o", str(IMAGES / "head-table.gif")]
        command([*made, "--size", "640x360", "--fps", "6", "--force"], standalone_mode=False)


if __name__ == "__main__":
    main()
