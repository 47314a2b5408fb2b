"""The sense of rotary axes: one machine described in both senses reads the same, and its programs, logs and tables
differ by the sign of what turns, and by nothing else.
"""

import re
import shutil
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import tomlkit
from commands import as_json, run
from test_any_machine import MACHINES

import mjsim
from mjsim.animation.scene import scene_of
from mjsim.campaign.chain_file import chain_of_file
from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import machine_document, read_machine
from mjsim.campaign.new import new_log_campaign, new_machine
from mjsim.compensation.controls import CONTROLS, control
from mjsim.compensation.tables import wanted_of
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.importing.logs import import_log
from mjsim.inference.unexplained import _chain_text
from mjsim.instruments.ball_bar.kinds import KINDS, able_kinds, kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program, driven_by
from mjsim.io.resources import examples
from mjsim.linuxcnc import configuration
from mjsim.linuxcnc.configuration import Settings, kinematics, write_configuration
from mjsim.machine.bodies import model_spec
from mjsim.machine.chain import FIVE_AXIS, SENSES, Placement, chain_of, usual_travel
from mjsim.machine.kinematics import Geometry, reading, sensitivity, spindle_in_work
from mjsim.machine.model import build
from mjsim.machine.plant import BUMP
from mjsim.nc.limits import model_limits
from mjsim.nc.read import parse_nc
from mjsim.nc.write import Options, nc_program
from mjsim.simulation.axes import AxesMotion
from mjsim.simulation.bar import reading as compiled
from mjsim.simulation.multibody import simulate
from mjsim.units import DEG, MM

BALL = np.array([0.083, -0.047, 0.155])
#: Effects whose numbers follow the sense of their axis: phase, place and depth change their sign, CW and CCW stay.
EFFECTS = (
    ("pitch_error.C", {"components": [[3.0, 0.0014, -70.0]]}),
    ("pitch_error.A", {"components": [[60.0, 0.0011, 33.0]], "direction": "CW"}),
    ("pitch_error.C", {"components": [[2.0, 0.002, 10.0]], "direction": "CCW"}),
    ("worm_wear.A", {"depth_deg": 0.002, "centre_deg": 20.0, "width_deg": 4.0, "direction": "CCW"}),
    ("backlash.A", {"width_deg": 0.002}),
    ("axis_location.EX0C", {"value_um": 7.3}),
    ("axis_location.EB0A", {"value_urad": -14.0}),
)


def other(chain, letters=None):
    """The same machine with the axes ``letters``, or all that turn, counted in the other sense."""
    placements = dict(chain.placements)
    for a in chain.axes:
        if a.rotary and (letters is None or a.letter in letters):
            one = placements.get(a.letter, Placement())
            sense = SENSES[chain.sense(a.letter) == SENSES[0]]
            placements[a.letter] = (
                one._replace(direction=tuple(-u for u in a.unit), sense=None) if a.tilted else one._replace(sense=sense)
            )
    length = chain.tool_length if chain.swivelling else None
    return chain_of(chain.configuration, tuple(sorted(placements.items())), length)


def signs(chain, turned):
    return np.array([1.0 if a.unit == b.unit else -1.0 for a, b in zip(chain.axes, turned.axes, strict=True)])


def mirrored(test, chain):
    """A test of the other description: the same motion of the machine."""
    if "axis" in [k.attribute for k in kind_of(test).keys]:
        more = {k: -v for k, v in test.more.items()}
        return replace(test, start=-test.start, stop=-test.stop, chain=chain, more=more)
    return replace(test, chain=chain)


def effects_of(chain):
    """:data:`EFFECTS` as they are described on ``chain``."""
    out = []
    for name, values in EFFECTS:
        v, turned = dict(values), chain.axis(name[-1]).ccw < 0.0
        if turned and "components" in v:
            v["components"] = [[n, a, -phase] for n, a, phase in v["components"]]
        if turned and "depth_deg" in v:
            v |= {"depth_deg": -v["depth_deg"], "centre_deg": -v["centre_deg"]}
        out.append(registry.make(name, chain, **v))
    return out


@pytest.fixture(scope="module")
def both():
    """The machine of an example, with errors that act on its rotary axes, in both senses."""
    m = read_machine(examples() / "healthy" / "machine.toml")
    iso = replace(m, placements=other(m.chain).placements)
    return m.with_effects(effects_of(m.chain)), iso.with_effects(effects_of(iso.chain))


