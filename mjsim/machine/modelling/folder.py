"""The folder of a machine model: the meshes that are made here, and two MJCF files that are copied."""

from __future__ import annotations

from pathlib import Path

from mjsim.io import resources
from mjsim.machine.modelling.solids import Machine, stl


def contents(machine: Machine) -> dict[str, bytes]:
    """The files of a model's folder.

    Args:
        machine: whose solids are made. The MJCF files are the package's, as they are: only they name the meshes, the
            densities, the joints and the shapes for collisions.

    Returns:
        Path inside the folder -> content.
    """
    parts = {part.mesh: part for body in machine.bodies for part in body.parts}
    meshes = {f"assets/{mesh}.stl": stl(part) for mesh, part in parts.items()}
    texts = {file.name: file.read_bytes() for file in (resources.model_file(), resources.scene_file())}
    return meshes | texts


def write_folder(machine: Machine, folder: Path) -> None:
    """Write the meshes and the MJCF files of a machine; meshes of another machine in ``assets`` are removed.

    Args:
        machine: to be written.
        folder: made where there is none. Other files in it stay.
    """
    files = contents(machine)
    (folder / "assets").mkdir(parents=True, exist_ok=True)
    for name in _meshes(folder) - set(files):
        (folder / name).unlink()
    for name, content in files.items():
        (folder / name).write_bytes(content)


def differences(machine: Machine, folder: Path) -> list[str]:
    """What in a folder is not as :func:`write_folder` would write it.

    Args:
        machine: to compare with.
        folder: of a model.

    Returns:
        Paths inside the folder, sorted: files that are missing or have another content, meshes that are too many.
    """
    files = contents(machine)
    wrong = {n for n, content in files.items() if not (folder / n).is_file() or (folder / n).read_bytes() != content}
    return sorted(wrong | (_meshes(folder) - set(files)))


def _meshes(folder: Path) -> set[str]:
    return {f"assets/{file.name}" for file in (folder / "assets").glob("*.stl")}
