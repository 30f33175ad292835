"""Benchmark of the rasterizer: time and error per option, image size and competing implementation, in one run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from unveil_core.base.process_memory import peak_memory_mb
from unveil_core.base.progress import Progress, no_progress
from unveil_core.bench import rivals
from unveil_core.bench.scenes import LABELS, corridor, corridor_camera
from unveil_core.bench.timing import alternate, machine
from unveil_core.geometry.camera import Camera
from unveil_core.raster.api import PLANES, render
from unveil_core.raster.reference import render_reference_in_tiles
from unveil_core.raster.spec import ALPHA_MIN, TRANSMITTANCE_MIN, Limits
from unveil_core.surfels.surfels import Surfels

__all__ = ["SIZES", "Plan", "bench_raster", "plane_gradients", "write_plot"]

NEAR, FAR = 0.2, 100.0
LEAVES = ("means", "quats", "log_scales", "opacity_logits", "sh")
SIZES = ((240, 160), (480, 320), (960, 640), (1920, 1280))
GROUPS = {
    "specified, all planes": PLANES,
    "rgb, alpha": ("rgb", "alpha"),
    "rgb, alpha, semantics": ("rgb", "alpha", "semantics"),
    "rgb, alpha, geometry": ("rgb", "alpha", "depth", "median_depth", "normal", "distortion"),
}
VARIANTS = {
    "exponential of degree 4": Limits(exp_degree=4),
    "exponential of degree 3": Limits(exp_degree=3),
    "cut at alpha 1/128": Limits(alpha_min=1 / 128),
    "cut at alpha 1/64": Limits(alpha_min=1 / 64),
    "cut at alpha 1/32": Limits(alpha_min=1 / 32),
    "stop at light 1e-3": Limits(transmittance_min=1e-3),
    "stop at light 1e-2": Limits(transmittance_min=1e-2),
    "stop at light 5e-2": Limits(transmittance_min=5e-2),
    "whole boxes, no exact reach": Limits(exact_reach=False),
}


@dataclass(frozen=True)
class Plan:
    """What is measured.

    Attributes:
        size, count: image and number of surfels of the main table; rounds: how often each thing runs there.
        counts, sizes: of the sweep; tiles: of how many tiles the error is taken.
        small, small_count: for the rivals that take seconds.
    """

    size: tuple[int, int] = (480, 320)
    count: int = 100_000
    rounds: int = 12
    counts: Sequence[int] = (10_000, 30_000, 100_000, 300_000, 1_000_000)
    sizes: Sequence[tuple[int, int]] = SIZES
    tiles: int = 30
    small: tuple[int, int] = (240, 160)
    small_count: int = 10_000
    yardstick: rivals.Yardstick | None = field(default=None, repr=False)


def plane_gradients(camera: Camera, planes: Sequence[str]) -> dict[str, Tensor]:
    """A gradient of the loss by each plane, positive, the same each time."""
    g = torch.Generator().manual_seed(7)
    last = {"rgb": (3,), "normal": (3,), "semantics": (LABELS,)}
    return {p: torch.rand(camera.height, camera.width, *last.get(p, ()), generator=g) for p in planes}


def _leaves(surfels: Surfels) -> Surfels:
    leaves = {n: getattr(surfels, n).detach().clone().requires_grad_(True) for n in LEAVES}
    return Surfels(**leaves, labels=surfels.labels)


class _Ours:
    """Forward and backward of some planes, as a thing to time; the last results are kept for the error."""

    def __init__(
        self,
        surfels: Surfels,
        camera: Camera,
        planes: Sequence[str],
        gradients: Mapping[str, Tensor],
        limits: Limits | None = None,
    ) -> None:
        self.leaves, self.camera, self.planes = _leaves(surfels), camera, tuple(planes)
        self.gradients = [gradients[p] for p in planes]
        self.limits = limits or Limits()
        self.made: list[Tensor] = []

    def __call__(self) -> None:
        for name in LEAVES:
            getattr(self.leaves, name).grad = None
        out = render(self.leaves, self.camera, self.planes, label_count=LABELS, limits=self.limits)
        self.made = [getattr(out, p) for p in self.planes]
        torch.autograd.backward(self.made, self.gradients)


class _Truth:
    """Float64 on some tiles, and how far others are from it there."""

    def __init__(self, surfels: Surfels, camera: Camera, tiles: int, planes: Sequence[str]) -> None:
        across, down = -(-camera.width // 16), -(-camera.height // 16)
        chosen = sorted({round((k + 0.5) * across * down / tiles) for k in range(min(tiles, across * down))})
        self.tiles = [t for t in chosen if t < across * down]
        self.counted = torch.zeros(camera.height, camera.width, dtype=torch.bool)
        for tile in self.tiles:
            x, y = tile % across * 16, tile // across * 16
            self.counted[y : y + 16, x : x + 16] = True
        self.gradients = {p: g * self._mask(g) for p, g in plane_gradients(camera, planes).items()}
        self.values, sums = render_reference_in_tiles(
            surfels, camera, LABELS, near=NEAR, far=FAR, gradients=self.gradients, tiles=self.tiles, together=True
        )
        self.sums = sums["all"]
        self.undecided = float(self.values["undecided"][self.counted].double().mean())
        self.counted &= ~self.values["undecided"]
        self.gradients = {p: g * self._mask(g) for p, g in self.gradients.items()}

    def _mask(self, plane: Tensor) -> Tensor:
        return self.counted if plane.dim() == 2 else self.counted[..., None]

    def errors(self, run: _Ours) -> dict[str, float]:
        """Relative L2: the colours, the worst plane, and the worst parameter's gradient of the sum over planes."""
        masked = _Ours(run.leaves, run.camera, run.planes, self.gradients, run.limits)
        masked()
        errors = {}
        for name, made in zip(masked.planes, masked.made, strict=True):
            truth = self.values[name] * self._mask(self.values[name])
            value = made.detach().double() * self._mask(made)
            errors[name] = float((value - truth).norm() / truth.norm())
        measured = {"rgb_error": errors["rgb"], "plane_error": max(errors.values())}
        if set(masked.planes) == set(self.gradients):
            measured["gradient_error"] = max(
                float((getattr(masked.leaves, n).grad.double() - self.sums[n]).norm() / self.sums[n].norm())
                for n in LEAVES
            )
        return {name: float(f"{value:.3g}") for name, value in measured.items()}

    def errors_of_yardstick(self, yard: rivals.Yardstick, surfels: Surfels, camera: Camera) -> dict[str, float]:
        """The same, of the yardstick; its gradients are by activated opacity and scale."""
        scene, view = yard.prepare(surfels, camera)
        planes, found = yard.run(scene, view, yard.gradient_of(self.gradients))
        rgb = planes[:3].permute(1, 2, 0).double() * self._mask(self.values["rgb"])
        truth = self.values["rgb"] * self._mask(self.values["rgb"])
        measured = {"rgb_error": float((rgb - truth).norm() / truth.norm())}
        pairs = {
            "means": found["means"],
            "quats": found["quats"],
            "log_scales": found["scales"] * scene["scales"],
            "opacity_logits": found["opac"] * scene["opac"] * (1 - scene["opac"]),
        }
        measured["gradient_error"] = max(
            float((g.double() - self.sums[n]).norm() / self.sums[n].norm()) for n, g in pairs.items()
        )
        return {name: float(f"{value:.3g}") for name, value in measured.items()}


