"""A workspace measured: numbers against direct computation, and what happens when parts are missing."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.evaluate.street_workspace import build_workspace
from tests.mesh.street import cast, street_camera
from unveil_core.base.errors import Cancelled, WorkspaceError
from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import read_image, read_label_image
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.drives.drive import Frame
from unveil_core.evaluate import evaluation, psnr, run_evaluation, ssim, write_metrics
from unveil_core.evaluate.baselines import telea
from unveil_core.evaluate.frame_scores import FrameScores, Sources


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_workspace(tmp_path_factory.mktemp("street"))


@pytest.fixture
def workspace(finished: Path, tmp_path: Path) -> Path:
    shutil.copytree(finished.parent, tmp_path / "copy")
    (tmp_path / "copy/workspace/drive/cameras.json").write_text(
        (finished / "drive/cameras.json").read_text().replace(str(finished.parent), str(tmp_path / "copy"))
    )
    return tmp_path / "copy/workspace"


def stacked(folder: Path, label: bool = False) -> np.ndarray:
    files = sorted(folder.glob("*.png"))
    return np.stack([read_label_image(f) if label else read_image(f) for f in files])


def test_numbers_are_those_of_the_pixels(finished: Path) -> None:
    truth = finished.parent / "drive_on_disk/truth"
    metrics = run_evaluation(finished)
    street, removed = stacked(truth / "images"), stacked(truth / "removed", label=True) > 0
    hidden = stacked(truth / "unseen", label=True) > 0
    delivered = stacked(finished / "frames/front")
    photographs = stacked(finished.parent / "drive_on_disk/images")
    error = ((delivered / 255.0 - street / 255.0) ** 2).mean(axis=-1)
    regions = metrics["truth"]["regions"]
    for name, mask in (("removed", removed), ("unseen", hidden), ("seen_elsewhere", removed & ~hidden)):
        assert regions[name]["pixels"] == mask.sum()
        assert regions[name]["methods"]["ours"]["psnr"] == pytest.approx(-10 * np.log10(error[mask].mean()), abs=1e-4)
    per_frame = [psnr(d, s, m) for d, s, m in zip(delivered, street, removed, strict=True)]
    assert regions["removed"]["methods"]["ours"]["psnr_frame_mean"] == pytest.approx(np.mean(per_frame), abs=1e-4)
    similar = [ssim(d, s, m) for d, s, m in zip(delivered, street, removed, strict=True)]
    assert regions["removed"]["methods"]["ours"]["ssim_frame_mean"] == pytest.approx(np.mean(similar), abs=1e-4)
    filled = [telea(p, m) for p, m in zip(photographs, removed, strict=True)]
    squared = ((np.stack(filled) / 255.0 - street / 255.0) ** 2).mean(axis=-1)
    assert regions["removed"]["methods"]["telea"]["psnr"] == pytest.approx(
        -10 * np.log10(squared[removed].mean()), abs=1e-4
    )
    untouched = ((photographs / 255.0 - street / 255.0) ** 2).mean(axis=-1)
    assert regions["whole"]["methods"]["input"]["psnr"] == pytest.approx(-10 * np.log10(untouched.mean()), abs=1e-4)


def test_order_of_the_methods(finished: Path) -> None:
    """Noise of 4 levels is 36 dB: better than any single-image filling, which is better than leaving the car."""
    methods = run_evaluation(finished)["truth"]["regions"]["removed"]["methods"]
    assert set(methods) == {"ours", "render", "input", "telea", "shift_map"}
    assert methods["ours"]["psnr"] == pytest.approx(36, abs=0.7)
    assert methods["ours"]["psnr"] > methods["render"]["psnr"] > methods["telea"]["psnr"] > methods["input"]["psnr"]
    assert methods["ours"]["ssim"] > methods["telea"]["ssim"]


def test_without_baselines_all_else_is_the_same(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = run_evaluation(finished)
    monkeypatch.setattr("unveil_core.evaluate.frame_scores.BASELINES", {"telea": lambda *_: pytest.fail("was run")})
    alone = run_evaluation(finished, baselines=False)
    assert alone["truth"]["baseline_seconds_per_frame"] == {}
    for figures in (whole, alone):
        figures["truth"].pop("baseline_seconds_per_frame")
        for methods in [r["methods"] for r in figures["truth"]["regions"].values()]:
            for name in ("telea", "shift_map"):
                methods.pop(name, None)
    assert alone["truth"] == whole["truth"] and alone["coverage"] == whole["coverage"]


def test_details_tell_blur_lines_and_what_is_left(workspace: Path) -> None:
    """The true street is right by all figures; the cars left standing are found, and by their numbers."""
    regions = run_evaluation(workspace)["truth"]["regions"]
    assert regions["removed"]["methods"]["input"]["residue"] > 0.5
    assert regions["removed"]["methods"]["ours"]["residue"] < 0.02
    assert "residue" not in regions["whole"]["methods"]["ours"]
    truth = workspace.parent / "drive_on_disk/truth"
    for path in sorted((truth / "images").glob("*.png")):
        shutil.copy(path, workspace / "frames/front" / path.name)
    metrics = run_evaluation(workspace)
    exact = metrics["truth"]["regions"]["removed"]["methods"]["ours"]
    assert [exact[k] for k in ("gradient", "residue")] == [1.0, 0.0]
    assert [exact[k] for k in ("line_recall", "false_lines")] == [1.0, 0.0]
    assert metrics["per_frame"][0]["gradient"]["ours"] == 1.0
    assert all(entry["left"] == 0 for entry in metrics["truth"]["residue_by_object"])
    shutil.copytree(workspace.parent / "drive_on_disk/images", workspace / "frames/front", dirs_exist_ok=True)
    left = run_evaluation(workspace)["truth"]["residue_by_object"]
    assert {(entry["id"], entry["class"]) for entry in left} <= {(1, "car"), (2, "car"), (3, "car")}
    assert left[0]["residue"] > 0.3 and left[0]["left"] >= left[-1]["left"]


def test_objects_that_stay_are_no_residue(workspace: Path) -> None:
    path = workspace / "instances.json"
    entries = json.loads(path.read_text())
    entries[0]["removed"] = False
    path.write_text(json.dumps(entries))
    assert 1 not in {entry["id"] for entry in run_evaluation(workspace)["truth"]["residue_by_object"]}
    path.write_text("{")
    with pytest.raises(WorkspaceError, match=r"instances\.json"):
        run_evaluation(workspace)


def test_untouched_pixels_and_masks(finished: Path) -> None:
    metrics = run_evaluation(finished)
    assert metrics["untouched"]["max"] == 0
    assert metrics["untouched"]["mean"] == 0
    assert metrics["truth"]["unobserved_mask_iou"] == 1.0
    assert 0.3 < metrics["truth"]["removed_mask_iou"] < 1
    removed = stacked(finished / "masks/removed/front", label=True) > 0
    assert metrics["coverage"]["removed"] == pytest.approx(removed.mean(), abs=1e-4)


def test_a_touched_pixel_is_found(workspace: Path) -> None:
    path = workspace / "frames/front/0001.png"
    picture = read_image(path)
    picture[0, 0, 1] ^= 8
    write_image_atomic(path, picture)
    metrics = run_evaluation(workspace)
    assert metrics["untouched"]["max"] == 8
    assert metrics["untouched"]["mean"] > 0
    assert [f["untouched_max"] for f in metrics["per_frame"]] == [0, 8, 0]


def test_without_truth(workspace: Path) -> None:
    shutil.rmtree(workspace.parent / "drive_on_disk/truth")
    metrics = run_evaluation(workspace)
    assert "truth" not in metrics
    assert metrics["untouched"]["max"] == 0
    assert 0 < metrics["coverage"]["unobserved_of_removed"] < 1
    assert "psnr" not in metrics["per_frame"][0]


def test_truth_given_by_hand_of_another_size_and_kind(workspace: Path, tmp_path: Path) -> None:
    """Twice as large, JPEG, without masks: the region is the workspace's own mask."""
    own = workspace.parent / "drive_on_disk/truth"
    elsewhere = tmp_path / "elsewhere"
    (elsewhere / "images").mkdir(parents=True)
    for path in sorted((own / "images").glob("*.png")):
        large = np.repeat(np.repeat(read_image(path), 2, axis=0), 2, axis=1)
        cv2.imwrite(str(elsewhere / f"images/{path.stem}.jpg"), large[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 98])
    shutil.rmtree(own)
    metrics = run_evaluation(workspace, elsewhere)
    removed = stacked(workspace / "masks/removed/front", label=True) > 0
    region = metrics["truth"]["regions"]["removed"]
    assert region["pixels"] == removed.sum()
    assert 33 < region["methods"]["ours"]["psnr"] < 37
    assert "unobserved_mask_iou" not in metrics["truth"]
    assert "cast_shadow" not in metrics["truth"]["regions"]


