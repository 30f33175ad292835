# SPDX-License-Identifier: GPL-3.0-or-later
"""What goes: ``scene.unveil_selection`` with the classes and objects of the drive, and the options that a run gets of it."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..formats.boxes import SceneBox
from ..formats.drive_files import ImportedDrive
from ..formats.files import file_stamp
from ..formats.object_files import ListedObject, read_choice, read_listed, read_moving, recorded_settings
from ..formats.timeline import Timeline, timeline_of
from ..scene import blocks, drive_scene, versions
from . import as_made, fixes, marks
from .quick.filters import UnveilFilter

__all__ = [
    "MARKED",
    "UnveilClass",
    "UnveilObject",
    "UnveilSelection",
    "arguments",
    "box_of",
    "chosen_arguments",
    "column",
    "fill",
    "is_marked",
    "lists_nothing",
    "marked_file",
    "problem",
    "stands",
]


UNKNOWN, MARKED, UNLISTED = -1, -2, -3
"""Rows of objects whose row nobody has looked up yet, that a person marked, and whose class is not listed."""


def _redraw_views(self: Any, context: bpy.types.Context) -> None:
    """Their boxes have another colour now, and nothing else tells a view of it."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


class UnveilObject(bpy.types.PropertyGroup):
    """One object that can go; its ``name`` is for people and for searching."""

    number: IntProperty(description="The number of the object in the workspace")
    class_name: StringProperty()
    row: IntProperty(default=UNKNOWN, description="Of its class in the list of classes; negative: it belongs to none")
    source: StringProperty(description="How it was found: images, clusters, box or mattes")
    chosen: BoolProperty(name="Remove", description="Take this object out of the street", update=_redraw_views)
    moves: BoolProperty(description="It moves during the drive, and is removed in any case")
    boxed: BoolProperty(
        description="Whether its place is known; of no meaning for a wire cube, which is a place itself"
    )
    centre: FloatVectorProperty(size=3)
    size: FloatVectorProperty(size=3)
    yaw: FloatProperty()
    distance: FloatProperty(description="From the nearest camera that sees it, metres; negative: unknown")
    frames: IntProperty(description="How many frames show it")
    first_frame: StringProperty()
    last_frame: StringProperty()
    best_track: StringProperty(description="The camera that shows it best")
    best_frame: IntProperty(default=-1, description="The frame of the timeline that shows it best; negative: none")
    points: IntProperty()
    thumbnail: StringProperty()
    thumbnail_stamp: StringProperty(description="When it was written: drawing does not ask the disk")
    marker: PointerProperty(type=bpy.types.Object, description="The wire cube around what nobody labelled")
    grow: IntProperty(
        name="Grow",
        subtype="PIXEL",
        min=0,
        max=200,
        description="Enlarge its mask by pixels of the delivered frame, where something of it is left",
    )
    keep_shadow: BoolProperty(name="Keep Shadow", description="Leave the shadow that it casts in the street")
    mattes: StringProperty(subtype="DIR_PATH", options=versions.PATH)


def column(listed: UnveilSelection, name: str, kind: type, width: int = 1) -> np.ndarray:
    """(N,) or (N, width) of a property of all listed objects: drawing hundreds has no time to ask each."""
    values = np.zeros(len(listed.objects) * width, {bool: np.bool_, int: np.int32, float: np.float32}[kind])
    listed.objects.foreach_get(name, values)
    return values if width == 1 else values.reshape(-1, width)


def _rows(listed: UnveilSelection) -> np.ndarray:
    """(N,) row of each object's class; negative for one that cannot be chosen with its class."""
    rows = column(listed, "row", int)
    if (rows == UNKNOWN).any():  # a file of a version that did not keep them
        rows = np.array([_row_of(o, listed) for o in listed.objects], np.int32)
    rows[(rows >= 0) & column(listed, "moves", bool)] = UNLISTED
    return rows


def _row_of(thing: UnveilObject, listed: UnveilSelection) -> int:
    row = MARKED if is_marked(thing) else listed.classes.find(thing.class_name)
    return UNLISTED if row == -1 else row