# -- what a machine file says ------------------------------------------------------------------------------------------


def chain_said(tmp_path, text, configuration="w-C'bXYZB-t", head="tool_length_mm = 250.0\n"):
    return chain_of_file(
        tmp_path / "machine.toml", tomlkit.parse(f'configuration = "{configuration}"\n{head}{text}').unwrap()
    )


def test_iso_is_the_motion_of_the_tool_against_the_workpiece(tmp_path):
    """ISO 841: a table turns clockwise for +, a head counter-clockwise. Without a sense, both do as before."""
    chain = chain_said(tmp_path, "")
    assert (chain.sense("B"), chain.sense("C"), chain.placements) == ("iso", "opposite", ())
    chain = chain_said(tmp_path, '[axis.B]\nsense = "iso"\n[axis.C]\nsense = "iso"')
    assert (chain.axis("B").unit, chain.axis("C").unit) == ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
    assert (chain.sense("B"), chain.sense("C"), chain.senses) == ("iso", "iso", "B iso, C iso")
    chain = chain_said(tmp_path, '[axis.B]\nsense = "opposite"\n[axis.C]\nsense = "opposite"')
    assert (chain.axis("B").unit, chain.axis("C").unit) == ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0))
    assert chain == other(chain_said(tmp_path, '[axis.B]\nsense = "iso"\n[axis.C]\nsense = "iso"'))


def test_direction_and_sense_agree_or_are_refused(tmp_path):
    same = chain_said(tmp_path, "[axis.C]\ndirection = [0.0, 0.0, -2.0]")
    assert same == chain_said(tmp_path, '[axis.C]\nsense = "iso"')
    assert same == chain_said(tmp_path, '[axis.C]\nsense = "iso"\ndirection = [0.0, 0.0, -1.0]')
    with pytest.raises(InputError) as said:
        chain_said(tmp_path, '[axis.C]\nsense = "iso"\ndirection = [0.0, 0.0, 1.0]')
    assert "machine.toml: axis C: direction = [0.0, 0.0, 1.0] means that it turns what it carries counter-clockwise, " \
        "seen against Z, and sense = 'iso' of an axis of the table means clockwise; allowed: direction = " \
        "[0.0, 0.0, -1.0], sense = 'opposite', or one of the two keys alone" in str(said.value)  # fmt: skip
    nutating = '[axis.B]\nsense = "iso"\ndirection = [0.0, 1.0, 1.0]'
    assert chain_said(tmp_path, nutating).axis("B").tilted
    with pytest.raises(InputError, match=r"axis B: .* allowed: direction = \[0.0, -1.0, -1.0\], sense = 'opposite'"):
        chain_said(tmp_path, nutating, "w-C'B'Y'bXZ-t", "")
    with pytest.raises(InputError, match="sense = 'ISO'; allowed: 'iso' or 'opposite'"):
        chain_said(tmp_path, '[axis.C]\nsense = "ISO"')


@pytest.mark.parametrize("configuration", ["w-C'A'Y'bXZ-t", "w-C'bXYZB-t", "w-X'Y'bZ-t"])
def test_every_new_machine_states_the_sense(tmp_path, configuration):
    """And counts as ISO 841 says, unless told otherwise."""
    new_machine(tmp_path / "m", configuration)
    file = tmp_path / "m" / "machine.toml"
    chain = read_machine(file).chain
    assert file.read_text().count('sense = "iso"') == len(chain.rotary)
    assert {chain.sense(a) for a in chain.rotary} <= {"iso"}
    again = machine_document(read_machine(file).with_drive("X", position_gain=40.0), file)
    assert again.count('sense = "iso"') == len(chain.rotary)
    spec = mujoco.MjSpec.from_file(str(tmp_path / "m" / "machine.xml"))
    for a in chain.axes:
        if a.rotary:
            np.testing.assert_allclose(spec.joint(a.letter).axis, a.unit, atol=1e-12)


def test_new_campaigns_state_the_sense_too(tmp_path):
    mjsim.new_campaign(tmp_path / "bar")
    chain = read_machine(tmp_path / "bar" / "machine.toml").chain
    assert chain.senses == "A iso, C iso"
    c = read_campaign(tmp_path / "bar")
    assert [t.direction for t in c.tests if t.kind == "rotary"] == ["CCW"]  # as its name says
    new_log_campaign(tmp_path / "log", "C")
    assert read_machine(tmp_path / "log" / "machine.toml").chain.senses == "C iso"


