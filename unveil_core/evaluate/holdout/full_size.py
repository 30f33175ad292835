"""The delivered frames against their footage, where that is larger than the working size."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.types import Float32, Mask
from unveil_core.delivery.lens import work_positions
from unveil_core.drives.drive import Frame
from unveil_core.drives.photographs import seen_footage
from unveil_core.evaluate.metrics import gradient, psnr_of_mse, rounded
from unveil_core.geometry.images import border_px, grow
from unveil_core.workspace.files import frame_file

__all__ = ["FullSize"]


@dataclass
class FullSize:
    """Sums over the delivered frames against their footage: inside the cars the squared error, in levels, the gradients of both and
    the pixels; outside, the pixels that changed."""

    squared: float = 0.0
    gradient: float = 0.0
    true_gradient: float = 0.0
    pixels: int = 0
    changed: int = 0

    def add(self, frame: Frame, region: Mask, touched: Mask, root: Path) -> None:
        """Add a frame.

        Args:
            frame: of the original drive, with footage.
            region: (H, W) where the photograph is the truth; touched: (H, W) where something may change at all.
            root: the workspace with ``frames/``.
        """
        footage = frame.footage
        assert footage is not None
        delivered, truth = read_image(frame_file(root / "frames", frame)), seen_footage(footage)
        at = work_positions(footage, frame.camera) - 0.5

        def enlarged(mask: Mask) -> Float32:
            return cv2.remap(mask.astype(np.float32), at[..., 0], at[..., 1], cv2.INTER_LINEAR)

        inside = enlarged(region) >= 1
        self.squared += float(((delivered[inside].astype(np.float64) - truth[inside]) ** 2).mean(axis=1).sum())
        self.gradient += float(gradient(delivered)[inside].sum())
        self.true_gradient += float(gradient(truth)[inside].sum())
        self.pixels += int(inside.sum())
        outside = enlarged(grow(touched, 2 * border_px(frame.camera.width))) == 0
        self.changed += int((delivered[outside] != truth[outside]).any(axis=1).sum())

    def figures(self) -> dict[str, Any]:
        """For JSON; none where the footage is no larger than the working size."""
        if not self.pixels:
            return {}
        figures = {
            "psnr": psnr_of_mse(self.squared / self.pixels / 255**2),
            "gradient": self.gradient / max(self.true_gradient, 1e-9),
            "changed_pixels": self.changed,
        }
        return {"full_size": rounded(figures)}
