"""Pictures of the README, the documentation and the model's page, from the real code: docs/images/*.png,
models/five_axis.png.

Run it with the project's Python. Same code, same pictures.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
from PIL import Image

from mjsim.campaign.files import read_campaign
from mjsim.commands import history as ladder
from mjsim.commands.ball_bar.compare import BarComparison
from mjsim.commands.edit import Change, add
from mjsim.commands.explain import explain
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.io.resources import examples, scene_file
from mjsim.machine.chain import FIVE_AXIS
from mjsim.plots import polar, style
from mjsim.plots.output import explanation_plot, ladder_plot, polar_traces, residual_trace
from mjsim.plots.residual import residual_figure
from mjsim.plots.save import save

IMAGES = Path(__file__).resolve().parents[2] / "docs" / "images"
MODEL_PICTURE = scene_file().with_name("five_axis.png")
CAMPAIGN, EFFECT, TEST = "hidden-backlash", "backlash.A", "cone15-y50-ccw"


def main() -> None:
    """Write all pictures."""
    with tempfile.TemporaryDirectory() as scratch:
        campaign = read_campaign(shutil.copytree(examples() / CAMPAIGN, Path(scratch) / CAMPAIGN))
        change = add(campaign, EFFECT, record=False)
        test = next(t for t in campaign.tests if t.name == TEST)
        IMAGES.mkdir(parents=True, exist_ok=True)
        explanation_plot(explain(campaign, change.before.machine, EFFECT), IMAGES / "explain.png")
        model_picture(test)
        hero(change, machine_picture(test, "overview", 1400), machine_picture(test, "closeup", 700))
        steps = [
            ladder.step_of("start", "", campaign.machine_file, change.before),
            ladder.step_of("add", EFFECT, campaign.machine_file, change.after),
        ]
        ladder_plot(steps, IMAGES / "ladder.png")
        before = next(t for t in change.before.tests if t.test.name == TEST)
        save(
            residual_figure([residual_trace(before, change.before.noise)], title="What the model does not explain"),
            IMAGES / "residual.png",
        )
    for file in sorted(IMAGES.glob("*.png")):
        print(f"{file.name}: {file.stat().st_size / 1e3:.0f} kB")


def machine_picture(test: BallBarTest, camera: str, size: int, phi_deg: float = 330.0) -> np.ndarray:
    """The machine in the middle of a test, (size, size, 3)."""
    program = Program(test)
    time = np.linspace(*program.measured_span, 4001)
    command = program.commands(time)[int(np.argmin(np.abs(program.phi(time) - np.radians(phi_deg))))]
    spec = mujoco.MjSpec.from_file(str(scene_file()))
    spec.visual.global_.offwidth, spec.visual.global_.offheight = size, size
    model = spec.compile()
    model.body("table_fixture").pos[:] = test.table_ball
    data = mujoco.MjData(model)
    for axis, value in zip(FIVE_AXIS.letters, command, strict=True):
        data.qpos[model.joint(axis).qposadr[0]] = value
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, size, size) as renderer:
        renderer.update_scene(data, camera=camera)
        return renderer.render().copy()


def model_picture(test: BallBarTest) -> None:
    """The picture of models/README.md."""
    picture = Image.fromarray(machine_picture(test, "overview", 1400)).resize((700, 700), Image.Resampling.LANCZOS)
    picture.save(MODEL_PICTURE, optimize=True)


def hero(change: Change, machine: np.ndarray, closeup: np.ndarray) -> None:
    """Machine, and one test before and after the effect was added, at one scale."""
    width, height, side, left, apart = 12.0, 4.1, 2.95, 4.75, 3.75
    figure = style.new_figure(width, height)
    for image, x, y, size in ((machine, 0.1, 0.1, 3.9), (closeup, 2.55, 2.55, 1.4)):
        axes = figure.add_axes((x / width, y / height, size / width, size / height))
        axes.imshow(image)
        axes.set_xticks([])
        axes.set_yticks([])
        for spine in axes.spines.values():
            spine.set(color="white", linewidth=1.5)
    sides = [("before", change.before), (f"after adding {EFFECT}", change.after)]
    found = [(name, one(c), c) for name, c in sides]
    step = polar.division_um([t for _, test, _ in found for t in polar_traces(test)])
    for i, (name, test, _) in enumerate(found):
        x = left + i * apart
        plot = figure.add_axes((x / width, 0.56 / height, side / width, side / height), projection="polar")
        polar.draw_polar(plot, polar_traces(test), step)
        centre = (x + 0.5 * side) / width
        title = f"{name}: RMS {style.micrometres(test.rms * 1e6)}"
        figure.text(
            centre, 1 - 0.2 / height, title, ha="center", va="center", fontsize=10.5, fontweight="bold", color=style.INK
        )
    handles, labels = plot.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="center",
        bbox_to_anchor=((left + 0.5 * (apart + side)) / width, 0.18 / height),
        ncols=3,
        frameon=False,
        fontsize=9,
    )
    figure.text(
        1 - 0.15 / width, 0.18 / height, polar.scale_text(step), ha="right", va="center", fontsize=9, color=style.INK
    )
    save(figure, IMAGES / "hidden-backlash.png")


def one(comparison: BarComparison):
    """The test that is shown."""
    return next(t for t in comparison.tests if t.test.name == TEST)


if __name__ == "__main__":
    main()
