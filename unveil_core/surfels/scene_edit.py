"""What becomes of a scene when objects are removed: one value, kept in one file, applied in one way.

The file, an NPZ archive of N surfels of the full scene and M new ones, holds ``removed``, ``displaced`` and ``relit`` (N,) bool;
``shortened`` (K, 6 or 7) float64, see :class:`Shortened`; ``origin`` (M,) uint8; and, where there are new ones, ``added.NAME``, the
arrays of ``Surfels``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.checks.array_headers import open_npz
from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import NO_ARCHIVE, write_atomic
from unveil_core.base.types import Float64, Mask
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["NOT_SHORTENED", "SceneEdit", "Shortened", "read_edit", "write_edit"]

MASKS = ("removed", "displaced", "relit")
ADDED = "added."
WIDTHS = {"means": (3,), "quats": (4,), "opacity_logits": (), "labels": ()}
"""Of the arrays of surfels, what follows the first axis where that is the same for all."""


@dataclass(frozen=True, eq=False)
class Shortened:
    """Surfels that lost a part.

    Attributes:
        index: (K,) of the scene's surfels; means: (K, 3) their centres; log_scales: (K, 2 or 3) as in ``Surfels``.
    """

    index: NDArray[np.int64]
    means: NDArray[np.float32]
    log_scales: NDArray[np.float32]

    @staticmethod
    def from_table(table: NDArray[np.generic]) -> Shortened:
        """Inverse of :meth:`table`."""
        index, means, scales = np.split(np.asarray(table), [1, 4], axis=1)
        return Shortened(index[:, 0].astype(np.int64), means.astype(np.float32), scales.astype(np.float32))

    def table(self) -> Float64:
        """(K, 6 or 7) one row per surfel: its index, centre and scales; float64 holds all three exactly."""
        return np.column_stack([self.index, self.means, self.log_scales]).astype(np.float64)

    def of(self, surfels: Surfels) -> Surfels:
        """The scene with these surfels as they are now."""
        if not len(self.index):
            return surfels
        index = torch.from_numpy(self.index)
        means, scales = surfels.means.clone(), surfels.log_scales.clone()
        means[index], scales[index] = torch.from_numpy(self.means), torch.from_numpy(self.log_scales)
        return replace(surfels, means=means, log_scales=scales)


NOT_SHORTENED = Shortened.from_table(np.zeros((0, 6)))


@dataclass(frozen=True, eq=False)
class SceneEdit:
    """What makes the empty scene of a full one of N surfels.

    Attributes:
        removed: (N,) surfels of removed objects; shortened: those that lost what reached behind these objects.
        displaced: (N,) surfels that new ones take the place of; relit: (N,) those that lost a shadow.
        added: M new surfels, None = none; origin: (M,) where their colours come from, see ``inpaint.origin``.
    """

    removed: Mask
    shortened: Shortened
    displaced: Mask
    relit: Mask
    added: Surfels | None = None
    origin: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))

    @staticmethod
    def removing(removed: Mask, shortened: Shortened) -> SceneEdit:
        """An edit that only takes away."""
        return SceneEdit(removed, shortened, *np.zeros((2, len(removed)), dtype=bool))

    @property
    def stays(self) -> Mask:
        """(N,) surfels that are left, shortened or not."""
        return np.asarray(~(self.removed | self.displaced))

    def apply(self, full: Surfels) -> Surfels:
        """The empty scene: of the full one what stays, in order, then what is added."""
        left = self.shortened.of(full).select(torch.from_numpy(self.stays))
        return left if self.added is None else concatenate([left, self.added])

    def carried(self, of_full: NDArray[Any], of_added: NDArray[Any]) -> NDArray[Any]:
        """(N' + M, ...) values of the empty scene's surfels: of the full scene's (N, ...), then of what is added (M, ...)."""
        return np.concatenate([of_full[self.stays], of_added])


def write_edit(edit: SceneEdit, path: Path) -> None:
    """Write an edit, whole or not at all."""
    arrays = {name: getattr(edit, name) for name in (*MASKS, "origin")}
    added = {} if edit.added is None else {ADDED + name: array for name, array in edit.added.arrays().items()}
    arrays |= {"shortened": edit.shortened.table(), **added}
    write_atomic(path, lambda stream: np.savez(stream, **arrays))


def read_edit(path: Path, count: int | None = None) -> SceneEdit:
    """Read what :func:`write_edit` wrote.

    Args:
        count: N, that the full scene has; None = not known.
    Raises:
        WorkspaceError: it is not there, cannot be read, or is no edit of a scene of so many surfels.
    """
    if not path.is_file():
        problem = "Not found: the stage that writes it has not run, or an older version made the workspace"
        raise WorkspaceError(problem, path=path, mend="run `unveil run` again")
    try:
        with open_npz(path, most_bytes=path.stat().st_size) as data:  # it is written as it is, not packed
            return _edit({name: data[name] for name in data.files}, count)
    except NO_ARCHIVE as error:
        raise WorkspaceError(f"Not an edit of the scene: {error}", path=path, mend="run `unveil run` again") from error


def _edit(arrays: Mapping[str, NDArray[Any]], count: int | None) -> SceneEdit:
    """The edit of these arrays; a ValueError or KeyError says what is wrong with them."""
    masks = [arrays[name] for name in MASKS]
    length = len(masks[0]) if count is None else count
    if any(mask.dtype != bool or mask.shape != (length,) for mask in masks):
        raise ValueError(f"it is not of {length} surfels" if count is not None else "its masks do not fit together")
    table, origin = arrays["shortened"], arrays["origin"]
    if table.dtype != np.float64 or table.ndim != 2 or table.shape[1] not in (6, 7) or not np.isfinite(table).all():
        raise ValueError("its shortened surfels are none")
    if ((table[:, 0] < 0) | (table[:, 0] >= length)).any():
        raise ValueError("it shortens surfels that the scene does not have")
    named = {name.removeprefix(ADDED): array for name, array in arrays.items() if name.startswith(ADDED)}
    if origin.dtype != np.uint8 or origin.shape != (len(named["means"]) if named else 0,):
        raise ValueError("its origins are not those of what it adds")
    removed, displaced, relit = masks
    return SceneEdit(
        removed, Shortened.from_table(table), displaced, relit, _surfels(named, len(origin)) if named else None, origin
    )


def _surfels(arrays: Mapping[str, NDArray[Any]], count: int) -> Surfels:
    for part in fields(Surfels):
        array, kind = arrays[part.name], np.int64 if part.name == "labels" else np.float32
        if array.dtype != kind or len(array) != count or not np.isfinite(array).all():
            raise ValueError(f"it adds surfels whose {part.name} are none")
        if array.shape[1:] != WIDTHS.get(part.name, array.shape[1:]):
            raise ValueError(f"it adds surfels whose {part.name} are of another shape")
    sh, scales = arrays["sh"].shape, arrays["log_scales"].shape
    if len(sh) != 3 or sh[1] not in (1, 4, 9, 16) or sh[2] != 3 or scales[1:] not in ((2,), (3,)):
        raise ValueError("it adds surfels of another kind")
    if count and not -1 <= int(arrays["labels"].min()) <= int(arrays["labels"].max()) < 256:
        raise ValueError("it adds surfels with labels that are none")
    return Surfels.from_arrays(arrays)
