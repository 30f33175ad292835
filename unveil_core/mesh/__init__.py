"""Meshes: fusion of depth images, decimation, export, pictures."""

from unveil_core.mesh.decimate import decimate
from unveil_core.mesh.export import read_ply, write_glb, write_obj, write_ply
from unveil_core.mesh.mesh import Mesh, drop_small_components
from unveil_core.mesh.picture import render_mesh_picture
from unveil_core.mesh.tsdf import DepthView, fuse

__all__ = [
    "DepthView",
    "Mesh",
    "decimate",
    "drop_small_components",
    "fuse",
    "read_ply",
    "render_mesh_picture",
    "write_glb",
    "write_obj",
    "write_ply",
]
