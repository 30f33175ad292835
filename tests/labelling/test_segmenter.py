"""Segmentation networks in ONNX files: labels at the image's size, whatever the network takes and gives; else one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from onnx import helper

from tests.drives.tiny_drive import make_tiny_drive
from tests.inpaint.networks import FLOAT, UINT8, save
from tests.labelling import segmentation_networks as nets
from tests.labelling.segmentation_networks import BUILDING, CAR, PERSON, ROAD, SKY, TRUCK, VEGETATION
from unveil_core.base.errors import SettingsError
from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives import open_drive
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.geometry.label_images import resize_labels
from unveil_core.labelling.segmenter import NO_LABELS_HELP, label_by_network, load_segmenter, segmenter_files
from unveil_core.semantics.classes import REMOVABLE

VOID = 255
COLOURS = {ROAD: (0, 0, 0), CAR: (255, 0, 0), VEGETATION: (0, 255, 0), SKY: (0, 0, 255)}


def patches(height: int, width: int, step: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """An image of squares of the four colours, and its classes."""
    y, x = np.mgrid[:height, :width] // step
    classes = np.array(list(COLOURS))[(x + 2 * y + x * y) % 4]
    image = np.zeros((height, width, 3), np.uint8)
    for number, colour in COLOURS.items():
        image[classes == number] = colour
    return image, classes


KNOWN = {
    "logits": nets.logits,
    "logits at full size": lambda p: nets.logits(p, stride=1),
    "logits, fixed": lambda p: nets.logits(p, 96, 128),
    "logits, one side fixed": lambda p: nets.logits(p, 96),
    "channels last": nets.logits_last,
    "channels last, fixed": lambda p: nets.logits_last(p, 64, 64),
    "probabilities": nets.probabilities,
    "labels": lambda p: nets.label_map(p, keep=False),
    "labels, four axes": lambda p: nets.label_map(p, keep=True),
    "labels, fixed": lambda p: nets.label_map(p, keep=True, size=64),
}


@pytest.mark.parametrize("kind", KNOWN)
@pytest.mark.parametrize("size", [(128, 192), (64, 64), (96, 320)])
def test_each_pixel_gets_its_class(kind: str, size: tuple[int, int], tmp_path: Path) -> None:
    segmenter = load_segmenter(KNOWN[kind](tmp_path / "net.onnx"))
    image, classes = patches(*size)
    labels = segmenter.segment(image)
    assert labels.semantic.dtype == np.uint8 and labels.semantic.shape == size and labels.instance is None
    scaled = "fixed" in kind and size != (64, 64)
    # Borders of what is seen at a quarter are round where three classes meet.
    assert (labels.semantic == classes).mean() > (0.9 if scaled else 0.995 if "logits" in kind else 0.999)
    assert segmenter.whole_street and not segmenter.has_instances and "(cityscapes)" in segmenter.summary


@pytest.mark.parametrize("size", [(1, 1), (7, 500), (333, 41)])
def test_any_size(size: tuple[int, int], tmp_path: Path) -> None:
    image = np.full((*size, 3), (255, 0, 0), np.uint8)
    for height, width in ((None, None), (64, 96)):
        path = nets.logits(tmp_path / "net.onnx", height, width)
        assert (load_segmenter(path).segment(image).semantic == CAR).all()


def test_maskformer(tmp_path: Path) -> None:
    image, classes = patches(128, 192)
    found = load_segmenter(nets.maskformer(tmp_path / "net.onnx")).segment(image).semantic
    assert (found == classes)[classes != ROAD].mean() > 0.995


def test_logits_are_enlarged_before_the_largest_is_taken(tmp_path: Path) -> None:
    """A slanted edge comes out slanted at a quarter of the size, not in steps of four."""
    y, x = np.mgrid[:128, :128]
    edge = 40 + y / 4
    image = np.zeros((128, 128, 3), np.uint8)
    image[..., 0] = np.clip((x - edge) * 20 + 128, 0, 255)
    found = load_segmenter(nets.logits(tmp_path / "net.onnx")).segment(image).semantic
    assert np.abs((found == ROAD).sum(axis=1)[4:-4] - edge[4:-4, 0]).max() <= 1.5


def test_colours_are_normalized_as_asked(tmp_path: Path) -> None:
    image = np.array([[[123, 9, 200], [124, 9, 200], [127, 9, 120], [128, 9, 130]]], np.uint8)
    path = nets.red_above(tmp_path / "net.onnx", 0.0)

    def cars() -> list[bool]:
        return [bool(v) for v in (load_segmenter(path).segment(image).semantic == CAR)[0]]

    assert cars() == [False, True, True, True]  # ImageNet's mean is at 123.7
    settings = tmp_path / "net.toml"
    settings.write_text("mean = [0.5, 0.5, 0.5]\nstd = [0.5, 0.5, 0.5]")
    assert cars() == [False, False, False, True]
    settings.write_text('mean = [125.0, 0, 0]\nwhite = 255\nchannels = "BGR"')
    assert cars() == [True, True, False, True]
    nets.red_above(path, 123.5)
    settings.write_text("white = 255")
    assert cars() == [False, True, True, True]


@pytest.mark.parametrize("stride", [1, 4])
def test_windows_agree_with_the_whole(stride: int, tmp_path: Path) -> None:
    path = nets.logits(tmp_path / "net.onnx", stride=stride)
    image = np.random.default_rng(0).integers(0, 256, (150, 260, 3)).astype(np.uint8)
    image = np.repeat(np.repeat(image[::10, ::10], 10, axis=0), 10, axis=1)
    (tmp_path / "net.toml").write_text("window = [512, 512]")
    whole = load_segmenter(path).segment(image).semantic
    # Otherwise the picture would be made to just cover the window.
    (tmp_path / "net.toml").write_text("window = [96, 96]\nshort_side = 150")
    seen = load_segmenter(path).segment(image).semantic
    assert (seen == whole).mean() > (0.9999 if stride == 1 else 0.9)


def test_no_seam_where_windows_err_at_their_borders(tmp_path: Path) -> None:
    path = nets.spoiled_border(tmp_path / "net.onnx", 64, 4)
    found = load_segmenter(path).segment(np.zeros((64, 300, 3), np.uint8)).semantic
    assert (found[4:-4, 4:-4] == ROAD).all() and (found[0] == BUILDING).all()
    (tmp_path / "net.toml").write_text("short_side = 160")
    image = np.random.default_rng(0).integers(0, 256, (160, 300, 3)).astype(np.uint8)
    assert (load_segmenter(path).segment(image).semantic[4:-4, 4:-4] == ROAD).all()


def test_a_fixed_square_sees_streets_with_their_proportions(tmp_path: Path) -> None:
    """Circles stay circles: a picture twice as wide as high goes through two windows and more, not squeezed into one."""
    path = nets.logits(tmp_path / "net.onnx", 64, 64, stride=1)
    image = np.zeros((128, 512, 3), np.uint8)
    image[:, ::4, 0] = image[:, 1::4, 0] = 255  # columns two wide: one wide at half the size, gone at an eighth
    found = load_segmenter(path).segment(image).semantic
    assert ((found == CAR) == (image[..., 0] > 0)).mean() > 0.9


# ------------------------------------------------------------------------------------------------------------------- classes


def test_classes_by_their_number(tmp_path: Path) -> None:
    ade = nets.colour_weights(150, car=102, vegetation=4, sky=2, road=6)  # a van
    image, classes = patches(64, 96)

    def check(name: str, weights: np.ndarray) -> None:
        path = nets.logits(tmp_path / name, stride=1, weights=weights)
        assert (load_segmenter(path).segment(image).semantic == classes).all()

    check("ade.onnx", ade)
    check("waymo.onnx", nets.colour_weights(29, car=2, vegetation=24, sky=25, road=21))
    check("waymo-28.onnx", nets.colour_weights(28, car=1, vegetation=23, sky=24, road=20))


def test_classes_that_mean_the_same_count_together(tmp_path: Path) -> None:
    """House and skyscraper at 0.3 each outdo a wall at 0.4."""
    bias = np.full(150, -STRONG, np.float32)
    bias[[25, 48, 0]] = np.log((0.3, 0.3, 0.4))
    node = helper.make_node("Conv", ["image", "weights", "bias"], ["out"])
    constants = {"weights": np.zeros((150, 3, 1, 1), np.float32), "bias": bias}
    path = save(tmp_path / "net.onnx", [("image", FLOAT, (1, 3, None, None))], [node], constants=constants)
    assert (load_segmenter(path).segment(np.zeros((40, 40, 3), np.uint8)).semantic == BUILDING).all()


STRONG = nets.STRONG


def test_classes_by_name(tmp_path: Path) -> None:
    weights = nets.colour_weights(4, car=3, vegetation=1, sky=2, road=0)
    path = nets.logits(tmp_path / "net.onnx", stride=1, weights=weights)
    (tmp_path / "net.toml").write_text(
        'classes = ["street", "Trees and such", "sky", "my_car"]\n[map]\n"Trees and such" = "vegetation"\n"3" = "car"'
    )
    image, classes = patches(64, 96)
    assert (load_segmenter(path).segment(image).semantic == classes).all()
    (tmp_path / "net.toml").write_text('classes = ["street", "shrub", "sky", "Pick-up truck"]\n[map]\nsky = ""')
    found = load_segmenter(path).segment(image).semantic
    assert (found == np.where((classes == VEGETATION) | (classes == SKY), VOID, classes))[classes != CAR].all()


def test_label_ids(tmp_path: Path) -> None:
    weights = nets.colour_weights(34, car=26, vegetation=21, sky=23, road=7)
    path = nets.label_map(tmp_path / "net.onnx", keep=False, weights=weights)
    image, classes = patches(64, 96)
    with pytest.raises(
        SettingsError, match=r"gives the label 26, which is none of its classes .*cityscapes-ids.* into net\.toml"
    ):
        load_segmenter(path).segment(image)
    (tmp_path / "net.toml").write_text('classes = "cityscapes-ids"')
    assert (load_segmenter(path).segment(image).semantic == classes).all()


# ------------------------------------------------------------------------------------------------------------------- objects

CAR_BOX, PERSON_BOX = (24, 20, 68, 40), (72, 16, 92, 48)
OBJECTS = [
    (CAR_BOX, 2, 0.9),
    ((26, 20, 69, 41), 7, 0.6),  # the same as a truck, less sure
    (PERSON_BOX, 0, 0.5),
    ((0, 16, 20, 48), 56, 0.9),  # a chair
    ((0, 16, 20, 48), 2, 0.1),  # not sure enough
]


def red_image() -> np.ndarray:
    """32 x 96: it lies 16 rows lower in the network's 64 x 96. Red where the boxes are, and below the car's box."""
    image = np.zeros((32, 96, 3), np.uint8)
    image[4:28, 32:60, 0] = image[4:28, 76:88, 0] = image[4:28, 4:16, 0] = 255
    return image


@pytest.mark.parametrize("version", [8, 5, 0])
@pytest.mark.parametrize("last", [False, True])
@pytest.mark.parametrize("size", [(64, 96), (None, None)])
def test_yolo(version: int, last: bool, size: tuple[int | None, int | None], tmp_path: Path) -> None:
    objects = OBJECTS if version else [OBJECTS[0], *OBJECTS[2:]]
    free = size[0] is None
    if free:  # the longer side is 96, and nothing is added above: 32 is a multiple of 32
        objects = [((x0, y0 - 16, x1, y1 - 16), n, s) for (x0, y0, x1, y1), n, s in objects]
        (tmp_path / "net.toml").write_text("window = [96, 96]")
    segmenter = load_segmenter(nets.yolo(tmp_path / "net.onnx", objects, version=version, last=last, size=size))
    labels = segmenter.segment(red_image())
    expected, ids = np.full((32, 96), VOID), np.zeros((32, 96))
    expected[4:24, 32:60], ids[4:24, 32:60] = CAR, 1  # cut to the box
    expected[4:28, 76:88], ids[4:28, 76:88] = PERSON, 2
    assert labels.instance is not None and labels.instance.dtype == np.uint16
    # Corners of a mask at a quarter of the size are round.
    assert (labels.semantic != expected).sum() <= 8 and (labels.instance != ids).sum() <= 8
    assert segmenter.has_instances and not segmenter.whole_street


def test_yolo_of_own_classes_at_another_size(tmp_path: Path) -> None:
    """Twice as large: the box and its mask are twice as large, too. Names are in the file."""
    path = nets.yolo(tmp_path / "net.onnx", [(CAR_BOX, 1, 0.9)], classes=2, names="{0: 'dog', 1: 'Lorry'}")
    image = np.repeat(np.repeat(red_image(), 2, axis=0), 2, axis=1)
    labels = load_segmenter(path).segment(image)
    expected = np.full((64, 192), VOID)
    expected[8:48, 64:120] = TRUCK
    assert (labels.semantic == expected).mean() > 0.99
    (tmp_path / "net.toml").write_text("score = 0.95")
    assert (load_segmenter(path).segment(image).semantic == VOID).all()


# -------------------------------------------------------------------------------------------------------------------- errors


def two_inputs(path: Path) -> Path:
    inputs = [("image", FLOAT, (1, 3, None, None)), ("task", FLOAT, (1, 77))]
    nodes = [helper.make_node("Identity", ["image"], ["a"]), helper.make_node("Identity", ["task"], ["b"])]
    return save(path, inputs, nodes, outputs=("a", "b"))


def same(path: Path, shape: tuple[int | None, ...], kind: int = FLOAT) -> Path:
    return save(path, [("image", kind, shape)], [helper.make_node("Identity", ["image"], ["out"])], kind=kind)


def garbage(path: Path) -> Path:
    path.write_bytes(b"no network")
    return path


def flat(path: Path) -> Path:
    nodes = [helper.make_node("ReduceMean", ["image", "axes"], ["out"], keepdims=0)]
    constants = {"axes": np.array([2, 3], np.int64)}
    return save(path, [("image", FLOAT, (1, 3, None, None))], nodes, constants=constants)


def not_finite(path: Path) -> Path:
    node = helper.make_node("Div", ["image", "zero"], ["out"])
    return save(path, [("image", FLOAT, (1, 3, None, None))], [node], constants={"zero": np.array(0, np.float32)})


def boxes_only(path: Path) -> Path:
    node = helper.make_node("Identity", ["found"], ["out"])
    found = {"found": np.zeros((1, 84, 189), np.float32)}
    return save(path, [("image", FLOAT, (1, 3, 96, 96))], [node], constants=found)


def detr(path: Path) -> Path:
    found = {"boxes": np.zeros((1, 50, 4)), "classes": np.zeros((1, 50, 91)), "planes": np.zeros((1, 50, 16, 16))}
    nodes = [helper.make_node("Identity", [name], [f"{name} out"]) for name in found]
    constants = {name: values.astype(np.float32) for name, values in found.items()}
    return save(
        path, [("image", FLOAT, (1, 3, 64, 64))], nodes, constants=constants, outputs=[f"{n} out" for n in found]
    )


WRONG = {
    r"net\.onnx: cannot be read: No such file": lambda p: p,
    r"net\.onnx: cannot be loaded": garbage,
    r"has the inputs 'image' .* and 'task' \(1, 77\) float": two_inputs,
    r"wants 'image' \(1, 4, \?, \?\) float, not an image of 3 channels": lambda p: same(p, (1, 4, None, None)),
    r"wants 2 images at a time": lambda p: same(p, (2, 3, None, None)),
    r"is given four dimensions": lambda p: same(p, (3, None, None)),
    r"is given float, float16, double or uint8": lambda p: same(p, (1, 3, None, None), nets.INT64),
    r"has 3 classes, and no list of such classes is known": lambda p: same(p, (1, 3, None, None)),
    r"gives 'out' \(1, 3\) float32 for an image of 160x224 \(give an ONNX file of one image": flat,
    r"gives values that are not finite in 'out'": not_finite,
    r"boxes without masks": boxes_only,
    r"gives 'boxes out' .* for an image of 64x64": detr,
    r"gives 'out' \(1, 3, 160, 224\) uint8": lambda p: same(p, (1, 3, None, None), UINT8),
}


@pytest.mark.parametrize("line", WRONG)
def test_what_is_none_is_one_line(line: str, tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=line) as caught:
        load_segmenter(WRONG[line](tmp_path / "net.onnx"))
    assert "net.onnx" in str(caught.value) and "\n" not in str(caught.value)


BAD_SETTINGS = {
    "classes = [": "Not readable TOML",
    "colours = 3": "has an unknown key 'colours' .keys are kind, output",
    'kind = "boxes"': "kind = 'boxes' is not understood .give one of logits, labels, yolo, maskformer",
    "mean = [1, 2]": "mean = .* is not understood .give three numbers",
    "mean = [123.7, 116.3, 103.5]": "mean is above 1, where white is .add white = 255.0",
    'classes = "pascal"': "or one of cityscapes,",
    'classes = ["car", "road"]': "net.onnx has 19 classes, and not 2",
    '[map]\n"car" = "cat"': "is not understood .give names of Cityscapes classes",
    '[map]\n"cat" = "car"': "Not a class of net.onnx: 'cat' in ",
    'output = "masks"': "has no output masks .it has logits",
    'kind = "yolo"': "not yolo .kind in net.toml",
    "window = [8, 8]": "window = .* is not understood",
    "[map]\n" + "\n".join(f'{n} = ""' for n in REMOVABLE): "no class that can be removed",
}


@pytest.mark.parametrize("text", BAD_SETTINGS)
def test_wrong_settings_are_one_line(text: str, tmp_path: Path) -> None:
    path = nets.logits(tmp_path / "net.onnx")
    (tmp_path / "net.toml").write_text(text)
    with pytest.raises(SettingsError, match=BAD_SETTINGS[text]) as caught:
        load_segmenter(path)
    assert "\n" not in str(caught.value)


def test_files_and_help(tmp_path: Path) -> None:
    path = nets.logits(tmp_path / "net.onnx")
    (tmp_path / "net.onnx.data").write_bytes(b"weights")
    (tmp_path / "net.toml").write_text("score = 0.5")
    assert [p.name for p in segmenter_files(path)] == ["net.onnx", "net.onnx.data", "net.toml"]
    assert "\n" not in NO_LABELS_HELP and all(w in NO_LABELS_HELP for w in ("--segmenter", "mask_path", "--marked"))


def test_frames_of_a_drive(tmp_path: Path) -> None:
    drive = open_drive(make_tiny_drive(tmp_path / "d", semantics=False))
    path = nets.logits(tmp_path / "net.onnx")
    found = list(label_by_network(drive, path))
    assert len(found) == len(drive.frames) and all(labels.semantic.shape == (24, 32) for labels in found)
    expected = load_segmenter(path).segment(read_image(drive.frames[1].image_path)).semantic
    assert np.array_equal(found[1].semantic, expected)


def test_the_footage_is_seen_at_its_own_size(tmp_path: Path) -> None:
    """Stripes of one pixel, black and red, are road and car; reduced to half they would be one dark red."""
    root = make_tiny_drive(tmp_path / "d", semantics=False)
    stripes = np.zeros((24, 32, 3), np.uint8)
    stripes[:, ::2] = COLOURS[CAR]
    for frame in open_drive(root).frames:
        write_image_atomic(frame.image_path, stripes)
    imported = import_drive(open_drive(root), tmp_path / "imported", work_side=16)
    path = nets.label_map(tmp_path / "net.onnx", keep=False)
    (labels, *_) = label_by_network(imported, path)
    assert labels.semantic.shape == (12, 16)
    seen = load_segmenter(path).segment(stripes).semantic
    assert set(np.unique(seen)) == {ROAD, CAR}
    assert np.array_equal(labels.semantic, resize_labels(seen, (16, 12)))
