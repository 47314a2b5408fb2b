"""How often the diagnosis of axis logs is right, on logs of an independent generator.

python scripts/benchmarks/benchmark_logs.py [--count 100] [--seed 1] [--drives [--left-out] | --torque]

Half of the machines are sound, half have one cause. With --drives, every machine has one cause of real drives: play
outside or inside the position loop, dead time, a filter of the command, a torque limit, a loss by the torque, a wrong
position gain, a limit of speed or voltage, an encoder that reads wrong, a held set-point. The torque, a current of
unknown constant, or neither is recorded.

With --left-out, the planted cause is not in the catalogue, nor is one that contains its law: nothing may be identified.

With --torque, sound machines are fitted whose data sheet is believed within a factor of five, and nothing is searched
for: how much narrower does a recorded torque make the 95 % intervals of their numbers? The control is four times as
fast as the recorder.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Collection
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.commands.axis_log.diagnose import diagnose_logs
from mjsim.commands.axis_log.diagnosis import LogDiagnosis
from mjsim.inference.axis_logs.candidates import Candidate, Catalogue
from mjsim.inference.axis_logs.data import axis_data
from mjsim.inference.axis_logs.encoders import EncoderCatalogue
from mjsim.inference.axis_logs.fit import LogFitter
from mjsim.inference.axis_logs.separability import intervals
from mjsim.inference.axis_logs.start import start_model
from tests.independent.logs import (
    CAMPAIGN,
    Axis,
    Control,
    csv,
    filtered,
    machine_toml,
    record,
    record_both,
    short_strokes,
    to_and_fro,
    write_campaign,
)

#: Kinds that stand for each other in a log: while an axis slides, a constant force is a friction by direction.
_SAME = {"friction_direction": "constant_force"}
#: Kinds whose law another one contains: a voltage limit whose line is level is a torque limit, and one whose line falls
#: as the velocity loop does is a speed limit.
_CONTAINS = {"current_clip": "voltage_limit", "speed_limit": "voltage_limit"}


@dataclass(frozen=True)
class Case:
    """One log and what hides in it.

    Attributes:
        axis: As it is.
        control: As it is.
        planted: Kind of the cause, its leading parameter and its value; nothing in a sound machine.
        friction: Coulomb friction that the machine file has, N·m.
        wrong: Numbers of the machine file that are wrong.
        torque: Whether the torque was recorded.
    """

    axis: Axis
    control: Control
    planted: tuple[str, str, float] | None
    friction: float
    wrong: dict[str, float] = field(default_factory=dict)
    torque: bool = False


def cases(count: int, seed: int) -> list[Case]:
    """Random machines, every second one with a cause."""
    random = np.random.default_rng(seed)
    out = []
    for i in range(count):
        coulomb = float(random.uniform(0.06, 0.2))
        axis = Axis(
            inertia=float(random.uniform(3e-4, 7e-4)),
            viscous=float(random.uniform(0.004, 0.012)),
            coulomb=coulomb,
            presliding=float(random.uniform(0.002, 0.008)),
        )
        control = Control(
            position_gain=float(random.uniform(35.0, 60.0)), velocity_gain=float(random.uniform(0.05, 0.09))
        )
        if random.random() < 0.5:
            control = replace(control, integral_time=float(random.uniform(0.02, 0.06)), feedforward=1.0)
        case = Case(axis, control, None, coulomb, torque=bool(random.random() < 0.3))
        out.append(_faulty(case, random) if i % 2 else case)
    return out


def _faulty(case: Case, random: np.random.Generator) -> Case:
    axis, sign = case.axis, float(random.choice([-1.0, 1.0]))
    kinds = ["friction", "torque_ripple", "viscous_direction", "loop_delay"]
    # an integrator holds a constant force from the start: no log of the motor shows it
    kinds.append("integral_time" if np.isfinite(case.control.integral_time) else "constant_force")
    kind = str(random.choice(kinds))
    if kind == "friction":
        return replace(case, planted=(kind, "coulomb_Nm", axis.coulomb), friction=0.0)
    if kind == "torque_ripple":
        size, order = float(random.uniform(0.01, 0.05)), float(random.integers(1, 7))
        wavy = replace(axis, ripple=size, ripple_order=order, ripple_phase=float(random.uniform(-3.0, 3.0)))
        return replace(case, axis=wavy, planted=(kind, "amplitude_Nm", size))
    if kind == "constant_force":
        size = sign * float(random.uniform(0.02, 0.06))
        return replace(case, axis=replace(axis, constant=size), planted=(kind, "torque_Nm", size))
    if kind == "viscous_direction":
        share = sign * float(random.uniform(0.15, 0.4))
        return replace(case, axis=replace(axis, viscous_share=share), planted=(kind, "share_ratio", share))
    if kind == "integral_time":
        ratio = float(random.choice([0.4, 0.6, 1.6, 2.5]))
        stated = {"integral_time": case.control.integral_time / ratio}
        return replace(case, planted=(kind, "ratio", ratio), wrong=stated)
    control = replace(case.control, delay_samples=int(random.integers(1, 4)))
    return replace(case, control=control, planted=(kind, "delay_ms", float(control.delay_samples)))


def diagnosed(case: Case, folder: Path, seed: int) -> LogDiagnosis:
    """The diagnosis of a case's log."""
    command = to_and_fro(case.control.sample)
    position, torque = record(case.axis, case.control, command, 0.05e-6, seed)
    (folder / "strokes.csv").write_text(csv(command, position, torque if case.torque else None))
    (folder / "campaign.toml").write_text(CAMPAIGN)
    (folder / "machine.toml").write_text(machine_toml(case.axis, case.control, False, case.friction, **case.wrong))
    return diagnose_logs(read_campaign(folder), read_machine(folder / "machine.toml"))


