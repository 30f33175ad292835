"""Plates as cameras and compositors write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

oiio = pytest.importorskip("OpenImageIO")

WIDTH, HEIGHT = 65, 42
TIMECODE = (0x01020304, 0)


def light(seed: int = 0, top: float = 6.0) -> NDArray[np.float32]:
    """(H, W, 3) scene light: dark to far above white, and a little below 0."""
    generator = np.random.default_rng(seed)
    found = generator.uniform(0, 1, (HEIGHT, WIDTH, 3)) ** 3 * top
    found[0, :4] = -0.01
    return found.astype(np.float32)


def write_exr(
    path: Path, picture: NDArray[np.float32], *, half: bool = True, compression: str = "zips", **more
) -> Path:  # type: ignore[no-untyped-def]
    """R, G, B, A, a float depth and small ids, with what a camera notes."""
    spec = oiio.ImageSpec(picture.shape[1], picture.shape[0], 6, oiio.HALF if half else oiio.FLOAT)
    spec.channelnames = ("R", "G", "B", "A", "depth.Z", "id.N")
    kind = oiio.HALF if half else oiio.FLOAT
    spec.channelformats = (kind, kind, kind, kind, oiio.FLOAT, oiio.UINT)
    spec["compression"] = compression
    spec.attribute("smpte:TimeCode", oiio.TypeDesc("timecode"), TIMECODE)
    spec["reelName"], spec["framesPerSecond"], spec["PixelAspectRatio"] = "A001_C002", 24.0, 2.0
    spec["imageCounter"] = 1042
    for name, value in more.items():
        if name == "chromaticities":
            spec.attribute(name, oiio.TypeDesc("float[8]"), value)
        else:
            spec[name] = value
    rest = np.zeros((*picture.shape[:2], 3), np.float32)
    rest[..., 0], rest[..., 1], rest[..., 2] = 0.5, np.pi, np.linspace(0, 1, picture.shape[1])
    return write(path, spec, np.concatenate([picture, rest], axis=2))


def write_dpx(path: Path, codes: NDArray[np.uint16], *, bits: int, transfer: str, little: bool = False) -> Path:
    """(H, W, 3) codes of so many bits."""
    spec = oiio.ImageSpec(codes.shape[1], codes.shape[0], 3, oiio.UINT16)
    spec["oiio:BitsPerSample"], spec["dpx:Transfer"] = bits, transfer
    spec["oiio:Endian"] = "little" if little else "big"
    spec["dpx:FramePosition"], spec["dpx:FrameRate"], spec["DocumentName"] = 1001, 24.0, "A001_C002"
    spec.attribute("smpte:TimeCode", oiio.TypeDesc("timecode"), TIMECODE)
    wide = codes.astype(np.uint32) << (16 - bits)
    wide |= wide >> bits
    return write(path, spec, wide.astype(np.uint16))


def write(path: Path, spec, pixels) -> Path:  # type: ignore[no-untyped-def]
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec) and output.write_image(pixels) and output.close(), output.geterror()
    return path


def pixels(path: Path, kind=oiio.FLOAT):  # type: ignore[no-untyped-def]
    """All of the first part."""
    source = oiio.ImageInput.open(str(path))
    return source.read_image(0, 0, 0, source.spec().nchannels, kind)


def attributes(path: Path) -> dict[str, object]:
    return {p.name: p.value for p in oiio.ImageInput.open(str(path)).spec().extra_attribs}
