"""A promptable network of the user's is asked what was clicked: real small graphs that look up the colour of the first point."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import helper

from tests.inpaint.networks import FLOAT, save
from unveil_core.base.errors import SettingsError
from unveil_core.marking.asked.prompts import Prompt
from unveil_core.marking.network import Networks, Promptable
from unveil_core.marking.seeds import Seeds

SIDE = 64
INT64 = onnx.TensorProto.INT64


def encoder(path: Path) -> Path:
    """Its features are the normalized picture."""
    same = helper.make_node("Identity", ["image"], ["embedding"])
    return save(path, [("image", FLOAT, (1, 3, SIDE, SIDE))], [same], outputs=["embedding"])


def decoder(path: Path, features: str = "image_embeddings") -> Path:
    """Two masks, the better second: where features are those at the first point on the object."""
    nodes = [
        helper.make_node("Reshape", ["point_coords", "pairs"], ["places"]),
        helper.make_node("Equal", ["point_labels", "own"], ["is_own"]),
        helper.make_node("Cast", ["is_own"], ["weight"], to=FLOAT),
        helper.make_node("ArgMax", ["weight"], ["first"], axis=1, keepdims=0),
        helper.make_node("Gather", ["places", "first"], ["place"], axis=0),
        helper.make_node("Floor", ["place"], ["whole"]),
        helper.make_node("Cast", ["whole"], ["xy"], to=INT64),
        helper.make_node("Gather", ["xy", "turned"], ["yx"], axis=1),
        helper.make_node("Squeeze", [features, "zeroth"], ["planes"]),
        helper.make_node("Transpose", ["planes"], ["pixels"], perm=[1, 2, 0]),
        helper.make_node("GatherND", ["pixels", "yx"], ["colour"]),
        helper.make_node("Reshape", ["colour", "column"], ["wanted"]),
        helper.make_node("Sub", [features, "wanted"], ["apart"]),
        helper.make_node("Abs", ["apart"], ["far"]),
        helper.make_node("ReduceSum", ["far", "channel"], ["sum"]),
        helper.make_node("Sub", ["half", "sum"], ["good"]),
        helper.make_node("Neg", ["good"], ["bad"]),
        helper.make_node("Concat", ["bad", "good"], ["masks"], axis=1),
        helper.make_node("Identity", ["scores"], ["iou_predictions"]),
    ]
    constants = {
        "pairs": np.array([-1, 2], np.int64),
        "own": np.array(1, np.float32),
        "turned": np.array([1, 0], np.int64),
        "zeroth": np.array([0], np.int64),
        "column": np.array([1, 3, 1, 1], np.int64),
        "channel": np.array([1], np.int64),
        "half": np.array(0.5, np.float32),
        "scores": np.array([[0.1, 0.9]], np.float32),
    }
    inputs = [
        (features, FLOAT, (1, 3, SIDE, SIDE)),
        ("point_coords", FLOAT, (1, None, 2)),
        ("point_labels", FLOAT, (1, None)),
    ]
    return save(path, inputs, nodes, constants=constants, outputs=["masks", "iou_predictions"])


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Promptable:
    folder = tmp_path_factory.mktemp("networks")
    return Promptable(Networks(encoder(folder / "encoder.onnx"), decoder(folder / "decoder.onnx")), threads=1)


@pytest.fixture
def picture() -> np.ndarray:
    """Grey, with a red rectangle, and one more red one farther to the right."""
    image = np.full((80, 128, 3), 120, np.uint8)
    image[30:60, 20:50] = image[30:60, 90:110] = (220, 20, 20)
    return image


def test_a_click_is_asked_about(network: Promptable, picture: np.ndarray) -> None:
    mask = network.outline(0, picture, None, Prompt(inside=np.array([[32.0, 44.0]])))
    assert mask[34:56, 24:46].all() and mask[34:56, 94:106].all() and not mask[:26].any() and not mask[:, :16].any()


def test_geometry_asks_in_other_frames_and_bounds_the_answer(network: Promptable, picture: np.ndarray) -> None:
    window = (slice(20, 70), slice(10, 60))
    shape = (50, 50)
    sure, likely, none = np.zeros(shape, bool), np.zeros(shape, bool), np.zeros(shape, bool)
    sure[15:35, 15:35] = likely[8:42, 8:42] = True
    mask = network.outline(1, picture, Seeds(window, sure, likely, likely, none, none, 34.0), None)
    assert mask[34:56, 24:46].all() and not mask[:, 62:].any()


def test_what_a_person_says_counts_more(network: Promptable, picture: np.ndarray) -> None:
    prompt = Prompt(inside=np.array([[32.0, 44.0], [70.0, 10.0]]), outside=np.array([[100.0, 44.0]]))
    mask = network.outline(2, picture, None, prompt)
    assert mask[10, 70] and not mask[44, 100]


def test_halves_of_two_networks_are_told(tmp_path: Path, picture: np.ndarray) -> None:
    shape = [("image", FLOAT, (1, 3, SIDE, SIDE))]
    pooled = helper.make_node("AveragePool", ["image"], ["embedding"], kernel_shape=[2, 2], strides=[2, 2])
    other = save(tmp_path / "other.onnx", shape, [pooled], outputs=["embedding"])
    network = Promptable(Networks(other, decoder(tmp_path / "decoder.onnx")), threads=1)
    with pytest.raises(SettingsError, match="give the two halves of one network"):
        network.outline(0, picture, None, Prompt(inside=np.array([[32.0, 44.0]])))
    with pytest.raises(SettingsError, match="other.onnx: has the inputs 'image'"):
        Promptable(Networks(encoder(tmp_path / "encoder.onnx"), other), threads=1)
