"""LPIPS and FID by networks whose answers are known, in both formats."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper
from scipy.linalg import sqrtm

from tests.evaluate.street_workspace import build_workspace
from tests.evaluate.test_evaluation import stacked
from unveil_core.app.cli import main
from unveil_core.base.errors import SettingsError
from unveil_core.evaluate import run_evaluation
from unveil_core.evaluate.perceptual import FeatureModel, LpipsModel, frechet_distance

pytestmark = pytest.mark.filterwarnings("ignore:.torch.jit.*deprecated:DeprecationWarning")


class MeanDifference(torch.nn.Module):
    """In place of LPIPS: the mean absolute difference, times a parameter that is 1."""

    def __init__(self) -> None:
        super().__init__()
        self.factor = torch.nn.Parameter(torch.ones(1))

    def forward(self, a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
        return self.factor * (a - b).abs().mean(dim=[1, 2, 3], keepdim=True)


class MeanColor(torch.nn.Module):
    """In place of the Inception network: three features."""

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        return images.mean(dim=[2, 3])


class Nothing(torch.nn.Module):
    def forward(self, a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
        return (a - b).mean() / 0.0 * 0.0


class Pair(torch.nn.Module):
    def forward(self, a: torch.Tensor, b: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return a.mean(), b.mean()


def save_onnx(path: Path, inputs: tuple[str, ...], nodes: list, shape: tuple = (None, 3, None, None)) -> Path:
    graph = helper.make_graph(
        nodes,
        "model",
        [helper.make_tensor_value_info(n, TensorProto.FLOAT, shape) for n in inputs],
        [helper.make_tensor_value_info("out", TensorProto.FLOAT, None)],
        [helper.make_tensor("axes", TensorProto.INT64, (2,), (2, 3))],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    onnx.save(model, str(path))
    return path


def difference_model(folder: Path, kind: str) -> Path:
    path = folder / f"lpips{kind}"
    if kind != ".onnx":
        torch.jit.script(MeanDifference()).save(str(path))
        return path
    return save_onnx(
        path,
        ("a", "b"),
        [
            helper.make_node("Sub", ["a", "b"], ["d"]),
            helper.make_node("Abs", ["d"], ["e"]),
            helper.make_node("ReduceMean", ["e"], ["out"], keepdims=1),
        ],
    )


def color_model(folder: Path, kind: str) -> Path:
    path = folder / f"features{kind}"
    if kind != ".onnx":
        torch.jit.script(MeanColor()).save(str(path))
        return path
    return save_onnx(
        path,
        ("images",),
        [helper.make_node("ReduceMean", ["images", "axes"], ["out"], keepdims=0)],
        shape=(None, 3, 299, 299),
    )


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_workspace(tmp_path_factory.mktemp("street"), width=72, height=48)


@pytest.fixture
def images() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (2, 40, 70, 3)).astype(np.uint8)


# ------------------------------------------------------------------------------------------------------------ the models


@pytest.mark.parametrize("kind", [".pt", ".torchscript", ".onnx"])
def test_lpips_gets_images_from_minus_one_to_one(kind: str, tmp_path: Path, images: np.ndarray) -> None:
    model = LpipsModel(difference_model(tmp_path, kind))
    expected = np.abs(images[0].astype(float) - images[1]).mean() * 2 / 255
    assert model(images[0], images[1]) == pytest.approx(expected, rel=1e-5)
    assert model(images[0], images[0]) == 0
    white, black = np.full_like(images[0], 255), np.zeros_like(images[0])
    assert model(white, black) == pytest.approx(2)


@pytest.mark.parametrize("kind", [".pts", ".onnx"])
def test_features_are_of_the_whole_image_from_zero_to_one(kind: str, tmp_path: Path) -> None:
    model = FeatureModel(color_model(tmp_path, kind))
    image = np.zeros((600, 900, 3), np.uint8)
    image[..., 0], image[:300, :, 1], image[:, :300, 2] = 255, 255, 51
    np.testing.assert_allclose(model(image), [1, 1 / 2, 0.2 / 3], atol=2e-3)


def test_channels_come_in_the_order_red_green_blue(tmp_path: Path) -> None:
    path = save_onnx(
        tmp_path / "red.onnx", ("a", "b"), [helper.make_node("Split", ["a"], ["out", "g", "bl"], axis=1, num_outputs=3)]
    )
    assert LpipsModel(path)(np.array([[[255, 0, 51]]], np.uint8), np.zeros((1, 1, 3), np.uint8)) == pytest.approx(1)


# ---------------------------------------------------------------------------------------------------- the Fréchet distance


def with_moments(rng: np.random.Generator, count: int, mean: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Rows whose sample mean is exactly ``mean`` and whose sample covariance is root^T root."""
    white = rng.standard_normal((count, len(root)))
    white -= white.mean(axis=0)
    unit = np.linalg.qr(white)[0] * np.sqrt(count - 1)
    return mean + unit @ root


