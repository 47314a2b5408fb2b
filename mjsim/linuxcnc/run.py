"""Running a program on LinuxCNC."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.linuxcnc import inside
from mjsim.linuxcnc.configuration import Settings, check_settings, write_configuration
from mjsim.linuxcnc.record import FEEDS, Record
from mjsim.machine.chain import FIVE_AXIS, Chain
from mjsim.nc.limits import scale
from mjsim.nc.write import Options, nc_program

# -- whether LinuxCNC can run here -------------------------------------------------------------------------------------

#: The modules ``linuxcnc`` and ``hal`` are those of the system's own Python.
PYTHON = "/usr/bin/python3"
_PROGRAMS = ("linuxcncsvr", "halcmd", "milltask", "rtapi_app", "io")
_INSTALL = "sudo apt-get install -y --no-install-recommends linuxcnc-uspace"


def missing() -> str:
    """What is missing to run LinuxCNC here, as a noun with a remedy; empty where nothing is."""
    for name in _PROGRAMS:
        if shutil.which(name) is None:
            return f"the program {name} (run: {_INSTALL})"
    if not os.access(PYTHON, os.X_OK) or _fails(PYTHON, "-c", "import hal, linuxcnc"):
        return f"the modules linuxcnc and hal of {PYTHON} (run: {_INSTALL})"
    if _fails(*unshare(), "true"):
        return "the right to make namespaces (unshare; a container needs the capability SYS_ADMIN)"
    return ""


def needed() -> None:
    """Refuse to go on where LinuxCNC cannot run.

    Raises:
        InputError: something is missing.
    """
    if what := missing():
        raise InputError(f"LinuxCNC cannot run here: {what} is missing")


def unshare() -> list[str]:
    """Command that runs another one in namespaces of its own, so that nothing of a control stays behind."""
    mine = [] if os.getuid() == 0 else ["--user", "--map-current-user", "--keep-caps"]
    return ["unshare", *mine, "--ipc", "--net", "--pid", "--mount", "--fork", "--kill-child", "--mount-proc"]


def environment() -> dict[str, str]:
    """The environment without what is meant for another Python or a display."""
    return {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "DISPLAY", "LD_PRELOAD")}


def _fails(*command: str) -> bool:
    return subprocess.run(command, env=environment(), capture_output=True, stdin=subprocess.DEVNULL).returncode != 0


#: Longest name of a folder with LinuxCNC's sockets: they take 108 characters.
_LONGEST = 95
#: Slower clocks that are tried where the computer is too busy, times real time.
_SLOWER = (5.0, 1.0)
#: Names of the files into which a program has its probings written.
_PROBED = re.compile(r"\(PROBEOPEN ([\w.+-]+)\)")
#: Blocks that the planner looks ahead, with some to spare: with fewer in its queue the path depends on the pace.
_AHEAD = 60
#: A queue that has run empty is filled at some 3000 blocks per second: to this share of its blocks not within a gap of
#: so many seconds.
_FULL, _GAP = 0.7, 0.2


def run_test(test: BallBarTest, settings: Settings | None = None, options: Options | None = None) -> Record:
    """Have LinuxCNC run the program that mjsim writes for a test.

    Args:
        test: What to run.
        settings: Of the control.
        options: How the program is written; its dialect has to be ``linuxcnc``.

    Raises:
        InputError: LinuxCNC is not there, cannot run here, or refuses the program.
    """
    options = options or Options(dialect="linuxcnc")
    if options.dialect != "linuxcnc":
        raise InputError(f"NC dialect {options.dialect!r} for LinuxCNC; allowed: linuxcnc")
    text = nc_program(test, options).text
    return run_program(text, test.chain, settings, options.feed == "tcp")


def run_program(text: str, chain: Chain = FIVE_AXIS, settings: Settings | None = None, tip: bool = False) -> Record:
    """Have LinuxCNC run an NC program and record what it tells the axes.

    Args:
        text: The program, in the dialect of LinuxCNC. It may stop at M0.
        chain: Axes of the machine.
        settings: Of the control.
        tip: Whether the program switches tool centre point control on with M428.

    Raises:
        InputError: LinuxCNC is not there, cannot run here, or refuses the program.
    """
    settings = settings or Settings()
    check_settings(settings, chain)
    needed()
    speeds, why = [settings.speed, *(v for v in _SLOWER if v < settings.speed)], ""
    for speed in speeds:
        try:
            return _run(text, chain, replace(settings, speed=speed), tip)
        except _Busy as busy:
            why = str(busy)
    raise InputError(f"LinuxCNC: {why}, also at {speeds[-1]:g} times real time; is the computer busy?")


class _Busy(Exception):
    """The run did not go as it should, maybe since the computer is too busy for a clock that runs so fast: why."""


def _run(text: str, chain: Chain, settings: Settings, tip: bool) -> Record:
    folder = Path(tempfile.mkdtemp(prefix="lc"))
    try:
        if len(str(folder)) > _LONGEST:
            raise InputError(f"{folder}: too long a name for LinuxCNC's sockets; allowed: a TMPDIR of a short name")
        folder.chmod(0o777)  # its real-time part runs as another user where mjsim runs as root
        write_configuration(folder, chain, settings, tip)
        (folder / "program.ngc").write_text(text, encoding="utf-8")
        record = _recorded(folder, chain, settings, _clock(folder, settings.speed))
        logs = [folder / name for name in _PROBED.findall(text)]
        probed = [np.loadtxt(log, ndmin=2) for log in logs if log.exists()]
        return replace(record, probed=np.vstack(probed)) if probed else record
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _clock(folder: Path, speed: float) -> bool:
    """Compile the faster clock; without a compiler LinuxCNC runs in real time."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if speed == 1.0 or compiler is None:
        return False
    source = Path(inside.__file__).with_name("clock.c")
    command = [compiler, "-O2", "-shared", "-fPIC", "-o", str(folder / "clock.so"), str(source), "-ldl"]
    return subprocess.run(command, capture_output=True, stdin=subprocess.DEVNULL).returncode == 0


