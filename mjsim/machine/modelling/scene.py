"""The scene around a machine made of its chain: floor, light, sky and cameras."""

from __future__ import annotations

import numpy as np

from mjsim.io.resources import scene_file
from mjsim.machine.chain import Chain
from mjsim.machine.modelling.assembly import assembled
from mjsim.machine.modelling.links import points
from mjsim.machine.modelling.mjcf import machine_xml


def scene_xml(chain: Chain, model: str) -> str:
    """The shipped scene around another machine.

    Args:
        chain: the machine's axes.
        model: file of its model, beside the scene.
    """
    assembly = assembled(chain)
    links = (assembly.bed, *assembly.work, assembly.table, *assembly.tool, assembly.spindle)
    corners = points(s for k in links for s in k.solids)
    middle, size = (corners.min(axis=0) + corners.max(axis=0)) / 2, float(np.ptp(corners, axis=0).max())
    text = scene_file().read_text(encoding="utf-8")
    for camera, away, fovy in (("overview", (-1.05, -1.26, 0.61), 42), ("side", (-1.8, -0.48, 0.38), 37)):
        seen = _looking(middle + size * np.array(away), middle)
        text = _replaced(text, f'<camera name="{camera}"', f'{seen} fovy="{fovy}"')
    floor = f'type="plane" size="0 0 0.05" pos="0 0 {assembly.floor:g}" material="floor"'
    text = _replaced(text, '<geom name="floor"', floor)
    return text.replace('file="five_axis.xml"', f'file="{model}"').replace('"five_axis scene"', '"machine scene"')


def whole_scene(chain: Chain) -> str:
    """The scene and the machine in it as one text."""
    inside = machine_xml(chain).partition(">")[2].rpartition("</mujoco>")[0]
    scene = scene_xml(chain, "machine.xml")
    return scene.replace('<include file="machine.xml"/>', inside)


def _replaced(text: str, start: str, attributes: str) -> str:
    """``text`` with other attributes behind ``start`` of an element."""
    head, _, rest = text.partition(start)
    return f"{head}{start} {attributes}/>{rest.partition('/>')[2]}"


def _looking(eye: np.ndarray, at: np.ndarray) -> str:
    """Position and orientation of a camera that looks from one point at another."""
    back = (eye - at) / np.linalg.norm(eye - at)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    axes = np.concatenate([right, np.cross(back, right)])
    return f'pos="{" ".join(f"{v:.6g}" for v in eye)}" xyaxes="{" ".join(f"{v:.6g}" for v in axes)}"'
