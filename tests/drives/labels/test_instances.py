"""Instance maps are read as what they are: ids, a class times 1000 plus a number, colours."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.drives.labels.files import as_palette, saved
from unveil_core.base.errors import DriveError
from unveil_core.base.pictures.decoding import read_values
from unveil_core.drives.labels.codes import InstanceCode
from unveil_core.drives.labels.instance_codes import instance_code
from unveil_core.drives.labels.reading import instances
from unveil_core.drives.labels.samples import samples_of

Map = NDArray[np.integer]
COLOURS = np.random.default_rng(5).integers(1, 255, (256, 3)).astype(np.uint8)
COLOURS[0] = 0


def objects(i: int = 0) -> NDArray[np.int64]:
    """(48, 64) ids 1 to 3 of frame i; the third comes later."""
    found = np.zeros((48, 64), np.int64)
    found[20:32, 4 + i : 20 + i], found[22:34, 30:40] = 1, 2
    found[24:30, 50:56] = 3 if i else 0
    return found


def of_cityscapes(x: Map, *, stuff: int = 1, first: int = 0) -> NDArray[np.int64]:
    """Cars numbered within their class, the rest a labelId times ``stuff``: road below, sky above."""
    around = np.where(np.arange(len(x))[:, None] < 20, 23, 7) * stuff
    return np.where(x > 0, 26000 + x - 1 + first, around)


def in_three_channels(x: Map) -> NDArray[np.uint8]:
    return np.dstack([x & 255, x >> 8 & 255, x >> 16 & 255]).astype(np.uint8)


KINDS: dict[str, Callable[[Map], NDArray[np.generic] | bytes]] = {
    "16 bits": lambda x: x.astype(np.uint16),
    "8 bits": lambda x: x.astype(np.uint8),
    "in all channels": lambda x: np.dstack([x] * 3).astype(np.uint8),
    "large ids": lambda x: (x * 20011).astype(np.uint16),
    "a palette": lambda x: as_palette(x.astype(np.uint8), COLOURS),
    "colours": lambda x: COLOURS[x],
    "colours with transparency": lambda x: np.dstack([COLOURS[x], np.full(x.shape, 255, np.uint8)]),
    "instanceIds of Cityscapes": lambda x: of_cityscapes(x).astype(np.uint16),
    "instance maps of KITTI-360": lambda x: of_cityscapes(x, stuff=1000, first=1).astype(np.uint16),
    "panoptic pictures of Cityscapes": lambda x: in_three_channels(of_cityscapes(x)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_objects_are_told_apart_and_are_the_same_in_all_frames(kind: str, tmp_path: Path) -> None:
    paths = [saved(tmp_path / f"{i}.png", KINDS[kind](objects(i))) for i in range(4)]
    code, told = instance_code(samples_of(paths), paths)
    plain = kind in ("16 bits", "8 bits", "in all channels", "large ids", "a palette")
    assert (code == InstanceCode()) == plain == (told is None)
    seen: dict[int, set[int]] = {}
    for i, path in enumerate(paths):
        found = instances(read_values(path), code, path)
        assert ((found > 0) == (objects(i) > 0)).all()
        for number in (1, 2, 3):
            seen.setdefault(number, set()).update(np.unique(found[objects(i) == number]).tolist())
    assert all(len(ids) == 1 for ids in seen.values()) and len(set.union(*seen.values())) == 3


def test_a_jpeg_is_one_line(tmp_path: Path) -> None:
    path = saved(tmp_path / "0.jpg", objects(1).astype(np.uint8))
    with pytest.raises(DriveError, match="lossy format"):
        instance_code(samples_of([path]), [path])


def test_more_colours_than_ids_are_one_line(tmp_path: Path) -> None:
    many = np.arange(300 * 300).reshape(300, 300) * 3
    path = saved(tmp_path / "0.png", in_three_channels(many))
    with pytest.raises(DriveError, match="more than 65535 colours"):
        instance_code(samples_of([path]), [path])
