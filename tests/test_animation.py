"""Videos: files that decode, balls where the kinematics puts them, the factor that is shown, traces that end at the
reading, refusals.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from mjsim.animation import gl
from mjsim.animation.board import Board
from mjsim.animation.encode import Gif
from mjsim.animation.ladder import animate_ladder, places
from mjsim.animation.layout import Layout
from mjsim.animation.movie import animate, pictures
from mjsim.animation.panel import Panel
from mjsim.animation.story import FILL, tell
from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import machine_text, read_machine
from mjsim.cli.main import main
from mjsim.commands import history as ladder
from mjsim.commands.compare import compare
from mjsim.effects.registry import make
from mjsim.errors import InputError
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.kinematics import bar_vector

ROOT = Path(__file__).resolve().parent.parent
#: Both directions: one alone would let the balls' offsets explain the backlash.
TEST, OTHER = "rotary-a-tangential-ccw", "rotary-a-tangential-cw"
SMALL = "320x180"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A campaign of two short tests."""
    target, source = tmp_path_factory.mktemp("animation") / "short", examples() / "hidden-backlash"
    (target / "traces").mkdir(parents=True)
    head, *tests = (source / "campaign.toml").read_text().split("[[test]]")
    kept = [t for t in tests if f'"{TEST}"' in t or f'"{OTHER}"' in t]
    (target / "campaign.toml").write_text("[[test]]".join([head, *kept]))
    for name in (TEST, OTHER):
        shutil.copy(source / "traces" / f"{name}.csv.gz", target / "traces")
    shutil.copy(source / "machine.toml", target)
    return target


@pytest.fixture(scope="module")
def campaign(folder):
    return read_campaign(folder)


@pytest.fixture(scope="module")
def machine(campaign):
    return read_machine(campaign.machine_file)


@pytest.fixture(scope="module")
def story(campaign, machine):
    return tell(campaign, machine, campaign.tests[0])


@pytest.fixture(scope="module")
def stage(campaign):
    """The machine in the renderer; skips where there is none."""
    from mjsim.animation.scene import Stage

    try:
        stage = Stage(campaign.tests[0], 640, 480)
    except InputError as error:
        pytest.skip(str(error))
    with stage:
        yield stage


@pytest.fixture
def gl_here(stage):
    """Only that there is a renderer."""


@pytest.fixture(scope="module")
def steps(campaign, machine):
    """Comparisons of the machine as given and with its backlash."""
    better = machine.with_effect(make("backlash.A", width_deg=0.002))
    before, after = compare(campaign, machine), compare(campaign, better)
    return [
        ladder.step_of("start", "", campaign.machine_file, before),
        ladder.step_of("add", "backlash.A", campaign.machine_file, after),
    ], [before, after]


@pytest.fixture
def recorded(folder, tmp_path, steps):
    """A copy of the campaign with a history of two models."""
    campaign = read_campaign(shutil.copytree(folder, tmp_path / "recorded"))
    ladder.record(campaign, steps[0])
    return campaign


def run(*args, **env):
    return CliRunner().invoke(main, [str(a) for a in args], env=env)


def frames_of(path):
    with av.open(str(path)) as file:
        return [f.to_ndarray(format="rgb24") for f in file.decode(video=0)]


# -- the files ---------------------------------------------------------------------------------------------------------


def test_an_mp4_that_browsers_play(gl_here, folder, tmp_path):
    out = tmp_path / "new" / "a.mp4"
    result = run(
        "animate", folder, "--test", TEST, "-o", out, "--size", SMALL, "--seconds", 1, "--fps", 12, "--json", "--quiet"
    )
    assert (result.exit_code, result.stderr) == (0, "")
    data = json.loads(result.stdout)
    assert (data["frames"], data["fps"], data["seconds"], data["width"], data["height"]) == (12, 12, 1.0, 320, 180)
    assert data["test"] == TEST and data["camera"] == "overview"
    assert [p.name for p in out.parent.iterdir()] == ["a.mp4"], "no temporary file stays"
    with av.open(str(out)) as file:
        stream = file.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert float(stream.duration * stream.time_base) == pytest.approx(1.0)
        assert (stream.frames, stream.width, stream.height, stream.average_rate) == (12, 320, 180, 12)
    raw = out.read_bytes()
    assert raw.index(b"moov") < raw.index(b"mdat"), "plays while it loads"
    frames = frames_of(out)
    assert len(frames) == 12
    changed = [np.abs(a.astype(int) - b).mean() for a, b in pairwise(frames)]
    assert min(changed[1:-1]) > 0.1, "the machine moves and the trace grows from frame to frame"
    assert all(np.ptp(f[:, :190]) > 150 and (f[:, 200:] > 235).mean() > 0.7 for f in frames), (
        "machine left, white plot right"
    )


