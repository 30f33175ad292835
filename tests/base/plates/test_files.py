"""Plates in and out: what is not touched stays bit for bit, with all that the file says of itself."""

from __future__ import annotations

import resource
import struct
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from tests.base.plates.plates import HEIGHT, WIDTH, attributes, light, oiio, pixels, write, write_dpx, write_exr
from unveil_core.base.errors import DriveError
from unveil_core.base.plates.files import plate_facts, read_plate

MASK = np.zeros((HEIGHT, WIDTH), bool)
MASK[10:20, 5:30] = True
NEW = np.linspace(0, 3, 3 * int(MASK.sum())).reshape(-1, 3)


@pytest.mark.parametrize("half", [True, False])
@pytest.mark.parametrize("compression", ["none", "zips", "piz", "dwaa", "b44"])
def test_exr_keeps_what_is_not_touched(tmp_path: Path, half: bool, compression: str) -> None:
    path = write_exr(tmp_path / "a.exr", light(), half=half, compression=compression)
    read_plate(path).replaced(MASK, NEW).write(tmp_path / "b.exr")
    before, after = pixels(path), pixels(tmp_path / "b.exr")
    changed = np.zeros(before.shape, bool)
    changed[MASK, :4] = True
    np.testing.assert_array_equal(before[~changed].view(np.uint32), after[~changed].view(np.uint32))
    np.testing.assert_allclose(after[MASK][:, :3], NEW, rtol=1e-3 if half else 1e-7)
    assert (after[MASK][:, 3] == 1).all()
    lossless = compression if compression in ("none", "zips", "piz") else "zip"
    told = attributes(path) | {"compression": lossless}
    found = attributes(tmp_path / "b.exr")
    told.pop("oiio:RowsPerChunk", None), found.pop("oiio:RowsPerChunk", None)  # follow from the compression
    assert found == told and told["smpte:TimeCode"] == (0x01020304, 0)
    ids = [pixels(p, oiio.UINT)[..., 5] for p in (path, tmp_path / "b.exr")]
    np.testing.assert_array_equal(*ids)
    assert [str(s) for s in oiio.ImageInput.open(str(tmp_path / "b.exr")).spec().channelformats] == [
        str(s) for s in oiio.ImageInput.open(str(path)).spec().channelformats
    ]


@pytest.mark.parametrize("little", [True, False])
@pytest.mark.parametrize(("bits", "transfer"), [(10, "Printing density"), (12, "Linear"), (16, "ITU-R 709-4")])
def test_dpx_keeps_what_is_not_touched(tmp_path: Path, bits: int, transfer: str, little: bool) -> None:
    codes = np.random.default_rng(0).integers(0, 1 << bits, (HEIGHT, WIDTH, 3)).astype(np.uint16)
    path = write_dpx(tmp_path / "a.dpx", codes, bits=bits, transfer=transfer, little=little)
    plate = read_plate(path)
    assert plate.facts.bits == bits
    np.testing.assert_allclose(plate.values, codes / ((1 << bits) - 1), atol=1e-7)
    new = np.linspace(0, 1, NEW.size).reshape(-1, 3)
    plate.replaced(MASK, new).write(tmp_path / "b.dpx")
    again = read_plate(tmp_path / "b.dpx")
    found = np.round(again.values * ((1 << bits) - 1)).astype(np.uint16)
    np.testing.assert_array_equal(found[~MASK], codes[~MASK])
    np.testing.assert_array_equal(found[MASK], np.round(new * ((1 << bits) - 1)))
    own, made = path.read_bytes(), (tmp_path / "b.dpx").read_bytes()
    assert own[:2048] == made[:2048] and len(own) == len(made)
    plate.replaced(np.zeros_like(MASK), new[:0]).write(tmp_path / "c.dpx")
    assert (tmp_path / "c.dpx").read_bytes() == own


def test_a_part_of_the_picture_may_have_data(tmp_path: Path) -> None:
    """A data window that is cropped on one side and goes over on the other."""
    spec = oiio.ImageSpec(WIDTH, HEIGHT, 3, oiio.HALF)
    spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height = 10, -5, 0, 0, 60, 40
    path = write(tmp_path / "a.exr", spec, light())
    plate = read_plate(path)
    assert plate.values.shape == (40, 60, 3) and not plate.values[:, :10].any()
    np.testing.assert_array_equal(plate.values[:37, 10:], pixels(path)[5:, :50])
    mask = np.zeros((40, 60), bool)
    mask[:8, 5:20] = True
    plate.replaced(mask, np.full((mask.sum(), 3), 0.25)).write(tmp_path / "b.exr")
    found = read_plate(tmp_path / "b.exr").values
    assert (found[:8, 10:20] == 0.25).all()
    np.testing.assert_array_equal(found[~mask], plate.values[~mask])
    np.testing.assert_array_equal(pixels(tmp_path / "b.exr")[:5], pixels(path)[:5])


