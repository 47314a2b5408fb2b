"""A probed sphere: reading, mistakes, comparison, diagnosis, planning and correction, on points of the independent
generator.
"""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from commands import printed as run
from commands import read, well_labelled

import mjsim
from mjsim.commands.any_instrument import compare_plainly
from mjsim.errors import InputError
from mjsim.inference.at_rest import RestProblem, RestSearch
from mjsim.inference.posterior import Posterior
from mjsim.instruments.sphere.instrument import SphereProbe, circle_through, location_errors, read_points, trace_text
from mjsim.instruments.sphere.mistakes import sphere_mistakes
from mjsim.plots.comparison import points_figure
from mjsim.units import DEG, UM
from tests.independent import sphere

SEED = 1


def nothing(errors):
    """The same errors, all zero."""
    if isinstance(errors, dict):
        return {k: nothing(v) for k, v in errors.items()}
    if isinstance(errors, (list, tuple)):
        return type(errors)(v if isinstance(v, int) else nothing(v) for v in errors)
    return 0.0 * errors


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A machine of the typical class, probed at 34 points; its location errors are in the fixture ``truth``."""
    path = tmp_path_factory.mktemp("probed")
    sphere.write(path, SEED)
    return path


@pytest.fixture(scope="module")
def diagnosed(folder):
    return mjsim.diagnose(*read(folder))


@pytest.fixture
def spoiled(folder, tmp_path):
    """Writes the campaign with a changed trace and gives its folder."""

    def write(change, **keys):
        for name in ("campaign.toml", "machine.toml"):
            (tmp_path / name).write_bytes((folder / name).read_bytes())
        head, *rows = (folder / "traces" / "points.csv").read_text().splitlines()
        table = np.array([[float(v) for v in r.split(",")] for r in rows])
        names = head.split(",")
        change(table, names)
        lines = [",".join(names), *(",".join(f"{v:.4f}" for v in row) for row in table)]
        (tmp_path / "traces").mkdir(exist_ok=True)
        (tmp_path / "traces" / "points.csv").write_text("\n".join(lines))
        return tmp_path

    return write


# -- reading and mistakes ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("head", "row", "message"),
    [
        ("X_mm,Y_mm,Z_mm,A_deg,C_deg,dx_um,dy_um", "1,2,3,4,5,6,7", "line 1: the column dz_um is missing"),
        ("X_mm,Y_mm,Z_mm,A_deg,C_deg,dx_um,dy_um,dz_mm", "1,2,3,4,5,6,7,8", "line 1: column 'dz_mm'; allowed: X_mm"),
        ("time_s,dx_um,dy_um,dz_um", "0,1,2,3", "as in the recording of an R-test"),
        ("X_mm,Y_mm,Z_mm,A_deg,C_deg,dx_um,dy_um,dz_um,from_A", "1,2,3,4,5,6,7,8,2", "line 2: from_A = 2; allowed: 1"),
        ("X_mm,Y_mm,Z_mm,A_deg,C_deg,dx_um,dy_um,dz_um", "1,2,3,4,5,6,7,eight", "line 2: dz_um = 'eight'"),
    ],
)
def test_wrong_files_are_named(folder, tmp_path, head, row, message):
    campaign, _ = read(folder)
    (tmp_path / "p.csv").write_text("\n".join([head, *[row] * 4]))
    with pytest.raises(InputError, match=message.replace("(", r"\(")):
        read_points(tmp_path / "p.csv", campaign.tests[0])


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("sphere_mm = [1.0, 2.0]", "sphere_mm"),
        ("angles_deg = [[1.0, 2.0, 3.0]]", "2 numbers a row, the angles of A, C"),
        ("angles_deg = [[1.0, 2.0]]\napproach = [[1, 0]]", "approach"),
        ("angles_deg = [[1.0, 2.0]]\nspindle_deg = [0.0, 1.0]", "spindle_deg has 2 entries for 1 rows"),
    ],
)
def test_wrong_tables_are_named(folder, tmp_path, key, message):
    (tmp_path / "machine.toml").write_bytes((folder / "machine.toml").read_bytes())
    sphere_key = "" if key.startswith("sphere") else "sphere_mm = [110.0, 20.0, 90.0]\n"
    (tmp_path / "campaign.toml").write_text(
        f'name = "x"\n[instrument]\nkind = "sphere"\n[[test]]\nname = "p"\nkind = "sphere"\n{sphere_key}{key}\n'
    )
    with pytest.raises(InputError, match=message):
        mjsim.read_campaign(tmp_path)


def test_another_instrument_has_no_repeatability(folder, tmp_path):
    (tmp_path / "machine.toml").write_bytes((folder / "machine.toml").read_bytes())
    text = (folder / "campaign.toml").read_text().replace('kind = "sphere"\nrepeat', 'kind = "ball_bar"\nrepeat', 1)
    (tmp_path / "campaign.toml").write_text(text)
    with pytest.raises(InputError, match="repeatability_um only with kind = 'r_test' or 'sphere'"):
        mjsim.read_campaign(tmp_path, traces=False)


def test_a_trace_goes_round(folder, tmp_path):
    campaign, _ = read(folder)
    (test,) = campaign.tests
    (tmp_path / "p.csv").write_text(trace_text(test, campaign.traces[test.name]))
    again = read_points(tmp_path / "p.csv", test)
    for name in ("position", "deviation", "side", "spindle"):
        assert np.allclose(getattr(again, name), getattr(campaign.traces[test.name], name), atol=1e-9)


def _exchanged(first, second):
    def change(table, names):
        i, j = names.index(first), names.index(second)
        table[:, [i, j]] = table[:, [j, i]]

    return change


def _times(name, factor):
    def change(table, names):
        table[:, names.index(name)] *= factor

    return change


def _millimetres(table, names):
    table[:, names.index("dx_um") : names.index("dz_um") + 1] *= 1e-3


def _elsewhere(table, names):
    table[:, names.index("Z_mm")] += 120.0


def _both(*changes):
    def change(table, names):
        for one in changes:
            one(table, names)

    return change


def _higher(mm):
    def change(table, names):
        table[:, names.index("dz_um")] += 1e3 * mm

    return change


def _centres(change):
    """The same of the measured centres, beside commanded positions that are right."""

    def changed(table, names):
        found, first = table.copy(), names.index("dx_um")
        found[:, :3] += 1e-3 * table[:, first : first + 3]
        change(found, names)
        table[:, first : first + 3] = 1e3 * (found[:, :3] - table[:, :3])

    return changed


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_times("A_deg", -1.0), "the sign of A is turned"),
        (_both(_times("A_deg", -1.0), _times("C_deg", -1.0)), "the sign of A and C is turned"),
        (_exchanged("X_mm", "Y_mm"), "X and Y are exchanged"),
        (_times("C_deg", DEG), "the rotary axes are in rad"),
        (_elsewhere, "Z is 120.0 mm too large everywhere, such as by the length of the probe"),
        (_exchanged("dy_um", "dz_um"), "dy is dz, dz is dy of the file"),
        (_times("dx_um", -1.0), "dy is minus dy, dz is minus dz of the file"),
        (_millimetres, "change by less than one probed centre repeats"),
        (_centres(_exchanged("X_mm", "Y_mm")), "X and Y are exchanged"),
        (_centres(_times("Y_mm", -1.0)), "the sign of Y is turned"),
        (_centres(lambda t, _: np.divide(t[:, :3], 25.4, out=t[:, :3])), "the linear axes are in inch"),
        (_centres(_elsewhere), "mm too large everywhere, such as by the length of the probe"),
        (_higher(0.5), "0.5 mm too far towards the spindle, as with a wrong length of the probe or radius of tip"),
        (lambda t, _: np.multiply(t[:, 5:8], 1e3, out=t[:, 5:8]), "the deviations are in nm"),
    ],
)
def test_mistakes_are_named(spoiled, change, message):
    def changed(table, names):
        if message.endswith("rad"):
            table[:, names.index("A_deg")] *= DEG
        change(table, names)

    where = spoiled(changed)
    (mistake,) = json.loads(run("check", where, "--json"))["mistakes"]
    assert message in mistake["sentence"]
    assert "or say --as-is" in " ".join(run("diagnose", where, code=1).split())


def test_no_mistake_where_there_is_none(folder):
    assert json.loads(run("check", folder, "--json"))["mistakes"] == []


NUMBER = r"([+\u2212-]?[0-9][0-9.]*)"


def decimals(text):
    """Decimals of a printed number; an integer may stand for tens."""
    return len(text.partition(".")[2])


def test_every_number_of_a_report_has_the_digits_of_its_uncertainty(folder, tmp_path):
    """Every interval and every expanded uncertainty of the page: half of it has two digits, and the number as many
    decimals. What is known to tens only ends in a zero.
    """
    run("report", folder, "-o", tmp_path / "r.html")
    page = re.sub(r"<(script|style|svg)\b.*?</\1>", "", (tmp_path / "r.html").read_text(), flags=re.DOTALL)
    rows = [re.sub(r"<[^>]+>", " ", row) for row in re.findall(r"<tr[^>]*>(.*?)</tr>", page, flags=re.DOTALL)]
    told = [m for row in rows for m in re.findall(rf"{NUMBER}\s+{NUMBER} to {NUMBER}", row)]
    halves = [m for row in rows for m in re.findall(rf"{NUMBER} ± {NUMBER}", row)]
    assert len(told) >= 8 and len(halves) >= 40
    for value, low, high in told:
        assert len(set(map(decimals, (value, low, high)))) == 1
        half = 0.5 * (float(high) - float(low)) * 10 ** decimals(value)
        assert 9.0 <= half, (value, low, high)  # ends are rounded: half a last digit each
        assert half <= 100.5 or ("." not in value and value[-1] == low[-1] == high[-1] == "0"), (value, low, high)
    for value, half in halves:
        assert decimals(value) == decimals(half)
        digits = round(float(half) * 10 ** decimals(half))
        assert 10 <= digits <= 99 or ("." not in half and half[-1] == value[-1] == "0"), (value, half)


# -- comparison --------------------------------------------------------------------------------------------------------


def effects_of(machine, errors):
    return [mjsim.make_effect(t.pop("id"), machine.chain, **t) for t in sphere.tables(errors)]


@pytest.mark.parametrize("kind", ["location", "square", "straight", "scale", "waves", "play", "motion"])
def test_the_model_with_the_true_errors_explains_all(tmp_path, kind):
    """mjsim and the generator, which shares no code with it, mean the same by every kind of error."""
    drawn = sphere.draw(np.random.default_rng(5))
    errors = nothing(drawn) | {kind: drawn[kind]}
    sphere.write(tmp_path, 3, errors, noise=1e-12)
    campaign, machine = read(tmp_path)
    before, after = (
        compare_plainly(campaign, machine),
        compare_plainly(campaign, machine.with_effects(effects_of(machine, errors))),
    )
    assert before.rms > 0.2 * UM and after.rms < 0.015 * UM


def test_sides_decide_on_play(tmp_path):
    """Without play both sides agree; with it, the points of one place differ by the play's width."""
    drawn = nothing(sphere.draw(np.random.default_rng(5)))
    errors = drawn | {"play": {"A": 0.0, "C": 0.01 * DEG}}
    sphere.write(tmp_path, 3, errors, [(0.0, 30.0), (0.0, 90.0), (0.0, 30.0), (0.0, 0.0), (0.0, 90.0)], noise=1e-12)
    campaign, _ = read(tmp_path)
    points = campaign.traces["points"]
    assert points.side[:, 1].tolist() == [1.0, 1.0, -1.0, -1.0, 1.0]
    apart = np.linalg.norm(points.deviation[0] - points.deviation[2])
    assert apart == pytest.approx(0.01 * DEG * np.hypot(0.11, 0.02), rel=0.01)


