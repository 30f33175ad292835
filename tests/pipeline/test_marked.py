"""Objects before there is a scene, and objects that a person marks: their ids stay, and they go as labelled ones do."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.drives.tiny_drive import edit
from tests.small_street import HIGH, LOW, make_small_street
from unveil_core.base.errors import DriveError, SelectionError
from unveil_core.base.pictures.decoding import read_label_image
from unveil_core.drives.marked import read_marked
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace

FEW_STEPS = RunSettings(quality="draft", iterations=150, splats=12_000)


def without_labels(path: Path) -> Path:
    def change(document: dict) -> None:
        document.pop("semantic_classes", None)
        for frame in document["frames"]:
            for name in ("semantic_path", "instance_path", "mask_path"):
                frame.pop(name, None)

    edit(path, change)
    return path


def box(number: int = 1001, grow: float = 0.3, **more: object) -> dict:
    """The car's box as a person draws it: a little larger, its floor a little under the street."""
    centre, size = (LOW + HIGH) / 2, HIGH - LOW
    return {"id": number, "centre": centre.tolist(), "size": (size + grow).tolist(), "yaw": 0.0, **more}


def objects_of(workspace: Workspace) -> dict:
    return json.loads(workspace.objects_json.read_text())


def removed_iou(workspace: Workspace, street: Path) -> float:
    both = either = 0
    for i in range(8):
        truth = cv2.imread(str(street.parent / f"truth/removed/{i:02d}.png"), 0) > 0
        mask = read_label_image(workspace.root / f"masks/removed/camera/{i:02d}.png") > 0
        both, either = both + int((truth & mask).sum()), either + int((truth | mask).sum())
    return both / either


def test_objects_are_listed_right_after_the_import(tmp_path: Path) -> None:
    workspace = run(make_small_street(tmp_path / "street"), tmp_path / "ws", until="objects")
    listed = objects_of(workspace)
    (car,) = listed["objects"]
    assert (car["id"], car["class"], car["source"], car["frames"]) == (5, "car", "images", 8)
    offset = json.loads((workspace.drive_dir / "cameras.json").read_text())["to_world"]["translation"]
    # Only two sides of it are ever seen.
    assert np.abs(np.array(car["box"]["centre"]) + offset - (LOW + HIGH) / 2).max() < 0.9
    assert 1.5 < car["distance_m"] < 7 and (workspace.root / car["thumbnail"]).stat().st_size > 200
    (known,) = [c for c in listed["classes"] if c["name"] == "car"]
    assert known["objects"] == 1 and known["removable"] and known["points"] > 30
    labels = np.load(workspace.root / "objects/point_labels.npy")
    assert (np.load(workspace.root / "objects/point_objects.npy") == 5).sum() == (labels == 13).sum() > 30


@pytest.fixture(scope="module")
def marked_street(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Workspace]:
    """A street of which nothing is known but its photographs and points, and a box around the car; run to the frames."""
    folder = tmp_path_factory.mktemp("marked")
    street = without_labels(make_small_street(folder / "street"))
    (folder / "marked.json").write_text(json.dumps([box()]))
    settings = replace(FEW_STEPS, marked=str(folder / "marked.json"), instances=(1001,))
    return street, run(street, folder / "ws", settings, until="deliver")


def test_a_box_takes_out_what_no_label_knows(marked_street: tuple[Path, Workspace]) -> None:
    street, workspace = marked_street
    assert removed_iou(workspace, street) > 0.75
    errors = {"before": 0.0, "after": 0.0}
    for i in range(8):
        truth = cv2.imread(str(street.parent / f"truth/images/{i:02d}.png")).astype(float)
        inside = cv2.imread(str(street.parent / f"truth/removed/{i:02d}.png"), 0) > 0
        for name, path in (
            ("before", street.parent / f"images/{i:02d}.png"),
            ("after", workspace.root / f"frames/camera/{i:02d}.png"),
        ):
            errors[name] += ((cv2.imread(str(path)).astype(float) - truth)[inside] ** 2).sum()
    assert 10 * np.log10(errors["before"] / errors["after"]) > 5
    (car,) = json.loads((workspace.root / "instances.json").read_text())
    assert (car["id"], car["source"], car["removed"]) == (1001, "box", True) and car["surfels"] > 100


