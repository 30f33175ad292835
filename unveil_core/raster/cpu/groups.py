"""Groups of planes: the kernels that make them, each compiled when it is first needed."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import NamedTuple

from unveil_core.raster.cpu.backward import backward_kernel
from unveil_core.raster.cpu.forward import forward_kernel

__all__ = ["GROUPS", "Group", "group_for", "plane_shapes"]


class Group(NamedTuple):
    """A pair of kernels.

    Attributes:
        members: planes that it can be asked for.
        geometry, semantics, label_distortion: what it makes beside rgb and alpha.
        forward, backward: for ranges of tiles, see :mod:`forward` and :mod:`backward`.
    """

    members: frozenset[str]
    geometry: bool
    semantics: bool
    label_distortion: bool
    forward: Callable[..., None]
    backward: Callable[..., None]


def _group(*members: str, geometry: bool = False, semantics: bool = False, label_distortion: bool = False) -> Group:
    switches = (geometry, semantics, label_distortion)
    made = forward_kernel(*switches), backward_kernel(*switches)
    return Group(frozenset(("rgb", "alpha", *members)), *switches, *made)


_GEOMETRY = ("depth", "median_depth", "normal", "distortion")
GROUPS = {
    "colour": _group(),
    "semantic": _group("semantics", semantics=True),
    "geometry": _group(*_GEOMETRY, geometry=True),
    "all": _group("semantics", *_GEOMETRY, "label_distortion", geometry=True, semantics=True, label_distortion=True),
}
"""By name, the cheapest first."""


def group_for(wanted: Collection[str]) -> str:
    """The cheapest group of kernels that makes all these planes."""
    return next(name for name, group in GROUPS.items() if group.members.issuperset(wanted))


def plane_shapes(group: Group, width: int, height: int, label_count: int) -> dict[str, tuple[int, ...]]:
    """Shapes in the kernels' order; planes that the group does not make are empty."""
    flat = (height, width)
    return {
        "rgb": (*flat, 3),
        "alpha": flat,
        "depth": flat if group.geometry else (0, 0),
        "median_depth": flat if group.geometry else (0, 0),
        "normal": (*flat, 3) if group.geometry else (0, 0, 0),
        "distortion": flat if group.geometry else (0, 0),
        "semantics": (*flat, label_count) if group.semantics else (0, 0, 0),
        "label_distortion": flat if group.label_distortion else (0, 0),
    }
