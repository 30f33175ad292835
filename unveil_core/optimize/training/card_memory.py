"""How much of a GPU's memory training takes, whether it fits, and what would.

The amounts are computed, not measured: what the kernels allocate, array by array, and what the torch losses do, with all terms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import torch

from unveil_core.base.errors import GpuTooSmallError
from unveil_core.base.kernels.device import CPU, Device, note_of_device
from unveil_core.geometry.camera import Camera
from unveil_core.optimize.training.views import MOST_RAYS
from unveil_core.raster.triton import memory

__all__ = ["Place", "StepSize", "fitting", "largest_step", "place_for", "state_bytes", "step_bytes", "trial_of_degrees"]

TILES_A_SURFEL = 10
"""Tiles that a surfel of a trained outdoor scene lies in, the safe side: in a corridor of small surfels it is 2.8."""
BYTES_A_LOSS, BYTES_A_LABEL = 320, 8
"""Of each pixel, what the losses and the view in their making hold at a time, counted by a test; and for each label, what the cross
entropy holds beside the plane of semantics."""
BYTES_OF_RAYS = 15
"""Of each pixel, the directions of a camera's pixels (``views``) in full and in half size: kept from its first view on."""
OBSERVED = 12
"""Bytes of a surfel that density control notes between its turns."""
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
        lenses: kinds of cameras, each of which keeps its rays.
        held: coefficients of the states that lie there beside the one that is stepped, one number each.
    """

    surfels: int
    coefficients: int
    width: int
    height: int
    labels: int
    lenses: int = 1
    held: tuple[int, ...] = ()


def state_bytes(surfels: int, coefficients: int) -> int:
    """Bytes of an optimization's state that is only kept: values, Adam's moments, what density control noted."""
    floats = 3 + 4 + 2 + 1 + 3 * coefficients
    return surfels * (3 * 4 * floats + OBSERVED)


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
    of_a_pixel = BYTES_A_LOSS + BYTES_A_LABEL * size.labels + BYTES_OF_RAYS * min(size.lenses, MOST_RAYS)
    held = sum(state_bytes(size.surfels, coefficients) for coefficients in size.held)
    return OF_CONTEXT + int(SPARE * (rasterizer + size.width * size.height * of_a_pixel + held))


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
            smaller = replace(
                size,
                surfels=surfels >> halvings,
                width=max(1, round(size.width * scale)),
                height=max(1, round(size.height * scale)),
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


def place_for(device: Device, sizes: Callable[[], Sequence[StepSize]]) -> Place:
    """Where an optimization works: on the device of the run, if its steps fit into that one's memory.

    Args:
        sizes: of the steps that may be the largest; only asked where memory is scarce.
    Raises:
        GpuTooSmallError: the GPU was asked for, and its memory is too small.
    """
    if not device.name.startswith("cuda"):
        return Place(device)
    return _placed(device, max(sizes(), key=step_bytes), _free_bytes(device))


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
    some = list(cameras)
    largest = max(some, key=lambda camera: camera.width * camera.height)
    lenses = len({camera.intrinsics for camera in some})
    return StepSize(surfels, (degree + 1) ** 2, largest.width, largest.height, labels, lenses)


def trial_of_degrees(step: StepSize, surfels: int) -> StepSize:
    """The last step of the trial of colour's degrees (``adaptation.colour_degree``): in half size, beside the states of all lower
    degrees and the one that the trial began with.

    Args:
        step: the largest of the optimization; surfels: how many it begins with.
    """
    lower = ((degree + 1) ** 2 for degree in range(16) if (degree + 1) ** 2 < step.coefficients)
    return replace(
        step,
        surfels=surfels,
        width=-(-step.width // 2),
        height=-(-step.height // 2),
        held=(*lower, step.coefficients),
    )
