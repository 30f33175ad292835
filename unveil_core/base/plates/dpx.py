"""Plates as DPX, of 8 to 16 bits, by OpenImageIO. The bytes of a file's header are kept."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import read_bytes
from unveil_core.base.errors import DriveError
from unveil_core.base.plates.library import dpx_library
from unveil_core.base.plates.plate import COPY, Plate, PlateFacts, checked_facts

__all__ = ["dpx_facts", "read_dpx"]

BITS = (8, 10, 12, 16)
LAYOUT = (slice(768, 780), slice(800, 801), slice(803, 804), slice(804, 808))
"""Bytes of a header that must be the same in two files of one layout: orientation, elements and size; what an element is; its bits;
its packing and encoding."""


def dpx_facts(path: Path) -> PlateFacts:
    """What the header of a DPX tells.

    Raises:
        DriveError: it cannot be read, or OpenImageIO is not installed.
    """
    source = _opened(path)
    try:
        return _facts(source.spec(), path)
    finally:
        source.close()


def read_dpx(path: Path) -> Plate:
    """Read a DPX.

    Raises:
        DriveError: see :func:`dpx_facts`; or it has other values than whole numbers of red, green and blue, or grey.
    """
    oiio, source = dpx_library(path), _opened(path)
    try:
        spec = oiio.ImageSpec(source.spec())
        facts = _facts(spec, path)
        if str(spec.format) not in ("uint8", "uint16") or spec.nchannels not in (1, 3, 4) or facts.bits not in BITS:
            what = f"{spec.nchannels} channels of {spec.format} with {facts.bits} bits"
            raise DriveError(f"has {what}", path=path, mend="export red, green and blue with 10, 12 or 16 bits")
        found = source.read_image(0, 0, 0, spec.nchannels, spec.format)
        if found is None:
            raise DriveError(f"Damaged: {_problem(source)}", path=path, mend=COPY)
    finally:
        source.close()
    pixels: NDArray[Any] = np.asarray(found).reshape(spec.height, spec.width, spec.nchannels)
    colours = 3 if spec.nchannels > 1 else 1
    alpha = pixels[..., 3] if spec.nchannels == 4 else None

    def store(target: Path, data: NDArray[Any], alpha: NDArray[Any] | None) -> None:
        whole = data if alpha is None else np.concatenate([data, alpha[..., None]], axis=2)
        _store(path, target, spec, whole)

    return Plate(path, facts, pixels[..., :colours], alpha, store)


def _store(source: Path, target: Path, spec: Any, pixels: NDArray[Any]) -> None:
    oiio, own = dpx_library(source), read_bytes(source)
    written = oiio.ImageSpec(spec)
    written["oiio:Endian"] = "little" if own[:4] == b"XPDS" else "big"
    output = oiio.ImageOutput.create("dpx")
    done = output.open(str(target), written) and output.write_image(np.ascontiguousarray(pixels))
    problem = _problem(output)
    if not (output.close() and done):
        raise DriveError(f"cannot be written as it came: {problem}", path=source, mend="export it as 10-bit RGB")
    target.write_bytes(_with_header_of(own, target.read_bytes()))


def _with_header_of(own: bytes, new: bytes) -> bytes:
    """The pixels of a file with all else of another one of the same layout; as they are where the layouts differ."""
    order = ">" if own[:4] == b"SDPX" else "<"
    if own[:4] != new[:4] or any(own[part] != new[part] for part in LAYOUT):
        return new
    at, there = (struct.unpack(order + "I", content[4:8])[0] for content in (own, new))
    size = len(new) - there
    return own[:at] + new[there:] + own[at + size :] if at + size <= len(own) else new


def _opened(path: Path) -> Any:
    oiio = dpx_library(path)
    source = oiio.ImageInput.open(str(path))
    if source is None or source.format_name() != "dpx":
        problem = (oiio.geterror() or "it is damaged") if source is None else f"it is named {path.suffix}"
        raise DriveError(f"cannot be read: {problem}", path=path, mend=COPY)
    return source


def _problem(file: Any) -> str:
    return str(file.geterror() or "its pixels cannot be read").splitlines()[0]


def _facts(spec: Any, path: Path) -> PlateFacts:
    attributes = {p.name: p.value for p in spec.extra_attribs}
    whole = 8 if str(spec.format) == "uint8" else 16
    size = int(spec.width), int(spec.height)
    bits = int(attributes.get("oiio:BitsPerSample", whole))
    aspect = float(attributes.get("PixelAspectRatio", 1.0) or 1.0)
    return checked_facts(PlateFacts("dpx", size, (0, 0), size, aspect, attributes, bits), path)
