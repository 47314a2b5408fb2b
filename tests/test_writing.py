"""What commands write: whole or not at all (full disk, Ctrl-C, SIGTERM), and what they leave of the host process."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from commands import POSIX, as_json, ok, refused, run, snapshot

from mjsim.campaign import files as campaign_files
from mjsim.cli import common
from mjsim.io.resources import examples


@pytest.fixture
def campaign(good, tmp_path):
    return shutil.copytree(good, tmp_path / "short")


# -- a full disk, an interrupt -----------------------------------------------------------------------------------------

WRITING = {
    "simulate": ["simulate", "{c}", "--out", "{c}/out/deeper", "--test", "turn", "--no-plots"],
    "export": ["export", "{c}", "--out", "{c}/out"],
    "remove": ["remove", "{c}", "friction.X"],
    "nc": ["nc", "{c}", "--test", "turn", "-o", "{c}/out/p.nc"],
    "import": ["import", "{c}/../turn.txt", "--campaign", "{c}", "--test", "turn", "--force", "--no-check"],
    "new": ["new", "campaign", "{c}/out/fresh"],
}


class Disk:
    """Stands for the disk: gives up at its ``n``-th action below a folder."""

    def __init__(self, monkeypatch, folder, give_up):
        self.left, self._folder, self._give_up, self.replaced = 10**9, str(folder), give_up, 0
        real = os.replace

        def replace(*args):
            real(*args)
            self.replaced += str(args[1]).startswith(self._folder)

        monkeypatch.setattr(os, "replace", replace)
        for owner, name in ((os, "replace"), (Path, "write_bytes"), (Path, "write_text")):
            monkeypatch.setattr(owner, name, self._counted(getattr(owner, name)))

    def _counted(self, real):
        def act(*args, **kwargs):
            self.left -= str(args[0]).startswith(self._folder)  # Numba writes its cache elsewhere
            if self.left < 0:
                self.left = 10**9  # cleaning up works again
                if isinstance(args[0], Path) and len(args) > 1 and not args[0].exists():
                    real(args[0], args[1][: len(args[1]) // 2])  # half of it is there
                self._give_up()
            return real(*args, **kwargs)

        return act


def full():
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize(
    ("name", "end"),
    [*((n, "full") for n in WRITING), ("simulate", "Ctrl-C"), ("remove", "Ctrl-C"), ("import", "Ctrl-C")],
)
def test_all_or_nothing(campaign, name, end, monkeypatch):
    """Whatever action of the disk is the one that fails: what was there is there, and nothing else.

    Once the first file is in its place, the others stand beside theirs; a failure then leaves whole files, and no
    temporary one.
    """
    shutil.copy(campaign / "traces" / "turn.csv", campaign.parent / "turn.txt")
    line = [a.format(c=campaign) for a in WRITING[name]]
    disk = Disk(monkeypatch, campaign.parent, full if end == "full" else lambda: signal.raise_signal(signal.SIGINT))
    before = snapshot(campaign.parent)
    for n in range(30):
        disk.left, disk.replaced = n, 0
        result = run(*line)
        if disk.left < 10**8:  # it has ended before
            assert result.exit_code == 0, result.output
            break
        assert result.exit_code == {"full": 1, "Ctrl-C": 130}[end], (n, result.output, result.exception)
        assert result.stderr.startswith("mjsim: ") and result.stderr.count("\n") == 1, result.stderr
        assert not [p for p in campaign.parent.rglob(".*.*") if p.is_file()], n
        if disk.replaced:
            break
        assert snapshot(campaign.parent) == before, (n, set(snapshot(campaign.parent)) ^ set(before))
    assert n > 0
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


@POSIX
def test_terminated_while_it_works(tmp_path):
    """The real process: SIGTERM in the middle of a run ends it with one sentence, and its folder is as it was."""
    code = (
        "import os, signal, sys; from mjsim.cli.main import main\n"
        "from mjsim.simulation import mjmodel; real = mjmodel.build_model\n"
        "def build(*a):\n    os.kill(os.getpid(), signal.SIGTERM)\n    return real(*a)\n"
        "mjmodel.build_model = build; sys.argv = ['mjsim', *sys.argv[1:]]; main()"
    )
    folder = shutil.copytree(examples() / "healthy", tmp_path / "c")
    before = snapshot(tmp_path)
    line = [sys.executable, "-c", code, "simulate", str(folder), "--out", str(folder / "out"), "--no-plots"]
    done = subprocess.run(line, capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (143, ""), done.stderr
    assert done.stderr == "mjsim: stopped; nothing half-written is left behind\n"
    assert snapshot(tmp_path) == before


def test_former_machine_texts_are_all_kept(campaign):
    """Also where the user has taken an older one away."""
    ok("remove", campaign, "friction.X", "--quiet")
    ok("remove", campaign, "friction.Y", "--quiet")
    state = campaign / ".mjsim"
    second = (state / "machine.002.toml").read_text()
    (state / "machine.001.toml").unlink()
    ok("remove", campaign, "friction.Z", "--quiet")
    assert (state / "machine.002.toml").read_text() == second
    assert (state / "machine.003.toml").exists()


def test_a_test_named_like_a_file_of_the_export(campaign):
    text = (campaign / "campaign.toml").read_text()
    (campaign / "campaign.toml").write_text(text.replace('name = "turn"', 'name = "figures"'))
    refused(campaign.parent, ["export", campaign, "--out", campaign / "out", "--json"], "figures", "rename")


# -- the host process --------------------------------------------------------------------------------------------------

HOST = """
import sys, warnings, mujoco, scipy.optimize  # SciPy adds filters of its own

