"""What our rasterizer is compared with: a C++ yardstick, plain vectorized torch, and gsplat: its torch reference, its kernels."""

from __future__ import annotations

import importlib
import importlib.util
import subprocess
import sys
import tempfile
import types
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from unveil_core.base.errors import UnveilError
from unveil_core.base.surroundings.programs import program
from unveil_core.geometry.camera import Camera
from unveil_core.raster import records as rec
from unveil_core.raster.reference import render_reference_in_tiles
from unveil_core.raster.spec import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN
from unveil_core.raster.spherical_harmonics import SH0
from unveil_core.surfels.surfels import Surfels

__all__ = ["GsplatKernels", "GsplatReference", "Yardstick", "gsplat_is_there", "plain_torch"]

FLAGS = (
    "-O3",
    "-march=native",
    "-mprefer-vector-width=512",
    "-ffast-math",
    "-fopenmp",
    "-shared",
    "-fPIC",
    "-std=c++17",
)


class Yardstick:
    """A C++ rasterizer of the same planes, compiled on the spot.

    The folder holds ``raster.cpp``, ``cppback.py`` (a ctypes wrapper with ``Lib``, ``make_cam`` and ``NPL`` planes) and
    ``common.py`` (``street_scene``).

    Raises:
        UnveilError: the folder lacks one of these, or the compiler fails.
    """

    def __init__(self, folder: Path) -> None:
        for name in ("raster.cpp", "cppback.py", "common.py"):
            if not (folder / name).is_file():
                raise UnveilError(f"no {name} there", path=folder, mend="name the folder of the C++ yardstick")
        self._built = tempfile.TemporaryDirectory()
        library = Path(self._built.name) / "libraster.so"
        compiler = program("g++")
        if compiler is None:
            raise UnveilError("Not found: g++", path=folder, mend="install a C++ compiler")
        done = subprocess.run(
            [compiler, *FLAGS, str(folder / "raster.cpp"), "-o", str(library)], capture_output=True, text=True
        )
        if done.returncode:
            raise UnveilError(f"g++ says: {done.stderr.strip().splitlines()[0]}", path=folder, mend="see the compiler")
        sys.path.insert(0, str(folder.resolve()))
        try:
            self._module = importlib.import_module("cppback")
        finally:
            sys.path.pop(0)
        # A library built with fast math turns subnormal numbers off for the whole process; numpy remarks on it.
        warnings.filterwarnings("ignore", message="The value of the smallest subnormal")
        self._lib = self._module.Lib(str(library))

    def surfels(self, count: int, *, degree: int = 0) -> Surfels:
        """The yardstick's own scene."""
        scene = self._module.street_scene(count, 0)
        sh = torch.zeros(count, (degree + 1) ** 2, 3)
        sh[:, 0] = (scene["rgb"] - 0.5) / SH0
        return Surfels(
            scene["means"],
            scene["quats"],
            scene["scales"].log(),
            torch.logit(scene["opac"].clamp(1e-4, 0.9999)),
            sh,
            scene["labels"].long(),
        )

    def prepare(self, surfels: Surfels, camera: Camera) -> tuple[dict[str, Tensor], Any]:
        """The scene in the yardstick's form: activated parameters, plain colours."""
        scene = {
            "means": surfels.means,
            "quats": surfels.quats,
            "scales": surfels.log_scales.exp(),
            "opac": torch.sigmoid(surfels.opacity_logits),
            "rgb": (0.5 + SH0 * surfels.sh[:, 0]).clamp_min(0.0),
            "labels": surfels.labels.to(torch.int32),
        }
        intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
        pose = np.asarray(camera.world_to_camera, np.float32)
        contiguous = {name: t.contiguous() for name, t in scene.items()}
        return contiguous, self._module.make_cam(pose, intrinsics, camera.width, camera.height)

    def run(self, scene: dict[str, Tensor], camera: Any, gradient: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        """Forward and backward of all planes: (planes, H, W) and gradients of the activated parameters."""
        planes, state = self._lib.fwd(scene, camera, 16, 4)
        return planes, self._lib.bwd(scene, camera, state, gradient)

    def gradient_of(self, by_plane: Mapping[str, Tensor]) -> Tensor:
        """Gradients of named planes in the yardstick's one array."""
        order = ("rgb", "semantics", "alpha", "depth", "median_depth", "normal", "distortion", "label_distortion")
        parts = [g.permute(2, 0, 1) if g.dim() == 3 else g[None] for g in (by_plane[name] for name in order)]
        return torch.cat(parts).contiguous()


def plain_torch(surfels: Surfels, camera: Camera, gradients: Mapping[str, Tensor], label_count: int) -> None:
    """Forward and backward by vectorized torch and its autograd, in float32, tile by tile."""
    render_reference_in_tiles(
        surfels, camera, label_count, near=0.2, far=100.0, gradients=gradients, dtype=torch.float32, together=True
    )


def gsplat_is_there() -> bool:
    """Whether the package is installed."""
    return importlib.util.find_spec("gsplat") is not None


def _render_weight_from_alpha(alphas: Tensor, ray_indices: Tensor, n_rays: int) -> tuple[Tensor, Tensor]:
    """What gsplat calls of nerfacc, whose own is for CUDA: weights along rays that are stored one after another."""
    through = torch.log1p(-alphas)
    summed = torch.cumsum(through, 0)
    first = torch.ones_like(ray_indices, dtype=torch.bool)
    first[1:] = ray_indices[1:] != ray_indices[:-1]
    start = (summed - through)[first][torch.cumsum(first, 0) - 1]
    light = torch.exp(summed - through - start)
    return alphas * light, light


def _accumulate_along_rays(weights: Tensor, values: Tensor | None, ray_indices: Tensor, n_rays: int) -> Tensor:
    source = weights[:, None] if values is None else weights[:, None] * values
    return torch.zeros(n_rays, source.shape[1], dtype=source.dtype).index_add(0, ray_indices, source)


@contextmanager
def _nerfacc() -> Iterator[None]:
    shim = types.ModuleType("nerfacc")
    shim.render_weight_from_alpha = _render_weight_from_alpha  # type: ignore[attr-defined]
    shim.accumulate_along_rays = _accumulate_along_rays  # type: ignore[attr-defined]
    before = sys.modules.get("nerfacc")
    sys.modules["nerfacc"] = shim
    try:
        yield
    finally:
        if before is None:
            del sys.modules["nerfacc"]
        else:
            sys.modules["nerfacc"] = before


class GsplatReference:
    """gsplat's torch reference for 2DGS: colour, alpha and normals.

    Which surfel meets which pixel it would find on a GPU; the pairs are given to it, and the time for them is not
    counted.
    """

    def __init__(self, surfels: Surfels, camera: Camera) -> None:
        self._torch_impl = importlib.import_module("gsplat.cuda._torch_impl_2dgs")
        self.surfels, self.camera = surfels, camera
        self.pixels, self.owners = _contributing_pairs(surfels, camera)

    def run(self, gradient: Tensor) -> Tensor:
        """Forward and backward; ``gradient`` (H, W, 3) by the colours. Returns the colours."""
        s, c = self.surfels, self.camera
        means, quats, log_scales, logits, rgb = (
            t.detach().clone().requires_grad_(True)
            for t in (s.means, s.quats, s.log_scales, s.opacity_logits, (0.5 + SH0 * s.sh[:, 0]).clamp_min(0.0))
        )
        scales = torch.cat([log_scales.exp(), torch.ones(len(s), 1)], 1)
        view = torch.from_numpy(c.world_to_camera).float()[None]
        intrinsics = torch.tensor([[[c.fx, 0, c.cx], [0, c.fy, c.cy], [0, 0, 1.0]]])
        unit = torch.nn.functional.normalize(quats, dim=1)
        _, means2d, _, transforms, normals = self._torch_impl._fully_fused_projection_2dgs(
            means, unit, scales, view, intrinsics, c.width, c.height
        )
        with _nerfacc():
            colours, _, _ = self._torch_impl.accumulate_2dgs(
                means2d,
                transforms,
                torch.sigmoid(logits)[None],
                rgb[None],
                normals,
                self.owners,
                self.pixels,
                torch.zeros_like(self.pixels),
                c.width,
                c.height,
            )
        (colours[0] * gradient).sum().backward()
        made: Tensor = colours[0].detach()
        return made


class GsplatKernels:
    """gsplat's 2DGS kernels on a GPU: colour, alpha, normal, median depth and distortion, which are less than our planes: no
    labels. gsplat is the user's to install (``pip install gsplat``).

    Args:
        surfels: N discs on the GPU, of degree 0; camera: the view.
    """

    def __init__(self, surfels: Surfels, camera: Camera) -> None:
        self._rasterize = importlib.import_module("gsplat").rasterization_2dgs
        device = surfels.means.device
        scales = torch.cat([surfels.log_scales.exp(), torch.ones_like(surfels.log_scales[:, :1])], 1)
        rgb = (0.5 + SH0 * surfels.sh[:, 0]).clamp_min(0.0)
        quats = torch.nn.functional.normalize(surfels.quats, dim=1)
        self.leaves = [
            t.detach().clone().requires_grad_(True)
            # Colours by view: depth is put beside them, view by view.
            for t in (surfels.means, quats, scales, torch.sigmoid(surfels.opacity_logits), rgb[None])
        ]
        self.view = torch.from_numpy(camera.world_to_camera).float()[None].to(device)
        k = [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]]
        self.intrinsics = torch.tensor([k], device=device)
        self.size = camera.width, camera.height

    def _planes(self) -> list[Tensor]:
        colours, alphas, normals, _, distortion, median, _ = self._rasterize(
            *self.leaves,
            self.view,
            self.intrinsics,
            *self.size,
            near_plane=0.2,
            far_plane=100.0,
            # Distortion is made with depth only.
            render_mode="RGB+ED",
            distloss=True,
        )
        return [colours, alphas, normals, distortion, median]

    def forward(self) -> None:
        """The planes, without gradients."""
        with torch.no_grad():
            self._planes()

    def run(self) -> None:
        """Forward and backward of the sum of all planes."""
        for leaf in self.leaves:
            leaf.grad = None
        planes = self._planes()
        torch.autograd.backward(planes, [torch.ones_like(plane) for plane in planes])


