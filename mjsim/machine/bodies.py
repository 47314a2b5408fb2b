"""Inertia of the multibody model's own moving bodies, axis by axis."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from mjsim.errors import InputError
from mjsim.io.resources import model_file
from mjsim.machine.chain import COORDINATES, FIVE_AXIS, Chain
from mjsim.machine.modelling import machine_xml

if TYPE_CHECKING:
    import mujoco


def own_inertia(model: mujoco.MjModel, chain: Chain) -> np.ndarray:
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
    """Whether there is a MuJoCo model with these axes: the shipped one, or one that is made of the chain."""
    return chain.spatial


def check_model(chain: Chain) -> None:
    """Refuse a machine whose bodies are not known.

    Raises:
        InputError: there is no MuJoCo model with these axes.
    """
    if not has_model(chain):
        raise InputError(
            f"configuration {chain.configuration!r} has no MuJoCo model; allowed: machines with "
            f"{', '.join(COORDINATES)}, such as {FIVE_AXIS.configuration!r}"
        )


def model_spec(chain: Chain) -> mujoco.MjSpec:
    """The editable model of a machine with these axes: the shipped one, or one that is made of the chain.

    Raises:
        InputError: there is none.
    """
    import mujoco

    check_model(chain)
    if chain.counter_clockwise.nominal == FIVE_AXIS:
        return counted(mujoco.MjSpec.from_file(str(model_file())), chain)
    return mujoco.MjSpec.from_string(machine_xml(chain))


def counted(spec: mujoco.MjSpec, chain: Chain) -> mujoco.MjSpec:
    """A model whose rotary joints count counter-clockwise, changed so that they count as the axes of ``chain`` do."""
    for axis in chain.axes:
        if axis.ccw < 0.0:
            joint = spec.joint(axis.letter)
            joint.axis, joint.range = -joint.axis, np.array(axis.ends(*joint.range))
    return spec


@cache
def moving_bodies(chain: Chain) -> np.ndarray:
    """:func:`own_inertia` of the model with these axes.

    Raises:
        InputError: there is none.
    """
    return own_inertia(model_spec(chain).compile(), chain)


def bodies_scale(own: np.ndarray, wanted: np.ndarray) -> float:
    """Factor to the solids' densities so that no axis' solids ``own`` outweigh its drive's whole inertia ``wanted``,
    (axes,) each.

    5 % of every axis stays on the motor side.
    """
    return min(1.0, float(np.min(0.95 * wanted / own)))
