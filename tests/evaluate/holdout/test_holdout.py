"""The drive with virtual cars: nothing of what they hide is left in it, and everything else is."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.small_street import make_small_street
from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import read_image, read_instance_image, read_label_image
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive, Footage, PointCloud
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.evaluate.holdout.drive import (
    AddedLabels,
    added_labels,
    moved_points,
    seen_elsewhere,
    write_holdout_drive,
)
from unveil_core.evaluate.holdout.placement import CarPixels, SceneView, see_cars
from unveil_core.evaluate.holdout.scores import HoldoutFrame, measure_holdout, write_strips
from unveil_core.evaluate.holdout.virtual_cars import VirtualCar
from unveil_core.geometry.images import grow
from unveil_core.geometry.reach import CameraViews
from unveil_core.semantics.classes import LabelSet
from unveil_core.semantics.labels import SceneLabels, choose_labels, frame_labels

CAR_AT = np.array([11.0, 2.6, 0.0])


def ground_view(drive: Drive, index: int) -> SceneView:
    """A street that is nothing but its ground at z = 0, in the drive's local frame."""
    camera = drive.frames[index].camera
    rise = camera.rays() @ np.array([0, 0, 1.0])
    height = camera.centre[2] + drive.to_world.translation[2]
    depth = np.where(rise < -1e-3, -height / np.where(rise < -1e-3, rise, -1), np.inf)
    return SceneView(camera, depth, np.zeros(depth.shape, dtype=bool))


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    folder = tmp_path_factory.mktemp("holdout")
    return import_drive(open_drive(make_small_street(folder / "street")), folder / "imported")


