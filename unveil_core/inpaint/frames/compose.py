"""Composition of a delivered frame: the photograph where nothing was removed, the empty street elsewhere, blended at the border."""

from __future__ import annotations

import cv2
import numpy as np

from unveil_core.base.mechanisms import on
from unveil_core.base.types import Float32, Levels, Mask
from unveil_core.geometry.axes import UP
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px, grow, masked_blur, scale_from_384

__all__ = ["compose_frame", "in_the_light_of", "optimized_pixels", "sky_below"]

SEAM_PX = 1.0
"""Width of the blend, measured inwards from the border of what was changed: masks reach that far beyond the object, so the blend
shows nothing of it."""
LIGHT_PX = 2.5
"""Standard deviation of what is light, pixels at 384. On planted cars of three real drives 2.5 is 0.03 to 0.1 dB better than 1, and
0.1 to 0.4 dB than the filled frame alone."""


def in_the_light_of(rendered: Levels, filled: Levels, removed: Mask) -> Levels:
    """The optimized scene in a frame, (H, W, 3), as bright as the frame was filled: a surfel has one colour for all views, and the
    chart's texels have edges that the optimization smoothed.

    Args:
        filled: (H, W, 3) before the scene was optimized; removed: (H, W) pixels of which both show the empty street.
    """
    if not on("filled_light"):
        return rendered
    picture = rendered.astype(np.float32)
    sigma = LIGHT_PX * scale_from_384(removed.shape[1])
    light = masked_blur(filled.astype(np.float32) - picture, removed, sigma)
    return picture + light


def optimized_pixels(removed: Mask, moving: Mask, bare: Mask) -> Mask:
    """(H, W) pixels that show the optimized scene: those behind removed objects.

    Shadows were relit in the photograph itself. Around dynamic objects nothing was optimized: there the inpainted frame is shown,
    with what other frames saw; and so it is where the scene would show the sky below the horizon.

    Args:
        removed: (H, W) pixels of removed objects; moving: (H, W) pixels of dynamic ones.
        bare: (H, W) pixels that would, see :func:`sky_below`.
    """
    if not on("optimized_pixels"):
        return np.zeros_like(removed)
    optimized = removed & ~grow(moving, border_px(removed.shape[1]))
    return optimized & ~bare


def sky_below(camera: Camera, depth: Float32) -> Mask:
    """(H, W) pixels below the horizon in which the empty scene has no surface: its depth (H, W) is 0 there."""
    if not on("no_sky_below"):
        return np.zeros(depth.shape, bool)
    return (depth == 0) & camera.below_horizon(UP)


def compose_frame(image: Levels, clean: Levels, changed: Mask) -> Float32:
    """Put ``clean`` into ``image`` where ``changed``, with a soft seam inside the changed region.

    Args:
        image: (H, W, 3) levels of 255 as photographed; clean: (H, W, 3) of the empty street, likewise.
        changed: (H, W) bool; outside of it the result is the photograph, bit for bit.
    """
    inward = cv2.distanceTransform(changed.astype(np.uint8), cv2.DIST_L2, 3)
    share = np.clip(inward / (SEAM_PX + 1.0), 0, 1)[..., None]
    blended = image * (1 - share) + clean * share
    return np.where(changed[..., None], blended, image).astype(np.float32)