@dataclass(frozen=True)
class DriveCase:
    """One log of a drive with one cause.

    Attributes:
        axis: As it is.
        control: As it is.
        stated: Control that the machine file has.
        planted: Kind of the cause, its leading parameter and its value.
        encoder: Of the machine file.
        channel: ``torque``, ``current`` or nothing.
        constant: Of the motor, N·m/A, of either sign; the machine file does not have it.
    """

    axis: Axis
    control: Control
    stated: Control
    planted: tuple[str, str, float]
    encoder: str
    channel: str
    constant: float


def drive_cases(count: int, seed: int) -> list[DriveCase]:
    """Random machines, the causes in turn."""
    random = np.random.default_rng([seed, 7])
    kinds = ("backlash", "servo_delay", "command_filter", "current_clip", "torque_loss", "servo_gain")
    kinds = (*kinds, "speed_limit", "voltage_limit", "encoder_error", "held_set_point")
    out = []
    for i in range(count):
        kind = kinds[i % len(kinds)]
        axis = Axis(
            inertia=float(random.uniform(3e-4, 7e-4)),
            viscous=float(random.uniform(0.004, 0.012)),
            coulomb=float(random.uniform(0.06, 0.2)),
            presliding=float(random.uniform(0.002, 0.008)),
        )
        control = Control(float(random.uniform(35.0, 60.0)), float(random.uniform(0.05, 0.09)))
        if random.random() < 0.5:
            control = replace(control, integral_time=float(random.uniform(0.02, 0.06)), feedforward=1.0)
        stated, encoder, size = control, "motor", float(random.uniform(0.0, 1.0))
        if kind == "backlash":
            encoder = ("motor", "load", "both")[i // len(kinds) % 3]
            control = stated = replace(control, on_load=encoder != "motor")
            planted = (kind, "width_um", 4.0 + 26.0 * size)
            axis = replace(axis, play=planted[2] * 1e-6)
        elif kind == "servo_delay":
            planted = (kind, "delay_ms", round(8.0 + 40.0 * size))
        elif kind == "command_filter":
            planted = (kind, ("lag_ms", "mean_ms")[i // len(kinds) % 2], 4.0 + 20.0 * size)
        elif kind == "current_clip":
            planted = (kind, "torque_Nm", (0.5 + 0.35 * size) * _largest(axis, control))
            control = replace(control, clip=planted[2])
        elif kind == "speed_limit":
            planted = (kind, "speed_rad_per_s", (0.5 + 0.35 * size) * _fastest(axis))
            control = replace(control, fastest=planted[2])
        elif kind == "voltage_limit":
            planted = (kind, "no_load_rad_per_s", (0.7 + 0.4 * size) * _fastest(axis))
            control = replace(control, no_load=planted[2], stall=1.5 * _largest(axis, control))
        elif kind == "encoder_error":
            planted = (kind, "amplitude_deg", 0.12 + 0.3 * size)
            order, phase = float(random.choice([1.0, 2.0, 4.0])), float(random.uniform(-3.0, 3.0))
            axis = replace(axis, misread=np.radians(planted[2]), misread_order=order, misread_phase=phase)
        elif kind == "held_set_point":
            control = replace(control, every=int(random.choice([2, 4, 8])))
            planted = (kind, "time_ms", 1e3 * control.every * control.sample)
        elif kind == "torque_loss":
            planted = (kind, "share_ratio", 0.15 + 0.35 * size)
            axis = replace(axis, loss=planted[2])
        else:
            ratio = float(random.choice([0.6, 0.75, 1.3, 1.6]))
            planted = (kind, "ratio", ratio)
            stated = replace(control, position_gain=control.position_gain / ratio)
        channel = str(random.choice(["torque", "current", ""]))
        out.append(DriveCase(axis, control, stated, planted, encoder, channel, float(random.choice([-0.6, 0.4, 1.1]))))
    return out


def _largest(axis: Axis, control: Control) -> float:
    """Largest torque of a drive without a limit, N·m, but for single peaks."""
    return float(np.quantile(np.abs(record(axis, control, to_and_fro(), 0.0)[1]), 0.99))


def _fastest(axis: Axis) -> float:
    """Largest commanded speed of a motor, rad/s."""
    return float(np.abs(np.diff(to_and_fro())).max()) / Control.sample * 2.0 * np.pi / axis.lead


def drive_diagnosed(case: DriveCase, folder: Path, seed: int) -> LogDiagnosis:
    """The diagnosis of a drive's log."""
    command, (kind, name, value) = to_and_fro(), case.planted
    told = command
    if kind == "servo_delay":
        told = np.concatenate([np.full(int(value), command[0]), command[: -int(value)]])
    elif kind == "command_filter":
        told = filtered(command, case.control.sample, name, 1e-3 * value)
    motor, load, torque = record_both(case.axis, case.control, told, 0.05e-6, seed)
    shown = {"torque": torque, "current": torque / case.constant}.get(case.channel)
    rows = csv(command, load if case.encoder == "load" else motor, shown).splitlines()
    if case.channel == "current":
        rows[0] = rows[0].replace("X_torque_Nm", "X_current_A")
    if kind == "backlash" and case.encoder != "load":
        rows = [rows[0] + ",X_load_mm", *(f"{row},{1e3 * y:.7f}" for row, y in zip(rows[1:], load, strict=True))]
    machine = machine_toml(case.axis, case.stated, False, case.axis.coulomb)
    machine = machine.replace("[drive.X]", f'[drive.X]\nencoder = "{case.encoder}"')
    write_campaign(folder, "\n".join(rows) + "\n", machine)
    return diagnose_logs(read_campaign(folder), read_machine(folder / "machine.toml"))


def without(kinds: Collection[str | None], missing: Callable[..., list[Candidate]]) -> Callable[..., list[Candidate]]:
    """The causes of a catalogue without those of some kinds."""
    return lambda *given: [c for c in missing(*given) if c.effect.kind not in kinds]


def run_left_out(count: int, seed: int) -> None:
    """Run the drives with the planted cause left out of the catalogue and print what is said then."""
    tally = Counter()
    for i, case in enumerate(drive_cases(count, seed)):
        kind, _, value = case.planted
        with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
            for catalogue in (Catalogue, EncoderCatalogue):
                lacking = without({kind, _CONTAINS.get(kind)}, catalogue.missing)
                stack.enter_context(patch.object(catalogue, "missing", lacking))
            result = drive_diagnosed(case, Path(folder), i)
        sure = [e.effect.kind for e in result.effects if (e.probability or 0.0) >= 0.95]
        tally["logs"] += 1
        tally[f"verdict {result.verdict}"] += 1
        tally["a name with 95 % or more"] += bool(sure)
        found = ", ".join(f"{e.effect.kind} ({e.probability:.2f})" for e in result.effects) or "nothing"
        print(f"{i}: {kind} {value:.5g} left out: {result.verdict}: {found}", flush=True)
    for name, number in tally.items():
        print(f"{name}: {number}")


def run_drives(count: int, seed: int) -> None:
    """Run the drives and print how often they were right."""
    tally, begun = Counter(), time.process_time()
    for i, case in enumerate(drive_cases(count, seed)):
        with tempfile.TemporaryDirectory() as folder:
            result = drive_diagnosed(case, Path(folder), i)
        kind, parameter, value = case.planted
        sure = {_SAME.get(e.effect.kind, e.effect.kind) for e in result.effects if (e.probability or 0.0) >= 0.95}
        mine = next((e for e in result.effects if e.effect.kind == kind), None)
        tally["logs"] += 1
        tally["the cause is named"] += mine is not None
        tally["the cause is named, and nothing else"] += {e.effect.kind for e in result.effects} == {kind}
        tally["something else is named with 95 % or more"] += bool(sure - {kind})
        tally["unknown"] += result.verdict == "unknown"
        if mine is not None and parameter in mine.ci95:
            low, high = mine.ci95[parameter]
            tally["intervals"] += 1
            tally["intervals that hold the value"] += low <= value <= high
            said = f"{value:.5g} in [{low:.5g}, {high:.5g}]" if low <= value <= high else f"{value:.5g} OUTSIDE"
            said += "" if low <= value <= high else f" [{low:.5g}, {high:.5g}]"
        else:
            said = f"{value:.5g}"
        found = ", ".join(f"{e.effect.kind} ({e.probability:.2f})" for e in result.effects) or "nothing"
        where = f"{case.encoder}, {case.channel or 'positions alone'}"
        print(f"{i}: {kind} {parameter} {said}, {where}: {result.verdict}: {found}", flush=True)
    for name, number in tally.items():
        print(f"{name}: {number}")
    print(f"{(time.process_time() - begun) / count:.2f} s of processor time for one log")


def run_torque(count: int, seed: int) -> None:
    """Fit machines with and without a recorded torque and print how much narrower their intervals are."""
    narrower: dict[str, list[float]] = {}
    held: Counter[str] = Counter()
    for i, case in enumerate(cases(2 * count, seed)[::2]):
        control = replace(case.control, sample=2.5e-4)
        command, every = short_strokes(control.sample), 4
        position, torque = record(case.axis, control, command, 0.05e-6, i)
        stated = machine_toml(case.axis, control, True, case.axis.coulomb, velocity_gain=0.05, inertia=4e-4)
        true = {
            "drive.inertia": case.axis.inertia,
            "drive.viscous": case.axis.viscous,
            "controller.c.velocity_gain": control.velocity_gain,
            "friction.X.coulomb_Nm": case.axis.coulomb,
        }
        widths: dict[str, list[float]] = {}
        for recorded in (None, torque[::every]):
            with tempfile.TemporaryDirectory() as folder:
                text = csv(command[::every], position[::every], recorded, every * control.sample)
                write_campaign(Path(folder), text, stated, every * control.sample)
                campaign, machine = read_campaign(Path(folder)), read_machine(Path(folder) / "machine.toml")
                data = axis_data(campaign, "X", machine)
                fitter = LogFitter(machine, data)
                ranges = intervals(fitter.polished(fitter.fit(start_model(machine, data))))
            for label, value in true.items():
                _, low, high = ranges[label]
                widths.setdefault(label, []).append(float(np.log(high / low)))
                held[label] += recorded is not None and low <= value <= high
        for label, (alone, both) in widths.items():
            narrower.setdefault(label, []).append(alone / both)
        print(f"{i}: " + ", ".join(f"{k} {a:.3f} -> {b:.3f}" for k, (a, b) in widths.items()), flush=True)
    for label, ratios in narrower.items():
        print(
            f"{label}: {min(ratios):.1f} to {max(ratios):.1f} times narrower with the torque, median "
            f"{np.median(ratios):.1f}; {held[label]} of {count} intervals hold"
        )


def main() -> None:
    """Run the bank and print how often it was right."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--drives", action="store_true")
    parser.add_argument("--left-out", action="store_true")
    parser.add_argument("--torque", action="store_true")
    given = parser.parse_args()
    if given.left_out:
        run_left_out(given.count, given.seed)
        return
    if given.torque:
        run_torque(given.count, given.seed)
        return
    if given.drives:
        run_drives(given.count, given.seed)
        return
    tally, begun = Counter(), time.process_time()
    for i, case in enumerate(cases(given.count, given.seed)):
        with tempfile.TemporaryDirectory() as folder:
            result = diagnosed(case, Path(folder), i)
        names = [_SAME.get(e.effect.kind, e.effect.kind) for e in result.effects]
        if case.planted is None:
            tally["sound"] += 1
            tally["sound: nothing found"] += not names
            said = "" if not names else f"sound machine: {names}"
        else:
            kind, parameter, value = case.planted
            tally["faulty"] += 1
            tally["faulty: the cause is named"] += kind in names
            tally["faulty: the cause alone is named"] += names == [kind]
            mine = next((e for e in result.effects if e.effect.kind == kind), None)
            if mine is not None and parameter in mine.ci95:
                low, high = mine.ci95[parameter]
                tally["intervals"] += 1
                tally["intervals: hold the value"] += low <= value <= high
                if not low <= value <= high:
                    print(f"{i}: {kind} {value:.5g} outside {low:.5g} to {high:.5g}", flush=True)
            said = (
                "" if names == [kind] else f"{kind} {value:.3g}: {names or 'nothing'}, {result.after.rms * 1e6:.3f} µm"
            )
        if said:
            print(f"{i}: {said}", flush=True)
    for name, count in tally.items():
        print(f"{name}: {count}")
    print(f"{(time.process_time() - begun) / given.count:.2f} s of processor time for one log")


if __name__ == "__main__":
    main()
