"""What comes with a picture goes into a PNG: as Pillow writes it into other files, and as Pillow finds it there again."""

from __future__ import annotations

import io
import struct
import zlib
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.base.pictures.files import chunk
from tests.base.pictures.profiles import P3, profile
from unveil_core.base.pictures.exif import Exif, cleaned_exif, exif_facts
from unveil_core.base.pictures.metadata import Metadata, metadata_of
from unveil_core.base.pictures.xmp import cleaned_xmp

Image = pytest.importorskip("PIL.Image")
RATIONAL = pytest.importorskip("PIL.TiffImagePlugin").IFDRational

PROFILE = profile("Display P3", P3)
DRONE = (
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    b'<rdf:Description xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" drone-dji:GimbalYawDegree="+12.5"/>'
    b"</rdf:RDF></x:xmpmeta>"
)
SECRET = b"\xff\xd8the photograph as it was\xff\xd9"


def picture() -> Any:
    return Image.fromarray(np.random.default_rng(0).integers(0, 256, (24, 32, 3)).astype(np.uint8))


def exif() -> Any:
    """Of a phone: with a thumbnail and a maker's note."""
    found = Image.Exif()
    found[271], found[272], found[274], found[305] = "Phone", "Model 9", 6, "Camera app"
    found[34665] = {
        33434: RATIONAL(1, 250), 33437: RATIONAL(18, 10), 34855: 64, 36867: "2026:01:02 03:04:05", 36881: "+01:00",
        37386: RATIONAL(425, 100), 37500: b"MAKER" + SECRET, 40962: 32, 42036: "Main lens", 41989: 26,
    }  # fmt: skip
    place = (RATIONAL(52), RATIONAL(30), RATIONAL(36, 10))
    found[34853] = {1: "S", 2: place, 3: "W", 4: (13.0, 24.0, 0.0), 5: b"\1", 6: RATIONAL(125, 10)}
    return found


def with_thumbnail(content: bytes) -> bytes:
    """Exif with a second directory, which has a thumbnail, as cameras write it."""
    order = "<" if content[:2] == b"II" else ">"
    first = struct.unpack_from(order + "I", content, 4)[0]
    count = struct.unpack_from(order + "H", content, first)[0]
    second = len(content)
    changed = bytearray(content)
    struct.pack_into(order + "I", changed, first + 2 + 12 * count, second)
    entries = [(0x0201, 4, 1, second + 30), (0x0202, 4, 1, len(SECRET))]
    changed += struct.pack(order + "H", 2) + b"".join(struct.pack(order + "HHII", *e) for e in entries) + bytes(4)
    return bytes(changed) + SECRET


def in_file(kind: str) -> bytes:
    """A picture with all of it, as another program writes it."""
    stream = io.BytesIO()
    raw = exif().tobytes().removeprefix(b"Exif\0\0")
    if kind == "PNG":
        from PIL.PngImagePlugin import PngInfo

        info = PngInfo()
        info.add_itxt("XML:com.adobe.xmp", DRONE.decode(), zip=True)
        picture().save(stream, "PNG", icc_profile=PROFILE, exif=with_thumbnail(raw), pnginfo=info, dpi=(300, 300))
    elif kind == "TIFF":
        from PIL.TiffImagePlugin import ImageFileDirectory_v2

        info, own = ImageFileDirectory_v2(), exif()
        for tag in (271, 272, 274, 305, 34665, 34853):
            info[tag] = own[tag]
        info[700] = DRONE
        picture().save(stream, "TIFF", icc_profile=PROFILE, tiffinfo=info)
    else:
        options = {"icc_profile": PROFILE, "exif": b"Exif\0\0" + with_thumbnail(raw), "xmp": DRONE}
        picture().save(stream, kind, **options)
    return stream.getvalue()


def plain_png(grey: bool = False) -> bytes:
    shape = (24, 32) if grey else (24, 32, 3)
    done, content = cv2.imencode(".png", np.random.default_rng(1).integers(0, 65536, shape).astype(np.uint16))
    assert done
    return content.tobytes()


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF", "WEBP"])
def test_profile_camera_place_and_notes_go_into_a_png(kind: str) -> None:
    plain = plain_png()
    found = metadata_of(in_file(kind)).in_png(plain)
    assert SECRET not in found and b"MAKER" not in found  # neither thumbnail nor maker's note
    pixels = [cv2.imdecode(np.frombuffer(c, np.uint8), cv2.IMREAD_UNCHANGED) for c in (plain, found)]
    np.testing.assert_array_equal(*pixels)
    again = Image.open(io.BytesIO(found))
    assert again.info["icc_profile"] == PROFILE
    told, own = again.getexif(), exif()
    for tag in (271, 272, 274, 305):
        assert told[tag] == own[tag]
    assert 37500 not in told.get_ifd(34665) and not told.get_ifd(1)
    for tag in (33434, 33437, 34855, 36867, 36881, 37386, 40962, 42036, 41989):
        assert told.get_ifd(34665)[tag] == own[34665][tag], tag
    assert told.get_ifd(34853)[2] == own[34853][2] and told.get_ifd(34853)[1] == "S"
    assert again.info["XML:com.adobe.xmp"].encode() == DRONE


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF", "WEBP"])
def test_facts_of_a_photograph(kind: str) -> None:
    found = exif_facts(metadata_of(in_file(kind)).exif)
    assert (found.make, found.model, found.lens, found.iso) == ("Phone", "Model 9", "Main lens", 64)
    assert (found.exposure_s, found.f_number, found.focal_mm) == pytest.approx((1 / 250, 1.8, 4.25))
    assert (found.taken, found.utc_offset_s) == ("2026:01:02 03:04:05", 3600)
    assert (found.latitude, found.longitude, found.altitude_m) == pytest.approx((-52.501, -13.4, -12.5))
    assert not found.adobe_rgb


