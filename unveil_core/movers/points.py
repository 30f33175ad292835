"""Which of the drive's points lie on dynamic objects: in a LiDAR cloud they leave trails through the empty street."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.drives.depth_range import FAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.grid import PointGrid
from unveil_core.ground.height_field import HeightField
from unveil_core.movers.contacts import Contacts
from unveil_core.movers.seen_through import Body, DriveVisibility

__all__ = ["points_along_track", "points_behind_contacts"]

OVER_GROUND_M = 0.12
"""Points lower than this over the ground, metres, belong to the ground."""
SIDE_M = 2.0
"""Contacts that span more depth than this, metres, show an object's long side; behind them lies no more than its width."""
LONG_SHARE = 2.0
"""Seen from its end an object may reach this multiple of its width farther."""
BEYOND_M = 20.0
"""A LiDAR sees an object before and after the camera does: its path is extended by so much, metres."""
STEP_M = 0.5
ROUNDED = 1 + 1e-6
"""Points are looked for this much farther than they may lie: more than any rounding."""


def points_behind_contacts(
    points: NDArray[np.float64],
    grid: PointGrid,
    mask: NDArray[np.bool_],
    contacts: Contacts,
    camera: Camera,
    body: Body,
    ground: HeightField,
) -> NDArray[np.int64]:
    """Indices (M,) of points on a dynamic object as one frame shows it: in its pixels, and no farther behind its contacts than it
    may reach.

    Args:
        points: (P, 3) world; grid: of them; mask: (H, W) of the object; contacts: of the same object, may be uncertain.
    """
    if not len(contacts):
        return np.zeros(0, dtype=np.int64)
    long_side = float(np.ptp(contacts.depth)) > SIDE_M
    reach = body.depth_m * (1.0 if long_side else LONG_SHARE)
    deepest = float((contacts.depth + 2 * contacts.error).max()) + reach
    some = grid.near(camera.centre, ROUNDED * deepest * camera.longest_ray)
    pixel, depth = camera.project(points[some])
    inside = np.flatnonzero(camera.in_picture(pixel, depth))
    inside = inside[mask[pixel[inside, 1].astype(int), pixel[inside, 0].astype(int)]]
    if not len(inside):
        return inside
    nearest = np.abs(pixel[inside, 0, None] - (contacts.columns[None] + 0.5)).argmin(axis=1)
    error = 2 * contacts.error[nearest]
    behind = depth[inside] - contacts.depth[nearest]
    hit = (behind > -0.4 - error) & (behind < reach + error)
    index = some[inside[hit]]
    return index[ground.over(points[index]) > OVER_GROUND_M]


def points_along_track(
    points: NDArray[np.float64],
    grid: PointGrid,
    track: NDArray[np.float64],
    height: float,
    visibility: DriveVisibility,
    body: Body,
    ground: HeightField,
) -> NDArray[np.int64]:
    """Indices (M,) of points on the path of a dynamic object.

    In the middle of the path all that frames do not show as static; at its sides, and where the camera did not see the object
    pass, only what other frames see through.

    Args:
        points: (P, 3) world; grid: of them.
        track: (K, 3) places in its middle, on the ground, one a frame, in order of time, K >= 2.
        height: of the object, metres.
        visibility: of all frames; ``occupied`` by static objects, poles as well.
    """
    way = (track @ ground.axes.T)[:, :2]
    travelled = np.linalg.norm(way[-1] - way[0])
    if travelled < body.drift_m / 3:
        return np.zeros(0, dtype=np.int64)
    ahead = (way[-1] - way[0]) / travelled
    # It was where its contacts were, and as far beyond them as it is long.
    half = body.drift_m * ahead
    ends = [way[0] - half, *way, way[-1] + half]
    ends = [ends[0] - BEYOND_M * ahead, *ends, ends[-1] + BEYOND_M * ahead]
    dense = []
    for a, b in zip(ends[:-1], ends[1:], strict=True):
        count = max(2, int(np.linalg.norm(b - a) / STEP_M) + 1)
        dense.append(a + np.linspace(0, 1, count)[:, None] * (b - a))
    reach = body.depth_m
    low, high = (extreme.reduce(np.concatenate(dense)) for extreme in (np.minimum, np.maximum))
    middle = np.array([*(low + high) / 2, 0.0]) @ ground.axes
    some = grid.near(middle, ROUNDED * (float(np.linalg.norm(high - low)) / 2 + reach))
    local = points[some] @ ground.axes.T
    near = cKDTree(np.concatenate(dense)).query(local[:, :2], distance_upper_bound=reach)[0]
    amid = cKDTree(np.concatenate(dense[1:-1])).query(local[:, :2], distance_upper_bound=reach / 2)[0]
    on_way = np.flatnonzero(np.isfinite(near))
    above = ground.over(points[some[on_way]])
    on_way = on_way[(above > OVER_GROUND_M) & (above < 1.2 * height)]
    index = some[on_way]
    through, occupied, seen = (np.zeros(len(index), np.int64) for _ in range(3))
    for v in visibility.around(points[index], FAR_M):
        camera = visibility.cameras[v]
        pixel, depth = camera.project(points[index])
        inside = np.flatnonzero(camera.in_picture(pixel, depth))
        if not len(inside):
            continue
        view = visibility.frames[v]
        row, column = pixel[inside, 1].astype(int), pixel[inside, 0].astype(int)
        through[inside] += view.open[row, column]
        occupied[inside] += view.occupied[row, column]
        seen[inside] += 1
    open_ = (through >= 2) & (through > occupied)
    swept = np.isfinite(amid[on_way]) & (2 * occupied < np.maximum(seen, 1))
    return index[open_ | swept]
