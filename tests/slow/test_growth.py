"""Work and memory of a whole run against the size of the drive: counted, not timed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tests.pipeline.test_growth import modules_with
from tests.worlds.box_worlds import make_box_world
from tests.worlds.long_street import long_street, long_way
from unveil_core.base.frame_cache import FrameCache, nbytes_of
from unveil_core.geometry.camera import Camera
from unveil_core.ground import blocks
from unveil_core.optimize.reoptimize import REOPTIMIZE_PRESETS, ReoptimizeSettings
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.raster import api

SIZE = (48, 32)
FRAMES, BLOCK_M = 8, 4.0
ROOM = 1 << 18
"""Bytes that the pictures of frames may take, far less than those of a drive: what is wanted again is loaded again."""


@dataclass
class Work:
    """What a run did.

    Attributes:
        points: that were projected; pixels, surfels: that were rendered.
        loaded: bytes of pictures of frames that were loaded or computed.
        held: bytes of pictures that were held at most at once; largest: bytes of the largest of them.
    """

    points: int = 0
    pixels: int = 0
    surfels: int = 0
    loaded: int = 0
    held: int = 0
    largest: int = 0


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

    def watched_get(self: FrameCache, key: tuple[int, int], make: Callable[[int], object]) -> object:
        def made(index: int) -> object:
            value = make(index)
            work.loaded += nbytes_of(value)
            work.largest = max(work.largest, nbytes_of(value))
            return value

        found = get(self, key, made)
        work.held = max(work.held, self.nbytes)
        return found

    with monkeypatch.context() as patch:
        patch.setattr(blocks, "BLOCK_M", BLOCK_M)
        patch.setattr(RunSettings, "memory_bytes", property(lambda self: ROOM))
        patch.setattr(Camera, "project", counted_project)
        patch.setattr(FrameCache, "get", watched_get)
        for module in modules_with(render):
            patch.setattr(module, "render", counted_render)
        patch.setitem(REOPTIMIZE_PRESETS, "draft", ReoptimizeSettings(iterations=10, ground_spacing_m=0.2))
        settings = RunSettings(quality="draft", remove=("vehicle",), iterations=20, adapt=False, shadows="off")
        run(drive, folder / "workspace", settings, until="reoptimize")
    return work


def test_a_run_of_twice_the_frames_is_twice_the_work_and_of_twice_the_width_four_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    once = work_of(tmp_path / "once", FRAMES, SIZE, monkeypatch)
    long = work_of(tmp_path / "long", 2 * FRAMES, SIZE, monkeypatch)
    wide = work_of(tmp_path / "wide", FRAMES, (2 * SIZE[0], 2 * SIZE[1]), monkeypatch)
    # How many frames look at one place is more in the longer drive, for so short a street: that is for the pieces below.
    assert long.pixels < 2.2 * once.pixels
    assert wide.pixels < 4.4 * once.pixels and wide.points < 4.4 * once.points and wide.surfels < 4.4 * once.surfels
    for work in (once, long, wide):
        # Far more was asked for than there is room for.
        assert work.loaded > 4 * ROOM and work.largest < ROOM and work.held <= ROOM
