"""The clean frames as movies, one a camera, by PyAV (FFmpeg): H.264 in MP4 to look at, ProRes 422 HQ in MOV to edit.

Colours are converted to Y'CbCr by Rec. 709 and the file says so. Both formats keep colour at half resolution, H.264 in both
directions; an odd width or height is enlarged by its last column or row. Frames come at the drive's rate where its time
stamps tell one.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import read_image_as_it_is
from unveil_core.drives.drive import tracks
from unveil_core.exports.job import Job
from unveil_core.exports.plates.png import told_frames
from unveil_core.exports.whole import tell

__all__ = ["FALLBACK_RATE", "write_mp4", "write_prores"]

FALLBACK_RATE = 10.0
"""Frames a second where the drive tells no rate: that of most driving datasets."""
BT709 = 1
"""ITU-T H.273: the number of Rec. 709 as primaries, transfer and matrix."""
LIMITED_RANGE = 1
"""FFmpeg's number of the range 16 to 235."""


@dataclass(frozen=True)
class _Codec:
    name: str
    suffix: str
    pixels: str
    options: dict[str, str]


H264 = _Codec("libx264", "mp4", "yuv420p", {"crf": "14", "preset": "medium", "movflags": "+faststart"})
"""crf 14: above what viewers can tell apart, a tenth of the size of PNG."""
PRORES = _Codec("prores_ks", "mov", "yuv422p10le", {"profile": "3", "vendor": "apl0"})


def write_mp4(job: Job, folder: Path) -> None:
    """``<camera>.mp4`` for each camera."""
    _write(job, folder, H264, "mp4")


def write_prores(job: Job, folder: Path) -> None:
    """``<camera>.mov`` for each camera."""
    _write(job, folder, PRORES, "prores")


def _write(job: Job, folder: Path, codec: _Codec, name: str) -> None:
    import av

    rate = Fraction(job.drive.frame_rate or FALLBACK_RATE).limit_denominator(1001)
    done = 0
    for track in tracks(job.drive):
        frames = [job.drive.frames[i] for i in track]
        first = _even(read_image_as_it_is(job.delivered(frames[0])))
        with av.open(str(folder / f"{frames[0].camera_name}.{codec.suffix}"), "w") as container:
            stream = container.add_stream(codec.name, rate=rate, options=codec.options)
            stream.height, stream.width = first.shape[:2]
            stream.pix_fmt = codec.pixels
            context = stream.codec_context
            context.color_primaries = context.color_trc = context.colorspace = BT709
            context.color_range = LIMITED_RANGE
            for frame in frames:
                picture = _even(read_image_as_it_is(job.delivered(frame)))
                if picture.shape != first.shape:
                    picture = cv2.resize(picture, first.shape[1::-1], interpolation=cv2.INTER_AREA)
                kind = "rgb48le" if picture.dtype == np.uint16 else "rgb24"
                whole = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format=kind)
                converted = whole.reformat(format=codec.pixels, dst_colorspace="ITU709", dst_color_range="MPEG")
                # The encoder of ProRes writes what each frame says, not what the stream does.
                converted.color_primaries = converted.color_trc = BT709
                container.mux(stream.encode(converted))
                done += 1
                job.progress(done, len(job.drive.frames), "encoding")
            container.mux(stream.encode(None))
    tell(folder, name, {"colorspace": "rec709", "frames_per_second": float(rate), "cameras": told_frames(job)})


def _even(picture: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.generic]:
    """(H, W, 3) RGB with even sides: grey is repeated, an alpha channel dropped."""
    rgb = picture[..., None].repeat(3, axis=2) if picture.ndim == 2 else picture[..., :3]
    down, right = (side % 2 for side in rgb.shape[:2])
    return np.pad(rgb, ((0, down), (0, right), (0, 0)), mode="edge")