def _knobs(plan: Plan) -> dict[str, Any]:
    """The main table: groups of planes, knobs, SH degrees and the yardstick, alternating."""
    camera = corridor_camera(*plan.size)
    yard = plan.yardstick
    surfels = yard.surfels(plan.count) if yard else corridor(plan.count)
    gradients = plane_gradients(camera, PLANES)
    ours = {f"{name}": _Ours(surfels, camera, planes, gradients) for name, planes in GROUPS.items()}
    ours |= {name: _Ours(surfels, camera, PLANES, gradients, limits) for name, limits in VARIANTS.items()}
    for degree in (1, 2, 3):
        rich = yard.surfels(plan.count, degree=degree) if yard else corridor(plan.count, degree=degree)
        ours[f"specified, SH degree {degree}"] = _Ours(rich, camera, PLANES, gradients)
    runs: dict[str, Callable[[], Any]] = dict(ours)
    if yard:
        runs = {"C++ yardstick": partial(yard.run, *yard.prepare(surfels, camera), yard.gradient_of(gradients))} | runs
    times = alternate(runs, rounds=plan.rounds, base="C++ yardstick" if yard else "specified, all planes")
    truth = _Truth(surfels, camera, plan.tiles, PLANES)
    rows = [{"name": name, **times[name]} for name in runs]
    for row in rows:
        if row["name"] == "C++ yardstick":
            assert yard is not None
            row.update(truth.errors_of_yardstick(yard, surfels, camera))
        elif "SH degree" not in str(row["name"]):
            row.update(truth.errors(ours[str(row["name"])]))
    return {
        "size": plan.size,
        "surfels": plan.count,
        "scene": "the yardstick's" if yard else "corridor",
        "forward_and_backward": rows,
        "undecided_pixels": round(truth.undecided, 4),
        "tiles_compared": len(truth.tiles),
    }


