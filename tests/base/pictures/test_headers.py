"""Headers of images: sizes as they are, and whether the file holds its picture's end."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.base.pictures.headers import header_of


def encoded(suffix: str, options: tuple[int, ...] = (), shape: tuple[int, ...] = (37, 53, 3)) -> bytes:
    picture = np.random.default_rng(1).integers(0, 256, shape, dtype=np.uint8)
    return bytes(cv2.imencode(suffix, picture, list(options))[1])


FILES = {
    "PNG": encoded(".png"),
    "PNG of one channel": encoded(".png", shape=(37, 53)),
    "PNG of one bit": encoded(".png", (cv2.IMWRITE_PNG_BILEVEL, 1), (37, 53)),
    "JPEG": encoded(".jpg"),
    "progressive JPEG": encoded(".jpg", (cv2.IMWRITE_JPEG_PROGRESSIVE, 1)),
    "JPEG with restart marks": encoded(".jpg", (cv2.IMWRITE_JPEG_RST_INTERVAL, 2)),
}


@pytest.mark.parametrize("name", FILES)
def test_the_size_is_read_and_the_end_found(name: str) -> None:
    header = header_of(FILES[name])
    assert header is not None
    assert (header.width, header.height, header.whole) == (53, 37, True)


@pytest.mark.parametrize("name", FILES)
def test_what_follows_the_picture_does_not_matter(name: str) -> None:
    header = header_of(FILES[name] + b"\0" + b"SEFT of a phone" * 999)
    assert header is not None
    assert header.whole


@pytest.mark.parametrize("name", FILES)
def test_a_file_cut_short_anywhere_is_never_whole(name: str) -> None:
    content = FILES[name]
    for end in range(len(content)):
        header = header_of(content[:end])
        assert header is None or not header.whole


def test_a_thumbnail_does_not_end_its_photograph() -> None:
    photograph = FILES["JPEG"]
    inside = b"Exif\0\0" + encoded(".jpg", shape=(8, 8, 3))
    tagged = photograph[:2] + b"\xff\xe1" + struct.pack(">H", len(inside) + 2) + inside + photograph[2:]
    header, cut = header_of(tagged), header_of(tagged[: len(tagged) // 2 + 300])
    assert header is not None
    assert (header.width, header.height, header.whole) == (53, 37, True)
    assert cut is not None
    assert not cut.whole


def png(width: int, height: int, rows: bytes) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def test_more_pixels_than_the_bytes_can_make_are_no_whole_picture() -> None:
    header = header_of(png(60_000, 60_000, b"\0" * 1000))
    assert header is not None
    assert (header.width, header.height, header.whole) == (60_000, 60_000, False)


@given(st.binary(max_size=300), st.sampled_from([b"", b"\x89PNG\r\n\x1a\n", b"\xff\xd8", *FILES.values()]), st.data())
def test_any_bytes_have_an_answer(noise: bytes, start: bytes, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(start)))
    header_of(start[:at] + noise + start[at:])


OTHER_FILES = {
    "TIFF": encoded(".tiff"),
    "TIFF as it is": encoded(".tiff", (cv2.IMWRITE_TIFF_COMPRESSION, 1)),
    "BMP": encoded(".bmp"),
    "grey BMP": encoded(".bmp", shape=(37, 53)),
    "WebP": encoded(".webp"),
    "WebP without loss": encoded(".webp", (cv2.IMWRITE_WEBP_QUALITY, 101)),
    "WebP with transparency": encoded(".webp", shape=(37, 53, 4)),
}


@pytest.mark.parametrize("name", OTHER_FILES)
def test_the_size_is_read_in_other_formats(name: str) -> None:
    content = OTHER_FILES[name]
    header = header_of(content)
    assert header is not None
    assert (header.width, header.height, header.whole, header.problem) == (53, 37, True, None)


@pytest.mark.parametrize("name", ["BMP", "grey BMP", "WebP", "WebP without loss", "WebP with transparency"])
def test_other_formats_cut_short_are_never_whole(name: str) -> None:
    content = OTHER_FILES[name]
    for end in range(len(content)):
        header = header_of(content[:end])
        assert header is None or not header.whole


@given(st.sampled_from(sorted(OTHER_FILES)), st.binary(max_size=60), st.data())
def test_any_bytes_of_other_formats_have_an_answer(name: str, noise: bytes, data: st.DataObject) -> None:
    content = OTHER_FILES[name]
    at = data.draw(st.integers(0, len(content)))
    header_of(content[:at] + noise + content[at + len(noise) :])
