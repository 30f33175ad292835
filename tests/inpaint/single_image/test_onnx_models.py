"""Networks in ONNX files: what they are given, what is taken of their answers, and one line for each that is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from onnx import TensorProto, helper

from tests.inpaint import networks
from tests.inpaint.networks import BOOL, FLOAT, HALF, images, save
from tests.pavement import box
from unveil_core.base.errors import SettingsError
from unveil_core.inpaint.single_image.onnx_models import load_reference, load_single_image
from unveil_core.inpaint.single_image.registry import fill_around, inpainter

KNOWN = {
    "fixed": lambda p: networks.mean_fill(p, 64, 64),
    "free": networks.mean_fill,
    "wide": lambda p: networks.mean_fill(p, None, 48),
    "to 255": networks.mean_fill_255,
    "bytes, channels last": networks.mean_fill_bytes_last,
    "four channels": networks.mean_fill_four_channels,
    "four channels, fixed": lambda p: networks.mean_fill_four_channels(p, 64, 80),
    "multiple of 32": lambda p: networks.halving(p, 5),
    "blur": lambda p: networks.blur(p, 4),
    "blur, fixed": lambda p: networks.blur(p, 4, 64, 64),
}
EVERY = pytest.mark.parametrize("kind", KNOWN)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = tmp_path_factory.mktemp("networks")
    for name, make in KNOWN.items():
        make(where / f"{name}.onnx")
    networks.from_reference(where / "reference.onnx")
    networks.from_reference(where / "reference, fixed.onnx", 64, 64, name="exemplar_image")
    return where


def smooth(height: int, width: int) -> np.ndarray:
    y, x = np.mgrid[:height, :width]
    return np.stack([90 + x % 100 / 2, 120 + y % 100 / 2, 0 * x + 60], axis=-1).astype(np.uint8)


# ------------------------------------------------------------------------------------------------------------- what is filled


@EVERY
def test_holes_are_filled_from_what_is_known_and_the_rest_stays(kind: str, folder: Path) -> None:
    image = np.full((70, 90, 3), (200, 120, 30), np.uint8)
    mask = box(image.shape, 20, 26, 30, 37) | box(image.shape, 66, 70, 86, 90)
    noise = np.random.default_rng(0).integers(0, 255, image.shape).astype(np.uint8)
    result = load_single_image(folder / f"{kind}.onnx")(np.where(mask[..., None], noise, image), mask)
    assert result.dtype == np.uint8 and np.abs(result.astype(int) - image).max() <= 1
    assert np.array_equal(result[~mask], image[~mask])


@EVERY
def test_the_same_bytes_again_and_from_another_session(kind: str, folder: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (75, 130, 3)).astype(np.uint8)
    mask = np.random.default_rng(1).random((75, 130)) < 0.2
    first = load_single_image(folder / f"{kind}.onnx")
    expected = first(image, mask)
    assert np.array_equal(first(image, mask), expected)
    assert np.array_equal(load_single_image(folder / f"{kind}.onnx")(image, mask), expected)


@EVERY
def test_any_size_and_any_mask(kind: str, folder: Path) -> None:
    fill = load_single_image(folder / f"{kind}.onnx")

    @settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
    @given(st.integers(1, 150), st.integers(1, 150), st.sampled_from((0.0, 0.02, 0.5, 1.0)), st.integers(0, 99))
    def check(height: int, width: int, share: float, seed: int) -> None:
        rng = np.random.default_rng(seed)
        image = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
        mask = rng.random((height, width)) < share
        before = image.copy()
        result = fill(image, mask)
        assert result.shape == image.shape and result.dtype == np.uint8 and result is not image
        assert np.array_equal(result[~mask], image[~mask]) and np.array_equal(image, before)
        # What lies under the mask does not matter.
        assert np.array_equal(fill(np.where(mask[..., None], 7, image).astype(np.uint8), mask), result)

    check()


def test_a_hole_is_seen_with_its_own_surroundings_at_full_resolution(folder: Path) -> None:
    """A network of 64x64 on a picture of 200x300: red surroundings here, blue there, and nothing is made smaller."""
    image = np.zeros((200, 300, 3), np.uint8)
    image[:, :150], image[:, 150:] = (200, 0, 0), (0, 0, 200)
    image[::2, :, 1] = 255  # would be grey if it were made smaller
    mask = box(image.shape, 50, 58, 40, 48) | box(image.shape, 150, 158, 250, 258)
    result = load_single_image(folder / "blur, fixed.onnx")(image, mask)
    for part, colour in ((np.s_[50:58, 40:48], (200, 0, 0)), (np.s_[150:158, 250:258], (0, 0, 200))):
        assert np.abs(result[part][..., [0, 2]].astype(int) - np.array(colour)[[0, 2]]).max() <= 1
    mean = load_single_image(folder / "fixed.onnx")(image, mask)
    assert (mean[55, 45] == mean[52, 47]).all() and mean[55, 45, 0] == 200 and mean[155, 255, 2] == 200


def test_a_hole_larger_than_the_window_is_made_smaller(folder: Path) -> None:
    image = smooth(300, 400)
    mask = box(image.shape, 60, 200, 80, 300)
    result = load_single_image(folder / "fixed.onnx")(np.where(mask[..., None], 0, image).astype(np.uint8), mask)
    assert np.array_equal(result[~mask], image[~mask])
    assert (np.ptp(result[100:160, 120:260].reshape(-1, 3), axis=0) <= 1).all() and result[130, 190, 2] == 60


def test_half_precision_and_masks_of_bool(tmp_path: Path) -> None:
    inputs = [("image", HALF, (1, 3, None, None)), ("hole", BOOL, (1, 1, None, None))]
    nodes = [
        helper.make_node("Cast", ["image"], ["wide"], to=FLOAT),
        helper.make_node("Cast", ["hole"], ["holes"], to=FLOAT),
        *networks.mean_nodes("wide", "holes", "filled"),
        helper.make_node("Cast", ["filled"], ["out"], to=HALF),
    ]
    path = save(tmp_path / "half.onnx", inputs, nodes, constants=networks.MEAN, kind=HALF)
    image = np.full((40, 50, 3), (10, 200, 60), np.uint8)
    mask = box(image.shape, 10, 20, 10, 20)
    assert np.abs(load_single_image(path)(image, mask).astype(int) - image).max() <= 1


def test_of_several_answers_the_image_is_taken(tmp_path: Path) -> None:
    nodes = [*networks.mean_nodes(out="picture"), helper.make_node("Identity", ["mask"], ["attention"])]
    path = save(tmp_path / "two.onnx", images(), nodes, constants=networks.MEAN, outputs=("attention", "picture"))
    image = np.full((40, 50, 3), (10, 200, 60), np.uint8)
    assert np.abs(load_single_image(path)(image, box(image.shape, 5, 9, 5, 9)).astype(int) - image).max() <= 1


def test_networks_find_their_surroundings_themselves(folder: Path) -> None:
    fill = inpainter(str(folder / "blur.onnx"))
    image, mask = smooth(90, 120), box((90, 120), 40, 50, 40, 55)
    assert np.array_equal(fill_around(fill, image, mask), fill(image, mask))


@pytest.mark.parametrize("name", ["reference", "reference, fixed"])
def test_a_reference_is_laid_beside_the_image(name: str, folder: Path) -> None:
    fill = load_reference(folder / f"{name}.onnx")
    image, reference = np.zeros((128, 128, 3), np.uint8), np.zeros((128, 128, 3), np.uint8)
    reference[:64], reference[64:] = (250, 0, 0), (0, 0, 250)
    mask = box(image.shape, 30, 50, 30, 60) | box(image.shape, 90, 110, 10, 60)
    result = fill(image, mask, reference)
    assert not result[~mask].any()
    assert (result[34:46, 34:56] == (250, 0, 0)).all() and (result[94:106, 14:56] == (0, 0, 250)).all()


def test_references_of_other_sizes(folder: Path) -> None:
    fill = load_reference(folder / "reference, fixed.onnx")
    for shape in ((20, 30), (64, 64), (200, 90), (1, 1)):
        reference = np.full((*shape, 3), (9, 99, 199), np.uint8)
        image, mask = smooth(100, 50), box((100, 50), 10, 30, 10, 30)
        result = fill(image, mask, reference)
        assert np.array_equal(result[~mask], image[~mask]) and (result[14:26, 14:26] == (9, 99, 199)).all()
    assert np.array_equal(fill(image, mask & False, reference), image)
    # A smaller picture of the same place is laid over it.
    place = np.zeros((60, 40, 3), np.uint8)
    place[20:40, 10:30] = 255
    image, mask = np.zeros((120, 80, 3), np.uint8), np.ones((120, 80), bool)
    for name in ("reference", "reference, fixed"):
        result = load_reference(folder / f"{name}.onnx")(image, mask, place)
        assert (result[46:74, 26:54] > 240).all() and (result[:30] < 15).all() and (result[:, 70:] < 15).all()


# --------------------------------------------------------------------------------------------------------------- what is none


def refused(path: Path, load=load_single_image) -> str:
    with pytest.raises(SettingsError) as caught:
        load(path)
    line = str(caught.value)
    assert line.startswith(str(path)) and "\n" not in line and "image (1, 3, H, W)" in line or "reference" in line
    return line


@pytest.mark.parametrize(
    ("inputs", "said"),
    [
        ([("image", FLOAT, (1, 3, 64, 64))], "'image' (1, 3, 64, 64) float"),
        ([("a", FLOAT, (1, 3, 64, 64)), ("b", FLOAT, (1, 3, 64, 64))], "'a' (1, 3, 64, 64) float and 'b'"),
        ([*images(64, 64), ("noise", FLOAT, (1, 1, 64, 64))], "'noise'"),
        ([("image", FLOAT, (1, 3, 64, 64)), ("mask", FLOAT, (1, 1, 32, 32))], "different sizes"),
        ([("image", FLOAT, (1, 3, 64, 64)), ("mask", FLOAT, (1, 3, 64, 64))], "a mask has 1 channels, not 3"),
        ([("latent", FLOAT, (1, 9, 64, 64))], "'latent' (1, 9, 64, 64) float"),
        ([("image", FLOAT, (1, 3, 8, 8)), ("mask", FLOAT, (1, 1, 8, 8))], "fewer than 16 pixels"),
        ([("image", FLOAT, (4, 3, 64, 64)), ("mask", FLOAT, (4, 1, 64, 64))], "4 images at a time"),
        ([("image", FLOAT, (3, 64, 64)), ("mask", FLOAT, (64, 64))], "four dimensions"),
        ([("image", TensorProto.INT64, (1, 3, 64, 64)), ("mask", FLOAT, (1, 1, 64, 64))], "int64"),
        ([("image", BOOL, (1, 3, 64, 64)), ("mask", FLOAT, (1, 1, 64, 64))], "only a mask can be bool"),
        ([("image", TensorProto.STRING, (1,)), ("mask", FLOAT, (1, 1, 64, 64))], "string"),
        ([*images(64, 64), ("reference", FLOAT, (1, 3, 64, 64))], "--reference-inpainter"),
    ],
)
def test_wrong_inputs_are_reported(inputs: list, said: str, tmp_path: Path) -> None:
    path = save(
        tmp_path / "wrong.onnx", inputs, [helper.make_node("Identity", [inputs[0][0]], ["out"])], kind=inputs[0][1]
    )
    assert said in refused(path)


def test_wrong_answers_are_reported(tmp_path: Path) -> None:
    numbers = {
        **networks.MEAN,
        "nothing": np.array(np.nan, np.float32),
        "pads": np.array([0, 0, 0, 0, 0, 0, 0, 1], np.int64),
    }
    mean = networks.mean_nodes(out="filled")
    for name, last, said in (
        ("mask only", helper.make_node("Identity", ["mask"], ["out"]), "gives (1, 1, 64, 64)"),
        ("one number", helper.make_node("Identity", ["mean"], ["out"]), "gives (1, 3, 1, 1)"),
        ("wider", helper.make_node("Pad", ["filled", "pads"], ["out"]), "gives (1, 3, 64, 65)"),
        ("nan", helper.make_node("Mul", ["filled", "nothing"], ["out"]), "not finite"),
        ("other mask", helper.make_node("Mul", ["image", "known"], ["out"]), "leaves the hole black"),
    ):
        path = save(tmp_path / f"{name}.onnx", images(64, 64), [*mean, last], constants=numbers)
        assert said in refused(path), name
    seven = helper.make_node("Reshape", ["filled", "shape"], ["out"])  # of a size known only when it runs
    shape = {"shape": np.array([7], np.int64)}
    path = save(tmp_path / "fails.onnx", images(), [*mean, seven], constants={**numbers, **shape})
    assert "does not take (1, 3, 72, 72) and (1, 1, 72, 72): " in refused(path)


def test_values_that_are_not_finite_later_are_reported_too(tmp_path: Path) -> None:
    """Zero over zero, where nothing at all is known."""
    nodes = [
        helper.make_node("Sub", ["one", "mask"], ["known"]),
        helper.make_node("ReduceSum", ["known", "axes"], ["count"]),
        helper.make_node("ReduceSum", ["image", "axes"], ["light"]),
        helper.make_node("Div", ["light", "count"], ["mean"]),
        helper.make_node("Mul", ["image", "zero"], ["black"]),
        helper.make_node("Add", ["black", "mean"], ["out"]),
    ]
    fill = load_single_image(save(tmp_path / "fragile.onnx", images(), nodes, constants=networks.MEAN))
    with pytest.raises(SettingsError, match="fragile.onnx: gives values that are not finite"):
        fill(smooth(40, 40), np.ones((40, 40), bool))


def test_files_that_are_no_networks(tmp_path: Path) -> None:
    assert "No such file" in refused(tmp_path / "absent.onnx")
    (tmp_path / "folder.onnx").mkdir()
    assert "directory" in refused(tmp_path / "folder.onnx")
    whole = networks.mean_fill(tmp_path / "whole.onnx").read_bytes()
    for name, content in (("empty", b""), ("text", b"hello " * 50), ("cut", whole[: len(whole) // 2])):
        path = tmp_path / f"{name}.onnx"
        path.write_bytes(content)
        assert "cannot be loaded" in refused(path)


def test_a_reference_network_must_take_a_reference(folder: Path, tmp_path: Path) -> None:
    assert "takes no reference: give it with --inpainter" in refused(folder / "free.onnx", load_reference)
    two = [*images(64, 64), ("other", FLOAT, (1, 3, 64, 64))]
    path = save(tmp_path / "two.onnx", two, [helper.make_node("Identity", ["other"], ["out"])])
    assert "none is called reference" in refused(path, load_reference)


def test_wrong_pictures_are_refused(folder: Path) -> None:
    fill = load_single_image(folder / "free.onnx")
    with pytest.raises(ValueError, match="uint8"):
        fill(smooth(40, 40).astype(np.float64), np.zeros((40, 40), bool))
    with pytest.raises(ValueError, match="does not fit"):
        fill(smooth(40, 40), np.zeros((3, 3), bool))
