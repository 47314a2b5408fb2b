"""Mistakes of the user's are recognised from the data and put right, and a faulty machine is not taken for one.

The traces are those of the example campaigns, which another simulation than mjsim's has made.
"""

import itertools
import shutil
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from commands import as_json, cut, ok, refused
from independent import bank
from independent import campaign as generator

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.tolerance import TYPICAL_TOLERANCE
from mjsim.commands.calibrate import calibrate
from mjsim.commands.check import check
from mjsim.commands.geometry import geometry
from mjsim.errors import InputError
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.mistakes.mistakes import UNITS, corrected, unit_of
from mjsim.inference.mistakes.recognise import recognise
from mjsim.inference.mistakes.sense import with_other_sense
from mjsim.inference.pitch.identify import identify_pitch_errors
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import Trace
from mjsim.instruments.ball_bar.program import Program
from mjsim.instruments.ball_bar.span import explain
from mjsim.io.resources import examples

#: What is wrong with the machine of each example is in its README; none of it is a mistake of the user's.
FAULTY = ("hidden-backlash", "two-candidates", "pitch-error", "unlisted", "healthy", "kato2013")
ASYMMETRIC = "cone15-y50-ccw"  # its reversals lie elsewhere in the other direction


def example(name):
    campaign = read_campaign(examples() / name)
    return campaign, read_machine(campaign.machine_file)


@pytest.fixture(scope="module")
def measured():
    """Seven tests of a machine with a cause that has two explanations."""
    return example("two-candidates")


@pytest.fixture(scope="module")
def backlash():
    """Thirteen tests, of which four turn one axis and show no reversal; the hidden cause is ten times the noise."""
    return example("hidden-backlash")


def scaled(campaign, factor, names):
    traces = dict(campaign.traces)
    for name in names:
        t = traces[name]
        traces[name] = Trace(t.time, factor * t.deviation, t.valid)
    return replace(campaign, traces=traces)


def exchanged(campaign, a, b):
    return replace(campaign, traces={**campaign.traces, a: campaign.traces[b], b: campaign.traces[a]})


def names_of(campaign):
    return tuple(t.name for t in campaign.measured)


@pytest.mark.parametrize("name", FAULTY)
def test_a_faulty_machine_is_no_mistake(name):
    assert recognise(*example(name)).mistakes == ()


@pytest.mark.parametrize("change", [0.5, 2.0])
def test_friction_far_from_the_data_sheet_is_no_mistake(measured, change):
    campaign, machine = measured
    for e in machine.effects:
        if e.kind == "friction":
            machine = machine.with_effect(e.replaced(coulomb_Nm=e.values["coulomb_Nm"] * change))
    assert recognise(campaign, machine).mistakes == ()


@pytest.mark.parametrize(("sign", "unit"), [*((1.0, u) for u in UNITS), (-1.0, ""), (-1.0, "mm"), (-1.0, "mil")])
def test_unit_and_sign_of_all_traces(measured, unit, sign):
    campaign, machine = measured
    factor = sign * UNITS.get(unit, 1.0)
    wrong = scaled(campaign, 1.0 / factor, names_of(campaign))
    (m,) = recognise(wrong, machine).mistakes
    assert (m.factor, m.unit, m.every, m.tests) == (factor, unit, True, names_of(campaign))
    assert m.kind == {(1, True): "unit", (-1, True): "sign_and_unit", (-1, False): "sign"}[int(sign), bool(unit)]
    right = corrected(wrong, (m,))
    for name, trace in campaign.traces.items():
        np.testing.assert_allclose(right.traces[name].deviation, trace.deviation, rtol=1e-12)


@pytest.mark.parametrize(("factor", "name"), [(-1.0, "cone45-centre-ccw"), (1e3, ASYMMETRIC), (25.4, "circle-xy-cw")])
def test_unit_or_sign_of_one_trace(backlash, factor, name):
    campaign, machine = backlash
    (m,) = recognise(scaled(campaign, 1.0 / factor, [name]), machine).mistakes
    assert (m.tests, m.factor, m.every) == ((name,), factor, False)
    assert f'"{name}"' in m.sentence


def test_the_unit_of_a_trace_without_reversals_shows_in_its_noise(backlash):
    campaign, machine = backlash
    (m,) = recognise(scaled(campaign, 1e-3, ["rotary-c-tangential-cw"]), machine).mistakes
    assert (m.tests, m.unit) == (("rotary-c-tangential-cw",), "mm")