@pytest.fixture(scope="module")
def masks_drive(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    folder = tmp_path_factory.mktemp("masks")
    path = make_small_street(folder / "street", masks_only=True)
    return import_drive(open_drive(path), folder / "imported")


def parked(drive: Drive) -> VirtualCar:
    return VirtualCar(CAR_AT - drive.to_world.translation, np.eye(3), 1, 11.0, 2.6)


def seen(drive: Drive) -> tuple[list[SceneView], list[CarPixels]]:
    views = [ground_view(drive, i) for i in range(len(drive.frames))]
    return views, [see_cars([parked(drive)], s) for s in views]


def together(views: list[SceneView]) -> CameraViews[SceneView]:
    return CameraViews([v.camera for v in views], views)


# ------------------------------------------------------------------------------------------------------------------ labels


def test_the_cars_get_a_class_that_goes(drive: Drive, masks_drive: Drive) -> None:
    assert added_labels(drive, choose_labels(drive)) == AddedLabels(13, 6, False)
    assert added_labels(masks_drive, choose_labels(masks_drive)) == AddedLabels(None, None, False)
    labels = LabelSet.cityscapes([0, 11, 13])
    people = SceneLabels(labels, "semantics", ("person",), (), (1, 1, 1))
    assert added_labels(drive, people).disk_id == 11  # cars stay in this run, people go
    single = SceneLabels(labels, "semantics", (), (5,), (1, 1, 1))
    assert added_labels(drive, single) == AddedLabels(13, 6, True)


def test_instance_ids_are_new_even_where_the_largest_is_taken(drive: Drive, tmp_path: Path) -> None:
    image = np.zeros((4, 4), np.uint16)
    image[0, :3] = (7, 40_000, 65_535)
    write_image_atomic(tmp_path / "ids.png", image)
    taken = replace(drive, frames=(replace(drive.frames[0], instance_path=tmp_path / "ids.png"),))
    first = added_labels(taken, choose_labels(drive)).first_instance
    assert first is not None and not {first + k for k in range(9)} & {7, 40_000, 65_535} and first + 9 < 65_535


# ------------------------------------------------------------------------------------------------------------------- drive


def test_every_file_has_the_car_and_nothing_else_changes(drive: Drive, tmp_path: Path) -> None:
    _, pixels = seen(drive)
    gone = [np.zeros((80, 128), bool)] * len(drive.frames)
    written = write_holdout_drive(drive, pixels, gone, drive.points, AddedLabels(13, 6, False), tmp_path / "drive")
    assert sum((p.number > 0).any() for p in pixels) >= 5
    for before, after, own in zip(drive.frames, written.frames, pixels, strict=True):
        covered = own.number > 0
        photograph, image = read_image(before.image_path), read_image(after.image_path)
        assert np.array_equal(image[~covered], photograph[~covered])
        assert np.array_equal(image[covered], own.color[covered])
        semantics, instances = read_label_image(after.semantic_path), read_instance_image(after.instance_path)
        assert (semantics[covered] == 13).all() and (instances[covered] == 6).all()
        assert np.array_equal(semantics[~covered], read_label_image(before.semantic_path)[~covered])
        assert np.array_equal(instances[~covered], read_instance_image(before.instance_path)[~covered])
        assert np.allclose(after.camera.world_to_camera, before.camera.world_to_camera)
    assert written.truth_root is None and drive.truth_root is not None
    assert sorted(p.name for p in tmp_path.iterdir()) == ["drive"]
    reopened = open_drive(tmp_path / "drive")
    assert len(reopened.frames) == len(drive.frames) and np.allclose(
        reopened.to_world.translation, drive.to_world.translation
    )
    assert np.array_equal(frame_labels(reopened.frames[0], choose_labels(reopened)) >= 0, np.ones((80, 128), bool))


def test_frames_without_a_mask_get_what_goes_there_and_the_car(masks_drive: Drive, tmp_path: Path) -> None:
    _, pixels = seen(masks_drive)
    really = np.zeros((80, 128), bool)
    really[50:60, 90:110] = True
    gone = [really] * len(masks_drive.frames)
    written = write_holdout_drive(
        masks_drive, pixels, gone, masks_drive.points, AddedLabels(None, None, False), tmp_path / "drive"
    )
    scene = choose_labels(written)
    given = set()
    for i, (before, after, own) in enumerate(zip(masks_drive.frames, written.frames, pixels, strict=True)):
        covered = own.number > 0
        assert (after.mask_path is not None) == (before.mask_path is not None or covered.any())
        if not covered.any():
            continue
        label = frame_labels(after, scene)
        assert (label[covered] == 1).all()
        known = really if i % 2 else read_label_image(before.mask_path) == 0
        assert np.array_equal(label[~covered] == 1, known[~covered])
        given.add(before.mask_path is None)
    assert given == {False, True}, "the car shows in frames with a mask and in frames without"


# ---------------------------------------------------------------------------------------------------------------- evidence


def test_points_behind_the_car_are_measured_on_it(drive: Drive) -> None:
    views, pixels = seen(drive)
    car = parked(drive)
    beside = np.array([12.0, -1.0, 0.0])  # on the free ground
    under = np.array([11.0, 2.6, 0.0])
    nowhere = np.array([-30.0, 0.0, 0.0])  # behind all cameras
    points = np.stack([beside, under, nowhere]) - drive.to_world.translation
    colors = np.full((3, 3), 77, np.uint8)
    moved = moved_points(PointCloud(points, colors), together(views), pixels, [car])
    assert len(moved.positions) == 3
    assert np.array_equal(moved.positions[[0, 2]], points[[0, 2]])
    local = (moved.positions[1] - car.centre) @ car.axes.T
    assert np.abs(local[0]) <= 2.2 and np.abs(local[1]) <= 0.9 and 0 <= local[2] <= 1.5
    assert np.max(np.abs(local) / (2.2, 0.9, 1.5)) > 0.4  # on its outside
    assert (moved.colors[[0, 2]] == 77).all() and not (moved.colors[1] == 77).all()


def test_no_point_is_left_that_only_hidden_pixels_showed(drive: Drive) -> None:
    """All over the ground: a point stays exactly where some frame shows it beside the car."""
    views, pixels = seen(drive)
    car = parked(drive)
    x, y = np.meshgrid(np.arange(4, 30, 0.4), np.arange(-5, 6, 0.4))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) - drive.to_world.translation
    moved = moved_points(PointCloud(points), together(views), pixels, [car])
    assert moved.colors is None
    stayed = {tuple(p) for p in moved.positions} & {tuple(p) for p in points}
    shown_somewhere, covered_somewhere = np.zeros(len(points), bool), np.zeros(len(points), bool)
    for view, own in zip(views, pixels, strict=True):
        pixel, depth = view.camera.project(points)
        inside = (depth > 0.2) & (pixel >= 0).all(1) & (pixel[:, 0] < 128) & (pixel[:, 1] < 80)
        index = np.flatnonzero(inside)
        on_car = own.number[pixel[index, 1].astype(int), pixel[index, 0].astype(int)] > 0
        near = own.depth[pixel[index, 1].astype(int), pixel[index, 0].astype(int)] > depth[index] + 0.1
        shown_somewhere[index[~on_car | near]] = True
        covered_somewhere[index[on_car]] = True
    hidden = covered_somewhere & ~shown_somewhere
    assert hidden.sum() > 10
    assert {tuple(p) for p in points[~hidden]} == stayed


