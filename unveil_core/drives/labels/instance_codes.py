"""What a drive's instance maps hold: ids, a class times 1000 plus a number, or colours."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.pictures.decoding import read_values
from unveil_core.drives.cityscapes import LABEL_IDS
from unveil_core.drives.labels.codes import InstanceCode
from unveil_core.drives.labels.orders import LABEL_ID_COUNT
from unveil_core.drives.labels.reading import colours_of, ids_of
from unveil_core.drives.labels.samples import Sample

__all__ = ["instance_code"]

CLASS = 1000
"""Of Cityscapes' ``instanceIds``: a labelId times this plus a number from 0; of KITTI-360's the same, from 1, and with 0 = none."""
COVERED = 0.5
"""Of such maps, in which ground and houses have numbers, too, a larger share of the pixels has one."""
MOST_OBJECTS = 65535
"""That 16 bits tell apart."""


def instance_code(samples: Sequence[Sample], paths: Iterable[Path]) -> tuple[InstanceCode, str | None]:
    """What instance maps hold.

    Args:
        samples: some of them; paths: all.
    Returns:
        the code, and what a user should know of it, None where pixels are ids.
    Raises:
        DriveError: they tell objects by more colours than ids there are, or in a lossy format.
    """
    if not samples:
        return InstanceCode(), None
    if any(s.small.lossy for s in samples):
        odd = next(s for s in samples if s.small.lossy)
        raise DriveError(
            "holds ids of objects in a lossy format, which changes them", path=odd.path, mend="export it as PNG"
        )
    coloured = [s for s in samples if s.ids is None]
    if coloured:
        colours = _all_colours(tuple((p, *_marks(p)) for p in paths))
        ids = [(c >> 16) | (c & 0xFF00) | ((c & 0xFF) << 16) for c in colours]
        if _of_classes(np.array(ids)):
            told = "instance maps are taken for Cityscapes' panoptic pictures, whose colours are class * 1000 + number"
            return InstanceCode(CLASS, colours=colours), told
        if len(colours) > MOST_OBJECTS:
            problem = f"tells objects by more than {MOST_OBJECTS} colours"
            raise DriveError(problem, path=coloured[0].path, mend="instances are 16-bit PNGs of ids")
        return InstanceCode(
            colours=colours
        ), f"instance maps tell {len(colours)} objects by their colours, black = none"
    ids_found = np.unique(np.concatenate([s.ids for s in samples if s.ids is not None]))
    if _of_classes(ids_found) and _covered(samples) > COVERED:
        zero_is_none = not ((ids_found > 0) & (ids_found < CLASS)).any()
        return InstanceCode(CLASS, zero_is_none), "instance maps are taken for class * 1000 + number, by their values"
    return InstanceCode(), None


def _covered(samples: Sequence[Sample]) -> float:
    """Share of the pixels that have a number."""
    return float(np.mean([(i > 0).mean() for s in samples if (i := ids_of(s.small)) is not None]))


def _of_classes(ids: NDArray[np.int64]) -> bool:
    """Whether numbers are a labelId, or a labelId times 1000 plus a number, and some are of what moves."""
    known = np.array([*LABEL_IDS, *range(1, LABEL_ID_COUNT)])
    large = ids[ids >= CLASS]
    small = ids[(ids > 0) & (ids < CLASS)]
    if not len(large) or not np.isin(large // CLASS, known).all() or not np.isin(small, known).all():
        return False
    moving = (large // CLASS >= min(k for k, name in LABEL_IDS.items() if name == "person")).any()
    # Of plain ids beyond 1000 those below are there, too, or classes that stand are not.
    return bool(moving and (len(small) or (large % CLASS == 0).any()))


def _marks(path: Path) -> tuple[int, int]:
    try:
        stat = path.stat()
    except OSError:
        return 0, 0
    return stat.st_size, stat.st_mtime_ns


@lru_cache(maxsize=4)
def _all_colours(files: tuple[tuple[Path, int, int], ...]) -> tuple[int, ...]:
    """Colours of all maps but black, ascending, as red * 65536 + green * 256 + blue."""
    found: set[int] = set()
    for path, *_ in files:
        pixels = colours_of(read_values(path)).reshape(-1, 3).astype(np.int64)
        numbers = (pixels[:, 0] << 16) | (pixels[:, 1] << 8) | pixels[:, 2]
        found |= set(np.unique(numbers).tolist())
    return tuple(sorted(found - {0}))