def test_a_test_is_not_too_quiet_beside_the_waves_of_a_worm(backlash):
    """A rotary test of C says nothing about the worm of A, whose waves of 3 µm are in all the others."""
    campaign, machine = backlash
    traces = {
        name: t
        if name == "rotary-c-tangential-cw"
        else replace(t, deviation=t.deviation + 3e-6 * np.sin(15.0 * t.time))
        for name, t in campaign.traces.items()
    }
    assert recognise(replace(campaign, traces=traces), machine).mistakes == ()


def test_direction(measured):
    campaign, machine = measured
    wrong = replace(campaign, tests=tuple(kind_of(t).turned(t) if t.name == ASYMMETRIC else t for t in campaign.tests))
    (m,) = recognise(wrong, machine).mistakes
    assert (m.kind, m.tests) == ("direction", (ASYMMETRIC,))
    assert corrected(wrong, (m,)).tests == campaign.tests


def test_direction_of_every_test(measured):
    campaign, machine = measured
    wrong = replace(campaign, tests=tuple(kind_of(t).turned(t) if kind_of(t).goes_round else t for t in campaign.tests))
    (m,) = recognise(wrong, machine).mistakes
    assert m.kind == "direction" and m.every
    assert set(m.tests) == {t.name for t in campaign.measured if t.kind != "rotary"}


def test_what_looks_the_same_is_not_named(measured):
    """Both directions of a cone about the centre have the same reversals: nothing is said, above all nothing wrong."""
    campaign, machine = measured
    assert recognise(exchanged(campaign, "cone15-centre-ccw", "cone15-centre-cw"), machine).mistakes == ()


def test_one_of_two_tests_of_a_set_up(measured):
    """Two tests share their ball offsets: turning either of them makes them agree, and mjsim does not choose."""
    campaign, machine = measured
    wrong = replace(
        campaign, tests=tuple(kind_of(t).turned(t) if t.name == "cone45-x50-ccw" else t for t in campaign.tests)
    )
    (m,) = recognise(wrong, machine).mistakes
    assert m.either and m.tests == ("cone15-x50-ccw", "cone45-x50-ccw") and " or " in m.sentence
    assert corrected(wrong, (m,)) == wrong


def test_exchanged_traces(measured):
    campaign, machine = measured
    wrong = exchanged(campaign, "cone15-centre-ccw", ASYMMETRIC)
    (m,) = recognise(wrong, machine).mistakes
    assert m.kind == "swapped" and set(m.tests) == {"cone15-centre-ccw", ASYMMETRIC}
    right = corrected(wrong, (m,))
    assert all(right.traces[n] is campaign.traces[n] for n in campaign.traces)


def test_several_mistakes_at_once(backlash):
    campaign, machine = backlash
    wrong = scaled(campaign, -1.0, ["circle-xy-cw"])
    wrong = scaled(wrong, 1e-3, ["cone45-centre-ccw"])
    found = {m.tests: (m.kind, m.factor) for m in recognise(wrong, machine).mistakes}
    assert found == {("circle-xy-cw",): ("sign", -1.0), ("cone45-centre-ccw",): ("unit", 1e3)}


def test_unit_of():
    assert unit_of(1.0) == (1.0, "") and unit_of(-1.3) == (-1.0, "") and unit_of(2.0) == (1.0, "")
    assert (
        unit_of(0.0011) == (1e3, "mm")
        and unit_of(-1 / 20) == (-25.4, "mil")
        and unit_of(40.0) == (25.4e-3, "microinch")
    )
    assert unit_of(5.0) is None and unit_of(0.2) is None and unit_of(0.0) is None


# -- clocks ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("feed", [500.0, 1500.0, 2000.0, 25400.0])
def test_feed_from_the_clock(circle, feed):
    given = circle("XY", (0, 0, 155), feed=1000.0, revolutions=2)
    found = explain(given, *Program(replace(given, feed=feed / 60e3)).measured_span)
    assert found.kind == "feed" and found.value * 60e3 == pytest.approx(feed, rel=1e-3)
    assert f"feed_mm_min = {feed:g}" in found.sentence and ("inch/min" in found.sentence) == (feed == 25400.0)


