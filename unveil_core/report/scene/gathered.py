"""What the page shows of the scene, gathered from a workspace: one reading of the surfels for all of it."""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.progress import Progress
from unveil_core.base.types import Float64
from unveil_core.drives.drive import Drive
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.origin import ORIGIN_COUNT
from unveil_core.provenance.of_workspace import surfel_origins
from unveil_core.report.pictures import data_uri, jpeg_uri, png_uri
from unveil_core.report.provenance import ORIGIN_COLORS
from unveil_core.report.scene.flight import flight, flight_cameras, movies_can_be_written
from unveil_core.report.scene.merged import within_budget
from unveil_core.report.scene.packed import LOG_SCALES, packed_text
from unveil_core.report.scene.path import STEP_M, Way, stretch_of, way_along
from unveil_core.report.scene.splats import splats_of
from unveil_core.report.scene.top_view import BACKGROUND, MARKED, Map, TopView, top_view
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.sky import Sky, load_sky
from unveil_core.surfels.surfels import Surfels

__all__ = ["MapPictures", "ScenePictures", "gather_scene"]

FIELD_DEGREES = (50.0, 80.0)
"""Least and greatest field of view of the scene's picture: that of the drive's camera, where it is neither a tele nor a fisheye."""
STRETCH_M = 80.0
"""Length of the way beside which the scene is shown in detail, metres. A draft of so much street has about 200,000 splats, near the
budget; of a kilometre within the budget nothing but haze would be left."""
STATION_M = 1.0
"""Between the places of the way that the page has, metres; between these the picture moves evenly."""
SKY_ROWS = 128
"""Of the panorama on the page at most: 100 kB of text."""
MAP_BYTES = 900_000
"""Of the map's picture at most."""
MAP_OPACITY = 150
"""Of the colours over the map, of 255."""


@dataclass(frozen=True)
class MapPictures:
    """The street from above.

    Attributes:
        map: where it lies.
        way: (S, 2) pixels of the drive's way.
        picture: a data URI.
        origins: one that is laid over it, None where nothing of that is known; kinds: those of ``MARKED`` in it.
    """

    map: Map
    way: Float64
    picture: str
    origins: str | None
    kinds: tuple[int, ...] = ()


@dataclass(frozen=True)
class ScenePictures:
    """The empty scene on the page.

    Attributes:
        viewer: what scene.js reads.
        map: the street from above.
        flight: a movie as a data URI; None where there is none, and then ``no_flight`` says why, if there is anything to say.
    """

    viewer: dict[str, Any]
    map: MapPictures
    flight: str | None = None
    no_flight: str = ""


def gather_scene(root: Path, drive: Drive, removed: Float64, progress: Progress) -> ScenePictures | None:
    """Draw the empty scene of a workspace; None where it has none.

    Args:
        removed: (K, 3) places of the removed objects.
    Raises:
        UnveilError: a file of the scene is damaged.
    """
    path = root / "surfels/empty.ply"
    surfels = read_surfels(path) if path.is_file() and drive.frames else None
    if surfels is None or not len(surfels):
        return None
    told = (root / "surfels/edit.npz").is_file()
    origins = surfel_origins(root, len(surfels)) if told else None
    sky_path = root / "surfels/sky.npz"
    sky = load_sky(sky_path) if sky_path.is_file() else _no_sky()
    way = way_along(drive)
    cameras = flight_cameras(way, drive.frames[0].camera.width)
    movie = None
    if cameras and movies_can_be_written():
        movie = data_uri("video/mp4", flight(surfels, sky, cameras, progress))
    words = "The flight along the street is left out: PyAV is not installed, which comes with the extra “exports”."
    return ScenePictures(
        viewer=_viewer(surfels, origins, sky, way, removed, drive.frames[0].camera),
        map=_map(top_view(surfels, origins, way), way),
        flight=movie,
        no_flight=words if cameras and movie is None else "",
    )


def _no_sky() -> Sky:
    """The dark of the other pictures, all around."""
    color = torch.tensor(BACKGROUND, dtype=torch.float32) / 255
    return Sky(color.reshape(3, 1, 1), up_frame(UP))


def _viewer(
    surfels: Surfels, origins: NDArray[np.uint8] | None, sky: Sky, way: Way, removed: Float64, camera: Camera
) -> dict[str, Any]:
    """What scene.js reads.

    Args:
        camera: one of the drive, whose field of view the picture has.
    """
    part, before = stretch_of(way, removed, STRETCH_M)
    text, told = packed_text(within_budget(splats_of(surfels, origins, part.eyes), part.eyes))
    eyes, views = part.at(np.arange(0.0, max(part.length, STEP_M), STATION_M))
    field = np.clip(2 * np.degrees(np.arctan(camera.width / 2 / camera.fx)), *FIELD_DEGREES)
    panorama = sky.texture.permute(1, 2, 0).numpy()
    if len(panorama) > SKY_ROWS:
        panorama = cv2.resize(panorama, (2 * SKY_ROWS, SKY_ROWS), interpolation=cv2.INTER_AREA)
    colors = np.clip(np.round(panorama * 255), 0, 255).astype(np.uint8)
    return {
        **told,
        "logs": LOG_SCALES,
        "splats": text,
        "sky": {
            "width": colors.shape[1],
            "height": colors.shape[0],
            "colors": base64.b64encode(colors.tobytes()).decode("ascii"),
            "axes": np.round(sky.axes, 6).tolist(),
        },
        "field": round(math.radians(float(field)), 4),
        "apart": STATION_M,
        "before": before,
        "shown": [round(part.length), round(way.length)],
        "stations": np.round(np.concatenate([eyes, views], axis=1), 3).tolist(),
        "tints": [
            [v / 255 for v in ORIGIN_COLORS[k]] + [1] if k in MARKED else [0, 0, 0, 0] for k in range(ORIGIN_COUNT)
        ],
        "kinds": [] if origins is None else [k for k in MARKED if (origins == k).any()],
    }


def _map(view: TopView, way: Way) -> MapPictures:
    overlay = None
    if view.origins is not None and view.origins.any():
        colors = np.zeros((256, 4), np.uint8)
        for kind in MARKED:
            colors[kind] = (*ORIGIN_COLORS[kind], MAP_OPACITY)
        overlay = png_uri(colors[view.origins])
    kinds = () if view.origins is None else tuple(k for k in MARKED if (view.origins == k).any())
    return MapPictures(view.map, view.map.to_pixels(way.eyes), jpeg_uri(view.picture, most=MAP_BYTES), overlay, kinds)