def test_circles(tmp_path):
    centre, direction, radius = circle_through(
        np.array([[1.0 + np.cos(a), 2.0 + np.sin(a), 3.0] for a in (0.0, 1.0, 2.5)]),
        np.array([0.0, 0.0, 1.0]),
    )
    assert np.allclose(centre, [1, 2, 3]) and np.allclose(direction, [0, 0, 1]) and radius == pytest.approx(1.0)
    drawn = sphere.draw(np.random.default_rng(5))
    sphere.write(tmp_path, 3, nothing(drawn) | {"location": drawn["location"]}, noise=1e-12, both_spindles=False)
    campaign, _ = read(tmp_path)
    found = location_errors(campaign.measured, campaign.traces)
    tip = 10e-6  # circles take the probe for calibrated, which it is within some 10 µm
    for name, true in drawn["location"].items():
        assert found[name] == pytest.approx(true, abs=4.0 * tip if name[1] in "XYZ" else 0.5e-6)


# -- diagnosis ---------------------------------------------------------------------------------------------------------


def located(result):
    rows = [(c.effect.effect, c.ci95) for c in result.calibration] + [(e.effect, e.ci95) for e in result.effects]
    return {e.subject: next(iter(ci.values())) for e, ci in rows if e.kind == "axis_location"}


