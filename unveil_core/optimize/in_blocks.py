"""A long drive reconstructed block by block: memory and the time of a step do not grow with its length.

Each block is reconstructed from its own frames and those that look into it, with the same start of the sky. Of the result it keeps
the surfels of places that belong to it; what a block saw of its neighbours only served its own frames as their background.

A block gets no more than it needs, and is kept under the digest of all that it gets: a change elsewhere does not make it again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.frame_cache import FrameCache, subset
from unveil_core.base.progress import Progress, no_progress, part_of
from unveil_core.base.resume.checkpoint import Kept, facts_array, facts_of
from unveil_core.base.resume.digest import digest_of
from unveil_core.base.resume.parts import Parts
from unveil_core.base.types import Float64, Labels, Levels, Mask
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.drives.exposure import Exposures
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.grid import PointGrid
from unveil_core.geometry.reach import centres_of
from unveil_core.ground.blocks import Block, Blocks
from unveil_core.optimize.presets import ReconstructSettings
from unveil_core.optimize.reconstruct import Reconstruction, reconstruct, sky_of_labels
from unveil_core.optimize.reoptimize import ReoptimizeSettings, reoptimize
from unveil_core.optimize.target_colours import coloured_by
from unveil_core.semantics.labels import SceneLabels
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["BlockwiseReconstruction", "BlockwiseReoptimization", "block_of_drive", "grid_of"]

CELL_M = 10.0
"""Side of the cells of the plan in which points are chosen for a block, metres."""
SLACK = 0.2
"""By how much the half width of a picture at depth 1 is widened when points are chosen."""


@dataclass(frozen=True, eq=False)
class BlockwiseReconstruction:
    """The reconstruction of a drive, block by block.

    Attributes:
        drive: imported; scene: its labels.
        settings: see :class:`ReconstructSettings`; their amounts of work are those of a drive as long as a block.
        blocks: of the drive; with one, all is as :func:`reconstruct` does it.
        exposures: of the photographs; hidden: (H, W) per frame, pixels that count for nothing; None = no such pixels.
        seed: order of the views.
        cache: room for the frames.
        kept: what is the same for all blocks, and the checkpoints of a drive that is one block.
        parts: finished blocks and their checkpoints; code: digest of the code that makes them.
    """

    drive: Drive
    scene: SceneLabels
    settings: ReconstructSettings
    blocks: Blocks
    exposures: Exposures
    hidden: Sequence[NDArray[np.bool_]] | None = None
    seed: int = 0
    cache: FrameCache = field(default_factory=FrameCache)
    kept: Kept = field(default_factory=Kept)
    parts: Parts = field(default_factory=Parts)
    code: str = ""
    progress: Progress = no_progress

    def whole(self) -> Reconstruction:
        """All blocks together."""
        if len(self.blocks.blocks) == 1:
            return reconstruct(
                self.drive,
                self.scene,
                self.settings,
                exposures=self.exposures,
                hidden=self.hidden,
                seed=self.seed,
                cache=self.cache,
                kept=self.kept,
                progress=self.progress,
            )
        found = [self.block(block) for block in self.blocks.blocks]
        choices = [facts_of(f["choices"]) for f in found]
        start, sky_choice = self._sky
        skies = [Sky(torch.from_numpy(f["sky"]), f["sky_axes"]) for f in found]
        surfels = concatenate([Surfels.from_arrays(f) for f in found])
        return Reconstruction(
            surfels, _together(skies, start), {"sky": sky_choice, "blocks": choices, **_sums(choices)}
        )

    def block(self, block: Block) -> dict[str, NDArray[Any]]:
        """The surfels that a block owns, its sky and choices: made, unless they are kept already."""
        drive = block_of_drive(self.drive, block, self._grid)
        # What was chosen, and how often a label occurs elsewhere, is nothing to a block.
        scene = replace(self.scene, removed=(), instances=(), pixel_counts=())
        own_exposures = Exposures({(f.camera_name, f.name): self.exposures.of(f) for f in drive.frames})
        hidden = None if self.hidden is None else subset(self.hidden, block.frames)
        sky, count = self._sky[0], len(block.own)
        given = (drive, scene, self.settings, own_exposures, hidden, sky, count, self.seed)
        place = (block.number, self.blocks.nodes, self.blocks.of_node)

        def make(kept: Kept) -> dict[str, NDArray[Any]]:
            done = reconstruct(
                drive,
                scene,
                self.settings,
                exposures=own_exposures,
                hidden=hidden,
                sky=sky,
                own_frames=count,
                seed=self.seed,
                cache=self.cache,
                kept=kept,
                progress=part_of(self.progress, block.number, len(self.blocks.blocks)),
            )
            owned = self.blocks.of_places(done.surfels.means.double().numpy()) == block.number
            part = done.surfels.select(torch.from_numpy(owned))
            found = {"sky": done.sky.texture.numpy(), "sky_axes": done.sky.axes}
            return {**part.arrays(), **found, "choices": facts_array(done.choices)}

        return self.parts.once(block.name, digest_of(self.code, given, place), make)

    @cached_property
    def _grid(self) -> PointGrid:
        """Of the drive's points: made once, not by each block."""
        return grid_of(self.drive)

    @cached_property
    def _sky(self) -> tuple[Sky | None, dict[str, Any]]:
        """The start of the sky, the same for all blocks: made once, by the block that is made first."""

        def make() -> dict[str, NDArray[Any]]:
            sky, choice = sky_of_labels(self.drive, self.scene, self.settings, self.exposures, self.hidden, self.cache)
            arrays = {} if sky is None else {"texture": sky.texture.numpy(), "axes": sky.axes}
            return {**arrays, "choice": facts_array(choice)}

        found = self.kept.once("sky", make)
        sky = Sky(torch.from_numpy(found["texture"]), found["axes"]) if "texture" in found else None
        return sky, facts_of(found["choice"])


