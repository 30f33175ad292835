"""What the page draws from the surfels: packed splats, fewer of them, the map, the flight."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.evaluate.street_workspace import CARS, OFFSET
from tests.report.scene_workspace import ROAD
from tests.report.test_page import Page
from unveil_core.base.errors import WorkspaceError
from unveil_core.base.progress import no_progress
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.imported import read_imported
from unveil_core.geometry.axes import UP
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.origin import CONTINUED, INVENTED, SEEN_ELSEWHERE
from unveil_core.provenance.of_workspace import surfel_origins
from unveil_core.raster.picture import picture_of, render_numpy
from unveil_core.raster.spherical_harmonics import SH0
from unveil_core.report.collect import KINDS, MOST_THUMBNAILS, THUMBNAIL_BYTES
from unveil_core.report.pictures import FRAME_BYTES, jpeg_uri
from unveil_core.report.scene import flight as flights
from unveil_core.report.scene import gathered
from unveil_core.report.scene.gathered import MapPictures, ScenePictures, gather_scene
from unveil_core.report.scene.merged import MOST_SPLATS, within_budget
from unveil_core.report.scene.packed import LOG_SCALES, packed
from unveil_core.report.scene.parts import map_part
from unveil_core.report.scene.path import Way, looking, stretch_of, way_along
from unveil_core.report.scene.splats import Splats, splats_of
from unveil_core.report.scene.top_view import map_of, top_view
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.scene_edit import read_edit, write_edit
from unveil_core.surfels.sky import load_sky
from unveil_core.surfels.surfels import Surfels, rotations


@pytest.fixture(scope="module")
def surfels(scene_workspace: Path) -> Surfels:
    return read_surfels(scene_workspace / "surfels/empty.ply")


@pytest.fixture(scope="module")
def way(scene_workspace: Path) -> Way:
    return way_along(read_imported(scene_workspace / "drive", points=False))


def as_surfels(splats: Splats) -> Surfels:
    """Splats for the rasterizer."""
    count = len(splats)
    opacities = torch.from_numpy(splats.opacities).double().clamp(1e-6, 1 - 1e-6)
    sh = (torch.from_numpy(splats.colors) - 0.5)[:, None] / SH0
    labels = torch.zeros(count, dtype=torch.int64)
    quats, scales = torch.from_numpy(splats.quats), torch.from_numpy(splats.log_scales)
    return Surfels(torch.from_numpy(splats.means), quats, scales, torch.logit(opacities).float(), sh, labels)


def unpacked(words: np.ndarray, low: np.ndarray, step: float) -> Splats:
    """Splats as the table in ``packed`` says, bit by bit."""
    bits = "".join(f"{int(v):032b}"[::-1] for v in words.reshape(-1))

    def number(row: int, start: int, count: int) -> int:
        at = 160 * row + start
        return int(bits[at : at + count][::-1], 2)

    rows = range(len(words))
    means = [[number(i, 21 * k, 21) * step + low[k] for k in range(3)] for i in rows]
    shades = np.array([[number(i, 96 + 8 * k, 8) / 255 for k in range(4)] for i in rows])
    span = LOG_SCALES[1] - LOG_SCALES[0]
    scales = [[LOG_SCALES[0] + span * number(i, 128 + 14 * k, 14) / 16383 for k in range(2)] for i in rows]
    quats = np.zeros((len(words), 4))
    for i in rows:
        largest, place = number(i, 94, 2), 64
        for k in (3, 2, 1, 0):
            if k != largest:
                quats[i, k] = number(i, place, 9) / 511 / 2**0.5 * (-1 if number(i, place + 9, 1) else 1)
                place += 10
        quats[i, largest] = np.sqrt(1 - (quats[i] ** 2).sum())
    origins = np.array([number(i, 156, 4) for i in rows])
    return Splats(np.array(means), np.roll(quats, 1, axis=1), np.array(scales), shades[:, 3], shades[:, :3], origins)


def test_what_is_packed_comes_back(surfels: Surfels, scene_workspace: Path, way: Way) -> None:
    origins = surfel_origins(scene_workspace, len(surfels))
    assert set(np.unique(origins)) == {SEEN_ELSEWHERE, CONTINUED, INVENTED}
    splats = splats_of(surfels, origins, way.eyes)
    assert len(splats) == len(surfels)
    some = splats.select(np.arange(0, len(splats), 17))
    words, low, step = packed(some)
    found = unpacked(words, low, step)
    assert step < 1e-4
    np.testing.assert_allclose(found.means, some.means, atol=step)
    np.testing.assert_allclose(found.colors, some.colors, atol=0.5 / 255 + 1e-6)
    np.testing.assert_allclose(found.opacities, some.opacities, atol=0.5 / 255 + 1e-6)
    np.testing.assert_allclose(found.log_scales, some.log_scales, atol=0.0006)
    np.testing.assert_array_equal(found.origins, some.origins)
    turned = rotations(torch.from_numpy(found.quats)) - rotations(torch.from_numpy(some.quats.astype(np.float64)))
    assert float(turned.abs().max()) < 0.006


def test_of_nothing_nothing_is_packed() -> None:
    nothing = np.zeros((0, 4), np.float32)
    empty = Splats(nothing[:, :3], nothing, nothing[:, :2], nothing[:, 0], nothing[:, :3], np.zeros(0, np.uint8))
    words, _, step = packed(empty)
    assert words.shape == (0, 5) and step > 0


def test_colours_by_direction_are_those_of_the_nearest_camera(surfels: Surfels, way: Way) -> None:
    sh = torch.zeros(len(surfels), 4, 3)
    sh[:, 3] = -0.4  # brighter towards +x: the camera looks that way
    shown = splats_of(Surfels(*(*(getattr(surfels, n) for n in NAMES[:4]), sh, surfels.labels)), None, way.eyes)
    ahead = shown.means[:, 0] > way.eyes[-1, 0] + 5
    assert ahead.any() and (shown.colors[ahead] > 0.6).all()
    assert set(shown.origins.tolist()) == {SEEN_ELSEWHERE}


NAMES = ("means", "quats", "log_scales", "opacity_logits", "sh", "labels")


def test_fewer_splats_look_alike_and_leave_no_holes() -> None:
    eyes = np.zeros((1, 3))
    y, z = (v.ravel() for v in np.meshgrid(np.arange(-3, 3, 0.1), np.arange(-2, 2, 0.1)))
    wall = np.column_stack([np.full(len(y), 8.0), y, z])
    normals = np.tile([-1.0, 0.0, 0.0], (len(wall), 1))
    shades = np.stack([0.5 + 0.4 * np.sin(3 * y), 0.5 + 0.4 * np.cos(2 * z), np.full(len(y), 0.4)], axis=1)
    colors, labels = np.round(255 * shades).astype(np.uint8), np.zeros(len(wall), np.int64)
    surfels = surfels_from_points(wall, colors, labels, normals, np.full(len(wall), 0.1), opacity=0.9, scale_factor=0.7)
    splats = splats_of(surfels, np.where(y > 0, INVENTED, SEEN_ELSEWHERE).astype(np.uint8), eyes)
    assert within_budget(splats, eyes, len(splats)) is splats
    assert all(len(within_budget(splats, eyes, most)) <= most for most in (2399, 2000, 30))
    fewer = within_budget(splats, eyes, len(splats) // 3)
    assert 0.25 * len(splats) < len(fewer) <= len(splats) // 3
    assert ((fewer.origins == INVENTED) == (fewer.means[:, 1] > 0.04)).all()

    camera = looking(eyes[0], np.array([1.0, 0, 0]), UP, (96, 64), 140.0)
    whole, merged, left_out = (
        render_numpy(as_surfels(s), camera, near=NEAR_M, far=FAR_M)
        for s in (splats, fewer, splats.select(np.arange(0, len(splats), 3)))
    )
    errors = [float(np.abs(255 * (whole["rgb"] - other["rgb"])).mean()) for other in (merged, left_out)]
    assert errors[0] < 8 < 25 < errors[1]
    # The same light goes through; where two of three were left out, the sky would show.
    assert whole["alpha"].min() > 0.95 and merged["alpha"].min() > 0.8 > left_out["alpha"].min()


def test_a_splat_alone_stays_as_it_was(surfels: Surfels, way: Way) -> None:
    splats = splats_of(surfels, None, way.eyes)
    wall = int(np.argmax(splats.means[:, 2]))
    found = within_budget(splats.select(np.array([wall, *([0] * 9)])), way.eyes, 5)  # and many of one place
    assert len(found) == 2
    k = int(np.argmin(np.linalg.norm(found.means - splats.means[wall], axis=1)))
    np.testing.assert_allclose(found.means[k], splats.means[wall], atol=1e-4)
    np.testing.assert_allclose(np.sort(found.log_scales[k]), np.sort(splats.log_scales[wall]), atol=1e-3)
    np.testing.assert_allclose(found.opacities[k], splats.opacities[wall], atol=1e-3)
    normals = [rotations(torch.from_numpy(q[None]))[0, :, 2].numpy() for q in (found.quats[k], splats.quats[wall])]
    assert abs(float(normals[0] @ normals[1])) > 0.9999


def test_the_map_shows_the_street_where_it_lies(scene_workspace: Path, surfels: Surfels, way: Way) -> None:
    origins = surfel_origins(scene_workspace, len(surfels))
    view = top_view(surfels, origins, way)
    height, width = view.picture.shape[:2]
    assert view.map.size == (width, height) and view.origins is not None and view.origins.shape == (height, width)
    shift = OFFSET - read_imported(scene_workspace / "drive").to_world.translation
    places = view.map.to_pixels(np.array([[car.x, car.y, 0] for car in CARS]) + shift)
    assert (np.diff(places[:, 0]) > 0).all()  # the drive goes to the right
    assert places[0, 1] < places[1, 1]  # the first car stands at its left
    for (x, y), kind in zip(places[:2], (CONTINUED, INVENTED), strict=True):
        around = view.origins[int(y) - 6 : int(y) + 7, int(x) - 6 : int(x) + 7]
        assert set(np.unique(around)) - {0} == {kind} and (around == kind).mean() > 0.9
    road = view.map.to_pixels(np.array([[6.0, 0.0, 0]]) + shift)[0]
    gray = view.picture[int(road[1]) - 4 : int(road[1]) + 5, int(road[0]) - 4 : int(road[0]) + 5].mean(axis=(0, 1))
    np.testing.assert_allclose(gray, ROAD, atol=14)
    apart = view.map.to_pixels(np.array([[0.0, 0, 0], [0.0, 2.5, 0]]))
    assert np.linalg.norm(apart[1] - apart[0]) == pytest.approx(2.5 * view.map.pixels_per_m)


def test_a_needle_across_the_street_is_no_beam_on_the_map(surfels: Surfels, way: Way) -> None:
    plain = top_view(surfels, None, way)
    spoilt = replace(surfels, log_scales=surfels.log_scales.clone())
    road = torch.linalg.norm(surfels.means[:, :2] - torch.from_numpy(way.eyes[0, :2] + (6.0, 0.0)), dim=1).argmin()
    spoilt.log_scales[road] = torch.tensor([np.log(8.0), np.log(0.2)])
    view = top_view(spoilt, None, way)
    assert view.map.size == plain.map.size
    assert np.abs(view.picture.astype(int) - plain.picture).mean() < 0.1


def test_of_a_long_drive_the_part_is_shown_where_most_was_removed() -> None:
    eyes = np.stack([np.arange(0, 500, 0.25), np.zeros(2000), np.zeros(2000)], axis=1)
    way = Way(eyes, np.tile([1.0, 0.0, 0.0], (2000, 1)))
    removed = np.array([[20.0, 3, 0], [300.0, 3, 0], [310.0, -3, 0], [350.0, -3, 0]])
    part, before = stretch_of(way, removed, 80.0)
    assert part.length == 80 and part.eyes[0, 0] == before
    assert before < 300 and before + 80 > 350
    assert stretch_of(way, removed[:0], 80.0)[1] == pytest.approx(210, abs=0.3)
    assert len(stretch_of(way, removed, 900.0)[0].eyes) == 2000


@pytest.mark.parametrize("length", [1, 2_000, 20_000])
def test_a_map_of_any_drive_is_small(length: int) -> None:
    eyes = np.stack([0.25 * np.arange(length), 3 * np.sin(np.arange(length) / 90), np.zeros(length)], axis=1)
    way = Way(eyes @ np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]]), np.tile([0.6, 0.8, 0.0], (length, 1)))
    width, height = map_of(way).size
    assert width * height <= 2_500_000 and max(width, height) <= 8_001
    assert width > height * (3 if length > 1 else 0.5)
    pixels = map_of(way).to_pixels(way.eyes)
    assert pixels[-1, 0] >= pixels[0, 0] and (pixels >= 0).all() and (pixels < (width, height)).all()


def cameras_of(length_m: float) -> list[Camera]:
    eyes = np.stack([np.arange(0, length_m, 0.25), *2 * [np.zeros(int(np.ceil(length_m / 0.25)))]], axis=1)
    return flights.flight_cameras(Way(eyes, np.tile([1.0, 0.0, 0.0], (len(eyes), 1))))


def test_a_flight_is_no_longer_than_people_watch() -> None:
    assert [len(cameras_of(metres)) for metres in (1.0, 20.0, 80.0, 5000.0)] == [0, 48, 120, 180]
    heights = [c.centre[2] for c in cameras_of(80.0)]
    assert heights[0] == 0 and max(heights) == pytest.approx(1.5, abs=0.01) and heights[-1] == pytest.approx(0)


def test_the_flight_shows_the_scene(scene_workspace: Path, surfels: Surfels) -> None:
    av = pytest.importorskip("av")
    drive, sky = read_imported(scene_workspace / "drive", points=False), load_sky(scene_workspace / "surfels/sky.npz")
    cameras = flights.flight_cameras(way_along(drive), 300)[::16]
    content = flights.flight(surfels, sky, cameras, no_progress)
    with av.open(io.BytesIO(content)) as container:
        shown = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
        assert container.streams.video[0].codec_context.name == "h264"
    assert len(shown) == len(cameras) and shown[0].shape == (162, 288, 3)
    for camera, picture in zip(cameras, shown, strict=True):
        drawn = picture_of(surfels, sky, camera, near=NEAR_M, far=FAR_M)
        assert np.abs(drawn.astype(float) - picture).mean() < 6


def test_without_pyav_the_flight_is_left_out_with_a_word(
    scene_workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gathered, "movies_can_be_written", lambda: False)
    scene = gather_scene(
        scene_workspace, read_imported(scene_workspace / "drive", points=False), np.zeros((0, 3)), no_progress
    )
    assert scene is not None and scene.flight is None and "PyAV is not installed" in scene.no_flight
    assert json.loads(json.dumps(scene.viewer))["count"] == len(base64.b64decode(scene.viewer["splats"])) / 20


def test_arrays_of_another_scene_are_one_line(scene_workspace: Path, surfels: Surfels) -> None:
    path = scene_workspace / "surfels/edit.npz"
    before = path.read_bytes()
    try:
        write_edit(replace(read_edit(path), added=None, origin=np.zeros(0, np.uint8)), path)
        with pytest.raises(WorkspaceError, match=r"empty\.ply: has \d+ surfels, \d+ are expected"):
            gather_scene(
                scene_workspace, read_imported(scene_workspace / "drive", points=False), np.zeros((0, 3)), no_progress
            )
    finally:
        path.write_bytes(before)


def test_the_page_of_a_scene_needs_nothing_but_itself(scene_workspace: Path) -> None:
    text = (scene_workspace / "report/index.html").read_text()
    page = Page(text)
    for _, attributes in page.found:
        for name in ("src", "href", "poster"):
            assert (attributes.get(name) or "data:").startswith(("data:", "#object-"))
    words = "".join(part for attributes, part in page.scripts if not attributes)
    assert not re.search(r"https?:|import\(|fetch\(|XMLHttpRequest|new Worker|eval\(|Function\(", words)
    (policy,) = [str(a["content"]) for tag, a in page.found if tag == "meta" and "default-src" in str(a)]
    digest = base64.b64encode(hashlib.sha256(words.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}';" in policy and "default-src 'none'" in policy
    assert {"media-src data:", "img-src data:"} <= {part.strip() for part in policy.split(";")}
    (scene,) = [part for attributes, part in page.scripts if attributes.get("id") == "scene"]
    assert json.loads(scene)["kinds"] == [CONTINUED, INVENTED]
    assert page.text.count("continued from what was seen") >= 3


def test_boxes_that_are_none_are_not_on_the_map(scene_workspace: Path) -> None:
    place = map_of(way_along(read_imported(scene_workspace / "drive", points=False)))
    width, height = place.size
    drawn = MapPictures(place, np.array([[0.0, 5.0], [9.0, 5.0]]), "data:,", None)
    good = {"centre": [5, 1, 0], "size": [4, 2, 1.5], "yaw": 0.3}
    bad = [None, 7, {}, {**good, "yaw": "x"}, {**good, "size": [1]}, {**good, "centre": [float("nan"), 0, 0]}]
    entries = [{"id": k, "class": "<car>", "removed": True, "box": box} for k, box in enumerate([good, *bad])]
    found = map_part(ScenePictures({}, drawn), [*entries, {"id": 9, "removed": False, "box": good}])
    assert found is not None and [box["id"] for box in found["boxes"]] == ["0"]
    x, y = float(found["boxes"][0]["x"]), float(found["boxes"][0]["y"])
    assert 0 < x < width and 0 < y < height


def test_the_parts_of_a_page_stay_below_its_limit() -> None:
    movie = flights.SECONDS[1] * flights.BITS_PER_SECOND / 8
    parts = (
        FRAME_BYTES + 20 * MOST_SPLATS * 4 / 3 + movie * 4 / 3 + gathered.MAP_BYTES + MOST_THUMBNAILS * THUMBNAIL_BYTES
    )
    assert parts < 22e6  # the rest is for overlays, tables and words
    noise = np.random.default_rng(0).integers(0, 256, (252, 420, 3)).astype(np.uint8)  # one of 32
    most = FRAME_BYTES // (32 * KINDS)
    assert len(jpeg_uri(noise)) > most >= len(jpeg_uri(noise, most=most))
