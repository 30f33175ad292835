# SPDX-License-Identifier: GPL-3.0-or-later
"""What a new file of Blender's brings, and nobody has touched, is put aside: a cube in the midst of the street is no start."""

from __future__ import annotations

import bpy
import numpy as np

from .. import blocks

__all__ = ["put_aside"]

NAME, ROLE = "Set Aside", "aside"
FACTORY = {
    "Cube": ("MESH", (0.0, 0.0, 0.0)),
    "Light": ("LIGHT", (4.076, 1.005, 5.904)),
    "Camera": ("CAMERA", (7.359, -6.926, 4.958)),
}
"""By name: the kind and place that Blender gives them."""
OFF = 0.01


def put_aside(scene: bpy.types.Scene) -> list[str]:
    """Move the untouched cube, light and camera of a new file into a collection that is switched off, and tell which.

    What was moved, renamed, animated, linked or modified is the artist's, and stays.
    """
    aside = next((c for c in scene.collection.children if c.get(blocks.ROLE) == ROLE and blocks.is_own(c)), None)
    there = set() if aside is None else set(aside.objects)
    found = [thing for thing in scene.collection.all_objects if thing not in there and _is_untouched(thing)]
    if not found:
        return []
    if aside is None:
        aside = bpy.data.collections.new(NAME)
        aside[blocks.ROLE] = ROLE
        scene.collection.children.link(aside)
    for thing in found:
        for collection in list(thing.users_collection):
            collection.objects.unlink(thing)
        aside.objects.link(thing)
    aside.hide_viewport = aside.hide_render = True
    return [thing.name for thing in found]


def _is_untouched(thing: bpy.types.Object) -> bool:
    kind, place = FACTORY.get(thing.name, ("", ()))
    return (
        thing.type == kind
        and thing.library is None
        and np.abs(np.array(thing.location) - place).max() < OFF
        and thing.animation_data is None
        and thing.parent is None
        and not len(thing.modifiers)
        and not len(thing.constraints)
        and (kind != "MESH" or len(thing.data.vertices) == 8)
    )
