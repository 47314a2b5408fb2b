"""Scores and figures of the diagnosis benchmark, on answers made by hand."""

import json
import signal
import sys
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "scripts" / "benchmarks"))
import benchmark_diagnosis
from diagnosis_figures import (
    brier_score,
    draw_reliability,
    interval_groups,
    log_score,
    median_predicted,
    reliability,
    rms_z,
)
from diagnosis_page import page, summary
from diagnosis_score import names_of, score

LIMITS = {"backlash": {"um": 0.8, "deg": 0.0008}, "friction": {"ratio": 0.4}, "pitch_error": {"um": 0.6, "deg": 0.0014}}


def finding(name, probability=None, others=(), **more):
    """A finding of the JSON of diagnose; ``others`` are ids, or pairs of id and probability."""
    alternatives = [a if isinstance(a, str) else {"id": a[0], "probability": a[1]} for a in others]
    out = {"id": name, "alternatives": alternatives, "parameters": {}, "ci95": {}} | more
    return out if probability is None else out | {"probability": probability}


def row(*effects, verdict="none", planted=(), within=(), calibration=(), unexplained=None, **answer):
    """A row of the benchmark: what was said of a machine with these causes and small errors."""
    truth = {"verdict": verdict, "effect": list(planted), "within": list(within), "tolerance": LIMITS, **answer}
    result = {"effects": list(effects), "calibration": list(calibration), "unexplained": unexplained}
    return {
        **{"name": "case", "category": "real-sound", "world": "real", "half": "tune", "noise_um": 0.1 * np.sqrt(2.0)},
        **{"answer": truth, "result": result, "seconds": 7.0},
    }


def test_both_forms_of_alternatives_are_read():
    assert names_of(finding("a", others=("b", "c"))) == ["a", "b", "c"]
    assert names_of(finding("a", 0.9, others=(("b", 0.1),))) == ["a", "b"]
    gain = {"id": "servo_gain.C", "ratio": 1.02}
    one = score(row(finding("servo_delay.C", 0.7, (("servo_gain.C", 0.3),)), verdict="effect", planted=[gain]))
    assert one.mark == "partly" and one.names == [(0.7, False), (0.3, True)] and one.findings == [(0.7, False)]
    assert score(row(finding("servo_gain.C"), verdict="effect", planted=[gain])).names == []


def test_small_errors_may_be_named_at_their_limit_or_where_none_is_stated():
    def marks(width, **answer):
        small = [{"id": "backlash.X", "width_um": width}]
        return score(row(finding("backlash.X", 0.9), within=small, **answer)).mark

    assert marks(0.5) == "wrong" and marks(0.79) == "wrong" and marks(0.81) == "right"
    assert marks(0.5, tolerance_stated=False) == "right"
    assert marks(0.73, defined_to=0.1) == "right" and marks(0.71, defined_to=0.1) == "wrong"
    friction = [{"id": "friction.A", "coulomb_Nm": 0.7}]
    high = score(row(finding("friction.A"), within=friction, friction_Nm={"A": 0.4}))
    low = score(row(finding("friction.A"), within=friction, friction_Nm={"A": 0.6}))
    assert (high.mark, low.mark) == ("right", "wrong")
    wave = [{"id": "pitch_error.C", "components": [[72.0, 0.0015, 10.0], [144.0, 0.0001, 0.0]]}]
    assert score(row(finding("pitch_error.C"), within=wave)).mark == "right"


def test_what_a_machine_does_in_part_is_neither_right_nor_wrong():
    odd = {"in_part": ["straightness.EYX"], "defined_to": 0.1}
    play = {"id": "backlash.A", "width_deg": 0.002}
    both = finding("straightness.EYX", 0.9), finding("backlash.A", 0.8)
    one = score(row(*both, verdict="effect", planted=[play], signature_rms_um=[1.0], **odd))
    assert (one.mark, one.first, one.clear, one.names) == ("right", False, [True], [(0.8, True)])
    assert score(row(*both[::-1], verdict="effect", planted=[play], signature_rms_um=[1.0], **odd)).first
    assert score(row(both[0], **odd)).mark == "right" and score(row(both[0])).mark == "wrong"
    # a sound machine that does more than the catalogue may be called unknown, an ideal one may not
    unknown = {"axes": ["X"], "variable": "position"}
    assert score(row(unexplained=unknown, **odd)).mark == "right" and score(row(unexplained=unknown)).mark == "wrong"


