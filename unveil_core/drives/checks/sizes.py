"""Calibrations and pictures of different sizes: copies of data sets are reduced, and their calibrations are not.

Where a calibration tells its size, or its principal point can only be that of a larger or smaller picture, it is scaled to the
picture that is there, and that is told.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from unveil_core.base.errors import DriveError
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.formats.cameras import picture_size

__all__ = ["calibration_size", "is_clean_ratio", "with_sizes_of_pictures"]

Size = tuple[int, int]
KNOWN_SIZES: tuple[Size, ...] = (
    (1920, 1280), (1920, 886), (1920, 1080), (1600, 900), (2048, 1550), (1550, 2048), (1242, 375), (1241, 376), (1238, 374),
    (1226, 370), (1224, 370), (1408, 376),
)  # fmt: skip
"""Of the cameras of Waymo, PandaSet, nuScenes, Argoverse 2, KITTI and KITTI-360, width and height in pixels."""
RATIOS = (2.0, 3.0, 4.0, 8.0, 1.5, 4 / 3, 0.5, 2 / 3, 0.75, 1 / 3, 0.25)
"""Of a calibration's size to a picture's, that people reduce or enlarge by."""
CENTRED, NEAR_MIDDLE, FAR_OFF = 0.05, 0.08, 0.2
"""Share of a side that a principal point lies off the middle: of lenses up to the first; of a size that is believed up to the
second; and beyond the third a picture is not the one of the calibration."""


def is_clean_ratio(one: Size, other: Size) -> bool:
    """Whether sizes differ by one factor in both directions, but for rounding."""
    return one != other and (
        abs(one[1] * other[0] / one[0] - other[1]) <= 1.0 or abs(other[1] * one[0] / other[0] - one[1]) <= 1.0
    )


def calibration_size(picture: Size, centre: tuple[float, float]) -> Size:
    """The size that a calibration is of which does not tell it: the picture's, unless its principal point can only be another's.

    Args:
        picture: width and height; centre: principal point, pixels.
    """

    def off(size: Size) -> float:
        return max(abs(centre[0] / size[0] - 0.5), abs(centre[1] / size[1] - 0.5))

    if not off(picture) > CENTRED:  # a principal point that is NaN is told elsewhere
        return picture
    known = [s for s in KNOWN_SIZES if is_clean_ratio(s, picture) and off(s) <= min(NEAR_MIDDLE, off(picture) / 2)]
    if known:
        return min(known, key=lambda s: (_oddness(s[0] / picture[0]), off(s)))
    if off(picture) <= FAR_OFF:
        return picture
    others = [(round(picture[0] * r), round(picture[1] * r)) for r in RATIOS]
    best = min((s for s in others if min(s) > 0), key=off, default=picture)
    return best if off(best) <= NEAR_MIDDLE else picture


def _oddness(ratio: float) -> float:
    """How far a ratio is from those that people reduce by; of KITTI's sizes several are nearly of one shape."""
    return round(min(abs(ratio / r - 1) for r in RATIOS), 3)


def with_sizes_of_pictures(drive: Drive) -> Drive:
    """The drive with the calibrations of its cameras scaled to their pictures, where these have another size by a clean ratio; a
    notice for each camera. Pictures of any other size are told when they are checked."""
    told: list[str] = []
    scaled: dict[tuple[str, Size], Size] = {}
    for frame in drive.frames:
        size = (frame.camera.width, frame.camera.height)
        key = (frame.camera_name, size)
        if key in scaled or frame.image_bytes is not None:
            continue
        scaled[key] = size
        with suppress(DriveError):
            found = picture_size(frame.image_path)
            if is_clean_ratio(size, found):
                scaled[key] = found
                pictures, calibrated = (f"{w}x{h}" for w, h in (found, size))
                told.append(
                    f"camera {frame.camera_name}: pictures are {pictures}, their calibration is of {calibrated}; it is scaled by "
                    f"{found[0] / size[0]:.4g}"
                )
    if not told:
        return drive
    frames = tuple(_scaled(f, scaled.get((f.camera_name, (f.camera.width, f.camera.height)))) for f in drive.frames)
    return replace(drive, frames=frames, notices=(*drive.notices, *told))


def _scaled(frame: Frame, size: Size | None) -> Frame:
    if size is None or size == (frame.camera.width, frame.camera.height):
        return frame
    rows = round(frame.ego_rows * size[1] / frame.camera.height)
    return replace(frame, camera=frame.camera.resized(*size), ego_rows=rows)
