"""Importing: whatever separator, unit, encoding or convention, the trace that comes out is the one that went in, or
one sentence.
"""

import gzip
import json
import os
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from commands import refused, run, snapshot

import mjsim
from mjsim.campaign.files import read_campaign
from mjsim.errors import InputError
from mjsim.importing.importer import times_of
from mjsim.instruments.ball_bar.program import Program
from mjsim.io.resources import examples

UM, DEG = 1e-6, np.pi / 180
CAMPAIGN = """\
# measured in hall 3
name = "short"
[instrument]
sample_rate_Hz = 100.0   # of the bar

[[test]]
name = "ccw"
kind = "circular"
plane = "XY"
direction = "CCW"      # as the operator saw it
revolutions = 1
table_ball_mm = [0.0, 0.0, 155.0]
bar_length_mm = 100.0
feed_mm_min = 3000.0

[[test]]
name = "cw"
kind = "circular"
plane = "XY"
direction = "CW"
revolutions = 2
table_ball_mm = [0.0, 0.0, 155.0]
bar_length_mm = 100.0
feed_mm_min = 3000.0

[[test]]
name = "turn"
kind = "rotary"
axis = "C"
from_deg = 0.0
to_deg = 360.0
sensitive_direction = "tangential"
table_ball_mm = [50.0, 0.0, 155.0]
bar_length_mm = 100.0
feed_mm_min = 3000.0
# nothing more that day
"""


@pytest.fixture
def folder(tmp_path):
    """A campaign without traces."""
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "campaign.toml").write_text(CAMPAIGN)
    shutil.copy(examples() / "hidden-backlash" / "machine.toml", tmp_path / "c")
    return tmp_path / "c"


def shape(phi):
    """A reading (m) that tells every angle, direction and sign from every other, single-valued on the circle."""
    return (4.0 + 6.0 * np.cos(phi) - 3.0 * np.sin(phi) + 2.0 * np.cos(2 * phi + 0.4) + 0.7 * np.sin(5 * phi)) * UM


def recorded(folder, name, step=0.01):
    """Program, times (s), φ (rad) and reading (m) of an ideal recording of a test."""
    program = Program(next(t for t in read_campaign(folder, traces=False).tests if t.name == name))
    lo, hi = program.measured_span
    time = np.arange(lo, hi, step)
    phi = program.phi(time)
    return program, time, phi, shape(phi)


def table(*columns, sep=",", comma=False, header="", end="\n", digits=9):
    rows = [
        sep.join(f"{x:.{digits}g}".replace(".", "," if comma else ".") for x in row)
        for row in zip(*columns, strict=True)
    ]
    return end.join([*header.splitlines(), *rows, ""])


def bring(folder, data, name="ccw", **options):
    """Import a file with this content; the trace as the campaign then gives it."""
    path = folder.parent / "file.txt"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    made = mjsim.import_trace(folder, path, name, **{"check": False, **options})
    trace = read_campaign(folder).traces[name]
    assert np.array_equal(trace.time, np.round(made.trace.time, 6))
    return made, trace


# -- separators, units, encodings --------------------------------------------------------------------------------------

