"""The workbench without a page: what a change does to the error, the ladder, fits, saving."""

import json
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from commands import TESTS, cut

import mjsim
from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.commands.compare import compare
from mjsim.commands.history import read_history
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.temperatures import Temperatures
from mjsim.prediction.part_run import PartRun
from mjsim.workbench import catalogue, lines
from mjsim.workbench.bodies import MachineBodies
from mjsim.workbench.jobs import Stopped
from mjsim.workbench.live import Live
from mjsim.workbench.overlay import DRIVES, MULTIBODY
from mjsim.workbench.page import traces
from mjsim.workbench.save import changes
from mjsim.workbench.state import Workbench
from mjsim.workbench.tried import Ladder


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """One open campaign for all tests that write nothing."""
    return mjsim.open_workbench(cut(tmp_path_factory.mktemp("workbench") / "campaign")).shared


@pytest.fixture
def bench(shared):
    return Workbench(shared)


def test_ladder_goes_back_and_forth():
    machine = read_machine(examples() / "healthy" / "machine.toml")
    models = [machine.with_effect(registry.make("backlash.A", width_deg=0.001 * k)) for k in range(1, 6)]
    ladder = Ladder(machine)
    assert not ladder.undo() and not ladder.redo()
    ladder.push("one", models[0])
    ladder.push("two", models[1], "slider")
    ladder.push("three", models[2], "slider")  # the same slider on its way: one rung
    assert [r.label for r in ladder.rungs] == ["machine as given", "one", "three"]
    ladder.push("four", models[3], "another slider")
    assert len(ladder.rungs) == 4
    assert ladder.undo() and ladder.undo() and ladder.machine is models[0]
    assert ladder.redo() and ladder.machine is models[2]
    ladder.push("five", models[4])  # what was undone is gone
    assert [r.label for r in ladder.rungs] == ["machine as given", "one", "three", "five"] and not ladder.can_redo
    ladder.go(0)
    assert ladder.machine is machine and ladder.can_redo and not ladder.can_undo
    with pytest.raises(IndexError):
        ladder.go(4)


def test_both_engines_give_the_error_of_compare(bench, shared):
    bench.set("backlash.A", width_deg=0.001)
    quick = bench.quick()
    full = bench.full()
    said = compare(shared.opened.campaign, bench.machine, problem=shared.opened.problem)
    assert (quick.engine, full.engine) == (DRIVES, MULTIBODY)
    assert full.rms == pytest.approx(said.rms, rel=1e-9)
    assert quick.rms == pytest.approx(said.rms, rel=0.01)
    for t in said.tests:
        trace = full.traces[t.test.name]
        assert trace.rms == pytest.approx(t.rms, rel=1e-9)
        assert np.allclose(trace.residual[t.valid], t.residual[t.valid], atol=1e-15)
    assert sum(t.share for t in full.traces.values()) == pytest.approx(1.0)
    assert bench.ladder.present.rms == full.rms and bench.ladder.present.engine == MULTIBODY


def test_a_test_that_is_there_is_not_simulated_again(bench, monkeypatch):
    bench.set("backlash.A", width_deg=0.0011)
    part = bench.full([TESTS[0]])
    assert [t.engine for t in part.traces.values()] == [MULTIBODY, DRIVES, DRIVES] and part.engine == DRIVES
    bench.full()
    monkeypatch.setattr(
        sys.modules["mjsim.workbench.overlay"], "simulate_each", lambda *_: pytest.fail("simulated again")
    )
    bench.set("backlash.A", width_deg=0.3)
    bench.undo()
    bench.set("backlash.A", width_deg=0.0011)
    assert bench.full().engine == MULTIBODY


def test_switch_keeps_the_values(bench):
    bench.set("backlash.A", width_deg=0.0017)
    bench.switch("backlash.A", False)
    assert bench.effect("backlash.A") is None
    bench.switch("backlash.A")
    assert bench.effect("backlash.A").values == {"width_deg": 0.0017}
    bench.switch("friction.X", False)
    bench.switch("friction.X")
    assert bench.effect("friction.X").values["coulomb_Nm"] == 1.0
    with pytest.raises(InputError, match="out of bounds; allowed: 0 to 1 °"):
        bench.set("backlash.A", width_deg=2.0)
    with pytest.raises(InputError, match="unknown effect"):
        bench.switch("gremlin.A")


