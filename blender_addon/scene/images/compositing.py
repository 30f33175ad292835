# SPDX-License-Identifier: GPL-3.0-or-later
"""A node group a camera for the compositor: photograph over clean plate by the mattes of the removed objects.

Its inputs are a factor an object: 1 is removed, 0 brings the object back. With all at 1 the image is the clean plate.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy

from ...formats import sequences
from ...formats.drive_files import ImportedDrive
from ...formats.plate_files import TrackPlates, st_maps_of
from ...formats.timeline import Timeline
from .. import blocks, drive_scene, versions, view
from . import plates

__all__ = ["LENSES", "add_to_compositor", "group_of", "has_delivered", "in_lens", "set_group", "tracks_of"]

LENSES = (
    ("DELIVERED", "As delivered", "In the lens of the footage: replaces the footage pixel by pixel"),
    ("UNDISTORTED", "Undistorted", "Without the lens, at full size: fits behind Blender's camera"),
)
"""What the group gives."""
IMAGE, MATTE = "Image", "Matte"
"""Outputs."""
PLANES = {"provenance": ("Provenance", 255.0), "certainty": ("Certainty", 1.0)}
"""Sequences of a number a pixel: the output, and its value where the file is white: 0 to 4 by origin, and 0 to 1."""
PLAN = "unveil_plan"
"""On a group: what it was built of. As long as that is the same, what is in it may be the artist's work, and stays."""
COLUMN, ROW = 260, 320
"""Distance of nodes."""