def test_a_machine_of_the_class(folder, diagnosed):
    true = sphere.draw(np.random.default_rng(SEED))["location"]
    found = located(diagnosed)
    assert set(found) == set(true)
    inside = [low <= true[name] / UM <= high for name, (low, high) in found.items()]
    assert sum(inside) >= 7
    assert diagnosed.verdict == "nothing_found" and diagnosed.at_rest[0].misfit < 0.5
    assert diagnosed.after.rms < diagnosed.at_rest[0].noise < 0.2 * diagnosed.before.rms
    half = {name: 0.5 * (high - low) for name, (low, high) in found.items()}
    assert half["EY0A"] < 1.0 and half["EZ0A"] > 8.0  # the probe's length hides the height of the table
    data = json.loads(run("diagnose", folder, "--json"))
    assert data["verdict"] == "nothing_found" and data["sphere_tests"]["noise_source"] == "stated"
    assert {row["id"].partition(".")[2] for row in data["sphere_tests"]["classical"]} == set(true)
    text = run("diagnose", folder)
    assert "from circles" in text and "probe_x_um" in text and "mjsim explain" not in text


def test_a_displaced_axis_is_named(tmp_path):
    errors = sphere.draw(np.random.default_rng(2))
    errors["location"]["EY0C"] = 60e-6
    sphere.write(tmp_path, 2, errors)
    result = mjsim.diagnose(*read(tmp_path))
    assert result.verdict == "identified" and result.effects[0].effect.id == "axis_location.EY0C"
    low, high = located(result)["EY0C"]
    assert low < 60.0 < high and high - low < 3.0 and result.effects[0].probability > 0.95


