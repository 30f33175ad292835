"""Levels of 255 in files of 8 and 16 bits, and in memory."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import read_image, read_image_as_it_is, read_levels
from unveil_core.base.pictures.levels import as_bytes, as_words, levels_of, rounded_like

WORDS = np.arange(1 << 16, dtype=np.uint16).reshape(256, 256)[..., None].repeat(3, axis=2)


def test_all_words_come_back_through_a_file(tmp_path: Path) -> None:
    path = tmp_path / "words.png"
    write_image_atomic(path, as_words(levels_of(WORDS)))
    assert np.array_equal(read_image_as_it_is(path), WORDS)
    levels = read_levels(path)
    assert levels.dtype == np.float32 and np.abs(levels * 257 - WORDS).max() < 0.01


def test_words_are_rounded_to_bytes_and_not_cut(tmp_path: Path) -> None:
    path = tmp_path / "words.png"
    cv2.imwrite(str(path), WORDS)
    assert np.array_equal(read_image(path), np.round(WORDS / 257).astype(np.uint8))


def test_bytes_stay_as_they_are(tmp_path: Path) -> None:
    picture = (WORDS >> 8).astype(np.uint8)
    write_image_atomic(tmp_path / "bytes.png", picture)
    assert np.array_equal(read_levels(tmp_path / "bytes.png"), picture)
    assert as_bytes(picture) is picture
    assert np.array_equal(as_words(picture), picture.astype(np.uint16) * 257)


def test_files_end_at_white_and_levels_do_not() -> None:
    bright = np.array([[[-3.4, 254.6, 301.2]]], np.float32)
    assert as_bytes(bright).tolist() == [[[0, 255, 255]]] and as_words(bright).tolist() == [[[0, 65432, 65535]]]
    assert rounded_like(bright, bright) is bright
    assert rounded_like(bright, as_bytes(bright)).dtype == np.uint8