def test_an_unlisted_cause_beside_a_listed_one():
    play, unknown = {"id": "backlash.A", "width_deg": 0.002}, {"axes": ["X"], "variable": "position"}

    def mark(*effects, unexplained=unknown):
        return score(row(*effects, verdict="unknown", planted=[play], unexplained=unexplained, axes=["X"])).mark

    assert mark(finding("backlash.A")) == "right"
    assert mark() == "partly" and mark(finding("backlash.A"), finding("backlash.X")) == "partly"
    assert mark(finding("backlash.A"), unexplained=None) == "missed"
    assert mark(finding("backlash.X"), unexplained=None) == "wrong"


def test_numbers_inside_their_interval_and_z():
    def entry(name, value, low, high, key="width_um"):
        return finding(name, parameters={key: value}, ci95={key: [low, high]})

    small = [{"id": "backlash.X", "width_um": 0.5}, {"id": "backlash.Y", "width_um": 0.5}]
    said = [entry("backlash.X", 0.6, 0.6 - 0.196, 0.6 + 0.196), entry("backlash.Y", 0.9, 0.9 - 0.196, 0.9 + 0.196)]
    first, second = score(row(calibration=said, within=small)).numbers
    assert first.inside and not second.inside and not first.planted and not first.finding
    assert (first.z, second.z) == (pytest.approx(1.0), pytest.approx(4.0))
    # a number that is defined to a tenth of its limit: its deviation is the hypotenuse of 0.1 and 0.08
    second = score(row(calibration=said, within=small, defined_to=0.1)).numbers[1]
    assert second.z == pytest.approx(0.4 / np.hypot(0.1, 0.08)) and not second.inside
    assert score(row(calibration=said, within=small, defined_to=0.5)).numbers[1].inside
    assert not score(row(calibration=said, within=small, undefined=["backlash.X", "backlash.Y"])).numbers
    # open intervals hold what lies on their side, and have no z
    (open_one,) = score(row(calibration=[entry("backlash.X", 0.1, None, 0.4)], within=small)).numbers
    assert not open_one.inside and open_one.z is None
    # a cause that was found is not counted in the calibration as well; every wave that has an interval counts
    wave = {"id": "pitch_error.C", "components": [[72.0, 0.002, 40.0], [144.0, 0.001, 0.0]]}
    pair = [[[72.0, 0.0019, 30.0]], [[72.0, 0.0023, 50.0]]]
    found = finding("pitch_error.C", ci95={"components": pair})
    (n,) = score(row(found, verdict="effect", planted=[wave], calibration=[found])).numbers
    assert n.inside and n.planted and n.finding and n.z == pytest.approx(0.0001 / (0.0004 / 3.92))


def test_intervals_are_told_apart_by_where_they_come_from():
    play = {"id": "backlash.X", "width_um": 2.0}
    said = finding("backlash.X", parameters={"width_um": 2.1}, ci95={"width_um": [1.9, 2.3]})
    small = [{"id": "backlash.Y", "width_um": 0.5}]
    other = finding("backlash.Y", parameters={"width_um": 0.5}, ci95={"width_um": [0.4, 0.6]})
    faulty = row(said, verdict="effect", planted=[play], within=small, calibration=[other])
    rows = [row(within=small, calibration=[other]), faulty, {**faulty, "world": "wild"}]
    rows.append(row(verdict="unknown", within=small, calibration=[other], unexplained={"axes": ["X"]}, axes=["X"]))
    sizes = {name: len(numbers) for name, numbers in interval_groups([score(r) for r in rows]).items()}
    assert list(sizes.values()) == [1, 2, 1, 1, 1, 1]
    assert rms_z(score(faulty).numbers) == pytest.approx(np.sqrt((0.1 / (0.4 / 3.92)) ** 2 / 2.0))


def calibrated():
    """Names whose probabilities are true: of 100 given with p, 100 p are."""
    return [(p, k < round(100 * p)) for p in (0.1, 0.3, 0.5, 0.7, 0.9) for k in range(100)]