VARIANTS = {
    "as mjsim's own": (lambda t, d: table(t, d / UM, header="time_s,deviation_um"), {}),
    "semicolons, decimal commas, CRLF, byte order mark": (
        lambda t, d: "\ufeff" + table(t, d / UM, sep=";", comma=True, end="\r\n", header="Zeit [s];Abweichung [µm]"),
        {},
    ),
    "tabs, ms, mm": (lambda t, d: table(1e3 * t, 1e3 * d, sep="\t", header="t / ms\tdeviation / mm"), {}),
    "spaces without a header, inches": (
        lambda t, d: table(t, d / 0.0254, sep="   "),
        {"time": "1", "deviation": "2", "time_unit": "s", "deviation_unit": "inch"},
    ),
    "mil": (lambda t, d: table(t, d / 25.4e-6, header="time (s),dev (mil)"), {}),
    "microinches, UTF-16": (lambda t, d: table(t, d / 25.4e-9, header="time_s,dev_µin").encode("utf-16"), {}),
    "Windows-1252": (lambda t, d: table(t, d / UM, header="Prüfer: Müller\ntime [s],dev [µm]").encode("cp1252"), {}),
    "units on a line of their own": (
        lambda t, d: table(t, d / UM, sep=";", header="Time;Radius error\n[s];[µm]"),
        {"deviation": "2"},
    ),
    "volts": (lambda t, d: table(t, d / UM / 25.0, header="time_s,signal_V"), {"um_per_volt": 25.0}),
    "lengths in mm": (lambda t, d: table(t, 100.0 + 1e3 * d, digits=12, header="time_s,length"), {}),
    "lengths in inches": (lambda t, d: table(t, (0.1 + d) / 0.0254, digits=12, header="time_s,length_inch"), {}),
    "positive inward": (lambda t, d: table(t, -d / UM, header="time_s,deviation_um"), {"inward": True}),
    "a rate and one column": (lambda t, d: table(d / UM), {"rate": 100.0, "deviation_unit": "um"}),
    "one column with decimal commas": (
        lambda t, d: table(d / UM, comma=True),
        {"rate": 100.0, "deviation_unit": "um", "decimal": "comma"},
    ),
    "times from the trace's start": (lambda t, d: table(t - t[0], d / UM, header="time_s,deviation_um"), {}),
    "more columns, comments, blank lines": (
        lambda t, d: (
            table(t, 20.0 + 0 * t, d / UM, header="# made by hand\n\ntime_s,temperature,deviation_um") + "\n\n"
        ),
        {},
    ),
    "separators at the ends of the lines": (
        lambda t, d: (
            table(t, d / UM, sep=";", header="time_s;deviation_um;").replace("\n", ";\n").replace("um;;", "um;")
        ),
        {},
    ),
    "compressed": (lambda t, d: gzip.compress(table(t, d / UM, header="time_s,deviation_um").encode()), {}),
}


@pytest.mark.parametrize("case", VARIANTS)
def test_every_way_to_write_the_same_trace(folder, case):
    write, options = VARIANTS[case]
    _, time, _, deviation = recorded(folder, "ccw")
    path = folder.parent / ("file.csv.gz" if case == "compressed" else "file.csv")
    data = write(time, deviation)
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    mjsim.import_trace(folder, path, "ccw", check=False, **options)
    trace = read_campaign(folder).traces["ccw"]
    assert trace.valid.all()
    assert trace.time == pytest.approx(time, abs=2e-6)
    assert trace.deviation == pytest.approx(deviation, abs=1e-10)


def test_what_was_found_and_concluded_is_said(folder):
    _, time, _, deviation = recorded(folder, "ccw")
    data = "\ufeff" + table(
        time - time[0], 100 + 1e3 * deviation, sep=";", comma=True, header="A file\nTime;Length", digits=12
    )
    made, _ = bring(folder, data)
    said = " | ".join(made.notes)
    for words in ("UTF-8 with byte order mark", "separator semicolon, decimal comma", "2 header lines",
        "time taken for s", "φ = 0",
                  "deviation taken for mm", "100 mm are subtracted"):  # fmt: skip
        assert words in said, words


def test_missing_cells_stay_missing(folder):
    _, time, _, deviation = recorded(folder, "ccw")
    rows = table(time, deviation / UM, header="time_s,deviation_um").split("\n")
    rows[100], rows[101] = rows[100].split(",")[0] + ",", rows[101].split(",")[0] + ",nan"
    made, trace = bring(folder, "\n".join(rows))
    assert np.flatnonzero(~trace.valid).tolist() == [99, 100] and made.to_json()["samples_missing"] == 2


def test_samples_of_run_in_and_run_out_are_left_out(folder):
    program, *_ = recorded(folder, "ccw")
    time = np.arange(0.0, program.duration, 0.01)
    made, trace = bring(folder, table(time, shape(program.phi(time)) / UM, header="time_s,deviation_um"))
    lo, hi = program.measured_span
    assert trace.time[0] == pytest.approx(lo, abs=0.01) and trace.time[-1] == pytest.approx(hi, abs=0.01)
    assert any("left out" in n for n in made.notes)


# -- angles ------------------------------------------------------------------------------------------------------------


def by_angle(folder, name, degrees, deviation, **options):
    """Import deviations over angles; times and readings."""
    return bring(folder, table(degrees, deviation / UM, header="angle_deg,deviation_um"), name, **options)


