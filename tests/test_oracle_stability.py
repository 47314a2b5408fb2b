"""A solver that diverges is an error with advice, never a result: no file, no log of MuJoCo's, one sentence, for
every command.
"""

import os
import re
import shutil
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from commands import refused, run

import mjsim
from mjsim.effects import registry
from mjsim.errors import SimulationError
from mjsim.machine.model import build
from mjsim.simulation import mjmodel
from mjsim.simulation.drive import STEP, SUBSTEPS, discretise, equations
from mjsim.simulation.drive import run as drive_run
from mjsim.simulation.multibody import simulate
from mjsim.simulation.stability import check_stable, least_velocity_gain


@pytest.fixture
def campaign(good, tmp_path, monkeypatch):
    folder = shutil.copytree(good, tmp_path / "campaign")
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")
    return folder


def absurd(campaign, axis="A", **numbers):
    """Other numbers in one drive's table."""
    text = (campaign / "machine.toml").read_text()
    head, mine = text.split(f"[drive.{axis}]")
    for key, value in numbers.items():
        mine = re.sub(rf"{key} = \S+", f"{key} = {value}", mine, count=1)
    (campaign / "machine.toml").write_text(f"{head}[drive.{axis}]{mine}")


COMMANDS = {
    "simulate": ["simulate", "C", "--out", "C/out"],
    "compare": ["compare", "C"],
    "export": ["export", "C", "--out", "C/out"],
    "diagnose": ["diagnose", "C"],
    "add": ["add", "C", "backlash.A"],
    "remove": ["remove", "C", "friction.X"],
    "plan": ["plan", "C"],
    "identify": ["identify", "pitch-error", "C", "--axis", "A"],
    "report": ["report", "C", "-o", "C/report.html"],
    "animate": ["animate", "C", "--test", "turn", "-o", "C/film.mp4"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_refuses_an_unstable_drive(campaign, command, capfd):
    absurd(campaign, position_gain_per_s=1000.0, velocity_gain_Nms_per_rad=0.001)
    args = [a.replace("C", str(campaign), 1) if a.startswith("C") else a for a in COMMANDS[command]]
    refused(
        campaign.parent, args, "drive A", "swings itself up", "velocity gain 0.001", "position gain 1000", "above 0.319"
    )
    out, err = capfd.readouterr()
    assert not out and "WARNING" not in err
    assert not os.listdir()


def test_a_sweep_tells_it_per_run(campaign, capfd):
    turn = (campaign / "campaign.toml").read_text().split("[[test]]")[1].replace('trace = "traces/turn.csv"\n', "")
    vary = '[[vary]]\nparameter = "drive.A.velocity_gain_Nms_per_rad"\nvalues = [0.001, 4.0]\n'
    (campaign / "sweep.toml").write_text(f'name = "s"\nmachine = "machine.toml"\n[[test]]{turn}{vary}')
    result = mjsim.run_batch(campaign / "sweep.toml", campaign / "out")
    table = result.to_dataframe().set_index("run")
    assert result.failed == 1 and np.isnan(table.loc[0, "max_um"]) and np.isfinite(table.loc[1, "max_um"])
    assert "drive A: the control loop swings itself up" in table.loc[0, "error"]
    assert "WARNING" not in capfd.readouterr().err and not os.listdir()


def test_what_only_mujoco_notices(m1, cone, tmp_path, monkeypatch, capfd):
    """Where the drives are sound and the multibody model is not, MuJoCo's own warning becomes the error; it writes
    no log.
    """
    real = mjmodel.with_numbers

    def shoved(*args, **kwargs):  # bodies with numbers that no machine has: the drives are stable, MuJoCo is not
        model = real(*args, **kwargs)
        model.dof_damping[:] = -1e9
        return model

    monkeypatch.setattr(mjmodel, "with_numbers", shoved)
    monkeypatch.chdir(tmp_path)
    before = mujoco.get_mju_user_warning()
    with pytest.raises(
        SimulationError, match=r"test short: (MuJoCo gave up \(mjWARN|the simulated reading is not finite)"
    ):
        simulate(m1, [cone(15, 10, (0, 0, 155), 20000, name="short")])
    assert mujoco.get_mju_user_warning() is before
    assert not os.listdir() and "WARNING" not in capfd.readouterr().err


# -- the criterion -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("letter", ["X", "Z", "A", "C"])
def test_the_bound_is_where_the_eigenvalues_cross(machine, letter):
    """Routh's bound against the eigenvalues of the written-out equations, and against what the drive does."""
    plant = build(machine)
    axis = replace(plant.axes[letter], position_gain=400.0, viscous=0.0, coulomb=0.0, static_ratio=1.0)
    bound = least_velocity_gain(axis)
    assert bound > 0.0
    times = np.arange(4001) * STEP
    size = {}
    for factor in (0.98, 1.02):
        mine = replace(axis, velocity_gain=factor * bound)
        assert (np.linalg.eigvals(equations(mine)[0]).real.max() > 0) == (factor < 1)
        out = np.empty(len(times))
        drive_run(discretise(mine, STEP / SUBSTEPS), 0.001 * (times > 0.1), STEP / SUBSTEPS, SUBSTEPS, out)
        late, early = np.ptp(out[-1000:]), np.ptp(out[1000:2000])
        size[factor] = late / early
        plant.axes[letter] = mine
        if factor < 1:
            with pytest.raises(SimulationError, match=f"drive {letter}: .*above {bound:.4g}"):
                check_stable(plant)
        else:
            check_stable(plant)
    assert size[0.98] > 1.5 and size[1.02] < 0.7


def test_an_elastic_drive_that_swings_itself_up(m1):
    soft = m1.with_effect(registry.make("drive_compliance.X", stiffness_N_per_um=10.0, damping_ratio=0.001))
    check_stable(build(soft))
    plant = build(soft.with_drive("X", position_gain=300.0))
    assert np.linalg.eigvals(equations(plant.axes["X"])[0]).real.max() > 0
    with pytest.raises(
        SimulationError, match=r"drive X: .*elastic transmission.*raise stiffness and damping of drive_compliance\.X"
    ):
        check_stable(plant)


def test_shipped_machines_are_stable(machine):
    check_stable(build(machine))


def test_stable_commands_still_run(campaign):
    assert run("compare", campaign, "--quiet").exit_code == 0
    assert not os.listdir()


def test_friction_too_stiff_to_be_simulated(campaign):
    """Bristles so stiff that thousands of sub-steps would be needed are refused with the length that is enough;
    that one runs.
    """
    text = (campaign / "machine.toml").read_text()
    head, mine = text.split('id = "friction.A"')
    stiff = head.replace("inertia_kgm2 = 0.0042", "inertia_kgm2 = 1e-6")
    for length in ("1e-5", "4.1e-5"):
        mine = re.sub(
            r"coulomb_Nm = \S+\npresliding_rad = \S+", f"coulomb_Nm = 1.6\npresliding_rad = {length}", mine, count=1
        )
        (campaign / "machine.toml").write_text(f'{stiff}id = "friction.A"{mine}')
        args = ["simulate", campaign, "--out", campaign / "out", "--test", "turn", "--no-plots"]
        if length == "1e-5":
            refused(
                campaign.parent,
                args,
                "drive A: friction",
                "presliding_rad = 1e-05",
                "allowed with these: presliding_rad above 4e-05",
            )
        else:
            assert run(*args).exit_code == 0
