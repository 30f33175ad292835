"""The clean frames as OpenEXR, a file a frame, with what a compositor needs as layers of named channels.

=========================== ========================================================================= ==================
channels                    what                                                                      values
=========================== ========================================================================= ==================
R G B                       the clean frame, linear: own primaries, or ``$OCIO``'s ``scene_linear``    half
removed.A                   what was removed, with its antialiased border                             half, 0 to 1
<class>_<id>.A              matte of a removed object, as ``car_0005.A``                              half, 0 to 1
provenance.Y                0 original, 1 relit, 2 seen elsewhere, 3 continued, 4 invented            half, whole numbers
certainty.Y                 how sure the pixel is, 1 where it is the footage's own                    half, 0 to 1
depth.Z                     of the empty street along the optical axis, the drive's units, 0 none     32-bit float
normal.X Y Z                of the empty street in the camera's axes: x right, y up, z to the viewer  half, 0 none
=========================== ========================================================================= ==================

All are of the size and lens of the footage. 8-bit sRGB comes back exactly from half precision; of 16 bits the lowest are rounded.
The header names the colour space (``unveil:colorspace``, ``colorInteropID``), has the chromaticities of the footage, and what its
camera noted: make, model, lens, exposure, time and place.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.pictures.decoding import read_image_as_it_is, read_label_image, read_metadata
from unveil_core.base.pictures.exif import exif_facts
from unveil_core.delivery.lens import work_positions
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Frame
from unveil_core.exports.color import LinearLight, linear_light
from unveil_core.exports.job import Job
from unveil_core.exports.mapping.objects import object_name
from unveil_core.exports.plates.png import numbered, told_frames
from unveil_core.exports.plates.silhouettes import Silhouettes
from unveil_core.exports.whole import tell
from unveil_core.raster.near_camera import near_camera
from unveil_core.raster.on_device import array, rendered
from unveil_core.surfels.surfels import Surfels
from unveil_core.view.surface import SURFACE_PLANES, surface_depth
from unveil_core.workspace.files import frame_file, load_mask

__all__ = ["write_exr"]

Layers = dict[str, NDArray[np.generic]]


def write_exr(job: Job, folder: Path) -> None:
    """``<camera>/<camera>.1001.exr`` for each frame, and ``export.json`` that tells which frame each is."""
    import OpenEXR

    frames, light = job.drive.frames, linear_light()
    removed = [entry for entry in job.objects if entry.get("removed")]
    silhouettes = Silhouettes(job, removed)
    empty = job.surfels("empty")
    for done, (frame, name) in enumerate(zip(frames, numbered(job, "exr"), strict=True)):
        channels = _color(job, frame, light)
        mattes = {f"{who}.A": share for who, share in silhouettes.of(frame).items()}
        shown = {**_told_pixels(job, frame), **mattes, **_surfaces(job, empty, frame)}
        channels |= {key: _in_footage(values, frame, key) for key, values in shown.items()}
        header: dict[str, Any] = {
            "compression": OpenEXR.ZIP_COMPRESSION,
            "type": OpenEXR.scanlineimage,
            **light.header(job.colours(frame)),
            **_noted(frame),
            "unveil:source": f"{frame.camera_name}/{frame.name}",
        }
        if frame.timestamp is not None:
            header["unveil:timestamp"] = repr(float(frame.timestamp))
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with OpenEXR.File(header, {key: np.ascontiguousarray(values) for key, values in channels.items()}) as file:
            file.write(str(path))
        job.progress(done + 1, len(frames), "writing plates")
    layers = [object_name(entry) for entry in removed]
    spaces = dict.fromkeys(light.name_for(c) for c in map(job.colours, frames))
    unread = dict.fromkeys(c.name for c in map(job.colours, frames) if not c.is_known)
    if unread:
        job.notice(f"exr: how {', '.join(unread)} encodes light is not known: it was taken for sRGB")
    told = {"colorspace": ", ".join(spaces), "mattes": layers, "cameras": told_frames(job)}
    if light.configuration is not None:
        told["opencolorio"] = light.configuration
    tell(folder, "exr", told)


def _color(job: Job, frame: Frame, light: LinearLight) -> Layers:
    """R G B, and A where the footage has an alpha channel, of the clean frame."""
    picture = read_image_as_it_is(job.delivered(frame))
    picture = picture[..., None].repeat(3, axis=2) if picture.ndim == 2 else picture
    share = picture.astype(np.float64) / np.iinfo(picture.dtype).max
    linear = light.of(share[..., :3], job.colours(frame)).astype(np.float16)
    found: Layers = {name: linear[..., k] for k, name in enumerate("RGB")}
    if picture.shape[2] == 4:
        found["A"] = share[..., 3].astype(np.float16)
    return found


def _noted(frame: Frame) -> dict[str, Any]:
    """What the camera noted, as OpenEXR's standard attributes."""
    facts = exif_facts(read_metadata(frame.footage_path).exif)
    offset = facts.utc_offset_s
    known = {
        "cameraMake": facts.make,
        "cameraModel": facts.model,
        "lensMake": facts.lens_make,
        "lensModel": facts.lens,
        "nominalFocalLength": facts.focal_mm,
        "expTime": facts.exposure_s,
        "aperture": facts.f_number,
        "isoSpeed": facts.iso,
        "capDate": facts.taken,
        "utcOffset": None if offset is None else -offset,  # OpenEXR's is what has to be added to get UTC
        "latitude": facts.latitude,
        "longitude": facts.longitude,
        "altitude": facts.altitude_m,
    }
    return {name: value for name, value in known.items() if value is not None}


def _told_pixels(job: Job, frame: Frame) -> Layers:
    """What stages told of the pixels, at working size; only what the workspace has."""
    found: Layers = {}
    root = job.workspace.root
    if (path := frame_file(root / "masks/removed", frame)).is_file():
        found["removed.A"] = load_mask(path).astype(np.float32)
    if (path := frame_file(root / "provenance", frame)).is_file():
        found["provenance.Y"] = read_label_image(path).astype(np.float32)
    if (path := frame_file(root / "certainty", frame)).is_file():
        found["certainty.Y"] = read_label_image(path).astype(np.float32) / 255
    return found


def _surfaces(job: Job, empty: Surfels, frame: Frame) -> Layers:
    """Depth and normal of the empty scene, at working size."""
    near = near_camera(empty, frame.camera)
    out = rendered(near, frame.camera, (*SURFACE_PLANES, "normal"), near=NEAR_M, far=FAR_M)
    depth = surface_depth(out)
    normal = array(out.normal) * np.array([1, -1, -1], np.float32)  # from OpenCV's axes to those of normal maps
    normal = normal / np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-6)
    normal = np.where(depth[..., None] > 0, normal, 0).astype(np.float32)
    return {
        "depth.Z": depth * np.float32(job.drive.to_world.scale),
        **{f"normal.{axis}": normal[..., k] for k, axis in enumerate("XYZ")},
    }


def _in_footage(values: NDArray[np.generic], frame: Frame, name: str) -> NDArray[np.generic]:
    """A plane of working size in the size and lens of the footage: mattes are interpolated, all else is of the nearest pixel."""
    plane = np.asarray(values, dtype=np.float32)
    if frame.footage is not None:
        at = work_positions(frame.footage, frame.camera) - np.float32(0.5)
        mode = cv2.INTER_LINEAR if name.endswith(".A") else cv2.INTER_NEAREST
        plane = cv2.remap(plane, at, None, mode, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    return plane if name.startswith("depth") else plane.astype(np.float16)
