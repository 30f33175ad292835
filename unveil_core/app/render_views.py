"""``unveil render``: the scene, full or empty, from where the user wants to see it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.new_files import mode_like
from unveil_core.base.errors import SettingsError, UnveilError
from unveil_core.base.files import write_image_atomic, write_json_atomic
from unveil_core.base.output.own_folder import OwnFolder
from unveil_core.base.pictures.decoding import read_metadata
from unveil_core.base.progress import Progress, no_progress
from unveil_core.drives.camera_path import View, drive_path, read_camera_path, shifted
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.drives.imported import read_imported
from unveil_core.geometry.camera import Camera
from unveil_core.ground.files import read_ground
from unveil_core.pipeline.output_place import check_folder_place, drives_of
from unveil_core.raster.near_camera import near_camera
from unveil_core.raster.on_device import array, rendered
from unveil_core.raster.picture import with_sky
from unveil_core.semantics.classes import VOID
from unveil_core.semantics.labels import SceneLabels
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.sky import Sky, load_sky
from unveil_core.surfels.surfels import Surfels
from unveil_core.view.surface import SOLID, SURFACE_PLANES, surface_depth
from unveil_core.workspace.files import load_labels
from unveil_core.workspace.scene_states import SCENE_STATES, check_scene_state, scene_file
from unveil_core.workspace.workspace import Workspace

__all__ = ["PLANES", "STATES", "check_planes", "read_scene", "render_views", "rendered_planes"]

STATES = SCENE_STATES
PLANES = ("rgb", "depth", "normal", "alpha", "semantics")
_NEEDS = {
    "rgb": ("rgb", "alpha"),
    "depth": SURFACE_PLANES,
    "normal": ("alpha", "normal"),
    "alpha": ("alpha",),
    "semantics": ("alpha", "semantics"),
}
DEPTH_STEPS_PER_M = 256
FARTHEST_SHIFT_M = 1000.0


def render_views(
    workspace: Workspace,
    output: Path,
    *,
    state: str = "empty",
    path: Path | None = None,
    beside: float = 0.0,
    above: float = 0.0,
    planes: Sequence[str] = ("rgb",),
    progress: Progress = no_progress,
) -> int:
    """Write ``<output>/<plane>/<view>.png`` and ``<output>/transforms.json``, which names them with their cameras.

    Views of a path with several cameras lie in a folder for each: ``<plane>/<camera>/<view>.png``. Colours are the scene's
    canonical ones, the same in all views, whatever the exposure of the nearest photograph.

    ========= ==========================================================================================================
    rgb       8-bit sRGB, the sky included
    depth     16-bit, of the surface along the optical axis, 256 steps a metre as KITTI keeps it, 0 for none
    normal    8-bit RGB, 127.5 (n + 1), in the camera's frame: x right, y up, z towards the viewer; 0 for none
    alpha     8-bit, the light that surfels stop
    semantics 8-bit, Cityscapes trainIds (of a drive with masks only, 0 what stays and 1 what goes), 255 for none
    ========= ==========================================================================================================

    Args:
        workspace: a reconstructed one.
        output: a folder, made if need be; files of the same names that were rendered before are written over, and no others.
        state: one of :data:`STATES`.
        path: cameras, see :func:`read_camera_path`; the drive's own by default.
        beside: metres to the right of the direction of travel, negative to the left; of the drive's own cameras it is the
            street's direction, where the workspace knows it; above: metres up.
        planes: of :data:`PLANES`.
        progress: called once per view.
    Returns:
        the number of views.
    Raises:
        SettingsError: an unknown state or plane, a shift out of range, or a folder that belongs to the workspace or holds files of
            the same names that were not rendered.
        DriveError: a path that cannot be read.
        UnveilError: the workspace has no such scene yet, or the folder cannot be written.
    """
    _check_settings(state, planes, beside, above)
    check_folder_place(output, drives_of(workspace))
    drive = read_imported(workspace.drive_dir, points=False)
    views = _views(workspace, drive, path, beside, above)
    several = len({v.track for v in views}) > 1
    names = [f"{view.track}/{view.name}" if several else view.name for view in views]
    files = ["transforms.json", *(f"{plane}/{name}.png" for plane in planes for name in names)]
    surfels, sky = read_scene(workspace, state)
    scene = load_labels(workspace) if "semantics" in planes else None
    first = drive.frames[0]
    colours = read_metadata(first.footage_path).of_color
    frames = []
    try:
        with OwnFolder(output, mend="name an empty folder, or one that was rendered to, with -o") as own:
            own.check(files)
            own.begin_anew()
            for done, (view, name) in enumerate(zip(views, names, strict=True)):
                for plane, picture in _pictures(surfels, sky, view.camera, planes, scene).items():
                    metadata = colours if plane == "rgb" else None
                    write_image_atomic(own.new / plane / f"{name}.png", picture, metadata=metadata)
                frames.append(_described(view, name, planes, drive))
                progress(done + 1, len(views), "rendering")
            scale = {"metric": True} if drive.scale_source == "metric" else {}
            write_json_atomic(own.new / "transforms.json", {"camera_model": "PINHOLE", **scale, "frames": frames})
            own.exchange(rights=mode_like(first.image_path))
    except OSError as error:
        raise UnveilError(f"cannot be written: {error.strerror}", path=output) from error
    return len(views)


def _views(workspace: Workspace, drive: Drive, path: Path | None, beside: float, above: float) -> tuple[View, ...]:
    views = drive_path(drive) if path is None else read_camera_path(path, drive)
    along = None
    if path is None and beside and workspace.ground_npz.is_file():
        # Along the street, not from frame to frame: where a car stands or creeps, that would be its jitter.
        along = read_ground(workspace.ground_npz).path.direction_at(np.stack([v.camera.centre for v in views]))
    return shifted(views, beside=beside, above=above, along=along)


def check_planes(planes: Sequence[str]) -> None:
    """Check names of planes.

    Raises:
        SettingsError: an unknown one, or none.
    """
    unknown = [p for p in planes if p not in PLANES]
    if unknown or not planes:
        problem = f"Not a plane: {unknown[0]}" if unknown else "no plane is named"
        raise SettingsError(problem, mend=f"use {', '.join(PLANES)}")


def _check_settings(state: str, planes: Sequence[str], beside: float, above: float) -> None:
    check_scene_state(state)
    check_planes(planes)
    for name, shift in (("beside", beside), ("above", above)):
        if not math.isfinite(shift) or abs(shift) > FARTHEST_SHIFT_M:
            raise SettingsError(f"{shift:g} m {name} the path", mend=f"at most {FARTHEST_SHIFT_M:g} m either way")


def read_scene(workspace: Workspace, state: str) -> tuple[Surfels, Sky]:
    """The surfels and the sky of a state.

    Raises:
        SettingsError: an unknown state. WorkspaceError: there is no such scene yet.
    """
    return read_surfels(scene_file(workspace, state)), load_sky(workspace.root / "surfels/sky.npz")


def _pictures(
    surfels: Surfels, sky: Sky, camera: Camera, planes: Sequence[str], scene: SceneLabels | None
) -> dict[str, NDArray[np.uint8] | NDArray[np.uint16]]:
    """The asked planes of one view as they go to disk."""
    pictures: dict[str, NDArray[np.uint8] | NDArray[np.uint16]] = {}
    for plane, values in rendered_planes(surfels, sky, camera, planes, scene).items():
        if plane == "alpha":
            pictures[plane] = _levels(values)
        elif plane == "depth":
            steps = np.round(values * DEPTH_STEPS_PER_M)
            pictures[plane] = np.where(steps < 2**16, steps, 0).astype(np.uint16)
        elif plane == "normal":
            solid = values.any(axis=-1, keepdims=True)
            pictures[plane] = np.where(solid, _levels(0.5 * values + 0.5), 0).astype(np.uint8)
        else:
            pictures[plane] = values
    return pictures


def rendered_planes(
    surfels: Surfels, sky: Sky, camera: Camera, planes: Sequence[str], scene: SceneLabels | None
) -> dict[str, NDArray[Any]]:
    """The asked planes of one view by name: rgb and semantics as they go to disk; depth in metres, normals of unit length in the
    axes of normal maps and alpha as float32.

    Args:
        scene: labels of the surfels, for semantics.
    """
    surfels = near_camera(surfels, camera)
    needed = tuple(dict.fromkeys(n for p in planes for n in _NEEDS[p]))
    labels = None if scene is None else len(scene.labels)
    out = rendered(surfels, camera, needed, near=NEAR_M, far=FAR_M, label_count=labels)
    found = {n: array(getattr(out, n)) for n in needed}
    alpha = found["alpha"]
    solid = alpha > SOLID  # elsewhere the sky is seen: no depth, no normal, and the sky's label
    shown: dict[str, NDArray[Any]] = {}
    for plane in dict.fromkeys(planes):
        if plane == "rgb":
            shown[plane] = with_sky(found["rgb"], alpha, sky, camera)
        elif plane == "alpha":
            shown[plane] = alpha.astype(np.float32)
        elif plane == "depth":
            shown[plane] = surface_depth(out)
        elif plane == "normal":
            # To the axes of normal maps: OpenCV's y and z point the other way.
            normal = found["normal"] * (1, -1, -1)
            normal = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)
            shown[plane] = np.where(solid[..., None], normal, 0).astype(np.float32)
        else:
            assert scene is not None
            sky_label = scene.labels.index("sky")
            none = VOID if sky_label is None else scene.labels.disk_ids[sky_label]
            ids = np.array(scene.labels.disk_ids)[found["semantics"].argmax(axis=-1)]
            shown[plane] = np.where(solid, ids, none).astype(np.uint8)
    return shown


def _levels(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.clip(np.round(values * 255), 0, 255).astype(np.uint8)


def _described(view: View, name: str, planes: Sequence[str], drive: Drive) -> dict[str, object]:
    """The view's entry of transforms.json, in the drive's own coordinates and OpenGL axes."""
    camera = view.camera
    pose = camera.camera_to_world
    pose[:3, 3] = drive.to_world.to_world(pose[:3, 3])
    pose[:3, :3] = drive.to_world.rotation @ pose[:3, :3]
    pose[:3, 1:3] *= -1
    keys = {"depth": "depth_file_path", "semantics": "semantic_path"}
    files = {keys.get(p, "file_path"): f"{p}/{name}.png" for p in planes if p in keys}
    return {
        "file_path": f"{'rgb' if 'rgb' in planes else planes[0]}/{name}.png",
        **files,
        "camera": view.track,
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "transform_matrix": pose.tolist(),
    }
