"""Footage that is not sRGB: plates say so, light is computed by its own curve, and what the camera noted goes along."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pytest

from tests.base.pictures.profiles import ADOBE, GAMMA, P3, SRGB, profile
from tests.base.pictures.test_metadata import in_file
from tests.exports.conftest import Street
from tests.exports.variants import Entry, variant
from unveil_core.app.cli import main
from unveil_core.base.pictures.metadata import Metadata, metadata_of
from unveil_core.drives.importing.colours import colour_notices
from unveil_core.exports.job import Job

NOTED = metadata_of(in_file("JPEG")).exif
PROFILES = {
    "P3": Metadata(profile("Display P3", P3), NOTED),
    "Adobe RGB": Metadata(profile("Adobe RGB (1998)", ADOBE, GAMMA(563 / 256)), NOTED),
    "a scanner": Metadata(profile("A scanner", None, more=[(b"A2B0", b"mft2" + bytes(40))], kind=b"RGB "), NOTED),
    "sRGB": Metadata(profile("sRGB", SRGB), NOTED),
}


def noted(street: Street, root: Path, *names: str) -> Job:
    """The workspace whose footage, and with it the delivered frames, have such profiles in turns."""
    job = variant(street, root, lambda number, entry: None)
    for number, frame in enumerate(job.drive.frames):
        assert frame.footage is not None
        metadata = PROFILES[names[number % len(names)]]
        for path in (frame.footage.path, job.delivered(frame)):
            path.write_bytes(metadata.in_png(path.read_bytes()))
    return Job(job.workspace)


def exported(job: Job, out: Path, name: str) -> tuple[Path, dict[str, Any]]:
    assert main(["export", str(job.workspace.root), "--to", name, "-o", str(out)]) == 0
    return out / name, json.loads((out / name / "export.json").read_text())


@pytest.mark.parametrize(
    ("name", "encoded", "linear", "corners", "gamma"),
    [
        ("P3", "srgb_p3d65_display", "lin_p3d65_scene", (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329), None),
        (
            "Adobe RGB",
            "g22_adobergb_display",
            "lin_adobergb_scene",
            (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.329),
            2.2,
        ),
        ("a scanner", "A scanner", "linear A scanner", None, None),
        ("sRGB", "srgb_rec709_display", "lin_rec709_scene", (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329), None),
    ],
)
def test_plates_say_what_their_colours_are(
    name: str,
    encoded: str,
    linear: str,
    corners: tuple[float, ...] | None,
    gamma: float | None,
    street: Street,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    job = noted(street, tmp_path / "workspace", name)
    folder, told = exported(job, tmp_path, "png")
    assert told["colorspace"] == encoded
    plate = folder / "front/front.1001.png"
    found = metadata_of(plate.read_bytes())
    assert found.profile == PROFILES[name].profile and found.exif == NOTED
    folder, told = exported(job, tmp_path, "exr")
    assert told["colorspace"] == linear
    assert ("how A scanner encodes light is not known" in capsys.readouterr().err) == (name == "a scanner")
    with OpenEXR.File(str(folder / "front/front.1001.exr"), separate_channels=True) as file:
        header = dict(file.header())
        light = np.stack([file.channels()[c].pixels for c in "RGB"], axis=2).astype(np.float64)
    assert header["unveil:colorspace"] == linear and header.get("colorInteropID", linear) == linear
    if corners is None:
        assert "chromaticities" not in header and "colorInteropID" not in header
    else:
        np.testing.assert_allclose(header["chromaticities"], corners, atol=1e-6)
    pixels = cv2.imread(str(plate), cv2.IMREAD_UNCHANGED)[..., ::-1] / 65535
    curve = np.where(pixels <= 0.04045, pixels / 12.92, ((pixels + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(light, curve if gamma is None else pixels**gamma, rtol=3e-3, atol=1e-4)


def test_exr_has_what_the_camera_noted(street: Street, tmp_path: Path) -> None:
    folder, _ = exported(noted(street, tmp_path / "workspace", "P3"), tmp_path, "exr")
    with OpenEXR.File(str(folder / "front/front.1002.exr")) as file:
        header = dict(file.header())
    assert (header["cameraMake"], header["cameraModel"], header["lensModel"]) == ("Phone", "Model 9", "Main lens")
    assert header["capDate"] == "2026:01:02 03:04:05" and header["utcOffset"] == -3600
    numbers = [header[n] for n in ("latitude", "longitude", "altitude", "expTime", "aperture", "isoSpeed")]
    np.testing.assert_allclose(numbers, [-52.501, -13.4, -12.5, 1 / 250, 1.8, 64], rtol=1e-6)
    assert header["nominalFocalLength"] == pytest.approx(4.25)


@pytest.mark.parametrize("name", ["P3", "Adobe RGB", "sRGB"])
def test_a_studio_s_light_is_that_of_the_colours(
    name: str, street: Street, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A configuration of OpenColorIO has one primaries for all: what the footage shows is the same in them."""
    pytest.importorskip("PyOpenColorIO")
    monkeypatch.setenv("OCIO", "ocio://cg-config-v2.2.0_aces-v1.3_ocio-v2.4")
    folder, told = exported(noted(street, tmp_path / "workspace", name), tmp_path, "exr")
    assert told["colorspace"] == "ACEScg"
    with OpenEXR.File(str(folder / "front/front.1001.exr"), separate_channels=True) as file:
        found = np.stack([file.channels()[c].pixels for c in "RGB"], axis=2).astype(np.float64)
    plate = cv2.imread(str(street.root / "frames/front/0000.png"), cv2.IMREAD_UNCHANGED)[..., ::-1] / 65535
    curve = np.where(plate <= 0.04045, plate / 12.92, ((plate + 0.055) / 1.055) ** 2.4)
    light = plate ** (563 / 256) if name == "Adobe RGB" else curve
    # From each to AP1 with Bradford's adaptation, as published for P3 and sRGB, and by the columns of the profiles.
    columns = {"P3": P3, "Adobe RGB": ADOBE, "sRGB": SRGB}[name]
    to_ap1 = np.array(
        [
            [0.61309732, 0.33952285, 0.04737928],
            [0.07019422, 0.91635557, 0.01345259],
            [0.0206156, 0.10956983, 0.86981512],
        ]
    )
    turn = to_ap1 @ np.linalg.solve(np.array(SRGB).T, np.array(columns).T)
    np.testing.assert_allclose(found, light @ turn.T, atol=4e-3)


