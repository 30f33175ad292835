"""Stretches of a street: together they own all of it, and they part where least is removed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.ground.test_blocks import straight
from tests.remove.test_regions import scene, surfels_at
from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.drives.depth_range import ASKED_M
from unveil_core.geometry.fields.picture_field import PictureField
from unveil_core.geometry.reach import centres_of
from unveil_core.ground.blocks import cut_into_blocks
from unveil_core.ground.path import fit_path
from unveil_core.ground.street import Ground
from unveil_core.inpaint.by_stretch import StreetFill
from unveil_core.inpaint.chart.street_chart import TEXEL_M, StreetChart, rows_of
from unveil_core.inpaint.frames.new_ground import displaced_by, ground_relit
from unveil_core.inpaint.light.view_light import ViewLight
from unveil_core.inpaint.street_scene import Removal, Views
from unveil_core.inpaint.stretches import AROUND_M, CASTS_M, QUIET_M, Stretch, cut_street


def level_street(frames: int) -> Ground:
    path = fit_path([f.camera for f in straight(frames, 1.0).frames])
    count = int((frames + 60) / 0.25)
    ones = np.ones(count)
    return Ground(path, -15.0, -8.0, 0.25, 0.25, np.zeros((count, 65)), 8 * ones, -8 * ones)


def stretches_of(frames: int, length_m: float, removed: np.ndarray) -> tuple[Ground, list[Stretch]]:
    drive, ground = straight(frames, 1.0), level_street(frames)
    return ground, cut_street(ground, cut_into_blocks(drive, length_m), [f.camera for f in drive.frames], removed)


@pytest.mark.parametrize("length_m", [1000.0, 100.0, 37.0])
def test_each_row_has_one_owner(length_m: float) -> None:
    ground, stretches = stretches_of(301, length_m, np.zeros((0, 3)))
    owned = np.concatenate([np.arange(*s.rows) for s in stretches])
    assert owned.tolist() == list(range(rows_of(ground)))
    at = np.linspace(-400, 700, 1000)
    assert (sum(s.owns(at).astype(int) for s in stretches) == 1).all()
    for stretch in stretches:
        assert stretch.around[0] <= stretch.rows[0] and stretch.rows[1] <= stretch.around[1]
        assert set(stretch.own) <= set(stretch.frames)
        if stretch.rows[0] > 0:
            assert (
                abs((stretch.rows[0] - stretch.around[0]) * TEXEL_M - AROUND_M) < 2 * TEXEL_M or stretch.around[0] == 0
            )


def test_a_drive_of_one_block_is_one_stretch_of_everything() -> None:
    ground, (only,) = stretches_of(80, 100.0, np.zeros((0, 3)))
    assert only.rows == only.around == (0, rows_of(ground)) and only.frames == tuple(range(80))


def test_stretches_part_beside_a_lorry_not_within_it() -> None:
    lorry = np.column_stack([np.linspace(95.0, 107.0, 500), np.full(500, 3.0), np.full(500, 1.0)])
    _, stretches = stretches_of(201, 100.0, lorry)
    border = stretches[0].s[1]
    assert border == stretches[1].s[0] and abs(border - 100.0) <= QUIET_M
    assert border < 95.0 or border > 107.0


def fill_of(frames: int, removal: Removal) -> StreetFill:
    ground, stretches = stretches_of(frames, 100.0, np.zeros((0, 3)))
    drive = straight(frames, 1.0)
    views = Views([], [], [], [])
    return StreetFill(drive, scene(("car",)), ground, removal, views, stretches, cache=FrameCache(), kept=Kept())


def crowd(count: int, length: float) -> Removal:
    generator = np.random.default_rng(count)
    places = generator.uniform([-15, -9, -0.3], [length + 15, 9, 0.6], (count, 3))
    gone = generator.random(count) < 0.3
    ids = np.where(gone, generator.integers(0, 9, count), 0)
    return Removal(surfels_at(places, generator.integers(0, 3, count)), gone, ids)


def test_a_stretch_is_given_what_is_near_it_and_finds_what_it_finds_in_all() -> None:
    removal = crowd(8000, 501.0)
    fill, surfels = fill_of(501, removal), removal.surfels
    means = surfels.means.double().numpy()
    sizes = []
    for stretch in fill.stretches:
        rows, columns = stretch.rows[1] - stretch.rows[0], 40
        generator = np.random.default_rng(stretch.number)
        chart = StreetChart(
            fill.ground,
            TEXEL_M,
            fill.ground.s_start + TEXEL_M * stretch.rows[0],
            -1.0,
            color=np.zeros((rows, columns, 3), np.float32),
            label=np.zeros((rows, columns), np.int16),
            source=np.ones((rows, columns), np.uint8),
            gain=generator.uniform(1.0, 3.0, (rows, columns, 3)).astype(np.float32),
            nearest=np.ones((rows, columns), np.float32),
            replaced=np.zeros((rows, columns), bool),
        )
        region = generator.random((rows, columns)) < 0.5
        near = fill.near(stretch)
        sizes.append(len(near))
        local = surfels.select(torch.from_numpy(near))
        for of_all, of_near in (
            (displaced_by(chart, region, surfels, [0, 1]), displaced_by(chart, region, local, [0, 1])),
            (ground_relit(chart, surfels), ground_relit(chart, local)),
        ):
            assert np.array_equal(np.flatnonzero(of_all), near[of_near]) and of_all.any()
        mask = np.isin(np.arange(len(surfels)), near) & removal.gone
        objects = [means[mask & (removal.instance == i)] for i in np.unique(removal.instance[mask]) if i > 0]
        assert all(np.array_equal(a, b) for a, b in zip(objects, removal.objects(near), strict=True))
        assert np.array_equal(means[mask & (removal.instance == 0)], removal.loose(near))
    assert len(sizes) == 5 and max(sizes) < 0.6 * len(surfels)


def test_only_cameras_near_a_stretch_are_asked_and_the_way_s_ends() -> None:
    fill = fill_of(1001, crowd(10, 1001.0))
    for stretch in fill.stretches:
        x = centres_of([fill.cameras[i] for i in fill._asked(stretch)])[:, 0]
        beyond = AROUND_M + CASTS_M + ASKED_M
        near = (x >= stretch.s[0] - beyond - 1) & (x <= stretch.s[1] + beyond + 1)
        assert abs(x[0]) < 1e-9 and abs(x[-1] - 1000.0) < 1e-9 and near[1:-1].all()
        assert set(np.round(x)) >= set(
            range(int(max(0, stretch.s[0] - beyond + 1)), int(min(1000, stretch.s[1] + beyond)))
        )
    (only,) = fill_of(80, crowd(10, 80.0)).stretches
    assert len(fill_of(80, crowd(10, 80.0))._asked(only)) == 80


def test_an_object_whose_shadow_stays_casts_it_though_it_goes() -> None:
    removal = crowd(4000, 501.0)
    fill = fill_of(501, removal)
    kept = fill_of(501, replace(removal, shadow_stays=frozenset({3, 5})))
    for before, after in zip(fill.stretches, kept.stretches, strict=True):
        near = fill.near(before)
        stays = np.isin(removal.instance[near], (3, 5)) & removal.gone[near]
        (of_all, goes), (of_kept, less) = fill._near(before), kept._near(after)
        assert stays.any() and len(less) == len(goes) - stays.sum() and len(of_kept) == len(of_all) + stays.sum()
        assert len(kept.removal.objects(near)) == len(removal.objects(near))  # its place is filled all the same


def test_pictures_of_one_camera_in_two_sizes_have_each_their_own_light() -> None:
    """A photograph that was turned, or reduced, shows the ground at other places."""
    ground, stretches = stretches_of(21, 20.0, np.zeros((0, 3)))
    drive = straight(21, 1.0)
    frames = [
        replace(f, camera=f.camera.resized(f.camera.width // 2, f.camera.height) if i % 2 else f.camera)
        for i, f in enumerate(drive.frames)
    ]
    drive = replace(drive, frames=tuple(frames))
    removal = crowd(50, 20.0)
    fill = StreetFill(
        drive, scene(("car",)), ground, removal, Views([], [], [], []), stretches, cache=FrameCache(), kept=Kept()
    )
    sizes = [(f.camera.width, f.camera.height) for f in frames]
    fields = tuple(PictureField.flat(size, 0.0) for size in fill._sizes)
    fill.light = ViewLight(fields, 0.0, 0.1, 0.2)
    assert len(set(sizes)) == 2
    for i, size in enumerate(sizes):
        field = fill.light_in(i)
        assert field is not None and field.size == size and field.plane().shape[:2] == size[::-1]