def test_chunks_of_a_png_go_along_and_a_profile_takes_the_place_of_srgb() -> None:
    plain = plain_png()
    body = plain[33:]
    gamma, physical = chunk(b"gAMA", struct.pack(">I", 45455)), chunk(b"pHYs", struct.pack(">IIB", 11811, 11811, 1))
    source = plain[:33] + chunk(b"sRGB", b"\0") + gamma + physical + chunk(b"tEXt", b"Comment\0hello") + body
    found = metadata_of(source).in_png(plain)
    assert gamma in found and physical in found and chunk(b"sRGB", b"\0") in found and b"hello" not in found
    both = Metadata(PROFILE, chunks=metadata_of(source).chunks).in_png(plain)
    assert b"iCCP" in both and b"sRGB" not in both.replace(PROFILE, b"")
    assert metadata_of(source).of_color.in_png(plain).count(b"pHYs") == 0
    assert metadata_of(both).in_png(both) == both  # nothing twice


def test_a_profile_of_other_pictures_is_left_out() -> None:
    assert b"iCCP" not in Metadata(profile("Press", None, kind=b"CMYK")).in_png(plain_png())
    assert b"iCCP" not in Metadata(PROFILE).in_png(plain_png(grey=True))
    assert b"iCCP" in Metadata(profile("Grey", None, kind=b"GRAY")).in_png(plain_png(grey=True))


def test_without_anything_a_png_is_as_it_was() -> None:
    plain = plain_png()
    assert metadata_of(plain).in_png(plain) is plain and not metadata_of(plain)
    assert not metadata_of(b"") and not metadata_of(b"BM" + bytes(60))


def test_a_profile_in_pieces_is_whole_or_none() -> None:
    content = in_file("JPEG")
    start = content.index(b"ICC_PROFILE\0") - 4
    size = int.from_bytes(content[start + 2 : start + 4], "big") + 2
    body = content[start + 18 : start + size]

    def piece(number: int, count: int, part: bytes) -> bytes:
        return b"\xff\xe2" + struct.pack(">H", len(part) + 16) + b"ICC_PROFILE\0" + bytes((number, count)) + part

    two = piece(2, 2, body[100:]) + piece(1, 2, body[:100])
    assert metadata_of(content[:start] + two + content[start + size :]).profile == PROFILE
    one = piece(1, 2, body[:100])
    assert metadata_of(content[:start] + one + content[start + size :]).profile is None


def test_a_packed_profile_without_end_takes_no_memory() -> None:
    bomb = zlib.compress(bytes(1 << 26), 9)
    plain = plain_png()
    source = plain[:33] + chunk(b"iCCP", b"x\0\0" + bomb) + plain[33:]
    assert metadata_of(source).profile is None


GOOGLE = "http://ns.google.com/photos/1.0"


@pytest.mark.parametrize(
    ("inside", "stays"),
    [
        (f'xmlns:GImage="{GOOGLE}/image/" GImage:Data="SECRET" xmlns:a="urn:a" a:kept="KEPT"', True),
        (f'xmlns:GDepth="{GOOGLE}/depthmap/" GDepth:Data="SECRET" xmlns:a="urn:a" a:kept="KEPT"', True),
        (f'xmlns:GCamera="{GOOGLE}/camera/" GCamera:MotionPhoto="SECRET" xmlns:a="urn:a" a:kept="KEPT"', True),
        (
            'xmlns:xmpNote="http://ns.adobe.com/xmp/note/" xmpNote:HasExtendedXMP="SECRET" xmlns:a="urn:a" a:kept="KEPT"',
            True,
        ),
    ],
)
def test_notes_that_show_or_miss_the_photograph_are_left_out(inside: str, stays: bool) -> None:
    packet = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><r:RDF xmlns:r="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f"<r:Description {inside}>"
        '<xmp:Thumbnails xmlns:xmp="http://ns.adobe.com/xap/1.0/"><r:Alt><r:li>SECRET</r:li></r:Alt></xmp:Thumbnails>'
        "</r:Description></r:RDF></x:xmpmeta>"
    )
    found = cleaned_xmp(packet.encode())
    assert found is not None and b"SECRET" not in found and (b'a:kept="KEPT"' in found) == stays


@pytest.mark.parametrize(
    "packet",
    [
        b"no XML",
        b"<a>",
        b"\xff\xfe<\0a\0/\0>\0",
        b'<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>',
        b"<a/>" + b" " * (1 << 19),
        b"<a>" * 2000 + b"Thumbnails" + b"</a>" * 2000,
    ],
)
def test_notes_that_are_none_are_left_out(packet: bytes) -> None:
    assert cleaned_xmp(packet) is None


def test_adobe_rgb_without_a_profile_is_told_by_the_camera() -> None:
    found = Image.Exif()
    found[34665] = {40961: 65535, 40965: {1: "R03", 2: b"0100"}}
    assert exif_facts(cleaned_exif(found.tobytes().removeprefix(b"Exif\0\0"))).adobe_rgb


@settings(max_examples=200)
@given(at=st.integers(0, 900), noise=st.binary(min_size=1, max_size=12), cut=st.integers(0, 12))
@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF", "WEBP"])
def test_damaged_files_have_less_and_never_fail(kind: str, at: int, noise: bytes, cut: int) -> None:
    whole = in_file(kind)
    found = metadata_of(whole[:at] + noise + whole[at + cut :])
    assert isinstance(exif_facts(found.exif), Exif)
    again = found.in_png(plain_png())
    assert metadata_of(again).profile == found.profile
    if kind == "PNG":  # whose parts say whether they are sound
        assert SECRET not in again
