"""A long drive reconstructed block by block: memory and the time of a step do not grow with its length.

Each block is reconstructed from its own frames and those that look into it, with the same start of the sky. Of the result it keeps
the surfels of places that belong to it; what a block saw of its neighbours only served its own frames as their background.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.checkpoint import Kept
from unveil_core.base.frame_cache import FrameCache, Frames
from unveil_core.base.progress import Progress, no_progress, part_of
from unveil_core.base.types import Float64, Mask
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.drives.exposure import Exposures
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.reach import PointGrid
from unveil_core.ground.blocks import Block, Blocks
from unveil_core.optimize.reconstruct import Reconstruction, ReconstructSettings, reconstruct, sky_of_labels
from unveil_core.optimize.reoptimize import ReoptimizeSettings, reoptimize
from unveil_core.semantics.labels import SceneLabels
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["block_of_drive", "reconstruct_in_blocks", "reoptimize_in_blocks"]

CELL_M = 10.0
"""Side of the cells of the plan in which points are chosen for a block, metres."""
SLACK = 0.2
"""By how much the half width of a picture at depth 1 is widened when points are chosen."""


def reconstruct_in_blocks(
    drive: Drive,
    scene: SceneLabels,
    settings: ReconstructSettings,
    blocks: Blocks,
    *,
    exposures: Exposures,
    hidden: Sequence[NDArray[np.bool_]] | None = None,
    seed: int = 0,
    cache: FrameCache | None = None,
    kept: Kept | None = None,
    progress: Progress = no_progress,
) -> Reconstruction:
    """:func:`reconstruct` of each block, and the whole of them.

    Args:
        blocks: of the drive; with one, this is the same as :func:`reconstruct`.
        kept: finished blocks and checkpoints, by the blocks' names.
    """
    kept, cache = kept or Kept(), cache or FrameCache()
    common: dict[str, Any] = {"exposures": exposures, "seed": seed, "cache": cache}
    if len(blocks.blocks) == 1:
        return reconstruct(drive, scene, settings, hidden=hidden, kept=kept, progress=progress, **common)
    sky, sky_choice = sky_of_labels(drive, scene, settings, exposures, hidden, cache)
    parts, skies, choices = [], [], []
    for block in blocks.blocks:
        own = kept.within(block.name)

        def make(block: Block = block, own: Kept = own) -> dict[str, NDArray[Any]]:
            done = reconstruct(
                block_of_drive(drive, block),
                scene,
                settings,
                hidden=None if hidden is None else Frames(len(block.frames), lambda k: hidden[block.frames[k]]),
                sky=sky,
                own_frames=len(block.own),
                kept=own,
                progress=part_of(progress, block.number, len(blocks.blocks)),
                **common,
            )
            owned = blocks.of_places(done.surfels.means.double().numpy()) == block.number
            part = done.surfels.select(torch.from_numpy(owned))
            facts = np.frombuffer(json.dumps(done.choices).encode(), np.uint8)
            return {**part.arrays(), "sky": done.sky.texture.numpy(), "sky_axes": done.sky.axes, "choices": facts}

        found = own.once("block", make)
        parts.append(Surfels.from_arrays(found))
        skies.append(Sky(torch.from_numpy(found["sky"]), found["sky_axes"]))
        choices.append(json.loads(found["choices"].tobytes()))
    return Reconstruction(
        concatenate(parts), _together(skies, sky), {"sky": sky_choice, "blocks": choices, **_sums(choices)}
    )


def block_of_drive(drive: Drive, block: Block) -> Drive:
    """The frames of a block, and the points that they may see."""
    frames = tuple(drive.frames[i] for i in block.frames)
    positions = drive.points.positions
    if not len(positions):
        return replace(drive, frames=frames)
    seen = np.zeros(len(positions), dtype=bool)
    seen[_in_some_view(PointGrid(positions, CELL_M), [f.camera for f in frames])] = True
    return replace(drive, frames=frames, points=drive.points.select(seen))


def _in_some_view(grid: PointGrid, cameras: Sequence[Camera]) -> NDArray[np.int64]:
    """Indices of the points that some camera may see, and of some others."""
    middles = grid.middles
    seen = np.zeros(len(middles), dtype=bool)
    for camera in cameras:
        seen |= _in_view(camera, middles)
    return grid.of_cells(seen)


def _in_view(camera: Camera, middles: Float64) -> Mask:
    """(C,) which cells of the plan, by their middles (C, 2), a camera may see something in."""
    away = middles - camera.centre[:2]
    distance = np.linalg.norm(away, axis=1)
    # The widest of the picture's borders, as seen from above, where the camera may be pitched and rolled a little.
    aside = max(camera.cx, camera.width - camera.cx) / camera.fx
    ahead = camera.forward[:2] / max(float(np.linalg.norm(camera.forward[:2])), 1e-9)
    along = away @ ahead
    reach = along + CELL_M > np.abs(away @ np.array([-ahead[1], ahead[0]])) / (aside + SLACK) - CELL_M
    return np.asarray((distance < CELL_M) | ((distance < FAR_M + CELL_M) & (along > -CELL_M) & reach))


def _together(skies: Sequence[Sky], start: Sky | None) -> Sky:
    """One sky of all blocks: each direction as the mean of the blocks that changed it, or of all."""
    textures = torch.stack([s.texture for s in skies]).double()
    weight = torch.ones_like(textures[:, :1])
    if start is not None:
        weight = (textures != start.texture.double()).any(dim=1, keepdim=True).double()
    mean = (weight * textures).sum(dim=0) / weight.sum(dim=0).clamp_min(1e-9)
    if start is not None:
        mean = torch.where(weight.sum(dim=0) > 0, mean, start.texture.double())
    return Sky(mean.float(), skies[0].axes)


def _sums(choices: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The numbers of all blocks together."""
    return {
        name: {key: sum(c[name][key] for c in choices) for key in ("chosen", "most")}
        for name in ("iterations", "budget")
        if all(name in c for c in choices)
    }


