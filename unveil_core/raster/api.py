"""render(): the one public function of the rasterizer."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from unveil_core.geometry.camera import Camera
from unveil_core.raster.autograd import rasterize
from unveil_core.raster.cpu.kernels import first_bad_row
from unveil_core.raster.reference import render_reference
from unveil_core.raster.spec import MAX_LABELS, PLANES
from unveil_core.raster.spherical_harmonics import evaluate
from unveil_core.surfels.surfels import Surfels

__all__ = ["BACKENDS", "PLANES", "Rendered", "render"]

BACKENDS = ("auto", "cpu", "reference")
_GEOMETRY = {"depth", "median_depth", "normal", "distortion"}
_LABELS = {"semantics", "label_distortion"}


@dataclass(frozen=True, eq=False)
class Rendered:
    """The planes that were asked for, others None.

    Attributes:
        rgb: (H, W, 3) accumulated colour, without any background.
        alpha: (H, W).
        semantics: (H, W, K) accumulated weight per label.
        depth: (H, W) accumulated weight times depth, not divided by alpha.
        median_depth: (H, W), 0 where no light is stopped.
        normal: (H, W, 3) accumulated, in the camera's frame, facing the camera.
        distortion: (H, W), equation 13 of 2DGS on mapped depth.
        label_distortion: (H, W), the same per label, summed over labels.
        visible: (N,) bool, surfels that touch the image.
    """

    rgb: Tensor | None
    alpha: Tensor | None
    semantics: Tensor | None
    depth: Tensor | None
    median_depth: Tensor | None
    normal: Tensor | None
    distortion: Tensor | None
    label_distortion: Tensor | None
    visible: Tensor
    _screen_gradients: Callable[[], Tensor | None] = field(default=lambda: None, repr=False)

    def screen_gradients(self) -> Tensor:
        """(N, 2) gradient of the loss by the projected means, in pixels; zero for surfels off the image.

        Raises:
            RuntimeError: backward has not run.
        """
        gradients = self._screen_gradients()
        if gradients is None:
            raise RuntimeError("screen_gradients() needs a backward pass first")
        return gradients


def _check(surfels: Surfels, label_count: int | None, outputs: Collection[str], near: float, far: float) -> int:
    """Shapes, finiteness and ranges; returns K."""
    unknown = [name for name in outputs if name not in PLANES]
    if unknown:
        raise ValueError(f"unknown plane {unknown[0]!r}; there are {', '.join(PLANES)}")
    if not 0 < near < far:
        raise ValueError(f"near {near} and far {far}: 0 < near < far is needed")
    n = len(surfels)
    shapes = {"means": (n, 3), "quats": (n, 4), "log_scales": (n, 2), "opacity_logits": (n,), "labels": (n,)}
    for name, shape in shapes.items():
        tensor = getattr(surfels, name)
        if tuple(tensor.shape) != shape:
            raise ValueError(f"{name} has shape {tuple(tensor.shape)}, {shape} is needed")
    coefficients = surfels.sh.shape[1] if surfels.sh.dim() == 3 else 0
    if surfels.sh.dim() != 3 or len(surfels.sh) != n or surfels.sh.shape[2] != 3 or coefficients not in (1, 4, 9, 16):
        raise ValueError(f"sh has shape {tuple(surfels.sh.shape)}, ({n}, 1 or 4 or 9 or 16, 3) is needed")
    for name in ("means", "quats", "log_scales", "opacity_logits", "sh"):
        values = getattr(surfels, name).detach()
        if values.dtype == torch.float32 and values.device.type == "cpu":
            flat = np.ascontiguousarray(values.numpy()).reshape(-1)
            bad = first_bad_row(flat, max(1, flat.size // max(n, 1))) if n else -1
        else:
            rows = torch.isfinite(values.reshape(n, -1)).all(dim=1) if n else torch.ones(0, dtype=torch.bool)
            bad = -1 if bool(rows.all()) else int((~rows).nonzero()[0])
        if bad >= 0:
            raise ValueError(f"{name} is not finite in row {bad}")
    low, high = (int(surfels.labels.min()), int(surfels.labels.max())) if n else (0, 0)
    count = high + 1 if label_count is None else label_count
    if not 1 <= count <= MAX_LABELS:
        raise ValueError(f"label_count {count}; 1 to {MAX_LABELS} labels are possible")
    if low < 0 or high >= count:
        raise ValueError(f"labels reach from {low} to {high}; 0 to {count - 1} are possible with label_count {count}")
    return count


def render(
    surfels: Surfels,
    camera: Camera,
    outputs: Collection[str] = ("rgb", "alpha"),
    *,
    label_count: int | None = None,
    near: float = 0.2,
    far: float = 100.0,
    backend: str = "auto",
) -> Rendered:
    """Render surfels, differentiable in means, quats, log_scales, opacity_logits and sh.

    Args:
        surfels: N surfels, float32.
        camera: the view.
        outputs: names of planes, see :class:`Rendered`; what is not asked for costs nothing.
        label_count: K for the label planes; the highest label plus one by default.
        near, far: world units; nearer contributions do not count, and distortion maps depth between them.
        backend: "auto", "cpu" or "reference" (dense float64, small scenes only).
    Raises:
        ValueError: an unknown plane or backend, a wrong shape, a label out of range, or a value that is not finite, named
            with its first bad row.
    """
    if backend not in BACKENDS:
        raise ValueError(f"unknown backend {backend!r}; there are {', '.join(BACKENDS)}")
    count = _check(surfels, label_count, outputs, near, far)
    wanted = set(outputs)
    if backend == "reference":
        planes = render_reference(surfels, camera, count, near=near, far=far)
        return Rendered(**{n: planes[n] if n in wanted else None for n in PLANES}, visible=planes["visible"])
    geometry, labels = bool(wanted & _GEOMETRY), bool(wanted & _LABELS)
    if surfels.sh.shape[1] > 1:
        centre = torch.from_numpy(camera.centre.astype(np.float32))
        rgb = evaluate(surfels.sh, F.normalize(surfels.means - centre, dim=1))
    else:
        rgb = evaluate(surfels.sh, surfels.means)
    stacked, screen = rasterize(
        surfels.means, surfels.quats, surfels.log_scales.exp(), torch.sigmoid(surfels.opacity_logits), rgb,
        surfels.labels, camera, label_count=count if labels else 1, geometry=geometry, with_labels=labels,
        near=near, far=far,
    )  # fmt: skip
    full = {
        "rgb": lambda: stacked[0:3].permute(1, 2, 0),
        "alpha": lambda: stacked[3],
        "depth": lambda: stacked[4],
        "median_depth": lambda: stacked[5],
        "normal": lambda: stacked[6:9].permute(1, 2, 0),
        "distortion": lambda: stacked[9],
        "label_distortion": lambda: stacked[10],
        "semantics": lambda: stacked[11 : 11 + count].permute(1, 2, 0),
    }
    return Rendered(
        **{name: full[name]() if name in wanted else None for name in PLANES},
        visible=screen.visible,
        _screen_gradients=lambda: screen.gradients,
    )
