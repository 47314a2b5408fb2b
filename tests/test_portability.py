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
from commands import as_json, cut

#: NiceGUI serves nothing where it finds itself in a test.
LEFT_OUT = ("PYTHONUTF8", "MUJOCO_GL", "MJSIM_CACHE", "PYTEST_CURRENT_TEST")
LINUX = sys.platform == "linux"
#: Tests of the example that show its backlash, and are quick.
NAMES = ("cone45-centre-ccw", "rotary-a-tangential-ccw")
TESTS = Path(__file__).resolve().parent
#: Imports what is named, then runs each command line.
RUN = """
import importlib, json, pathlib, sys
for name in json.loads(sys.argv[1]):
    importlib.import_module(name)
from mjsim.cli.main import main
from mjsim.report import demo
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


def elsewhere(environment, *lines, modules, examples):
    """What command lines print, by their first word, in one process; ``examples`` are the demo's."""
    words = json.dumps([[str(w) for w in line] for line in lines])
    command = [sys.executable, "-c", RUN, json.dumps(modules), words, str(examples)]
    done = subprocess.run(command, capture_output=True, env=environment, timeout=900)
    out, errors = done.stdout.decode("cp1252"), done.stderr.decode("cp1252")
    assert done.returncode == 0, out[-2000:] + errors[-4000:]
    return {part.split(None, 1)[0]: part.split("\n", 1)[1] for part in out.split("## ")[1:]}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Two tests, as an editor and a spreadsheet of Windows save them."""
    folder = cut(tmp_path_factory.mktemp("elsewhere") / "Maß nehmen" / "hidden-backlash", NAMES)
    for packed in folder.glob("traces/*.csv.gz"):
        packed.with_suffix("").write_bytes(gzip.decompress(packed.read_bytes()).replace(b"\n", b"\r\n"))
        packed.unlink()
    text = (folder / "campaign.toml").read_text(encoding="utf-8").replace(".csv.gz", ".csv")
    (folder / "campaign.toml").write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    machine = (folder / "machine.toml").read_bytes()
    (folder / "machine.toml").write_bytes(machine.replace(b"\n", b"\r\n"))
    sweep = f'name = "s"\ncampaign = "."\ntests = ["{NAMES[1]}"]\n'
    sweep += '[[vary]]\nparameter = "backlash.X.width_um"\nvalues = [0.0, 5.0]\n'
    (folder / "sweep.toml").write_bytes(sweep.replace("\n", "\r\n").encode())
    return folder


@pytest.fixture(scope="module")
def said(environment, campaign, good, tmp_path_factory):
    """Every module and the commands in one process: what each prints, and the folder that they write into."""
    out = tmp_path_factory.mktemp("out")
    files = sorted((TESTS.parent / "mjsim").rglob("*.py"))
    names = [".".join(f.relative_to(TESTS.parent).with_suffix("").parts).removesuffix(".__init__") for f in files]
    names.remove("mjsim.linuxcnc.inside")  # runs inside LinuxCNC only
    shutil.copytree(campaign, out / "examples" / campaign.name)
    for name in "ab":
        shutil.copytree(good, out / "fleet" / name)
    lines = [
        ["check", campaign, "--json"],
        ["compare", campaign],
        ["diagnose", campaign, "--json"],
        ["report", campaign, "-o", out / "report.html"],
        ["add", campaign, "backlash.A"],
        ["nc", campaign, "--test", NAMES[1], "-o", out / "program.nc"],
        ["batch", campaign / "sweep.toml", "--out", out / "sweep", "--threads", "2", "--json"],
        ["demo", "--out", out / "demo"],
        ["fleet", out / "fleet", "--out", out / "tables", "--threads", "2", "--as-is", "--json"],
    ]
    return elsewhere(environment, *lines, modules=names, examples=out / "examples"), out


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


def test_every_module_and_the_commands(said, campaign):
    said, out = said
    (found,) = json.loads(said["diagnose"])["effects"]
    assert found["id"] == "backlash.A"
    assert "backlash.A" in (out / "report.html").read_text(encoding="utf-8")
    assert "backlash.A" in (campaign / "machine.toml").read_text(encoding="utf-8") and ends_alike(campaign)
    assert (json.loads(said["batch"])["simulated"], json.loads(said["batch"])["failed"]) == (2, 0)
    program = out / "program.nc"
    words = ["nc", "read", program, "--campaign", campaign, "--test", NAMES[1]]
    plain = as_json(*words)
    program.write_bytes(program.read_bytes().replace(b"\r\n", b"\n").replace(b"\n", b"\r\n"))
    assert as_json(*words) == plain


def ends_alike(campaign):
    """Whether each line of the machine file still ends with CRLF."""
    data = (campaign / "machine.toml").read_bytes()
    return data.count(b"\n") == data.count(b"\r\n") > 0


def test_two_processes_of_a_fleet(said):
    assert [r["error"] for r in json.loads(said[0]["fleet"])["results"]] == [None, None]


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
            _, errors = process.communicate(timeout=120)
    assert b"Traceback" not in errors, errors.decode("cp1252")


def test_the_demo(said):
    folder = said[1] / "demo"
    assert (folder / "report.html").is_file() and (folder / "ladder.png").is_file()
    assert "backlash" in (folder / "machine.toml").read_text(encoding="utf-8")