def test_seen_elsewhere_is_what_another_frame_shows_beside_the_car(drive: Drive) -> None:
    views, pixels = seen(drive)
    with_car = max(range(len(pixels)), key=lambda i: int((pixels[i].number > 0).sum()))
    found = seen_elsewhere(together(views), pixels, far=100.0)[with_car]
    covered = pixels[with_car].number > 0
    assert not found[~covered].any() and 0 < found.sum() < covered.sum()
    # The ground under the car: no frame sees it. Its top hides what lies beyond, which others see.
    points = views[with_car].camera.unproject(np.where(np.isfinite(views[with_car].depth), views[with_car].depth, 0))
    under = covered & (np.abs(points + drive.to_world.translation - CAR_AT) < (1.6, 0.6, 0.1)).all(axis=2)
    assert under.sum() > 5 and not found[under].any()
    (alone,) = seen_elsewhere(together([views[with_car]]), [pixels[with_car]], far=100.0)
    assert not alone.any()


def test_a_removed_object_is_no_evidence(drive: Drive) -> None:
    views, pixels = seen(drive)
    excluded = [SceneView(s.camera, s.depth, np.ones_like(s.excluded)) for s in views]
    assert not any(seen.any() for seen in seen_elsewhere(together(excluded), pixels, far=100.0))


# ----------------------------------------------------------------------------------------------------------------- scores


@pytest.fixture
def delivered(drive: Drive, tmp_path: Path) -> tuple[list[HoldoutFrame], Drive, Path]:
    """A workspace whose delivery is the photograph with 5 levels added behind the car, 3 of them in the unseen part."""
    views, pixels = seen(drive)
    gone = [np.zeros((80, 128), bool) for _ in drive.frames]
    written = write_holdout_drive(drive, pixels, gone, drive.points, AddedLabels(13, 6, False), tmp_path / "drive")
    frames, known = [], seen_elsewhere(together(views), pixels, far=100.0)
    for i, frame in enumerate(drive.frames):
        elsewhere = known[i]
        frames.append(HoldoutFrame(frame, views[i], pixels[i], gone[i], elsewhere))
        photograph = read_image(frame.image_path).astype(int)
        covered = pixels[i].number > 0
        error = np.where(covered, np.where(elsewhere, 5, -3), 0)[..., None]
        clean = np.clip(photograph + error, 0, 255).astype(np.uint8)
        write_image_atomic(tmp_path / f"ws/frames/{frame.camera_name}/{frame.name}.png", clean)
        unobserved = np.where(covered & ~elsewhere, 255, 0).astype(np.uint8)
        write_image_atomic(tmp_path / f"ws/masks/unobserved/{frame.camera_name}/{frame.name}.png", unobserved)
    return frames, written, tmp_path / "ws"


