"""The pipeline's rows on the small street: each delivers frames, better ones than the crowded street, on one scene."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.inpaint.networks import blur, from_reference
from tests.small_street import FRAMES, make_small_street
from unveil_core.app.cli import main
from unveil_core.bench.pipeline import NEEDS_WEIGHTS, bench_pipeline
from unveil_core.bench.rows import ROWS
from unveil_core.optimize.presets import PRESETS, ReconstructSettings
from unveil_core.optimize.reoptimize import REOPTIMIZE_PRESETS, ReoptimizeSettings
from unveil_core.optimize.start import StartSettings
from unveil_core.pipeline.settings import RunSettings
from unveil_core.semantics.classes import CITYSCAPES

DRAFT = RunSettings(quality="draft")
WITH_CHART = ("forward", "independent", "ellipsoids", "ours", "ours_by_reference")
ROAD, SIDEWALK = CITYSCAPES.index("road"), CITYSCAPES.index("sidewalk")
SMALL = ReconstructSettings(iterations=40, sh_degree=0, start=StartSettings(budget=3000), budget=4000)


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_small_street(tmp_path_factory.mktemp("street"))


@pytest.fixture(scope="module")
def told(street: Path, tmp_path_factory: pytest.TempPathFactory) -> dict:
    """All rows by the command line, with few steps."""
    folder = tmp_path_factory.mktemp("bench")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(PRESETS, "draft", SMALL)
        patch.setitem(REOPTIMIZE_PRESETS, "draft", ReoptimizeSettings(iterations=10, ground_spacing_m=0.2))
        command = ["bench", "pipeline", str(street), "--quality", "draft", "-o", str(folder / "rows.json")]
        assert main([*command, "--keep", str(folder / "kept"), "--scene", str(folder / "scene")]) == 0
    return {"folder": folder, **json.loads((folder / "rows.json").read_text())}


def test_every_row_runs_or_says_what_it_lacks(told: dict) -> None:
    rows = {row["row"]: row for row in told["rows"]}
    assert list(rows) == list(ROWS)
    for name, row in rows.items():
        if ROWS[name].weights:
            assert row["status"] == NEEDS_WEIGHTS and "ONNX" in row["mend"]
            continue
        assert row["status"] == "done" and row["seconds"] >= row["own_seconds"] >= 0 and row["peak_memory_mb"] > 50
        better = row["regions"]["removed"]["psnr"] - rows["input"]["regions"]["removed"]["psnr"]
        assert name == "input" or better > 1.0, (name, better)
        details = row["regions"]["removed"]
        assert details["gradient"] > 0 and 0 <= details["residue"] <= 1
        assert "gradient" not in row["regions"]["whole"]
        assert len(list((told["folder"] / "kept" / name).rglob("*.png"))) == FRAMES
    # What a row builds on counts for it; what it does not, does not.
    scene = sum(stage["seconds"] for stage in told["scene"].values())
    assert rows["spin_nerf"]["seconds"] - rows["spin_nerf"]["own_seconds"] == pytest.approx(scene, abs=0.05)
    assert rows["flow"]["seconds"] - rows["flow"]["own_seconds"] < 0.5 * scene
    assert rows["ours"]["regions"]["removed"]["psnr"] > rows["telea"]["regions"]["removed"]["psnr"]


def test_outside_the_masks_only_shadows_change(told: dict, street: Path) -> None:
    """Rows with the chart take shadows from the ground beside the masks; all others deliver the photographs there."""
    for row in told["rows"]:
        if row["status"] != "done":
            continue
        changed = np.zeros(0, bool)
        for i in range(FRAMES):
            photograph, frame = (
                cv2.imread(str(path))
                for path in (
                    street.parent / f"images/{i:02d}.png",
                    told["folder"] / f"kept/{row['row']}/camera/{i:02d}.png",
                )
            )
            outside = cv2.imread(str(told["folder"] / f"scene/masks/removed/camera/{i:02d}.png"), 0) == 0
            other = (frame != photograph).any(axis=2)
            label = cv2.imread(str(street.parent / f"semantics/{i:02d}.png"), cv2.IMREAD_UNCHANGED)
            assert np.isin(label[other & outside], (ROAD, SIDEWALK)).all(), row["row"]
            changed = np.concatenate([changed, other[outside]])
        assert (row["changed_outside"] > 0) == changed.any()
        # The street has no shadow but what the reconstruction takes for one.
        assert changed.mean() < (0.01 if row["row"] in WITH_CHART else 1e-9), row["row"]


def test_the_plot_lies_beside(told: dict) -> None:
    picture = cv2.imread(str(told["folder"] / "rows.png"))
    assert picture is not None and picture.shape[0] > 400


def test_the_scene_is_used_again(told: dict, street: Path) -> None:
    # Under the same limits; that nothing is reconstructed, the state tells.
    state = (told["folder"] / "scene/workspace.json").read_bytes()
    again = bench_pipeline(street, DRAFT, rows=("telea",), scene=told["folder"] / "scene")
    assert json.loads(state)["stages"] == json.loads((told["folder"] / "scene/workspace.json").read_bytes())["stages"]
    first = next(row for row in told["rows"] if row["row"] == "telea")
    assert again["rows"][0]["regions"] == first["regions"] and len(again["rows"]) == 1


def test_a_reference_model_is_given_the_later_frame(told: dict, street: Path) -> None:
    seen: list[np.ndarray] = []

    def mean_of_reference(image: np.ndarray, mask: np.ndarray, reference: np.ndarray) -> np.ndarray:
        seen.append(reference)
        return np.where(mask[..., None], reference.mean(axis=(0, 1)), 0).astype(np.uint8)

    keep = told["folder"] / "reference"
    done = bench_pipeline(
        street,
        DRAFT,
        rows=("reference_reverse",),
        scene=told["folder"] / "scene",
        keep=keep,
        reference=mean_of_reference,
    )
    assert done["rows"][0]["status"] == "done" and len(seen) >= 3
    # The first frame, which shows the car, comes last; its reference is the second, cleaned (but for the seam, and the
    # rim that rows fill and do not deliver).
    later = cv2.imread(str(keep / "reference_reverse/camera/01.png"))[..., ::-1]
    mask = cv2.imread(str(told["folder"] / "scene/masks/removed/camera/01.png"), 0) > 0
    inside = cv2.erode(mask.astype(np.uint8), np.ones((9, 9))) > 0
    outside = cv2.dilate(mask.astype(np.uint8), np.ones((9, 9))) == 0
    same = (seen[-1] == later).all(axis=2)
    assert inside.sum() > 50 and same[outside].all() and same[inside].all()


def test_rows_of_networks_run_when_files_are_given(told: dict, street: Path, tmp_path: Path) -> None:
    """By real ONNX files: one that continues what is around, and one that takes the reference."""
    network, reference = blur(tmp_path / "around.onnx", 12), from_reference(tmp_path / "reference.onnx")
    rows = ["network_per_frame", "reference_reverse", "ours_by_reference"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(REOPTIMIZE_PRESETS, "draft", ReoptimizeSettings(iterations=10, ground_spacing_m=0.2))
        patch.setitem(PRESETS, "draft", SMALL)
        command = ["bench", "pipeline", str(street), "--quality", "draft", "--rows", ",".join(rows), "-o"]
        command += [str(tmp_path / "rows.json"), "--scene", str(told["folder"] / "scene"), "--keep", str(tmp_path)]
        assert main([*command, "--inpainter", str(network), "--reference-inpainter", str(reference)]) == 0
    found = json.loads((tmp_path / "rows.json").read_text())
    assert found["inpainter"] == "around.onnx" and found["reference_inpainter"] == "reference.onnx"
    crowded = next(row for row in told["rows"] if row["row"] == "input")["regions"]["removed"]["psnr"]
    for row in found["rows"]:
        assert row["status"] == "done", row
        better = row["regions"]["removed"]["psnr"] - crowded
        # The reference is taken pixel for pixel: the street has moved on.
        assert better > (-1 if row["row"] == "reference_reverse" else 1), (row["row"], better)
    ours = next(row for row in told["rows"] if row["row"] == "ours")["regions"]["removed"]["psnr"]
    assert abs(found["rows"][2]["regions"]["removed"]["psnr"] - ours) < 2
