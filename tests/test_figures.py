"""`mjsim figures`: the paper's figures 3 to 17 and its numbers, once for all tests."""

import csv
import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from mjsim.cli.main import main
from mjsim.paper.contents import OFFSET_LOOK, POLAR
from mjsim.paper.figures import NUMBERS, targets
from mjsim.paper.runs import Run

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder and JSON of one run."""
    out = tmp_path_factory.mktemp("paper") / "figures"
    result = CliRunner().invoke(main, ["figures", "--out", str(out), "--json", "--quiet"])
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    return out, json.loads(result.stdout)


def test_every_figure_is_there_as_png_and_svg(made):
    out, data = made
    assert sorted(p.name for p in out.iterdir()) == sorted(p.name for p in targets(out))
    assert len(data["files"]) == 2 * 15 + 1
    for n in range(3, 18):
        with Image.open(out / f"fig{n:02d}.png") as image:
            assert min(image.size) >= 500
            grey = np.asarray(image.convert("L"))
        assert 0.005 < np.mean(grey < 200) < 0.3  # something is drawn, and it is no blot
        assert ET.parse(out / f"fig{n:02d}.svg").getroot().tag.endswith("svg")


def test_every_printed_number_has_a_simulated_one_that_agrees(made, paper):
    _, data = made
    found = {(n["group"], n["name"]): n for n in data["numbers"]}
    assert set(found) == {(g, k) for g, entries in paper.items() for k in entries}
    for (group, name), n in found.items():
        assert n["agrees"], n
        said = paper[group][name]
        assert n["printed"] == (said["value"] if isinstance(said, dict) else said)


def test_numbers_as_csv(made):
    out, data = made
    rows = list(csv.DictReader((out / "numbers.csv").open()))
    assert [r["name"] for r in rows] == [n["name"] for n in data["numbers"]]
    assert {r["agrees"] for r in rows} == {"yes"}


def test_scales_angles_and_panels_are_the_captions(paper):
    """µm per division, cones, offsets and number of plots as the paper's captions give them."""
    by_number = {f.number: f for f in POLAR}
    assert set(by_number) | {3, 4, 9} == set(NUMBERS)
    scales = {n: {p.um_per_div for p in f.panels} for n, f in by_number.items()}
    assert scales == {n: {5.0} if n in (7, 8) else {10.0} for n in by_number}
    assert {n: len(f.panels) for n, f in by_number.items()} == {
        5: 3,
        6: 3,
        7: 1,
        8: 2,
        10: 2,
        11: 2,
        12: 2,
        13: 2,
        14: 2,
        15: 2,
        16: 4,
        17: 4,
    }
    assert {r.theta for n in (5, 7, 8, 10, 11) for r in by_number[n].runs} == {15}
    assert {r.theta for n in (6, 12, 13, 14, 15, 16, 17) for r in by_number[n].runs} == {45}
    assert {(r.x, r.y) for r in by_number[8].runs} == {(v, 0) for v in (-200, -50, 50, 200)} | {
        (0, v) for v in (-200, -50, 50, 200)
    }
    assert {(r.x, r.y) for r in by_number[16].runs} == {(200, 0)} and {(r.x, r.y) for r in by_number[17].runs} == {
        (0, 200)
    }
    assert {r.method for r in by_number[17].runs} == {"perpendicular", "parallel"}
    test = Run("all", 45, 50).test()
    assert test.table_ball == pytest.approx((0.05, 0.0, paper["bar"]["ZT_mm"] / 1e3))
    assert test.length == pytest.approx(paper["bar"]["length_mm"] / 1e3)
    assert test.feed * 60e3 == pytest.approx(paper["bar"]["feed_mm_per_min"])
    assert np.degrees([test.half_apex, test.inclination]) == pytest.approx([45.0, 30.0])


def test_offsets_differ_without_colour():
    """Positive and negative offsets of one size differ in their lines as well."""
    assert all(OFFSET_LOOK[v][1] != OFFSET_LOOK[-v][1] for v in (50, 200))


def refused(*args):
    result = CliRunner().invoke(main, ["figures", *map(str, args)])
    assert result.exit_code == 1 and result.stdout == ""
    assert result.stderr.count("\n") == 1
    return result.stderr


def test_a_figure_that_the_paper_does_not_simulate(tmp_path):
    assert "no figure 2; allowed: 3 to 17" in refused("--out", tmp_path / "x", "--only", 2)
    assert not (tmp_path / "x").exists()


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "fig07.svg").write_text("mine")
    assert "fig07.svg: exists already" in refused("--out", tmp_path, "--only", 7)
    assert [p.name for p in tmp_path.iterdir()] == ["fig07.svg"]
    assert (tmp_path / "fig07.svg").read_text() == "mine"