def test_every_effect_can_be_switched_on_and_has_sliders(bench):
    warm = replace(bench.machine, temperatures=Temperatures(np.arange(2.0), ("spindle",), np.zeros((2, 1))))
    for effect_id in registry.all_ids():
        effect = catalogue.switched_on(effect_id, warm)
        assert effect.id == effect_id and not effect.is_neutral
        for p in effect.parameters_of(effect.subject):
            if p.kind == "number":
                s = catalogue.slider(p, effect.values[p.name])
                assert p.lower <= s.low < s.high <= p.upper and s.low <= effect.values[p.name] <= s.high
                assert 100 <= (s.high - s.low) / s.step <= 5000
    shown = catalogue.by_axis(warm)
    assert list(shown)[: FIVE_AXIS.count] == list(FIVE_AXIS.letters)
    assert sorted(e.id for rows in shown.values() for e in rows) == sorted(registry.all_ids())
    without = {e.id for rows in catalogue.by_axis(bench.machine).values() for e in rows}
    assert without == set(registry.all_ids(sensors=False))
    assert {e.axis for rows in shown.values() for e in rows} == set(FIVE_AXIS.letters)


def test_gains_name_what_hides_and_nothing_once_it_is_in(bench):
    found = bench.update_gains()
    best = max(found, key=lambda k: found[k].share)
    assert best == "backlash.A" and found[best].share > 0.5 and found[best].significant
    bench.switch("backlash.A")
    assert bench.effect("backlash.A").values["width_deg"] == pytest.approx(0.002, rel=0.2)  # the linear estimate
    effect = bench.fit("backlash.A")
    assert effect.values["width_deg"] == pytest.approx(0.002, rel=0.02)
    low, high = bench.intervals["backlash.A"]["width_deg"]
    assert low < effect.values["width_deg"] < high
    assert bench.full().rms < 1.3 * bench.noise
    left = bench.update_gains()
    assert not any(g.significant for g in left.values())
    assert [c.words for c in bench.unsaved] == ["+ backlash.A"]
    assert [e.key for e in bench.fit_all()] == ["backlash.A"]


def test_save_writes_what_add_writes(tmp_path):
    one, other = cut(tmp_path / "one"), cut(tmp_path / "other")
    added = mjsim.add(read_campaign(one), "backlash.A")
    bench = mjsim.open_workbench(other)
    before = (other / "machine.toml").read_bytes()
    bench.add(added.effect)
    bench.full()
    assert (other / "machine.toml").read_bytes() == before and not (other / ".mjsim").exists()
    assert [c.words for c in bench.save()] == ["+ backlash.A"]
    assert (other / "machine.toml").read_text() == (one / "machine.toml").read_text()
    mine, theirs = read_history(read_campaign(other)), read_history(read_campaign(one))
    assert mine == theirs
    assert (other / ".mjsim" / "machine.001.toml").read_bytes() == before
    assert bench.save() == [] and not bench.unsaved
    bench.switch("backlash.A", False)
    with pytest.raises(InputError, match="fits worse than the file's"):
        bench.save()
    assert [c.words for c in bench.save(force=True)] == ["− backlash.A"]
    assert [s.label for s in read_history(read_campaign(other))][-1] == "- backlash.A"
    (other / "machine.toml").write_text("# mine\n" + (other / "machine.toml").read_text())
    bench.add(added.effect)
    with pytest.raises(InputError, match="was changed since it was opened"):
        bench.save()


def test_changes_lead_from_one_model_to_the_other():
    machine = read_machine(examples() / "healthy" / "machine.toml")
    after = machine.without("friction.X").with_effect(registry.make("backlash.A", width_deg=0.001))
    after = after.with_effect(machine.effect("friction.Y").replaced(coulomb_Nm=2.0))
    steps = changes(machine, after)
    assert [s.words for s in steps] == ["− friction.X", "+ friction.Y", "+ backlash.A"]
    assert steps[-1].machine.effects == after.effects and changes(machine, machine) == []


def test_without_traces_it_simulates(tmp_path):
    bench = mjsim.open_workbench(cut(tmp_path / "planned", TESTS[:1], traces=False))
    first = bench.full()
    assert first.rms is None and bench.noise is None and bench.update_gains() == {}
    bench.set("backlash.A", width_deg=0.01)
    trace = bench.quick().traces[TESTS[0]]
    assert np.ptp(trace.simulated - first.traces[TESTS[0]].simulated) > 1e-6 and trace.residual is None
    assert "not measured" in bench.show(TESTS[0]).caption
    with pytest.raises(InputError, match="no test has a trace"):
        bench.fit("backlash.A")


def test_the_part_follows_the_model(bench):
    run = PartRun("boss", (0.04, 0.01, 0.12), tolerance=1e-3)
    before = bench.predict(run)
    bench.set("squareness.XY", angle_urad=200.0)
    after = bench.predict(run)
    made = {c.key: c.rms for c in after.causes}
    assert "squareness.XY" not in {c.key for c in before.causes} and 2e-6 < made["squareness.XY"] < 8e-6
    assert "without a diagnosis" in after.basis
    with pytest.raises(InputError, match=r"nothing\.nc"):
        bench.predict(PartRun("nothing.nc"))


