"""Class names and colours."""

from __future__ import annotations

from blender_addon.formats.classes import CITYSCAPES, color_table
from unveil_core.semantics import classes


def test_class_colours_are_the_projects() -> None:
    assert tuple(CITYSCAPES) == classes.CITYSCAPES and tuple(CITYSCAPES.values()) == classes.COLORS
    assert tuple(color_table("semantics")[13]) == (0, 0, 142)
