"""LinuxCNC as the control in the loop: runs an NC program headless and records every servo cycle.

Needs the package ``linuxcnc-uspace`` with the system's own Python (its modules ``linuxcnc`` and ``hal``), and
namespaces. Joints are simulated as ideal drives. Nothing here uses code of mjsim. This file is also the script that
the system's Python runs inside its own IPC, PID, network and mount namespaces:

    /usr/bin/python3 control_loop.py PROGRAM.nc RECORD.npy JOINTS.ini
"""

import array
import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

PYTHON = "/usr/bin/python3"
PROGRAMS = ("linuxcncsvr", "halcmd", "milltask", "rtapi_app", "io")
#: Acceleration of axes (the path) and of joints (homing and the pace of corrections), mm/s² and °/s².
AXIS, JOINT = 20_000, 1_000_000
AXES = "XYZAC"
_TRAVEL = {"X": 600, "Y": 600, "Z": 700, "A": 100, "C": 36_000}
#: A row of a record: sample number, motor-pos-cmd and pos-cmd of every joint, program line, motion type.
WIDTH = 13


def missing() -> str:
    """What is missing to run LinuxCNC here; empty where nothing is."""
    for name in PROGRAMS:
        if shutil.which(name) is None:
            return f"{name} of the package linuxcnc-uspace"
    clean = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    have = subprocess.run([PYTHON, "-c", "import hal, linuxcnc, numpy"], env=clean, capture_output=True)
    if have.returncode:
        return "the modules linuxcnc and hal of the system's Python"
    if subprocess.run([*_unshare(), "true"], capture_output=True).returncode:
        return "namespaces (unshare)"
    return ""


def _unshare() -> list[str]:
    mine = [] if os.getuid() == 0 else ["--user", "--map-current-user", "--keep-caps"]
    return ["unshare", *mine, "--ipc", "--net", "--pid", "--mount", "--fork", "--kill-child", "--mount-proc"]


def record(program: Path, corrections: Path | None, folder: Path, limit: float = 300.0):
    """Run a program and return its record, (n, WIDTH) in mm and degrees.

    Args:
        program: NC file; it stops at M0 before and after the path.
        corrections: folder with ``joints.ini`` and its tables, or None.
        folder: where the control works; its path has to be short.
    """
    import numpy as np

    out = folder / "record.npy"
    told = str(corrections / "joints.ini") if corrections and (corrections / "joints.ini").exists() else "-"
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "DISPLAY", "LD_PRELOAD")}
    command = [*_unshare(), PYTHON, os.path.abspath(__file__), str(program), str(out), told]
    done = subprocess.run(command, env=clean, capture_output=True, text=True, timeout=limit)
    if done.returncode:
        raise RuntimeError(f"LinuxCNC: {done.stdout[-1500:]} {done.stderr[-1500:]}")
    return np.load(out)


# -- what follows runs in the system's Python --------------------------------------------------------------------------


def _told(path: str, work: Path) -> dict[int, list[str]]:
    """INI lines by joint; the tables that they name are copied beside the INI file."""
    lines: dict[int, list[str]] = {}
    if path == "-":
        return lines
    joint = -1
    for line in Path(path).read_text().splitlines():
        if found := re.fullmatch(r"\[JOINT_(\d)\]", line.strip()):
            joint = int(found[1])
        elif "=" in line and not line.startswith(";"):
            lines.setdefault(joint, []).append(line)
            if line.startswith("COMP_FILE ="):
                name = line.split("=")[1].strip()
                shutil.copy(Path(path).parent / name, work / name)
    return lines


