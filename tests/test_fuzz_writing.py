"""What mjsim writes: read back equal, whole or not at all (full disk, Ctrl-C, SIGTERM); files that say the same in other ways."""

import contextlib
import errno
import io
import json
import os
import shutil
import signal
import string
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from commands import CAMPAIGN, as_json, ok, refused, run, snapshot
from fuzzing import cases, tried
from hypothesis import assume, given
from hypothesis import strategies as st

from mjsim.ballbar.measurement import Instrument
from mjsim.campaign.files import campaign_from, read_campaign
from mjsim.campaign.files import test_table as table_of
from mjsim.campaign.machine_file import read_machine, write_machine
from mjsim.campaign.traces import read_trace, saturated
from mjsim.cli import common
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.importing.importer import import_trace
from mjsim.io import files
from mjsim.io.resources import examples
from mjsim.nc.read import motion_csv, parse_nc
from mjsim.nc.write import Options, nc_program
from mjsim.units import UM


@pytest.fixture
def campaign(good, tmp_path):
    return shutil.copytree(good, tmp_path / "short")


def numbers(low, high):
    return st.floats(low, high, allow_nan=False, allow_infinity=False)


TEXTS = st.text(st.characters(categories=["L", "N", "P", "S", "Zs"], codec="utf-8"), min_size=1, max_size=20).filter(str.isprintable)

# -- read back equal ---------------------------------------------------------------------------------------------------------------


@st.composite
def tables(draw):
    """A ``[[test]]`` table of any kind."""
    out = {"name": draw(st.text(string.ascii_letters + string.digits, min_size=1, max_size=12))}
    out["kind"] = draw(st.sampled_from(("cone_frustum", "circular", "rotary")))
    way = st.sampled_from(("CW", "CCW"))
    if out["kind"] == "cone_frustum":
        out |= {"half_apex_deg": draw(numbers(1, 80)), "inclination_deg": draw(numbers(0, 80)), "direction": draw(way)}
        out |= {"sensitive_direction": draw(st.sampled_from(("perpendicular", "parallel"))), "revolutions": draw(st.integers(1, 3))}
    elif out["kind"] == "circular":
        out |= {"plane": draw(st.sampled_from(("XY", "YZ", "ZX"))), "direction": draw(way), "revolutions": draw(st.integers(1, 3))}
    else:
        out |= {"axis": draw(st.sampled_from("AC")), "from_deg": draw(numbers(-360, 360)), "to_deg": draw(numbers(-360, 360))}
        out |= {"sensitive_direction": draw(st.sampled_from(("tangential", "radial", "axial")))}
    ball = [draw(numbers(-200, 200)) for _ in range(3)]
    return out | {"table_ball_mm": ball, "bar_length_mm": draw(numbers(50, 300)), "feed_mm_min": draw(numbers(100, 5000))}


@cases(80)
@given(tables(), TEXTS)
def test_a_test_survives_its_table(table, name):
    try:
        (first,) = campaign_from(Path("campaign.toml"), {"name": name, "test": [table]}, traces=False).tests
    except InputError:
        assume(False)
    (again,) = campaign_from(Path("campaign.toml"), {"name": name, "test": [table_of(first)]}, traces=False).tests
    for key, value in vars(first).items():
        assert getattr(again, key) == (pytest.approx(value, rel=1e-8, abs=1e-12) if isinstance(value, float | tuple) else value)


@st.composite
def effects(draw):
    """Any effect of the catalogue with any values inside its bounds."""
    cls, subject = registry.effect_class(draw(st.sampled_from(registry.all_ids())))
    values = {}
    for p in cls.parameters_of(subject):
        if p.kind == "number":
            values[p.name] = draw(numbers(p.lower, p.upper))
        elif p.kind == "components":
            row = st.tuples(numbers(0.5, 2000), numbers(0, min(p.upper, 1.0)), numbers(-180, 180)).map(list)
            values[p.name] = draw(st.lists(row, min_size=1, max_size=4))
        elif draw(st.booleans()):
            values[p.name] = draw(st.sampled_from(p.choices))
    return cls(subject, **values)


