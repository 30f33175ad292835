"""Metres, up, and the points that the scene starts from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.progress import Progress
from unveil_core.base.types import Float64, Mask, Picture
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import read_points, write_points
from unveil_core.solve.events import Events
from unveil_core.solve.footage.frames import FootageFrame, Reel
from unveil_core.solve.mapping.model import Model
from unveil_core.solve.placing import Placed, placed, up_and_height
from unveil_core.solve.points.cloud import dense_points
from unveil_core.solve.points.straight import Straightened, straightened
from unveil_core.solve.settings import SolveSettings
from unveil_core.solve.stages.look import Looked
from unveil_core.solve.steps import Steps

__all__ = ["Found", "place_and_fill"]


@dataclass(frozen=True, eq=False)
class Found:
    """Attributes: model: in metres; points: likewise; placed: how they are known."""

    model: Model
    points: PointCloud
    placed: Placed


def place_and_fill(
    model: Model,
    reels: Sequence[Reel],
    looked: Looked,
    output: Path,
    settings: SolveSettings,
    steps: Steps,
    events: Events,
) -> Found:
    owner = {f.file: f for r in reels for f in r.frames}
    cameras = [owner[n].camera for n in model.names]
    cloud_place = steps.folder / "points.ply"
    sparse = PointCloud(model.points)
    up, source, height = up_and_height(model, cameras, sparse)
    if steps.begin("points", None) is not None and cloud_place.is_file():
        events.end("points", "up to date")
        cloud = read_points(cloud_place)
    else:
        progress = events.begin("points")
        cloud = _dense(model, owner, looked, output, up, height, progress)
        if not len(cloud.positions):
            cloud = PointCloud(model.points, np.full((len(model.points), 3), 128, np.uint8))
        write_points(cloud, cloud_place)
        steps.done("points", {"points": len(cloud.positions)})
        events.end("points")
    up, source, height = up_and_height(model, cameras, cloud)
    where = placed(model, reels, up, source, height, settings)
    moved = replace(cloud, positions=where.to_model.to_local(cloud.positions))
    return Found(model.moved(where.to_model), moved, where)


def _dense(
    model: Model,
    owner: dict[str, FootageFrame],
    looked: Looked,
    output: Path,
    up: Float64,
    height: float | None,
    progress: Progress,
) -> PointCloud:
    lenses: dict[int, Straightened] = {}
    cameras = []
    for i in range(len(model.names)):
        number = int(model.lens[i])
        if number not in lenses:
            lenses[number] = straightened(model.lenses[number].camera(np.eye(4)), model.lenses[number].distortion)
        cameras.append(replace(lenses[number].camera, world_to_camera=model.poses[i]))
    tracks: dict[str, list[int]] = {}
    order = {f: k for k, f in enumerate(owner)}
    for i in sorted(range(len(model.names)), key=lambda i: order[model.names[i]]):
        tracks.setdefault(owner[model.names[i]].camera, []).append(i)

    def picture(i: int) -> tuple[Picture, Mask | None]:
        frame, lens = owner[model.names[i]], lenses[int(model.lens[i])]
        hidden = looked.allowed(frame)
        return lens.picture(read_image(output / "images" / frame.file)), lens.hidden(
            None if hidden is None else ~hidden
        )

    return dense_points(cameras, list(tracks.values()), picture, up, height, progress)
