"""The ground on disk: ``ground/ground.npz`` of a workspace, arrays only, in the local coordinates of its drive.

===================  =======  ======================================================================================
axes                 (3, 3)   rows east, north, up
path_nodes           (S, 2)   east, north, one every path_step metres
path_heading         (S,)     radians
path_start           ()       arc length of the first node; the first camera is at 0
path_step            ()
street_height        (A, B)   over (s, t), street_cell apart, the first at street_first; these four are absent without a street
street_first         (2,)
street_cell          (2,)
street_limits        (2, A)   smallest and largest t that is ground
terrain_height       (P, Q)   over (east, north), terrain_cell apart, the first at terrain_corner, NaN where nobody knows;
terrain_corner       (2,)     these three are absent without a terrain
terrain_cell         ()
===================  =======  ======================================================================================
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from unveil_core.base.checks.array_headers import open_npz
from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import NO_ARCHIVE, write_atomic
from unveil_core.base.types import Float64
from unveil_core.ground.fit import DriveGround
from unveil_core.ground.height_field import HeightField
from unveil_core.ground.path import StreetPath
from unveil_core.ground.street import Ground

__all__ = ["read_ground", "write_ground"]

LARGEST_BYTES = 2**30
"""Of all arrays together: a few hundred kilometres of street."""
MEND = "run `unveil ground` again"


def write_ground(ground: DriveGround, path: Path) -> None:
    """Write a ground, whole or not at all."""
    way, street, terrain = ground.path, ground.street, ground.terrain
    arrays = {
        "axes": way.axes,
        "path_nodes": way.nodes,
        "path_heading": way.heading,
        "path_start": way.start,
        "path_step": way.step,
    }
    if street is not None:
        arrays |= {
            "street_height": street.height,
            "street_first": np.array([street.s_start, street.t_start]),
            "street_cell": np.array([street.s_cell, street.t_cell]),
            "street_limits": np.stack([street.t_min, street.t_max]),
        }
    if terrain is not None:
        arrays |= {"terrain_height": terrain.height, "terrain_corner": terrain.corner, "terrain_cell": terrain.cell}
    whole = {name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()}
    write_atomic(path, lambda stream: np.savez_compressed(stream, **whole))  # type: ignore[arg-type]


def read_ground(path: Path) -> DriveGround:
    """Read what :func:`write_ground` wrote.

    Raises:
        WorkspaceError: it is not there, cannot be read, or holds what is no ground.
    """
    if not path.is_file():
        raise WorkspaceError("Not found", path=path, mend="run `unveil ground`")
    try:
        with open_npz(path, most_bytes=LARGEST_BYTES) as data:
            return _ground({name: data[name] for name in data.files})
    except NO_ARCHIVE as error:
        raise WorkspaceError(f"Not a readable ground: {error}", path=path, mend=MEND) from error


def _ground(arrays: dict[str, Float64]) -> DriveGround:
    """The ground of these arrays; a ValueError or KeyError says what is wrong with them."""

    def array(name: str, *shape: int | None, gaps: bool = False) -> Float64:
        """One of the arrays; None in a shape stands for any length from 1 on."""
        found = arrays[name]
        fits = found.ndim == len(shape) and all(
            n == wanted or (wanted is None and n > 0) for n, wanted in zip(found.shape, shape, strict=False)
        )
        if found.dtype != np.float64 or not fits:
            raise ValueError(f"{name} holds {found.dtype} {found.shape}")
        if not (gaps or np.isfinite(found).all()) or np.isinf(found).any():
            raise ValueError(f"not finite: {name}")
        return found

    def size(name: str, *shape: int) -> Float64:
        found = array(name, *shape)
        if not (found > 0).all():
            raise ValueError(f"not above 0: {name}")
        return found

    axes = array("axes", 3, 3)
    if np.abs(axes @ axes.T - np.eye(3)).max() > 1e-6 or np.linalg.det(axes) < 0:
        raise ValueError("not a rotation: axes")
    nodes, step = array("path_nodes", None, 2), float(size("path_step"))
    if (np.linalg.norm(np.diff(nodes, axis=0), axis=1) > 2 * step).any():
        raise ValueError("path_nodes leap")
    path = StreetPath(axes, nodes, array("path_heading", len(nodes)), float(array("path_start")), step)
    street = terrain = None
    if "street_height" in arrays:
        height = array("street_height", None, None)
        (s_start, t_start), (s_cell, t_cell) = array("street_first", 2), size("street_cell", 2)
        t_min, t_max = array("street_limits", 2, len(height))
        if min(height.shape) < 2:
            raise ValueError("street_height is too small")
        street = Ground(path, float(s_start), float(t_start), float(s_cell), float(t_cell), height, t_max, t_min)
    if "terrain_height" in arrays:
        height = array("terrain_height", None, None, gaps=True)
        if min(height.shape) < 2:
            raise ValueError("terrain_height is too small")
        terrain = HeightField(axes, array("terrain_corner", 2), float(size("terrain_cell")), height)
    return DriveGround(path, street, terrain)
