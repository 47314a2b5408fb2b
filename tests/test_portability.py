"""mjsim on a system that has nothing of POSIX: every module, and the commands, in processes that see none of it.

``elsewhere/sitecustomize.py`` says what they do not see. It stands in for Windows on Linux. On other systems the same
commands run as they are.
"""

import gzip
import json
import os
import shutil
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest
from commands import TESTS as COMMON_TESTS
from commands import as_json, cut

#: NiceGUI serves nothing where it finds itself in a test.
LEFT_OUT = ("PYTHONUTF8", "MUJOCO_GL", "MJSIM_CACHE", "PYTEST_CURRENT_TEST")
LINUX = sys.platform == "linux"
TESTS = Path(__file__).resolve().parent
#: Imports what is named, then runs each command line.
RUN = """
import importlib, json, pathlib, sys
for name in json.loads(sys.argv[1]):
    importlib.import_module(name)
from mjsim.cli.main import main
from mjsim.report import demo
if sys.argv[3]:
    demo.examples = lambda: pathlib.Path(sys.argv[3])
for line in json.loads(sys.argv[2]):
    print("##", *line)
    main(line, standalone_mode=False)
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Of a process that is elsewhere: a cache of its own, streams as Windows has them, no help from the caller."""
    known = {k: v for k, v in os.environ.items() if k not in LEFT_OUT}
    stand_in = [str(TESTS / "elsewhere")] if LINUX else []
    path = os.pathsep.join([*stand_in, str(TESTS.parent), os.environ.get("PYTHONPATH", "")])
    streams = {"PYTHONIOENCODING": "cp1252", "PYTHONWARNDEFAULTENCODING": "1", "PYTHONWARNINGS": "ignore"}
    return known | streams | {"PYTHONPATH": path, "XDG_CACHE_HOME": str(tmp_path_factory.mktemp("cache"))}


def elsewhere(environment, *lines, modules=(), examples=""):
    """What command lines print, by their first word, in one process; ``examples`` are the demo's, if not the usual."""
    words = json.dumps([[str(w) for w in line] for line in lines])
    command = [sys.executable, "-c", RUN, json.dumps(modules), words, str(examples)]
    done = subprocess.run(command, capture_output=True, env=environment, timeout=300)
    out, errors = done.stdout.decode("cp1252"), done.stderr.decode("cp1252")
    assert done.returncode == 0, out[-2000:] + errors[-4000:]
    return {part.split(None, 1)[0]: part.split("\n", 1)[1] for part in out.split("## ")[1:]}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Two tests, as an editor and a spreadsheet of Windows save them."""
    folder = cut(tmp_path_factory.mktemp("elsewhere") / "Maß nehmen", COMMON_TESTS[1:])
    for packed in folder.glob("traces/*.csv.gz"):
        packed.with_suffix("").write_bytes(gzip.decompress(packed.read_bytes()).replace(b"\n", b"\r\n"))
        packed.unlink()
    text = (folder / "campaign.toml").read_text(encoding="utf-8").replace(".csv.gz", ".csv")
    (folder / "campaign.toml").write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    machine = (folder / "machine.toml").read_bytes()
    (folder / "machine.toml").write_bytes(machine.replace(b"\n", b"\r\n"))
    return folder


PROBE = """
import os, signal, sys
found = [n for n in ("fork", "getuid", "sched_getaffinity") if hasattr(os, n)]
found += [n for n in ("SIGALRM", "setitimer") if hasattr(signal, n)]
try:
    import fcntl
    found.append("fcntl")
except ImportError:
    pass
with open(sys.argv[1], "w") as file:
    file.write("µ\\n")
    try:
        os.replace(sys.argv[1], sys.argv[1] + "2")
        found.append("moved while it was open")
    except PermissionError:
        pass
