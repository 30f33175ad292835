"""Small real ONNX files with the signatures of segmentation networks. Most tell classes by colour: red is a car, green vegetation,
blue sky, black road."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
from onnx import helper

from tests.inpaint.networks import FLOAT, UINT8, save

ROAD, BUILDING, VEGETATION, SKY, PERSON, CAR, TRUCK = 0, 2, 8, 10, 11, 13, 14
INT64 = onnx.TensorProto.INT64
STRONG = 20.0
PAIR = ("output0", "output1")


def colour_weights(
    count: int = 19, car: int = CAR, vegetation: int = VEGETATION, sky: int = SKY, road: int = ROAD
) -> np.ndarray:
    """(count, 3, 1, 1) of a convolution of RGB minus a half."""
    weights = np.zeros((count, 3, 1, 1), np.float32)
    for number, colour in ((car, 0), (vegetation, 1), (sky, 2)):
        weights[number, :, 0, 0] = -STRONG
        weights[number, colour] = STRONG
    weights[road, :, 0, 0] = -STRONG
    return weights


def biased(weights: np.ndarray, void: float = -3 * STRONG) -> np.ndarray:
    """(count,) classes without a weight never win."""
    bias = np.full(len(weights), void, np.float32)
    bias[np.abs(weights).sum(axis=(1, 2, 3)) > 0] = 0
    return bias


def colour_nodes(image: str, out: str, stride: int = 1) -> list[onnx.NodeProto]:
    """Logits by colour: ImageNet's normalization undone, a convolution, and means of blocks of ``stride``."""
    return [
        helper.make_node("Mul", [image, "std"], ["spread"]),
        helper.make_node("Add", ["spread", "mean"], ["plain"]),
        helper.make_node("AveragePool", ["plain"], ["small"], kernel_shape=[stride] * 2, strides=[stride] * 2),
        helper.make_node("Conv", ["small", "weights", "bias"], [out]),
    ]


def colour_constants(weights: np.ndarray | None = None) -> dict[str, np.ndarray]:
    weights = colour_weights() if weights is None else weights
    return {
        "std": np.array([0.229, 0.224, 0.225], np.float32).reshape(1, 3, 1, 1),
        "mean": np.array([0.485 - 0.5, 0.456 - 0.5, 0.406 - 0.5], np.float32).reshape(1, 3, 1, 1),
        "weights": weights,
        "bias": biased(weights),
    }


def logits(
    path: Path,
    height: int | None = None,
    width: int | None = None,
    *,
    stride: int = 4,
    weights: np.ndarray | None = None,
) -> Path:
    """As a SegFormer: (b, C, h / 4, w / 4)."""
    inputs = [("pixel_values", FLOAT, (None, 3, height, width))]
    return save(
        path,
        inputs,
        colour_nodes("pixel_values", "logits", stride),
        constants=colour_constants(weights),
        outputs=("logits",),
    )


def logits_last(path: Path, height: int | None = None, width: int | None = None) -> Path:
    """Channels last, in and out."""
    nodes = [
        helper.make_node("Transpose", ["image"], ["first"], perm=[0, 3, 1, 2]),
        *colour_nodes("first", "planes", 2),
        helper.make_node("Transpose", ["planes"], ["out"], perm=[0, 2, 3, 1]),
    ]
    return save(path, [("image", FLOAT, (1, height, width, 3))], nodes, constants=colour_constants())


def probabilities(path: Path) -> Path:
    nodes = [*colour_nodes("image", "planes", 2), helper.make_node("Softmax", ["planes"], ["out"], axis=1)]
    return save(path, [("image", FLOAT, (1, 3, None, None))], nodes, constants=colour_constants())


def label_map(path: Path, *, keep: bool, weights: np.ndarray | None = None, size: int | None = None) -> Path:
    """Integers (1, h, w), or (1, 1, h, w) with ``keep``, of uint8 pixels."""
    nodes = [
        helper.make_node("Cast", ["pixels"], ["bright"], to=FLOAT),
        helper.make_node("Div", ["bright", "white"], ["part"]),
        helper.make_node("Sub", ["part", "half"], ["centred"]),
        helper.make_node("Conv", ["centred", "weights", "bias"], ["planes"]),
        helper.make_node("ArgMax", ["planes"], ["out"], axis=1, keepdims=int(keep)),
    ]
    constants = {**colour_constants(weights), "white": np.array(255, np.float32), "half": np.array(0.5, np.float32)}
    return save(path, [("pixels", UINT8, (1, 3, size, size))], nodes, constants=constants, kind=INT64)