@cases(60)
@given(st.lists(effects(), max_size=4), st.sampled_from("XYZAC"), numbers(1, 900), st.booleans())
def test_a_machine_survives_its_file(tmp_path_factory, more, axis, gain, windows):
    folder = tmp_path_factory.mktemp("machine")
    original, path = examples() / "hidden-backlash" / "machine.toml", folder / "machine.toml"
    path.write_bytes(original.read_bytes().replace(b"\n", b"\r\n" if windows else b"\n"))
    machine = read_machine(path).with_drive(axis, position_gain=gain)
    for effect in more:
        machine = machine.with_effect(effect)
    write_machine(machine, path, path, force=True)
    again = read_machine(path)
    assert [e.key for e in again.effects] == [e.key for e in machine.effects]
    assert again.drives[axis].position_gain == pytest.approx(gain, rel=1e-8)
    for one, other in zip(machine.effects, again.effects, strict=True):
        for name, value in one.values.items():
            got = other.values[name]
            assert np.allclose(got, value, rtol=1e-7, atol=1e-300) if not isinstance(value, str) else got == value
    write_machine(again, path, path, force=True)
    assert read_machine(path).effects[-1].values == again.effects[-1].values
    shutil.rmtree(folder)


@cases(12)
@given(
    tables(), st.sampled_from(("fanuc", "siemens", "linuxcnc")), st.sampled_from(("a11", "inverse", "tcp")), st.booleans(), st.booleans()
)
def test_an_nc_program_survives_its_file(table, dialect, feed, turned, rollover):
    table = {**table, "half_apex_deg": 15.0} if table["kind"] == "cone_frustum" else table
    options = Options(dialect, feed, 5.0, reversed=("A",) if turned else (), rollover=rollover and dialect != "linuxcnc")
    try:
        (test,) = campaign_from(Path("campaign.toml"), {"name": "n", "test": [table]}, traces=False).tests
        written = nc_program(test, options)
    except InputError:
        assume(False)
    again = parse_nc(written.text, Path("p.nc"), dialect, options.reversed, options.rollover)
    off = again.motion.points - written.motion.points
    off[:, 4] -= 2 * np.pi * np.round(off[0, 4] / (2 * np.pi))  # with C within 0 to 360° the first turn is not said
    assert np.abs(off).max() < 1e-9
    assert again.motion.seconds == pytest.approx(written.motion.seconds, rel=2e-3)
    rows = np.loadtxt(io.StringIO(motion_csv(again.motion)), delimiter=",", skiprows=1)
    assert rows.shape == (len(again.motion.points), 6)


@cases(40)
@given(st.lists(numbers(-900, 900), min_size=50, max_size=80), numbers(0.001, 0.5), st.booleans())
def test_a_trace_survives_its_file(tmp_path_factory, values, step, packed):
    from mjsim.importing.into_campaign import trace_bytes

    path = tmp_path_factory.getbasetemp() / ("t.csv.gz" if packed else "t.csv")
    time, deviation = step * np.arange(len(values)), np.array(values) * UM
    path.write_bytes(trace_bytes(path, time, deviation))
    trace = tried("exported trace", lambda p: read_trace(p, Instrument()), path)
    if trace is not None:
        assert trace.time == pytest.approx(time, abs=6e-7)
        assert trace.deviation == pytest.approx(deviation, abs=6e-11)


# -- the same, said in another way -------------------------------------------------------------------------------------------------


def with_mark(data):
    return b"\xef\xbb\xbf" + data


def with_returns(data):
    return data.replace(b"\n", b"\r\n")


SAME = {
    "byte order mark": with_mark,
    "Windows line ends": with_returns,
    "both": lambda d: with_mark(with_returns(d)),
    "blank lines at the end": lambda d: d + b"\n\n\n",
    "no line end at the end": lambda d: d.rstrip(b"\n"),
}


@pytest.mark.parametrize("way", SAME)
@pytest.mark.parametrize("file", ["campaign.toml", "machine.toml", "traces/turn.csv"])
def test_the_same_campaign(campaign, way, file):
    def look(c):
        return (c.name, c.tests, c.instrument, {k: (t.time.tolist(), t.deviation.tolist(), t.valid.tolist()) for k, t in c.traces.items()})

    before, machine = look(read_campaign(campaign)), read_machine(campaign / "machine.toml")
    (campaign / file).write_bytes(SAME[way]((campaign / file).read_bytes()))
    assert look(read_campaign(campaign)) == before
    assert [(e.key, e.values) for e in read_machine(campaign / "machine.toml").effects] == [(e.key, e.values) for e in machine.effects]


def test_comments_and_the_order_of_tables_mean_nothing(campaign):
    before = read_campaign(campaign).tests
    head, *tests = CAMPAIGN.split("[[test]]\n")
    name, instrument = head.split("[instrument]")
    text = "# a comment\n" + name + "".join(f"[[test]] # one\n{t}# more\n" for t in tests) + "[instrument]" + instrument
    (campaign / "campaign.toml").write_text(text)
    assert read_campaign(campaign).tests == before


