"""The numbers behind a palette, which decoders hide."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.drives.labels.files import as_palette
from unveil_core.base.pictures.decoding import read_values
from unveil_core.base.pictures.palettes import indexed

PALETTE = np.random.default_rng(0).integers(0, 256, (256, 3)).astype(np.uint8)


def numbers(bits: int) -> np.ndarray:
    return np.random.default_rng(bits).integers(0, 1 << bits, (7, 13)).astype(np.uint8)


@pytest.mark.parametrize("bits", [1, 2, 4, 8])
def test_those_of_a_png(bits: int, tmp_path: Path) -> None:
    own = PALETTE[: 1 << bits]
    (tmp_path / "p.png").write_bytes(as_palette(numbers(bits), own, bits))
    found = read_values(tmp_path / "p.png")
    assert found.palette is not None and (found.palette == own).all()
    assert (found.pixels == numbers(bits)).all()
    shown = cv2.imread(str(tmp_path / "p.png"), cv2.IMREAD_COLOR)[..., ::-1]
    assert (own[found.pixels] == shown).all()


def test_those_of_a_bmp(tmp_path: Path) -> None:
    picture = numbers(8)
    rows = b"".join(row.tobytes() + bytes(-len(row) % 4) for row in picture[::-1])
    table = np.concatenate([PALETTE[:, ::-1], np.zeros((256, 1), np.uint8)], axis=1).tobytes()
    head = struct.pack("<IiiHHIIiiII", 40, 13, 7, 1, 8, 0, len(rows), 0, 0, 256, 0)
    start = 14 + 40 + 1024
    (tmp_path / "p.bmp").write_bytes(b"BM" + struct.pack("<IHHI", start + len(rows), 0, 0, start) + head + table + rows)
    found = read_values(tmp_path / "p.bmp")
    assert found.palette is not None and (found.palette == PALETTE).all() and (found.pixels == picture).all()


def test_those_of_a_tiff(tmp_path: Path) -> None:
    picture = numbers(8)
    levels = (PALETTE.T.astype("<u2") * 257).tobytes()
    tags = {
        256: (3, 13),
        257: (3, 7),
        258: (3, 8),
        259: (3, 1),
        262: (3, 3),
        273: (4, 0),
        277: (3, 1),
        278: (3, 7),
        279: (4, 91),
    }
    at = 8 + 2 + 12 * (len(tags) + 1) + 4
    entries = b"".join(
        struct.pack("<HHII", tag, kind, 1, at + len(levels) if tag == 273 else value)
        for tag, (kind, value) in tags.items()
    )
    entries += struct.pack("<HHII", 320, 3, 768, at)
    content = b"II*\0" + struct.pack("<IH", 8, len(tags) + 1) + entries + bytes(4) + levels + picture.tobytes()
    (tmp_path / "p.tif").write_bytes(content)
    found = read_values(tmp_path / "p.tif")
    assert found.palette is not None and (found.palette == PALETTE).all() and (found.pixels == picture).all()


def test_other_pictures_have_none(tmp_path: Path) -> None:
    for suffix in (".png", ".tif", ".bmp", ".jpg", ".webp"):
        done, encoded = cv2.imencode(suffix, cv2.GaussianBlur(numbers(8), (0, 0), 2)[..., None].repeat(3, 2))
        assert done and indexed(encoded.tobytes()) is None
    assert indexed(b"") is None and indexed(b"\x89PNG\r\n\x1a\n") is None


@pytest.mark.parametrize("cut", [20, 40, 60, 200, 800])
def test_a_file_cut_short_is_none_or_told_later(cut: int) -> None:
    whole = as_palette(numbers(8), PALETTE)
    found = indexed(whole[:cut])
    assert found is None or found.palette.shape[1] == 3
