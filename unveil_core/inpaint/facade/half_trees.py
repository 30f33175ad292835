"""Completes trees of which something removed hides all but a part of the crown, after a whole tree of the same street.

Over a lorry the top of a crown is seen, and what is under it in no frame: it would float. What the frames do show of it, its
outline against the sky and the houses, tells where it stands and how large it is; a whole tree of the street, stood there in this
size, is what it is taken to look like.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from scipy.spatial import cKDTree

from unveil_core.base.types import Float32, Float64, Labels, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.clusters import connected_points
from unveil_core.geometry.images import border_px, grow, scale_from_384
from unveil_core.ground.street import Ground
from unveil_core.inpaint.facade.poles import hidden_and_through, only_hidden
from unveil_core.inpaint.light.crowns import CROWN_M, FOOT_M, trunk_places, turned_half
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["complete_trees"]

LINK_M, LEAST = 0.7, 25
"""Largest gap within a crown, metres, and its fewest surfels."""
WHOLE = 200
"""Fewest surfels of a whole tree after which others are completed: it was seen from close by."""
MODELS = 2
"""Whole trees that are tried, those with most surfels."""
TRUNK_M = 0.6
"""Distance from its middle within which low surfels are a trunk's, metres."""
SEEN_PX, VIEWS = 24, 6
"""Pixels at 384 in width that a crown covers in a frame to be fitted there; and how many frames, those that show most of it."""
FARTHEST_M = 25.0
"""Farther off a frame tells nothing of where a crown stands, metres: its depth is off by more than trees are apart. Two drawn
streets lost 2.9 and 1.1 dB by trees at 31 to 55 m, stood too low before a bright sky; one gains 2.0 by a tree at 11 to 17 m."""
CUT_PX, CUT = 3, 0.5
"""A crown's lower rim is cut where something removed begins within so many pixels under it; a crown that is cut along this share of
its rim in most frames goes on behind it."""
AROUND_M, STEP_M = 3.0, 0.75
"""Distance from the seen part within which the tree may stand, and the steps in which it is looked for, metres."""
NEAR_M, FINE_M = 1.2, 0.3
"""The same around the best of these places."""
TRUNK = 0.3
"""What a trunk costs through which frames look, of what the crown's outline scores: it is slim, and few pixels tell of it."""
SMALLEST = 0.8
"""Height of the seen part's top, as a share of a whole tree's, from which on it is a tree's top. What is lower is a piece of a
crown: with such completed, two streets lost 0.1 dB and one 2.0, where a tree was stood before the sky; one gained 2.9 by higher
ones."""
SIZES = (0.8, 0.9, 1.0, 1.12, 1.25)
"""The sizes that are tried: what makes the model as high as the seen part, times these."""
FIT_PX = 256
"""Width of the pictures in which it is looked for, pixels: a crown is some tens of them wide."""
POINTS, TUFT_M = 500, 0.25
"""Points that stand for a model while its place is looked for, and half the width of each, metres."""
AGREES = 0.5
"""Share of what the frames show of a crown, and of what the model would cover wrongly, that it must cover."""
ASTRAY = 0.05
"""What of that a metre costs that the tree stands from the middle of its seen part: outlines from a few places in a row hardly tell
distance, and the scene's depth does."""
BEHIND = 1.1
"""Ratio of the scene's depth to the tree's from which on a frame looks past the tree."""


_Planes = tuple[Sequence[Camera], Sequence[Float32], Sequence[Mask]]
"""Of each frame its camera, its depth (H, W), and what is removed (H, W)."""
_Found = tuple[float, int, Float64, float]
"""How well a tree agrees with what is seen, which model it is, where it stands (2,), and how large it is."""


@dataclass(frozen=True, eq=False)
class _PlantView:
    """What a frame shows of plants.

    Attributes:
        camera: of the frame.
        depth: (H, W) of the full scene, metres; removed: (H, W) bool, pixels of what is removed.
        on_plant: (H, W) bool, pixels of plants; sky: (H, W) bool, of the sky.
    """

    camera: Camera
    depth: Float32
    removed: Mask
    on_plant: Mask
    sky: Mask


