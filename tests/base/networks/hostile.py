"""Networks that never end, or ask for all memory there is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from onnx import GraphProto, NodeProto, TensorProto, helper, numpy_helper

__all__ = ["endless", "endless_for_bright", "endless_scan", "greedy"]

FLOAT, INT64, BOOL = TensorProto.FLOAT, TensorProto.INT64, TensorProto.BOOL
ROUNDS = 1 << 60


def _value(name: str, kind: int, shape: list[object] | None) -> object:
    return helper.make_tensor_value_info(name, kind, shape)


def _save(path: Path, nodes: list[NodeProto], constants: dict[str, np.ndarray], classes: int = 3) -> Path:
    image, out = _value("image", FLOAT, [1, 3, "H", "W"]), _value("out", FLOAT, None)
    kept = [numpy_helper.from_array(v, k) for k, v in constants.items()]
    graph = helper.make_graph(nodes, "g", [image], [out], kept)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    path.write_bytes(model.SerializeToString())
    return path


def _rounds() -> GraphProto:
    return helper.make_graph(
        [helper.make_node("Identity", ["c"], ["co"]), helper.make_node("Identity", ["x"], ["xo"])],
        "body",
        [_value("i", INT64, []), _value("c", BOOL, []), _value("x", FLOAT, None)],
        [_value("co", BOOL, []), _value("xo", FLOAT, None)],
    )


def endless(path: Path) -> Path:
    """A loop of 2^60 rounds."""
    loop = helper.make_node("Loop", ["n", "t", "image"], ["out"], body=_rounds())
    return _save(path, [loop], {"n": np.array(ROUNDS), "t": np.array(True)})


def endless_scan(path: Path) -> Path:
    """The same, within an If."""
    loop = helper.make_node("Loop", ["n", "t", "image"], ["o"], body=_rounds())
    then = helper.make_graph([loop], "then", [], [_value("o", FLOAT, None)])
    other = helper.make_graph([helper.make_node("Identity", ["image"], ["p"])], "other", [], [_value("p", FLOAT, None)])
    node = helper.make_node("If", ["t"], ["out"], then_branch=then, else_branch=other)
    return _save(path, [node], {"n": np.array(ROUNDS), "t": np.array(True)})


def endless_for_bright(path: Path) -> Path:
    """A loop of as many rounds as the first pixel says, which noise of the trial does not reach: 2^60 for white."""
    nodes = [
        helper.make_node("ReduceMin", ["image"], ["low"], keepdims=0),
        helper.make_node("Greater", ["low", "most"], ["bright"]),
        helper.make_node("Where", ["bright", "n", "one"], ["rounds"]),
        helper.make_node("Loop", ["rounds", "t", "image"], ["out"], body=_rounds()),
    ]
    constants = {
        "n": np.array(ROUNDS), "one": np.array(1), "t": np.array(True), "most": np.array(2.0, np.float32),
    }  # fmt: skip
    return _save(path, nodes, constants)


def greedy(path: Path) -> Path:
    """2^33 bytes from 300."""
    nodes = [
        helper.make_node(
            "ConstantOfShape", ["n"], ["much"], value=numpy_helper.from_array(np.ones(1, np.float32), "v")
        ),
        helper.make_node("ReduceSum", ["much"], ["sum"], keepdims=0),
        helper.make_node("Add", ["image", "sum"], ["out"]),
    ]
    return _save(path, nodes, {"n": np.array([1 << 31])})
