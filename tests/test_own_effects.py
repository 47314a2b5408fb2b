"""A user's own effect file that goes wrong is named in one sentence, with file and line; nothing is written."""

import gc
import json
import shutil
import threading

import pytest
from commands import as_json, refused

import mjsim
from mjsim.commands.edit import resolve_effect
from mjsim.effects import registry
from mjsim.errors import InputError, SimulationError
from mjsim.machine.chain import FIVE_AXIS
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


def text(body="pass", more=""):
    return FILE.replace("BODY", body) + more


@pytest.fixture
def campaign(good, tmp_path):
    return shutil.copytree(good, tmp_path / "campaign")


@pytest.fixture(autouse=True)
def the_process_is_as_before():
    threads = set(threading.enumerate())
    yield
    gc.collect()  # pools end with their last owner, and their threads soon after
    for thread in set(threading.enumerate()) - threads:
        thread.join(5.0)
        assert not thread.is_alive()


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
    mine = as_json(*simulated(campaign), "--force")["tests"][0]
    assert mine["max_um"] != plain["max_um"]


# -- position_error ----------------------------------------------------------------------------------------------------

ALLOWED = "allowed: an array of finite numbers, m and rad, shape"
BAD = {
    "raises": ("1 / 0", "raised ZeroDivisionError: division by zero", "line 13"),
    "an effect's own refusal": ("self.replaced(size_um=1e9)", "out of bounds", "line 13"),
    "misspells a parameter": ("self.si('sice_um')", "KeyError: 'sice_um'", "line 13", "has the parameters size_um"),
    "gives nothing": ("return", "returned None: is `return` missing?", "line 11", ALLOWED),
    "gives NaN": ("out[5, 2] = np.nan", "returned numbers that are not finite (1 of", ALLOWED),
    "gives another shape": ("return out[:, 3]", "returned shape", ALLOWED),
    "gives micrometres": ("out *= 1e6", "returned 2, more than 1 m or rad (µm or degrees?)"),
    "writes into the motion": ("motion.position[0, 0] = 1.0", "ValueError", "line 13", "work on a copy"),
}


@pytest.mark.parametrize("case", BAD)
def test_position_error(campaign, case):
    body, *words = BAD[case]
    equip(campaign, text(body))
    refused(campaign.parent, simulated(campaign), "effect mine.A: position_error", "(mine.py", *words)


