"""Temperature sensors: their record, what the machine makes of them, and that a diagnosis gives a drift to the sensor
that it follows.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from commands import printed, run
from independent import warming

import mjsim
from mjsim.campaign.machine_file import machine_of
from mjsim.campaign.temperature import read_temperatures, remarks_on
from mjsim.commands.any_instrument import compare_plainly
from mjsim.commands.diagnosis import Diagnosis
from mjsim.errors import InputError
from mjsim.machine.model import build
from mjsim.machine.temperatures import Temperatures
from mjsim.simulation.transmission import transmit

PLANTED = {("X", "spindle"): 3.0, ("Z", "bed"): -8.0}


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    """A machine that was probed while it warmed up."""
    folder = tmp_path_factory.mktemp("warm")
    warming.write_sphere(folder, 1, PLANTED)
    return folder


def found_in(folder) -> tuple[Diagnosis, dict]:
    """The diagnosis of a campaign, and its findings by key."""
    campaign = mjsim.read_campaign(folder)
    result = mjsim.diagnose(campaign, machine_of(campaign))
    return result, {e.effect.key: e for e in result.effects}


# -- the record --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("spindle,bed\n20,20\n21,20\n", "the first column is 'spindle'; allowed: time_s, then one column a sensor"),
        ("time_s\n0\n1\n", "0 sensors behind time_s; allowed: 1 to 20"),
        ("time_s,a,a_degC\n0,20,20\n1,20,20\n", "the sensor a has 2 columns; allowed: one"),
        ("time_s,a[b]\n0,20\n1,20\n", "allowed: the name of a sensor"),
        ("time_s,a\n0,20\n1,warm\n", "line 3: a = 'warm'; allowed: a number"),
        ("time_s,a\n0,20\n1,293.15\n", "line 3: a = 293.15; allowed: -50 to 200 °C"),
        ("time_s,a\n0,20\n0,21\n", "line 3: time_s = 0 after 0; allowed: times that grow"),
        ("time_s,a\n0,20\n", "1 rows of numbers; allowed: two or more"),
    ],
)
def test_a_wrong_record_is_refused(tmp_path, text, message):
    (tmp_path / "temperature.csv").write_text(text)
    with pytest.raises(InputError) as error:
        read_temperatures(tmp_path)
    assert message in str(error.value) and "temperature.csv" in str(error.value)


def logger(folder, text):
    """A campaign's folder with the file of a logger."""
    (folder / "campaign.toml").write_text('name = "warm"\n')
    (folder / "log.csv").write_text(text, encoding="utf-8")
    return ("import", folder / "log.csv", "--campaign", folder, "--temperatures")


def test_a_logger_with_dates_is_imported(tmp_path):
    """German words, decimal commas, times without seconds, an empty cell, and one minute twice."""
    rows = ["1;01.03.2026 23:59;21,4;20,9", "2;02.03.2026 00:00;21,5;20,9", "3;02.03.2026 00:00;22,5;20,9"]
    rows += ["4;02.03.2026 00:01;;20,9", "5;02.03.2026 00:02;23,5;21,0"]
    order = logger(tmp_path, "\n".join(["Logger 7", "Nr.;Datum;Spindel vorn [°C];Bett [°C]", *rows, ""]))
    start = ("--start", "02.03.2026 00:00")
    preview = json.loads(printed(*order, *start, "--preview", "--json"))["temperatures"]
    assert preview["samples"] == 3 and not (tmp_path / "temperature.csv").exists()
    printed(*order, *start)
    t = read_temperatures(tmp_path)
    assert t.names == ("Spindel-vorn", "Bett") and t.time.tolist() == [-60.0, 0.0, 120.0]
    assert t.value.tolist() == [[21.4, 20.9], [22.0, 20.9], [23.5, 21.0]]
    assert "exists already" in printed(*order, code=1)
    printed(*order, "--force")  # without a start: from the first sample
    assert read_temperatures(tmp_path).time.tolist() == [0.0, 60.0, 180.0]


def test_other_units_and_clocks_of_a_logger(tmp_path):
    order = logger(tmp_path, "time,T1_degF,T2 (K)\n23:59:30,68,293.15\n23:59:50,77,294.15\n00:00:10,86,295.15\n")
    printed(*order, "--start", "23:59:00")
    t = read_temperatures(tmp_path)
    assert t.names == ("T1", "T2") and t.time.tolist() == [30.0, 50.0, 70.0]  # over midnight
    assert np.allclose(t.value, [[20.0, 20.0], [25.0, 21.0], [30.0, 22.0]])