def _of_class(self: UnveilClass) -> np.ndarray:
    """Indices of its objects that can be chosen one by one."""
    listed = self.id_data.unveil_selection
    return np.flatnonzero(_rows(listed) == listed.classes.find(self.name))


def _class_chosen(self: UnveilClass) -> bool:
    own = _of_class(self)
    return bool(column(self.id_data.unveil_selection, "chosen", bool)[own].all()) if len(own) else self.alone


def _choose_class(self: UnveilClass, value: bool) -> None:
    own = _of_class(self)
    self.alone = value and not len(own)
    for i in own:
        self.id_data.unveil_selection.objects[int(i)].chosen = value


class UnveilClass(bpy.types.PropertyGroup):
    """One class of the drive's labels, by its name."""

    chosen: BoolProperty(
        name="Remove", description="Take all of this class out of the street", get=_class_chosen, set=_choose_class
    )
    alone: BoolProperty(description="Whether the class is removed where it has no single objects")
    removable: BoolProperty()
    objects: IntProperty()
    points: IntProperty()
    pixels: IntProperty()


class UnveilSelection(bpy.types.PropertyGroup):
    """What can go and what does. Saved with the .blend."""

    workspace: StringProperty(description="Absolute path of the workspace that the lists are of")
    objects: CollectionProperty(type=UnveilObject)
    classes: CollectionProperty(type=UnveilClass)
    active: IntProperty(name="Object", default=0)
    active_class: IntProperty(name="Class", default=0)
    boxes: EnumProperty(
        name="Boxes",
        description="Which objects' boxes the 3D views draw; a click on one chooses it",
        items=(
            ("ALL", "All", "All objects; in After the active one alone, for the others would cover the result"),
            ("GOING", "Removed", "What is chosen to go, in After, too"),
            ("ACTIVE", "Active Only", "The object whose row is active: isolated"),
            ("NONE", "None", "No boxes"),
        ),
        update=_redraw_views,
    )
    ghosts: BoolProperty(
        name="Ghosts",
        description="Fill the boxes of what goes with a translucent color, so that its place is seen in After, too",
        update=_redraw_views,
    )
    filter: PointerProperty(type=UnveilFilter)
    fixes: CollectionProperty(type=fixes.UnveilFix)
    active_fix: IntProperty(name="Fix", default=0)
    as_made: StringProperty(description="The choice that the workspace was made with, see as_made.py")
    marked_from: StringProperty(description="A file of marks that is not the workspace's own")
    marked_as: StringProperty(description="What the marks were when they were read there")
    corrections_from: StringProperty(description="A file of corrections that is not the workspace's own")
    all_classes: BoolProperty(name="All Classes", description="Also list classes that are not usually removed")


# ------------------------------------------------------------------------------------------------------------ what it holds


def is_marked(thing: UnveilObject) -> bool:
    """Whether a person marked it, by a box or mattes."""
    return thing.source in ("box", "mattes")


def box_of(thing: UnveilObject) -> SceneBox | None:
    """The box of an object: where its wire cube is now, for one that has such; None where nothing is known of its place."""
    if thing.source == "box":
        return None if not marks.alive(thing.marker) else marks.box_of_marker(thing.marker)
    return SceneBox(tuple(thing.centre), tuple(thing.size), thing.yaw) if thing.boxed else None


def current(scene: Any) -> bool:
    """Whether the lists are of the workspace that is set."""
    place = scene.unveil.workspace
    listed = scene.unveil_selection.workspace
    return bool(place and listed) and blocks.same_place(place, listed)


def standing(scene: Any) -> list[UnveilObject]:
    """The objects whose choice counts: not those that move, nor marks whose wire cube was deleted."""
    return [o for o in scene.unveil_selection.objects if stands(o)]


# ---------------------------------------------------------------------------------------------------------- what a run gets