def reoptimize_in_blocks(
    surfels: Surfels,
    movable: Mask,
    sky: Sky,
    targets: Sequence[tuple[Camera, NDArray[np.uint8]]],
    settings: ReoptimizeSettings,
    blocks: Blocks,
    *,
    label_count: int,
    seed: int = 0,
    cache: FrameCache | None = None,
    kept: Kept | None = None,
    progress: Progress = no_progress,
) -> Surfels:
    """:func:`reoptimize` of what each block owns; what its neighbours own is as it was.

    Args:
        targets: of all frames.
        blocks: of the drive; with one, this is the same as :func:`reoptimize`.
        kept: finished blocks and checkpoints, by the blocks' names.
    """
    kept, cache = kept or Kept(), cache or FrameCache()
    places = surfels.means.detach().double().numpy()
    owner, grid = blocks.of_places(places), PointGrid(places, CELL_M)
    changed = {name: array.copy() for name, array in surfels.arrays().items()}
    for block in blocks.blocks:
        own = kept.within(block.name)
        mine = np.flatnonzero(movable & (owner == block.number))
        if not len(mine) or not block.frames:
            continue

        def make(block: Block = block, own: Kept = own, mine: NDArray[np.int64] = mine) -> dict[str, NDArray[Any]]:
            near = np.zeros(len(places), dtype=bool)
            near[_in_some_view(grid, [targets[i][0] for i in block.frames])] = True
            near[mine] = True
            moves = np.zeros(len(places), dtype=bool)
            moves[mine] = True
            done = reoptimize(
                surfels.select(torch.from_numpy(near)),
                moves[near],
                sky,
                Frames(len(block.frames), lambda k: targets[block.frames[k]]),
                settings.scaled(len(block.own)),
                near=NEAR_M,
                far=FAR_M,
                label_count=label_count,
                seed=seed,
                cache=cache,
                checkpoint=own.checkpoint("training"),
                progress=part_of(progress, block.number, len(blocks.blocks)),
            )
            return done.select(torch.from_numpy(moves[near])).arrays()

        for name, array in own.once("block", make).items():
            changed[name][mine] = array
    return Surfels.from_arrays(changed)
