"""The empty scene from new viewpoints, against true pictures from there.

A scene that was optimized for its own cameras may look right from them alone. Where a truth folder has ``free/`` (cameras in
``transforms.json``, ``images/`` of the empty street, and, optional, ``removed/`` and ``unseen/`` masks), ``surfels/empty.ply``
is rendered from those cameras and measured as the recorded frames' renders are.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.parallel import each
from unveil_core.base.pictures.decoding import read_image, read_label_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64, Mask
from unveil_core.drives.camera_path import View, read_camera_path
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.evaluate.metrics import SSIM_WINDOW, psnr_of_mse, squared_error, ssim_map
from unveil_core.raster.picture import picture_of
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.sky import load_sky

__all__ = ["FREE_REGIONS", "measure_free_views"]


FREE_REGIONS = {
    "free_removed": "removed",
    "free_unseen": "unseen",
    "free_seen_elsewhere": "seen_elsewhere",
    "free_whole": "whole",
}
"""Regions of the free views, and what the same region of the recorded frames is called."""


def measure_free_views(
    root: Path, drive: Drive, truth: Path | None, recorded: dict[str, Any], progress: Progress = no_progress
) -> dict[str, Any] | None:
    """Measure ``surfels/empty.ply`` from free viewpoints; nothing is written.

    The scene is rendered in its canonical colours: true pictures of a drive whose exposure changed have to be in these.

    Args:
        root: the workspace; drive: its imported drive.
        truth: the truth folder, or None.
        recorded: of each region of the recorded frames the ``methods``, as ``run_evaluation`` pools them; of these
            ``render`` is compared.
        progress: called once per view.
    Returns:
        None without ``free/transforms.json`` or without an empty scene, else a dict: ``views``; ``regions`` and, per track of
        cameras, ``tracks``, both of ``psnr`` (of the pooled error), ``ssim``, ``pixels`` and ``views`` for each of
        :data:`FREE_REGIONS`; ``below_recorded``, decibels that a region's PSNR lies below that of the recorded frames'
        renders; ``per_view`` PSNR.
    Raises:
        WorkspaceError: a view has no true picture, or one of another size.
        DriveError: cameras or pictures that cannot be read.
    """
    folder = None if truth is None else truth / "free"
    scene = root / "surfels/empty.ply"
    if folder is None or not (folder / "transforms.json").is_file() or not scene.is_file():
        return None
    views = read_camera_path(folder / "transforms.json", drive)
    surfels, sky = read_surfels(scene), load_sky(root / "surfels/sky.npz")
    sums: dict[str, dict[str, list[tuple[float, float, int]]]] = defaultdict(lambda: defaultdict(list))
    per_view = []

    def compare(view: View) -> tuple[Float64, Float64]:
        street = _true_picture(folder, view)
        picture = picture_of(surfels, sky, view.camera, near=NEAR_M, far=FAR_M)
        error = squared_error(picture, street)
        big = min(error.shape) >= SSIM_WINDOW
        return error, ssim_map(picture, street) if big else np.full(error.shape, np.nan)

    for done, (view, (error, similar)) in enumerate(zip(views, each(compare, views), strict=True)):
        entry: dict[str, Any] = {"view": view.name, "track": view.track, "psnr": {}}
        for region, mask in _regions(folder, view).items():
            if mask.any():
                score = (float(error[mask].sum()), float(similar[mask].sum()), int(np.count_nonzero(mask)))
                sums[view.track][region].append(score)
                entry["psnr"][region] = psnr_of_mse(score[0] / score[2])
        per_view.append(entry)
        progress(done + 1, len(views), "measuring free views")
    regions = _pooled(sums.values())
    below = {}
    for region, values in regions.items():
        beside = recorded.get(FREE_REGIONS[region], {}).get("methods", {}).get("render", {}).get("psnr")
        if beside is not None and math.isfinite(beside):
            below[region] = beside - values["psnr"]
    tracks = {name: _pooled([of_track]) for name, of_track in sums.items()}
    return {"views": len(views), "regions": regions, "below_recorded": below, "tracks": tracks, "per_view": per_view}


def _pooled(groups: Iterable[dict[str, list[tuple[float, float, int]]]]) -> dict[str, dict[str, float | int]]:
    groups = list(groups)
    found: dict[str, dict[str, float | int]] = {}
    for region in FREE_REGIONS:
        scores = [s for group in groups for s in group.get(region, [])]
        if scores:
            squared, similar, pixels = (sum(column) for column in zip(*scores, strict=True))
            found[region] = {
                "psnr": psnr_of_mse(squared / pixels),
                "ssim": similar / pixels,
                "pixels": int(pixels),
                "views": len(scores),
            }
    return found


def _true_picture(folder: Path, view: View) -> NDArray[np.uint8]:
    for suffix in (".png", ".jpg", ".jpeg"):
        path = folder / "images" / f"{view.name}{suffix}"
        if path.is_file():
            picture = read_image(path)
            if picture.shape[:2] != (view.camera.height, view.camera.width):
                raise WorkspaceError(
                    f"Not the size of its camera: {picture.shape[1]}x{picture.shape[0]} pixels, "
                    f"the camera says {view.camera.width}x{view.camera.height}",
                    path=path,
                    mend="give w and h of transforms.json as the pictures have them",
                )
            return picture
    raise WorkspaceError(
        "has no true picture", path=folder / "images" / view.name, mend="add it or drop the view from transforms.json"
    )


def _regions(folder: Path, view: View) -> dict[str, Mask]:
    """The regions of a view, in the order of :data:`FREE_REGIONS` but the whole first."""
    shape = (view.camera.height, view.camera.width)
    masks = {}
    for name in ("removed", "unseen"):
        path = folder / name / f"{view.name}.png"
        if path.is_file():
            masks[name] = read_label_image(path) > 127
            if masks[name].shape != shape:
                raise WorkspaceError("Not the size of its picture", path=path, mend="make it as large")
    regions = {"free_whole": np.ones(shape, dtype=bool)}
    if "removed" in masks:
        regions["free_removed"] = masks["removed"]
        if "unseen" in masks:
            regions["free_unseen"] = masks["removed"] & masks["unseen"]
            regions["free_seen_elsewhere"] = masks["removed"] & ~masks["unseen"]
    return regions
