"""The machine's model as bodies that carry one another, posed by axis positions, with the bar and its path."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.bodies import model_spec
from mjsim.machine.chain import Chain
from mjsim.simulation.mjmodel import rotation_of
from mjsim.workbench.overlay import Trace

if TYPE_CHECKING:
    import trimesh

#: Points of a path that is drawn.
_POINTS = 540
#: Vertical field of view of the page's camera, °.
FIELD = 38.0
#: Three.js' cylinder stands along y; this turns it along z, (3, 3).
STANDING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
#: Groups of geoms that are looked at; the others are there to touch.
_LOOKED_AT = (0, 2)
#: Types of geoms that have an end.
_SOLID = tuple(int(getattr(mujoco.mjtGeom, f"mjGEOM_{n}")) for n in ("MESH", "BOX", "CYLINDER", "SPHERE"))
#: Directions from which the whole machine is seen, and the distance in its sizes.
_VIEWS = {"overview": ((-0.60, -0.72, 0.36), 1.75), "side": ((-0.98, -0.15, 0.12), 1.75), "above": ((0, -0.3, 1), 1.6)}
#: Eye of the view at the bar, less its middle, bar lengths.
_CLOSE = np.array([-3.2, -5.2, 3.4])


@dataclass(frozen=True)
class Body:
    """A body of the machine.

    Attributes:
        name: As in the model.
        parent: Of the body that carries it; ``world`` where none does.
        position: In the parent, (3,) m.
        turn: In the parent, (3, 3).
        joint: The axis that moves it; empty where none does.
        along: (3,) direction of that axis.
        rotary: Whether it turns.
        solids: Colour as ``#rrggbb`` and geoms of the model that have it, of what one sees of it.
    """

    name: str
    parent: str
    position: np.ndarray
    turn: np.ndarray
    joint: str
    along: np.ndarray
    rotary: bool
    solids: tuple[tuple[str, tuple[int, ...]], ...] = ()

    def placed(self, position: float) -> tuple[np.ndarray, np.ndarray]:
        """Place (3,) m and turn (3, 3) in the parent with its axis at ``position`` (m, rad)."""
        if not self.joint:
            return self.position, self.turn
        if not self.rotary:
            return self.position + self.turn @ (self.along * position), self.turn
        quat = np.concatenate([[np.cos(position / 2)], np.sin(position / 2) * self.along])
        return self.position, self.turn @ rotation_of(quat)


class MachineBodies:
    """The model of a machine with given axes.

    Args:
        chain: The axes.

    Raises:
        InputError: There is no model with these axes.
    """

    def __init__(self, chain: Chain) -> None:
        self.model = model_spec(chain).compile()
        self.bodies = tuple(_body(self.model, i) for i in range(1, self.model.nbody))
        self._joints = np.array([self.model.joint(a).qposadr[0] for a in chain.letters])
        self._chain = chain

    @property
    def meshes(self) -> dict[str, tuple[int, ...]]:
        """Geoms by the file name of the mesh that shows them: ``<body>-<number>.stl``."""
        return {f"{b.name}-{i}.stl": geoms for b in self.bodies for i, (_, geoms) in enumerate(b.solids)}

    def posed(self, test: BallBarTest) -> Posed:
        """The machine in a test."""
        return Posed(self, test)

    @cached_property
    def middle_and_size(self) -> tuple[np.ndarray, float]:
        """Middle (3,) m and size (m) of the machine at its zero position."""
        data = mujoco.MjData(self.model)
        mujoco.mj_kinematics(self.model, data)
        seen = np.isin(self.model.geom_group, _LOOKED_AT) & (self.model.geom_rbound > 0.0)
        low = (data.geom_xpos - self.model.geom_rbound[:, None])[seen].min(axis=0)
        high = (data.geom_xpos + self.model.geom_rbound[:, None])[seen].max(axis=0)
        return (low + high) / 2, float((high - low).max())

    def carrier(self, test: BallBarTest) -> str:
        """The body in whose frame the path of a test is drawn: the table, or what carries all that turns it, where
        the bar stays with the work.
        """
        body = self.model.body("table_fixture").id
        if kind_of(test).moves_on_table:
            return self.model.body(int(self.model.body_parentid[body])).name
        known = {b.name: b for b in self.bodies}
        name = last = self.model.body(body).name
        while name in known:
            last = known[name].parent if known[name].rotary else last
            name = known[name].parent
        return last


class Posed:
    """The machine in one test.

    Args:
        machine: The bodies.
        test: It says where the table ball is.
    """

    def __init__(self, machine: MachineBodies, test: BallBarTest) -> None:
        self.machine, self.test = machine, test
        self.model = machine.model.__copy__()
        self.model.body("table_fixture").pos[:] = test.table_ball
        self.data = mujoco.MjData(self.model)
        self.carrier = machine.carrier(test)
        self._way: tuple[np.ndarray, np.ndarray] | None = None

    def balls(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Centres of table ball and spindle ball, (3,) m each, with the axes at ``position`` (axes,) m and rad."""
        self.data.qpos[self.machine._joints] = position
        mujoco.mj_kinematics(self.model, self.data)
        return self.data.site("table_ball").xpos.copy(), self.data.site("spindle_ball").xpos.copy()

    def views(self, position: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Place and point looked at, (3,) m each, of the usual views, with the axes at ``position`` (axes,)."""
        table, spindle = self.balls(position)
        bar, (middle, size) = (table + spindle) / 2, self.machine.middle_and_size
        out = {"close-up": (bar + _CLOSE * self.test.shown_over, bar)}
        for name, (direction, distance) in _VIEWS.items():
            away = np.array(direction, float)
            out[name] = (middle + distance * size * away / np.linalg.norm(away), middle)
        out["bar"] = (bar + 0.45 * _CLOSE * self.test.shown_over, bar)
        return out

    def path(self, trace: Trace, time: np.ndarray, position: np.ndarray, factor: float) -> dict[str, np.ndarray]:
        """The way of the bar's end with its error magnified, (n, 3) m in the frame of :attr:`carrier`.

        Args:
            trace: Of the test.
            time: (n,) s of ``position``.
            position: Axis positions, (n, axes) m and rad.
            factor: How many times the deviation's size is drawn.

        Returns:
            ``nominal``, ``simulated``, and ``measured`` where there is a measurement.
        """
        measured, simulated = trace.centred
        pick = np.unique(np.linspace(0, len(trace.time) - 1, _POINTS).astype(int))
        if self._way is None or len(self._way[0]) != len(pick):  # models differ by µm, of which one sees nothing
            self._way = self._bar_along(position[np.clip(np.searchsorted(time, trace.time[pick]), 0, len(time) - 1)])
        base, along = self._way
        lines = {"nominal": np.zeros(len(pick)), "simulated": simulated[pick]}
        if measured is not None:
            lines["measured"] = np.nan_to_num(measured[pick])
        return {name: base + factor * value[:, None] * along for name, value in lines.items()}

    def _bar_along(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """End of the bar without an error, m, and its direction, (n, 3) each in the frame of :attr:`carrier`."""
        base, along = np.empty((len(position), 3)), np.empty((len(position), 3))
        carrier = self.model.body(self.carrier).id
        for row, q in enumerate(position):
            table, spindle = self.balls(q)
            direction = self.test.pointing(table, spindle)
            turn = self.data.xmat[carrier].reshape(3, 3)
            base[row] = (table + direction * self.test.length - self.data.xpos[carrier]) @ turn
            along[row] = direction @ turn
        return base, along


def _body(model: mujoco.MjModel, i: int) -> Body:
    has_joint = model.body_jntnum[i] > 0
    j = int(model.body_jntadr[i]) if has_joint else -1
    by_colour: dict[str, list[int]] = {}
    for g in np.flatnonzero((model.geom_bodyid == i) & np.isin(model.geom_group, _LOOKED_AT)):
        if model.geom_type[g] in _SOLID:
            by_colour.setdefault(_colour(model, int(g)), []).append(int(g))
    return Body(
        model.body(i).name,
        model.body(int(model.body_parentid[i])).name,
        model.body_pos[i].copy(),
        rotation_of(model.body_quat[i]),
        model.joint(j).name if has_joint else "",
        model.jnt_axis[j].copy() if has_joint else np.zeros(3),
        bool(has_joint and model.jnt_type[j] == int(mujoco.mjtJoint.mjJNT_HINGE)),
        tuple((colour, tuple(geoms)) for colour, geoms in by_colour.items()),
    )


def _colour(model: mujoco.MjModel, g: int) -> str:
    material = int(model.geom_matid[g])
    rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[g]
    return "#" + "".join(f"{round(255 * float(x)):02x}" for x in rgba[:3])


def turn_to(along: np.ndarray) -> np.ndarray:
    """A rotation (3, 3) that takes z to ``along`` (3,)."""
    helper = np.eye(3)[int(np.argmin(np.abs(along)))]
    x = np.cross(helper, along)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(along, x), along])


# -- what geoms look like, for the page --------------------------------------------------------------------------------


def stl_of(model: mujoco.MjModel, geoms: Iterable[int]) -> bytes:
    """STL data of some geoms of one body, in the body's frame.

    Args:
        model: The machine's model.
        geoms: Their numbers; meshes, boxes, cylinders and spheres.
    """
    import trimesh  # slow to load, and the traces come first

    data = trimesh.util.concatenate([_solid(model, g) for g in geoms]).export(file_obj=None, file_type="stl")
    assert isinstance(data, bytes)
    return data


def _solid(model: mujoco.MjModel, g: int) -> trimesh.Trimesh:
    import trimesh

    kind, size = int(model.geom_type[g]), model.geom_size[g]
    if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
        m = int(model.geom_dataid[g])
        vertices = model.mesh_vert[model.mesh_vertadr[m] :][: model.mesh_vertnum[m]]
        faces = model.mesh_face[model.mesh_faceadr[m] :][: model.mesh_facenum[m]]
        solid = trimesh.Trimesh(vertices, faces, process=False)
    elif kind == int(mujoco.mjtGeom.mjGEOM_BOX):
        solid = trimesh.creation.box(2 * size)
    elif kind == int(mujoco.mjtGeom.mjGEOM_CYLINDER):
        solid = trimesh.creation.cylinder(size[0], 2 * size[1], sections=48)
    else:
        solid = trimesh.creation.icosphere(2, size[0])
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = rotation_of(model.geom_quat[g]), model.geom_pos[g]
    return solid.apply_transform(place)
