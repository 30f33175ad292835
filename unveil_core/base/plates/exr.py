"""Plates as OpenEXR: all parts, layers and attributes of a file are kept as they are, by its own library.

Where the compression loses something the file is written without loss: packing untouched pixels again would change them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.plates.plate import COPY, Plate, PlateFacts, checked_facts

__all__ = ["exr_facts", "is_lossy", "read_exr"]

LOSSY = ("PXR24_COMPRESSION", "B44_COMPRESSION", "B44A_COMPRESSION", "DWAA_COMPRESSION", "DWAB_COMPRESSION")
"""That change numbers, or may."""
MOST_VALUES = 1 << 28
"""Of all parts and layers."""
ALWAYS, PACKED = 1 << 26, 64
"""Values that any file may claim; and of more, how many a byte: footage is packed to ten at most, black pictures to a thousand."""
FLAT = ("scanlineimage", "tiledimage")
NAMES = {"red": "R", "green": "G", "blue": "B", "alpha": "A"}
"""Of channels, in small letters, and what they are called usually."""
Layer = dict[str, str]
"""By R, G, B, A and Y the names of a layer's channels in the file."""


def exr_facts(path: Path) -> PlateFacts:
    """What the header of an EXR tells.

    Raises:
        DriveError: it cannot be read, is deep, or has no picture in colour or grey.
    """
    with _readable(path):
        parts = _parts(path, header_only=True)
        return _facts(parts, _picture(parts, path)[0], path)


def is_lossy(facts: PlateFacts) -> bool:
    """Whether a file is packed in a way that would change its numbers when it is packed again."""
    return getattr(facts.attributes.get("compression"), "name", "") in LOSSY


def read_exr(path: Path) -> Plate:
    """Read an EXR.

    Raises:
        DriveError: see :func:`exr_facts`; or its pixels cannot be read.
    """
    with _readable(path):
        return _read(path)


def _read(path: Path) -> Plate:
    parts = _parts(path, header_only=True)
    part, layer = _picture(parts, path)
    facts = _facts(parts, part, path)
    values, bytes_there = sum(_area(p.header) * len(p.header["channels"]) for p in parts), path.stat().st_size
    if values > MOST_VALUES:
        raise DriveError("has more pixels and layers than are read", path=path, mend="export the picture's layer alone")
    if values > max(ALWAYS, PACKED * bytes_there):
        raise DriveError(
            f"claims {values:,} values in {bytes_there:,} bytes, which no footage is packed to", path=path, mend=COPY
        )
    parts = _parts(path, header_only=False)
    channels = parts[part].channels
    names = [layer["Y"]] if "Y" in layer else [layer[n] for n in "RGB"]
    planes = [channels[n].pixels for n in names]
    if any(p.shape != facts.data_size[::-1] or p.dtype != planes[0].dtype for p in planes):
        raise DriveError("has red, green and blue of several sizes or types", path=path, mend="export it again")
    data = np.stack(planes, axis=2)
    if data.dtype.kind != "f":
        raise DriveError("has whole numbers for colours", path=path, mend="export it with half or float")
    alpha = channels[layer["A"]].pixels if "A" in layer else None

    def store(target: Path, data: NDArray[Any], alpha: NDArray[Any] | None) -> None:
        _store(path, target, part, {n: data[..., k] for k, n in enumerate(names)}, layer.get("A"), alpha)

    return Plate(path, facts, data, alpha, store)


def _store(
    source: Path,
    target: Path,
    part: int,
    planes: dict[str, NDArray[Any]],
    opacity: str | None,
    alpha: NDArray[Any] | None,
) -> None:
    try:
        file = OpenEXR.File(str(source), separate_channels=True)
        own = file.parts[part].channels
        for name, plane in planes.items():
            own[name].pixels = np.ascontiguousarray(plane)
        if opacity is not None and alpha is not None:
            own[opacity].pixels = np.ascontiguousarray(alpha)
        for each in file.parts:
            if each.header["compression"].name in LOSSY:
                each.header["compression"] = OpenEXR.ZIP_COMPRESSION
        file.write(str(target))
    except (RuntimeError, ValueError, TypeError, OSError) as error:
        raise DriveError(
            f"cannot be written as it came: {error}", path=source, mend="export it as a plain EXR"
        ) from error


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """What the library raises for damaged files, of several kinds, in one line; also for what their headers hold."""
    try:
        yield
    except (MemoryError, DriveError):
        raise
    except Exception as error:
        problem = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DriveError(f"cannot be read: {problem}", path=path, mend=COPY) from error


def _parts(path: Path, *, header_only: bool) -> list[Any]:
    found = list(OpenEXR.File(str(path), separate_channels=True, header_only=header_only).parts)
    if not found:  # the library says no more of a file that is cut short
        raise DriveError("Damaged or cut short", path=path, mend=COPY)
    return found


def _area(header: dict[str, Any]) -> int:
    low, high = (np.asarray(v, dtype=np.int64) for v in header["dataWindow"])
    return int(np.prod(np.maximum(high - low + 1, 0)))


def _facts(parts: list[Any], part: int, path: Path) -> PlateFacts:
    header = parts[part].header
    (left, top), (right, bottom) = ((int(v) for v in corner) for corner in header["displayWindow"])
    (x, y), (last_x, last_y) = ((int(v) for v in corner) for corner in header["dataWindow"])
    facts = PlateFacts(
        "openexr",
        (right - left + 1, bottom - top + 1),
        (x - left, y - top),
        (last_x - x + 1, last_y - y + 1),
        float(header.get("pixelAspectRatio", 1.0)),
        dict(header),
    )
    return checked_facts(facts, path)


def _picture(parts: list[Any], path: Path) -> tuple[int, Layer]:
    """The part of the picture and its channels: R, G and B alone, else those of the only layer that has them, else Y."""
    layers: list[tuple[int, str, Layer]] = []
    for k, part in enumerate(parts):
        kind = getattr(part.header.get("type"), "name", "scanlineimage")
        if kind not in FLAT:
            raise DriveError("has deep data", path=path, mend="flatten it")
        named: dict[str, Layer] = {}
        for channel in part.header["channels"]:
            layer, _, last = str(channel.name).rpartition(".")
            named.setdefault(layer, {}).setdefault(NAMES.get(last.lower(), last.upper()), str(channel.name))
        layers += [(k, layer, channels) for layer, channels in named.items()]
    coloured = [one for one in layers if {"R", "G", "B"} <= set(one[2])]
    chosen = [one for one in coloured if not one[1]] or (coloured if len(coloured) == 1 else [])
    if chosen:
        return chosen[0][0], {n: name for n, name in chosen[0][2].items() if n in "RGBA"}
    if coloured:
        listed = ", ".join(one[1] for one in coloured[:6])
        mend = "export the picture alone, or name its channels R, G and B"
        raise DriveError(f"has {len(coloured)} layers of colours: {listed}", path=path, mend=mend)
    grey = [one for one in layers if not one[1] and "Y" in one[2] and "RY" not in one[2]]
    if grey:
        return grey[0][0], {n: name for n, name in grey[0][2].items() if n in "YA"}
    held = ", ".join(str(c.name) for part in parts for c in part.header["channels"])
    raise DriveError(f"has no channels R, G and B, but {held[:80]}", path=path, mend="export the picture as R, G and B")