def test_a_reliability_diagram_of_known_probabilities():
    bins = reliability(calibrated())
    assert [(b.count, b.true) for b in bins] == [(100, 10), (100, 30), (100, 50), (100, 70), (100, 90)]
    assert [b.stated for b in bins] == pytest.approx([0.1, 0.3, 0.5, 0.7, 0.9])
    assert [b.error for b in bins] == pytest.approx([0.0] * 5, abs=1e-12)
    sure = reliability([(0.95, k < 60) for k in range(100)] + [(1.0, False), (0.2, True)])
    assert [b.count for b in sure] == [0, 1, 0, 0, 101]
    assert sure[4].error == pytest.approx((60 - 96.0) / 101) and np.isnan(sure[2].error)


def test_a_number_is_beyond_its_limit_or_not():
    def number(name, number, p, expected=0.0, limit=0.8):
        return {"id": name, "number": number, "probability_beyond": p, "expected": expected, "limit": limit}

    small = [
        {"id": "backlash.X", "width_um": 0.9},
        {"id": "friction.A", "coulomb_Nm": 0.7},
        {"id": "pitch_error.C", "components": [[72.0, 0.0015, 10.0]]},
    ]
    said = row(verdict="effect", within=small, planted=[{"id": "backlash.Y", "width_um": -0.1, "equivalent": ["a.Z"]}])
    said["result"]["budget"] = [
        number("backlash.X", "width_um", 0.7),
        number("backlash.Y", "width_um", 0.2),
        number("backlash.Z", "width_um", 0.1),  # a play that the machine does not have
        number("friction.A", "coulomb_Nm", 0.6, 0.4, 0.2),
        number("pitch_error.C", "order 72", 0.9, 0.0, 0.0014),
        number("pitch_error.C", "order 144", 0.3, 0.0, 0.0014),
        number("a.Z", "width_um", 0.5),
        number("scale_error.X", "ppm", None),
    ]
    expected = [(0.7, True), (0.2, False), (0.1, False), (0.6, True), (0.9, True), (0.3, False)]
    assert score(said).limits == expected
    said["answer"]["defined_to"] = 0.2  # on a wild machine nobody can say of a number so near its limit
    assert (0.7, True) not in score(said).limits


def test_scores_of_known_probabilities():
    p = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
    assert brier_score(calibrated(), 0) == pytest.approx(np.mean(p * (1.0 - p)))
    entropy = -np.mean(p * np.log(p) + (1.0 - p) * np.log(1.0 - p))
    assert log_score(calibrated(), 0) == pytest.approx(-entropy)
    # a cause that nobody saw is a probability of 0 that came true
    assert brier_score([(1.0, True)], 1) == pytest.approx(0.5)
    assert log_score([(1.0, True)], 1) == pytest.approx(0.5 * np.log(1e-6))


def test_a_clear_cause_that_is_not_named_counts_as_a_probability_of_zero():
    play = {"id": "backlash.X", "width_um": 2.0}
    beside = finding("backlash.Y", 0.6)
    clear = score(row(beside, verdict="effect", planted=[play], signature_rms_um=[0.31]))
    faint = score(row(beside, verdict="effect", planted=[play], signature_rms_um=[0.29]))
    assert (clear.unseen, clear.clear, faint.unseen, faint.clear, faint.first) == (1, [False], 0, [], None)


def test_the_figure_is_drawn_and_is_the_same_twice(tmp_path):
    groups = {"sound": calibrated()[:250], "wild": calibrated()[250:]}
    files = []
    for folder in ("a", "b"):
        draw_reliability(groups, tmp_path / folder / "reliability")
        files.append({f.suffix: f.read_bytes() for f in (tmp_path / folder).iterdir()})
    assert files[0] == files[1] and set(files[0]) == {".png", ".svg"} and len(files[0][".png"]) > 10_000


