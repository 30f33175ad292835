"""A flight along the empty street, as a small movie that browsers show: H.264 by PyAV (FFmpeg)."""

from __future__ import annotations

import io
from collections.abc import Iterator
from fractions import Fraction

import numpy as np

from unveil_core.base.parallel import each
from unveil_core.base.progress import Progress
from unveil_core.base.types import Picture
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.exports.plates.movie import Codec, encode
from unveil_core.geometry.axes import UP
from unveil_core.geometry.camera import Camera
from unveil_core.raster.picture import picture_of
from unveil_core.report.scene.path import Way, looking
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

__all__ = ["flight", "flight_cameras", "movies_can_be_written"]

WIDTHS = (96, 640)
"""Of a picture in pixels, least and most: that of the drive's images between them, for the scene has nothing finer."""
FOCAL = 0.8
"""Of the picture's width: a field of view of 64 degrees, between those of cars' cameras and of films."""
FRAMES_PER_SECOND = 12
SPEED = 8.0
"""Metres a second, where the drive is short enough for the longest flight."""
SECONDS = (4.0, 15.0)
"""Shortest and longest flight: what is longer is flown faster, so that a long drive's page is no larger and no later."""
LEAST_WAY_M = 2.0
"""A shorter way is no flight."""
LIFT_M = 1.5
"""How far above the drive's camera the flight rises in its middle: enough to see the scene from where no frame was."""
AHEAD_M = 14.0
"""What the flight keeps in its middle, so that it looks down as it rises."""
BITS_PER_SECOND = 1_300_000
"""At most, 2.6 MB in all."""
RATE = f"{BITS_PER_SECOND // 1000}k"
CODEC = Codec("libx264", "mp4", "yuv420p", {"crf": "25", "preset": "medium", "maxrate": RATE, "bufsize": RATE})


def movies_can_be_written() -> bool:
    """Whether PyAV is installed."""
    try:
        import av  # noqa: F401
    except ImportError:
        return False
    return True


def flight_cameras(way: Way, width: int = WIDTHS[1]) -> list[Camera]:
    """The views of the flight; none where the way is no way.

    Args:
        width: of the drive's images, pixels.
    """
    if way.length < LEAST_WAY_M:
        return []
    count = round(FRAMES_PER_SECOND * float(np.clip(way.length / SPEED, *SECONDS)))
    share = np.linspace(0, 1, count)
    eyes, views = way.at(way.length * share)
    lifts = LIFT_M * np.sin(np.pi * share) ** 2
    targets = eyes + AHEAD_M * views
    steep = np.abs(views @ UP) > 0.98  # a camera that looks up or down has no level view
    if steep.any():
        return []
    wide = int(np.clip(width, *WIDTHS)) // 32 * 32  # 16 to 9, both even, as encoders ask
    size = (wide, 9 * wide // 16)
    return [
        looking(eye + lift * UP, target, UP, size, FOCAL * wide)
        for eye, target, lift in zip(eyes, targets, lifts, strict=True)
    ]


def flight(surfels: Surfels, sky: Sky, cameras: list[Camera], progress: Progress) -> bytes:
    """The scene from all ``cameras``, an MP4; pictures are drawn several at a time, encoded and forgotten.

    Raises:
        ImportError: PyAV is not installed.
    """

    def pictures() -> Iterator[Picture]:
        drawn = each(lambda camera: picture_of(surfels, sky, camera, near=NEAR_M, far=FAR_M), cameras)
        for done, picture in enumerate(drawn):
            yield picture
            progress(done + 1, len(cameras), "flying along the street")

    return _encoded(pictures(), (cameras[0].width, cameras[0].height))


def _encoded(pictures: Iterator[Picture], size: tuple[int, int]) -> bytes:
    import av

    file = io.BytesIO()
    with av.open(file, "w", format=CODEC.suffix) as container:
        encode(container, CODEC, Fraction(FRAMES_PER_SECOND), size, pictures)
    return file.getvalue()
