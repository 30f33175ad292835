"""Textured meshes as GLB, y up: pages as JPEG in the file, under unlit materials, for photographs are lit already."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.files import write_bytes_atomic
from unveil_core.exports.coordinates import y_up
from unveil_core.exports.glb import FLOAT, INDEX_DATA, UINT, GlbBuffer, glb_bytes, street_node
from unveil_core.exports.job import Job
from unveil_core.exports.textured.levels import Level, encoded, page_mesh, textured_levels
from unveil_core.exports.whole import tell
from unveil_core.mesh.export import Z_TO_Y

__all__ = ["write_textured_glb"]

LINEAR, MIPMAPPED, CLAMPED = 9729, 9987, 33071


def write_textured_glb(job: Job, folder: Path) -> None:
    """``empty.glb``, ``empty_lod1.glb`` ..., and ``export.json``."""
    told = []
    for level in textured_levels(job):
        write_bytes_atomic(folder / f"{level.name}.glb", _glb(job, level))
        told.append(level.told(f"{level.name}.glb"))
    tell(
        folder,
        "textured-glb",
        {"coordinates": y_up(job.drive).to_json(shifted=False), "colorspace": job.colorspace, "levels": told},
    )


def _glb(job: Job, level: Level) -> bytes:
    buffer = GlbBuffer()
    primitives: list[dict[str, Any]] = []
    materials: list[dict[str, Any]] = []
    images: list[dict[str, Any]] = []
    mesh = level.textured.mesh
    for number, image in enumerate(level.textured.images):
        vertices, coordinates, triangles = page_mesh(level.textured, number)
        if not len(triangles):
            continue
        points = (mesh.vertices[vertices] @ Z_TO_Y.T.astype(np.float32)).astype("<f4")
        bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        # glTF's v runs down.
        down = np.stack([coordinates[:, 0], 1 - coordinates[:, 1]], axis=1).astype("<f4")
        attributes = {"POSITION": buffer.add(points, FLOAT, **bounds), "TEXCOORD_0": buffer.add(down, FLOAT)}
        indices = buffer.add(triangles.ravel().astype("<u4"), UINT, target=INDEX_DATA)
        primitives.append({"attributes": attributes, "indices": indices, "material": len(materials), "mode": 4})
        image_view = buffer.add_bytes(encoded(image, ".jpg"))
        images.append({"bufferView": image_view, "mimeType": "image/jpeg", "name": f"{level.name}_{number}"})
        color = {"baseColorTexture": {"index": len(materials)}, "metallicFactor": 0, "roughnessFactor": 1}
        entry: dict[str, Any] = {"name": f"{level.name}_{number}", "doubleSided": True, "pbrMetallicRoughness": color}
        materials.append({**entry, "extensions": {"KHR_materials_unlit": {}}})
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "unveil"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [street_node(job.drive, f"{level.name} street")],
        "meshes": [{"name": f"{level.name} street", "primitives": primitives}],
        "materials": materials,
        "textures": [{"source": k, "sampler": 0} for k in range(len(images))],
        "samplers": [{"magFilter": LINEAR, "minFilter": MIPMAPPED, "wrapS": CLAMPED, "wrapT": CLAMPED}],
        "images": images,
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": buffer.size}],
    }
    return glb_bytes(document, b"".join(buffer.parts))
