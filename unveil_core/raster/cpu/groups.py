"""The tile kernels of each group of planes; each is compiled when it is first needed."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from unveil_core.raster.cpu.backward import backward_kernel
from unveil_core.raster.cpu.forward import forward_kernel
from unveil_core.raster.passes import GROUPS

__all__ = ["KERNELS", "Kernels"]


class Kernels(NamedTuple):
    """For ranges of tiles; see :mod:`forward` and :mod:`backward`."""

    forward: Callable[..., None]
    backward: Callable[..., None]


KERNELS = {name: Kernels(forward_kernel(*group), backward_kernel(*group)) for name, group in GROUPS.items()}
"""By the group's name."""