def test_the_command_writes_the_sense_that_is_asked_for(tmp_path):
    new = ["machine", "new", "--configuration", "w-C'A'Y'bXZ-t", "--sense", "C", "opposite"]
    data = as_json(*new, "-o", str(tmp_path / "m"))
    assert data["sense"] == {"A": "iso", "C": "opposite"}
    assert read_machine(tmp_path / "m" / "machine.toml").chain.senses == "A iso, C opposite"
    wrong = run(*new[:-1], "clockwise", "-o", str(tmp_path / "x"))
    assert wrong.exit_code == 1 and "--sense C clockwise; allowed: iso or opposite" in wrong.stderr


# -- one machine, two descriptions -------------------------------------------------------------------------------------


@pytest.mark.parametrize("machine", MACHINES, ids=lambda m: m[0])
def test_every_chain_reads_the_same_in_both_senses(machine):
    chain = chain_of(*machine)
    turned = other(chain)
    again = chain_of(turned.configuration, turned.placements, machine[2])
    written = eval(_chain_text(turned), {"chain_of": chain_of, "Placement": Placement})
    for one, two in ((turned.counter_clockwise, chain), (other(turned), chain), (again, turned), (written, turned)):
        np.testing.assert_allclose([a.unit for a in one.axes], [a.unit for a in two.axes], rtol=0, atol=1e-15)
        assert [a.point for a in one.axes] == [a.point for a in two.axes]
    sign, rng = signs(chain, turned), np.random.default_rng(1)
    assert (sign == [-1.0 if a.rotary else 1.0 for a in chain.axes]).all()
    q = np.hstack([rng.uniform(-0.3, 0.3, (50, 3)), rng.uniform(-2.0, 2.0, (50, len(chain.rotary)))])
    for read in (reading, compiled):
        extra = () if read is reading else (Geometry(),)
        want, got = read(chain, q, BALL, 0.1, *extra), read(turned, sign * q, BALL, 0.1, *extra)
        np.testing.assert_allclose(got, want, rtol=0, atol=1e-15)
    a, b = sensitivity(chain, q, BALL), sensitivity(turned, sign * q, BALL)
    np.testing.assert_allclose(b.axes, sign * a.axes, rtol=0, atol=1e-14)
    low, high = usual_travel(chain).T
    np.testing.assert_array_equal(usual_travel(turned), np.sort(np.stack([sign * low, sign * high], 1), axis=1))
    for name in (
        able_kinds(chain) if not chain.carried else ()
    ):  # the tests that a plan proposes move the machine in the same way
        for one, two in zip(
            KINDS[name].proposals(chain, 0.1, 0.155), KINDS[name].proposals(turned, 0.1, 0.155), strict=True
        ):
            assert KINDS[name].short_name(one) == KINDS[name].short_name(two) or name == "simultaneous"
            phi = np.linspace(*Program(one).ends, 40)
            path = Program(two).path(phi if two.start == one.start and two.stop == one.stop else -phi)
            np.testing.assert_allclose(path, sign * Program(one).path(phi), rtol=0, atol=1e-12)


def test_one_axis_alone_may_count_the_other_way(tmp_path):
    """A table on its cradle, of which only the table counts clockwise: the tilt keeps its way."""
    for letters in ("A", "C"):
        turned = other(FIVE_AXIS, letters)
        test = next(t for t in KINDS["cone_frustum"].proposals(FIVE_AXIS, 0.1, 0.155))
        phi = np.linspace(*Program(test).ends, 200)
        path = Program(mirrored(test, turned)).path(phi)
        np.testing.assert_array_equal(path, signs(FIVE_AXIS, turned) * Program(test).path(phi))


def test_the_models_turn_the_other_way():
    """The joints of the model that ships, and their ranges."""
    turned = other(FIVE_AXIS)
    for make in (model_spec, scene_of):
        plain, iso = make(FIVE_AXIS), make(turned)
        for a in FIVE_AXIS.rotary:
            np.testing.assert_array_equal(iso.joint(a).axis, -plain.joint(a).axis)
            np.testing.assert_array_equal(iso.joint(a).range, -plain.joint(a).range[::-1])
            iso.compile()
    plain, iso, i = model_limits(FIVE_AXIS), model_limits(turned), FIVE_AXIS.index("A")
    assert (iso.low[i], iso.high[i]) == (-plain.high[i], -plain.low[i])


