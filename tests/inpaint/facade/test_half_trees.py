"""Trees of which a lorry hides all but a part of the crown."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from tests.inpaint.facade.test_continued import street
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import grow
from unveil_core.inpaint.facade import half_trees
from unveil_core.inpaint.facade.half_trees import complete_trees
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels, concatenate

GROUND, _ = street(np.inf)
FAR = 200.0
CROWN, HIGH = 1.5, 4.0
"""Radius of a crown and height of its middle, metres."""
LORRY_M = 3.2


def tree(x: float, y: float, size: float = 1.0, *, over_lorry: bool = False, seed: int = 0) -> Surfels:
    """A trunk and a ball of leaves, or what of it is seen over the lorry."""
    rng = np.random.default_rng(seed)
    leaves = rng.normal(size=(900, 3))
    leaves *= CROWN * rng.uniform(0.7, 1, (900, 1)) / np.linalg.norm(leaves, axis=1, keepdims=True)
    leaves[:, 2] += HIGH
    angle, h = rng.uniform(0, 2 * np.pi, 200), rng.uniform(0.05, HIGH - CROWN + 0.2, 200)
    places = size * np.concatenate([leaves, np.c_[0.12 * np.cos(angle), 0.12 * np.sin(angle), h]]) + (x, y, 0)
    if over_lorry:
        places = places[places[:, 2] > 1.5 + (LORRY_M - 1.5) * places[:, 1] / 3]
    grey, normal = np.full((len(places), 3), 60, np.uint8), np.tile([-1.0, 0, 0], (len(places), 1))
    return surfels_from_points(
        places, grey, np.zeros(len(places), np.int64), normal, np.full(len(places), 0.2), opacity=0.9
    )


def look(x: float, back: float = 0.0) -> Camera:
    """Along the street and a little to the left, from 1.5 m; from farther ``back`` through a longer lens."""
    turn = np.radians(15) * 17 / (17 + back)
    pose = np.eye(4)
    pose[:3, :3] = [[np.sin(turn), -np.cos(turn), 0], [0, 0, -1], [np.cos(turn), np.sin(turn), 0]]
    pose[:3, 3] = -pose[:3, :3] @ np.array([x - back, 0.0, 1.5])
    focal = 150.0 * (17 + back) / 17
    return Camera(240, 160, focal, focal, 120.0, 80.0, pose)


def shown(camera: Camera, surfels: Surfels) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) pixels of a tree, and its depth."""
    mask, depth = np.zeros((160, 240), dtype=bool), np.full((160, 240), FAR, np.float32)
    _, pixels, z = camera.shown(surfels.means.double().numpy(), nearest=0.5)
    for (x, y), d in zip(pixels.astype(int), z, strict=True):
        r = max(1, round(0.2 * camera.fx / d))
        part = np.s_[max(0, y - r) : y + r + 1, max(0, x - r) : x + r + 1]
        mask[part] = True
        depth[part] = np.minimum(depth[part], d)
    return mask, depth


class View(NamedTuple):
    camera: Camera
    depth: np.ndarray
    removed: np.ndarray
    on_plant: np.ndarray
    sky: np.ndarray


def completed(plants: Surfels, seen: list[View]) -> Surfels | None:
    cameras, depths, removed, on_plant, sky = zip(*seen, strict=True)
    return complete_trees(plants, GROUND, cameras, depths, removed, on_plant=on_plant, sky=sky)


def views(*trees: Surfels, lorry: bool = True, back: float = 0.0) -> list[View]:
    """Frames towards trees; a lorry hides what is lower than LORRY_M at y = 3, between x = 9 and 19."""
    found = []
    for x in np.arange(0.0, 7.0):
        camera = look(x, back)
        plant, depth = np.zeros((160, 240), dtype=bool), np.full((160, 240), FAR, np.float32)
        for one in trees:
            mask, own = shown(camera, one)
            plant, depth = plant | mask, np.minimum(depth, own)
        rays = camera.rays()
        with np.errstate(divide="ignore", invalid="ignore"):
            z = 3.0 / rays[..., 1]
        at = camera.centre + z[..., None] * rays
        along = at[..., 0] + 0.4 * back  # the lorry stands where it hides the same
        hidden = lorry & (z > 0) & (along > 9) & (along < 19) & (at[..., 2] < LORRY_M) & (at[..., 2] > 0)
        sky = ~plant & ~hidden & (rays[..., 2] > 0)
        depth = np.where(hidden, z, np.where(sky, 0, depth)).astype(np.float32)  # the sky is rendered as nothing
        found.append(View(camera, depth, hidden, plant & ~hidden, sky))
    return found


@pytest.mark.parametrize("size", [1.0, 1.15])
def test_a_half_seen_tree_is_completed_after_a_whole_one(size: float) -> None:
    whole, half = tree(20.0, -4.0), tree(17.0, 5.0, size, seed=1)
    top = tree(17.0, 5.0, size, over_lorry=True, seed=1)
    found = completed(concatenate([whole, top]), views(whole, half))
    assert found is not None
    means = found.means.double().numpy()
    middle = np.median(means[:, :2], axis=0)
    assert np.abs(middle - (17.0, 5.0)).max() < 1.0, "it stands where the tree does"
    assert means[:, 2].min() < 1.0 and means[:, 2].max() < size * (HIGH + CROWN) + 0.4
    # Nothing of it where a frame looks past the tree.
    for view in views(whole, half):
        inside, past = view.camera.fall_in(means, view.sky & ~grow(view.removed, 3))
        assert inside.any() and not past.any()


def test_a_piece_of_a_crown_far_lower_than_the_trees_of_the_street_is_no_tree() -> None:
    whole, half = tree(20.0, -4.0, 1.6), tree(17.0, 5.0, seed=1)
    top = tree(17.0, 5.0, over_lorry=True, seed=1)
    assert completed(concatenate([whole, top]), views(whole, half)) is None


def test_a_tree_that_no_frame_sees_from_nearby_is_not_completed(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, half = tree(20.0, -4.0), tree(17.0, 5.0, seed=1)
    plants = concatenate([whole, tree(17.0, 5.0, over_lorry=True, seed=1)])
    seen = views(whole, half, back=20.0)
    assert completed(plants, seen) is None
    monkeypatch.setattr(half_trees, "FARTHEST_M", 60.0)
    assert completed(plants, seen) is not None


def test_nothing_is_made_up_where_nothing_hides_or_no_tree_tells() -> None:
    whole, half = tree(20.0, -4.0), tree(17.0, 5.0, seed=1)
    top = tree(17.0, 5.0, over_lorry=True, seed=1)
    seen = views(whole, half)
    assert completed(top, seen) is None, "no whole tree to go by"
    assert completed(concatenate([whole, half]), seen) is None, "both are whole"
    assert completed(concatenate([whole, top]), views(whole, top, lorry=False)) is None, "a balloon"
