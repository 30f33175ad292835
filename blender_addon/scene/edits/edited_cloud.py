# SPDX-License-Identifier: GPL-3.0-or-later
"""A cloud of Gaussians as the artist left it, in its workspace's coordinates: points deleted, the object moved or scaled."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ...formats.gaussians import Gaussians
from ...formats.splat_files.splat_facts import FACTS
from .. import drive_scene, versions

__all__ = ["edited_gaussians"]

EVEN = 1e-4
"""By which the scales of an object's axes may differ."""


def edited_gaussians(context: bpy.types.Context, thing: bpy.types.Object) -> tuple[Gaussians, dict[str, np.ndarray]]:
    """What an object shows, modifiers included.

    Returns:
        its Gaussians in metres, in the coordinates of the workspace; whole numbers by name that they carry, see ``splat_facts``.
    Raises:
        ValueError: it cannot be taken back as it is, in one line with what to do.
    """
    if int(thing.get("unveil_gaussians_shown", 0)) < int(thing.get("unveil_gaussians", 0)):
        raise ValueError(f"{thing.name}: shows a part of its Gaussians only, and cannot be taken back")
    if thing.modifiers and not thing.visible_get():  # Blender does not apply modifiers of what is hidden
        raise ValueError(f"{thing.name}: is hidden, and has modifiers (show it, for what they make)")
    shown = thing.evaluated_get(context.evaluated_depsgraph_get())
    cloud = shown.data
    if getattr(cloud, "points", None) is None or not len(cloud.points):
        raise ValueError(f"{thing.name}: has no Gaussians left (undo, or load the results again)")
    place, turn, scale = _world(thing).decompose()
    if max(scale) - min(scale) > EVEN * max(scale) or min(scale) <= 0:
        raise ValueError(f"{thing.name}: is scaled differently along its axes (scale it evenly, or reset its scale)")
    try:
        harmonics = _harmonics(cloud)
        positions, scales = (_values(cloud, name, "vector", 3) for name in ("position", "scale"))
        rotations, base = (_values(cloud, "rotation", "value", 4), _values(cloud, "radiance:base", _base_part(), 4))
    except KeyError as error:
        raise ValueError(f"{thing.name}: lacks the attribute {error} of Gaussians (undo what removed it)") from error
    if len(harmonics) and abs(turn.angle) > EVEN:
        raise ValueError(
            f"{thing.name}: was turned, and its colours by direction would not follow (reset its rotation)"
        )
    metre = drive_scene.metre_of(context.scene)
    matrix = np.array(turn.to_matrix(), np.float64)
    found = Gaussians(
        positions=((positions @ matrix.T * scale[0] + np.array(place)) / metre).astype(np.float32),
        scales=(scales * scale[0] / metre).astype(np.float32),
        rotations=_turned(np.array(turn, np.float64), rotations).astype(np.float32),
        base=base,
        harmonics=harmonics,
    )
    return found, {name: _values(cloud, name, "value", 1)[:, 0] for name in FACTS if name in cloud.attributes}


def _world(thing: bpy.types.Object) -> Any:
    """Where an object is: of one that is hidden, Blender keeps no matrix up to date."""
    own = thing.matrix_basis
    return own if thing.parent is None else _world(thing.parent) @ thing.matrix_parent_inverse @ own


def _base_part() -> str:
    return versions.four_floats()[1]


def _values(cloud: Any, name: str, part: str, width: int) -> np.ndarray:
    attribute = cloud.attributes[name]
    found = np.empty(len(cloud.points) * width, np.int32 if attribute.data_type == "INT" else np.float32)
    attribute.data.foreach_get(part, found)
    return found.reshape(-1, width)


def _harmonics(cloud: Any) -> np.ndarray:
    count = sum(a.name.startswith("radiance:sh_") for a in cloud.attributes)
    found = [_values(cloud, f"radiance:sh_{k}", "vector", 3) for k in range(count)]
    return np.stack(found) if found else np.empty((0, len(cloud.points), 3), np.float32)


def _turned(turn: np.ndarray, quats: np.ndarray) -> np.ndarray:
    """(N, 4) quaternions w, x, y, z: ``turn`` (4,) times ``quats``."""
    w, x, y, z = turn
    rows = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    return np.asarray(quats @ rows.T)
