"""The dense reference: every surfel against every pixel, in float64 torch, gradients by autograd. For tests only.

The intersection is the textbook cross product of two homogeneous planes (2DGS, equations 8 to 10), not the re-centred
form of the fast backends, and an ellipsoid's distance is taken without a factor of its covariance, so that the two can
check each other. Memory is pixels x surfels: keep scenes small.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

import torch
import torch.nn.functional as F
from torch import Tensor

from unveil_core.geometry.camera import Camera
from unveil_core.raster.passes import field_of_view
from unveil_core.raster.spec import (
    ALPHA_MAX,
    ALPHA_MIN,
    DEPTH_MAX,
    DILATION,
    EDGE_ON,
    LOG_SCALE_MAX,
    LOW_PASS,
    OFFSET_MAX,
    PLANES,
    SCALE_MIN_PX,
    TRANSMITTANCE_MIN,
)
from unveil_core.raster.spherical_harmonics import evaluate
from unveil_core.surfels.surfels import Surfels

__all__ = ["render_reference", "render_reference_in_tiles"]


def _rotation(quats: Tensor) -> Tensor:
    norm = quats.norm(dim=1, keepdim=True)
    # A zero quaternion means no rotation, and has no gradient.
    identity = quats.new_tensor([1.0, 0.0, 0.0, 0.0]).expand_as(quats)
    unit = torch.where(norm > 1e-12, quats / norm.clamp_min(1e-12), identity)
    w, x, y, z = unit.unbind(-1)
    rows = [
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    ]
    return torch.stack(rows, dim=-1).reshape(-1, 3, 3)


def _disc_distance(plane: Tensor, edge_on: Tensor, px: Tensor, py: Tensor) -> tuple[Tensor, Tensor]:
    """(P, N) u^2 + v^2, infinite without an intersection, and its depth.

    Args:
        plane: (N, 3, 3) columns h_u, h_v and p after the intrinsics. edge_on: (N,) bool. px, py: (P, 1).
    """
    cross = torch.linalg.cross(
        px[..., None] * plane[None, :, 2] - plane[None, :, 0], py[..., None] * plane[None, :, 2] - plane[None, :, 1]
    )
    parallel = cross[..., 2].abs() < 1e-300
    w = torch.where(parallel, torch.ones_like(cross[..., 2]), cross[..., 2])
    u, v = cross[..., 0] / w, cross[..., 1] / w
    exact = torch.where(parallel | edge_on, torch.inf, u * u + v * v)
    return exact, u * plane[:, 2, 0] + v * plane[:, 2, 1] + plane[:, 2, 2]


def _footprint_distance(local: Tensor, axes: Tensor, camera: Camera, whole: Camera, dx: Tensor, dy: Tensor) -> Tensor:
    """(P, N) d^T C^-1 d of ellipsoids.

    By columns w_k of W, C^-1 is the sum of squared cross products of d with them, and of them with one another
    (Cauchy and Binet), so that no digit cancels.

    Args:
        local: (N, 3) centres. axes: (N, 3, 3) columns of the rotation times the scales; in the camera's frame.
        dx, dy: (P, N) pixel centres less projected means.
    """
    slope = local[:, :2] / local[:, 2:]
    x_low, x_high, y_low, y_high = field_of_view(whole)
    x, y = slope[:, :1].clamp(x_low, x_high), slope[:, 1:].clamp(y_low, y_high)
    p = camera.fx / local[:, 2:] * (axes[:, 0] - x * axes[:, 2])
    q = camera.fy / local[:, 2:] * (axes[:, 1] - y * axes[:, 2])
    minors = torch.linalg.cross(p, q).square().sum(1)
    det = minors + DILATION * (p * p + q * q).sum(1) + DILATION**2
    across = sum((p[:, k] * dy - q[:, k] * dx).square() for k in range(3))
    return (across + DILATION * (dx * dx + dy * dy)) / det


def _pair_distortion(weight: Tensor, mapped: Tensor) -> Tensor:
    """(P,) sum over pairs in front of one another of w_i w_j (m_i - m_j)^2, for (P, N) weights."""
    before = [torch.cumsum(v, dim=1) - v for v in (weight, weight * mapped, weight * mapped * mapped)]
    return (weight * (mapped * mapped * before[0] + before[2] - 2 * mapped * before[1])).sum(dim=1)


def render_reference(
    surfels: Surfels,
    camera: Camera,
    label_count: int,
    *,
    near: float,
    far: float,
    coefficients: int | None = None,
    dtype: torch.dtype = torch.float64,
    whole: Camera | None = None,
    outputs: Collection[str] = PLANES,
) -> dict[str, Tensor]:
    """All planes, or some.

    Args:
        surfels: N surfels of any float type; gradients flow back to them.
        label_count: K.
        outputs: names of planes; the others cost nothing.
        coefficients: how many of the spherical-harmonic coefficients are used; all by default.
        whole: the camera that this one is a part of, itself by default.
        dtype: float32 makes plain vectorized torch of it, as a thing to compare speeds with.
    Returns:
        plane name to (H, W) or (H, W, C); "visible" (N,) bool; "undecided" (H, W) bool, pixels where a
        decision (contribution counted, light used up, which of the two filters) hangs on less than a ten-thousandth,
        so that float32 may rightly decide otherwise.
    """
    width, height = camera.width, camera.height
    pose = torch.from_numpy(camera.world_to_camera).to(dtype)
    means, log_scales = surfels.means.to(dtype), surfels.log_scales.to(dtype)
    opacity = torch.sigmoid(surfels.opacity_logits.to(dtype))
    centre = torch.from_numpy(camera.centre).to(dtype)
    rgb = evaluate(surfels.sh[:, :coefficients].to(dtype), F.normalize(means - centre, dim=1))
    local = means @ pose[:3, :3].T + pose[:3, 3]
    axes = pose[:3, :3] @ _rotation(surfels.quats.to(dtype))
    focal = max(camera.fx, camera.fy)
    # Both limits cut the gradient: the upper one by the clamp, the lower one because it is taken as a constant.
    scale = torch.maximum(
        log_scales.clamp_max(LOG_SCALE_MAX).exp(), SCALE_MIN_PX / focal * local[:, 2:].detach().clamp_min(0.0)
    )
    normal = axes[torch.arange(len(axes)), :, surfels.normal_axes()]
    facing = (normal * local).sum(1, keepdim=True)
    edge_on = facing[:, 0].abs() < EDGE_ON * local.norm(dim=1)
    normal = normal * torch.where((facing > 0) & ~edge_on[:, None], -1.0, 1.0)
    intrinsics = torch.tensor([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]], dtype=dtype)
    axes = axes[..., : scale.shape[1]] * scale[:, None]
    plane = intrinsics @ torch.cat([axes[..., :2], local[..., None]], dim=-1)

    placed = (local[:, 2] > near) & (local[:, 2] < DEPTH_MAX)
    offset = local.detach()[:, :2] / torch.where(placed, local[:, 2], torch.ones_like(local[:, 2])).detach()[:, None]
    placed &= ((offset * offset.new_tensor([camera.fx, camera.fy])).abs() < OFFSET_MAX).all(dim=1)
    order = torch.argsort(local[:, 2].detach().float(), stable=True)
    order = order[placed[order]]
    z, plane, opacity, label = local[order, 2], plane[order], opacity[order], surfels.labels[order]
    projected = plane[:, :2, 2] / plane[:, 2:, 2]
    ys, xs = torch.meshgrid(
        torch.arange(height, dtype=dtype) + 0.5, torch.arange(width, dtype=dtype) + 0.5, indexing="ij"
    )
    px, py = xs.reshape(-1, 1), ys.reshape(-1, 1)
    dx, dy = px - projected[:, 0], py - projected[:, 1]
    if surfels.ellipsoids:
        exact = _footprint_distance(local[order], axes[order], camera, whole or camera, dx, dy)
        met, screen = z.expand_as(exact), torch.full_like(exact, torch.inf)
    else:
        exact, met = _disc_distance(plane, edge_on[order], px, py)
        screen = LOW_PASS * (dx * dx + dy * dy)
    is_exact = exact <= screen
    depth = torch.where(is_exact, met, z.expand_as(exact))
    in_front = depth >= near
    depth = torch.where(in_front, depth, torch.ones_like(depth))
    raw = opacity * torch.exp(-0.5 * torch.where(is_exact, exact, screen))
    alpha = raw.clamp_max(ALPHA_MAX)
    alpha = torch.where((alpha >= ALPHA_MIN) & in_front, alpha, torch.zeros_like(alpha))
    through = torch.cumprod(1 - alpha, dim=1)
    counted = alpha > 0
    undecided = ((raw / ALPHA_MIN - 1).abs() < 1e-4) | ((raw / ALPHA_MAX - 1).abs() < 1e-4)
    undecided |= counted & ((exact - screen).abs() < 1e-4 * screen)
    undecided |= counted & (((through / TRANSMITTANCE_MIN - 1).abs() < 1e-3) | ((2 * through - 1).abs() < 1e-4))
    finished = torch.cummax((through < TRANSMITTANCE_MIN).to(torch.int8), dim=1).values > 0 if len(z) else through > 2
    alpha = torch.where(finished, torch.zeros_like(alpha), alpha)

    def before(a: Tensor) -> Tensor:
        product = torch.cumprod(1 - a, dim=1)
        return torch.cat([torch.ones_like(product[:, :1]), product[:, :-1]], dim=1) if a.shape[1] else product

    light = before(alpha)
    weight = alpha * light
    mapped = far / (far - near) - far * near / (far - near) / depth
    one_hot = F.one_hot(label, label_count).to(dtype)
    index = torch.where((light > 0.5) & (alpha > 0), torch.arange(len(z)), -1)
    last = index.max(dim=1).values if len(z) else torch.full((height * width,), -1)
    median = depth.gather(1, last.clamp_min(0)[:, None])[:, 0] if len(z) else torch.zeros(height * width, dtype=dtype)

    def per_label() -> Tensor:
        total = torch.zeros(height * width, dtype=dtype)
        for k in range(label_count):
            own = alpha * one_hot[:, k]
            total = total + _pair_distortion(own * before(own), mapped)
        return total

    visible = torch.zeros(len(surfels), dtype=torch.bool)
    visible[order] = (alpha > 0).any(dim=0)
    planes: dict[str, Callable[[], Tensor]] = {
        "rgb": lambda: weight @ rgb[order],
        "alpha": lambda: weight.sum(dim=1),
        "semantics": lambda: weight @ one_hot,
        "depth": lambda: (weight * depth).sum(dim=1),
        "median_depth": lambda: torch.where(last >= 0, median, torch.zeros_like(median)),
        "normal": lambda: weight @ normal[order],
        "distortion": lambda: _pair_distortion(weight, mapped),
        "label_distortion": per_label,
    }
    made = {name: planes[name]() for name in outputs}
    shaped = {name: plane.reshape(height, width, *plane.shape[1:]) for name, plane in made.items()}
    return {**shaped, "visible": visible, "undecided": undecided.any(dim=1).reshape(height, width)}


def _reach(surfels: Surfels, camera: Camera, near: float) -> Tensor:
    """(N, 4) pixel bounds (x0, x1, y0, y1) that hold all of a surfel before the camera, by the sphere around it; float64."""
    pose = torch.from_numpy(camera.world_to_camera)
    local = surfels.means.detach().double() @ pose[:3, :3].T + pose[:3, 3]
    # Three and a third standard deviations: beyond, even opacity 1 is under 1/255.
    radius = 3.4 * surfels.log_scales.detach().double().clamp_max(LOG_SCALE_MAX).exp().amax(dim=1)
    if surfels.ellipsoids:
        # The footprint is as wide on either side, and no wider than the sphere's at the edge of the field of view.
        bound = torch.tensor(field_of_view(camera)).abs().max()
        z = local[:, 2].clamp_min(near)
        wide = max(camera.fx, camera.fy) * radius / z * (1.0 + bound * bound).sqrt() + 3.0
        middle = [camera.fx * local[:, 0] / z + camera.cx, camera.fy * local[:, 1] / z + camera.cy]
        return torch.stack([m + s * wide for m in middle for s in (-1.0, 1.0)], 1)
    front, back = (local[:, 2] - radius).clamp_min(1e-9), local[:, 2] + radius
    bounds = []
    for axis, focal, centre in ((0, camera.fx, camera.cx), (1, camera.fy, camera.cy)):
        low, high = local[:, axis] - radius, local[:, axis] + radius
        bounds += [
            centre + focal * torch.minimum(low / front, low / back) - 3.0,
            centre + focal * torch.maximum(high / front, high / back) + 3.0,
        ]
    all_over = local[:, 2] - radius <= near
    return torch.stack(
        [torch.where(all_over, b.new_tensor(s * torch.inf), b) for b, s in zip(bounds, (-1, 1) * 2, strict=True)], 1
    )


def _like(mask: Tensor, plane: Tensor) -> Tensor:
    return mask if plane.dim() == 2 else mask[..., None]


def render_reference_in_tiles(
    surfels: Surfels,
    camera: Camera,
    label_count: int,
    *,
    near: float,
    far: float,
    gradients: Mapping[str, Tensor] | None = None,
    tiles: Collection[int] | None = None,
    side: int = 16,
    dtype: torch.dtype = torch.float64,
    together: bool = False,
) -> tuple[dict[str, Tensor], dict[str, dict[str, Tensor]]]:
    """The reference for large scenes: dense within each tile, over the surfels that may reach it.

    A tile is a camera of its own, with the principal point moved; which surfels may reach it is decided by a sphere
    around each, so nothing is shared with the bounds of the fast backends.

    Args:
        gradients: by plane, a gradient of the loss in the plane's shape; undecided pixels get none.
        tiles: numbers of the tiles to render, row by row; all by default. side: pixels along a tile.
        together: one loss of all planes, and one gradient of it under the name "all".
    Returns:
        planes in full size (zero in other tiles), with "undecided"; and by each plane of ``gradients``, the gradients of
        means, quats, log_scales, opacity_logits and sh, (N, ...), of that plane's loss alone.
    """
    names = ("means", "quats", "log_scales", "opacity_logits", "sh")
    width, height = camera.width, camera.height
    across = -(-width // side)
    bounds = _reach(surfels, camera, near)
    planes: dict[str, Tensor] = {}
    sums = {
        p: {n: torch.zeros_like(getattr(surfels, n), dtype=dtype) for n in names}
        for p in (("all",) if together else gradients or {})
    }
    for tile in range(across * -(-height // side)) if tiles is None else tiles:
        x, y = tile % across * side, tile // across * side
        w, h = min(side, width - x), min(side, height - y)
        crop = replace(camera, width=w, height=h, cx=camera.cx - x, cy=camera.cy - y)
        touching = (bounds[:, 0] < x + w) & (bounds[:, 1] > x) & (bounds[:, 2] < y + h) & (bounds[:, 3] > y)
        index = touching.nonzero()[:, 0]
        leaves = {n: getattr(surfels, n).detach()[index].to(dtype).requires_grad_(bool(gradients)) for n in names}
        made = render_reference(
            Surfels(**leaves, labels=surfels.labels[index]),
            crop,
            label_count,
            near=near,
            far=far,
            dtype=dtype,
            whole=camera,
        )
        made.pop("visible")
        decided = ~made["undecided"]
        for name, plane in made.items():
            whole = planes.setdefault(name, torch.zeros(height, width, *plane.shape[2:], dtype=plane.dtype))
            whole[y : y + h, x : x + w] = plane.detach()
        losses = {}
        for name, gradient in (gradients or {}).items():
            weight = gradient[y : y + h, x : x + w].to(dtype)
            losses[name] = (made[name] * torch.where(_like(decided, weight), weight, torch.zeros_like(weight))).sum()
        if together:
            losses = {"all": torch.stack(list(losses.values())).sum()}
        for name, loss in losses.items():
            found = torch.autograd.grad(loss, list(leaves.values()), retain_graph=not together, allow_unused=True)
            for parameter, value in zip(names, found, strict=True):
                if value is not None:
                    sums[name][parameter][index] += value
    return planes, sums
