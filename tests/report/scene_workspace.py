"""A finished workspace of the analytic street with a scene of its road and facades."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from tests.evaluate.street_workspace import CARS, OFFSET, build_workspace
from tests.mesh.street import FACADE_HEIGHT, HALF_WIDTH, SKY
from unveil_core.base.files import write_image_atomic, write_json_atomic
from unveil_core.base.pictures.decoding import read_label_image
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate import METHODS
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.inpaint.origin import CONTINUED, INVENTED
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.ply import write_surfels
from unveil_core.surfels.scene_edit import NOT_SHORTENED, SceneEdit, write_edit
from unveil_core.surfels.sky import Sky, save_sky
from unveil_core.surfels.surfels import Surfels

SPACING = 0.4
"""Between surfels, metres."""
ROAD, LINE, GLASS, WALLS = (110, 112, 116), (225, 222, 210), (60, 72, 88), {-1.0: (158, 168, 152), 1.0: (184, 132, 102)}

METRICS = {
    "coverage": {"removed": 0.2, "unobserved_of_removed": 0.3},
    "untouched": {"max": 0},
    "provenance": {"pixels": 9, "origins": {"continued": {"share": 0.7, "psnr": 22.0}, "invented": {"share": 0.3}}},
    "truth": {
        "frames": 4,
        "regions": {
            region: {"methods": {method: {"psnr": 20.0, "ssim": 0.7} for method in METHODS}}
            for region in ("removed", "seen_elsewhere", "unseen", "cast_shadow")
        },
    },
}
"""Figures for all tables: what is measured is of no account here."""


def edit_of(surfels: Surfels, origin: NDArray[np.uint8]) -> SceneEdit:
    """What made an empty scene that nothing was removed from, the last of whose surfels were added, with their origins."""
    left = len(surfels) - len(origin)
    nothing = np.zeros(left, dtype=bool)
    added = surfels.select(torch.arange(left, len(surfels)))
    return SceneEdit(nothing, NOT_SHORTENED, nothing, nothing, added, origin)


def build_scene_workspace(root: Path) -> Path:
    """The workspace, with metrics, provenance of its surfels, and boxes in its own coordinates; returns its folder."""
    workspace = build_workspace(root, count=4, width=120, height=80, step=1.5)
    shift = OFFSET - read_imported(workspace / "drive").to_world.translation
    points, colors, normals = _street()
    under = np.zeros(len(points), np.uint8)
    for car, origin in zip(CARS, (CONTINUED, INVENTED, CONTINUED), strict=True):
        near = np.abs(points[:, :2] - (car.x, car.y)) < (car.half_x, car.half_y)
        under[near.all(axis=1) & (points[:, 2] < 0.1)] = origin
    order = np.argsort(under > 0, kind="stable")  # what was filled in comes last, as seeds do
    surfels = surfels_from_points(
        points[order] + shift,
        colors[order],
        np.zeros(len(points), np.int64),
        normals[order],
        np.full(len(points), SPACING),
        opacity=0.95,
        scale_factor=0.45,
    )
    write_surfels(surfels, workspace / "surfels/empty.ply")
    seeds = under[order][under[order] > 0]
    write_edit(edit_of(surfels, seeds), workspace / "surfels/edit.npz")
    save_sky(_sky(), workspace / "surfels/sky.npz")
    entries = json.loads((workspace / "instances.json").read_text())
    for entry in entries:
        entry["box"]["centre"] = (np.array(entry["box"]["centre"]) + shift).tolist()
        entry["box"]["yaw"] = np.pi / 2  # from the first axis of up_frame: the cars stand along x
    write_json_atomic(workspace / "instances.json", entries)
    for path in (workspace / "regions/front").glob("*.png"):
        changed = read_label_image(path) > 0
        write_image_atomic(workspace / "provenance/front" / path.name, np.where(changed, CONTINUED, 0).astype(np.uint8))
        write_image_atomic(workspace / "certainty/front" / path.name, np.where(changed, 200, 255).astype(np.uint8))
    write_json_atomic(workspace / "metrics.json", METRICS)
    return workspace


def _street() -> tuple[np.ndarray, ...]:
    """Places (P, 3), colours (P, 3) and normals (P, 3) of a road with a line, and of two facades with windows."""
    x, y = (v.ravel() for v in np.meshgrid(np.arange(-1, 36, SPACING), np.arange(-HALF_WIDTH, HALF_WIDTH, SPACING)))
    road = np.stack([x, y, 0 * x], axis=1)
    shades = np.where((np.abs(y + 1.4) < SPACING)[:, None], LINE, ROAD)
    parts = [(road, shades, np.tile([0.0, 0.0, 1.0], (len(road), 1)))]
    x, z = (v.ravel() for v in np.meshgrid(np.arange(-1, 36, SPACING), np.arange(0, FACADE_HEIGHT, SPACING)))
    window = (np.abs(x % 3 - 1.5) < 0.6) & (np.abs(z % 3.2 - 1.8) < 0.8)
    for side in (-1.0, 1.0):
        wall = np.stack([x, 0 * x + side * HALF_WIDTH, z], axis=1)
        parts.append((wall, np.where(window[:, None], GLASS, WALLS[side]), np.tile([0.0, -side, 0.0], (len(wall), 1))))
    points, shades, normals = (np.concatenate(part) for part in zip(*parts, strict=True))
    return points, shades.astype(np.uint8), normals


def _sky() -> Sky:
    """The street's even sky, darker below the horizon, and red in one direction so that a turn shows."""
    texture = np.empty((3, 16, 32), np.float32)
    texture[:] = np.array(SKY)[:, None, None]
    texture[:, :8] *= 0.5
    texture[:, 8:, :4] = np.array([[[0.8]], [[0.2]], [[0.2]]])
    return Sky(torch.from_numpy(texture), up_frame(UP))
