"""Views held out, and what is said of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from tests.small_street import make_small_street
from unveil_core.drives import open_drive
from unveil_core.evaluate.held_out import class_iou, evaluate_views, split_drive
from unveil_core.semantics.labels import choose_labels
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels


def test_every_nth_frame_is_held_out_but_never_the_ends(tmp_path: Path) -> None:
    drive = open_drive(make_small_street(tmp_path))
    training, held = split_drive(drive, 3)
    names = [f.name for f in drive.frames]
    assert [f.name for f in held] == names[1::3][: len(held)]
    assert {f.name for f in training.frames} | {f.name for f in held} == set(names)
    assert names[0] not in {f.name for f in held} and names[-1] not in {f.name for f in held}


def test_iou_counts_every_class_that_has_pixels() -> None:
    confusion = np.array([[90, 10, 0], [0, 50, 0], [0, 0, 0]])
    told = class_iou(confusion, ("road", "car", "nobody"))
    assert told["iou"] == {"road": 0.9, "car": round(50 / 60, 4)}
    assert told["miou"] == round((0.9 + 50 / 60) / 2, 4)
    rare = class_iou(np.array([[100_000, 0], [5, 0]]), ("road", "pole"))
    assert rare["left_out"] == ["pole"] and rare["iou"]["pole"] == 0.0 and rare["miou"] > 0.99


def test_an_empty_scene_shows_the_sky_and_is_judged_by_it(tmp_path: Path) -> None:
    drive = open_drive(make_small_street(tmp_path))
    scene = choose_labels(drive)
    nothing = Surfels(
        torch.zeros(0, 3),
        torch.zeros(0, 4),
        torch.zeros(0, 2),
        torch.zeros(0),
        torch.zeros(0, 1, 3),
        torch.zeros(0, dtype=torch.int64),
    )
    sky = Sky(torch.full((3, 8, 16), 0.5), np.eye(3))
    told = evaluate_views(nothing, sky, list(drive.frames[:2]), scene, near=0.2, far=100.0)
    assert 5 < told["psnr"] < 25 and told["iou"]["road"] == 0.0 and 0 < told["iou"]["sky"] < 1
    shaded = Sky(torch.linspace(0.1, 0.3, 8)[None, :, None].repeat(3, 1, 16), np.eye(3))
    plain, aligned = (
        evaluate_views(nothing, shaded, list(drive.frames[:2]), scene, near=0.2, far=100.0, align_exposure=a)
        for a in (False, True)
    )
    assert aligned["psnr"] > plain["psnr"] + 3 and aligned["iou"] == plain["iou"]
