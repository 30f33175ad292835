# SPDX-License-Identifier: GPL-3.0-or-later
"""``blender --background [FILE.blend] --command unveil shot [CAMERA.abc|.fbx|.usd] --plates PLATE.1001.exr -o DRIVE``

A camera of another program, or of the .blend, as a drive that ``unveil run`` takes, without a window: what *Use This Shot* does.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import bpy

from ..formats.files import one_line
from ..formats.shot.numbering import number_in, numbered_name, numbers_like
from ..formats.shot.place import shot_folder
from ..formats.shot.writer import write_shot
from ..scene.shot.background import put_behind
from ..scene.shot.camera import ShotError
from ..scene.shot.take import shot_of

__all__ = ["make_drive"]

KINDS = (".abc", ".fbx", ".usd", ".usda", ".usdc", ".usdz")
POINTS = ("EMPTY", "MESH")
"""Kinds of objects that are taken for points."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> Any:
        raise ShotError(message)


def make_drive(arguments: list[str]) -> Path:
    """Write the drive.

    Args:
        arguments: those behind the verb.
    Returns:
        its transforms.json.
    Raises:
        ShotError: something of it cannot be used, in one line.
    """
    parser = _Parser(add_help=False, allow_abbrev=False)
    parser.add_argument("camera_file", type=Path, nargs="?")
    parser.add_argument("--plates", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--fps", type=float)
    parser.add_argument("--start", type=int)
    parser.add_argument("--camera")
    parser.add_argument("--units-per-metre", type=float)
    parser.add_argument("--no-points", action="store_true")
    parser.add_argument("--replace", action="store_true")
    given = parser.parse_args(arguments)
    scene = bpy.context.scene
    for name in ("fps", "units_per_metre"):
        value = getattr(given, name)
        if value is not None and not 0 < value < 1e6:
            raise ShotError(f"--{name.replace('_', '-')} is {value:g}: give a number above 0")
    if given.fps is not None:  # before anything is imported: keys are placed by it
        scene.render.fps = max(round(given.fps), 1)
        scene.render.fps_base = scene.render.fps / given.fps
    if given.camera_file is not None:
        _imported(given.camera_file)
    if given.units_per_metre is not None:
        scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 1 / given.units_per_metre
    scene.camera = _camera(given.camera, scene)
    if given.plates is not None:
        _with_plates(scene, given.plates.absolute(), given.start)
    for thing in bpy.context.view_layer.objects:
        thing.select_set(thing.type in POINTS and not given.no_points)
    try:
        mend = "name another folder with -o, or add --replace"
        with shot_folder(given.output.absolute(), mend=mend, replace=given.replace) as files:
            taken = shot_of(bpy.context, files)
            drive = write_shot(files, taken.shot)
    except (OSError, ValueError) as error:
        raise ShotError(one_line(error, given.output)) from error
    for line in taken.told:
        print(f"unveil: {line}", file=sys.stderr)
    return drive


def _imported(path: Path) -> None:
    """Bring a file's cameras, empties and meshes into the scene, in the place of what a new file has."""
    if not path.is_file() or path.suffix.lower() not in KINDS:
        raise ShotError(f"{path}: Not a file of a camera (use {', '.join(KINDS)})")
    if not bpy.data.filepath:
        bpy.data.batch_remove(list(bpy.data.objects))
    name = str(path.absolute())
    try:
        if path.suffix.lower() == ".abc":
            bpy.ops.wm.alembic_import(filepath=name, as_background_job=False, set_frame_range=False)
        elif path.suffix.lower() == ".fbx":
            bpy.ops.import_scene.fbx(filepath=name, anim_offset=0.0)
        else:
            bpy.ops.wm.usd_import(filepath=name, set_frame_range=False)
    except (RuntimeError, AttributeError) as error:
        problem = str(error).strip().splitlines()[-1] if str(error).strip() else "Blender cannot import it"
        raise ShotError(f"{path}: {problem}") from error


def _camera(name: str | None, scene: bpy.types.Scene) -> bpy.types.Object:
    """The camera that is meant: by its name, the scene's, or the only one."""
    cameras = [o for o in scene.objects if o.type == "CAMERA"]
    if name is not None:
        chosen = [o for o in cameras if name in (o.name, o.data.name)]
    else:
        chosen = [scene.camera] if scene.camera in cameras else cameras
    if len(chosen) != 1:
        listed = ", ".join(o.name for o in cameras[:8]) or "none"
        what = f"no camera {name}" if name is not None else "no camera" if not cameras else f"{len(cameras)} cameras"
        raise ShotError(f"the scene has {what}, but {listed}: name one by --camera")
    return chosen[0]


def _with_plates(scene: bpy.types.Scene, plate: Path, start: int | None) -> None:
    """All plates of a picture's sequence behind the camera; frames are their numbers, unless ``start`` is that of the first."""
    if not plate.is_file():
        raise ShotError(f"{plate}: Not found: give a picture of the sequence, as plate.1001.exr")
    if number_in(plate) is None:
        raise ShotError(f"{plate}: has no number in its name: give a picture of a sequence, as plate.1001.exr")
    numbers = numbers_like(plate)
    first = plate.with_name(numbered_name(plate.name, numbers[0]))
    for shown in list(scene.camera.data.background_images):
        scene.camera.data.background_images.remove(shown)
    put_behind(scene, scene.camera, first, numbers[-1] - numbers[0] + 1, numbers[0] if start is None else start)
