"""How much of a GPU's memory training takes, whether it fits, and what would.

The amounts are computed, not measured: what the kernels allocate, array by array, and what the torch losses do, with all terms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import torch

from unveil_core.base.errors import GpuTooSmallError
from unveil_core.base.kernels.device import CPU, Device, note_of_device
from unveil_core.geometry.camera import Camera
from unveil_core.raster.triton import memory

__all__ = ["Place", "StepSize", "fitting", "largest_step", "place_for", "step_bytes"]

TILES_A_SURFEL = 10
"""Tiles that a surfel of a trained outdoor scene lies in, the safe side: in a corridor of small surfels it is 2.8."""
BYTES_A_LOSS, BYTES_A_LABEL = 320, 8
"""Of each pixel, what the losses and the view in their making hold at a time, counted by a test; and for each label, what the cross
entropy holds beside the plane of semantics."""
SPARE = 1.15
"""Memory that torch's allocator holds beyond what is in use, as a factor."""
OF_CONTEXT = 600 << 20
"""Bytes that CUDA takes for its context and torch for compiled kernels, before the first tensor."""
FINE_SHARE, COARSE_SHARE = 0.7, 0.15
"""Of the memory that a step leaves: for the views in full and in half size. The rest is for what was not thought of."""


@dataclass(frozen=True)
class StepSize:
    """What a step works on.

    Attributes:
        surfels: at most; coefficients: of their colours, each (L + 1)^2.
        width, height: of the largest view, pixels; labels: K.
    """

    surfels: int
    coefficients: int
    width: int
    height: int
    labels: int


def step_bytes(size: StepSize) -> int:
    """Bytes on the GPU that a training step with all terms takes at most, views not counted."""
    rasterizer = memory.step_bytes(
        size.surfels,
        TILES_A_SURFEL * size.surfels,
        size.width,
        size.height,
        size.labels,
        sh_rows=size.coefficients,
    )["peak"]
    losses = size.width * size.height * (BYTES_A_LOSS + BYTES_A_LABEL * size.labels)
    return OF_CONTEXT + int(SPARE * (rasterizer + losses))


def _free_bytes(device: Device) -> int:
    """What this process may still take of the GPU's memory, its own unused blocks included."""
    there = torch.device(device.name)
    free, _ = torch.cuda.mem_get_info(there)
    return free + torch.cuda.memory_reserved(there) - torch.cuda.memory_allocated(there)


def fitting(size: StepSize, free: int) -> str | None:
    """Options with which a step fits into ``free`` bytes; None = none with a picture worth looking at.

    Smaller pictures first, down to half the side: delivered frames keep the footage's size. Then half as many surfels, and so on.
    """
    surfels = size.surfels
    longest = max(size.width, size.height)
    for halvings in range(5):
        for eighths in range(8, 3, -1):
            side = longest * eighths // 8
            scale = side / longest
            smaller = StepSize(
                surfels >> halvings,
                size.coefficients,
                max(1, round(size.width * scale)),
                max(1, round(size.height * scale)),
                size.labels,
            )
            if step_bytes(smaller) <= free:
                options = [f"--splats {surfels >> halvings}"] if halvings else []
                options += [f"--work-side {side}"] if eighths < 8 else []
                return " ".join(options) or None
    return None


@dataclass(frozen=True)
class Place:
    """Where an optimization works.

    Attributes:
        device: that it takes; why: a line on why that is not the run's, empty where it is.
        fine_bytes, coarse_bytes: room there for the views in full and in half size; 0 on the processor, where they stay.
    """

    device: Device
    why: str = ""
    fine_bytes: int = 0
    coarse_bytes: int = 0


def place_for(device: Device, size: Callable[[], StepSize]) -> Place:
    """Where an optimization works: on the device of the run, if its steps fit into that one's memory.

    Args:
        size: of the largest step; only asked where memory is scarce.
    Raises:
        GpuTooSmallError: the GPU was asked for, and its memory is too small.
    """
    if not device.name.startswith("cuda"):
        return Place(device)
    return _placed(device, size(), _free_bytes(device))


def _placed(device: Device, size: StepSize, free: int) -> Place:
    need = step_bytes(size)
    if need <= free:
        return Place(device, "", int(FINE_SHARE * (free - need)), int(COARSE_SHARE * (free - need)))
    problem = (
        f"{size.surfels:,} surfels at {size.width}x{size.height} need {need / 2**30:.1f} GB of the GPU's memory, "
        f"{free / 2**30:.1f} GB are free"
    )
    smaller = fitting(size, free)
    if device.asked_for:
        raise GpuTooSmallError(problem, mend=f"use {smaller} or --device cpu" if smaller else "use --device cpu")
    why = f"training on the processor: {problem}" + (f" ({smaller} would fit)" if smaller else "")
    note_of_device(why)
    return Place(CPU, why)


def largest_step(surfels: int, degree: int, cameras: Iterable[Camera], labels: int) -> StepSize:
    """The largest step of an optimization.

    Args:
        surfels: how many there may become; degree: of their colours at most; cameras: of the views; labels: K.
    """
    largest = max(cameras, key=lambda camera: camera.width * camera.height)
    return StepSize(surfels, (degree + 1) ** 2, largest.width, largest.height, labels)