print(found, open(sys.argv[1], "rb").read())
"""


@pytest.mark.skipif(not LINUX, reason="no stand-in is used")
def test_it_sees_nothing_of_posix(environment, tmp_path):
    """The stand-in itself: without it, the tests below could not fail."""
    command = [sys.executable, "-c", PROBE, str(tmp_path / "a")]
    done = subprocess.run(command, capture_output=True, env=environment, timeout=60)
    assert done.stdout.split() == [b"[]", b"b'\\xb5\\r\\n'"], done.stderr


def test_every_module_and_the_commands(environment, campaign, tmp_path):
    files = sorted((TESTS.parent / "mjsim").rglob("*.py"))
    names = [".".join(f.relative_to(TESTS.parent).with_suffix("").parts).removesuffix(".__init__") for f in files]
    names.remove("mjsim.linuxcnc.inside")  # runs inside LinuxCNC only
    sweep = 'name = "s"\ncampaign = "."\ntests = ["circle-xy-ccw"]\n'
    sweep += '[[vary]]\nparameter = "backlash.X.width_um"\nvalues = [0.0, 5.0]\n'
    (campaign / "sweep.toml").write_bytes(sweep.replace("\n", "\r\n").encode())
    said = elsewhere(
        environment,
        ["check", campaign, "--json"],
        ["compare", campaign],
        ["diagnose", campaign, "--json"],
        ["report", campaign, "-o", tmp_path / "report.html"],
        ["add", campaign, "backlash.A"],
        ["nc", campaign, "--test", "circle-xy-ccw", "-o", tmp_path / "program.nc"],
        ["batch", campaign / "sweep.toml", "--out", tmp_path / "sweep", "--threads", "2", "--json"],
        modules=names,
    )
    (found,) = json.loads(said["diagnose"])["effects"]  # these two tests cannot tell it from a lag of the axis
    assert "backlash.A" in (found["id"], *found["alternative_ids"])
    assert "backlash.A" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "backlash.A" in (campaign / "machine.toml").read_text(encoding="utf-8") and ends_alike(campaign)
    assert (json.loads(said["batch"])["simulated"], json.loads(said["batch"])["failed"]) == (2, 0)
    program = tmp_path / "program.nc"
    words = ["nc", "read", program, "--campaign", campaign, "--test", "circle-xy-ccw"]
    plain = as_json(*words)
    program.write_bytes(program.read_bytes().replace(b"\r\n", b"\n").replace(b"\n", b"\r\n"))
    assert as_json(*words) == plain


def ends_alike(campaign):
    """Whether each line of the machine file still ends with CRLF."""
    data = (campaign / "machine.toml").read_bytes()
    return data.count(b"\n") == data.count(b"\r\n") > 0


def test_two_processes_of_a_fleet(environment, campaign, tmp_path):
    for name in "ab":
        shutil.copytree(campaign, tmp_path / "fleet" / name, ignore=shutil.ignore_patterns(".mjsim"))
    said = elsewhere(
        environment, ["fleet", tmp_path / "fleet", "--out", tmp_path / "out", "--threads", "2", "--as-is", "--json"]
    )
    assert [r["error"] for r in json.loads(said["fleet"])["results"]] == [None, None]


def test_the_workbench_is_served(environment, campaign):
    command = [sys.executable, "-m", "mjsim", "open", str(campaign), "--no-browser", "--json"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, env=environment) as process:
        try:
            address = json.loads(b"".join(process.stdout.readline() for _ in range(3)))["address"]
            with urllib.request.urlopen(address, timeout=60) as page:
                assert page.status == 200 and b"mjsim" in page.read()
        finally:
            process.terminate()
            _, errors = process.communicate(timeout=30)
    assert b"Traceback" not in errors, errors.decode("cp1252")


@pytest.mark.slow
def test_the_demo(environment, tmp_path):
    """On three tests of the example, to be quicker."""
    cut(tmp_path / "examples" / "hidden-backlash")
    elsewhere(environment, ["demo", "--out", tmp_path / "demo"], examples=tmp_path / "examples")
    assert (tmp_path / "demo" / "report.html").is_file() and (tmp_path / "demo" / "ladder.png").is_file()
    assert "backlash" in (tmp_path / "demo" / "machine.toml").read_text(encoding="utf-8")