@cases(60)
@given(
    st.sampled_from([(";", ","), (";", "."), ("\t", ","), ("\t", "."), (",", "."), (" ", ".")]),
    st.booleans(),
    st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]),
    st.sampled_from(["\n", "\r\n"]),
    st.sampled_from(["mm", "um", "inch"]),
    st.integers(0, 3),
)
def test_the_same_import(good, layout, swapped, encoding, end, unit, blank):
    """Separator, decimal sign, order of columns, encoding, line ends, unit, blank lines: the same trace comes out."""
    separator, sign = layout
    lo = float((good / "traces" / "turn.csv").read_text().split("\n")[1].split(",")[0])
    time = lo + 0.01 * np.arange(210)
    deviation = 5.0 * np.sin(0.05 * np.arange(210))
    scale = {"um": 1.0, "mm": 1e-3, "inch": 1 / 25400.0}[unit]
    columns = [("time_s", time, "{:.3f}"), (f"deviation_{unit}", deviation * scale, "{:.9f}")][:: -1 if swapped else 1]
    rows = [separator.join(f.format(x[i]).replace(".", sign) for _, x, f in columns) for i in range(len(time))]
    source = good.parent / "turn-µ.txt"
    source.write_bytes((end.join([separator.join(n for n, _, _ in columns), *rows]) + end * (1 + blank)).encode(encoding))
    try:
        got = import_trace(good, source, "turn", preview=True, check=False)
    finally:
        source.unlink()
    assert got.trace.time == pytest.approx(time, abs=1e-6)
    assert got.trace.deviation == pytest.approx(deviation * UM, abs=3e-11)
    assert got.unit == unit


@cases(60)
@given(st.integers(2, 150), st.integers(2, 150), st.sampled_from(["swap", "double", "back"]))
def test_times_out_of_order_are_refused_with_their_row(tmp_path_factory, i, j, how):
    rows = [f"{0.01 * k:.2f},{np.sin(k):.3f}" for k in range(160)]
    if how == "swap":
        assume(i != j)
        rows[i], rows[j] = rows[j], rows[i]
        wrong = min(i, j) + 1
    elif how == "double":
        rows.insert(i, rows[i])
        wrong = i + 1
    else:
        rows[i:] = rows[i:][::-1]
        wrong = i + 1
        assume(i < 158)
    path = tmp_path_factory.getbasetemp() / "order.csv"
    path.write_text("\n".join(["time_s,deviation_um", *rows, ""]))
    with pytest.raises(InputError, match=rf"order\.csv, line {wrong + 2 - (how == 'back') * 0}: time_s"):
        read_trace(path, Instrument())


# -- a sensor at its stop ----------------------------------------------------------------------------------------------------------


def curve(n=2000):
    k = np.arange(n)
    return 400.0 * np.sin(2 * np.pi * k / 900) + np.random.default_rng(1).normal(0.0, 0.1, n)


@pytest.mark.parametrize("low, high", [(-1e9, 250.0), (-250.0, 1e9), (-250.0, 250.0), (-399.0, 1e9)])
def test_flat_tops_are_no_readings(low, high):
    x = np.round(np.clip(curve(), low, high), 1) * UM
    want = (curve() >= high) | (curve() <= low)
    found = saturated(x)
    assert (found & ~want).sum() <= 10 and (want & ~found).sum() <= 40
    assert found.sum() > 30


@pytest.mark.parametrize("digits", [0, 1, 2, 4, 8])
@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("size", [400.0, 3.0, 0.3])
def test_few_digits_are_no_stop(digits, noise, size):
    """A peak is flat where its digits are few; a constant reading, and one of two values, say nothing."""
    k = np.arange(2000)
    x = size * np.sin(2 * np.pi * k / 900) + np.random.default_rng(2).normal(0.0, 1.0, 2000) * noise
    assert not saturated(np.round(x, digits) * UM).any()
    assert not saturated(np.zeros(100)).any() and not saturated(np.repeat([0.0, 1e-6], 50)).any()


