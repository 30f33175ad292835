"""Assumptions as stages record them: each with data of which it holds, and with data of which it does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.inpaint.facade.test_continued import FACADE_T, houses, street
from tests.inpaint.sunny_street import box_surfels
from tests.remove.test_regions import scene, surfels_at
from tests.small_street import BUILDING, SKY, make_small_street
from unveil_core.base.pictures.decoding import read_image, read_label_image
from unveil_core.drives import open_drive
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.geometry.reach import centres_of
from unveil_core.inpaint.chart.rectify import LEAST_AGREEMENT, Rectified
from unveil_core.inpaint.facade.offsets import share_facing
from unveil_core.inpaint.light.sun import Sun, given_sun
from unveil_core.inpaint.upright import Completed
from unveil_core.optimize.start import start_sky
from unveil_core.pipeline.steps.choose import _much_left
from unveil_core.pipeline.steps.ground import _metres_assumed, _street_assumed
from unveil_core.pipeline.steps.inpaint import _facades_assumed, _sun_assumed, _sun_recorded
from unveil_core.pipeline.steps.reconstruct import _ground_assumed, _sky_assumed
from unveil_core.pipeline.steps.remove import MOST_NAMED, _vehicles_assumed
from unveil_core.remove.selection import select_removed
from unveil_core.semantics.classes import LabelSet
from unveil_core.semantics.instances import Box
from unveil_core.semantics.labels import SceneLabels, find_labels
from unveil_core.surfels.surfels import concatenate
from unveil_core.workspace.assumptions import Assumption, assumed, recorded_assumptions


def test_what_a_stage_records_is_read_back() -> None:
    one = Assumption("the sun shines", False, "no direction", "dark patches count")
    assert recorded_assumptions({"inpaint": assumed([one]), "mesh": {"assumptions": [{"odd": 1}]}, "x": 3}) == [
        ("inpaint", one)
    ]
    assert one.message() == "not so: the sun shines (no direction); dark patches count"


@pytest.mark.parametrize(
    ("height", "holds"), [(0.2, False), (0.5, True), (1.6, True), (4.0, True), (4.9, False), (160.0, False)]
)
def test_metres_put_cameras_as_high_as_on_a_street(height: float, holds: bool) -> None:
    ground, cameras = street(60.0)
    centres = centres_of(cameras) + (0, 0, height - 1.6)
    told = _metres_assumed("metric", ground, centres)
    assert told.holds == holds
    assert told.found == f"by metric, cameras {height:.1f} m over the street"
    assert "--scale" in told.instead


def test_an_estimated_scale_is_said_whatever_the_height() -> None:
    ground, cameras = street(60.0)
    told = _metres_assumed("camera height", ground, centres_of(cameras))
    assert (told.holds, told.found) == (False, "by camera height")
    assert "1.6 m" in told.instead
    # Without a street nothing tells how high the cameras are.
    assert _metres_assumed("metric", None, centres_of(cameras)).holds


@pytest.mark.parametrize(
    ("removed", "share", "holds"), [(("car",), "12 %", True), (("car", "building"), "88 %", False)]
)
def test_most_of_what_was_photographed_stays(removed: tuple[str, ...], share: str, holds: bool) -> None:
    labels = LabelSet.cityscapes([0, 2, 13])  # road, building, car
    told = _much_left(SceneLabels(labels, "semantics", removed, (), (120, 760, 120)))
    assert (told.holds, told.found) == (holds, f"{share} is {', '.join(removed)}")
    assert "--remove" in told.instead


def by_name(found: list[Assumption]) -> dict[str, Assumption]:
    return {one.name: one for one in found}


def test_a_drive_without_classes_has_none_that_tells_the_ground() -> None:
    ground, _ = street(np.inf)
    masks, classes = (
        by_name(_street_assumed(labels, ground, None, 0.0))
        for labels in (LabelSet.keep_remove(), LabelSet.cityscapes([0]))
    )
    assert classes["labels tell the ground"].holds
    assert not masks["labels tell the ground"].holds
    assert masks["labels tell the ground"].instead == "level surfels do"
    assert masks["the ground was seen"].holds
    none = by_name(_street_assumed(LabelSet.cityscapes([0]), None, None, 0.0))
    assert list(none) == ["the ground was seen"]
    assert not none["the ground was seen"].holds


@pytest.mark.parametrize(("noise", "holds"), [(0.03, True), (0.12, False)])
def test_the_ground_is_known_to_centimetres_where_its_points_agree(noise: float, holds: bool) -> None:
    ground, _ = street(np.inf)
    told = by_name(_street_assumed(LabelSet.cityscapes([0]), ground, None, noise))
    assert told["the ground's height is known to centimetres"].holds == holds
    assert f"{100 * noise:.0f} cm" in told["the ground's height is known to centimetres"].found


@pytest.mark.parametrize(("agreement", "holds"), [(LEAST_AGREEMENT - 0.01, False), (LEAST_AGREEMENT + 0.01, True)])
def test_kerbs_run_along_the_street_where_the_path_follows_them(agreement: float, holds: bool) -> None:
    ground, _ = street(np.inf)
    told = by_name(_street_assumed(LabelSet.cityscapes([0]), ground, Rectified(ground.path, 0.0, agreement), 0.0))
    assert told["paint and kerbs run along the street"].holds == holds


def test_a_drive_under_a_roof_has_no_sky(tmp_path: Path) -> None:
    drive = localized(open_drive(make_small_street(tmp_path)))
    found, images = find_labels(drive), [read_image(f.image_path) for f in drive.frames]
    labels = [
        found.labels.compact(read_label_image(f.semantic_path)) for f in drive.frames if f.semantic_path is not None
    ]
    sky, house = (found.labels.disk_ids.index(kind) for kind in (SKY, BUILDING))
    _, open_air = start_sky(drive, found, images, labels, None)
    grey, roofed = start_sky(drive, found, images, [np.where(p == sky, house, p) for p in labels], None)
    assert _sky_assumed({"sky": open_air}).holds
    assert _sky_assumed({"sky": open_air}).found == "in 8 of 8 frames"
    told = _sky_assumed({"sky": roofed})
    assert (told.holds, told.found) == (False, "in none of 8 frames")
    assert float(grey.texture.min()) == float(grey.texture.max())
    # Without labels each block looks for itself.
    assert _sky_assumed({"sky": {}, "blocks": [{"sky": roofed}, {"sky": open_air}]}).found == "in 8 of 16 frames"


def long_object(length: float, gap: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) a box of a vehicle so long, with a gap in the middle, and (M, 3) a badly named pole within it."""
    x, y, z = (
        g.ravel() for g in np.meshgrid(np.arange(0, length, 0.1), np.linspace(-1.2, 1.2, 5), np.arange(0.2, 3, 0.4))
    )
    solid = np.abs(x - length / 2) >= gap / 2
    return np.column_stack([x, y, z])[solid], np.array([[3.0, 0.1, h] for h in np.arange(0.6, 2.5, 0.2)])