def test_pictures(bench):
    every = bench.show()
    assert every.html.count("<svg") == len(TESTS) and "µm (multibody), noise" in every.caption
    one = bench.show(TESTS[0])._repr_html_()
    assert one.count("<path") == 2 and "1 div.:" in one and 'class="turn"' in one
    effect = bench.show("backlash.A")
    assert effect.html.count("<svg") == 6 and "without it" in effect.caption
    with pytest.raises(InputError, match="tests: cone15"):
        bench.show("nothing.A")


def test_thinned_lines_keep_their_peaks():
    x = np.linspace(0.0, 1.0, 20001)
    y = np.sin(20 * x)
    y[7777], y[12345] = 5.0, np.nan
    a, b = lines.thinned(x, y, 100)
    assert len(a) <= 200 and np.nanmax(b) == 5.0 and np.nanmin(b) == pytest.approx(np.nanmin(y))
    assert (np.diff(a) > 0).all()
    points = lines.pairs(np.array([0.0, 123.45678]), np.array([np.nan, -0.0123456]))
    assert points[1].tolist() == [123.457, -0.01235] and np.isnan(points[0, 1])
    assert lines.pairs(np.zeros(2), np.full(2, np.nan)).shape == (2, 2)


def test_the_notebook_runs(tmp_path, monkeypatch, capsys):
    """Its cells, one after the other, on three tests; no output is kept in the file."""
    notebook = json.loads((examples() / "workbench.ipynb").read_text())
    cut(tmp_path / "hidden-backlash")
    monkeypatch.setattr("mjsim.io.resources.examples", lambda: tmp_path)
    names: dict = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [] and cell["execution_count"] is None
            exec("".join(cell["source"]), names)
    said = capsys.readouterr().out
    assert "backlash.A(width_deg=0.002" in said and "+ backlash.A" in said and names["best"][0] == "backlash.A"


def test_live_shows_drives_first_and_multibody_soon(shared):
    live = Live(Workbench(shared))
    seen = []
    try:
        live.bench.set("backlash.A", width_deg=0.00123)
        live.changed()
        limit = time.monotonic() + 60
        while not live.settled and time.monotonic() < limit:
            if live.overlay is not None and live.overlay.machine is live.bench.machine:
                seen.append(live.overlay.engine)
            time.sleep(0.002)
        assert live.settled and live.error == ""
        assert DRIVES in seen
        with pytest.raises(Stopped):
            live.run("nothing", lambda progress: (live.stop(), progress("on", 1, 2)))
        assert live.job is None and live.run("one", lambda _: 1) == 1
    finally:
        live.close()


def test_bodies_stand_where_mujoco_has_them(shared):
    """The page nests groups; put together they give MuJoCo's places."""
    test = shared.opened.tests[0]
    machine = MachineBodies(test.chain)
    posed, position = machine.posed(test), np.array([0.1, -0.05, 0.2, 0.3, 1.2])
    posed.balls(position)
    place = {"world": (np.zeros(3), np.eye(3))}
    for body in machine.bodies:
        at, turn = body.placed(position[test.chain.index(body.joint)] if body.joint else 0.0)
        if body.name == "table_fixture":
            at = np.asarray(test.table_ball)
        origin, frame = place[body.parent]
        place[body.name] = origin + frame @ at, frame @ turn
        i = posed.model.body(body.name).id
        assert np.allclose(place[body.name][0], posed.data.xpos[i], atol=1e-9), body.name
        assert np.allclose(place[body.name][1].ravel(), posed.data.xmat[i], atol=1e-9), body.name
    assert sum(len(b.solids) for b in machine.bodies) > 15 and posed.carrier == "table"
    assert machine.carrier(shared.opened.test("rotary-a-tangential-ccw")) not in ("table", "cradle")


def test_what_a_residual_is_drawn_over(bench):
    trace = bench.quick().traces[TESTS[0]]
    keys = traces.choices(bench.opened, TESTS[0])
    assert list(keys)[:2] == ["angle", "time"] and "A position" in keys and "A speed" in keys
    over = traces.abscissa(bench.opened, trace, "A position")
    assert over.label == "A position, °" and 0 < over.forward.mean() < 1
    speed = traces.abscissa(bench.opened, trace, "A speed")
    inner = slice(20, -20)
    assert np.allclose(np.gradient(over.value, trace.time)[inner], speed.value[inner], atol=0.2)
    assert len(traces.choices(bench.opened, "circle-xy-ccw")) == 6
