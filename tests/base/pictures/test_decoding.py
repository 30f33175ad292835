"""What reaches a decoder: still pictures of known formats whose size was looked at, and nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.base.pictures.files import animated_png, chunk, jpeg2000, tiff
from unveil_core.base.errors import DriveError
from unveil_core.base.pictures import decoding
from unveil_core.base.pictures.decoding import (
    decode_image,
    decode_unchanged,
    read_image,
    read_image_as_it_is,
    read_label_image,
    size_of_image,
)

PICTURE = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (24, 32, 3)).astype(np.uint8), (0, 0), 2)
WIDE = PICTURE.astype(np.uint16) * 257
DEPTH = np.linspace(0, 80, 24 * 32, dtype=np.float32).reshape(24, 32)
READ: dict[str, tuple[str, np.ndarray, list[int]]] = {
    "PNG": (".png", PICTURE, []),
    "grey PNG": (".png", PICTURE[..., 0], []),
    "PNG of 16 bits": (".png", WIDE, []),
    "PNG with transparency": (".png", np.dstack([PICTURE, PICTURE[..., :1]]), []),
    "PNG of 16 bits, with transparency": (".png", np.dstack([WIDE, WIDE[..., :1]]), []),
    "PNG of one bit": (".png", (PICTURE[..., 0] > 128).astype(np.uint8) * 255, [cv2.IMWRITE_PNG_BILEVEL, 1]),
    "JPEG": (".jpg", PICTURE, []),
    "progressive JPEG": (".jpg", PICTURE, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]),
    "TIFF": (".tiff", PICTURE, []),
    "TIFF of 16 bits": (".tiff", WIDE, []),
    "TIFF of depth": (".tiff", DEPTH, []),
    "TIFF as it is": (".tiff", PICTURE, [cv2.IMWRITE_TIFF_COMPRESSION, 1]),
    "TIFF with deflate": (".tiff", PICTURE, [cv2.IMWRITE_TIFF_COMPRESSION, 8]),
    "TIFF with PackBits": (".tiff", PICTURE, [cv2.IMWRITE_TIFF_COMPRESSION, 32773]),
    "TIFF with transparency": (".tiff", np.dstack([PICTURE, PICTURE[..., :1]]), []),
    "BMP": (".bmp", PICTURE, []),
    "BMP with transparency": (".bmp", np.dstack([PICTURE, PICTURE[..., :1]]), []),
    "grey BMP": (".bmp", PICTURE[..., 0], []),
    "WebP": (".webp", PICTURE, []),
    "WebP without loss": (".webp", PICTURE, [cv2.IMWRITE_WEBP_QUALITY, 101]),
    "WebP with transparency": (".webp", np.dstack([PICTURE, PICTURE[..., :1]]), []),
}
"""Suffix, pixels and options of the encoder."""
OTHERS = {
    "JPEG 2000": jpeg2000(32, 24),
    "JPEG 2000 without boxes": b"\xff\x4f\xff\x51\0\x2f" + bytes(60),
    "Radiance": cv2.imencode(".hdr", DEPTH[..., None].repeat(3, 2))[1].tobytes(),
    "portable pixmap": cv2.imencode(".ppm", PICTURE)[1].tobytes(),
    "Sun raster": cv2.imencode(".ras", PICTURE)[1].tobytes(),
    "GIF": b"GIF89a" + bytes(60),
    "OpenEXR": b"\x76\x2f\x31\x01" + bytes(60),
    "AVIF": b"\0\0\0\x20ftypavif" + bytes(60),
    "HEIC": b"\0\0\0\x2cftypheic" + bytes(60),
    "BigTIFF": b"II+\0\x08\0\0\0" + bytes(60),
    "WebP's container with sound": b"RIFF\x24\0\0\0WAVEfmt " + bytes(60),
    "a text": b"P3 is no picture",
}


@pytest.fixture
def decoder(monkeypatch: pytest.MonkeyPatch) -> list[bytes]:
    """What the decoder is given."""
    given: list[bytes] = []
    decode = cv2.imdecode

    def watched(content: np.ndarray, flags: int) -> Any:
        given.append(content.tobytes())
        return decode(content, flags)

    monkeypatch.setattr(decoding.cv2, "imdecode", watched)
    return given


def encoded(name: str) -> bytes:
    suffix, pixels, options = READ[name]
    return bytes(cv2.imencode(suffix, pixels, options)[1])


@pytest.mark.parametrize("name", READ)
def test_formats_of_cameras_are_read(name: str, tmp_path: Path) -> None:
    content = encoded(name)
    plain = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(decode_unchanged(content, tmp_path, (32, 24)), plain)
    assert size_of_image(content, tmp_path) == (32, 24)
    (tmp_path / "a").write_bytes(content)
    if plain.dtype != np.float32:
        assert read_image(tmp_path / "a", (32, 24)).shape == (24, 32, 3)


@pytest.mark.parametrize("name", READ)
def test_the_camera_is_asked_before_a_decoder(name: str, decoder: list[bytes], tmp_path: Path) -> None:
    with pytest.raises(DriveError, match=r"Not the size of its camera: 32x24 pixels, the camera says 33x24"):
        decode_image(encoded(name), tmp_path, (33, 24))
    assert decoder == []


@pytest.mark.parametrize("name", ["JPEG 2000", "GIF", "OpenEXR", "AVIF", "HEIC", "BigTIFF"])
def test_a_known_format_that_is_not_read_is_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(DriveError, match=rf"Not read: {name}"):
        size_of_image(OTHERS[name], tmp_path / "a.jpg")


@pytest.mark.parametrize("name", OTHERS)
def test_other_formats_reach_no_decoder(name: str, decoder: list[bytes], tmp_path: Path) -> None:
    path = tmp_path / "images.png"
    path.write_bytes(OTHERS[name])
    for read in (read_image, read_image_as_it_is, read_label_image):
        with pytest.raises(DriveError, match=r"images\.png: Not .*export it again as PNG or JPEG"):
            read(path)
    with pytest.raises(DriveError):
        size_of_image(OTHERS[name], path)
    assert decoder == []


@pytest.mark.parametrize("kinds", ["acTL fcTL fdAT", "acTL", "fcTL", "fdAT", "fcTL fdAT", "acTL fcTL"])
@pytest.mark.parametrize("frame", [(0, 0, 32, 24), (0, 0, 64, 96), (20, 20, 32, 24), (1 << 31, 0, 1, 1), (0, 0, 32, 1)])
def test_animated_pngs_reach_no_decoder(
    kinds: str, frame: tuple[int, int, int, int], decoder: list[bytes], tmp_path: Path
) -> None:
    frame = (*frame[:2], min(frame[2], 4096), frame[3])
    with pytest.raises(DriveError, match="an animated PNG"):
        decode_image(animated_png(32, 24, frame, kinds), tmp_path, (32, 24))
    assert decoder == []


def test_an_animated_webp_reaches_no_decoder(decoder: list[bytes], tmp_path: Path) -> None:
    body = b"WEBPVP8X" + (10).to_bytes(4, "little") + b"\x02\0\0\0" + b"\x1f\0\0\x17\0\0" + b"ANIM" + bytes(50)
    with pytest.raises(DriveError, match="an animated WebP"):
        decode_image(b"RIFF" + len(body).to_bytes(4, "little") + body, tmp_path)
    assert decoder == []


def test_of_a_png_the_decoder_gets_what_makes_the_picture(decoder: list[bytes], tmp_path: Path) -> None:
    """A text that unpacks to a gigabyte, a profile, what a later standard adds: they reach no library."""
    plain = encoded("PNG")
    others = b"".join(chunk(kind, zlib.compress(bytes(9999))) for kind in (b"iCCP", b"zTXt", b"eXIf", b"cICP", b"xxXx"))
    found = decode_image(plain[:33] + others + plain[33:] + b"SEFT of a phone", tmp_path)
    assert decoder == [plain]
    assert np.array_equal(found, decode_image(plain, tmp_path))


DEFLATED = zlib.compress(bytes(1 << 16))
PLAIN_TIFF = {
    256: (4, 32), 257: (4, 24), 258: (3, 8), 259: (3, 8), 262: (3, 1), 273: (4, 0), 277: (3, 1), 278: (4, 24),
    279: (4, len(DEFLATED)),
}  # fmt: skip


def test_the_plain_tiff_of_these_tests_is_read(tmp_path: Path) -> None:
    assert not decode_image(tiff(PLAIN_TIFF, DEFLATED), tmp_path, (32, 24)).any()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({256: (4, 30_000), 257: (4, 30_000)}, "Not the size of its camera: 30000x30000 pixels, the camera says 32x24"),
        ({259: (3, 7)}, "compression 7"),
        ({259: (3, 34676)}, "compression 34676"),
        ({262: (3, 6)}, "colours of kind 6"),
        ({277: (3, 9)}, "9 channels"),
        ({258: (3, 999)}, "999 bits"),
        ({322: (4, 1 << 15), 323: (4, 1 << 15)}, "tiles of 32768x32768"),
        ({322: (16, 1 << 15)}, "Cut short"),
        ({258: (3, 64), 277: (3, 4), 279: (4, 1)}, "Cut short"),
        ({279: (4, 1 << 31)}, "Cut short"),
        ({700: (1, 1 << 30)}, None),
    ],
)
def test_a_tiff_claims_what_cameras_write(
    change: dict[int, tuple[int, int]], said: str | None, decoder: list[bytes], tmp_path: Path
) -> None:
    content = tiff(dict(sorted({**PLAIN_TIFF, **change}.items())), DEFLATED)
    if said is None:
        decode_image(content, tmp_path, (32, 24))
        return
    with pytest.raises(DriveError, match=said):
        decode_image(content, tmp_path, (32, 24))
    assert decoder == []


def test_pictures_without_a_camera_have_a_limit_too(decoder: list[bytes], tmp_path: Path) -> None:
    """2.7 GB from 2.6 MB."""
    data = zlib.compress(bytes(3 << 20))
    content = tiff({**PLAIN_TIFF, 256: (4, 30_000), 257: (4, 30_000), 279: (4, len(data))}, data)
    with pytest.raises(DriveError, match="claims 30000x30000 pixels"):
        read = tmp_path / "matte.tif"
        read.write_bytes(content)
        read_image_as_it_is(read)
    assert decoder == []


def test_a_jpeg_of_many_scans_reaches_no_decoder(decoder: list[bytes], tmp_path: Path) -> None:
    """Each of them costs a decoder a walk through all pixels."""
    content = encoded("progressive JPEG")
    scan = content[content.rindex(b"\xff\xda") : -2]
    with pytest.raises(DriveError, match="more than 100 scans"):
        decode_image(content[:-2] + scan * 200 + content[-2:], tmp_path, (32, 24))
    assert decoder == []


def test_the_first_size_of_a_jpeg_counts(decoder: list[bytes], tmp_path: Path) -> None:
    """A decoder makes room for it."""
    content = encoded("JPEG")
    at = content.index(b"\xff\xc0")
    frame = content[at : at + 2 + int.from_bytes(content[at + 2 : at + 4], "big")]
    huge = frame[:5] + b"\xff\x00\xff\x00" + frame[9:]
    with pytest.raises(DriveError, match="65280x65280 pixels"):
        decode_image(content[:at] + huge + content[at:], tmp_path, (32, 24))
    with pytest.raises(DriveError, match="Cut short"):
        decode_image(content[:at] + frame + content[at:], tmp_path, (32, 24))
    assert decoder == []


def test_opencv_has_the_same_limit() -> None:
    """The second net, which the command sets before it is imported."""
    program = (
        "import sys; sys.argv[1:] = ['--version']; from unveil_core.app.cli import main; main(); "
        "import os; print('cv2' in sys.modules, os.environ['OPENCV_IO_MAX_IMAGE_PIXELS'], os.environ['OMP_WAIT_POLICY'])"
    )
    env = {k: v for k, v in os.environ.items() if k not in ("OPENCV_IO_MAX_IMAGE_PIXELS", "OMP_WAIT_POLICY")}
    said = subprocess.run([sys.executable, "-c", program], env=env, capture_output=True, text=True, check=True).stdout
    assert said.splitlines()[-1] == f"False {decoding.MOST_PIXELS} PASSIVE"
