"""Work and memory of a whole run against the size of the drive: counted, not timed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from sample_scenes.box_worlds import make_box_world
from sample_scenes.long_street import long_street, long_way
from tests.ground.test_blocks import straight
from tests.ground.test_street import look
from unveil_core.base.frame_cache import FrameCache
from unveil_core.delivery.views import EmptyView, EmptyViews, choose_sources
from unveil_core.drives.drive import PointCloud
from unveil_core.evaluate.holdout.drive import seen_elsewhere
from unveil_core.evaluate.holdout.placement import CarPixels, SceneView
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.reach import CameraViews
from unveil_core.ground import blocks
from unveil_core.ground.blocks import cut_into_blocks
from unveil_core.inpaint.frames.holes import Hole
from unveil_core.inpaint.frames.keyframes import plan_keyframes
from unveil_core.movers.seen_through import DriveVisibility, FrameVisibility, count_evidence
from unveil_core.optimize.in_blocks import block_of_drive
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.raster import api
from unveil_core.remove import observed
from unveil_core.remove.observed import SeenView, SeenViews, never_seen

SIZE = (96, 64)


@dataclass
class Work:
    """What a run did: points that were projected, pixels and surfels that were rendered, bytes of frames that were held at most."""

    points: int = 0
    pixels: int = 0
    surfels: int = 0
    held: int = 0


def work_of(folder: Path, frames: int, size: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> Work:
    way = long_way(frames, size=size)
    drive = make_box_world(folder / "drive", long_street(float(frames), seed=1), way, rays=1500)
    work = Work()
    project, render, get = Camera.project, api.render, FrameCache.get

    def counted_project(self: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        work.points += len(points)
        return project(self, points)

    def counted_render(surfels, camera, *arguments, **options):  # type: ignore[no-untyped-def]
        work.pixels += camera.width * camera.height
        work.surfels += len(surfels)
        return render(surfels, camera, *arguments, **options)

    def watched_get(self: FrameCache, *arguments: object) -> object:
        found = get(self, *arguments)  # type: ignore[arg-type]
        work.held = max(work.held, self.nbytes)
        return found

    with monkeypatch.context() as patch:
        patch.setattr(blocks, "BLOCK_M", 8.0)
        patch.setattr(Camera, "project", counted_project)
        patch.setattr(FrameCache, "get", watched_get)
        for module in _modules_with(render):
            patch.setattr(module, "render", counted_render)
        settings = RunSettings(quality="draft", remove=("vehicle",), iterations=40, memory="64M", adapt=False)
        run(drive, folder / "workspace", settings, until="mesh")
    return work


def _modules_with(function: object) -> list[object]:
    import sys

    return [
        m
        for name, m in list(sys.modules.items())
        if name.startswith("unveil_core") and vars(m).get("render") is function
    ]


def test_twice_the_width_is_four_times_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    once = work_of(tmp_path / "once", 10, SIZE, monkeypatch)
    wide = work_of(tmp_path / "wide", 10, (2 * SIZE[0], 2 * SIZE[1]), monkeypatch)
    assert wide.pixels < 4.4 * once.pixels and wide.points < 4.6 * once.points
    assert max(once.held, wide.held) <= 64 << 20


def line(frames: int) -> list[Camera]:
    """A camera every 5 m along x, looking ahead."""
    return [look(np.array([5.0 * i, 0.0, 1.6]), 0.0).resized(24, 16) for i in range(frames)]


def growth(work: Callable[[int], None], monkeypatch: pytest.MonkeyPatch) -> float:
    """By how much the number of projected points grows from 60 frames to 120, from 300 m to 600."""
    counts = []
    project, shared_out = Camera.project, observed.in_parallel
    for frames in (60, 120):
        points = 0

        def counted(self: Camera, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            nonlocal points
            points += len(places)
            return project(self, places)

        def counted_kernel(kernel: object, size: int, *arguments: object) -> None:
            nonlocal points
            points += size
            shared_out(kernel, size, *arguments)  # type: ignore[arg-type]

        with monkeypatch.context() as patch:
            patch.setattr(Camera, "project", counted)
            patch.setattr(observed, "in_parallel", counted_kernel)
            work(frames)
        counts.append(points)
    assert counts[0] > 0
    return counts[1] / counts[0]


def visibility_of(frames: int) -> None:
    cameras, shape = line(frames), (16, 24)
    hidden = np.zeros(shape, dtype=bool)
    hidden[8:12, 10:14] = True
    nothing = SeenView(np.where(hidden, 0, 3).astype(np.float16))
    views = SeenViews(cameras, [nothing] * frames)
    for camera in cameras:
        assert never_seen(camera, hidden, np.full(shape, 12.0), views).sum() == hidden.sum()


def keyframes_of(frames: int) -> None:
    mask = np.zeros((16, 24), dtype=bool)
    mask[6:9, 10:14] = True
    holes = [Hole(camera, mask, np.full(int(mask.sum()), 10.0)) for camera in line(frames)]
    assert plan_keyframes(holes, np.arange(frames)).keyframes or frames


def sources_of(frames: int) -> None:
    cameras = line(frames)
    views = EmptyViews(
        cameras, [EmptyView(c, np.full((16, 24), 10, np.float32), np.zeros((16, 24), bool)) for c in cameras]
    )
    for i, camera in enumerate(cameras):
        choose_sources(camera.centre + 10 * camera.rays()[6:9, 10:14].reshape(-1, 3), i, views, 3)


def evidence_of(frames: int) -> None:
    cameras, shape = line(frames), (16, 24)
    visibility = DriveVisibility(cameras, [FrameVisibility(np.ones(shape, bool), np.zeros(shape, bool))] * frames)
    for i, camera in enumerate(cameras):
        count_evidence(camera.centre + 8 * camera.rays()[7:9, 11:13].reshape(-1, 1, 3), visibility, i, farther=4.0)


def footage_of(frames: int) -> None:
    cameras, shape = line(frames), (16, 24)
    number = np.zeros(shape, dtype=np.uint8)
    number[8:12, 10:14] = 1
    car = CarPixels(number, np.full(shape, 5.0, np.float32), np.zeros((*shape, 3), np.uint8))
    # What no frame shows is asked of all that may.
    views = [SceneView(c, np.full(shape, 12.0, np.float32), np.ones(shape, bool)) for c in cameras]
    found = seen_elsewhere(CameraViews(cameras, views), [car] * frames, far=100.0)
    assert not any(mask.any() for mask in found)


@pytest.mark.parametrize("work", [visibility_of, keyframes_of, sources_of, evidence_of, footage_of])
def test_twice_the_way_is_twice_the_work(work: Callable[[int], None], monkeypatch: pytest.MonkeyPatch) -> None:
    # Of the shorter drive more frames lie near an end. Each frame against all others would be 4.
    assert growth(work, monkeypatch) < 3


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