def test_another_choice_does_not_make_the_scene_anew(marked_street: tuple[Path, Workspace]) -> None:
    """An artist adds mattes, chooses them instead of the box, and gets the same hole from the scene that is there."""
    street, workspace = marked_street
    (workspace.root.parent / "mattes").mkdir()
    for i in range(0, 8, 2):  # half size, and only every other frame
        white = cv2.imread(str(street.parent / f"truth/removed/{i:02d}.png"), 0)
        cv2.imwrite(str(workspace.root.parent / f"mattes/{i:02d}.png"), cv2.resize(white, (64, 40)))
    path = workspace.root.parent / "marked.json"
    path.write_text(json.dumps([box(), {"id": 1002, "class": "van", "mattes": "mattes"}]))
    settings = replace(FEW_STEPS, marked=str(path), instances=(1002,))
    before = [e["stage"] for e in workspace.events() if e["message"] == "started"]
    run(street, workspace.root, settings, until="remove")
    started = [e["stage"] for e in workspace.events() if e["message"] == "started"][len(before) :]
    assert started == ["objects", "choose", "instances", "remove"]
    van = objects_of(workspace)["objects"][1]
    assert (van["id"], van["class"], van["source"], van["frames"]) == (1002, "van", "mattes", 4)
    assert removed_iou(workspace, street) > 0.7


def test_ids_of_clusters_stay(tmp_path: Path) -> None:
    """Where no image tells objects apart, those of the points are found again among the surfels."""
    street = make_small_street(tmp_path / "street", masks_only=True)
    workspace = run(street, tmp_path / "ws", RunSettings(quality="draft"), until="objects")
    (car,) = objects_of(workspace)["objects"]
    assert (car["source"], car["class"]) == ("clusters", "remove")
    settings = RunSettings(quality="draft", instances=(car["id"],), iterations=20)
    run(street, workspace.root, settings, until="remove")
    (same,) = json.loads((workspace.root / "instances.json").read_text())
    assert same["id"] == car["id"] and same["surfels"] > 50
    assert removed_iou(workspace, street) > 0.6
    with pytest.raises(SelectionError, match=f"no instance 77; found: {car['id']}$"):
        run(street, workspace.root, RunSettings(quality="draft", instances=(77,), iterations=20), until="choose")


def test_a_drive_without_labels_can_be_imported_but_not_unveiled(tmp_path: Path) -> None:
    street = without_labels(make_small_street(tmp_path / "street"))
    workspace = run(street, tmp_path / "ws", until="objects")
    assert objects_of(workspace)["objects"] == [] and objects_of(workspace)["source"] == "nothing"
    with pytest.raises(DriveError, match="mark objects and choose them"):
        run(street, tmp_path / "ws", until="choose")
    with pytest.raises(DriveError, match="mark objects and choose them"):
        run(street, tmp_path / "other")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"id": 1}, "holds no list"),
        ([{"id": 0, "centre": [0, 0, 0], "size": [1, 1, 1]}], "not an id from 1 to 65535: 0"),
        ([{"id": 3, "centre": [0, 0, 0], "size": [1, 0, 1]}], "not positive"),
        ([{"id": 3, "mattes": "nowhere"}], "nowhere: holds no pictures"),
        ([{"id": 3, "centre": [0, 0, 0]}], "lacks 'size'"),
        ([box(7), box(7)], "id 7 occurs twice"),
        (["car"], "Not an object: entry 0"),
    ],
)
def test_bad_marks_are_named(content: object, message: str, tmp_path: Path) -> None:
    (tmp_path / "marked.json").write_text(json.dumps(content))
    with pytest.raises(DriveError, match=message):
        read_marked(tmp_path / "marked.json")


def test_a_mark_cannot_take_the_id_of_another_object(tmp_path: Path) -> None:
    street = make_small_street(tmp_path / "street")
    (tmp_path / "marked.json").write_text(json.dumps([box(5)]))
    with pytest.raises(SelectionError, match="marked object 5 has the id of another object .use 6 or more"):
        run(street, tmp_path / "ws", RunSettings(marked=str(tmp_path / "marked.json")), until="objects")
