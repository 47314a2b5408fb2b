"""Starts LinuxCNC in the current folder, runs ``program.ngc`` to its end, and keeps every servo cycle.

This file runs in the system's own Python, which has the modules ``linuxcnc`` and ``hal``, and in namespaces of its
own. It uses nothing of mjsim and nothing but the standard library. Arguments: number of joints, longest run in s.
It writes ``record.bin`` (one row of doubles per cycle: sample number, then what the sampler has) and ``result.json``.
"""

import array
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

#: Kinds of messages that are errors (nml_oi.hh: NML_ERROR, OPERATOR_ERROR).
_ERRORS = (1, 11)
#: The queue is taken for filled when it has not grown for so long, s.
_FILLED = 0.5
#: Longest wait for an answer, s: a busy computer is slow.
_PATIENCE = 60.0
#: The control is taken for stuck when it has neither moved, read a block nor dwelled for so long, s. A busy computer
#: has been seen to do it, once in some hundred runs.
_STUCK = 30.0
#: What LinuxCNC up to 2.9 says on a busy computer although nothing is wrong: it has read on before the probe's move was
#: in its queue (https://github.com/LinuxCNC/linuxcnc/issues/3650).
_TOO_EARLY = "Queue is not empty after probing"


class Failure(Exception):
    """Why the run came to nothing, as a sentence."""


class Stuck(Failure):
    """The run stands still, or the control has fallen over its own pace: another one may not."""