@pytest.mark.parametrize("name", ["ccw", "cw", "turn"])
@pytest.mark.parametrize("feed", [500.0, 3000.0, 12000.0])
def test_times_of_angles_invert_the_program(folder, name, feed):
    """At 12 m/min φ = 0 still lies in the ramp."""
    text = (folder / "campaign.toml").read_text().replace("3000.0", str(feed))
    (folder / "campaign.toml").write_text(text)
    program, time, phi, _ = recorded(folder, name, 0.005)
    assert times_of(program, phi) == pytest.approx(time, abs=1e-8)


@pytest.mark.parametrize("name", ["ccw", "cw", "turn"])
def test_signed_angle(folder, name):
    _, time, phi, deviation = recorded(folder, name)
    _, trace = by_angle(folder, name, phi / DEG, deviation)
    assert trace.time == pytest.approx(time, abs=3e-6) and trace.deviation == pytest.approx(deviation, abs=1e-10)


def test_angle_within_a_turn_over_several_revolutions(folder):
    """The file counts along the motion from 0 to 360°, again in every revolution, clockwise."""
    _, time, phi, deviation = recorded(folder, "cw")
    _, trace = by_angle(folder, "cw", (-phi / DEG) % 360.0, deviation, angle_sense="cw")
    assert trace.time == pytest.approx(time, abs=3e-6) and trace.deviation == pytest.approx(deviation, abs=1e-10)


def test_radians_and_another_zero(folder):
    """The paper's plots call 180° what is φ = 0."""
    _, time, phi, deviation = recorded(folder, "ccw")
    data = table((phi + np.pi) % (2 * np.pi), deviation / UM, header="phi,deviation_um", digits=12)
    made, trace = bring(folder, data, angle_zero=np.pi)
    assert trace.time == pytest.approx(time, abs=3e-6) and trace.deviation == pytest.approx(deviation, abs=1e-10)
    assert any("taken for rad" in n for n in made.notes)


def test_clockwise_run_listed_by_place(folder):
    """A table over the place on the circle, from 0 to 360°, of a run that went the other way."""
    text = (folder / "campaign.toml").read_text().replace("revolutions = 2", "revolutions = 1")
    (folder / "campaign.toml").write_text(text)
    degrees = np.arange(0.0, 360.01, 1.0)
    listed = shape(degrees * DEG)
    file = folder.parent / "listed.csv"
    file.write_text(table(degrees, listed / UM, header="angle_deg,deviation_um"))
    with pytest.raises(
        InputError, match=r'grows while test "cw" runs CW; say --angle-sense cw .* or --angle-sense ccw'
    ):
        mjsim.import_trace(folder, file, "cw", check=False)
    made, trace = bring(folder, file.read_text(), "cw", angle_sense="ccw")
    program = Program(made.test)
    assert trace.deviation == pytest.approx(shape(program.phi(trace.time)), abs=1e-10)
    assert program.phi(trace.time[[0, -1]]) / DEG == pytest.approx([0.0, -360.0], abs=1e-3)


@pytest.mark.parametrize("begin", [45.0, 180.0, 300.0])
@pytest.mark.parametrize("how", ["angle", "time"])
def test_a_circle_that_begins_elsewhere(folder, begin, how):
    """What lies beyond the end goes to the beginning, in the order of the angle."""
    phi = (begin + np.arange(0.0, 360.0, 0.5)) * DEG
    if how == "angle":
        made, trace = by_angle(folder, "ccw", phi / DEG, shape(phi))
    else:
        time = (phi - phi[0]) * 0.1 / 0.05  # 3000 mm/min on 100 mm
        made, trace = bring(folder, table(time, shape(phi) / UM, header="time_s,deviation_um"), start_angle=begin * DEG)
    at = Program(made.test).phi(trace.time)
    assert len(at) == 720 and trace.deviation == pytest.approx(shape(at), abs=1e-10)
    assert (np.diff(at) > 0).all() and at[-1] - at[0] == pytest.approx(359.5 * DEG, abs=1e-5) and -1e-5 < at[0] < 0.01
    assert any("go to the beginning" in n for n in made.notes)


def test_encoder_noise_does_not_turn_time_back(folder):
    _, _, phi, deviation = recorded(folder, "ccw")
    jitter = 0.2 * np.random.default_rng(1).standard_normal(len(phi)) * np.diff(phi).mean()
    made, trace = by_angle(folder, "ccw", (phi + 3 * jitter) / DEG, deviation)
    assert (np.diff(trace.time) > 0).all() and 0.5 * len(phi) < len(trace.time) < len(phi)
    assert any("there already" in n for n in made.notes)


