"""The tile kernels of each group of planes; each is compiled when it is first needed."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

from unveil_core.raster.cpu.backward import backward_kernel
from unveil_core.raster.cpu.forward import forward_kernel
from unveil_core.raster.passes import GROUPS

__all__ = ["Kernels", "kernels_for"]


class Kernels(NamedTuple):
    """For ranges of tiles; see :mod:`forward` and :mod:`backward`."""

    forward: Callable[..., None]
    backward: Callable[..., None]


@lru_cache(None)
def kernels_for(group: str, exp_degree: int) -> Kernels:
    """The kernels of a group of planes, with an exponential of this degree."""
    switches = GROUPS[group]
    return Kernels(forward_kernel(*switches, exp_degree), backward_kernel(*switches, exp_degree))