def test_what_is_in_no_model_is_unknown(tmp_path):
    """Every place has an error of its own, far beyond the noise: nothing is identified, and intervals grow."""
    rng = np.random.default_rng(9)
    sphere.write(tmp_path, 2, extra=lambda angles: rng.normal(0.0, 5e-6, (len(angles), 3)))
    result = mjsim.diagnose(*read(tmp_path))
    assert result.verdict == "unknown" and result.at_rest[0].misfit > 0.95 and result.at_rest[0].left > 2.5 * UM
    low, high = located(result)["EY0C"]
    assert high - low > 4.0
    assert result.probabilities["identified"] < 0.05


def test_one_fit_of_two_set_ups_is_one_after_the_other(tmp_path, monkeypatch):
    """What one recording says, taken as the normal distribution of its numbers without priors, and then the other: the
    same as both at once. So points are joined with a ball bar.
    """
    # both halves share the probe, which one after the other cannot say: here it is known, and has no error
    monkeypatch.setattr("mjsim.instruments.sphere.instrument.LOBES", 1e-12)
    rows = sphere.Probed.rows
    monkeypatch.setattr(sphere.Probed, "rows", lambda *args: rows(*args[:6], None, *args[7:]))
    errors = sphere.draw(np.random.default_rng(4))
    sphere.write(tmp_path, 4, errors)
    campaign, machine = read(tmp_path)
    (test,) = campaign.tests
    points, probe = campaign.traces["points"], replace(campaign.instrument, offset=1e-9)
    cut = len(points.position) // 2

    def half(at, name):
        part = replace(
            points, **{k: getattr(points, k)[at] for k in ("position", "deviation", "side", "spindle", "time", "run")}
        )
        return replace(test, name=name, setup=name), part

    parts = [half(slice(0, cut), "first"), half(slice(cut, None), "second")]
    made = [
        replace(
            campaign,
            tests=tuple(t for t, _ in some),
            traces={t.name: p for t, p in some},
            instruments={"sphere": probe},
        )
        for some in (parts, parts[:1], parts[1:])
    ]

    def fit(campaign, known=None):
        search = RestSearch(RestProblem.of(campaign), machine, known)
        return search._first([c.free for c in search.expected])

    whole, first = fit(made[0]), fit(made[1])
    then = fit(made[2], Posterior.of(first))
    of = {f.effect.key: f for f in whole.effects}
    for f in then.effects:
        spread = np.sqrt(np.diag(whole.covariance_of(of[f.effect.key])))
        assert f.vector == pytest.approx(of[f.effect.key].vector, abs=0.02 * spread.min())
        assert np.sqrt(np.diag(then.covariance_of(f))) == pytest.approx(spread, rel=0.01)