@pytest.mark.parametrize("digits", [3, 2, 1])
@pytest.mark.parametrize("gap", [False, True])
def test_rounded_angles_put_on_an_even_clock(folder, digits, gap):
    """A bar at 100 Hz goes 0.286° from sample to sample: one digit makes its samples early or late by half a step."""
    _, time, phi, deviation = recorded(folder, "cw")
    keep = np.ones(len(phi), bool)
    keep[500:540] = not gap
    made, trace = by_angle(folder, "cw", np.round(phi[keep] / DEG, digits), deviation[keep])
    assert trace.time == pytest.approx(time[keep], abs=2e-5 if digits > 1 else 1e-3)
    assert trace.deviation == pytest.approx(deviation[keep], abs=1e-10)
    assert any("evenly spaced" in n for n in made.notes)


def test_whole_degrees_at_a_high_rate_lose_no_sample(folder):
    """Several samples fall on every degree."""
    _, time, phi, deviation = recorded(folder, "ccw")
    _, trace = by_angle(folder, "ccw", np.round(phi / DEG), deviation)
    assert len(trace.time) == len(time) and np.abs(trace.time - time).max() < 0.003
    assert trace.deviation == pytest.approx(deviation, abs=1e-10)


def test_a_list_by_degrees_is_taken_at_its_word(folder):
    """Both ends of every revolution are listed, and some degrees are missing: the others stay where they are."""
    degrees = np.append(np.arange(0.0, 361.0), np.arange(0.0, 361.0))
    degrees = np.delete(degrees, [40, 41, 500])
    made, trace = by_angle(folder, "cw", degrees, shape(-degrees * DEG), angle_sense="cw")
    assert len(trace.time) == 722 - 1 - 3
    assert trace.deviation == pytest.approx(shape(Program(made.test).phi(trace.time)), abs=1e-10)


def test_two_runs_in_one_file_are_taken_one_by_one(folder):
    _, time, phi, deviation = recorded(folder, "ccw")
    degrees = phi / DEG
    both = table(
        np.append(degrees, degrees[::-1]),
        np.append(deviation, 2 * deviation[::-1]) / UM,
        header="angle_deg,deviation_um",
    )
    file = folder.parent / "both.csv"
    file.write_text(both)
    with pytest.raises(InputError, match=rf"line {len(phi) + 2}: the angle turns back.*--rows"):
        mjsim.import_trace(folder, file, "ccw", check=False)
    _, trace = bring(folder, both, rows=(2, len(phi) + 1))
    assert trace.time == pytest.approx(time, abs=3e-6)


# -- into campaign.toml ------------------------------------------------------------------------------------------------

NEW = ["--kind", "circular", "--plane", "YZ", "--direction", "CW", "--feed", 3000, "--length", 100, "--table-ball", 0,
    0, 155,
       "--revolutions", 1, "--setup", "second"]  # fmt: skip


@pytest.fixture
def file(folder):
    """A recording of the test "ccw", in mjsim's own form."""
    _, time, _, deviation = recorded(folder, "ccw")
    path = folder.parent / "YZ run 1.csv"
    path.write_text(table(time, deviation / UM, header="time_s,deviation_um"))
    return path


def done(*args):
    result = run(*args)
    assert result.exit_code == 0, result.output
    return result


def test_a_new_test_is_appended_and_comments_stay(folder, file):
    data = json.loads(done("import", file, "--campaign", folder, *NEW, "--json", "--quiet", "--no-check").stdout)
    (made,) = data["traces"]
    assert (made["test"], made["added"], made["written"]) == ("YZ-run-1", True, True)
    text = (folder / "campaign.toml").read_text()
    assert text.startswith(CAMPAIGN)
    assert tomllib.loads(text)["test"][-1] == {
        "name": "YZ-run-1", "trace": "traces/YZ-run-1.csv", "setup": "second", "kind": "circular", "plane": "YZ",
        "direction": "CW",
        "revolutions": 1, "table_ball_mm": [0.0, 0.0, 155.0], "bar_length_mm": 100.0, "feed_mm_min": 3000.0,
    }  # fmt: skip
    assert [t.name for t in read_campaign(folder).measured] == ["YZ-run-1"]


