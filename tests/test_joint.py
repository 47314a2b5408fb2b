"""Ball bar and axis log of one machine: what the ball bar cannot tell apart, a log of one axis decides."""

import json
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from commands import cut
from independent import machine_logs
from independent.campaign import Case

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.cli.main import main
from mjsim.commands.axis_log.judge import Judge
from mjsim.commands.diagnose import diagnose_jointly, simulated_in_motion
from mjsim.commands.finding import DiagnosedEffect
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.inference.axis_logs.data import axis_data
from mjsim.inference.axis_logs.discrepancy import discrepancy_of
from mjsim.inference.axis_logs.entries import AxisModel, KnownNumbers
from mjsim.inference.axis_logs.fit import AxisFit
from mjsim.inference.axis_logs.shared import known_numbers
from mjsim.inference.axis_logs.start import start_model
from mjsim.inference.data_sheet import data_sheet
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.posterior import CompetingModel, Posterior
from mjsim.io.resources import examples
from mjsim.machine.model import build
from mjsim.simulation.stability import check_stable

INSTRUMENTS = (
    '[instrument.bar]\nkind = "ball_bar"\n\n[instrument.control]\nkind = "axis_log"\nsample_rate_Hz = 1000.0\n'
)
CAUSES = {
    "servo_gain.C": {"id": "servo_gain.C", "ratio": 1.03},
    "servo_delay.C": {"id": "servo_delay.C", "delay_ms": -0.5},
}


def case(*hidden):
    return Case("two-candidates", "M2", (), hidden, seed=5)


def with_log(folder, *hidden, torque=False):
    """The example that leaves two candidates, with a log of C of the same hidden machine."""
    target = folder / "campaign"
    shutil.copytree(examples() / "two-candidates", target, ignore=shutil.ignore_patterns(".mjsim"))
    machine_logs.add(case(*hidden), target, "C", torque)
    return target


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    return with_log(tmp_path_factory.mktemp("mixed"), CAUSES["servo_gain.C"])


def explained_by(machine, effect_id, spread, **values):
    """A model of the ball bar with one effect that it knows within ``spread`` typical sizes."""
    effect = registry.make(effect_id, machine.chain, **values)
    free = EffectVector(effect, tuple(values))
    n = len(data_sheet(machine.chain))
    covariance = np.diag([spread**2, *np.ones(n)])
    return CompetingModel(effect_id, machine.with_effect(effect), Posterior((free,), covariance), 0.0)


def candidates(machine):
    return (
        explained_by(machine, "servo_gain.C", 0.06, ratio=1.03),
        explained_by(machine, "servo_delay.C", 0.1, delay_ms=-0.49),
    )


def judged(folder, models):
    """What the log says of a finding of the ball bar and of what it cannot be told from."""
    campaign = read_campaign(folder)
    machine = read_machine(campaign.machine_file)
    models = models(machine)
    effect = models[0].machine.effect(models[0].effect_id)
    others = tuple(m.effect_id for m in models[1:])
    found = DiagnosedEffect(effect, (), {}, 0.0, 0.0, others, (), models=models)
    bar = SimpleNamespace(machine=models[0].machine, effects=(found,))
    return Judge(campaign, machine, 1).of(bar, {})


@pytest.mark.parametrize("hidden", CAUSES)
def test_a_log_decides_between_gain_and_delay(tmp_path, hidden):
    """Slow tests see a gain that is too high as a command that is early; where the axis accelerates they differ."""
    result = judged(with_log(tmp_path, CAUSES[hidden]), candidates)
    decision = result.decisions["servo_gain.C"]
    assert decision.effect_id == hidden
    (other,) = set(CAUSES) - {hidden}
    assert decision.excluded == (other,) and decision.told == {}
    assert decision.bar[other] == 0.0 and decision.logs[other] > 500.0
    assert [e.id for e in result.machine.effects if e.id in CAUSES] == [hidden]


def test_a_log_contradicts_what_is_not_there(tmp_path):
    """A position gain that the ball bar alone believes in, and that the log of the axis does not have."""
    result = judged(with_log(tmp_path), lambda machine: candidates(machine)[:1])
    assert result.decisions == {} and result.support["servo_gain.C"] < -50.0


def test_a_log_supports_what_is_there(mixed):
    assert judged(mixed, lambda machine: candidates(machine)[:1]).support["servo_gain.C"] > 500.0


