"""The removed objects: a list, and the splats of each."""

from __future__ import annotations

import json

import numpy as np

from tests.exports.conftest import Street
from tests.exports.street import WORLD
from tests.plain_ply import read_plain_ply
from unveil_core.drives.boxes import TrackedBox
from unveil_core.semantics.objects import marked_box


def test_each_removed_object_has_its_box_frames_and_splats(street: Street) -> None:
    folder, job = street.exported("objects-json"), street.job
    entries = json.loads((folder / "objects.json").read_text())["objects"]
    assert [(e["id"], e["class"], e["splats"], e["frames"]) for e in entries] == [
        (1, "car", "car_0001.ply", 3),
        (2, "car", "car_0002.ply", 3),
    ]
    full = job.surfels("full").means.double().numpy()
    for entry in entries:
        own = full[job.full_instances == entry["id"]]
        vertex = read_plain_ply(folder / entry["splats"])
        shift = json.loads((folder / f"{entry['splats']}.json").read_text())["shift"]
        positions = np.stack([vertex[n] for n in "xyz"], axis=1) + np.array(shift)
        np.testing.assert_allclose(positions, WORLD.to_world(own), atol=1e-5)
        assert entry["splat_count"] == len(own) > 5 and set(vertex["instance"]) == {entry["id"]}
        reach = np.linalg.norm(positions - np.array(entry["box"]["centre"]), axis=1).max()
        assert reach < np.linalg.norm(entry["box"]["size"]) / 2 + 0.2 * WORLD.scale
        np.testing.assert_allclose(entry["box"]["size"], np.array([4, 1.8, 1.5]) * WORLD.scale)
        box = entry["box"]
        tracked = TrackedBox(entry["id"], "car", tuple(box["centre"]), tuple(box["size"]), box["yaw"])
        before = job.objects[entry["id"] - 1]["box"]
        again = marked_box(tracked, job.drive)
        np.testing.assert_allclose(again.centre, before["centre"], atol=1e-6)
        np.testing.assert_allclose([*again.size, again.yaw], [*before["size"], before["yaw"]], atol=1e-9)
        # And it is around the splats, in the drive's own axes by the boxes' own words.
        inside = np.abs(tracked.to_local(WORLD).local(own)) < 1.1
        assert inside.all(axis=1).mean() > 0.9
