"""A scene in Python is the one that ``unveil render`` shows, to the last bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import unveil_core as unveil
from tests.exact_scene import build_exact_workspace
from unveil_core.app.cli import main
from unveil_core.app.render_views import DEPTH_STEPS_PER_M
from unveil_core.base.errors import SettingsError
from unveil_core.base.kernels.device import CPU, Device
from unveil_core.base.pictures.decoding import read_image, read_instance_image, read_label_image

PLANES = ("rgb", "depth", "normal", "alpha", "semantics")


@pytest.fixture(scope="module")
def exact(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_exact_workspace(tmp_path_factory.mktemp("exact"))


def test_it_shows_what_the_command_shows(exact: Path, tmp_path: Path) -> None:
    command = ["render", str(exact), "--above", "0.3", "--planes", ",".join(PLANES), "-o", str(tmp_path / "out")]
    assert main(command) == 0
    space = unveil.Workspace.open(exact)
    scene, frame = space.scene("empty"), space.frames(size="work")[2]
    camera = frame.camera
    pose = camera.world_to_camera.copy()
    pose[:3, 3] -= camera.world_to_camera[:3, :3] @ (0.0, 0.0, 0.3)  # up in the world, as --above
    moved = type(camera)(*camera.intrinsics, pose)
    rgb, depth, normal, alpha, semantics = scene.render(moved, PLANES)
    name = f"{frame.name}.png"
    assert np.array_equal(rgb, read_image(tmp_path / "out/rgb" / name))
    assert np.array_equal(np.round(depth * DEPTH_STEPS_PER_M), read_instance_image(tmp_path / "out/depth" / name))
    assert np.array_equal(semantics, read_label_image(tmp_path / "out/semantics" / name))
    assert np.abs(alpha * 255 - read_label_image(tmp_path / "out/alpha" / name)).max() <= 0.5 + 1e-4
    length = np.linalg.norm(normal, axis=-1)
    assert np.allclose(length[depth > 0], 1, atol=1e-5) and (length[depth == 0] == 0).all()


def test_surfels_are_tensors_and_scenes_are_kept(exact: Path) -> None:
    space = unveil.Workspace.open(exact)
    full, empty = space.scene("full"), space.scene()
    assert full is space.scene("full") and full.state == "full" and empty.state == "empty"
    count = len(full.surfels)
    assert isinstance(full.surfels.means, torch.Tensor) and full.surfels.means.shape == (count, 3)
    names = full.labels.labels.names
    assert "car" in names and (full.surfels.labels == names.index("car")).any()
    camera = space.frames(size="work")[0].camera
    assert (full.render(camera) != empty.render(camera)).any()
    with pytest.raises(SettingsError, match="Not a plane: colour"):
        full.render(camera, "colour")
    with pytest.raises(SettingsError, match="Not a state: half"):
        space.scene("half")  # type: ignore[arg-type]


def test_a_camera_is_moved_along_its_own_axes(exact: Path) -> None:
    camera = unveil.Workspace.open(exact).frames(size="work")[0].camera
    right, down, ahead = camera.world_to_camera[:3, :3]
    moved = camera.moved(right=1.5, up=0.5, ahead=-2.0)
    assert np.allclose(moved.centre - camera.centre, 1.5 * right - 0.5 * down - 2.0 * ahead)
    assert np.array_equal(moved.forward, camera.forward)


def test_a_device_can_be_chosen_and_is_refused_in_one_line(exact: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = unveil.Workspace.open(exact).frames(size="work")[0]
    scene = unveil.Workspace.open(exact).scene("empty")
    asked: list[str] = []

    def told(setting: str) -> Device:
        asked.append(setting)
        return CPU

    with monkeypatch.context() as patch:
        patch.setattr("unveil_core.api.scenes.chosen_device", told)
        planes = [scene.render(frame.camera, "depth", device=d) for d in ("auto", "cpu")]
        assert np.array_equal(planes[0], planes[1]) and np.array_equal(frame.depth(device="cuda"), planes[0])
        assert asked == ["auto", "cpu", "cuda"]
    monkeypatch.setattr(torch.version, "cuda", None)
    with pytest.raises(SettingsError, match="no GPU can be used: this torch is a build without CUDA"):
        scene.render(frame.camera, device="cuda")
    with pytest.raises(SettingsError, match="Not a choice of device: 'gpu'.*auto, cpu, cuda"):
        scene.render(frame.camera, device="gpu")  # type: ignore[call-overload]