def tracks_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The cameras of the shown drive; touches no disk, as all that panels ask."""
    collection = view.shown_drive(scene)
    return [] if collection is None else drive_scene.tracks_of(collection)


def has_delivered(scene: bpy.types.Scene) -> bool:
    """Whether the shown drive had all its clean frames when it was loaded."""
    tracks = tracks_of(scene)
    return bool(tracks) and all(c.get("unveil_delivered") for c in tracks)


def in_lens(scene: bpy.types.Scene) -> bool:
    """Whether any of its footage has a lens."""
    return any(c.get("unveil_in_lens") for c in tracks_of(scene))


def group_of(scene: bpy.types.Scene, track: str) -> bpy.types.NodeTree | None:
    """The group of a track of the shown drive."""
    collection = view.shown_drive(scene)
    return collection and blocks.find(bpy.data.node_groups, blocks.drive_of(collection), f"composite:{track}")


# ------------------------------------------------------------------------------------------------------------------- the group


def set_group(
    mark: str, track: str, drive: ImportedDrive, timeline: Timeline, made: TrackPlates, lens: str
) -> bpy.types.NodeTree:
    """The group of a track, made or brought up to date; attached to nothing.

    Args:
        lens: of :data:`LENSES`; where the footage has none both are the same.
    Raises:
        OSError: a copy of a picture cannot be made.
    """
    frames = drive.tracks[track]
    end = "_in_lens" if any(f.in_lens for f in frames) else ""
    maps = st_maps_of(drive, track)
    pictures = {
        "photograph": _Pictures([f.footage for f in frames], f"original{end}", False),
        "clean": _Pictures(made.clean, "plate_clean", False),
        **{m.key: _Pictures(m.files, f"matte_{m.key}", True) for m in made.mattes},
    }
    planes = [kind for kind in PLANES if getattr(made, kind)]
    pictures |= {kind: _Pictures(getattr(made, kind), f"plate_{kind}", True) for kind in planes}
    for name, file in maps.items():
        _still(mark, f"st:{name}:{track}", file, f"{track} ST map {name}")
    flat = lens == "UNDISTORTED" and bool(maps)
    names = {m.key: m.name for m in made.mattes}
    plan = json.dumps([names, planes, flat])
    role = f"composite:{track}"
    groups = bpy.data.node_groups
    group = blocks.ensure(groups, mark, role, lambda: groups.new(f"Unveil {track}", "CompositorNodeTree"))
    group.use_fake_user = True
    if group.get(PLAN) != plan:
        outputs = [IMAGE, MATTE, *(PLANES[kind][0] for kind in planes)]
        _set_sockets(group, list(names.values()), outputs)
        undistort = blocks.find(bpy.data.images, mark, f"st:undistort:{track}") if flat else None
        _build(group, names, planes, undistort)
        group[PLAN] = plan
    wanted = set()
    for kind, sequence in pictures.items():
        start = timeline.first(track)
        numbered = sequences.numbered(
            timeline.held(track, sequence.files), drive.workspace, "blender", sequence.folder, track
        )
        own = f"composite:{kind}:{track}"
        image = blocks.ensure_file(
            bpy.data.images, mark, own, str(numbered.files[0]), f"{track} {names.get(kind, kind)}"
        )
        if sequence.is_data:
            image.colorspace_settings.is_data = True
        image.source = "SEQUENCE" if len(numbered) > 1 else "FILE"
        plates.reload_changed(image, numbered.files)
        for node in [n for n in group.nodes if n.get(blocks.ROLE) == kind]:
            node.image = image
            if len(numbered) > 1:
                node.frame_start, node.frame_duration, node.frame_offset = start, len(numbered), numbered.first - 1
                node.use_auto_refresh = True
        wanted.add(own)
    _forget_others(mark, track, wanted)
    return group


class _Pictures:
    """One file a picture; ``folder``: of copies of them, where Blender needs such; ``is_data``: numbers rather than colours."""

    def __init__(self, files: Sequence[Path], folder: str, is_data: bool) -> None:
        self.files, self.folder, self.is_data = list(files), folder, is_data


def _still(mark: str, role: str, file: Path, name: str) -> bpy.types.Image:
    image = blocks.ensure_file(bpy.data.images, mark, role, str(file), name)
    image.colorspace_settings.is_data = image.use_fake_user = True
    plates.reload_changed(image, [file])
    return image


def _forget_others(mark: str, track: str, wanted: set[str]) -> None:
    """Take away pictures of objects that are no longer removed, unless somebody uses them."""
    for image in [i for i in bpy.data.images if i.get(blocks.DRIVE) == mark and blocks.is_own(i)]:
        role = str(image.get(blocks.ROLE, ""))
        ours = role.startswith("composite:") and role.split(":", 2)[2] == track
        if ours and role not in wanted and not image.users:
            bpy.data.images.remove(image)


def _set_sockets(group: bpy.types.NodeTree, factors: list[str], outputs: list[str]) -> None:
    """Inputs and outputs by name; those that are there keep their values in whatever node shows the group."""
    wanted = [*(("INPUT", name) for name in factors), *(("OUTPUT", name) for name in outputs)]
    there = {(i.in_out, i.name): i for i in group.interface.items_tree if i.item_type == "SOCKET"}
    for key, item in there.items():
        if key not in wanted:
            group.interface.remove(item)
    for way, name in [key for key in wanted if key not in there]:
        kind = "NodeSocketColor" if name == IMAGE and way == "OUTPUT" else "NodeSocketFloat"
        socket = group.interface.new_socket(name, in_out=way, socket_type=kind)
        if way == "INPUT":
            socket.subtype, socket.min_value, socket.max_value, socket.default_value = "FACTOR", 0.0, 1.0, 1.0
            socket.description = "1: removed, 0: as photographed"
            for node in _nodes_of(group):  # Blender gives them 0, whatever the default is
                node.inputs[name].default_value = 1.0


def _nodes_of(group: bpy.types.NodeTree) -> list[bpy.types.Node]:
    """All nodes that show a group, in this file's own trees."""
    trees = [*bpy.data.node_groups, *(getattr(scene, "node_tree", None) for scene in bpy.data.scenes)]
    nodes = [n for tree in trees if tree is not None and blocks.is_own(tree) for n in tree.nodes]
    return [n for n in nodes if getattr(n, "node_tree", None) == group]