def test_a_gif_that_loops(gl_here, folder, tmp_path):
    out = tmp_path / "a.gif"
    result = run(
        "animate", folder, "--test", TEST, "-o", out, "--size", SMALL, "--seconds", 1, "--fps", 7, "--camera", "bar"
    )
    assert result.exit_code == 0, result.output
    assert result.stdout == "" and "error × 5000 (measured − simulated)" in result.stderr
    with Image.open(out) as image:
        assert (image.format, image.size, image.n_frames, image.info["loop"]) == ("GIF", (320, 180), 7, 0)
        durations, pictures = [], []
        for k in range(7):
            image.seek(k)
            durations.append(image.info["duration"])
            pictures.append(np.asarray(image.convert("RGB")).astype(int))
    assert sum(durations) == 1000 and set(durations) <= {140, 150}
    assert all(np.abs(a - b).mean() > 0.5 for a, b in pairwise(pictures))


def test_a_gif_keeps_the_colours_that_mean_something(tmp_path):
    noise = np.random.default_rng(1).integers(0, 255, (60, 80, 3), dtype=np.uint8)
    noise[:4, :4], noise[4:8, :4] = (217, 72, 15), (217, 26, 64)
    with Gif(tmp_path / "a.gif", (80, 60), 10.0) as out:
        out.add(noise)
        out.add(noise[:, ::-1])
    with Image.open(tmp_path / "a.gif") as image:
        first = np.asarray(image.convert("RGB")).astype(int)
    assert first[1, 1].tolist() == [217, 72, 15] and first[5, 1].tolist() == [217, 26, 64]


def test_same_input_same_frames(stage, story):
    layout, times = Layout(320, 180), np.array([3.0, 6.0])
    one, two = ([f.copy() for f in pictures(story, stage, layout, "overview", times, 1.0)] for _ in range(2))
    np.testing.assert_array_equal(one, two)
    assert one[0].shape == (180, 320, 3) and (one[0] != one[1]).any()


def test_the_function_of_the_package(gl_here, folder, tmp_path):
    import mjsim

    film = mjsim.animate(mjsim.read_campaign(folder), TEST, tmp_path / "a.mp4", size=SMALL, fps=2.0, speed=10.0)
    assert film.speed == pytest.approx(10.0) and film.frames == len(frames_of(film.file)) == round(
        film.fps * 14.642 / 10.0
    )


# -- the machine and the bar -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("camera, aside", [("closeup", 0.0), ("closeup", 0.2), ("overview", 0.2), ("bar", 0.0)])
def test_the_balls_are_where_the_kinematics_puts_them(stage, story, camera, aside):
    from mjsim.animation.scene import cameras

    assert cameras() == ["overview", "closeup", "side", "bar"]
    position = story.position(0.02)  # A = 0: the table ball stands free, the spindle's is at its side
    stretch = 0.02
    balls = stage.pose(position, stretch)
    vector = balls.spindle - balls.table
    np.testing.assert_allclose(vector, bar_vector(FIVE_AXIS, position[None], story.test.table_ball)[0], atol=1e-12)
    along = vector / np.linalg.norm(vector)
    np.testing.assert_allclose(balls.ghost - balls.table, along * (story.test.length + stretch), atol=1e-12)
    image = stage.render(camera, 640, 480, balls, (), aside).astype(int)
    column, row = np.round(stage.pixel(balls.table, 640, 480)).astype(int)
    r, g, b = image[row, column]
    assert min(r, g, b) > 170 and np.ptp([r, g, b]) < 30, "the table ball is white"
    column, row = np.round(stage.pixel(balls.ghost, 640, 480)).astype(int)
    r, g, b = image[row, column]
    assert r > 120 and r > 2 * g and r > 1.4 * b, "the ghost is red"
    middle = balls.table + along * 0.04
    column, row = np.round(stage.pixel(middle, 640, 480)).astype(int)
    spot = image[row - 1 : row + 2, column - 1 : column + 2].reshape(-1, 3)
    assert any(r > 150 and r > 1.5 * g > 1.5 * b for r, g, b in spot), "the bar between them is orange"


