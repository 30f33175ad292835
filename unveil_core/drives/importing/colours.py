"""Which colours a drive's footage has: nothing is converted, so what is not sRGB is told."""

from __future__ import annotations

from collections.abc import Sequence

from unveil_core.base.errors import DriveError
from unveil_core.base.pictures.colours import SRGB, Colours, colours_of
from unveil_core.base.pictures.decoding import read_metadata
from unveil_core.base.pictures.metadata import metadata_of
from unveil_core.drives.drive import Frame

__all__ = ["colour_notices", "colours_of_footage", "looked_at"]


def looked_at(frames: Sequence[Frame]) -> list[Frame]:
    """The first frame of each camera, one of its middle, and its last: a camera does not change its colours underway."""
    found = []
    for camera in dict.fromkeys(f.camera_name for f in frames):
        own = [f for f in frames if f.camera_name == camera]
        found += [own[k] for k in sorted({0, len(own) // 2, len(own) - 1})]
    return found


def colours_of_footage(frame: Frame) -> Colours:
    """The colours of the file that a frame is delivered as; sRGB where it cannot be read, which others tell.

    Args:
        frame: as read, or imported.
    """
    try:
        if frame.footage is not None:
            return colours_of(read_metadata(frame.footage.path))
        return colours_of(metadata_of(frame.image_bytes()) if frame.image_bytes else read_metadata(frame.image_path))
    except (DriveError, OSError):
        return SRGB


def colour_notices(frames: Sequence[Frame]) -> list[str]:
    """What to say of a drive whose footage is not sRGB, or of several kinds."""
    found: dict[str, tuple[Colours, str]] = {}
    for frame in looked_at(frames):
        colours = colours_of_footage(frame)
        found.setdefault(colours.name, (colours, frame.camera_name))
    if len(found) > 1:
        kinds = ", ".join(f"{name} (camera {camera})" for name, (_, camera) in found.items())
        return [
            f"the footage has several kinds of colours: {kinds}; convert it to one, or colours of one end up in another"
        ]
    ((name, (colours, _)),) = found.items() if found else ((SRGB.name, (SRGB, "")),)
    if colours.is_srgb:
        return []
    light = (
        "" if colours.is_known else "; how it encodes light is not known here, plates in linear light take it for sRGB"
    )
    return [
        f"the footage is {name}, not sRGB: everything is done in its own colours, and delivered frames have its profile{light}"
    ]