def chosen(scene: Any) -> tuple[list[str], list[int]]:
    """Names of the classes that go whole, and ids of the single objects that go beside them."""
    listed = scene.unveil_selection
    rows, ticked = _rows(listed), column(listed, "chosen", bool)
    whole = _whole_rows(listed, rows, ticked)
    goes = ticked & ~column(listed, "moves", bool) & ~np.isin(rows, whole)
    goes[[int(i) for i in np.flatnonzero(rows == MARKED) if not stands(listed.objects[int(i)])]] = False
    return [listed.classes[row].name for row in whole], [int(n) for n in column(listed, "number", int)[goes]]


def chosen_classes(scene: Any) -> list[str]:
    """Names of the classes that go whole."""
    return chosen(scene)[0]


def chosen_numbers(scene: Any) -> list[int]:
    """Ids of the single objects that go beside these classes."""
    return chosen(scene)[1]


def _whole_rows(listed: UnveilSelection, rows: np.ndarray, ticked: np.ndarray) -> list[int]:
    """Rows of the classes that go whole: all of their objects are chosen, or they have none and are chosen themselves."""
    counts = np.bincount(rows[rows >= 0], minlength=len(listed.classes))
    left = np.bincount(rows[(rows >= 0) & ~ticked], minlength=len(listed.classes))
    return [i for i, c in enumerate(listed.classes) if (not left[i] if counts[i] else c.alone)]


def _marked(listed: UnveilSelection) -> list[int]:
    """Indices of the objects that a person marked."""
    return [int(i) for i in np.flatnonzero(_rows(listed) == MARKED)]


def stands(thing: UnveilObject) -> bool:
    """Whether the choice of an object counts."""
    return not thing.moves and not (thing.source == "box" and not marks.alive(thing.marker))


def arguments(scene: Any) -> list[str]:
    """Options of ``unveil run`` that say what is removed; none before a drive was imported, which means all that can be.

    Writes ``marked.json`` of the workspace where people marked objects and something of that has changed.
    """
    if not current(scene):
        return []
    path = _write_marked(scene)
    mended = fixes.write(scene)
    files = {"--marked": "" if path is None else str(path), "--corrections": mended}
    return [*chosen_arguments(scene), *(word for name, file in files.items() if file for word in (name, file))]


def _write_marked(scene: Any) -> Path | None:
    """The file of marks: the one that the workspace was made with, as long as they are the same; else its own, written anew."""
    listed, metre = scene.unveil_selection, drive_scene.metre_of(scene)
    if listed.marked_from:
        if _marks_as_text(scene) == listed.marked_as:
            return Path(listed.marked_from)
        listed.marked_from = ""
    return marks.write_marked(Path(listed.workspace), standing(scene), metre)


def _marks_as_text(scene: Any) -> str:
    place = Path(scene.unveil_selection.workspace)
    return json.dumps(marks.marked_entries(place, standing(scene), drive_scene.metre_of(scene)))


def preview_arguments(scene: Any, workspace: Path) -> list[str]:
    """The same for a preview, which finds objects anew by itself: those that have no label it knows by their boxes.

    Writes ``marked.json`` beside the preview's workspace.
    """
    if not current(scene):
        return []
    chosen = [o for o in standing(scene) if o.number in set(chosen_numbers(scene))]
    found = [o for o in chosen if o.source == "clusters" and o.boxed]
    names = {o.number: marks.AS_MARKED + o.number for o in found}
    numbers = [names.get(o.number, o.number) for o in chosen]
    boxes = {names[o.number]: (o.class_name, box_of(o)) for o in found}
    metre = drive_scene.metre_of(scene)
    place = Path(scene.unveil_selection.workspace)
    path = marks.write_marked(place, standing(scene), metre, boxes=boxes, into=workspace.with_suffix(".json"))
    classes = chosen_classes(scene)
    options = {"--remove": ",".join(classes), "--instances": ",".join(str(n) for n in numbers)}
    options["--marked"] = "" if path is None else str(path)
    return [word for name, value in options.items() if value for word in (name, value)]