def test_without_an_error_the_bar_ends_in_the_ball(stage, story):
    balls = stage.pose(story.position(5.0), 0.0)
    assert np.linalg.norm(balls.ghost - balls.spindle) < 50e-6


# -- what is magnified -------------------------------------------------------------------------------------------------


def test_the_factor_shown_is_the_factor_applied(campaign, machine, story):
    largest = np.nanmax(np.abs(story.error.value))
    assert story.magnified == "error × 5000 (measured − simulated)" and story.magnification == 5000.0
    assert 0.4 * FILL * story.test.length <= 5000.0 * largest <= FILL * story.test.length
    for time in (2.0, 7.0, 11.0):
        assert story.stretch(time) == 5000.0 * story.error.at(time) != 0.0
    other = tell(campaign, machine, campaign.tests[0], 300.0)
    assert "× 300 " in other.magnified and other.stretch(7.0) == pytest.approx(0.06 * story.stretch(7.0))
    with pytest.raises(
        InputError, match=r"magnification 1e\+06: the error is up to .* µm and the bar 100 mm; allowed: 1 to \d+"
    ):
        tell(campaign, machine, campaign.tests[0], 1e6)


def test_the_error_is_the_residual_of_compare(story, steps):
    t = steps[1][0].tests[0]
    np.testing.assert_array_equal(story.error.value[t.valid], t.residual[t.valid])
    measured, simulated = story.traces
    np.testing.assert_allclose((measured.value - simulated.value)[t.valid], t.residual[t.valid], atol=1e-15)
    assert np.isnan(story.error.value[~t.valid]).all()


def test_no_reading_no_error(story):
    assert story.stretch(0.01) == 0.0 and np.isnan(story.error.at(0.01)), "before the trace begins"
    gap = replace(
        story.error, value=np.where((story.error.time > 5.0) & (story.error.time < 6.0), np.nan, story.error.value)
    )
    assert np.isfinite(gap.at(4.99)) and np.isfinite(gap.at(5.03)) and np.isnan(gap.at(5.5))


def test_a_test_without_trace_shows_the_simulation(campaign, machine):
    bare = tell(replace(campaign, traces={}), machine, campaign.tests[0])
    assert [s.name for s in bare.traces] == ["simulated"] and not bare.measured
    assert "(simulated deviation)" in bare.magnified
    np.testing.assert_array_equal(bare.error.value, bare.traces[0].value)


# -- the plot ----------------------------------------------------------------------------------------------------------


def test_the_drawn_trace_ends_at_the_reading(campaign, story):
    panel = Panel(story, Layout(1280, 720), 1.0)
    trigger = steps_trigger(story, campaign)
    recorded = campaign.traces[TEST]
    ink = []
    for time in (2.0, 6.0, 10.0):
        image = np.asarray(panel.frame(time)).astype(int)
        assert image.shape == (720, 520, 3)
        phi, value = panel.drawn("measured")
        last = int(np.searchsorted(recorded.time - trigger, time + 1e-9, side="right")) - 1
        assert np.degrees(phi) == pytest.approx(
            float(np.degrees(story.program.phi(recorded.time[last : last + 1] - trigger)[0])), abs=1e-6
        )
        offset = value - recorded.deviation[last]
        assert offset == pytest.approx(story.traces[0].value[0] - recorded.deviation[0], abs=1e-12), (
            "one mean is taken out"
        )
        column, row = (round(x) for x in panel.spot(phi, value))
        assert image[row, column].max() < 90, "the dot of the measured trace, near-black"
        ink.append(int((image[100:490] < 90).all(axis=2).sum()))
    assert ink[0] < ink[1] < ink[2], "the trace grows"


def steps_trigger(story, campaign):
    """Trigger shift that the comparison found, s."""
    return float(campaign.traces[TEST].time[0] - story.traces[0].time[0])