def _recorded(folder: Path, chain: Chain, settings: Settings, faster: bool) -> Record:
    command = [*unshare(), PYTHON, inside.__file__, str(chain.count), str(settings.limit)]
    env = {**environment(), "MJSIM_CLOCK": str(settings.speed if faster else 1.0)}
    with open(folder / "out.txt", "w", encoding="utf-8") as out:
        try:
            subprocess.run(
                command, cwd=folder, env=env, stdin=subprocess.DEVNULL, stdout=out, stderr=out,
                timeout=settings.limit + 120.0,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise InputError(f"LinuxCNC did not end within {settings.limit + 120.0:g} s") from None
    answer = folder / "result.json"
    if not answer.exists():
        raise InputError(f"LinuxCNC ended without a record: {_tail(folder)}")
    result = json.loads(answer.read_text(encoding="utf-8"))
    if "failure" in result and result["again"]:
        raise _Busy(result["failure"])
    if "failure" in result:
        raise InputError(f"LinuxCNC: {result['failure']}")
    rows = np.fromfile(folder / "record.bin").reshape(-1, 2 * chain.count + 3)
    units = np.array([scale(a) for a in chain.letters])
    line, kind = rows[:, -2].astype(int), rows[:, -1].astype(int)
    if result["lost"] or _starved(line, np.isin(kind, FEEDS), np.array(result["queue"])):
        raise _Busy("it reads the program too slowly")
    told, path = rows[:, 1 : 1 + chain.count] * units, rows[:, 1 + chain.count : 1 + 2 * chain.count] * units
    return Record(told, path, line, kind, chain, result["seconds"])


def _starved(line: np.ndarray, feed: np.ndarray, queue: np.ndarray) -> bool:
    """Whether the planner may have had too few blocks to look ahead while it moved along the path.

    Args:
        line: Line of the program in every cycle, (n,).
        feed: Whether it is on the path, (n,).
        queue: Cycles so far, the blocks in the queue when the last one was added, and the time, (m, 3), in s.
    """
    if not feed.any() or len(queue) < 2:
        return False
    asked, blocks = queue[:, 0].astype(int), queue[:, 1]
    cycles = np.flatnonzero(feed)
    added = np.flatnonzero(np.diff(blocks)) + 1
    before = line[np.clip(asked[added - 1] - 1, 0, len(line) - 1)]  # the block was added later than this
    end = np.maximum.accumulate(np.append(0, before + blocks[added]))  # line up to which blocks were queued, at least
    place = np.searchsorted(asked[added], cycles, side="right")
    few = (line[cycles] > line[cycles].min()) & (end[place] - line[cycles] < _AHEAD)  # the first block waits
    # a full queue may take in as many blocks as it gives, so that its number stays; an empty one is filled in steps
    full = (blocks[added] > _FULL * np.append(0, blocks[added])[:-1]) & (np.diff(queue[:, 2])[added - 1] < _GAP)
    full |= asked[added] > cycles[-1]  # nothing was added any more, and the path came to its end
    return bool((few & ~np.append(full, True)[place]).any())


def _tail(folder: Path) -> str:
    """The last lines that it wrote, for a message."""
    text = " ".join(
        (folder / n).read_text(encoding="utf-8", errors="replace")
        for n in ("out.txt", "log.txt")
        if (folder / n).exists()
    )
    return " ".join(text.split())[-300:] or "it wrote nothing"
