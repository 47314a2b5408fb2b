"""What holds for every kind of test; the template of a new campaign has one of each, at its end as comments."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mjsim
from mjsim.campaign.files import campaign_from
from mjsim.importing.into_campaign import options
from mjsim.instruments.ball_bar import files
from mjsim.instruments.ball_bar.kinds import KINDS
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.kinematics import machine_to_work, reading
from mjsim.plots.output import conditions

DOCS = Path(__file__).resolve().parent.parent / "docs"


@pytest.fixture(scope="module")
def tests(tmp_path_factory):
    file = tmp_path_factory.mktemp("kinds") / "new" / "campaign.toml"
    mjsim.new_campaign(file.parent)
    live, _, more = file.read_text().partition("# More tests.")
    file.write_text(live + re.sub(r"(?m)^# ", "", more.partition("\n")[2]))
    written = tomllib.loads(file.read_text())["test"]
    tables = {t["kind"]: t for t in reversed(written)}
    by_name = {t.name: t for t in mjsim.read_campaign(file).tests}
    keys = {kind: {k for t in written if t["kind"] == kind for k in t} for kind in tables}
    return file, {kind: by_name[t["name"]] for kind, t in tables.items()}, keys


@pytest.mark.parametrize("kind", KINDS)
def test_the_bar_keeps_its_length(tests, kind):
    test = tests[1][kind]
    program = Program(test)
    q = program.path(np.linspace(*program.ends, 721))
    assert q.shape == (721, 5)
    assert np.abs(reading(test.chain, q, np.array(test.table_ball), test.length)).max() < 1e-12


@pytest.mark.parametrize("kind", KINDS)
def test_the_angle_is_the_paths_inverse(tests, kind):
    test = tests[1][kind]
    phi = np.linspace(*Program(test).measured_ends, 721)
    off = KINDS[kind].angle(test, KINDS[kind].path(test, phi)) - phi
    assert np.abs((off + np.pi) % (2 * np.pi) - np.pi).max() < 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_the_other_direction_is_the_same_path(tests, kind):
    test = tests[1][kind]
    back = KINDS[kind].turned(test)
    assert KINDS[kind].turned(back) == test
    ends = Program(test).ends, Program(back).ends
    assert ends[0][1] - ends[0][0] == pytest.approx(-(ends[1][1] - ends[1][0]), abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_proposed_tests_are_tests_of_the_kind_with_names_of_their_own(kind):
    proposed = [replace(t, feed=0.02) for t in KINDS[kind].proposals(FIVE_AXIS, 0.1, 0.155)]
    proposed += [v for t in proposed[:2] for v in KINDS[kind].variations(t)]
    assert proposed and {t.kind for t in proposed} == {kind}
    different = {str(files.test_table(t)) for t in proposed}
    assert len({KINDS[kind].short_name(t) for t in proposed}) == len(different)
    for t in proposed:
        assert re.fullmatch(r"[a-z][a-z0-9-]*[a-z0-9]", KINDS[kind].short_name(t)) and not KINDS[kind].wrong(t)
        q = KINDS[kind].path(t, np.linspace(*Program(t).ends, 361))
        assert np.abs(reading(FIVE_AXIS, q, np.array(t.table_ball), t.length)).max() < 1e-12


def test_no_module_asks_for_a_kind_by_its_name():
    """What depends on the kind is asked of the kind."""
    package = Path(mjsim.__file__).parent
    names = re.compile(rf"""[=!]=\s*["']({"|".join(KINDS)})["']""")
    found = [
        f"{f.name}: {m[0]}"
        for f in package.rglob("*.py")
        if f.parent.name != "kinds"
        for m in names.finditer(f.read_text())
    ]
    assert not found


@pytest.mark.parametrize("kind", KINDS)
def test_the_feed_is_the_one_on_the_circle(tests, kind):
    """Arc of the spindle ball as the table sees it, or of the table ball about the axis: radius times angle. Where
    both rotary axes turn, the linear axes' fastest way.
    """
    test = tests[1][kind]
    q = KINDS[kind].path(test, np.linspace(0.5, 0.6, 1001))
    if kind == "simultaneous":
        q = KINDS[kind].path(test, np.linspace(*Program(test).ends, 20001))
        step = np.linalg.norm(np.diff(q[:, :3], axis=0), axis=1).max()
        arc = 0.1 * step * 20000 / np.ptp(Program(test).ends)
    elif kind == "rotary":
        arc = np.hypot(*test.table_ball[:2]) * 0.1
    else:
        arc = np.linalg.norm(np.diff(machine_to_work(test.chain, q, q[:, :3]), axis=0), axis=1).sum()
    assert KINDS[kind].radius(test) * 0.1 == pytest.approx(arc, rel=1e-6)


def test_a_circle_leans_about_a_diameter(tests):
    """By 90° it is the circle of another plane; φ on the diameter stays where it is; the lean is that of the normal."""
    flat = tests[1]["circular"]
    phi = np.linspace(0.0, 6.0, 50)

    def away(plane, **more):
        return KINDS["circular"].path(replace(flat, plane=plane, more=more), phi)[:, :3] - flat.table_ball

    np.testing.assert_allclose(away("XY", lean=np.pi / 2), away("ZX")[:, [2, 1, 0]], atol=1e-12)
    for about in (0.0, 1.1, -2.0):
        leaning = away("YZ", lean=0.3, lean_about=about)
        normal = np.cross(leaning[10], leaning[20])
        assert abs(normal[0]) / np.linalg.norm(normal) == pytest.approx(np.cos(0.3), abs=1e-12)
        hinge = KINDS["circular"].path(
            replace(flat, plane="YZ", more={"lean": 0.3, "lean_about": about}), np.array([about])
        )
        still = KINDS["circular"].path(replace(flat, plane="YZ"), np.array([about]))
        np.testing.assert_allclose(hinge, still, rtol=0, atol=1e-12)
    assert KINDS["circular"].plane(replace(flat, more={"lean": 0.3})) == ""
    assert "without a lean_deg" in KINDS["circular"].wrong(replace(flat, more={"lean_about": 0.3}))


@pytest.mark.parametrize("kind", KINDS)
def test_a_test_written_and_read_is_the_same(tests, kind):
    file, by_kind, _ = tests
    test = replace(by_kind[kind], spindle=np.pi)
    table = files.test_table(test) | {"started_s": test.started}
    again = campaign_from(file, {"name": "again", "test": [table]}, traces=False).tests[0]
    assert again == test


@pytest.mark.parametrize("kind", KINDS)
def test_keys_are_explained_and_have_options(tests, kind):
    keys = [k.name for k in KINDS[kind].keys]
    assert set(keys) <= tests[2][kind]
    page = (DOCS / "campaign-format.md").read_text()
    for key in keys:
        assert f"`{key}`" in page and key in options()
    assert f"`{kind}`" in page and conditions(tests[1][kind])
