"""The colours that exported files have: names, and linear light, in the footage's own primaries or of a studio's configuration of
OpenColorIO."""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import SettingsError
from unveil_core.base.pictures.colours import SRGB as SRGB_COLOURS
from unveil_core.base.pictures.colours import Colours, to_xyz
from unveil_core.base.srgb import srgb_of_linear
from unveil_core.base.types import Float32, Float64

__all__ = ["LINEAR", "REC709", "SRGB", "LinearLight", "in_rec709", "linear_light"]

LINEAR, SRGB = SRGB_COLOURS.linear, SRGB_COLOURS.encoded
"""Names of the Color Interop Forum, which OpenEXR, OpenColorIO and glTF use: linear light with the primaries of Rec. 709, and the
encoding of pictures on disk."""
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""Chromaticities: x and y of red, green, blue and white."""
OF_PICTURES = (
    "sRGB - Texture",
    "srgb_texture",
    "srgb_rec709_scene",
    "sRGB Encoded Rec.709 (sRGB)",
    "sRGB",
    "texture_paint",
)
"""Names under which configurations have the encoding of photographs, those of the ACES configurations first, a role last."""
OF_LIGHT = ("Linear Rec.709 (sRGB)", "lin_rec709_scene", "lin_rec709", "lin_srgb", "Utility - Linear - sRGB", "Linear")
"""Names under which they have linear light with the primaries of Rec. 709."""


@dataclass(frozen=True, eq=False)
class LinearLight:
    """The linear colours that plates are written in.

    Attributes:
        configuration: of OpenColorIO, as ``$OCIO`` names it; None: each picture keeps its own primaries.
        name: of the configuration's space; interop_id: by the Color Interop Forum, "" if it has none.
        from_srgb: processor of OpenColorIO from sRGB pictures to the space; from_light: from linear Rec. 709, None if the
            configuration has no such space.
    """

    configuration: str | None = None
    name: str = ""
    interop_id: str = ""
    from_srgb: Any = None
    from_light: Any = None

    def of(self, picture: NDArray[np.floating], colours: Colours = SRGB_COLOURS) -> Float32:
        """(H, W, 3) float32 of a picture (H, W, 3) in [0, 1] that has these colours.

        Raises:
            SettingsError: the configuration has no space that its light could be brought to.
        """
        if self.configuration is None:
            return colours.light(picture).astype(np.float32)
        plain = colours.is_srgb or not colours.is_known
        if not plain and self.from_light is None:
            problem = f"has no linear light of Rec. 709, by which footage of {colours.name} is brought to it"
            raise SettingsError(problem, path=self.configuration, mend="unset OCIO for the footage's own primaries")
        pixels = np.ascontiguousarray(picture if plain else _rec709_light(picture, colours), dtype=np.float32)
        (self.from_srgb if plain else self.from_light).applyRGB(pixels)
        return pixels

    def name_for(self, colours: Colours) -> str:
        """What the light of a picture of these colours is called."""
        if self.configuration is not None:
            return self.name
        return colours.linear or f"linear {colours.name}"

    def header(self, colours: Colours = SRGB_COLOURS) -> dict[str, Any]:
        """Attributes of an OpenEXR file of such a picture."""
        found: dict[str, Any] = {"unveil:colorspace": self.name_for(colours)}
        own = self.configuration is None
        if identity := (colours.linear if own else self.interop_id):
            found["colorInteropID"] = identity
        if own and colours.chromaticities is not None:
            found["chromaticities"] = colours.chromaticities
        return found


def linear_light() -> LinearLight:
    """The colours of ``$OCIO``'s role ``scene_linear`` where it is set, else linear light in the footage's own primaries.

    Raises:
        SettingsError: OpenColorIO is not installed, or its configuration cannot be read or lacks what is needed.
    """
    named = os.environ.get("OCIO", "").strip()
    if not named:
        return LinearLight()
    if find_spec("PyOpenColorIO") is None:
        mend = "pip install '.[exports]' in the folder of Unveil, or unset OCIO for linear Rec. 709"
        raise SettingsError("Not installed: OpenColorIO, and OCIO names a configuration", mend=mend)
    import PyOpenColorIO as ocio

    try:
        config = ocio.Config.CreateFromFile(named)
        source, light = (
            next((name for name in names if config.getColorSpace(name) is not None), None)
            for names in (OF_PICTURES, OF_LIGHT)
        )
        target = config.getColorSpace("scene_linear")
        if source is None or target is None:
            lacks = "role scene_linear" if target is None else "encoding of sRGB pictures"
            raise SettingsError(f"has no {lacks}", path=named, mend="unset OCIO for linear Rec. 709")
        processors = [
            None if name is None else config.getProcessor(name, target.getName()).getDefaultCPUProcessor()
            for name in (source, light)
        ]
    except (ocio.Exception, ocio.ExceptionMissingFile) as error:
        problem = f"Not a configuration of OpenColorIO: {error}"
        raise SettingsError(problem, path=named, mend="mend OCIO, or unset it for linear Rec. 709") from error
    interop = target.getInteropID() if hasattr(target, "getInteropID") else ""
    return LinearLight(named, target.getName(), interop, *processors)


def in_rec709(picture: NDArray[np.floating], colours: Colours) -> Float64:
    """(H, W, 3) a picture in [0, 1] of some colours in those of sRGB; what these have not is cut off at their border."""
    if colours.is_srgb or not colours.is_known:
        return np.asarray(picture, dtype=np.float64)
    return srgb_of_linear(np.clip(_rec709_light(picture, colours), 0, 1))


def _rec709_light(picture: NDArray[np.floating], colours: Colours) -> Float64:
    """(H, W, 3) light of a picture in the primaries of Rec. 709; below 0 and beyond 1 where they do not reach."""
    assert colours.chromaticities is not None
    turn = np.linalg.solve(to_xyz(REC709), to_xyz(colours.chromaticities))
    return np.asarray(colours.light(picture) @ turn.T)
