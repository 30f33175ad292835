"""Streets by seed: what is drawn is a street, and what is rendered of it is true.

Seeds from 28 on are held out for measuring: tests draw others.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from sample_scenes.generators.streets import cache as store
from sample_scenes.generators.streets.cameras import shots, station_distances
from sample_scenes.generators.streets.draw import SIZES, draw
from sample_scenes.generators.streets.exposure import base_gain, encode, gains
from sample_scenes.generators.streets.footprint import footprint
from sample_scenes.generators.streets.labels import noisy
from sample_scenes.generators.streets.path import STEP_M, bend_curvature, corner_curve, swept
from sample_scenes.generators.streets.plan import KINDS, LabelNoise, Plan
from sample_scenes.generators.streets.truth import true_picture
from sample_scenes.generators.streets.visibility import Shown, View, never_seen
from tests.blender_addon.run_in_blender import BLENDER, WITH_OTHERS
from unveil_core.base.pictures.decoding import read_image, read_instance_image, read_label_image
from unveil_core.drives import open_drive
from unveil_core.drives.importing.check import check_drive

ROOT = Path(__file__).resolve().parents[2]
SEEDS = range(100, 180)


@cache
def plan(seed: int) -> Plan:
    return draw(seed)


def test_a_seed_draws_one_street() -> None:
    first, second, other = draw(123), draw(123), draw(124)
    assert first.things == second.things and first.light == second.light and first.rig == second.rig
    assert [leg.lots for leg in first.legs] == [leg.lots for leg in second.legs]
    np.testing.assert_array_equal(first.route_xyz, second.route_xyz)
    assert first.things != other.things


def test_what_is_drawn_stays_in_its_range() -> None:
    for seed in SEEDS:
        found = plan(seed)
        rig, light, scanner = found.rig, found.light, found.scanner
        assert 1.2 <= rig.height <= 3.0 and 50 <= rig.fov <= 110 and 1.0 <= rig.step <= 4.0
        assert scanner.beams in (0, 16, 32, 64, 128) and light.drift < 0.5
        assert light.kind != "sun" or 12 <= light.elevation <= 66
        assert (rig.width, rig.height_px) == ((960, 640) if seed % 5 == 4 else (384, 256))
        assert len(shots(found)) == (12 if seed % 5 == 4 else 28)
        assert len(found.things) >= 2 and [t.number for t in found.things] == list(range(1, len(found.things) + 1))
        assert max(np.abs(np.diff(leg.path.z)).max() for leg in found.legs) < 0.16 * STEP_M


def test_all_there_is_to_draw_is_drawn() -> None:
    courses = Counter(str(plan(s).course["kind"]) for s in SEEDS)
    assert set(courses) == {"straight", "bend", "S", "junction"} and min(courses.values()) > 15
    assert {plan(s).light.kind for s in SEEDS} == {"sun", "overcast", "dusk"}
    kinds = Counter(t.kind for s in SEEDS for t in plan(s).things)
    assert set(kinds) == set(KINDS) and max(KINDS[k].size[0] for k in kinds) > 15
    for share in (
        np.mean([plan(s).rig.halt is not None for s in SEEDS]),
        np.mean([len(plan(s).rig.cameras) > 1 for s in SEEDS]),
        np.mean([plan(s).noise is not None for s in SEEDS]),
        np.mean([any(t.speed for t in plan(s).things) for s in SEEDS]),
        np.mean([plan(s).light.drift > 0 for s in SEEDS]),
        np.mean([plan(s).legs[0].section.tram for s in SEEDS]),
    ):
        assert 0.1 < share < 0.6
    styles = {lot.style for s in SEEDS for leg in plan(s).legs for lot in leg.lots}
    assert {"plaster", "brick", "shop", "office", "house", "garden", "hedge", "wall", "gap"} <= styles


def test_the_way_is_smooth() -> None:
    for seed in SEEDS:
        found = plan(seed)
        steps = np.linalg.norm(np.diff(found.route_xyz[:, :2], axis=0), axis=1)
        assert (np.abs(steps - 0.25) < 0.06).all()
        assert np.abs(np.diff(found.route_angle)).max() < 0.25 / 6.0
        assert np.abs(np.diff(found.route_xyz[:, 2], n=2)).max() < 0.02
        # The way is where it points to.
        along = np.unwrap(np.arctan2(*np.diff(found.route_xyz[:, :2], axis=0).T[::-1]))
        assert np.abs(np.remainder(along - found.route_angle[:-1] + np.pi, 2 * np.pi) - np.pi).max() < 0.12


def test_a_bend_turns_as_far_as_it_should() -> None:
    path = swept(-10, 120, lambda s: bend_curvature(s, 20.0, -0.8, 40.0), np.zeros_like)
    assert path.heading(110.0) == pytest.approx(-0.8, abs=0.01) and np.abs(path.curvature).max() <= 1 / 40 + 1e-9
    assert path.heading(0.0) == 0.0
    left = path.place(0.0, 2.0, 0.5)
    np.testing.assert_allclose(left, (0.0, 2.0, 0.5), atol=1e-9)


def test_a_corner_touches_both_lines() -> None:
    u, v = np.array([1.0, 0.0]), np.array([0.0, -1.0])
    arc, before, along = corner_curve(np.array([0.0, -2.0]), u, np.array([10.0, 0.0]), v, 5.0)
    np.testing.assert_allclose(arc[0], (5.0, -2.0), atol=1e-9)
    np.testing.assert_allclose(arc[-1], (10.0, -7.0), atol=1e-9)
    assert (before, along) == (pytest.approx(5.0), pytest.approx(10.0))


def test_cameras_keep_off_things() -> None:
    for seed in SEEDS[::3]:
        found = plan(seed)
        frames = [s for s in shots(found) if s.camera == "front"]
        for thing in found.things:
            here = footprint(thing, found.legs)
            for shot in frames:
                at = footprint(thing, found.legs, shot.time) if thing.speed else here
                assert at.distance(shot.pose[:2, 3]) > 0.9


def test_things_keep_off_each_other_and_off_posts() -> None:
    for seed in SEEDS[::4]:
        found = plan(seed)
        prints = [footprint(t, found.legs) for t in found.things]
        for k, one in enumerate(prints):
            assert not any(one.overlaps(other) for other in prints[:k])
            assert all(one.distance(leg.path.place(p.s, p.t)[:2]) > 0.3 for leg in found.legs for p in leg.posts)


def test_a_turn_at_a_junction_stays_on_the_carriageway() -> None:
    turns = [plan(s) for s in SEEDS if plan(s).corners]
    for found in turns:
        arcs = np.concatenate([np.array(c.arc) for c in found.corners])
        apart = np.linalg.norm(found.route_xyz[:, None, :2] - arcs[None], axis=2)
        assert apart.min() > 1.1


def test_a_halt_repeats_a_place_and_its_poses_are_noisy() -> None:
    found = next(plan(s) for s in SEEDS if plan(s).rig.halt is not None and len(plan(s).rig.cameras) == 1)
    first, last = found.rig.halt or (0, 0)
    frames = shots(found)
    true = np.stack([f.pose[:3, 3] for f in frames])
    told = np.stack([f.told[:3, 3] for f in frames])
    assert np.ptp(true[first : last + 1], axis=0).max() == 0
    off = np.linalg.norm(told - true, axis=1)
    assert 0.001 < off[first : last + 1].mean() < 0.03 and np.delete(off, range(first, last + 1)).max() == 0
    times = [f.time for f in frames]
    assert np.diff(times).min() > 0 and len(set(station_distances(found.rig))) == len(frames) - (last - first)


def test_label_noise_has_its_size() -> None:
    labels = np.zeros((256, 384), np.int64)
    labels[:, 192:] = 2
    ids = np.zeros_like(labels)
    ids[100:160, 100:140] = 7
    labels[ids == 7] = 13
    rng = np.random.default_rng(0)
    border = []
    for _ in range(10):
        found, numbers = noisy(labels, ids, LabelNoise(1.5, 0.0, 0.0), rng)
        border.append(np.abs((found[170:] == 0).sum(axis=1) - 192).mean())
        assert np.array_equal(found == 13, numbers == 7)
    # Of a shift's two components a straight border shows one: root of a half, and of a normal variable 0.8 on average.
    assert 0.4 < np.mean(border) < 1.5
    missed = [noisy(labels, ids, LabelNoise(0.0, 0.0, 0.3), rng)[1].max() == 0 for _ in range(60)]
    assert 8 <= sum(missed) <= 30
    gone, _ = noisy(labels, ids, LabelNoise(0.0, 0.0, 1.0), rng)
    assert not (gone == 13).any()
    specks, _ = noisy(labels, np.zeros_like(ids), LabelNoise(0.0, 30.0, 0.0), rng)
    assert 20 < (specks != labels).sum() < 2500


def test_exposure_meets_its_level_and_drifts_smoothly() -> None:
    light = np.random.default_rng(0).gamma(2.0, 3.0, (60, 80, 3))
    gain = base_gain([light], 0.4)
    assert encode(light, gain).mean() / 255 == pytest.approx(0.4, abs=0.01)
    drifting = next(plan(s).light for s in SEEDS if plan(s).light.drift)
    stops = np.log2(gains(drifting, 0, 28, 1.0))
    assert 0.05 < np.ptp(stops) < 2 and np.abs(np.diff(stops)).max() < 0.6


def test_the_truth_is_the_input_where_nothing_went() -> None:
    rng = np.random.default_rng(1)
    full = rng.integers(90, 120, (80, 100, 3)).astype(np.uint8)
    empty = np.clip(full.astype(int) + rng.integers(-1, 2, full.shape), 0, 255).astype(np.uint8)
    removed = np.zeros((80, 100), bool)
    removed[30:50, 30:60] = True
    empty[30:60, 30:60] += 60
    true = true_picture(full, empty, removed)
    changed = cv2.dilate(removed.astype(np.uint8), np.ones((41, 41), np.uint8)) > 0
    np.testing.assert_array_equal(true[~changed], full[~changed])
    np.testing.assert_array_equal(true[32:58, 32:58], empty[32:58, 32:58])


def test_a_place_behind_a_thing_is_unseen_and_one_beside_it_is_not() -> None:
    pose = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 1.6], [0, 0, 0, 1]])
    view = View(pose, 96, 64, 70.0)
    down = view.rays()[..., 2] < -1e-3
    depth = np.where(down, -1.6 / np.minimum(view.rays()[..., 2], -1e-3), np.inf)
    normal = np.zeros((64, 96, 3)) + (0, 0, 1)
    moved = pose.copy()
    moved[:3, 3] += (0.3, 0.2, 0.0)
    asked = down & (depth < 20)
    asked[:, :16] = asked[:, -16:] = asked[-12:] = False
    free = np.zeros_like(asked)
    other = View(moved, 96, 64, 70.0)
    assert not never_seen(view, asked, depth, normal, [Shown(other, depth, free)]).any()
    assert np.array_equal(never_seen(view, asked, depth, normal, [Shown(other, depth, ~free)]), asked)


def test_a_street_is_made_once_and_never_by_half(tmp_path: Path) -> None:
    place = store.street_folder(3, tmp_path, "tiny")
    assert store.version() in place.parts and place != store.street_folder(3, tmp_path)

    def fails(folder: Path) -> None:
        (folder / "images").mkdir()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        store.kept(place, fails)
    assert not place.exists() and list(place.parent.iterdir()) == []
    assert store.kept(place, lambda folder: (folder / "a").write_text("1"))
    assert not store.kept(place, fails) and (place / "a").read_text() == "1"


@pytest.mark.skipif(not BLENDER.is_file(), reason="Blender's Python module is an extra")
def test_a_rendered_street_is_a_drive_with_its_truth(tmp_path: Path) -> None:
    script = ROOT / "sample_scenes/generators/streets/make_streets.py"
    start = f"{WITH_OTHERS}import runpy; sys.argv[0] = {str(script)!r}; sys.path.insert(0, {str(script.parent)!r}); "
    run = "runpy.run_path(sys.argv[0], run_name='__main__')"
    command = [str(BLENDER), "-c", start + run, "--seeds", "2", "--size", "tiny"]
    out = subprocess.run(
        [*command, "--cache", str(tmp_path)], capture_output=True, text=True, timeout=300, env={**os.environ}
    )
    assert out.returncode == 0, out.stderr[-800:]
    folder = store.street_folder(2, tmp_path, "tiny")
    drive = open_drive(folder)
    check_drive(drive)
    told = json.loads((folder / "street.json").read_text())
    assert len(drive.frames) == SIZES["tiny"][2] and drive.truth_root is not None and told["seed"] == 2
    assert len(drive.points.positions) > 5000 and drive.scale_source == "metric"
    outside = []
    for frame in drive.frames:
        stem = frame.name
        full, true = read_image(frame.image_path), read_image(folder / f"truth/images/{stem}.jpg")
        removed = read_label_image(folder / f"truth/removed/{stem}.png") > 0
        shadow = read_label_image(folder / f"truth/shadow/{stem}.png") > 0
        unseen = read_label_image(folder / f"truth/unseen/{stem}.png") > 0
        assert not (unseen & ~removed).any() and not (shadow & removed).any()
        far = cv2.dilate((removed | shadow).astype(np.uint8), np.ones((9, 9), np.uint8)) == 0
        apart = np.abs(full.astype(float) - true.astype(float))
        outside.append(apart[far].mean())
        assert apart[removed].mean() > 12 and np.isfinite(outside[-1]) and removed.mean() > 0.01
        depth = read_instance_image(folder / f"truth/depth/{stem}.png")
        assert depth.shape == (full.shape[0] // 2, full.shape[1] // 2) and 0.3 < (depth > 0).mean() < 1
    assert np.mean(outside) < 1.5
    assert len(list((folder / "truth/free/images").glob("*.jpg"))) == told["free_views"]
