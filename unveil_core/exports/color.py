"""The colours that exported files have: names, and linear light, of Rec. 709 or of a studio's configuration of OpenColorIO."""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import SettingsError
from unveil_core.base.srgb import linear_of_srgb
from unveil_core.base.types import Float32

__all__ = ["LINEAR", "REC709", "SRGB", "LinearLight", "linear_light"]

LINEAR, SRGB = "lin_rec709_scene", "srgb_rec709_display"
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


@dataclass(frozen=True, eq=False)
class LinearLight:
    """The linear colours that plates are written in.

    Attributes:
        name: of the colour space; interop_id: by the Color Interop Forum, "" if it has none.
        chromaticities: of its primaries and white, None if the configuration does not tell.
        configuration: of OpenColorIO, as ``$OCIO`` names it; None without one.
        processor: of OpenColorIO; None for Rec. 709 by the formula of sRGB.
    """

    name: str = LINEAR
    interop_id: str = LINEAR
    chromaticities: tuple[float, ...] | None = REC709
    configuration: str | None = None
    processor: Any = None

    def of(self, srgb: NDArray[np.floating]) -> Float32:
        """(H, W, 3) float32 of a picture (H, W, 3) in [0, 1]."""
        if self.processor is None:
            return linear_of_srgb(srgb).astype(np.float32)
        pixels = np.ascontiguousarray(srgb, dtype=np.float32)
        self.processor.applyRGB(pixels)
        return pixels

    def header(self) -> dict[str, Any]:
        """Attributes of an OpenEXR file."""
        found: dict[str, Any] = {"unveil:colorspace": self.name}
        if self.interop_id:
            found["colorInteropID"] = self.interop_id
        if self.chromaticities is not None:
            found["chromaticities"] = self.chromaticities
        return found


def linear_light() -> LinearLight:
    """The colours of ``$OCIO``'s role ``scene_linear`` where it is set, else linear Rec. 709.

    Raises:
        SettingsError: OpenColorIO is not installed, or its configuration cannot be read or lacks what is needed.
    """
    named = os.environ.get("OCIO", "").strip()
    if not named:
        return LinearLight()
    if find_spec("PyOpenColorIO") is None:
        mend = "pip install '.[exports]' in the folder of Unveil, or unset OCIO for linear Rec. 709"
        raise SettingsError("OCIO names a configuration, but OpenColorIO is not installed", mend=mend)
    import PyOpenColorIO as ocio

    try:
        config = ocio.Config.CreateFromFile(named)
        source = next((name for name in OF_PICTURES if config.getColorSpace(name) is not None), None)
        target = config.getColorSpace("scene_linear")
        if source is None or target is None:
            lacks = "role scene_linear" if target is None else "encoding of sRGB pictures"
            raise SettingsError(f"has no {lacks}", path=named, mend="unset OCIO for linear Rec. 709")
        processor = config.getProcessor(source, target.getName()).getDefaultCPUProcessor()
    except (ocio.Exception, ocio.ExceptionMissingFile) as error:
        problem = f"is no configuration of OpenColorIO: {error}"
        raise SettingsError(problem, path=named, mend="mend OCIO, or unset it for linear Rec. 709") from error
    interop = target.getInteropID() if hasattr(target, "getInteropID") else ""
    return LinearLight(target.getName(), interop, None, named, processor)