def test_what_the_ball_bar_knows_are_priors(m2):
    model = explained_by(m2, "servo_gain.C", 0.06, ratio=1.03)
    entries = {e.label: e for e in known_numbers(model, "C").entries}
    gain = entries["servo_gain.C.ratio"]
    size = registry.kinds()["servo_gain"].parameters[0].scale
    assert gain.centre == 1.03 and gain.deviation == pytest.approx(0.06 * size / 1.03)
    inertia = entries["drive.inertia"]
    assert inertia.centre == m2.drives["C"].inertia and inertia.deviation == pytest.approx(0.03)
    assert "servo_gain.C.ratio" not in {e.label for e in known_numbers(model, "X").entries}


def test_the_fit_is_that_of_the_rows_of_both(m2):
    """Of two numbers the ball bar knows their difference, and the log one of them: together they know both. Inverse
    covariance, estimate and odds are those of the stacked rows.
    """
    rng = np.random.default_rng(4)
    names = ("inertia", "velocity_gain")
    sheet = data_sheet(m2.chain)
    at = [next(i for i, p in enumerate(sheet) if (p.axis, p.name) == ("C", name)) for name in names]
    sd = np.array([sheet[i].sd for i in at])
    bar = 1e4 * rng.normal(size=(50, 1)) @ [[1.0, -1.0]] + 10.0 * rng.normal(size=(50, 2))
    log = 1e3 * np.column_stack([rng.normal(size=400), 0.05 * rng.normal(size=400)])
    covariance = np.eye(len(sheet))
    covariance[np.ix_(at, at)] = np.linalg.inv(np.diag(sd**-2.0) + bar.T @ bar) / np.outer(sd, sd)
    known = known_numbers(CompetingModel("nothing", m2, Posterior((), covariance), 0.0), "C")
    entries = tuple(e for e in known.entries if e.name in names)
    model = AxisModel(m2, "C", entries, known)
    order = [names.index(e.name) for e in entries]
    rows, noise = log[:, order], 1e-6
    truth = np.array([0.004, -0.002])
    residual = rows @ truth * noise + noise * 0.5 * rng.normal(size=len(rows))

    stacked = (np.diag(sd**-2.0) + bar.T @ bar)[np.ix_(order, order)]
    fit = AxisFit(model, (residual,), (rows * noise,), (len(rows),), (1.0 / noise,), (noise,))
    assert fit.precision == pytest.approx(stacked + rows.T @ rows, rel=1e-6)
    alone = replace(fit, model=replace(model, known=KnownNumbers()))
    second = order.index(1)
    assert fit.covariance[second, second] < 0.1 * alone.covariance[second, second]

    found = discrepancy_of(model, (residual,), (rows * noise,), (noise,), ())
    assert found.step == pytest.approx(np.linalg.solve(stacked + rows.T @ rows, rows.T @ residual / noise), rel=1e-6)
    # log evidence of the rows of the log where the ball bar has told its part, of a unit variance
    spread = np.eye(len(rows)) + rows @ np.linalg.solve(stacked, rows.T)
    y = residual / noise
    expected = -0.5 * (y @ np.linalg.solve(spread, y) + np.linalg.slogdet(spread)[1])
    assert found.evidence == pytest.approx(expected, rel=1e-6)


@pytest.mark.slow
def test_a_bar_that_knows_no_better_leaves_the_data_sheet_its_bounds(mixed, m2):
    """A number that a ball bar does not show is as uncertain for it as its class. A log may not take that for an
    explanation: what lies beyond the data sheet is a cause with a name.
    """
    data = axis_data(read_campaign(mixed).of("axis_log"), "C", m2)
    alone = {e.label: e for e in start_model(m2, data).entries}
    known = explained_by(m2, "friction.C", 1e3, coulomb_Nm=m2.effect("friction.C").values["coulomb_Nm"])
    entries = {e.label: e for e in start_model(m2, data, (), known_numbers(known, "C")).entries}
    mine, theirs = entries["friction.C.coulomb_Nm"], alone["friction.C.coulomb_Nm"]
    assert mine.deviation > theirs.deviation
    assert (mine.lower, mine.upper) == pytest.approx((theirs.lower, theirs.upper))


def test_tests_in_motion_are_simulated_without_what_only_logs_have(m2):
    """Otherwise a cause that a log has found would end the diagnosis of the ball bar beside it."""
    found = [
        registry.make("loop_delay.C", m2.chain, delay_ms=2.0),
        registry.make("servo_gain.C", m2.chain, ratio=1.03),
        registry.make("cogging.X", m2.chain, components=[[4.0, 0.1, 0.0]]),
    ]
    moving = simulated_in_motion(m2.with_effects(found))
    assert moving == m2.with_effect(found[1])
    check_stable(build(moving))