@dataclass(frozen=True, eq=False)
class _Model:
    """A whole tree: its surfels; where each lies from its foot, (N, 3) along the ground's axes, the last over the ground; its
    height, metres."""

    surfels: Surfels
    places: Float64
    height: float


@dataclass(frozen=True, eq=False)
class _Outline:
    """A view, coarser than its frame where that is large, with the part of a crown that it shows, ``crown`` (H, W), and the pixels
    that look past it, ``past`` (H, W)."""

    camera: Camera
    crown: Mask
    past: Mask


def complete_trees(
    plants: Surfels,
    ground: Ground,
    cameras: Sequence[Camera],
    depths: Sequence[Float32],
    removed: Sequence[Mask],
    *,
    on_plant: Sequence[Mask],
    sky: Sequence[Mask],
) -> Surfels | None:
    """Surfels for the hidden parts of trees of which a part of the crown was seen; None where there are no such, or no whole tree.

    Args:
        plants: surfels of vegetation that stay; ground: what they stand on.
        cameras, depths, removed: the views, depth (H, W) of the full scene and what is removed (H, W) bool.
        on_plant, sky: (H, W) bool per view, pixels of plants and of the sky.
    """
    path = ground.path
    means = plants.means.detach().double().numpy()
    height = ground.over(path.to_street(means))
    local = means @ path.axes.T
    crown = np.flatnonzero((height > FOOT_M[1]) & (plants.opacity_logits.detach().numpy() > 0))
    low = np.flatnonzero((height > FOOT_M[0]) & (height <= FOOT_M[1]))
    trunks = trunk_places(local[low, :2], local[crown, :2])
    if not len(trunks):
        return None
    away, nearest = cKDTree(trunks).query(local[:, :2])
    lone = crown[away[crown] > CROWN_M]
    trees = [_model(plants, ground, local, height, k, trunks[k], (away, nearest)) for k in range(len(trunks))]
    models = sorted((m for m in trees if m is not None), key=lambda m: -len(m.surfels))[:MODELS]
    if not models or not len(lone):
        return None
    group = connected_points(local[lone], LINK_M)
    size = np.exp(plants.log_scales.detach().double().numpy()).max(axis=1)
    crowns = [c for c in (lone[group == g] for g in np.unique(group)) if len(c) >= LEAST]
    planes = (cameras, depths, removed)
    views = (_PlantView(*view) for view in zip(*planes, on_plant, sky, strict=True))
    seen = _outlines([(means[c], size[c]) for c in crowns], views)
    parts = []
    for members, outlines in zip(crowns, seen, strict=True):
        if outlines:
            top = float(np.percentile(height[members], 98))
            alike = [m for m in models if top >= SMALLEST * m.height]
            tree = _fitted(alike, ground, local[members], top, outlines, planes) if alike else None
            parts += [] if tree is None else [tree]
    if not parts:
        return None
    found = concatenate(parts)
    found = found.select(torch.from_numpy(only_hidden(found, *planes)))
    return found if len(found) else None


def _model(
    plants: Surfels,
    ground: Ground,
    local: Float64,
    height: Float64,
    number: int,
    place: Float64,
    trunks: tuple[Float64, Labels],
) -> _Model | None:
    """The tree of one trunk; None where too little of it was seen.

    Args:
        local: (N, 3) of the plants along the ground's axes; height: (N,) over the ground.
        number, place: the trunk's, (2,) in plan; trunks: how far and which the nearest trunk of each surfel is, (N,) each.
    """
    away, nearest = trunks
    own = nearest == number
    crown = own & (height > FOOT_M[1]) & (away < CROWN_M)
    if crown.sum() < WHOLE:
        return None
    trunk = own & (height > 0) & (height <= FOOT_M[1]) & (away < TRUNK_M)
    far_side = turned_half(plants, crown, np.tile(place, (int(crown.sum()), 1)), ground)
    surfels = concatenate([plants.select(torch.from_numpy(crown | trunk)), far_side])
    means = surfels.means.double().numpy()
    street = ground.path.to_street(means)
    places = np.column_stack([(means @ ground.path.axes.T)[:, :2] - place, ground.over(street)])
    return _Model(surfels, places, float(np.percentile(places[:, 2], 98)))