def test_the_machine_moves_and_reads_the_same(both):
    """In MuJoCo and on the drives alone, with errors that depend on position, on CW and CCW."""
    plain, iso = both
    sign = signs(plain.chain, iso.chain)
    tests = [t for t in read_campaign(examples() / "healthy", traces=False).tests if t.name in
             ("cone45-x50-ccw", "rotary-a-tangential-cw")]  # fmt: skip
    tests = [replace(t, revolutions=1, feed=4000 * MM / 60) for t in tests]
    for test in tests:
        twin = mirrored(test, iso.chain)
        one, two = simulate(plain, [test], 1)[0], simulate(iso, [twin], 1)[0]
        np.testing.assert_allclose(two.deviation, one.deviation, rtol=0, atol=1e-12)
        np.testing.assert_allclose(two.position, sign * one.position, rtol=0, atol=1e-12)
        assert np.ptp(one.deviation) > 5e-6
        a, b = AxesMotion(test).load(build(plain)), AxesMotion(twin).load(build(iso))
        np.testing.assert_allclose(b, sign * a, rtol=0, atol=1e-13)


def test_ccw_is_how_the_table_turns():
    """Names and directions of tests, in both senses."""
    for chain, stop in ((FIVE_AXIS, 90 * DEG), (other(FIVE_AXIS), -90 * DEG)):
        kind = KINDS["rotary"]
        test = BallBarTest("", "rotary", (0.1, 0.0, 0.155), 0.1, 0.02, sensitive="tangential", axis="C", stop=stop,
                           chain=chain)  # fmt: skip
        assert kind.completed(test).direction == "CCW" and "-ccw-" in kind.short_name(test)
        assert kind.turned(test).direction == "CW" and "-cw-" in kind.short_name(kind.turned(test))


def test_a_stated_direction_of_the_table_keeps_the_tilt(tmp_path):
    """An example with C described by direction = [0, 0, -1]: nothing is left but the noise."""
    folder = tmp_path / "c"
    shutil.copytree(examples() / "healthy", folder, ignore=shutil.ignore_patterns("heldout"))
    said = (folder / "machine.toml").read_text()
    (folder / "machine.toml").write_text(said.replace("[drive.X]", "[axis.C]\ndirection = [0, 0, -1]\n\n[drive.X]", 1))
    doc = tomlkit.parse((folder / "campaign.toml").read_text())
    keep = [t for t in doc["test"] if t["name"] in ("cone15-centre-cw", "rotary-c-tangential-ccw")]
    for t in keep:
        if t["kind"] == "rotary":
            t["from_deg"], t["to_deg"] = -t["from_deg"], -t["to_deg"]
    doc["test"] = keep
    (folder / "campaign.toml").write_text(tomlkit.dumps(doc))
    c = read_campaign(folder)
    q = Program(c.tests[0]).path(np.linspace(0, 2 * np.pi, 50))[:, FIVE_AXIS.index("A")]
    assert q.min() == pytest.approx(5 * DEG, abs=0.1 * DEG) and q.max() == pytest.approx(25 * DEG, abs=0.1 * DEG)
    result = mjsim.compare(c, read_machine(folder / "machine.toml"))
    assert result.rms < 1.3 * result.noise


# -- programs ----------------------------------------------------------------------------------------------------------


def words(text, letter):
    lines = [line for line in text.splitlines() if line.startswith(("N", "G0"))]
    return [m for line in lines for m in re.findall(rf"{letter}(-?[\d.]+)", line)]


@pytest.mark.parametrize("dialect", ["fanuc", "siemens", "linuxcnc"])
def test_programs_differ_by_the_sign_of_what_turns(dialect):
    test = next(t for t in read_campaign(examples() / "healthy", traces=False).tests if t.name == "cone15-x50-ccw")
    turned = other(FIVE_AXIS)
    how = Options(dialect, "tcp", step_deg=2.0)
    for o in (how, replace(how, feed="")):
        plain, iso = nc_program(test, o), nc_program(mirrored(test, turned), o)
        for letter in "XYZF":
            assert words(iso.text, letter) == words(plain.text, letter)
        for letter in "AC":
            there, here = words(iso.text, letter), words(plain.text, letter)
            assert [float(v) for v in there] == [-float(v) for v in here] and any(float(v) for v in here)
        assert "A opposite, C opposite" in plain.text.replace("OPPOSITE", "opposite")
        back = parse_nc(iso.text, "t.nc", dialect, chain=turned).motion
        np.testing.assert_allclose(back.points, iso.motion.points, rtol=0, atol=1e-12)
        np.testing.assert_allclose(
            spindle_in_work(turned, back.axes), spindle_in_work(FIVE_AXIS, plain.motion.axes), rtol=0, atol=1e-9
        )
        # a program that counts against the machine file is the one of the other sense
        lines = nc_program(test, replace(o, reversed=("A", "C"))).text.splitlines()
        assert [x for x in lines if x.startswith("N")] == [x for x in iso.text.splitlines() if x.startswith("N")]
        again = parse_nc(iso.text, "t.nc", dialect, ("A", "C"), chain=FIVE_AXIS).motion
        np.testing.assert_allclose(again.points, plain.motion.points, rtol=0, atol=1e-12)


