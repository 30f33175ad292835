"""Stage ``mesh``: the full and the empty street as fused meshes."""

from __future__ import annotations

import shutil

from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.imported import read_imported
from unveil_core.ground.blocks import cut_into_blocks
from unveil_core.mesh import write_glb, write_ply
from unveil_core.mesh.levels import fuse_by_distance
from unveil_core.mesh.views import depth_views
from unveil_core.pipeline.stage import StageContext
from unveil_core.surfels.ply import read_surfels

__all__ = ["run"]

MESH_VOXEL_M = {"draft": 0.12, "standard": 0.08, "high": 0.05}
"""Edge of a voxel of the fused meshes, metres, as far as the first of the distances."""
DISTANCES_M = (30.0, 60.0, FAR_M)
"""To which depth voxels of that size, of twice and of four times that size are fused: a pixel is as large there as they are."""


def run(context: StageContext) -> None:
    """meshes/full.ply, meshes/empty.ply, meshes/empty.glb."""
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir, points=False)
    voxel = MESH_VOXEL_M[context.settings.quality]
    for state, path in (("full", workspace.surfels_full), ("empty", workspace.surfels_empty)):
        last = context.output(f"meshes/{state}.glb" if state == "empty" else f"meshes/{state}.ply")
        if last.is_file():
            continue  # written by an attempt that was interrupted
        mesh = fuse_by_distance(
            lambda path=path: depth_views(read_surfels(path), drive.frames, near=NEAR_M, far=FAR_M),  # type: ignore[misc]
            voxel_size=voxel,
            distances=DISTANCES_M,
            region_of=cut_into_blocks(drive).of_places,
            cameras=[f.camera for f in drive.frames],
            scratch=context.scratch(state),
            cache=context.cache,
            progress=context.progress,
        )
        write_ply(mesh, context.output(f"meshes/{state}.ply"), drive.to_world)
        if state == "empty":
            write_glb(mesh, last, drive.to_world)
        shutil.rmtree(context.scratch(state), ignore_errors=True)