# -- everything around it ----------------------------------------------------------------------------------------------


def test_import(folder, tmp_path):
    """A protocol of another layout, with German words, decimal commas and measured centres, gives the same points."""
    campaign, _ = read(folder)
    points = campaign.traces["points"]
    found = (points.position[:, :3] + points.deviation) * 1e3
    rows = [
        ";".join(f"{v:.5f}".replace(".", ",") for v in (*a / DEG, *p, s / DEG))
        for a, p, s in zip(points.position[:, 3:], found, points.spindle, strict=True)
    ]
    (tmp_path / "p.txt").write_text("Kugel\nA [°];C [°];X ist [mm];Y ist [mm];Z ist [mm];Spindle\n" + "\n".join(rows))
    (tmp_path / "machine.toml").write_bytes((folder / "machine.toml").read_bytes())
    (tmp_path / "campaign.toml").write_text('name = "mine"\n')
    order = ("import", tmp_path / "p.txt", "--campaign", tmp_path, "--points", "--test", "ball")
    assert "say where the sphere is: --sphere X Y Z" in " ".join(run(*order, code=1).split())
    order = (*order, "--sphere", 110, 20, 90)
    shown = json.loads(run(*order, "--preview", "--json"))["points"][0]
    assert shown["points"] == 34 and not (tmp_path / "traces").exists() and shown["questions"] == []
    run(*order)
    again = mjsim.read_campaign(tmp_path).traces["ball"]
    assert np.allclose((again.position[:, :3] + again.deviation) * 1e3, found, atol=2e-5)
    (tmp_path / "q.csv").write_bytes((folder / "traces" / "points.csv").read_bytes())
    run("import", tmp_path / "q.csv", "--campaign", tmp_path, "--points", "--test", "ball", "--force")
    again = mjsim.read_campaign(tmp_path).traces["ball"]
    assert np.array_equal(again.side, points.side) and np.allclose(again.spindle, points.spindle)
    text = run(*order[:7], "--signal", "dx=3:kg", code=1)
    assert "unit 'kg'" in text


def test_import_keeps_the_plan(folder, tmp_path):
    """A table of planned positions needs no sides and no angles of the spindle; one of other positions gets none."""
    campaign, _ = read(folder)
    points = campaign.traces["points"]
    planned = replace(
        campaign.tests[0],
        trace=None,
        angles=tuple(map(tuple, points.position[:, 3:])),
        spindle=tuple(points.spindle),
        approach=tuple(tuple(map(int, -row)) for row in points.side),
    )
    columns = dict(zip("AC", points.position[:, 3:].T, strict=True))
    columns |= dict(zip(("dx", "dy", "dz"), points.deviation.T, strict=True))
    kept, notes = SphereProbe().from_columns(tmp_path, planned, columns)
    assert np.array_equal(kept.side, -points.side) and np.allclose(kept.spindle, points.spindle)
    assert any("from_A, from_C, spindle: as planned" in n for n in notes)
    other, notes = SphereProbe().from_columns(tmp_path, planned, {k: v[::-1] for k, v in columns.items()})
    assert not other.spindle.any() and not any("as planned" in n for n in notes)


def test_a_new_campaign_has_planned_positions_without_an_editor(tmp_path):
    folder = tmp_path / "mine"
    run("new", "campaign", folder, "--instrument", "sphere")
    run("plan", folder, "--points", 12, "--range", "A", -90, 30, "--write")
    (test,) = mjsim.read_campaign(folder).tests
    assert test.name == "ball" and len(test.angles) == len(test.approach) == len(test.spindle) == 12
    assert "measured from where A and C meet" in (folder / "campaign.toml").read_text()  # comments stay
    assert "--write needs --points or --targets" in run("plan", folder, "--write", code=2)