def test_truth_for_some_frames(workspace: Path) -> None:
    (workspace.parent / "drive_on_disk/truth/images/0001.png").unlink()
    metrics = run_evaluation(workspace)
    assert metrics["frames"] == 3
    assert metrics["truth"]["frames"] == 2


def test_flicker_by_the_true_depth(workspace: Path) -> None:
    """The delivery's noise of 4 levels, anew in each frame, is what flickers; the true street does so by sampling only."""
    assert "flicker" not in run_evaluation(workspace)  # nothing tells how far away the street is
    truth = workspace.parent / "drive_on_disk/truth"
    for i, path in enumerate(sorted((truth / "images").glob("*.png"))):
        depth = cast(street_camera(1.2 * i))["depth"][1::2, 1::2]
        write_image_atomic(truth / "depth" / path.name, np.round(depth * 256).astype(np.uint16))
    found = run_evaluation(workspace)["flicker"]
    assert found["depth"] == "truth" and found["pairs"] == 2 and found["pixels"] > 100
    assert set(found["methods"]) == {"ours", "render", "telea", "shift_map", "truth"}
    squared = {name: m["squared"] for name, m in found["methods"].items()}
    # Two draws of noise add up, the interpolated one at 4/9 on average of its variance at least, at 1 at most.
    assert 16 * 1.4 < squared["ours"] - squared["truth"] < 16 * 2.2
    assert 3 < (squared["render"] - squared["truth"]) / (squared["ours"] - squared["truth"]) < 5


