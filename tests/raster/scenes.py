"""Random scenes and cameras for the rasterizer's tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from unveil_core.geometry.camera import Camera
from unveil_core.surfels.surfels import Surfels

DEVICE = "cuda" if torch.cuda.is_available() else "cpu"
"""Where the Triton kernels run: on the GPU, or in Triton's interpreter."""
GRADIENTS = ("means", "quats", "log_scales", "opacity_logits", "sh")


def camera(width: int = 48, height: int = 32, focal: float = 40.0) -> Camera:
    """A camera that looks along its own z, a little turned."""
    yaw, pitch = 0.05, -0.03
    turn = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    tilt = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    pose = np.eye(4)
    pose[:3, :3] = tilt @ turn
    pose[:3, 3] = (0.05, -0.02, 0.1)
    return Camera(width, height, focal, focal * 1.05, width / 2 + 0.3, height / 2 - 0.4, pose)


def random_surfels(
    count: int, seed: int, *, labels: int = 5, degree: int = 1, spread: float = 0.85, grazing: bool = False
) -> Surfels:
    """Surfels before the camera at 2.5 to 10 m, of mixed sizes, opacities and directions.

    Unless ``grazing``, none is seen under less than about six degrees: float32 loses digits there in proportion.
    """
    g = torch.Generator().manual_seed(seed)
    depth = 2.5 + 7.5 * torch.rand(count, generator=g)
    side = spread * (torch.rand(count, 2, generator=g) * 2 - 1) * torch.tensor([0.75, 0.55])
    means = torch.cat([side * depth[:, None], depth[:, None]], dim=1)
    quats = torch.randn(count, 4, generator=g)
    if not grazing:
        view = torch.from_numpy(camera().centre).float() - means
        view = view / view.norm(dim=1, keepdim=True)
        for _ in range(20):
            w, x, y, z = (quats / quats.norm(dim=1, keepdim=True)).unbind(1)
            normal = torch.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], dim=1)
            edge_on = (normal * view).sum(dim=1).abs() < 0.1
            quats = torch.where(edge_on[:, None], torch.randn(count, 4, generator=g), quats)
    return Surfels(
        means=means,
        quats=quats,
        log_scales=torch.log(0.2 * torch.exp(0.5 * torch.randn(count, 2, generator=g))),
        opacity_logits=1.5 * torch.randn(count, generator=g),
        sh=0.4 * torch.randn(count, (degree + 1) ** 2, 3, generator=g),
        labels=torch.randint(0, labels, (count,), generator=g),
    )


def random_ellipsoids(
    count: int, seed: int, *, degree: int = 1, spread: float = 0.85, grazing: bool = False
) -> Surfels:
    """The same with a third scale, as often the smallest as any other."""
    surfels = random_surfels(count, seed, degree=degree, spread=spread, grazing=grazing)
    g = torch.Generator().manual_seed(seed + 1000)
    third = torch.log(0.2 * torch.exp(0.5 * torch.randn(count, 1, generator=g)))
    return replace(surfels, log_scales=torch.cat([surfels.log_scales, third], dim=1))


def for_backend(surfels: Surfels, backend: str) -> Surfels:
    """The surfels where the backend takes them."""
    device = DEVICE if backend == "triton" else "cpu"
    return Surfels(**{name: getattr(surfels, name).to(device) for name in (*GRADIENTS, "labels")})


def with_gradients(surfels: Surfels) -> Surfels:
    """The same values as float leaves that collect gradients."""
    leaves = {name: getattr(surfels, name).clone().requires_grad_(True) for name in GRADIENTS}
    return Surfels(**leaves, labels=surfels.labels)
