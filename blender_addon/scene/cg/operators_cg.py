# SPDX-License-Identifier: GPL-3.0-or-later
"""My car in the empty street, at one click: the scene renders the artist's objects over the clean plate, with their shadows."""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path

import bpy
from bpy.props import BoolProperty

from ...formats.object_files import found_sun
from .. import blocks, cameras, drive_scene, versions, view
from . import aside, catcher, plate_nodes

__all__: list[str] = []


class UNVEIL_OT_set_up_cg(bpy.types.Operator):
    """Ready the scene for your own objects: a transparent film, the clean plate under the render, the street's mesh as shadow
    catcher, and the view transform Standard. Then F12 shows your car in the empty street"""

    bl_idname = "unveil.set_up_cg"
    bl_label = "Set Up for CG"
    bl_options = {"REGISTER", "UNDO"}

    shadows: BoolProperty(
        name="Shadows on the Street",
        default=True,
        description="Render with Cycles, which lets the street's mesh take shadows; off: the render engine stays",
    )
    sun: BoolProperty(
        name="Add Sun and Sky",
        default=True,
        description="Where the scene has no light: a sun from where the footage has it, else from the shadow settings, and a sky",
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        collection = view.shown_drive(context.scene)
        if collection is None or not collection.get("unveil_clean"):
            cls.poll_message_set("There are no clean frames yet: press Unveil first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene, collection = context.scene, view.shown_drive(context.scene)
        assert collection is not None
        mark = blocks.drive_of(collection)
        tracks = drive_scene.tracks_of(collection)
        camera = scene.camera if scene.camera in tracks else tracks[0]
        plate = next((b for b in camera.data.background_images if _is_clean(b)), None)
        if plate is None:
            self.report({"ERROR"}, f"Camera {camera.name} has no clean frames (run Unveil, or Reload Results)")
            return {"CANCELLED"}
        try:
            plate_nodes.put_under(scene, mark, plate)
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        aside.put_aside(scene)
        cameras.fit_scene_to(scene, camera)
        scene.render.film_transparent = True
        versions.switch_compositor_on(scene)
        scene.render.use_sequencer = False
        scene.view_settings.view_transform = "Standard"
        scene.view_settings.look, scene.view_settings.exposure, scene.view_settings.gamma = "None", 0.0, 1.0
        mesh = blocks.find(bpy.data.objects, mark, "mesh:empty")
        if mesh is not None and self.shadows:
            catcher.catch(mark, mesh)
            scene.render.engine = "CYCLES"
        if self.sun and self.shadows:
            lit = catcher.add_sun(scene, collection, *_sun(scene, collection))
            if lit is not None:
                catcher.add_sky(scene)
        collection[view.CG] = True
        view.apply(scene)
        without = "" if mesh is not None else "; there is no mesh yet, so no shadows fall on the street"
        self.report({"INFO"}, f"F12 renders your objects over the clean plate of {camera.name}{without}")
        return {"FINISHED"}


def _sun(scene: bpy.types.Scene, collection: bpy.types.Collection) -> tuple[float, float]:
    """Azimuth and elevation of the sun that the results went by, radians; those of the settings where they tell none."""
    with suppress(OSError, ValueError):  # the results are loaded: whatever is wrong with that file was told
        found = found_sun(Path(blocks.workspace_of(collection)))
        if found is not None and 0 < found[1] <= 90:
            return math.radians(found[0]), math.radians(found[1])
    return scene.unveil.sun_azimuth, scene.unveil.sun_elevation


def _is_clean(plate: bpy.types.CameraBackgroundImage) -> bool:
    return plate.image is not None and str(plate.image.get(blocks.ROLE, "")).startswith("plate:clean:")


CLASSES = (UNVEIL_OT_set_up_cg,)
