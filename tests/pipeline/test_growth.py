"""Work of pieces of a run against the size of the drive: counted, not timed. A whole run is in ``tests/slow/``."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from tests.ground.test_blocks import straight
from tests.ground.test_street import look
from unveil_core.base.frame_cache import FrameCache
from unveil_core.delivery.views import EmptyView, EmptyViews, choose_sources
from unveil_core.drives.drive import PointCloud
from unveil_core.evaluate.holdout.drive import seen_elsewhere
from unveil_core.evaluate.holdout.placement import CarPixels, SceneView
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.reach import CameraViews
from unveil_core.ground.blocks import cut_into_blocks
from unveil_core.inpaint.frames.holes import Hole
from unveil_core.inpaint.frames.keyframes import plan_keyframes
from unveil_core.movers.seen_through import DriveVisibility, FrameVisibility, count_evidence
from unveil_core.optimize.in_blocks import block_of_drive
from unveil_core.raster import api
from unveil_core.remove import observed
from unveil_core.remove.observed import SeenView, SeenViews, never_seen
from unveil_core.remove.remains import remains
from unveil_core.surfels.initialize import surfels_from_points

SIZE = (48, 32)
FRAMES, BLOCK_M = 8, 4.0
ROOM = 1 << 18
"""Bytes that the pictures of frames may take, far less than those of a drive: what is wanted again is loaded again."""


def modules_with(function: object) -> list[object]:
    import sys

    return [
        m
        for name, m in list(sys.modules.items())
        if name.startswith("unveil_core") and vars(m).get("render") is function
    ]


def line(frames: int, size: tuple[int, int]) -> list[Camera]:
    """A camera every 5 m along x, looking ahead."""
    return [look(np.array([5.0 * i, 0.0, 1.6]), 0.0).resized(*size) for i in range(frames)]


@dataclass(frozen=True)
class Given:
    """A drive for one piece of work: so many frames of a size, whose pictures come from a cache."""

    frames: int
    size: tuple[int, int] = (24, 16)
    cache: FrameCache = field(default_factory=FrameCache)

    @property
    def shape(self) -> tuple[int, int]:
        return self.size[1], self.size[0]

    @property
    def cameras(self) -> list[Camera]:
        return line(self.frames, self.size)

    def part(self, top: float, bottom: float, left: float, right: float) -> np.ndarray:
        """(H, W) bool, a part of the picture, in shares of its sides."""
        mask = np.zeros(self.shape, dtype=bool)
        height, width = self.shape
        mask[round(top * height) : round(bottom * height), round(left * width) : round(right * width)] = True
        return mask


def visibility_of(given: Given) -> None:
    hidden = given.part(0.5, 0.75, 0.42, 0.58)

    def seen(i: int) -> SeenView:
        return SeenView(np.where(hidden, 0, 3).astype(np.float16))

    cameras = given.cameras
    views = SeenViews(cameras, given.cache.frames(given.frames, seen))
    for camera in cameras:
        assert never_seen(camera, hidden, np.full(given.shape, 12.0), views).any()


def keyframes_of(given: Given) -> None:
    mask = given.part(0.38, 0.56, 0.42, 0.58)
    holes = [Hole(camera, mask, np.full(int(mask.sum()), 10.0)) for camera in given.cameras]
    assert len(plan_keyframes(holes, np.arange(given.frames)).visit_order) == given.frames


def sources_of(given: Given) -> None:
    cameras, asked = given.cameras, given.part(0.38, 0.56, 0.42, 0.58)

    def view(i: int) -> EmptyView:
        return EmptyView(cameras[i], np.full(given.shape, 10, np.float32), np.zeros(given.shape, bool))

    views = EmptyViews(cameras, given.cache.frames(given.frames, view))
    for i, camera in enumerate(cameras):
        choose_sources(camera.centre + 10 * camera.rays()[asked], i, views, 3)


def evidence_of(given: Given) -> None:
    cameras, asked = given.cameras, given.part(0.44, 0.56, 0.46, 0.54)

    def view(i: int) -> FrameVisibility:
        return FrameVisibility(np.ones(given.shape, bool), np.zeros(given.shape, bool))

    visibility = DriveVisibility(cameras, given.cache.frames(given.frames, view))
    for i, camera in enumerate(cameras):
        count_evidence(camera.centre + 8 * camera.rays()[asked].reshape(-1, 1, 3), visibility, i, farther=4.0)


def footage_of(given: Given) -> None:
    cameras, number = given.cameras, given.part(0.5, 0.75, 0.42, 0.58).astype(np.uint8)

    def car(i: int) -> CarPixels:
        return CarPixels(number, np.full(given.shape, 5.0, np.float32), np.zeros((*given.shape, 3), np.uint8))

    def view(i: int) -> SceneView:
        return SceneView(cameras[i], np.full(given.shape, 12.0, np.float32), np.ones(given.shape, bool))

    # What no frame shows is asked of all that may.
    views = CameraViews(cameras, given.cache.frames(given.frames, view))
    found = seen_elsewhere(views, given.cache.frames(given.frames, car), far=100.0)
    assert not any(mask.any() for mask in found)


def rendered_of(given: Given) -> None:
    """Surfels every 4 m along the way, of which each frame renders those that are near."""
    x = np.repeat(np.arange(0.0, 5.0 * given.frames, 4.0), 2)
    points = np.stack([x, np.tile([-5.0, 5.0], len(x) // 2), np.full(len(x), 1.5)], axis=1)
    grey, label = np.full((len(x), 3), 128, np.uint8), np.zeros(len(x), np.int64)
    normals = np.repeat([[0.0, 0.0, 1.0]], len(x), axis=0)
    scene = surfels_from_points(points, grey, label, normals, np.full(len(x), 0.5), opacity=0.9)
    nothing = given.cache.frames(given.frames, lambda i: np.zeros(given.shape, dtype=bool))
    assert not remains(scene, np.zeros(len(scene), dtype=bool), given.cameras, nothing).any()


def counted(work: Callable[[Given], None], frames: int, monkeypatch: pytest.MonkeyPatch) -> tuple[int, int]:
    """Points that are projected and surfels that are rendered, and pictures that are asked for, for so many frames."""
    count = asked = 0
    project, shared_out, draw, get = Camera.project, observed.in_parallel, api.render, FrameCache.get

    def counted_project(self: Camera, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        nonlocal count
        count += len(places)
        return project(self, places)

    def counted_kernel(kernel: object, size: int, *arguments: object) -> None:
        nonlocal count
        count += size
        shared_out(kernel, size, *arguments)  # type: ignore[arg-type]

    def counted_render(surfels, *arguments, **options):  # type: ignore[no-untyped-def]
        nonlocal count
        count += len(surfels)
        return draw(surfels, *arguments, **options)

    def counted_get(self: FrameCache, *arguments: object) -> object:
        nonlocal asked
        asked += 1
        return get(self, *arguments)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(Camera, "project", counted_project)
        patch.setattr(observed, "in_parallel", counted_kernel)
        patch.setattr(FrameCache, "get", counted_get)
        for module in modules_with(draw):
            patch.setattr(module, "render", counted_render)
        work(Given(frames))
    return count, asked


PIECES = [visibility_of, keyframes_of, sources_of, evidence_of, footage_of, rendered_of]


@pytest.mark.parametrize("work", PIECES)
def test_twice_the_way_is_twice_the_work(work: Callable[[Given], None], monkeypatch: pytest.MonkeyPatch) -> None:
    """750 m and 1,500 m: frames near an end of the drive, which have fewer neighbours, are few."""
    once, twice = (counted(work, frames, monkeypatch) for frames in (150, 300))
    assert 0 < twice[0] < 2.2 * once[0] and twice[1] <= 2.2 * once[1]


@pytest.mark.parametrize("work", [visibility_of, sources_of])
def test_twice_the_way_takes_no_more_memory(work: Callable[[Given], None]) -> None:
    peaks = []
    for frames in (25, 50):
        given = Given(frames, (128, 96), FrameCache(ROOM))
        tracemalloc.start()
        work(given)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    # Less than a byte for each pixel of the frames that the longer drive has more; each has two at least.
    assert peaks[1] < peaks[0] + 25 * 128 * 96


def test_a_block_of_a_longer_drive_is_no_larger() -> None:
    sizes = []
    for frames in (400, 800):
        drive = straight(frames, 1.0)
        x = np.linspace(-50, frames + 50, 30 * frames)
        points = PointCloud(np.stack([x, 6 * np.sign(np.sin(9 * x)), np.zeros_like(x)], axis=1))
        whole = replace(drive, points=points)
        blocks_of = cut_into_blocks(whole).blocks
        parts = [block_of_drive(whole, block) for block in blocks_of]
        sizes.append((max(len(p.frames) for p in parts), max(len(p.points.positions) for p in parts)))
    assert abs(sizes[0][0] - sizes[1][0]) <= 2 and sizes[1][1] < 1.2 * sizes[0][1]