def _ini(told: dict[int, list[str]]) -> str:
    out = [
        "[EMC]\nVERSION = 1.1\nMACHINE = loop\nDEBUG = 0",
        "[DISPLAY]\nDISPLAY = /bin/true\nMAX_FEED_OVERRIDE = 1.0",
        "[FILTER]",
        "[RS274NGC]\nPARAMETER_FILE = linuxcnc.var\nRS274NGC_STARTUP_CODE = G21 G90 G17 G40 G49 G54 G94",
        "[EMCMOT]\nEMCMOT = motmod\nCOMM_TIMEOUT = 4.0\nSERVO_PERIOD = 1000000",
        "[TASK]\nTASK = milltask\nCYCLE_TIME = 0.001",
        "[EMCIO]\nEMCIO = io\nCYCLE_TIME = 0.010\nTOOL_TABLE = tool.tbl",
        "[HAL]\nHALFILE = sim.hal",
        f"[KINS]\nKINEMATICS = trivkins coordinates={AXES}\nJOINTS = 5",
        f"[TRAJ]\nCOORDINATES = {AXES}\nLINEAR_UNITS = mm\nANGULAR_UNITS = deg\nDEFAULT_LINEAR_VELOCITY = 100\n"
        f"MAX_LINEAR_VELOCITY = 1000\nDEFAULT_LINEAR_ACCELERATION = {JOINT}\nMAX_LINEAR_ACCELERATION = {JOINT}\n"
        f"MAX_ANGULAR_VELOCITY = 360\nMAX_ANGULAR_ACCELERATION = {AXIS}\nARC_BLEND_ENABLE = 1",
    ]
    for n, axis in enumerate(AXES):
        travel, speed = _TRAVEL[axis], 500 if axis in "XYZ" else 360
        kind = "LINEAR" if axis in "XYZ" else "ANGULAR"
        ends = f"MIN_LIMIT = -{travel}\nMAX_LIMIT = {travel}\nMAX_VELOCITY = {speed}"
        out.append(f"[AXIS_{axis}]\n{ends}\nMAX_ACCELERATION = {AXIS}")
        out.append(
            f"[JOINT_{n}]\nTYPE = {kind}\nHOME = 0\nHOME_SEQUENCE = 0\n{ends}\nMAX_ACCELERATION = {JOINT}\n"
            + "FERROR = 10\nMIN_FERROR = 10\n"
            + "\n".join(told.get(n, []))
        )
    return "\n\n".join(out) + "\n"


def _hal() -> str:
    out = [
        "loadrt [KINS]KINEMATICS",
        "loadrt motmod servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints=[KINS]JOINTS",
        "loadrt sampler depth=400000 cfg=ffffffffffss",
        *(f"addf {f} servo-thread" for f in ("motion-command-handler", "motion-controller", "sampler.0")),
    ]
    for n in range(len(AXES)):
        out.append(f"net J{n} joint.{n}.motor-pos-cmd => joint.{n}.motor-pos-fb sampler.0.pin.{n}")
        out.append(f"net P{n} joint.{n}.pos-cmd => sampler.0.pin.{n + 5}")
    out += [
        "net LINE motion.program-line => sampler.0.pin.10",
        "net TYPE motion.motion-type => sampler.0.pin.11",
        "setp sampler.0.enable 0",
        "net ESTOP iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in",
        "net PREP iocontrol.0.tool-prepare => iocontrol.0.tool-prepared",
        "net CHG iocontrol.0.tool-change => iocontrol.0.tool-changed",
    ]
    return "\n".join(out) + "\n"