def red_above(path: Path, threshold: float) -> Path:
    """Car where the first channel, as the network is given it, is above a threshold; else road."""
    weights = np.zeros((19, 3, 1, 1), np.float32)
    weights[CAR, 0] = 1
    bias = np.full(19, -100, np.float32)
    bias[[ROAD, CAR]] = (0, -threshold)
    node = helper.make_node("Conv", ["image", "weights", "bias"], ["out"])
    return save(path, [("image", FLOAT, (1, 3, None, None))], [node], constants={"weights": weights, "bias": bias})


def maskformer(path: Path) -> Path:
    """Three queries of which each is sure of a class, masked by a colour at a quarter of the size."""
    classes = np.full((1, 3, 20), -STRONG, np.float32)
    for query, number in enumerate((CAR, VEGETATION, SKY)):
        classes[0, query, number] = STRONG
    masks = np.full((3, 3, 1, 1), -STRONG, np.float32)
    masks[np.arange(3), np.arange(3)] = STRONG
    constants = {**colour_constants(masks), "classes": classes}
    nodes = [
        *colour_nodes("pixel_values", "masks_queries_logits", 4),
        helper.make_node("Identity", ["classes"], ["class_queries_logits"]),
    ]
    inputs = [("pixel_values", FLOAT, (1, 3, None, None))]
    return save(path, inputs, nodes, constants=constants, outputs=("class_queries_logits", "masks_queries_logits"))


def spoiled_border(path: Path, side: int, border: int) -> Path:
    """Road everywhere, but a building along the border of what it is shown: what lacks surroundings is wrong."""
    plane = np.full((1, 19, side, side), -STRONG, np.float32)
    plane[0, ROAD] = 1
    plane[0, BUILDING] = 3
    plane[0, BUILDING, border:-border, border:-border] = 0
    nodes = [
        helper.make_node("ReduceMean", ["image", "axes"], ["offset"], keepdims=1),
        helper.make_node(
            "Add", ["offset", "plane"], ["out"]
        ),  # an offset by window, of all logits alike, means nothing
    ]
    constants = {"plane": plane, "axes": np.array([1, 2, 3], np.int64)}
    return save(path, [("image", FLOAT, (1, 3, side, side))], nodes, constants=constants)


Found = tuple[Sequence[float], int, float]
"""Box x0, y0, x1, y1 in pixels of the network's input; class; score."""


def yolo(
    path: Path,
    found: Sequence[Found],
    *,
    version: int = 8,
    size: tuple[int | None, int | None] = (64, 96),
    classes: int = 80,
    names: str | None = None,
    last: bool = False,
) -> Path:
    """Gives these objects always; their masks are where the picture is red."""
    height, width = size[0] or 160, size[1] or 224
    places = sum(height // s * (width // s) for s in (8, 16, 32))
    coefficients = np.zeros(32, np.float32)
    coefficients[0] = 10
    features = {8: 4 + classes, 5: 5 + classes, 0: 6}[version]
    rows = np.zeros(({8: places, 5: 3 * places, 0: 300}[version], features + 32), np.float32)
    for k, (box, number, score) in enumerate(found):
        x0, y0, x1, y1 = box
        rows[k, -32:] = coefficients
        if version == 0:
            rows[k, :6] = (*box, score, number)
            continue
        rows[k, :4] = ((x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0)
        rows[k, features - classes + number] = score if version == 8 else score / 0.9
        if version == 5:
            rows[k, 4] = 0.9
    answer = rows.T if version == 8 else rows
    kernel = np.zeros((32, 3, 1, 1), np.float32)
    kernel[0, 0] = 1
    bias = np.zeros(32, np.float32)
    bias[0] = -0.5
    nodes = [
        helper.make_node("Identity", ["found"], ["output0"]),
        helper.make_node("AveragePool", ["images"], ["small"], kernel_shape=[4, 4], strides=[4, 4]),
        helper.make_node("Conv", ["small", "kernel", "bias"], ["planes"]),
        helper.make_node("Transpose", ["planes"], ["output1"], perm=[0, 2, 3, 1] if last else [0, 1, 2, 3]),
    ]
    constants = {"found": answer[None].copy(), "kernel": kernel, "bias": bias}
    save(path, [("images", FLOAT, (1, 3, *size))], nodes, constants=constants, outputs=PAIR)
    if names is not None:
        model = onnx.load(str(path))
        helper.set_model_props(model, {"names": names, "task": "segment"})
        onnx.save(model, str(path))
    return path
