"""An instrument of a test's own goes through the commands without another file touched: a displacement sensor between
spindle and table that reads along the first axis.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
import pytest
from click.testing import CliRunner
from pydantic import Field

import mjsim
from mjsim.cli.main import main
from mjsim.errors import InputError
from mjsim.instruments.base import INSTRUMENTS, Instrument, Mistake, Observation, register
from mjsim.instruments.schema import Table, Text
from mjsim.io.inputs import read_bytes
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS, Chain
from mjsim.machine.kinematics import bar_vector
from mjsim.units import MM, UM

RATE = 100.0


@dataclass(frozen=True)
class Stroke:
    """The first axis goes to and fro once, and the sensor reads what it is off its command."""

    __test__: ClassVar[bool] = False
    instrument: ClassVar[str] = "displacement_sensor"
    name: str
    way: float
    setup: str
    trace: str | None
    chain: Chain


class StrokeTable(Table):
    name: Text
    kind: Literal["stroke"]
    stroke_mm: Annotated[float, Field(gt=0, le=100)]
    trace: str | None = None


class Sensor(Instrument[Stroke, np.ndarray]):
    name = Stroke.instrument
    noun = "displacement sensor"
    test_noun = "stroke"
    beside = "strokes"

    def kinds(self):
        return ("stroke",)

    def table(self, chain):
        return StrokeTable

    def test_of(self, file, table, chain):
        return Stroke(table.name, table.stroke_mm * MM, table.name, table.trace, chain)

    def read(self, path: Path, test, data):
        return np.loadtxt(read_bytes(path).decode().splitlines()[1:], delimiter=",", ndmin=2)

    def observe(self, test, recording):
        value = recording[:, 1:] * UM
        return Observation(recording[:, 0], value, np.isfinite(value))

    def command(self, test, time):
        q = np.zeros((len(time), test.chain.count))
        q[:, 0] = 0.5 * test.way * (1.0 - np.cos(np.pi * np.clip(time, 0.0, 4.0) / 2.0))
        return q

    def reading(self, test, position, geometry):
        time = np.arange(len(position)) * 1e-3
        return (bar_vector(test.chain, position, np.zeros(3), geometry)[:, 0] - self.command(test, time)[:, 0])[:, None]

    def noise(self, test, recording, data):
        return np.array([data.resolution_um * UM])

    def figures(self, test, time, reading):
        return {"range_um": float(np.ptp(reading)) / UM}

    def mistakes(self, tests, recordings, data):
        said = "{}: reads more than 10 mm; correct the column's unit"
        return [
            Mistake("unit", (t.name,), said.format(t.name)) for t in tests if abs(recordings[t.name][:, 1]).max() > 1e4
        ]


@pytest.fixture
def sensor():
    register(Sensor)
    yield
    del INSTRUMENTS[Sensor.name]


def campaign_toml(planned=True):
    tables = ['name = "strokes"\n[instrument]\nkind = "displacement_sensor"\nresolution_um = 0.05\n']
    tables.append('[[test]]\nname = "there-and-back"\nkind = "stroke"\nstroke_mm = 20.0\ntrace = "stroke.csv"\n')
    return "".join(tables) + ('[[test]]\nname = "later"\nkind = "stroke"\nstroke_mm = 40.0\n' if planned else "")


@pytest.fixture
def folder(tmp_path, sensor):
    """Recorded on a machine with 8 µm of backlash that the machine file lacks; the sensor's zero is 3 µm off."""
    machine = mjsim.read_machine(examples() / "healthy" / "machine.toml")
    worn = machine.with_effect(mjsim.make_effect("backlash.X", machine.chain, width_um=8.0))
    test = Stroke("there-and-back", 20.0 * MM, "there-and-back", None, FIVE_AXIS)
    time, value = shown(worn, test)
    noise = 0.05 * np.random.default_rng(1).normal(size=len(time))
    rows = "".join(f"{t:.3f},{v / UM + 3.0 + n:.4f}\n" for t, v, n in zip(time, value, noise, strict=True))
    (tmp_path / "stroke.csv").write_text("time_s,deviation_um\n" + rows)
    (tmp_path / "campaign.toml").write_text(campaign_toml())
    (tmp_path / "machine.toml").write_bytes((examples() / "healthy" / "machine.toml").read_bytes())
    return tmp_path


def shown(machine, test):
    """Times of the samples, and what an ideal sensor shows of a machine."""
    from mjsim.machine.model import build
    from mjsim.simulation.axes import load_of

    plant, fine = build(machine), np.arange(4100) * 1e-3
    value = Sensor().reading(test, load_of(plant, fine, Sensor().command(test, fine)), plant.geometry)[:, 0]
    time = np.arange(0.0, 4.0, 1.0 / RATE)
    return time, np.interp(time, fine, value)