# -- the ladder --------------------------------------------------------------------------------------------------------


def test_places_stand_and_change():
    at = places(3, 651)
    assert at[0] == 0.0 and at[-1] == 2.0 and (np.diff(at) >= 0.0).all()
    stand = [np.isclose(at, k).sum() * 0.01 for k in range(3)]
    assert all(1.5 <= s < 1.75 for s in stand)


def test_the_ladder_collapses(recorded, steps, tmp_path):
    out = tmp_path / "l.mp4"
    result = run("animate", recorded.folder, "--ladder", "-o", out, "--size", SMALL, "--fps", 5, "--json", "--quiet")
    assert (result.exit_code, result.stderr) == (0, "")
    data = json.loads(result.stdout)
    assert data["tests"] == [TEST, OTHER] and [m["label"] for m in data["models"]] == [
        "machine as given",
        "+ backlash.A",
    ]
    assert [m["rms_um"] for m in data["models"]] == [s.rms_um for s in steps[0]], (
        "the recorded machines are simulated again"
    )
    frames = frames_of(out)
    assert data["frames"] == len(frames) == 20 and data["seconds"] == 4.0
    assert np.abs(frames[0].astype(int) - frames[-1]).mean() > 0.2


def test_the_board_draws_the_residual_of_the_model(steps):
    board = Board("c", ["machine as given", "+ backlash.A"], steps[1], [TEST], (640, 360))
    radius = []
    for place, comparison in ((0.0, steps[1][0]), (1.0, steps[1][1])):
        image = board.frame(place)
        assert image.shape == (360, 640, 3)
        drawn = board._lines[0].get_ydata()
        expected = np.where(comparison.tests[0].valid, comparison.tests[0].residual, np.nan) / 1e-6
        np.testing.assert_allclose(drawn, expected[:: round(len(expected) / len(drawn))], rtol=1e-12)
        radius.append(float(np.nanmean(np.abs(drawn))))
        assert board._now.get_text() == f"{comparison.rms * 1e6:.2f} µm"
    assert radius[1] < 0.1 * radius[0]
    board.frame(0.5)
    assert board._name.get_text() == "machine as given → + backlash.A"


def test_a_step_keeps_its_machine(recorded, machine):
    with open(recorded.machine_file, "a") as file:
        file.write('\n[[effect]]\nid = "backlash.C"\nwidth_deg = 0.01\n')
    first, second = (ladder.machine_of_step(recorded, s) for s in ladder.read_history(recorded))
    assert repr(first.effects) == repr(machine.effects) and first.drives == machine.drives
    assert [e.key for e in second.effects][-1] == "backlash.A" and second.effect("backlash.C") is None


def test_a_step_finds_the_users_own_effect(tmp_path):
    (tmp_path / "c").mkdir()
    (tmp_path / "m").mkdir()
    source = (examples() / "hidden-backlash" / "machine.toml").read_text()
    shutil.copy(examples() / "unlisted" / "encoder_step.py", tmp_path / "m")
    own = '\n[[effect]]\nid = "encoder_step.A"\nfile = "encoder_step.py"\nstep_deg = 0.001\nat_deg = 20.0\n'
    (tmp_path / "m" / "machine.toml").write_text(source + own)
    machine = read_machine(tmp_path / "m" / "machine.toml")
    text = machine_text(machine, tmp_path / "m" / "machine.toml", tmp_path / "c")
    assert 'file = "../m/encoder_step.py"' in text
    assert [e.key for e in read_machine(tmp_path / "c" / "machine.toml", text).effects] == [
        e.key for e in machine.effects
    ]


def test_help():
    text = run("animate", "--help").stdout
    assert "Example: mjsim animate" in text and "--json" in text and "--quiet" in text
    assert max(map(len, text.splitlines())) <= 80
    assert "\n  animate " in run("--help").stdout


# -- refusals ----------------------------------------------------------------------------------------------------------


def refused(result, *words, status=1):
    assert result.exit_code == status and result.stdout == "", result.output
    sentence = result.stderr
    if status == 1:
        assert sentence.startswith("mjsim: ") and sentence.count("\n") == 1
    assert all(w in sentence for w in words), sentence