def marked_file(scene: Any) -> str:
    """The file that tells of the marks in the list; empty where none is there."""
    listed = scene.unveil_selection
    marked = any(stands(listed.objects[i]) for i in _marked(listed))
    return (listed.marked_from or str(Path(listed.workspace) / marks.FILE)) if marked else ""


def chosen_arguments(scene: Any) -> list[str]:
    """The same without the marks' file. Quick, and touches no disk: for every redraw."""
    if not current(scene):
        return []
    return as_made.in_its_words(_chosen_arguments(scene), scene.unveil_selection.as_made)


def _chosen_arguments(scene: Any) -> list[str]:
    found: list[str] = []
    classes, numbers = chosen(scene)
    if classes:
        found += ["--remove", ",".join(classes)]
    if numbers:
        found += ["--instances", ",".join(str(n) for n in numbers)]
    listed = scene.unveil_selection
    told = np.flatnonzero((column(listed, "grow", int) > 0) | column(listed, "keep_shadow", bool))
    single = [
        entry
        for o in (listed.objects[int(i)] for i in told)
        for entry, has in ((f"{o.number}:grow={o.grow}", o.grow > 0), (f"{o.number}:shadow=keep", o.keep_shadow))
        if has
    ]
    return [*found, "--per-object", ",".join(single)] if single else found


def problem(scene: Any) -> str:
    """One line on why nothing can be removed as things stand, or an empty string."""
    if not current(scene) or any(chosen(scene)):
        return ""
    if lists_nothing(scene):
        return "Nothing is chosen: the drive has no labelled objects; add a box or mattes"
    if not scene.unveil_selection.objects:
        return "Nothing is chosen: tick a class; too few points lie on its objects to tell them apart"
    return "Nothing is chosen: tick what is to go, or click its box"


def lists_nothing(scene: Any) -> bool:
    """Whether the drive has neither objects nor classes that can go."""
    listed = scene.unveil_selection
    return not listed.objects and not any(c.removable for c in listed.classes)


# ------------------------------------------------------------------------------------------------------------------ filling


def fill(scene: bpy.types.Scene, drive: ImportedDrive) -> None:
    """List the classes and objects of a workspace; what was chosen in it stays chosen.

    Raises:
        ValueError: a damaged file; one line that names it.
    """
    selection, places = scene.unveil_selection, _places(drive, timeline_of(drive, scene.unveil.start_frame))
    place = str(drive.workspace.resolve())
    classes, objects = read_listed(drive)
    same = selection.workspace == place
    chosen = {o.number for o in selection.objects if o.chosen} if same else set()
    alone = {c.name for c in selection.classes if c.alone} if same else set()
    if not same:
        chosen, alone = _recorded(drive.workspace, objects)
    kept = [_keep(o) for o in selection.objects if is_marked(o)] if same else []
    single = (
        {o.number: (o.grow, o.keep_shadow) for o in selection.objects} if same else _recorded_single(drive.workspace)
    )
    if not same:
        selection.fixes.clear()
    known = {entry.number: entry for entry in objects}
    if not same:
        recorded = recorded_settings(drive.workspace)
        elsewhere = {
            name: as_made.file_elsewhere(drive.workspace, recorded, name) for name in ("marked", "corrections")
        }
        selection.marked_from, selection.corrections_from = elsewhere["marked"], elsewhere["corrections"]
        kept = marks.restore(scene, drive, Path(elsewhere["marked"]) if elsewhere["marked"] else None)
    moving = read_moving(drive)
    selection.workspace = place
    selection.objects.clear()
    for number, entry in known.items():
        if entry.source in ("box", "mattes"):
            continue
        thing = selection.objects.add()
        thing.number, thing.source, thing.class_name = number, entry.source, entry.class_name
        thing.chosen, thing.moves = number in chosen, number in moving
        _describe(thing, entry, drive, places)
    for mark in kept:
        thing = selection.objects.add()
        for name, value in mark.items():
            setattr(thing, name, value)
        if not same:
            thing.chosen = thing.number in chosen
        if thing.number in known:
            _describe(thing, known[thing.number], drive, places)
    for thing in selection.objects:
        thing.grow, thing.keep_shadow = single.get(thing.number, (0, False))
        thing.name = f"{thing.class_name} {thing.number}"
    selection.classes.clear()
    for entry in classes:
        item = selection.classes.add()
        item.name, item.removable, item.alone = entry.name, entry.removable, entry.name in alone
        item.objects, item.points, item.pixels = entry.objects, entry.points, entry.pixels // 1000
    for thing in selection.objects:
        thing.row = _row_of(thing, selection)
    selection.active = min(selection.active, max(len(selection.objects) - 1, 0))
    if not same:
        selection.as_made = as_made.remembered(_chosen_arguments(scene), recorded) if chosen or alone else ""
        selection.marked_as = _marks_as_text(scene) if selection.marked_from else ""