def test_gaussians_in_closed_form() -> None:
    rng = np.random.default_rng(0)
    first, second = np.array([1.0, 2.0, 0.5, 3.0]), np.array([2.0, 0.1, 0.5, 1.0])
    turn = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    step = np.array([0.3, -0.2, 0.0, 1.0])
    a = with_moments(rng, 60, np.zeros(4), np.diag(first) @ turn)
    b = with_moments(rng, 45, step, np.diag(second) @ turn)
    # Covariances of the same axes: the distance of the deviations.
    assert frechet_distance(a, b) == pytest.approx(step @ step + ((first - second) ** 2).sum(), rel=1e-10)


def test_covariances_of_different_axes() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.standard_normal((80, 6)) @ rng.standard_normal((6, 6)), rng.standard_normal((50, 6)) + 0.3
    first, second = np.cov(a, rowvar=False), np.cov(b, rowvar=False)
    step = a.mean(axis=0) - b.mean(axis=0)
    expected = step @ step + np.trace(first + second - 2 * np.real(sqrtm(first @ second)))
    assert frechet_distance(a, b) == pytest.approx(expected, rel=1e-8)
    assert frechet_distance(b, a) == pytest.approx(expected, rel=1e-8)


def test_fewer_images_than_dimensions() -> None:
    """A rotation into many more dimensions changes nothing."""
    rng = np.random.default_rng(2)
    a, b = rng.standard_normal((12, 3)), 2 * rng.standard_normal((9, 3)) + 1
    turn = np.linalg.qr(rng.standard_normal((2048, 3)))[0].T
    assert frechet_distance(a @ turn, b @ turn) == pytest.approx(frechet_distance(a, b), rel=1e-9)
    many = 5 * rng.standard_normal((20, 2048))
    assert frechet_distance(many, many) < 1e-6
    assert frechet_distance(many, many + 0.5) == pytest.approx(0.25 * 2048, rel=1e-9)


@pytest.mark.parametrize("shape", [(1, 3), (4, 2), (4,)])
def test_sets_that_have_no_distance(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="features must be"):
        frechet_distance(np.ones((5, 3)), np.ones(shape))


# ------------------------------------------------------------------------------------------------------ a whole workspace


def test_a_workspace_is_measured(finished: Path, tmp_path: Path) -> None:
    plain = run_evaluation(finished)
    lpips, fid = difference_model(tmp_path, ".pt"), color_model(tmp_path, ".onnx")
    metrics = run_evaluation(finished, lpips=lpips, fid=fid)
    truth = finished.parent / "drive_on_disk/truth"
    street = stacked(truth / "images")
    folders = {
        "ours": finished / "frames/front",
        "render": finished / "renders/front",
        "input": finished.parent / "drive_on_disk/images",
    }
    whole = metrics["truth"]["regions"]["whole"]["methods"]
    features = FeatureModel(fid)
    for method, folder in folders.items():
        pictures = stacked(folder)
        expected = np.abs(pictures.astype(float) - street).mean() * 2 / 255
        assert whole[method]["lpips"] == pytest.approx(expected, abs=1e-4)
        sets = [np.stack([features(p) for p in some]) for some in (pictures, street)]
        assert whole[method]["fid"] == pytest.approx(frechet_distance(*sets), abs=1e-4)
    assert whole["input"]["fid"] > 2 * whole["ours"]["fid"]
    assert whole["telea"]["lpips"] > whole["ours"]["lpips"] > 0
    # All else is as it is without networks, where nothing is said of these two.
    assert "lpips" not in json.dumps(plain) and "fid" not in json.dumps(plain)
    for method in folders:
        del whole[method]["lpips"], whole[method]["fid"]
        for name, region in metrics["truth"]["regions"].items():
            assert region["methods"][method] == plain["truth"]["regions"][name]["methods"][method]


