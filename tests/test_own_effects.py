"""A user's own effect that misbehaves is stopped and named in one sentence, whatever it does; nothing is written, nothing runs on."""

import json
import os
import pickle
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from commands import as_json, ok, refused, run, snapshot

import mjsim
from mjsim.batch.workshop import Job, Workshop
from mjsim.effects import guard, last_resort, registry
from mjsim.effects.hooks import guard_class
from mjsim.errors import EffectTimeout, InputError, SimulationError
from mjsim.machine.effect import Effect, Parameter
from mjsim.simulation import callback
from mjsim.simulation.multibody import simulate

#: An effect file; line 13 is the first of what position_error does.
FILE = """\
import time
import numpy as np
import mjsim

@mjsim.register
class Mine(mjsim.Effect):
    kind = "mine"
    subjects = ("A",)
    title = definition = source = signature = "of a test"
    parameters = (mjsim.Parameter("size_um", "size", 0.0, 50.0, neutral=0.0),)
    def position_error(self, motion):
        out = np.zeros_like(motion.position)
        out[:, 3] = self.si("size_um") * np.sin(7 * motion.position[:, 3]); BODY
        return out
"""
LOOP = "\n        while True: pass"
#: Shortest limit that a loaded machine keeps for code that does end.
SHORT = "0.3"


def text(body="pass", more=""):
    return FILE.replace("BODY", body) + more


@pytest.fixture
def campaign(good, tmp_path):
    return shutil.copytree(good, tmp_path / "campaign")


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setenv(guard.VARIABLE, SHORT)


@pytest.fixture(autouse=True)
def nothing_runs_on(monkeypatch):
    """After every test the only threads of own effects are those that wait for work, and the process is as it was."""
    monkeypatch.setattr(last_resort, "wanted", lambda: None)  # it would end the tests
    before = resource.getrlimit(resource.RLIMIT_AS), sys.stdout
    yield
    assert {t for t in threading.enumerate() if isinstance(t, guard._Worker)} == set(guard._idle)
    assert before == (resource.getrlimit(resource.RLIMIT_AS), sys.stdout)


def equip(campaign, content):
    """The campaign's machine with the effect of a file."""
    (campaign / "mine.py").write_text(content)
    with open(campaign / "machine.toml", "a") as file:
        file.write('\n[[effect]]\nid = "mine.A"\nfile = "mine.py"\nsize_um = 2.0\n')


def simulated(campaign):
    return ["simulate", campaign, "--out", campaign / "out", "--test", "turn", "--no-plots", "--json"]


def test_one_that_behaves(campaign):
    plain = as_json(*simulated(campaign))["tests"][0]
    equip(campaign, text())
    own = as_json(*simulated(campaign), "--force")["tests"][0]
    assert own["max_um"] != plain["max_um"]


# -- position_error -----------------------------------------------------------------------------------------------------------------