def test_plan_and_positions(folder, tmp_path):
    data = json.loads(run("plan", folder, "--points", 24, "--range", "A", -90, 30, "--json"))
    test = data["test"]
    assert len(test["angles_deg"]) == len(test["approach"]) == 24
    assert {tuple(a) for a in test["approach"]} == {(1, 1), (-1, -1)}
    assert all(-90 <= a <= 30 for a, _ in test["angles_deg"])
    known = {r["id"]: r["half_width95"] for r in data["location_errors"]}
    assert known["axis_location.EY0A"] < 1.5 and known["axis_location.EC0A"] < 12.0
    for name in ("machine.toml", "campaign.toml"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "traces").mkdir()
    (tmp_path / "traces" / "points.csv").write_bytes((folder / "traces" / "points.csv").read_bytes())
    import tomlkit

    text = (tmp_path / "campaign.toml").read_text()
    (tmp_path / "campaign.toml").write_text(text + "\n" + tomlkit.dumps({"test": [test]}))
    said = run("nc", tmp_path, "--test", "sphere", "-o", tmp_path / "positions.nc", code=1)
    assert "which is measured at rest, are written as .csv, not as '.nc'" in " ".join(said.split())
    assert not (tmp_path / "positions.nc").exists()
    run("nc", tmp_path, "--test", "sphere", "-o", tmp_path / "positions.csv")
    head, *rows = (tmp_path / "positions.csv").read_text().splitlines()
    assert head == "X_mm,Y_mm,Z_mm,A_deg,C_deg,from_A,from_C,spindle_deg" and len(rows) == 24
    assert json.loads(run("check", tmp_path, "--json"))["not_measured"] == ["sphere"]


def test_compensate(folder, tmp_path, diagnosed):
    data = json.loads(run("compensate", folder, "--control", "heidenhain", "-o", tmp_path / "files", "--json"))
    assert "kinematics.tab" in data["files"] and set(data["kinematics"]) <= set(located(diagnosed))
    assert data["forecast"]["rms_after_um"] < 0.25 * data["forecast"]["rms_before_um"]
    said = (tmp_path / "files" / "corrections.txt").read_text()
    assert "data: 1 touch probe test" in said and "pitch_error.X" not in said.partition("Left:")[0]


def test_report_plots_and_workbench(folder, tmp_path):
    data = json.loads(run("report", folder, "-o", tmp_path / "page.html", "--json"))
    assert data["verdict"] == "nothing_found" and len(data["located"]) == 8
    page = (tmp_path / "page.html").read_text()
    assert "From circles" in page and "data:image/png" in page
    plots = json.loads(run("compare", folder, "--json", "--out", tmp_path / "plots"))["plots"]
    assert [p.rpartition("/")[2] for p in plots] == ["points.png"]
    bench = mjsim.open_workbench(folder)
    before = bench.quick().rms
    bench.set("axis_location.EY0A", value_um=5.4)
    assert bench.quick().rms < before


def test_the_picture_is_well_labelled(folder):
    (part,) = mjsim.compare(*read(folder)).parts
    assert well_labelled(points_figure(part.tests[0]))


def test_repeats_give_the_noise(folder):
    campaign, _ = read(folder)
    (test,), points = campaign.tests, campaign.traces["points"]
    rng = np.random.default_rng(1)

    def twice(values):
        return np.concatenate([values, values])

    noise = rng.normal(0.0, 2e-6, (2 * len(points.position), 3))
    both = replace(
        points,
        **{k: twice(getattr(points, k)) for k in ("position", "side", "spindle", "time", "run")},
        deviation=twice(points.deviation) + noise,
    )
    scatter, freedom = both.scatter
    probe = campaign.instrument.with_scatter(scatter, freedom)
    assert freedom == 3 * 34 and probe.source == "repeated points" and probe.noise == pytest.approx(2e-6, rel=0.15)
    assert sphere_mistakes([test], {"points": points}, probe) == []