@pytest.mark.parametrize(
    ("name", "space", "primaries"), [("P3", "p3d65", 12), ("Adobe RGB", "rec709", 1), ("sRGB", "rec709", 1)]
)
def test_movies_are_tagged_or_converted(name: str, space: str, primaries: int, street: Street, tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    job = variant(street, tmp_path / "workspace", lambda number, entry: None)
    green = np.zeros((96, 128, 3), np.uint16) + np.array([9000, 50000, 12000], np.uint16)
    for frame in job.drive.frames:
        assert frame.footage is not None
        done, content = cv2.imencode(".png", green[..., ::-1])
        for path in (frame.footage.path, job.delivered(frame)):
            path.write_bytes(PROFILES[name].in_png(content.tobytes()))
    folder, told = exported(Job(job.workspace), tmp_path, "prores")
    assert told["colorspace"] == space and done
    with av.open(str(folder / "front.mov")) as movie:
        stream = movie.streams.video[0]
        picture = next(movie.decode(stream))
        assert (picture.color_primaries, picture.colorspace) == (primaries, 1)
        shown = picture.reformat(format="rgb48le", src_colorspace="ITU709", dst_colorspace="ITU709").to_ndarray()[
            48, 64
        ]
        assert stream.average_rate == Fraction(10)
    own = green[0, 0] / 65535
    if name == "Adobe RGB":
        light = np.linalg.solve(np.array(SRGB).T, np.array(ADOBE).T) @ own ** (563 / 256)
        own = np.clip(
            np.where(light <= 0.0031308, light * 12.92, 1.055 * np.maximum(light, 0) ** (1 / 2.4) - 0.055), 0, 1
        )
        assert own[0] == 0  # more green than Rec. 709 has
    np.testing.assert_allclose(shown / 65535, own, atol=0.02)


def test_formats_that_cannot_say_it_are_named(
    street: Street, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = noted(street, tmp_path / "workspace", "P3")
    assert main(["export", str(job.workspace.root), "--to", "splat-ply,png,glb", "-o", str(tmp_path)]) == 0
    said = capsys.readouterr().err
    assert "splat-ply, glb: the colours are the footage's (srgb_p3d65_display); these files cannot say so" in said
    assert json.loads((tmp_path / "empty_splats.ply.json").read_text())["colorspace"] == "srgb_p3d65_display"


def test_undistorted_pictures_have_the_profile_too(street: Street, tmp_path: Path) -> None:
    job = noted(street, tmp_path / "workspace", "P3")
    assert main(["export", str(job.workspace.root), "--to", "colmap", "--undistorted", "-o", str(tmp_path)]) == 0
    found = metadata_of((tmp_path / "colmap/images/0000.png").read_bytes())
    assert found.profile == PROFILES["P3"].profile and found.exif == NOTED


@pytest.mark.parametrize(
    ("names", "notice"),
    [
        (["sRGB"], None),
        (["P3"], "the footage is Display P3, not sRGB: everything is done in its own colours"),
        (["Adobe RGB"], "the footage is Adobe RGB (1998), not sRGB"),
        (["a scanner"], "how it encodes light is not known here"),
        (["P3", "sRGB"], "several kinds of colours: Display P3 (camera front), sRGB (camera front); convert it to one"),
    ],
)
def test_what_is_not_srgb_is_told_at_import(
    names: list[str], notice: str | None, street: Street, tmp_path: Path
) -> None:
    found = colour_notices(noted(street, tmp_path / "workspace", *names).drive.frames)
    assert (not found) if notice is None else notice in "".join(found)


def test_each_camera_of_a_rig_is_looked_at(street: Street, tmp_path: Path) -> None:
    def rig(number: int, entry: Entry) -> None:
        entry["camera"] = ("front", "front", "rear")[number]

    job = variant(street, tmp_path / "workspace", rig)
    last = job.drive.frames[2]
    assert last.footage is not None
    last.footage.path.write_bytes(PROFILES["P3"].in_png(last.footage.path.read_bytes()))
    assert "sRGB (camera front), Display P3 (camera rear)" in colour_notices(job.drive.frames)[0]