def grid_of(drive: Drive) -> PointGrid:
    """The points of a drive in the cells that :func:`block_of_drive` chooses from."""
    return PointGrid(drive.points.positions, CELL_M)


def block_of_drive(drive: Drive, block: Block, grid: PointGrid | None = None) -> Drive:
    """The frames of a block, and the points that they may see: no more than a block is made of.

    Args:
        grid: of the drive, see :func:`grid_of`; None = made for this block.
    """
    frames = tuple(
        replace(drive.frames[i], boxes=(), instance_path=None, ego_path=None, footage=None) for i in block.frames
    )
    drive = replace(drive, frames=frames, sources=(), sweeps=(), notices=(), truth_root=None, key_frames=None)
    if not len(drive.points.positions):
        return drive
    seen = _in_some_view(grid or grid_of(drive), [f.camera for f in frames])
    return replace(drive, points=drive.points.select(seen))


def _in_some_view(grid: PointGrid, cameras: Sequence[Camera]) -> NDArray[np.int64]:
    """Indices, rising, of the points that some camera may see, and of some others."""
    middles = grid.middles
    seen = np.zeros(len(middles), dtype=bool)
    # The cells of a long drive that no camera of the block comes near are not asked for each of them.
    places = centres_of(cameras)[:, :2]
    beyond = np.maximum(places.min(axis=0) - middles, middles - places.max(axis=0)).max(axis=1)
    near = np.flatnonzero(beyond < FAR_M + CELL_M)
    for camera in cameras:
        seen[near] |= _in_view(camera, middles[near])
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
    """One sky of all blocks: each direction as the mean of the blocks that changed it, or of all.

    Without a common start each block chose the size of its panorama: they are brought to the finest.
    """
    rows = max(s.texture.shape[1] for s in skies)
    textures = torch.stack([s.with_rows(rows).texture for s in skies]).double()
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


@dataclass(frozen=True, eq=False)
class BlockwiseReoptimization:
    """The re-optimization of a drive, block by block: each moves what it owns among what its neighbours own, as that was.

    Attributes:
        surfels: the empty scene, N surfels; movable: (N,) those that may change; relit: (N,) those of them that lost a shadow and
            still have its colours; sky: fixed.
        targets: camera and cleaned frame (H, W, 3) of all frames.
        settings: see :class:`ReoptimizeSettings`.
        blocks: of the drive.
        label_count: K; seed: order of the views.
        cache: room for the frames.
        parts: finished blocks and their checkpoints; code: digest of the code that makes them.
    """

    surfels: Surfels
    movable: Mask
    relit: Mask
    sky: Sky
    targets: Sequence[tuple[Camera, Levels]]
    settings: ReoptimizeSettings
    blocks: Blocks
    label_count: int
    seed: int = 0
    cache: FrameCache = field(default_factory=FrameCache)
    parts: Parts = field(default_factory=Parts)
    code: str = ""
    progress: Progress = no_progress

    def whole(self) -> Surfels:
        """The scene with all that moved."""
        changed = {name: array.copy() for name, array in self.surfels.arrays().items()}
        for block in self.blocks.blocks:
            mine = self._mine(block)
            for name, array in self.block(block).items():
                changed[name][mine] = array
        return Surfels.from_arrays(changed)

    def block(self, block: Block) -> dict[str, NDArray[Any]]:
        """The movable surfels of a block: made, unless they are kept already."""
        mine = self._mine(block)
        if not len(mine) or not block.frames:
            return {}
        near, moves = np.zeros((2, len(self.surfels)), dtype=bool)
        if len(self.blocks.blocks) == 1:
            near[:] = True
        else:
            near[_in_some_view(self._grid, [self.targets[i][0] for i in block.frames])] = True
        near[mine] = moves[mine] = True
        surfels, moves, relit = self.surfels.select(torch.from_numpy(near)), moves[near], (moves & self.relit)[near]
        targets, settings = subset(self.targets, block.frames), self.settings.scaled(len(block.own))
        given = (surfels.arrays(), moves, relit, self.sky, targets, settings, self.label_count, self.seed)

        def make(kept: Kept) -> dict[str, NDArray[Any]]:
            done = reoptimize(
                coloured_by(surfels, relit, targets, near=NEAR_M),
                moves,
                self.sky,
                targets,
                settings,
                near=NEAR_M,
                far=FAR_M,
                label_count=self.label_count,
                seed=self.seed,
                cache=self.cache,
                checkpoint=kept.checkpoint("training"),
                progress=part_of(self.progress, block.number, len(self.blocks.blocks)),
            )
            return done.select(torch.from_numpy(moves)).arrays()

        return self.parts.once(block.name, digest_of(self.code, given), make)

    @cached_property
    def _places(self) -> Float64:
        return self.surfels.means.detach().double().numpy()

    @cached_property
    def _grid(self) -> PointGrid:
        return PointGrid(self._places, CELL_M)

    @cached_property
    def _owner(self) -> Labels:
        return self.blocks.of_places(self._places)

    def _mine(self, block: Block) -> NDArray[np.int64]:
        """Indices of the movable surfels that a block owns."""
        return np.flatnonzero(self.movable & (self._owner == block.number))
