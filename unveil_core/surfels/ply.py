"""Surfels as PLY: the attribute names of 3D Gaussian Splatting files plus a label, so that other splat viewers open them. All
attributes are floats, the label, too.

A disc has no third scale; viewers want one, so ``scale_2`` is a thin constant, and reading ignores it. It is real, and
read, where the header has the comment ``splats ellipsoids``. ``f_rest`` is stored channel-major as the field does: all
red coefficients, then green, then blue.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from unveil_core.base.errors import UnveilError
from unveil_core.base.ply.reading import UNREADABLE, read_vertices
from unveil_core.base.ply.writing import write_vertices
from unveil_core.geometry.similarity import Similarity
from unveil_core.surfels.surfels import THIN_LOG_SCALE, Surfels

__all__ = ["read_surfels", "write_surfels"]


def _names(rest: int) -> list[str]:
    return [
        "x",
        "y",
        "z",
        "nx",
        "ny",
        "nz",
        "f_dc_0",
        "f_dc_1",
        "f_dc_2",
        *(f"f_rest_{i}" for i in range(rest)),
        "opacity",
        "scale_0",
        "scale_1",
        "scale_2",
        "rot_0",
        "rot_1",
        "rot_2",
        "rot_3",
    ]


ELLIPSOIDS = "splats ellipsoids"
"""The header's comment of a file whose third scale is real."""


def write_surfels(
    surfels: Surfels,
    path: Path,
    *,
    to_world: Similarity | None = None,
    comments: tuple[str, ...] = (),
    more: Mapping[str, NDArray[np.integer]] | None = None,
    thin: float = 1.0,
) -> None:
    """Write surfels to a binary PLY, atomically.

    Args:
        surfels: what to write, N surfels.
        path: the file.
        to_world: of the drive, noted in comments; the coordinates stay local, as float32 needs.
        comments: lines for the header, such as the label names.
        more: whole numbers (N,) below 2^24 by the name of their attribute, to follow the label.
        thin: times the thin third scale, for coordinates that are not metres.
    """
    s = surfels.detach()
    count, coefficients = len(s), s.sh.shape[1]
    rest = 3 * (coefficients - 1)
    # All are floats: importers of splats that know no integers count no bytes for them, and all that follows is garbage.
    names = (*_names(rest), "label", *(more or {}))
    table = np.empty((count, len(names)), "<f4")
    columns: dict[str, Tensor | NDArray[np.integer] | float] = {
        "x": s.means,
        "nx": s.normals(),
        "f_dc_0": s.sh[:, 0],
        "f_rest_0": s.sh[:, 1:].transpose(1, 2).reshape(count, rest),
        "opacity": s.opacity_logits,
        "scale_2": THIN_LOG_SCALE + math.log(thin),
        "scale_0": s.log_scales,
        "rot_0": s.quats,
        "label": s.labels,
        **(more or {}),
    }
    for name, values in columns.items():
        if name in names:
            array = np.asarray(values.cpu() if isinstance(values, Tensor) else values)
            first, width = names.index(name), array.shape[1] if array.ndim == 2 else 1
            table[:, first : first + width] = array.reshape(-1, width)
    lines = [*comments, ELLIPSOIDS] if s.ellipsoids else list(comments)
    if to_world is not None:
        lines += to_world.comments()
    write_vertices(path, table.view([(name, "<f4") for name in names])[:, 0], lines)


def read_surfels(path: Path) -> Surfels:
    """Read a file of :func:`write_surfels`, or any 3DGS PLY (its third scale is dropped, labels become 0; add the
    comment ``splats ellipsoids`` to its header to keep the scale).

    Raises:
        UnveilError: the file is missing, is not a PLY, or lacks a 3DGS attribute.
    """
    try:
        found = read_vertices(path)
    except UNREADABLE as error:
        raise UnveilError(f"Not a readable surfel PLY: {str(error) or type(error).__name__}", path=path) from error
    present = set(found.names)
    rest = sum(name.startswith("f_rest_") for name in present)
    scales = ("scale_0", "scale_1", "scale_2")[: 3 if ELLIPSOIDS in found.comments else 2]
    unread = {"nx", "ny", "nz", "scale_2"} - set(scales)
    if rest not in (0, 9, 24, 45):
        raise UnveilError(f"has {rest} coefficients f_rest", path=path, mend="degrees 0 to 3 have 0, 9, 24 or 45")
    missing = [n for n in _names(rest) if n not in present | unread]
    if missing:
        raise UnveilError(f"lacks the attribute {missing[0]}", path=path, mend="export it with 3DGS attribute names")

    def stack(*names: str) -> torch.Tensor:
        columns = found.columns(names, np.float32)
        if not np.isfinite(columns).all():  # or too large
            raise UnveilError(f"Not finite: {names[0]}", path=path, mend="run the stage that wrote it again")
        return torch.from_numpy(columns)

    count = len(found.table)
    sh = stack("f_dc_0", "f_dc_1", "f_dc_2")[:, None]
    if rest:
        higher = stack(*(f"f_rest_{i}" for i in range(rest))).reshape(count, 3, rest // 3).transpose(1, 2)
        sh = torch.cat([sh, higher], dim=1)
    labels = np.zeros(count, dtype=np.int64)
    if "label" in present:
        given = found.table["label"]
        with np.errstate(invalid="ignore"):  # NaN becomes a number that it does not equal
            labels = given.astype(np.int64)
        if count and not ((labels == given).all() and -1 <= int(labels.min()) <= int(labels.max()) < 256):
            raise UnveilError("Not a label: one of its values", path=path, mend="labels are -1 to 255")
    return Surfels(
        means=stack("x", "y", "z"),
        quats=stack("rot_0", "rot_1", "rot_2", "rot_3"),
        log_scales=stack(*scales),
        opacity_logits=stack("opacity")[:, 0].clone(),
        sh=sh.contiguous(),
        labels=torch.from_numpy(labels),
    )
