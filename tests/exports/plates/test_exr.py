"""The plates as OpenEXR reads them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from scipy.ndimage import map_coordinates

from tests.exports.conftest import Street
from tests.exports.street import HEIGHT, LARGER, WIDTH, WORLD
from tests.exports.variants import Entry, variant
from unveil_core.app.cli import main
from unveil_core.base.pictures.decoding import read_instance_image
from unveil_core.base.srgb import linear_of_srgb
from unveil_core.delivery.lens import work_positions
from unveil_core.workspace.files import load_mask

MATTES = ["car_0001.A", "car_0002.A"]


@pytest.fixture(scope="module")
def plate(street: Street) -> tuple[dict[str, np.ndarray], dict[str, object]]:
    with OpenEXR.File(str(street.exported("exr") / "front/front.1002.exr"), separate_channels=True) as file:
        return {name: c.pixels.copy() for name, c in file.channels().items()}, dict(file.header())


def test_colours_are_linear_and_named_so(street: Street, plate: tuple[dict[str, np.ndarray], dict]) -> None:  # type: ignore[type-arg]
    channels, header = plate
    assert header["colorInteropID"] == "lin_rec709_scene" and header["unveil:source"] == "front/0001"
    np.testing.assert_allclose(header["chromaticities"], [0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329], atol=1e-6)
    delivered = cv2.imread(str(street.root / "frames/front/0001.png"), cv2.IMREAD_UNCHANGED)[..., ::-1] / 65535
    linear = np.where(delivered <= 0.04045, delivered / 12.92, ((delivered + 0.055) / 1.055) ** 2.4)
    found = np.stack([channels[c] for c in "RGB"], axis=2)
    assert found.dtype == np.float16 and found.shape == (HEIGHT * LARGER, WIDTH * LARGER, 3)
    np.testing.assert_allclose(found, linear, rtol=2.0**-11, atol=1e-7)


def test_every_8_bit_value_comes_back_from_half_precision() -> None:
    half = linear_of_srgb(np.arange(256) / 255).astype(np.float16).astype(np.float64)
    back = np.where(half <= 0.0031308, half * 12.92, 1.055 * half ** (1 / 2.4) - 0.055)
    np.testing.assert_array_equal(np.round(back * 255), np.arange(256))


def test_layers_lie_in_the_lens_of_the_footage(street: Street, plate: tuple[dict[str, np.ndarray], dict]) -> None:  # type: ignore[type-arg]
    channels, _ = plate
    assert set(channels) == {
        *"RGB", *MATTES, "removed.A", "provenance.Y", "certainty.Y", "depth.Z", "normal.X", "normal.Y", "normal.Z",
    }  # fmt: skip
    frame = street.job.drive.frames[1]
    assert frame.footage is not None and frame.instance_path is not None
    at = np.moveaxis(work_positions(frame.footage, frame.camera) - 0.5, 2, 0)[::-1].astype(np.float64)
    inside = ((at >= 0) & (at <= np.array([HEIGHT - 1, WIDTH - 1])[:, None, None])).all(axis=0)
    ids = read_instance_image(frame.instance_path)
    removed = load_mask(street.root / "masks/removed/front/0001.png")
    origins = cv2.imread(str(street.root / "provenance/front/0001.png"), cv2.IMREAD_UNCHANGED)
    for name, plane in (("car_0001.A", ids == 1), ("car_0002.A", ids == 2), ("removed.A", removed)):
        expected = map_coordinates(plane.astype(np.float64), at, order=1)
        np.testing.assert_allclose(channels[name][inside], expected[inside], atol=0.05)  # OpenCV's steps of 1/32 px
        assert 0.002 < channels[name].mean() < 0.5
    nearest = origins[
        tuple(np.clip(np.round(at), 0, None).astype(int)[k].clip(0, s - 1) for k, s in enumerate(ids.shape))
    ]
    assert (channels["provenance.Y"][inside] == nearest[inside]).mean() > 0.97


def test_depth_and_normal_are_those_of_the_empty_street(
    street: Street, plate: tuple[dict[str, np.ndarray], dict]
) -> None:  # type: ignore[type-arg]
    channels, _ = plate
    depth = channels["depth.Z"]
    assert depth.dtype == np.float32
    near = depth[-12:, 40:80] / WORLD.scale  # metres; the road before the car
    road = near[near > 0]
    assert len(road) > 100 and 2 < np.median(road) < 6
    normal = np.stack([channels[f"normal.{a}"] for a in "XYZ"], axis=2).astype(np.float64)
    length = np.linalg.norm(normal, axis=2)
    np.testing.assert_allclose(length[depth > 0], 1, atol=2e-3)
    assert not length[depth == 0].any() and (depth == 0).any()
    below = normal[-12:, 40:80][near > 0]
    assert np.median(below[:, 1]) > 0.7  # a road's normal is up


def test_without_instance_images_mattes_come_from_the_scene(street: Street, tmp_path: Path) -> None:
    root = tmp_path / "workspace"
    shutil.copytree(street.root, root)
    path = root / "drive/cameras.json"
    data = json.loads(path.read_text())
    for entry in data["frames"]:
        del entry["instances"]
    path.write_text(json.dumps(data))
    assert main(["export", str(root), "--to", "exr", "-o", str(tmp_path)]) == 0
    with OpenEXR.File(str(tmp_path / "exr/front/front.1001.exr"), separate_channels=True) as file:
        found = {name: file.channels()[name].pixels.astype(np.float32) for name in MATTES}
    with OpenEXR.File(str(street.exported("exr") / "front/front.1001.exr"), separate_channels=True) as file:
        for name in MATTES:
            of_images = file.channels()[name].pixels.astype(np.float32)
            shared = np.minimum(found[name], of_images).sum()
            assert shared > 0.5 * of_images.sum() and shared > 0.5 * found[name].sum(), name


@pytest.mark.parametrize("case", ["one camera", "a rig", "an object without pixels"])
def test_all_frames_have_one_set_of_channels_with_names(case: str, street: Street, tmp_path: Path) -> None:
    """Programs take the channels of the first frame for all, and a layer that is a number for an index."""

    def edit(number: int, entry: Entry) -> None:
        if case == "a rig":
            entry["camera"] = ("front", "rear")[number % 2]
        for key in ("masks/removed", "provenance", "certainty"):
            (root / key / entry["camera"]).mkdir(parents=True, exist_ok=True)
            source = street.root / key / f"front/{entry['name']}.png"
            shutil.copy(source, root / key / entry["camera"] / source.name)

    root = tmp_path / "workspace"
    variant(street, root, edit)
    if case == "an object without pixels":
        entries = json.loads((root / "instances.json").read_text())
        (root / "instances.json").write_text(json.dumps([*entries, {**entries[0], "id": 9, "class": "bus"}]))
    assert main(["export", str(root), "--to", "exr", "-o", str(tmp_path)]) == 0
    found = set()
    for path in (tmp_path / "exr").rglob("*.exr"):
        with OpenEXR.File(str(path), separate_channels=True) as file:
            found.add(frozenset(file.channels()))
    (channels,) = found
    assert ("bus_0009.A" in channels) == (case == "an object without pixels")
    assert {"R", "G", "B", "depth.Z", "provenance.Y", *MATTES} <= channels
    assert not any(part.isdigit() for name in channels for part in name.split("."))
