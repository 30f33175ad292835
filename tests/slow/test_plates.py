"""A whole run of plates: what is delivered is of their kind, and outside of what went each value is the file's."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from tests.base.plates.plates import attributes, pixels, write_exr
from tests.small_street import make_small_street
from unveil_core.base.srgb import linear_of_srgb
from unveil_core.drives.imported import read_imported
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings

SETTINGS = RunSettings(quality="draft", iterations=20, splats=2_000, work_side=96, frames=":4")


def test_plates_come_back_as_plates(tmp_path: Path) -> None:
    path = make_small_street(tmp_path / "street")
    document = json.loads(path.read_text())
    for entry in document["frames"]:
        source = path.parent / entry["file_path"]
        picture = cv2.imread(str(source))[..., ::-1]
        write_exr(source.with_suffix(".exr"), linear_of_srgb(picture / 255).astype(np.float32))
        source.unlink()
        entry["file_path"] = str(Path(entry["file_path"]).with_suffix(".exr"))
    path.write_text(json.dumps(document))
    done = run(path, tmp_path / "ws", SETTINGS, until="deliver")
    for frame in read_imported(done.drive_dir).frames:
        own, made = path.parent / f"images/{frame.name}.exr", done.root / f"frames/camera/{frame.name}.exr"
        before, after = pixels(own), pixels(made)
        masks = [done.root / f"masks/{n}/camera/{frame.name}.png" for n in ("removed", "shadows")]
        went = np.maximum(*(cv2.imread(str(m), cv2.IMREAD_GRAYSCALE) for m in masks))
        near = cv2.resize(cv2.dilate(went, np.ones((5, 5))), own_size := (before.shape[1], before.shape[0])) > 0
        changed = (before != after).any(axis=2)
        assert changed.any() and not (changed & ~near).any()
        np.testing.assert_array_equal(before[~changed].view(np.uint32), after[~changed].view(np.uint32))
        assert attributes(made) == attributes(own)
        seen = cv2.imread(str(done.root / f"frames/camera/{frame.name}.png"))
        assert seen.dtype == np.uint8 and seen.shape[1::-1] == own_size
