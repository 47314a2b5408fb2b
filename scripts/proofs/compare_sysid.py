"""The same identification by MuJoCo's own toolbox (mujoco.sysid) and by mjsim, side by side.

    python scripts/proofs/compare_sysid.py CAMPAIGN --test NAME --axis X

Both get one log of one axis under a P-P cascade (no integrator, no feedforward), and find inertia, viscous and Coulomb
friction, a constant force and both gains. MuJoCo's model is a mass on a slide joint with damping and frictionloss and
an actuator with affine bias. It needs the packages of ``pip install "mujoco[sysid]"``.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.inference.axis_logs.candidates import Catalogue
from mjsim.inference.axis_logs.data import axis_data
from mjsim.inference.axis_logs.fit import LogFitter
from mjsim.inference.axis_logs.gains import read_gains
from mjsim.inference.axis_logs.separability import intervals
from mjsim.inference.axis_logs.start import start_model
from mjsim.instruments.axis_log.measurement import AxisRecord
from mjsim.machine.model import Machine
from mjsim.threads import one_blas_thread
from mjsim.units import UM

MODEL = """
<mujoco>
  <option timestep="{step}" gravity="0 0 0" integrator="implicitfast"/>
  <worldbody>
    <body name="axis"><joint name="q" type="slide" axis="1 0 0"/><geom name="mass" size="0.01" mass="1"/></body>
  </worldbody>
  <actuator><general name="servo" joint="q" gaintype="fixed" biastype="affine"/></actuator>
  <sensor><jointpos name="position" joint="q"/></sensor>
</mujoco>
"""
#: Factor by which each number may be off its start.
RANGE = 20.0
NAMES = ("inertia", "viscous", "coulomb", "offset", "position_gain", "velocity_gain")


def starts(machine: Machine, axis: str, controller: str) -> dict[str, float]:
    """Numbers from which both begin, at the load: kg, N·s/m, N, N, 1/s, N·s/m."""
    drive = machine.under(controller).drives[axis]
    square = drive.gear**2
    viscous, gain = drive.viscous * square, drive.velocity_gain * square
    start = {"inertia": drive.inertia * square, "viscous": viscous, "coulomb": 0.1 * viscous, "offset": 0.02 * viscous}
    return start | {"position_gain": drive.position_gain, "velocity_gain": gain}


def by_sysid(record: AxisRecord, step: float, start: dict[str, float], free: tuple[str, ...]):
    """RMS (m), numbers and half 95 % intervals that mujoco.sysid finds."""
    import mujoco
    from mujoco import sysid  # pyright: ignore[reportAttributeAccessIssue]

    if not hasattr(sysid, "optimize"):  # without its packages it is an empty module
        raise SystemExit('mujoco.sysid needs packages of its own: pip install "mujoco[sysid]"')
    spec = mujoco.MjSpec.from_string(MODEL.format(step=step))

    def build(params, spec):
        """The model with the parameters in it: the actuator's gains are products of two of them."""
        x = {n: float(params[n].value[0]) * start[n] for n in NAMES}
        fresh = spec.copy()
        joint, servo = fresh.joint("q"), fresh.actuator("servo")
        # a body's mass, no armature: dry friction is as stiff as the mass of the body allows
        fresh.geom("mass").mass, joint.frictionloss = x["inertia"], x["coulomb"]
        joint.damping = np.array([x["viscous"], *np.zeros(np.size(joint.damping) - 1)])
        servo.gainprm[0] = x["position_gain"] * x["velocity_gain"]
        servo.biasprm[:3] = [-x["offset"], -servo.gainprm[0], -x["velocity_gain"]]
        return fresh.compile()

    params = sysid.ParameterDict()
    for n in NAMES:
        low = -RANGE if n == "offset" else 1.0 / RANGE
        params.add(sysid.Parameter(n, 1.0, low, RANGE, frozen=n not in free))
    times = step * np.arange(len(record.command))
    control = sysid.TimeSeries(times, record.command[:, None], {"servo_ctrl": (sysid.SignalType.MjCtrl, np.array([0]))})
    measured = sysid.TimeSeries(times, record.actual[:, None], {"position": (sysid.SignalType.MjSensor, np.array([0]))})

    def in_um(params, predicted, recorded, model, return_pred_all, state, sensor_weights=None):
        """The state less what was recorded: a rollout's sensors are those of the step before."""
        rest = np.interp(state[:, 0], recorded.times, recorded.data[:, 0]) - state[:, 1]
        return (rest / UM)[:, None], predicted, predicted

    model = build(params, spec)
    rate = float(np.polyfit(times[:50], record.actual[:50], 2)[1]) if np.ptp(record.command[:200]) else 0.0
    begin = sysid.create_initial_state(model, record.actual[:1], np.array([rate]))
    runs = sysid.ModelSequences("axis", spec, "log", begin, control, measured)
    residual = sysid.build_residual_fn(models_sequences=[runs], build_model=build, modify_residual=in_um)
    best, result = sysid.optimize(params, residual, optimizer="mujoco", verbose=False, eps=1e-5, max_iters=60)
    left, _, _ = residual(result.x, best)
    _, half = sysid.calculate_intervals([np.ravel(r) for r in left], result.jac)
    rms = UM * float(np.sqrt(np.mean(np.concatenate([np.ravel(r) for r in left]) ** 2)))
    found = {n: (float(v) * start[n], float(h) * abs(start[n])) for n, v, h in zip(free, result.x, half, strict=True)}
    return rms, found


