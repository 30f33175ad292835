"""Scenes on which rasterizers break, by name, with the error that every backend of Unveil is held to.

    from tests.raster.hard_cases import CASES
    case = CASES["edge-on, lying"]
    render(case.surfels, case.camera(37, 21), label_count=case.label_count)

An error is the largest difference from the float64 reference in a plane, relative to the plane's largest value or 1,
whichever is more; for a gradient it is the relative L2 norm. All are under 1e-3 but those that say why not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch

from unveil_core.geometry.camera import Camera
from unveil_core.surfels.surfels import Surfels

HALF = math.sqrt(0.5)
LIE_DOWN, STAND_SIDEWAYS = (HALF, HALF, 0.0, 0.0), (HALF, 0.0, HALF, 0.0)
FACING = (1.0, 0.0, 0.0, 0.0)
PAIR = ((0.0, 0.0, 3.0), (0.05, 0.05, 3.5))


@dataclass(frozen=True, eq=False)
class HardCase:
    """One scene.

    Attributes:
        surfels: float32.
        limit: stated error of planes and gradients.
        label_count: K.
        eye: (3,) float64, where the camera stands; it looks along z.
        true_surfels, true_eye: the same scene in float64 where the float32 one was moved to fit, for the reference.
        gradients: whether gradients are held to the limit too, or only promised to be finite.
        why: for a limit over 1e-3.
    """

    surfels: Surfels
    limit: float = 2e-5
    label_count: int = 3
    eye: tuple[float, float, float] = (0.0, 0.0, 0.0)
    true_surfels: Surfels | None = None
    true_eye: tuple[float, float, float] | None = None
    gradients: bool = True
    why: str = ""

    def camera(self, width: int, height: int, *, true: bool = False) -> Camera:
        """A camera of this size; ``true`` puts it where the float64 scene is."""
        pose = np.eye(4)
        pose[:3, 3] = -np.array(self.true_eye if true and self.true_eye is not None else self.eye)
        return Camera(width, height, 30.0, 30.0, width / 2, height / 2, pose)


def surfels(
    means: object,
    quat: tuple[float, float, float, float] = FACING,
    log_scales: tuple[float, float] = (-1.0, -1.0),
    logit: float = 2.0,
    *,
    degree: int = 1,
    label_count: int = 3,
) -> Surfels:
    """Surfels that differ in nothing but place, colour and label."""
    positions = torch.tensor(means, dtype=torch.float32).reshape(-1, 3)
    n = len(positions)
    g = torch.Generator().manual_seed(0)
    return Surfels(
        means=positions,
        quats=torch.tensor(quat).expand(n, 4).clone(),
        log_scales=torch.tensor(log_scales).expand(n, 2).clone(),
        opacity_logits=torch.full((n,), float(logit)),
        sh=0.3 * torch.randn(n, (degree + 1) ** 2, 3, generator=g),
        labels=torch.arange(n) % label_count,
    )


def _many_labels(label_count: int) -> Surfels:
    places = [[0.1 * math.cos(2.4 * i), 0.1 * math.sin(2.4 * i), 3 + 0.05 * i] for i in range(57)]
    return surfels(places, logit=-1.0, label_count=label_count)


def _surveyed() -> HardCase:
    """Six thousand kilometres from the origin, as surveyed drives are; recentred on the camera before rendering."""
    eye = np.array([6_000_123.25, -5_812_960.5, 34.125])
    near = surfels([[0.02 * i - 0.3, 0.01 * i - 0.1, 3 + 0.05 * i] for i in range(30)], (0.9, 0.2, 0.3, 0.1))
    there = Surfels(
        near.means.double() + torch.from_numpy(eye),
        near.quats,
        near.log_scales,
        near.opacity_logits,
        near.sh,
        near.labels,
    )
    return HardCase(near, true_surfels=there, true_eye=tuple(eye.tolist()))


CASES: dict[str, HardCase] = {
    "empty": HardCase(surfels(np.zeros((0, 3)).tolist())),
    "edge-on, lying": HardCase(surfels([[0, 0, 3], [0.1, 0.2, 4]], LIE_DOWN)),
    "edge-on, on a row of pixel centres": HardCase(surfels([[0, 0, 3]], LIE_DOWN)),
    "edge-on, standing": HardCase(surfels([[0, 0, 3]], STAND_SIDEWAYS)),
    "crosses the camera's plane": HardCase(surfels([[0, 0.5, 0.5], [0, 0.5, 1.0]], LIE_DOWN, (0.5, 0.5))),
    "centre behind, edge in front": HardCase(surfels([[0, 0.5, -0.5]], LIE_DOWN, (0.5, 0.5))),
    "centre nearer than near": HardCase(surfels([[0, 0.1, 0.1]], LIE_DOWN, (0.5, 0.5))),
    "a micrometre": HardCase(surfels(PAIR, log_scales=(math.log(1e-6),) * 2)),
    "a kilometre": HardCase(surfels([[0, 0, 3], [0, 1, 5]], (0.9, 0.3, 0.1, 0.0), (math.log(1e3),) * 2), 1e-4),
    "no scale at all": HardCase(surfels(PAIR, log_scales=(-200.0, -200.0))),
    "no scale along one axis": HardCase(surfels(PAIR, log_scales=(-200.0, 0.0))),
    "scale beyond float": HardCase(surfels([[0, 0, 3]], (0.9, 0.3, 0.1, 0.0), (200.0, 200.0))),
    "opacity 0": HardCase(surfels(PAIR, logit=-200.0)),
    "opacity 1": HardCase(surfels(PAIR, logit=200.0)),
    "zero quaternion": HardCase(surfels(PAIR, (0.0, 0.0, 0.0, 0.0))),
    "huge quaternion": HardCase(surfels(PAIR, (1e18, 0.0, 1e17, 0.0))),
    "a thousand opaque layers": HardCase(surfels([[0, 0, 3 + 0.01 * i] for i in range(1000)], logit=10.0)),
    "a thousand thin layers": HardCase(surfels([[0, 0, 3 + 0.01 * i] for i in range(1000)], logit=-5.3), 2e-4),
    "equal depths": HardCase(surfels([[0.01 * i, 0, 3] for i in range(50)])),
    "the same surfel twenty times": HardCase(surfels([[0.02, 0.03, 3]] * 20)),
    "one label": HardCase(_many_labels(1), label_count=1),
    "nineteen labels": HardCase(_many_labels(19), label_count=19),
    "surveyed coordinates, recentred": _surveyed(),
    "beyond what float32 can place": HardCase(
        surfels([[1e30, 0, 3], [1e9, 0, 0.3], [0, 0, 1e30]], log_scales=(10.0, 10.0))
    ),
    "far centre, near edge": HardCase(
        surfels([[3000, 0, 0.3]], (0.9, 0.3, 0.5, 0.0), (7.0, 7.0)),
        1e-2,
        gradients=False,
        why="a disc of a kilometre whose centre lies 300,000 pixels aside, where float32 places it to a thirtieth of a "
        "pixel; a quarter of the limit was measured, and one pixel in a hundred may fall on the other side of the cut "
        "at alpha 1/255",
    ),
}
SIZES = ((37, 21), (1, 1), (16, 16), (17, 33))
"""Image sizes: not divisible by 16, one pixel, one tile, one pixel over."""