def _outlines(crowns: Sequence[tuple[Float64, Float64]], views: Iterable[_PlantView]) -> list[list[_Outline]]:
    """Of each crown's seen part the frames that show most of it; none where it is not cut.

    Args:
        crowns: of each the places (N, 3) and sizes (N,) of its surfels.
    """
    found: list[list[_Outline]] = [[] for _ in crowns]
    cut: list[list[bool]] = [[] for _ in crowns]
    for view in views:
        for k, (means, size) in enumerate(crowns):
            outline = _outline(means, size, view)
            if outline is not None:
                cut[k].append(_is_cut(outline.crown, view.removed))
                # Only so many are held, however long the drive is.
                found[k] = sorted([*found[k], _coarse(outline)], key=lambda o: -int(o.crown.sum()))[:VIEWS]
    return [own if told and np.mean(told) >= 0.5 else [] for own, told in zip(found, cut, strict=True)]


def _outline(means: Float64, size: Float64, view: _PlantView) -> _Outline | None:
    """What a view shows of a crown's part (N, 3), of surfels of ``size`` (N,); None where that is too little."""
    index, pixels, z = view.camera.shown(means, nearest=0.5, furthest=FARTHEST_M)
    if len(index) < LEAST / 2:
        return None
    column, row = pixels.astype(np.int64).T
    shown = np.abs(view.depth[row, column] - z) < 0.5 + 0.1 * z
    crown = np.zeros(view.on_plant.shape, np.uint8)
    reach = np.clip(1.2 * size[index] * view.camera.fx / z, 1, view.camera.width / 48)
    for x, y, r in zip(column[shown], row[shown], reach[shown], strict=True):
        cv2.circle(crown, (int(x), int(y)), round(float(r)), 1, -1)
    seen = (crown > 0) & view.on_plant & ~view.removed
    if seen.sum() < SEEN_PX * scale_from_384(view.camera.width) ** 2:
        return None
    past = view.sky | (view.depth > BEHIND * np.median(z[shown]) + 0.5)
    past &= ~view.on_plant & ~grow(view.removed, border_px(view.camera.width, 1))
    return _Outline(view.camera, seen, past)


def _is_cut(crown: Mask, removed: Mask) -> bool:
    """Whether something removed (H, W) begins under a crown (H, W)."""
    columns, height = np.flatnonzero(crown.any(axis=0)), len(crown)
    lowest = height - 1 - crown[::-1, columns].argmax(axis=0)
    below = [np.minimum(lowest + k, height - 1) for k in range(1, round(CUT_PX * scale_from_384(crown.shape[1])) + 1)]
    return bool(np.any([removed[b, columns] for b in below], axis=0).mean() >= CUT)