def test_tilted_planes_and_tool_vectors_turn_the_table_the_same_way():
    """The reader finds the rotary positions itself: those of the sense, and the same places on the workpiece."""
    body = "G90 G17 G21 G54\nG0 X0 Y0 Z200. A0 C0\nG68.2 X0 Y0 Z0 I30. J20. K0\nG53.1\nG0 X10. Y0 Z50.\n"
    body += "G1 X40. F500\nG1 Y30.\nG69\nM30\n"
    iso = other(FIVE_AXIS)
    a, b = (parse_nc(f"%\nO1\n{body}%\n", "t.nc", "fanuc", chain=chain).motion for chain in (FIVE_AXIS, iso))
    np.testing.assert_allclose(b.axes, signs(FIVE_AXIS, iso) * a.axes, rtol=0, atol=1e-12)
    assert np.abs(a.axes[:, FIVE_AXIS.rotary_columns]).max() > 10 * DEG


# -- logs --------------------------------------------------------------------------------------------------------------


def test_logs_are_read_in_the_sense_of_the_control(tmp_path):
    """What the control recorded stands in the campaign as it was recorded, whatever the sense."""
    time = 0.004 * np.arange(500)
    told = 30.0 * np.sin(2 * np.pi * time)
    file = tmp_path / "log.csv"
    rows = [f"{t:.4f},{x:.6f},{x - 0.01:.6f}" for t, x in zip(time, told, strict=True)]
    file.write_text("\n".join(["t [s],C soll [deg],C ist [deg]", *rows]) + "\n")
    for sense in SENSES:
        folder = tmp_path / sense
        new_log_campaign(folder, "C")
        text = (folder / "machine.toml").read_text()
        (folder / "machine.toml").write_text(text.replace('sense = "iso"', f'sense = "{sense}"'))
        import_log(folder, file)
        c = read_campaign(folder)
        got = c.traces["log"].axes["C"]
        np.testing.assert_allclose(got.command / DEG, told, rtol=0, atol=1e-5)
        assert c.tests[0].chain.sense("C") == sense


def test_a_worn_flank_carries_in_the_same_turn_of_the_table(both):
    """CCW is where the position grows in one description and falls in the other."""
    for machine, way in zip(both, (1.0, -1.0), strict=True):
        of_a = [o.parameters[3] for o in build(machine).ops if o.source == machine.chain.index("A") and o.code == BUMP]
        assert of_a == [way]


# -- tables of controls ------------------------------------------------------------------------------------------------


RANGES = {"X": (-0.11, 0.13), "Y": (-0.12, 0.1), "Z": (0.05, 0.26), "A": (-5 * DEG, 40 * DEG), "C": (-0.2, 2.1 * np.pi)}


@pytest.mark.parametrize("name", list(CONTROLS))
def test_tables_are_mirrored_and_lengths_are_not(both, name):
    made = []
    for machine in both:
        found = [e for e in machine.effects if e.kind != "friction"]
        wanted, left = wanted_of(machine, found)
        assert not left
        ranges = {a: machine.chain.axis(a).ends(*ends) for a, ends in RANGES.items()}
        made.append(control(name).corrections(wanted, ranges))
    plain, iso = made
    assert plain.backlash == iso.backlash and plain.kinematics == iso.kinematics
    assert {(t.out, t.source) for t in plain.tables} == {(t.out, t.source) for t in iso.tables} != set()
    digit = 2e-4 * DEG
    for t in plain.tables:
        twin = iso.table(t.out, t.source)
        # what acts while the position grows in one description acts while it falls in the other
        at = np.linspace(max(t.positions[0], -twin.positions[-1]), min(t.positions[-1], -twin.positions[0]), 50)
        sides = ((t.forward, twin.reverse), (t.reverse, twin.forward))
        rest = [np.interp(-at, twin.positions, yours) + np.interp(at, t.positions, mine) for mine, yours in sides]
        zero = rest[0][0] if name == "fanuc" else 0.0  # which counts from the reference point, on one flank
        np.testing.assert_allclose(rest, zero, rtol=0, atol=digit)
    files = [control(name).files(c) for c in made]
    assert set(files[0]) == set(files[1])