GAVE = "allowed: an array of finite numbers, m and rad, shape"
BAD = {
    "raises": ("1 / 0", "raised ZeroDivisionError: division by zero", "line 13"),
    "raises an error of its own": ("raise type('Odd', (BaseException,), {'__str__': lambda s: 1 / 0})", "raised Odd", "line 13"),
    "raises a long story": ("raise ValueError('long ' * 1000)", "raised ValueError: long long", "line 13"),
    "raises two lines": ("raise ValueError('one\\ntwo')", "raised ValueError: one two"),
    "leaves": ("import sys; sys.exit(0)", "raised SystemExit: 0", "line 13"),
    "interrupts": ("raise KeyboardInterrupt", "raised KeyboardInterrupt", "line 13"),
    "an effect's own refusal": ("self.replaced(size_um=1e9)", "raised InputError", "out of bounds", "line 13"),
    "gives nothing": ("return", "gave None", GAVE),
    "gives NaN": ("out[5, 2] = np.nan", "gave numbers that are not finite (1 of", GAVE),
    "gives infinity": ("out[:, 0] = -np.inf", "not finite", GAVE),
    "gives another shape": ("return out[:, 3]", "gave shape", GAVE),
    "gives one row less": ("return out[1:]", "gave shape", GAVE),
    "gives complex numbers": ("return out + 1j", "gave an array of complex128", GAVE),
    "gives texts": ("return out.astype(str)", "gave an array of <U32", GAVE),
    "gives truths": ("return out > 0", "gave an array of bool", GAVE),
    "gives a ragged list": ("return [[1.0], [1.0, 2.0]]", "raised ValueError"),
    "gives something odd": ("return object()", "gave a object of object", GAVE),
    "gives micrometres": ("out *= 1e6", "gave 2; allowed: errors up to 1, in m and rad (not µm or degrees)"),
    "writes into the motion": ("motion.position[0, 0] = 1.0", "ValueError", "line 13", "work on a copy"),
    "writes into the times": ("motion.time[:] = 0.0", "ValueError", "line 13", "work on a copy"),
    "replaces the motion": ("motion.position = out", "FrozenInstanceError", "line 13"),
    "wants all memory": ("np.ones((10**7, 10**7))", "raised", "MemoryError", "line 13"),
    "recurses": ("(f := lambda: f())()", "raised RecursionError", "line 13"),
    "loops": (LOOP, "did not end within 0.3 s", "line 14", guard.VARIABLE),
    "loops and keeps errors": (
        "\n        while True:\n            try: time.sleep(0)\n            except Exception: pass",
        "did not end within 0.3 s",
    ),
    "loops and keeps everything": (
        "\n        while True:\n            try: sum(range(100))\n            except: pass", "did not end within 0.3 s", guard.VARIABLE,
    ),
    "loops while it is converted": (
        "return type('Odd', (), {'__array__': lambda s, *a, **k: [0 for _ in iter(int, 1)]})()", "did not end within 0.3 s", guard.VARIABLE,
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_position_error(campaign, case, short):
    body, *words = BAD[case]
    equip(campaign, text(body))
    said = refused(campaign.parent, simulated(campaign), "effect mine.A: position_error ", "(mine.py", *words)
    assert "; mend the file" in said or "; work on a copy" in said or "; what the motion holds" in said


COMMANDS = {
    "compare": ["compare", "C"],
    "diagnose": ["diagnose", "C"],
    "add": ["add", "C", "backlash.A"],
    "remove": ["remove", "C", "friction.X"],
    "plan": ["plan", "C"],
    "export": ["export", "C", "--out", "C/out"],
    "report": ["report", "C", "-o", "C/report.html"],
    "animate": ["animate", "C", "--test", "turn", "-o", "C/film.mp4"],
    "simulate": ["simulate", "C", "--out", "C/out"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_stops_a_loop(campaign, command, short):
    equip(campaign, text(LOOP))
    args = [a.replace("C", str(campaign), 1) if a.startswith("C") else a for a in COMMANDS[command]]
    refused(campaign.parent, args, "mine.A", "position_error did not end within 0.3 s (mine.py, line 14)", guard.VARIABLE)


def test_a_sweep_stops_at_a_loop(campaign, short):
    """Every other run would wait for it as well; what raises is told per run instead (test_batch.py)."""
    equip(campaign, text(LOOP))
    turn = (campaign / "campaign.toml").read_text().split("[[test]]")[1].replace('trace = "traces/turn.csv"\n', "")
    (campaign / "sweep.toml").write_text(
        f'name = "s"\nmachine = "machine.toml"\n[[test]]{turn}[[vary]]\nparameter = "backlash.A.width_deg"\nvalues = [0.0, 0.001]\n'
    )
    result = run("batch", campaign / "sweep.toml", "--out", campaign / "out", "--json")
    assert (result.exit_code, result.stdout) == (1, "")
    assert "effect mine.A: position_error did not end within 0.3 s (mine.py, line 14)" in result.stderr
    assert result.stderr.count("\n") == 1 and not list((campaign / "out").rglob("part-*"))


def test_the_sentence_comes_back_from_a_cluster(campaign, short):
    equip(campaign, text(LOOP))
    c = mjsim.read_campaign(campaign)
    from mjsim.batch.cluster import Shop, _pack, _work
    from mjsim.batch.describe import versions
    from mjsim.batch.recipe import Recipe

    shop = pickle.loads(pickle.dumps(Shop(_pack(Recipe(mjsim.read_machine(c.machine_file), ())), 0)))
    with pytest.raises(EffectTimeout, match=r"effect mine\.A: .*\(mine\.py, line 14\)") as caught:
        _work(shop, [Job(0, 0, c.tests[0], np.zeros(0), None)], versions())
    again = pickle.loads(pickle.dumps(caught.value))
    assert type(again) is EffectTimeout and str(again) == str(caught.value)
    assert not callback._users


def test_all_threads_stop(campaign, short, cone):
    """Several tests side by side, each in the loop."""
    equip(campaign, text(LOOP))
    machine = mjsim.read_machine(campaign / "machine.toml")
    begun = time.monotonic()
    with pytest.raises(EffectTimeout):
        simulate(machine, [cone(15, 10, (0, 0, 155), 20000, name=f"t{i}") for i in range(6)], threads=2)
    assert time.monotonic() - begun < 5.0
    assert not callback._users


def test_what_it_prints_leaves_stdout_alone(campaign):
    equip(campaign, text("print('hello from mine'); import sys; sys.stdout.write('and on')") + "\nprint('loaded')\n")
    result = ok(*simulated(campaign))
    assert json.loads(result.stdout)["tests"]
    assert "hello from mine" in result.stderr and "and on" in result.stderr and "loaded" in result.stderr


def test_it_cannot_change_what_another_sees(campaign):
    """Writing is refused for views as well, and what was given back can be changed later without harm."""
    equip(campaign, text("motion.position.T[3, 5:] = 0.0"))
    refused(campaign.parent, simulated(campaign), "read-only", "work on a copy")


def test_it_may_keep_its_result(campaign, cone):
    (campaign / "mine.py").write_text(text("\n        if hasattr(self, 'kept'): self.kept += 1.0\n        self.kept = out"))
    effect = registry.load_file(campaign / "mine.py")("A", size_um=2.0)
    machine = mjsim.read_machine(campaign / "machine.toml").with_effect(effect)
    tests = [cone(15, 10, (0, 0, 155), 20000, name=f"t{i}") for i in range(2)]
    first, second = simulate(machine, tests, threads=1)
    assert np.array_equal(first.deviation, second.deviation)


def test_memory_has_an_end_while_it_runs(campaign):
    equip(campaign, text("import resource; assert resource.getrlimit(resource.RLIMIT_AS)[0] < 1e15 and False, 'limited'"))
    before = resource.getrlimit(resource.RLIMIT_AS)
    assert before[0] == resource.RLIM_INFINITY
    refused(campaign.parent, simulated(campaign), "AssertionError: limited")


# -- while the file is loaded -------------------------------------------------------------------------------------------------------

LOADED = {
    "loops": (text() + "\nwhile True: pass\n", "did not end within 0.1 s while it was loaded (line 16)", guard.VARIABLE),
    "loops and keeps errors": (text() + "\nwhile True:\n    try: time.sleep(0.001)\n    except Exception: pass\n", "did not end within"),
    "leaves": (text() + "\nraise SystemExit(0)\n", "SystemExit: 0 (line 16)"),
    "interrupts": (text() + "\nraise KeyboardInterrupt\n", "KeyboardInterrupt (line 16)"),
    "raises": (text() + "\nx = 1\nx.y\n", "AttributeError", "(line 17)"),
    "wrong syntax": ("import mjsim\nclass (:\n", "SyntaxError", "(line 2)"),
    "wrong indent": ("import mjsim\n  x = 1\n", "IndentationError", "(line 2)"),
    "wrong encoding": (b"# -*- coding: none -*-\n", "SyntaxError"),
    "no text": (b"\x7fELF\x00\x00\xff", "mine.py"),
    "imports what is not there": ("import no_such_module_of_mine\n", "ModuleNotFoundError", "no_such_module_of_mine", "(line 1)"),
    "empty": ("", "0 effect classes registered", "exactly one"),
    "forgets to register": (text().replace("@mjsim.register\n", ""), "0 effect classes registered", "@register"),
    "two effects": (text() + text().replace('"mine"', '"mine_too"'), "2 effect classes registered", "exactly one"),
    "a kind that exists": (text().replace('"mine"', '"backlash"'), "'backlash'", "already taken", "choose another kind"),
    "a kind that is no name": (text().replace('"mine"', '"my kind"'), "kind = 'my kind'", "letters"),
    "a kind that is a number": (text().replace('"mine"', "7"), "kind = 7"),
    "no kind": (text().replace('    kind = "mine"\n', ""), "'kind' is missing"),
    "a subject that is a text": (text().replace('("A",)', '"A"'), "subjects = 'A'", "a tuple"),
    "no subjects": (text().replace('("A",)', "()"), "subjects = ()"),
    "the same subject twice": (text().replace('("A",)', '("A", "A")'), "different names"),
    "a parameter without comma": (text().replace("neutral=0.0),)", "neutral=0.0))"), "a tuple of mjsim.Parameter"),
    "a parameter that is none": (text().replace('(mjsim.Parameter("size_um", "size", 0.0, 50.0, neutral=0.0),)', "(3,)"), "no mjsim.Par"),
    "bounds the wrong way": (text().replace("0.0, 50.0", "50.0, 0.0"), "bounds of size_um"),
    "neutral outside its bounds": (text().replace("neutral=0.0", "neutral=-1.0"), "bounds of size_um"),
    "a scale of zero": (text().replace("neutral=0.0", "neutral=0.0, scale=0.0"), "scale of size_um"),
    "a bound that is a text": (text().replace("50.0,", '"50",'), "something else than numbers"),
    "free of what is not there": (text().replace('kind = "mine"', 'kind = "mine"; free = ("width",)'), "free = ('width',)", "size_um"),
    "a title that is none": (text().replace('"of a test"', "None"), "title = None", "a text"),
}  # fmt: skip


@pytest.mark.parametrize("case", LOADED)
def test_loading(campaign, case, short):
    content, *words = LOADED[case]
    known = registry.kinds()
    (campaign / "mine.py").write_bytes(content if isinstance(content, bytes) else content.encode())
    refused(campaign.parent, ["add", campaign, campaign / "mine.py", "--json"], "effect file", "mine.py: ", *words)
    (campaign / "machine.toml").open("a").write('\n[[effect]]\nid = "mine.A"\nfile = "mine.py"\nsize_um = 2.0\n')
    refused(campaign.parent, simulated(campaign), "machine.toml: [[effect]] number 6: effect file", "mine.py: ", *words)
    assert registry.kinds() == known


def test_it_is_not_there(campaign):
    refused(campaign.parent, ["add", campaign, campaign / "mine.py", "--json"], "mine.py", "no such file")
    (campaign / "mine.py").mkdir()
    refused(campaign.parent, ["add", campaign, campaign / "mine.py", "--json"], "mine.py", "no such file")
    (campaign / "mine.txt").write_text(text())
    refused(campaign.parent, ["add", campaign, campaign / "mine.txt", "--json"], "mine.txt", "(.py)")


def test_an_installed_package_that_fails_is_named(monkeypatch):
    class Point:
        name, dist = "wave", type("Dist", (), {"name": "my-package"})

        def load(self):
            raise ImportError("no luck")

    monkeypatch.setattr(registry, "entry_points", lambda group: [Point()])
    registry._load_installed.cache_clear()
    try:
        with pytest.raises(InputError, match="effect 'wave' of the installed package my-package: raised ImportError: no luck; mend or"):
            registry.kinds()
    finally:
        monkeypatch.undo()
        registry.kinds()


# -- everything else that a class can override --------------------------------------------------------------------------------------

HOOKS = {
    "apply loops": (
        "    def apply(self, plant):\n        while True: pass\n",
        "apply did not end within 0.3 s (mine.py, line 16)",
    ),
    "apply raises": (
        "    def apply(self, plant):\n        plant.axes['Q']\n",
        "apply raised KeyError: 'Q' (mine.py, line 16)",
    ),
    "apply gives NaN": (
        "    def apply(self, plant):\n        plant.axes['A'].delay = float('nan')\n",
        "apply put delay = nan into the A drive",
    ),
    "apply takes the inertia": (
        "    def apply(self, plant):\n        plant.axes['A'].inertia = 0\n",
        "apply put inertia = 0 into the A drive",
    ),
    "apply adds what is none": (
        "    def apply(self, plant):\n        plant.add_op('user', 99, 'A', 1.0)\n",
        "an operation with code 99",
    ),
    "a property loops": (
        "    @property\n    def is_neutral(self):\n        while True: pass\n", "is_neutral did not end within 0.3 s (mine.py, line 17)",
    ),
    "a property that is none": ("    @property\n    def is_neutral(self):\n        return 3\n", "is_neutral gave 3", "True or False"),
    "a key that is none": ("    @property\n    def key(self):\n        return 3\n", "key gave 3", "a text"),
    "forgets the base": ("    def __init__(self, subject, **values):\n        pass\n", "mine.A: __init__ did not call super()"),
    "__init__ raises": ("    def __init__(self, subject, **values):\n        1 / 0\n", "mine.A: __init__ raised ZeroDivisionError"),
    "__init__ loops": ("    def __init__(self, subject, **values):\n        while 1: pass\n", "mine.A: __init__ did not end within 0.3 s"),
    "parameters that are none": (
        "    @classmethod\n    def parameters_of(cls, subject):\n        return None\n", "effect mine: parameters_of gave None",
    ),
    "bodies that fit nowhere": (
        "    def edit_spec(self, spec):\n        spec.worldbody.add_body(name='x').add_joint()\n", "mine.A", "edit_spec",
    ),
    "edit_spec raises": ("    def edit_spec(self, spec):\n        spec.body('no such').mass = 1\n", "mine.A: edit_spec raised"),
    "edit_model raises": ("    def edit_model(self, model):\n        model.body('no such')\n", "mine.A: edit_model raised KeyError"),
    "edit_model loops": ("    def edit_model(self, model):\n        while 1: pass\n", "mine.A: edit_model did not end within 0.3 s"),
}  # fmt: skip


@pytest.mark.parametrize("case", HOOKS)
def test_hooks(campaign, case, short):
    more, *words = HOOKS[case]
    equip(campaign, text(more=more))
    refused(campaign.parent, simulated(campaign), "effect mine", *words)


FITTED = {
    "seeds that are none": ("    @classmethod\n    def seeds(cls, subject):\n        return None\n", "seeds gave None", "a list of dict"),
    "seeds of another": ("    @classmethod\n    def seeds(cls, subject):\n        return [{'x': 1}]\n", "seeds gave [{'x': 1}]", "size_um"),
    "seeds loop": ("    @classmethod\n    def seeds(cls, subject):\n        while 1: pass\n", "seeds did not end within 0.3 s"),
    "free of another": ("    @classmethod\n    def free_of(cls, subject):\n        return 'x',\n", "free_of gave ('x',)", "size_um"),
    "free of a text": ("    @classmethod\n    def free_of(cls, subject):\n        return 'x'\n", "free_of gave 'x'", "size_um"),
    "replaced by nothing": ("    def replaced(self, **values):\n        return None\n", "replaced gave None", "an effect"),
    "position_error loops": ("    def position_error(self, motion):\n        while 1: pass\n", "position_error did not end within 0.3 s"),
}


@pytest.mark.parametrize("case", FITTED)
def test_what_a_fit_asks(campaign, case, short):
    more, *words = FITTED[case]
    (campaign / "mine.py").write_text(text(more=more))
    refused(campaign.parent, ["add", campaign, campaign / "mine.py", "--json"], "effect mine", *words)


def test_a_class_that_nobody_registered(m1, cone):
    """A script can hand any object to the library."""

    class Loose(Effect):
        kind, subjects, parameters = "loose", ("A",), (Parameter("size_um", "size", neutral=0.0),)

        def position_error(self, motion):
            raise SystemExit(0)

    with pytest.raises(SimulationError, match=r"effect loose\.A: position_error raised SystemExit: 0 \(test_own_effects\.py, line"):
        simulate(m1.with_effect(Loose("A", size_um=1.0)), [cone(15, 10, (0, 0, 155), 20000)])


# -- the watch itself ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", ["soon", "0", "-1", "nan", "1e9"])
def test_a_limit_that_is_none(campaign, monkeypatch, value):
    monkeypatch.setenv(guard.VARIABLE, value)
    equip(campaign, text())
    refused(campaign.parent, simulated(campaign), guard.VARIABLE, repr(value), "seconds above 0")


def test_a_slow_effect_has_time(campaign, monkeypatch):
    """The limit as shipped is a minute per call; one that takes longer than a short limit passes with a longer one."""
    monkeypatch.delenv(guard.VARIABLE, raising=False)
    assert guard.limit() == 60.0
    monkeypatch.setenv(guard.VARIABLE, "")
    assert guard.limit() == 60.0
    body = "end = time.monotonic() + 0.5\n        while time.monotonic() < end: pass"
    equip(campaign, text(body))
    as_json(*simulated(campaign))
    monkeypatch.setenv(guard.VARIABLE, SHORT)
    refused(campaign.parent, [*simulated(campaign), "--force"], "did not end within 0.3 s")


@pytest.mark.parametrize("body", ["time.sleep(100)", "sum(range(10**15))"], ids=["waits", "holds Python's lock"])
def test_code_that_is_not_python_does_not_keep_the_process(campaign, body):
    """A long sleep cannot be interrupted, and a loop in C not even looked at; the command ends all the same and says why."""
    equip(campaign, text(body))
    before = snapshot(campaign)
    command = [sys.executable, "-c", "from mjsim.cli.main import main; main()", *map(str, simulated(campaign))]
    done = subprocess.run(command, env={**os.environ, guard.VARIABLE: SHORT}, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("mjsim: effect mine.A: position_error did not end within 0.3 s"), done.stderr
    assert done.stderr.count("\n") == 1 and "mend the file" in done.stderr
    assert snapshot(campaign) == before


def test_the_watch_costs_next_to_nothing():
    """Less than a millisecond per call, where the motion that is handed over takes more."""

    def own():
        return 1

    guard.watched("", own)
    begun = time.perf_counter()
    for _ in range(200):
        guard.watched("", own)
    assert (time.perf_counter() - begun) / 200 < 2e-3


def test_built_in_effects_are_not_watched():
    for cls in registry.kinds().values():
        guard_class(cls)
        assert not any(getattr(m, "_watched_by_mjsim", False) for c in cls.__mro__ for m in vars(c).values())


def test_workers_do_not_outlive_a_fork(campaign):
    """A child process has none of its parent's threads, and makes its own."""
    guard.watched("", int)
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.write(write, b"%d" % guard.watched("", lambda: 42))
        os._exit(0)
    os.close(write)
    assert os.waitpid(child, 0)[1] == 0
    assert os.read(read, 10) == b"42"


def test_an_interrupt_of_the_user_stops_the_code(monkeypatch):
    """Ctrl-C reaches the waiting caller, and with it the code."""

    def interrupted():
        threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
        while True:
            pass

    monkeypatch.setenv(guard.VARIABLE, "30")
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        guard.watched("", interrupted)
    assert time.monotonic() - begun < 10.0


def test_workshop_survives(campaign, short):
    """A run that loops leaves the workshop's thread fit for the next one."""
    equip(campaign, text("\n        while self.si('size_um') > 1e-6: pass"))
    from mjsim.batch.recipe import Recipe

    c = mjsim.read_campaign(campaign)
    machine = mjsim.read_machine(c.machine_file)
    shop = Workshop(Recipe(machine, ()))
    job = Job(0, 0, c.tests[0], np.zeros(0), None)
    with callback.installed():
        with pytest.raises(EffectTimeout):
            shop.run(job)
        shop._recipe = Recipe(machine.with_effect(machine.effect("mine.A").replaced(size_um=0.5)), ())
        assert shop.run(job).error is None