@pytest.mark.parametrize("turns", [1, 3, 5])
def test_turns_from_the_clock(circle, turns):
    given = circle("YZ", (0, 0, 155), revolutions=2)
    found = explain(given, *Program(replace(given, revolutions=turns)).measured_span)
    assert (found.kind, found.value) == ("revolutions", turns)


@pytest.mark.parametrize(("factor", "unit"), [(1e-3, "ms"), (60.0, "minutes")])
def test_unit_of_time(cone, factor, unit):
    given = cone(15, 10, (50, 0, 155))
    begin, end = Program(given).measured_span
    found = explain(given, begin / factor, end / factor)
    assert (found.kind, found.value) == ("time_unit", factor) and unit in found.sentence


def test_origin_of_the_clock(cone):
    given = cone(15, 10, (50, 0, 155))
    begin, end = Program(given).measured_span
    found = explain(given, 0.0, end - begin)
    assert found.kind == "origin" and found.value == pytest.approx(begin)


def test_a_cut_trace_is_not_taken_for_another_feed(circle):
    given = circle("XY", (0, 0, 155), feed=1000.0, revolutions=2)
    begin, end = Program(given).measured_span
    found = explain(given, begin, end - 8.0)
    assert found.kind == "unclear" and "stops 8.00 s early" in found.sentence


# -- the commands ------------------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path):
    return shutil.copytree(examples() / "two-candidates", tmp_path / "c", ignore=shutil.ignore_patterns(".mjsim"))


def spoil_trace(folder, name, change):
    """Rewrite a trace of the folder as plain text, with ``change(time, deviation in µm)``."""
    campaign = read_campaign(folder)
    test = next(t for t in campaign.tests if t.name == name)
    t = campaign.traces[name]
    rows = [f"{a:.6f},{b:.6f}" for a, b in zip(*change(t.time, 1e6 * t.deviation), strict=True)]
    (folder / test.trace).unlink()
    (folder / "traces" / f"{name}.csv").write_text("\n".join(["time_s,deviation_um", *rows, ""]))
    file = folder / "campaign.toml"
    file.write_text(file.read_text().replace(test.trace, f"traces/{name}.csv"))


def test_commands_refuse_what_is_certainly_wrong(tmp_path):
    tests = ("cone15-centre-ccw", ASYMMETRIC)
    whole, folder = (cut(tmp_path / name, tests, example="two-candidates") for name in ("whole", "spoilt"))
    spoil_trace(folder, ASYMMETRIC, lambda t, d: (t, -d))
    refused(
        folder,
        ["compare", folder],
        "campaign.toml",
        ASYMMETRIC,
        "the sign is the other way round",
        "mjsim check",
        "--as-is",
    )
    for command in (
        ["diagnose", folder],
        ["plan", folder],
        ["add", folder, "servo_gain.C"],
        ["report", folder, "-o", folder / "r.html"],
    ):
        refused(folder, command, "the sign is the other way round")
    given = as_json("compare", folder, "--as-is", "--no-plots")
    right = as_json("compare", whole, "--no-plots")
    assert given["rms_um"] > 1.2 * right["rms_um"]


def test_check_and_fix(folder, tmp_path):
    """Three mistakes in one folder: one table, one corrected copy, and the campaign is as it was."""
    spoil_trace(folder, "cone45-centre-ccw", lambda t, d: (t, d / 1e3))
    spoil_trace(folder, "cone15-centre-cw", lambda t, d: (t * 1e3, d))
    file = folder / "campaign.toml"
    text = file.read_text()
    head, name, rest = text.partition(f'name = "{ASYMMETRIC}"')
    file.write_text(head + name + rest.replace('direction = "CCW"', 'direction = "CW"', 1))
    found = as_json("check", folder)
    kinds = {tuple(m["tests"]): m["kind"] for m in found["mistakes"]}
    assert kinds == {("cone15-centre-cw",): "time_unit", ("cone45-centre-ccw",): "unit", (ASYMMETRIC,): "direction"}
    out = tmp_path / "corrected"
    said = ok("check", folder, "--fix", out).output
    assert "the readings are in mm" in said and "time_s is in ms" in said and "exchange CCW and CW" in said
    assert max(map(len, said.splitlines()[:8])) <= 80
    again = as_json("check", out)
    assert again["mistakes"] == []
    before, after = read_campaign(examples() / "two-candidates"), read_campaign(out)
    assert after.tests == tuple(replace(t, trace=u.trace) for t, u in zip(before.tests, after.tests, strict=True))
    for name, trace in before.traces.items():
        np.testing.assert_allclose(
            after.traces[name].deviation, trace.deviation, atol=0.06e-9 if name != "cone45-centre-ccw" else 1e-9
        )
        np.testing.assert_allclose(after.traces[name].time, trace.time, atol=1e-6)
    assert (out / "machine.toml").read_bytes() == (folder / "machine.toml").read_bytes()
    refused(folder, ["check", folder, "--fix", out], str(out), "exists")


