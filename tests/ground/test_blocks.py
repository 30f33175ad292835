"""Blocks along the way: each frame and each place belongs to one, and neighbours that look in join."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.ground.test_street import look
from unveil_core.drives.drive import Drive, Frame, PointCloud
from unveil_core.ground.blocks import LOOKS_M, Blocks, cut_into_blocks


def drive_along(places: np.ndarray, headings: np.ndarray, name: str = "front", turned: float = 0.0) -> list[Frame]:
    return [
        Frame(f"{i:04d}", name, look(np.array([*p, 1.6]), h + turned), Path("x.png"), timestamp=0.1 * i)
        for i, (p, h) in enumerate(zip(places, headings, strict=True))
    ]


def drive_of(*tracks: list[Frame]) -> Drive:
    return Drive(Path("."), tuple(f for t in tracks for f in t), PointCloud(np.zeros((0, 3))))


def straight(count: int, step: float) -> Drive:
    x = step * np.arange(count)
    return drive_of(drive_along(np.stack([x, 0 * x], axis=1), 0 * x))


def check(blocks: Blocks, drive: Drive) -> None:
    own = [i for b in blocks.blocks for i in b.own]
    assert sorted(own) == list(range(len(drive.frames)))
    for k, block in enumerate(blocks.blocks):
        assert block.number == k and set(block.own) <= set(block.frames) and list(block.frames) == sorted(block.frames)


@settings(deadline=None, max_examples=30)
@given(st.integers(1, 400), st.floats(0.0, 4.0))
@example(226, 2.0)
def test_every_frame_has_one_block_of_about_the_length(count: int, step: float) -> None:
    drive = straight(count, step)
    blocks = cut_into_blocks(drive)
    check(blocks, drive)
    wanted = step * (count - 1) / 100
    if abs(wanted % 1 - 0.5) < 1e-9:  # halfway between two counts the last bits of the way decide
        return
    assert len(blocks.blocks) == max(1, round(wanted)) or step < 0.25


def test_frames_before_a_block_that_look_into_it_join_it() -> None:
    drive = straight(290, 1.0)  # no node of the way lies on a border, where rounding would decide
    first, second, third = cut_into_blocks(drive).blocks
    assert min(first.frames) == 0 and max(first.frames) == max(first.own)
    for block in (second, third):
        joined = set(block.frames) - set(block.own)
        assert joined == set(range(min(block.own) - int(max(LOOKS_M)), min(block.own)))


def test_a_camera_that_looks_back_joins_from_behind() -> None:
    x = np.arange(300.0)
    places = np.stack([x, 0 * x], axis=1)
    drive = drive_of(drive_along(places, 0 * x), drive_along(places, 0 * x, "rear", np.pi))
    blocks = cut_into_blocks(drive)
    check(blocks, drive)
    joined = [drive.frames[i] for i in set(blocks.blocks[1].frames) - set(blocks.blocks[1].own)]
    assert {f.camera_name for f in joined if f.camera.centre[0] < 100} == {"front"}
    assert {f.camera_name for f in joined if f.camera.centre[0] > 198} == {"rear"}


def test_a_red_light_is_no_way() -> None:
    generator = np.random.default_rng(0)
    x = np.concatenate([np.arange(0, 60.0), np.full(2000, 60.0), np.arange(60, 120.0)])
    places = np.stack([x, 0 * x], axis=1) + generator.normal(0, 0.01, (len(x), 2))
    assert len(cut_into_blocks(drive_of(drive_along(places, 0 * x))).blocks) == 1


def test_places_belong_to_the_nearest_piece_of_the_way_and_ends_reach_on() -> None:
    blocks = cut_into_blocks(straight(301, 1.0))
    places = np.array([[-80.0, 5, 0], [50, -30, 4], [101, 20, 0], [199, 3, 9], [201, 3, 9], [900, 0, 0]])
    assert blocks.of_places(places).tolist() == [0, 0, 1, 1, 2, 2]
    assert cut_into_blocks(straight(20, 1.0)).of_places(places).tolist() == [0] * 6


def test_where_the_way_comes_by_again_places_belong_to_the_first_time() -> None:
    angle = np.linspace(0, 4 * np.pi, 600)  # twice around a circle of 60 m
    places = 60 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    places += np.random.default_rng(0).normal(0, 0.2, places.shape)
    drive = drive_of(drive_along(places, angle + np.pi / 2))
    blocks = cut_into_blocks(drive)
    check(blocks, drive)
    assert len(blocks.blocks) >= 7
    beside = np.column_stack([66 * np.cos(angle), 66 * np.sin(angle), 0 * angle])
    owner = blocks.of_places(beside)
    assert (owner <= len(blocks.blocks) / 2).mean() > 0.95
