"""Metres, up, and the points that the scene starts from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.types import Mask, Picture
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import read_points, write_points
from unveil_core.points.cloud import dense_points
from unveil_core.points.straight import straightened
from unveil_core.solve.events import Events
from unveil_core.solve.footage.frames import FootageFrame, Reel
from unveil_core.solve.mapping.model import Model
from unveil_core.solve.placing import Placed, placed, up_and_height
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
    images: Path,
    settings: SolveSettings,
    steps: Steps,
    events: Events,
) -> Found:
    owner = {f.file: f for r in reels for f in r.frames}
    cameras = [owner[n].camera for n in model.names]
    cloud_place = steps.folder / "points.ply"
    up, source, height = up_and_height(model, cameras, PointCloud(model.points))
    before = steps.begin("points", None)
    if before is not None:
        events.end("points", "up to date")
        cloud = read_points(cloud_place)
    else:
        progress = events.begin("points")
        views = _Views(model, owner, looked, images)
        cloud = dense_points(views.cameras, views.tracks, views.picture, up, height, progress)
        if not len(cloud.positions):
            cloud = PointCloud(model.points, np.full((len(model.points), 3), 128, np.uint8))
        write_points(cloud, cloud_place)
        steps.done("points", {"points": len(cloud.positions)}, [cloud_place])
        events.end("points")
    up, source, height = up_and_height(model, cameras, cloud)
    where = placed(model, reels, up, source, height, settings)
    moved = replace(cloud, positions=where.to_model.to_local(cloud.positions))
    return Found(model.moved(where.to_model), moved, where)


class _Views:
    """The frames of a model as points are found in them."""

    def __init__(self, model: Model, owner: dict[str, FootageFrame], looked: Looked, images: Path) -> None:
        self.model, self.owner, self.looked, self.images = model, owner, looked, images
        self.lenses = [straightened(lens.camera(np.eye(4)), lens.distortion) for lens in model.lenses]
        self.cameras = [
            replace(self.lenses[int(k)].camera, world_to_camera=pose)
            for k, pose in zip(model.lens, model.poses, strict=True)
        ]
        order = {f: k for k, f in enumerate(owner)}
        tracks: dict[str, list[int]] = {}
        for i in sorted(range(len(model.names)), key=lambda i: order[model.names[i]]):
            tracks.setdefault(owner[model.names[i]].camera, []).append(i)
        self.tracks = list(tracks.values())

    def picture(self, i: int) -> tuple[Picture, Mask | None]:
        """A frame without distortion, and its pixels that are no part of the street."""
        frame, lens = self.owner[self.model.names[i]], self.lenses[int(self.model.lens[i])]
        return lens.picture(read_image(self.images / frame.file)), lens.hidden(self.looked.hidden(frame))
