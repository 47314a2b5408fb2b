"""The machine model that a user has today: drives and the effects already in it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.machine import own
from mjsim.machine.chain import FIVE_AXIS, SINGULAR, Chain, Placement, chain_of
from mjsim.machine.control import Control, Controller
from mjsim.machine.effect import Effect
from mjsim.machine.plant import AxisPlant, Plant
from mjsim.machine.temperatures import Temperatures

# -- names and units of the numbers of a drive's data sheet, as users read them ----------------------------------------

#: By attribute of a drive or parameter of its friction: name in words, and unit.
SHEET_NAMES = {
    "inertia": ("inertia", "kg·m²"),
    "viscous": ("viscous friction", "N·m·s/rad"),
    "position_gain": ("position gain", "1/s"),
    "velocity_gain": ("velocity gain", "N·m·s/rad"),
    "integral_time": ("integral time", "s"),
    "coulomb_Nm": ("Coulomb friction", "N·m"),
    "presliding_rad": ("presliding", "rad"),
}


def sheet_name(name: str) -> tuple[str, str]:
    """A number of the data sheet in words, and its unit; empty where there is none."""
    return SHEET_NAMES.get(name, (name.replace("_", " "), ""))


#: One standard deviation of the data sheet (relative). Controller settings are exact numbers in the control; what hangs
#: on the motor and the mechanics is not. Source: campaign format, "data sheet".
TOLERANCE = {
    "position_gain": 0.0003,
    "integral_time": 0.005,
    "velocity_gain": 0.02,
    "inertia": 0.03,
    "viscous": 0.10,
    "coulomb": 0.05,
    "presliding": 0.10,
}
#: Encoders of an axis: on the motor; at the load alone; on both, of which the load's closes the position loop and the
#: motor's is the actual position of a log.
ENCODERS = ("motor", "load", "both")
#: Numbers of the data sheet that stand in the effect ``friction``, by the names of its parameters.
FRICTION_PARAMETERS = {"coulomb": "coulomb_Nm", "presliding": "presliding_rad"}


@dataclass(frozen=True)
class Drive:
    """Cascaded drive of one axis, motor side (paper, Fig. 2); SI.

    Attributes:
        gear: motor angle per axis position, rad/m (2π/lead) or rad/rad (worm-wheel teeth R).
        position_gain: Kpp, 1/s. velocity_gain: Kvp, N·m·s/rad. integral_time: Ti, s.
        inertia: J of the whole axis, kg·m². viscous: C, N·m·s/rad. gravity: N·m.
        feedforward: ratio of the velocity feedforward. control: what the control does beside its gains.
        encoder: one of :data:`ENCODERS`: where the position loop is closed, and what is the actual position of logs.
        torque_constant: of the motor, N·m/A; 0: not known.
    """

    axis: str
    gear: float
    position_gain: float
    velocity_gain: float
    integral_time: float
    inertia: float
    viscous: float
    gravity: float = 0.0
    feedforward: float = 0.0
    control: Control = field(default_factory=Control)
    encoder: str = "motor"
    torque_constant: float = 0.0


@dataclass(frozen=True)
class Machine:
    """Rigid kinematics + drives + a list of effects.

    Attributes:
        placements: rotary axes that are tilted or offset: letter and placement.
        tool_length: from the head's pivot to the spindle ball, m; ``None`` is that of the chain.
        singular: what the control does at a singular direction, one of :data:`mjsim.machine.chain.SINGULAR`.
        functional_points: of linear axes, by letter, in machine coordinates with all axes at 0, m.
        temperatures: that were recorded while it was measured; ``None`` where none were.
        tolerance: Limits (two standard deviations) of what a machine of this class may have without being at fault, by
            kind of effect and unit, as in the machine file.
        controllers: By name what ran on each axis (axis logs). Where the drives have no gains of their own they stand
            with those of the first.
        factor: Within which each number of the data sheet is believed, where an identification is to find them.
    """

    name: str
    drives: dict[str, Drive]
    effects: tuple[Effect, ...] = ()
    path: Path | None = None
    configuration: str = FIVE_AXIS.configuration
    effect_files: dict[str, str] = field(default_factory=dict)
    tolerance: dict[str, dict[str, float]] = field(default_factory=dict)
    controllers: dict[str, dict[str, Controller]] = field(default_factory=dict)
    factor: float | None = None
    placements: tuple[tuple[str, Placement], ...] = ()
    tool_length: float | None = None
    singular: str = SINGULAR[0]
    functional_points: tuple[tuple[str, tuple[float, float, float]], ...] = ()
    temperatures: Temperatures | None = None

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the temperature sensors that were recorded."""
        return self.temperatures.names if self.temperatures is not None else ()

    @property
    def chain(self) -> Chain:
        """The axes and their order."""
        return chain_of(self.configuration, self.placements, self.tool_length, self.singular, self.functional_points)

    @property
    def file(self) -> Path:
        """The machine file that it was read from.

        Raises:
            InputError: it was made in Python.
        """
        if self.path is None:
            raise InputError(
                f"machine {self.name!r} was not read from a file; read it with read_machine, or write it to a file "
                f"first"
            )
        return self.path

    def under(self, controller: str | None) -> Machine:
        """The machine while one of its controllers runs.

        Args:
            controller: Its name; ``None``: the drives as they are.

        Raises:
            InputError: There is no such controller.
        """
        if controller is None:
            return self
        if controller not in self.controllers:
            allowed = ", ".join(self.controllers) or "none"
            raise InputError(f"machine {self.name!r} has no controller {controller!r}; allowed: {allowed}")
        tables = self.controllers[controller]
        drives = {a: replace(d, **vars(tables[a])) if a in tables else d for a, d in self.drives.items()}
        return replace(self, drives=drives)

    def effect(self, key: str) -> Effect | None:
        """The effect with this key (or id), or ``None``."""
        return next((e for e in self.effects if e.key == key), None) or next(
            (e for e in self.effects if e.id == key), None
        )

    def with_effect(self, effect: Effect) -> Machine:
        """A machine with ``effect`` appended, or in place of the one with the same key."""
        return self.with_effects((effect,))

    def with_effects(self, effects: Iterable[Effect]) -> Machine:
        """:meth:`with_effect` of one after another."""
        by_key = {e.key: e for e in self.effects} | {e.key: e for e in effects}
        return replace(self, effects=tuple(by_key.values()))

    def without(self, key: str) -> Machine:
        """A machine without the effects that have this key or id."""
        return replace(self, effects=tuple(e for e in self.effects if key not in (e.key, e.id)))

    def with_drive(self, axis: str, **changes: float) -> Machine:
        """A machine with some numbers of one drive changed, as in ``with_drive(axis, position_gain=45.0)``.

        Args:
            axis: letter of the axis.
            changes: attributes of :class:`Drive`, SI.

        Raises:
            InputError: there is no such axis or number, or its value is not possible.
        """
        if axis not in self.drives:
            raise InputError(f"machine {self.name!r} has no axis {axis!r}; allowed: {', '.join(self.drives)}")
        known = [f.name for f in fields(Drive) if f.name not in ("axis", "control", "encoder", "torque_constant")]
        for name, value in changes.items():
            if name not in known:
                near = next((k for k in known if name.startswith(k)), None)
                hint = f"; it is called {near} here, SI" if near else ""
                raise InputError(f"with_drive({axis!r}): unknown number {name!r}{hint}; allowed: {', '.join(known)}")
            least = -np.inf if name == "gravity" else 0.0
            from_zero = ("viscous", "gravity", "feedforward")
            if not np.isfinite(value) or value < least or (value == 0.0 and name not in from_zero):
                allowed = "a finite number" if name == "gravity" else "0 or more" if name in from_zero else "above 0"
                raise InputError(f"with_drive({axis!r}): {name} = {value:g}; allowed: {allowed}")
        return replace(self, drives={**self.drives, axis: replace(self.drives[axis], **changes)})


def build(machine: Machine) -> Plant:
    """The plant of a machine. Neutral effects are left out, so that off is bit-identical to absent.

    Raises:
        InputError: an effect acts on what this machine does not have.
    """
    chain = machine.chain
    named = [f.name for f in fields(Drive) if f.name not in ("axis", "torque_constant")]
    drives = {a: machine.drives[a] for a in chain.letters}
    axes = {a: AxisPlant(**{n: getattr(d, n) for n in named}) for a, d in drives.items()}
    plant = Plant(axes, chain=chain, temperatures=machine.temperatures)
    for effect in machine.effects:
        if effect.subject not in (allowed := effect.subjects_of(chain)):
            raise InputError(f"effect {effect.id}: the machine has no {effect.subject}; allowed: {', '.join(allowed)}")
        if effect.is_neutral:
            continue
        own.apply(effect, plant)
        if effect.in_python:
            plant.python_effects.append(effect)
    plant.close_loops_on_loads()
    return plant
