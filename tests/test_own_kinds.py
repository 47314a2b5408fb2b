"""A kind of test is one file: kinds defined here pass through everything that a user does with a test."""

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated

import numpy as np
import pytest
from click.testing import CliRunner
from pydantic import Field

import mjsim
from mjsim.cli.main import main
from mjsim.inference.planning.candidates import first_round, neighbours
from mjsim.instruments.ball_bar import files
from mjsim.instruments.ball_bar.kinds import base
from mjsim.instruments.ball_bar.kinds.base import DIRECTION, FROM, REVOLUTIONS, TO, Arc, Key, Kind
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import Chain
from mjsim.machine.kinematics import work_to_machine
from mjsim.units import DEG

LEAN = Key("lean_deg", "lean", DEG, Annotated[float, Field(ge=-60, le=60)], help="The circle leans by this about X, °.")


class LeaningCircle(Kind):
    """A circle of X, Y and Z in a plane that leans about X; it goes round, and has a key that no other kind has."""

    name = "leaning_circle"
    keys = (LEAN, DIRECTION, REVOLUTIONS)

    def path(self, test: BallBarTest, phi: np.ndarray) -> np.ndarray:
        lean = test.more["lean"]
        y = test.length * np.sin(phi)
        offset = np.column_stack([test.length * np.cos(phi), np.cos(lean) * y, np.sin(lean) * y])
        q = np.zeros((len(phi), test.chain.count))
        q[:, test.chain.linear_columns] = offset + test.table_ball
        return q

    def angle(self, test: BallBarTest, q: np.ndarray) -> np.ndarray:
        x, y, z = (q[:, test.chain.linear_columns] - test.table_ball).T
        return np.arctan2(np.cos(test.more["lean"]) * y + np.sin(test.more["lean"]) * z, x)

    def words(self, test: BallBarTest) -> str:
        return f"circle that leans by {test.more['lean'] / DEG:g}°, {test.direction}"

    def proposals(self, chain: Chain, length: float, height: float) -> Iterator[BallBarTest]:
        for lean in (20.0, 40.0):
            yield BallBarTest("", self.name, (0.0, 0.0, height), length, 0.0, more={"lean": lean * DEG}, chain=chain)

    def variations(self, test: BallBarTest) -> Iterator[BallBarTest]:
        yield replace(test, more={"lean": -test.more["lean"]})


class Nod(Arc):
    """A turns, and the spindle ball follows beside the table ball: it does not go round."""

    name = "nod"
    keys = (FROM, TO)
    moves_on_table = False

    def path(self, test: BallBarTest, phi: np.ndarray) -> np.ndarray:
        q = np.zeros((len(phi), test.chain.count))
        q[:, test.chain.index("A")] = phi
        beside = np.add(test.table_ball, (test.length, 0.0, 0.0))
        q[:, test.chain.linear_columns] = work_to_machine(test.chain, q, beside)
        return q

    def angle(self, test: BallBarTest, q: np.ndarray) -> np.ndarray:
        return q[:, test.chain.index("A")]

    def words(self, test: BallBarTest) -> str:
        return f"A nods from {test.start / DEG:g}° to {test.stop / DEG:g}°"

    def turns(self, test: BallBarTest) -> str:
        return "A"

    def radius(self, test: BallBarTest) -> float:
        return float(np.hypot(*test.table_ball[1:]))


CAMPAIGN = """name = "own kinds"
[[test]]
name = "leaning"
kind = "leaning_circle"
lean_deg = 25.0
direction = "CCW"
revolutions = 2
table_ball_mm = [10.0, 20.0, 155.0]
bar_length_mm = 100.0
feed_mm_min = 3000.0
[[test]]
name = "nodding"
kind = "nod"
from_deg = 0.0
to_deg = 40.0
table_ball_mm = [0.0, 20.0, 155.0]
bar_length_mm = 100.0
feed_mm_min = 3000.0
"""


@pytest.fixture(autouse=True)
def kinds(monkeypatch):
    for kind in (LeaningCircle, Nod):
        monkeypatch.setitem(base.KINDS, kind.name, kind())


@pytest.fixture
def folder(tmp_path):
    mjsim.new_campaign(tmp_path / "own")
    (tmp_path / "own" / "campaign.toml").write_text(CAMPAIGN)
    return tmp_path / "own"


def run(*arguments):
    result = CliRunner().invoke(main, [*map(str, arguments)])
    assert result.exit_code == 0, result.output
    return result


def test_a_key_of_ones_own_is_read_checked_and_written(folder):
    leaning, nodding = mjsim.read_campaign(folder).tests
    assert leaning.more == {"lean": pytest.approx(25.0 * DEG)} and files.test_table(leaning)["lean_deg"] == 25.0
    assert (nodding.direction, nodding.revolutions) == ("CCW", 1)
    for wrong, said in (
        ("lean_deg = 99.0", "lean_deg = 99"),
        ("", "'lean_deg' is missing"),
        ('lean_deg = 1.0\nplane = "XY"', "'plane'"),
    ):
        (folder / "campaign.toml").write_text(CAMPAIGN.replace("lean_deg = 25.0", wrong))
        with pytest.raises(mjsim.InputError, match=said):
            mjsim.read_campaign(folder)


def test_simulation_import_comparison_plots_export_and_nc(folder, tmp_path):
    run("simulate", folder, "--out", tmp_path / "out")
    assert (tmp_path / "out" / "leaning.png").stat().st_size > 10_000 and (tmp_path / "out" / "nodding.png").is_file()
    for name in ("leaning", "nodding"):
        time, deviation = np.loadtxt(tmp_path / "out" / f"{name}.csv", delimiter=",", skiprows=1, usecols=(0, 2)).T
        lo, hi = Program(
            next(t for t in mjsim.read_campaign(folder, traces=False).tests if t.name == name)
        ).measured_span
        keep = (time >= lo) & (time <= hi)
        noise = 0.1 * np.random.default_rng(1).standard_normal(keep.sum())
        rows = np.column_stack([time[keep], deviation[keep] + noise])
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="time_s,deviation_um", comments="", fmt="%.6f")
        run("import", tmp_path / f"{name}.csv", "--campaign", folder, "--test", name)
    compared = json.loads(run("compare", folder, "--json").stdout)
    leaning, nodding = compared["tests"]
    assert leaning["rms_um"] < 0.2 and nodding["rms_um"] < 0.2
    assert leaning["iso230_4"]["measured"]["circular_error_um"] > 0.0 and not nodding["iso230_4"]
    assert all((folder / ".mjsim" / "compare" / f"{n}.png").is_file() for n in ("leaning", "nodding"))
    run("export", folder, "--out", tmp_path / "tables")
    assert (tmp_path / "tables" / "leaning.csv").is_file()
    for name in ("leaning", "nodding"):
        run("nc", folder, "--test", name, "-o", tmp_path / f"{name}.nc")
        run("nc", "read", tmp_path / f"{name}.nc", "--campaign", folder, "--test", name)


def test_an_own_kind_is_planned_with_the_others(folder):
    tests = mjsim.read_campaign(folder, traces=False).tests
    proposed = [t for t in first_round(tests) if t.kind == "leaning_circle"]
    assert {t.name for t in proposed} == {
        f"leaning-circle{lean}-centre-ccw-f{feed}" for lean in (20, 40) for feed in (1000, 4000)
    }
    around = list(neighbours(proposed[0]))
    assert any(t.direction == "CW" for t in around) and any(t.more["lean"] < 0 for t in around)
