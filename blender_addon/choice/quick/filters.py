# SPDX-License-Identifier: GPL-3.0-or-later
"""Which objects the list shows, and in which order: by class, size, distance and frames."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

__all__ = ["UnveilFilter", "ranks", "shown", "sizes"]


class UnveilFilter(bpy.types.PropertyGroup):
    """Of the list of objects."""

    opened: BoolProperty(name="Filter", description="Show what the list is filtered and sorted by")
    class_name: StringProperty(name="Class", description="Show objects of this class alone; empty: of all")
    smallest: FloatProperty(
        name="Size", description="Show objects whose longest side is at least this long, in metres", min=0, precision=1
    )
    farthest: FloatProperty(
        name="Within",
        description="Show objects that come at least this near to the camera, in metres; 0: all",
        min=0,
        precision=0,
    )
    fewest: IntProperty(name="Frames", description="Show objects that at least so many frames show", min=0)
    sort: EnumProperty(
        name="Sort",
        description="What the list is sorted by",
        items=(
            ("NONE", "As Found", "In the order in which objects were found"),
            ("NAME", "Name", "By class and number"),
            ("SIZE", "Size", "The largest first"),
            ("AWAY", "Distance", "The nearest first"),
            ("SEEN", "Frames", "Those that most frames show first"),
            ("GOES", "Removed", "What goes first"),
        ),
    )
    reverse: BoolProperty(name="Reverse", description="Sort the other way round")


def sizes(listed: Any, metre: float) -> np.ndarray:
    """(N,) longest sides in metres; 0 where nothing is known of it."""
    count = len(listed.objects)
    sides, boxed = np.zeros(3 * count, np.float32), np.zeros(count, np.bool_)
    listed.objects.foreach_get("size", sides)
    listed.objects.foreach_get("boxed", boxed)
    return np.where(boxed, sides.reshape(-1, 3).max(axis=1, initial=0.0), 0.0) / metre


def _column(listed: Any, name: str, kind: type) -> np.ndarray:
    values = np.zeros(len(listed.objects), kind)
    listed.objects.foreach_get(name, values)
    return values


def shown(listed: Any, metre: float) -> np.ndarray:
    """(N,) bool: whether the filter lets an object through; what nothing is known of passes only where that is not asked for.

    Args:
        listed: ``scene.unveil_selection``; metre: units of the scene.
    """
    wanted = listed.filter
    found = np.ones(len(listed.objects), np.bool_)
    if wanted.class_name:
        found &= np.array([o.class_name == wanted.class_name for o in listed.objects], np.bool_)
    if wanted.smallest > 0:
        found &= sizes(listed, metre) >= wanted.smallest
    if wanted.farthest > 0:
        away = _column(listed, "distance", np.float32)
        found &= (away >= 0) & (away <= wanted.farthest)
    if wanted.fewest > 0:
        found &= _column(listed, "frames", np.int32) >= wanted.fewest
    return found


def ranks(listed: Any, metre: float) -> list[int]:
    """The place of each object in the sorted list; empty where they stay as they were found."""
    wanted = listed.filter
    if wanted.sort == "NONE":
        return list(range(len(listed.objects)))[::-1] if wanted.reverse else []
    if wanted.sort == "NAME":
        keys = [(o.class_name, o.number) for o in listed.objects]
        order = sorted(range(len(keys)), key=keys.__getitem__)
    else:
        away = _column(listed, "distance", np.float32)
        values = {
            "SIZE": lambda: -sizes(listed, metre),
            "AWAY": lambda: np.where(away < 0, np.inf, away),
            "SEEN": lambda: -_column(listed, "frames", np.int32),
            "GOES": lambda: ~(_column(listed, "chosen", np.bool_) | _column(listed, "moves", np.bool_)),
        }[wanted.sort]()
        order = [int(i) for i in np.argsort(values, kind="stable")]
    found = [0] * len(order)
    for place, i in enumerate(reversed(order) if wanted.reverse else order):
        found[i] = place
    return found


CLASSES = (UnveilFilter,)
