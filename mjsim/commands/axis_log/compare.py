"""Axis logs against a machine: errors per axis, and the radial error where a circle is stated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.any_instrument import refuse_mistakes
from mjsim.commands.comparison import ComparedChannel, ComparedPart, ComparedTest, significant
from mjsim.errors import InputError
from mjsim.inference.axis_logs.as_given import fit_as_given
from mjsim.inference.axis_logs.data import AxisData, axis_data, check_controllers
from mjsim.inference.axis_logs.entries import SHIFT, ZERO, AxisModel
from mjsim.inference.axis_logs.fit import AxisFit, LogFitter
from mjsim.inference.axis_logs.start import MOST_SHIFT
from mjsim.instruments.axis_log.measurement import LogTest, Recording, circle_part, radial_deviation, recorded_axes
from mjsim.instruments.base import INSTRUMENTS, Channel
from mjsim.machine.model import Machine, build
from mjsim.progress import Progress, silent
from mjsim.simulation.stability import check_loop
from mjsim.threads import one_blas_thread
from mjsim.units import DEG, MM, UM


@dataclass(frozen=True)
class ComparedAxis(ComparedChannel):
    """One axis of one log; its channel's unit is µm or °, everything else axis units (m or rad).

    Attributes:
        axis: Letter.
        rotary: Whether it turns.
        command: (n,).
        velocity: Simulated, (n,) per s.
        torque: Simulated torque of the motor, (n,) N·m.
        recorded_torque: As recorded, (n,) N·m; nothing where it was not.
        noise_source: Where the noise comes from.
        shift: Time by which the recording is late, s.
        zero: Encoder's zero against the command's.
    """

    axis: str
    rotary: bool
    command: np.ndarray
    velocity: np.ndarray
    torque: np.ndarray
    recorded_torque: np.ndarray | None
    noise_source: str
    shift: float
    zero: float

    @property
    def travel(self) -> Channel:
        """Unit of positions, mm or °."""
        return Channel("position", "°", DEG, "deg") if self.rotary else Channel("position", "mm", MM, "mm")

    @property
    def following(self) -> float:
        """RMS of the command less the measured position."""
        return float(np.sqrt(np.mean((self.command - self.measured) ** 2)))

    def to_json(self) -> dict:
        """Plain numbers, µm or degrees, ms."""
        unit, symbol, travel = self.channel.size, self.channel.suffix, self.travel
        worst = int(np.argmax(np.abs(self.residual)))
        return {
            "axis": self.axis,
            f"rms_{symbol}": significant(self.rms / unit),
            f"max_{symbol}": significant(self.maximum / unit),
            "worst_time_s": significant(self.time[worst]),
            f"worst_position_{travel.suffix}": significant(self.measured[worst] / travel.size),
            f"noise_{symbol}": significant(self.noise / unit),
            "noise_source": self.noise_source,
            "shift_ms": significant(self.shift * 1e3),
            "shift_at_limit": bool(abs(self.shift) > 0.99 * MOST_SHIFT * np.median(np.diff(self.time))),
            f"zero_{symbol}": significant(self.zero / unit),
            f"following_error_{symbol}": significant(self.following / unit),
        }


@dataclass(frozen=True)
class ComparedCircle:
    """The circle of one log as a ball bar would see it.

    Attributes:
        phi: Angles of the command, (n,) rad.
        measured: Radial deviation about the least-squares circle, (n,) m.
        simulated: The same.
    """

    phi: np.ndarray
    measured: np.ndarray
    simulated: np.ndarray

    @property
    def rms(self) -> float:
        """RMS of measured less simulated, m."""
        return float(np.sqrt(np.mean((self.measured - self.simulated) ** 2)))

    def to_json(self) -> dict:
        """Plain numbers, µm."""
        return {
            "rms_um": significant(self.rms / UM),
            "max_um": significant(np.abs(self.measured - self.simulated).max() / UM),
            "measured_circular_error_um": significant(np.ptp(self.measured) / UM),
            "simulated_circular_error_um": significant(np.ptp(self.simulated) / UM),
        }


@dataclass(frozen=True)
class ComparedLog(ComparedTest):
    """One log.

    Attributes:
        test: The log.
        axes: By letter.
        circle: Where one is stated.
    """

    test: LogTest
    axes: Mapping[str, ComparedAxis]
    circle: ComparedCircle | None

    @property
    def channels(self) -> tuple[ComparedAxis, ...]:
        """The axes."""
        return tuple(self.axes.values())

    @property
    def linear(self) -> list[ComparedAxis]:
        """The linear axes."""
        return [a for a in self.axes.values() if not a.rotary]

    def to_json(self) -> dict:
        """Plain numbers."""
        out: dict = {
            "name": self.test.name,
            "kind": "log",
            "setup": self.test.setup,
            "controller": self.test.controller,
            "samples": len(next(iter(self.axes.values())).time),
        }
        if self.linear:
            out["rms_um"] = significant(np.sqrt(np.mean([a.rms**2 for a in self.linear])) / UM)
            out["max_um"] = significant(max(a.maximum for a in self.linear) / UM)
        return out | {
            "axes": [a.to_json() for a in self.axes.values()],
            "radial": self.circle.to_json() if self.circle else None,
        }


@dataclass(frozen=True)
class LogComparison(ComparedPart):
    """All logs of a campaign against a machine.

    Attributes:
        campaign: What was recorded, the logs alone.
        machine: As compared.
        tests: One per log.
    """

    campaign: Campaign
    machine: Machine
    tests: tuple[ComparedLog, ...]

    @property
    def rms(self) -> float:
        """RMS of all residuals of the linear axes, m."""
        squares = [a.rms**2 for t in self.tests for a in t.linear]
        return float(np.sqrt(np.mean(squares))) if squares else 0.0

    @property
    def rms_rotary(self) -> float | None:
        """RMS of all residuals of the rotary axes, rad; nothing where none was recorded."""
        squares = [a.rms**2 for t in self.tests for a in t.axes.values() if a.rotary]
        return float(np.sqrt(np.mean(squares))) if squares else None

    @property
    def noise(self) -> float:
        """Largest noise of a linear axis, m."""
        return max((a.noise for t in self.tests for a in t.linear), default=0.0)

    def to_json(self) -> dict:
        """As ``mjsim compare --json`` prints it."""
        return {
            "campaign": self.campaign.name,
            "machine": self.machine.name,
            "effects": [e.id for e in self.machine.effects],
            "noise_um": significant(self.noise / UM),
            "noise_source": "; ".join(dict.fromkeys(a.noise_source for t in self.tests for a in t.axes.values())),
            "rms_um": significant(self.rms / UM),
            **({"rms_deg": significant(self.rms_rotary / DEG)} if self.rms_rotary is not None else {}),
            "not_measured": [t.name for t in self.campaign.planned],
            "tests": [t.to_json() for t in self.tests],
        }


@one_blas_thread
def compare_logs(campaign: Campaign, machine: Machine, threads: int = 2, progress: Progress = silent) -> LogComparison:
    """Simulate every recorded axis under its command and lay it over what was measured.

    A time shift of a few samples, the encoder's zero, the integrator's torque at the start and the screw's angle are
    fitted with their priors; the machine is taken as it is.

    Raises:
        InputError: No log has a recording, or a controller is missing.
    """
    campaign = checked_logs(campaign, machine)
    fits, axes = {}, recorded_axes(campaign.measured)
    for i, axis in enumerate(axes):
        progress("simulating", i, len(axes))
        fitter = LogFitter(machine, axis_data(campaign, axis, machine), threads)
        fits[axis] = (fitter, fit_as_given(fitter, machine))
    return overlay_logs(campaign, machine, fits)


def checked_logs(campaign: Campaign, machine: Machine) -> Campaign:
    """The recorded axis logs of a campaign, after a look for mistakes.

    Raises:
        InputError: No log has a recording, one shows a mistake, or the machine lacks the controller of one.
        SimulationError: A loop is unstable with the numbers of the machine file.
    """
    logs = campaign.of(LogTest.instrument)
    if not logs.measured:
        raise InputError(f"{campaign.folder / 'campaign.toml'}: no log has a trace; comparing needs at least one")
    refuse_mistakes(logs)
    check_controllers(logs, machine)
    refuse_unstable(logs, machine)
    return logs


def refuse_unstable(logs: Campaign, machine: Machine) -> None:
    """Stop where the loop of a recorded axis is unstable with the numbers of the machine file.

    Raises:
        SimulationError: Names the table, the loop and what to change.
    """
    for test in logs.measured:
        plant = build(machine.under(test.controller))
        for axis in test.axes:
            own = f"controller.{test.controller}.{axis}" if test.controller is not None else f"drive.{axis}"
            check_loop(plant.axes[axis], f"{machine.file or machine.name}: [{own}]", logs.traces[test.name].step)


def overlay_logs(campaign: Campaign, machine: Machine, fits: Mapping[str, tuple[LogFitter, AxisFit]]) -> LogComparison:
    """Comparison of given fits, one per axis."""
    found: dict[str, dict[str, ComparedAxis]] = {t.name: {} for t in campaign.measured}
    for axis, (fitter, fit) in fits.items():
        for k, d in enumerate(fitter.data):
            found[d.name][axis] = _compared(fitter, fit.model, d, k)
    tests = []
    for test in campaign.measured:
        axes = {a: found[test.name][a] for a in test.axes}
        tests.append(ComparedLog(test, axes, _circle(test, campaign.traces[test.name], axes)))
    return LogComparison(campaign, machine, tuple(tests))


def _compared(fitter: LogFitter, model: AxisModel, d: AxisData, k: int) -> ComparedAxis:
    vector = model.vector
    motion = fitter.motion(model, vector, k)
    rotary = d.test.chain.is_rotary(d.axis)
    return ComparedAxis(
        channel=INSTRUMENTS[d.test.instrument].channels(d.test)[d.test.axes.index(d.axis)],
        time=d.time,
        measured=d.record.actual,
        simulated=fitter.positions(model, vector, k),
        valid=np.ones(len(d.time), bool),
        noise=d.noise.rms,
        axis=d.axis,
        rotary=rotary,
        command=d.record.command,
        velocity=np.interp(d.time, motion.time, motion.velocity),
        torque=np.interp(d.time, motion.time, motion.torque),
        recorded_torque=d.record.motor_torque(model.machine.drives[d.axis].gear),
        noise_source=d.noise.source,
        shift=model.nuisance(vector, SHIFT, d.name),
        zero=model.nuisance(vector, ZERO, d.name),
    )


def _circle(test: LogTest, recording: Recording, axes: Mapping[str, ComparedAxis]) -> ComparedCircle | None:
    if test.circle is None:
        return None
    part = circle_part(test, recording)
    x, y = (axes[a] for a in test.circle.axes)
    measured, simulated = (
        radial_deviation(test.circle, getattr(x, n)[part.samples], getattr(y, n)[part.samples])
        for n in ("measured", "simulated")
    )
    return ComparedCircle(part.phi, measured, simulated)