def run(*arguments):
    result = CliRunner().invoke(main, [*map(str, arguments)])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_check_compare_and_export(folder, tmp_path):
    data = json.loads(run("check", folder, "--json"))
    assert data["tests"][0]["finding"] == ["ok"] and data["not_measured"] == ["later"]
    data = json.loads(run("compare", folder, "--json", "--out", tmp_path / "plots"))
    (test,) = data["tests"]
    assert 3.0 < test["rms_um"] < 5.0 and test["max_um"] > 3.5  # half of the backlash to either side
    assert test["set_up"]["zero_of_deviation_um"] == pytest.approx(3.0, abs=0.2)
    measured, simulated = (test["figures"][who]["range_um"] for who in ("measured", "simulated"))
    assert measured > simulated + 7.0
    assert [Path(p).name for p in data["plots"]] == ["there-and-back.png"] and Path(data["plots"][0]).is_file()
    assert "there-and-back" in run("compare", folder, "--no-plots") and "later" in run("check", folder)
    run("export", folder, "--out", tmp_path / "tables")
    head, *rows = (tmp_path / "tables" / "there-and-back.csv").read_text().splitlines()
    assert head.split(",")[:2] == ["time_s", "deviation_measured_um"] and len(rows) == test["samples"]
    assert "there-and-back,deviation,um" in (tmp_path / "tables" / "figures.csv").read_text()


def test_the_model_that_has_the_cause_leaves_the_noise(folder):
    bench = mjsim.open_workbench(folder)
    before = bench.quick()
    bench.set("backlash.X", width_um=8.0)
    after = bench.quick()
    assert before.rms > 60.0 * after.rms and after.rms == pytest.approx(0.05 * UM, rel=0.1)
    assert bench.ladder.present.rms == after.rms
    assert [s.words for s in bench.save()] == ["+ backlash.X"] and mjsim.open_workbench(folder).quick().rms == after.rms
    assert bench.undo() and bench.quick().rms == before.rms


def test_report(folder, tmp_path):
    data = json.loads(run("report", folder, "-o", tmp_path / "page.html", "--json"))
    page = (tmp_path / "page.html").read_text()
    assert data["instrument"] == "stroke" and data["tests"][0]["name"] == "there-and-back"
    assert "Strokes of" in page and page.count("data:image/png") >= 1


def test_animate(folder, tmp_path):
    film = ("-o", tmp_path / "film.gif", "--seconds", "0.3", "--fps", "10")
    data = json.loads(run("animate", folder, "--test", "there-and-back", *film, "--json"))
    assert data["test"] == "there-and-back" and data["frames"] == 3 and (tmp_path / "film.gif").stat().st_size > 1000


def test_beside_a_ball_bar(folder, tmp_path):
    """A third instrument stands below the others' answers, and a diagnosis says that it cannot use it."""
    from tests.test_planned_tests import BAR_TEST

    head, _, tests = campaign_toml().partition("[[test]]")
    named = head.replace("[instrument]", "[instrument.sensor]")
    (folder / "campaign.toml").write_text(
        named + '[instrument.bar]\nkind = "ball_bar"\n' + BAR_TEST + "[[test]]" + tests
    )
    campaign = mjsim.read_campaign(folder)
    assert [t.instrument for t in campaign.tests] == ["ball_bar", *["displacement_sensor"] * 2]
    data = json.loads(run("compare", folder, "--json", "--no-plots"))
    assert data["not_measured"] == ["planned-circle", "later"]
    with pytest.raises(InputError, match=r"no diagnosis works with .*displacement_sensor"):
        mjsim.diagnose(campaign, mjsim.read_machine(campaign.machine_file))


def test_a_mistake_is_refused(folder):
    lines = (folder / "stroke.csv").read_text().splitlines()
    wrong = [lines[0], *(f"{t},{1e4 * (float(v) + 10.0)}" for t, v in (row.split(",") for row in lines[1:]))]
    (folder / "stroke.csv").write_text("\n".join(wrong))
    assert json.loads(run("check", folder, "--json"))["mistakes"][0]["kind"] == "unit"
    result = CliRunner().invoke(main, ["compare", str(folder), "--no-plots"])
    assert result.exit_code == 1 and "correct the column's unit, or say --as-is" in result.output
    run("compare", folder, "--no-plots", "--as-is")


def test_unknown_kinds_are_still_named(folder):
    text = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").write_text(text.replace('kind = "stroke"\nstroke_mm = 40.0', 'kind = "strok"'))
    with pytest.raises(InputError, match="strok"):
        mjsim.read_campaign(folder)
