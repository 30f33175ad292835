"""The sky: colour by viewing direction where the surfels leave light through.

A small panorama around the drive's up axis (azimuth by elevation), sampled bilinearly. It is fitted directly to the sky
pixels first and may be trained with the surfels; no surfel carries the label sky.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from unveil_core.base.checks.array_headers import open_npz
from unveil_core.base.errors import UnveilError
from unveil_core.base.files import NO_ARCHIVE, write_atomic
from unveil_core.geometry.axes import up_frame
from unveil_core.geometry.camera import Camera

__all__ = ["Sky", "fit_sky", "load_sky", "save_sky"]

LARGEST_BYTES = 1 << 28
"""Of a sky's file, unpacked: hundred times what is written."""


@dataclass(frozen=True, eq=False)
class Sky:
    """A panorama of the sky.

    Attributes:
        texture: (3, E, A) float32 sRGB colours, rows from straight down (-90 degrees) to straight up, columns around.
        axes: (3, 3) float64, rows east, north, up of the panorama in the drive's frame.
    """

    texture: Tensor
    axes: NDArray[np.float64]

    def to(self, device: torch.device | str) -> Sky:
        """The same on a device; itself where it is there already."""
        return self if self.texture.device == torch.device(device) else Sky(self.texture.to(device), self.axes)

    def grid(self, camera: Camera) -> Tensor:
        """(1, H, W, 2) sampling positions of a camera's pixels, for :meth:`sample`; reuse it over iterations."""
        directions = camera.rays() @ self.axes.T
        azimuth = np.arctan2(directions[..., 1], directions[..., 0]) / np.pi
        elevation = np.arctan2(directions[..., 2], np.hypot(directions[..., 0], directions[..., 1])) / (np.pi / 2)
        # For the texture with its ends wrapped, see :func:`_wrapped`.
        width = self.texture.shape[2]
        grid = np.stack([azimuth * width / (width + 2), elevation], axis=-1)
        return torch.from_numpy(grid[None].astype(np.float32))

    def grid_of_rays(self, rays: Tensor, turn: Tensor) -> Tensor:
        """(1, H, W, 2) as :meth:`grid`, computed where the rays are: cheaper on a GPU than to bring or to keep the positions.

        Args:
            rays: (H, W, 3) in the camera's frame; turn: (3, 3) float32 from there to the panorama's axes, see :meth:`turn`.
        """
        # Element by element: a matrix product may be rounded to TF32.
        east, north, up = ((rays * row).sum(dim=2) for row in turn)
        width = self.texture.shape[2]
        azimuth = torch.atan2(north, east) * (width / (width + 2) / np.pi)
        elevation = torch.atan2(up, torch.hypot(east, north)) * (2 / np.pi)
        return torch.stack([azimuth, elevation], dim=2)[None]

    def grid_there(self, camera: Camera, device: torch.device) -> Tensor:
        """(1, H, W, 2) as :meth:`grid`, computed on a device, in float32."""
        x = (torch.arange(camera.width, device=device, dtype=torch.float32) + (0.5 - camera.cx)) / camera.fx
        y = (torch.arange(camera.height, device=device, dtype=torch.float32) + (0.5 - camera.cy)) / camera.fy
        x, y = x.expand(camera.height, -1), y[:, None].expand(-1, camera.width)
        return self.grid_of_rays(torch.stack([x, y, torch.ones_like(x)], dim=2), self.turn(camera).to(device))

    def turn(self, camera: Camera) -> Tensor:
        """(3, 3) float32 from a camera's frame to the panorama's axes."""
        return torch.from_numpy((self.axes @ camera.world_to_camera[:3, :3].T).astype(np.float32))

    def sample(self, grid: Tensor, texture: Tensor | None = None) -> Tensor:
        """(H, W, 3) sky colours at ``grid``; differentiable in ``texture`` (default: the stored one)."""
        texture = self.texture if texture is None else texture
        wrapped = _wrapped(texture)[None]
        picture = F.grid_sample(wrapped, grid, mode="bilinear", padding_mode="border", align_corners=False)
        return picture[0].permute(1, 2, 0)

    def with_rows(self, rows: int) -> Sky:
        """The same panorama with more rows, a multiple of its own, sampled bilinearly."""
        factor = rows // self.texture.shape[1]
        if factor == 1:
            return self
        wrapped = _wrapped(self.texture)[None]
        finer = F.interpolate(wrapped, scale_factor=factor, mode="bilinear", align_corners=False)
        return Sky(finer[0, :, :, factor:-factor].contiguous(), self.axes)

    def render(self, camera: Camera) -> Tensor:
        """(H, W, 3) sky colours of a whole view."""
        return self.sample(self.grid(camera))


