# SPDX-License-Identifier: GPL-3.0-or-later
"""The clean plate under whatever the scene renders, in the scene's compositor."""

from __future__ import annotations

from typing import Any

import bpy

from .. import blocks, versions

__all__ = ["put_under"]

PLATE, SIZE, OVER = "cg:plate", "cg:size", "cg:over"
"""Roles of the nodes: they are made once, and brought up to date."""
STEP = 260
"""Between nodes."""


def put_under(scene: bpy.types.Scene, mark: str, plate: Any) -> bool:
    """Lay a camera's pictures under what the compositor gives now; whatever the artist has built there stays above them.

    Args:
        mark: of the drive; plate: the picture behind the camera, with its frames.
    Returns:
        whether nodes were added; otherwise they were there, and show these pictures now.
    Raises:
        ValueError: the compositor is another file's, or has no output; one line.
    """
    tree = versions.compositor_of(scene)
    if not blocks.is_own(tree):
        raise ValueError(f"{tree.name}: is linked from another file (make it local to add the plate)")
    result = _result(tree)
    image = _node(tree, mark, PLATE, "CompositorNodeImage")
    image.image = plate.image
    user = plate.image_user
    if plate.image.source == "SEQUENCE":
        image.frame_start, image.frame_duration = user.frame_start, user.frame_duration
        image.frame_offset, image.use_auto_refresh = user.frame_offset, True
    over = next((n for n in tree.nodes if n.get(blocks.ROLE) == OVER and n.get(blocks.DRIVE) == mark), None)
    if over is not None and over.outputs[0].is_linked:
        return False
    over = over or _node(tree, mark, OVER, "CompositorNodeAlphaOver")
    size = _node(tree, mark, SIZE, "CompositorNodeScale")
    versions.scale_to_render(size)
    above = result.links[0].from_socket if result.is_linked else _rendered(tree, scene)
    below, front = versions.alpha_over_sockets(over)
    tree.links.new(image.outputs["Image"], size.inputs["Image"])
    tree.links.new(size.outputs["Image"], below)
    tree.links.new(above, front)
    tree.links.new(over.outputs[0], result)
    _arrange(above.node, image, size, over, result.node)
    return True


def _result(tree: Any) -> Any:
    """The socket that takes the picture."""
    outputs = [n for n in tree.nodes if n.bl_idname in ("CompositorNodeComposite", "NodeGroupOutput")]
    sockets = [s for n in outputs for s in n.inputs if s.name == "Image"]
    if not sockets:
        raise ValueError(f"{tree.name}: has no output named Image (add one, or empty the compositor)")
    return sockets[0]


def _rendered(tree: Any, scene: bpy.types.Scene) -> Any:
    node = next((n for n in tree.nodes if n.bl_idname == "CompositorNodeRLayers"), None)
    if node is None:
        node = tree.nodes.new("CompositorNodeRLayers")
        node.scene = scene
    return node.outputs["Image"]


def _node(tree: Any, mark: str, role: str, kind: str) -> Any:
    node = next((n for n in tree.nodes if n.get(blocks.ROLE) == role and n.get(blocks.DRIVE) == mark), None)
    if node is None:
        node = tree.nodes.new(kind)
        blocks.mark(node, mark, role)
        node.label = {PLATE: "Clean Plate", SIZE: "Plate at Render Size", OVER: "Render over Plate"}[role]
    return node


def _arrange(above: Any, image: Any, size: Any, over: Any, result: Any) -> None:
    """Beside what is there: the plate below the render, the output moved on as far as the new nodes need."""
    x, y = above.location
    image.location, size.location = (x, y - 1.6 * STEP), (x + STEP, y - 1.6 * STEP)
    over.location = (x + 2 * STEP, y)
    result.location = (max(result.location.x, x + 3 * STEP), y)