def test_long_drives_fill_some_frames_only(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unveil_core.evaluate.baselines.BASELINE_FRAMES", 2)
    methods = run_evaluation(finished)["truth"]["regions"]["removed"]["methods"]
    assert {name: m["frames"] for name, m in methods.items()} == {
        "ours": 3,
        "render": 3,
        "input": 3,
        "telea": 2,
        "shift_map": 2,
    }


def test_exact_delivery_is_json(workspace: Path, tmp_path: Path) -> None:
    for path in sorted((workspace.parent / "drive_on_disk/truth/images").glob("*.png")):
        shutil.copy(path, workspace / "frames/front" / path.name)
    metrics = run_evaluation(workspace)
    assert metrics["truth"]["regions"]["removed"]["methods"]["ours"]["psnr"] is None
    assert metrics["truth"]["regions"]["removed"]["methods"]["ours"]["ssim"] == 1.0
    write_metrics(metrics, tmp_path / "out/metrics.json")
    assert json.loads((tmp_path / "out/metrics.json").read_text()) == metrics


def test_missing_parts_are_one_line(workspace: Path, tmp_path: Path) -> None:
    with pytest.raises(WorkspaceError, match="images"):
        run_evaluation(workspace, tmp_path / "nowhere")
    (tmp_path / "other/images").mkdir(parents=True)
    with pytest.raises(WorkspaceError, match="none of the drive's frames"):
        run_evaluation(workspace, tmp_path / "other")
    (workspace / "frames/front/0002.png").unlink()
    with pytest.raises(WorkspaceError, match=r"0002\.png.*unveil deliver"):
        run_evaluation(workspace)


def test_progress_and_cancel(finished: Path) -> None:
    seen: list[int] = []
    run_evaluation(finished, progress=lambda done, total, message="", **m: seen.append(done))
    assert seen == [1, 2, 3]

    def stop(done: int, total: int, message: str = "", **metrics: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        run_evaluation(finished, progress=stop)


def test_nothing_is_written(finished: Path) -> None:
    before = sorted((p, p.stat().st_mtime_ns) for p in finished.rglob("*"))
    run_evaluation(finished)
    assert sorted((p, p.stat().st_mtime_ns) for p in finished.rglob("*")) == before


def test_it_goes_on_where_it_was_interrupted(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluation, "TOGETHER", 2)
    score_frame, scored = evaluation.score_frame, []

    def counted(sources: Sources, frame: Frame, with_baselines: bool) -> FrameScores:
        scored.append(frame.name)
        return score_frame(sources, frame, with_baselines)

    monkeypatch.setattr(evaluation, "score_frame", counted)
    whole = without_seconds(run_evaluation(finished))
    frames = len(scored)

    def stop(done: int, total: int, message: str = "", **metrics: float) -> None:
        if (done, message) == (3, "measuring"):
            raise Cancelled

    kept = Kept(tmp_path, every_s=0.0)
    with pytest.raises(Cancelled):
        run_evaluation(finished, progress=stop, kept=kept)
    scored.clear()
    assert without_seconds(run_evaluation(finished, kept=kept)) == whole
    assert len(scored) == frames - 2 > 0


def without_seconds(metrics: dict[str, Any]) -> str:
    """All figures but those that a clock gives."""

    def bare(value: Any) -> Any:
        if isinstance(value, dict):
            return {k: bare(v) for k, v in value.items() if "seconds" not in k}
        return [bare(v) for v in value] if isinstance(value, list) else value

    return json.dumps(bare(metrics), sort_keys=True)
