"""Axis logs against a machine: errors per axis, and the radial deviation where a circle is stated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mjsim.axislog.circle import circle_part, radial_deviation
from mjsim.axislog.measurement import LogTest, Recording
from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.estimation.axis_logs.as_given import fit_as_given
from mjsim.estimation.axis_logs.data import AxisData, LogNoise, axis_data, check_controllers
from mjsim.estimation.axis_logs.entries import SHIFT, ZERO, AxisModel
from mjsim.estimation.axis_logs.fit import AxisFit, LogFitter
from mjsim.estimation.axis_logs.start import MOST_SHIFT
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread
from mjsim.units import DEG, MM, UM
from mjsim.workflow.log_check import refuse_mistakes, refuse_unstable


@dataclass(frozen=True)
class ComparedAxis:
    """One axis of one log; axis units (m or rad).

    Attributes:
        axis: Letter.
        rotary: Whether it turns.
        time: (n,) s.
        command: (n,).
        measured: (n,).
        simulated: With the nuisances, (n,).
        velocity: Simulated, (n,) per s.
        torque: Simulated torque of the motor, (n,) N·m.
        recorded_torque: As recorded, (n,) N·m; nothing where it was not.
        noise: Of one sample.
        shift: Time by which the recording is late, s.
        zero: Encoder's zero against the command's.
    """

    axis: str
    rotary: bool
    time: np.ndarray
    command: np.ndarray
    measured: np.ndarray
    simulated: np.ndarray
    velocity: np.ndarray
    torque: np.ndarray
    recorded_torque: np.ndarray | None
    noise: LogNoise
    shift: float
    zero: float

    @property
    def residual(self) -> np.ndarray:
        """Measured less simulated, (n,)."""
        return self.measured - self.simulated

    @property
    def rms(self) -> float:
        """RMS of the residual."""
        return float(np.sqrt(np.mean(self.residual**2)))

    def to_json(self) -> dict:
        """Plain numbers, µm or degrees, ms."""
        unit, symbol, place, travel = (DEG, "deg", DEG, "deg") if self.rotary else (UM, "um", MM, "mm")
        worst = int(np.argmax(np.abs(self.residual)))
        return {
            "axis": self.axis,
            f"rms_{symbol}": _r(self.rms / unit),
            f"max_{symbol}": _r(np.abs(self.residual).max() / unit),
            "worst_time_s": _r(self.time[worst]),
            f"worst_position_{travel}": _r(self.measured[worst] / place),
            f"noise_{symbol}": _r(self.noise.rms / unit),
            "noise_source": self.noise.source,
            "shift_ms": _r(self.shift * 1e3),
            "shift_at_limit": bool(abs(self.shift) > 0.99 * MOST_SHIFT * np.median(np.diff(self.time))),
            f"zero_{symbol}": _r(self.zero / unit),
            f"following_error_{symbol}": _r(np.sqrt(np.mean((self.command - self.measured) ** 2)) / unit),
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
            "rms_um": _r(self.rms / UM),
            "max_um": _r(np.abs(self.measured - self.simulated).max() / UM),
            "measured_circular_error_um": _r(np.ptp(self.measured) / UM),
            "simulated_circular_error_um": _r(np.ptp(self.simulated) / UM),
        }


@dataclass(frozen=True)
class ComparedLog:
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
            out["rms_um"] = _r(np.sqrt(np.mean([a.rms**2 for a in self.linear])) / UM)
            out["max_um"] = _r(max(np.abs(a.residual).max() for a in self.linear) / UM)
        return out | {
            "axes": [a.to_json() for a in self.axes.values()],
            "radial": self.circle.to_json() if self.circle else None,
        }


@dataclass(frozen=True)
class LogComparison:
    """All logs of a campaign against a machine.

    Attributes:
        campaign: What was recorded.
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
        return max((a.noise.rms for t in self.tests for a in t.linear), default=0.0)

    def to_json(self) -> dict:
        """As ``mjsim compare --json`` prints it."""
        recorded = {t.test.name for t in self.tests}
        return {
            "campaign": self.campaign.name,
            "machine": self.machine.name,
            "effects": [e.id for e in self.machine.effects],
            "noise_um": _r(self.noise / UM),
            "noise_source": "; ".join(dict.fromkeys(a.noise.source for t in self.tests for a in t.axes.values())),
            "rms_um": _r(self.rms / UM),
            **({"rms_deg": _r(self.rms_rotary / DEG)} if self.rms_rotary is not None else {}),
            "not_measured": [t.name for t in self.campaign.logs.tests if t.name not in recorded],
            "tests": [t.to_json() for t in self.tests],
        }


def _r(x: float) -> float:
    return float(f"{float(x):.6g}")


@one_blas_thread
def compare_logs(campaign: Campaign, machine: Machine, threads: int = 2, progress: Progress = silent) -> LogComparison:
    """Simulate every recorded axis under its command and lay it over what was measured.

    A time shift of a few samples, the encoder's zero, the integrator's torque at the start and the screw's angle are
    fitted with their priors; the machine is taken as it is.

    Raises:
        InputError: No log has a recording, or a controller is missing.
    """
    check_recorded(campaign, machine)
    fits = {}
    for i, axis in enumerate(campaign.logs.axes):
        progress("simulating", i, len(campaign.logs.axes))
        fitter = LogFitter(machine, axis_data(campaign.logs, axis, machine), threads)
        fits[axis] = (fitter, fit_as_given(fitter, machine))
    return overlay_logs(campaign, machine, fits)


def check_recorded(campaign: Campaign, machine: Machine) -> None:
    """Refuse a campaign without any recording, controllers that the machine does not have, and unstable loops."""
    if not campaign.logs.recorded:
        raise InputError(f"{campaign.folder / 'campaign.toml'}: no log has a trace; comparing needs at least one")
    refuse_mistakes(campaign)
    check_controllers(campaign.logs, machine)
    refuse_unstable(campaign, machine)


def overlay_logs(campaign: Campaign, machine: Machine, fits: Mapping[str, tuple[LogFitter, AxisFit]]) -> LogComparison:
    """Comparison of given fits, one per axis."""
    found: dict[str, dict[str, ComparedAxis]] = {t.name: {} for t in campaign.logs.recorded}
    for axis, (fitter, fit) in fits.items():
        for k, d in enumerate(fitter.data):
            found[d.name][axis] = _compared(campaign, fitter, fit.model, d, k)
    tests = []
    for test in campaign.logs.recorded:
        axes = {a: found[test.name][a] for a in test.axes}
        tests.append(ComparedLog(test, axes, _circle(test, campaign.logs.recordings[test.name], axes)))
    return LogComparison(campaign, machine, tuple(tests))


def _compared(campaign: Campaign, fitter: LogFitter, model: AxisModel, d: AxisData, k: int) -> ComparedAxis:
    vector = model.vector
    motion = fitter.motion(model, vector, k)
    gear = model.machine.drives[d.axis].gear
    return ComparedAxis(
        d.axis,
        campaign.logs.tests[0].chain.is_rotary(d.axis),
        d.time,
        d.record.command,
        d.record.actual,
        fitter.positions(model, vector, k),
        np.interp(d.time, motion.time, motion.velocity),
        np.interp(d.time, motion.time, motion.torque),
        d.record.motor_torque(gear),
        d.noise,
        model.nuisance(vector, SHIFT, d.name),
        model.nuisance(vector, ZERO, d.name),
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
