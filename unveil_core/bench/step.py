"""A whole training step: render, losses, backward, optimizer; beside the yardstick's forward and backward alone."""

from __future__ import annotations

import statistics
import time
from typing import Any

import numpy as np
import torch

from unveil_core.base.kernels.device import current_device
from unveil_core.base.process_memory import peak_memory_mb
from unveil_core.bench import rivals
from unveil_core.bench.raster import plane_gradients
from unveil_core.bench.scenes import LABELS, corridor, corridor_camera
from unveil_core.bench.timing import machine, second_process_seconds
from unveil_core.optimize.training.parameters import LearningRates
from unveil_core.optimize.training.trainer import Optimization, TrainSettings
from unveil_core.optimize.training.views import training_view, views_on
from unveil_core.raster.api import PLANES, render
from unveil_core.surfels.sky import Sky

__all__ = ["bench_step"]

WARM_UP = 3


def bench_step(
    *,
    size: tuple[int, int] = (480, 320),
    count: int = 100_000,
    degree: int = 3,
    iterations: int = 15,
    yardstick: rivals.Yardstick | None = None,
) -> dict[str, Any]:
    """Milliseconds of a step with all losses of the second stage, against another street seen from the same place.

    It is taken on the device of the process (``base.kernels.device``); on a GPU a step is over when the GPU has done it, and
    ``gpu_memory_mb`` is the most that torch held there. With a yardstick, its forward and backward runs after each step, and
    the ratio is the median over these pairs.
    """
    camera = corridor_camera(*size)
    scene = yardstick.surfels if yardstick else corridor
    start, target = scene(count, degree=degree), corridor(count, seed=1)
    sky = Sky(torch.rand(3, 64, 128, generator=torch.Generator().manual_seed(0)), np.eye(3))
    with torch.no_grad():
        seen = render(target, camera, ("rgb", "semantics"), label_count=LABELS)
    assert seen.rgb is not None and seen.semantics is not None
    device = current_device()
    there = torch.device(device.name)
    image = (seen.rgb.clamp(0, 1).numpy() * 255).astype(np.uint8)
    views = views_on([training_view(camera, image, seen.semantics.argmax(2).numpy(), None, sky)], sky, there, 1 << 30)
    prepared = yardstick.prepare(scene(count), camera) if yardstick else None
    whole = yardstick.gradient_of(plane_gradients(camera, PLANES)) if yardstick else None
    steps: list[float] = []
    others: list[float] = []
    before = machine()
    settings = TrainSettings(sky_rate=0.0, backend=device.backend)
    state = Optimization(
        start.to(there), sky, settings, LearningRates(means=1e-4), label_count=LABELS, sky_label=LABELS - 1
    )
    if there.type == "cuda":
        torch.cuda.reset_peak_memory_stats(there)  # of what this process did before
    for _ in range(iterations + WARM_UP):
        begun = time.perf_counter()
        state.step(views, geometry=True, done=0.0)
        if there.type == "cuda":
            torch.cuda.synchronize(there)
        steps.append((time.perf_counter() - begun) * 1e3)
        if yardstick and prepared is not None and whole is not None:
            begun = time.perf_counter()
            yardstick.run(*prepared, whole)
            others.append((time.perf_counter() - begun) * 1e3)
    steps, others = steps[WARM_UP:], others[WARM_UP:]
    figures: dict[str, Any] = {
        "machine": before,
        "size": size,
        "surfels": count,
        "sh_degree": degree,
        "step_ms": round(statistics.median(steps), 2),
        "least_ms": round(min(steps), 2),
        "device": device.name,
        "peak_memory_mb": peak_memory_mb(),
        "second_process_s": second_process_seconds(),
    }
    if there.type == "cuda":
        figures["gpu"] = torch.cuda.get_device_name(there)
        figures["gpu_memory_mb"] = round(torch.cuda.max_memory_allocated(there) / 2**20, 1)
    if others:
        figures["yardstick_ms"] = round(statistics.median(others), 2)
        figures["ratio"] = round(statistics.median(a / b for a, b in zip(steps, others, strict=True)), 3)
    return figures
