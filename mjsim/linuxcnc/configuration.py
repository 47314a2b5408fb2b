"""The files that make LinuxCNC the control of a machine: INI file, HAL file, kinematics, corrections."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.machine.chain import SENSES, Chain, usual_speed
from mjsim.nc.control import Control, linuxcnc
from mjsim.nc.limits import model_limits, scale

#: Servo period of LinuxCNC, s.
CYCLE = 1e-3
#: Acceleration of every axis where the user says none, mm/s² and °/s² (assumed: 20 m/s², a fast machine).
ACCELERATION = 20_000.0
#: Acceleration of the joints, mm/s² and °/s²: it only paces homing and corrections, so they are carried out at once.
JOINT_ACCELERATION = 1e6
#: Travel of an axis without limits, mm and degrees.
_ENDLESS = 36_000.0
#: Where the kinematics are, and how those with tool centre point control of a tilting and a round table are called.
_MODULES, _TIP = Path("/usr/lib/linuxcnc/modules"), "{letters}-trt-kins"
#: Pin that makes them count as ISO 841 says; without it they do the opposite.
_PIN = "conventional-directions"
_SWITCH = {
    "428": "o<428remap>sub\n  M68 E3 Q1\n  M66 E0 L0\no<428remap>endsub\n",
    "429": "o<429remap>sub\n  M68 E3 Q0\n  M66 E0 L0\no<429remap>endsub\n",
}


@dataclass(frozen=True)
class Settings:
    """How LinuxCNC is set up and run.

    Attributes:
        acceleration: MAX_ACCELERATION of axes, mm/s² or °/s², by letter; others get :data:`ACCELERATION`. MAX_VELOCITY
            is the usual one of :mod:`mjsim.machine.chain`.
        speed: The control's clock runs so many times as fast as a real one. It needs a C compiler.
        corrections: Folder that ``mjsim compensate --control linuxcnc`` wrote, with ``joints.ini`` and its tables.
        limit: Longest run on the clock of the wall, s.
        probe: Distance at which a simulated probe switches, mm, from the place that the program names by its analog
            outputs 0 to 2 (``M68``), mm; 0: there is none.
    """

    acceleration: Mapping[str, float] = field(default_factory=dict)
    speed: float = 20.0
    corrections: Path | None = None
    limit: float = 600.0
    probe: float = 0.0

    def model(self, chain: Chain) -> Control:
        """The model of LinuxCNC with these settings."""
        return linuxcnc(chain, self.accelerations(chain), usual_speed(chain))

    def accelerations(self, chain: Chain) -> np.ndarray:
        """Of every axis, (axes,) m/s² and rad/s²."""
        return np.array([self.acceleration.get(a, ACCELERATION) * scale(a) for a in chain.letters])


def check_settings(settings: Settings, chain: Chain) -> None:
    """Refuse settings that cannot be.

    Raises:
        InputError: an axis is none of the machine, a number is out of bounds, or corrections are not there.
    """
    for axis, value in settings.acceleration.items():
        if axis not in chain.letters:
            raise InputError(
                f"acceleration of {axis}: the machine has no such axis; allowed: {', '.join(chain.letters)}"
            )
        if not 1.0 <= value <= 1e6:
            raise InputError(f"acceleration of {axis}: {value:g} mm/s² or °/s²; allowed: 1 to 1000000")
    if not 0.1 <= settings.speed <= 50.0:
        raise InputError(f"speed of {settings.speed:g} times real time; allowed: 0.1 to 50")
    if settings.corrections is not None and not settings.corrections.is_dir():
        raise InputError(
            f"{settings.corrections}: no such folder; allowed: what mjsim compensate --control linuxcnc wrote"
        )


def write_configuration(folder: Path, chain: Chain, settings: Settings, tip: bool) -> None:
    """Write all files that LinuxCNC reads.

    Args:
        folder: Where it will work.
        chain: Axes of the machine; joint n is the n-th of them.
        settings: How it is set up.
        tip: Whether the program switches tool centre point control on.

    Raises:
        InputError: LinuxCNC has no kinematics for tool centre point control of this machine.
    """
    (folder / "machine.ini").write_text(
        _ini(chain, settings, tip, _corrections(folder, settings.corrections)), encoding="utf-8"
    )
    (folder / "machine.hal").write_text(_hal(chain, tip, settings.probe), encoding="utf-8")
    (folder / "tool.tbl").write_text("T1 P1 Z0 D0 ;\n", encoding="utf-8")
    (folder / "linuxcnc.var").write_text("", encoding="utf-8")
    for code, text in _SWITCH.items() if tip else ():
        (folder / f"{code}remap.ngc").write_text(text, encoding="utf-8")


def kinematics(chain: Chain, tip: bool) -> str:
    """The kinematics module of LinuxCNC with its parameters.

    Raises:
        InputError: there is none with tool centre point control for this machine.
    """
    letters = "".join(chain.letters)
    if not tip:
        return f"trivkins coordinates={letters}"
    name = _TIP.format(letters=letters.lower())
    if chain.swivelling or len(chain.rotary) != 2 or not (_MODULES / f"{name}.so").exists():
        raise InputError(
            f"LinuxCNC has no kinematics with tool centre point control for the configuration {chain.configuration!r}; "
            f"allowed: a round table on a tilting one"
        )
    if conventional(chain) and _PIN.encode() not in (_MODULES / f"{name}.so").read_bytes():
        raise InputError(
            f"LinuxCNC: {name} of this version has no pin {_PIN}, so that it counts the axes of a table against "
            f"ISO 841; allowed: LinuxCNC 2.10 or later, a program without tool centre point control, or a machine with "
            'sense = "opposite"'
        )
    return f"{name} sparm=identityfirst"


def conventional(chain: Chain) -> bool:
    """Whether both rotary axes count as ISO 841 says: LinuxCNC's kinematics have one switch for the two.

    Raises:
        InputError: one of them does and the other does not.
    """
    senses = {a: chain.sense(a) for a in chain.rotary}
    if len(set(senses.values())) > 1:
        raise InputError(
            f"LinuxCNC counts both axes of a table in one sense; found: "
            f"{', '.join(f'{a} {s}' for a, s in senses.items())}; allowed: one sense for both, or a program without "
            "tool centre point control"
        )
    return SENSES[0] in senses.values()


def _corrections(work: Path, folder: Path | None) -> dict[int, list[str]]:
    """INI lines by joint; the tables that they name are copied beside the INI file."""
    lines: dict[int, list[str]] = {}
    if folder is None or not (folder / "joints.ini").exists():
        return lines
    joint = -1
    for line in (folder / "joints.ini").read_text(encoding="utf-8").splitlines():
        if found := re.fullmatch(r"\[JOINT_(\d)\]", line.strip()):
            joint = int(found[1])
        elif "=" in line and not line.startswith(";"):
            lines.setdefault(joint, []).append(line)
            if line.startswith("COMP_FILE ="):
                name = line.split("=")[1].strip()
                shutil.copy(folder / name, work / name)
    return lines


def _ini(chain: Chain, settings: Settings, tip: bool, corrections: dict[int, list[str]]) -> str:
    letters = "".join(chain.letters)
    accelerations = {a: settings.acceleration.get(a, ACCELERATION) for a in chain.letters}
    turning = max((accelerations[a] for a in chain.rotary), default=ACCELERATION)
    remap = "\nSUBROUTINE_PATH = .\n" + "\n".join(f"REMAP = M{m} modalgroup=10 ngc={m}remap" for m in _SWITCH)
    out = [
        "[EMC]\nVERSION = 1.1\nMACHINE = mjsim\nDEBUG = 0",
        "[DISPLAY]\nDISPLAY = /bin/true\nMAX_FEED_OVERRIDE = 1.0",
        "[FILTER]",
        "[RS274NGC]\nPARAMETER_FILE = linuxcnc.var\nRS274NGC_STARTUP_CODE = G21 G90 G17 G40 G49 G54 G94"
        + (remap if tip else ""),
        f"[EMCMOT]\nEMCMOT = motmod\nCOMM_TIMEOUT = 4.0\nSERVO_PERIOD = {CYCLE * 1e9:.0f}",
        "[TASK]\nTASK = milltask\nCYCLE_TIME = 0.001",
        "[EMCIO]\nEMCIO = io\nCYCLE_TIME = 0.010\nTOOL_TABLE = tool.tbl",
        "[HAL]\nHALFILE = machine.hal",
        f"[KINS]\nKINEMATICS = {kinematics(chain, tip)}\nJOINTS = {chain.count}",
        f"[TRAJ]\nCOORDINATES = {letters}\nLINEAR_UNITS = mm\nANGULAR_UNITS = deg\nDEFAULT_LINEAR_VELOCITY = 100\n"
        f"MAX_LINEAR_VELOCITY = 1000\nDEFAULT_LINEAR_ACCELERATION = {JOINT_ACCELERATION:.0f}\n"
        f"MAX_LINEAR_ACCELERATION = {JOINT_ACCELERATION:.0f}\nMAX_ANGULAR_VELOCITY = 360\n"
        f"MAX_ANGULAR_ACCELERATION = {turning:.3f}\nARC_BLEND_ENABLE = 1",
    ]
    limits, fast = model_limits(chain), usual_speed(chain)
    for n, axis in enumerate(chain.letters):
        unit = scale(axis)
        low, high = max(limits.low[n] / unit, -_ENDLESS), min(limits.high[n] / unit, _ENDLESS)
        kind = "ANGULAR" if chain.is_rotary(axis) else "LINEAR"
        ends = f"MIN_LIMIT = {low:.4f}\nMAX_LIMIT = {high:.4f}\nMAX_VELOCITY = {fast[n] / unit:.4f}"
        out.append(f"[AXIS_{axis}]\n{ends}\nMAX_ACCELERATION = {accelerations[axis]:.3f}")
        joint = f"TYPE = {kind}\nHOME = 0\nHOME_SEQUENCE = 0\n{ends}\nMAX_ACCELERATION = {JOINT_ACCELERATION:.0f}"
        out.append("\n".join([f"[JOINT_{n}]", joint, "FERROR = 10\nMIN_FERROR = 10", *corrections.get(n, [])]))
    return "\n\n".join(out) + "\n"


def _hal(chain: Chain, tip: bool, probe: float = 0.0) -> str:
    """Joints that follow at once, and the sampler: motor-pos-cmd and pos-cmd of every joint, line, kind of motion; and
    a probe that switches at a distance, mm.
    """
    n = chain.count
    out = [
        "loadrt [KINS]KINEMATICS",
        "loadrt motmod servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints=[KINS]JOINTS num_aio=4",
        f"loadrt sampler depth=100000 cfg={'f' * 2 * n}ss",
        *(f"addf {f} servo-thread" for f in ("motion-command-handler", "motion-controller", "sampler.0")),
    ]
    for i in range(n):
        out.append(f"net told{i} joint.{i}.motor-pos-cmd => joint.{i}.motor-pos-fb sampler.0.pin.{i}")
        out.append(f"net path{i} joint.{i}.pos-cmd => sampler.0.pin.{n + i}")
    out += [
        f"net line motion.program-line => sampler.0.pin.{2 * n}",
        f"net kind motion.motion-type => sampler.0.pin.{2 * n + 1}",
        "setp sampler.0.enable 0",
        "net estop iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in",
        "net prepare iocontrol.0.tool-prepare => iocontrol.0.tool-prepared",
        "net change iocontrol.0.tool-change => iocontrol.0.tool-changed",
    ]
    if tip and conventional(chain):
        out.append(f"setp {_TIP.format(letters=''.join(chain.letters).lower())}.{_PIN} 1")
    if tip:
        out.append("net switch motion.analog-out-03 => motion.switchkins-type")
    return "\n".join([*out, *(_probe(chain, probe) if probe else [])]) + "\n"


def _probe(chain: Chain, distance: float) -> list[str]:
    """A probe's signal from where the linear axes are: one servo cycle late, as a real one is."""
    axes = [chain.letters.index(a) for a in chain.linear]
    out = ["loadrt sum2 count=3", "loadrt hypot", "loadrt comp"]
    out += [f"addf {f} servo-thread" for f in ("sum2.0", "sum2.1", "sum2.2", "hypot.0", "comp.0")]
    for k, joint in enumerate(axes):
        out.append(f"net path{joint} => sum2.{k}.in0")
        out.append(f"net place{k} motion.analog-out-0{k} => sum2.{k}.in1")
        out.append(f"setp sum2.{k}.gain1 -1")
        out.append(f"net away{k} sum2.{k}.out => hypot.0.in{k}")
    out.append("net distance hypot.0.out => comp.0.in0")
    out.append(f"setp comp.0.in1 {distance:.6f}")
    return [*out, "setp comp.0.hyst 0", "net touch comp.0.out => motion.probe-input"]
