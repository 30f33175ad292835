"""A clean frame that a person mended, through a whole run whose footage is larger, in a lens and has 16 bits."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.pipeline.test_deliver import HEIGHT, SETTINGS, WIDTH, done, street
from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.base.pictures.decoding import read_label_image
from unveil_core.delivery.lens import footage_positions
from unveil_core.drives.imported import read_imported
from unveil_core.inpaint.origin import INVENTED
from unveil_core.pipeline.run import run_verb
from unveil_core.workspace.workspace import Workspace

__all__ = ["done", "street"]

OWN = "03"
PAINT = np.array([0.1, 0.9, 0.2])
PATCH = np.array([[8.0, -3.0, 0], [11.0, -3.0, 0], [11.0, -1.9, 0], [8.0, -1.9, 0]])
"""Corners of a place on the road, beside and behind the car, in the drive's own coordinates."""


def outline(ws: Workspace, name: str) -> np.ndarray:
    """(H, W) bool, where the footage of a frame shows the place."""
    drive = read_imported(ws.drive_dir, points=False)
    frame = next(f for f in drive.frames if f.name == name)
    along = np.linspace(0, 1, 40)[:, None]
    ring = np.concatenate([a * (1 - along) + b * along for a, b in zip(PATCH, np.roll(PATCH, -1, axis=0), strict=True)])
    assert frame.footage is not None
    pixels, depth = footage_positions(frame.footage, drive.to_world.to_local(ring))
    shown = np.zeros((HEIGHT, WIDTH), np.uint8)
    if (depth > 0.3).all():
        cv2.fillPoly(shown, [np.round(pixels - 0.5).astype(np.int32)], 1)
    return shown.astype(bool)


def delivered(ws: Workspace, name: str) -> np.ndarray:
    picture = cv2.imread(str(ws.root / f"frames/camera/{name}.png"), cv2.IMREAD_UNCHANGED)
    return picture[..., ::-1].astype(np.float64) / 65535


def mended(ws: Workspace, folder: Path, entry: dict[str, object], rgba: np.ndarray) -> tuple[Workspace, Path]:
    """A copy of a workspace that was run on with a correction, and the file of that."""
    shutil.copytree(ws.root, folder / "ws")
    cv2.imwrite(str(folder / "paint.png"), cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGRA))
    (folder / "corrections.json").write_text(json.dumps([{"camera": "camera", "image": "paint.png", **entry}]))
    found = Workspace.open(folder / "ws")
    settings = replace(SETTINGS, corrections=str(folder / "corrections.json"))
    for verb in ("reoptimize", "deliver"):
        run_verb(verb, found.root, settings)
    return found, folder / "corrections.json"


@pytest.fixture(scope="module")
def painted(done: Workspace, tmp_path_factory: pytest.TempPathFactory) -> tuple[Workspace, np.ndarray]:
    rgba = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    where = outline(done, OWN)
    rgba[where] = np.append(np.round(PAINT * 255), 255)
    return mended(done, tmp_path_factory.mktemp("painted"), {"frame": OWN}, rgba)[0], where


def test_the_frame_itself_is_as_it_was_painted(painted: tuple[Workspace, np.ndarray]) -> None:
    ws, where = painted
    assert np.abs(delivered(ws, OWN)[where] - np.round(PAINT * 255) / 255).max() < 2e-5 and where.sum() > 100


def test_all_other_frames_follow(done: Workspace, painted: tuple[Workspace, np.ndarray]) -> None:
    """By as much as the place's depth is known: most of what they show of it, and nothing elsewhere."""
    ws, _ = painted
    seen = 0
    for name in (f"{i:02d}" for i in range(8) if f"{i:02d}" != OWN):
        where = outline(done, name)
        if where.sum() < 60:
            continue
        seen += 1
        after, before = delivered(ws, name), delivered(done, name)
        inner = cv2.erode(where.astype(np.uint8), np.ones((3, 3))).astype(bool)
        beyond = ~cv2.dilate(where.astype(np.uint8), np.ones((9, 9))).astype(bool)
        green = (after[..., 1] > 0.6) & (after[..., 0] < 0.4)
        assert green[inner].mean() > 0.85, name
        assert green[beyond].mean() < 0.005, name
        masks = [ws.root / f"masks/{n}/camera/{name}.png" for n in ("removed", "shadows")]
        goes = cv2.resize(np.maximum(*(read_label_image(m) for m in masks)), (WIDTH, HEIGHT))
        still = beyond & ~cv2.dilate(goes, np.ones((15, 15))).astype(bool)
        assert np.array_equal(after[still], before[still]) and still.mean() > 0.2
        origin = read_label_image(ws.root / f"provenance/camera/{name}.png")
        assert (origin[cv2.resize(inner.astype(np.uint8), origin.shape[::-1]) > 0] == INVENTED).mean() > 0.8
    assert seen >= 4


