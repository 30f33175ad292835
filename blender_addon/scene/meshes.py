# SPDX-License-Identifier: GPL-3.0-or-later
"""Filling Blender meshes from arrays, with vertex colours and the material that shows them."""

from __future__ import annotations

import bpy
import numpy as np

from . import blocks

__all__ = ["color_material", "fill_mesh", "set_colors", "set_values", "show_colors"]


def fill_mesh(mesh: bpy.types.Mesh, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Put geometry into a mesh in place of what it holds.

    Args:
        vertices: (V, 3); faces: (F, K) with K corners each, indices that are not checked.
    """
    mesh.clear_geometry()
    # Attributes are copied as they are; "co" and "vertex_index" are set one by one.
    if len(vertices):
        mesh.vertices.add(len(vertices))
        mesh.attributes["position"].data.foreach_set("vector", np.ascontiguousarray(vertices, np.float32).ravel())
    if len(faces):
        corners = faces.shape[1]
        mesh.loops.add(faces.size)
        mesh.attributes[".corner_vert"].data.foreach_set("value", np.ascontiguousarray(faces, np.int32).ravel())
        mesh.polygons.add(len(faces))
        mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, corners, dtype=np.int32))
    mesh.update(calc_edges=True)


def set_colors(mesh: bpy.types.Mesh, name: str, colors: np.ndarray) -> None:
    """A colour per vertex, (V, 3) uint8 sRGB."""
    attribute = mesh.color_attributes.get(name)
    if attribute is None:
        attribute = mesh.color_attributes.new(name, "BYTE_COLOR", "POINT")
    whole = np.ones((len(colors), 4), np.float32)
    whole[:, :3] = colors / np.float32(255)
    attribute.data.foreach_set("color_srgb", whole.ravel())


def set_values(mesh: bpy.types.Mesh, name: str, values: np.ndarray, domain: str) -> None:
    """A number for each element of a domain, "POINT" or "FACE": whole numbers as INT, others as FLOAT."""
    kind = "INT" if values.dtype.kind in "iu" else "FLOAT"
    attribute = mesh.attributes.get(name)
    if attribute is not None and attribute.domain != domain:
        mesh.attributes.remove(attribute)
        attribute = None
    if attribute is None:
        attribute = mesh.attributes.new(name, kind, domain)
    attribute.data.foreach_set("value", values.astype(np.int32 if kind == "INT" else np.float32))


def show_colors(mesh: bpy.types.Mesh, name: str) -> None:
    """Make one of the mesh's colours the one that the Solid view and its material show."""
    attribute = mesh.color_attributes.get(name)
    if attribute is not None:
        mesh.color_attributes.active_color = attribute
        mesh.color_attributes.render_color_index = list(mesh.color_attributes).index(attribute)


def color_material(drive: str, name: str, role: str = "material") -> bpy.types.Material:
    """The material that shows the active colours of whatever has it, unlit: photographs have their light already."""
    material = blocks.find(bpy.data.materials, drive, role)
    if material is not None:
        return material
    material = bpy.data.materials.new(name)
    blocks.mark(material, drive, role)
    if material.node_tree is None:
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    output, surface, colors = (
        nodes.new(kind) for kind in ("ShaderNodeOutputMaterial", "ShaderNodeEmission", "ShaderNodeVertexColor")
    )
    for place, node in enumerate((colors, surface, output)):
        node.location = (220 * place, 0)
    links.new(colors.outputs["Color"], surface.inputs["Color"])
    links.new(surface.outputs["Emission"], output.inputs["Surface"])
    return material
