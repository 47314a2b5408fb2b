"""Inertia of the multibody model's own moving bodies, axis by axis."""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np

from mjsim.io.resources import model_file
from mjsim.machine.chain import AXES


def own_inertia(model: mujoco.MjModel) -> np.ndarray:
    """Inertia of the bodies that each axis of ``model`` moves, (5,) kg and kg·m², order X, Y, Z, A, C; armatures are set to zero."""
    dofs = [model.joint(a).dofadr[0] for a in AXES]
    model.dof_armature[dofs] = 0.0
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)  # no more than the mass matrix needs: no callback is called
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return np.diag(mass)[dofs]


@cache
def moving_bodies() -> np.ndarray:
    """:func:`own_inertia` of the MJCF as it ships."""
    return own_inertia(mujoco.MjModel.from_xml_path(str(model_file())))


def bodies_scale(own: np.ndarray, wanted: np.ndarray) -> float:
    """Factor to the solids' densities so that no axis' solids ``own`` outweigh its drive's whole inertia ``wanted``, (5,) each.

    5 % of every axis stays on the motor side.
    """
    return min(1.0, float(np.min(0.95 * wanted / own)))