@one_blas_thread
def by_mjsim(campaign, machine: Machine, axis: str, free: tuple[str, ...]):
    """The same by mjsim."""
    data = axis_data(campaign, axis, machine)
    # a recorded output also says over how many samples the control takes the velocity
    fitter, model = LogFitter(machine, data), start_model(machine, data, read_gains(machine, data))
    found = Catalogue(machine, data).missing(model)
    for kind in ("friction", "constant_force"):
        if machine.effect(f"{kind}.{axis}") is None:
            model = next(c for c in found if c.effect.kind == kind).extend(model)
    # Coulomb friction as such: bristles as stiff as they start; no shift in time; gains as stated where known
    held = {n for n in ("position_gain", "velocity_gain") if n not in free} | {"presliding_rad", "shift"}
    kept = tuple(replace(e, deviation=1e-4) if e.name in held else e for e in model.entries)
    fit = fitter.fit(replace(model, entries=kept))
    gear, ends = machine.drives[axis].gear, intervals(fitter.polished(fit))
    labels = {"inertia": ("drive.inertia", gear**2), "viscous": ("drive.viscous", gear**2)}
    labels |= {"coulomb": (f"friction.{axis}.coulomb_Nm", gear), "offset": (f"constant_force.{axis}.torque_Nm", gear)}
    controller = data[0].test.controller
    labels |= {"position_gain": (f"controller.{controller}.position_gain", 1.0)}
    labels |= {"velocity_gain": (f"controller.{controller}.velocity_gain", gear**2)}
    out = {}
    for n in free:
        label, factor = labels[n]
        value, low, high = (factor * x for x in ends[label])
        out[n] = (value, 0.5 * abs(high - low))
    return fit.rms, out


def timed(work: Callable):
    """Result, wall time and processor time of a piece of work."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    return result, time.perf_counter() - wall, time.process_time() - cpu


def main() -> None:
    """Identify by both and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", type=Path)
    parser.add_argument("--test", required=True)
    parser.add_argument("--axis", default="X")
    parser.add_argument("--known-gains", action="store_true", help="hold both gains as stated")
    given = parser.parse_args()
    campaign = read_campaign(given.campaign)
    machine = read_machine(campaign.machine_file)
    test = next(t for t in campaign.of("axis_log").tests if t.name == given.test)
    campaign = campaign.only([given.test])
    recording = campaign.traces[test.name]
    start = starts(machine, given.axis, test.controller or "")
    free = NAMES[:4] if given.known_gains else NAMES
    record = recording.axes[given.axis]
    rows = {
        "mujoco.sysid": timed(lambda: by_sysid(record, recording.step, start, free)),
        "mjsim": timed(lambda: by_mjsim(campaign, machine, given.axis, free)),
    }
    for name, ((rms, _), wall, cpu) in rows.items():
        print(f"{name}: {rms / UM:.2f} µm RMS, {wall:.1f} s ({cpu:.1f} s of processor time)")
    print("\n| number | " + " | ".join(rows) + " |\n|---|" + "---|" * len(rows))
    for n in free:
        cells = [f"{found[n][0]:.5g} ± {found[n][1]:.2g}" for (_, found), _, _ in rows.values()]
        print(f"| {n} | " + " | ".join(cells) + " |")
    if not math.isfinite(rows["mujoco.sysid"][0][0]):
        print("mujoco.sysid did not converge")


if __name__ == "__main__":
    main()
