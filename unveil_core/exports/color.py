"""Names of the colours that exported files have."""

from __future__ import annotations

__all__ = ["LINEAR", "SRGB"]

LINEAR, SRGB = "lin_rec709_scene", "srgb_rec709_display"
"""Names of the Color Interop Forum, which OpenEXR, OpenColorIO and glTF use: linear light with the primaries of Rec. 709, and the
encoding of pictures on disk."""