class Loop:
    """One running control."""

    def __init__(self, work: Path, joints: int, limit: float) -> None:
        self.joints, self.limit = joints, limit
        # a pipe would be held open by what goes into the background
        self.log = open(work / "log.txt", "w", encoding="utf-8")
        os.environ["HOME"] = str(work)  # LinuxCNC keeps a memory map there, one for each running control
        self.env = {**os.environ, "INI_FILE_NAME": f"{work}/machine.ini", "RTAPI_FIFO_PATH": f"{work}/fifo"}
        self.env["HAL_RTMOD_DIR"] = "/usr/lib/linuxcnc/modules"
        if os.getuid() == 0:
            self.env["RTAPI_UID"] = "65534"  # its real-time part refuses root
        if (work / "clock.so").exists():
            self.env["LD_PRELOAD"] = str(work / "clock.so")

    def start(self, *command: str) -> subprocess.Popen:
        return subprocess.Popen(command, stdout=self.log, stderr=self.log, stdin=subprocess.DEVNULL, env=self.env)

    def run(self, *command: str) -> None:
        if self._ended(self.start(*command)):
            raise Failure(f"{' '.join(command)} failed")

    @staticmethod
    def _ended(process: subprocess.Popen) -> int:
        try:
            return process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            raise Failure(f"{process.args} does not end") from None

    def up(self) -> None:
        """As the script ``linuxcnc`` does, without its lock file, windows and questions."""
        ini = "machine.ini"
        self.run("linuxcncsvr", "-ini", ini)
        self.run("halcmd", "loadusr", "-Wn", "iocontrol", "io", "-ini", ini)
        self.run("halcmd", "loadrt", "tpmod")
        self.run("halcmd", "loadrt", "homemod")
        self.run("halcmd", "-i", ini, "-f", "machine.hal")
        task = self.start("halcmd", "loadusr", "-Wn", "inihal", "milltask", "-ini", ini)
        self.run("halcmd", "start")  # milltask waits for answers of the running thread
        if self._ended(task):
            raise Failure("milltask does not start")
        import hal  # pyright: ignore[reportMissingImports]
        import linuxcnc  # pyright: ignore[reportMissingImports]

        c: Any = linuxcnc
        self.hal, self.c, self.stream = hal, c, None
        self.stat, self.command, self.errors = c.stat(), c.command(), c.error_channel()
        s = self.stat
        self.until(lambda: s.state in (1, 2, 3))
        for state in (c.STATE_ESTOP_RESET, c.STATE_ON):
            self.command.state(state)
            self.until(lambda state=state: s.task_state == state)
        self.command.home(-1)
        self.until(lambda: all(s.homed[: self.joints]))
        self.command.mode(c.MODE_AUTO)
        self.until(lambda: s.task_mode == c.MODE_AUTO)
        self.command.program_open(os.path.abspath("program.ngc"))
        self.until(lambda: s.file.endswith("program.ngc"))
        self.component = hal.component("recorder")
        self.component.ready()
        self.stream = hal.stream(self.component, hal.sampler_base, "f" * 2 * self.joints + "ss")
        self.rows = array.array("d")

    def poll(self) -> bool:
        try:
            self.stat.poll()
        except self.c.error:
            return False
        while error := self.errors.poll():
            if error[0] in _ERRORS:
                said = error[1].strip()
                raise Stuck(said) if said == _TOO_EARLY else Failure(said)
        while self.stream is not None and self.stream.readable:
            row = self.stream.read()
            self.rows.append(self.stream.sampleno)
            self.rows.extend(row)
        return True

    def until(self, test, limit: float = _PATIENCE) -> None:
        end = time.monotonic() + limit
        while not (self.poll() and test()):
            if time.monotonic() > end:
                raise Failure("it does not answer")
            time.sleep(0.002)

    def alive(self) -> bool:
        """Whether the control's processes are there: its status merely stands still when they are not."""
        seen = set()
        for number in filter(str.isdigit, os.listdir("/proc")):
            try:
                name, _, rest = Path(f"/proc/{number}/status").read_text(encoding="utf-8").partition("\n")
            except OSError:
                continue
            if "(zombie)" not in rest:
                seen.add(name.split()[1])
        return {"milltask", "rtapi_app"} <= seen

    def go(self) -> dict:
        """Run to the end, going on at every M0."""
        s, c = self.stat, self.c
        self.hal.set_p("sampler.0.enable", "1")
        self.command.auto(c.AUTO_RUN, 0)
        self.until(lambda: s.interp_state != c.INTERP_IDLE)
        idle, began, next_look = 0, time.monotonic(), 0.0
        self.queue = []
        state, since = (), began
        while idle < 5:
            time.sleep(0.01)
            self.poll()
            self.look()
            now = time.monotonic()
            if now - began > self.limit:
                raise Failure(f"the program does not end within {self.limit:g} s")
            here = (s.interp_state, s.queue, s.motion_line, s.read_line, s.position, s.delay_left)
            if here != state:
                state, since = here, now
            elif now - since > _STUCK:
                raise Stuck(f"it stands still at line {s.motion_line} of the program")
            if now > next_look:
                next_look = now + 1.0
                if not self.alive():
                    raise Failure("it has ended on its own")
            if s.interp_state == c.INTERP_PAUSED and s.inpos and not s.queue:
                self._resume()
            idle = idle + 1 if s.interp_state == c.INTERP_IDLE and s.inpos and not s.queue else 0
        self.hal.set_p("sampler.0.enable", "0")
        time.sleep(0.05)
        self.poll()
        lost = int(self.hal.get_value("sampler.0.overruns"))
        return {"seconds": time.monotonic() - began, "lost": lost, "queue": self.queue}

    def look(self) -> None:
        """Keep how many cycles there are, how many blocks were queued when the last one was added, and the time."""
        self.queue.append((len(self.rows) // (2 * self.joints + 3), self.stat.queue, time.monotonic()))

    def _resume(self) -> None:
        """Go on after M0, with the feed held until blocks are queued: so the first ones do not depend on the pace."""
        s, c = self.stat, self.c
        self.command.feedrate(0.0)
        self.until(lambda: s.feedrate == 0.0)
        self.command.auto(c.AUTO_RESUME)
        self.until(lambda: s.interp_state != c.INTERP_PAUSED)
        most, since = -1, time.monotonic()
        while time.monotonic() - since < _FILLED:
            if s.queue > most:
                most, since = s.queue, time.monotonic()
            time.sleep(0.01)
            self.poll()
            self.look()
        self.command.feedrate(1.0)
        self.until(lambda: s.feedrate == 1.0)


def main(joints: int, limit: float) -> None:
    work = Path.cwd()
    up = False
    try:
        loop = Loop(work, joints, limit)
        loop.up()
        up = True
        result = loop.go()
        with open("record.bin", "wb") as file:
            loop.rows.tofile(file)
    except Failure as failure:
        result = {"failure": str(failure), "again": not up or isinstance(failure, Stuck)}
    (work / "result.json").write_text(json.dumps(result), encoding="utf-8")
    os._exit(0)  # the end of process 1 ends everything else in its namespace


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]))