def test_what_was_left_out_is_said(campaign):
    trace = campaign / "traces" / "turn.csv"
    time = [row.split(",")[0] for row in trace.read_text().split("\n")[1:-1]]
    top = np.clip(3.0 * np.sin(np.arange(len(time)) / 20) + np.random.default_rng(3).normal(0, 0.02, len(time)), -9, 2.0)
    trace.write_text("\n".join(["time_s,deviation_um", *(f"{t},{x:.2f}" for t, x in zip(time, top, strict=True)), ""]))
    held = int(read_trace(trace, Instrument()).saturated)
    assert held >= 30
    row = as_json("compare", campaign, "--no-plots", "--as-is")["tests"][0]
    assert row["samples_saturated"] == held <= row["samples_left_out"]
    assert f"its stop, or beyond its range, in {held} of {len(time)} samples" in " ".join(
        ok("compare", campaign, "--no-plots", "--as-is").stdout.split()
    )


# -- a full disk, an interrupt -----------------------------------------------------------------------------------------------------

WRITING = {
    "simulate": ["simulate", "{c}", "--out", "{c}/out/deeper", "--test", "turn"],
    "compare": ["compare", "{c}", "--out", "{c}/out"],
    "export": ["export", "{c}", "--out", "{c}/out"],
    "remove": ["remove", "{c}", "friction.X"],
    "nc": ["nc", "{c}", "--test", "turn", "-o", "{c}/out/p.nc"],
    "nc feed": ["nc", "feed", "{c}", "--test", "turn", "--step-deg", "2", "-o", "{c}/out/p.csv", "--plot", "{c}/out/p.png"],
    "import": ["import", "{c}/../turn.txt", "--campaign", "{c}", "--test", "turn", "--force", "--no-check"],
    "new": ["new", "campaign", "{c}/out/fresh"],
}


