"""A flat straight street with a parked car and a tree crown over it, lit by a sun whose shadows are known exactly."""

from __future__ import annotations

import numpy as np

from tests.ground.test_street import drive_on_circle
from unveil_core.base.srgb import relight
from unveil_core.ground.path import fit_path
from unveil_core.ground.street_fit import fit_street_heights
from unveil_core.inpaint.chart.street_chart import OBSERVED, OUTSIDE, StreetChart
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels, concatenate

CAR = np.array([[9.0, -3.6, 0.0], [13.5, -1.8, 1.5]])
CROWN = np.array([[6.0, -6.5, 3.0], [9.0, -4.0, 5.5]])
HOUSE = np.array([[14.0, -9.0, 0.0], [24.0, -8.0, 6.0]])
ROW = np.array([[-30.0, -9.0, 0.0], [60.0, -8.0, 8.0]])
"""Houses all along the street."""
SHADE = np.array([0.17, 0.22, 0.32])
"""Share of the light that a shadow leaves."""
TEXEL = 0.05


def box_surfels(box: np.ndarray, *, open_below: float = 0.0, spacing: float = 0.12) -> Surfels:
    """Discs all over a box, without what lies under ``open_below``."""
    parts, normals = [], []
    for axis in range(3):
        a, b = [k for k in range(3) if k != axis]
        grid = np.meshgrid(*(np.arange(box[0, k] + spacing / 2, box[1, k], spacing) for k in (a, b)), indexing="ij")
        for side in box[:, axis]:
            points = np.empty((grid[0].size, 3))
            points[:, a], points[:, b], points[:, axis] = grid[0].ravel(), grid[1].ravel(), side
            parts.append(points)
            normals.append(np.repeat(np.eye(3)[axis : axis + 1], len(points), axis=0))
    points, normal = np.concatenate(parts), np.concatenate(normals)
    kept = points[:, 2] >= open_below
    count = int(kept.sum())
    return surfels_from_points(
        points[kept],
        np.full((count, 3), 90, np.uint8),
        np.zeros(count, np.int64),
        normal[kept],
        np.full(count, spacing),
        opacity=0.95,
        scale_factor=0.6,
    )


def blocked(points: np.ndarray, box: np.ndarray, towards_sun: np.ndarray) -> np.ndarray:
    """(P,) whether the ray from a point to the sun meets the box: the slab test."""
    with np.errstate(divide="ignore"):
        first, second = (box[0] - points) / towards_sun, (box[1] - points) / towards_sun
    near, far = np.minimum(first, second).max(axis=1), np.maximum(first, second).min(axis=1)
    return (near <= far) & (far > 0)


def paint(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Colours in full sun."""
    grain = 0.02 * np.sin(9 * s + 5 * t) * np.cos(7 * t - 4 * s)
    color = np.repeat((0.5 + grain)[..., None], 3, axis=-1)
    color[np.abs(t + 1.4) < 0.1] = 0.85
    color[np.abs(t) > 4] = np.array([0.7, 0.66, 0.6])
    return color


def sunny_chart(
    towards_sun: np.ndarray | None, house: np.ndarray = HOUSE
) -> tuple[StreetChart, np.ndarray, np.ndarray, Surfels, Surfels]:
    """The chart as read, the true one without the car, the car's footprint, and surfels of what stays and of the car."""
    path = fit_path(drive_on_circle(np.inf, 0.0))
    s, t = np.meshgrid(np.arange(-2, 28, 0.3), np.arange(-7.5, 7.5, 0.3), indexing="ij")
    points = np.stack([s.ravel(), t.ravel(), np.zeros(s.size)], axis=1)
    ground = fit_street_heights(path, path.to_world(points))
    rows, columns = int(28 / TEXEL), int(14 / TEXEL)
    empty = StreetChart(
        ground,
        TEXEL,
        -1.0,
        -7.0,
        np.zeros((rows, columns, 3), np.float32),
        np.zeros((rows, columns), np.int16),
        np.full((rows, columns), OBSERVED, np.uint8),
        np.ones((rows, columns, 3), np.float32),
        np.full((rows, columns), 5.0, np.float32),
        np.zeros((rows, columns), bool),
    )
    world = empty.world(*(i.ravel() for i in np.indices((rows, columns))))
    street = path.to_street(world).reshape(rows, columns, 3)
    color = paint(street[..., 0], street[..., 1])

    # The test's boxes stand in world coordinates, which on this straight street are street coordinates.
    def shaded(*boxes: np.ndarray) -> np.ndarray:
        if towards_sun is None:
            return np.zeros((rows, columns), bool)
        return np.any([blocked(world, b, towards_sun) for b in boxes], axis=0).reshape(rows, columns)

    truth = np.where(shaded(CROWN, house)[..., None], relight(color, SHADE), color)
    seen = np.where(shaded(CROWN, house, CAR)[..., None], relight(color, SHADE), color)
    plan = world.reshape(rows, columns, 3)[..., :2]
    footprint = ((plan > CAR[0, :2] - 0.1) & (plan < CAR[1, :2] + 0.1)).all(axis=2)
    # What the car hides from a camera on the road's axis.
    hidden = footprint | ((plan[..., 1] < CAR[1, 1]) & (plan[..., 0] > 9) & (plan[..., 0] < 16) & (plan[..., 1] > -6))
    chart = StreetChart(
        ground,
        TEXEL,
        -1.0,
        -7.0,
        np.where(hidden[..., None], 0, seen).astype(np.float32),
        (np.abs(street[..., 1]) > 4).astype(np.int16),
        np.where(hidden, OUTSIDE, OBSERVED).astype(np.uint8),
        empty.gain,
        empty.nearest,
        empty.replaced,
    )
    kept = concatenate([box_surfels(box, spacing=0.2) for box in (CROWN, house)])
    return chart, truth, footprint, kept, box_surfels(CAR, spacing=0.2)