@pytest.mark.parametrize(
    ("text", "more", "message"),
    [
        ("a;b\n1;2\n2;2\n3;2\n", (), "no column of times"),
        ("time;a\n08:00:00;2\n08:01:00;2\n08:00:30;2\n", (), "line 4: time_s = 30 after 60; allowed: times that grow"),
        ("time;a\n08:00:00;2\n08:01:00;2\n08:02:00;2\n", ("--start", "2026-03-02 08:00"), "a time of day, as of"),
        ("time;a\n0;2\n60;2\n120;2\n", ("--start", "08:00:00"), "no times of day, so --start has no meaning"),
        ("time;a [mV]\n0;2\n60;2\n120;2\n", (), "in mv; allowed: °C, °F or K"),
        ("time;a\n0;2\n60;950\n120;2\n", (), "line 3: a = 950; allowed: -50 to 200 °C"),
    ],
)
def test_a_wrong_file_of_a_logger_is_refused(tmp_path, text, more, message):
    order = logger(tmp_path, text)
    assert message in " ".join(printed(*order, *more, code=1).split())
    assert not (tmp_path / "temperature.csv").exists()


def test_a_record_is_averaged_and_stays_beyond_its_ends():
    time = np.arange(0.0, 600.0, 5.0)
    noise = np.tile([0.1, -0.1], 60)
    t = Temperatures(time, ("a",), (20.0 + time / 100.0 + noise)[:, None])
    inside = np.array([100.0, 333.0, 500.0])
    middle = t.rise_at("a", np.array([0.0]))[0]
    assert middle == pytest.approx(0.0, abs=1e-12)
    assert np.allclose(np.diff(t.rise_at("a", inside)), np.diff(inside) / 100.0)
    first, last = t.rise_at("a", np.array([-1e4, 1e5]))
    assert (first, last) == (t.rise_at("a", time[:1])[0], t.rise_at("a", time[-1:])[0])


def test_an_axis_follows_the_sum_of_its_sensors(warm):
    """The compiled look-up is numpy's interpolation, at any time and in any order of the effects."""
    campaign = mjsim.read_campaign(warm)
    machine, t = machine_of(campaign), campaign.temperatures
    sizes = {"spindle": 3.0, "room": -2.0}
    for sensor, size in sizes.items():
        machine = machine.with_effect(
            mjsim.make_effect("thermal_expansion.Y", machine.chain, expansion_um_per_K=size, sensor=sensor)
        )
    clock = np.linspace(t.time[0] - 500.0, t.time[-1] + 500.0, 999)
    machine = replace(machine, effects=machine.effects[-2:])
    moved = transmit(build(machine).op_table(), np.zeros((len(clock), 5)), clock)
    want = sum(size * 1e-6 * t.rise_at(sensor, clock) for sensor, size in sizes.items())
    assert np.abs(want).max() > 5e-6 and np.allclose(moved[:, 1], want, atol=1e-15)
    assert not moved[:, [0, 2, 3, 4]].any()


def test_a_machine_needs_the_sensors_that_it_follows(warm, tmp_path):
    campaign = mjsim.read_campaign(warm)
    text = (warm / "machine.toml").read_text()
    more = '\n[[effect]]\nid = "thermal_expansion.X"\nsensor = "nose"\nexpansion_um_per_K = 2.0\n'
    (tmp_path / "machine.toml").write_text(text + more)
    with pytest.raises(InputError, match=r"has the sensors spindle, bed, room, but the machine has .*nose"):
        machine_of(campaign, tmp_path / "machine.toml")
    without = replace(campaign, temperatures=None)
    with pytest.raises(InputError, match=r"temperature\.csv: is missing"):
        mjsim.compare(without, mjsim.read_machine(tmp_path / "machine.toml"))
    planned = replace(campaign, traces={})
    assert machine_of(planned, tmp_path / "machine.toml").sensors == ("spindle", "bed", "room")
    (tmp_path / "tolerance.toml").write_text(text + "\n[tolerance.thermal_expansion]\num_per_K = 10.0\n")
    with pytest.raises(InputError, match="has no single size"):
        mjsim.read_machine(tmp_path / "tolerance.toml")


# -- check -------------------------------------------------------------------------------------------------------------


def test_check_looks_at_the_record(warm):
    campaign = mjsim.read_campaign(warm)
    t = campaign.temperatures
    assert remarks_on(campaign) == [] == json.loads(run("check", warm, "--json").output)["temperature"]

    def said(**changes) -> str:
        (sentence,) = remarks_on(replace(campaign, temperatures=replace(t, **changes)))
        return sentence

    gap = (t.time < 1000.0) | (t.time > 2200.0)
    assert "20 min without a sample" in said(time=t.time[gap], value=t.value[gap])
    copied = np.column_stack([t.value[:, 0], t.value[:, 1], t.value[:, 1] + 0.3])
    assert "the sensors bed and room show the same" in said(value=copied)
    still = np.column_stack([t.value[:, 0], t.value[:, 1], np.full(len(t.time), 21.0)])
    assert "the sensor room changes by less than 0.1 K" in said(value=still)
    assert "points lies outside; the nearest temperature" in said(time=t.time + 4000.0)
    test = campaign.tests[0]
    both = replace(
        campaign,
        tests=(test, replace(test, name="again")),
        traces={name: campaign.traces[test.name] for name in (test.name, "again")},
    )
    assert "all tests start at 0 s; state started_s" in remarks_on(both)[0]


