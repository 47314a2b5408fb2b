"""Inertia of the multibody model's own moving bodies, axis by axis."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from mjsim.errors import InputError
from mjsim.io.resources import model_file
from mjsim.machine.chain import FIVE_AXIS, Chain

if TYPE_CHECKING:
    import mujoco


def own_inertia(model: mujoco.MjModel, chain: Chain = FIVE_AXIS) -> np.ndarray:
    """Inertia of the bodies that each axis of ``model`` moves, (axes,) kg and kg·m²; armatures are set to zero."""
    import mujoco  # not above: reading a campaign needs no MuJoCo, whose import fails where its renderer is missing

    dofs = [model.joint(a).dofadr[0] for a in chain.letters]
    model.dof_armature[dofs] = 0.0
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)  # no more than the mass matrix needs: no callback is called
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return np.diag(mass)[dofs]


def has_model(chain: Chain) -> bool:
    """Whether there is a MuJoCo model with these axes."""
    return chain == FIVE_AXIS


def check_model(chain: Chain) -> None:
    """Refuse a machine whose bodies are not known.

    Raises:
        InputError: there is no MuJoCo model with these axes.
    """
    if not has_model(chain):
        raise InputError(
            f"configuration {chain.configuration!r} has no MuJoCo model; allowed: {FIVE_AXIS.configuration!r}"
        )


@cache
def moving_bodies(chain: Chain) -> np.ndarray:
    """:func:`own_inertia` of the MJCF as it ships.

    Raises:
        InputError: no MJCF ships for these axes.
    """
    import mujoco

    check_model(chain)
    return own_inertia(mujoco.MjModel.from_xml_path(str(model_file())))


def bodies_scale(own: np.ndarray, wanted: np.ndarray) -> float:
    """Factor to the solids' densities so that no axis' solids ``own`` outweigh its drive's whole inertia ``wanted``,
    (axes,) each.

    5 % of every axis stays on the motor side.
    """
    return min(1.0, float(np.min(0.95 * wanted / own)))