def test_nothing_to_put_right(folder, tmp_path):
    said = ok("check", folder, "--fix", tmp_path / "new")
    assert "No mistake found." in said.output and "nothing was written" in said.output
    assert "tests show unit and sign." in " ".join(said.output.split())  # a circle looks the same in both directions
    assert not (tmp_path / "new").exists()


def test_a_choice_is_left_to_the_user(folder, tmp_path):
    file = folder / "campaign.toml"
    head, name, rest = file.read_text().partition('name = "cone45-x50-ccw"')
    file.write_text(head + name + rest.replace('direction = "CCW"', 'direction = "CW"', 1))
    refused(folder, ["check", folder, "--fix", tmp_path / "new"], "cone15-x50-ccw", "or", "only you can tell")
    refused(folder, ["compare", folder], "only you can tell", "--as-is")
    assert not (tmp_path / "new").exists()


def test_exchanged_traces_of_different_length_are_named_by_their_clocks(folder):
    """Each trace lasts as long as the other's program."""
    file, a, b = folder / "campaign.toml", "traces/cone15-centre-ccw.", "traces/cone45-centre-ccw."
    file.write_text(file.read_text().replace(a, "HOLD").replace(b, a).replace("HOLD", b))
    (m,) = check(folder).mistakes
    assert m.kind == "swapped" and set(m.tests) == {"cone15-centre-ccw", "cone45-centre-ccw"}
    refused(folder, ["compare", folder], "exchanged")


def test_another_feed_is_not_taken_for_exchanged_traces(folder):
    """Tests of one campaign often last alike: a round feed is the likelier mistake."""
    file = folder / "campaign.toml"
    file.write_text(file.read_text().replace("feed_mm_min = 1000.0", "feed_mm_min = 1500.0", 1))
    refused(folder, ["compare", folder], "set feed_mm_min = 1000", "unless it is the trace of test")
    (m,) = check(folder).mistakes
    assert m.kind == "feed" and m.factor * 60e3 == pytest.approx(1000.0)


@pytest.fixture(scope="module")
def real_machine(tmp_path_factory):
    """A machine of the independent generator, with small errors of every kind; one of its tests is a cone."""
    folder = tmp_path_factory.mktemp("real")
    generator.write(next(itertools.islice(bank.real(), 3, None)), folder)
    campaign = read_campaign(folder)
    return campaign, read_machine(campaign.machine_file)


def in_other_sense(campaign, machine, axis):
    """The same files with the other sense of one axis in the machine file."""
    other = with_other_sense(machine, axis)
    return replace(campaign, tests=tuple(replace(t, chain=other.chain) for t in campaign.tests)), other


def test_the_wrong_sense_of_an_axis(real_machine):
    """Tests from one position of C to another tell it; C is right as given, and no test goes from a place of A."""
    campaign, machine = real_machine
    assert recognise(campaign, machine).mistakes == ()
    assert recognise(*in_other_sense(campaign, machine, "A")).mistakes == ()
    (m,) = recognise(*in_other_sense(campaign, machine, "C")).mistakes
    assert (m.kind, m.axis, m.certain) == ("sense", "C", False)
    assert set(m.tests) == {t.name for t in campaign.measured if t.kind == "rotary"}
    assert 'sense = "opposite" in [axis.C] of the machine file' in m.sentence and "run the other way" in m.sentence


@pytest.mark.parametrize("command", [checked_problem, geometry, calibrate, partial(identify_pitch_errors, axes=("C",))])
def test_every_command_refuses_the_wrong_sense(real_machine, command):
    """What fits numbers without a search would put them into a mirrored machine."""
    campaign, machine = in_other_sense(*real_machine, "C")
    machine = replace(machine, tolerance=TYPICAL_TOLERANCE)
    with pytest.raises(InputError, match=r"C counts the other way .* which one, only you can tell"):
        command(campaign, machine)