def test_several_parts_and_layers(tmp_path: Path) -> None:
    first, second = (oiio.ImageSpec(WIDTH, HEIGHT, 3, kind) for kind in (oiio.FLOAT, oiio.HALF))
    first.channelnames, second.channelnames = ("N.X", "N.Y", "N.Z"), ("beauty.B", "beauty.G", "beauty.R")
    first["name"], second["name"] = "normals", "beauty"
    path = tmp_path / "a.exr"
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), (first, second)) and output.write_image(light(1))
    assert output.open(str(path), second, "AppendSubimage") and output.write_image(light(2)) and output.close()
    plate = read_plate(path)
    np.testing.assert_array_equal(plate.values, light(2).astype(np.float16).astype(np.float32)[..., ::-1])
    plate.replaced(MASK, NEW).write(tmp_path / "b.exr")
    again = read_plate(tmp_path / "b.exr")
    np.testing.assert_array_equal(pixels(tmp_path / "b.exr"), light(1))
    np.testing.assert_allclose(again.values[MASK], NEW, rtol=1e-3)
    np.testing.assert_array_equal(again.values[~MASK], plate.values[~MASK])


def test_large_ids_are_kept(tmp_path: Path) -> None:
    """Whole numbers that floating point does not hold."""
    planes = {n: light()[..., k].astype(np.float16) for k, n in enumerate("RGB")}
    ids = np.arange(WIDTH * HEIGHT, dtype=np.uint32).reshape(HEIGHT, WIDTH) + np.uint32(1 << 31)
    path = tmp_path / "a.exr"
    OpenEXR.File({"compression": OpenEXR.ZIPS_COMPRESSION}, {**planes, "id": ids}).write(str(path))
    read_plate(path).replaced(MASK, NEW).write(tmp_path / "b.exr")
    found = OpenEXR.File(str(tmp_path / "b.exr"), separate_channels=True).channels()
    np.testing.assert_array_equal(found["id"].pixels, ids)


def test_grey_plates(tmp_path: Path) -> None:
    spec = oiio.ImageSpec(WIDTH, HEIGHT, 1, oiio.HALF)
    spec.channelnames = ("Y",)
    path = write(tmp_path / "a.exr", spec, light()[..., :1])
    plate = read_plate(path)
    plate.replaced(MASK, np.full((MASK.sum(), 3), 0.5)).write(tmp_path / "b.exr")
    found = read_plate(tmp_path / "b.exr").values
    assert np.allclose(found[MASK], 0.5, atol=1e-3)
    np.testing.assert_array_equal(found[~MASK], plate.values[~MASK])


def test_the_header_is_enough_for_the_size(tmp_path: Path) -> None:
    path = write_exr(tmp_path / "a.exr", light())
    facts = plate_facts(path)
    assert facts.kind == "openexr" and facts.size == (WIDTH, HEIGHT) and facts.pixel_aspect == 2.0
    with pytest.raises(DriveError, match="Not the size of its camera: 65x42 pixels, the camera says 64x42"):
        read_plate(path, (64, 42))


@pytest.mark.parametrize(
    ("width", "why"), [(2_000_000, "has more pixels and layers than are read"), (500_000, "claims 126,000,000 values")]
)
def test_what_a_header_claims_is_bounded_before_memory_is_taken(width: int, why: str, tmp_path: Path) -> None:
    path = write_exr(tmp_path / "a.exr", light())
    content = bytearray(path.read_bytes())
    for window in (b"dataWindow", b"displayWindow"):
        at = content.index(window) + len(window) + len(b"\0box2i\0") + 4
        content[at : at + 16] = struct.pack("<4i", 0, 0, width - 1, HEIGHT - 1)
    path.write_bytes(content)
    assert plate_facts(path).size == (width, HEIGHT)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(DriveError, match=why):
        read_plate(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < before + 50_000


def test_what_cannot_be_kept_is_told(tmp_path: Path) -> None:
    spec = oiio.ImageSpec(WIDTH, HEIGHT, 2, oiio.FLOAT)
    spec.channelnames = ("N.X", "N.Y")
    with pytest.raises(DriveError, match=r"no channels R, G and B, but N\.X, N\.Y"):
        read_plate(write(tmp_path / "a.exr", spec, light()[..., :2]))
    spec = oiio.ImageSpec(WIDTH, HEIGHT, 6, oiio.HALF)
    spec.channelnames = tuple(f"{layer}.{c}" for layer in ("Combined", "Diffuse") for c in "RGB")
    with pytest.raises(DriveError, match="has 2 layers of colours: Combined, Diffuse"):
        read_plate(write(tmp_path / "b.exr", spec, np.concatenate([light(), light()], axis=2)))
    path = write_exr(tmp_path / "c.exr", light(), compression="none")
    path.write_bytes(path.read_bytes()[:4000])
    with pytest.raises(DriveError, match=r"c\.exr: (Damaged|cannot be read)"):
        read_plate(path)
    (tmp_path / "d.exr").write_bytes(b"no plate")
    with pytest.raises(DriveError, match="Not an OpenEXR or DPX file"):
        read_plate(tmp_path / "d.exr")
    with pytest.raises(DriveError, match="Not found"):
        plate_facts(tmp_path / "gone.exr")


def test_without_the_library_one_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For DPX; the one for EXR is always there."""
    codes = np.zeros((HEIGHT, WIDTH, 3), np.uint16)
    path = write_dpx(tmp_path / "a.dpx", codes, bits=10, transfer="Linear")
    monkeypatch.setattr("unveil_core.base.plates.library.find_spec", lambda _: None)
    with pytest.raises(
        DriveError, match=r"a\.dpx: Not installed: OpenImageIO, which reads DPX files \(pip install '\.\[plates\]'"
    ):
        read_plate(path)