def _recorded(workspace: Path, objects: Sequence[ListedObject]) -> tuple[set[int], set[str]]:
    """What the workspace itself says was chosen: ids and classes."""
    recorded = read_choice(workspace)
    own = {o.number for o in objects if o.class_name in recorded.classes and o.source not in ("box", "mattes")}
    return own | recorded.instances, set(recorded.classes)


def _recorded_single(workspace: Path) -> dict[int, tuple[int, bool]]:
    """By object, how far its mask was enlarged and whether its shadow stayed, as the workspace says."""
    found: dict[int, tuple[int, bool]] = {}
    listed = recorded_settings(workspace).get("per_object")
    for entry in listed if isinstance(listed, list) else ():
        told = re.fullmatch(r"(\d{1,9}):(?:grow=(\d{1,3})|(shadow)=keep)", entry) if isinstance(entry, str) else None
        if told:
            grow, keep = found.get(int(told[1]), (0, False))
            found[int(told[1])] = (int(told[2]), keep) if told[2] else (grow, True)
    return found


def _keep(thing: UnveilObject) -> dict[str, Any]:
    """A mark, to be put into the list again."""
    names = ("number", "class_name", "source", "chosen", "marker", "mattes")
    return {name: getattr(thing, name) for name in names}


def _describe(
    thing: UnveilObject, entry: ListedObject, drive: ImportedDrive, places: dict[str, dict[str, int]]
) -> None:
    thing.frames, thing.points = entry.frames, entry.points
    own = next((frames for frames in places.values() if {entry.first_frame, entry.last_frame} <= set(frames)), {})
    thing.first_frame, thing.last_frame = (str(own.get(n, n)) for n in (entry.first_frame, entry.last_frame))
    track, frame = entry.best_camera or "", entry.best_frame or ""
    found = frame in places.get(track, ())
    thing.best_track, thing.best_frame = (track, places[track][frame]) if found else ("", -1)
    thing.distance = -1.0 if entry.distance_m is None else entry.distance_m
    thing.thumbnail = "" if entry.thumbnail is None else str(entry.thumbnail)
    thing.thumbnail_stamp = file_stamp(thing.thumbnail)
    thing.boxed = entry.box is not None and thing.source != "box"
    if entry.box is not None and thing.boxed:
        thing.centre, thing.size = ([v * drive.metre for v in part] for part in (entry.box.centre, entry.box.size))
        thing.yaw = entry.box.yaw - math.pi / 2  # the files count from east, the scene's x is north


def _places(drive: ImportedDrive, timeline: Timeline) -> dict[str, dict[str, int]]:
    """By track and name of a picture, the frame of the timeline that shows it."""
    return {
        track: {f.name: frame for f, frame in zip(frames, timeline.frames[track], strict=True)}
        for track, frames in drive.tracks.items()
    }


CLASSES = (UnveilObject, UnveilClass, UnveilSelection)


def register() -> None:
    bpy.types.Scene.unveil_selection = PointerProperty(type=UnveilSelection)


def unregister() -> None:
    del bpy.types.Scene.unveil_selection