class Disk:
    """Stands for the disk: gives up at its ``n``-th action that counts."""

    def __init__(self, monkeypatch, give_up):
        self.left, self._give_up, self.replaced = 10**9, give_up, 0
        real = os.replace

        def replace(*args):
            real(*args)
            self.replaced += 1

        monkeypatch.setattr(os, "replace", replace)
        for owner, name in ((os, "replace"), (Path, "write_bytes"), (Path, "write_text")):
            monkeypatch.setattr(owner, name, self._counted(getattr(owner, name)))

    def _counted(self, real):
        def act(*args, **kwargs):
            self.left -= 1
            if self.left < 0:
                self.left = 10**9  # cleaning up works again
                if isinstance(args[0], Path) and len(args) > 1 and isinstance(args[1], bytes | str) and not args[0].exists():
                    real(args[0], args[1][: len(args[1]) // 2])  # half of it is there
                self._give_up()
            return real(*args, **kwargs)

        return act


def full():
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("name", WRITING)
@pytest.mark.parametrize("way", ["full", "Ctrl-C", "SIGTERM"])
def test_all_or_nothing(campaign, name, way, monkeypatch):
    """Whatever action of the disk is the one that fails: what was there is there, and nothing else.

    Once the first file is in its place, the others stand beside theirs; a failure then leaves whole files, and no temporary one.
    """
    shutil.copy(campaign / "traces" / "turn.csv", campaign.parent / "turn.txt")
    line = [a.format(c=campaign) for a in WRITING[name]]
    give_up = {"full": full, "Ctrl-C": lambda: signal.raise_signal(signal.SIGINT), "SIGTERM": lambda: signal.raise_signal(signal.SIGTERM)}[
        way
    ]
    disk = Disk(monkeypatch, give_up)
    before = snapshot(campaign.parent)
    for n in (0, 3, 30) if name == "compare" else range(30):
        disk.left, disk.replaced = n, 0
        result = run(*line)
        if disk.left < 10**8:  # it has ended before
            assert result.exit_code == 0, result.output
            break
        assert result.exit_code == {"full": 1, "Ctrl-C": 130, "SIGTERM": 143}[way], (n, result.output, result.exception)
        assert result.stderr.startswith("mjsim: ") and result.stderr.count("\n") == 1, result.stderr
        assert not [p for p in campaign.parent.rglob(".*.*") if p.is_file()], n
        if disk.replaced:
            break
        assert snapshot(campaign.parent) == before, (n, set(snapshot(campaign.parent)) ^ set(before))
    assert n > 0
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_replaced_files_come_back(tmp_path, monkeypatch):
    for name in "abc":
        (tmp_path / name).write_text(f"former {name}")
    real = os.replace

    def fail(new, path):
        if Path(path).name == "c" and ".former" not in str(new):
            raise OSError(errno.EIO, "Input/output error")
        real(new, path)

    before = snapshot(tmp_path)
    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(InputError, match="c: cannot be written: Input/output error"):
        files.write_all({tmp_path / n: "new" for n in "abc"}, force=True)
    assert snapshot(tmp_path) == before
    monkeypatch.setattr(os, "replace", real)
    monkeypatch.setattr(os, "link", lambda *_: full())  # a file system without hard links
    files.write_all({tmp_path / n: "new" for n in "abc"}, force=True)
    assert snapshot(tmp_path) == {Path(n): b"new" for n in "abc"}


def test_a_group_inside_a_group_belongs_to_it(tmp_path):
    with contextlib.suppress(KeyError), files.together():
        files.write_all({tmp_path / "deep" / "a": "1"})
        with files.together():
            files.write_whole(tmp_path / "b", "2")
        assert not (tmp_path / "b").exists()
        raise KeyError
    assert snapshot(tmp_path) == {}
    with files.together():
        files.write_whole(tmp_path / "a", "1")
        files.write_whole(tmp_path / "a", "2", force=True)
    assert snapshot(tmp_path) == {Path("a"): b"2"}


def test_terminated_while_it_works(tmp_path):
    """The real process: SIGTERM in the middle of a long run ends it with one sentence, and its folder is as it was."""
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


# -- what is nobody's fault, or mjsim's --------------------------------------------------------------------------------------------


def test_a_fault_of_its_own_is_one_sentence(campaign, monkeypatch):
    from mjsim.campaign import files as campaign_files

    def fault(*_):
        raise KeyError("line one\nline two")

    monkeypatch.setattr(campaign_files, "parse", fault)
    monkeypatch.delenv(common.TRACEBACK, raising=False)
    before = snapshot(campaign.parent)
    result = run("compare", campaign)
    assert (result.exit_code, result.stdout) == (3, "")
    assert result.stderr.startswith("mjsim: a fault of mjsim itself: KeyError in test_fuzz_writing.py, line ")
    assert result.stderr.count("\n") == 1 and "Traceback" not in result.stderr and common.TRACEBACK in result.stderr
    assert snapshot(campaign.parent) == before
    monkeypatch.setenv(common.TRACEBACK, "1")
    assert isinstance(run("compare", campaign).exception, KeyError)


def test_no_memory_is_one_sentence(campaign, monkeypatch):
    from mjsim.campaign import files as campaign_files

    def none(*_):
        raise MemoryError

    monkeypatch.setattr(campaign_files, "parse", none)
    refused(campaign.parent, ["compare", campaign], "not enough memory")


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp437"])
def test_terminals_without_greek_letters(campaign, encoding):
    env = {**os.environ, "PYTHONIOENCODING": encoding}
    call = [sys.executable, "-c", "from mjsim.cli.main import main; main()"]
    done = subprocess.run([*call, "effects", "friction"], capture_output=True, env=env, timeout=60)
    assert done.returncode == 0 and b"friction" in done.stdout, done.stderr
    done = subprocess.run([*call, "effects", "friction", "--json"], capture_output=True, env=env, timeout=60)
    assert json.loads(done.stdout.decode(encoding)) == as_json("effects", "friction")


def test_a_folder_whose_name_is_no_text(campaign):
    odd = campaign.rename(campaign.with_name("odd \udcff µ"))
    data = as_json("simulate", odd, "--test", "turn", "--out", odd / "out", "--no-plots")
    assert data["tests"][0]["name"] == "turn" and data["out"].endswith("out")
    assert ok("simulate", odd, "--test", "turn", "--out", odd / "out2", "--no-plots").exit_code == 0
    refused(odd.parent, ["new", "campaign", odd / "fresh\udcff"], "--name")


def test_an_unstable_machine_leaves_no_log(campaign, tmp_path, monkeypatch):
    """MuJoCo's own warnings go to stderr and to a file MUJOCO_LOG.TXT in the current folder, if nobody hears them."""
    monkeypatch.chdir(tmp_path)
    text = (campaign / "machine.toml").read_text()
    (campaign / "machine.toml").write_text(text.replace("worm_teeth = 60", "worm_teeth = 1e-300"))
    refused(tmp_path, ["simulate", campaign, "--out", tmp_path / "out", "--test", "turn"])
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_a_test_named_like_a_file_of_the_export(campaign):
    text = (campaign / "campaign.toml").read_text()
    (campaign / "campaign.toml").write_text(text.replace('name = "turn"', 'name = "figures"'))
    refused(campaign.parent, ["export", campaign, "--out", campaign / "out", "--json"], "figures", "rename")


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