def _wrapped(texture: Tensor) -> Tensor:
    """A panorama (3, E, A) with one more column on each side, so that the seam behind is continuous: (3, E, A + 2)."""
    return torch.cat([texture[:, :, -1:], texture, texture[:, :, :1]], dim=2)


def fit_sky(
    samples: Sequence[tuple[Camera, NDArray[np.uint8], NDArray[np.bool_]]],
    up: NDArray[np.float64],
    *,
    height: int = 64,
) -> Sky:
    """Average the sky pixels of some views by direction and fill the rest smoothly.

    Args:
        samples: (camera, image (H, W, 3) uint8, sky mask (H, W)) of views.
        up: (3,) the drive's up.
        height: rows of the panorama; it has twice as many columns.
    Returns:
        a sky whose unseen directions carry the nearest seen colour, blurred.
    """
    axes = up_frame(up)
    width = 2 * height
    total = np.zeros((height * width, 3))
    weight = np.zeros(height * width)
    for camera, image, mask in samples:
        directions = camera.rays()[mask] @ axes.T
        if not len(directions):
            continue
        azimuth = np.arctan2(directions[:, 1], directions[:, 0])
        elevation = np.arctan2(directions[:, 2], np.hypot(directions[:, 0], directions[:, 1]))
        column = np.clip(((azimuth / np.pi + 1) / 2 * width).astype(int), 0, width - 1)
        row = np.clip(((elevation / (np.pi / 2) + 1) / 2 * height).astype(int), 0, height - 1)
        cell = row * width + column
        colors = image[mask].astype(np.float64) / 255
        for channel in range(3):
            total[:, channel] += np.bincount(cell, colors[:, channel], minlength=height * width)
        weight += np.bincount(cell, minlength=height * width)
    texture = np.full((height, width, 3), 0.7)
    if weight.any():
        from scipy.ndimage import distance_transform_edt, gaussian_filter

        seen = weight.reshape(height, width) > 0
        mean = total / np.maximum(weight, 1)[:, None]
        grid = mean.reshape(height, width, 3)
        nearest = distance_transform_edt(~seen, return_distances=False, return_indices=True)
        filled = grid[nearest[0], nearest[1]]
        smooth = gaussian_filter(filled, sigma=(2, 2, 0), mode=("nearest", "wrap", "nearest"))
        texture = np.where(seen[..., None], grid, smooth)
    return Sky(torch.from_numpy(texture.transpose(2, 0, 1).astype(np.float32).copy()), axes)


def save_sky(sky: Sky, path: Path) -> None:
    """Write the sky as a plain npz."""
    write_atomic(path, lambda stream: np.savez(stream, texture=sky.texture.numpy(), axes=sky.axes))


def load_sky(path: Path) -> Sky:
    """The sky of a workspace.

    Raises:
        UnveilError: missing or damaged.
    """
    try:
        with open_npz(path, ("texture", "axes"), LARGEST_BYTES) as data:
            texture, axes = data["texture"], data["axes"]
        if texture.dtype != np.float32 or texture.ndim != 3 or len(texture) != 3 or not texture.size:
            raise ValueError(f"its texture is {texture.dtype} {texture.shape}")
        if axes.dtype != np.float64 or axes.shape != (3, 3) or np.abs(axes @ axes.T - np.eye(3)).max() > 1e-3:
            raise ValueError("its axes do not form a rotation")
        if not np.isfinite(texture).all():
            raise ValueError("a colour is not finite")
        return Sky(torch.from_numpy(texture), axes)
    except NO_ARCHIVE as error:
        raise UnveilError(f"Not a readable sky: {error}", path=path, mend="run `unveil reconstruct` again") from error