COMMANDS = {
    "compare": ["compare", "C"],
    "diagnose": ["diagnose", "C"],
    "add": ["add", "C", "backlash.A"],
    "plan": ["plan", "C"],
    "report": ["report", "C", "-o", "C/report.html"],
    "animate": ["animate", "C", "--test", "turn", "-o", "C/film.mp4"],
    "all tests": ["simulate", "C", "--out", "C/out"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_names_the_line(campaign, command):
    equip(campaign, text("1 / 0"))
    args = [a.replace("C", str(campaign), 1) if a.startswith("C") else a for a in COMMANDS[command]]
    refused(campaign.parent, args, "effect mine.A: position_error raised ZeroDivisionError", "(mine.py, line 13)")


def test_a_fit_names_the_line(campaign):
    """The machine does not have the effect yet: it first runs inside the fit."""
    (campaign / "mine.py").write_text(text("1 / 0"))
    refused(
        campaign.parent,
        ["add", campaign, campaign / "mine.py", "--threads", 2, "--json"],
        "effect mine.A: position_error",
    )


def test_a_class_that_nobody_registered(m1, cone):
    """A script can hand any object to the library."""

    class Loose(Effect):
        kind, subjects, parameters = "loose", ("A",), (Parameter("size_um", "size", neutral=0.0),)

        def position_error(self, motion):
            raise SystemExit(0)

    with pytest.raises(
        SimulationError, match=r"effect loose\.A: position_error raised SystemExit: 0 \(test_own_effects\.py, line"
    ):
        simulate(m1.with_effect(Loose("A", size_um=1.0)), [cone(15, 10, (0, 0, 155), 20000)])


# -- while the file is loaded ------------------------------------------------------------------------------------------

LOADED = {
    "leaves": (text() + "\nraise SystemExit(0)\n", "SystemExit: 0 (mine.py, line 16)"),
    "raises": (text() + "\nx = 1\nx.y\n", "AttributeError", "line 17)"),
    "wrong syntax": ("import mjsim\nclass (:\n", "SyntaxError", "line 2)"),
    "imports what is not there": (
        "import no_such_module_of_mine\n",
        "ModuleNotFoundError",
        "no_such_module_of_mine",
        "line 1)",
    ),
    "forgets to register": (text().replace("@mjsim.register\n", ""), "no class has @mjsim.register above it"),
    "two effects": (
        text() + text().replace('"mine"', '"mine_too"').replace("Mine", "Too"),
        "2 classes",
        "(Mine, Too)",
        "one class a file",
    ),
    "a kind that exists": (
        text().replace('"mine"', '"backlash"'),
        "'backlash'",
        "already taken",
        "choose another kind",
    ),
    "a kind that is no name": (text().replace('"mine"', '"my kind"'), "kind = 'my kind'", "letters"),
    "no kind": (text().replace('    kind = "mine"\n', ""), "'kind' is missing"),
    "a subject that is a text": (text().replace('("A",)', '"A"'), "subjects = 'A'", "a tuple"),
    "a parameter without comma": (text().replace("neutral=0.0),)", "neutral=0.0))"), "a tuple of mjsim.Parameter"),
    "a parameter without a unit": (
        text().replace('"size_um"', '"size"'),
        "'size' has no unit",
        "_um",
        "_deg",
        "ratio, order",
    ),
    "a parameter in inches": (
        text().replace('"size_um"', '"size_inch"'),
        "parameter name 'size_inch' has no unit",
        "_mm",
    ),
    "a parameter in a unit of its own": (
        text().replace('"size_um"', '"size_urad_per_rad_per_s"'),
        "parameter name 'size_urad_per_rad_per_s' has no unit",
        "_urad",
    ),
    "bounds the wrong way": (text().replace("0.0, 50.0", "50.0, 0.0"), "parameter size_um has the bounds 50 to 0"),
    "a scale of zero": (text().replace("neutral=0.0", "neutral=0.0, scale=0.0"), "scale of the parameter size_um"),
    "free of what is not there": (
        text().replace('kind = "mine"', 'kind = "mine"; search = mjsim.SearchHints(free=("width",))'),
        "free = ('width',)",
        "size_um",
    ),
    "hints outside search": (
        text().replace("title =", "quasi_static = False; title ="),
        "search = mjsim.SearchHints(quasi_static=",
    ),
    "a title that is none": (text().replace('"of a test"', "None"), "title = None", "a text"),
}


@pytest.mark.parametrize("case", LOADED)
def test_loading(campaign, case):
    content, *words = LOADED[case]
    known = registry.kinds()
    (campaign / "mine.py").write_bytes(content if isinstance(content, bytes) else content.encode())
    refused(campaign.parent, ["add", campaign, campaign / "mine.py", "--json"], "effect file", "mine.py", *words)
    (campaign / "machine.toml").open("a").write('\n[[effect]]\nid = "mine.A"\nfile = "mine.py"\nsize_um = 2.0\n')
    refused(campaign.parent, simulated(campaign), 'machine.toml: [[effect]] "mine.A": effect file', "mine.py", *words)
    assert registry.kinds() == known


def test_every_effect_of_the_catalogue_keeps_the_rules_of_one_s_own():
    assert not any(map(registry._wrong, registry.kinds().values()))


def test_it_is_not_there(campaign):
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
        with pytest.raises(
            InputError, match="effect 'wave' of the installed package my-package: ImportError: no luck; mend or"
        ):
            registry.kinds()
    finally:
        monkeypatch.undo()
        registry.kinds()


# -- an effect whose file is gone or broken is taken out by its id -----------------------------------------------------


@pytest.mark.parametrize("content", [None, "1 / 0\n"], ids=["gone", "broken"])
def test_an_effect_without_its_file_is_removed(campaign, content):
    before = (campaign / "machine.toml").read_text()
    equip(campaign, text() if content is None else content)
    if content is None:
        (campaign / "mine.py").unlink()
    with_it = (campaign / "machine.toml").read_bytes()
    refused(campaign.parent, ["compare", campaign], '"mine.A"', "mine.py", "`mjsim remove`")
    data = as_json("remove", campaign, "mine.A")
    assert data["effect"] == {"id": "mine.A", "parameters": {}, "ci95": {}}
    assert data["rms_before_um"] is None and data["rms_after_um"] > 0.0
    assert (campaign / "machine.toml").read_text().strip() == before.strip()
    assert (campaign / ".mjsim" / "machine.001.toml").read_bytes() == with_it
    steps = json.loads((campaign / ".mjsim" / "history.json").read_text())["steps"]
    assert [s["action"] for s in steps] == ["remove"]


def test_another_effect_waits_for_the_file(campaign):
    equip(campaign, text())
    (campaign / "mine.py").unlink()
    refused(campaign.parent, ["remove", campaign, "friction.X"], '"mine.A"', "no such file")


# -- everything else that a class can override -------------------------------------------------------------------------

METHODS = {
    "apply raises": (
        "    def apply(self, plant):\n        plant.axes['Q']\n",
        "mine.A: apply raised KeyError: 'Q' (mine.py, line 16)",
    ),
    "apply gives NaN": (
        "    def apply(self, plant):\n        plant.axes['A'].delay = np.nan\n",
        "apply put delay = nan into the A drive",
    ),
    "apply takes the inertia": (
        "    def apply(self, plant):\n        plant.axes['A'].inertia = 0\n",
        "put inertia = 0 into the A drive",
    ),
    "a property raises": (
        "    @property\n    def is_neutral(self):\n        return 1 / 0\n",
        "mine.py, line 17: raised ZeroDivisionError",
    ),
}


@pytest.mark.parametrize("case", METHODS)
def test_methods(campaign, case, monkeypatch):
    monkeypatch.delenv("MJSIM_TRACEBACK", raising=False)
    more, *words = METHODS[case]
    equip(campaign, text(more=more))
    refused(campaign.parent, simulated(campaign), *words)


# -- where it runs ---------------------------------------------------------------------------------------------------


def test_in_another_thread(m1, cone, campaign):
    (campaign / "mine.py").write_text(text("1 / 0"))
    effect = registry.load_file(campaign / "mine.py")("A", size_um=2.0)
    said = []

    def work():
        try:
            simulate(m1.with_effect(effect), [cone(15, 10, (0, 0, 155), 20000)])
        except SimulationError as error:
            said.append(str(error))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert said and "raised ZeroDivisionError" in said[0]


def test_nothing_is_installed_after_a_failure(campaign):
    equip(campaign, text("1 / 0"))
    with pytest.raises(SimulationError):
        simulate(mjsim.read_machine(campaign / "machine.toml"), mjsim.read_campaign(campaign).tests, threads=2)
    assert not callback._users


def test_a_file_may_be_named_by_a_path(campaign):
    file = campaign / "mine.py"
    file.write_text(FILE.replace("BODY", "pass"))
    for name in (file, str(file)):
        cls, subjects, source = resolve_effect(name, FIVE_AXIS)
        assert (cls.kind, subjects, source) == ("mine", ["A"], file.resolve())


def test_an_effect_of_one_machine_is_none_of_another(campaign, good, tmp_path):
    """Several machines in one process, as in a fleet: each has the effects of its own files."""
    from mjsim.campaign.machine_file import read_machine
    from mjsim.inference.signatures import seeds

    other = shutil.copytree(good, tmp_path / "other")
    for folder, name in ((campaign, "mine.py"), (other, "same_kind.py")):
        (folder / name).write_text(text())
        with (folder / "machine.toml").open("a") as file:
            file.write(f'\n[[effect]]\nid = "mine.A"\nfile = "{name}"\nsize_um = 1.0\n')
    machines = [read_machine(folder / "machine.toml") for folder in (campaign, other, good)]
    tried = [[c.effect for c in seeds(m) if c.id == "mine.A"] for m in machines]
    assert [len(effects) for effects in tried] == [1, 1, 0]
    assert type(tried[0][0]) is not type(tried[1][0])
    assert "mine.A" not in registry.all_ids()


def test_two_files_of_one_machine_with_one_kind(campaign):
    for name, subject in (("mine.py", "A"), ("yours.py", "C")):
        (campaign / name).write_text(text().replace('("A",)', f'("{subject}",)'))
        with (campaign / "machine.toml").open("a") as file:
            file.write(f'\n[[effect]]\nid = "mine.{subject}"\nfile = "{name}"\nsize_um = 1.0\n')
    refused(campaign.parent, simulated(campaign), "yours.py and mine.py both define the kind 'mine'")


def test_an_effect_file_that_the_machine_uses_is_not_written_over(campaign):
    """A second unknown cause on an axis gets a file of its own."""
    from dataclasses import replace

    from mjsim.campaign.machine_file import read_machine
    from mjsim.commands.diagnosis import unused_file

    machine = read_machine(campaign / "machine.toml")
    folder = campaign / ".mjsim"
    assert unused_file(folder, "unexplained_C", machine) == folder / "unexplained_C.py"
    using = replace(machine, effect_files={"a.C": ".mjsim/unexplained_C.py", "b.C": ".mjsim/unexplained_C_2.py"})
    assert unused_file(folder, "unexplained_C", using) == folder / "unexplained_C_3.py"
