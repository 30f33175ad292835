"""What a GPU gives: its error against float64, the time and memory of a pass, and gsplat's kernels beside it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

from unveil_core.bench.raster import FAR, GROUPS, LEAVES, NEAR, plane_gradients
from unveil_core.bench.rivals import GsplatKernels, gsplat_is_there
from unveil_core.bench.scenes import LABELS, corridor, corridor_camera
from unveil_core.bench.timing import alternate
from unveil_core.geometry.camera import Camera
from unveil_core.raster.api import PLANES, render
from unveil_core.raster.reference import render_reference_in_tiles
from unveil_core.raster.triton.memory import step_bytes
from unveil_core.surfels.surfels import Surfels

__all__ = [
    "backend_errors",
    "intersections",
    "kernel_times",
    "pass_times",
    "reached_tiles",
    "warp_times",
    "with_gradients",
]

FEW = {**GROUPS, "all but label distortion": PLANES[:-1]}
"""Planes that are timed, by name: label distortion is a pass of its own on a GPU."""


def with_gradients(surfels: Surfels) -> Surfels:
    """The same values as leaves that collect gradients."""
    leaves = {n: getattr(surfels, n).detach().clone().requires_grad_(True) for n in LEAVES}
    return Surfels(**leaves, labels=surfels.labels)


def backend_errors(
    surfels: Surfels, camera: Camera, device: str, *, backend: str = "triton", tiles: Collection[int] | None = None
) -> dict[str, dict[str, Any]]:
    """How far a backend is from float64, plane by plane.

    Args:
        surfels: on the CPU. device: where the backend takes them. tiles: numbers of the tiles that are compared, all by default.
    Returns:
        by plane, relative L2: "value", and of the gradient of a weighted sum of it the worst parameter's, "gradient", with the
        parameter's name.
    """
    weights = plane_gradients(camera, PLANES)
    truth, references = render_reference_in_tiles(
        surfels, camera, LABELS, near=NEAR, far=FAR, gradients=weights, tiles=tiles
    )
    counted = ~truth["undecided"]
    if tiles is not None:
        chosen = torch.zeros_like(counted)
        across = -(-camera.width // 16)
        for tile in tiles:
            x, y = tile % across * 16, tile // across * 16
            chosen[y : y + 16, x : x + 16] = True
        counted &= chosen
    errors: dict[str, dict[str, Any]] = {}
    for plane in PLANES:
        leaves = with_gradients(surfels.to(device))
        out = render(leaves, camera, [plane], label_count=LABELS, near=NEAR, far=FAR, backend=backend)
        mask = counted if weights[plane].dim() == 2 else counted[..., None]
        value = getattr(out, plane).cpu() * mask
        (value * weights[plane]).sum().backward()
        expected = truth[plane] * mask
        by_leaf = {n: _error(getattr(leaves, n).grad, references[plane][n]) for n in LEAVES}
        largest = max(float(g.norm()) for g in references[plane].values())
        # Where the gradient is zero in exact arithmetic, only rounding is left, and no relative error says anything.
        told = {n: e for n, e in by_leaf.items() if float(references[plane][n].norm()) > 1e-6 * largest}
        worst = max(told, key=lambda n: told[n])
        errors[plane] = {
            "value": _error(value.detach(), expected),
            "gradient": told[worst],
            "of": worst,
        }
    return errors


def _error(found: Tensor | None, expected: Tensor) -> float:
    found = torch.zeros_like(expected) if found is None else found.cpu()
    return float(f"{float((found.double() - expected).norm() / expected.norm().clamp_min(1e-30)):.3g}")


class _Waited:
    """A pass to time: what it started on a GPU must have ended."""

    def __init__(self, run: Callable[[], Any], device: str) -> None:
        self.run, self.on_gpu = run, _is_gpu(device)

    def __call__(self) -> None:
        self.run()
        if self.on_gpu:
            torch.cuda.synchronize()


def _is_gpu(device: str) -> bool:
    return torch.device(device).type == "cuda"


def _pass(surfels: Surfels, camera: Camera, planes: Sequence[str], *, backward: bool) -> Callable[[], None]:
    """Forward, or forward and backward, as a training loop does it: values are not checked again."""
    leaves = with_gradients(surfels) if backward else surfels.detach()
    by_plane = plane_gradients(camera, planes)
    gradients = [by_plane[p].to(surfels.means.device) for p in planes]

    def run() -> None:
        for name in LEAVES:
            getattr(leaves, name).grad = None
        options: dict[str, Any] = {"label_count": LABELS, "near": NEAR, "far": FAR, "check": False}
        out = render(leaves, camera, planes, backend="triton", **options)
        if backward:
            torch.autograd.backward([getattr(out, p) for p in planes], gradients)

    return run


def pass_times(count: int, size: tuple[int, int], *, rounds: int, device: str = "cuda") -> dict[str, Any]:
    """Milliseconds of forward, and of forward and backward, by planes; in alternation with gsplat's 2DGS kernels, if installed.

    Args:
        count: surfels of the corridor. size: width and height. rounds: how often each is run. device: a GPU; or "cpu", where the
            kernels run in Triton's interpreter, whose times tell nothing but that the measurement works.
    Returns:
        "ms" by name; "intersections"; and of all planes "bytes_computed" and, on a GPU, "bytes_measured" at the peak.
    """
    camera, surfels = corridor_camera(*size), corridor(count).to(device)
    runs: dict[str, Callable[[], Any]] = {}
    for name, planes in FEW.items():
        runs[f"{name}: forward"] = _Waited(_pass(surfels, camera, planes, backward=False), device)
        runs[f"{name}: forward and backward"] = _Waited(_pass(surfels, camera, planes, backward=True), device)
    if _is_gpu(device) and gsplat_is_there():
        rival = GsplatKernels(surfels, camera)
        runs["gsplat 2DGS, colour, normal, distortion: forward"] = _Waited(rival.forward, device)
        runs["gsplat 2DGS, colour, normal, distortion: forward and backward"] = _Waited(rival.run, device)
    row: dict[str, Any] = {"surfels": count, "size": size, "ms": alternate(runs, rounds=rounds)}
    row["intersections"] = intersections(surfels, camera)
    computed = step_bytes(count, row["intersections"], *size, LABELS, PLANES)
    # The leaves, the gradients by plane and Adam are not of the pass.
    row["bytes_computed"] = computed["peak"] - computed["adam"] - computed["parameters"] - computed["planes"]
    if _is_gpu(device):
        run = _pass(surfels, camera, PLANES, backward=True)
        del runs
        torch.cuda.empty_cache()
        before = torch.cuda.memory_allocated()
        torch.cuda.reset_peak_memory_stats()
        run()
        row["bytes_measured"] = torch.cuda.max_memory_allocated() - before
    return row


def intersections(surfels: Surfels, camera: Camera) -> int:
    """Pairs of a surfel and a tile that it reaches."""
    from unveil_core.raster.passes import Settings
    from unveil_core.raster.triton import backend

    settings = Settings("colour", LABELS, surfels.sh.shape[1], NEAR, FAR)
    inputs = tuple(getattr(surfels, n) for n in LEAVES)
    done = backend.forward_pass(inputs, surfels.labels, camera, settings, keep=True)  # type: ignore[arg-type]
    assert done.lists is not None
    return len(done.lists.ids)


def reached_tiles(surfels: Surfels, camera: Camera) -> tuple[int, int]:
    """Pairs of a surfel and a tile without a GPU, where Triton's interpreter is on: of bounding boxes, and that are reached.

    The interpreter takes its time by program, so this one counts all surfels at once.
    """
    from unveil_core.raster.cpu import backend
    from unveil_core.raster.passes import Settings
    from unveil_core.raster.triton.binning import count_tiles

    settings = Settings("colour", LABELS, surfels.sh.shape[1], NEAR, FAR)
    inputs = tuple(getattr(surfels, n) for n in LEAVES)
    done = backend.forward_pass(inputs, surfels.labels, camera, settings, keep=True)  # type: ignore[arg-type]
    boxes = torch.from_numpy(done.buffers.array("boxes", (len(surfels), 4), np.int16))
    records, visible = torch.from_numpy(done.records), done.visible.to(torch.uint8)
    count, block = torch.empty(len(surfels), dtype=torch.int32), 65_536
    count_tiles[(-(-len(surfels) // block),)](records, boxes, visible, len(surfels), count, BLOCK=block)
    pairs = len(done.bins.ids), int(count.sum())
    backend.release(done)
    return pairs


def kernel_times(count: int, size: tuple[int, int], *, device: str = "cuda") -> dict[str, float]:
    """Milliseconds on the GPU of each kernel of one forward and backward pass of all planes, by name, the longest first."""
    camera, surfels = corridor_camera(*size), corridor(count).to(device)
    run = _Waited(_pass(surfels, camera, PLANES, backward=True), device)
    run()
    with torch.profiler.profile(activities=[torch.profiler.ProfilerActivity.CUDA]) as profile:
        run()
    times: dict[str, float] = {}
    for event in profile.key_averages():
        # torch's own kernels have template arguments of a thousand letters behind their name.
        name = event.key.removeprefix("void ").split("<")[0]
        times[name] = times.get(name, 0.0) + event.self_device_time_total / 1e3
    return {name: round(ms, 4) for name, ms in sorted(times.items(), key=lambda kv: -kv[1]) if ms > 0}


def warp_times(count: int, size: tuple[int, int], *, rounds: int, device: str = "cuda") -> dict[str, dict[str, float]]:
    """Milliseconds of all planes, forward and backward, by the warps of a tile's program: the backend's own choice, made by
    registers alone, is to be held against them."""
    from unveil_core.raster.triton import backend

    run = _pass(corridor(count).to(device), corridor_camera(*size), PLANES, backward=True)
    own = backend.FORWARD_WARPS, backend.BACKWARD_WARPS, backend.LABEL_WARPS

    def with_warps(forward: int, backward: int, label: int) -> None:
        backend.FORWARD_WARPS, backend.BACKWARD_WARPS, backend.LABEL_WARPS = forward, backward, label
        run()

    choices = [own, *((f, own[1], own[2]) for f in (2, 8)), *((own[0], b, own[2]) for b in (1, 4))]
    choices += [(own[0], own[1], label) for label in (1, 4)]
    names = {"forward {}, backward {}, label distortion {}".format(*choice): choice for choice in choices}
    runs = {name: _Waited(partial(with_warps, *choice), device) for name, choice in names.items()}
    try:
        return alternate(runs, rounds=rounds)
    finally:
        backend.FORWARD_WARPS, backend.BACKWARD_WARPS, backend.LABEL_WARPS = own
