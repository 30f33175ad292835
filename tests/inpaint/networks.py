"""Small real ONNX files with the signatures of inpainting networks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

FLOAT, UINT8, HALF, BOOL = TensorProto.FLOAT, TensorProto.UINT8, TensorProto.FLOAT16, TensorProto.BOOL
IMAGE, MASK = (None, 3, None, None), (None, 1, None, None)

Input = tuple[str, int, Sequence[int | None]]


def save(
    path: Path,
    inputs: Sequence[Input],
    nodes: Sequence[onnx.NodeProto],
    *,
    constants: dict[str, np.ndarray] | None = None,
    kind: int = FLOAT,
    outputs: Sequence[str] = ("out",),
) -> Path:
    """A graph as a file; its outputs are of the type ``kind`` and of any shape."""
    graph = helper.make_graph(
        list(nodes),
        "network",
        [helper.make_tensor_value_info(*i) for i in inputs],
        [helper.make_tensor_value_info(o, kind, None) for o in outputs],
        [numpy_helper.from_array(v, n) for n, v in (constants or {}).items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    onnx.save(model, str(path))
    return path


def images(height: int | None = None, width: int | None = None, kind: int = FLOAT) -> list[Input]:
    """Image and mask of one size, channels first."""
    return [("image", kind, (1, 3, height, width)), ("mask", kind, (1, 1, height, width))]


AXES = {"axes": np.array([2, 3], np.int64), "one": np.array(1, np.float32), "least": np.array(1e-6, np.float32)}


def mean_nodes(image: str = "image", mask: str = "mask", out: str = "out") -> list[onnx.NodeProto]:
    """The mean of what is known, everywhere."""
    return [
        helper.make_node("Sub", ["one", mask], ["known"]),
        helper.make_node("Mul", [image, "known"], ["lit"]),
        helper.make_node("ReduceSum", ["lit", "axes"], ["light"]),
        helper.make_node("ReduceSum", ["known", "axes"], ["count"]),
        helper.make_node("Max", ["count", "least"], ["some"]),
        helper.make_node("Div", ["light", "some"], ["mean"]),
        helper.make_node("Mul", [image, "zero"], ["black"]),
        helper.make_node("Add", ["black", "mean"], [out]),
    ]


MEAN = {**AXES, "zero": np.array(0, np.float32)}


def mean_fill(path: Path, height: int | None = None, width: int | None = None) -> Path:
    """Fills with the mean of what is known; image and mask in [0, 1], channels first."""
    return save(path, images(height, width), mean_nodes(), constants=MEAN)


def mean_fill_255(path: Path) -> Path:
    """The same, answering 0 to 255, as LaMa's usual export does."""
    nodes = [*mean_nodes(out="small"), helper.make_node("Mul", ["small", "white"], ["out"])]
    return save(path, images(64, 64), nodes, constants={**MEAN, "white": np.array(255, np.float32)})


def mean_fill_bytes_last(path: Path) -> Path:
    """The same on uint8, channels last, mask 255."""
    shape = [("pixels", UINT8, (1, None, None, 3)), ("mask", UINT8, (1, None, None, 1))]
    nodes = [
        helper.make_node("Cast", ["pixels"], ["float_pixels"], to=FLOAT),
        helper.make_node("Transpose", ["float_pixels"], ["first"], perm=[0, 3, 1, 2]),
        helper.make_node("Cast", ["mask"], ["float_mask"], to=FLOAT),
        helper.make_node("Transpose", ["float_mask"], ["big_mask"], perm=[0, 3, 1, 2]),
        helper.make_node("Div", ["big_mask", "white"], ["holes"]),
        *mean_nodes("first", "holes", "filled"),
        helper.make_node("Transpose", ["filled"], ["filled_last"], perm=[0, 2, 3, 1]),
        helper.make_node("Round", ["filled_last"], ["whole"]),
        helper.make_node("Cast", ["whole"], ["out"], to=UINT8),
    ]
    return save(path, shape, nodes, constants={**MEAN, "white": np.array(255, np.float32)}, kind=UINT8)


def mean_fill_four_channels(path: Path, height: int | None = None, width: int | None = None) -> Path:
    """The same with image and mask in one input."""
    split = helper.make_node("Split", ["input", "parts"], ["image", "mask"], axis=1)
    constants = {**MEAN, "parts": np.array([3, 1], np.int64)}
    return save(path, [("input", FLOAT, (1, 4, height, width))], [split, *mean_nodes()], constants=constants)


def blur(path: Path, radius: int, height: int | None = None, width: int | None = None) -> Path:
    """A normalized convolution of what is known: each pixel the mean of the known ones around it."""
    side = 2 * radius + 1
    constants = {
        **AXES,
        "kernel3": np.ones((3, 1, side, side), np.float32),
        "kernel1": np.ones((1, 1, side, side), np.float32),
    }
    nodes = [
        helper.make_node("Sub", ["one", "mask"], ["known"]),
        helper.make_node("Mul", ["image", "known"], ["lit"]),
        helper.make_node("Conv", ["lit", "kernel3"], ["light"], pads=[radius] * 4, group=3),
        helper.make_node("Conv", ["known", "kernel1"], ["count"], pads=[radius] * 4),
        helper.make_node("Max", ["count", "least"], ["some"]),
        helper.make_node("Div", ["light", "some"], ["out"]),
    ]
    return save(path, images(height, width), nodes, constants=constants)


def halving(path: Path, times: int) -> Path:
    """Means of blocks: like a network that halves its picture, it takes sides only that are multiples of ``2 ** times``."""
    block = 2**times
    scales = np.array([1, 1, block, block], np.float32)
    nodes = [
        *mean_nodes(out="filled"),
        helper.make_node("AveragePool", ["filled"], ["small"], kernel_shape=[block] * 2, strides=[block] * 2),
        helper.make_node("Resize", ["small", "", "scales"], ["large"], mode="nearest"),
        helper.make_node("Sub", ["large", "filled"], ["difference"]),  # fails where the sizes differ
        helper.make_node("Add", ["difference", "filled"], ["out"]),
    ]
    return save(path, images(), nodes, constants={**MEAN, "scales": scales})


def from_reference(path: Path, height: int | None = None, width: int | None = None, name: str = "reference") -> Path:
    """Takes the reference where the mask is, pixel for pixel."""
    inputs = [*images(height, width), (name, FLOAT, (1, 3, height, width))]
    nodes = [
        helper.make_node("Sub", ["one", "mask"], ["known"]),
        helper.make_node("Mul", ["image", "known"], ["kept"]),
        helper.make_node("Mul", [name, "mask"], ["taken"]),
        helper.make_node("Add", ["kept", "taken"], ["out"]),
    ]
    return save(path, inputs, nodes, constants=AXES)
