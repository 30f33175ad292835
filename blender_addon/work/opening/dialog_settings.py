# SPDX-License-Identifier: GPL-3.0-or-later
"""What a dialog asks before an import: the settings of the command that say what of a drive is read and how large it is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty

from ...formats.table.run_settings import SHOWN, RunSetting
from ...scene.settings import CAMERAS, SET_UP_SCENE, START_FRAME, property_of
from ..preferences import preferences

__all__ = ["ASKED", "DialogSettings", "Overlaid"]

ASKED = ("scene", "frames", "cameras", "labels", "segmenter", "sweeps", "scale", "camera_height", "up")
"""Settings of the table."""
DRAWN = (
    ("start_frame", "every_nth", "cameras", "workspace", "set_up_scene"),
    ("scene", "labels", "segmenter", "sweeps"),
    ("scale", "camera_height", "up"),
)
"""In groups."""
TABLE: dict[str, RunSetting] = {setting.name: setting for setting in SHOWN if setting.name in ASKED}


class Overlaid:
    """A ``scene.unveil`` with other values of some properties, for options that are only tried."""

    def __init__(self, settings: Any, values: dict[str, Any]) -> None:
        self._settings, self._values = settings, values

    def __getattr__(self, name: str) -> Any:
        return self._values[name] if name in self._values else getattr(self._settings, name)


class DialogSettings:
    """Mix in before ``bpy.types.Operator``."""

    workspace: StringProperty(
        name="Results Folder", subtype="DIR_PATH", description="Folder of the results; empty: beside the drive"
    )
    set_up_scene: BoolProperty(**SET_UP_SCENE)
    start_frame: IntProperty(**START_FRAME)
    every_nth: IntProperty(
        name="Every Nth Frame", default=1, min=1, soft_max=20, description="1: all frames of the drive"
    )
    cameras: StringProperty(**CAMERAS)
    more: BoolProperty(
        name="Labels, Scale and Up",
        description="Show what a drive tells by itself where nothing is wrong: its labels, its scale and its up axis",
        options={"SKIP_SAVE", "HIDDEN"},
    )

    def given(self) -> Iterator[tuple[str, Any]]:
        """Name and value of each property of a ``scene.unveil`` that somebody has set here."""
        is_set = self.properties.is_property_set  # type: ignore[attr-defined]
        for name in ("set_up_scene", "start_frame", *TABLE):
            if name != "frames" and is_set(name):
                yield name, getattr(self, name)
        if is_set("every_nth"):
            yield "frames", "" if self.every_nth == 1 else f"::{self.every_nth}"

    def words(self) -> dict[str, Any]:
        """What somebody has set, for another operator of this kind."""
        is_set = self.properties.is_property_set  # type: ignore[attr-defined]
        names = ("workspace", "set_up_scene", "start_frame", "every_nth", *TABLE)
        return {name: getattr(self, name) for name in names if name != "frames" and is_set(name)}

    def fill(self, context: bpy.types.Context, settings: Any) -> None:
        """Show what the scene has; what is given stays. Of a network that labels, the preferences name the usual one."""
        is_set = self.properties.is_property_set  # type: ignore[attr-defined]
        for name in ("set_up_scene", "start_frame", *TABLE):
            if name != "frames" and not is_set(name):
                setattr(self, name, getattr(settings, name))
        chosen = preferences(context)
        if chosen is not None and chosen.segmenter.strip() and not self.segmenter:
            self.segmenter = chosen.segmenter
        frames = settings.frames.removeprefix("::")
        if not is_set("every_nth") and settings.frames.startswith("::") and frames.isdigit() and int(frames) > 0:
            self.every_nth = int(frames)

    def draw_settings(self, layout: bpy.types.UILayout) -> None:
        layout.use_property_split, layout.use_property_decorate = True, False
        for i, names in enumerate(DRAWN):
            if i == 1:
                row = layout.row()
                row.use_property_split = False
                row.prop(self, "more", toggle=True, icon="TRIA_DOWN" if self.more else "TRIA_RIGHT")
            column = layout.column()
            for name in names if self.more or i == 0 else ():
                column.prop(self, name)

    def is_asked_more(self) -> bool:
        """Whether one of the settings that are not shown at first differs from what it usually is."""
        rest = (name for names in DRAWN[1:] for name in names)
        return any(getattr(self, name) != TABLE[name].start for name in rest)


DialogSettings.__annotations__.update(
    {name: property_of(setting) for name, setting in TABLE.items() if name not in ("frames", "cameras")}
)