# -- compare and diagnose ----------------------------------------------------------------------------------------------


def test_the_generator_and_the_model_mean_the_same(tmp_path):
    """What the generator plants, as an effect of mjsim, explains its readings: a laser and a probe see both signs."""
    warming.write_positions(tmp_path / "laser", 3, {("X", "spindle"): 4.0}, {}, noise=1e-12)
    errors = {k: {} for k in ("location", "square", "straight", "scale", "play", "waves", "motion")}
    warming.write_sphere(tmp_path / "probe", 3, {("X", "spindle"): 4.0}, errors=errors, noise=1e-12)
    for name in ("laser", "probe"):
        campaign = mjsim.read_campaign(tmp_path / name, as_is=True)
        machine = machine_of(campaign)
        effect = mjsim.make_effect("thermal_expansion.X", machine.chain, expansion_um_per_K=4.0, sensor="spindle")
        before, after = (compare_plainly(campaign, m).rms for m in (machine, machine.with_effect(effect)))
        assert before > 2e-6 and after < 0.15e-6, (name, before, after)  # 0.02 K of noise in the record


def test_a_probe_finds_what_follows_which_sensor(warm):
    result, found = found_in(warm)
    for (axis, sensor), size in PLANTED.items():
        e = found[f"thermal_expansion.{axis}[{sensor}]"]
        low, high = e.ci95["expansion_um_per_K"]
        assert low <= size <= high and high - low < 2.0 and e.probability > 0.95
    assert {k for k in found if k.startswith("thermal")} == {f"thermal_expansion.{a}[{s}]" for a, s in PLANTED}
    assert "temperature" in result.budget[0].rows


def test_a_ball_bar_finds_what_follows_which_sensor(tmp_path):
    warming.write_bar(tmp_path, 2, {("X", "spindle"): 3.0}, layout="sparse-circles", gap=600.0)
    result, found = found_in(tmp_path)
    (e,) = found.values()
    low, high = e.ci95["expansion_um_per_K"]
    assert e.effect.key == "thermal_expansion.X[spindle]" and low <= 3.0 <= high and e.probability > 0.95
    (b,) = (b for b in result.budget if b.effect_id == e.effect.key)
    assert b.largest == "temperature"  # two tests show X: 0.02 K of noise and half a minute between samples count


def test_a_drift_that_follows_no_sensor_is_given_to_none(tmp_path):
    """One settles with the clock, one goes up and down by itself."""
    drifts = {"settles": lambda t: 15.0 * (1.0 - np.exp(-t / 1500.0)), "odd": lambda t: 6.0 * np.sin(t / 430.0)}
    for seed, (name, drift) in enumerate(drifts.items(), start=6):
        warming.write_sphere(tmp_path / name, seed, {}, drift={"Z": drift})
        _, found = found_in(tmp_path / name)
        assert not [k for k, e in found.items() if k.startswith("thermal_expansion") and e.probability > 0.95], name
        assert name == "odd" or found["thermal_drift.Z"].probability > 0.5


def test_copies_of_a_sensor_are_alternatives(warm, tmp_path):
    for file in warm.rglob("*"):
        if file.is_file():
            (tmp_path / file.relative_to(warm)).parent.mkdir(exist_ok=True)
            (tmp_path / file.relative_to(warm)).write_bytes(file.read_bytes())
    rows = [row.split(",") for row in (tmp_path / "temperature.csv").read_text().split()]
    copied = [",".join([*row, "copy" if i == 0 else row[1]]) for i, row in enumerate(rows)]
    (tmp_path / "temperature.csv").write_text("\n".join(copied))
    result, found = found_in(tmp_path)
    e = next(e for k, e in found.items() if k.startswith("thermal_expansion.X"))
    pair = {"thermal_expansion.X[spindle]", "thermal_expansion.X[copy]"}
    assert {e.effect.key, *e.alternatives} == pair and result.verdict == "ambiguous"
    assert 0.4 < e.probability < 0.6


def test_the_report_shows_the_temperatures(warm):
    campaign = mjsim.read_campaign(warm)
    made = mjsim.make_report(campaign, machine_of(campaign), diagnosed=False)
    assert 'id="temperature"' in made.html and made.data["temperature"] == []
