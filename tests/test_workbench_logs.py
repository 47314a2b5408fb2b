"""The workbench of axis logs, without a page: changes, fits, diagnosis, saving."""

import numpy as np
import pytest

import mjsim
from mjsim.commands.axis_log.compare import compare_logs
from mjsim.errors import InputError
from tests.independent.logs import CAMPAIGN, Axis, Control, csv, machine_toml, record, to_and_fro

CONTROL = Control()


def write(folder, ripple=0.03):
    """One axis with friction, and a torque ripple that the machine file lacks."""
    axis, command = Axis(coulomb=0.12, ripple=ripple, ripple_order=3.0, ripple_phase=0.7), to_and_fro(CONTROL.sample)
    (folder / "strokes.csv").write_text(csv(command, *record(axis, CONTROL, command, 0.02e-6)))
    (folder / "campaign.toml").write_text(CAMPAIGN)
    (folder / "machine.toml").write_text(machine_toml(axis, CONTROL, False, 0.12))
    return folder


def test_a_wave_is_switched_on_fitted_and_saved(tmp_path):
    bench = mjsim.open_workbench(write(tmp_path))
    before = bench.quick()
    assert before.rms == compare_logs(bench.campaign, bench.machine).rms > 5e-6 and bench.noise < 0.1e-6
    assert set(bench.catalogue) == {"X"} and "backlash.X" not in {e.id for e in bench.catalogue["X"]}
    bench.set("torque_ripple.X", order=3.0)
    fitted = bench.fit("torque_ripple.X")
    assert fitted.values["amplitude_Nm"] == pytest.approx(0.03, rel=0.01)
    assert fitted.values["phase_deg"] == pytest.approx(np.degrees(0.7), abs=0.5)
    low, high = bench.intervals["torque_ripple.X"]["amplitude_Nm"]
    assert low < 0.03 < high and bench.quick().rms < 0.1e-6
    assert bench.ladder.rungs[0].rms == before.rms > 50 * bench.ladder.present.rms
    assert bench.undo() and bench.effect("torque_ripple.X").values["amplitude_Nm"] != fitted.values["amplitude_Nm"]
    assert bench.redo()
    said = [s.words for s in bench.save()]
    assert "+ torque_ripple.X" in said and bench.unsaved == []
    again = mjsim.open_workbench(tmp_path)
    assert again.quick().rms < 0.1e-6 and any((tmp_path / ".mjsim").glob("machine.*.toml"))
    (tmp_path / "machine.toml").write_text((tmp_path / "machine.toml").read_text() + "\n# of another hand\n")
    bench.switch("torque_ripple.X", False)
    with pytest.raises(InputError, match="was changed since it was opened"):
        bench.save()


def test_bars_say_what_could_explain_the_error(tmp_path):
    """One linear step finds the ripple's order, size and phase; what is fitted leaves nothing to explain."""
    bench = mjsim.open_workbench(write(tmp_path))
    with pytest.raises(InputError, match="switch one on first"):
        bench.fit_all()
    before, bars = bench.quick().rms, bench.update_gains()
    best = max(bars, key=lambda k: bars[k].share)
    assert best == "torque_ripple.X" and bars[best].share > 0.95 and bars[best].significant
    assert set(bars) <= {e.id for e in bench.catalogue["X"]}
    bench.switch(best)
    assert bench.gains_are_old
    assert bench.effect(best).values["order"] == pytest.approx(3.0, abs=0.05)
    assert bench.effect(best).values["amplitude_Nm"] == pytest.approx(0.03, rel=0.1)
    assert bench.quick().rms < 0.2 * before
    assert [e.id for e in bench.fit_all()] == [best] and bench.ladder.present.label == "fit all"
    assert bench.quick().rms < 0.1e-6
    assert max(bar.share for bar in bench.update_gains().values()) < 0.01


def test_bars_of_a_sound_axis_stay_empty(tmp_path):
    bars = mjsim.open_workbench(write(tmp_path, 0.0)).update_gains()
    assert bars and not any(bar.significant for bar in bars.values())


def test_numbers_that_cannot_be_fitted_are_said(tmp_path):
    bench = mjsim.open_workbench(write(tmp_path, 0.0))
    assert bench.fit("viscous_friction.X").values["ratio"] == pytest.approx(1.0, abs=0.05)
    with pytest.raises(InputError, match="exists for: X"):
        bench.fit("viscous_friction.Y")
