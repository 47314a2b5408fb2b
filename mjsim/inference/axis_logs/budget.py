"""The uncertainty budget of the numbers that axis logs tell: as :mod:`mjsim.inference.budget`, of one axis' fit.

The fit takes what a model leaves for noise, and counts residuals by how many independent ones they are worth. So the
variance that the readings make of a number is ``gᵀ C Jᵀ W² J C g``. What white noise of the encoder would make of it
with the same weights, ``Σ s² |W² J C g|²``, is the row of the noise; the rest is what is not understood.

A number of the data sheet has its own statement among its priors. There the sheet's row is what errors of the sheet
make of the estimate, ``Σ (C g)ᵢ²/σᵢ²`` over its numbers; of those that another instrument knows together, with the
inverse of their covariance in the place of ``1/σᵢ²``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mjsim.inference.axis_logs.entries import CONTROLLER, DRIVE, LOAD, NUISANCES, Entry
from mjsim.inference.axis_logs.fit import AxisFit
from mjsim.inference.budget import REMEDIES as MACHINE_REMEDIES
from mjsim.inference.budget import Budget, explained_by
from mjsim.machine.model import SHEET_NAMES, sheet_name
from mjsim.units import unit_of

#: What makes each row smaller.
REMEDIES = {
    "noise": "more recordings of the same motion",
    "set_up": "recordings of other motions of the axis (`mjsim plan`)",
    "machine_model": MACHINE_REMEDIES["machine_model"],
    "data_sheet": "a recorded torque or current, and motions at other speeds (`mjsim plan`)",
    "other_errors": "motions that tell the causes apart (`mjsim plan`)",
    "not_understood": "finding the cause of what is left",
}


class _Number(NamedTuple):
    """A number of a fit: id of its owner, name, unit, value, gradient by the vector (p,), entries of its own, and
    whether the data sheet states it.
    """

    owner: str
    name: str
    unit: str
    value: float
    gradient: np.ndarray
    own: list[int]
    is_sheet: bool


def log_budget(fit: AxisFit) -> tuple[Budget, ...]:
    """The budget of every number of a fitted axis that is no nuisance.

    Args:
        fit: The final model, with its derivatives.
    """
    entries, priors, covariance, out = fit.model.entries, fit.model.priors, fit.covariance, []
    blocks: dict[str, list[int]] = {"set_up": [], "data_sheet": [], "other_errors": []}
    for i, e in enumerate(entries):
        nuisance = "machine_model" if e.owner == LOAD else "set_up"
        row = nuisance if e.owner in NUISANCES else "data_sheet" if _is_sheet(e) else "other_errors"
        blocks.setdefault(row, []).append(i)
    for n in _numbers(fit):
        moved = covariance @ n.gradient
        rows = {"noise": 0.0, "not_understood": 0.0}
        for design, weight, noise in zip(fit.design, fit.weight, fit.noise, strict=True):
            seen = np.asarray(weight) * (design @ moved)
            mine = noise**2 * float(np.sum((np.asarray(weight) * seen) ** 2))
            rows["noise"] += mine
            rows["not_understood"] += max(float(seen @ seen) - mine, 0.0)
        for row, at in blocks.items():
            rows[row] = explained_by(covariance, moved, np.setdiff1d(at, n.own).astype(int))
        if n.is_sheet:  # what errors of the sheet make of it: its own number is one of them
            at = blocks["data_sheet"]
            rows["data_sheet"] = float(moved[at] @ priors.precision[np.ix_(at, at)] @ moved[at])
        sizes = {row: math.sqrt(max(v, 0.0)) for row, v in rows.items()}
        total = math.sqrt(max(float(n.gradient @ moved), 0.0))
        out.append(Budget(n.owner, n.name, n.unit, n.value, total, sizes, remedies=REMEDIES))
    return tuple(out)


def _numbers(fit: AxisFit) -> Iterator[_Number]:
    """Numbers of the effects and of the data sheet of a fit; of a wave its amplitude."""
    model = fit.model
    for i, e in enumerate(model.entries):
        if e.owner in NUISANCES or e.name.startswith("sine"):
            continue
        gradient = np.zeros(len(model.entries))
        if e.owner in (DRIVE, CONTROLLER):
            name, unit = sheet_name(e.name)
            gradient[i] = _slope(e)
            owner = ".".join(filter(None, (e.owner, e.where, model.axis)))
            yield _Number(owner, name, unit, e.value, gradient, [i], True)
            continue
        own = [k for k, other in enumerate(model.entries) if other.owner == e.owner]
        if not e.name.startswith("cosine"):
            gradient[i] = _slope(e)
            mine = [i] if _is_sheet(e) else own
            yield _Number(e.owner, e.name, unit_of(e.name)[1], e.value, gradient, mine, _is_sheet(e))
            continue
        k = model.place(f"{e.owner}.{e.name.replace('cosine', 'sine')}")
        assert k is not None
        size = math.hypot(e.value, model.entries[k].value)
        for j in (i, k):
            gradient[j] = _slope(model.entries[j]) * model.entries[j].value / max(size, 1e-12)
        name, unit = _wave(fit, e)
        yield _Number(e.owner, name, unit, size, gradient, own, False)


def _is_sheet(e: Entry) -> bool:
    """Whether a number is one of the data sheet."""
    return e.owner in (DRIVE, CONTROLLER) or e.name in SHEET_NAMES


def _slope(e: Entry) -> float:
    """Derivative of a number by its entry of the vector."""
    return e.value if e.log else e.scale


def _wave(fit: AxisFit, e: Entry) -> tuple[str, str]:
    """What the amplitude of a wave is called, and its unit."""
    effect = fit.model.machine.effect(e.owner)
    assert effect is not None
    if order := e.name.removeprefix("cosine").strip():
        rotary = fit.model.machine.chain.is_rotary(fit.model.axis)
        return f"order {order}", ("°" if rotary else "µm") if effect.kind == "pitch_error" else "N·m"
    name = next(p.name for p in effect.parameters_of(effect.subject) if p.name.startswith("amplitude_"))
    return name, unit_of(name)[1]
