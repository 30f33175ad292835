"""render(): the one public function of the rasterizer."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from unveil_core.base.parallel import in_parallel
from unveil_core.geometry.camera import Camera
from unveil_core.raster.autograd import can_render_on, rasterize
from unveil_core.raster.checks import CHUNK, WORTH, count_not_finite, label_ends
from unveil_core.raster.reference import render_reference
from unveil_core.raster.spec import MAX_LABELS, PLANES, Limits
from unveil_core.surfels.surfels import Surfels

__all__ = ["BACKENDS", "PLANES", "Rendered", "render"]

SPECIFIED = Limits()
BACKENDS = ("auto", "cpu", "triton", "reference")
PARAMETERS = ("means", "quats", "log_scales", "opacity_logits", "sh")


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
        visible: (N,) bool, surfels whose bounds touch the image (the reference: that contribute to a pixel).
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
        """(N, 2) gradient of the loss by the projected means in pixels, each surfel's shape and depth held; zero for
        surfels off the image.

        Raises:
            RuntimeError: backward has not run, or the backend is the reference.
        """
        gradients = self._screen_gradients()
        if gradients is None:
            raise RuntimeError("screen_gradients() needs a backward pass of the cpu or triton backend first")
        return gradients


def _check_camera(camera: Camera) -> None:
    if camera.width < 1 or camera.height < 1:
        raise ValueError(f"camera of {camera.width} x {camera.height} pixels; at least one is needed")
    if np.shape(camera.world_to_camera) != (4, 4):
        raise ValueError(f"world_to_camera has shape {np.shape(camera.world_to_camera)}, (4, 4) is needed")
    if not np.isfinite(camera.world_to_camera).all():
        row = int(np.argmin(np.isfinite(camera.world_to_camera).all(axis=1)))
        raise ValueError(f"world_to_camera is not finite in row {row}")
    for name in ("fx", "fy", "cx", "cy"):
        value = getattr(camera, name)
        if not np.isfinite(value) or (name[0] == "f" and value <= 0):
            raise ValueError(f"camera {name} is {value}")


def _check_finite(name: str, values: Tensor) -> None:
    if values.dtype == torch.float32 and values.device.type == "cpu":
        # One vectorized pass; rows are only looked for when something is wrong.
        bits = values.detach().contiguous().numpy().reshape(-1).view(np.uint32)
        bad = np.zeros(-(-len(bits) // CHUNK), np.uint32)
        in_parallel(count_not_finite, len(bits), WORTH * CHUNK, bits, bad)
        if not bad.any():
            return
    good = torch.isfinite(values.detach()).reshape(len(values), -1).all(dim=1)
    if not bool(good.all()):
        raise ValueError(f"{name} is not finite in row {int((~good).nonzero()[0])}")


def _check_surfels(surfels: Surfels, backend: str) -> None:
    """Shapes, kinds and devices: nothing that a GPU must be waited for."""
    n = len(surfels)
    shapes = {"means": (n, 3), "quats": (n, 4), "opacity_logits": (n,), "labels": (n,)}
    for name, shape in shapes.items():
        tensor = getattr(surfels, name)
        if tuple(tensor.shape) != shape:
            raise ValueError(f"{name} has shape {tuple(tensor.shape)}, {shape} is needed")
    if tuple(surfels.log_scales.shape) not in ((n, 2), (n, 3)):
        raise ValueError(f"log_scales has shape {tuple(surfels.log_scales.shape)}, ({n}, 2 or 3) is needed")
    if (
        surfels.sh.dim() != 3
        or len(surfels.sh) != n
        or surfels.sh.shape[2] != 3
        or surfels.sh.shape[1] not in (1, 4, 9, 16)
    ):
        raise ValueError(f"sh has shape {tuple(surfels.sh.shape)}, ({n}, 1 or 4 or 9 or 16, 3) is needed")
    if surfels.labels.dtype != torch.int64:
        raise ValueError(f"labels are {surfels.labels.dtype}, torch.int64 is needed")
    for name in PARAMETERS:
        values = getattr(surfels, name)
        if backend == "cpu" and (values.dtype != torch.float32 or values.device.type != "cpu"):
            raise ValueError(f"{name} is {values.dtype} on {values.device}; the cpu backend needs torch.float32 on cpu")
        if backend == "triton" and (values.dtype != torch.float32 or not can_render_on(values.device)):
            raise ValueError(
                f"{name} is {values.dtype} on {values.device}; the triton backend needs torch.float32 on cuda"
            )
        if values.device != surfels.labels.device:
            raise ValueError(
                f"{name} is on {values.device}, labels are on {surfels.labels.device}; one device is needed"
            )


def _check_values(surfels: Surfels) -> tuple[int, int]:
    """That all parameters are finite; returns the lowest and highest label. A GPU is waited for once."""
    if len(surfels) == 0:
        return 0, 0
    tensors = {name: getattr(surfels, name).detach() for name in PARAMETERS}
    if surfels.means.device.type == "cpu":
        for name, values in tensors.items():
            _check_finite(name, values)
        return _label_range(surfels.labels)
    finite = torch.stack([torch.isfinite(values).all() for values in tensors.values()])
    facts = torch.cat([finite.long(), torch.stack(surfels.labels.aminmax())]).tolist()
    for (name, values), good in zip(tensors.items(), facts, strict=False):
        if not good:
            _check_finite(name, values)
    return facts[-2], facts[-1]


def _label_range(labels: Tensor) -> tuple[int, int]:
    array = labels.contiguous().numpy()
    ends = np.empty((-(-len(array) // CHUNK), 2), np.int64)
    in_parallel(label_ends, len(array), WORTH * CHUNK, array, ends)
    return int(ends[:, 0].min()), int(ends[:, 1].max())


def _label_count(low: int, high: int, label_count: int | None) -> int:
    count = high + 1 if label_count is None else label_count
    if not 1 <= count <= MAX_LABELS:
        raise ValueError(f"label_count {count}; 1 to {MAX_LABELS} labels are possible")
    if low < 0 or high >= count:
        raise ValueError(f"labels reach from {low} to {high}; 0 to {count - 1} are possible with label_count {count}")
    return count


def _coefficients(surfels: Surfels, sh_degree: int | None) -> int:
    if sh_degree is None:
        return int(surfels.sh.shape[1])
    if not 0 <= sh_degree <= surfels.sh_degree:
        raise ValueError(f"sh_degree {sh_degree}; 0 to {surfels.sh_degree} are in these surfels")
    return (sh_degree + 1) ** 2


def render(
    surfels: Surfels,
    camera: Camera,
    outputs: Collection[str] = ("rgb", "alpha"),
    *,
    label_count: int | None = None,
    near: float = 0.2,
    far: float = 100.0,
    backend: str = "auto",
    sh_degree: int | None = None,
    limits: Limits = SPECIFIED,
    check: bool = True,
) -> Rendered:
    """Render surfels, differentiable in means, quats, log_scales, opacity_logits and sh.

    Args:
        surfels: N surfels, float32: discs, or ellipsoids where there are three scales. camera: the view.
        outputs: names of planes, see :class:`Rendered`. The cheapest group of kernels that makes them all is run:
            colour (rgb, alpha), colour with semantics, colour with geometry, or all.
        label_count: K for the label planes; the highest label plus one by default.
        near, far: metres; nearer contributions do not count, and distortion maps depth between them.
        backend: "cpu", "triton" (NVIDIA GPUs), "reference" (dense float64, small scenes only), or "auto": where the
            surfels are.
        limits: of the cpu backend, for measuring what precision costs.
        sh_degree: use spherical harmonics up to this degree only; all that there are by default.
        check: look for values that are not finite and labels out of range. On a GPU the host waits for the answer. A loop
            that has rendered these surfels once, and changes them by finite steps, may leave it out; such values then
            give a wrong image, and such labels read and write beside their arrays.
    Raises:
        ValueError: an unknown plane or backend, a wrong shape, a label out of range, or a value that is not finite,
            named with its first bad row.
    """
    names = (outputs,) if isinstance(outputs, str) else tuple(dict.fromkeys(outputs))
    for name in names:
        if name not in PLANES:
            raise ValueError(f"not a plane: {name!r}; use {', '.join(PLANES)}")
    if backend not in BACKENDS:
        raise ValueError(f"not a backend: {backend!r}; use {', '.join(BACKENDS)}")
    if not 0 < near < far < np.inf:
        raise ValueError(f"near {near} and far {far}; 0 < near < far is needed")
    _check_camera(camera)
    if backend == "auto":
        backend = "triton" if surfels.means.is_cuda else "cpu"
    if backend == "triton" and importlib.util.find_spec("triton") is None:
        raise ValueError("the triton backend needs the package triton: pip install triton")
    if backend != "cpu" and limits != SPECIFIED:
        raise ValueError(f"limits other than the specified ones are known to the cpu backend only, not to {backend}")
    _check_surfels(surfels, backend)
    ends = _check_values(surfels) if check or label_count is None else (0, 0)
    count, coefficients = _label_count(*ends, label_count), _coefficients(surfels, sh_degree)
    if backend == "reference":
        planes = render_reference(surfels, camera, count, near=near, far=far, coefficients=coefficients, outputs=names)
        planes, visible, screen = {name: planes[name] for name in names}, planes["visible"], None
    else:
        planes, screen = rasterize(
            surfels,
            camera,
            names,
            label_count=count,
            coefficients=coefficients,
            near=near,
            far=far,
            backend=backend,
            limits=limits,
        )
        visible = screen.visible
    return Rendered(
        rgb=planes.get("rgb"),
        alpha=planes.get("alpha"),
        semantics=planes.get("semantics"),
        depth=planes.get("depth"),
        median_depth=planes.get("median_depth"),
        normal=planes.get("normal"),
        distortion=planes.get("distortion"),
        label_distortion=planes.get("label_distortion"),
        visible=visible,
        _screen_gradients=lambda: screen.gradients if screen else None,
    )