def test_scores_are_those_of_the_pixels(delivered: tuple[list[HoldoutFrame], Drive, Path], drive: Drive) -> None:
    frames, written, root = delivered
    found = measure_holdout(frames, [parked(drive)], written, root)
    regions = found["regions"]
    assert regions["seen_elsewhere"]["methods"]["ours"]["psnr"] == pytest.approx(20 * np.log10(255 / 5), abs=0.01)
    assert regions["unseen"]["methods"]["ours"]["psnr"] == pytest.approx(20 * np.log10(255 / 3), abs=0.01)
    assert regions["removed"]["pixels"] == sum(int((f.cars.number > 0).sum()) for f in frames)
    assert regions["removed"]["pixels"] == regions["seen_elsewhere"]["pixels"] + regions["unseen"]["pixels"]
    for method in ("telea", "shift_map"):
        assert 8 < regions["removed"]["methods"][method]["psnr"] < regions["removed"]["methods"]["ours"]["psnr"]
    assert found["unobserved_mask_iou"] == 1.0 and found["outside"] == {"changed": 0.0, "mean": 0.0}
    (car,) = found["cars"]
    assert car["pixels"] == regions["removed"]["pixels"] and car["along_m"] == 11.0 and car["left_m"] == 2.6
    assert car["psnr"]["ours"] == regions["removed"]["methods"]["ours"]["psnr"]
    flicker = found["flicker"]["methods"]
    assert flicker["truth"]["absolute"] <= flicker["ours"]["absolute"] < flicker["shift_map"]["absolute"]


def test_a_network_sees_crops_around_the_car(delivered: tuple[list[HoldoutFrame], Drive, Path], drive: Drive) -> None:
    frames, written, root = delivered

    def worst(a: np.ndarray, b: np.ndarray) -> float:
        assert a.shape == b.shape and min(a.shape[:2]) >= 64
        return float(np.abs(a.astype(int) - b).max())

    found = measure_holdout(frames, [parked(drive)], written, root, lpips=worst)
    (car,) = found["cars"]
    for part, error in (("removed", 5), ("seen_elsewhere", 5), ("unseen", 3)):
        for rows in (found["regions"], car["regions"]):
            assert rows[part]["methods"]["ours"]["lpips"] == error, part
    assert car["regions"]["unseen"]["methods"]["ours"]["psnr"] == found["regions"]["unseen"]["methods"]["ours"]["psnr"]
    assert found["regions"]["removed"]["methods"]["telea"]["lpips"] > 5


def test_barred_pixels_do_not_count_and_changes_elsewhere_are_found(
    delivered: tuple[list[HoldoutFrame], Drive, Path], drive: Drive
) -> None:
    frames, written, root = delivered
    bars = np.zeros((80, 128), bool)
    bars[:, :64] = True
    excluded = [replace(f, view=replace(f.view, excluded=bars)) for f in frames]
    expected = sum(int((f.cars.number[:, 64:] > 0).sum()) for f in frames)
    path = root / "frames" / frames[4].frame.camera_name / f"{frames[4].frame.name}.png"
    picture = read_image(path)
    picture[2:6, 110:120] ^= 16
    write_image_atomic(path, picture)
    found = measure_holdout(excluded, [parked(drive)], written, root)
    assert found["regions"].get("removed", {"pixels": 0})["pixels"] == expected
    whole = measure_holdout(frames, [parked(drive)], written, root)
    assert 0 < whole["outside"]["changed"] < 0.01 and whole["outside"]["mean"] == 16