def test_a_trace_for_a_test_that_is_there(folder, file):
    done("import", file, "--campaign", folder, "--test", "ccw", "--no-check")
    text = (folder / "campaign.toml").read_text()
    assert [r for r in text.splitlines() if r not in CAMPAIGN.splitlines()] == ['trace = "traces/ccw.csv"']
    before = snapshot(folder)
    refused(folder, ["import", file, "--campaign", folder, "--test", "ccw"], "ccw.csv", "--force")
    done("import", file, "--campaign", folder, "--test", "ccw", "--force", "--no-check", "--quiet")
    assert snapshot(folder) == before


@pytest.mark.parametrize("change", ["CRLF", "inline", "no test yet"])
def test_other_forms_of_campaign_toml(folder, file, change):
    path = folder / "campaign.toml"
    if change == "CRLF":
        path.write_bytes(CAMPAIGN.replace("\n", "\r\n").encode())
    elif change == "inline":
        path.write_text('name = "short" # in one line\ntest = [{name="a", kind="circular", plane="XY", direction="CW", '
                        "table_ball_mm=[0.0, 0.0, 155.0], bar_length_mm=100.0, feed_mm_min=3000.0}]\n")  # fmt: skip
    else:
        path.write_text('# to be filled\nname = "short"\n')
    done("import", file, "--campaign", folder, *NEW, "--no-check")
    data = path.read_bytes()
    assert "YZ-run-1" in read_campaign(folder).traces
    assert data.count(b"\r\n") == (data.count(b"\n") if change == "CRLF" else 0)
    assert b"#" in data


def test_the_test_from_the_files_header(folder, file):
    head = (
        "Ball bar export\nTest plane: YZ\nRun direction: CW\nFeedrate (mm/min): 3000\nBar length: 100 "
        "mm\nrevolutions = 1\n"
    )
    file.write_text(head + file.read_text())
    done("import", file, "--campaign", folder, "--table-ball", 0, 0, 155, "--no-check")
    test = read_campaign(folder).tests[-1]
    assert (test.plane, test.direction, test.revolutions, test.feed, test.length) == (
        "YZ",
        "CW",
        1,
        pytest.approx(0.05),
        0.1,
    )


def test_preview_writes_nothing_and_shows_the_same(folder, file):
    before = snapshot(folder)
    shown = done("import", file, "--campaign", folder, *NEW, "--preview", "--no-check")
    assert snapshot(folder) == before
    assert "preview: nothing was written" in shown.stderr
    for words in (
        "→ test YZ-run-1 (a new test in campaign.toml)",
        "100 Hz",
        "the program 12.57 s",
        "µm, RMS",
        "deviation_um",
    ):
        assert words in shown.stdout, shown.stdout
    assert max(map(len, shown.stdout.splitlines())) <= 80
    written = done("import", file, "--campaign", folder, *NEW, "--no-check")
    assert written.stdout == shown.stdout and "preview" not in written.stderr


def test_several_files_all_or_none(folder, file):
    second = file.with_name("second.csv")
    second.write_text(file.read_text().replace("deviation_um", "deviation"))
    refused(
        folder, ["import", file, second, "--campaign", folder, *NEW, "--no-check"], "second.csv", "--deviation-unit"
    )
    second.write_text(file.read_text())
    done("import", file, second, "--campaign", folder, *NEW, "--no-check", "--quiet")
    assert [t.name for t in read_campaign(folder).measured] == ["YZ-run-1", "second"]


def test_a_failed_write_leaves_campaign_toml_as_it_was(folder, file, monkeypatch):
    """campaign.toml comes last: the trace that was new goes again, and no temporary file stays."""
    real = os.replace

    def fail(new, path):
        if Path(path).name == "campaign.toml":
            raise OSError(28, "No space left on device")
        real(new, path)

    monkeypatch.setattr(os, "replace", fail)
    before = snapshot(folder)
    with pytest.raises(InputError, match="No space left"):
        mjsim.import_trace(folder, file, "ccw", check=False)
    assert snapshot(folder) == before


# -- refusals ----------------------------------------------------------------------------------------------------------


def spoiled(change):
    return lambda text: change(text.split("\n"))