@pytest.mark.parametrize(
    "options, words",
    [
        (["--test", "cone99"], ["no test 'cone99'", TEST]),
        (["--test", TEST, "--camera", "top"], ["no camera 'top'", "overview, closeup, side, bar"]),
        (["--test", TEST, "--size", "321x180"], ["'321x180'", "320x180 to 3840x2160", "even"]),
        (["--test", TEST, "--size", "big"], ["'big'", "WIDTHxHEIGHT"]),
        (["--test", TEST, "--size", "320x90"], ["320x180 to 3840x2160"]),
        (["--test", TEST, "--fps", "0"], ["0 frames per second", "1 to 60"]),
        (["--test", TEST, "--seconds", "0"], ["0 s", "2 to 30000"]),
        (["--test", TEST, "--seconds", "1e9"], ["2 to 30000"]),
        (["--test", TEST, "--speed", "-1"], ["speed -1", "0.01 to 1000"]),
        (["--ladder"], ["the ladder has no model", "mjsim add"]),
        (["--ladder", "--test", "cone99"], ["no measured test 'cone99'", TEST]),
    ],
)
def test_refusals_are_one_sentence(folder, tmp_path, options, words):
    refused(run("animate", folder, "-o", tmp_path / "a.mp4", *options, "--json"), *words)
    assert list(tmp_path.iterdir()) == []


def test_a_number_that_is_none_is_wrong_usage(folder, tmp_path):
    refused(
        run("animate", folder, "--test", TEST, "-o", tmp_path / "a.mp4", "--fps", "nan"),
        "'nan' is not a finite number",
        status=2,
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("value", ["0.5", "nan", "1e9"])
def test_a_factor_out_of_bounds(gl_here, folder, tmp_path, value):
    refused(
        run("animate", folder, "--test", TEST, "-o", tmp_path / "a.mp4", "--magnify", value),
        "magnification",
        "allowed: 1 to",
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.avi", "a", "a.mp4.txt"])
def test_other_suffixes(folder, tmp_path, name):
    refused(run("animate", folder, "--test", TEST, "-o", tmp_path / name), ".mp4 or .gif", name)
    refused(run("animate", folder, "--ladder", "-o", tmp_path / name), ".mp4 or .gif", name)


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--test", "a", "--test", "b"],
        ["--test", "a", "--speed", "1", "--seconds", "1"],
        ["--test", "a", "--magnify", "x"],
        ["--ladder", "--speed", "1"],
        ["--ladder", "--machine", "m.toml"],
        ["--ladder", "--camera", "side"],
    ],
)
def test_wrong_usage(folder, tmp_path, options):
    refused(run("animate", folder, "-o", tmp_path / "a.mp4", *options), "Usage:", status=2)


def test_nothing_is_overwritten(gl_here, recorded, tmp_path):
    out = tmp_path / "a.mp4"
    out.write_text("mine")
    refused(run("animate", recorded.folder, "--test", TEST, "-o", out), "a.mp4", "--force")
    refused(run("animate", recorded.folder, "--ladder", "-o", out), "a.mp4", "--force")
    assert out.read_text() == "mine"
    done = run(
        "animate",
        recorded.folder,
        "--test",
        TEST,
        "-o",
        out,
        "--size",
        SMALL,
        "--seconds",
        1,
        "--fps",
        2,
        "--force",
        "--quiet",
    )
    assert (done.exit_code, done.stdout, done.stderr) == (0, "", "") and len(frames_of(out)) == 2


def test_a_failure_in_the_middle_leaves_nothing(gl_here, campaign, tmp_path):
    def stop(stage, done, total):
        if stage == "rendering" and done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        animate(campaign, TEST, tmp_path / "a.mp4", size=SMALL, seconds=1.0, progress=stop)
    assert list(tmp_path.iterdir()) == []


def test_a_history_without_machines(recorded, tmp_path):
    file = ladder.history_file(recorded)
    rows = [{k: v for k, v in s.items() if k != "model"} for s in json.loads(file.read_text())["steps"]]
    file.write_text(json.dumps({"steps": rows}))
    refused(
        run("animate", recorded.folder, "--ladder", "-o", tmp_path / "a.mp4"),
        "history.json",
        "without its machine",
        "mjsim add",
    )
    assert run("history", recorded.folder, "--json").exit_code == 0, "such a history can still be read"


