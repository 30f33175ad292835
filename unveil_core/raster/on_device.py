"""Planes rendered on the device of the run, for scenes and callers in the processor's memory: the one place of transfers.

A scene is brought to the device once and stays there while it is rendered from frame to frame. On the processor nothing is copied.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields
from threading import Lock
from typing import Any
from weakref import WeakKeyDictionary

import torch
from numpy.typing import NDArray
from torch import Tensor

from unveil_core.base.files import is_out_of_gpu_memory
from unveil_core.base.kernels.device import current_device, note_of_device
from unveil_core.geometry.camera import Camera
from unveil_core.raster.api import Rendered, render
from unveil_core.surfels.surfels import Surfels

__all__ = ["array", "rendered", "there"]

KEPT = 2
"""Scenes that stay on the device: a stage renders the full and the empty one in turn. One of a million surfels takes 0.1 GB."""

_there: WeakKeyDictionary[Surfels, tuple[str, Surfels]] = WeakKeyDictionary()
"""For each scene in the processor's memory its device and its copy there, the oldest first."""
_found_good: WeakKeyDictionary[Surfels, tuple[tuple[int, ...], int]] = WeakKeyDictionary()
"""For each scene that was rendered, by what torch tells that its tensors changed, and one more than its highest label. To look at
all values takes a fifth of the time of rendering a scene, and makes a GPU wait; most scenes are rendered from many frames."""
_lock = Lock()


def there(surfels: Surfels) -> Surfels:
    """The surfels on the device of the run."""
    device = current_device().name
    if surfels.device == torch.device(device):
        return surfels
    with _lock:
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
    """The planes without gradients, on the device of the run; arguments as of ``render``. Values are looked at once.

    On the processor where a GPU that was not asked for has no memory left.
    """
    device = current_device()
    options: dict[str, Any] = {"label_count": label_count, "near": near, "far": far}
    with torch.no_grad():
        try:
            return _render_checked(there(surfels), camera, outputs, backend=device.backend, **options)
        except RuntimeError as error:
            if device.asked_for or not is_out_of_gpu_memory(error):
                raise
        with _lock:
            _there.clear()
        torch.cuda.empty_cache()
        note_of_device("rendering on the processor: the GPU has no memory left")
        return render(surfels.to("cpu"), camera, outputs, **options)


def _render_checked(
    surfels: Surfels, camera: Camera, outputs: Collection[str], *, label_count: int | None, **options: Any
) -> Rendered:
    """As ``render``, with its look at the values where they are not known."""
    versions = tuple(getattr(surfels, f.name)._version for f in fields(surfels))
    with _lock:
        known = _found_good.get(surfels)
    if known is not None and known[0] == versions and (label_count is None or known[1] <= label_count):
        return render(surfels, camera, outputs, label_count=label_count or known[1], check=False, **options)
    out = render(surfels, camera, outputs, label_count=label_count, **options)
    labels = int(surfels.labels.max()) + 1 if len(surfels) else 1
    with _lock:
        _found_good[surfels] = (versions, labels)
    return out


def array(plane: Tensor | None) -> NDArray[Any]:
    """A plane that was asked for, or what follows from one, as an array in the processor's memory."""
    assert plane is not None, "the plane was not asked for"
    found: NDArray[Any] = plane.detach().cpu().numpy()
    return found
