"""Metashape's *Export Cameras* (XML): poses from cameras to the chunk with OpenCV's axes, sensors with their calibration.

Source: Agisoft's manual, appendix *Camera models*: the principal point counts from the middle of the picture, ``b1`` is added to
the focal length along x, and P1 and P2 stand where OpenCV has p2 and p1.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.checks.conventions import OPENCV
from unveil_core.drives.drive import Distortion
from unveil_core.drives.formats.cameras import rigid
from unveil_core.drives.formats.kitti.boxes import xml_items
from unveil_core.drives.formats.shot.path import CameraPath, Lens, LensOf, PathFrame
from unveil_core.geometry.lens import FISHEYE

__all__ = ["read_metashape"]

GEOCENTRIC_M = 1e6
"""A chunk whose origin is so far from that of its world lies on the Earth's surface: up leads away from its centre."""
SKEW = 1e-6
"""Of ``b2`` over the focal length: below it no pixel is moved."""
MEND = "export it again by File > Export > Export Cameras, as Agisoft XML"
UNDISTORT = "export undistorted photographs, or fit the calibration without it"


def read_metashape(path: Path) -> CameraPath:
    """Read an XML file of cameras.

    Raises:
        DriveError: it is another XML, or a sensor has what OpenCV's models lack.
    """
    chunk = next(xml_items(path, 1, attributes=True), None)
    if chunk is None or chunk.tag != "chunk":
        raise DriveError("Not a file of Metashape's cameras", path=path, mend=MEND)
    lenses = {s.get("id"): s for s in chunk.findall("sensors/sensor")}
    placed = {c.get("id"): _placement(c, path) for c in chunk.findall("components/component")}
    whole = _placement(chunk, path)
    frames: list[PathFrame] = []
    lost, made = 0, dict[str | None, Lens]()
    scale: float | None = None
    up: Float64 | None = None
    for camera in chunk.findall("cameras//camera"):
        if camera.get("enabled", "1").lower() in ("0", "false"):
            continue
        label, text = str(camera.get("label", "")), camera.findtext("transform")
        if text is None or not label:
            lost += text is None
            continue
        sensor = camera.get("sensor_id")
        if sensor not in made:
            made[sensor] = _lens(lenses.get(sensor), path)
        lens = made[sensor]
        pose = rigid(_numbers(text, path, label), path, f"the pose of {label}")
        step = placed.get(camera.get("component_id"), whole)
        if step is not None:
            length, turn, shift = step
            pose[:3, 3] = length * turn @ pose[:3, 3] + shift
            pose[:3, :3] = turn @ pose[:3, :3]
            scale = 1.0  # a chunk that has a scale is in metres
            far = float(np.linalg.norm(shift))
            up = shift / far if far > GEOCENTRIC_M else np.array([0.0, 0.0, 1.0])
        frames.append(PathFrame(pose, _fixed(lens), name=label, camera=f"sensor {sensor}"))
    if not frames:
        raise DriveError("has no camera with a pose", path=path, mend="align the photographs, and export the cameras")
    if len({f.camera for f in frames}) == 1:
        frames = [PathFrame(f.pose, f.lens, name=f.name) for f in frames]
    told = (f"{lost} cameras of Metashape have no pose and are left out",) if lost else ()
    return CameraPath(tuple(frames), OPENCV, scale, up, told)


def _fixed(lens: Lens) -> LensOf:
    """A lens that is the file's own, whatever size the pictures have: where they were reduced, they tell so."""
    return lambda size, aspect: lens


def _numbers(text: str | None, path: Path, what: str) -> list[float]:
    try:
        return [float(word) for word in (text or "").split()]
    except ValueError as error:
        raise DriveError(f"the numbers of {what[:40]} are none", path=path, mend=MEND) from error


def _placement(owner: ElementTree.Element, path: Path) -> tuple[float, Float64, Float64] | None:
    """Scale, rotation (3, 3) and shift (3,) from a chunk or component to the world; None where it has none."""
    step = owner.find("transform")
    if step is None or step.find("scale") is None:
        return None
    parts = [
        _numbers(step.findtext(name), path, "the chunk's transform") for name in ("scale", "rotation", "translation")
    ]
    scale, turn, shift = parts[0], parts[1] or np.eye(3).ravel().tolist(), parts[2] or [0.0] * 3
    if len(scale) != 1 or not 0 < scale[0] < np.inf or len(turn) != 9 or len(shift) != 3:
        raise DriveError("the chunk's transform is none", path=path, mend=MEND)
    matrix = rigid(np.column_stack([np.reshape(turn, (3, 3)), shift]), path, "the chunk's transform")
    return scale[0], matrix[:3, :3], matrix[:3, 3]


def _lens(sensor: ElementTree.Element | None, path: Path) -> Lens:
    kind = "frame" if sensor is None else str(sensor.get("type", "frame"))
    found = None if sensor is None else _calibration(sensor.findall("calibration"))
    size = None if found is None else found.find("resolution")
    if found is None or size is None:
        raise DriveError("a camera has no calibrated sensor", path=path, mend=MEND)
    if kind not in ("frame", "fisheye"):
        raise DriveError(
            f"has a sensor of type {kind[:20]}", path=path, mend="export cameras of frame or fisheye sensors"
        )

    def number(name: str) -> float:
        values = _numbers(found.findtext(name), path, name)
        return values[0] if values else 0.0

    try:
        width, height = int(size.get("width", 0)), int(size.get("height", 0))
    except ValueError as error:
        raise DriveError("a sensor has a size that is none", path=path, mend=MEND) from error
    focal = number("f")
    if min(width, height) < 1 or not 0 < focal < np.inf:
        raise DriveError("a sensor has no size or focal length", path=path, mend=MEND)
    if abs(number("b2")) > SKEW * focal or (kind == "frame" and number("k4")) or number("p3") or number("p4"):
        raise DriveError("a sensor has b2, k4, p3 or p4, which OpenCV's lens lacks", path=path, mend=UNDISTORT)
    if kind == "fisheye":
        if number("p1") or number("p2"):
            raise DriveError("a fisheye has p1 or p2, which OpenCV's lacks", path=path, mend=UNDISTORT)
        bent: Distortion | None = Distortion(FISHEYE, tuple(number(k) for k in ("k1", "k2", "k3", "k4")))
    else:
        bent = Distortion("OPENCV", tuple(number(k) for k in ("k1", "k2", "p2", "p1", "k3")) + (0.0, 0.0, 0.0))
        bent = None if bent.is_zero else bent
    centre = width / 2 + number("cx"), height / 2 + number("cy")
    return Lens((width, height), (focal + number("b1"), focal), centre, bent)


def _calibration(found: Iterable[ElementTree.Element]) -> ElementTree.Element | None:
    """That which was adjusted, else the first."""
    listed = list(found)
    return next((c for c in listed if c.get("class") == "adjusted"), listed[0] if listed else None)
