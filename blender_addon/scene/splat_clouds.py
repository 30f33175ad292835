# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaussians as a point cloud of the type that Blender draws natively, since 5.3.

Its attributes, as Blender's own importer of PLY files names and types them: ``position``; ``scale``, standard deviations, not
their logarithms; ``rotation``, a quaternion w, x, y, z; ``radiance:base``, four floats with the harmonics' constant coefficients
and the opacity from 0 to 1; ``radiance:sh_0`` and so on for the further coefficients, a vector each. A surfel's third extent is
thin.

A cloud of a workspace equals what Blender's importer makes of the same scene, exported by ``unveil export``, to the last bits of
single precision: needles that stick out of the street are shortened in both. Beside what that has, it carries whole numbers for
Geometry Nodes: ``label``, ``instance`` and ``provenance``, see ``formats/splat_files/``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..formats.gaussians import Gaussians
from . import versions

__all__ = ["MOST_NATIVE", "make"]

MOST_NATIVE = 4_000_000
"""More Gaussians of a scene are thinned evenly. Each takes 56 bytes of memory and of the .blend, and 180 more with harmonics of the
third degree: 0.2 to 0.9 GB for so many."""


def make(name: str, gaussians: Gaussians, facts: Mapping[str, np.ndarray] | None = None) -> Any:
    """A new point cloud that holds Gaussians; one whose number changes is made anew.

    Args:
        name: of the cloud; gaussians: N of them.
        facts: whole numbers (N,) by the name of their attribute.
    """
    cloud = versions.new_splat_cloud(name, len(gaussians))
    attributes = cloud.attributes
    kind, key = versions.four_floats()
    wanted = [
        ("position", "FLOAT_VECTOR", "vector", gaussians.positions),
        ("scale", "FLOAT_VECTOR", "vector", gaussians.scales),
        ("rotation", "QUATERNION", "value", gaussians.rotations),
        ("radiance:base", kind, key, gaussians.base),
        *(
            (f"radiance:sh_{number}", "FLOAT_VECTOR", "vector", values)
            for number, values in enumerate(gaussians.harmonics)
        ),
        *((fact, "INT", "value", values) for fact, values in (facts or {}).items()),
    ]
    for attribute, data_type, _, _ in wanted:  # all first: a new one may move those that are there
        if attribute not in attributes:
            attributes.new(attribute, data_type, "POINT")
    for attribute, data_type, part, values in wanted:
        numbers = np.int32 if data_type == "INT" else np.float32
        attributes[attribute].data.foreach_set(part, np.ascontiguousarray(values, numbers).ravel())
    cloud.update_tag()
    return cloud
