"""Tests that were not measured, with their noise-free truth: do the fitted machine's predictions hold outside its
campaign?

The folder has the form that campaigns with known answers use: ``heldout/campaign.toml`` and, per test,
``NAME.truth.csv`` with the columns phi_deg, deviation_um (true machine, no set-up error) and nominal_um (the user's
machine).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import tomlkit

from .campaign import Case, truth
from .layouts import arrange, cone

#: Every fourth sample is written: 50 Hz.
EVERY = 4


def tests(case: Case) -> list[dict]:
    """Cones at places, angles and directions that no layout of the bank has, some minutes after the campaign."""
    far = [cone(15, (-50, 0), "CW", 1500.0), cone(45, (0, 70), "CCW", 1500.0), cone(30, (40, 40), "CCW", 1500.0)]
    return arrange(far, case.tests[-1]["started_s"] + 300.0)


def write_heldout(case: Case, folder: Path | str) -> None:
    """Writes ``heldout/`` into the campaign folder of a case."""
    case = case.resolved()

    def both(test: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        phi, _, true = truth(case, test)
        return phi, true, truth(case, test, hidden=False, tolerances=False)[2]

    write_truth(folder, case.name, tests(case), both)


def write_truth(folder: Path | str, name: str, rows: list[dict], truth_of: Callable[[dict], tuple]) -> None:
    """Writes tests and what ``truth_of`` says of each: φ in degrees, the true and the nominal deviation in µm."""
    here = Path(folder) / "heldout"
    here.mkdir(parents=True, exist_ok=True)
    instrument = {"kind": "ball_bar", "resolution_um": 0.1, "range_mm": 1.0, "sample_rate_Hz": 200.0}
    plain = [{k: v for k, v in t.items() if k not in ("trace", "setup")} for t in rows]
    head = {"name": f"{name}-heldout", "machine": "../machine.toml", "instrument": instrument, "test": plain}
    (here / "campaign.toml").write_text(tomlkit.dumps(head))
    for test in rows:
        np.savetxt(
            here / f"{test['name']}.truth.csv",
            np.column_stack(truth_of(test))[::EVERY],
            fmt="%.4f",
            delimiter=",",
            header="phi_deg,deviation_um,nominal_um",
            comments="",
        )
