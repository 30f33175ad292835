"""What is marked as moving is left out of the scene from the first, where nothing else tells of it."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from tests.moving_street import FRAMES, MOVER_ID, PARKED_ID, WALKER, make_moving_street
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.files import load_array


def test_a_mark_that_moves_is_a_dynamic_object(tmp_path: Path) -> None:
    path = make_moving_street(tmp_path / "street", WALKER, instances=True)
    data = json.loads(path.read_text())
    data.pop("semantic_classes", None)
    for frame in data["frames"]:
        for key in ("semantic_path", "instance_path"):
            frame.pop(key, None)
    path.write_text(json.dumps(data))
    ids = [cv2.imread(str(path.parent / f"instances/{i:02d}.png"), cv2.IMREAD_UNCHANGED) for i in range(FRAMES)]
    entries = []
    for number, of, moves in ((1, MOVER_ID, True), (2, PARKED_ID, False)):
        (tmp_path / f"mattes/{number}").mkdir(parents=True)
        for i, own in enumerate(ids):
            cv2.imwrite(str(tmp_path / f"mattes/{number}/{i:02d}.png"), (own == of).astype(np.uint8) * 255)
        entries.append({"id": number, "class": "thing", "mattes": f"mattes/{number}", "moves": moves})
    marked = tmp_path / "marked.json"
    marked.write_text(json.dumps(entries))
    settings = RunSettings(quality="draft", marked=str(marked))
    workspace = run(path, tmp_path / "ws", settings, until="choose")
    assert len(json.loads((workspace.root / "movers/movers.json").read_text())) >= 1
    for i, own in enumerate(ids):
        file = next((workspace.root / "movers/pixels").rglob(f"{i:02d}.png"), None)
        pixels = np.zeros(own.shape, bool) if file is None else cv2.imread(str(file), cv2.IMREAD_UNCHANGED) > 0
        assert pixels[own == MOVER_ID].all() and not pixels[own == PARKED_ID].any()
    assert load_array(workspace.root / "movers/points.npy").sum() > 0  # the walker's, along its way
    segmented = workspace.state()["stages"]["segment"]
    entries[1]["class"] = "car"  # a mark that stands still does not make the scene anew
    marked.write_text(json.dumps(entries))
    run(path, workspace.root, settings, until="choose")
    assert workspace.state()["stages"]["segment"] == segmented