def test_the_scene_follows(done: Workspace, painted: tuple[Workspace, np.ndarray]) -> None:
    """What is rendered of it, where its surfels may change."""
    renders = [cv2.imread(str(w.root / f"renders/camera/{OWN}.png"))[..., ::-1] / 255.0 for w in (done, painted[0])]
    size = renders[0].shape[1::-1]
    where = cv2.resize(painted[1].astype(np.uint8), size) > 0
    distance = [np.abs(r - PAINT).mean(axis=2)[where].mean() for r in renders]
    assert distance[1] < 0.5 * distance[0]


def test_only_what_follows_from_it_is_made_again(painted: tuple[Workspace, np.ndarray], done: Workspace) -> None:
    stages, before = painted[0].state()["stages"], done.state()["stages"]
    same = {name for name in before if stages[name]["input_hash"] == before[name]["input_hash"]}
    assert set(before) - same == {"reoptimize", "deliver"}


def test_a_picture_that_was_painted_over_counts_where_it_differs(
    done: Workspace, painted: tuple[Workspace, np.ndarray], tmp_path: Path
) -> None:
    """Not where a program changed it by a level of 8 bits."""
    before = cv2.imread(str(done.root / f"frames/camera/{OWN}.png"), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(tmp_path / "before.png"), before)
    generator = np.random.default_rng(0)
    over = np.clip(before.astype(np.int64) + generator.integers(-256, 257, before.shape), 0, 65535)
    over[painted[1]] = np.round(PAINT[::-1] * 65535)
    rgba = cv2.cvtColor(over.astype(np.uint16), cv2.COLOR_BGR2RGBA)
    ws, _ = mended(done, tmp_path, {"frame": OWN, "over": "before.png"}, rgba)
    after = delivered(ws, OWN)
    assert np.abs(after[painted[1]] - PAINT).max() < 2e-5
    beside = np.abs(after - delivered(painted[0], OWN)).max(axis=2)[~painted[1]]
    assert np.median(beside) == 0
    assert (beside > 0.02).mean() < 1e-3, (
        "what is optimized anew differs a little, and the layer that is taken in a few pixels"
    )


def test_what_is_marked_as_wrong_is_invented_anew(done: Workspace, tmp_path: Path) -> None:
    """And not with the colours that marked it."""
    rgba = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    where = outline(done, OWN)
    rgba[where] = (255, 0, 255, 255)
    ws, _ = mended(done, tmp_path, {"frame": OWN, "invent": True}, rgba)
    after = delivered(ws, OWN)
    inner = cv2.erode(where.astype(np.uint8), np.ones((5, 5))).astype(bool)
    assert not np.array_equal(after[inner], delivered(done, OWN)[inner])
    assert np.abs(after[inner].mean(axis=0) - 0.42).max() < 0.15  # grey as the road around it


@pytest.mark.parametrize(
    ("entries", "error", "said"),
    [
        ({}, DriveError, "holds no list of corrections"),
        ([{"camera": "camera", "frame": "03"}], DriveError, "Not a correction: entry 0"),
        ([{"camera": "camera", "frame": "03", "image": "p.png", "invent": 1}], DriveError, "neither true nor false"),
        ([{"camera": "camera", "frame": "03", "image": "p.png"}] * 2, DriveError, "is corrected twice"),
        ([{"camera": "camera", "frame": "77", "image": "p.png"}], SettingsError, "has no frame 77 of camera camera"),
        ([{"camera": "camera", "frame": "03", "image": "no.png"}], DriveError, "no.png"),
        (
            [{"camera": "camera", "frame": "03", "image": "small.png"}],
            DriveError,
            "Not the size of frame 03: 8x8 pixels, the frame has 128x80",
        ),
        ([{"camera": "camera", "frame": "03", "image": "rgb.png"}], DriveError, "has no transparency"),
    ],
)
def test_what_is_no_correction_is_told(
    done: Workspace, tmp_path: Path, entries: object, error: type[Exception], said: str
) -> None:
    cv2.imwrite(str(tmp_path / "p.png"), np.zeros((HEIGHT, WIDTH, 4), np.uint8))
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((8, 8, 4), np.uint8))
    cv2.imwrite(str(tmp_path / "rgb.png"), np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    (tmp_path / "c.json").write_text(json.dumps(entries))
    shutil.copytree(done.root, tmp_path / "ws")
    with pytest.raises(error, match=said):
        run_verb("reoptimize", tmp_path / "ws", replace(SETTINGS, corrections=str(tmp_path / "c.json")))


# --------------------------------------------------------------------------------------------------------- single objects


def test_a_mask_is_enlarged_by_pixels_of_the_delivered_frame(done: Workspace, tmp_path: Path) -> None:
    """8 of 128 are 6 of 96."""
    shutil.copytree(done.root, tmp_path / "ws")
    run_verb("remove", tmp_path / "ws", replace(SETTINGS, per_object=("5:grow=8",)))
    grown = 0
    for i in range(8):
        before, after = (
            read_label_image(r / f"masks/removed/camera/{i:02d}.png") > 0 for r in (done.root, tmp_path / "ws")
        )
        allowed = cv2.dilate(before.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (15, 15))) > 0
        assert (after | ~before).all() and not (after & ~allowed).any()
        least = cv2.dilate(before.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9))) > 0
        assert (after & least).sum() > 0.98 * least.sum()
        grown += int(after.sum()) - int(before.sum())
    assert grown > 500
