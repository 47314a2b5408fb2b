"""Where the compiled callback finds MuJoCo's arrays: byte offsets into mjModel and mjData.

The offsets are found at start-up in live structures: the pointer to an array that Python also sees (``data.qpos``)
stands in the structure as that array's address. Two instances must agree, so a changed MuJoCo layout is noticed at
once, not guessed.
"""

from __future__ import annotations

import ctypes

import mujoco
import numpy as np

from mjsim.errors import SimulationError

_PROBE = """
<mujoco>
  <option><flag sensor="enable"/></option>
  <size nuserdata="4"/>
  <worldbody>
    <body><joint name="a" type="slide"/><geom size=".1" mass="1"/>
      <body><joint name="b" type="hinge"/><geom size=".1" mass="1"/></body></body>
  </worldbody>
  <actuator><motor joint="a"/></actuator>
  <sensor><user dim="3"/></sensor>
  <custom><numeric name="n" data="1 2 3"/></custom>
</mujoco>"""

DATA_FIELDS = ("qpos", "qvel", "ctrl", "qfrc_applied", "qfrc_bias", "qfrc_passive", "userdata", "sensordata", "M")
MODEL_FIELDS = ("numeric_data", "M_rownnz", "M_rowadr", "M_colind")
_LIMIT = 200_000


def _offset(base: int, address: int, what: str) -> int:
    for offset in range(0, _LIMIT, 8):
        if ctypes.c_uint64.from_address(base + offset).value == address:
            return offset
    raise SimulationError(f"MuJoCo {mujoco.__version__}: {what} not found in its structure; install the pinned version")


def find_offsets() -> tuple[dict[str, int], dict[str, int]]:
    """Byte offsets of the pointers in mjModel and mjData, and of the time in mjData under ``"time"``."""
    found = []
    for _ in range(2):
        model = mujoco.MjModel.from_xml_string(_PROBE)
        data = mujoco.MjData(model)
        in_model = {n: _offset(model._address, getattr(model, n).ctypes.data, n) for n in MODEL_FIELDS}
        in_data = {n: _offset(data._address, getattr(data, n).ctypes.data, n) for n in DATA_FIELDS}
        data.time = 12345.678901
        in_data["time"] = _offset(data._address, int(np.float64(data.time).view(np.uint64)), "time")
        found.append((in_model, in_data))
    if found[0] != found[1]:
        raise SimulationError(
            f"MuJoCo {mujoco.__version__}: structure offsets are not reproducible; install the pinned version"
        )
    return found[0]