def test_the_page_has_every_world_and_every_miss(tmp_path):
    play = {"id": "backlash.X", "width_um": 2.0}
    right = row(finding("backlash.X", 0.97), verdict="effect", planted=[play], signature_rms_um=[0.9])
    right |= {"heldout_um": 1.0, "heldout_removed": 0.75}
    wrong = row(finding("servo_gain.Y", 0.55)) | {"name": "false alarm", "category": "null", "world": "ideal"}
    crash = {k: wrong[k] for k in ("name", "category", "half", "noise_um")} | {"world": "wild", "error": "Boom: x|y"}
    scores = [score(r) for r in (right, wrong, crash | {"name": "crashed"})]
    lines = page(scores, [], "A remark.", tmp_path)
    text = " ".join(lines)
    assert "|  | ideal | real | wild | target |" in lines
    assert "| false alarms on sound machines | 1/1 = 100.0 % [2, 100] | none | none | at most 1 % |" in lines
    assert (
        "| false alarm | nothing | wrong: servo_gain.Y |" in lines
        and "| crashed | nothing | crash: Boom: x/y |" in lines
    )
    assert "Brier score 0.1517" in text and "A remark." in text and (tmp_path / "images" / "reliability.svg").exists()
    assert "Wrong among findings of 0.95 or more: 0/1" in text
    assert median_predicted(scores) == "0.750"
    told = summary(scores)
    assert any(line.startswith("wrong   false alarm: nothing: servo_gain.Y") for line in told)
    assert not any("case" in line for line in told)  # what was answered in full is not listed
    plain = page([score(row())], [], "", tmp_path)
    assert (
        "This version of the program gives no probabilities." in plain and "Not run yet: ideal, wild machines." in plain
    )


def test_versions_before_the_last_have_a_column_and_count_nowhere_else(tmp_path):
    old = row(finding("servo_gain.Y", 0.98)) | {"name": "old alarm", "category": "null", "world": "wild", "commit": "a"}
    new = row() | {"name": "new", "category": "null", "world": "wild", "commit": "b"}
    lines = page([score(old), score(new)], [], "", tmp_path)
    assert "|  | wild | wild, versions before | target |" in lines
    assert "| false alarms on sound machines | 0/1 = 0.0 % [0, 98] | 1/1 = 100.0 % [2, 100] | at most 1 % |" in lines
    assert not any("old alarm" in line for line in lines)
    assert "This version of the program gives no probabilities." in lines


def test_the_published_half_is_run_by_whole_worlds(monkeypatch, capsys, tmp_path):
    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["benchmark_diagnosis", *arguments])
        with pytest.raises(SystemExit) as stop:
            benchmark_diagnosis.main()
        return str(stop.value)

    for choice in (["--only", "x"], ["--most", "1"], ["--category", "null"]):
        assert "the published half is run by whole worlds" in call("run", "--half", "publish", *choice)
    assert "the published half is run by whole worlds" in call(
        "write", "--half", "publish", "--folder", str(tmp_path / "f")
    )
    assert not (tmp_path / "f").exists()
    (tmp_path / "rows.jsonl").write_text(json.dumps(row() | {"half": "publish"}) + "\n")
    monkeypatch.setattr("independent.bank.cases", lambda: [SimpleNamespace(name="another", half="publish")])
    assert "1 campaigns of the published half have no answer" in call("report", "--out", str(tmp_path / "rows.jsonl"))


def test_rows_are_written_at_once_and_a_case_that_takes_too_long_is_a_crash(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(benchmark_diagnosis, "commit", lambda: "abc")
    cases = [
        SimpleNamespace(name=n, category="wild-sound", half="tune", noise_um=0.1) for n in ("quick", "slow", "odd")
    ]

    def answer(case, row):
        row["answer"] = {"verdict": "none"}
        while case.name == "slow":
            pass
        row["result"] = {"effects": [], "unexplained": None}
        assert case.name != "odd"

    out = tmp_path / "rows.jsonl"
    assert benchmark_diagnosis.run_group(cases, out, answer, 0.2, False) == 3
    quick, slow, odd = map(json.loads, out.read_text().splitlines())
    assert "error" not in quick and "out of time" in slow["error"] and "AssertionError" in odd["error"]
    assert (quick["world"], quick["commit"]) == ("wild", "abc")
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == ["right", "crash", "crash"]


def test_ctrl_c_lets_what_runs_finish(monkeypatch, capsys):
    before = signal.getsignal(signal.SIGINT)
    running, waiting, last = Future(), Future(), Future()
    running.set_running_or_notify_cancel()
    ends = []
    monkeypatch.setattr(benchmark_diagnosis.os, "_exit", ends.append)
    monkeypatch.setattr(benchmark_diagnosis.multiprocessing, "active_children", list)
    try:
        benchmark_diagnosis._stop_by_keyboard([running, waiting, last])
        signal.raise_signal(signal.SIGINT)
        assert waiting.cancelled() and last.cancelled() and not running.cancelled() and not ends
        signal.raise_signal(signal.SIGINT)
        assert ends == [1]
    finally:
        signal.signal(signal.SIGINT, before)
