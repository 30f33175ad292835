"""The clean frames as movies, one a camera, by PyAV (FFmpeg): H.264 in MP4 to look at, ProRes 422 HQ in MOV to edit.

Colours are converted to Y'CbCr by Rec. 709 and the file says so. Pictures of Display P3 keep their primaries, and the file says
that; those of other colours, which movies have no name for, are converted to Rec. 709. Both keep colour at half resolution,
H.264 in both directions; an odd width or height is enlarged by its last column or row. Frames come at the drive's rate where its
time stamps tell one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.pictures.colours import Colours
from unveil_core.base.pictures.decoding import read_image_as_it_is
from unveil_core.drives.drive import Frame, tracks
from unveil_core.exports.color import in_rec709
from unveil_core.exports.job import Job
from unveil_core.exports.plates.png import told_frames
from unveil_core.exports.whole import tell

__all__ = ["FALLBACK_RATE", "Codec", "encode", "write_mp4", "write_prores"]

FALLBACK_RATE = 10.0
"""Frames a second where the drive tells no rate: that of most driving datasets."""
BT709, P3 = 1, 12
"""ITU-T H.273: the numbers of Rec. 709 as primaries, transfer and matrix, and of P3 with the white D65 as primaries."""
SPACES = {BT709: "rec709", P3: "p3d65"}
LIMITED_RANGE = 1
"""FFmpeg's number of the range 16 to 235."""


@dataclass(frozen=True)
class Codec:
    """How FFmpeg is told to encode: its encoder, the file's suffix, the layout of pixels, and options of the encoder."""

    name: str
    suffix: str
    pixels: str
    options: dict[str, str]


H264 = Codec("libx264", "mp4", "yuv420p", {"crf": "14", "preset": "medium", "movflags": "+faststart"})
"""crf 14: above what viewers can tell apart, a tenth of the size of PNG."""
PRORES = Codec("prores_ks", "mov", "yuv422p10le", {"profile": "3", "vendor": "apl0"})


def write_mp4(job: Job, folder: Path) -> None:
    """``<camera>.mp4`` for each camera."""
    _write(job, folder, H264, "mp4")


def write_prores(job: Job, folder: Path) -> None:
    """``<camera>.mov`` for each camera."""
    _write(job, folder, PRORES, "prores")


def _write(job: Job, folder: Path, codec: Codec, name: str) -> None:
    import av

    rate = Fraction(job.drive.frame_rate or FALLBACK_RATE).limit_denominator(1001)
    done, spaces = 0, {}
    for track in tracks(job.drive):
        frames = [job.drive.frames[i] for i in track]
        first = _even(read_image_as_it_is(job.delivered(frames[0])))
        size = (first.shape[1], first.shape[0])
        primaries = P3 if all(job.colours(f).encoded == "srgb_p3d65_display" for f in frames) else BT709
        spaces[frames[0].camera_name] = SPACES[primaries]
        with av.open(str(folder / f"{frames[0].camera_name}.{codec.suffix}"), "w") as container:
            pictures = _pictures(job, frames, size, done, keep=primaries == P3)
            encode(container, codec, rate, size, pictures, primaries)
        done += len(frames)
    told = ", ".join(dict.fromkeys(spaces.values()))
    tell(folder, name, {"colorspace": told, "frames_per_second": float(rate), "cameras": told_frames(job)})


def encode(
    container: Any,
    codec: Codec,
    rate: Fraction,
    size: tuple[int, int],
    pictures: Iterable[NDArray[np.generic]],
    primaries: int = BT709,
) -> None:
    """Write RGB pictures (H, W, 3), 8 or 16 bits, as a movie coded by BT.709.

    Args:
        container: an open one of PyAV.
        rate: pictures a second; size: width and height of all, both even.
        primaries: of the pictures, by their number in H.273.
    """
    import av

    stream = container.add_stream(codec.name, rate=rate, options=codec.options)
    stream.width, stream.height = size
    stream.pix_fmt = codec.pixels
    context = stream.codec_context
    context.color_primaries = primaries
    context.color_trc = context.colorspace = BT709
    context.color_range = LIMITED_RANGE
    for picture in pictures:
        kind = "rgb48le" if picture.dtype == np.uint16 else "rgb24"
        whole = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format=kind)
        converted = whole.reformat(format=codec.pixels, dst_colorspace="ITU709", dst_color_range="MPEG")
        # The encoder of ProRes writes what each frame says, not what the stream does.
        converted.color_primaries, converted.color_trc = primaries, BT709
        container.mux(stream.encode(converted))
    container.mux(stream.encode(None))


def _pictures(
    job: Job, frames: list[Frame], size: tuple[int, int], before: int, *, keep: bool
) -> Iterator[NDArray[np.generic]]:
    """A camera's delivered frames; ``before``: how many of the job's were encoded already; ``keep``: their colours as they are."""
    for done, frame in enumerate(frames, start=before + 1):
        picture = _even(read_image_as_it_is(job.delivered(frame)))
        if not keep and not job.colours(frame).is_srgb:
            picture = _converted(picture, job.colours(frame))
        if picture.shape[1::-1] != size:
            picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        yield picture
        job.progress(done, len(job.drive.frames), "encoding")


def _converted(picture: NDArray[Any], colours: Colours) -> NDArray[Any]:
    """A picture of some colours in those of sRGB, with as many bits."""
    most = int(np.iinfo(picture.dtype).max)
    return np.round(in_rec709(picture / most, colours) * most).astype(picture.dtype)


def _even(picture: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.generic]:
    """(H, W, 3) RGB with even sides: grey is repeated, an alpha channel dropped."""
    rgb = picture[..., None].repeat(3, axis=2) if picture.ndim == 2 else picture[..., :3]
    down, right = (side % 2 for side in rgb.shape[:2])
    return np.pad(rgb, ((0, down), (0, right), (0, 0)), mode="edge")