def _contributing_pairs(surfels: Surfels, camera: Camera) -> tuple[Tensor, Tensor]:
    """(pixel, surfel) of every contribution, by pixel and then by depth, as the CPU backend's tile lists have them."""
    from unveil_core.raster.cpu import backend
    from unveil_core.raster.passes import TILE, Settings, tile_counts

    settings = Settings("colour", 1, 1, 0.2, 100.0)
    inputs = (surfels.means, surfels.quats, surfels.log_scales, surfels.opacity_logits, surfels.sh)
    done = backend.forward_pass(inputs, torch.zeros_like(surfels.labels), camera, settings, keep=True)
    across, _ = tile_counts(camera.width, camera.height)
    pixels, owners = [], []
    for tile in range(len(done.bins.offsets) - 1):
        low, high = int(done.bins.offsets[tile]), int(done.bins.offsets[tile + 1])
        ids = torch.from_numpy(done.bins.ids[low:high].astype(np.int64))
        field = torch.from_numpy(done.records[ids.numpy()]).T
        y, x = torch.meshgrid(
            torch.arange(TILE) + tile // across * TILE, torch.arange(TILE) + tile % across * TILE, indexing="ij"
        )
        dx, dy = x.reshape(-1, 1) + 0.5 - field[rec.CX], y.reshape(-1, 1) + 0.5 - field[rec.CY]
        q = 1 + field[rec.A2] * dx + field[rec.B2] * dy
        u, v = (field[rec.A0] * dx + field[rec.B0] * dy) / q, (field[rec.A1] * dx + field[rec.B1] * dy) / q
        square = torch.minimum(u * u + v * v, 2 * (dx * dx + dy * dy))
        alpha = (field[rec.OPACITY] * torch.exp(-0.5 * square)).clamp_max(ALPHA_MAX)
        inside = (x.reshape(-1, 1) < camera.width) & (y.reshape(-1, 1) < camera.height)
        alpha = torch.where((alpha >= ALPHA_MIN) & inside, alpha, 0.0)
        alive = torch.cumprod(1 - alpha, 1) >= TRANSMITTANCE_MIN
        pixel, entry = ((alpha > 0) & alive).nonzero().unbind(1)
        pixels.append((y * camera.width + x).reshape(-1)[pixel])
        owners.append(ids[entry])
    backend.release(done)
    pixel, owner = torch.cat(pixels), torch.cat(owners)
    order = torch.sort(pixel, stable=True).indices
    return pixel[order], owner[order]