class _Loop:
    """One running control."""

    def __init__(self, work: Path) -> None:
        self.log = open(work / "log.txt", "w")  # a pipe would be held open by what goes into the background
        os.environ["HOME"] = str(work)  # LinuxCNC keeps a memory map there
        self.env = {**os.environ, "INI_FILE_NAME": f"{work}/machine.ini", "RTAPI_FIFO_PATH": f"{work}/fifo"}
        self.env["HAL_RTMOD_DIR"] = "/usr/lib/linuxcnc/modules"
        if os.getuid() == 0:
            self.env["RTAPI_UID"] = "65534"

    def start(self, *command: str) -> subprocess.Popen:
        return subprocess.Popen(command, stdout=self.log, stderr=self.log, stdin=subprocess.DEVNULL, env=self.env)

    def run(self, *command: str) -> None:
        if self.start(*command).wait(30):
            raise SystemExit(f"{' '.join(command)} failed")

    def up(self) -> None:
        ini = "machine.ini"
        self.run("linuxcncsvr", "-ini", ini)
        self.run("halcmd", "loadusr", "-Wn", "iocontrol", "io", "-ini", ini)
        self.run("halcmd", "loadrt", "tpmod")
        self.run("halcmd", "loadrt", "homemod")
        self.run("halcmd", "-i", ini, "-f", "sim.hal")
        task = self.start("halcmd", "loadusr", "-Wn", "inihal", "milltask", "-ini", ini)
        self.run("halcmd", "start")
        if task.wait(30):
            raise SystemExit("milltask failed")
        import hal
        import linuxcnc

        self.hal, self.c = hal, linuxcnc
        self.stat, self.command, self.errors = linuxcnc.stat(), linuxcnc.command(), linuxcnc.error_channel()
        self.stream = None
        s, c = self.stat, linuxcnc
        self.until(lambda: s.state in (1, 2, 3))
        for state in (c.STATE_ESTOP_RESET, c.STATE_ON):
            self.command.state(state)
            self.until(lambda state=state: s.task_state == state)
        self.command.home(-1)
        self.until(lambda: all(s.homed[:5]))
        self.command.mode(c.MODE_AUTO)
        self.until(lambda: s.task_mode == c.MODE_AUTO)
        self.command.program_open(os.path.abspath("program.ngc"))
        self.until(lambda: s.file.endswith("program.ngc"))
        self.component = hal.component("recorder")
        self.component.ready()
        self.stream, self.rows = hal.stream(self.component, hal.sampler_base, "ffffffffffss"), array.array("d")

    def poll(self) -> bool:
        try:
            self.stat.poll()
        except self.c.error:
            return False
        if error := self.errors.poll():
            raise SystemExit(error[1].strip())
        while self.stream is not None and self.stream.readable:
            row = self.stream.read()
            self.rows.append(self.stream.sampleno)
            self.rows.extend(row)
        return True

    def until(self, test, limit: float = 20.0) -> None:
        end = time.monotonic() + limit
        while not (self.poll() and test()):
            if time.monotonic() > end:
                raise SystemExit("LinuxCNC does not answer")
            time.sleep(0.002)

    def go(self) -> None:
        """Run to the end. At M0 the feed is held until blocks are queued, so that the record does not depend on when
        they come.
        """
        s, c = self.stat, self.c
        self.hal.set_p("sampler.0.enable", "1")
        self.command.auto(c.AUTO_RUN, 0)
        self.until(lambda: s.interp_state != c.INTERP_IDLE)
        idle, began = 0, time.monotonic()
        while idle < 5:
            time.sleep(0.01)
            self.poll()
            if time.monotonic() - began > 240:
                raise SystemExit("the program does not end")
            if s.interp_state == c.INTERP_PAUSED and s.inpos and not s.queue:
                self.command.feedrate(0.0)
                self.until(lambda: s.feedrate == 0.0)
                self.command.auto(c.AUTO_RESUME)
                self.until(lambda: s.interp_state != c.INTERP_PAUSED)
                last = -1
                while s.queue != last:
                    last = s.queue
                    time.sleep(0.1)
                    self.poll()
                self.command.feedrate(1.0)
                self.until(lambda: s.feedrate == 1.0)
            idle = idle + 1 if s.interp_state == c.INTERP_IDLE and s.inpos and not s.queue else 0
        self.hal.set_p("sampler.0.enable", "0")
        time.sleep(0.05)
        self.poll()


def _main(program: str, out: str, joints: str) -> None:
    import numpy

    work = Path(out).resolve().parent / "control"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    work.chmod(0o777)
    if len(str(work)) > 95:
        raise SystemExit(f"path too long for a socket: {work}")
    told = _told(joints, work)
    shutil.copy(program, work / "program.ngc")
    os.chdir(work)
    Path("machine.ini").write_text(_ini(told))
    Path("sim.hal").write_text(_hal())
    Path("tool.tbl").write_text("T1 P1 Z0 D0 ;\n")
    Path("linuxcnc.var").write_text("")
    loop = _Loop(work)
    loop.up()
    loop.go()
    rows = numpy.frombuffer(loop.rows, dtype=float).reshape(-1, WIDTH)
    lost = int(loop.hal.get_value("sampler.0.overruns"))
    numpy.save(out, rows)
    print(json.dumps({"rows": len(rows), "lost": lost}), flush=True)
    os._exit(1 if lost else 0)


if __name__ == "__main__":
    _main(*sys.argv[1:4])