def test_the_command_takes_one_of_them(finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", str(finished), "--lpips", str(difference_model(tmp_path, ".onnx"))]) == 0
    methods = json.loads(capsys.readouterr().out)["truth"]["regions"]["whole"]["methods"]
    assert 0 < methods["ours"]["lpips"] < methods["input"]["lpips"]
    assert "fid" not in methods["ours"]


def test_without_truth_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    workspace = build_workspace(tmp_path / "street", truth=False)
    assert main(["evaluate", str(workspace), "--lpips", str(difference_model(tmp_path, ".pt"))]) == 2
    error = capsys.readouterr().err
    assert "LPIPS needs true images of the empty street, and has 0 (give a folder of them with --truth)" in error
    assert error.count("\n") == 1


# ----------------------------------------------------------------------------------------------------------------- errors


def shortened(path: Path) -> Path:
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    return path


def written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def scripted(path: Path, module: torch.nn.Module) -> Path:
    torch.jit.script(module).save(str(path))
    return path


def saved(path: Path, thing: object) -> Path:
    torch.save(thing, path)
    return path


class Trap:
    """Raises when it is unpickled."""

    def __reduce__(self) -> tuple:
        return (pytest.fail, ("it was unpickled",))


FIXED = [helper.make_node("ReduceMean", ["a"], ["out"], keepdims=1)]


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (lambda f: f / "none.pt", "none.pt: cannot be read: No such file"),
        (lambda f: f, "Neither TorchScript"),
        (lambda f: written(f / "weights.pth", b""), "weights.pth: Neither TorchScript"),
        (lambda f: written(f / "empty.pt", b""), "empty.pt: Not a TorchScript archive: damaged, or a plain pickle"),
        (lambda f: written(f / "empty.onnx", b"rubbish"), "empty.onnx: cannot be loaded"),
        (lambda f: shortened(difference_model(f, ".pt")), "lpips.pt: Not a TorchScript archive"),
        (lambda f: shortened(difference_model(f, ".onnx")), "lpips.onnx: cannot be loaded"),
        (
            lambda f: saved(f / "state.pt", MeanDifference().state_dict()),
            "state.pt: Not opened: a plain torch.save pickle",
        ),
        (lambda f: saved(f / "trap.pt", Trap()), "trap.pt: Not opened: a plain torch.save pickle"),
        (lambda f: written(f / "old.pt", pickle.dumps(Trap())), "old.pt: Not a TorchScript archive"),
        (lambda f: scripted(f / "one.pt", MeanColor()), "one.pt: does not take (1, 3, 40, 70) and (1, 3, 40, 70): "),
        (lambda f: color_model(f, ".onnx"), "it has 1 inputs and 1 outputs"),
        (lambda f: scripted(f / "pair.pt", Pair()), "it gives a tuple, not a tensor"),
        (lambda f: scripted(f / "nan.pt", Nothing()), "gives values that are not finite"),
        (
            lambda f: save_onnx(f / "map.onnx", ("a", "b"), [helper.make_node("Sub", ["a", "b"], ["out"])]),
            "map.onnx: gives (1, 3, 40, 70) values, not one",
        ),
        (lambda f: save_onnx(f / "fixed.onnx", ("a", "b"), FIXED, (1, 3, 64, 64)), "Got: 40 Expected: 64"),
    ],
)
def test_bad_models_are_one_line(make, line: str, tmp_path: Path, images: np.ndarray, capfd) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(SettingsError, match=r"give a model that takes two images") as caught:
        LpipsModel(make(tmp_path))(images[0], images[1])
    assert line in str(caught.value)
    assert len(str(caught.value)) < 500
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (lambda f: difference_model(f, ".pt"), "does not take (1, 3, 299, 299)"),
        (lambda f: difference_model(f, ".onnx"), "it has 2 inputs and 1 outputs"),
        (
            lambda f: save_onnx(f / "map.onnx", ("a",), [helper.make_node("Identity", ["a"], ["out"])]),
            "gives (1, 3, 299, 299) values for one image, not (1, D)",
        ),
    ],
)
def test_bad_features_are_one_line(make, line: str, tmp_path: Path, images: np.ndarray) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(SettingsError, match=r"\(N, 3, 299, 299\)") as caught:
        FeatureModel(make(tmp_path))(images[0])
    assert line in str(caught.value)