def test_lines_on_the_ground_are_looked_for_behind_the_car(
    delivered: tuple[list[HoldoutFrame], Drive, Path], drive: Drive
) -> None:
    frames, written, root = delivered
    grounded = [replace(f, ground=f.cars.number > 0) for f in frames]
    blurred = {"blurred": lambda picture: cv2.GaussianBlur(picture, (0, 0), 4.0)}
    found = measure_holdout(grounded, [parked(drive)], written, root, references=blurred)
    recall, false = found["line_recall"], found["false_lines"]
    assert set(recall) == {"ours", "telea", "shift_map", "blurred"}
    # A few levels more or less move no line, and a seam between two of them is none.
    assert recall["ours"] > 0.95 and false["ours"] < 0.05
    assert recall["blurred"] < 0.1 and recall["telea"] < 0.5
    methods = found["regions"]["removed"]["methods"]
    assert methods["telea"]["psnr"] < methods["blurred"]["psnr"] < methods["ours"]["psnr"]
    assert found["gradient"]["blurred"] < 0.8
    assert found["spectrum_4px"]["blurred"] < found["spectrum_16px"]["blurred"] < 0.9
    nowhere = [replace(f, ground=np.zeros_like(f.removed)) for f in frames]
    assert set(measure_holdout(nowhere, [parked(drive)], written, root)["line_recall"].values()) == {None}
    assert measure_holdout(frames, [parked(drive)], written, root)["line_recall"] == {}


def test_strips_show_the_four_pictures(delivered: tuple[list[HoldoutFrame], Drive, Path], drive: Drive) -> None:
    frames, written, root = delivered
    paths = write_strips(frames, [parked(drive)], written, root, root / "pictures")
    assert 1 <= len(paths) <= 2
    strip = read_image(paths[0])
    assert strip.shape == (80, 4 * 128 + 3 * 4, 3)
    name = paths[0].stem.partition("_")[2]
    own = next(f for f in frames if f.frame.name == name)
    assert np.array_equal(strip[:, :128], read_image(own.frame.image_path))
    assert np.array_equal(
        strip[:, 2 * 132 : 2 * 132 + 128], read_image(root / f"frames/{paths[0].name.replace('_', '/')}")
    )
    shutil.rmtree(root)


def test_footage_larger_than_the_working_size_is_painted_and_measured_at_its_own(drive: Drive, tmp_path: Path) -> None:
    footage = []
    for frame in drive.frames:
        path = tmp_path / f"footage/{frame.name}.png"
        write_image_atomic(path, np.kron(read_image(frame.image_path), np.ones((2, 2, 1), np.uint8)))
        footage.append(Footage(path, frame.camera.resized(256, 160)))
    large = replace(drive, frames=tuple(replace(f, footage=g) for f, g in zip(drive.frames, footage, strict=True)))
    views, pixels = seen(large)
    gone = [np.zeros((80, 128), bool) for _ in large.frames]
    written = write_holdout_drive(large, pixels, gone, large.points, AddedLabels(13, 6, False), tmp_path / "drive")
    frames = [HoldoutFrame(f, v, p, g, g) for f, v, p, g in zip(large.frames, views, pixels, gone, strict=True)]
    for held, with_car in zip(frames, written.frames, strict=True):
        assert held.frame.footage is not None and with_car.footage is not None
        true, painted = read_image(held.frame.footage.path), read_image(with_car.footage.path)
        covered = np.kron(held.cars.number > 0, np.ones((2, 2), bool))
        assert painted.shape == (160, 256, 3)
        assert np.array_equal(painted[~grow(covered, 3)], true[~grow(covered, 3)])
        inner = ~grow(~covered, 3)
        assert not inner.any() or (painted[inner] != true[inner]).any(axis=1).mean() > 0.9
        delivered = np.clip(true.astype(int) + 5 * covered[..., None], 0, 255).astype(np.uint8)
        delivered[:2, :2] ^= 8
        write_image_atomic(tmp_path / f"ws/frames/{held.frame.camera_name}/{held.frame.name}.png", delivered)
    found = measure_holdout(frames, [parked(large)], written, tmp_path / "ws")["full_size"]
    shown = sum(bool(f.region.any()) for f in frames)
    assert found["psnr"] == pytest.approx(20 * np.log10(255 / 5), abs=0.1)
    assert found["gradient"] == pytest.approx(1.0, abs=0.05) and found["changed_pixels"] == 4 * shown
