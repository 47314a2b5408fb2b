"""A few campaigns of the independent generator through the whole diagnosis;
``scripts/benchmarks/benchmark_diagnosis.py`` runs them all.
"""

import sys
from functools import cache
from pathlib import Path

import pytest
from independent import bank, campaign
from independent.layouts import layout

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.commands.diagnose import diagnose
from mjsim.inference.findings import explain
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.vibration import separate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "scripts" / "benchmarks"))
#: Campaigns with few tests each; other causes are looked for in the examples, in test_planning and in test_worn_worm.
CHOSEN = ("null-020", "sparse-torque_ripple.A-08")


@cache
def cases():
    """All campaigns of the bank by name."""
    return {c.name: c for c in bank.cases()}


@pytest.mark.parametrize("name", CHOSEN)
def test_a_hidden_cause_is_named(name, tmp_path, monkeypatch):
    from diagnosis_score import score

    # the next test is planned after the cause is named, and takes longer; tests/test_planning.py looks at it
    monkeypatch.setattr("mjsim.commands.diagnose.plan_for", lambda *args, **options: None)
    case = cases()[name]
    assert case.half == "tune"  # the published half is not looked at here
    answer = campaign.write(case, tmp_path)
    c = read_campaign(tmp_path)
    result = diagnose(c, read_machine(c.machine_file))
    row = {"name": name, "noise_um": case.noise_um, "answer": answer, "result": result.to_json()}
    assert score(row).mark == "right", row["result"]


def test_a_knock_that_the_waves_of_a_worm_hide_is_no_further_cause(tmp_path):
    """It comes to light once the waves are named. Four causes were named before, three of them to explain the knock."""
    hidden = {"id": "pitch_error.A", "components": [[90.0, 0.000305, 40.0], [180.0, 0.000153, 130.0]]}
    case = campaign.Case("knocks", "M2", tuple(layout("cradle")), (hidden,), outliers=6, gaps=1, seed=5)
    campaign.write_files(case, tmp_path)
    c = read_campaign(tmp_path)
    machine = read_machine(c.machine_file)
    explained = explain(separate(checked_problem(c, machine, 2), machine))
    assert [f.key for f in explained.selection.found] == ["pitch_error.A"]
    assert explained.unexplained is None
    assert sum(explained.data.outliers.values()) == 5  # the sixth lies within five times the noise


def test_the_bank_is_large_enough_and_halved():
    found = list(cases().values())
    kinds = {c.category for c in found}
    assert sum(c.category == "null" for c in found) >= 300
    assert sum(c.category != "null" for c in found) >= 200
    for kind in kinds:
        half = sum(c.half == "tune" for c in found if c.category == kind)
        assert abs(2 * half - sum(c.category == kind for c in found)) <= 4
    assert bank.cases() == found


def test_marks():
    """How an answer is judged: names, sets of equivalents, wrong confident names."""
    from diagnosis_score import score

    def row(said, truth, verdict="effect", unknown=None):
        effects = [{"id": s[0], "alternatives": list(s[1:])} for s in said]
        result = {"verdict": "nothing_found" if not said else "x", "effects": effects, "unexplained": unknown}
        return {"noise_um": 0.12, "answer": {"verdict": verdict, "effect": truth}, "result": result}

    def mark(answer):
        return score(answer).mark

    gain = {"id": "servo_gain.C", "equivalent": ["servo_delay.C"]}
    assert mark(row([("servo_delay.C", "servo_gain.C")], [gain])) == "right"
    assert mark(row([("servo_gain.C",)], [gain])) == "right"
    assert mark(row([("servo_delay.C",)], [gain])) == "wrong"
    assert mark(row([("servo_gain.C", "backlash.A")], [gain])) == "partly"
    assert mark(row([("backlash.A",)], [gain])) == "wrong"
    assert mark(row([], [gain])) == "missed"
    assert mark(row([], [], "none")) == "right"
    assert mark(row([("backlash.A",)], [], "none")) == "wrong"
    assert mark(row([], [], "unknown", {"axes": ["C"]})) == "right"
    assert mark(row([("backlash.A",)], [], "unknown", {"axes": ["C"]})) == "partly"
    assert mark(row([("backlash.A",)], [], "unknown")) == "wrong"
