"""Types of what mjsim uses of MuJoCo: its bindings are compiled and carry none. Whatever else MuJoCo has is unknown
here.

`tests/test_upkeep.py` holds every name against the installed MuJoCo.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

__version__: str

class _Enum:
    value: int
    __members__: dict[str, Any]
    def __int__(self) -> int: ...
    def __index__(self) -> int: ...

class mjtCamera(_Enum):
    mjCAMERA_FREE: mjtCamera
    mjCAMERA_FIXED: mjtCamera

class mjtCatBit(_Enum):
    mjCAT_ALL: mjtCatBit

class mjtDisableBit(_Enum):
    mjDSBL_CONSTRAINT: mjtDisableBit
    mjDSBL_EULERDAMP: mjtDisableBit

class mjtFontScale(_Enum):
    mjFONTSCALE_100: mjtFontScale

class mjtFramebuffer(_Enum):
    mjFB_OFFSCREEN: mjtFramebuffer

class mjtGeom(_Enum):
    mjGEOM_BOX: mjtGeom
    mjGEOM_CYLINDER: mjtGeom
    mjGEOM_MESH: mjtGeom
    mjGEOM_SPHERE: mjtGeom
    mjGEOM_CAPSULE: mjtGeom
    mjGEOM_LINE: mjtGeom

class mjtJoint(_Enum):
    mjJNT_SLIDE: mjtJoint
    mjJNT_HINGE: mjtJoint

class mjtObj(_Enum):
    mjOBJ_CAMERA: mjtObj

class mjtRndFlag(_Enum):
    mjRND_SHADOW: mjtRndFlag

class mjtState(_Enum):
    mjSTATE_FULLPHYSICS: mjtState
    mjSTATE_CTRL: mjtState

class mjtTrn(_Enum):
    mjTRN_JOINT: mjtTrn

class mjtVisFlag(_Enum):
    mjVIS_TENDON: mjtVisFlag

class mjtWarning(_Enum): ...

class MjOption:
    gravity: np.ndarray

class _View:
    """Numbers of one element; writing into an array writes into the model."""

    id: int
    name: str

class _Actuator(_View): ...

class _Body(_View):
    pos: np.ndarray
    quat: np.ndarray

class _Joint(_View):
    axis: np.ndarray
    pos: np.ndarray
    qposadr: np.ndarray
    dofadr: np.ndarray
    bodyid: np.ndarray

class _Numeric(_View):
    data: np.ndarray

class _Sensor(_View):
    adr: np.ndarray

class MjModel:
    opt: MjOption
    nq: int
    nv: int
    nu: int
    nsensordata: int
    actuator_gainprm: np.ndarray
    body_gravcomp: np.ndarray
    body_parentid: np.ndarray
    body_mass: np.ndarray
    body_weldid: np.ndarray
    body_inertia: np.ndarray
    dof_armature: np.ndarray
    body_jntadr: np.ndarray
    body_jntnum: np.ndarray
    body_parentid: np.ndarray
    body_pos: np.ndarray
    body_quat: np.ndarray
    geom_bodyid: np.ndarray
    geom_dataid: np.ndarray
    geom_group: np.ndarray
    geom_matid: np.ndarray
    geom_pos: np.ndarray
    geom_quat: np.ndarray
    geom_rbound: np.ndarray
    geom_rgba: np.ndarray
    geom_size: np.ndarray
    geom_type: np.ndarray
    jnt_axis: np.ndarray
    jnt_type: np.ndarray
    mat_rgba: np.ndarray
    mesh_face: np.ndarray
    mesh_faceadr: np.ndarray
    mesh_facenum: np.ndarray
    mesh_vert: np.ndarray
    mesh_vertadr: np.ndarray
    mesh_vertnum: np.ndarray
    nbody: int
    jnt_range: np.ndarray
    jnt_limited: np.ndarray
    _address: int
    @staticmethod
    def from_xml_string(xml: str) -> MjModel: ...
    @staticmethod
    def from_xml_path(filename: str) -> MjModel: ...
    def __copy__(self) -> MjModel: ...
    def actuator(self, name: str | int) -> _Actuator: ...
    def body(self, name: str | int) -> _Body: ...
    def joint(self, name: str | int) -> _Joint: ...
    def numeric(self, name: str | int) -> _Numeric: ...
    def sensor(self, name: str | int) -> _Sensor: ...

class _Warning:
    number: int

class _Site:
    xpos: np.ndarray

class MjData:
    geom_xpos: np.ndarray
    time: float
    qpos: np.ndarray
    qvel: np.ndarray
    ctrl: np.ndarray
    xpos: np.ndarray
    xmat: np.ndarray
    sensordata: np.ndarray
    userdata: np.ndarray
    warning: Sequence[_Warning]
    _address: int
    def __init__(self, model: MjModel) -> None: ...
    def site(self, name: str | int) -> _Site: ...

class _SpecJoint:
    axis: np.ndarray
    range: np.ndarray
    armature: float
    @property
    def parent(self) -> _SpecBody: ...

class _SpecBody:
    pos: np.ndarray
    quat: np.ndarray
    def add_joint(self, *, name: str, type: _Enum, axis: ArrayLike, armature: float = ...) -> _SpecJoint: ...

class _SpecCamera:
    name: str

class _SpecGeom:
    contype: int
    conaffinity: int

class _SpecSensor:
    name: str

class _SpecCompiler:
    discardvisual: bool

class _SpecOption:
    timestep: float
    disableflags: int

class MjSpec:
    option: _SpecOption
    compiler: _SpecCompiler
    #: ``visual.global_``, ``visual.quality``, ...
    visual: Any
    nuserdata: int
    cameras: Sequence[_SpecCamera]
    lights: Sequence[object]
    tendons: Sequence[object]
    actuators: Sequence[object]
    keys: Sequence[object]
    geoms: Sequence[_SpecGeom]
    sensors: Sequence[_SpecSensor]
    @staticmethod
    def from_file(filename: str) -> MjSpec: ...
    @staticmethod
    def from_string(xml: str) -> MjSpec: ...
    def add_actuator(self, *, name: str, target: str, trntype: mjtTrn) -> object: ...
    def add_numeric(self, *, name: str, data: ArrayLike) -> object: ...
    def body(self, name: str) -> _SpecBody: ...
    def joint(self, name: str) -> _SpecJoint: ...
    def delete(self, element: object) -> None: ...
    def compile(self) -> MjModel: ...

class MjvCamera:
    type: int | mjtCamera
    fixedcamid: int
    lookat: np.ndarray
    distance: float
    azimuth: float
    elevation: float

class MjvGeom:
    pos: np.ndarray
    emission: float

class MjvGLCamera:
    """One eye of a scene."""

    pos: np.ndarray
    forward: np.ndarray
    up: np.ndarray
    frustum_center: float
    frustum_near: float
    frustum_top: float

class MjvOption:
    flags: np.ndarray

class MjvScene:
    camera: tuple[MjvGLCamera, MjvGLCamera]
    flags: np.ndarray
    geoms: Sequence[MjvGeom]
    maxgeom: int
    ngeom: int
    def __init__(self, model: MjModel, maxgeom: int) -> None: ...

class MjrContext:
    def __init__(self, model: MjModel, fontscale: int) -> None: ...
    def free(self) -> None: ...

class MjrRect:
    def __init__(self, left: int, bottom: int, width: int, height: int) -> None: ...

class Renderer:
    def __init__(self, model: MjModel, height: int = ..., width: int = ...) -> None: ...
    def __enter__(self) -> Renderer: ...
    def __exit__(self, *error: object) -> None: ...
    def update_scene(self, data: MjData, camera: int | str | MjvCamera = ...) -> None: ...
    def render(self) -> np.ndarray: ...

def mj_camlight(m: MjModel, d: MjData) -> None: ...
def mj_forward(m: MjModel, d: MjData) -> None: ...
def mj_fullM(m: MjModel, d: MjData, dst: np.ndarray) -> None: ...
def mj_fwdPosition(m: MjModel, d: MjData) -> None: ...
def mj_getState(m: MjModel, d: MjData, state: np.ndarray, sig: mjtState | int) -> None: ...
def mj_kinematics(m: MjModel, d: MjData) -> None: ...
def mj_name2id(m: MjModel, type: int, name: str) -> int: ...
def mj_resetData(m: MjModel, d: MjData) -> None: ...
def mj_setConst(m: MjModel, d: MjData) -> None: ...
def mj_stateSize(m: MjModel, sig: mjtState | int) -> int: ...
def mjr_readPixels(rgb: np.ndarray | None, depth: np.ndarray | None, viewport: MjrRect, con: MjrContext) -> None: ...
def mjr_render(viewport: MjrRect, scn: MjvScene, con: MjrContext) -> None: ...
def mjr_setBuffer(framebuffer: int, con: MjrContext) -> None: ...
def mju_mat2Quat(quat: np.ndarray, mat: np.ndarray, /) -> None: ...
def mju_quat2Mat(res: np.ndarray, quat: np.ndarray, /) -> None: ...
def mjv_connector(geom: MjvGeom, type: int, width: float, from_: np.ndarray, to: np.ndarray) -> None: ...
def mjv_initGeom(
    geom: MjvGeom, type: int, size: np.ndarray, pos: np.ndarray, mat: np.ndarray, rgba: np.ndarray
) -> None: ...
def mjv_updateScene(
    m: MjModel, d: MjData, opt: MjvOption, pert: None, cam: MjvCamera, catmask: int, scn: MjvScene
) -> None: ...
def get_mju_user_warning() -> object: ...
def set_mjcb_control(callback: object) -> None: ...
def get_mjcb_time() -> Any: ...
def set_mjcb_time(callback: object) -> None: ...
def set_mju_user_warning(callback: object) -> None: ...
