"""Masks are read as what they are, whichever format and channel they are in; which end is removed is said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.drives.labels.files import as_palette, saved
from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.base.pictures.decoding import read_values
from unveil_core.drives import open_drive
from unveil_core.drives.labels.codes import LabelCodes, MaskCode
from unveil_core.drives.labels.mask_codes import mask_code
from unveil_core.drives.labels.reading import mask_of, removed
from unveil_core.drives.labels.samples import samples_of
from unveil_core.drives.labels.understood import with_codes

Gone = NDArray[np.bool_]


def gone(i: int = 0) -> Gone:
    """(96, 128) what is removed of frame i."""
    found = np.zeros((96, 128), bool)
    found[40:72, 16 + 8 * i : 56 + 8 * i] = True
    return found


def grey(x: Gone, keep: int = 255) -> NDArray[np.uint8]:
    return np.where(x, 0, keep).astype(np.uint8)


def of_alpha(colour: int) -> Callable[[Gone], NDArray[np.uint8]]:
    return lambda x: np.dstack([np.full((*x.shape, 3), colour, np.uint8), grey(x)])


def cut_out(x: Gone) -> NDArray[np.uint8]:
    """The photograph itself, transparent where something goes."""
    photo = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 255, (*x.shape, 3)).astype(np.uint8), (0, 0), 2)
    return np.dstack([photo, grey(x)])


def once_a_jpeg(x: Gone) -> NDArray[np.uint8]:
    done = cv2.imencode(".jpg", grey(x), [cv2.IMWRITE_JPEG_QUALITY, 40])[1]
    decoded = cv2.imdecode(done, cv2.IMREAD_UNCHANGED).astype(np.int64)
    noise = np.random.default_rng(0).integers(1, 9, x.shape)
    return np.where(decoded < 128, noise, decoded).astype(np.uint8)


KINDS: dict[str, tuple[Callable[[Gone], NDArray[np.generic] | bytes], str]] = {
    "0 and 255": (grey, ".png"),
    "0 and 1": (lambda x: grey(x, 1), ".png"),
    "16 bits": (lambda x: grey(x).astype(np.uint16) * 257, ".png"),
    "16 bits, 0 and 1": (lambda x: grey(x, 1).astype(np.uint16), ".png"),
    "RGB": (lambda x: np.dstack([grey(x)] * 3), ".png"),
    "RGBA, opaque": (lambda x: np.dstack([grey(x)] * 3 + [np.full(x.shape, 255, np.uint8)]), ".png"),
    "kept in green": (lambda x: np.dstack([0 * grey(x), grey(x), 0 * grey(x)]), ".png"),
    "transparency over black": (of_alpha(0), ".png"),
    "transparency over white": (of_alpha(255), ".png"),
    "the photograph cut out": (cut_out, ".png"),
    "palette of one bit": (lambda x: as_palette(grey(x, 1), np.array([[0, 0, 0], [255, 255, 255]]), 1), ".png"),
    "palette of one bit, white first": (
        lambda x: as_palette(x.astype(np.uint8), np.array([[255, 255, 255], [0, 0, 0]]), 1),
        ".png",
    ),
    "palette, red kept": (lambda x: as_palette(grey(x, 1), np.array([[0, 0, 0], [128, 0, 0]])), ".png"),
    "JPEG": (grey, ".jpg"),
    "WebP": (lambda x: np.dstack([grey(x)] * 3), ".webp"),
    "a PNG that was a JPEG": (once_a_jpeg, ".png"),
    "BMP": (grey, ".bmp"),
    "TIFF": (grey, ".tif"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_black_or_transparent_is_removed(kind: str, tmp_path: Path) -> None:
    make, suffix = KINDS[kind]
    paths = [saved(tmp_path / f"{i}{suffix}", make(gone(i))) for i in range(3)]
    code, told = mask_code(samples_of(paths))
    assert code.removes == "black" and code.by_alpha == ("transparency" in kind or "cut out" in kind)
    assert len(told) == int(code.by_alpha) + int(code.up_to > 0)
    for i, path in enumerate(paths):
        found = removed(read_values(path), code)
        edges = cv2.morphologyEx(gone(i).astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((5, 5), np.uint8)) > 0
        assert (found == gone(i))[~edges].all()
        if code.up_to == 0:
            assert (found == gone(i)).all()


def test_soft_borders_of_exact_masks_stay(tmp_path: Path) -> None:
    soft = cv2.GaussianBlur(grey(gone()), (0, 0), 1.5)
    path = saved(tmp_path / "0.png", soft)
    code, told = mask_code(samples_of([path]))
    assert code == MaskCode() and told == []
    assert (removed(read_values(path), code) == (soft == 0)).all()


def test_white_is_removed_where_the_user_says_so(tmp_path: Path) -> None:
    for name, picture in (("0.png", ~grey(gone())), ("1.png", (~grey(gone())).astype(np.uint16) * 257)):
        path = saved(tmp_path / name, picture)
        code, told = mask_code(samples_of([path]), "white")
        assert code.removes == "white" and told == []
        assert (removed(read_values(path), code) == gone()).all()


def test_masks_that_remove_nothing_are_told_with_the_convention(tmp_path: Path) -> None:
    code, told = mask_code(samples_of([saved(tmp_path / "0.png", np.full((24, 32), 255, np.uint8))]))
    assert code == MaskCode()
    assert (
        len(told) == 1
        and "remove nothing: black and transparent is removed" in told[0]
        and "--mask-removes white" in told[0]
    )


def test_what_the_format_removes_is_taken_unless_somebody_says_otherwise(tmp_path: Path) -> None:
    """As Instant-NGP's masks, whose white is removed."""
    drive = make_tiny_drive(tmp_path, semantics=False, masks=True)
    opened = open_drive(drive)
    white = LabelCodes(mask=MaskCode("white"))
    ngp = replace(opened, frames=tuple(replace(f, codes=white) for f in opened.frames))
    for removes, turned in ((None, True), ("white", True), ("black", False)):
        frame = with_codes(ngp, mask_removes=removes).frames[1]
        assert (mask_of(frame) != mask_of(opened.frames[1])).all() == turned
