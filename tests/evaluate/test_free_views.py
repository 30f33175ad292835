"""Free viewpoints measured: numbers against direct computation, and a scene that holds from its own cameras only is found out."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from tests.exact_scene import build_exact_workspace
from unveil_core.app.render_views import render_views
from unveil_core.base.errors import DriveError, UnveilError, WorkspaceError
from unveil_core.base.files import write_image_atomic, write_json_atomic
from unveil_core.base.pictures.decoding import read_image, read_label_image
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate import run_evaluation, ssim
from unveil_core.evaluate.free_views import measure_free_views
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.surfels import Surfels
from unveil_core.workspace.workspace import Workspace


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_exact_workspace(tmp_path_factory.mktemp("exact"))


@pytest.fixture
def workspace(finished: Path, tmp_path: Path) -> Path:
    """A copy to break, with its own truth."""
    shutil.copytree(finished.parent, tmp_path / "copy")
    cameras = tmp_path / "copy/workspace/drive/cameras.json"
    cameras.write_text(cameras.read_text().replace(str(finished.parent), str(tmp_path / "copy")))
    return tmp_path / "copy/workspace"


def measured(workspace: Path, recorded: dict[str, Any] | None = None) -> dict[str, Any]:
    drive = read_imported(workspace / "drive")
    found = measure_free_views(workspace, drive, drive.truth_root, recorded or {})
    assert found is not None
    return found


def test_numbers_are_those_of_the_pixels(finished: Path, tmp_path: Path) -> None:
    """Against what ``unveil render`` writes for the same cameras."""
    free = finished.parent / "street/truth/free"
    render_views(Workspace.open(finished), tmp_path, path=free / "transforms.json")
    found = measured(finished, {"removed": {"methods": {"render": {"psnr": 33.0}}}})
    errors, masks, similar = {}, {}, {}
    for name in ("01_beside", "05_beside", "01_above", "05_above"):
        street = read_image(free / f"images/{name}.png")
        picture = read_image(tmp_path / f"rgb/{name.split('_')[1]}/{name}.png")
        errors[name] = ((picture / 255.0 - street / 255.0) ** 2).mean(axis=-1)
        masks[name] = read_label_image(free / f"removed/{name}.png") > 127
        similar[name] = ssim(picture, street)
    whole, removed = np.stack(list(errors.values())), np.stack(list(masks.values()))
    assert found["views"] == 4 and removed.sum() > 1000
    for region, values in (("free_whole", whole.ravel()), ("free_removed", whole[removed])):
        score = found["regions"][region]
        assert score["psnr"] == pytest.approx(-10 * np.log10(values.mean()), abs=1e-6)
        assert (score["pixels"], score["views"]) == (len(values), 4)
    assert found["regions"]["free_whole"]["ssim"] == pytest.approx(np.mean(list(similar.values())), abs=1e-6)
    beside = np.stack([errors[n] for n in errors if "beside" in n])
    assert found["tracks"]["beside"]["free_whole"]["psnr"] == pytest.approx(-10 * np.log10(beside.mean()), abs=1e-6)
    assert found["below_recorded"] == {"free_removed": pytest.approx(33.0 - found["regions"]["free_removed"]["psnr"])}
    assert [(v["view"], v["track"]) for v in found["per_view"]] == [(n, n.split("_")[1]) for n in errors]


def test_a_scene_that_holds_from_its_cameras_only(workspace: Path) -> None:
    """Everything twice as far from the middle of the path, and twice as large: its pictures from there are nearly the same."""
    before = measured(workspace)["regions"]
    drive = read_imported(workspace / "drive")
    path = workspace / "surfels/empty.ply"
    surfels = read_surfels(path)
    eye = torch.from_numpy(drive.frames[4].camera.centre).float()
    larger = Surfels(
        eye + 2 * (surfels.means - eye),
        surfels.quats,
        surfels.log_scales + np.log(2),
        surfels.opacity_logits,
        surfels.sh,
        surfels.labels,
    )
    write_surfels(larger, path)
    after = measured(workspace)["regions"]
    assert before["free_removed"]["psnr"] > 25 and after["free_removed"]["psnr"] < before["free_removed"]["psnr"] - 5
    assert after["free_whole"]["psnr"] < before["free_whole"]["psnr"] - 3


def test_what_no_frame_showed_is_told_apart(workspace: Path) -> None:
    free = workspace.parent / "street/truth/free"
    whole = measured(workspace)["regions"]["free_removed"]["pixels"]
    unseen = 0
    for path in sorted((free / "removed").iterdir()):
        mask = read_label_image(path)
        mask[: len(mask) // 2] = 0
        unseen += int((mask > 0).sum())
        write_image_atomic(free / "unseen" / path.name, mask)
    regions = measured(workspace)["regions"]
    assert regions["free_unseen"]["pixels"] == unseen > 0
    assert regions["free_seen_elsewhere"]["pixels"] == whole - unseen > 0


def test_it_is_part_of_an_evaluation(workspace: Path) -> None:
    """With the frames delivered as photographed and rendered as they are in truth: only the free views have errors."""
    truth = workspace.parent / "street/truth/images"
    for path in sorted(truth.iterdir()):
        for folder in ("frames", "renders"):
            (workspace / folder / "camera").mkdir(parents=True, exist_ok=True)
            shutil.copy(path, workspace / folder / "camera" / path.name)
    seen: list[tuple[int, int]] = []
    metrics = run_evaluation(workspace, progress=lambda done, total, message="", **m: seen.append((done, total)))
    assert seen[-4:] == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert metrics["free_views"]["regions"]["free_removed"]["psnr"] == round(
        measured(workspace)["regions"]["free_removed"]["psnr"], 4
    )
    # Renders that agree exactly have no finite PSNR to lie below of.
    assert metrics["free_views"]["below_recorded"] == {}
    render = read_image(workspace / "renders/camera/03.png")
    render[40, 60] ^= 8
    write_image_atomic(workspace / "renders/camera/03.png", render)
    assert run_evaluation(workspace)["free_views"]["below_recorded"]["free_whole"] > 10
    write_json_atomic(workspace / "metrics.json", metrics)


@pytest.mark.parametrize("lacking", ["truth", "cameras", "scene"])
def test_nothing_to_measure_is_no_error(lacking: str, workspace: Path) -> None:
    drive = read_imported(workspace / "drive")
    if lacking == "cameras":
        (workspace.parent / "street/truth/free/transforms.json").unlink()
    if lacking == "scene":
        (workspace / "surfels/empty.ply").unlink()
    assert measure_free_views(workspace, drive, None if lacking == "truth" else drive.truth_root, {}) is None


def other_size(free: Path) -> None:
    path = free / "images/05_above.png"
    write_image_atomic(path, read_image(path)[:-1])


def other_mask(free: Path) -> None:
    path = free / "removed/05_above.png"
    write_image_atomic(path, read_label_image(path)[:-1])


def no_picture(free: Path) -> None:
    (free / "images/05_above.png").unlink()


def no_pose(free: Path) -> None:
    data = json.loads((free / "transforms.json").read_text())
    del data["frames"][1]["transform_matrix"]
    (free / "transforms.json").write_text(json.dumps(data))


@pytest.mark.parametrize(
    ("damage", "kind", "line"),
    [
        (other_size, WorkspaceError, "05_above.png: Not the size of its camera: 128x79 pixels, the camera says 128x80"),
        (other_mask, WorkspaceError, "05_above.png: Not the size of its picture"),
        (no_picture, WorkspaceError, "05_above: has no true picture"),
        (no_pose, DriveError, "transforms.json: Not a 4x4 matrix: the pose of frame 05_beside"),
    ],
)
def test_damage_is_one_line(
    damage: Callable[[Path], None], kind: type[UnveilError], line: str, workspace: Path
) -> None:
    damage(workspace.parent / "street/truth/free")
    with pytest.raises(kind) as error:
        measured(workspace)
    assert line in str(error.value) and "\n" not in str(error.value)