# -- no OpenGL ---------------------------------------------------------------------------------------------------------


def test_no_opengl_is_one_sentence_with_the_packages(folder, tmp_path, monkeypatch):
    def missing(system):
        raise ImportError("libEGL.so.1: cannot open shared object file")

    monkeypatch.setattr(gl, "_context_class", missing)
    setup = (ROOT / "scripts" / "setup").read_text()
    packages = re.search(r"gl_packages=\((.*?)\)", setup)[1]
    refused(run("animate", folder, "--test", TEST, "-o", tmp_path / "a.mp4"), "no OpenGL", "libEGL.so.1", packages)
    assert list(tmp_path.iterdir()) == []


HIDE = """
import ctypes, ctypes.util, sys
load, find = ctypes.CDLL.__init__, ctypes.util.find_library
gone = lambda name: name and any(x in str(name) for x in ("GL", "OSMesa", "glfw"))
def init(self, name, *args, **more):
    if gone(name):
        raise OSError(f"{name}: cannot open shared object file")
    load(self, name, *args, **more)
ctypes.CDLL.__init__ = init
ctypes.util.find_library = lambda name: None if gone(name) else find(name)
from mjsim.cli.main import main
main()
"""


@pytest.mark.parametrize("value", [None, "osmesa"])
def test_a_computer_without_the_libraries(folder, tmp_path, value):
    """Another process that finds none of them, as MuJoCo and the bindings look for them when they are imported."""
    env = {k: v for k, v in os.environ.items() if k not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")} | (
        {"MUJOCO_GL": value} if value else {}
    )
    command = [sys.executable, "-c", HIDE, "animate", str(folder), "--test", TEST, "-o", str(tmp_path / "a.mp4")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=env)
    assert (done.returncode, done.stdout) == (1, "") and done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.startswith("mjsim: cannot render the machine: no OpenGL") and gl.PACKAGES in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_users_own_choice_of_renderer(folder, tmp_path, monkeypatch):
    command = ("animate", folder, "--test", TEST, "-o", tmp_path / "a.mp4")
    refused(run(*command, MUJOCO_GL="disabled"), "MUJOCO_GL=disabled", "MUJOCO_GL=egl")
    refused(run(*command, MUJOCO_GL="vulkan"), "MUJOCO_GL=vulkan", "egl, osmesa, glfw")
    assert list(tmp_path.iterdir()) == []
    for value, system in (
        ("osmesa", "osmesa"),
        ("glfw", "glfw"),
        ("glx", "glfw"),
        ("EGL", "egl"),
        ("on", "egl"),
        ("", "egl"),
    ):
        monkeypatch.setenv("MUJOCO_GL", value)
        assert gl.chosen() == system
    monkeypatch.delenv("MUJOCO_GL")
    assert gl.chosen() == "egl"


@pytest.mark.parametrize(("platform", "system"), [("linux", "egl"), ("darwin", "cgl"), ("win32", "glfw")])
def test_the_renderer_follows_the_platform(monkeypatch, platform, system):
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(gl, "import_module", lambda name: None)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    assert gl.chosen() == system
    monkeypatch.setenv("MUJOCO_GL", "wgl")
    assert gl.chosen() == "glfw"
    monkeypatch.setenv("MUJOCO_GL", "egl")
    if platform != "linux":
        with pytest.raises(InputError, match=r"MUJOCO_GL=egl: no such renderer; allowed: .*glfw"):
            gl.chosen()


def test_ladder_needs_no_opengl(recorded, tmp_path, monkeypatch):
    monkeypatch.setattr(gl, "_context_class", None)
    assert animate_ladder(recorded, tmp_path / "l.gif", size=SMALL, fps=2.0).file.is_file()


def test_only_the_command_line_and_the_workbench_import_it():
    users = [
        p for p in (ROOT / "mjsim").rglob("*.py") if "mjsim.animation" in p.read_text() and p.parent.name != "animation"
    ]
    assert {p.relative_to(ROOT / "mjsim").as_posix() for p in users} == {
        "__init__.py",
        "cli/animate.py",
        "workbench/page/desk.py",
    }