def test_kinematic_data_have_the_directions_of_the_sense(both):
    """SINUMERIK's vectors point where + turns counter-clockwise; LinuxCNC has a switch for it."""
    vectors, pins = [], []
    for machine in both:
        location = [e for e in machine.effects if e.kind == "axis_location"]
        wanted, _ = wanted_of(machine, location)
        text = control("sinumerik").files(control("sinumerik").corrections(wanted, RANGES))["machine_data.txt"]
        vectors.append([float(v) for v in re.findall(r"MD24570.*: set (\S+)", text)])
        linuxcnc = control("linuxcnc")
        pins.append(linuxcnc.files(linuxcnc.corrections(wanted, RANGES))["kinematics.hal"].splitlines())
    np.testing.assert_allclose(vectors[1], -np.array(vectors[0]), rtol=0, atol=1e-12)
    assert len(vectors[0]) == 3 and abs(vectors[0][0]) == pytest.approx(1.0)
    assert pins[1] == [*pins[0], "setp xyzac-trt-kins.conventional-directions 1"]


# -- LinuxCNC ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def modules(tmp_path, monkeypatch):
    """A folder with kinematics of LinuxCNC 2.10 by name alone, whose files say which pins they have."""
    folder = tmp_path / "modules"
    folder.mkdir()
    (folder / "xyzac-trt-kins.so").write_bytes(b"\0%s.conventional-directions\0")
    monkeypatch.setattr(configuration, "_MODULES", folder)
    return folder


def test_linuxcnc_is_told_the_sense(modules, tmp_path):
    iso, mixed = other(FIVE_AXIS), other(FIVE_AXIS, "A")
    for chain, tip, said in ((FIVE_AXIS, True, 0), (iso, True, 1), (iso, False, 0), (mixed, False, 0)):
        write_configuration(tmp_path, chain, Settings(), tip)
        hal = (tmp_path / "machine.hal").read_text()
        assert hal.count("setp xyzac-trt-kins.conventional-directions 1") == said
    ini = (tmp_path / "machine.ini").read_text()
    low, high = model_limits(FIVE_AXIS).low[3] / DEG, model_limits(FIVE_AXIS).high[3] / DEG
    assert f"MIN_LIMIT = {-high:.4f}\nMAX_LIMIT = {-low:.4f}" in ini.partition("[AXIS_A]")[2]
    with pytest.raises(InputError, match="both axes of a table in one sense; found: A iso, C opposite"):
        kinematics(mixed, True)
    (modules / "xyzac-trt-kins.so").write_bytes(b"\0%s.x-offset\0")
    assert kinematics(FIVE_AXIS, True)
    with pytest.raises(InputError, match=r"has no pin conventional-directions.*allowed: LinuxCNC 2.10 or later"):
        kinematics(iso, True)


# -- a wrong sense in the machine file ---------------------------------------------------------------------------------


def test_a_program_of_the_other_sense_names_the_axis(tmp_path):
    """Its positions belong to the test in one sense only."""
    chain = read_machine(examples() / "hidden-backlash" / "machine.toml").chain
    test = next(t for t in read_campaign(examples() / "hidden-backlash").tests if t.name == "cone15-x50-ccw")
    text = nc_program(test, Options("linuxcnc", step_deg=1.0)).text
    nc = parse_nc(text, tmp_path / "cone.ngc", "linuxcnc", chain=chain)
    turned = replace(test, chain=other(chain, "C"))
    again = parse_nc(text, tmp_path / "cone.ngc", "linuxcnc", chain=turned.chain)
    assert driven_by(test, nc.motion, "cone.ngc").commanded is nc.motion
    with pytest.raises(InputError, match=r'C counted the other way, .*: sense = "opposite" of \[axis.C\] in the'):
        driven_by(turned, again.motion, "cone.ngc")
