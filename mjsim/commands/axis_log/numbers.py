"""Numbers that a diagnosis of axis logs hands on: intervals of the parameters of effects, and the data sheet."""

from __future__ import annotations

import numpy as np

from mjsim.commands.axis_log.diagnosis import SheetNumber
from mjsim.inference.axis_logs.entries import CONTROLLER, DRIVE, NUISANCES, Entry
from mjsim.inference.axis_logs.fit import AxisFit
from mjsim.inference.axis_logs.found import AxisSelection
from mjsim.inference.axis_logs.separability import inseparable, intervals, undetermined
from mjsim.inference.data_sheet import OF_SHEET
from mjsim.machine.model import Machine


def parameter_intervals(fit: AxisFit) -> dict[str, dict[str, list]]:
    """95 % intervals by effect and parameter, in the parameters' units; those of a wave from its two parts."""
    out: dict[str, dict[str, list]] = {}
    found = intervals(fit)
    for e in fit.model.entries:
        if e.owner in (DRIVE, CONTROLLER, *NUISANCES):
            continue
        if not e.name.startswith(("cosine", "sine")):
            out.setdefault(e.owner, {})[e.name] = list(found[e.label][1:])
    for e in fit.model.entries:
        if not e.name.startswith("cosine"):
            continue
        effect = fit.model.machine.effect(e.owner)
        assert effect is not None
        parts = [found[f"{e.owner}.{n}"] for n in (e.name, e.name.replace("cosine", "sine"))]
        amplitude = float(np.hypot(parts[0][0], parts[1][0]))
        spread = max(0.5 * (high - low) for _, low, high in parts)
        turn = float(np.degrees(spread / max(amplitude, 1e-12)))
        ends = [max(0.0, amplitude - spread), amplitude + spread]
        mine = out.setdefault(e.owner, {})
        if order := e.name.removeprefix("cosine").strip():
            row = next(r for r in effect.values["components"] if f"{r[0]:g}" == order)
            low, high = mine.get("components", [[], []])
            mine["components"] = [
                [*low, [row[0], ends[0], row[2] - turn]],
                [*high, [row[0], ends[1], row[2] + turn]],
            ]
        else:
            name = next(p.name for p in effect.parameters_of(effect.subject) if p.name.startswith("amplitude_"))
            phase = effect.values["phase_deg"]
            mine |= {name: ends, "phase_deg": [phase - turn, phase + turn]}
    return out


def sheet_of(machine: Machine, axis: str, selection: AxisSelection) -> list[SheetNumber]:
    """The numbers of one axis' data sheet as stated and as found.

    Where a finding is a factor on such a number, the number is what both together come to.
    """
    fit, out = selection.fit, []
    read = {(g.controller or "", n) for g in selection.gains for n in g.values}
    ranges, combined = intervals(fit), {label for i in inseparable(fit) for label in i.labels}
    open_ = undetermined(fit)
    friction = machine.effect(f"friction.{axis}")
    for e in fit.model.entries:
        if e.owner == DRIVE:
            stated = getattr(machine.drives[axis], e.name)
        elif e.owner == CONTROLLER:
            stated = getattr(machine.controllers[e.where][axis], e.name)
        elif friction is not None and e.owner == friction.id and e.name in ("coulomb_Nm", "presliding_rad"):
            stated = friction.values[e.name]
        else:
            continue
        value, low, high = ranges[e.label]
        source = "recorded output" if e.owner == CONTROLLER and (e.where, e.name) in read else "motion"
        known = source == "recorded output" or (e.label not in combined and e.label not in open_)
        found = _with_factor(fit, e)
        if found is not None:
            value, low, high, known = found
        out.append(SheetNumber(axis, e.name, e.where, stated, value, (low, high), known, source))
    return out


def _with_factor(fit: AxisFit, e: Entry) -> tuple[float, float, float, bool] | None:
    """A number of the data sheet times the factor that an effect puts on it, its interval, and whether it is known."""
    kind = next((k for k, name in OF_SHEET.items() if name == e.name and e.owner in (DRIVE, CONTROLLER)), None)
    factor = fit.model.machine.effect(f"{kind}.{fit.model.axis}") if kind else None
    if factor is None:
        return None
    places = [fit.model.place(label) for label in (e.label, f"{factor.id}.ratio")]
    mine = [j for j in places if j is not None]
    sd = float(np.sqrt(max(fit.covariance[np.ix_(mine, mine)].sum(), 0.0)))  # both are logarithms
    value = e.value * factor.values["ratio"]
    wide = max(fit.model.entries[j].deviation for j in mine)
    return value, value * float(np.exp(-1.96 * sd)), value * float(np.exp(1.96 * sd)), bool(sd < 0.5 * wide)