def _sweep(plan: Plan, progress: Progress) -> list[dict[str, Any]]:
    """Sizes and numbers of surfels."""
    rows: list[dict[str, Any]] = []
    for turn, (count, size) in enumerate((c, s) for c in plan.counts for s in plan.sizes):
        surfels, camera = corridor(count), corridor_camera(*size)
        gradients = plane_gradients(camera, PLANES)
        ours = {
            name: _Ours(surfels, camera, GROUPS[name], gradients) for name in ("specified, all planes", "rgb, alpha")
        }
        runs: dict[str, Callable[[], Any]] = dict(ours)
        if plan.yardstick:
            prepared, whole = plan.yardstick.prepare(surfels, camera), plan.yardstick.gradient_of(gradients)
            runs["C++ yardstick"] = partial(plan.yardstick.run, *prepared, whole)
        times = alternate(runs, rounds=3, base="C++ yardstick" if plan.yardstick else None)
        truth = _Truth(surfels, camera, 3, PLANES)
        rows.append({"surfels": count, "size": size, **times, **truth.errors(ours["specified, all planes"])})
        progress(turn + 1, len(plan.counts) * len(plan.sizes), surfels=float(count))
    return rows


def _slow_rivals(plan: Plan) -> list[dict[str, Any]]:
    """Rivals that take seconds, on a small scene, once each."""
    surfels, camera = corridor(plan.small_count), corridor_camera(*plan.small)
    gradients = plane_gradients(camera, PLANES)
    runs: dict[str, Callable[[], Any]] = {
        "ours, all planes": _Ours(surfels, camera, PLANES, gradients),
        "ours, rgb, alpha": _Ours(surfels, camera, ("rgb", "alpha"), gradients),
        "plain torch, all planes": lambda: rivals.plain_torch(surfels, camera, gradients, LABELS),
    }
    if rivals.gsplat_is_there():
        reference = rivals.GsplatReference(surfels, camera)
        runs["gsplat's torch reference, rgb, alpha, normal"] = lambda: reference.run(gradients["rgb"])
    times = alternate(runs, rounds=3, base="ours, all planes")
    return [{"name": name, "size": plan.small, "surfels": plan.small_count, **row} for name, row in times.items()]


def bench_raster(plan: Plan, *, progress: Progress = no_progress) -> dict[str, Any]:
    """All tables as one JSON-able document."""
    measured: dict[str, Any] = {
        "machine": machine(),
        "specified": {"alpha_min": ALPHA_MIN, "transmittance_min": TRANSMITTANCE_MIN},
    }
    measured["knobs"] = _knobs(plan)
    measured["rivals"] = _slow_rivals(plan)
    measured["sweep"] = _sweep(plan, progress)
    measured["peak_memory_mb"] = peak_memory_mb()
    return measured


def write_plot(measured: Mapping[str, Any], path: Path) -> None:
    """Cost against error, with the Pareto front drawn: nothing on it is beaten in both."""
    from unveil_core.bench.plot import pareto_plot

    rows = [r for r in measured["knobs"]["forward_and_backward"] if "gradient_error" in r]
    pareto_plot(
        [(str(r["name"]), float(r["ms"]), float(r["gradient_error"])) for r in rows],
        path,
        title="Forward and backward, all planes: {}x{}, {:,} surfels".format(
            *measured["knobs"]["size"], measured["knobs"]["surfels"]
        ),
    )