def _build(
    group: bpy.types.NodeTree, names: dict[str, str], planes: Sequence[str], undistort: bpy.types.Image | None
) -> None:
    """The nodes, anew. Images are put in afterwards.

    Args:
        names: of the inputs, by the keys of their mattes; planes: of :data:`PLANES`, what there are pictures of.
        undistort: the ST map that all goes through at the end.
    """
    group.nodes.clear()
    tree = _Tree(group)
    given = tree.new("NodeGroupInput", 0, -2)
    photograph, clean = (tree.image(kind, 0, row) for row, kind in enumerate(("photograph", "clean")))
    removed = None
    for i, (key, name) in enumerate(names.items()):
        matte = tree.image(key, 0, 2 + i)
        factor = next(s for s in given.outputs if s.name == name)
        dialled = tree.math("MULTIPLY", factor, matte, 1, 2 + i)
        removed = dialled if removed is None else tree.math("MAXIMUM", removed, dialled, 2 + i, 2 + i)
    last = 3 + len(names)
    mixed = tree.mix("MIX", removed, photograph, clean, last, 0)
    shown = {IMAGE: mixed, MATTE: removed}
    for row, kind in enumerate(planes, start=2 + len(names)):
        output, white = PLANES[kind]
        shown[output] = tree.math("MULTIPLY", tree.image(kind, 0, row), white, 1, row)
    if undistort is not None:
        below = 2 + len(names) + len(planes)
        st_map = tree.image("st", 0, below)
        st_map.node.image = undistort
        # The node takes the third value for opacity, and ST maps leave it empty.
        opaque = tree.mix("ADD", 1.0, st_map, (0.0, 0.0, 1.0, 1.0), 1, below)
        for row, (name, socket) in enumerate(shown.items()):
            if socket is not None:
                shown[name] = tree.map_uv(socket, opaque, last + 1, row, smooth=name in (IMAGE, MATTE))
    result = tree.new("NodeGroupOutput", last + 2, 0)
    for name, socket in shown.items():
        if socket is not None:
            tree.link(socket, next(s for s in result.inputs if s.name == name))


class _Tree:
    """Nodes of a group in columns and rows. A value for an input is a socket to link, a number or colour to set, or None."""

    def __init__(self, group: bpy.types.NodeTree) -> None:
        self.group = group

    def new(self, kind: str, column: int, row: int) -> Any:
        node = self.group.nodes.new(kind)
        node.location = (COLUMN * column, -ROW * row)
        return node

    def link(self, value: Any, socket: Any) -> None:
        if isinstance(value, bpy.types.NodeSocket):
            self.group.links.new(value, socket)
        elif value is not None:
            socket.default_value = value

    def image(self, kind: str, column: int, row: int) -> Any:
        node = self.new("CompositorNodeImage", column, row)
        node[blocks.ROLE], node.label = kind, kind
        return node.outputs["Image"]

    def math(self, operation: str, a: Any, b: Any, column: int, row: int) -> Any:
        node = self.new(versions.MATH_NODE, column, row)
        node.operation = operation
        self.link(a, node.inputs[0])
        self.link(b, node.inputs[1])
        return node.outputs[0]

    def mix(self, blend: str, factor: Any, a: Any, b: Any, column: int, row: int) -> Any:
        node = self.new(versions.MIX_NODE, column, row)
        sockets = versions.mix_sockets(node, blend)
        for value, socket in zip((factor if factor is not None else 0.0, a, b), sockets, strict=False):
            self.link(value, socket)
        return sockets[-1]

    def map_uv(self, socket: Any, at: Any, column: int, row: int, *, smooth: bool) -> Any:
        node = self.new("CompositorNodeMapUV", column, row)
        versions.set_map_uv_filter(node, smooth)
        self.link(socket, node.inputs["Image"])
        self.link(at, node.inputs["UV"])
        return node.outputs[0]


# ---------------------------------------------------------------------------------------------------- in the artist's compositor


def add_to_compositor(scene: bpy.types.Scene, group: bpy.types.NodeTree) -> bpy.types.Node:
    """One node of the group in the scene's compositor, linked to nothing; the one that is there already where one is.

    Raises:
        ValueError: the scene's compositor is another file's; one line.
    """
    tree = versions.compositor_of(scene)
    if not blocks.is_own(tree):
        raise ValueError(f"{tree.name}: is linked from another file (make it local to add to it)")
    for node in tree.nodes:
        if getattr(node, "node_tree", None) == group:
            return node
    lowest = min((n.location.y - n.height for n in tree.nodes), default=0.0)
    left = min((n.location.x for n in tree.nodes), default=0.0)
    node = tree.nodes.new("CompositorNodeGroup")
    node.node_tree, node.label, node.width = group, group.name, COLUMN
    node.location = (left, lowest - ROW)
    return node