@pytest.mark.parametrize(("length", "gap", "why"), [(18.0, 0.0, None), (31.0, 0.0, ""), (18.0, 0.8, " with a gap")])
def test_an_object_that_is_too_long_is_named(length: float, gap: float, why: str | None) -> None:
    own, pole = long_object(length, gap)
    labels = np.repeat([2, 0], [len(own), len(pole)])
    found = select_removed(
        surfels_at(np.concatenate([own, pole]), labels),
        np.where(labels == 2, 7, 0),
        scene(("car",)),
        too_close=0.0,
        axes=np.eye(3),
    )
    gone, boxes = found.removed, found.not_one
    told = _vehicles_assumed(boxes, {7: "train"})
    assert told.holds == (why is None)
    if why is not None:
        longest = max(boxes[7].size)
        assert longest == pytest.approx(length, abs=1.0)
        assert told.found == f"train 7: {longest:.1f} m long{why}"
    # What is said is done: its own points go, and those in its box only where it is one vehicle's.
    assert gone[: len(own)].all()
    assert gone[len(own) :].all() == gone[len(own) :].any() == told.holds


def test_of_many_long_objects_the_longest_are_named() -> None:
    boxes = {n: Box((0.0, 0.0, 0.0), (26.0 + n, 2.0, 3.0), 0.0) for n in range(1, 10)}
    found = _vehicles_assumed(boxes, {}).found
    assert found.startswith("object 9: 35.0 m long, object 8")
    assert found.endswith(f"and {9 - MOST_NAMED} more")


def test_a_sun_that_was_given_is_recorded_as_given() -> None:
    given = given_sun(135.0, 40.25)
    found = Sun(given.towards, 0.41237, 135.0, 40.25)
    place = {"azimuth_deg": 135.0, "elevation_deg": 40.25}
    assert _sun_recorded(given, given=True) == {**place, "given": True}
    assert _sun_recorded(found, given=False) == {**place, "score": 0.412}
    assert _sun_recorded(None, given=False) is None
    assert _sun_assumed(given, given=True).found == "azimuth 135, elevation 40 degrees, as given, not tested"
    assert _sun_assumed(found, given=False).found == "azimuth 135, elevation 40 degrees"
    assert [_sun_assumed(sun, given=sun is given).holds for sun in (given, found, None)] == [True, True, False]


def completed(sides: int, facing: float | None) -> Completed:
    return Completed(None, None, sides, 0, facing, np.zeros(0, dtype=bool))


def test_facades_that_stand_across_are_not_parallel_to_the_street() -> None:
    ground, _ = street(np.inf)
    along = houses(np.inf)
    across = concatenate(
        [box_surfels(np.array([[x, FACADE_T, 0.0], [x + 0.1, FACADE_T + 4.0, 4.0]])) for x in (8.0, 16.0)]
    )
    for walls, holds in ((along, True), (across, False)):
        told = by_name(_facades_assumed(completed(1, share_facing(walls, ground)), named=True))
        assert told["walls of houses are parallel to the street"].holds == holds
        assert told["facades stand along the street"].holds
        assert told["walls of houses are parallel to the street"].instead.startswith("noted, nothing is switched off")
    assert share_facing(along.select(np.arange(3)), ground) is None


def test_without_a_label_of_houses_there_are_no_facades() -> None:
    (told,) = _facades_assumed(completed(0, None), named=False)
    assert not told.holds
    assert told.found == "no label means buildings"


@pytest.mark.parametrize(
    ("start", "instead"),
    [
        ({"measured": 0.02, "told_by": "photographs", "height": 1.62}, "where photographs of it agree"),
        ({"measured": 0.02, "told_by": "points", "height": 1.62}, "at the height of few points"),
        ({"measured": 0.02}, "no points show the ground before training"),
    ],
)
def test_it_is_said_who_told_the_ground_without_a_lidar(start: dict[str, object], instead: str) -> None:
    (told,) = _ground_assumed({"blocks": [{"ground": {"measured": 0.8}}, {"ground": start}]})
    assert not told.holds and told.instead.endswith(instead)
    assert told.found.startswith("points lie close together on 2 % of the lane ahead")
    assert ("1.62 m" in told.found) == ("told_by" in start)


def test_a_measured_ground_is_told_so() -> None:
    (told,) = _ground_assumed({"ground": {"measured": 0.8}})
    assert told.holds and told.found == "points lie close together on 80 % of the lane ahead"
    assert _ground_assumed({"ground": {"measured": None}}) == [] == _ground_assumed({})
