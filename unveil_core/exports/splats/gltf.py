"""Splats as binary glTF 2.0 with the extension ``KHR_gaussian_splatting`` (release candidate of the Khronos group).

A primitive of points whose attributes are floats: position, rotation (xyzw), scale, opacity from 0 to 1, and the coefficients of
each degree. The kernel is ``ellipse``; the colour space ``srgb_rec709_display``, in which the scene was optimized. ``COLOR_0``,
linear as the format asks, lets programs without the extension show points. y is up; the local origin is the node's translation and
the drive's units its scale, as in the mesh's GLB, so nothing is rounded but by single precision. Labels and objects go along as
the custom attributes ``_LABEL`` and ``_INSTANCE``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.files import write_bytes_atomic
from unveil_core.base.srgb import linear_of_srgb
from unveil_core.exports.color import SRGB
from unveil_core.exports.glb import FLOAT, USHORT, GlbBuffer, glb_bytes, street_node
from unveil_core.exports.job import Job
from unveil_core.exports.splats.placed import opacities, placed
from unveil_core.geometry.similarity import Similarity
from unveil_core.mesh.export import Z_TO_Y
from unveil_core.raster.spherical_harmonics import SH0
from unveil_core.surfels.surfels import Surfels, three_log_scales

__all__ = ["write_splat_gltf"]

EXTENSION = "KHR_gaussian_splatting"


def write_splat_gltf(job: Job, path: Path) -> None:
    """The scene as one GLB."""
    # Metres around the local origin; the node brings them to the drive.
    there = placed(job.scene, Similarity(1.0, Z_TO_Y))
    buffer = GlbBuffer()
    attributes = _attributes(buffer, there)
    attributes["_LABEL"] = buffer.add(job.train_ids(there).astype("<f4"), FLOAT)
    attributes["_INSTANCE"] = buffer.add(job.scene_instances().astype("<f4"), FLOAT)
    node = street_node(job.drive, f"{job.state} street")
    extension = {"kernel": "ellipse", "colorSpace": SRGB}
    primitive = {"mode": 0, "attributes": attributes, "extensions": {EXTENSION: extension}}
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "unveil", "extras": {"colorspace": job.colorspace}},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
    }
    if len(there):
        document["meshes"] = [{"name": f"{job.state} street", "primitives": [primitive]}]
        document["accessors"], document["bufferViews"] = buffer.accessors, buffer.views
        document["buffers"] = [{"byteLength": buffer.size}]
    else:
        del node["mesh"]  # an accessor of nothing is not allowed
    write_bytes_atomic(path, glb_bytes(document, b"".join(buffer.parts)))


def _attributes(buffer: GlbBuffer, there: Surfels) -> dict[str, int]:
    """Accessors by the name of their attribute."""
    means = there.means.numpy().astype("<f4")
    bounds = {"min": means.min(axis=0).tolist(), "max": means.max(axis=0).tolist()} if len(means) else {}
    alpha = opacities(there).numpy()
    found = {
        "POSITION": buffer.add(means, FLOAT, **bounds),
        f"{EXTENSION}:ROTATION": buffer.add(np.roll(there.quats.numpy(), -1, axis=1).astype("<f4"), FLOAT),
        f"{EXTENSION}:SCALE": buffer.add(three_log_scales(there).exp().numpy().astype("<f4"), FLOAT),
        f"{EXTENSION}:OPACITY": buffer.add(alpha.astype("<f4"), FLOAT),
    }
    for k in range(there.sh.shape[1]):
        level = int(k**0.5)
        name = f"{EXTENSION}:SH_DEGREE_{level}_COEF_{k - level * level}"
        found[name] = buffer.add(there.sh[:, k].numpy().astype("<f4"), FLOAT)
    color = np.clip(0.5 + SH0 * there.sh[:, 0].double().numpy(), 0, 1)
    rgba = np.concatenate([linear_of_srgb(color), alpha[:, None]], axis=1)
    found["COLOR_0"] = buffer.add(np.round(rgba * 65535).astype("<u2"), USHORT, normalized=True)
    return found
