"""Traces and campaigns as users' programs write them: the same in another encoding, a sensor at its stop, odd
clocks.
"""

import shutil

import numpy as np
import pytest
from commands import CAMPAIGN, as_json, ok, refused

from mjsim.campaign.files import campaign_from, read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.instruments.ball_bar.files import read_trace, saturated
from mjsim.instruments.ball_bar.files import test_table as table_of
from mjsim.instruments.ball_bar.measurement import BallBarData
from mjsim.io.resources import examples
from mjsim.units import UM


@pytest.fixture
def campaign(good, tmp_path):
    return shutil.copytree(good, tmp_path / "short")


SAME = {
    "byte order mark": lambda data: b"\xef\xbb\xbf" + data,
    "Windows line ends and byte order mark": lambda data: b"\xef\xbb\xbf" + data.replace(b"\n", b"\r\n"),
    "blank lines at the end": lambda data: data + b"\n\n\n",
    "no line end at the end": lambda data: data.rstrip(b"\n"),
}


@pytest.mark.parametrize("change", SAME)
def test_the_same_campaign_in_other_bytes(campaign, change):
    def look():
        c, machine = read_campaign(campaign), read_machine(campaign / "machine.toml")
        traces = {k: (t.time.tolist(), t.deviation.tolist(), t.valid.tolist()) for k, t in c.traces.items()}
        return c.name, c.tests, c.instrument, traces, [(e.key, e.values) for e in machine.effects]

    before = look()
    for file in ("campaign.toml", "machine.toml", "traces/turn.csv"):
        (campaign / file).write_bytes(SAME[change]((campaign / file).read_bytes()))
    assert look() == before


def test_comments_and_the_order_of_tables_mean_nothing(campaign):
    before = read_campaign(campaign).tests
    head, *tests = CAMPAIGN.split("[[test]]\n")
    name, instrument = head.split("[instrument]")
    tables = "".join(f"[[test]] # one\n{t}# more\n" for t in tests)
    (campaign / "campaign.toml").write_text("# a comment\n" + name + tables + "[instrument]" + instrument)
    assert read_campaign(campaign).tests == before


def test_a_test_survives_its_table():
    """Tests of every kind, written as a table and read again."""
    file = examples() / "hidden-backlash" / "campaign.toml"
    before = read_campaign(file, traces=False).tests
    table = {"name": "again", "test": [table_of(t) for t in before]}
    for test, again in zip(before, campaign_from(file, table, traces=False).tests, strict=True):
        for key, value in vars(test).items():
            if key not in ("trace", "started"):
                close = pytest.approx(value, rel=1e-8) if isinstance(value, float | tuple) else value
                assert getattr(again, key) == close, key


# -- a sensor at its stop ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("low, high", [(-1e9, 250.0), (-250.0, 1e9), (-250.0, 250.0), (-399.0, 1e9)])
def test_flat_tops_are_no_readings(low, high):
    k = np.arange(2000)
    curve = 400.0 * np.sin(2 * np.pi * k / 900) + np.random.default_rng(1).normal(0.0, 0.1, len(k))
    want = (curve >= high) | (curve <= low)
    found = saturated(np.round(np.clip(curve, low, high), 1) * UM)
    assert (found & ~want).sum() <= 10 and (want & ~found).sum() <= 40
    assert found.sum() > 30


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("size", [400.0, 3.0, 0.3])
def test_few_digits_are_no_stop(noise, size):
    """A peak is flat where its digits are few; a constant reading, and one of two values, say nothing."""
    k = np.arange(2000)
    x = size * np.sin(2 * np.pi * k / 900) + np.random.default_rng(2).normal(0.0, 1.0, len(k)) * noise
    for digits in (0, 1, 2, 4, 8):
        assert not saturated(np.round(x, digits) * UM).any()
    assert not saturated(np.zeros(100)).any() and not saturated(np.repeat([0.0, 1e-6], 50)).any()


def test_what_was_left_out_is_said(campaign):
    trace = campaign / "traces" / "turn.csv"
    time = [row.split(",")[0] for row in trace.read_text().split("\n")[1:-1]]
    noise = np.random.default_rng(3).normal(0, 0.02, len(time))
    top = np.clip(3.0 * np.sin(np.arange(len(time)) / 20) + noise, -9, 2.0)
    rows = [f"{t},{x:.2f}" for t, x in zip(time, top, strict=True)]
    trace.write_text("\n".join(["time_s,deviation_um", *rows, ""]))
    held = int(read_trace(trace, BallBarData()).saturated)
    assert held >= 30
    row = as_json("compare", campaign, "--no-plots", "--as-is")["tests"][0]
    assert row["samples_saturated"] == held <= row["samples_left_out"]
    said = " ".join(ok("compare", campaign, "--no-plots", "--as-is").stdout.split())
    assert f"its stop, or beyond its range, in {held} of {len(time)} samples" in said


# -- clocks ------------------------------------------------------------------------------------------------------------


def test_rates_that_no_recorder_has(campaign):
    """Most samples within a billionth of a second: their even clock would not fit into memory."""
    trace = campaign / "traces" / "turn.csv"
    lines = trace.read_text().split("\n")
    first = float(lines[1].split(",")[0])
    close = [f"{first + 1e-9 * i:.12f},0.0" for i in range(1, 400)]
    trace.write_text("\n".join([*lines[:2], *close, *lines[2:]]))
    refused(campaign.parent, ["compare", campaign, "--json"], "turn.csv", "even rate")


def test_lines_are_counted_with_blank_ones(campaign):
    trace = campaign / "traces" / "turn.csv"
    lines = trace.read_text().split("\n")
    trace.write_text("\n".join([*lines[:3], "", "", *lines[3:20], lines[5], *lines[20:]]))
    refused(campaign.parent, ["compare", campaign, "--json"], "turn.csv, line 23", "grow")
