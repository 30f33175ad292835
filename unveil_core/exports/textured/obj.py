"""Textured meshes as OBJ in the drive's coordinates, with a material and a PNG for each page."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import write_bytes_atomic
from unveil_core.exports.coordinates import drive_coordinates
from unveil_core.exports.job import Job
from unveil_core.exports.textured.levels import Level, encoded, textured_levels
from unveil_core.exports.whole import tell

__all__ = ["write_textured_obj"]


def write_textured_obj(job: Job, folder: Path) -> None:
    """``empty.obj``, ``empty.mtl``, ``empty_0.png`` ..., the same of each level of detail, and ``export.json``."""
    told = []
    for level in textured_levels(job):
        for number, image in enumerate(level.textured.images):
            write_bytes_atomic(folder / f"{level.name}_{number}.png", encoded(image, ".png"))
        write_bytes_atomic(folder / f"{level.name}.mtl", _materials(level).encode())
        write_bytes_atomic(folder / f"{level.name}.obj", _obj(job, level).encode())
        told.append(level.told(f"{level.name}.obj"))
    tell(
        folder,
        "textured-obj",
        {
            "coordinates": drive_coordinates(job.drive).to_json(shifted=False),
            "colorspace": job.colorspace,
            "levels": told,
        },
    )


def _obj(job: Job, level: Level) -> str:
    mesh, atlas, to_world = level.textured.mesh, level.textured.atlas, job.drive.to_world
    parts = [
        f"# unveil, {', '.join(to_world.comments())}",
        f"mtllib {level.name}.mtl",
        _rows("v %.6f %.6f %.6f", to_world.to_world(mesh.vertices)),
        _rows("vt %.6f %.6f", atlas.coordinates),
    ]
    for number in range(len(level.textured.images)):
        own = atlas.pages == number
        corners = np.stack([mesh.faces[own] + 1, atlas.corners[own] + 1], axis=2).reshape(-1, 6)
        parts += [f"usemtl {level.name}_{number}", _rows("f %d/%d %d/%d %d/%d", corners)]
    return "\n".join(parts) + "\n"


def _rows(line: str, table: NDArray[np.generic]) -> str:
    return "\n".join([line] * len(table)) % tuple(table.ravel().tolist())


def _materials(level: Level) -> str:
    """Materials that show their picture as it is (``illum 0``)."""
    return "\n".join(
        f"newmtl {level.name}_{number}\nillum 0\nKd 1 1 1\nKs 0 0 0\nmap_Kd {level.name}_{number}.png\n"
        for number in range(len(level.textured.images))
    )
