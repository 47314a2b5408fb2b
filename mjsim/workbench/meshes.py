"""What geoms of a machine's model look like, as meshes for the page."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np
import trimesh

from mjsim.simulation.mjmodel import rotation_of


def stl_of(model: mujoco.MjModel, geoms: Iterable[int]) -> bytes:
    """STL data of some geoms of one body, in the body's frame.

    Args:
        model: The machine's model.
        geoms: Their numbers; meshes, boxes, cylinders and spheres.
    """
    data = trimesh.util.concatenate([_solid(model, g) for g in geoms]).export(file_obj=None, file_type="stl")
    assert isinstance(data, bytes)
    return data


def _solid(model: mujoco.MjModel, g: int) -> trimesh.Trimesh:
    kind, size = int(model.geom_type[g]), model.geom_size[g]
    if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
        m = int(model.geom_dataid[g])
        vertices = model.mesh_vert[model.mesh_vertadr[m] :][: model.mesh_vertnum[m]]
        faces = model.mesh_face[model.mesh_faceadr[m] :][: model.mesh_facenum[m]]
        solid = trimesh.Trimesh(vertices, faces, process=False)
    elif kind == int(mujoco.mjtGeom.mjGEOM_BOX):
        solid = trimesh.creation.box(2 * size)
    elif kind == int(mujoco.mjtGeom.mjGEOM_CYLINDER):
        solid = trimesh.creation.cylinder(size[0], 2 * size[1], sections=48)
    else:
        solid = trimesh.creation.icosphere(2, size[0])
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = rotation_of(model.geom_quat[g]), model.geom_pos[g]
    return solid.apply_transform(place)