def test_two_candidates_are_resolved_by_one_log(mixed, fast_plans, tmp_path):
    cones = ("cone15-centre-ccw", "cone15-x50-ccw", "cone45-x50-ccw")  # which leave two candidates, as all tests do
    ball_bar = read_campaign(cut(tmp_path / "cones", cones, example="two-candidates"))
    logs = read_campaign(mixed).of("axis_log")
    campaign = replace(
        ball_bar,
        tests=ball_bar.tests + logs.tests,
        traces=ball_bar.traces | logs.traces,
        instruments=ball_bar.instruments | logs.instruments,
    )
    result = diagnose_jointly(campaign, read_machine(campaign.machine_file))
    data = result.to_json()
    (effect,) = data["effects"]
    assert result.effects[0].models and result.logs is not None
    assert (data["verdict"], effect["id"], effect["decided_by"]) == ("identified", "servo_gain.C", "axis_log")
    low, high = effect["ci95"]["ratio"]
    assert low < 1.03 < high and high - low < 0.002
    assert effect["alternatives"] == [] and data["next_test"] is None
    assert data["rms_after_um"] < 1.05 * data["noise_um"]
    assert {"servo_gain.C", "servo_delay.C"}.isdisjoint(data["not_testable"])
    assert "that of servo_delay.C differs by" in effect["evidence"]


def test_compare_and_check_work_on_both(mixed, tmp_path):
    folder = shutil.copytree(mixed, tmp_path / "one")
    text = (folder / "campaign.toml").read_text()
    tests = text.split("[[test]]")
    (folder / "campaign.toml").write_text("[[test]]".join([tests[0], tests[1], tests[-1]]))
    for command in (["compare", "--no-plots"], ["check"]):
        run = CliRunner().invoke(main, [command[0], str(folder), *command[1:], "--json"])
        assert run.exit_code == 0, run.output
        data = json.loads(run.stdout)
        assert [t["name"] for t in data["tests"]] == ["cone15-centre-ccw"]
        assert [t["name"] for t in data["axis_logs"]["tests"]] == ["strokes-c"]


def test_instruments_by_name(mixed, tmp_path):
    campaign = read_campaign(mixed)
    assert campaign.instruments["axis_log"].rate == 1000.0 and campaign.of("ball_bar").instrument.resolution == 0.1e-6
    text = (mixed / "campaign.toml").read_text()
    before, _, rest = text.partition("[instrument.bar]")
    tests = "[[test]]" + rest.partition("[[test]]")[2]
    machine = (mixed / "machine.toml").read_text()
    wrong = {
        '[instrument]\nkind = "ball_bar"\n': "one table for each",
        INSTRUMENTS.replace("axis_log", "ball_bar"): "allowed: one of each kind",
        '[instrument.bar]\nkind = "ball_bar"\n': "is of the kind axis_log",
    }
    for table, said in wrong.items():
        (tmp_path / "machine.toml").write_text(machine)
        (tmp_path / "campaign.toml").write_text(before + table + tests)
        with pytest.raises(InputError, match=said):
            read_campaign(tmp_path, traces=False)
    named = tests.replace('kind = "log"', 'kind = "log"\ninstrument = "control"')
    (tmp_path / "campaign.toml").write_text(before + INSTRUMENTS + named)
    assert len(read_campaign(tmp_path, traces=False).of("axis_log").tests) == 1
    (tmp_path / "campaign.toml").write_text(before + INSTRUMENTS + named.replace('"control"', '"bar"'))
    with pytest.raises(InputError, match="allowed for axis logs: 'control'"):
        read_campaign(tmp_path, traces=False)


def test_a_delay_may_stand_before_or_behind_the_recorded_command(m2):
    """Nobody knows where a control records: with a command delay, the recording's shift has room for it."""
    from mjsim.inference.axis_logs.start import nuisance_entries
    from mjsim.instruments.axis_log.measurement import LogTest

    data = [SimpleNamespace(test=LogTest("a", ("C",)), axis="C", step=1e-3, name="a", resolution=1e-6,
                            record=SimpleNamespace(actual=np.linspace(0.0, 0.1, 1000), output=None))]  # fmt: skip
    late = m2.with_effect(registry.make("servo_delay.C", m2.chain, delay_ms=3.0))
    plain, wide = (nuisance_entries(m, data)[0] for m in (m2, late))
    assert plain.deviation == 1.0 and wide.deviation == pytest.approx(np.hypot(1.0, 3.0))
    assert replace(plain, deviation=wide.deviation).scale == wide.scale
