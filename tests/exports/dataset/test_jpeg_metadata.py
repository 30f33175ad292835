"""A JPEG with profile and notes is read back with them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageCms

from unveil_core.base.pictures.decoding import read_metadata
from unveil_core.base.pictures.metadata import Metadata
from unveil_core.exports.dataset.jpeg_metadata import in_jpeg


def test_profile_and_notes_come_back(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 255, (16, 24, 3), dtype=np.uint8)
    encoded = cv2.imencode(".jpg", picture)[1].tobytes()
    exif = Image.Exif()
    exif[0x010F] = "Maker"
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    long = profile[:128] + b"\0" * 150_000  # in three segments
    path = tmp_path / "made.jpg"
    for own in (profile, long):
        path.write_bytes(in_jpeg(encoded, Metadata(own, exif.tobytes().removeprefix(b"Exif\0\0"), b"<x:xmpmeta/>")))
        with Image.open(path) as opened:
            assert opened.info["icc_profile"] == own and opened.getexif()[0x010F] == "Maker"
            assert np.array_equal(np.asarray(opened)[..., ::-1], cv2.imdecode(np.frombuffer(encoded, np.uint8), 1))
    assert read_metadata(path).profile == long
    assert in_jpeg(encoded, Metadata()) == encoded
