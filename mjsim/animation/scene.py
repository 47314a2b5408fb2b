"""The machine of a test in MuJoCo's renderer: posed by axis positions, with the bar's error drawn magnified."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np

from mjsim.animation.gl import advice, chosen, make_context
from mjsim.errors import InputError
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.io.resources import scene_file
from mjsim.machine.bodies import counted
from mjsim.machine.chain import FIVE_AXIS, Chain
from mjsim.machine.modelling import whole_scene

#: The camera that follows the bar; all others are the model's.
BAR = "bar"
#: Cameras that show the whole machine.
FAR = ("overview", "side")
_ORIGIN, _UPRIGHT = np.zeros(3), np.eye(3).ravel()
ORANGE, RED, BLUE = (1.0, 0.42, 0.05, 1.0), (0.85, 0.10, 0.25, 1.0), (0.10, 0.32, 0.62, 1.0)
#: Radii in m: the bar, the error on it, and the ghost.
BAR_RADIUS, ERROR_RADIUS, BALL_RADIUS = 0.0028, 0.0045, 0.0075


def cameras() -> list[str]:
    """Names of the cameras that a view can have."""
    spec = mujoco.MjSpec.from_file(str(scene_file()))
    return [c.name for c in spec.cameras] + [BAR]


def scene_of(chain: Chain) -> mujoco.MjSpec:
    """The machine of a chain in its scene."""
    if chain.counter_clockwise.nominal == FIVE_AXIS:
        return counted(mujoco.MjSpec.from_file(str(scene_file())), chain)
    return mujoco.MjSpec.from_string(whole_scene(chain))


@dataclass(frozen=True)
class Line:
    """A line in the scene: (n, 3) world points (m), NaN breaks it; width in pixels."""

    points: np.ndarray
    colour: tuple[float, float, float, float]
    width: float


@dataclass(frozen=True)
class Balls:
    """Where the bar is, in world coordinates (m).

    Attributes:
        table, spindle: (3,) centres of the balls. ghost: (3,) the spindle-side end with its error magnified.
    """

    table: np.ndarray
    spindle: np.ndarray
    ghost: np.ndarray


class Stage:
    """One test's machine, ready to be posed and rendered; close it after use (or use it in a ``with`` block).

    The bar is drawn from the table ball to the *ghost*: the point on the bar's line at its nominal length plus the
    magnified error. Everything else has its true size.
    """

    def __init__(self, test: BallBarTest, width: int, height: int, shadows: bool = False):
        """For pictures of up to ``width`` x ``height`` pixels; ``shadows`` in those of the whole machine, at twice the
        computing.

        Raises:
            InputError: no OpenGL.
        """
        self._context: Any = None
        self._gpu: Any = None
        self._context = make_context(width, height)
        spec = scene_of(test.chain)
        spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
        spec.visual.quality.offsamples, spec.visual.quality.shadowsize = 0, 1024
        spec.visual.global_.fovy = 34.0
        self.model = spec.compile()
        self.model.body("table_fixture").pos[:] = test.table_ball
        self.data = mujoco.MjData(self.model)
        self.test, self.shadows = test, shadows
        #: The frame in which the trail stands still: the table, where the bar goes round in the work's frame.
        self.carrier = self._still()
        self._joints = np.array([self.model.joint(a).qposadr[0] for a in test.chain.letters])
        with advice(chosen()):  # without a display, GLFW's context fails only here
            self._gpu = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._gpu)
        self._scene = mujoco.MjvScene(self.model, maxgeom=2000)
        self._option = mujoco.MjvOption()
        self._option.flags[mujoco.mjtVisFlag.mjVIS_TENDON] = False
        self._buffers: dict[tuple[int, int], np.ndarray] = {}

    def _still(self) -> int:
        """The body in whose frame the trail stands still."""
        turning = self.test.chain.turning
        if kind_of(self.test).moves_on_table or self.test.axis not in [a.letter for a in turning]:
            return self.model.body("table").id
        table = int(self.model.joint(turning[-1].letter).bodyid[0])
        return int(self.model.body_parentid[table])

    def __enter__(self) -> Stage:
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """Free what the graphics driver holds."""
        if self._context is not None:
            self._context.make_current()
            if self._gpu is not None:
                self._gpu.free()
            self._context.free()
            self._context = None

    def __del__(self) -> None:
        # a forgotten stage must not free its textures in another one's context, which may have the same numbers;
        # when Python ends, the driver may be gone already
        with contextlib.suppress(Exception):
            self.close()

    def pose(self, position: np.ndarray, stretch: float = 0.0) -> Balls:
        """Move the axes to ``position`` (5,) m and rad; the ghost stands ``stretch`` m beyond the bar's nominal
        length.
        """
        self.data.qpos[self._joints] = position
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        table = self.data.site("table_ball").xpos.copy()
        spindle = self.data.site("spindle_ball").xpos.copy()
        along = self.test.pointing(table, spindle)
        return Balls(table, spindle, table + along * (self.test.length + stretch))

    def to_carrier(self, point: np.ndarray) -> np.ndarray:
        """World points (..., 3) in the trail's frame at the present pose, m."""
        return (point - self.data.xpos[self.carrier]) @ self.data.xmat[self.carrier].reshape(3, 3)

    def to_world(self, point: np.ndarray) -> np.ndarray:
        """Inverse of :meth:`to_carrier`."""
        return point @ self.data.xmat[self.carrier].reshape(3, 3).T + self.data.xpos[self.carrier]

    def render(
        self, camera: str, width: int, height: int, balls: Balls, lines: Sequence[Line] = (), aside: float = 0.0
    ) -> np.ndarray:
        """A picture (height, width, 3) uint8 of the present pose; it is overwritten by the next of this size.

        Args:
            camera: a name of :func:`cameras`. balls: what :meth:`pose` returned. lines: drawn along in world
                coordinates.
            aside: how far the picture's middle lies right of what the camera looks at, over half its width.

        Raises:
            InputError: an unknown camera.
        """
        mujoco.mjv_updateScene(
            self.model,
            self.data,
            self._option,
            None,
            self._camera(camera),
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._scene,
        )
        self._draw_bar(balls)
        for line in lines:
            self._draw_line(line)
        # from near, the steps of the shadow map are larger than what is to be seen
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = self.shadows and camera in FAR
        for eye in self._scene.camera:
            eye.frustum_center = aside * eye.frustum_top * width / height
        rect = mujoco.MjrRect(0, 0, width, height)
        self._context.make_current()  # another stage may have been at work in this thread
        image = self._buffers.setdefault((width, height), np.empty((height, width, 3), np.uint8))
        mujoco.mjr_render(rect, self._scene, self._gpu)
        mujoco.mjr_readPixels(image, None, rect, self._gpu)
        return image[::-1]

    def pixel(self, point: np.ndarray, width: int, height: int) -> np.ndarray:
        """Column and row (2,), in pixels, of a world point (3,) in the picture rendered last, at that size."""
        pair = self._scene.camera  # one per eye; a picture is taken from between them
        eye, ahead, up = (np.mean([getattr(c, k) for c in pair], axis=0) for k in ("pos", "forward", "up"))
        d = np.asarray(point) - eye
        scale = 0.5 * height * pair[0].frustum_near / pair[0].frustum_top
        column = (
            scale * (d @ np.cross(ahead, up)) / (d @ ahead)
            - 0.5 * height * pair[0].frustum_center / pair[0].frustum_top
        )
        return np.array([0.5 * width + column, 0.5 * height - scale * (d @ up) / (d @ ahead)])

    def _camera(self, name: str) -> mujoco.MjvCamera:
        camera = mujoco.MjvCamera()
        if name == BAR:
            camera.type = mujoco.mjtCamera.mjCAMERA_FREE
            camera.lookat[:] = self.data.site("table_ball").xpos
            # 1.5 bars either side of the table ball; from the front, high enough to look under the spindle nose and
            # onto the table
            camera.distance = 1.45 * self.test.shown_over / np.tan(np.radians(17.0))
            camera.azimuth, camera.elevation = 65.0, -38.0
            return camera
        number = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_CAMERA.value, name)
        if number < 0:
            raise InputError(f"no camera {name!r}; allowed: {', '.join(cameras())}")
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, number
        return camera

    def _draw_bar(self, balls: Balls) -> None:
        self._rod(balls.table, balls.ghost, BAR_RADIUS, ORANGE)
        if np.linalg.norm(balls.ghost - balls.spindle) > 1e-4:
            self._rod(balls.spindle, balls.ghost, ERROR_RADIUS, RED)
        self._new(mujoco.mjtGeom.mjGEOM_SPHERE, BALL_RADIUS, RED).pos[:] = balls.ghost

    def _rod(self, start: np.ndarray, end: np.ndarray, radius: float, colour: tuple) -> None:
        geom = self._new(mujoco.mjtGeom.mjGEOM_CAPSULE, radius, colour)
        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE.value, radius, start, end)

    def _draw_line(self, line: Line) -> None:
        points = line.points
        for a, b in pairwise(points):
            if np.isfinite(a[0] + b[0]) and self._scene.ngeom < self._scene.maxgeom:
                geom = self._new(mujoco.mjtGeom.mjGEOM_LINE, line.width, line.colour)
                mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_LINE.value, line.width, a, b)

    def _new(self, kind, radius: float, colour: tuple):
        geom = self._scene.geoms[self._scene.ngeom]
        self._scene.ngeom += 1
        mujoco.mjv_initGeom(geom, kind.value, np.full(3, radius), _ORIGIN, _UPRIGHT, np.array(colour, np.float32))
        geom.emission = 0.3
        return geom
