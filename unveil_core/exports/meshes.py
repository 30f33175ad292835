"""The workspace's meshes as PLY, OBJ and GLB, with fewer triangles where asked."""

from __future__ import annotations

from pathlib import Path

from unveil_core.exports.job import Job
from unveil_core.mesh import write_glb, write_obj, write_ply

__all__ = ["write_mesh_glb", "write_mesh_obj", "write_mesh_ply"]


def write_mesh_ply(job: Job, path: Path) -> None:
    """The mesh as PLY in the drive's coordinates, sRGB vertex colours."""
    write_ply(job.mesh, path, job.drive.to_world)


def write_mesh_obj(job: Job, path: Path) -> None:
    """The mesh as OBJ, likewise."""
    write_obj(job.mesh, path, job.drive.to_world)


def write_mesh_glb(job: Job, path: Path) -> None:
    """The mesh as binary glTF, y up, under a node that is moved to the drive's place."""
    write_glb(job.mesh, path, job.drive.to_world)