REFUSED = {
    "no such file": (None, ["--test", "ccw"], "no such file"),
    "no numbers": (lambda t: "time,dev\nnone\n", [], "no table of numbers"),
    "empty": (lambda t: "", [], "no table of numbers"),
    "binary": (lambda t: "\0\1\2" * 99, [], "byte 0 is not text"),
    "text in the table": (lambda t: t.replace("\n", "\nhello,world\n", 9).replace("hello,world\n", "", 5), [],
    "line 7", "'hello,world'"),
    "which column": (lambda t: t.replace("time_s,deviation_um\n", ""), [], "which column is the time", "--time COLUMN",
    "has 1, 2"),
    "unknown column": (lambda t: t, ["--time", "clock"], "no column 'clock'", '1 "time_s", 2 "deviation_um"'),
    "column number": (lambda t: t, ["--deviation", "3"], "no column '3'"),
    "one column twice": (lambda t: t, ["--time", "2", "--deviation", "2"], "two things"),
    "unit of the deviation": (lambda t: t.replace("deviation_um", "deviation"), [], "--deviation-unit um, mm, inch"),
    "unit of the time": (lambda t: t.replace("time_s", "time").replace("\n1", "\n7"), [], "--time-unit"),
    "volts without a scale": (lambda t: t.replace("_um", "_V"), [], "--scale UM_PER_VOLT"),
    "a scale without volts": (lambda t: t, ["--scale", "10"], "in um", "volts only"),
    "time goes back": (spoiled(lambda r: "\n".join([*r[:50], r[10], *r[50:]])), [], "line 51", "times that grow"),
    "time missing": (spoiled(lambda r: "\n".join([*r[:50], ",1.0", *r[51:]])), [], "line 51", "the time is missing"),
    "wrong feed": (spoiled(lambda r: "\n".join(r[:600])), [], "(5.98 s)", "(12.57 s)", "it stops"),
    "wrong revolutions": (lambda t: t, ["--test", "cw", "--clock", "trace"], "12.56 s", "revolutions"),
    "no clock fits": (spoiled(lambda r: "\n".join([r[0], *("9" + x for x in r[1:300])])), [], "is measured for "
                                                                                              "12.57 s",
                                                                                              "--start-angle"),
    "too few": (spoiled(lambda r: "\n".join(r[:1] + r[1::40])), [], "samples", "at least 50"),
    "comma or two columns": (lambda t: "\n".join(f"{i % 7},{i}" for i in range(1300)), ["--rate", "100"],
    "--decimal comma or --sep"),
    "beyond the range": (lambda t: t.replace("_um", "_mm"), [], "inside the sensor's range", "--deviation-unit"),
    "lengths turned round": (lambda t: t, ["--absolute", "--sign", "inward"], "--sign outward"),
    "rows the wrong way": (lambda t: t, ["--rows", "50", "3"], "rows 50 to 3"),
    "rows without a table": (lambda t: t, ["--rows", "1", "1"], "no table of numbers"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refused_in_one_sentence(folder, file, case):
    spoil, options, *words = REFUSED[case]
    if spoil is None:
        file = file.with_name("none.csv")
    else:
        file.write_text(spoil(file.read_text()))
    options = options if "--test" in options else [*options, "--test", "ccw"]
    refused(folder, ["import", file, "--campaign", folder, "--json", *options], file.name, *words)


CAMPAIGN_REFUSED = {
    "no campaign": (["--campaign", "{folder}/none"], "no such campaign", "mjsim new campaign"),
    "a new test of no kind": ([], '"YZ-run-1" is not in', "--kind"),
    "a new test without its keys": (["--plane", "YZ"], "circular needs --direction, --table-ball, --length, --feed"),
    "keys of another kind": ([*NEW, "--axis", "C"], "'axis' does not belong to circular"),
    "keys for a test that is there": (["--test", "ccw", "--feed", 1000], '"ccw" is there already', "leave out --feed"),
    "a name that is a path": ([*NEW, "--test", "../x"], "../x"),
    "a length out of bounds": ([*NEW, "--length", 5], "bar_length_mm = 5", "20"),
}


@pytest.mark.parametrize("case", CAMPAIGN_REFUSED)
def test_refused_by_the_campaign(folder, file, case):
    options, *words = CAMPAIGN_REFUSED[case]
    options = [str(o).format(folder=folder) for o in options]
    options = options if "--campaign" in options else ["--campaign", folder, *options]
    refused(folder, ["import", file, *options], *words)


@pytest.mark.parametrize("name", ["campaign.toml", "machine.toml", "mine.py"])
def test_only_traces_are_replaced(folder, file, name):
    (folder / "mine.py").write_text("mine")
    (folder / "campaign.toml").write_text(CAMPAIGN.replace('name = "ccw"\n', f'name = "ccw"\ntrace = "{name}"\n'))
    refused(folder, ["import", file, "--campaign", folder, "--test", "ccw", "--force"], name, "no trace's file")


# -- a wrong unit becomes a question -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("factor", "unit", "words"),
    [
        (1e-3, "um", "less than a ball bar can tell: is the deviation in mm"),  # mm in the file, said to be µm
        (1 / 25.4e3, "um", "less than a ball bar can tell: is the deviation in inch"),
        (39.37, "um", "is the deviation in uin, not um?"),  # microinches: plausible in itself, not beside the model
    ],
)
def test_a_wrong_unit_is_asked_about_and_not_corrected(folder, file, factor, unit, words):
    time, deviation = np.loadtxt(file, delimiter=",", skiprows=1).T
    file.write_text(table(time, factor * deviation, header="time,deviation"))
    args = ["import", file, "--campaign", folder, "--test", "ccw", "--time-unit", "s", "--deviation-unit", unit]
    data = json.loads(done(*args, "--json").stdout)["traces"][0]
    assert len(data["questions"]) == 1 and words in data["questions"][0] and "--deviation-unit" in data["questions"][0]
    kept = read_campaign(folder).traces["ccw"].deviation
    assert kept == pytest.approx(factor * deviation * UM, abs=1e-10)
    assert words in done(*args, "--force").stderr


def test_no_question_where_nothing_is_strange(folder, file):
    assert mjsim.import_trace(folder, file, "ccw").questions == ()


# -- export and back ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A short campaign of an example, compared and exported for a spreadsheet with decimal commas."""
    from test_cli import TESTS, cut

    folder = cut(tmp_path_factory.mktemp("export") / "c", TESTS[1:])
    campaign = read_campaign(folder)
    files = mjsim.export(campaign, mjsim.read_machine(campaign.machine_file), folder / "out", decimal_comma=True)
    return folder, campaign, files, mjsim.compare(campaign, mjsim.read_machine(campaign.machine_file))


def test_exported_figures(exported):
    folder, campaign, files, comparison = exported
    (name,) = campaign.traces
    assert [f.name for f in files] == [f"{name}.csv", "figures.csv"]
    raw = (folder / "out" / "figures.csv").read_bytes()
    assert raw.startswith(b"\xef\xbb\xbf") and raw.count(b"\r\n") == raw.count(b"\n") == 2
    head, row = (line.split(";") for line in raw.decode("utf-8-sig").splitlines())
    figures = dict(zip(head, row, strict=True))
    assert (figures["test"], figures["kind"], figures["measured_G_um"]) == (name, "rotary", "")
    assert float(figures["residual_rms_um"].replace(",", ".")) * UM == pytest.approx(comparison.rms, abs=1e-10)
    assert all(h.endswith(("_um", "_mm", "_ms", "_min")) for h in head if "samples" not in h and h not in head[:4])


@pytest.mark.parametrize("column", ["time", "angle"])
def test_export_and_import_give_the_same_comparison(exported, tmp_path, column):
    source, campaign, _, comparison = exported
    (name,) = campaign.traces
    folder = shutil.copytree(source, tmp_path / "c", ignore=shutil.ignore_patterns("traces", "out", ".mjsim"))
    chosen = {"time": {"time": "time_s"}, "angle": {"angle": "phi_deg"}}[column]
    mjsim.import_trace(folder, source / "out" / f"{name}.csv", name, check=False, **chosen)
    again = read_campaign(folder)
    assert len(again.traces[name].time) == len(campaign.traces[name].time)
    assert again.traces[name].deviation == pytest.approx(campaign.traces[name].deviation, abs=1e-10)
    second = mjsim.compare(again, mjsim.read_machine(again.machine_file))
    assert second.rms == pytest.approx(comparison.rms, abs=2e-9)
    if column == "time":  # in the angle the trigger is in already
        assert second.tests[0].trigger == pytest.approx(comparison.tests[0].trigger, abs=1e-6)


def test_export_refuses(exported, tmp_path):
    folder, campaign, *_ = exported
    refused(folder, ["export", folder, "--out", folder / "out", "--json"], "--force")
    refused(
        folder,
        ["export", folder, "--out", folder / "new", "--test", "none"],
        "no test 'none' with a trace",
        *campaign.traces,
    )
    assert run("export", folder).exit_code == 2
