"""Solids as files: the parts of a body, and binary STL of one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from mjsim.machine.modelling.pieces import Piece

#: The first 80 bytes of every file; constant, so that the same solid is the same file.
_HEADER = b"mjsim five-axis machine, metres".ljust(80, b" ")
_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@dataclass(frozen=True)
class Part:
    """A mesh of the model.

    Attributes:
        mesh: its name in the model; its file is ``assets/<mesh>.stl``.
        pieces: closed pieces whose sum it is.
    """

    mesh: str
    pieces: list[Piece]


@dataclass(frozen=True)
class Body:
    """What moves as one.

    Attributes:
        name: of the body in the model.
        parts: its meshes.
    """

    name: str
    parts: tuple[Part, ...]


@dataclass(frozen=True)
class Machine:
    """A machine as solids.

    Attributes:
        bodies: all of them, in world coordinates with all axes at zero, except for the fixture, whose origin is its
            ball's centre.
    """

    bodies: tuple[Body, ...]


def solid(pieces: list[Piece]) -> trimesh.Trimesh:
    """The sum of pieces as MuJoCo reads it from a file.

    Vertices are rounded to 0.1 µm, so that no platform's last bit shows, and then to single precision.

    Args:
        pieces: closed, each on its own.

    Returns:
        The mesh, m.
    """
    vertices = [(np.round(v, 7) + 0.0).astype(np.float32) for v, _ in pieces]
    offsets = np.cumsum([0, *(len(v) for v in vertices)])
    faces = [f + offset for (_, f), offset in zip(pieces, offsets, strict=False)]
    return trimesh.Trimesh(np.vstack(vertices).astype(float), np.vstack(faces), process=False)


def stl(part: Part) -> bytes:
    """The file of a part: binary STL in metres, with a constant header.

    Args:
        part: to be written.

    Returns:
        The file's content.

    Raises:
        ValueError: a piece is not closed.
    """
    mesh = solid(part.pieces)
    if not mesh.is_watertight and not trimesh.Trimesh(mesh.vertices, mesh.faces, process=True).is_watertight:
        raise ValueError(f"{part.mesh}: a piece is not closed")
    faces = np.zeros(len(mesh.faces), _FACE)
    faces["corners"] = mesh.vertices[mesh.faces]
    return _HEADER + np.array(len(faces), "<u4").tobytes() + faces.tobytes()