def _coarse(outline: _Outline) -> _Outline:
    """The outline in a picture about :data:`FIT_PX` wide."""
    step = max(1, outline.camera.width // FIT_PX)
    small = outline.camera.resized(outline.camera.width // step, outline.camera.height // step)
    crown, past = (m[::step, ::step][: small.height, : small.width] for m in (outline.crown, outline.past))
    return _Outline(small, crown, past)


def _fitted(
    models: Sequence[_Model],
    ground: Ground,
    seen: Float64,
    top: float,
    outlines: Sequence[_Outline],
    planes: _Planes,
) -> Surfels | None:
    """A model where, and as large as, its outline agrees best with what the frames show; None where none agrees.

    Args:
        seen: (N, 3) the seen part along the ground's axes; top: its height over the ground, metres.
        outlines: of the seen part; planes: of all frames, none of which may look through the trunk.
    """
    middle = np.median(seen[:, :2], axis=0)
    some = [_few(model) for model in models]

    def agreement(k: int, place: Float64, size: float) -> _Found:
        away = float(np.linalg.norm(place - middle))
        return _agreement(some[k], ground, place, size, outlines) - ASTRAY * away, k, place, size

    steps = np.arange(-AROUND_M, AROUND_M + 1e-9, STEP_M)
    coarse = [
        agreement(k, middle + (dx, dy), factor * top / model.height)
        for k, model in enumerate(models)
        for factor in SIZES
        for dx in steps
        for dy in steps
    ]
    _, k, place, size = max(coarse, key=_score)
    steps = np.arange(-NEAR_M, NEAR_M + 1e-9, FINE_M)
    fine = [agreement(k, place + (dx, dy), size) for dx in steps for dy in steps]
    through = _trunk_through(models[k], ground, [f[2] for f in fine], size, planes)
    score, place = max(
        ((f[0] - TRUNK * share, f[2]) for f, share in zip(fine, through, strict=True)), key=lambda f: f[0]
    )
    return _stood(models[k], ground, place, size) if score >= AGREES else None


def _trunk_through(model: _Model, ground: Ground, places: Sequence[Float64], size: float, planes: _Planes) -> Float64:
    """(C,) share of its trunk through which frames look, if the model stood at each of C ``places`` (2,) in plan."""
    trunk = model.places[model.places[:, 2] < FOOT_M[1]][:POINTS]
    if not len(trunk):
        return np.zeros(len(places))
    feet = np.stack([_foot(ground, place) for place in places])
    world = (feet[:, None] + size * trunk).reshape(-1, 3) @ ground.path.axes
    share: Float64 = hidden_and_through(world, *planes)[1].reshape(len(places), -1).mean(axis=1)
    return share


def _score(found: _Found) -> float:
    return found[0]


def _few(model: _Model) -> Float64:
    """(P, 3) places that stand for a model."""
    step = max(1, len(model.places) // POINTS)
    return model.places[::step]


def _foot(ground: Ground, place: Float64) -> Float64:
    """(3,) where on the ground a tree stands, along the ground's axes, its plan ``place`` (2,) given."""
    axes = ground.path.axes
    street = ground.path.to_street((np.append(place, 0.0) @ axes)[None])
    return np.append(place, float(ground.height_at(street[:, 0], street[:, 1])[0]))


def _agreement(points: Float64, ground: Ground, place: Float64, size: float, outlines: Sequence[_Outline]) -> float:
    """Pixels of the crown that a tree would cover, as a share of all of them and those past it that it would cover."""
    world = (_foot(ground, place) + size * points) @ ground.path.axes
    hit = asked = 0
    for outline in outlines:
        pixels, z = outline.camera.project(world)
        inside = outline.camera.in_picture(pixels, z, nearest=0.5)
        asked += int(outline.crown.sum())
        if not inside.any():
            continue
        column, row = pixels[inside].astype(np.int64).T
        covered = np.zeros(outline.crown.shape, np.uint8)
        covered[row, column] = 1
        reach = max(1, round(size * TUFT_M * outline.camera.fx / float(np.median(z[inside]))))
        covered = cv2.dilate(covered, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
        hit += int((outline.crown & (covered > 0)).sum())
        asked += int((outline.past & (covered > 0)).sum())
    return hit / max(asked, 1)


def _stood(model: _Model, ground: Ground, place: Float64, size: float) -> Surfels:
    """The model's surfels, stood at a place in a size."""
    axes = ground.path.axes
    world = (_foot(ground, place) + size * model.places) @ axes
    surfels = model.surfels
    return replace(
        surfels,
        means=torch.from_numpy(world).to(surfels.means),
        log_scales=surfels.log_scales + float(np.log(size)),
    )
