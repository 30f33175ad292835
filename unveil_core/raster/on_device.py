"""Planes rendered on the device of the run, for scenes and callers in the processor's memory: the one place of transfers.

A scene is brought to the device once and stays there while it is rendered from frame to frame. On the processor nothing is copied.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any
from weakref import WeakKeyDictionary

import torch
from numpy.typing import NDArray
from torch import Tensor

from unveil_core.base.kernels.device import current_device
from unveil_core.geometry.camera import Camera
from unveil_core.raster.api import Rendered, render
from unveil_core.surfels.surfels import Surfels

__all__ = ["array", "rendered", "there"]

KEPT = 2
"""Scenes that stay on the device: a stage renders the full and the empty one in turn. One of a million surfels takes 0.1 GB."""

_there: WeakKeyDictionary[Surfels, tuple[str, Surfels]] = WeakKeyDictionary()
"""For each scene in the processor's memory its device and its copy there, the oldest first."""


def there(surfels: Surfels) -> Surfels:
    """The surfels on the device of the run."""
    device = current_device().name
    if surfels.device == torch.device(device):
        return surfels
    known = _there.pop(surfels, None)
    copy = surfels.to(device) if known is None or known[0] != device else known[1]
    _there[surfels] = (device, copy)
    for old in list(_there)[:-KEPT]:
        _there.pop(old, None)
    return copy


def rendered(
    surfels: Surfels,
    camera: Camera,
    outputs: Collection[str],
    *,
    label_count: int | None = None,
    near: float,
    far: float,
) -> Rendered:
    """The planes, on the device of the run and without gradients; arguments as of ``render``."""
    with torch.no_grad():
        return render(
            there(surfels),
            camera,
            outputs,
            label_count=label_count,
            near=near,
            far=far,
            backend=current_device().backend,
        )


def array(plane: Tensor | None) -> NDArray[Any]:
    """A plane that was asked for, or what follows from one, as an array in the processor's memory."""
    assert plane is not None, "the plane was not asked for"
    found: NDArray[Any] = plane.detach().cpu().numpy()
    return found
