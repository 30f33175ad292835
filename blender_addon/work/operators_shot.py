# SPDX-License-Identifier: GPL-3.0-or-later
"""Use This Shot: the active camera with the plates behind it becomes a drive, which is then imported into the same scene."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty

from ..formats.files import is_link, one_line
from ..formats.shot.place import shot_folder
from ..formats.shot.writer import write_shot
from ..formats.writing.new_files import NewFiles, Somebodys
from ..scene import blocks, versions
from ..scene.settings import SET_UP_SCENE
from ..scene.shot.camera import ShotError
from ..scene.shot.take import shot_of
from .job.calling import called

__all__: list[str] = []


class UNVEIL_OT_use_shot(bpy.types.Operator):
    """Make a drive of the active camera, the plates behind it and the known points, and import it into this scene"""

    bl_idname = "unveil.use_shot"
    bl_label = "Use This Shot"

    folder: StringProperty(
        name="Drive",
        subtype="DIR_PATH",
        description="Folder that the drive is written to; empty: beside the .blend",
        options={"SKIP_SAVE"},
    )
    workspace: StringProperty(
        name="Results Folder", subtype="DIR_PATH", description="Folder of the results; empty: beside the drive"
    )
    set_up_scene: BoolProperty(**{**SET_UP_SCENE, "default": False})
    run_import: BoolProperty(
        name="Import",
        default=True,
        description="Import the drive; off: only write it, for `unveil run` on another machine",
    )
    replace: BoolProperty(
        name="Replace",
        description="Write over files of the drive that were changed since, or that Unveil did not write",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.scene.camera is None:
            cls.poll_message_set("The scene has no active camera")
            return False
        return bool(bpy.ops.unveil.import_drive.poll())

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask before something of somebody is written over."""
        if versions.has_window() and not self.replace:
            try:
                with self._files(context):
                    pass
            except Somebodys as error:
                self.replace = True
                return context.window_manager.invoke_confirm(
                    self, event, title="Write Over It?", message=str(error), confirm_text="Write Over", icon="WARNING"
                )
            except (ShotError, OSError, ValueError):
                pass  # told below
        return self.execute(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        try:
            with self._files(context) as files:
                taken = shot_of(context, files)
                drive = write_shot(files, taken.shot)
        except ShotError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, one_line(error, scene.name))
            return {"CANCELLED"}
        for line in taken.told:
            self.report({"WARNING"}, line)
        settings = scene.unveil
        settings.start_frame, settings.set_up_scene = taken.shot.frames[0].number, self.set_up_scene
        settings.frames = settings.cameras = ""
        if not self.run_import:
            settings.drive = str(drive)
            self.report({"INFO"}, f"{drive}: {len(taken.shot.frames)} frames")
            return {"FINISHED"}
        words = {"filepath": str(drive), "workspace": self.workspace}
        return called(self, bpy.ops.unveil.import_drive, "INVOKE_DEFAULT", **words)

    def _files(self, context: bpy.types.Context) -> AbstractContextManager[NewFiles]:
        folder = blocks.absolute(self.folder) if self.folder else _default_folder(context.scene)
        return shot_folder(folder, mend="choose another folder, or Replace", replace=self.replace)


def _default_folder(scene: bpy.types.Scene) -> Path:
    """Beside the .blend.

    Raises:
        ShotError: it was not saved yet; or a link is there, which may be a stranger's.
    """
    if not bpy.data.filepath:
        raise ShotError("The drive is written beside the .blend: save that first, or give a folder")
    blend = Path(bpy.data.filepath)
    folder = blend.parent / f"{blend.stem}_{bpy.path.clean_name(scene.camera.name)}_shot"
    if is_link(folder):
        raise ShotError(f"{folder}: is a link: remove it, or give a folder")
    return folder


def _menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.operator(UNVEIL_OT_use_shot.bl_idname, icon="CAMERA_DATA")


CLASSES = (UNVEIL_OT_use_shot,)


def register() -> None:
    for menu in _menus():
        menu.append(_menu)


def unregister() -> None:
    for menu in _menus():
        menu.remove(_menu)


def _menus() -> list[type]:
    """Where an artist looks for it: 3D View > View > Cameras, Movie Clip Editor > Reconstruction."""
    return [bpy.types.VIEW3D_MT_view_cameras, bpy.types.CLIP_MT_reconstruction]
