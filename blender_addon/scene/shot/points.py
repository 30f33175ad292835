# SPDX-License-Identifier: GPL-3.0-or-later
"""Points of a shot that are known: tracks of the clip that were reconstructed, and what the artist has selected."""

from __future__ import annotations

import bpy
import numpy as np

__all__ = ["bundles", "selected"]

STEADY = 0.01
"""By which share of the way between two frames the solve may fit the camera worse before its tracks are not its points."""


def bundles(scene: bpy.types.Scene, camera: bpy.types.Object, clip: bpy.types.MovieClip, frames: range) -> np.ndarray:
    """(P, 3) float64 reconstructed tracks of a clip, in the scene; none where the camera does not follow its solve.

    The solve has coordinates of its own. Where the camera is in both tells how they lie to each other: so it does not matter
    whether it follows by a constraint or by keys that were made of one.
    """
    solved = next((o for o in clip.tracking.objects if o.is_camera), None)
    if solved is None:
        return np.zeros((0, 3))
    tracks = [t.bundle for t in solved.tracks if t.has_bundle]
    before, cameras = scene.frame_current, solved.reconstruction.cameras
    known = {c.frame: c for c in cameras}
    first = 1 - clip.frame_start  # a solve counts the clip's frames
    there = [f for f in frames if f + first in known]
    if not tracks or not there:
        return np.zeros((0, 3))
    placed = []
    for frame in (there[0], there[-1]):
        scene.frame_set(frame)
        world = camera.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world
        placed.append(np.array(world @ known[frame + first].matrix.inverted()))
    scene.frame_set(before)
    points = np.array([tuple(t) for t in tracks], dtype=np.float64)
    found = [points @ m[:3, :3].T + m[:3, 3] for m in placed]
    reach = np.linalg.norm(np.ptp(found[0], axis=0))
    return found[0] if np.abs(found[0] - found[1]).max() <= STEADY * max(float(reach), 1e-9) else np.zeros((0, 3))


def selected(context: bpy.types.Context) -> np.ndarray:
    """(P, 3) float64 in the scene: places of the selected empties, but for those that the camera hangs on, and vertices of the
    selected meshes; of one that is edited only those vertices that are selected."""
    graph = context.evaluated_depsgraph_get()
    found: list[np.ndarray] = []
    rig, above = set(), context.scene.camera
    while above is not None:
        rig.add(above)
        above = above.parent
    for thing in context.view_layer.objects:
        if not thing.select_get() or thing in rig:
            continue
        if thing.type == "EMPTY":
            found.append(np.array([thing.evaluated_get(graph).matrix_world.translation], dtype=np.float64))
        elif thing.type == "MESH":
            found.append(_vertices(thing, graph))
    return np.concatenate([*found, np.zeros((0, 3))])


def _vertices(thing: bpy.types.Object, graph: bpy.types.Depsgraph) -> np.ndarray:
    if thing.mode == "EDIT":
        thing.update_from_editmode()
        places = [v.co for v in thing.data.vertices if v.select]
        local = np.array([tuple(p) for p in places], dtype=np.float64).reshape(-1, 3)
    else:
        seen = thing.evaluated_get(graph)
        mesh = seen.to_mesh()
        flat = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", flat)
        seen.to_mesh_clear()
        local = flat.reshape(-1, 3).astype(np.float64)
    matrix = np.array(thing.matrix_world, dtype=np.float64)
    return local @ matrix[:3, :3].T + matrix[:3, 3]
