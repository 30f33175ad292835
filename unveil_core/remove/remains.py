"""Remains of removed objects: surfels of other labels that carry no pixel but theirs.

A surfel that the frames show only where a removed object is seen has its colour from that object, whatever its label: a reflection
behind the object's surface, or what stands in for its side where the side has no texture. Of the street behind it knows nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.kernels.device import current_device
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.resume.checkpoint import Checkpoint
from unveil_core.base.types import Mask
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.raster import render
from unveil_core.raster.near_camera import near_runs
from unveil_core.raster.on_device import there
from unveil_core.surfels.initialize import SH_C0
from unveil_core.surfels.surfels import Surfels

__all__ = ["remains"]

SHARE = 0.8
"""Share of what the frames show of a surfel that must lie on removed objects."""
LEAST_PX = 0.25
"""Least weight, in pixels over all frames, from which on the frames show a surfel at all."""
WIDTH_PX = 384
"""Width of the images in which it is counted, pixels: shares are known well enough, and the time does not grow."""


def remains(
    surfels: Surfels,
    gone: Mask,
    cameras: Sequence[Camera],
    objects: Sequence[NDArray[np.bool_]],
    checkpoint: Checkpoint | None = None,
    progress: Progress = no_progress,
) -> Mask:
    """(N,) which surfels not yet ``gone`` are shown only by pixels of removed objects.

    Args:
        surfels: the full scene; gone: (N,) those that are removed already.
        cameras: of the frames; objects: (H, W) pixels of removed objects per frame, borders included, asked for once each.
        checkpoint: from which an interrupted call goes on.
    """
    # What a surfel weighs in a picture is what the picture changes by with its colour.
    weight = torch.zeros((len(surfels), 3), dtype=surfels.sh.dtype)
    checkpoint = Checkpoint() if checkpoint is None else checkpoint
    done, at = 0, 0
    if (saved := checkpoint.load()) is not None:
        weight, done = torch.from_numpy(saved[0]["weight"]), int(saved[1]["done"])
    for run, near in near_runs(surfels, cameras):
        first, at = at, at + len(run)
        if at <= done:
            continue
        some = there(surfels.select(near))
        color = torch.zeros((len(some), 1, 3), dtype=surfels.sh.dtype, device=some.device, requires_grad=True)
        plain = replace(some, sh=color)
        for i, camera in enumerate(run, start=first):
            _draw(plain, camera, objects[i])
        if color.grad is not None:
            weight[near] += color.grad[:, 0].cpu()
        if checkpoint.due():
            checkpoint.save({"weight": weight.numpy()}, {"done": at})
        progress(at, len(cameras), "looking for what remains of objects")
    on_objects, everywhere = (weight[:, :2].double().numpy() / SH_C0).T
    return np.asarray(~gone & (everywhere > LEAST_PX) & (on_objects >= SHARE * everywhere))


def _draw(plain: Surfels, camera: Camera, mask: NDArray[np.bool_]) -> None:
    """Add to the gradient of the colours: of red what surfels weigh on the mask's pixels, of green what on all."""
    width = min(WIDTH_PX, camera.width)
    small = camera.resized(width, max(1, round(camera.height * width / camera.width)))
    share = cv2.resize(mask.astype(np.float32), (small.width, small.height), interpolation=cv2.INTER_AREA)
    picture = render(plain, small, ("rgb",), near=NEAR_M, far=FAR_M, backend=current_device().backend).rgb
    assert picture is not None
    asked = torch.from_numpy(np.stack([share, np.ones_like(share), np.zeros_like(share)], axis=2))
    torch.autograd.backward((picture * asked.to(picture.device)).sum())