heard = []
mujoco.set_mju_user_warning(heard.append)
before = warnings.filters[:], mujoco.get_mjcb_control(), mujoco.get_mju_user_warning()
import mjsim
from mjsim.cli.main import main
mjsim.simulate, mjsim.diagnose
assert (warnings.filters, mujoco.get_mjcb_control(), mujoco.get_mju_user_warning()) == before, "import"
try:
    main(["simulate", sys.argv[1], "--test", "turn", "--out", sys.argv[2], "--no-plots", "--quiet"])
except SystemExit as end:
    assert not end.code
assert (warnings.filters, mujoco.get_mjcb_control(), mujoco.get_mju_user_warning()) == before, "command"
assert not heard
"""


def test_the_host_process_stays_as_it_is(campaign, tmp_path):
    """Warning filters, MuJoCo's control callback and its warning handler, after import and after a command."""
    line = [sys.executable, "-c", HOST, str(campaign), str(tmp_path / "out")]
    done = subprocess.run(line, capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "out" / "turn.csv").exists()


def test_an_unstable_machine_leaves_no_log(campaign, tmp_path, monkeypatch):
    """MuJoCo's own warnings go to stderr and to a file MUJOCO_LOG.TXT in the current folder, if nobody hears them."""
    monkeypatch.chdir(tmp_path)
    text = (campaign / "machine.toml").read_text()
    (campaign / "machine.toml").write_text(text.replace("worm_teeth = 60", "worm_teeth = 1e-300"))
    refused(tmp_path, ["simulate", campaign, "--out", tmp_path / "out", "--test", "turn"])
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


# -- what is nobody's fault, or mjsim's --------------------------------------------------------------------------------


def test_a_fault_of_its_own_is_one_sentence(campaign, monkeypatch):
    def fault(*_):
        raise KeyError("line one\nline two")

    monkeypatch.setattr(campaign_files, "parse", fault)
    monkeypatch.delenv(common.TRACEBACK, raising=False)
    before = snapshot(campaign.parent)
    result = run("compare", campaign)
    assert (result.exit_code, result.stdout) == (3, "")
    assert result.stderr.startswith("mjsim: a fault of mjsim itself: KeyError in test_writing.py, line ")
    assert result.stderr.count("\n") == 1 and "Traceback" not in result.stderr and common.TRACEBACK in result.stderr
    assert snapshot(campaign.parent) == before
    monkeypatch.setenv(common.TRACEBACK, "1")
    assert isinstance(run("compare", campaign).exception, KeyError)


def test_no_memory_is_one_sentence(campaign, monkeypatch):
    def none(*_):
        raise MemoryError

    monkeypatch.setattr(campaign_files, "parse", none)
    refused(campaign.parent, ["compare", campaign], "not enough memory")


def test_a_terminal_without_greek_letters():
    env = {**os.environ, "PYTHONIOENCODING": "ascii"}
    call = [sys.executable, "-c", "from mjsim.cli.main import main; main()", "effects", "friction"]
    done = subprocess.run(call, capture_output=True, env=env, timeout=60)
    assert done.returncode == 0 and b"friction" in done.stdout, done.stderr
    done = subprocess.run([*call, "--json"], capture_output=True, env=env, timeout=60)
    assert json.loads(done.stdout.decode("ascii")) == as_json("effects", "friction")


def test_a_folder_whose_name_is_no_text(campaign):
    odd = campaign.rename(campaign.with_name("odd \udcff µ"))
    data = as_json("simulate", odd, "--test", "turn", "--out", odd / "out", "--no-plots")
    assert data["tests"][0]["name"] == "turn" and data["out"].endswith("out")
    refused(odd.parent, ["new", "campaign", odd / "fresh\udcff"], "--name")
